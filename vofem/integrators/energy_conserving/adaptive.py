"""Runs of the midpoint rule whose steps follow a tolerance.

Every step is taken whole and in two halves; the halves are kept where both
agree. So the error estimate sees whatever the step sees, a switch included,
and the energy is conserved as at one step size. Where a contact acts,
velocities have to agree too, and a step has to resolve the impact: against a
stop so stiff that every step ends at it, displacements say nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError
from vofem.integrators.energy_conserving.setting import Setting
from vofem.integrators.energy_conserving.step import (
    Factored,
    Forcing,
    Matrices,
    Scratch,
    State,
    accept,
    accept_history,
    combine,
    step,
)
from vofem.integrators.methods import ENERGY_CONSERVING
from vofem.integrators.stepping.ladder import Ladder
from vofem.integrators.stepping.record import Output, Trail
from vofem.integrators.stepping.step_loads import PARTS, joined, swing
from vofem.laws.evaluate import commit_all, force_and_tangent, tangent_jumps
from vofem.laws.rows import Rows, dot
from vofem.laws.springpot import History, Pace, Springpots, carry_on, impose
from vofem.laws.table import Laws, with_state
from vofem.linalg.banded import solve, subtract_product
from vofem.linalg.jit import jit

Array = NDArray[np.float64]

#: Steps between two looks at the outcome.
_CHUNK = 256

#: Change of velocity in one half of a step, over that of the impact, up to which a step resolves a contact.
_RESOLVED = 0.25

#: Tangent of a law over that of the rest of its step, up to which a step resolves a jump of it: the same measure.
_SOFT = 0.5 * _RESOLVED**2

#: Way that an unresolved change of velocity would make until the end, over the tolerance, up to which it is let pass.
_HARMLESS = 0.1


class AdaptiveSteps(Ladder, Setting):
    """A run of steps chosen by their error."""

    place: tuple[str, ...] = (
        *Ladder.place, "tolerance", "steps", "coarsest", "beyond", "farthest", "coarser", "fineness",
    )  # fmt: skip

    def plan(self, t_end: float, tolerance: float, fineness: float = 1.0) -> None:
        """Set the end in s, the tolerance, and how finely impacts are resolved, over what is done by default."""
        self.climb(t_end, tolerance)
        self.weight = self.bands.system.scale[self.bands.order]
        self.period = self.bands.over.period(t_end)
        self.steps, self.coarsest, self.beyond, self.fineness = 0, 0.0, False, fineness
        self.farthest = 0.0
        # What a run of a coarser tolerance found at the times of `check_times`, in band order.
        self.coarser = np.empty((0, 0))
        self.ladder: dict[int, Factored] = {}
        n, m = self.state.q.size, self.state.u.size
        self.trial, self.tried = np.zeros((6, n)), np.zeros((3, m))
        self.past = self.state.memory.copy()
        self.keep_history(self.tick, t_end + 2.0 * self.largest)
        self.paces: dict[int, Pace] = {}
        self.ahead = History(self.history.y.copy(), self.history.told.copy())

    def measure(self, displacement: Array) -> None:
        """Set the size that errors are related to from a rough run, shape (n, n_times)."""
        # A scene that starts from rest has no size of its own before it has moved.
        self.size = self.largest_of(displacement)

    def largest_of(self, displacement: Array) -> float:
        """Return the largest of displacements in band order, shape (n, n_times), in m; rotations by their arms."""
        return float(np.max(np.abs(self.weight[:, None] * displacement), initial=0.0))

    @property
    def finished(self) -> bool:
        """Whether all states are stored."""
        return self.beyond

    def reached(self) -> float:
        """Return the time of the state on the trail, s."""
        return min(self.time, self.t_end)

    def _rung(self, rung: int) -> Factored:
        if rung not in self.ladder:
            self.ladder[rung] = self.factor(self.length(rung))
        return self.ladder[rung]

    def _pace(self, rung: int) -> Pace:
        if rung not in self.paces:
            self.paces[rung] = self.pace(self.length(rung))
        return self.paces[rung]

    def advance(self, out: Output, cursor: int) -> tuple[int, Array]:
        """Take some steps; the last one goes beyond the end, to complete the state there."""
        found = []
        for _ in range(_CHUNK):
            if self.beyond:
                break
            cursor, events = self._one(out, cursor)
            found.append(events)
        return cursor, np.concatenate(found)

    def _one(self, out: Output, cursor: int) -> tuple[int, Array]:
        while True:
            whole, half = self._rung(self.rung), self._rung(self.rung + 1)
            t, dt = self.time, whole.dt
            springpots = self.springpots(t + dt * np.array([0.5, 0.25, 0.75]))
            values, between = self._loads(t, dt, half)
            paces = self._pace(self.rung), self._pace(self.rung + 1)
            state = self.state
            laws = with_state(self.laws, state.memory)
            solves, rough, smooth, kick = _try(
                self.matrices, self._rung(max(self.rung - 3, 0)).structure.factored, whole, half, self.rows, laws,
                self.forcing, values, state, self.trial, self.tried, self.weight, self.space, self.past,
                springpots, *paces, self.history, self.ahead, self.fineness,
            )  # fmt: skip
            self.complain(dt)
            if solves < 0 and self.at_the_bottom:
                raise ConvergenceError(
                    f"{ENERGY_CONSERVING.name} found no solution of the step from t = {t:g} s, however small; "
                    "a nonlinear spring that softens may leave none"
                )
            ratio = max(self.ratio(rough, smooth), between) if solves >= 0 else np.inf
            # An impact that the step does not resolve may change velocities for the whole rest of the run.
            if kick * self.t_end > _HARMLESS * self.whole:
                ratio = max(ratio, 2.0)
            if not self.accepts(ratio):
                self.bands.counters.rejected += 1
                continue
            cursor, events = _take(
                self.matrices, half, self.rows, laws, self.forcing, values, t, state, self.trial,
                self.tried, self.trail, out, cursor, self.space, springpots, paces[1], self.history,
            )  # fmt: skip
            self.beyond = self.now >= self.end
            self.farthest = max(self.farthest, float(np.max(self.weight * np.abs(state.q))))
            self.step_on(ratio)
            self.coarsest = max(self.coarsest, half.dt)
            self.steps += 0 if self.beyond else 2
            self.count(self.steps, solves)
            return cursor, events

    def _loads(self, t: float, dt: float, half: Factored) -> tuple[Array, float]:
        """Return the loads over the step and its halves, and their own part of the error over the tolerance.

        The motion between the ends of a step is a polynomial. What a load moves beside it, as a short one does, is no
        error of the steps and does not add up, but is seen where states between steps are asked for.
        """
        parts = self.bands.over.parts(t, t + dt)
        if not parts.shape[1]:
            return np.empty((0, 3)), 0.0
        cut, moved = PARTS // 2, 0.0
        halves = parts[:, :, :cut], parts[:, :, cut:]
        moments = np.empty((3, parts.shape[1], 3))
        moments[:, :, 0] = joined(parts)
        for k, part in enumerate(halves, 1):
            moments[:, :, k] = joined(part)
            far = swing(part, moments[0, :, k], moments[1, :, k])
            if np.any(far):
                moved = max(moved, float(np.max(self.weight * (far @ np.abs(half.dt * half.shift)))))
        return self.load_values(moments), moved / self.whole


@jit
def _try(
    matrices: Matrices, filtering: Array, whole: Factored, half: Factored, rows: Rows, laws: Laws, total: Forcing,
    values: Array, state: State, trial: Array, tried: Array, weight: Array, space: Scratch, past: Array,
    springpots: Springpots, pace: Pace, half_pace: Pace, history: History, ahead: History, fineness: float,
) -> tuple[int, float, float, float]:  # fmt: skip
    """Take a step whole and in halves; return contact solves, two errors of displacements, and unresolved impacts.

    The second error is smoothed: ``(A^-1 M)^2`` of the first, A the matrix of
    a step eight times as long, which leaves what the step resolves well. Where
    a contact acts the first one holds the error of velocities times the step
    too. The last number, in m/s, is the largest change of a law's velocity that
    the step does not resolve.
    The state stays as it is: mean velocities of the halves are left in
    `trial[0]` and `trial[1]`, reactions in `tried[0]` and `tried[1]`.
    """
    first, second, full, q, v, end = trial[0], trial[1], trial[2], trial[3], trial[4], trial[5]
    n, m, remembers = state.q.size, state.u.size, history.y.shape[0] > 0
    combine(whole, values[:, 0], total)
    if remembers:
        impose(springpots, pace, history, 0, laws, state.u, 0.0, 1.0)
    full[:] = state.expected
    tried[2][:] = state.reaction
    a = step(matrices, whole, rows, laws, total.push, state.q, state.v, state.u, full, tried[2], space)
    combine(half, values[:, 1], total)
    if remembers:
        impose(springpots, half_pace, history, 1, laws, state.u, 0.0, 1.0)
    first[:] = state.expected
    tried[0][:] = state.reaction
    b = step(matrices, half, rows, laws, total.push, state.q, state.v, state.u, first, tried[0], space)
    if a < 0 or b < 0:
        return -1, 0.0, 0.0, 0.0
    for i in range(n):
        q[i] = state.q[i] + half.dt * first[i]
        v[i] = 2.0 * (first[i] + total.shift[i]) - state.v[i]
        second[i] = full[i] + (full[i] - first[i])
    u = np.empty(m)
    for j in range(m):
        u[j] = dot(rows, j, q)
    combine(half, values[:, 2], total)
    tried[1][:] = tried[0]
    if past.size > 0:
        # The second half begins with what the first one leaves, should it be taken.
        past[:] = state.memory
        commit_all(laws, u)
    if remembers:
        ahead.y[:] = history.y
        for i in range(ahead.y.shape[0]):
            carry_on(springpots, half_pace, ahead, i, 1, dot(rows, springpots.row + i, first), 0.0)
        impose(springpots, half_pace, ahead, 2, laws, u, 0.0, 1.0)
    c = step(matrices, half, rows, laws, total.push, q, v, u, second, tried[1], space)
    if past.size > 0:
        state.memory[:] = past
    if c < 0:
        return -1, 0.0, 0.0, 0.0
    rough, smooth, kick = 0.0, 0.0, 0.0
    acts = False
    if m > 0:
        for i in range(n):
            end[i] = second[i] + (second[i] - v[i])
        acts, kick = _impact(rows, laws, state, half.dt, u, v, second, end, tried, fineness)
    if acts:
        # Where a stop is stiff, steps of any size end at it: their displacements agree and their velocities do not.
        for i in range(n):
            rough = max(rough, weight[i] * whole.dt * abs(full[i] + (full[i] - state.v[i]) - end[i]) / 3.0)
    # Else velocities are not asked: those of fast modes, which hardly move anything, would dictate the step.
    for i in range(n):
        # From velocities: of displacements, the shortest steps change nothing but the last digits.
        q[i] = half.dt * ((full[i] - first[i]) + (full[i] - second[i])) / 3.0
        rough = max(rough, weight[i] * abs(q[i]))
    for _ in range(2):
        v[:] = 0.0
        subtract_product(matrices.mass, q, v)
        solve(filtering, v)
        for i in range(n):
            q[i] = -v[i]
    for i in range(n):
        smooth = max(smooth, weight[i] * abs(q[i]))
    return a + b + c, rough, smooth, kick


@jit
def _impact(
    rows: Rows, laws: Laws, state: State, dt: float, u: Array, v: Array, second: Array, end: Array, tried: Array,
    fineness: float,
) -> tuple[bool, float]:  # fmt: skip
    """Return whether a law's tangent jumps in two halves of a step, and the largest change of rate not resolved, m/s.

    With a stiffness k on a mass m at penetration s the velocity of the impact
    is ``sqrt(r^2 + k s^2/m)``, r the rate: as ``k s/m`` is the change of rate
    per time, it needs no mass to be known. A contact that is held closed by
    what lies on it has a large one too, and its trembling passes for resolved.
    Any other law is asked for its tangents k at the ends of the halves; ``k dt^2/2m`` follows from
    the change of rate ``R dt/m`` that comes with its reaction R.
    """
    acts, kick = False, 0.0
    for j in range(state.u.size):
        last = u[j] + dt * dot(rows, j, second)
        r0, r1, r2 = dot(rows, j, state.v), dot(rows, j, v), dot(rows, j, end)
        change = max(abs(r1 - r0), abs(r2 - r1))
        if j >= state.status.size:
            if tangent_jumps(laws, j):
                k0 = force_and_tangent(laws, j, state.u[j])[1]
                k1 = force_and_tangent(laws, j, u[j])[1]
                k2 = force_and_tangent(laws, j, last)[1]
                stiff = max(abs(k0), abs(k1), abs(k2))
                if max(abs(k1 - k0), abs(k2 - k1)) > 0.5 * stiff:
                    acts = True
                    reaction = max(abs(tried[0, j]), abs(tried[1, j]))
                    if 0.5 * stiff * change * dt > _SOFT / fineness**2 * reaction:
                        kick = max(kick, change)
            continue
        deepest = max(state.u[j], u[j], last) - laws.table[j]["gap"]
        if deepest <= 0.0:
            continue
        acts = True
        speed = max(r0 * r0, r1 * r1, r2 * r2) + deepest * change / dt
        if change * change > (_RESOLVED / fineness) ** 2 * speed:
            kick = max(kick, change)
    return acts, kick


@jit
def _take(
    matrices: Matrices, half: Factored, rows: Rows, laws: Laws, total: Forcing, values: Array, t: float, state: State,
    trial: Array, tried: Array, before: Trail, out: Output, cursor: int, space: Scratch, springpots: Springpots,
    pace: Pace, history: History,
) -> tuple[int, Array]:  # fmt: skip
    """Accept both halves; return the cursor and the events."""
    dt, loaded = half.dt, values.shape[0] > 0
    events = np.empty((4 if state.status.size else 0, 3))
    # Not a literal, for which `accept` would be compiled once more.
    happened = cursor - cursor
    for k in range(2):
        combine(half, values[:, k + 1], total)
        state.reaction[:] = tried[k]
        wanted, last = cursor, state.width[0]
        cursor, events, happened = accept(
            matrices, rows, laws, total, loaded, t + k * dt, dt, trial[k], state, before, out, cursor,
            events, happened, space,
        )  # fmt: skip
        if history.y.shape[0] > 0:
            accept_history(
                springpots, pace, history, rows, tried[k], k + 1, t + k * dt, last, trial[k], out, wanted, cursor
            )
    return cursor, events[:happened]
