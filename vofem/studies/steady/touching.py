"""Changes of an orbit's signature along a branch: touches that begin or end, and switches that change their order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.integrators.event_driven.flow import Flow
from vofem.studies.steady.between import Step, point_between
from vofem.studies.steady.family import Family
from vofem.studies.steady.point import Interval, Point, corrected, derivative_by_value, tangent_at
from vofem.studies.steady.signature import AT_ONCE, CLOSES, ROUNDING, Extreme, Signature
from vofem.system import CLOSED, OPEN, PINNED

#: `Evaluation.error` of a grazing: as small as rounding allows.
_EXACT = 1e-16

#: Length in rad of a touch that has just begun, and of several touches that begin at once, whose equations are singular
#: at length zero.
BEYOND, _SEVERAL = 1e-8, 1e-6

#: Speed of approach of an impact that has just begun, over that of the motion.
_SLOW = 1e-6

#: Steps from a grazing in scaled coordinates where forces jump; the first is taken that leads to an orbit which
#: repeats, because rounding grows the more the shorter a touch. An orbit may lie aside of a step by a share of it.
_JUMPING, _ASIDE = (1e-4, 1e-3, 1e-5, 1e-6, 0.01, 0.03, 0.1), 0.3

#: Length in rad below which a touch may be about to end.
_NEARLY = 5e-3

#: Height over the size of the motion, and difference of phases over the orbit, up to which touches begin together.
_TOGETHER, _ALIKE = 1e-11, 1e-6

#: Rate of the parameter, in scaled coordinates, that may be rounding beside a grazing.
_ROUNDED = 1e-8

#: Shares of a step before its begin and beyond its end up to which a change may lie.
_OUTSIDE = 0.05

#: Changes that are located in one step at most, to find the first of them.
_MOST = 8

#: Distance of an extreme from its gap, over the size of the motion, that is told where a branch is lost, and the number
#: of touches above which a contact may chatter.
_CLOSE, _SEQUENCE = 1e-4, 3

#: How many orbits inside a step are looked at where a change may hide.
_LOOKS = 4

#: Distance of an extreme from its gap over the size of the motion, in terms of the step, up to which it may reach the
#: gap inside the step; and a value inside, as a share of the smaller one at the ends, that leaves no doubt.
_REACH, _CLEAR = 0.1, 0.2

#: Step in scaled coordinates by which the height of an extreme is differentiated.
_DIFFERENCE = 1e-6


@dataclass(frozen=True)
class Passage:
    """A change of the signature."""

    before: Point  #: The last orbit with the old signature.
    at: Point  #: The orbit at the change.
    after: Point | None  #: The first orbit with the new signature; None where several branches may begin.
    grazed: tuple[int, ...]  #: Contacts that are grazed.


@dataclass(frozen=True)
class _Change:
    """A change between two neighbours: its share of the step, and what changes.

    Either an extreme that touches its contact, pairs of switches that vanish, the place of a length that vanishes
    between switches of two contacts, an impact on a rigid stop whose speed vanishes, a slider that turns and begins to
    stick there, or the switches between which one sticks for no time.
    """

    share: float
    extreme: Extreme | None = None
    pairs: tuple[tuple[int, int], ...] = ()
    place: int = -1
    impact: int = -1
    turn: int = -1
    stick: tuple[int, int] = (-1, -1)


def passage(family: Family, interval: Interval, now: Point, after: Point) -> Passage | None:
    """Return the first change of the signature between two neighbours; None if there is none and the orbit repeats.

    Raises `ConvergenceError` if the change cannot be located, or the second orbit does not repeat under an ordinary
    run.
    """
    chart: Signature = now.chart
    lengths = chart.lengths(after.y[:-1])
    if min(lengths[0], lengths[-1]) <= 0.0:
        raise ConvergenceError("a switch passed the phase at which the state is an unknown")
    # Beside a segment of negative length there are extremes that mean nothing.
    changes, found = _vanishing(now, after), None
    if not changes:
        flow = chart.flow(after.problem, after.y[:-1])
        repeats = after.evaluation.repeats(flow)
        changes = [] if repeats else _touching(now, after, flow=flow)
        if not changes and not repeats:
            raise ConvergenceError(
                f"the orbit does not repeat under an ordinary run, by {after.evaluation.closing:.1e} of the motion"
            )
    if changes:
        found = _first(family, interval, now, after, changes)
    hidden = _hidden(family, interval, now, after if found is None else found.before)
    return found if hidden is None else _first(family, interval, now, *hidden)


def _hidden(
    family: Family, interval: Interval, now: Point, after: Point, looks: int = _LOOKS
) -> tuple[Point, list[_Change]] | None:
    """Return an orbit between two neighbours and its changes, which are undone before the second neighbour."""
    share = _lowest(family, now, after) if looks and isinstance(now.chart, Signature) else None
    if share is None:
        return None
    try:
        middle = point_between(family, Step(now, after), interval, share)
        changes = _vanishing(now, middle) or _touching(now, middle)
    except ConvergenceError:
        return None
    if changes:
        return middle, changes
    before = _hidden(family, interval, now, middle, looks - 1)
    return _hidden(family, interval, middle, after, looks - 1) if before is None else before


def _lowest(family: Family, now: Point, after: Point) -> float | None:
    """Return where between two neighbours a length or the distance of an extreme from its gap may become negative.

    Each follows Hermite's cubic through its values and slopes at both. None where all stay away from zero.
    """
    chart: Signature = now.chart
    secant = (after.y - now.y) / now.scales
    step = float(np.linalg.norm(secant))
    if not step > 0.0:
        return None
    # Derivatives along the branch, times this, are those by the share of the step.
    along = [step**2 / max(float(secant @ (p.tangent * p.scales / now.scales)), 0.1 * step) for p in (now, after)]
    ends = np.array([chart.lengths(p.y[:-1]) for p in (now, after)])
    slopes = np.array([a * chart.rates(p.tangent * p.scales) for p, a in zip((now, after), along, strict=True)])
    inside = [slice(p + 1, k + 1) for p, k in chart.touches]
    pairs = range(1, len(chart.switches))
    inside += [slice(k, k + 1) for k in pairs if chart.switches[k].contact != chart.switches[k - 1].contact]
    known = [(*ends[:, one].sum(axis=1), *slopes[:, one].sum(axis=1)) for one in inside]
    earlier = now.evaluation.extremes
    for last in after.evaluation.extremes:
        same = [e for e in earlier if (e.contact, e.segment) == (last.contact, last.segment)]
        first = min(same, key=lambda e: abs(e.phase - last.phase), default=None)
        if first is None or max(first.height, last.height) < -_REACH * step:
            continue
        sign = -1.0 if chart.statuses[last.segment][last.contact] == CLOSED else 1.0
        rises = [
            sign * a * _rise(family, p, e.contact, e.phase) / p.evaluation.size_of(e.contact)
            for p, a, e in zip((now, after), along, (first, last), strict=True)
        ]
        known.append((-first.height, -last.height, -rises[0], -rises[1]))
    if not known:
        return None
    v0, v1, s0, s1 = np.array(known).T
    # Where the derivative ``s0 + 2 b x + a x^2`` of the cubic vanishes.
    a, b = 3.0 * (s0 + s1 - 2.0 * (v1 - v0)), 3.0 * (v1 - v0) - 2.0 * s0 - s1
    with np.errstate(divide="ignore", invalid="ignore"):
        pull = -(b + np.copysign(np.sqrt(b**2 - a * s0), b))
        x = np.array([pull / a, s0 / pull])
    x = np.where((x > 0.0) & (x < 1.0), x, 0.0)
    low = v0 + x * (s0 + x * (b + x * a / 3.0)) - _CLEAR * np.minimum(v0, v1)
    low[(x == 0.0) | (np.minimum(v0, v1) <= AT_ONCE)] = np.inf
    worst = np.unravel_index(low.argmin(), low.shape)
    return float(x[worst]) if low[worst] < 0.0 else None


def _first(family: Family, interval: Interval, now: Point, after: Point, changes: list[_Change]) -> Passage:
    """Return the first of some changes of the signature between two neighbours, and of those that come before it."""
    last = after
    for _ in range(_MOST):
        change = min(changes, key=lambda one: one.share)
        found = _located(family, interval, now, last, change)
        changes = _vanishing(now, found.before, found.grazed) or _touching(now, found.before, _TOGETHER)
        last = found.before
        if not changes and change.pairs and len(found.grazed) > 1:
            # Contacts that are grazed there together may have touched before.
            place = now.problem.size + change.pairs[0][1]
            half = now.y + 0.5 * (found.before.y - now.y)
            last = _along(now, _with_length(family, interval, now.chart, half, place, half[place]))
            changes = _touching(now, last)
        if not changes:
            _checked(found)
            return found
    raise ConvergenceError("too many changes of contact in one step")


def _checked(found: Passage) -> None:
    """Raise where an orbit at a change of the signature does not repeat under an ordinary run."""
    # The orbits before and after a change differ by a touch that is hardly longer than rounding.
    point = found.before if found.after is None else found.after
    if not point.chart.smooth(point.problem):
        # Where a force jumps at a grazing, differences grow without bound.
        return
    away = float(point.evaluation.closing)
    if not away <= CLOSES:
        raise ConvergenceError(
            f"the orbit at a change of contact at {point.value:.12g} does not repeat under an ordinary run, by "
            f"{away:.1e} of the motion"
        )


def ending(family: Family, interval: Interval, now: Point) -> Passage | None:
    """Return the grazing ahead of an orbit with very short touches that become shorter; None if there is none.

    Where several touches end at once the equations become singular, and steps towards this orbit fail.
    """
    chart: Signature = now.chart
    lengths = chart.lengths(now.y[:-1])
    rates = chart.rates(now.tangent * now.scales)
    short = [
        (p, k) for p, k in chart.touches if lengths[p + 1 : k + 1].sum() < _NEARLY and rates[p + 1 : k + 1].sum() < 0.0
    ]
    if not short:
        return None
    p, k = short[0]
    length = float(lengths[p + 1 : k + 1].sum())
    ahead = length / float(-rates[p + 1 : k + 1].sum())
    after = replace(now, y=now.y + 1.1 * ahead * now.tangent * now.scales)
    found = _first(family, interval, now, after, [_Change(1.0 / 1.1, pairs=tuple(short))])
    away = float(np.linalg.norm((found.before.y - now.y) / now.scales))
    if found.after is None or away > 10.0 * _NEARLY or abs(found.at.value - now.value) > _NEARLY * interval.size:
        raise ConvergenceError("a change of contact was found elsewhere")
    return found


def _vanishing(now: Point, after: Point, without: Sequence[int] = ()) -> list[_Change]:
    """Return touches whose length passes zero, and switches of two contacts that change their order."""
    chart: Signature = now.chart
    first, last = chart.lengths(now.y[:-1]), chart.lengths(after.y[:-1])
    n = after.problem.size
    found: list[_Change] = []
    inside: set[int] = set()
    ended = []
    for p, k in chart.touches:
        here, there = float(first[p + 1 : k + 1].sum()), float(last[p + 1 : k + 1].sum())
        if there <= 0.0 and chart.switches[k].contact not in without:
            ended.append((here / (here - there) if here > there else 0.0, p, k))
            inside.update(range(p + 1, k + 1))
    if ended:
        share = min(ended)[0]
        found.append(_Change(share, pairs=tuple((p, k) for s, p, k in ended)))
    for k in range(1, len(chart.switches)):
        if k in inside or last[k] >= -AT_ONCE or chart.switches[k].contact == chart.switches[k - 1].contact:
            continue
        here, there = float(first[k]), float(last[k])
        found.append(_Change(here / (here - there) if here > there else 0.0, place=n + k))
    return [*found, *_slowing(now, after, without), *_sticking(now, after, without)]


def _slowing(now: Point, after: Point, without: Sequence[int]) -> list[_Change]:
    """Return impacts on rigid stops whose speed of approach passes zero."""
    chart: Signature = now.chart
    speeds = chart.approaches(after.problem, after.evaluation)
    if not speeds:
        return []
    first, rounding = chart.approaches(now.problem, now.evaluation), ROUNDING * after.evaluation.sizes[1]
    return [
        _Change(max(first[k], 0.0) / (max(first[k], 0.0) - speed), impact=k)
        for k, speed in speeds.items()
        if speed < -rounding and chart.switches[k].contact not in without
    ]


def _sticking(now: Point, after: Point, without: Sequence[int]) -> list[_Change]:
    """Return where sliders that turn begin to stick, and where they cease to."""
    chart: Signature = now.chart
    first, last = (chart.margins(p.problem, p.evaluation) for p in (now, after))
    found = [
        _Change(max(first[k], 0.0) / (max(first[k], 0.0) - margin), turn=k)
        for k, margin in last.items()
        if margin < -ROUNDING and chart.switches[k].contact not in without
    ]
    lengths = chart.lengths(now.y[:-1]), chart.lengths(after.y[:-1])
    for p, k in chart.sticks:
        here, there = (float(one[p + 1 : k + 1].sum()) for one in lengths)
        if there <= 0.0 and chart.switches[k].contact not in without:
            found.append(_Change(here / (here - there) if here > there else 0.0, stick=(p, k)))
    return found


def _touching(now: Point, after: Point, rounding: float = ROUNDING, flow: Flow | None = None) -> list[_Change]:
    """Return extremes of gap functions that have come to the wrong side."""
    chart: Signature = now.chart
    wrong = [e for e in after.evaluation.extremes if e.height > rounding]
    flow = chart.flow(after.problem, after.y[:-1]) if flow is None else flow
    first = chart.first_touch(after.evaluation, flow)
    if first is not None and first.height > rounding and not any(_alike(chart, e.phase, first.phase) for e in wrong):
        wrong.append(first)
    if not wrong:
        return []
    earlier = now.evaluation.extremes
    found = []
    for extreme in wrong:
        same = [e for e in earlier if (e.contact, e.segment) == (extreme.contact, extreme.segment)]
        share = 0.5
        if same:
            near = min(same, key=lambda e: abs(e.phase - extreme.phase))
            share = min(max(-near.height, 0.0) / (extreme.height + max(-near.height, 0.0)), 1.0)
            extreme = extreme._replace(phase=near.phase + share * (extreme.phase - near.phase))
        found.append(_Change(share, extreme=extreme))
    return found


def _located(family: Family, interval: Interval, now: Point, after: Point, change: _Change) -> Passage:
    """Return a change of the signature."""
    guess = now.y + change.share * (after.y - now.y)
    if change.extreme is not None:
        return _begins(family, interval, now, after, guess, change.extreme)
    if change.pairs:
        return _ends(family, interval, now, after, guess, change.pairs)
    if change.turn >= 0:
        return _stick_begins(family, interval, now, after, guess, change.turn)
    if change.stick[0] >= 0:
        return _stick_ends(family, interval, now, after, guess, change.stick)
    if change.impact >= 0:
        return _impact_ends(family, interval, now, after, guess, change.impact)
    chart: Signature = now.chart
    at = _with_length(family, interval, chart, guess, change.place, 0.0)
    _between(now, after, at.y)
    other, y = chart.swapped(at.y[:-1], change.place)
    towards = np.zeros(at.y.size)
    towards[change.place] = 1.0
    k = change.place - at.problem.size
    if max(chart.struck[k - 1 : k + 1]) >= 0 and _coupled(at.problem, chart, k):
        raise ConvergenceError(
            "two impacts happen at the same time, of bodies that move each other; beyond, their order is another one, "
            "and so is the motion"
        )
    beyond = _point(family, interval, other, np.append(y, at.value), towards)
    return Passage(_along(now, at), at, beyond, ())


def _begins(family: Family, interval: Interval, now: Point, after: Point, guess: Array, extreme: Extreme) -> Passage:
    """Return the orbit that grazes a contact, and the first one that touches it."""
    old: Signature = now.chart
    chart, y, place = old.with_touch(guess[:-1], (extreme.contact,), extreme.phase)
    at = _with_length(family, interval, chart, np.append(y, guess[-1]), place, 0.0)
    phase = float(chart.phases(at.y[:-1])[place - at.problem.size])
    state = _point(family, interval, old, _without_length(at, place), now.tangent)
    _between(now, after, state.y)
    state = _along(now, state)
    known = [(extreme.contact, phase), *zip((s.contact for s in old.switches), old.phases(state.y[:-1]), strict=True)]
    others = _grazing(state, known)
    grazed = tuple(sorted((extreme.contact, *(e.contact for e in others))))
    if not others and not _rigid(at.problem, grazed):
        beyond = _beyond(family, interval, at, [(place, 1)])
        return Passage(state, state, _not_turned(beyond, state), grazed)
    every = [extreme._replace(phase=phase), *others]
    if _rigid(at.problem, grazed):
        return Passage(state, state, _hitting(family, interval, state, every), grazed)
    return Passage(state, state, _touched(family, interval, state, every), grazed)


def _hitting(family: Family, interval: Interval, at: Point, extremes: Sequence[Extreme]) -> Point | None:
    """Return the orbit with impacts of no speed at extremes that graze rigid stops; None where branches may fork.

    The impacts become faster along the direction of the branch.
    """
    if not all(_rigid(at.problem, [e.contact]) for e in extremes):
        return None
    chart, y = at.chart, at.y[:-1]
    for e in extremes:
        chart, y, place = chart.with_touch(y, (e.contact,), e.phase)
        chart, y = chart.merged(y, place - at.problem.size - 1)
    phases = chart.phases(y)
    new = [
        k
        for k, j in enumerate(chart.struck)
        if any(j == e.contact and _alike(chart, float(phases[k]), e.phase) for e in extremes)
    ]
    return _faster(family, interval, chart, np.append(y, at.value), new)


def _impact_ends(family: Family, interval: Interval, now: Point, after: Point, guess: Array, number: int) -> Passage:
    """Return the orbit that grazes a rigid stop, where the speed of an impact vanishes, and the same without it."""
    old: Signature = now.chart
    chart, y, place = old.split(guess[:-1], number, CLOSED)
    at = _with_length(family, interval, chart, np.append(y, guess[-1]), place, 0.0)
    old, y = chart.merged(at.y[:-1], number)
    y = np.append(y, at.value)
    _between(now, after, y)
    here = old.evaluate(at.problem, y[:-1], derivative=False)
    speeds, rounding = old.approaches(at.problem, here), _TOGETHER * here.sizes[1]
    ended = [number, *(k for k, speed in speeds.items() if k != number and abs(speed) <= rounding)]
    before = _faster(family, interval, old, y, ended)
    if before is None:
        raise ConvergenceError("an impact becomes slower as another one becomes faster")
    before, y = replace(before, tangent=-before.tangent), y[:-1]
    known = [(old.switches[k].contact, float(old.phases(y)[k])) for k in ended]
    out, y = old.without(y, ended)
    y = np.append(y, at.value)
    outside = _point(family, interval, out, y, np.append(np.zeros(y.size - 1), 1.0))
    if _rise(family, outside, *known[0]) > 0.0:
        outside = replace(outside, tangent=-outside.tangent)
    others = _grazing(outside, known)
    grazed = tuple(sorted([*(contact for contact, _ in known), *(e.contact for e in others)]))
    return Passage(before, outside, None if others else outside, grazed)


def _stick_begins(family: Family, interval: Interval, now: Point, after: Point, guess: Array, number: int) -> Passage:
    """Return the orbit in which a slider that turns is at the limit of sticking, and the first one that sticks."""
    old: Signature = now.chart
    chart, y, place = old.split(guess[:-1], number, PINNED)
    at = _with_length(family, interval, chart, np.append(y, guess[-1]), place, 0.0)
    old, y = chart.merged(at.y[:-1], number)
    before = _along(now, _point(family, interval, old, np.append(y, at.value), now.tangent))
    _between(now, after, before.y)
    margins = old.margins(before.problem, before.evaluation)
    others = [k for k, margin in margins.items() if k != number and abs(margin) <= _TOGETHER]
    chart, y = old, before.y[:-1]
    for k in sorted([number, *others], reverse=True):
        chart, y, place = chart.split(y, k, PINNED)
    at = replace(at, chart=chart, y=np.append(y, at.value))
    # Each stick before the first one adds a switch, and splitting them in descending order leaves `place` at the first.
    beyond = _beyond(family, interval, at, [(place, 1)])
    return Passage(before, before, beyond, tuple(sorted(old.switches[k].contact for k in (number, *others))))


def _stick_ends(
    family: Family, interval: Interval, now: Point, after: Point, guess: Array, stick: tuple[int, int]
) -> Passage:
    """Return the orbit in which a slider sticks for no time, and the same one in which it turns at once."""
    old: Signature = now.chart
    p, k = stick
    if k != p + 1:
        raise ConvergenceError("a slider ceases to stick while contacts switch")
    n = now.problem.size
    at = _with_length(family, interval, old, guess, n + k, 0.0)
    before = _along(now, _with_length(family, interval, old, at.y, n + k, BEYOND))
    _between(now, after, before.y)
    lengths = old.lengths(at.y[:-1])
    ended = [(i, j) for i, j in old.sticks if j == i + 1 and lengths[j] <= _TOGETHER * old.turn]
    chart, y = old, at.y[:-1]
    for i, j in sorted(ended, reverse=True):
        if old.statuses[i][old.switches[i].contact] == old.switches[j].status:
            chart, y = chart.without(y, [i, j])
        else:
            chart, y = chart.merged(y, i)
    y = np.append(y, at.value)
    outside = _point(family, interval, chart, y, np.append(np.zeros(y.size - 1), 1.0))
    turning = [k for k, margin in chart.margins(outside.problem, outside.evaluation).items() if abs(margin) <= _NEARLY]
    if len(turning) < len(ended):
        raise ConvergenceError("a slider ceases to stick where it goes on in the same direction")
    if _speeding(family, outside, turning, "margins").min() < 0.0:
        outside = replace(outside, tangent=-outside.tangent)
    return Passage(before, outside, outside, tuple(sorted(old.switches[i].contact for i, _ in ended)))


def _faster(family: Family, interval: Interval, chart: Signature, y: Array, numbers: Sequence[int]) -> Point | None:
    """Return the next orbit on the side on which some impacts of no speed become faster; None if not all of them do."""
    point = _point(family, interval, chart, y, np.append(np.zeros(y.size - 1), 1.0))
    rises = _speeding(family, point, numbers, "approaches")
    if rises.max() < 0.0:
        point, rises = replace(point, tangent=-point.tangent), -rises
    if not rises.min() > 0.0:
        return None
    guess = y + _SLOW * point.evaluation.sizes[1] / float(rises.min()) * point.tangent * point.scales
    y, _, _ = corrected(family, chart, guess, point.scales, point.tangent, point.by_value)
    return _point(family, interval, chart, y, point.tangent)


def _speeding(family: Family, point: Point, numbers: Sequence[int], what: str) -> Array:
    """Return the derivatives of `approaches` or `margins` of some switches along a branch, in scaled coordinates."""
    values = []
    for sign in (1.0, -1.0):
        y = point.y + sign * _DIFFERENCE * point.tangent * point.scales
        problem = family.of(y)
        speeds = getattr(point.chart, what)(problem, point.chart.evaluate(problem, y[:-1], derivative=False))
        values.append([speeds[k] for k in numbers])
    return (np.array(values[0]) - np.array(values[1])) / (2.0 * _DIFFERENCE)


def _touched(family: Family, interval: Interval, at: Point, extremes: Sequence[Extreme]) -> Point:
    """Return the orbit that touches contacts at extremes of an orbit which just grazes them."""
    groups: list[tuple[float, list[int]]] = []
    for e in extremes:
        mine = [group for group in groups if _alike(at.chart, group[0], e.phase)]
        if mine:
            mine[0][1].append(e.contact)
        else:
            groups.append((e.phase, [e.contact]))
    places: list[tuple[int, int]] = []
    chart, y = at.chart, at.y[:-1]
    for when, contacts in sorted(groups, reverse=True):
        chart, y, place = chart.with_touch(y, tuple(contacts), when)
        places = [(place, len(contacts)), *((other + 2 * len(contacts), size) for other, size in places)]
    return _beyond(family, interval, replace(at, chart=chart, y=np.append(y, at.value)), places)


def _ends(
    family: Family, interval: Interval, now: Point, after: Point, guess: Array, pairs: tuple[tuple[int, int], ...]
) -> Passage:
    """Return the orbit that grazes a contact, and the same one without its touch."""
    old: Signature = now.chart
    n = now.problem.size
    single = len(pairs) == 1 and pairs[0][1] == pairs[0][0] + 1
    if single:
        at = _with_length(family, interval, old, guess, n + pairs[0][1], 0.0)
        lengths = old.lengths(at.y[:-1])
        short = [(p, k) for p, k in old.touches if lengths[p + 1 : k + 1].sum() < 0.5 * _SEVERAL]
        pairs = (*pairs, *(pair for pair in short if pair != pairs[0]))
        single = len(pairs) == 1
    chart, place = old, n + pairs[0][1]
    if not single:
        # Where all lengths are zero the equations are singular; those of one touch are not.
        p, k = pairs[0]
        phases = old.phases(guess[:-1])
        out, y = old.without(guess[:-1], [index for pair in pairs for index in pair])
        chart, y, place = out.with_touch(y, (old.switches[p].contact,), float(0.5 * (phases[p] + phases[k])))
        at = _with_length(family, interval, chart, np.append(y, guess[-1]), place, 0.0)
    grazed = tuple(old.switches[p].contact for p, _ in pairs)
    zero, places = (at, [(place, 1)]) if single else _shrunk(now, guess, at, place, pairs)
    _between(now, after, zero.y)
    # At length zero the branch seems to turn.
    before = _along(now, _beyond(family, interval, zero, places))
    if any(not 0.0 < before.y[here] < now.y[here] for here, _ in places):
        before = now
    contact = grazed[0]
    phase = float(chart.phases(at.y[:-1])[place - n])
    status = int(chart.statuses[place - n - 1][contact])
    out, y = chart.without(at.y[:-1], [place - n - 1, place - n])
    y = np.append(y, at.value)
    outside = _point(family, interval, out, y, np.append(np.zeros(y.size - 1), 1.0))
    if _rise(family, outside, contact, phase) * (-1.0 if status == 1 else 1.0) > 0.0:
        outside = replace(outside, tangent=-outside.tangent)
    if single:
        before = _not_turned(before, outside)
    other = _grazing(outside, [(contact, phase)]) if single else []
    if not other or _jump(now.problem, [e.contact for e in other]):
        return Passage(before, outside, outside, grazed)
    # Those that touched no longer do, and those that did not begin to: so this branch crosses that without touches.
    return Passage(before, outside, _touched(family, interval, outside, other), (*grazed, *(e.contact for e in other)))


def _shrunk(
    now: Point, guess: Array, at: Point, place: int, pairs: tuple[tuple[int, int], ...]
) -> tuple[Point, list[tuple[int, int]]]:
    """Return an orbit with a touch of length zero in the chart with several of them, and places of their lengths.

    As in `_beyond` each place comes with the number of contacts that touch there at the same time.
    """
    chart: Signature = now.chart
    n, left = at.problem.size, {index for pair in pairs for index in pair}
    phases = chart.phases(guess[:-1])
    mine = at.chart.phases(at.y[:-1])
    first = place - n - 1
    phases[[k for k in range(phases.size) if k not in left]] = np.delete(mine, [first, first + 1])
    groups: list[list[int]] = []
    for p, k in sorted(pairs):
        if groups and p < groups[-1][1]:
            groups[-1][1] = max(groups[-1][1], k)
        else:
            groups.append([p, k])
    known = [(at.chart.switches[first].contact, float(mine[first]))]
    known += [(e.contact, e.phase) for e in at.evaluation.extremes]
    for p, k in groups:
        middle = 0.5 * (phases[p] + phases[k])
        same = [phase for contact, phase in known if contact == chart.switches[p].contact]
        phases[p : k + 1] = min(same, key=lambda phase: abs(phase - middle), default=middle)
    lengths = np.diff(np.append(chart.anchor, phases))
    y = np.concatenate([at.y[:n], lengths, at.y[n + mine.size :]])
    return replace(at, chart=chart, y=y), [(n + (p + k + 1) // 2, (k - p + 1) // 2) for p, k in groups]


def what_contacts_do(point: Point) -> list[str]:
    """Return what the contacts of an orbit do that may end a branch there: rests, impacts without end, grazings."""
    chart, laws = point.chart, point.problem.system.contacts
    if not isinstance(chart, Signature) or laws is None:
        return []
    lengths = chart.lengths(point.y[:-1])
    found = []
    for contact, name in enumerate(laws.names):
        if contact >= len(laws) - len(point.problem.given.sliders or ()):
            if all(status[contact] == PINNED for status in chart.statuses):
                found.append(f"friction {name!r} sticks all along, so that its body may rest in many places")
            continue
        if any(status[contact] == PINNED for status in chart.statuses):
            found.append(f"contact {name!r} rests at its gap for a part of the orbit")
        mine = [(p, k) for p, k in chart.touches if chart.switches[p].contact == contact]
        for status, what in ((CLOSED, "touches"), (OPEN, "opens")):
            times = [lengths[p + 1 : k + 1].sum() for p, k in mine if chart.switches[p].status == status]
            if min(times, default=np.inf) < _NEARLY:
                found.append(
                    f"contact {name!r} {what} {len(times)} times an orbit, once for {min(times):.2g} rad of the load"
                )
        if _jump(point.problem, [contact]) and len(mine) > _SEQUENCE:
            found.append(f"its force jumps, so that it may chatter: touches of {name!r} may become infinitely many")
        hits = chart.struck.count(contact)
        if hits > _SEQUENCE:
            found.append(f"{name!r} is hit {hits} times an orbit: impacts may become infinitely many")
        near = [-e.height for e in point.evaluation.extremes if e.contact == contact and e.height > -_CLOSE]
        if near:
            found.append(f"contact {name!r} comes within {max(min(near), 0.0):.2g} of the motion to its gap")
    return found


def _not_turned(short: Point, outside: Point) -> Point:
    """Return an orbit with a short touch such that the parameter changes as along the branch without the touch.

    The length of the touch changes like the root of its height, so the rate of the parameter is lost in rounding.
    """
    rate, like = float(short.tangent[-1]), float(outside.tangent[-1])
    if rate * like >= 0.0 or abs(rate) > _ROUNDED or not short.chart.smooth(short.problem):
        return short
    return replace(short, tangent=np.append(short.tangent[:-1], -rate))


def _grazing(point: Point, known: Sequence[tuple[int, float]]) -> list[Extreme]:
    """Return the extremes of gap functions of an orbit that graze their contacts, without some contacts and phases."""
    chart: Signature = point.chart
    return [
        e
        for e in point.evaluation.extremes
        if abs(e.height) <= _TOGETHER and not any(e.contact == c and _alike(chart, e.phase, p) for c, p in known)
    ]


def _rise(family: Family, point: Point, contact: int, phase: float) -> float:
    """Return the derivative of a contact's coordinate at a phase along a branch, in scaled coordinates."""
    values = []
    for sign in (1.0, -1.0):
        y = point.y + sign * _DIFFERENCE * point.tangent * point.scales
        problem = family.of(y)
        evaluation = point.chart.evaluate(problem, y[:-1], derivative=False)
        z, _ = problem.to_modes(point.chart.at_phase(problem, evaluation, phase))
        values.append(float(problem.space.contacts[contact] @ z) - float(problem.system.contacts.gap[contact]))
    return (values[0] - values[1]) / (2.0 * _DIFFERENCE)


