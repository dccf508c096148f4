"""Changes of an orbit's signature along a branch: what begins or ends, and switches that change their order."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.integrators.event_driven.pinned import PIN_FRACTION
from vofem.studies.steady.following.beside import (
    ASIDE,
    away_along,
    lasting_of,
    not_turned,
    orbit_beyond,
    orbit_inside,
    orbit_outside,
    slope_along,
    with_length,
)
from vofem.studies.steady.following.between import Step, point_between
from vofem.studies.steady.following.family import Family
from vofem.studies.steady.following.point import Point, level, point_at
from vofem.studies.steady.following.watched import (
    NEARLY,
    SAME,
    Change,
    Mark,
    Pair,
    is_end,
    is_over,
    lasting_at,
    mark_at,
    mark_of,
    newly_touching,
    paired,
    run_of,
    slips_between,
    spans_of,
    turns_between,
    vanished,
    watched_at,
)
from vofem.studies.steady.segments.gaps import ROUNDING, jumps, law_of, stops_of
from vofem.studies.steady.segments.near import polished
from vofem.studies.steady.segments.shooting import CLOSES
from vofem.studies.steady.segments.signature import Signature, States, signature_of
from vofem.studies.steady.segments.sticking import excess
from vofem.studies.steady.segments.switches import AT_ONCE, Edit
from vofem.system import PINNED

#: Rate at which an extreme moves away from its gap, over the size of the motion and in scaled coordinates, that may be
#: rounding.
_LEAVES = 1e-5

#: Share of a step beyond its end up to which a change may lie, and distance before its begin that is rounding.
_OUTSIDE, _BEHIND = 0.05, 1e-8

#: Share of a step up to which a change may be the one at which the step begins.
_AT_BEGIN = 1e-6

#: Changes that are located in one step at most, to find the first of them.
_MOST = 8

#: How many orbits inside a step are looked at where a change may hide.
_LOOKS = 4

#: Distance of an extreme from its gap over the size of the motion, in terms of the step, up to which it may reach the
#: gap inside the step; and a value inside, as a share of the smaller one at the ends, that leaves no doubt.
_REACH, _CLEAR = 0.1, 0.2

#: Distance up to which an extreme may have come past a switch, and by how much farther than where one vanishes an
#: orbit is looked at.
_BESIDE_GAP, _FARTHER = 1e-6, 0.1

#: Distance in scaled coordinates of orbits that rest at a gap after different numbers of touches, and least cosine of
#: the angle between their branches.
_RESTS, _STRAIGHT = 1e-4, 0.9


@dataclass(frozen=True)
class Passage:
    """A change of the signature."""

    before: Point  #: The last orbit with the old signature.
    at: Point  #: The orbit at the change.
    after: Point | None  #: The first orbit with the new signature; None where several branches may begin.
    grazed: tuple[int, ...]  #: Contacts that are grazed.


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


def _changes(now: Point, after: Point, without: Collection[Pair] = ()) -> list[Change]:
    """Return all changes of the signature between two neighbours, except of some pairs.

    Where they show none and an ordinary run does not repeat, its first touch is one.
    """
    # Beside a segment of negative length there are extremes that mean nothing.
    found = vanished(now, after, without) or newly_touching(now, after)
    return found if found or after.evaluation.repeats else newly_touching(now, after, run_of(after))


def _rested(point: Point) -> str:
    """Return which contacts a run lets rest at their gaps while the orbit touches them, as the end of a sentence."""
    laws, own, flow = point.problem.system.contacts, point.chart.switches, run_of(point)
    rests = {e.contact for e in flow.events if e.after == PINNED and law_of(point.problem, e.contact) == "jump"}
    names = [repr(laws.names[j]) for j in sorted(rests) if (j, PINNED) not in own]
    if not names:
        return ""
    return f": the run lets {' and '.join(names)} rest at the gap where touches are lower than {PIN_FRACTION:g} of it"


def _earliest(family: Family, now: Point, after: Point, found: Passage | None) -> Passage | None:
    """Return what is hidden before a change that was found, or before the second of two neighbours; else the change."""
    hidden = _hidden(family, now, after if found is None else found.before)
    return found if hidden is None else _first(family, now, *hidden)


def _hidden(family: Family, now: Point, after: Point, looks: int = _LOOKS) -> tuple[Point, list[Change]] | None:
    """Return an orbit between two neighbours and its changes, which are undone before the second neighbour."""
    share = _lowest(family, now, after) if looks and isinstance(now.chart, Signature) else None
    if share is None:
        return None
    middle = point_between(family, Step(now, after), share)
    changes = vanished(now, middle) or newly_touching(now, middle)
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
    inside = [slice(p + 1, last + 1) for (p, _), last in spans_of(now.problem, chart).items()]
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
    # One close to its gap, which moves towards it, may have come past a switch.
    halfway = 0.5 if np.any((heights > -_BESIDE_GAP) & (rates * [[1.0], [-1.0]] < 0.0) & ~whole) else None
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

    Heights of sliders that turn are their margins, below zero.
    They are NaN where one is at the other end alone. `along`: factors of the derivatives along the branch.
    """
    extremes = paired(*(point.evaluation.extremes for point in ends))
    pairs = [tuple(None if e is None else (mark_at(e), e.height) for e in pair) for pair in extremes]
    pairs += [
        tuple((mark_of(one.chart, one.y, k), -one.evaluation.margins[k][0]) for one in ends)
        for k in ends[0].evaluation.margins
    ]
    near = []
    for pair in pairs:
        mark, height = max((one for one in pair if one is not None), key=itemgetter(1))
        # A force whose extreme is gone at one end may have changed much.
        alone = None in pair and law_of(ends[0].problem, mark.contact) == "stick"
        if height >= (min(least, -_REACH) if alone else least):
            near.append(pair)
    pairs = near
    found = np.full((2, 2, len(pairs)), np.nan)
    for k, point in enumerate(ends):
        mine = [(number, pair[k]) for number, pair in enumerate(pairs)]
        known = {number: one for number, one in mine if one is not None}
        new = [mark for mark, _ in known.values() if mark not in point.leaving]
        if new:
            point.leaving.update(zip(new, away_along(family, point, new), strict=True))
        for number, (mark, height) in known.items():
            found[:, k, number] = height, along[k] * point.leaving[mark]
    return found[0], found[1]


