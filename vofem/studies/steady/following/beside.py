"""The orbit at a change of the signature, and the orbits beside it.

Where one of the numbers that are watched vanishes lies an orbit that belongs to two signatures. In one of them,
outside, nothing has begun; in the other something has no length or no speed. Whichever way a branch comes, this orbit
is solved outside with one touch or stick of length zero, which is regular, and all that begins there at once is read
from it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.laws.friction import DOWN, UP
from vofem.studies.steady.following.family import Family
from vofem.studies.steady.following.point import Point, corrected, derivative_by_value, point_at, scales_of
from vofem.studies.steady.following.watched import (
    STUCK,
    TOGETHER,
    Begun,
    Mark,
    hit_near,
    is_among,
    mark_at,
    mark_of,
    nearest_extreme,
    newly_touching,
    run_of,
    slips_between,
    stuck_of,
    turn_near,
)
from vofem.studies.steady.segments.gaps import ROUNDING, jumps, law_of, stops_of
from vofem.studies.steady.segments.signature import Signature, States
from vofem.studies.steady.segments.switches import AT_ONCE, Switch
from vofem.system import CLOSED, OPEN, PINNED

#: Error of an evaluation of a grazing: as small as rounding allows.
_EXACT = 1e-16

#: Length in rad of a touch or stick that has just begun, and of several touches which begin at once, whose equations
#: are singular at length zero.
_BEYOND, _SEVERAL = 1e-8, 1e-6

#: Largest height of a slider's extreme, over its limit or the speed of the motion, in the orbit at its limit.
_AT_LIMIT = 1e-10

#: Height of a slider's extreme up to which it begins together with another one: forces are rounded more than places.
_FORCES = 1e-11

#: Longer ones, and the cosines of the angle between the branch and lengths that grow evenly between which they are
#: needed: where the branch bends from there to other directions, rounding decides.
_LONGER, _BENDS = (1e-6, 1e-5), (0.14, 0.99999)

#: How often states in which segments begin follow those before until they are those of one orbit.
_SETTLED = 2

#: Steps in scaled coordinates to the first orbit beyond a grazing where forces jump or bodies rebound. Rounding grows
#: the more the nearer the grazing; the first is taken of which an ordinary run tells that it repeats, or what it lacks.
_NEAREST = (1e-5, 1e-4, 1e-3, 1e-2)

#: An orbit may lie aside of a step by a share of it.
ASIDE = 0.3

#: Rate of the parameter, in scaled coordinates, that may be rounding beside a grazing.
_ROUNDED = 1e-8

#: Steps to the orbit in which a slider just stops, or just begins to slide.
_MOST = 8

#: Step in scaled coordinates by which heights, speeds and reactions are differentiated.
_DIFFERENCE = 1e-6

#: Why a branch ends where a slider stops or breaks away for some time at once.
_JUMPS = (
    "a slider stops or begins to slide there, for a time that is not short: where static friction is larger than that "
    "of sliding, the motion jumps"
)


def orbit_outside(
    family: Family, chart: Signature, guess: Array, mark: Mark, towards: Array, near: Any
) -> tuple[Point, list[Mark]]:
    """Return the orbit near a guess in which something is about to begin, and all that is, this one first.

    `near`: an evaluation near the guess, or `States`.
    """
    if law_of(family.of(guess), mark.contact) == "stick" and not mark.turns:
        point, mark = _at_limit(family, chart, guess, mark, towards, near)
        rounding = max(_FORCES, 4.0 * abs(nearest_extreme(point.evaluation, mark).height))
    else:
        point, mark = _without_length(family, chart, guess, mark, towards, near)
        rounding = TOGETHER
        if mark.turns and _breaks(point.problem, mark.contact) and _stays(point, mark):
            raise ConvergenceError(_JUMPS)
    y = point.y
    own = [mark_of(chart, y, k) for k in range(len(chart.switches))]
    own = [one for one in own if law_of(point.problem, one.contact) != "stick"]
    found = [
        mark_at(e)
        for e in point.evaluation.extremes
        if abs(e.height) <= rounding and not is_among(chart, [mark, *own], e.contact, e.phase)
    ]
    margins = point.evaluation.margins.items()
    turns = [mark_of(chart, y, k) for k, (margin, least) in margins if abs(margin) <= max(rounding, least)]
    return point, [mark, *found, *(turn for turn in turns if not is_among(chart, [mark], turn.contact, turn.phase))]


def orbit_inside(family: Family, outer: Point, marks: Sequence[Mark]) -> Point | None:
    """Return the first orbit in which all has begun that is about to; None if there is none beside."""
    chart, y, begins, begun = _begun(outer.evaluation, outer.chart, outer.y[:-1], marks)
    inner = orbit_beyond(family, chart, np.append(y, outer.value), begun, begins)
    return inner if inner is None else not_turned(inner, outer)


def _at_limit(
    family: Family, chart: Signature, guess: Array, mark: Mark, towards: Array, near: Any
) -> tuple[Point, Mark]:
    """Return the orbit near a guess in which a slider just stops, or just begins to slide, and where in the orbit."""
    problem = family.of(guess)
    if _breaks(problem, mark.contact):
        raise ConvergenceError(_JUMPS)
    evaluation = chart.evaluate(problem, guess[:-1], near=near)
    scales = scales_of(family, chart, problem, evaluation)
    by_value = derivative_by_value(family, chart, guess, evaluation)
    direction, best = towards / np.linalg.norm(towards), np.inf
    for _ in range(_MOST):
        y, evaluation = corrected(family, chart, guess, scales, direction, by_value, tolerance=_EXACT, near=evaluation)
        point = point_at(family, chart, y, direction, evaluation)
        found = nearest_extreme(point.evaluation, mark)
        mark = mark._replace(phase=found.phase)
        if abs(found.height) <= ROUNDING or abs(found.height) >= 0.5 * best:
            break
        best, scales, by_value, direction = abs(found.height), point.scales, point.by_value, point.tangent
        away = float(away_along(family, point, [mark])[0])
        guess = point.y + found.height / away * point.tangent * point.scales
    if abs(found.height) > _AT_LIMIT:
        raise ConvergenceError("the orbit in which a slider just stops or begins to slide was not found")
    return (point if point.tangent @ towards >= 0.0 else point.turned()), mark


def _without_length(
    family: Family, chart: Signature, guess: Array, mark: Mark, towards: Array, near: Any
) -> tuple[Point, Mark]:
    """Return the orbit near a guess in which something has begun that has no length, and where in the orbit."""
    known = chart.evaluate(family.of(guess), guess[:-1], derivative=False, near=near)
    long, y, begins, ((_, k, _),) = _begun(known, chart, guess[:-1], [mark], touches=True)
    at = with_length(family, long, np.append(y, guess[-1]), known.problem.size + k - mark.hit, 0.0, begins)
    slides = law_of(at.problem, mark.contact) == "stick"
    mark = mark._replace(phase=float(long.phases(at.y[:-1])[k - mark.hit]))
    gone = [k - 1] if slides else [k - 1 - mark.hit, k]
    y = np.append(long.edited(at.y[:-1], gone)[1], at.value)
    return point_at(family, chart, y, towards, near=long.begins_of(at.evaluation, gone)), mark


def _breaks(problem: Any, slider: int) -> bool:
    """Return whether the force of a slider jumps where it breaks away."""
    sliders = problem.course.sliders
    return bool(sliders.static[slider - sliders.first] > sliders.limit[slider - sliders.first])


def _stays(point: Point, mark: Mark) -> bool:
    """Return whether a slider that begins to stick where it turns would do so for long: what pulls at it decreases."""
    chart, problem, path = point.chart, point.problem, point.evaluation.path
    k = turn_near(chart, chart.phases(point.y[:-1]), mark.contact, mark.phase)
    stuck = chart.statuses[k].copy()
    stuck[mark.contact] = PINNED
    time, tau = float(path.times[k] + path.durations[k]), STUCK / problem.loads.omega
    held = int(np.sum(stuck[: mark.contact] == PINNED))
    pull = problem.course.motion(stuck, np.array([time]), path.ends[k][None]).reactions(np.array([0.0, tau]))[held]
    return bool((pull[1] - pull[0]) * (1.0 if chart.switches[k].status == UP else -1.0) < 0.0)


def _begun(
    known: Any, chart: Signature, y: Array, marks: Sequence[Mark], *, touches: bool = False
) -> tuple[Signature, Array, States, list[Begun]]:
    """Return the signature in which marks have begun without any length, coordinates, states, and what has begun.

    `touches`: impacts on rigid stops are touches without length too, and none lasts while a slider is at rest.
    """
    problem = known.problem
    groups: list[tuple[float, list[Mark]]] = []
    for mark in sorted(marks, key=lambda mark: mark.phase):
        if groups and chart.alike(groups[-1][0], mark.phase):
            groups[-1][1].append(mark)
        else:
            groups.append((mark.phase, [mark]))
    phases, added, ends = chart.phases(y), list[tuple[int, float, Switch]](), list[tuple[int, int, int]]()
    for phase, together in groups:
        number, touched = int(np.searchsorted(phases, phase)), []
        for mark in together:
            contact, law = mark.contact, law_of(problem, mark.contact)
            if law == "stick":
                new = _slip(known, chart, phases, mark)
                ends.append((len(added), len(added) + len(new) - 1, 2 - len(new)))
                added += new
            elif mark.hit:
                ends.append((len(added), len(added) + 1, 0))
                added += touch(problem, chart, y, [contact], phase, hit=True)
            elif law == "impact" and not touches:
                ends.append((len(added), len(added), 0))
                added.append((number, phase, Switch(contact, int(chart.statuses[number][contact]))))
            else:
                touched.append(contact)
        if touched:
            ends.append((len(added), len(added) + 2 * len(touched) - 1, 0))
            added += touch(problem, chart, y, touched, phase, lasts=not touches)
    begins = chart.begins_of(known, (), added)
    chart, y, numbers = chart.edited(y, (), added)
    begun = [(numbers[first], numbers[last] + later) for first, last, later in ends]
    return chart, y, begins, [lasting_of(problem, chart, p, k) for p, k in begun]


def _slip(known: Any, chart: Signature, phases: Array, mark: Mark) -> list[tuple[int, float, Switch]]:
    """Return what `Signature.edited` adds where a slider sticks or slides for no time; one switch where it turns."""
    contact, phase, turns, _ = mark
    if turns:
        k = turn_near(chart, phases, contact, phase)
        return [(k, float(phases[k]), Switch(contact, PINNED))]
    for k, switch in enumerate(chart.switches):
        if switch[:2] == (contact, PINNED) and chart.alike(float(phases[k]), phase):
            return [(k, float(phases[k]), Switch(contact, UP + DOWN - int(chart.statuses[k][contact])))]
    # What switches there does so while the slider sticks or slides.
    there_too = np.flatnonzero(np.abs(phases - phase) <= AT_ONCE)
    number = int(there_too[0] if there_too.size else np.searchsorted(phases, phase))
    over = chart.together(number).stop if there_too.size else number
    now = int(chart.statuses[number][contact])
    if now != PINNED:
        return [(number, phase, Switch(contact, PINNED)), (over, phase, Switch(contact, now, over > number))]
    problem, time = known.problem, phase / known.problem.loads.omega
    state = known.path.state(number, time - float(known.path.times[number]))
    before, after = (problem.course.reaction(chart.statuses[k], time, state, contact)[0] for k in (number, over))
    # It slides before, and over the other switch, or from that one on.
    at_once = over > number and jumps(problem, chart, number) and abs(after) > abs(before)
    force, begins = (after, over) if at_once else (before, number)
    there = Switch(contact, UP if force > 0.0 else DOWN, at_once)
    return [(begins, phase, there), (over, phase, Switch(contact, now))]


def lasting_of(problem: Any, chart: Signature, first: int, last: int) -> Begun:
    """Return what has begun; a slider may stop in a touch, which lasts before and after its stop."""
    if first == last:
        return Begun(first, last)
    if chart.hit_between(first, last):
        return Begun(first, last, (first + 1, last))
    stop = next((one for one in stops_of(problem, chart) if first < one.first < last), None)
    return Begun(first, last, ((first + last + 1) // 2,) if stop is None else (stop.first, stop.last + 1))


def touch(
    problem: Any, chart: Signature, y: Array, contacts: Sequence[int], phase: float,
    *, lasts: bool = False, hit: bool = False,
) -> list[tuple[int, float, Switch]]:  # fmt: skip
    """Return what `Signature.edited` adds for a touch of length zero by one or more contacts at once.

    Where a slider holds the points that touch, they do so when it stops. `lasts`: as long as it is at rest.
    `hit`: whether it begins before an impact on a rigid stop and ends after it.
    """
    phases = chart.phases(y)
    first = last = hit_near(chart, phases, phase) if hit else int(np.searchsorted(phases, phase))
    begins = ends = float(phases[first]) if hit else phase
    last += hit
    stops = [] if hit else [one for one in stops_of(problem, chart) if set(contacts) <= set(one.held)]
    if stops:
        stop = min(stops, key=lambda one: abs(float(phases[one.first]) - phase))
        first, last = stop.first, stop.last + 1 if lasts else stop.first
        begins, ends = (float(phases[stop.first]), float(phases[stop.last if lasts else stop.first]))
    now = chart.statuses[first]
    there = [(first, begins, Switch(j, OPEN if now[j] == CLOSED else CLOSED)) for j in contacts]
    return there + [(last, ends, Switch(j, int(now[j]))) for j in contacts]


def orbit_beyond(
    family: Family, chart: Signature, y: Array, begun: Sequence[Begun], near: Any, most: float = np.inf
) -> Point | None:
    """Return the orbit just beyond one at which something begins without length or speed, as `_begun` tells.

    None if none beside has all of it.
    `near`: an evaluation near the coordinates, or `States`.
    `most`: for how long in rad a slider sticks or slides at most.
    """
    problem = family.of(y)
    n = problem.size
    laws = {law_of(problem, chart.switches[one.last].contact) for one in begun}
    lasting, hits = [one for one in begun if one.ends], [one.last for one in begun if not one.ends]
    lengths = [n + k for one in lasting for k in one.ends]
    if not laws & {"impact", "jump"}:
        # Where forces are smooth, the parameter changes as squared lengths, or as those of sticks.
        inner: Point | None = None
        several = len(lasting) > 1 or lasting[0].last - lasting[0].first > len(lasting[0].ends)
        slow = any(one.ends[-1] > one.ends[0] + 1 or slips_between(chart, one.first, one.last) for one in lasting)
        tried = sorted({_SEVERAL if several else _BEYOND, *_LONGER})
        if slow:
            known = chart.lengths(y[:-1])
            tried = [min(most, *(stuck_of(chart, known, one.first, one.last) for one in lasting))]
        for length in tried:
            guess = y.copy()
            for first, last, ends in lasting:
                guess[[n + k for k in ends]] = length
                guess[n + first] -= 0.5 * length * len(ends)
                if last + 1 < len(chart.switches):
                    guess[n + last + 1] -= 0.5 * length * len(ends)
            try:
                place = n + lasting[0].ends[-1]
                inner = with_length(family, chart, guess, place, length, near, alone=len(lasting) == 1)
            except ConvergenceError:
                if inner is None:
                    raise
                break
            # Rounding may decide the lengths of several touches too, and how they change.
            grown = (guess - y) / inner.scales
            bends = _BENDS[0] < abs(grown @ inner.tangent) / np.linalg.norm(grown) < _BENDS[1]
            if not bends and inner.y[lengths].min() > 0.0:
                break
        return inner
    # Elsewhere lengths, speeds and the parameter change together, and the branch has a direction.
    towards = np.zeros(y.size)
    towards[lengths or [-1]] = 1.0
    for _ in range(_SETTLED):
        # What is known may be far away, and speeds are roots of what segments miss.
        near = States(y[:-1], chart.evaluate(problem, y[:-1], derivative=False, near=near).reached)
    at = point_at(family, chart, y, towards, near=near)

    def speeds(problem: Any, evaluation: Any, _: Array) -> Array:
        every = chart.approaches(problem, evaluation)
        return np.array([every[k] for k in hits]) / at.evaluation.sizes[1]

    rates = np.append((at.tangent * at.scales)[lengths], slope_along(family, at, speeds) if hits else [])
    if rates.max() < 0.0:
        at, rates = at.turned(), -rates
    if not rates.min() > 0.0:
        return None
    for step in _NEAREST:
        guess = y + step * at.tangent * at.scales
        try:
            found, evaluation = corrected(
                family, chart, guess, at.scales, at.tangent, at.by_value, tolerance=_EXACT, near=at.evaluation
            )
        except ConvergenceError:
            continue
        inner = point_at(family, chart, found, at.tangent, evaluation)
        near = np.linalg.norm((found - guess) / at.scales) <= ASIDE * step
        if near and (inner.evaluation.repeats or newly_touching(at, inner, run_of(inner))):
            return inner
    raise ConvergenceError("no orbit was found beside one that grazes a contact whose force jumps, or a rigid stop")


def not_turned(short: Point, outside: Point) -> Point:
    """Return an orbit with a short touch such that the parameter changes as along the branch without the touch.

    The length of the touch changes like the root of its height, so the rate of the parameter is lost in rounding.
    """
    rate, like = float(short.tangent[-1]), float(outside.tangent[-1])
    if rate * like >= 0.0 or abs(rate) > _ROUNDED or not short.chart.smooth(short.problem):
        return short
    return replace(short, tangent=np.append(short.tangent[:-1], -rate))


def slope_along(family: Family, point: Point, values: Callable[[Any, Any, Array], Any]) -> Array:
    """Return the derivatives of values of problem, evaluation and coordinates along a branch, in scaled coordinates."""
    y = point.y + _DIFFERENCE * point.tangent * point.scales
    problem = family.of(y)
    evaluation = point.chart.evaluate(problem, y[:-1], derivative=False, near=point.evaluation)
    moved = values(problem, evaluation, y[:-1])
    return (np.asarray(moved) - values(point.problem, point.evaluation, point.y[:-1])) / _DIFFERENCE


def away_along(family: Family, point: Point, marks: Sequence[Mark]) -> Array:
    """Return by how much an orbit moves away, along its branch, from those in which something begins at marks.

    These are the rates of the distances from gaps over their sizes, or of the margins of sliders.
    """
    chart = point.chart

    def away(problem: Any, evaluation: Any, y: Array) -> list[float]:
        phases, found = chart.phases(y), []
        places = [phases[hit_near(chart, phases, mark.phase)] if mark.hit else mark.phase for mark in marks]
        z, _ = chart.modes_at(problem, evaluation, np.array(places))
        for k, (mark, phase) in enumerate(zip(marks, places, strict=True)):
            contact, turns = mark.contact, mark.turns
            if turns:
                found.append(evaluation.margins[turn_near(chart, phases, contact, phase)][0])
                continue
            if law_of(problem, contact) == "stick":
                found.append(-nearest_extreme(evaluation, mark).height)
                continue
            above = float(problem.space.contacts[contact] @ z[:, k]) - float(problem.system.contacts.gap[contact])
            closed = chart.statuses[int(np.searchsorted(phases, phase))][contact] == CLOSED
            found.append((above if closed else -above) / float(point.evaluation.gaps.size_of(contact)))
        return found

    return slope_along(family, point, away)


def with_length(
    family: Family, chart: Signature, guess: Array, place: int, length: float, near: Any, *, alone: bool = True
) -> Point:
    """Return the orbit near a guess at which one length has a value; `near` as in `corrected`.

    `alone`: whether no other touches are as short, whose lengths need all digits of all gaps.
    """
    guess = guess.copy()
    guess[place] = length
    problem = family.of(guess)
    evaluation = chart.evaluate(problem, guess[:-1], near=near)
    scales = scales_of(family, chart, problem, evaluation)
    by_value = derivative_by_value(family, chart, guess, evaluation)
    normal = np.zeros(guess.size)
    normal[place] = 1.0
    # The gap of a touch may differ by the rounding of the parameter, and its length may not.
    loose: int | None = None
    if alone:
        begun = chart.partners[place - problem.size]
        loose = place if begun is None else problem.size + begun
    y, evaluation = corrected(family, chart, guess, scales, normal, by_value, 12, _EXACT, known=evaluation, loose=loose)
    y[place] = length
    return point_at(family, chart, y, normal, evaluation)
