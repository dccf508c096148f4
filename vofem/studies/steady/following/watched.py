"""What is watched along a branch to see that an orbit's signature changes.

Numbers that are positive while a signature holds are watched: lengths between switches, speeds of impacts, reactions of
sliders that turn, and distances of extremes of gap functions from their gaps.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import zip_longest
from typing import Any, NamedTuple

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.integrators.event_driven.flow import Flow
from vofem.studies.steady.following.point import Point
from vofem.studies.steady.segments.extremes import Extreme
from vofem.studies.steady.segments.gaps import ROUNDING, stops_of
from vofem.studies.steady.segments.signature import Signature
from vofem.studies.steady.segments.switches import AT_ONCE
from vofem.system import PINNED

#: Largest length in rad for which a slider sticks that has just begun to: it lasts before as the square root of the
#: height, after as the cube root. It is shorter if the segments before and behind are, and then a share of them.
STUCK, _ROOM = 1e-3, 0.3

#: A slider that stops and slides on, or slides while it sticks, does so for this share of it at least, since equations
#: are singular where that vanishes.
_NEARLY_STUCK = 0.999

#: Shares of a step by which ends of touches may differ that are searched as one.
SAME = 0.02

#: Height over the size of the motion up to which touches begin together.
TOGETHER = 1e-13

#: Length in rad below which a touch may be about to end.
NEARLY = 5e-3

#: Two switches of a signature, or one twice, by their numbers.
Pair = tuple[int, int]


class Begun(NamedTuple):
    """What has begun in a signature: its first and last switch, and those that end its lengths; an impact has none."""

    first: int
    last: int
    ends: tuple[int, ...] = ()


class Mark(NamedTuple):
    """Where in an orbit a contact may begin to touch, or a slider to stick or to slide: phase in rad.

    `turns`: whether it is a slider that turns there.
    `hit`: whether an impact on a rigid stop turns the contact's motion there.
    """

    contact: int
    phase: float
    turns: bool = False
    hit: bool = False


def mark_at(extreme: Extreme) -> Mark:
    """Return the mark of an extreme."""
    return Mark(extreme.contact, extreme.phase, hit=extreme.hit)


class Change(NamedTuple):
    """A change between two neighbours: its share of the step, and the switches of what ends, or what begins."""

    share: float
    pairs: tuple[Pair, ...] = ()
    begins: Mark | None = None


def mark_of(chart: Signature, y: Array, k: int) -> Mark:
    """Return the contact that switches at a switch, and where in the orbit."""
    contact, status, _ = chart.switches[k]
    return Mark(contact, float(chart.phases(y[:-1])[k]), min(status, int(chart.statuses[k][contact])) > PINNED)


def is_end(chart: Signature, pair: Pair) -> bool:
    """Return whether something ends where what is watched at two switches vanishes."""
    p, k = pair
    return chart.struck[k] >= 0 if p == k else chart.switches[p].contact == chart.switches[k].contact


def turn_near(chart: Signature, phases: Array, contact: int, phase: float) -> int:
    """Return the switch at which a slider turns, the nearest to a phase."""
    mine = [k for k, s in enumerate(chart.switches) if s.contact == contact and s.status > PINNED]
    mine = [k for k in mine if chart.statuses[k][contact] > PINNED]
    return min(mine, key=lambda k: abs(float(phases[k]) - phase))


def hit_near(chart: Signature, phases: Array, phase: float) -> int:
    """Return the impact on a rigid stop that is the nearest to a phase."""
    hits = [k for k, stop in enumerate(chart.struck) if stop >= 0]
    if not hits:
        raise ConvergenceError("an impact at which another contact begins to touch is no longer there")
    return min(hits, key=lambda k: abs(float(phases[k]) - phase))


def turns_between(chart: Signature, p: int, k: int) -> bool:
    """Return whether a slider turns where what it does between two switches ends: only one of both is left."""
    contact, status, _ = chart.switches[k]
    before = int(chart.statuses[p][contact])
    return before > PINNED and before != status


def slips_between(chart: Signature, p: int, k: int) -> bool:
    """Return whether a slider stops between two switches and slides on, or slides until it stops."""
    contact, status, _ = chart.switches[k]
    if chart.switches[p].contact != contact or max(status, int(chart.statuses[k][contact])) <= PINNED:
        return False
    return status == PINNED or not turns_between(chart, p, k)


def is_over(chart: Signature, p: int, k: int) -> bool:
    """Return whether a slider sticks or slides between two switches, and one other switch happens meanwhile."""
    return p + 1 < k <= chart.together(p + 1).stop and not chart.switches[p + 1].at_once


def stuck_of(chart: Signature, lengths: Array, first: int, last: int) -> float:
    """Return the length in rad, between two switches, of a stick or slide that has just begun."""
    beside = chart.causes[first], chart.together(chart.causes[last]).stop
    return min(STUCK, _ROOM * float(lengths[[*beside]].min()))


def is_among(chart: Signature, marks: Sequence[Mark], contact: int, phase: float) -> bool:
    """Return whether a contact has a mark at a phase in rad."""
    return any(mark.contact == contact and chart.alike(mark.phase, phase) for mark in marks)


def nearest_extreme(evaluation: Any, mark: Mark) -> Extreme:
    """Return the extreme of a slider that is nearest to a mark."""
    mine = [e for e in evaluation.extremes if e.contact == mark.contact]
    if not mine:
        raise ConvergenceError("a slider no longer comes near to where it begins to stick or to slide")
    turn = evaluation.chart.turn
    return min(mine, key=lambda e: abs((e.phase - mark.phase + 0.5 * turn) % turn - 0.5 * turn))


def run_of(point: Point) -> Flow:
    """Return an ordinary run over an orbit from the phase of its coordinates."""
    flow: Flow = point.chart.flow(point.problem, point.y[:-1])
    return flow


def spans_of(problem: Any, chart: Signature) -> dict[Pair, int]:
    """Return pairs of switches that stay in their order, of touches and sticks, and neighbours of two contacts.

    Each comes with the switch up to which its time counts. A touch during which a slider holds the point that touches
    ends with its begin: the time up to the stop of the slider vanishes. Both cannot switch in another order.
    """
    s, stops = chart.switches, stops_of(problem, chart)
    lasts = [pair for pair in chart.spells if not (is_over(chart, *pair) and turns_between(chart, *pair))]
    found = {pair: pair[1] for pair in (*chart.touches, *lasts)}
    for p, k in chart.touches:
        found[p, k] = next((stop.first for stop in stops if p < stop.first < k and s[p].contact in stop.held), k)
    held = {(at, j) for stop in stops for at in (stop.first, stop.last) for j in stop.held}
    for k in range(1, len(s)):
        if (
            not s[k].at_once
            and s[k].contact != s[k - 1].contact
            and not {(k, s[k - 1].contact), (k - 1, s[k].contact)} & held
        ):
            found[k - 1, k] = k
    return found


def lasting_at(point: Point) -> dict[Pair, float]:
    """Return for how long in rad pairs of switches last; see `spans_of`."""
    lengths = point.chart.lengths(point.y[:-1])
    return {
        (p, k): float(lengths[p + 1 : last + 1].sum()) for (p, k), last in spans_of(point.problem, point.chart).items()
    }


def watched_at(point: Point) -> dict[Pair, tuple[float, float]]:
    """Return numbers that are positive while a signature holds, and what of each is rounding, by their switches."""
    chart: Signature = point.chart
    lengths, s = chart.lengths(point.y[:-1]), chart.switches
    found = {
        (p, k): (
            lasts - (_NEARLY_STUCK * stuck_of(chart, lengths, p, k) if slips_between(chart, p, k) else 0.0),
            AT_ONCE if s[p].contact != s[k].contact else 0.0,
        )
        for (p, k), lasts in lasting_at(point).items()
    }
    rounding = ROUNDING * point.evaluation.sizes[1]
    found |= {(k, k): (x, rounding) for k, x in chart.approaches(point.problem, point.evaluation).items()}
    found |= {(k, k): margin for k, margin in point.evaluation.margins.items()}
    return found | point.evaluation.caused


def vanished(now: Point, after: Point, without: Collection[Pair] = ()) -> list[Change]:
    """Return what has vanished of the numbers that are watched; what ends at about one place is one change."""
    chart: Signature = now.chart
    first, found = watched_at(now), list[tuple[float, Pair]]()
    for pair, (there, rounding) in watched_at(after).items():
        here = max(first[pair][0], 0.0)
        if there < -rounding or there == rounding == 0.0:
            found.append((here / (here - there) if here > there else 0.0, pair))
    found = [(share, pair) for share, pair in found if pair not in without]
    ends = [(share, pair) for share, pair in found if is_end(chart, pair)]
    changes, orders = [], list[tuple[float, Pair]]()
    for share, (p, k) in found:
        if is_end(chart, (p, k)):
            continue
        if chart.switches[k].at_once:
            if not any(k in pair for _, pair in ends):
                orders.append((share, (p, k)))
        elif p == k:
            # It may turn for the stop that vanishes.
            if not any(one == p for _, (one, _) in ends):
                changes.append(Change(share, begins=mark_of(chart, now.y, k)))
        elif not any(one <= p and k <= other for _, (one, other) in ends):
            orders.append((share, (p, k)))
    for several in (orders, ends):
        if several:
            share = min(several)[0]
            changes.append(Change(share, tuple(pair for one, pair in sorted(several) if one <= share + SAME)))
    return changes


def newly_touching(now: Point, after: Point, flow: Flow | None = None) -> list[Change]:
    """Return extremes of gap functions that have come to the wrong side, the first touch of a run among them."""
    chart: Signature = now.chart
    there, found = after.evaluation.extremes, []
    first = None if flow is None else chart.first_touch(after.evaluation, flow)
    if first is not None and not any(e.height > ROUNDING and chart.alike(e.phase, first.phase) for e in there):
        there = sorted([*there, first])
    for near, e in paired(now.evaluation.extremes, there):
        if e is None or e.height <= ROUNDING:
            continue
        share, phase = 0.5, e.phase
        if near is not None:
            share = min(max(-near.height, 0.0) / (e.height + max(-near.height, 0.0)), 1.0)
            phase = near.phase + share * (e.phase - near.phase)
        found.append(Change(share, begins=mark_at(e)._replace(phase=phase)))
    return found


def paired(earlier: Sequence[Extreme], later: Sequence[Extreme]) -> list[tuple[Extreme | None, Extreme | None]]:
    """Return extremes at two neighbours that follow from each other; those of a contact in a segment keep their order.

    Where there are more at one neighbour, one is alone that is the first or the last of its segment.
    """
    groups: dict[tuple[int, int], tuple[list[Extreme], list[Extreme]]] = {}
    for k, every in enumerate((earlier, later)):
        for e in every:
            groups.setdefault((e.contact, e.segment), ([], []))[k].append(e)
    pairs = list[tuple[Extreme | None, Extreme | None]]()
    for a, b in groups.values():
        first, last = (
            sum(abs(x.height - y.height) for x, y in zip(one, other, strict=False))
            for one, other in ((a, b), (a[::-1], b[::-1]))
        )
        step = 1 if first <= last else -1
        pairs += zip_longest(a[::step], b[::step])
    return pairs