def _first(family: Family, now: Point, after: Point, changes: list[Change]) -> Passage:
    """Return the first of some changes of the signature between two neighbours, and of those that come before it."""
    last, pairs = after, tuple[Pair, ...]()
    for _ in range(_MOST):
        change = min(changes, key=lambda one: one.share)
        if pairs and change.pairs and change.share >= 1.0 - SAME:
            # Of two that end at one orbit, the first orbit beside it with one of them may lack the other.
            change = change._replace(pairs=(*change.pairs, *pairs))
        found, pairs = _located(family, now, last, change)
        last = found.before
        changes = _changes(now, last, pairs)
        if not changes:
            inner = last if pairs else found.after
            # Where forces jump, what they do to rounding grows without bound at a grazing, but not beside it.
            one = found.at if inner is not None and inner.chart.smooth(inner.problem) else inner
            # Where switches happen at one time a run may take them in another order.
            reorders = bool(pairs) and not is_end(now.chart, pairs[0])
            if one is not None and not (one.evaluation.closes if reorders else one.evaluation.repeats):
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
    touches, spans = chart.touches, spans_of(now.problem, chart)
    ahead = {
        (p, k): float(lengths[p + 1 : last + 1].sum() / -rates[p + 1 : last + 1].sum())
        for (p, k), last in spans.items()
        if (p, k) in touches and 0.0 < lengths[p + 1 : last + 1].sum() < NEARLY and rates[p + 1 : last + 1].sum() < 0.0
    }
    if not ahead:
        return None
    first = min(ahead.values())
    after = replace(now, y=now.y + 1.1 * first * now.tangent * now.scales)
    pairs = tuple(pair for pair, distance in ahead.items() if distance <= (1.0 + SAME) * first)
    found = _first(family, now, after, [Change(1.0 / 1.1, pairs)])
    away = float(np.linalg.norm((found.before.y - now.y) / now.scales))
    if found.after is None or away > 10.0 * NEARLY or abs(found.at.value - now.value) > NEARLY * family.interval.size:
        raise ConvergenceError("a change of contact was found elsewhere")
    return _earliest(family, now, after, found)


