"""Orbits as segments whose lengths are unknowns.

The signature of an orbit is the list of its contact switches. Its unknowns are the state at a phase of the loads, the
anchor, and the lengths of the segments up to each switch in rad of the loads. The equations say that the state returns
and that every contact switches at its gap. If a contact has switched before, its equation is the change of its
coordinate since then, divided by the length in between. In this form a touch may have the length zero, and the orbit
just grazes the contact. All equations are analytic in the unknowns and in the parameter, through such a grazing too.

An impact on a rigid stop is a switch that leaves the contact open; the state passes a linear map there. A slider
switches where its speed is zero, or where its reaction reaches the limit at which it breaks away.

In Newton's method the states in which segments begin are unknowns too. A stiff contact magnifies differences, from one
touch to the next, until no Newton step from the state at the anchor alone would converge. What a segment misses of the
state in which the next one begins is one more column, so linear systems stay small (J. Albersmeyer, M. Diehl, SIAM J.
Optim. 20, 2010, doi:10.1137/080724885).

H. Dankowicz, F. Schilder, Recipes for Continuation, SIAM 2013, doi:10.1137/1.9781611972573 (segments as unknowns).
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array, Complex
from vofem.errors import ConvergenceError
from vofem.integrators.event_driven.along import Path
from vofem.integrators.event_driven.flow import Flow, FlowEvent
from vofem.laws.friction import DOWN, UP
from vofem.linalg.eigen import eigenvalues
from vofem.studies.steady.newton import Evaluation, direction
from vofem.studies.steady.orbit import DECIDED, PeriodicOrbit
from vofem.studies.steady.segments.extremes import LEAST, Extreme, turning_points
from vofem.studies.steady.segments.gaps import ROUNDING, Gaps, law_of
from vofem.studies.steady.segments.settling import SETTLES, bounces_of, settled
from vofem.studies.steady.segments.shooting import CLOSES, Shooting, relative, share
from vofem.studies.steady.segments.sticking import centring, excess, places_of, released
from vofem.studies.steady.segments.switches import AT_ONCE, Switch, Switches
from vofem.system import CLOSED, PINNED

#: Steps of an orbit from which its range is refined, and the least number in a segment.
_RANGE, _LEAST_RANGE = 600, 16

#: The anchor is moved if a switch comes nearer to it than this share of the longest segment.
_NEAR_ANCHOR = 0.15

#: Height of an extreme or a touch, over the size of the motion, up to which an orbit grazes a contact.
_GRAZED = 1e-12

#: Difference of phases, over the orbit, up to which a switch of a flow is one of the signature.
_SAME = 1e-5

#: Error of an evaluation that may be rounding.
_SOLVED = 1e-10

#: Switches in an orbit whose times are unknowns: the work grows with their square, and is minutes for more of them.
MOST_SWITCHES = 2000

#: Factor by which an impact may be faster or slower than that in which a body comes to rest.
_ALLOWED = 2.0

#: Rounding of the unknowns, as a share of them, and signs with which it is tried.
_DIGITS, _SIGNS = 1e-15, ((1.0, -1.0), (1.0, 1.0, -1.0), (-1.0, 1.0, 1.0, 1.0, -1.0))

#: A branch is followed through orbits of which a run misses so much by rounding: where it misses more, chance decides.
#: Parts of an orbit that are run where a whole run misses something.
_TOLD, _PARTS = 1e-6, 8

#: Distance in rad from a grazing at which runs begin and end that are not to touch there.
_ASIDE = 1e-3

#: Length in rad of a touch that may be lost in rounding.
_SHORT = 1e-5

#: Rounding error of a multiplier, divided by its condition and the size of the monodromy matrix.
_EPS = 64.0 * float(np.finfo(float).eps)

#: Relative difference of times that are one, and share of the jump of a force by which it lacks its limit before.
_INSTANT, _LACKS = 1e-14, 1e-9

#: Condition of the equations of the switches above which multipliers need a generalised eigenvalue problem.
_SINGULAR = 1e3


class States(NamedTuple):
    """Where segments begin: coordinates of a signature, shape (m,), and the states there in unknowns, (k + 1, 2n)."""

    y: Array
    states: Array


@dataclass(frozen=True)
class SignatureEvaluation(Evaluation):
    """The equations of the orbits of a signature at some unknowns."""

    chart: Signature
    problem: Shooting
    y: Array  #: The unknowns, shape (m,).
    path: Path  #: The motion through the segments.
    residual: Array  #: Shape (m,); to first order that of segments that begin where those before end.
    jacobian: Array  #: Empty without derivatives, shape (m, m).
    error: float  #: The largest residual, or what segments miss of the next ones, over the size of the motion.
    sizes: tuple[float, float]  #: Sizes of modal displacements and velocities.
    #: Sizes by which the equations of the switches were divided, shape (k,); derivatives do not tell how these change.
    divisors: Array

    @property
    def solved(self) -> float:
        """An error that may be rounding."""
        return _SOLVED

    @property
    def states(self) -> Array:
        """The states in unknowns in which the segments begin, shape (k + 1, 2n)."""
        return self.problem.unmodal(self.path.begins.T).T

    def after(self, moved: Array) -> States:
        """Return where segments begin, to first order, after a step of the coordinates, shape (m,), if it is known."""
        count, n = self.path.columns.shape[1], self.problem.size
        if count < moved.size:
            return States(self.y, self.states)
        along = np.append(moved, 1.0)[:count]
        begins = self.chart.begins(self.path, along)
        begins[0] = self.problem.modal(self.y[:n] + moved[:n])
        return States(self.y + moved, self.problem.unmodal(begins.T).T)

    @property
    def reached(self) -> Array:
        """To first order the states in unknowns in which segments begin if they follow those before, (k + 1, 2n)."""
        along = np.zeros(self.path.columns.shape[1])
        if along.size != self.y.size:
            # The last column tells what segments miss.
            along[-1:] = 1.0
        return self.problem.unmodal(self.chart.begins(self.path, along).T).T

    def stripped(self) -> SignatureEvaluation:
        """Return the evaluation without the columns of its segments, which take memory."""
        return replace(self, path=self.path.stripped())

    def range_of(self, row: Array) -> tuple[float, float]:
        """Return the least and the largest value of a row over the free degrees of freedom, shape (n,)."""
        rows, segments = self.problem.modal_row(row)[None], np.flatnonzero(self.path.durations > 0.0)
        of, tau, (u,), (rate,) = self.path.sampled(rows, segments, self.gaps.steps(segments, _RANGE, _LEAST_RANGE))
        # Only neighbours of the largest samples are refined, because no other sample can be an extreme.
        i = np.flatnonzero((rate[:-1] * rate[1:] < 0.0) & (of[:-1] == of[1:]))
        both = np.stack([i, i + 1])
        reach = np.abs(rate[both]).max(axis=0) * (tau[i + 1] - tau[i])
        i = i[(u[both].min(axis=0) - reach < u.min()) | (u[both].max(axis=0) + reach > u.max())]
        _, turned = turning_points(self.path.rows(rows, of[i]), np.zeros_like(i), tau[i], tau[i + 1])
        return float(np.append(u, turned).min()), float(np.append(u, turned).max())

    @cached_property
    def gaps(self) -> Gaps:
        """The gap functions along the orbit."""
        return Gaps(self.problem, self.path, self.chart, self.sizes)

    @property
    def extremes(self) -> list[Extreme]:
        """The extremes of all gap functions inside segments at which the contact might switch."""
        return self.gaps.extremes

    @cached_property
    def margins(self) -> dict[int, tuple[float, float]]:
        """By how much reactions of sliders would exceed their limits where they turn without sticking.

        They and what of them is rounding are shares of the limits, by the numbers of the switches.
        """
        sliders, found, path = self.problem.course.sliders, {}, self.path
        if sliders is None:
            return {}
        for k, (contact, status, _) in enumerate(self.chart.switches):
            if status > PINNED and self.chart.statuses[k][contact] > PINNED:
                # What its turn lets go of slides by then.
                stuck = self.chart.statuses[self.chart.together(k).stop].copy()
                stuck[contact] = PINNED
                time, limit = float(path.times[k] + path.durations[k]), sliders.static[contact - sliders.first]
                over, rounding = excess(self.problem, stuck, time, path.ends[k], contact, status)
                found[k] = over / limit, max(rounding / limit, ROUNDING)
        return found

    @cached_property
    def caused(self) -> dict[tuple[int, int], tuple[float, float]]:
        """By how much the forces of what is released at once lack its limit before, and exceed it after, in N.

        They and their rounding come by the numbers of the cause and the release, and by that of the release twice.
        """
        problem, chart, path, found = self.problem, self.chart, self.path, dict[tuple[int, int], tuple[float, float]]()
        rows, sliders = problem.space.contacts, problem.course.sliders
        for k, (contact, status, at_once) in enumerate(chart.switches):
            if not at_once:
                continue
            cause, time = chart.causes[k], float(path.times[k])
            before = excess(problem, chart.statuses[cause], time, path.ends[cause], contact, status)
            after = excess(problem, chart.statuses[k], time, path.starts[k], contact, status)
            rounding = max(before[1], after[1], _LACKS * abs(after[0] - before[0]))
            found[cause, k] = -before[0], rounding
            struck = chart.struck[cause]
            if struck < 0 or sliders is None or contact < sliders.first or rows[struck] @ rows[contact] == 0.0:
                # An impact moves what a slider holds.
                found[k, k] = after[0], rounding
        return found

    @property
    def grazes(self) -> str:
        """Name of a contact whose force jumps and that the orbit grazes within rounding; empty without one.

        It may touch the contact for a short time: a parabola is as high as a quarter of its time times its first rate.
        """
        laws, rows, path = self.problem.system.contacts, self.problem.space.contacts, self.path
        assert laws is not None
        n = self.problem.size // 2
        heights = [(e.contact, abs(e.height)) for e in self.extremes]
        for p, k in self.chart.touches:
            contact, time = self.chart.switches[p].contact, float(path.durations[p + 1 : k + 1].sum())
            rate = float(rows[contact] @ path.ends[p, n:])
            heights.append((contact, 0.25 * abs(time * rate) / float(self.gaps.size_of(contact))))
        return next((laws.names[j] for j, height in heights if laws.jumps[j] and height <= _GRAZED), "")

    @cached_property
    def _ran(self) -> tuple[bool, float]:
        """Whether an ordinary run from t = 0 takes the same switches, and by how much its ends differ.

        It starts from the state of the orbit, rounded as in a user's run.
        """
        problem = self.problem
        start = problem.from_state(problem.state(self.chart.unknowns(problem, self.y, self)))
        flow = problem.run(start, check=True)
        return self.chart.follows(self.y, flow.events, problem.loads.omega), self._missed(flow, start)

    @property
    def closing(self) -> float:
        """Difference of both ends of an ordinary run over the orbit from t = 0, over the size of the motion."""
        return self._ran[1]

    @property
    def closes(self) -> bool:
        """Whether an ordinary run over the orbit comes back, whichever switches it takes."""
        return self.closing <= max(CLOSES, self.rounding)

    @cached_property
    def repeats(self) -> bool:
        """Whether an ordinary run over the orbit takes the same switches and comes back.

        Where the orbit switches just at t = 0, a run from the phase of `y` may do so alone. Where rounding grows too
        much in one run, runs over parts of the orbit tell.
        """
        follows, away = self._ran
        if (follows and away <= CLOSES) or self._repeats_in(1):
            return True
        return away <= _TOLD and self.rounding > CLOSES and self._repeats_in(_PARTS)

    def _repeats_in(self, parts: int) -> bool:
        """Return whether runs over parts of the orbit take the same switches and end where the next ones begin.

        The first begins at the phase of `y`, the others in the longest segments between.
        """
        chart, problem, path = self.chart, self.problem, self.path
        edges = np.linspace(0, len(chart.switches) + 1, parts + 1).astype(int)
        begins = [(0, 0.0, self.y[: problem.size])]
        for low, high in itertools.pairwise(edges[1:].tolist()):
            if high > low:
                k = low + int(np.argmax(path.durations[low:high]))
                tau = 0.5 * float(path.durations[k])
                begins.append((k, tau, problem.unmodal(path.state(k, tau))))
        phases = [(float(path.times[k]) + tau) * problem.loads.omega for k, tau, _ in begins]
        phases = [chart.anchor, *phases[1:], chart.anchor + chart.turn]
        ends, events = [state for *_, state in (*begins[1:], begins[0])], list[FlowEvent]()
        for (k, _, state), end, begin, stop in zip(begins, ends, phases[:-1], phases[1:], strict=True):
            if not self._as_begun(state, chart.statuses[k]):
                return False
            flow = problem.run(state, begin, chart.statuses[k].tolist(), stop - begin, check=True)
            events += flow.events
            if self._missed(flow, end) > CLOSES:
                return False
        return chart.follows(self.y, events, problem.loads.omega)

    def repeats_around(self, phase: float) -> bool:
        """Return whether a run repeats from just behind a phase in rad to just before it.

        Where an orbit grazes a contact whose force jumps, or a rigid stop, rounding decides whether a run touches it.
        """
        chart, problem, path, omega = self.chart, self.problem, self.path, self.problem.loads.omega
        phase = chart.anchor + (phase - chart.anchor) % chart.turn
        edges = np.concatenate([[chart.anchor], chart.phases(self.y), [chart.anchor + chart.turn]])
        k = int(np.searchsorted(edges[1:-1], phase))
        aside = min(_ASIDE, 0.5 * float(phase - edges[k]), 0.5 * float(edges[k + 1] - phase))
        begin, end = (
            problem.unmodal(path.state(k, (phase + way * aside) / omega - float(path.times[k]))) for way in (1.0, -1.0)
        )
        flow = problem.run(begin, phase + aside, chart.statuses[k].tolist(), chart.turn - 2.0 * aside, check=True)
        return self._missed(flow, end) <= CLOSES and chart.follows(self.y, flow.events, omega)

    def _as_begun(self, state: Array, status: NDArray[np.int64]) -> bool:
        """Return whether contacts are open or closed in a state in unknowns as their status says; runs take its word.

        `status` has shape (n_contacts,).
        """
        laws = self.problem.system.contacts
        assert laws is not None
        z, _ = self.problem.to_modes(state)
        inside, allowed = self.problem.space.contacts @ z - laws.gap, CLOSES * self.gaps.size_of(range(len(laws)))
        return bool(np.all((np.where(status == CLOSED, -inside, inside) <= allowed)[status < PINNED]))

    def _missed(self, flow: Flow, end: Array) -> float:
        """Return the difference of the end of a flow from a state in unknowns, over the size of the motion."""
        return relative(self.problem.to_unknowns(flow.displacement, flow.velocity) - end, self.sizes)

    @property
    def missed(self) -> float:
        """What any run may miss after the orbit.

        Where forces jump rounding decides whether a contact rests, so that one run does not tell. There twice the
        estimate counts.
        """
        return max(self.closing, 2.0 * self.rounding) if self._jumps else self.closing

    @property
    def _jumps(self) -> bool:
        """Whether forces of contacts jump at their gaps."""
        laws = self.problem.system.contacts
        return laws is not None and bool(laws.jumps.any())

    @cached_property
    def held(self) -> Array:
        """The Jacobian matrix where sliders that stick all along keep their places; that of multipliers."""
        places, n = places_of(self.problem, self.chart.statuses), self.problem.size
        if places is None or not self.jacobian.size:
            return self.jacobian
        found = self.jacobian.copy()
        found[:n, :n] += np.eye(n)
        moved = self.problem.modal(found[:n])
        found[:n] = self.problem.unmodal(moved - places.moves @ (places.rows @ moved))
        found[:n, :n] -= np.eye(n)
        return found

    @cached_property
    def monodromy(self) -> Array | None:
        """Derivative of the state after an orbit, shape (2n, 2n); None where a contact whose force jumps is grazed."""
        n = self.problem.size
        closes, switches = self.held[:n], self.held[n:]
        matrix = closes[:, :n] + np.eye(n)
        if not np.all(np.isfinite(self.jacobian)):
            raise ConvergenceError("the derivative of an orbit is not finite")
        if self.chart.smooth(self.problem) or not switches.size:
            return np.asarray(matrix)
        speeds = self.chart.approaches(self.problem, self).items()
        if min((v for k, v in speeds if k not in self.chart.settling), default=np.inf) * _SINGULAR <= self.sizes[1]:
            return None
        norms = np.linalg.norm(switches[:, n:], axis=1)
        if not norms.all():
            return None
        # What a damper does in a short touch vanishes with it, so that its own short rates are no grazing.
        hard = [k for k, s in enumerate(self.chart.switches) if law_of(self.problem, s.contact) != "smooth"]
        rates = switches[np.ix_(hard, [n + k for k in hard])] / norms[hard, None]
        if hard and np.linalg.cond(rates) >= _SINGULAR:
            return None
        return np.asarray(matrix - closes[:, n:] @ np.linalg.solve(switches[:, n:], switches[:, :n]))

    @cached_property
    def rounding(self) -> float:
        """Change over an orbit, over the size of the motion, that rounding may cause.

        Rounding in a segment grows in those after it, so it is measured: by how much the equations change with rounded
        unknowns. A run moves its switches until their equations hold, and its end moves with them.
        """
        if not np.all(np.isfinite(self.jacobian)):
            return 0.0
        n, left = self.problem.size, np.zeros_like(self.residual)
        exact = self.chart.evaluate(self.problem, self.y, derivative=False).residual
        for signs in _SIGNS:
            rounded = self.y * (1.0 + _DIGITS * np.resize(signs, self.y.size))
            moved = self.chart.evaluate(self.problem, rounded, derivative=False)
            left = np.maximum(left, np.abs(moved.residual - exact))
        closes, switches = left[:n], left[n:]
        if switches.size and not self.chart.smooth(self.problem):
            carried = direction(self.jacobian[n:, n:].T, self.jacobian[:n, n:].T)
            closes = closes + np.abs(carried.T) @ switches
        return min(max(relative(closes, self.sizes), float(switches.max(initial=0.0))), _TOLD)

    @cached_property
    def uncertainty(self) -> float:
        """Estimated rounding error of the modulus of the largest multipliers."""
        from scipy.linalg import eig

        matrix = self.monodromy
        if matrix is None or not matrix.size:
            return DECIDED
        values, left, right = eig(matrix, left=True, right=True)
        close = np.abs(np.sum(left.conj() * right, axis=0))
        loss = _EPS * float(np.linalg.norm(matrix, 2)) / np.maximum(close, np.finfo(float).eps)
        near = np.abs(np.abs(values) - 1.0) <= np.maximum(loss, DECIDED)
        return float(max(DECIDED, np.max(np.minimum(loss, 0.1)[near], initial=0.0)))

    @cached_property
    def multipliers(self) -> Complex:
        """Eigenvalues of the monodromy matrix; infinite where a contact whose force jumps is grazed."""
        if self.monodromy is not None:
            return eigenvalues(self.monodromy)
        n = self.problem.size
        from scipy.linalg import eig

        right = np.zeros_like(self.held)
        right[:n, :n] = np.eye(n)
        # In scaled coordinates: else rounding of the largest unit is left in all.
        scales = self.chart.scales(self.problem, self)
        left = (self.held + right) * scales / scales[:, None]
        a, b = eig(left, right, right=False, homogeneous_eigvals=True)
        # The lengths of segments add as many infinite values.
        order = np.argsort(-np.abs(b) / np.hypot(np.abs(a), np.abs(b)))[:n]
        a, b = a[order], b[order]
        tiny = np.abs(b) <= 1e-15 * np.abs(a)
        return np.where(tiny, np.inf, a / np.where(tiny, 1.0, b))


@dataclass(frozen=True)
class Signature(Switches):
    """The contact switches of orbits, and the coordinates that belong to them."""

    #: Orbits are divided into segments, whose switches are watched, and which begin in states that are unknowns too.
    segmented: ClassVar[bool] = True
    lifted: ClassVar[bool] = True
    widened: ClassVar[float] = 1.0

    # -- equations ------------------------------------------------------------------------------------

    def evaluate(
        self, problem: Shooting, y: Array, *, derivative: bool = True, near: SignatureEvaluation | States | None = None
    ) -> SignatureEvaluation:
        """Return the equations; raise `ConvergenceError` if the motion cannot be followed.

        `near`: states in which segments begin at coordinates nearby, from which those here follow to first order. By
        default each segment begins where the one before ends.
        """
        n, k = problem.size, len(self.switches)
        omega, lengths = problem.loads.omega, self.lengths(y)
        if not np.all(np.isfinite(y)) or np.any(lengths < -0.5 * self.turn):
            raise ConvergenceError("the iteration diverged: an unknown has no bound")
        given = None if near is None or not k else self._begins(problem, y, near)
        m, lifted = (n + k) * derivative, given is not None
        columns, lengthen = np.zeros((n, m + lifted)), np.zeros((k + 1, m + lifted))
        if derivative:
            columns[:, :n] = problem.modal(np.eye(n))
            lengthen[:k, n:m] = np.eye(k) / omega
            lengthen[k, n:m] = -1.0 / omega
        problem.work.begin()
        problem.work.flows += derivative
        path = problem.course.along(
            self.anchor / omega, problem.modal(y[:n]), self.statuses, lengths / omega, columns, lengthen,
            struck=self.struck, every=derivative or lifted, given=given,
        )  # fmt: skip
        # Where all is at rest, rounding is compared with what sliders can hold.
        least = problem.least
        path = replace(path, sizes=(max(path.sizes[0], least), max(path.sizes[1], omega * least))) if least else path
        residual, jacobian = np.empty(n + k), np.empty((m, m))
        closing, places = problem.unmodal(path.ends[-1]) - y[:n], places_of(problem, self.statuses)
        moved = path.columns
        if places is not None:
            off, centred = centring(problem, path, places, columns, lengthen)
            closing = closing + problem.unmodal(places.moves @ off)
            moved = moved + places.moves @ centred
        residual[:n] = closing
        error = max(relative(closing, path.sizes), share(path.missed, path.sizes))
        if derivative:
            jacobian[:n] = problem.unmodal(moved[:, :m])
            jacobian[:n, :n] -= np.eye(n)
        sizes = np.ones(0)
        if k:
            values, rows, sizes = self._switching(problem, path)
            residual[n:] = values / sizes
            error = max(error, float(np.abs(residual[n:]).max()))
            if derivative:
                jacobian[n:] = rows[:, :m] / sizes[:, None]
            if lifted:
                residual += np.concatenate([problem.unmodal(moved[:, m]), rows[:, m] / sizes])
        if not np.all(np.isfinite(residual)):
            error = np.inf
        return SignatureEvaluation(self, problem, y.copy(), path, residual, jacobian, error, path.sizes, sizes)

    def _begins(self, problem: Shooting, y: Array, near: SignatureEvaluation | States) -> Array:
        """Return modal states in which segments begin, shape (k + 1, 2n), from those at coordinates nearby."""
        begins, omega = problem.modal(near.states.T).T, problem.loads.omega
        moved = y - near.y
        if not moved.any():
            return begins
        path = problem.course.along(
            self.anchor / omega, begins[0], self.statuses, self.lengths(near.y) / omega,
            problem.modal(moved[: problem.size])[:, None], self.rates(np.append(moved, 0.0))[:, None] / omega,
            struck=self.struck, every=True, given=begins,
        )  # fmt: skip
        return self.begins(path, np.ones(1))

    def begins(self, path: Path, along: Array) -> Array:
        """Return modal states (k + 1, 2n) in which segments begin, to first order, after steps along columns."""
        ends, course = path.ends + path.all_columns @ along, path.course
        n, rows = ends.shape[1] // 2, course.space.contacts
        for index, stop in enumerate(self.struck):
            if stop >= 0:
                ends[index, n:] -= course.kick[stop] * (rows[stop] @ ends[index, n:]) * rows[stop]
        return np.concatenate([path.begins[:1], ends[:-1]])

    def smooth(self, problem: Shooting) -> bool:
        """Return whether the motion has a continuous derivative through all switches."""
        laws = problem.system.contacts
        if laws is None:
            return True
        used = sorted({s.contact for s in self.switches})
        if max(self.struck, default=-1) >= 0 or any(s.status > PINNED for s in self.switches):
            return False
        return not np.any((laws.jump & (laws.gap > 0.0))[used] | (laws.damping[used] > 0.0))

    def _switching(self, problem: Shooting, path: Path) -> tuple[Array, Array, Array]:
        """Return the equations of k switches: values (k,), derivatives (k, columns), and sizes to compare with (k,)."""
        laws, rows = problem.system.contacts, problem.space.contacts
        assert laws is not None
        n, k = rows.shape[1], len(self.switches)
        contacts, number = self._contacts, np.arange(k)
        norms = np.linalg.norm(rows, axis=1)[contacts]
        # The coordinate is at the gap.
        gap = laws.gap[contacts]
        values = np.einsum("ij,ij->i", rows[contacts], path.ends[:k, :n]) - gap
        derived = path.end_rows[number, contacts]
        sizes = np.maximum(norms * path.sizes[0], np.abs(gap))
        # It changes as much as nothing from one switch of a contact to its next one.
        again = self._again
        values[again] = path.means[again, contacts[again]]
        derived[again] = path.mean_rows[again, contacts[again]]
        sizes[again] = norms[again] * path.sizes[1]
        for index in again.tolist():
            since = self._since[index]
            assert since is not None
            if since < index - 1:
                values[index], derived[index] = _mean(path, int(contacts[index]), since, index)
        for index, (contact, status, at_once) in enumerate(self.switches):
            before = self.statuses[index][contact]
            if at_once:
                # It follows the switch before after no time.
                values[index], sizes[index] = problem.loads.omega * path.durations[index], 1.0
                derived[index] = problem.loads.omega * (path.shifts[index] - path.shifts[index - 1])
            elif before == PINNED:
                values[index], derived[index], sizes[index] = released(problem, path, index, contact, status)
            elif before > PINNED:
                # A slider comes to rest.
                values[index], sizes[index] = rows[contact] @ path.ends[index, n:], norms[index] * path.sizes[1]
                derived[index] = rows[contact] @ path.all_columns[index, n:] if path.all_columns.size else 0.0
        return values, derived, np.maximum(sizes, 1e-300)

    @cached_property
    def _contacts(self) -> NDArray[np.int64]:
        return np.array([s.contact for s in self.switches], dtype=np.int64)

    @cached_property
    def _since(self) -> list[int | None]:
        """For every switch the one since which its coordinate has changed as much as nothing, if there is one."""
        # An impact turns what begins to touch before it and ceases to after it, however short the touch.
        found = [None if p is None or self.hit_between(p, k) else p for k, p in enumerate(self.partners)]
        for p, k in self.successive:
            if self.struck[p] >= 0 and (self.struck[k] >= 0 or self.switches[k].status == PINNED):
                # The time between two bounces may be as short as it likes.
                found[k] = p
        return found

    @cached_property
    def _again(self) -> NDArray[np.int64]:
        """Numbers of the switches whose coordinates have changed as much as nothing since an earlier one."""
        return np.array([k for k, since in enumerate(self._since) if since is not None], dtype=np.int64)

    # -- coordinates ----------------------------------------------------------------------------------

    def scales(self, problem: Shooting, evaluation: SignatureEvaluation) -> Array:
        """Return sizes of the coordinates: those of the motion, and 1 rad, or more if there are many segments."""
        n, k = problem.size // 2, len(self.switches)
        z, v = evaluation.sizes
        v = max(v, problem.loads.omega * z)
        z = max(z, v / max(float(np.sqrt(np.max(problem.space.stiffness, initial=0.0))), problem.loads.omega))
        if not v > 0.0:
            z, v = 1.0, problem.loads.omega
        return np.concatenate([np.full(n, z), np.full(n, v), np.full(k, max(1.0, np.sqrt(k / 4.0)))])

    def modes_at(self, problem: Shooting, evaluation: SignatureEvaluation, phases: Array) -> tuple[Array, Array]:
        """Return modal displacements and velocities at some phases of the loads, each of shape (n, n_phases)."""
        path = evaluation.path
        times = (self.anchor + (phases - self.anchor) % self.turn) / problem.loads.omega
        # Segments of negative length overlap: the last one that has begun counts.
        which = np.max((path.times <= times[:, None]) * np.arange(path.times.size), axis=1)
        z, v = np.empty((2, problem.size // 2, times.size))
        for motion, mine, own in path.motions(which):
            z[:, mine], v[:, mine] = motion.modes(own, times[mine] - path.times[which[mine]])
        return z, v

    def at_phase(self, problem: Shooting, evaluation: SignatureEvaluation, phase: float) -> Array:
        """Return the state in unknowns at a phase of the loads, shape (2n,)."""
        z, v = self.modes_at(problem, evaluation, np.array([phase]))
        return problem.to_unknowns(z[:, 0], v[:, 0])

    def unknowns(self, problem: Shooting, y: Array, evaluation: SignatureEvaluation) -> Array:
        """Return the state at t = 0 of the loads."""
        return y[: problem.size] if self.anchor == 0.0 else self.at_phase(problem, evaluation, 0.0)

    def orbit(self, problem: Shooting, y: Array, evaluation: SignatureEvaluation) -> PeriodicOrbit:
        """Return the orbit."""
        return problem.orbit_of(self.unknowns(problem, y, evaluation), evaluation, lambda: DECIDED)

    def flow(self, problem: Shooting, y: Array) -> Flow:
        """Return the ordinary flow over one period of the orbit, which searches its events."""
        return problem.run(y[: problem.size], self.anchor, self.start, check=True)

    # -- comparison with a flow -----------------------------------------------------------------------

    def follows(self, y: Array, events: Sequence[FlowEvent], omega: float) -> bool:
        """Return whether the events of flows over an orbit are those of the signature, each contact for itself.

        The flows may begin at any phase. Touches that are so short that they are lost in rounding do not count.
        """
        phases = self.phases(y)
        later = [self.anchor + (e.time * omega - self.anchor) % self.turn for e in events]
        found = sorted(zip(later, events, strict=True), key=itemgetter(0))
        bouncing = bounces_of([event for _, event in found])
        for contact in range(len(self.start)):
            own = [k for k, s in enumerate(self.switches) if s.contact == contact and k not in self.settling]
            mine = [(phases[k], self.switches[k].status) for k in own]
            seen = [(p, e.after) for k, (p, e) in enumerate(found) if e.contact == contact and k not in bouncing]
            if [status for _, status in mine] == [status for _, status in seen]:
                continue
            if not mine and _one_way({self.start[contact], *(status for _, status in seen)}):
                continue
            hit = contact in self.struck or any(e.contact == contact and e.before == e.after for e in events)
            rests = any(status == PINNED for _, status in (*mine, *seen))
            if hit or rests or _lasting(self.start[contact], mine) != _lasting(self.start[contact], seen):
                return False
        return True

    def approaches(self, problem: Shooting, evaluation: SignatureEvaluation) -> dict[int, float]:
        """Return the speeds of approach of all impacts on rigid stops, m/s, by the numbers of their switches."""
        rows, n = problem.space.contacts, problem.size // 2
        speeds = evaluation.path.ends[:, n:]
        return {k: float(rows[j] @ speeds[k]) for k, j in enumerate(self.struck) if j >= 0}

    def unsettled(self, problem: Shooting, evaluation: SignatureEvaluation) -> bool:
        """Return whether bodies rest after impacts that have become too fast for that, or much slower than needed."""
        laws, rows, n = problem.system.contacts, problem.space.contacts, problem.size // 2
        if laws is None or not laws.rigid.any():
            return False
        speeds = np.einsum("ij,ij->i", rows[self._contacts], evaluation.path.ends[: len(self.switches), n:])
        moving = np.array([status[j] != PINNED for status, (j, *_) in zip(self.statuses, self.switches, strict=False)])
        before = {k: float(speeds[p]) for p, k in self.successive if p in self.settling}
        for k, (contact, status, _) in enumerate(self.switches):
            if status == PINNED and moving[k] and laws.rigid[contact] and laws.restitution[contact] > 0.0:
                slow = SETTLES * float(speeds[moving & (self._contacts == contact)].max())
                if speeds[k] > _ALLOWED * slow or before.get(k, np.inf) < slow / _ALLOWED:
                    return True
        return False

    def first_touch(self, evaluation: SignatureEvaluation, flow: Flow) -> Extreme | None:
        """Return the extreme at the first touch of a flow that is none of the signature's, found however short."""
        problem, y = evaluation.problem, evaluation.y
        sliders, omega, phases = problem.course.sliders, problem.loads.omega, self.phases(y)
        bouncing = bounces_of(flow.events)
        left = list(zip(phases.tolist(), self.switches, strict=True))
        for index, event in enumerate(flow.events):
            phase = event.time * omega
            same = [
                one
                for one in left
                if one[1][:2] == (event.contact, event.after) and abs(one[0] - phase) <= _SAME * self.turn
            ]
            if same:
                left.remove(same[0])
                continue
            if (sliders is not None and event.contact >= sliders.first) or index in bouncing:
                continue
            later = [e.time * omega for e in flow.events[index + 1 :] if e.contact == event.contact]
            segment = int(np.searchsorted(phases, phase))
            begun, duration = float(evaluation.path.times[segment]), float(evaluation.path.durations[segment])
            low = phase / omega - begun
            high = min((later[0] / omega - begun) if later else duration, duration)
            if high <= low:
                return None
            tau = np.linspace(low, high, LEAST + 1)
            of = np.full(tau.size, segment)
            found = evaluation.gaps.among(
                of, tau, *evaluation.path.rows(problem.space.contacts, of)(tau), event.contact
            )
            return max(found, key=lambda e: e.height, default=None)
        return None

    # -- other signatures -----------------------------------------------------------------------------

    def begins_of(
        self, known: SignatureEvaluation, gone: Sequence[int] = (), added: Sequence[tuple[int, float, Switch]] = ()
    ) -> States:
        """Return where the segments of an edited signature begin in the motion of an evaluation; see `edited`."""
        new, y, numbers = self.edited(known.y, gone, added)
        path, kept = known.path, (k for k in range(len(self.switches)) if k not in gone)
        begins = [path.begins[0]]
        for index in range(len(new.switches)):
            if index in numbers:
                k, phase, _ = added[numbers.index(index)]
                begins.append(path.state(k, phase / known.problem.loads.omega - float(path.times[k])))
            else:
                begins.append(path.begins[next(kept) + 1])
        return States(y, known.problem.unmodal(np.array(begins).T).T)

    def recentred(
        self, known: SignatureEvaluation, y: Array, tangent: Array
    ) -> tuple[Signature, Array, States, Array] | None:
        """Return signature, coordinates, states and direction with the anchor in the middle of the longest segment.

        None where the anchor is far enough from all switches. The state is followed forwards in time only, because fast
        modes grow without bound backwards. `tangent` are derivatives of the coordinates along the branch. Those of the
        lengths and the parameter tell the direction; those of the state, which need the parameter's effect, are 0.
        """
        problem, path, k = known.problem, known.path, len(self.switches)
        lengths, n = self.lengths(y), problem.size
        around = np.append(lengths[1:k], lengths[0] + lengths[k])
        if not k or min(lengths[0], lengths[-1]) >= _NEAR_ANCHOR * around.max():
            return None
        longest = self.longest(np.append(0.0, around)) - 1
        if longest == k - 1:
            # The segment around the anchor is the longest.
            shift = 0.5 * (lengths[0] - lengths[k])
            first = 0 if shift >= 0.0 else k
            inside = shift if shift >= 0.0 else lengths[k] + shift
        else:
            first, inside = longest + 1, 0.5 * lengths[longest + 1]
        turned = tangent[n:-1]
        state = path.state(first, float(inside / problem.loads.omega))
        # The last segment goes on in the first one.
        begins = np.concatenate([state[None], path.begins[first + 1 :], path.begins[1 : first + 1]])
        states = problem.unmodal(begins.T).T
        switches = (*self.switches[first:], *self.switches[:first])
        anchor = self.anchor + float(lengths[:first].sum() + inside)
        # Shifted by whole orbits, so that the phase stays small.
        anchor -= np.floor(anchor / self.turn) * self.turn
        # Each part ends at its switch; the anchor itself stays at its phase.
        changes = np.append(turned, -turned.sum())
        rest, slopes = (
            np.append(
                values[first] - cut_off + (values[0] if first == k else 0.0),
                np.roll(np.append(values[1:k], values[k] + values[0]), -first)[: k - 1],
            )
            for values, cut_off in ((lengths, inside), (changes, -turned[:first].sum()))
        )
        start = tuple(int(s) for s in self.statuses[first])
        new = Signature(start, switches, anchor, self.periods)
        moved = np.append(states[0], rest)
        return new, moved, States(moved, states), np.concatenate([np.zeros(n), slopes, tangent[-1:]])


