"""Folds, branch points, period doublings and Neimark-Sacker points between two neighbours on a branch.

If a multiplier crosses the unit circle between two neighbours, the numbers of multipliers outside the circle differ. If
a number changes by two, two crossings are searched. Two opposite crossings leave all numbers unchanged. They are
searched where a parabola through three orbits of the branch comes near zero, until its lowest point is known.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from vofem.errors import ConvergenceError
from vofem.studies.steady.between import Step, point_between
from vofem.studies.steady.census import (
    Census,
    Test,
    census,
    collision,
    counted,
    determinant,
    orientation,
    pair,
    pairs_at_one,
    real_at,
    stays_on_circle,
    turning,
)
from vofem.studies.steady.extended import Extended
from vofem.studies.steady.family import Family
from vofem.studies.steady.point import TOLERANCE, Point, derivative_by_value, tangent_at
from vofem.studies.steady.shorter import at_flip, repeats
from vofem.studies.steady.special import SpecialPoint, special_at

#: Kind, on the way, of the point at which a branch ends on orbits that repeat earlier.
SHORTER = "shorter"

#: A share of a step and the value of a test there.
_Place = tuple[float, float]

#: Evaluations of a test function in the search for its root, and the share of the step to which it is found.
_TRIES, _FINE = 60, 1e-12

#: Distance of two places, as a share of the step, between which the values of a test may differ by rounding alone.
_ROUGH = 1e-9

#: Largest portion of a bracket that is gone at once.
_MOST = 0.999

#: Values of a test that are zero, and the share of the step in which a value that stays large shows a jump.
_ZERO, _JUMP = 1e-14, 1e-7

#: A sign change counts as a root where the function is smaller there than this share of its ends: no pole, no jump.
_VANISHES = 1e-3

#: A parabola that falls below this share of the lowest of three values, or of the largest, makes it necessary to search
#: two steps.
_NEAR, _DEEP = 0.3, 0.05

#: Largest number of orbits that are computed there, and their least distance in terms of the longer step.
_LOOKS, _CLOSE = 16, 1e-8

#: Values of a test that are rounding, as those of conservative scenes, where multipliers come in reciprocal pairs.
_ROUNDING = 1e-9

#: How far a branch point may lie from where it was seen, in scaled coordinates.
_NEARBY = 1e-3

#: How near to a special point, as a share of its part of the step, its neighbours are compared, and how near to it the
#: parts on both sides begin; the first of these is taken at which it shows.
_BESIDE, _MARGINS = 0.02, (1e-6, 1e-4, 1e-2)

#: Shares at which a part is cut; the first of them at which an orbit is found. Touches of stiff contacts change most of
#: their length close to a grazing.
_CUTS = (0.5, 0.2, 0.8, 0.05, 0.95)

#: Parts of a step that are looked at, and the share of it that is not divided any more.
_MOST_PARTS, _NARROW = 60, 1e-6


@dataclass(frozen=True)
class _Part:
    """A part of a step, from one share of it to another."""

    step: Step
    low: float = 0.0
    high: float = 1.0

    def placed(self, found: list[SpecialPoint]) -> list[SpecialPoint]:
        """Return special points of this part with their share of the whole step."""
        return [replace(one, place=self.low + one.place * (self.high - self.low)) for one in found]

    def cut(self, family: Family, share: float) -> tuple[_Part, _Part]:
        """Return the parts on both sides of a share of this part."""
        middle = point_between(family, self.step, share)
        at = self.low + share * (self.high - self.low)
        return _Part(Step(self.step.first, middle), self.low, at), _Part(Step(middle, self.step.last), at, self.high)


def crossings(family: Family, step: Step) -> list[SpecialPoint]:
    """Return the special points of a step, in the order of the branch, that can be found from its two ends."""
    shorter = repeats(step.first, step.last)
    if shorter is not None:
        at = root(family, step, shorter)
        if at is not None:
            return [special_at(SHORTER, at_flip(family, at[0]), at[1])]
    return _found(family, step, None)


def hidden(
    family: Family, steps: tuple[Step, Step], known: tuple[set[str], set[str]]
) -> tuple[list[SpecialPoint], list[SpecialPoint]]:
    """Return opposite special points of two successive steps, which cannot be found from the ends of the steps.

    Along the three orbits at the ends of both steps every function that vanishes at a special point is compared with a
    parabola. Where this comes near zero without reaching it at any of the three, the lowest value is searched.

    `known`: kinds of special points that have been found in each of them, which are not searched again.
    Returns the special points of each of the two steps.
    """
    found: tuple[list[SpecialPoint], list[SpecialPoint]] = ([], [])
    for kinds, test in _tests(steps[0].last):
        place = _lowest(family, steps, test)
        if place is None:
            continue
        which = int(place > 0.0)
        if kinds & (known[which] | {one.kind for one in found[which]}):
            continue
        seen = _found(family, steps[which], place if which else 1.0 + place)
        found[which].extend(one for one in seen if one.kind in kinds)
    return found


def _tests(middle: Point) -> list[tuple[set[str], Test]]:
    """Return functions that change their sign at special points, and the kinds of these."""
    tests: list[tuple[set[str], Test]] = [({"fold", "branch_point"}, turning)]
    if middle.evaluation.multipliers is not None:
        at_one: list[tuple[set[str], Test]] = [({"fold", "branch_point"}, real_at(1.0))]
        tests += [
            *(at_one if middle.chart.segmented else []),
            ({"period_doubling"}, real_at(-1.0)),
            ({"neimark_sacker"}, pairs_at_one(middle)),
        ]
    return tests


def _found(family: Family, step: Step, cut: float | None) -> list[SpecialPoint]:
    """Return the special points of a step; each part of it that still shows a change beside them is looked at again."""
    parts = [_Part(step)]
    if cut is not None:
        with contextlib.suppress(ConvergenceError):
            parts = list(parts[0].cut(family, cut))
    found: list[SpecialPoint] = []
    for _ in range(_MOST_PARTS):
        if not parts:
            break
        part = parts.pop()
        if not (_turned(part.step) or _counted(part.step)):
            continue
        inside = sorted(_single(family, part.step), key=lambda one: one.place)
        found += part.placed(inside)
        if part.high - part.low > _NARROW:
            parts += _beside(family, part, inside)
    return sorted(found, key=lambda one: one.place)


def _beside(family: Family, part: _Part, found: list[SpecialPoint]) -> list[_Part]:
    """Return the parts before, between and after the special points of a part; two parts where it has none."""
    if not found:
        for share in _CUTS:
            with contextlib.suppress(ConvergenceError):
                return list(part.cut(family, share))
        return []
    try:
        # Beside a branch point the equations are nearly singular, and rounding is large.
        margins = {one.place: (_BESIDE,) if one.kind == "branch_point" else _MARGINS for one in found}
        known = {one.place: one.point for one in found}
        folds = [one.place for one in found if one.kind == "fold"]
        places = sorted(known)
        points, shares = [part.step.first], [0.0]
        for before, place, after in zip([0.0, *places[:-1]], places, [*places[1:], 1.0], strict=True):
            for margin in margins[place]:
                ends = place - min(margin, 0.5 * (place - before)), place + min(margin, 0.5 * (after - place))
                sides = [point_between(family, part.step, end, known, tolerance=TOLERANCE) for end in ends]
                # At a fold the branch turns and a multiplier passes 1, which rounding separates.
                shown = _turned(Step(*sides)), _counted(Step(*sides))
                if all(shown) or (any(shown) and place not in folds):
                    break
            points += sides
            shares += ends
    except ConvergenceError:
        return []
    points, shares = [*points, part.step.last], [*shares, 1.0]
    shares = [part.low + share * (part.high - part.low) for share in shares]
    return [
        _Part(Step(points[k], points[k + 1]), shares[k], shares[k + 1])
        for k in range(0, len(points), 2)
        if shares[k] < shares[k + 1]
    ]


def _turned(step: Step) -> bool:
    """Return whether a branch has another direction at the end of a step."""
    return turning(step.first) * turning(step.last) < 0.0


def _counted(step: Step) -> bool:
    """Return whether numbers of multipliers or, without them, the orientation tell of special points in a step."""
    changes = _changes(step)
    exact = changes is not None and step.first.chart.segmented
    return (changes is not None and any(changes[not exact :])) or (
        not exact and orientation(step.first) != orientation(step.last)
    )


def _directed(family: Family, point: Point) -> Point:
    """Return a point with the direction of the branch there, on the side of its tangent so far."""
    y, evaluation = point.y, point.evaluation
    by_value = derivative_by_value(family, point.chart, y, evaluation)
    return replace(point, by_value=by_value, tangent=tangent_at(evaluation, by_value, point.scales, point.tangent))


def _changes(step: Step) -> Census | None:
    """Return by how much the numbers of multipliers beyond the unit circle change; None where they are not known."""
    a, b = census(step.first), census(step.last)
    if a is None or b is None:
        return None
    plus, minus, pairs = (y - x for x, y in zip(a, b, strict=True))
    # If two real multipliers meet outside the circle and become a pair, none crosses the circle.
    if abs(plus) == 2 and pairs == -plus // 2:
        plus = pairs = 0
    if abs(minus) == 2 and pairs == -minus // 2:
        minus = pairs = 0
    return Census(plus, minus, pairs)


def _single(family: Family, step: Step) -> list[SpecialPoint]:
    """Return the special points of a step, that can be found from the numbers of multipliers at its ends."""
    found: list[SpecialPoint] = []
    changes = _changes(step)
    turned = _turned(step)
    if changes is None or not step.first.chart.segmented:
        # Multipliers by harmonic balance are not exact, so that the branch turns a little beside a multiplier 1.
        passed = int(orientation(step.first) != orientation(step.last))
        at_one = determinant(step.first)
    else:
        passed, at_one = changes.plus, real_at(1.0)
    if turned:
        found += _at_turn(family, step, passed % 2 == 1)
    elif passed:
        found += _located(family, step, "branch_point", at_one, passed, 0)
    if changes is not None:
        found += _located(family, step, "period_doubling", real_at(-1.0), changes.minus, 1)
        without_loss = stays_on_circle(step.first) and stays_on_circle(step.last)
        at_pair = collision if without_loss else pair
        found += _located(family, step, "neimark_sacker", at_pair, changes.pairs, 2)
    return found


def _located(family: Family, step: Step, kind: str, test: Test, change: int, which: int) -> list[SpecialPoint]:
    """Return the places at which multipliers pass the unit circle, one for each of them."""
    tests = [test]
    if abs(change) > 1:
        begin = census(step.first)
        assert begin is not None
        passed = np.sign(change) * (np.arange(abs(change)) + 0.5)
        tests = [counted(which, begin[which] + float(one)) for one in passed]
    found = [root(family, step, one) for one in (tests if change else [])]
    if kind == "branch_point":
        found = [None if at is None else (_exact(family, at[0]), at[1]) for at in found]
    return [special_at(kind, *at) for at in found if at is not None]


def _at_turn(family: Family, step: Step, passed: bool) -> list[SpecialPoint]:
    """Return the special point at which a branch turns: a fold, or a point at which it meets another branch.

    At a fold the determinant changes its sign with the direction of the branch. Where it does not, the branch comes
    back along mirrored orbits: another branch of orbits, mostly symmetric ones, passes there.
    """
    at = root(family, step, turning)
    if at is None:
        return []
    point, share = at
    if passed:
        return [special_at("fold", point, share)]
    low, high = share - _BESIDE * share, share + _BESIDE * (1.0 - share)
    try:
        beside = [point_between(family, step, near) for near in (low, high)]
    except ConvergenceError:
        return [special_at("fold", point, share)]
    if orientation(beside[0]) == orientation(beside[1]):
        return [special_at("branch_point", _exact(family, point), share)]
    # A fold; apart from it there is a branch point in the same step.
    return [special_at("fold", point, share)]


def _exact(family: Family, point: Point) -> Point:
    """Return a branch point solved as one; along a branch the equations become singular there, which spoils digits."""
    chart = Extended(point.chart, family, "branch_point", family.interval.size)
    try:
        found = chart.solved(np.concatenate([point.y[:-1], [0.0, point.value]]))
    except ConvergenceError:
        return point
    y = np.delete(found, -2)
    if np.linalg.norm((y - point.y) / point.scales) > _NEARBY:
        return point
    evaluation = point.chart.evaluate(family.of(y), y[:-1])
    by_value = derivative_by_value(family, point.chart, y, evaluation)
    return replace(point, y=y, problem=family.of(y), evaluation=evaluation, by_value=by_value)


# -- crossings that undo each other -------------------------------------------------------------------


def _lowest(family: Family, steps: tuple[Step, Step], test: Test) -> float | None:
    """Return where a test has another sign than at the ends of two steps that agree in it; None if there is none.

    Returns from -1 to 0 in the first step, up to 1 in the second one, each in proportion to its length.
    """
    first, second = steps
    lengths = first.length, second.length
    try:
        ends = [test(point) for point in (first.first, second.first, second.last)]
    except ConvergenceError:
        return None
    if not np.all(np.isfinite(ends)) or min(lengths) <= 0.0 or np.max(np.abs(ends)) <= _ROUNDING:
        return None
    sign = np.sign(ends[1])
    if sign == 0.0 or any(sign * end <= 0.0 for end in ends):
        return None
    # Places along the branch, as shares of the longer step.
    longest = max(lengths)
    known = dict(zip((-lengths[0] / longest, 0.0, lengths[1] / longest), (sign * end for end in ends), strict=True))
    if not _vertex(known).depth < max(_NEAR * min(known.values()), _DEEP * max(known.values())):
        return None
    for _ in range(_LOOKS):
        place = _next(known)
        if place is None or min(abs(place - other) for other in known) < _CLOSE:
            return None
        which = int(place > 0.0)
        share = place * longest / lengths[which] + (1 - which)
        try:
            value = sign * test(point_between(family, steps[which], share, tangent=test is turning))
        except ConvergenceError:
            return None
        if not np.isfinite(value):
            return None
        if value < 0.0:
            return share if which else share - 1.0
        known[place] = value
    return None


def _next(known: dict[float, float]) -> float | None:
    """Return the next place at which a negative value is searched between positive ones; None if there seems none.

    `known`: values by place.
    """
    found = _vertex(known)
    if not np.isfinite(found.depth):
        return None
    lowest = min(known, key=lambda place: known[place])
    # Zero may lie as far from the lowest one, by the parabola's bend. Neighbours farther off say less about it.
    width = float(np.sqrt(known[lowest] / found.bend))
    places = sorted(known)
    if abs(found.place - lowest) > 0.5 * width and found.depth <= _NEAR * known[lowest]:
        return found.place
    gaps = {
        sign: min((sign * (x - lowest) for x in places if sign * (x - lowest) > 0.0), default=0.0) for sign in (-1, 1)
    }
    side = max(gaps, key=lambda sign: gaps[sign])
    return lowest + 2.0 * side * width if gaps[side] > 4.0 * width else None


class _Vertex(NamedTuple):
    """The lowest point of a parabola: its place, its value, which is infinite where there is none, and its bend."""

    place: float
    depth: float
    bend: float


def _vertex(known: dict[float, float]) -> _Vertex:
    """Return the lowest point of the parabola through the lowest of some values and its neighbours."""
    places = sorted(known)
    k = min(max(int(np.argmin([known[place] for place in places])), 1), len(places) - 2)
    x = np.array(places[k - 1 : k + 2])
    y = np.array([known[place] for place in places[k - 1 : k + 2]])
    first, second = np.diff(y) / np.diff(x)
    bend = float((second - first) / (x[2] - x[0]))
    if bend <= 0.0:
        return _Vertex(np.nan, np.inf, bend)
    # Newton's form of the parabola through the middle and the first point.
    place = float(0.5 * (x[0] + x[1]) - 0.5 * first / bend)
    if not places[0] < place < places[-1]:
        return _Vertex(np.nan, np.inf, bend)
    return _Vertex(place, float(y[1] + (place - x[1]) * (first + bend * (place - x[0]))), bend)


# -- roots --------------------------------------------------------------------------------------------


def root(family: Family, step: Step, test: Test) -> tuple[Point, float] | None:
    """Return where a test function changes its sign, and its share of the step; None at a jump or a pole.

    Inverse quadratic interpolation is used where it is safe, and otherwise the bracket is halved (Chandrupatla, 1997).
    """
    try:
        ends = test(step.first), test(step.last)
    except ConvergenceError:
        return None
    if not np.all(np.isfinite(ends)) or ends[0] * ends[1] > 0.0:
        return None
    vanishes = _VANISHES * max(map(abs, ends))
    known: dict[float, Point] = {}
    # The newest place, the one on the other side of the root, and the one that was left out last, with their values.
    a, b, c = (0.0, ends[0]), (1.0, ends[1]), None
    settled = False
    try:
        for _ in range(_TRIES):
            width = abs(b[0] - a[0])
            jump = width <= _JUMP and min(abs(a[1]), abs(b[1])) > vanishes
            if width <= _FINE or jump or (settled and width <= _ROUGH):
                break
            moved = _portion(a, b, c) * width
            # A test that only touches zero beside its root is found out by a value on the other side.
            beside = a[0] in known and (settled or moved <= _FINE)
            share = a[0] + (min(_ROUGH, 0.5 * width) if beside else moved) * np.sign(b[0] - a[0])
            known[share] = point_between(family, step, share, known, tangent=test is turning)
            value = test(known[share])
            rounding = moved <= _ROUGH and abs(value) >= abs(a[1])
            if (value > 0.0) == (a[1] > 0.0):
                a, c = (share, value), a
                settled = not beside and (rounding or abs(value) <= _ZERO)
            else:
                a, b, c = (share, value), a, b
                settled = beside or rounding or abs(value) <= _ZERO
            if beside and abs(value) <= _ZERO:
                break
    except ConvergenceError:
        # At a branch point the equations are singular; an orbit beside it is better than none.
        pass
    found = [(abs(value), float(share)) for share, value in (a, b) if share in known]
    value, share = min(found, default=(np.inf, 0.0))
    if value > vanishes:
        return None
    return known[share] if test is turning else _directed(family, known[share]), share


def _portion(a: _Place, b: _Place, c: _Place | None) -> float:
    """Return the next place at which a root between a and b is searched, as a portion of the way from a to b."""
    if a[1] == b[1] or (c is not None and c[1] == b[1]):
        return 0.5
    if c is None:
        return a[1] / (a[1] - b[1])
    x, y = (a[0] - b[0]) / (c[0] - b[0]), (a[1] - b[1]) / (c[1] - b[1])
    if not 1.0 - np.sqrt(1.0 - x) < y < np.sqrt(x):
        return 0.5
    portion = a[1] / (b[1] - a[1]) * c[1] / (b[1] - c[1])
    portion += (c[0] - a[0]) / (b[0] - a[0]) * a[1] / (c[1] - a[1]) * b[1] / (c[1] - b[1])
    return float(min(max(portion, 0.0), _MOST))