def resting(family: Family, now: Point, guess: Array, *, stick: bool = False) -> Passage | None:
    """Return the orbit at a guess ahead with the switches of an ordinary run there, of which some are rests at a gap.

    Under the displacement law touches become shorter without end, and a run lets a contact rest after some of them.
    Where their number changes, the orbits on both sides differ by less than such a touch does. So they do where a body
    that rests at a rigid stop begins to leave it for a moment. None where no contact rests, where another contact
    touches, and where the orbit belongs to another branch.

    `stick`: whether it is sliders that rest.
    """
    chart, problem, n = now.chart, family.of(guess), now.problem.size
    new, y, found = chart, guess[:-1], None
    for _ in range(_MOST):
        if found is not None and found.repeats:
            break
        old = new.switches
        new, y = signature_of(problem, new.flow(problem, y))
        every = [chart.switches, new.switches]
        rests = {law_of(problem, s.contact) == "stick" for one in every for s in one if s.status == PINNED}
        touching = [{s.contact for s in one} for one in every]
        if stick not in rests or new.switches == old or touching[0] != touching[1]:
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
    # Just beyond the grazing at which an impact begins, the motion changes against its trend.
    trend = along * now.tangent[-1] * inner.tangent[-1]
    if np.linalg.norm(away - own) > _RESTS or abs(along) < _STRAIGHT or trend < 0.0:
        return None
    return Passage(now, inner, inner if along > 0.0 else inner.turned(), ())


def _located(family: Family, now: Point, after: Point, change: Change) -> tuple[Passage, tuple[Pair, ...]]:
    """Return a change of the signature, and the switches of what ends there."""
    old: Signature = now.chart
    pairs, guess = change.pairs, now.y + change.share * (after.y - now.y)
    near = now if change.share < 0.5 else after
    if change.begins is not None:
        if change.share <= _AT_BEGIN and away_along(family, now, [change.begins])[0] > 0.0:
            # It has just been grazed, leaves the gap, and comes back within the step.
            raise ConvergenceError("a contact leaves its gap and comes back in one step")
        outer, every = orbit_outside(family, old, guess, change.begins, now.tangent, near.evaluation)
        _between(now, after, outer.y)
        outer = _along(now, outer)
        return Passage(outer, outer, orbit_inside(family, outer, every), _contacts(every)), ()
    if not is_end(old, pairs[0]):
        return _reordered(family, now, after, guess, change, near.evaluation)
    phases = old.phases(guess[:-1])
    gone = sorted({index for p, k in pairs for index in _gone(now.problem, old, p, k)})
    during = {pair: stop for pair in pairs for stop in stops_of(now.problem, old) if pair[0] < stop.first < pair[1]}
    middles = [
        Mark(
            old.switches[k].contact,
            float(phases[during[p, k].first] if (p, k) in during else 0.5 * (phases[p] + phases[k])),
            turns_between(old, p, k) and old.switches[p].status == PINNED,
            old.hit_between(p, k),
        )
        for p, k in pairs
    ]
    out, y, _ = old.edited(guess[:-1], gone)
    upwards = np.append(np.zeros(y.size), 1.0)
    begins = old.begins_of(near.evaluation, gone)
    outer, every = orbit_outside(family, out, np.append(y, guess[-1]), middles[0], upwards, begins)
    ended: list[Mark] = []
    for contact, middle, turns, _ in middles:
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
    slips = [pair for pair in pairs if slips_between(old, *pair)]
    if not slips:
        _between(now, after, zero)
    groups: list[Pair] = []
    for p, k in sorted(pairs):
        if groups and p < groups[-1][1]:
            groups[-1] = groups[-1][0], max(groups[-1][1], k)
        else:
            groups.append((p, k))
    # What slides or sticks for a short time does so in the step; how short depends on its neighbours.
    ends = [lasting_at(one) for one in (now, after)] if slips else []
    # Only what comes before the switch that happens meanwhile has a length that is given.
    lengths = old.lengths(now.y[:-1])
    shares = {(p, k): float(lengths[p + 1] / lengths[p + 1 : k + 1].sum()) for p, k in slips}
    most = min((0.5 * shares[pair] * sum(max(one[pair], 0.0) for one in ends) for pair in slips), default=np.inf)
    begun = [lasting_of(now.problem, old, p, k) for p, k in groups]
    inner = orbit_beyond(family, old, zero, begun, near.evaluation, most)
    if inner is None:
        raise ConvergenceError("what ends at a grazing does not do so in one direction of the branch")
    if slips:
        _between(now, after, inner.y)
    before, values = inner.turned(), watched_at(now)
    nearer = watched_at(before)
    if any(not 0.0 < nearer[pair][0] < values[pair][0] for pair in pairs):
        before = now
    if _opposed(family, before, outer, ended[0]):
        outer = outer.turned()
    others = [mark for mark in every if mark not in ended]
    laws = {law_of(now.problem, mark.contact) for mark in others}
    beyond: Point | None = outer
    if laws & {"impact", "smooth"}:
        # Those that touched no longer do, and those that did not begin to: so this branch crosses that without touches.
        beyond = None if "impact" in laws else orbit_inside(family, outer, others)
    return Passage(not_turned(before, outer), outer, beyond, _contacts(every)), pairs