def _lasting(start: int, switches: list[tuple[float, int]]) -> list[int]:
    """Return the statuses that a contact takes, from a first one on, without those that are lost in rounding."""
    left = [start]
    for k, (phase, status) in enumerate(switches):
        lasts = k + 1 == len(switches) or switches[k + 1][0] - phase >= _SHORT
        if lasts and status != left[-1]:
            left.append(status)
    return left


def _mean(path: Path, contact: int, partner: int, index: int) -> tuple[float, Array]:
    """Return the mean rate of a contact between two switches with others in between, and its derivatives (columns,)."""
    between = slice(partner + 1, index + 1)
    durations, means = path.durations[between], path.means[between, contact]
    whole = float(durations.sum())
    share = durations / whole if whole != 0.0 else np.full(durations.size, 1.0 / durations.size)
    value = float(share @ means)
    derived = share @ path.mean_rows[between, contact]
    if whole != 0.0:
        derived = derived + ((means - value) / whole) @ np.diff(path.shifts[partner : index + 1], axis=0)
    return value, derived


def _one_way(statuses: Collection[int]) -> bool:
    """Return whether a slider sticks and slides in one direction alone.

    It does not come back to its place, so in an orbit it sticks: there its force reaches the limit at most.
    """
    return PINNED in statuses and (UP in statuses) != (DOWN in statuses)


