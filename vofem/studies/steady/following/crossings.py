"""Folds, branch points, period doublings and Neimark-Sacker points between two neighbours on a branch.

If a multiplier crosses the unit circle between two neighbours, the numbers of multipliers outside the circle differ,
and the root of a function of the multipliers is found. A multiplier that crosses the circle and returns leaves these
numbers unchanged. The error of multipliers between two neighbours is therefore controlled as that of an integration is:
where it is not small compared with their distance from the circle, the step is cut. It is cut at its special points
too, and all parts are examined alike.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from vofem.arrays import Array, Complex
from vofem.errors import ConvergenceError
from vofem.studies.steady.following.between import Step, point_between
from vofem.studies.steady.following.census import (
    ON_CIRCLE,
    Census,
    Test,
    census,
    collision,
    counted,
    counts_of,
    critical,
    determinant,
    logarithms,
    matched,
    multipliers,
    orientation,
    pair,
    pair_on_circle,
    real_at,
    turning,
)
from vofem.studies.steady.following.extended import Extended
from vofem.studies.steady.following.family import Family
from vofem.studies.steady.following.point import Point, corrected, point_at
from vofem.studies.steady.following.shorter import at_flip, repeats
from vofem.studies.steady.special import SpecialPoint, special_at

#: Kind, on the way, of the point at which a branch ends on orbits that repeat earlier.
SHORTER = "shorter"

#: A share of a step and the value of a test there.
_Place = tuple[float, float]

#: Evaluations of a test function in the search for its root, and how near it is found, in scaled coordinates.
_TRIES, _FINE = 60, 1e-12

#: Shares of a step that a bracket and a move in it have at most where values that do not fall are rounding.
_NARROWED, _MOVED = 1e-2, 1e-4

#: Distance in scaled coordinates from a root at which the sign on its other side is looked for at first, and the one up
#: to which a change of sign there tells its place.
_OTHER, _CLOSE = 1e-11, 1e-9

#: How much farther the sign on the other side is looked for each time, and by how much values may rise there.
_FARTHER = 10.0

#: Largest portion of a bracket that is gone at once.
_MOST = 0.999

#: The share of the step in which a value shows a jump that stays so large.
_JUMP, _STAYS = 1e-4, 0.1

#: The share of the way to a corner by which it is approached.
_NEARER = 0.9

#: Distance of a special point from an end of a part, as a share of it, up to which it is that end.
_AT_END = 1e-9

#: A sign change counts as a root where the function is smaller there than this share of its ends: no pole, no jump. The
#: share for the rate of the parameter at a turn.
_VANISHES, _NEARLY_LEVEL = 1e-3, 2e-2

#: How far a branch point may lie from where it was seen, in scaled coordinates.
_NEARBY = 1e-3

#: How near to a turn of the branch, as a share of the step, its neighbours are compared, and the widest bracket of a
#: root where no further orbit is found.
_BESIDE = 0.02

#: Shares at which a part is cut; the first of them at which an orbit is found. Touches of stiff contacts change most of
#: their length close to a grazing.
_CUTS = (0.5, 0.2, 0.8, 0.05, 0.95)

#: Parts of a step that are looked at, and the length of one, in scaled coordinates, at which rounding decides.
_MOST_PARTS, _NARROW = 500, 1e-9

#: Distance from a branch point, where the equations are singular, up to which rounding decides about a multiplier at 1
#: and where the branch turns, and the length of a part there that is not cut.
_SINGULAR, _UNCUT = 1e-4, 1e-5

#: Error of a prediction that is allowed, as a share of the distance from the unit circle.
_ALLOWED = 0.3

#: Sine of the angle of a multiplier up to which it may meet its conjugate and leave the circle along the real axis, and
#: the share of a step in which this is looked for.
_NEAR_AXIS, _MEETS = 0.2, 0.1

#: Least cosine of the angle between the direction of an orbit within a part and the way from end to end.
_ALONG = 0.9

#: Rate of the parameter along the branch, as a share of that of the motion, that is rounding.
_LEVEL = 1e-12

#: Share of a step within which several multipliers may pass the unit circle at one place. In longer parts they are
#: parted by cuts: two that meet outside change the numbers too.
_TOGETHER = 0.1

#: Weight of a single real multiplier that crosses the circle, against pairs that do so and become real outside.
_ODD = 10

#: Entries of `Census` that change at special points.
_WHICH = {"fold": 0, "branch_point": 0, "period_doubling": 1, "neimark_sacker": 2}


@dataclass(frozen=True)
class _End:
    """An orbit at an end of a part of a step, and on which side of special points it counts.

    `place`: share of the step.
    `kind`: of a special point, or empty.
    `heading`: sign of the parameter's rate along the branch.
    `orientation`: of the Jacobian matrix, where numbers of multipliers are not exact.
    """

    point: Point
    place: float
    counts: Census | None
    heading: float
    orientation: float
    logarithms: Complex
    kind: str = ""

    @property
    def at_one(self) -> bool:
        """Whether it is a special point at which a multiplier is 1."""
        return _WHICH.get(self.kind) == 0


def crossings(family: Family, step: Step, earlier: Step | None, notes: list[str]) -> list[SpecialPoint]:
    """Return the special points of a step, in the order of the branch; `earlier` is the step before it, if known.

    A step that is not examined to its end is told in `notes`.
    """
    shorter = repeats(step.first, step.last)
    if shorter is not None:
        at = root(family, step, shorter)
        if at is not None:
            return [special_at(SHORTER, at_flip(family, at[0]), at[1])]
    parts = [(_end(step.first, 0.0), _end(step.last, 1.0))]
    known = list(parts[0])
    if earlier is not None:
        known.append(_end(earlier.first, -earlier.length / step.length))
    found, missing = list[SpecialPoint](), False
    for _ in range(_MOST_PARTS):
        if not parts:
            break
        low, high = parts.pop(0)
        branched = [one for one in known if one.kind == "branch_point"]
        apart = high.place - low.place > _TOGETHER and max(map(abs, _changes(low.counts, high.counts) or (0,))) > 1
        inside = [] if apart else _single(family, low, high)
        ends = list(_sides(low, high, inside))
        singular = all(_beside(end, branched, step.length) for end in (low, high))
        long = (high.place - low.place) * step.length > (_UNCUT if singular else _NARROW)
        if not inside and long and ((differs := _differs(low, high)) or _doubtful(known, low, high)):
            ends = _cut(family, low, high)
            missing |= differs and not ends
        ends = [_as_beside(end, branched, step.length) for end in ends]
        found += inside
        known += ends
        if ends:
            ends = [low, *ends, high]
            parts += list(zip(ends[::2], ends[1::2], strict=True))
    if parts or missing:
        begin, end = sorted((step.first.value, step.last.value))
        notes.append(
            f"special points between {begin:.12g} and {end:.12g} may be missing: multipliers or orbits change too "
            "quickly there; follow this interval alone with a smaller max_step= to find them"
        )
    return sorted(found, key=lambda one: one.place)


def hidden_beside(before: Point, after: Point) -> bool:
    """Return whether multipliers pass the unit circle between a grazing and the first orbit with its touch.

    Where forces do not jump, multipliers before and beyond a grazing are the same.
    """
    changes = _changes(census(before), census(after))
    return changes is not None and any(changes)


def _end(point: Point, place: float) -> _End:
    """Return an orbit as an end of two parts."""
    exact = point.chart.segmented
    rate = turning(point)
    # Where a touch is very short, nearly all of the direction is its length, and not the motion.
    moves = float(np.linalg.norm(np.append(point.tangent[: point.problem.size], rate)))
    sides = float(np.sign(rate)) if abs(rate) > _LEVEL * moves else 0.0, 0.0 if exact else orientation(point)
    return _End(point, place, census(point), *sides, logarithms(point))


def _differs(low: _End, high: _End) -> bool:
    """Return whether the ends of a part tell of special points in it.

    Beside a fold or a branch point rounding separates the turn of the branch from the multiplier that passes 1.
    """
    changes = _changes(low.counts, high.counts)
    turned = low.heading * high.heading < 0.0
    if changes is None or not low.point.chart.segmented:
        turned |= low.orientation != high.orientation
        return turned or (changes is not None and any(changes[1:]))
    if low.at_one or high.at_one:
        return any(changes[changes.plus % 2 :])
    return turned or any(changes)


def _sides(low: _End, high: _End, found: list[SpecialPoint]) -> Iterator[_End]:
    """Return every special point of a part as the end of the part before it and as the begin of the one after it.

    The multiplier that is on the unit circle there counts once on each side of it.
    """
    size, turned = high.place - low.place, low.heading * high.heading < 0.0
    for one in found:
        if not low.place + _AT_END * size < one.place < high.place - _AT_END * size:
            continue
        end = replace(_end(one.point, one.place), kind=one.kind)
        passes = not (turned and one.kind == "branch_point")
        heading = -low.heading if turned and end.at_one else low.heading
        side = -low.orientation if passes and end.at_one else low.orientation
        before = replace(end, heading=low.heading, orientation=low.orientation)
        after = replace(before, heading=heading, orientation=side)
        if low.counts is not None and end.counts is not None:
            values = multipliers(one.point)
            at = critical(values, one.kind)
            rest = counts_of(np.delete(values, at))
            name = Census._fields[_WHICH[one.kind]]
            ways = [rest._replace(**{name: getattr(rest, name) + more}) for more in (0, 1)]
            nearest = int(_unlikely(low.counts, ways[1]) < _unlikely(low.counts, ways[0]))
            on_circle = end.logarithms.copy()
            on_circle[at] = 1j * on_circle[at].imag
            before = replace(before, counts=ways[nearest], logarithms=on_circle)
            after = replace(after, counts=ways[1 - nearest if passes else nearest], logarithms=on_circle)
        yield before
        yield after
        low = after


def _beside(end: _End, branched: list[_End], length: float) -> list[_End]:
    """Return the records of branch points beside an end in a step of some length, which may be the end itself."""
    return [one for one in branched if abs(end.place - one.place) * length <= _SINGULAR]


def _as_beside(end: _End, branched: list[_End], length: float) -> _End:
    """Return an end with what is known of its side of a branch point beside it."""
    near = [] if end.at_one else _beside(end, branched, length)
    if not near:
        return end
    # Of the records before and after a branch point, that of this side.
    at = min(near, key=lambda one: abs(end.place - one.place)).place
    side = [one for one in near if one.place == at][0 if end.place < at else -1]
    counts = end.counts
    if counts is not None and side.counts is not None:
        counts = counts._replace(plus=side.counts.plus)
    return replace(end, counts=counts, heading=side.heading, orientation=side.orientation)


def _unlikely(a: Census, b: Census) -> int:
    """Return the number of crossings between two ends; one of a real multiplier would have been found as a root."""
    changes = _changes(a, b)
    assert changes is not None
    return sum(map(abs, changes)) + _ODD * (changes.plus % 2 + changes.minus % 2)


def _cut(family: Family, low: _End, high: _End) -> list[_End]:
    """Return an orbit within a part, as the end of one part and the begin of the other; nothing if none is found."""
    step = Step(low.point, high.point)
    for share in _CUTS:
        with contextlib.suppress(ConvergenceError):
            middle = point_between(family, step, share)
            if middle.tangent @ step.secant < _ALONG * step.length:
                continue  # Along another branch that leaves between the two.
            return [_end(middle, low.place + share * (high.place - low.place))] * 2
    return []


def _doubtful(known: list[_End], low: _End, high: _End) -> bool:
    """Return whether multipliers may cross the unit circle, or the branch may turn, and come back within a part."""
    if _may_return(known, low, high):
        return True
    # By harmonic balance a branch turns beside the orbit whose multiplier is 1, which is one of shooting.
    return not low.point.chart.segmented and _may_return(
        [_by_rate(end) for end in known], _by_rate(low), _by_rate(high)
    )


def _by_rate(end: _End) -> _End:
    """Return an end that is watched by the rate of the parameter; it vanishes where the branch turns."""
    rate = turning(end.point)
    return replace(end, logarithms=np.array([rate if abs(rate) > ON_CIRCLE else 0.0], dtype=complex))


def _may_return(known: list[_End], low: _End, high: _End) -> bool:
    """Return whether what is watched may cross the unit circle and come back within a part.

    How far logarithms are from the chord in the middle of the part is estimated by second divided differences with the
    next orbits that are known on both sides of the part.
    """
    if low.logarithms.size != high.logarithms.size:
        return False
    size, a, b = high.place - low.place, low.logarithms, matched(low.logarithms, high.logarithms)
    known = [one for one in known if one.logarithms.size == a.size]
    before = max((one for one in known if one.place < low.place), key=lambda one: one.place, default=None)
    beyond = min((one for one in known if one.place > high.place), key=lambda one: one.place, default=None)
    # One that crosses is found beforehand, unless another one crosses the other way.
    nearest = np.minimum(np.abs(a.real), np.abs(b.real))
    # Angles of fast modes tell nothing, however short the part: they turn by many times 2 pi in a step.
    meets = (np.maximum(np.abs(np.sin(a.imag)), np.abs(np.sin(b.imag))) <= _NEAR_AXIS) & (size > _MEETS)

    def size_of(change: Complex) -> Array:
        return np.where(meets, np.abs(change), np.abs(change.real))

    error = size_of(0.5 * (b - a)) if before is beyond is None else np.zeros(a.size)
    for one, end, here in ((before, low, a), (beyond, high, b)):
        if one is not None:
            slope = (matched(here, one.logarithms) - here) / (one.place - end.place)
            # Farther away than the part is long nothing is known of where the slope changes. Parts of any lengths meet
            # at a fold or a branch point, beside which it changes evenly.
            away = abs(one.place - end.place)
            away = size + (away if end.at_one else min(away, size))
            error = np.maximum(error, size_of(0.25 * ((b - a) / size - slope) * size**2 / away))
    across = np.where(nearest > ON_CIRCLE, 0.0, np.abs(b.real - a.real))
    distance = np.where(a.real * b.real <= 0.0, across, nearest)
    # Without damping pairs stay on the circle, up to rounding.
    off = (np.abs(np.sin(a.imag)) < ON_CIRCLE) | (np.maximum(np.abs(a.real), np.abs(b.real)) > ON_CIRCLE)
    return bool(np.any(off & (error > _ALLOWED * distance)))


def _changes(a: Census | None, b: Census | None) -> Census | None:
    """Return by how much the numbers of multipliers beyond the unit circle change; None where they are not known."""
    if a is None or b is None:
        return None
    plus, minus, pairs = (y - x for x, y in zip(a, b, strict=True))
    # If two real multipliers meet outside the circle and become a pair, none crosses the circle.
    if abs(plus) == 2 and pairs == -plus // 2:
        plus = pairs = 0
    if abs(minus) == 2 and pairs == -minus // 2:
        minus = pairs = 0
    return Census(plus, minus, pairs)


def _single(family: Family, low: _End, high: _End) -> list[SpecialPoint]:
    """Return the special points of one kind in a part that its ends tell of, in the order of the branch.

    Others are found in the parts between them: a fold may bring a second real multiplier outside, with which another
    one becomes a pair, and none of this pair passes the circle.
    A part that begins or ends at a point of the same kind is cut before, because a function is zero there.
    """
    found: list[SpecialPoint] = []
    step, changes = Step(low.point, high.point), _changes(low.counts, high.counts)
    known = {_WHICH[end.kind] for end in (low, high) if end.kind}
    turned = low.heading * high.heading < 0.0
    exact = changes is not None and step.first.chart.segmented
    # Multipliers by harmonic balance are not exact, so that the branch turns a little beside a multiplier 1.
    passed = changes.plus if changes is not None and exact else int(low.orientation != high.orientation)
    at_one = real_at(1.0) if exact else determinant(step.first)
    if 0 not in known:
        if turned and exact and abs(passed) == 1:
            # Where touches are short the rate of the parameter is rounding at a fold, and the multiplier is not.
            found += _located(family, step, "fold", at_one, passed)
        elif turned:
            found += _at_turn(family, step, passed % 2 == 1)
        elif passed:
            found += _located(family, step, "branch_point", at_one, passed)
    if changes is not None:
        if not found and 1 not in known:
            found += _located(family, step, "period_doubling", real_at(-1.0), changes.minus)
        if not found and 2 not in known:
            without_loss = pair_on_circle(step.first) and pair_on_circle(step.last)
            at_pair = collision if without_loss else pair
            found += _located(family, step, "neimark_sacker", at_pair, changes.pairs)
    size = high.place - low.place
    found = [replace(one, place=low.place + size * one.place) for one in found]
    return sorted(found, key=lambda one: one.place)


def _located(family: Family, step: Step, kind: str, test: Test, change: int) -> list[SpecialPoint]:
    """Return the places at which multipliers pass the unit circle, one for each of them."""
    tests = [test]
    if abs(change) > 1:
        # Of a pair that becomes real beyond the circle, no multiplier passes it.
        begins = logarithms(step.first)
        if np.sum(begins.real * matched(begins, logarithms(step.last)).real < 0.0) < abs(change):
            return []
        begin = census(step.first)
        assert begin is not None
        passed = np.sign(change) * (np.arange(abs(change)) + 0.5)
        tests = [counted(_WHICH[kind], begin[_WHICH[kind]] + float(one)) for one in passed]
    found = [root(family, step, one) for one in (tests if change else [])]
    if kind == "branch_point":
        found = [None if at is None else (_along(step, _exact(family, at[0]), at[1]), at[1]) for at in found]
    return [special_at(kind, *at) for at in found if at is not None]


def _along(step: Step, point: Point, share: float) -> Point:
    """Return a branch point with the direction between its neighbours; its own equations have those of both branches.

    Orbits beside it are then not sought along the other branch.
    """
    ends = [end.tangent * end.scales / point.scales for end in (step.first, step.last)]
    mean = (1.0 - share) * ends[0] + share * ends[1]
    return replace(point, tangent=mean / np.linalg.norm(mean))


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
    kind = "fold"  # There may be a branch point apart from it in the same step.
    with contextlib.suppress(ConvergenceError):
        # Very close to a branch point the determinant is rounding.
        near = share - min(_BESIDE, 0.5 * share), share + min(_BESIDE, 0.5 * (1.0 - share))
        low, high = (orientation(point_between(family, step, one)) for one in near)
        if low == high:
            kind, point = "branch_point", _along(step, _exact(family, point), share)
    return [special_at(kind, point, share)]


def _exact(family: Family, point: Point) -> Point:
    """Return a branch point solved as one; along a branch the equations become singular there, which spoils digits."""
    chart = Extended(point.chart, family, "branch_point", family.interval.scale(point.value))
    try:
        found = chart.solved(np.concatenate([point.y[:-1], [0.0, point.value]]))
    except ConvergenceError:
        return point
    y = np.delete(found, -2)
    if np.linalg.norm((y - point.y) / point.scales) > _NEARBY:
        return point
    return point_at(family, point.chart, y, point.tangent, scales=point.scales)


# -- roots --------------------------------------------------------------------------------------------


def root(family: Family, step: Step, test: Test) -> tuple[Point, float] | None:
    """Return where a test function changes its sign, and its share of the step; None at a jump or a pole.

    Inverse quadratic interpolation is used where it is safe, and otherwise the bracket is halved (Chandrupatla, 1997).
    By harmonic balance a branch has corners, at which it may turn: the rate of the parameter jumps there.
    """
    try:
        ends = test(step.first), test(step.last)
    except ConvergenceError:
        return None
    if not np.all(np.isfinite(ends)) or ends[0] * ends[1] > 0.0:
        return None
    largest, fine, aside = max(map(abs, ends)), _FINE / step.length, _OTHER / step.length
    close = _CLOSE / step.length
    known, places = dict[float, Point](), list[_Place]()
    # The newest place, the one on the other side of the root, and the one that was left out last, with their values.
    a, b, c = (0.0, ends[0]), (1.0, ends[1]), None
    settled = False
    corners = test is turning and not step.first.chart.segmented
    try:
        for _ in range(_TRIES):
            width = abs(b[0] - a[0])
            left = abs(a[1] - b[1]) if corners else min(abs(a[1]), abs(b[1]))
            jump = width <= _JUMP and left > _STAYS * largest
            if jump or width <= (close if settled else fine):
                break
            moved = _portion(a, b, c) * width
            # A test that only touches zero beside its root is found out by a value on the other side.
            beside = a[0] in known and (settled or moved <= fine)
            if beside:
                moved, aside = min(aside, 0.5 * width), _FARTHER * aside
            share = a[0] + moved * np.sign(b[0] - a[0])
            known[share] = point_between(family, step, share, known, tangent=test is turning)
            value, before = test(known[share]), a
            places.append((share, value))
            if (value > 0.0) == (a[1] > 0.0):
                # Close to the root a larger value is rounding.
                if not (beside and moved <= close and abs(value) > abs(a[1])):
                    a, c = (share, value), a
            else:
                a, b, c = (share, value), a, b
                if beside and moved <= close:
                    break
                # What seemed to be the root only touched zero: the search goes on in what is left.
                beside, aside = False, _OTHER / step.length
            # Near a root values fall, and where they no longer do they are rounding.
            small = width <= _NARROWED and moved <= _MOVED and abs(value) >= abs(before[1])
            settled = value == 0.0 or (abs(value) <= _FARTHER * abs(before[1]) if beside else small)
    except ConvergenceError:
        # At a branch point the equations are singular; an orbit beside it is better than none.
        pass
    if corners and abs(a[1] - b[1]) > _STAYS * largest:
        every = {0.0: step.first, 1.0: step.last, **known}
        at = _corner(family, *(every[share] for share in sorted((a[0], b[0]))))
        if at is not None:
            return at, float(Step(step.first, at).secant @ step.secant) / step.length**2
    # The parameter depends on the place of a turn by the square alone, and beside a branch point rates are rounding.
    some, least = (places, _NEARLY_LEVEL) if test is turning else ([a, b], _VANISHES)
    value, share = min(((abs(value), float(share)) for share, value in some if share in known), default=(np.inf, 0.0))
    if value > least * largest or abs(b[0] - a[0]) > _BESIDE:
        return None
    at = known[share]
    if test is not turning:
        at = point_at(family, at.chart, at.y, at.tangent, at.evaluation, scales=at.scales)
    return at, share


def _corner(family: Family, before: Point, after: Point) -> Point | None:
    """Return an orbit at a corner between two neighbours at which the branch turns; None if there is none.

    The directions at both meet at the corner, which is approached from both sides.
    """
    for _ in range(_TRIES):
        far = Step(before, after).legs
        if not far.min() > 0.0 or turning(before) * turning(after) >= 0.0:
            return None
        if far.max() <= _CLOSE:
            corner = before.y + far[0] * before.tangent * before.scales
            return point_at(family, before.chart, corner, before.tangent, scales=before.scales)
        try:
            before, after = _moved(family, before, _NEARER * far[0]), _moved(family, after, -_NEARER * far[1])
        except ConvergenceError:
            return None
    return None


def _moved(family: Family, point: Point, distance: float) -> Point:
    """Return the orbit at a distance along the direction of a branch."""
    guess = point.y + distance * point.tangent * point.scales
    y, evaluation = corrected(family, point.chart, guess, point.scales, point.tangent, point.by_value)
    return point_at(family, point.chart, y, point.tangent, evaluation, scales=point.scales)


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