def _alike(chart: Signature, one: float, other: float) -> bool:
    return abs((one - other + 0.5 * chart.turn) % chart.turn - 0.5 * chart.turn) <= _ALIKE * chart.turn


def _jump(problem: Any, contacts: Sequence[int]) -> bool:
    """Return whether the force of one of some contacts jumps."""
    laws = problem.system.contacts
    return bool(np.any(laws.jump[list(contacts)] & (laws.gap[list(contacts)] > 0.0)))


def _rigid(problem: Any, contacts: Sequence[int]) -> bool:
    """Return whether one of some contacts is a rigid stop."""
    return bool(np.any(problem.system.contacts.rigid[list(contacts)]))


def _coupled(problem: Any, chart: Signature, k: int) -> bool:
    """Return whether what happens at switch k and at the one before acts on the coordinate of the other."""
    one, other = (problem.space.contacts[chart.switches[j].contact] for j in (k - 1, k))
    return abs(one @ other) > ROUNDING * float(np.linalg.norm(one) * np.linalg.norm(other))


def _between(now: Point, after: Point, y: Array) -> None:
    """Raise where coordinates do not lie between two neighbours."""
    secant, away = (after.y - now.y) / now.scales, (y - now.y) / now.scales
    length = float(np.linalg.norm(secant))
    share = float(away @ secant) / length**2 if length > 0.0 else 0.0
    aside = float(np.linalg.norm(away - share * secant))
    if not -_OUTSIDE <= share <= 1.0 + _OUTSIDE or aside > _ASIDE * length + 1e-9:
        raise ConvergenceError("a change of contact was found elsewhere")