def signature_of(problem: Shooting, flow: Flow) -> tuple[Signature, Array]:
    """Return the signature of a flow over one orbit from the phase at which it starts, and coordinates.

    Raises `ConvergenceError` where contacts switch more often than can be treated.
    """
    omega, segments = problem.loads.omega, flow.solution.segments
    statuses = {
        j: {int(s), *(e.after for e in flow.events if e.contact == j)} for j, s in enumerate(segments.status[0])
    }
    stuck = [j for j, own in statuses.items() if _one_way(own)]
    start = tuple(PINNED if j in stuck else int(s) for j, s in enumerate(segments.status[0]))
    events = [(e.time * omega, switch) for e, switch in _switches(problem, flow) if switch.contact not in stuck]
    if len(events) > MOST_SWITCHES:
        raise ConvergenceError(
            f"contacts switch {len(events)} times in an orbit, and Newton's method takes at most {MOST_SWITCHES}"
        )
    anchor = flow.start.time * omega
    if events and events[0][0] - anchor <= AT_ONCE:
        # What is left at once is not the status at the start, where the orbit ends in the one that is entered.
        contact, status = events[0][1][:2]
        if [e.after for e in flow.events if e.contact == contact][-1] == status:
            start, events = (*start[:contact], status, *start[contact + 1 :]), events[1:]
    lengths = np.diff([anchor, *(time for time, _ in events)])
    new = Signature(start, tuple(switch for _, switch in events), anchor, problem.periods)
    state = problem.to_unknowns(flow.start.displacement, flow.start.velocity)
    return new, np.concatenate([state, lengths])


