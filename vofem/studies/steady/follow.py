"""Following a branch of orbits by pseudo-arclength, through folds and grazings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError
from vofem.studies.steady.between import Step
from vofem.studies.steady.branch import BranchCounters
from vofem.studies.steady.charts import ORIGIN, EventChart, at_phase
from vofem.studies.steady.crossings import Crossing, crossings, hidden
from vofem.studies.steady.events import chart_at, extremes, phases, signature, slowest, switches
from vofem.studies.steady.family import Family
from vofem.studies.steady.grazing import (
    Touch,
    before,
    beyond,
    grazing,
    margin_around,
    phases_like,
    touch_of_extreme,
    touch_of_phase,
)
from vofem.studies.steady.point import Interval, Point, corrected, derivative_by_value, tangent_at
from vofem.studies.steady.shooting import Shooting

Array = NDArray[np.float64]

#: First, largest and least step in scaled coordinates.
FIRST, LARGEST, LEAST = 0.01, 0.1, 1e-9

#: Cosine of the angle between successive tangents below which a step is rejected, and the desired angle in rad.
_REFUSED, _AIM = np.cos(np.radians(25.0)), np.radians(8.0)

#: Cosine of the angle below which a step is rejected at a corner of a branch, and the largest step at a corner.
_CORNER, _SHORT = np.cos(np.radians(80.0)), 1e-4

#: Factors by which a step may change.
_SHRINK, _GROW = 0.4, 2.0

#: Relative rate of the slowest event below which the coordinates at this event are used, and the rate above which the
#: usual ones are used again.
_ENTER, _LEAVE = 0.1, 0.25

#: Number of points from which on it is checked whether a branch is closed.
_LOOP = 12

#: Share of the last step of a closed branch before its first orbit in which a special point is that of this orbit.
_AGAIN = 1e-2

#: Difference of two orbits, over the size of the motion, and of their values, over the interval, that are one.
_SAME = 1e-7

#: Largest change of an orbit over its period, as a share of its motion, and what rounding may be magnified to in it.
_CLOSES, _ROUNDED = 1e-8, 1e-14

#: Largest distance of a grazing from a point, in steps, and largest relative height of an extreme that is checked.
_FARTHEST, _NEAR = 4.0, 0.3


@dataclass
class Mark:
    """A special point.

    Attributes
    ----------
    kind : str
    point : Point
    place : float
        Number of the point before it, plus the share of the step to the next one.
    contact : str
        Name of the contact that grazes; empty for other kinds.
    turns : bool
        Whether the branch turns there, smoothly.
    """

    kind: str
    point: Point
    place: float
    contact: str = ""
    turns: bool = False


@dataclass
class Track:
    """The part of a branch that has been followed.

    Attributes
    ----------
    points : list of Point
    steps : list of Step or None
        The steps from each point to the next; None if the two have no common coordinates.
    marks : list of Mark
    notes : list of str
    interrupted : bool
        Whether Ctrl-C was pressed.
    """

    points: list[Point] = field(default_factory=list)
    steps: list[Step | None] = field(default_factory=list)
    marks: list[Mark] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    interrupted: bool = False


class Follower:
    """Follows a branch.

    Parameters
    ----------
    family : Family
    interval : Interval
    counters : BranchCounters
    largest : float
        Step.
    most : int
        Points.
    """

    def __init__(
        self,
        family: Family,
        interval: Interval,
        counters: BranchCounters,
        *,
        largest: float = LARGEST,
        most: int = 5000,
    ) -> None:
        self.family, self.interval, self.counters = family, interval, counters
        self.largest, self.most = largest, most
        self.track = Track()
        self._flows_counted = family.work.flows
        self._over = False
        self._leaving_another = False
        self._begun = 0
        #: Change over its period of the last orbit that was refused because it does not repeat.
        self._refused: float | None = None

    # -- counting -------------------------------------------------------------------------------------

    def _count(self, kind: str) -> None:
        """Attribute the flows since the last call."""
        done = self.family.work.flows
        setattr(self.counters, kind, getattr(self.counters, kind) + done - self._flows_counted)
        self._flows_counted = done

    # -- points ---------------------------------------------------------------------------------------

    def point(self, chart: Any, y: Array, towards: Array, evaluation: Any = None) -> Point:
        """Return a point with its tangent on the side of a direction in scaled coordinates."""
        problem = self.family.at(y[-1])
        evaluation = chart.evaluate(problem, y[:-1]) if evaluation is None else evaluation
        scales = np.append(chart.scales(problem, evaluation), self.interval.size)
        by_value = derivative_by_value(self.family, self.interval, chart, y, evaluation)
        tangent = tangent_at(evaluation, by_value, scales, towards)
        if tangent @ towards < 0.0:
            tangent = -tangent
        return Point(chart, y, problem, evaluation, scales, by_value, tangent)

    def begin(self, unknowns: Array, value: float) -> Point:
        """Return the first point, heading for the far end of the interval."""
        y = np.append(unknowns, value)
        towards = np.zeros(y.size)
        towards[-1] = 1.0 if self.interval.stop > self.interval.start else -1.0
        return self.point(ORIGIN, y, towards)

    # -- the walk -------------------------------------------------------------------------------------

    def follow(
        self,
        first: Point,
        step: float = FIRST,
        report: Callable[[float], bool] | None = None,
        *,
        leaving: bool = False,
    ) -> Track:
        """Follow the branch from a point until it leaves the interval.

        If `leaving` is true, the branch begins at a special point of another branch. This point is not marked again.
        """
        track = self.track
        track.points.append(first)
        self._count("flows")
        self._leaving_another = leaving
        now, step = first if leaving else self._recharted(first, None), min(step, self.largest)
        failures = 0
        while not self._over:
            if len(track.points) >= self.most:
                track.notes.append(f"the branch was followed for {self.most} points; raise max_points to go on")
                break
            if report is not None and report(now.value):
                track.interrupted = True
                track.notes.append(f"interrupted at {now.value:.9g}: what was found until then is here")
                break
            after = self._advanced(now, step)
            if after is None:
                self._count("rejected_flows")
                failures += 1
                passed = self._near_grazing(now, step) if failures > 1 else None
                if passed is not None:
                    now, step, failures = passed, min(step, FIRST), 0
                    continue
                step *= _SHRINK
                if step < LEAST:
                    track.notes.append(f"the branch was lost at {now.value:.12g}: {self._why_lost()}")
                    break
                continue
            failures, self._refused = 0, None
            now, step = after
        else:
            # What comes after the branch, such as pictures, is to hear of it too.
            if report is not None and report(now.value):
                track.interrupted = True
                track.notes.append(f"interrupted at {now.value:.9g}, the end of the branch")
        self.counters.points = len(track.points)
        track.marks.sort(key=lambda mark: mark.place)
        return track

    def _advanced(self, now: Point, step: float) -> tuple[Point, float] | None:
        """Return the next point and step, or None where the step was too long."""
        chart = now.chart
        guess = now.y + (step * now.tangent + 0.5 * step**2 * self._bend(now)) * now.scales
        if isinstance(chart, EventChart) and chart.rate(now.problem, guess[:-1]) <= 0.0:
            return self._leaving(now, guess, step)
        try:
            y, evaluation, by_value = corrected(self.family, chart, guess, now.scales, now.tangent, now.by_value)
            after = self._accepted(now, y, evaluation, by_value, step)
        except ConvergenceError:
            return None
        if after is None:
            return None
        if isinstance(chart, EventChart) and chart.rate(after.problem, after.y[:-1]) <= 0.0:
            return None
        if not self._repeats(after):
            return None
        if signature(chart, after.evaluation) != signature(chart, now.evaluation):
            return self._changed(now, after, step)
        end = self.interval.beyond(after.value)
        if end is not None:
            return self._last(now, after, end)
        angle = float(np.arccos(np.clip(now.tangent @ after.tangent, -1.0, 1.0)))
        self._take(Step(now, after))
        if self._over or self._closed(now, after):
            return after, step
        factor = float(np.clip(_AIM / max(angle, 1e-3), 0.5, _GROW))
        return self._recharted(after, now), min(step * factor, self.largest)

    def _bend(self, now: Point) -> Array:
        """Return the change of the tangent along the branch, from the step that led to a point; zero without one."""
        before = self._earlier(Step(now, now))
        if before is None:
            return np.zeros_like(now.tangent)
        length = float(np.linalg.norm((now.y - before.first.y) / now.scales))
        tangent = before.first.tangent * before.first.scales / now.scales
        change = now.tangent - tangent / np.linalg.norm(tangent)
        return np.asarray(change / length) if length > 0.0 else np.zeros_like(change)

    def _accepted(self, now: Point, y: Array, evaluation: Any, by_value: Array, step: float) -> Point | None:
        """Return a corrected point, or None where the branch has turned too far.

        Under harmonic balance a branch has a corner where a slider begins to slip. There short steps may turn farther.
        """
        refused = _REFUSED if isinstance(now.problem, Shooting) or step > _SHORT else _CORNER
        problem = self.family.at(y[-1])
        chart = now.chart
        scales = np.append(chart.scales(problem, evaluation), self.interval.size)
        # First the cheap test, with the derivative from the correction.
        towards = now.tangent * now.scales / scales
        towards /= np.linalg.norm(towards)
        secant = (y - now.y) / now.scales
        if secant @ now.tangent < refused * np.linalg.norm(secant):
            return None
        by_value = derivative_by_value(self.family, self.interval, chart, y, evaluation)
        tangent = tangent_at(evaluation, by_value, scales, towards)
        if tangent @ towards < refused:
            return None
        return Point(chart, y, problem, evaluation, scales, by_value, tangent)

    def _repeats(self, point: Point, grazing: Point | None = None) -> bool:
        """Return whether an orbit closes under one flow over its period in which no event is ignored.

        In coordinates at events some events are ignored. Where a force jumps, the flow changes like a root at a
        grazing, and rounding of the state alone decides whether an orbit beside it touches: these are not refused.
        """
        problem = point.problem
        if not isinstance(problem, Shooting) or point.chart is ORIGIN:
            return True
        begun = self.family.work.flows
        try:
            plain = problem.evaluate(point.unknowns(), derivative=False)
            point.change = plain.error
            if plain.error <= _CLOSES or (grazing is not None and _jumps(problem, _grazed(grazing))):
                return True
            matrix = problem.evaluate(point.unknowns()).monodromy / problem.scales[:, None] * problem.scales
        except ConvergenceError:
            return False
        finally:
            done = self.family.work.flows - begun
            self.counters.check_flows += done
            self._flows_counted += done
        if plain.error <= _ROUNDED * np.linalg.norm(matrix):
            return True
        self._refused = plain.error
        return False

    def _why_lost(self) -> str:
        """Return why no further orbit was found."""
        if self._refused is None:
            return (
                "Newton's method does not converge for the smallest step; the motion beyond may chatter or touch two "
                "contacts at once"
            )
        return (
            f"what was found beyond does not repeat, but changes by {self._refused:.1e} of the motion over its period, "
            "so it is no orbit; a contact may begin or cease to touch there. Try to continue from an orbit beyond, "
            "found with vofem.periodic"
        )

    def _take(self, step: Step | None, point: Point | None = None) -> None:
        """Add a point to the branch, and the special points on the way to it."""
        track = self.track
        after = point if step is None else step.last
        assert after is not None
        self._count("flows")
        base = len(track.points) - 1
        if step is not None:
            found = [] if self._leaving_another else crossings(self.family, step, self.interval)
            for crossing in found:
                self._mark(crossing, step, base)
                if self._over:
                    break
            earlier = track.steps[-1] if track.steps else None
            if earlier is not None and not self._over and base > self._begun:
                self._look_between(earlier, step, base)
            if self._leaving_another:
                # The special point at which the branch begins is near its first step.
                self._begun, self._leaving_another = base + 1, False
            self._count("refinement_flows")
        if not self._over:
            track.points.append(after)
            track.steps.append(step)

    def _look_between(self, earlier: Step, step: Step, base: int) -> None:
        """Mark special points of the last two steps that undo each other."""
        first, second = (
            {mark.kind for mark in self.track.marks if place <= mark.place < place + 1.0}
            for place in (base - 1.0, float(base))
        )
        before, after = hidden(self.family, self.interval, (earlier, step), (first, second))
        for crossing in before:
            self._mark(crossing, earlier, base - 1)
        for crossing in after:
            self._mark(crossing, step, base)

    def _earlier(self, step: Step) -> Step | None:
        """Return the step that ends where another one begins, in the same coordinates, or None."""
        before = self.track.steps[-1] if self.track.steps else None
        if before is None or before.last.y is not step.first.y or type(before.last.chart) is not type(step.first.chart):
            return None
        return before

    def _mark(self, crossing: Crossing, step: Step, base: int) -> None:
        """Add a crossing. A branch over several periods ends where its orbits repeat earlier."""
        kind, at = crossing.kind, crossing.point
        problem = at.problem
        if not self._repeats(at):
            self._over = True
            self.track.notes.append(f"the branch was lost at {step.first.value:.12g}: {self._why_lost()}")
            return
        if kind == "shorter":
            shortest = problem.shortest_period(at.unknowns(), at.evaluation)
            kind = "period_doubling" if shortest * 2 == problem.periods else "branch_point"
            self._over = True
            self.track.points.append(at)
            self.track.steps.append(None)
            times = "period" if shortest == 1 else "periods"
            self.track.notes.append(
                f"the branch ends at {at.value:.12g} on orbits over {shortest} {times} of the loads; beyond are the "
                "same orbits, later by whole periods"
            )
        self.track.marks.append(Mark(kind, at, base + crossing.share, turns=crossing.turns))

    def _closed(self, now: Point, after: Point) -> bool:
        """Return whether the branch has come back to its first point, as it began; then it is over."""
        points = self.track.points
        if len(points) < _LOOP:
            return False
        scales = np.append(ORIGIN.scales(now.problem, now.evaluation), self.interval.size)

        def place(point: Point) -> Array:
            return np.asarray(np.append(point.unknowns(), point.value) / scales)

        if abs(points[0].value - after.value) > abs(after.value - now.value) + 0.1 * self.interval.size:
            return False
        start, here, there = place(points[0]), place(now), place(after)
        step = there - here
        share = float((start - here) @ step / (step @ step)) if np.any(step) else -1.0
        if not 0.0 <= share <= 1.0 or np.linalg.norm(start - here - share * step) > 0.1 * np.linalg.norm(step):
            return False
        if step @ (place(points[1]) - start) <= 0.0:
            return False
        self._over = True
        # The points beyond the first orbit are the beginning of the branch again.
        last = len(points) - 2 + share - _AGAIN
        self.track.marks[:] = [mark for mark in self.track.marks if mark.place < last]
        self.track.notes.append(f"the branch is closed: it has come back to its first orbit at {points[0].value:.12g}")
        return True

    def _last(self, now: Point, after: Point, end: float) -> tuple[Point, float] | None:
        """Take the point at an end of the interval; the branch is over."""
        share = (end - now.value) / (after.value - now.value)
        guess = now.y + share * (after.y - now.y)
        guess[-1] = end
        normal = np.zeros(guess.size)
        normal[-1] = 1.0
        try:
            y, evaluation, _ = corrected(self.family, now.chart, guess, now.scales, normal, now.by_value)
            if signature(now.chart, evaluation) != signature(now.chart, now.evaluation):
                return None
            last = self.point(now.chart, y, now.tangent, evaluation)
        except ConvergenceError:
            return None
        if not self._repeats(last):
            return None
        self._take(Step(now, last))
        self._over = True
        return last, 0.0

    # -- coordinates ----------------------------------------------------------------------------------

    def _recharted(self, now: Point, earlier: Point | None) -> Point:
        """Return a point in the coordinates that suit it: those of its slowest event where that is slow."""
        if not isinstance(now.problem, Shooting):
            return now
        flow, problem = now.evaluation.flow, now.problem
        chart = now.chart
        if isinstance(chart, EventChart):
            mine = [p for p in phases(problem, chart, flow) if p.time == flow.start.time and p.contact == chart.contact]
            if mine and mine[0].rate < _LEAVE:
                margin = min(0.4 * mine[0].earlier / problem.duration, 0.25)
                return replace(now, chart=replace(chart, margin=margin))
        phase = slowest(problem, chart, flow)
        slow = phase is not None and phase.rate < _ENTER
        if not slow:
            if not isinstance(chart, EventChart):
                return now if chart is ORIGIN else replace(now, chart=ORIGIN)
            return self._moved(now, earlier, ORIGIN, now.unknowns())
        assert phase is not None
        if isinstance(chart, EventChart) and phase.contact == chart.contact and phase.time == flow.start.time:
            return now
        new, y = chart_at(problem, flow, chart, phase)
        if len(new.switching) > 1 and _jumps(problem, new.switching):
            # Derivatives along the event of one contact would miss that the other one moves.
            return now
        return self._moved(now, earlier, new, y)

    def _moved(self, now: Point, earlier: Point | None, chart: Any, y: Array) -> Point:
        """Return a point in other coordinates, its tangent on the side away from an earlier point."""
        problem = now.problem
        try:
            evaluation = chart.evaluate(problem, y)
            if evaluation.error > 1e-8:
                return now
            scales = np.append(chart.scales(problem, evaluation), self.interval.size)
            whole = np.append(y, now.value)
            towards = np.zeros(whole.size)
            known = None if earlier is None else self._coordinates(chart, earlier, float(y[0]))
            if known is not None and earlier is not None:
                towards = (whole - np.append(known, earlier.value)) / scales
            if not np.any(towards):
                towards[-1] = now.tangent[-1]
            if not np.any(towards):
                return now
            moved = self.point(chart, whole, towards / np.linalg.norm(towards), evaluation)
        except ConvergenceError:
            return now
        finally:
            self._count("flows")
        return moved

    def _joined(self, now: Point, after: Point) -> Step | None:
        """Return the step to a point in the coordinates of that point; None where the other one has none of these."""
        chart = ORIGIN if not isinstance(after.chart, EventChart) else after.chart
        if now.chart is chart:
            return Step(now, after)
        y = self._coordinates(chart, now, float(after.y[0]))
        if y is None:
            return None
        towards = (after.y - np.append(y, now.value)) / after.scales
        if not np.any(towards):
            return None
        try:
            moved = self.point(chart, np.append(y, now.value), towards / np.linalg.norm(towards))
        except ConvergenceError:
            return None
        return Step(moved, after) if moved.evaluation.error <= 1e-8 else None

    def _coordinates(self, chart: Any, point: Point, phase: float) -> Array | None:
        """Return the coordinates of a point in a chart, near a phase; None where it has no such event."""
        problem, flow = point.problem, point.evaluation.flow
        if not isinstance(chart, EventChart):
            return point.unknowns()
        if isinstance(point.chart, EventChart) and point.chart.contact == chart.contact:
            return point.y[:-1]
        turn = 2.0 * np.pi * problem.periods
        best, found = 0.2 * turn, None
        for other in phases(problem, point.chart, flow):
            if other.contact != chart.contact or other.status != chart.after[chart.contact]:
                continue
            angle = other.time * problem.loads.omega
            away = abs((angle - phase + 0.5 * turn) % turn - 0.5 * turn)
            if away < best:
                best, found = away, other
        if found is None:
            return None
        _, y = chart_at(problem, flow, point.chart, found)
        y[0] = phase + (y[0] - phase + 0.5 * turn) % turn - 0.5 * turn
        return y

    # -- grazings -------------------------------------------------------------------------------------

    def _leaving(self, now: Point, guess: Array, step: float) -> tuple[Point, float] | None:
        """Pass the grazing at which the event of the coordinates vanishes."""
        chart = now.chart
        here, there = chart.rate(now.problem, now.y[:-1]), chart.rate(now.problem, guess[:-1])
        target = now.y + here / (here - there) * (guess - now.y)
        problem = self.family.at(target[-1])
        if here <= 0.0 or there >= here:
            return None
        time, state = chart.point(problem, target[:-1])
        mine = [t for t, contact, *_ in switches(chart, now.evaluation.flow) if contact == chart.contact]
        margin = margin_around(now.problem, mine[2:], now.evaluation.flow.start.time)
        own = [p for p in phases(now.problem, chart, now.evaluation.flow) if p.contact == chart.contact]
        also = phases_like(now, min(own, key=lambda phase: phase.rate)) if own else ()
        touch = Touch(problem, float(target[-1]), chart.contact, time, state, chart.before, margin, also)  # type: ignore[arg-type]
        return self._passed_out(now, touch, step)

    def _changed(self, now: Point, after: Point, step: float) -> tuple[Point, float] | None:
        """Pass a grazing between two points with different events."""
        counts = [dict(pair for pair in signature(p.chart, p.evaluation) or () if pair[1] > 0) for p in (now, after)]
        contacts = {j for count in counts for j in count if counts[0].get(j, 0) != counts[1].get(j, 0)}
        appear = {counts[1].get(j, 0) > counts[0].get(j, 0) for j in contacts}
        if len(appear) != 1:
            return None
        appears = appear.pop()
        owner = after if appears else now
        own = [p for p in phases(owner.problem, owner.chart, owner.evaluation.flow) if p.contact in contacts]
        own = [p for p in own if p.stop - p.time < p.earlier]
        if not own:
            return None
        touch = touch_of_phase(owner, min(own, key=lambda phase: phase.rate))
        if appears:
            return self._passed_in(now, touch, step)
        return self._passed_out(now, touch, step)

    def _near_grazing(self, now: Point, step: float) -> Point | None:
        """Return a point beyond a grazing that is near, where the branch does not go on without one."""
        if not isinstance(now.problem, Shooting):
            return None
        near = [e for e in extremes(now.problem, now.evaluation.flow) if e.size < _NEAR]
        for extreme in near[:2]:
            touch = touch_of_extreme(now, extreme.contact, extreme.time, extreme.status)
            found = self._passed_in(now, touch, max(step, FIRST))
            if found is not None:
                return found[0]
        return None

    def _located(self, now: Point, touch: Touch, step: float) -> Point | None:
        """Return a grazing, where it lies ahead and within reach."""
        try:
            at = grazing(self.family, self.interval, touch)
        except ConvergenceError:
            return None
        here, there = now.unknowns(), at_phase(at.problem, at.evaluation.flow, 0.0)
        n = here.size // 2
        origin = ORIGIN.scales(now.problem, now.evaluation)
        away = np.append((there - here) / origin, (at.value - now.value) / self.interval.size)
        if np.linalg.norm(away) > _FARTHEST * step or n == 0:
            return None
        if now.chart is ORIGIN and away @ now.tangent < -1e-3 * np.linalg.norm(away):
            return None
        return None if self._passed_before(at, there, origin) else at

    def _passed_before(self, at: Point, state: Array, scales: Array) -> bool:
        """Return whether the branch has come through a grazing already: then going on from it would lead back.

        Only one branch continues from a grazing, so a branch can return to this orbit only if it is closed.
        """
        for mark in self.track.marks:
            if mark.kind != "grazing" or abs(mark.point.value - at.value) > _SAME * self.interval.size:
                continue
            if np.max(np.abs((mark.point.unknowns() - state) / scales), initial=0.0) <= _SAME:
                return True
        return False

    def _passed_in(self, now: Point, touch: Touch, step: float) -> tuple[Point, float] | None:
        """Continue with a contact that begins to touch."""
        at = self._located(now, touch, step)
        try:
            if at is None or self._signed(at, at) != self._signed(now, at):
                return None
            outside = before(self.family, self.interval, at)
            several = _may_split(at)
            first = None if several else beyond(self.family, self.interval, at)
            if not self._repeats(outside, at):
                return None
        except ConvergenceError:
            return None
        finally:
            self._count("refinement_flows")
        end = self.interval.beyond(at.value)
        if end is not None:
            return None
        self._take(self._joined(now, outside), outside)
        if self._over:
            return outside, step
        self._graze(at, outside)
        if first is None:
            self._ends_there(at)
            return outside, step
        self._take(None, first)
        return first, min(step, FIRST)

    def _passed_out(self, now: Point, touch: Touch, step: float) -> tuple[Point, float] | None:
        """Continue without a contact that has just stopped touching."""
        at = self._located(now, touch, step)
        try:
            if at is None or self._signed(at, at) == self._signed(now, at):
                return None
            outside = before(self.family, self.interval, at)
            if not self._repeats(outside, at):
                return None
            if _may_split(at):
                self._take(None, outside)
                self._graze(at, outside)
                self._ends_there(at)
                return outside, step
            last = beyond(self.family, self.interval, at)
        except ConvergenceError:
            return None
        finally:
            self._count("refinement_flows")
        if self.interval.beyond(at.value) is not None:
            return None
        inside = replace(last, tangent=-last.tangent)
        same = isinstance(now.chart, EventChart) and now.chart.contact == last.chart.contact
        if same:
            # The same phase of the loads, counted from the same period.
            turn = 2.0 * np.pi * now.problem.periods
            shift = np.round((now.y[0] - inside.y[0]) / turn) * turn
            moved = inside.y.copy()
            moved[0] += shift
            inside = replace(inside, y=moved)
            if inside.tangent @ now.tangent < 0.0:
                return None
        self._take(Step(now, inside) if same else self._joined(now, inside), inside)
        if self._over:
            return inside, step
        away = replace(outside, tangent=-outside.tangent)
        self._take(None, away)
        self._graze(at, away)
        return replace(away, chart=ORIGIN), min(step, FIRST)

    @staticmethod
    def _signed(point: Point, at: Point) -> Any:
        """Return how often contacts close in an orbit, without the contacts that graze together at another orbit."""
        return signature(point.chart, point.evaluation, [contact for contact, _ in at.chart.also])

    def _ends_there(self, at: Point) -> None:
        """End the branch at a grazing of several contacts."""
        laws = at.problem.system.contacts
        assert laws is not None
        names = " and ".join(repr(laws.names[contact]) for contact in _grazed(at))
        self.track.notes.append(
            f"the branch ends at {at.value:.12g}, where contacts {names} are grazed by one orbit. With forces that "
            "jump, as those of acts_on='displacement', orbits that touch one of them or all may begin there: follow "
            "those that you want from a value beyond, with guess="
        )
        self._over = True

    def _graze(self, at: Point, shown: Point) -> None:
        laws = at.problem.system.contacts
        assert laws is not None
        place = float(len(self.track.points) - 1)
        for contact in _grazed(at):
            self.track.marks.append(Mark("grazing", shown, place, laws.names[contact]))


def _grazed(at: Point) -> list[int]:
    """Return the contacts that an orbit grazes."""
    return [at.chart.contact, *(contact for contact, _ in at.chart.also)]


def _may_split(at: Point) -> bool:
    """Return whether several branches may continue from a grazing: one of several contacts with a force that jumps.

    Where no force jumps the flow has a continuous derivative, and there is one branch.
    """
    contacts = _grazed(at)
    return len(contacts) > 1 and _jumps(at.problem, contacts)


def _jumps(problem: Any, contacts: list[int]) -> bool:
    """Return whether the force of one of some contacts jumps."""
    laws = problem.system.contacts
    return bool(np.any(laws.jump[contacts] & (laws.gap[contacts] > 0.0)))