def _along(now: Point, point: Point) -> Point:
    """Return a point with its tangent in the direction of a step."""
    return point if point.tangent @ now.tangent >= 0.0 else replace(point, tangent=-point.tangent)


def _without_length(at: Point, place: int) -> Array:
    n = at.problem.size
    return np.append(at.chart.without(at.y[:-1], [place - n - 1, place - n])[1], at.y[-1])


def _point(family: Family, interval: Interval, chart: Signature, y: Array, towards: Array) -> Point:
    """Return a point of a branch, its tangent on the side of a direction in scaled coordinates."""
    problem = family.of(y)
    evaluation = chart.evaluate(problem, y[:-1])
    scales = np.append(chart.scales(problem, evaluation), interval.size)
    by_value = derivative_by_value(family, interval, chart, y, evaluation)
    tangent = tangent_at(evaluation, by_value, scales, towards)
    return Point(chart, y, problem, evaluation, scales, by_value, tangent)


def _with_length(
    family: Family, interval: Interval, chart: Signature, guess: Array, place: int, length: float
) -> Point:
    """Return the orbit near a guess at which one length has a value."""
    guess = guess.copy()
    guess[place] = length
    problem = family.of(guess)
    evaluation = chart.evaluate(problem, guess[:-1])
    scales = np.append(chart.scales(problem, evaluation), interval.size)
    by_value = derivative_by_value(family, interval, chart, guess, evaluation)
    normal = np.zeros(guess.size)
    normal[place] = 1.0
    y, evaluation, by_value = corrected(family, chart, guess, scales, normal, by_value, 12, _EXACT)
    y[place] = length
    by_value = derivative_by_value(family, interval, chart, y, evaluation)
    tangent = tangent_at(evaluation, by_value, scales, normal)
    return Point(chart, y, family.of(y), evaluation, scales, by_value, tangent)