def _switches(problem: Shooting, flow: Flow) -> list[tuple[FlowEvent, Switch]]:
    """Return the events of a flow, and their switches; what is released at once follows its cause."""
    found, groups = list[tuple[FlowEvent, Switch]](), list[list[FlowEvent]]()
    for e in settled(flow):
        if groups and e.time <= groups[-1][0].time * (1.0 + _INSTANT):
            groups[-1].append(e)
        else:
            groups.append([e])
    for group in groups:
        causes = [e for e in group if e.before != PINNED]
        found += [(e, Switch(e.contact, e.after)) for e in causes]
        for e in group:
            if e.before == PINNED:
                found.append((e, Switch(e.contact, e.after, bool(causes) and _let_go(problem, flow, e, group[0].time))))
    return found


def _let_go(problem: Shooting, flow: Flow, event: FlowEvent, time: float) -> bool:
    """Return whether a release of a flow lacks its limit just before the switches of others at its time."""
    record, contact = flow.solution.record, event.contact
    index = int(np.searchsorted(record.starts, time, side="left"))
    if not 0 < index < record.segments:
        return False
    held = record.status(index).copy()
    held[contact] = PINNED
    state = np.concatenate(record.state(index))
    before, after = (
        excess(problem, status, event.time, state, contact, event.after)[0]
        for status in (record.status(index - 1), held)
    )
    return bool(before < -_LACKS * abs(after - before))
