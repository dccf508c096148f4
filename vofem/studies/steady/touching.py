"""Changes of an orbit's signature along a branch: what begins or ends, and switches that change their order.

Numbers that are positive while a signature holds are watched: lengths between switches, speeds of impacts, reactions of
sliders that turn, and distances of extremes of gap functions from their gaps. Where one of them vanishes lies an orbit
that belongs to two signatures. In one of them, outside, nothing has begun; in the other something has no length or no
speed. Whichever way a branch comes, this orbit is solved outside with one touch or stick of length zero, which is
regular, and all that begins there at once is read from it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.integrators.event_driven.flow import Flow
from vofem.integrators.event_driven.pinned import PIN_FRACTION
from vofem.laws.friction import DOWN, UP
from vofem.studies.steady.between import Step, point_between
from vofem.studies.steady.extremes import Extreme
from vofem.studies.steady.family import Family
from vofem.studies.steady.near import polished
from vofem.studies.steady.point import Point, corrected, derivative_by_value, level, point_at, scales_of
from vofem.studies.steady.shooting import CLOSES
from vofem.studies.steady.signature import AT_ONCE, ROUNDING, Signature, States, Switch, signature_of
from vofem.system import CLOSED, OPEN, PINNED

#: Error of an evaluation of a grazing: as small as rounding allows.
_EXACT = 1e-16

#: Length in rad of a touch or stick that has just begun, and of several touches which begin at once, whose equations
#: are singular at length zero.
BEYOND, _SEVERAL = 1e-8, 1e-6

#: Length of one during which a slider sticks: it lasts before as the square root of the height, after as the cube root.
#: A slider that stops and slides on, or slides while it sticks, does so at least for nearly as long, since equations
#: are singular where that vanishes.
_STUCK, _NEARLY_STUCK = 1e-3, 0.999e-3

#: Largest height of a slider's extreme, over its limit or the speed of the motion, in the orbit at its limit.
_AT_LIMIT = 1e-10

#: Longer ones, and the cosines of the angle between the branch and lengths that grow evenly between which they are
#: needed: where the branch bends from there to other directions, rounding decides.
_LONGER, _BENDS = (1e-6, 1e-5), (0.14, 0.99999)

#: Steps in scaled coordinates to the first orbit beyond a grazing where forces jump or bodies rebound. Rounding grows
#: the more the nearer the grazing; the first is taken of which an ordinary run tells that it repeats, or what it lacks.
_NEAREST = (1e-5, 1e-4, 1e-3, 1e-2)

#: An orbit may lie aside of a step by a share of it.
_ASIDE = 0.3

#: Length in rad below which a touch may be about to end.
_NEARLY = 5e-3

#: Shares of a step by which ends of touches may differ that are searched as one.
_SAME = 0.02

#: Height over the size of the motion up to which touches begin together.
_TOGETHER = 1e-13

#: Rate of the parameter, in scaled coordinates, that may be rounding beside a grazing.
_ROUNDED = 1e-8

#: Rate at which an extreme moves away from its gap, over the size of the motion and in scaled coordinates, that may be
#: rounding.
_LEAVES = 1e-5

#: Share of a step beyond its end up to which a change may lie, and distance before its begin that is rounding.
_OUTSIDE, _BEHIND = 0.05, 1e-8

#: Share of a step up to which a change may be the one at which the step begins.
_AT_BEGIN = 1e-6

#: Changes that are located in one step at most, to find the first of them.
_MOST = 8

#: Distance of an extreme from its gap, over the size of the motion, that is told where a branch is lost, and the number
#: of touches above which a contact may chatter.
_CLOSE, _SEQUENCE = 1e-4, 3

#: Length in rad of a rest at a rigid stop that is about to end.
_BRIEF = 0.02

#: How many orbits inside a step are looked at where a change may hide.
_LOOKS = 6

#: Distance of an extreme from its gap over the size of the motion, in terms of the step, up to which it may reach the
#: gap inside the step; and a value inside, as a share of the smaller one at the ends, that leaves no doubt.
_REACH, _CLEAR = 0.1, 0.2

#: Distance up to which an extreme may have come past a switch, and by how much farther than where one vanishes an
#: orbit is looked at.
_BESIDE_GAP, _FARTHER = 1e-6, 0.1

#: Distance in scaled coordinates of orbits that rest at a gap after different numbers of touches, and least cosine of
#: the angle between their branches.
_RESTS, _STRAIGHT = 1e-4, 0.9

#: Step in scaled coordinates by which heights, speeds and reactions are differentiated.
_DIFFERENCE = 1e-6

#: Why a branch ends where a slider stops or breaks away for some time at once.
_JUMPS = (
    "a slider stops or begins to slide there, for a time that is not short: where static friction is larger than that "
    "of sliding, the motion jumps"
)

#: Two switches of a signature, or one twice, by their numbers.
_Pair = tuple[int, int]


class _Begun(NamedTuple):
    """What has begun in a signature: its first and last switch, and those that end its lengths; an impact has none."""

    first: int
    last: int
    ends: tuple[int, ...] = ()


class Mark(NamedTuple):
    """Where in an orbit a contact may begin to touch, or a slider to stick or to slide: phase in rad.

    `turns`: whether it is a slider that turns there.
    """

    contact: int
    phase: float
    turns: bool = False


@dataclass(frozen=True)
class Passage:
    """A change of the signature."""

    before: Point  #: The last orbit with the old signature.
    at: Point  #: The orbit at the change.
    after: Point | None  #: The first orbit with the new signature; None where several branches may begin.
    grazed: tuple[int, ...]  #: Contacts that are grazed.


class _Change(NamedTuple):
    """A change between two neighbours: its share of the step, and the switches of what ends, or what begins."""

    share: float
    pairs: tuple[_Pair, ...] = ()
    begins: Mark | None = None


def passage(family: Family, now: Point, after: Point) -> Passage | None:
    """Return the first change of the signature between two neighbours; None if there is none and the orbit repeats.

    Raises `ConvergenceError` if the change cannot be located, or the second orbit does not repeat under an ordinary
    run.
    """
    chart: Signature = now.chart
    lengths = chart.lengths(after.y[:-1])
    if min(lengths[0], lengths[-1]) <= 0.0:
        raise ConvergenceError("a switch passed the phase at which the state is an unknown")
    if any(float(lengths[p + 1 : k + 1].sum()) <= 0.0 for p, k in chart.leaves):
        raise ConvergenceError("a body came back to a rigid stop before it left it")
    changes = _changes(now, after)
    if not changes and not after.evaluation.repeats:
        away = after.evaluation.closing
        raise ConvergenceError(
            f"the orbit does not repeat under an ordinary run, by {away:.1e} of the motion{_rested(after)}"
            if away > CLOSES
            else f"contacts and sliders switch in another order in an ordinary run over the orbit{_rested(after)}"
        )
    return _earliest(family, now, after, _first(family, now, after, changes) if changes else None)


def _changes(now: Point, after: Point, without: Collection[_Pair] = ()) -> list[_Change]:
    """Return all changes of the signature between two neighbours, except of some pairs.

    Where they show none and an ordinary run does not repeat, its first touch is one.
    """
    # Beside a segment of negative length there are extremes that mean nothing.
    found = _vanishing(now, after, without) or _touching(now, after)
    return found if found or after.evaluation.repeats else _touching(now, after, _run(after))


def _run(point: Point) -> Flow:
    """Return an ordinary run over an orbit from the phase of its coordinates."""
    flow: Flow = point.chart.flow(point.problem, point.y[:-1])
    return flow


def _rested(point: Point) -> str:
    """Return which contacts a run lets rest at their gaps while the orbit touches them, as the end of a sentence."""
    laws, own, flow = point.problem.system.contacts, point.chart.switches, _run(point)
    rests = {e.contact for e in flow.events if e.after == PINNED and _law(point.problem, e.contact) == "jump"}
    names = [repr(laws.names[j]) for j in sorted(rests) if (j, PINNED) not in own]
    if not names:
        return ""
    return f": the run lets {' and '.join(names)} rest at the gap where touches are lower than {PIN_FRACTION:g} of it"


def _earliest(family: Family, now: Point, after: Point, found: Passage | None) -> Passage | None:
    """Return what is hidden before a change that was found, or before the second of two neighbours; else the change."""
    hidden = _hidden(family, now, after if found is None else found.before)
    return found if hidden is None else _first(family, now, *hidden)


def _hidden(family: Family, now: Point, after: Point, looks: int = _LOOKS) -> tuple[Point, list[_Change]] | None:
    """Return an orbit between two neighbours and its changes, which are undone before the second neighbour."""
    share = _lowest(family, now, after) if looks and isinstance(now.chart, Signature) else None
    if share is None:
        return None
    middle = point_between(family, Step(now, after), share)
    changes = _vanishing(now, middle) or _touching(now, middle)
    if changes:
        return middle, changes
    before = _hidden(family, now, middle, looks - 1)
    return _hidden(family, middle, after, looks - 1) if before is None else before


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
    inside = [slice(p + 1, last + 1) for (p, _), last in _spans(now.problem, chart).items()]
    known = [(*ends[:, one].sum(axis=1), *slopes[:, one].sum(axis=1)) for one in inside]
    heights, rates = _extremes_along(family, (now, after), along, -_REACH * step)
    whole = np.isfinite(heights).all(axis=0)
    # One that is at one end alone goes on evenly until it vanishes. A look is taken a little farther.
    with np.errstate(divide="ignore", invalid="ignore"):
        reached = (heights / rates + [[0.0], [1.0]])[:, ~whole]
        reached = reached + [[_FARTHER], [-_FARTHER]] * np.minimum(reached, 1.0 - reached)
    reached = reached[(reached > 0.0) & (reached < 1.0)]
    if reached.size:
        return float(reached.min())
    # One close to its gap may have come past a switch.
    halfway = 0.5 if np.any(heights[:, ~whole] > -_BESIDE_GAP) else None
    known += list(map(tuple, np.concatenate([-heights, rates])[:, whole].T))
    if not known:
        return halfway
    v0, v1, s0, s1 = np.array(known).T
    # Where the derivative ``s0 + 2 b x + a x^2`` of the cubic vanishes.
    a, b = 3.0 * (s0 + s1 - 2.0 * (v1 - v0)), 3.0 * (v1 - v0) - 2.0 * s0 - s1
    with np.errstate(divide="ignore", invalid="ignore"):
        pull = -(b + np.copysign(np.sqrt(b**2 - a * s0), b))
        x = np.array([pull / a, s0 / pull])
    x = np.where((x > 0.0) & (x < 1.0), x, 0.0)
    low = v0 + x * (s0 + x * (b + x * a / 3.0)) - _CLEAR * np.minimum(v0, v1)
    # What is zero at the second neighbour, where a touch ends, may have been negative before.
    low[(x == 0.0) | (v0 <= AT_ONCE)] = np.inf
    worst = np.unravel_index(low.argmin(), low.shape)
    return float(x[worst]) if low[worst] < (-AT_ONCE if v1[worst[1]] <= AT_ONCE else 0.0) else halfway


def _extremes_along(
    family: Family, ends: tuple[Point, Point], along: Sequence[float], least: float
) -> tuple[Array, Array]:
    """Return heights above a least one of extremes at two neighbours, and rates at which they leave the gap, (2, k).

    They are NaN where one is at the other end alone. `along`: factors of the derivatives along the branch.
    """
    pairs = _paired(*(point.evaluation.extremes for point in ends))
    pairs = [pair for pair in pairs if max(e.height for e in pair if e is not None) >= least]
    found = np.full((2, 2, len(pairs)), np.nan)
    for k, point in enumerate(ends):
        mine = [(number, pair[k]) for number, pair in enumerate(pairs)]
        known = {number: e for number, e in mine if e is not None}
        new = [e for e in known.values() if e not in point.leaving]
        if new:
            point.leaving.update(
                zip(new, _away_along(family, point, [Mark(e.contact, e.phase) for e in new]), strict=True)
            )
        for number, e in known.items():
            found[:, k, number] = e.height, along[k] * point.leaving[e]
    return found[0], found[1]


def _paired(earlier: Sequence[Extreme], later: Sequence[Extreme]) -> list[tuple[Extreme | None, Extreme | None]]:
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


def _first(family: Family, now: Point, after: Point, changes: list[_Change]) -> Passage:
    """Return the first of some changes of the signature between two neighbours, and of those that come before it."""
    last, pairs = after, tuple[_Pair, ...]()
    for _ in range(_MOST):
        change = min(changes, key=lambda one: one.share)
        if pairs and change.pairs and change.share >= 1.0 - _SAME:
            # Of two that end at one orbit, the first orbit beside it with one of them may lack the other.
            change = change._replace(pairs=(*change.pairs, *pairs))
        found, pairs = _located(family, now, last, change)
        last = found.before
        changes = _changes(now, last, pairs)
        if not changes:
            inner = last if pairs else found.after
            # Where forces jump, what they do to rounding grows without bound at a grazing, but not beside it.
            one = found.at if inner is not None and inner.chart.smooth(inner.problem) else inner
            if one is not None and not one.evaluation.repeats:
                raise ConvergenceError(
                    f"the orbit at a change of contact at {one.value:.12g} does not repeat under an ordinary run, by "
                    f"{one.evaluation.closing:.1e} of the motion"
                )
            return found
    raise ConvergenceError("too many changes of contact in one step")


def ending(family: Family, now: Point) -> Passage | None:
    """Return the grazing ahead of an orbit with very short touches that become shorter; None if there is none.

    Where several touches end at once the equations become singular, and steps towards this orbit fail.
    """
    chart: Signature = now.chart
    lengths, rates = chart.lengths(now.y[:-1]), chart.rates(now.tangent * now.scales)
    touches, spans = chart.touches, _spans(now.problem, chart)
    ahead = {
        (p, k): float(lengths[p + 1 : last + 1].sum() / -rates[p + 1 : last + 1].sum())
        for (p, k), last in spans.items()
        if (p, k) in touches and 0.0 < lengths[p + 1 : last + 1].sum() < _NEARLY and rates[p + 1 : last + 1].sum() < 0.0
    }
    if not ahead:
        return None
    first = min(ahead.values())
    after = replace(now, y=now.y + 1.1 * first * now.tangent * now.scales)
    pairs = tuple(pair for pair, distance in ahead.items() if distance <= (1.0 + _SAME) * first)
    found = _first(family, now, after, [_Change(1.0 / 1.1, pairs)])
    away = float(np.linalg.norm((found.before.y - now.y) / now.scales))
    if found.after is None or away > 10.0 * _NEARLY or abs(found.at.value - now.value) > _NEARLY * family.interval.size:
        raise ConvergenceError("a change of contact was found elsewhere")
    return _earliest(family, now, after, found)


def resting(family: Family, now: Point, guess: Array) -> Passage | None:
    """Return the orbit at a guess ahead with the switches of an ordinary run there, of which some are rests at a gap.

    Under the displacement law touches become shorter without end, and a run lets a contact rest after some of them.
    Where their number changes, the orbits on both sides differ by less than such a touch does. So they do where a body
    that rests at a rigid stop begins to leave it for a moment. None where no contact rests, where another contact
    touches, and where the orbit belongs to another branch.
    """
    chart, problem, n = now.chart, family.of(guess), now.problem.size
    new, y, found = chart, guess[:-1], None
    for _ in range(_MOST):
        if found is not None and found.repeats:
            break
        old = new.switches
        new, y = signature_of(problem, new.flow(problem, y))
        every = [chart.switches, new.switches]
        rests = any(s.status == PINNED and _law(problem, s.contact) != "stick" for one in every for s in one)
        touching = [{s.contact for s in one} for one in every]
        if not rests or new.switches == old or touching[0] != touching[1]:
            return None
        found = polished(new.evaluate(problem, y))
        if found is None:
            return None
        y = found.y
    else:
        return None
    inner = point_at(family, new, np.append(y, guess[-1]), level(y.size + 1, now.tangent[-1]), found)
    scales = np.append(now.scales[:n], now.scales[-1])
    ahead, beyond, away, own = (
        np.append(x[:n], x[-1]) / scales
        for x in (now.tangent * now.scales, inner.tangent * inner.scales, inner.y, guess)
    )
    along = float(ahead @ beyond) / float(np.linalg.norm(ahead) * np.linalg.norm(beyond))
    if np.linalg.norm(away - own) > _RESTS or abs(along) < _STRAIGHT:
        return None
    return Passage(now, inner, inner if along > 0.0 else inner.turned(), ())


# -- what is watched ----------------------------------------------------------------------------------


def _spans(problem: Any, chart: Signature) -> dict[_Pair, int]:
    """Return pairs of switches that stay in their order, of touches and sticks, and neighbours of two contacts.

    Each comes with the switch up to which its time counts. A touch during which a slider holds the point that touches
    ends with its begin: the time up to the stop of the slider vanishes. Both cannot switch in another order.
    """
    s, stops = chart.switches, chart.stops(problem)
    found = {pair: pair[1] for pair in (*chart.touches, *chart.spells)}
    for p, k in chart.touches:
        found[p, k] = next((stop.first for stop in stops if p < stop.first < k and s[p].contact in stop.held), k)
    held = {(at, j) for stop in stops for at in (stop.first, stop.last) for j in stop.held}
    for k in range(1, len(s)):
        if s[k].contact != s[k - 1].contact and not {(k, s[k - 1].contact), (k - 1, s[k].contact)} & held:
            found[k - 1, k] = k
    return found


def _watched(point: Point) -> dict[_Pair, tuple[float, float]]:
    """Return numbers that are positive while a signature holds, and what of each is rounding, by their switches."""
    chart: Signature = point.chart
    lengths, s = chart.lengths(point.y[:-1]), chart.switches
    found = {
        (p, k): (
            float(lengths[p + 1 : last + 1].sum()) - _NEARLY_STUCK * _slips(chart, p, k),
            AT_ONCE if s[p].contact != s[k].contact else 0.0,
        )
        for (p, k), last in _spans(point.problem, chart).items()
    }
    rounding = ROUNDING * point.evaluation.sizes[1]
    found |= {(k, k): (x, rounding) for k, x in chart.approaches(point.problem, point.evaluation).items()}
    return found | {(k, k): (x, ROUNDING) for k, x in chart.margins(point.problem, point.evaluation).items()}


def _vanishing(now: Point, after: Point, without: Collection[_Pair] = ()) -> list[_Change]:
    """Return what has vanished of the numbers that are watched; what ends at about one place is one change."""
    chart: Signature = now.chart
    first, found = _watched(now), list[tuple[float, _Pair]]()
    for pair, (there, rounding) in _watched(after).items():
        here = max(first[pair][0], 0.0)
        if there < -rounding or there == rounding == 0.0:
            found.append((here / (here - there) if here > there else 0.0, pair))
    found = [(share, pair) for share, pair in found if pair not in without]
    ends = [(share, pair) for share, pair in found if _ends(chart, pair)]
    changes = []
    for share, (p, k) in found:
        if not _ends(chart, (p, k)):
            if p == k:
                if any(one == p for _, (one, _) in ends):
                    # It turns for the stop that vanishes.
                    continue
                changes.append(_Change(share, begins=_mark(chart, now.y, k)))
            elif not any(one <= p and k <= other for _, (one, other) in ends):
                changes.append(_Change(share, ((p, k),)))
    if ends:
        share = min(ends)[0]
        changes.append(_Change(share, tuple(pair for one, pair in sorted(ends) if one <= share + _SAME)))
    return changes


def _ends(chart: Signature, pair: _Pair) -> bool:
    """Return whether something ends where what is watched at two switches vanishes."""
    p, k = pair
    return chart.struck[k] >= 0 if p == k else chart.switches[p].contact == chart.switches[k].contact


def _mark(chart: Signature, y: Array, k: int) -> Mark:
    contact, status = chart.switches[k]
    return Mark(contact, float(chart.phases(y[:-1])[k]), min(status, int(chart.statuses[k][contact])) > PINNED)


def _touching(now: Point, after: Point, flow: Flow | None = None) -> list[_Change]:
    """Return extremes of gap functions that have come to the wrong side, the first touch of a run among them."""
    chart: Signature = now.chart
    there, found = after.evaluation.extremes, []
    first = None if flow is None else chart.first_touch(after.evaluation, flow)
    if first is not None and not any(e.height > ROUNDING and chart.alike(e.phase, first.phase) for e in there):
        there = sorted([*there, first])
    for near, e in _paired(now.evaluation.extremes, there):
        if e is None or e.height <= ROUNDING:
            continue
        share, phase = 0.5, e.phase
        if near is not None:
            share = min(max(-near.height, 0.0) / (e.height + max(-near.height, 0.0)), 1.0)
            phase = near.phase + share * (e.phase - near.phase)
        found.append(_Change(share, begins=Mark(e.contact, phase)))
    return found


# -- the orbit at a change, and its neighbours --------------------------------------------------------


def _located(family: Family, now: Point, after: Point, change: _Change) -> tuple[Passage, tuple[_Pair, ...]]:
    """Return a change of the signature, and the switches of what ends there."""
    old: Signature = now.chart
    pairs, guess = change.pairs, now.y + change.share * (after.y - now.y)
    near = now if change.share < 0.5 else after
    if change.begins is not None:
        if change.share <= _AT_BEGIN and _away_along(family, now, [change.begins])[0] > 0.0:
            # It has just been grazed, leaves the gap, and comes back within the step.
            raise ConvergenceError("a contact leaves its gap and comes back in one step")
        outer, every = _outside(family, old, guess, change.begins, now.tangent, near.evaluation)
        _between(now, after, outer.y)
        outer = _along(now, outer)
        return Passage(outer, outer, _inside(family, outer, every), _contacts(every)), ()
    if not _ends(old, pairs[0]):
        return _swapped(family, now, after, guess, pairs[0][1], near.evaluation), pairs
    phases = old.phases(guess[:-1])
    gone = sorted({index for p, k in pairs for index in _gone(now.problem, old, p, k)})
    during = {pair: stop for pair in pairs for stop in old.stops(now.problem) if pair[0] < stop.first < pair[1]}
    middles = [
        Mark(
            old.switches[k].contact,
            float(phases[during[p, k].first] if (p, k) in during else 0.5 * (phases[p] + phases[k])),
            _turns(old, p, k) and old.switches[p].status == PINNED,
        )
        for p, k in pairs
    ]
    out, y, _ = old.edited(guess[:-1], gone)
    upwards = np.append(np.zeros(y.size), 1.0)
    begins = old.begins_of(near.evaluation, gone)
    outer, every = _outside(family, out, np.append(y, guess[-1]), middles[0], upwards, begins)
    ended: list[Mark] = []
    for contact, middle, turns in middles:
        mine = [mark for mark in every if mark.contact == contact and mark.turns == turns]
        ended += sorted(mine, key=lambda mark: abs(mark.phase - middle))[:1]
    if len(set(ended)) < len(pairs):
        if len(pairs) > 1:
            return _located(family, now, after, change._replace(pairs=pairs[:1]))
        raise ConvergenceError("what ends at a grazing does not begin there on the way back")
    # The orbit outside as one of the old signature: what ends has no length.
    n = now.problem.size
    phases[[k for k in range(phases.size) if k not in gone]] = out.phases(outer.y[:-1])
    for (p, k), mark in zip(pairs, ended, strict=True):
        stop = during.get((p, k))
        phases[[p, k]] = mark.phase if stop is None else phases[[stop.first, stop.last]]
    left = outer.y[n + len(out.switches) :]
    zero = np.concatenate([outer.y[:n], np.diff(np.append(old.anchor, phases)), left])
    slips = any(_slips(old, *pair) for pair in pairs)
    if not slips:
        _between(now, after, zero)
    groups: list[_Pair] = []
    for p, k in sorted(pairs):
        if groups and p < groups[-1][1]:
            groups[-1] = groups[-1][0], max(groups[-1][1], k)
        else:
            groups.append((p, k))
    inner = _beyond(family, old, zero, [_lasting(now.problem, old, p, k) for p, k in groups], near.evaluation)
    if inner is None:
        raise ConvergenceError("what ends at a grazing does not do so in one direction of the branch")
    if slips:
        _between(now, after, inner.y)
    before, values = inner.turned(), _watched(now)
    nearer = _watched(before)
    if any(not 0.0 < nearer[pair][0] < values[pair][0] for pair in pairs):
        before = now
    if _opposed(family, before, outer, ended[0]):
        outer = outer.turned()
    others = [mark for mark in every if mark not in ended]
    laws = {_law(now.problem, mark.contact) for mark in others}
    beyond: Point | None = outer
    if laws & {"impact", "smooth"}:
        # Those that touched no longer do, and those that did not begin to: so this branch crosses that without touches.
        beyond = None if "impact" in laws else _inside(family, outer, others)
    return Passage(_not_turned(before, outer), outer, beyond, _contacts(every)), pairs


def _opposed(family: Family, before: Point, outer: Point, ended: Mark) -> bool:
    """Return whether the orbit outside has the direction from which a branch comes, and not that in which it goes on.

    The branch goes on where what has ended moves away. Where that is rounding, and forces are smooth, states change
    evenly through a grazing; beside a stiff contact they do so within a length that is rounding only.
    """
    away = float(_away_along(family, outer, [ended])[0])
    if _law(outer.problem, ended.contact) != "smooth" or abs(away) > _LEAVES:
        return away < 0.0
    own = [*range(outer.problem.size), -1]
    come, gone = ((point.tangent * point.scales)[own] / outer.scales[own] for point in (before, outer))
    return bool(come @ gone < 0.0)


def _contacts(marks: Sequence[Mark]) -> tuple[int, ...]:
    return tuple(sorted(mark.contact for mark in marks))


def _swapped(family: Family, now: Point, after: Point, guess: Array, k: int, near: Any) -> Passage:
    """Return the orbit in which two contacts switch at one time, and the same one with the switches in other order."""
    chart: Signature = now.chart
    place = now.problem.size + k
    at = _with_length(family, chart, guess, place, 0.0, near)
    _between(now, after, at.y)
    one, other = (at.problem.space.contacts[chart.switches[j].contact] for j in (k - 1, k))
    coupled = abs(one @ other) > ROUNDING * float(np.linalg.norm(one) * np.linalg.norm(other))
    if max(chart.struck[k - 1 : k + 1]) >= 0 and coupled:
        raise ConvergenceError(
            "two impacts happen at the same time, of bodies that move each other; beyond, their order is another one, "
            "and so is the motion"
        )
    edit = [k], [(k - 1, float(chart.phases(at.y[:-1])[k]), chart.switches[k])]
    new, y, _ = chart.edited(at.y[:-1], *edit)
    towards = np.zeros(at.y.size)
    towards[place] = 1.0
    beyond = point_at(family, new, np.append(y, at.value), towards, near=chart.begins_of(at.evaluation, *edit))
    return Passage(_along(now, at), at, beyond, ())


def _turns(chart: Signature, p: int, k: int) -> bool:
    """Return whether a slider turns where what it does between two switches ends: only one of both is left."""
    contact, status = chart.switches[k]
    before = int(chart.statuses[p][contact])
    return before > PINNED and before != status


def _slips(chart: Signature, p: int, k: int) -> bool:
    """Return whether a slider stops between two switches and slides on, or slides until it stops."""
    contact, status = chart.switches[k]
    if chart.switches[p].contact != contact or max(status, int(chart.statuses[k][contact])) <= PINNED:
        return False
    return status == PINNED or not _turns(chart, p, k)


def _gone(problem: Any, chart: Signature, p: int, k: int) -> list[int]:
    """Return the switches that the orbit outside does not have, of what ends between two of them."""
    if _law(problem, chart.switches[k].contact) != "stick":
        return [p, k]
    if k != p + 1:
        raise ConvergenceError("a slider ceases to stick while contacts switch")
    return [p] if _turns(chart, p, k) else [p, k]


def _outside(
    family: Family, chart: Signature, guess: Array, mark: Mark, towards: Array, near: Any
) -> tuple[Point, list[Mark]]:
    """Return the orbit near a guess in which something is about to begin, and all that is, this one first.

    `near`: an evaluation near the guess, or `States`.
    """
    if _law(family.of(guess), mark.contact) == "stick" and not mark.turns:
        point, mark = _at_limit(family, chart, guess, mark, towards, near)
        rounding = max(_TOGETHER, 4.0 * abs(_nearest(point.evaluation, mark).height))
    else:
        point, mark = _without_length(family, chart, guess, mark, towards, near)
        rounding = _TOGETHER
        if mark.turns and _breaks(point.problem, mark.contact) and _stays(point, mark):
            raise ConvergenceError(_JUMPS)
    y = point.y
    own = [_mark(chart, y, k) for k in range(len(chart.switches))]
    own = [one for one in own if _law(point.problem, one.contact) != "stick"]
    found = [
        Mark(e.contact, e.phase)
        for e in point.evaluation.extremes
        if abs(e.height) <= rounding and not _among(chart, [mark, *own], e.contact, e.phase)
    ]
    margins = chart.margins(point.problem, point.evaluation)
    turns = [_mark(chart, y, k) for k, margin in margins.items() if abs(margin) <= rounding]
    return point, [mark, *found, *(turn for turn in turns if not _among(chart, [mark], turn.contact, turn.phase))]


def _nearest(evaluation: Any, mark: Mark) -> Extreme:
    """Return the extreme of a slider that is nearest to a mark."""
    mine = [e for e in evaluation.extremes if e.contact == mark.contact]
    if not mine:
        raise ConvergenceError("a slider no longer comes near to where it begins to stick or to slide")
    turn = evaluation.chart.turn
    return min(mine, key=lambda e: abs((e.phase - mark.phase + 0.5 * turn) % turn - 0.5 * turn))


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
        found = _nearest(point.evaluation, mark)
        mark = mark._replace(phase=found.phase)
        if abs(found.height) <= ROUNDING or abs(found.height) >= 0.5 * best:
            break
        best, scales, by_value, direction = abs(found.height), point.scales, point.by_value, point.tangent
        away = float(_away_along(family, point, [mark])[0])
        guess = point.y + found.height / away * point.tangent * point.scales
    if abs(found.height) > _AT_LIMIT:
        raise ConvergenceError("the orbit in which a slider just stops or begins to slide was not found")
    return (point if point.tangent @ towards >= 0.0 else point.turned()), mark


def _breaks(problem: Any, slider: int) -> bool:
    """Return whether the force of a slider jumps where it breaks away."""
    sliders = problem.course.sliders
    return bool(sliders.static[slider - sliders.first] > sliders.limit[slider - sliders.first])


def _stays(point: Point, mark: Mark) -> bool:
    """Return whether a slider that begins to stick where it turns would do so for long: what pulls at it decreases."""
    chart, problem, path = point.chart, point.problem, point.evaluation.path
    k = _turn(chart, chart.phases(point.y[:-1]), mark.contact, mark.phase)
    stuck = chart.statuses[k].copy()
    stuck[mark.contact] = PINNED
    time, tau = float(path.times[k] + path.durations[k]), _STUCK / problem.loads.omega
    held = int(np.sum(stuck[: mark.contact] == PINNED))
    pull = problem.course.motion(stuck, np.array([time]), path.ends[k][None]).reactions(np.array([0.0, tau]))[held]
    return bool((pull[1] - pull[0]) * (1.0 if chart.switches[k].status == UP else -1.0) < 0.0)


def _without_length(
    family: Family, chart: Signature, guess: Array, mark: Mark, towards: Array, near: Any
) -> tuple[Point, Mark]:
    """Return the orbit near a guess in which something has begun that has no length, and where in the orbit."""
    known = chart.evaluate(family.of(guess), guess[:-1], derivative=False, near=near)
    long, y, begins, ((_, k, _),) = _begun(known, chart, guess[:-1], [mark], touches=True)
    at = _with_length(family, long, np.append(y, guess[-1]), known.problem.size + k, 0.0, begins)
    slides = _law(at.problem, mark.contact) == "stick"
    mark = mark._replace(phase=float(long.phases(at.y[:-1])[k]))
    gone = [k - 1] if slides else [k - 1, k]
    y = np.append(long.edited(at.y[:-1], gone)[1], at.value)
    return point_at(family, chart, y, towards, near=long.begins_of(at.evaluation, gone)), mark


def _inside(family: Family, outer: Point, marks: Sequence[Mark]) -> Point | None:
    """Return the first orbit in which all has begun that is about to; None if there is none beside."""
    chart, y, begins, begun = _begun(outer.evaluation, outer.chart, outer.y[:-1], marks)
    inner = _beyond(family, chart, np.append(y, outer.value), begun, begins)
    return inner if inner is None else _not_turned(inner, outer)


def _begun(
    known: Any, chart: Signature, y: Array, marks: Sequence[Mark], *, touches: bool = False
) -> tuple[Signature, Array, States, list[_Begun]]:
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
            contact, law = mark.contact, _law(problem, mark.contact)
            if law == "stick":
                new = _slip(known, chart, phases, mark)
                ends.append((len(added), len(added) + len(new) - 1, 2 - len(new)))
                added += new
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
    return chart, y, begins, [_lasting(problem, chart, p, k) for p, k in begun]


def _slip(known: Any, chart: Signature, phases: Array, mark: Mark) -> list[tuple[int, float, Switch]]:
    """Return what `Signature.edited` adds where a slider sticks or slides for no time; one switch where it turns."""
    contact, phase, turns = mark
    if turns:
        k = _turn(chart, phases, contact, phase)
        return [(k, float(phases[k]), Switch(contact, PINNED))]
    for k, switch in enumerate(chart.switches):
        if switch == (contact, PINNED) and chart.alike(float(phases[k]), phase):
            return [(k, float(phases[k]), Switch(contact, UP + DOWN - int(chart.statuses[k][contact])))]
    number = int(np.searchsorted(phases, phase))
    now = int(chart.statuses[number][contact])
    there = PINNED
    if now == PINNED:
        problem, time = known.problem, phase / known.problem.loads.omega
        state = known.path.state(number, time - float(known.path.times[number]))
        there = UP if problem.course.reaction(chart.statuses[number], time, state, contact) > 0.0 else DOWN
    return [(number, phase, Switch(contact, there)), (number, phase, Switch(contact, now))]


def _lasting(problem: Any, chart: Signature, first: int, last: int) -> _Begun:
    """Return what has begun; a slider may stop in a touch, which lasts before and after its stop."""
    if first == last:
        return _Begun(first, last)
    stop = next((one for one in chart.stops(problem) if first < one.first < last), None)
    return _Begun(first, last, ((first + last + 1) // 2,) if stop is None else (stop.first, stop.last + 1))


def touch(
    problem: Any, chart: Signature, y: Array, contacts: Sequence[int], phase: float, *, lasts: bool
) -> list[tuple[int, float, Switch]]:
    """Return what `Signature.edited` adds for a touch of length zero by one or more contacts at once.

    Where a slider holds the points that touch, they do so when it stops. `lasts`: as long as it is at rest.
    """
    phases = chart.phases(y)
    first = last = int(np.searchsorted(phases, phase))
    begins = ends = phase
    stops = [one for one in chart.stops(problem) if set(contacts) <= set(one.held)]
    if stops:
        stop = min(stops, key=lambda one: abs(float(phases[one.first]) - phase))
        first, last = stop.first, stop.last + 1 if lasts else stop.first
        begins, ends = (float(phases[stop.first]), float(phases[stop.last if lasts else stop.first]))
    now = chart.statuses[first]
    there = [(first, begins, Switch(j, OPEN if now[j] == CLOSED else CLOSED)) for j in contacts]
    return there + [(last, ends, Switch(j, int(now[j]))) for j in contacts]


def _beyond(family: Family, chart: Signature, y: Array, begun: Sequence[_Begun], near: Any) -> Point | None:
    """Return the orbit just beyond one at which something begins without length or speed, as `_begun` tells.

    None if none beside has all of it. `near`: an evaluation near the coordinates, or `States`.
    """
    problem = family.of(y)
    n = problem.size
    laws = {_law(problem, chart.switches[one.last].contact) for one in begun}
    lasting, hits = [one for one in begun if one.ends], [one.last for one in begun if not one.ends]
    lengths = [n + k for one in lasting for k in one.ends]
    if not laws & {"impact", "jump"}:
        # Where forces are smooth, the parameter changes as squared lengths, or as those of sticks.
        inner: Point | None = None
        several = len(lasting) > 1 or lasting[0].last - lasting[0].first > len(lasting[0].ends)
        slow = any(one.ends[-1] > one.ends[0] + 1 or _slips(chart, one.first, one.last) for one in lasting)
        for length in (_STUCK,) if slow else sorted({_SEVERAL if several else BEYOND, *_LONGER}):
            guess = y.copy()
            for first, last, ends in lasting:
                guess[[n + k for k in ends]] = length
                guess[n + first] -= 0.5 * length * len(ends)
                if last + 1 < len(chart.switches):
                    guess[n + last + 1] -= 0.5 * length * len(ends)
            try:
                place = n + lasting[0].ends[-1]
                inner = _with_length(family, chart, guess, place, length, near, alone=len(lasting) == 1)
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
    at = point_at(family, chart, y, towards, near=near)

    def speeds(problem: Any, evaluation: Any, _: Array) -> Array:
        every = chart.approaches(problem, evaluation)
        return np.array([every[k] for k in hits]) / at.evaluation.sizes[1]

    rates = np.append((at.tangent * at.scales)[lengths], _slope(family, at, speeds) if hits else [])
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
        near = np.linalg.norm((found - guess) / at.scales) <= _ASIDE * step
        if near and (inner.evaluation.repeats or _touching(at, inner, _run(inner))):
            return inner
    raise ConvergenceError("no orbit was found beside one that grazes a contact whose force jumps, or a rigid stop")


def what_contacts_do(point: Point) -> str:
    """Return what of an orbit most likely ends a branch there, as the end of a sentence; "" for nothing.

    These are, the most likely first: sliders and contacts that rest, impacts without end, short touches, grazings.
    """
    chart = point.chart
    laws = point.problem.system.contacts if isinstance(chart, Signature) else None
    if laws is None:
        return ""
    found: dict[tuple[int, str], list[str]] = {}
    for contact, name in enumerate(laws.names):
        kind, hits = _law(point.problem, contact), chart.struck.count(contact)
        rests = [status[contact] == PINNED for status in chart.statuses]
        count, shortest, what = _short_touches(point, contact)
        touches = f"{what} at {{}}{', the shortest' if count > 1 else ''} for {shortest:.2g} rad of the load"
        near = min((-e.height for e in point.evaluation.extremes if e.contact == contact), default=np.inf)
        rest = _shortest_rest(point, contact)
        for rank, (holds, told) in enumerate((
            (
                kind == "impact" and rest < _BRIEF,
                f"{{}} resting for {rest:.2g} rad of the load only; its impacts become infinitely many where it no "
                "longer comes to rest",
            ),
            (kind != "stick" and any(rests), "{} resting at the gap for a part of it"),
            (kind == "jump" and count > _SEQUENCE, touches + ": where a force jumps they may become infinitely many"),
            (hits > _SEQUENCE, f"{hits} impacts on {{}}, which may become infinitely many"),
            (shortest < _NEARLY, touches),
            (kind == "stick" and near < _CLOSE, "{} about to stop or to slide for a short time"),
            (kind != "stick" and near < _CLOSE, f"{{}} within {max(near, 0.0):.2g} of the motion of the gap"),
            (kind == "stick" and all(rests), "{} sticking all along"),
        )):  # fmt: skip
            if holds:
                found.setdefault((rank, told), []).append(repr(name))
                break
    first = min(found, default=(0, ""))[0]
    parts = [told.format(" and ".join(names)) for (rank, told), names in found.items() if rank == first]
    return "; the orbit there has " + ", and ".join(parts) if parts else ""


def _shortest_rest(point: Point, contact: int) -> float:
    """Return the shortest time in rad of the load for which something rests at a rigid stop."""
    chart, lengths = point.chart, point.chart.lengths(point.y[:-1])
    rests = ((p, k) for p, k in chart.successive if chart.switches[p] == (contact, PINNED))
    return min((float(lengths[p + 1 : k + 1].sum()) for p, k in rests), default=np.inf)


def _short_touches(point: Point, contact: int) -> tuple[int, float, str]:
    """Return the number of touches or openings of a contact, the shortest in rad of the load, and words for them."""
    chart, lengths = point.chart, point.chart.lengths(point.y[:-1])
    found: dict[int, list[float]] = {CLOSED: [], OPEN: []}
    for p, k in chart.touches:
        if chart.switches[p].contact == contact:
            found[chart.switches[p].status].append(float(lengths[p + 1 : k + 1].sum()))
    closed, opened = (min(found[status], default=np.inf) for status in (CLOSED, OPEN))
    status, one, many = (CLOSED, "a touch", "touches") if closed <= opened else (OPEN, "an opening", "openings")
    count = len(found[status])
    return count, min(closed, opened), f"{count} {many}" if count > 1 else one


def _not_turned(short: Point, outside: Point) -> Point:
    """Return an orbit with a short touch such that the parameter changes as along the branch without the touch.

    The length of the touch changes like the root of its height, so the rate of the parameter is lost in rounding.
    """
    rate, like = float(short.tangent[-1]), float(outside.tangent[-1])
    if rate * like >= 0.0 or abs(rate) > _ROUNDED or not short.chart.smooth(short.problem):
        return short
    return replace(short, tangent=np.append(short.tangent[:-1], -rate))


def _slope(family: Family, point: Point, values: Callable[[Any, Any, Array], Any]) -> Array:
    """Return the derivatives of values of problem, evaluation and coordinates along a branch, in scaled coordinates."""
    y = point.y + _DIFFERENCE * point.tangent * point.scales
    problem = family.of(y)
    evaluation = point.chart.evaluate(problem, y[:-1], derivative=False, near=point.evaluation)
    moved = values(problem, evaluation, y[:-1])
    return (np.asarray(moved) - values(point.problem, point.evaluation, point.y[:-1])) / _DIFFERENCE


def _turn(chart: Signature, phases: Array, contact: int, phase: float) -> int:
    """Return the switch at which a slider turns, the nearest to a phase."""
    mine = [k for k, (j, status) in enumerate(chart.switches) if j == contact and status > PINNED]
    mine = [k for k in mine if chart.statuses[k][contact] > PINNED]
    return min(mine, key=lambda k: abs(float(phases[k]) - phase))


def _away_along(family: Family, point: Point, marks: Sequence[Mark]) -> Array:
    """Return by how much an orbit moves away, along its branch, from those in which something begins at marks.

    These are the rates of the distances from gaps over their sizes, or of the margins of sliders.
    """
    chart = point.chart

    def away(problem: Any, evaluation: Any, y: Array) -> list[float]:
        phases, found = chart.phases(y), []
        z, _ = chart.modes_at(problem, evaluation, np.array([mark.phase for mark in marks]))
        for k, mark in enumerate(marks):
            contact, phase, turns = mark
            if turns:
                found.append(chart.margins(problem, evaluation)[_turn(chart, phases, contact, phase)])
                continue
            if _law(problem, contact) == "stick":
                found.append(-_nearest(evaluation, mark).height)
                continue
            above = float(problem.space.contacts[contact] @ z[:, k]) - float(problem.system.contacts.gap[contact])
            closed = chart.statuses[int(np.searchsorted(phases, phase))][contact] == CLOSED
            found.append((above if closed else -above) / float(point.evaluation.size_of(contact)))
        return found

    return _slope(family, point, away)


def _law(problem: Any, contact: int) -> str:
    """Return what a touch of a contact is: "stick" of a slider, "impact", or "jump" or "smooth" by its force."""
    sliders, laws = problem.course.sliders, problem.system.contacts
    if sliders is not None and contact >= sliders.first:
        return "stick"
    if laws.rigid[contact]:
        return "impact"
    return "jump" if laws.jump[contact] and laws.gap[contact] > 0.0 else "smooth"


def _among(chart: Signature, marks: Sequence[Mark], contact: int, phase: float) -> bool:
    return any(mark.contact == contact and chart.alike(mark.phase, phase) for mark in marks)


def _between(now: Point, after: Point, y: Array) -> None:
    """Raise where coordinates do not lie between two neighbours."""
    secant, away = (after.y - now.y) / now.scales, (y - now.y) / now.scales
    length = float(np.linalg.norm(secant))
    share = float(away @ secant) / length**2 if length > 0.0 else 0.0
    aside = float(np.linalg.norm(away - share * secant))
    if not -_BEHIND <= share * length <= (1.0 + _OUTSIDE) * length or aside > _ASIDE * length + 1e-9:
        raise ConvergenceError("a change of contact was found elsewhere")


def _along(now: Point, point: Point) -> Point:
    """Return a point with its tangent in the direction of a step."""
    return point if point.tangent @ now.tangent >= 0.0 else point.turned()


def _with_length(
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