def _opposed(family: Family, before: Point, outer: Point, ended: Mark) -> bool:
    """Return whether the orbit outside has the direction from which a branch comes, and not that in which it goes on.

    The branch goes on where what has ended moves away. Where that is rounding, and forces are smooth, states change
    evenly through a grazing; beside a stiff contact they do so within a length that is rounding only.
    """
    away = float(away_along(family, outer, [ended])[0])
    if law_of(outer.problem, ended.contact) != "smooth" or abs(away) > _LEAVES:
        return away < 0.0
    own = [*range(outer.problem.size), -1]
    come, gone = ((point.tangent * point.scales)[own] / outer.scales[own] for point in (before, outer))
    return bool(come @ gone < 0.0)


def _contacts(marks: Sequence[Mark]) -> tuple[int, ...]:
    return tuple(sorted(mark.contact for mark in marks))


def _reordered(
    family: Family, now: Point, after: Point, guess: Array, change: Change, near: Any
) -> tuple[Passage, tuple[Pair, ...]]:
    """Return the orbit in which switches happen at one time and one beyond it, and the pairs of which this is so.

    Beyond, they do so in another order, or one of them at once by the jump of a force at the other, or no longer so.
    """
    chart, n, share, pairs = now.chart, now.problem.size, change.share, change.pairs
    p, k = pairs[0]
    if share <= _AT_BEGIN and _grows(family, now, (p, k)):
        raise ConvergenceError("switches change their order and change it back in one step")
    if chart.switches[k].at_once:
        # The orbit in which it happens without a jump at the same time.
        alone, y, (number,) = chart.edited(guess[:-1], *_no_longer(chart, (p, k), guess[:-1]))
        zero = number + int(p != k)
        begins = chart.begins_of(near, *_no_longer(chart, (p, k), near.y))
        found = with_length(family, alone, np.append(y, guess[-1]), n + zero, 0.0, begins)
        y, states = (np.delete(x, i, axis=0) for x, i in ((found.y, n + zero), (found.evaluation.states, zero + 1)))
        y, states = np.insert(y, n + k, 0.0), np.insert(states, k + 1, states[k], axis=0)
        at = point_at(family, chart, y, now.tangent, near=States(y[:-1], states))
    else:
        at = with_length(family, chart, guess, n + k, 0.0, near)
    _between(now, after, at.y)
    there = watched_at(at)
    reordered = tuple(pair for pair in pairs if pair == (p, k) or abs(there[pair][0]) <= there[pair][1])
    for pair in reordered:
        _check_impacts(at, pair)
    (first, *_), edits = zip(*(_reorder(at, pair) for pair in reordered), strict=True)
    gone, added = (list(chain.from_iterable(parts)) for parts in zip(*edits, strict=True))
    new, y, numbers = chart.edited(at.y[:-1], gone, added)
    y[[n + j for j, switch in enumerate(new.switches) if switch.at_once]] = 0.0
    # What vanishes at this orbit grows beyond it: a time before a switch, or a force beyond its limit.
    towards, begins = level(y.size + 1), None
    if all(max(chart.struck[i] for i in pair) < 0 for pair in reordered):
        # An impact that comes earlier changes the states in which others happen.
        begins = chart.begins_of(at.evaluation, gone, added)
    number = numbers[first.which] + first.later
    if not first.force:
        towards = np.zeros(y.size + 1)
        towards[n + number] = 1.0
    beyond = point_at(family, new, np.append(y, at.value), towards, near=begins)
    if first.force and not _grows(family, beyond, (new.causes[number] if first.force == "before" else number, number)):
        beyond = beyond.turned()
    return Passage(_along(now, at), at, beyond, ()), reordered


def _grows(family: Family, point: Point, pair: Pair) -> bool:
    """Return whether the time between two switches grows, or the force of one at once beyond its limit."""
    chart, (p, k) = point.chart, pair
    if not chart.switches[k].at_once:
        return bool(chart.rates(point.tangent * point.scales)[p + 1 : k + 1].sum() > 0.0)
    slope = slope_along(family, point, lambda _problem, evaluation, _y: [evaluation.caused[pair][0]])
    return bool(slope[0] > 0.0)


class _Place(NamedTuple):
    """What vanishes where switches are reordered: the length before one that is added, or before a later one."""

    which: int = 0
    later: int = 0
    force: str = ""  #: That of a release at once instead, "before" or "after" its cause.