def _beyond(family: Family, interval: Interval, at: Point, places: list[tuple[int, int]]) -> Point:
    """Return the orbit just beyond a grazing, whose touches at places have so many contacts and the length zero."""
    if not _jump(at.problem, [at.chart.switches[place - at.problem.size].contact for place, _ in places]):
        guess, length = at.y.copy(), _SEVERAL if sum(size for _, size in places) > 1 else BEYOND
        for place, contacts in places:
            guess[place] = length
            guess[place - contacts] -= 0.5 * length
            if place + contacts < at.problem.size + len(at.chart.switches):
                guess[place + contacts] -= 0.5 * length
        return _with_length(family, interval, at.chart, guess, places[0][0], length)
    # Where forces jump, lengths and parameter change together, and the branch has a direction at length zero.
    lengths = [place for place, _ in places]
    towards = np.zeros(at.y.size)
    towards[lengths] = 1.0
    at = _point(family, interval, at.chart, at.y, towards)
    along = at.tangent * at.scales
    if not np.all(along[lengths] > 0.0):
        raise ConvergenceError("one orbit grazes several contacts, and no orbit beside it touches all of them")
    for step in _JUMPING:
        try:
            found = _with_length(family, interval, at.chart, at.y + step * along, lengths[0], step * along[lengths[0]])
        except ConvergenceError:
            continue
        aside = float(np.linalg.norm((found.y - at.y) / at.scales - step * at.tangent))
        repeats = found.evaluation.repeats(found.chart.flow(found.problem, found.y[:-1]))
        if repeats and aside <= _ASIDE * step:
            return found
    raise ConvergenceError("no orbit was found beside one that grazes a contact whose force jumps")
