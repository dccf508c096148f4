"""Curves of special points in two parameters: `locus`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vofem._validate import number, whole
from vofem.arrays import Array
from vofem.blas import one_thread
from vofem.errors import ArgumentError, ConvergenceError, MethodError
from vofem.kernels.choice import by_need
from vofem.progress import Progress
from vofem.scene import Scene
from vofem.studies.steady.branch import Curve
from vofem.studies.steady.following.beside import touch
from vofem.studies.steady.following.between import Step
from vofem.studies.steady.following.census import Test, pair_on_circle, pairs_at_one, real_at, turning
from vofem.studies.steady.following.crossings import root
from vofem.studies.steady.following.extended import Extended
from vofem.studies.steady.following.family import Family, Interval
from vofem.studies.steady.following.follow import LARGEST, Follower, charted
from vofem.studies.steady.following.point import Point, corrected, level, point_at
from vofem.studies.steady.segments.shooting import Shooting
from vofem.studies.steady.special import KINDS, SpecialPoint, special_at
from vofem.studies.steady.steady_state import as_guess

#: Relative difference of `value` up to which the first point is the given special point.
_SAME = 1e-6

#: Residual of the given orbit, over the size of the motion, up to which it belongs to the scene.
_ORBIT = 1e-5

#: Distance of a multiplier from -1 up to which an orbit may be a period doubling.
_FLIPS = 0.1

#: Length in rad up to which a touch, and height up to which an extreme of a gap function, is a grazing.
_SHORT, _LOW = 1e-3, 1e-5

#: Values of tests that are rounding.
_ROUNDING = 1e-9

#: Distance from the unit circle within which a multiplier that belongs to a special point is expected.
_ON_CIRCLE = 1e-5

#: Distance of theta from 0 and pi below which both multipliers of a pair meet.
_MEET = 1e-4

#: Multiple of s, in scaled equations, above which an orbit is no branch point, and its rate along a locus that may be
#: rounding.
_UNFOLDED, _UNFOLDS = 1e-7, 1e-5

#: Frequency of the loads, over that of the first orbit, below which periods count as infinite.
_SLOWEST = 1e-3

#: Inverse cosine of the angle to its border from which on a null vector replaces it.
_TURNED = 2.0

_PAIR = "neimark_sacker"


@dataclass(eq=False, repr=False, kw_only=True)
class Locus(Curve):
    """The curve of a special point of periodic orbits in two parameters.

    Attributes
    ----------
    values : ndarray, shape (n, 2)
        Values of both parameters of `build` along the curve: (value, other).
    kind : str
        Kind of the special point, as in `SpecialPoint`.
    contact : str
        Name of the contact that grazes; empty for other kinds.
    special : list of SpecialPoint
        Points of the curve at which it is special itself; `.value` and `.other` are its parameters. "turn": `other` has
        an extreme, where two special points of this kind meet. "cusp": two folds meet and vanish, where the curve has a
        tip. Any other kind is that of another special point which the orbit is as well: there two loci meet.
    counters : BranchCounters
    notes : list of str
        Sentences that a user should read, such as why the curve ended.
    interrupted : bool
        Whether Ctrl-C was pressed while the curve was followed.
    """

    kind: str
    contact: str = ""

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        low, high = self.values.min(axis=0), self.values.max(axis=0)
        spans = f"value {low[0]:.6g} to {high[0]:.6g}, other {low[1]:.6g} to {high[1]:.6g}"
        return f"Locus({self.kind}, {len(self)} points, {spans}; {self._kinds()})"


@one_thread
@by_need("steady states", small=False)
def locus(
    build: Callable[[float, float], Scene],
    special: SpecialPoint,
    start: float,
    stop: float,
    *,
    max_step: float = LARGEST,
    max_points: int = 5000,
    max_seconds: float | None = None,
    progress: Progress = None,
) -> Locus:
    """Follow a special point of periodic orbits in two parameters.

    The orbit and the condition that makes it special are solved together, so that every point of the curve is as exact
    as the special points of a branch. The curve is followed through its turns until `other` leaves the interval.
    Touches of contacts may begin and end on the way. Ctrl-C ends the computation; what was found is returned, and a
    note says so.

    Parameters
    ----------
    build : callable
        ``build(value, other)`` returns the scene. `value` is the parameter of the branch on which the special point was
        found; `other` is a second one, such as the amplitude of a load, a damper or a gap.
    special : SpecialPoint
        An entry of `Branch.special` for scenes ``build(value, start)``.
    start, stop : float
        Value of `other` for which `special` was found, and the value towards which the curve is followed.
    max_step : float
        Largest step along the curve, as in `vofem.continuation`.
    max_points : int
        Largest number of points. If it is reached, the curve ends, and a note says so.
    max_seconds : float, optional
        Time in s after which the curve ends; what was found is returned, with a note.
    progress : bool or callable, optional
        Whether a progress bar is shown, as in `vofem.simulate`. A function is called with the value of `other` that was
        reached and `stop`.

    Returns
    -------
    Locus

    Raises
    ------
    ArgumentError
        For arguments out of range, and if ``build(special.value, start)`` does not have this special point.
    MethodError
        If the orbits were computed by harmonic balance, and the point is no fold or branch point.
    ConvergenceError
        If the equations of the special point are not solved at `start`.
    """
    if not callable(build):
        raise ArgumentError(f"locus: build is {build!r}, expected a function that returns a Scene at (value, other)")
    if not isinstance(special, SpecialPoint) or special.kind not in KINDS:
        raise ArgumentError(
            f"locus: special is {special!r}, expected an entry of the list special of a branch, of the kind "
            f"{', '.join(KINDS)}"
        )
    start, stop = number("locus: start", start), number("locus: stop", stop)
    if Interval(start, stop).empty:
        raise ArgumentError(f"locus: start and stop are both {start:.15g}; expected an interval of the other parameter")
    max_points = whole("locus: max_points", max_points)
    max_step = number("locus: max_step", max_step, positive=True)
    if max_seconds is not None:
        max_seconds = number("locus: max_seconds", max_seconds, positive=True)
    orbit = special.orbit
    if orbit.method != "shooting" and special.kind not in ("fold", "branch_point"):
        raise MethodError(
            f"locus: a {special.kind} is followed by shooting, and this one was found by harmonic balance, which "
            "follows folds and branch points; find it with vofem.continuation(..., method='shooting')"
        )
    family, first = _begin(build, special, Interval(start, stop))
    noun = f"locus of {special.kind}"
    walker = _Walk(family, largest=max_step, most=max_points, seconds=max_seconds, noun=noun)
    if special.kind == "branch_point" and abs(first.tangent[-3]) > _UNFOLDS:
        raise ArgumentError(
            f"locus: the branch point at {special.value:.9g} exists for {start:.9g} alone: with another value of the "
            "other parameter the branches no longer meet, because the scenes are not symmetric. Follow a fold beside "
            "it, or change a parameter that leaves the scene symmetric"
        )
    walker.follow(first, progress=progress)
    rows = [(float(place), point) for place, point in enumerate(walker.points)]
    rows += [(one.place, one.point) for one in walker.special]
    rows.sort(key=lambda row: row[0])
    values = np.array([point.y[-2:] for _, point in rows])
    distinct = np.append(True, np.any(np.diff(values, axis=0) != 0.0, axis=1))
    return Locus(values=values[distinct], kind=special.kind, contact=special.contact, **walker.found())


class _Walk(Follower):
    """Follows a special orbit."""

    onward = (
        ". To go on, begin at a special point of this kind on a branch for a value of the other parameter beyond",
        ". To go on, begin beyond",
    )

    def located(self, step: Step, earlier: Step | None) -> list[SpecialPoint]:
        """Return the points of a step at which the locus is special. It shows its own turns."""
        kind, middle = step.first.chart.kind, step.first
        tests: list[tuple[str, Test]] = []
        if kind == "fold":
            tests.append(("cusp", lambda point: float(point.evaluation.bend)))
        if kind == _PAIR:
            tests.append(("fold", lambda point: float(np.sin(0.5 * point.y[-3]))))
            tests.append(("period_doubling", lambda point: float(np.cos(0.5 * point.y[-3]))))
        tests.append(("turn", turning))
        if all(point.evaluation.multipliers is not None for point in (middle, step.last)):
            # A pair begins where both multipliers of a double one belong together.
            names = [_PAIR if at == kind else at for at in ("fold", "period_doubling")]
            tests += [(names[0], real_at(1.0)), (names[1], real_at(-1.0)), (_PAIR, pairs_at_one(middle))]
        found: list[SpecialPoint] = []
        for name, test in tests:
            ends = [test(step.first), test(step.last)]
            if not np.all(np.isfinite(ends)) or max(map(abs, ends)) <= _ROUNDING or ends[0] * ends[1] > 0.0:
                continue
            at = root(self.family, step, test)
            if at is None:
                continue
            if test is tests[-1][1] and test is not turning and not pair_on_circle(at[0], _ON_CIRCLE):
                continue  # Two real multipliers, reciprocals of each other.
            if name == "turn" and found:
                # At a tip, and where the locus comes back along itself.
                continue
            found.append(special_at(name, *at))
        return sorted(found, key=lambda one: one.place)

    def _take(self, after: Point, step: Step | None = None, special: Sequence[SpecialPoint] = ()) -> None:
        """Add a point, unless it is none of a locus of its kind."""
        first = self.points[0]
        if isinstance(after.problem, Shooting) and after.problem.loads.omega < _SLOWEST * first.problem.loads.omega:
            self._end(after, "where the period of the loads grows without bound")
        elif after.chart.kind == "branch_point" and abs(after.y[-3]) > _UNFOLDED:
            self._end(after, "where branches no longer meet, as in scenes that are not symmetric")
        else:
            super()._take(after, step, special)

    def _recentred(self, now: Point, least: float = np.inf) -> Point:
        """Return a point with its anchor away from all switches, and with borders that are near its null vectors."""
        now = super()._recentred(now, least)
        if now.evaluation.turned < _TURNED:
            return now
        return point_at(self.family, now.chart.with_new_borders(), now.y, now.tangent, near=now.evaluation)

    def _end(self, point: Point, why: str) -> None:
        self._over = True
        self.notes.append(f"the {self.noun} ends before ({point.y[-2]:.9g}, {point.value:.9g}), {why}")

    def _mark(self, special: SpecialPoint, base: int) -> None:
        """Add a special point. Where both multipliers of a pair meet, the locus ends."""
        at = special.point
        self.special.append(replace(special, place=base + special.place))
        if at.chart.kind == _PAIR and abs(np.sin(at.y[-3])) < _MEET:
            self._over = True
            where = "1" if np.cos(at.y[-3]) > 0.0 else "-1"
            self.notes.append(
                f"the locus ends at ({at.y[-2]:.12g}, {at.value:.12g}), where both multipliers of the pair are {where}"
            )


def _begin(build: Callable[[float, float], Scene], special: SpecialPoint, interval: Interval) -> tuple[Family, Point]:
    """Return the family of orbits over both parameters, and the special point in it."""
    orbit, value, kind = special.orbit, float(special.value), special.kind
    harmonics = None
    if orbit.method == "harmonic_balance":
        from vofem.studies.steady.harmonic.balance import harmonics_in

        assert orbit.unknowns is not None
        harmonics = harmonics_in(orbit.scene, orbit.unknowns.size)
    family = Family("locus", build, interval, orbit.method, orbit.periods, harmonics, parameters=2)
    problem = family.at(value, interval.start)
    if isinstance(problem, Shooting):
        problem = as_guess(problem, orbit)
        family.begin_with(problem, value, interval.start)
    inner, y = charted(problem, problem.from_orbit(orbit))
    known = inner.evaluate(problem, y)
    where = f"build({value:.9g}, {interval.start:.9g})"
    if not known.error <= _ORBIT:
        raise ArgumentError(
            f"locus: the orbit of special misses an orbit of {where} by {known.error:.1e} of its motion. Expected the "
            f"scene for which the {kind} was found: give the same function as to vofem.continuation, and as start the "
            "value of the other parameter there"
        )
    # A branch of orbits over several periods may end at a special point of orbits over fewer.
    shortest = problem.shortest_period(y, known)
    if shortest < problem.periods:
        family = family.over(shortest)
        problem = family.at(value, interval.start)
        inner, y = charted(problem, problem.from_orbit(orbit))
    elif kind == "period_doubling":
        nearest = min(known.multipliers.tolist(), key=lambda one: abs(one + 1.0))
        if abs(nearest + 1.0) > _FLIPS:
            raise ArgumentError(
                f"locus: special is no period_doubling: the multiplier of its orbit that is nearest to -1 is "
                f"{nearest:.3g}. Expected an entry of branch.special"
            )
    held = -1
    if kind == "grazing":
        inner, y, held = _touch(problem, inner, y, special)
    chart = Extended(inner, family, kind, abs(value) if value else 1.0, held)
    evaluation = inner.evaluate(problem, y)
    if kind == "neimark_sacker":
        y = np.append(y, _angle(evaluation.multipliers))
    elif kind == "branch_point":
        y = np.append(y, 0.0)
    y = np.concatenate([y, [value, interval.start]])
    scales = np.append(inner.scales(problem, evaluation), [1.0] * (chart.more - 1) + [chart.size, interval.size])
    try:
        y, solved = corrected(family, chart, y, scales, None, np.zeros(y.size - 1), 12)
    except ConvergenceError as error:
        raise ConvergenceError(
            f"locus: the equations of the {kind} are not solved from its orbit at {where}. {error}. Two special points "
            "may coincide there; follow the branch at another value of the other parameter, and start there"
        ) from error
    if abs(y[-2] - value) > _SAME * chart.size:
        raise ArgumentError(
            f"locus: the {kind} of special, found at {value:.12g}, lies at {y[-2]:.12g} in {where}. Expected the scene "
            "for which it was found"
        )
    # The correction rounds what it holds, and a locus must not begin outside of its interval.
    y[-1] = interval.start
    return family, point_at(family, chart, y, level(y.size, family.interval.way), solved)


def _angle(values: Any) -> float:
    """Return the angle of the complex pair that is nearest to the unit circle."""
    pairs = [one for one in values.tolist() if one.imag > 0.0]
    if not pairs:
        raise ArgumentError("locus: the orbit of special has no complex multipliers, and is no neimark_sacker point")
    return float(np.angle(min(pairs, key=lambda one: abs(abs(one) - 1.0))))


def _touch(problem: Shooting, inner: Any, y: Array, special: SpecialPoint) -> tuple[Any, Array, int]:
    """Return the chart of a grazing, coordinates, and the number of the switch behind the begin of its touch."""
    laws = problem.system.contacts
    assert laws is not None
    if special.contact not in laws.names:
        raise ArgumentError(
            f"locus: the contact {special.contact!r} of special is none of the scene's: {', '.join(laws.names)}"
        )
    contact = laws.names.index(special.contact)
    lengths = inner.lengths(y)
    for p, k in inner.touches:
        alone = k == p + 1 or inner.hit_between(p, k)
        if alone and inner.switches[k].contact == contact and lengths[p + 1 : k + 1].sum() <= _SHORT:
            return inner, y, p + 1
    low = [e for e in inner.evaluate(problem, y).extremes if e.contact == contact]
    if not low or min(abs(e.height) for e in low) > _LOW:
        raise ArgumentError(
            f"locus: the orbit of special does not graze contact {special.contact!r}. Expected the grazing of a branch"
        )
    nearest = min(low, key=lambda e: abs(e.height))
    chart, y, numbers = inner.edited(y, (), touch(problem, inner, y, [contact], nearest.phase, hit=nearest.hit))
    return chart, y, numbers[0] + 1
