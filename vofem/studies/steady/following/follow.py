"""Following a branch of orbits by pseudo-arclength, through folds and grazings."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.integrators.observer import deferred_interrupts
from vofem.progress import Progress, TerminalBar
from vofem.studies.steady.branch import BranchCounters
from vofem.studies.steady.following.between import Step, interpolated, point_between, steady
from vofem.studies.steady.following.changes import Passage, ending, passage, resting
from vofem.studies.steady.following.crossings import SHORTER, crossings, hidden_beside
from vofem.studies.steady.following.family import Family, Interval
from vofem.studies.steady.following.point import ORIGIN, Point, corrected, level, point_at, scales_of, sided
from vofem.studies.steady.following.reasons import what_contacts_do
from vofem.studies.steady.problem import OutOfTime
from vofem.studies.steady.segments.near import polished, signature_at
from vofem.studies.steady.segments.shooting import CLOSES, Shooting, relative
from vofem.studies.steady.segments.signature import Signature, SignatureEvaluation, signature_of
from vofem.studies.steady.special import SpecialPoint, special_at

#: First, largest and least step in scaled coordinates.
FIRST, LARGEST, LEAST = 0.01, 0.1, 1e-10

#: Cosine of the angle between successive tangents below which a step is rejected, and the desired angle in rad.
_REFUSED, _AIM = np.cos(np.radians(25.0)), np.radians(12.0)

#: Largest difference of the direction from one orbit to the next from the mean of the branch's directions at both, and
#: the share of the largest step below which it is not looked at.
_APART, _LEAST_SHARE = 0.1, 1e-3

#: Cosine of the angle below which a step is rejected at a corner of a branch, and the largest step at a corner. A step
#: that ends at a grazing may turn as far as it must where it is shorter.
_CORNER, _SHORT = np.cos(np.radians(80.0)), 1e-4

#: What a function given as `progress` is called with.
REPORTED = "the value reached and stop"

#: Step above which one whose special points are not all found is shortened.
_NEAR_OTHERS = 1e-3

#: Longest step, but for the parameter, in which touches may turn into a rest, and how many are tried to find the
#: shortest one.
_RESTING, _NEARER = 1e-3, 6

#: Factor by which a longer step is tried where touches do not turn into a rest in one.
_BEYOND = 4.0

#: Steps by which what sliders do in very short times is passed.
_FARTHER = (1e-3, 1e-4, 1e-5)

#: Distance in scaled coordinates within which a step may end at a grazing.
_NEAR = 0.03

#: Condition of the equations of an orbit above which rounding decides directions.
_MAGNIFIES = 1e13

#: Share of its largest motion at which a branch ends: where nothing moves, no size tells orbits from each other.
_VANISHED = 1e-9

#: Difference of an orbit from the first one at the same value, as a share of it, up to which it is that.
_SAME = 1e-6

#: Factors by which a step may change.
_SHRINK, _GROW = 0.4, 2.0

#: Number of points from which on it is checked whether a branch is closed.
_LOOP = 12

#: Distance, as a share of the interval, within which impacts become infinitely many at one place.
_BESIDE = 1e-3

#: Distance of a closed branch from its first orbit, as a share of its last step, and how often it is looked for there.
_THROUGH, _REFINED = 0.01, 3

#: Distance from the first orbit of a closed branch, as a share of its last step, up to which a special point is that.
_AGAIN = 1e-2


@dataclass
class Follower:
    """Follows a branch, and holds what has been followed of it.

    `largest`: step.
    `most`: points.
    `seconds`: time after which the walk ends.
    `noun`: what is followed, for notes.
    `steps`: the steps from each point to the next; None if both are one orbit in other coordinates.
    """

    #: What to do where the curve is lost, and where its motion vanishes, as the ends of notes.
    onward: ClassVar[tuple[str, str]] = (
        ". To go on, follow from an orbit beyond: vofem.continuation(..., guess=) with a run there that has settled, "
        "or with periods=",
        ". To go on, begin beyond",
    )

    family: Family
    _: KW_ONLY
    largest: float = LARGEST
    most: int = 5000
    seconds: float | None = None
    noun: str = "branch"
    points: list[Point] = field(default_factory=list, init=False)
    steps: list[Step | None] = field(default_factory=list, init=False)
    special: list[SpecialPoint] = field(default_factory=list, init=False)
    notes: list[str] = field(default_factory=list, init=False)
    interrupted: bool = field(default=False, init=False)
    _over: bool = field(default=False, init=False)
    _leaving_another: bool = field(default=False, init=False)
    _begun: int = field(default=0, init=False)
    _why: str = field(default="", init=False)
    #: Where impacts were told to become infinitely many.
    _accumulated: float = field(default=np.inf, init=False)
    #: Begins and ends of steps in which touches turn into a rest, or a rest into touches.
    _rests: list[tuple[float, float]] = field(default_factory=list, init=False)
    #: Grazings beside which special points may hide.
    _hiding: list[float] = field(default_factory=list, init=False)
    #: The point from which the end of touches was looked for last, and what was found.
    _ahead: tuple[Point | None, Passage | None] = field(default=(None, None), init=False)

    def __post_init__(self) -> None:
        self._flows_counted = self.family.work.flows
        self.counters = BranchCounters(search_flows=self._flows_counted)

    def found(self) -> dict[str, Any]:
        """Return what a branch and a locus hold of the walk."""
        names = ("special", "counters", "notes", "interrupted")
        return {name: getattr(self, name) for name in names}

    # -- counting -------------------------------------------------------------------------------------

    def _count(self, kind: str) -> None:
        """Attribute the flows since the last call."""
        done = self.family.work.flows
        setattr(self.counters, kind, getattr(self.counters, kind) + done - self._flows_counted)
        self._flows_counted = done

    # -- points ---------------------------------------------------------------------------------------

    def located(self, step: Step, earlier: Step | None) -> list[SpecialPoint]:
        """Return the special points of a step except grazings; `earlier` is the step before it in the same touches."""
        return [] if self._leaving_another else crossings(self.family, step, earlier, self.notes)

    def begin(self, unknowns: Array, value: float, known: Any = None) -> Point:
        """Return the first point, heading for the far end of the interval.

        `known`: the evaluation of an orbit with these unknowns, whose signature need not be searched again.
        """
        problem = self.family.at(value)
        segmented = isinstance(known, SignatureEvaluation)
        chart, y = (known.chart, known.y) if segmented else charted(problem, unknowns)
        y = np.append(y, value)
        towards = level(y.size, self.family.interval.way)
        evaluation = chart.evaluate(problem, y[:-1], near=known)
        scales = scales_of(self.family, chart, problem, evaluation)
        y, evaluation = corrected(self.family, chart, y, scales, towards, np.zeros(y.size - 1), known=evaluation)
        return self._recentred(point_at(self.family, chart, y, towards, evaluation))

    # -- the walk -------------------------------------------------------------------------------------

    def follow(self, first: Point, step: float = FIRST, progress: Progress = False, *, leaving: bool = False) -> None:
        """Follow the branch from a point until it leaves the interval.

        If `leaving` is true, the branch begins at a special point of another branch. This point is not marked again.
        """
        self.points.append(first)
        self._count("flows")
        self._leaving_another = leaving
        work = self.family.work
        with branch_progress(self.family.interval, progress, self.family.what) as (report, pressed):
            try:
                with work.within(self.seconds, pressed):
                    self._walk(first, min(step, self.largest), report)
            except OutOfTime:
                if not pressed() and (self.seconds is None or time.monotonic() > work.until):
                    # The limit is that of a search which this walk is a part of.
                    raise
                now, self.interrupted = self.points[-1], pressed()
                if self.interrupted:
                    told = f"interrupted at {now.value:.9g}: what was found until then is here"
                else:
                    told = f"the limit of {self.seconds:g} s was reached at {now.value:.9g}; raise max_seconds to go on"
                self._stopped(now, told)
            if pressed() and not self.interrupted:
                # What comes after the branch, such as pictures, is to hear of it too.
                self.interrupted = True
                self.notes.append(f"interrupted at {self.points[-1].value:.9g}, the end of the {self.noun}")
        self._count("flows")
        if self._hiding:
            self.notes.insert(0, self._hiding_told())
        if self._rests:
            self.notes.insert(0, self._rests_told())
        self.special.sort(key=lambda mark: mark.place)
        self.counters.points, self.counters.check_flows = len(self.points), self.family.work.checks
        self.counters.eigensolves = self.family.work.runs.eigensolves

    def _walk(self, now: Point, step: float, report: Callable[[float], None]) -> None:
        """Follow the branch from a point."""
        largest = 0.0
        while not self._over:
            size = float(np.linalg.norm(now.y[: now.problem.size]))
            largest = max(largest, size)
            if size < _VANISHED * largest and not now.problem.least:
                self.notes.append(
                    f"the {self.noun} ends at {now.value:.6g}, where the motion vanishes: it is {size / largest:.0e} "
                    f"of the largest one{self.onward[1]}"
                )
                return
            if len(self.points) >= self.most:
                self._stopped(now, f"the {self.noun} was followed for {self.most} points; raise max_points to go on")
                return
            report(now.value)
            self.family.work.begin()
            step, end = self._within(now, step)
            if end is not None and step <= 0.0:
                self._ended(end)
                break
            after = self._advanced(now, step, end)
            if after is None:
                self._count("rejected_flows")
                step *= _SHRINK
                if step >= LEAST:
                    continue
                after = self._farther(now)
                if after is None:
                    self.notes.append(self._lost(now))
                    return
            now, step = after
        report(now.value)

    def _hiding_told(self) -> str:
        """Return beside which grazings special points may hide."""
        places, several = ", ".join(f"{value:.12g}" for value in self._hiding), "s" * (len(self._hiding) > 1)
        return (
            f"special points just beyond the grazing{several} at {places} may be missing: multipliers pass the unit "
            "circle there, before the touch is long enough to be followed"
        )

    def _rests_told(self) -> str:
        """Return where touches turn into a rest, or a rest into touches."""
        low, high = np.min(self._rests), np.max(self._rests)
        widest = max(abs(end - begin) for begin, end in self._rests)
        several = f"{len(self._rests)} steps" if len(self._rests) > 1 else "a step"
        return (
            f"between {low:.9g} and {high:.9g} touches turn into a rest at the gap, or a "
            f"rest into touches, in {several} of at most {widest:.1g}. No orbit there repeats to {CLOSES:g} of the "
            "motion, and special points inside are not listed"
        )

    def _stopped(self, now: Point, limit: str) -> None:
        """Note a limit, and what contacts do there, which may be the reason why it was reached."""
        self.notes.append(limit + what_contacts_do(now))

    def _lost(self, now: Point) -> str:
        """Return what is known about the place where no further orbit was found."""
        rounded = ""
        if (
            now.chart.segmented
            and now.chart.switches
            and np.linalg.cond(now.evaluation.jacobian * now.scales[:-1]) > _MAGNIFIES
        ):
            rounded = "; one touch after another magnifies rounding, so that it decides the direction of the branch"
        return (
            f"the {self.noun} was lost at {now.value:.12g}: Newton's method does not converge for the smallest "
            f"step{self._why}{what_contacts_do(now)}{rounded}{self.onward[0]}"
        )

    def _within(self, now: Point, step: float) -> tuple[float, float | None]:
        """Return a step that does not leave the interval, and the end of the interval if it leads there."""
        ahead = float(self._predicted(now, step)[-1])
        end = self.family.interval.beyond(ahead)
        return (step, None) if end is None else (step * (end - now.value) / (ahead - now.value), end)

    def _advanced(self, now: Point, step: float, end: float | None) -> tuple[Point, float] | None:
        """Return the next point, at an end of the interval where that is given, and step; None where it is too long."""
        chart = now.chart
        guess = self._predicted(now, step)
        if end is not None:
            guess[-1] = end
        try:
            y, evaluation = self._corrected(now, guess, step, end is not None)
            after = self._accepted(now, y, evaluation, step)
            if after is None or (end is not None and after.tangent[-1] * (end - now.value) < 0.0):
                return self._ending(now, step) if step <= _SHORT else None
            left = self.family.interval.beyond(after.value) if end is None else None
            if left is not None and left != now.value:
                # Off its prediction a step may lead beyond an end.
                return self._advanced(now, step * (left - now.value) / (after.value - now.value), left)
            passed = None
            if chart.segmented:
                passed = passage(self.family, now, after)
        except (ConvergenceError, np.linalg.LinAlgError) as error:
            self._why = f" ({error})"
            return self._ending(now, step)
        if passed is not None and passed.grazed:
            left, turns = self._before(now, passed)
            if (left > _NEAR or turns) and step > 0.5 * left:
                # Steps become shorter towards a grazing, as they begin short beyond it: special points lie close to it.
                return now, 0.5 * left
        if passed is not None:
            return self._passed(now, passed, step)
        angle = float(np.arccos(np.clip(now.tangent @ after.tangent, -1.0, 1.0)))
        special = self._examined(Step(now, after), step)
        if special is None:
            return None
        self._take(after, Step(now, after), special)
        if end is not None and not self._over:
            self._ended(end)
        if self._over or self._closed(now, after):
            return after, step
        factor = float(np.clip(_AIM / max(angle, 1e-3), 0.5, _GROW))
        return self._settled(self._recentred(after)), min(step * factor, self.largest)

    def _ending(self, now: Point, step: float) -> tuple[Point, float] | None:
        """Pass what no step reaches: a grazing at which several touches end, or touches that turn into a rest."""
        if not now.chart.segmented:
            return self._around_corner(now, step)
        if self._ahead[0] is not now:
            self._ahead = now, None
            with contextlib.suppress(ConvergenceError, np.linalg.LinAlgError):
                self._ahead = now, ending(self.family, now)
        passed = self._ahead[1]
        rests = passed is None and step * np.linalg.norm(now.tangent[:-1]) <= _RESTING
        if rests:
            passed = self._nearest_rest(now, step)
        if passed is None or self.family.interval.left(passed.at.value):
            return None
        if step > _SHORT and self._before(now, passed)[1]:
            self._why = " (the branch turns too far in one step)"
            return None
        laws, changed = now.problem.system.contacts, passed.at.chart.impacts ^ now.chart.impacts
        near = abs(passed.at.value - self._accumulated) <= _BESIDE * self.family.interval.size
        if changed and not passed.grazed and not near and laws is not None:
            self._accumulated = passed.at.value
            names = " and ".join(sorted({repr(laws.names[contact]) for contact, _ in changed}))
            self.notes.append(
                f"near {passed.at.value:.9g} impacts on {names} become infinitely many, and on one side bodies bounce "
                "until they rest. Special points accumulate there, and the nearest ones are not listed"
            )
        elif rests and not changed:
            self._rests.append((now.value, passed.at.value))
        return self._passed(now, passed, step)

    def _resting(self, now: Point, step: float, *, stick: bool = False) -> Passage | None:
        """Return the orbit a step ahead with the switches of an ordinary run, if there is one; see `resting`."""
        with contextlib.suppress(ConvergenceError, np.linalg.LinAlgError):
            return resting(self.family, now, now.y + step * now.tangent * now.scales, stick=stick)
        return None

    def _nearest_rest(self, now: Point, step: float) -> Passage | None:
        """Return the nearest such orbit a step ahead, or else a little beyond. What lies between is not examined.

        Where impacts become infinitely many, the nearest orbits have as many as can be told apart; one is taken beyond.
        """
        found, low, moves = self._resting(now, step), 0.0, float(np.linalg.norm(now.tangent[:-1]))
        while found is None and 0.0 < _BEYOND * step * moves <= _RESTING:
            low, step = step, _BEYOND * step
            found = self._resting(now, step)
        if found is None or found.at.chart.impacts != now.chart.impacts:
            return found
        for _ in range(_NEARER):
            at = 0.5 * (low + step)
            nearer = self._resting(now, at)
            low, step, found = (at, step, found) if nearer is None else (low, at, nearer)
        return found

    def _farther(self, now: Point) -> tuple[Point, float] | None:
        """Return the next orbit whose sliders switch as in an ordinary run, where they do so in very short times."""
        if not isinstance(now.chart, Signature) or now.problem.course.sliders is None:
            return None
        for length in _FARTHER:
            step = length / float(np.linalg.norm(now.tangent[:-1]))
            passed = self._resting(now, step, stick=True)
            if passed is not None and not self.family.interval.left(passed.at.value):
                self.notes.append(
                    f"between {now.value:.12g} and {passed.at.value:.12g} sliders stop and slide for times that are "
                    f"too short to be told apart{what_contacts_do(now)}. Special points there are not listed"
                )
                return self._passed(now, passed, step)
        return None

    def _around_corner(self, now: Point, step: float) -> tuple[Point, float] | None:
        """Return an orbit a short step beyond a corner of a branch by harmonic balance, where it may turn by any angle.

        It has corners where the number of stops of a slider changes. Beyond one it follows the direction that the
        equations have there, and their determinant with this direction keeps its sign.
        """
        if step > _SHORT:
            return None
        own = sided(now, now.tangent)

        def facing(y: Array, towards: Array, evaluation: Any = None) -> Point:
            found = point_at(self.family, now.chart, y, towards, evaluation, scales=now.scales)
            return found if sided(found, found.tangent) == own else found.turned()

        ahead = now.y + step * now.tangent * now.scales
        with contextlib.suppress(ConvergenceError, np.linalg.LinAlgError):
            after = facing(ahead, now.tangent)
            guess = ahead + step * after.tangent * now.scales
            for _ in range(2):
                y, evaluation = corrected(self.family, now.chart, guess, now.scales, after.tangent, after.by_value)
                after = facing(y, after.tangent, evaluation)
                way = Step(now, after)
                # The way from end to end leads along both sides where the corner is as far from both.
                guess = now.y + way.legs[0] * (now.tangent + after.tangent) * now.scales
            if way.legs.min() > 0.0 and way.length <= _NEAR:
                # What comes beyond is not predicted from what was before.
                self._take(after, None, self._examined(way, 0.0) or ())
                return after, step
        return None

    @staticmethod
    def _before(now: Point, passed: Passage) -> tuple[float, bool]:
        """Return how far ahead a change of the signature lies, and whether the branch turns too far up to there."""
        way = Step(now, passed.before)
        turned = now.tangent @ passed.before.tangent < _REFUSED
        return way.length, way.length > _SHORT and bool(turned or _elsewhere(way))

    def _passed(self, now: Point, passed: Passage, step: float) -> tuple[Point, float] | None:
        """Continue beyond a change of the signature."""
        last = passed.before
        if self.family.interval.left(last.value):
            return None
        if np.any(last.y != now.y):
            way = Step(now, last)
            special = self._examined(way, way.length if step > 0.5 * way.length else 0.0)
            if special is None:
                return now, 0.5 * way.length
            self._take(last, way, special)
            if self._over or self._closed(now, last):
                return last, step
        laws = last.problem.system.contacts
        assert laws is not None
        place = float(len(self.points) - 1)
        elastic = len(laws) - len(last.problem.given.sliders or ())
        for contact in passed.grazed:
            kind = "grazing" if contact < elastic else "sticking"
            self.special.append(special_at(kind, passed.at, place, laws.names[contact]))
        if passed.after is None:
            names = " and ".join(dict.fromkeys(repr(laws.names[contact]) for contact in passed.grazed))
            self.notes.append(
                f"the {self.noun} ends at {passed.at.value:.12g}, where one orbit grazes {names} several times, and "
                "none beside it touches each time. Orbits that touch at one of them may begin there: follow those that "
                "you want from a value beyond, with guess="
            )
            self._over = True
            return last, step
        smooth = not (laws.jumps.any() or laws.rigid.any() or last.problem.given.sliders)
        if smooth and isinstance(last.chart, Signature) and hidden_beside(last, passed.after):
            self._hiding.append(passed.at.value)
        self._take(passed.after)
        return self._recentred(passed.after, least=0.0), min(FIRST, self.largest)

    def _recentred(self, now: Point, least: float = np.inf) -> Point:
        """Return a point with its anchor away from all switches, where one comes nearer to it than a least length."""
        if not now.chart.segmented or now.chart.lengths(now.y[:-1])[[0, -1]].min() >= least:
            return now
        found = now.chart.recentred(now.evaluation, now.y[:-1], now.tangent * now.scales)
        if found is None:
            return now
        chart, y, begins, towards = found
        y = np.append(y, now.value)
        evaluation = chart.evaluate(now.problem, y[:-1], near=begins)
        scales = scales_of(self.family, chart, now.problem, evaluation)
        return point_at(self.family, chart, y, towards / scales, evaluation)

    def _settled(self, now: Point) -> Point:
        """Return a point at which bodies rest at rigid stops after as many bounces as an ordinary run needs there."""
        chart, problem, n = now.chart, now.problem, now.problem.size
        if not isinstance(chart, Signature) or not chart.unsettled(problem, now.evaluation):
            return now
        new, y = signature_of(problem, chart.flow(problem, now.y[:-1]))
        found = polished(new.evaluate(problem, y))
        if found is None or relative(found.y[:n] - now.y[:n], found.sizes) > CLOSES or not found.repeats:
            return now
        scales = scales_of(self.family, new, problem, found)
        towards = np.zeros(scales.size)
        towards[:n], towards[-1] = now.tangent[:n], now.tangent[-1]
        return point_at(self.family, new, np.append(found.y, now.value), towards, found, scales=scales)

    def _earlier(self, now: Point) -> tuple[Array, Array, float] | None:
        """Return the point before the last one, its tangent, both in scaled coordinates, and its distance."""
        before = self.steps[-1] if self.steps else None
        if before is None or before.last is not now:
            return None
        place = before.first.y / now.scales
        tangent = before.first.tangent * before.first.scales / now.scales
        length = float(np.linalg.norm(now.y / now.scales - place))
        return (place, tangent / np.linalg.norm(tangent), length) if length > 0.0 else None

    def _predicted(self, now: Point, step: float) -> Array:
        """Return the next point: on the cubic through the last two points with their tangents, or on the tangent."""
        earlier, here = self._earlier(now), now.y / now.scales
        if earlier is None:
            return (here + step * now.tangent) * now.scales
        place, tangent, length = earlier
        known = [-length, -length, 0.0, 0.0], [place, place, here, here], [tangent, now.tangent]
        return interpolated(*known, step) * now.scales

    def _corrected(self, now: Point, guess: Array, step: float, held: bool) -> tuple[Array, Any]:
        """Return the orbit near a guess; `held`: at its value of the parameter."""
        slope, earlier = now.tangent[-1], self._earlier(now)
        bend = 0.0 if earlier is None else (slope - earlier[1][-1]) / earlier[2]
        held = held or (isinstance(now.chart, Signature) and steady(slope, slope + step * bend))
        normal = level(guess.size, np.copysign(1.0, slope)) if held else now.tangent
        return corrected(self.family, now.chart, guess, now.scales, normal, now.by_value, near=now.evaluation)

    def _accepted(self, now: Point, y: Array, evaluation: Any, step: float) -> Point | None:
        """Return a corrected point, or None where the branch has turned too far.

        Under harmonic balance a branch has a corner where a slider begins to slip. There short steps may turn farther.
        """
        refused = _REFUSED if isinstance(now.problem, Shooting) or step > _SHORT else _CORNER
        scales = scales_of(self.family, now.chart, self.family.of(y), evaluation)
        secant = (y - now.y) / now.scales
        after = None
        # First the cheap test, without a direction.
        if secant @ now.tangent >= refused * np.linalg.norm(secant):
            towards = now.tangent * now.scales / scales
            towards /= np.linalg.norm(towards)
            after = point_at(self.family, now.chart, y, towards, evaluation, scales=scales)
        if after is None or after.tangent @ towards < refused:
            self._why = " (the branch turns too far in one step)"
            return None
        if step > _LEAST_SHARE * self.largest and _elsewhere(Step(now, after)):
            self._why = " (the step led to another branch)"
            return None
        return after

    def _examined(self, step: Step, length: float) -> list[SpecialPoint] | None:
        """Return the special points of the step from the last point; None where a length is too long to find all."""
        told = len(self.notes)
        self._count("flows")
        found = self.located(step, self.steps[-1] if len(self.points) - 1 > self._begun else None)
        self._count("refinement_flows")
        if len(self.notes) > told and length > _NEAR_OTHERS:
            # Where branches come near to each other a shorter step tells which of them is this one.
            del self.notes[told:]
            return None
        return found

    def _take(self, after: Point, step: Step | None = None, special: Sequence[SpecialPoint] = ()) -> None:
        """Add a point to the branch, and the special points of the step to it."""
        base = len(self.points) - 1
        for mark in special:
            self._mark(mark, base)
            if self._over:
                return
        if step is not None and self._leaving_another:
            # The special point at which the branch begins is near its first step.
            self._begun, self._leaving_another = base + 1, False
        self.points.append(after)
        self.steps.append(step)

    def _mark(self, special: SpecialPoint, base: int) -> None:
        """Add a special point. A branch over several periods ends where its orbits repeat earlier."""
        kind, at = special.kind, special.point
        problem = at.problem
        if kind == SHORTER:
            shortest = problem.shortest_period(at.unknowns(), at.evaluation)
            kind = "period_doubling" if shortest * 2 == problem.periods else "branch_point"
            self._over = True
            self.points.append(at)
            self.steps.append(None)
            times = "period" if shortest == 1 else "periods"
            self.notes.append(
                f"the branch ends at {at.value:.12g} on orbits over {shortest} {times} of the loads; beyond are the "
                "same orbits, later by whole periods"
            )
        self.special.append(replace(special, kind=kind, place=base + special.place))

    def _closed(self, now: Point, after: Point) -> bool:
        """Return whether the branch has come back to its first point, as it began; then it is over."""
        points = self.points
        if len(points) < _LOOP:
            return False
        own = now.chart.scales(now.problem, now.evaluation)[: points[0].unknowns().size]
        scales = np.append(own, self.family.interval.size)

        def place(point: Point) -> Array:
            return np.asarray(np.append(point.unknowns(), point.value) / scales)

        if abs(points[0].value - after.value) > abs(after.value - now.value) + 0.1 * self.family.interval.size:
            return False
        start, here, there = place(points[0]), place(now), place(after)
        step, before = there - here, len(points) - 2
        length = np.linalg.norm(step)
        share = float((start - here) @ step / (step @ step)) if np.any(step) else -1.0
        # A branch that began at a special point comes back to it. It may turn much there, away from its secant.
        again = [
            mark.place - before
            for mark in self.special
            if mark.place >= before and np.linalg.norm(place(mark.point) - start) <= _AGAIN * length
        ]
        off = not 0.0 <= share <= 1.0 or np.linalg.norm(start - here - share * step) > 0.1 * length
        if (off and not again) or step @ (place(points[1]) - start) <= 0.0:
            return False
        if not again:
            found = self._share_through(Step(now, after), start, place, share)
            if found is None:
                return False
            share = found
        self._over = True
        # The points beyond the first orbit are the beginning of the branch again.
        last = before + min(again, default=share)
        self.special[:] = [mark for mark in self.special if mark.place < last]
        self.notes.append(f"the {self.noun} is closed: it has come back to its first orbit at {points[0].value:.12g}")
        return True

    def _share_through(self, step: Step, start: Array, place: Callable[[Point], Array], share: float) -> float | None:
        """Return the share of a step at which the branch goes through its start; None where it passes beside it.

        States at t = 0 may come close to the first one by chance. `place`: returns the state and the value of a point.
        """
        along = place(step.last) - place(step.first)
        for _ in range(_REFINED):
            left = start - place(point_between(self.family, step, share))
            more = float(left @ along / (along @ along))
            if np.linalg.norm(left - more * along) <= _THROUGH * np.linalg.norm(along):
                return share
            share = min(max(share + more, 0.0), 1.0)
        return None

    def _ended(self, end: float) -> None:
        """Let the branch be over at an end of the interval."""
        self._over = True
        values = [point.value for point in (*self.points, *(mark.point for mark in self.special))]
        began = abs(self.points[0].value - end) <= _SAME * self.family.interval.size
        if end != self.family.interval.start or not began or len(values) < 2:
            return
        farthest = max(values, key=lambda value: abs(value - end))
        one, other = self.points[0].unknowns(), self.points[-1].unknowns()
        if np.linalg.norm(other - one) > _SAME * np.linalg.norm(one):
            self.notes.append(
                f"the {self.noun} turned near {farthest:.12g} and left the interval through its own start, at "
                f"{end:.12g}"
            )
            return
        self.notes.append(
            f"the walk turned round near {farthest:.12g} and came back along its own orbits, so that the {self.noun} "
            "and its special points are listed twice, and what comes beyond is missing. A step led from a part of the "
            f"{self.noun} to another one close to it; follow it with a smaller max_step="
        )


class Quiet(Follower):
    """Follows a branch that is part of a search: without special points, and without advice to who asked for more."""

    onward = "", ""

    def located(self, step: Step, earlier: Step | None) -> list[SpecialPoint]:
        """Return nothing."""
        return []


def _elsewhere(step: Step) -> bool:
    """Return whether the way to a neighbour has not the mean of the directions at both, as along one branch."""
    now, after = step.first, step.last
    mean = now.tangent + after.tangent * after.scales / now.scales
    return bool(np.linalg.norm(step.secant / step.length - mean / np.linalg.norm(mean)) > _APART)


def charted(problem: Any, unknowns: Array) -> tuple[Any, Array]:
    """Return the chart in which an orbit is followed, and its coordinates there."""
    return signature_at(problem, unknowns) if isinstance(problem, Shooting) else (ORIGIN, unknowns)


@contextlib.contextmanager
def branch_progress(
    interval: Interval, progress: Progress, what: str
) -> Iterator[tuple[Callable[[float], None], Callable[[], bool]]]:
    """Give a function that shows the parameter's value reached, and one that returns whether Ctrl-C was pressed."""
    counting = "{task.completed:.4g} of {task.total:.4g} along the interval"
    farthest = 0.0
    with TerminalBar((what, REPORTED), progress, interval.size, counting) as bar, deferred_interrupts() as pressed:

        def report(value: float) -> None:
            nonlocal farthest
            # A branch goes back and forth: the bar shows the farthest value.
            farthest = max(farthest, min(abs(value - interval.start), interval.size))
            bar.update(farthest, report=(value, interval.stop))

        yield report, pressed