def _no_longer(chart: Signature, pair: Pair, y: Array) -> Edit:
    """Return what `Signature.edited` needs for a release that comes a time after its cause, or before."""
    p, k = pair
    return [k], [(p, float(chart.phases(y)[p]), chart.switches[k]._replace(at_once=False))]


def _reorder(at: Point, pair: Pair) -> tuple[_Place, Edit]:
    """Return what `Signature.edited` needs where two switches, or a release at once, leave their order."""
    (p, k), chart, problem = pair, at.chart, at.problem
    s = chart.switches
    if s[k].at_once:
        return _Place(later=int(p != k)), _no_longer(chart, pair, at.y[:-1])
    cause, moved, phase = chart.causes[p], chart.together(k), float(chart.phases(at.y[:-1])[k])
    before = [int(chart.statuses[j][s[j].contact]) for j in (cause, k)]
    if before[0] != PINNED and before[1] == PINNED and jumps(problem, chart, cause):
        return _Place(force="after"), ([k], [(k, phase, s[k]._replace(at_once=True))])
    if before[0] == PINNED and before[1] != PINNED and cause == p and jumps(problem, chart, k):
        return _Place(force="before"), ([p], [(moved.stop, phase, s[p]._replace(at_once=True))])
    let_go = [j for j in moved if s[j].contact == s[p].contact]
    if s[p].status == PINNED and cause == p and let_go:
        # What stopped before and was let go of at once turns instead.
        return _Place(), ([p, *let_go], [(moved.stop, phase, s[let_go[0]]._replace(at_once=False))])
    if min(before[1], s[k].status) > PINNED and jumps(problem, chart, cause):
        stuck, time = chart.statuses[cause].copy(), float(at.evaluation.path.times[k])
        stuck[s[k].contact] = PINNED
        if excess(problem, stuck, time, at.evaluation.path.starts[k], *s[k][:2])[0] < 0.0:
            # It does not turn before the other switch, but stops, and that one lets it go.
            added = [(cause, phase, s[k]._replace(status=PINNED)), (k, phase, s[k]._replace(at_once=True))]
            return _Place(later=1), ([k], added)
    return _Place(which=len(moved) - 1, later=1), ([*moved], [(cause, phase, s[j]) for j in moved])


def _check_impacts(at: Point, pair: Pair) -> None:
    """Raise where an impact happens at the same time as another one, or turns what the other contact does."""
    chart: Signature = at.chart
    p, k = pair
    hits = [j for j in pair if chart.struck[j] >= 0]
    if chart.switches[k].at_once or not hits:
        return
    rows = at.problem.space.contacts
    one, other = (rows[chart.switches[j].contact] for j in (p, k))
    if abs(one @ other) <= ROUNDING * float(np.linalg.norm(one) * np.linalg.norm(other)):
        return
    if len(hits) == 2:
        raise ConvergenceError(
            "two impacts happen at the same time, of bodies that move each other; beyond, their order is another one, "
            "and so is the motion"
        )
    (hit,), path, n = hits, at.evaluation.path, at.problem.space.size
    row = rows[chart.switches[p + k - hit].contact]
    if float(row @ path.ends[hit, n:]) * float(row @ path.begins[hit + 1, n:]) <= 0.0:
        raise ConvergenceError(
            "an impact happens at the same time as another contact opens or closes, and turns the motion there; "
            "beyond, this contact does something else"
        )


def _gone(problem: Any, chart: Signature, p: int, k: int) -> list[int]:
    """Return the switches that the orbit outside does not have, of what ends between two of them."""
    if law_of(problem, chart.switches[k].contact) != "stick":
        return [p, k]
    if k != p + 1 and not is_over(chart, p, k):
        raise ConvergenceError("a slider ceases to stick while contacts switch")
    return [p] if turns_between(chart, p, k) else [p, k]


def _between(now: Point, after: Point, y: Array) -> None:
    """Raise where coordinates do not lie between two neighbours."""
    secant, away = (after.y - now.y) / now.scales, (y - now.y) / now.scales
    length = float(np.linalg.norm(secant))
    share = float(away @ secant) / length**2 if length > 0.0 else 0.0
    aside = float(np.linalg.norm(away - share * secant))
    if not -_BEHIND <= share * length <= (1.0 + _OUTSIDE) * length or aside > ASIDE * length + 1e-9:
        raise ConvergenceError("a change of contact was found elsewhere")


def _along(now: Point, point: Point) -> Point:
    """Return a point with its tangent in the direction of a step."""
    return point if point.tangent @ now.tangent >= 0.0 else point.turned()
