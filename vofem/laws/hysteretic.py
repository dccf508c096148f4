# mypy: disable-error-code="no-any-return"
"""Laws with internal variables: cyclic laws on a backbone, and springs of Jenkins elements.

A cyclic law is elastic between the largest forces that tension and compression have reached, and follows its backbone
beyond either of them. Its internal variables are the elongation on the backbone and the force at which tension yields
again, the same two for compression, and the residual elongation. A law of Jenkins elements is a linear spring in
parallel with elements, each of which is a spring in series with a slider. Its internal variables are the positions of
the sliders. Both laws are rate independent: the force follows from the internal variables and the elongation. Forces
grow along rising paths and fall along falling ones, so mean force and end force are monotone functions of the end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from vofem.arrays import Array
from vofem.kernels.jit import jit
from vofem.laws.group import ListedLaws
from vofem.laws.law import COMMIT, FORCE, KINK, LOSS, MEAN, STORED, TANGENT, Law
from vofem.laws.paper import no_modes, path_needed

_SQRT = 1.0 / math.sqrt(3.0)


@dataclass(frozen=True)
class HystereticLaws(ListedLaws):
    """Rate-independent laws with internal variables, one per row; no force falls as its coordinate rises.

    `rows` has shape (n_laws, n).
    """

    place: ClassVar[int] = 2
    kind: ClassVar[str] = "hysteretic springs"
    recorded: ClassVar[bool] = True
    named: ClassVar[str] = "springs"

    laws: tuple[Law, ...]

    @property
    def forms(self) -> tuple[Law, ...]:
        """The laws."""
        return self.laws

    def nonlinearity(self, method: str) -> str:
        """Return why the force is not piecewise linear in the displacement."""
        return (
            f"{self.labels[0]} remembers its past, and {method} needs laws that are piecewise linear in the "
            "displacement"
        )

    def statics_refusal(self, path: bool) -> str | None:
        """Return why there is no equilibrium without a path."""
        return None if path else path_needed(self.labels[0])

    def modes_refusal(self) -> str:
        """Return why there are no modes."""
        return no_modes(self.labels[0])

    def harmonic_refusal(self) -> str | None:
        """Return why there is no derivative by the internal variables: of laws that do not give it."""
        label = next((law.label for law in self.laws if law.slopes is None), None)
        reason = "does not say how its force depends on its internal variables; let a damped simulation settle instead"
        return None if label is None else f"{label} {reason}"


# -- Jenkins elements ---------------------------------------------------------------------------------------


def jenkins(
    label: str, name: str, stiffness: float, beside: float, springs: Array, slips: Array, limit: float, unit: str
) -> Law:  # fmt: skip
    """Return the law of a spring beside Jenkins elements, of stiffnesses (N/m) and slip forces (N), shape (n,).

    `stiffness` is that of all together.
    """
    numbers = np.concatenate([[float(springs.size), beside], springs, slips])
    return Law(
        label, name, elements, numbers, np.zeros(springs.size), stiffness, limit, unit,
        slopes=element_slopes,
    )  # fmt: skip


@jit
def elements(what: int, p: Any, z: Any, u0: float, u1: float) -> float:
    """Answer for n Jenkins elements of p = (n, spring beside them, springs, slip forces); see `law`."""
    count = int(p[0])
    if what == KINK:
        # Bends upward and downward of every element; a law takes them in any order.
        e = int(u1)
        if e >= 2 * count:
            return np.nan
        width = p[2 + count + e % count] / p[2 + e % count]
        return z[e % count] - width if e < count else z[e % count] + width
    a, b = min(u0, u1), max(u0, u1)
    total = 0.0
    if what == FORCE or (what == MEAN and a == b):
        total = p[1] * u1
    elif what == TANGENT:
        total = p[1]
    elif what == STORED:
        total = 0.5 * p[1] * u1 * u1
    elif what == MEAN:
        total = p[1] * 0.5 * (a + b)
    for e in range(count):
        spring, slip = p[2 + e], p[2 + count + e]
        stretch, width = u1 - z[e], slip / spring
        if what == FORCE or (what == MEAN and a == b):
            total += min(max(spring * stretch, -slip), slip)
        elif what == TANGENT:
            total += spring if abs(spring * stretch) < slip else 0.0
        elif what == MEAN:
            low, high = z[e] - width, z[e] + width
            work = 0.0
            if a < low:
                work -= slip * (min(b, low) - a)
            if b > high:
                work += slip * (b - max(a, high))
            left, right = max(a, low), min(b, high)
            if right > left:
                work += spring * (0.5 * (left + right) - z[e]) * (right - left)
            total += work / (b - a)
        elif what == STORED:
            pull = min(abs(spring * stretch), slip)
            total += 0.5 * pull * pull / spring
        elif what == LOSS:
            total += slip * max(abs(stretch) - width, 0.0)
        elif what == COMMIT:
            z[e] = min(max(z[e], u1 - width), u1 + width)
    return total


def element_slopes(p: Array, z: Array, u: float) -> tuple[Array, Array, Array]:
    """Return derivatives by the positions of the sliders; see `Law.slopes`."""
    springs, slips = p[2 : 2 + z.size], p[2 + z.size : 2 + 2 * z.size]
    slipping = np.abs(u - z) > slips / springs
    held = np.abs(u - z) < slips / springs
    return np.where(held, -springs, 0.0), np.diag(np.where(slipping, 0.0, 1.0)), np.where(slipping, 1.0, 0.0)


# -- cyclic laws ------------------------------------------------------------------------------------------


#: Positions of the numbers of a cyclic law: whether its backbone is a table, and whether it cannot pull.
_TABLE, _STIFFNESS, _GAP, _ONE_SIDED, _LIMIT, _SPAN = range(6)

#: Of the table: number of knots, then elongation, force, slope and work at the knots, one array after the other.
_COUNT, _KNOTS = 4, 5

#: Positions of the internal variables.
_UP_AT, _UP, _DOWN_AT, _DOWN, _RESIDUAL = range(5)


def cyclic(
    label: str, name: str, stiffness: float, onset: float, limit: float, *, span: float | None = None,
    table: Array | None = None, one_sided: bool = False, gap: float = 0.0, unit: str = "N",
) -> Law:  # fmt: skip
    """Return a cyclic law on a hyperbola or on a table.

    `stiffness`, `onset`, `limit`: stiffness before any load, which is the largest that the law ever has, N/m; force at
    which it first yields, and limit load, N.
    `span`: range of forces over which the secant stiffness falls to zero, N.
    `table` (shape (4 n_knots,)): elongation, force, slope and work at the knots of the backbone, one array after the
    other.
    `one_sided`: whether the force cannot pull, as in a stop.
    `gap`: elongation at which the force begins, m.
    """
    if table is None:
        assert span is not None
        numbers = np.array([0.0, stiffness, gap, float(one_sided), limit, span])
    else:
        numbers = np.concatenate([[1.0, stiffness, gap, float(one_sided), table.size / 4], table])
    reach = onset / stiffness
    past = np.array([reach, onset, reach, onset, 0.0])
    return Law(label, name, backbone_law, numbers, past, stiffness, limit, unit, slopes=cyclic_slopes)


@jit
def backbone_law(what: int, p: Any, z: Any, u0: float, u1: float) -> float:
    """Answer for a cyclic law; see `law`."""
    k, residual = p[_STIFFNESS], z[_RESIDUAL]
    # The elongations at which it begins to yield in compression and in tension. A stop has no compression.
    low, high = residual, residual + z[_UP] / k
    if p[_ONE_SIDED] == 0.0:
        low -= z[_DOWN] / k
    if what == KINK:
        return p[_GAP] + (low if u1 == 0.0 else high) if u1 < 2.0 else np.nan
    u = u1 - p[_GAP]
    a, b = min(u0, u1) - p[_GAP], max(u0, u1) - p[_GAP]
    if what == MEAN and a < b:
        return _mean_of_path(p, z, low, high, a, b)
    pulls = p[_ONE_SIDED] == 0.0
    if low <= u <= high:
        force, tangent = k * (u - residual), k
    elif u > high:
        force, tangent = _backbone(p, z[_UP_AT] + (u - high))
    elif pulls:
        force, tangent = _backbone(p, z[_DOWN_AT] + (low - u))
        force = -force
    else:
        force, tangent = 0.0, 0.0
    if what in (FORCE, MEAN):
        return force
    if what == TANGENT:
        return tangent
    if what == STORED:
        return 0.5 * force * force / k
    if low <= u <= high or (u < low and not pulls):
        return 0.0
    if u > high:
        at, before, way = z[_UP_AT], z[_UP], u - high
    else:
        at, before, way, force = z[_DOWN_AT], z[_DOWN], low - u, -force
    if what == LOSS:
        stored = (force - before) * (0.5 * (force + before) / k)
        return max(way * _backbone_mean(p, at, at + way) - stored, 0.0)
    if what == COMMIT and u > high:
        z[_UP_AT], z[_UP], z[_RESIDUAL] = at + way, force, u - force / k
    elif what == COMMIT:
        z[_DOWN_AT], z[_DOWN], z[_RESIDUAL] = at + way, force, u + force / k
    return 0.0


@jit
def _mean_of_path(p: Any, z: Any, low: float, high: float, a: float, b: float) -> float:
    """Return the mean force of a cyclic law over a path from a to b > a."""
    k, residual = p[_STIFFNESS], z[_RESIDUAL]
    if a >= low and b <= high:
        return k * (0.5 * (a + b) - residual)
    total, length = 0.0, 0.0
    if a < low:
        part = min(b, low) - a
        length += part
        if p[_ONE_SIDED] == 0.0:
            at = z[_DOWN_AT] + (low - a)
            total -= part * _backbone_mean(p, at - part, at)
    left, right = max(a, low), min(b, high)
    if right > left:
        total += k * (0.5 * (left + right) - residual) * (right - left)
        length += right - left
    if b > high:
        part = b - max(a, high)
        length += part
        at = z[_UP_AT] + (b - high)
        total += part * _backbone_mean(p, at - part, at)
    return total / length


@jit
def _knot(p: Any, w: float) -> int:
    """Return the number of the interval of a table that holds w."""
    low, high = 0, int(p[_COUNT]) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if p[_KNOTS + middle] <= w:
            low = middle
        else:
            high = middle
    return low


@jit
def _cubic(p: Any, k: int, w: float) -> tuple[float, float]:
    """Return force and slope at w in interval k of a table; beyond the last knot it is straight."""
    a, n = _KNOTS, int(p[_COUNT])
    if w >= p[a + n - 1]:
        slope = p[a + 3 * n - 1]
        return p[a + 2 * n - 1] + slope * (w - p[a + n - 1]), slope
    h = p[a + k + 1] - p[a + k]
    x = (w - p[a + k]) / h
    rise = p[a + n + k + 1] - p[a + n + k]
    s0, s1 = h * p[a + 2 * n + k], h * p[a + 2 * n + k + 1]
    c, d = 3.0 * rise - 2.0 * s0 - s1, s0 + s1 - 2.0 * rise
    return p[a + n + k] + x * (s0 + x * (c + x * d)), (s0 + x * (2.0 * c + 3.0 * x * d)) / h


@jit
def _backbone(p: Any, w: float) -> tuple[float, float]:
    """Return force and slope of the backbone at an elongation w, counted from the start of the backbone."""
    if p[_TABLE] == 0.0:
        total = p[_SPAN] + p[_STIFFNESS] * w
        slope = p[_LIMIT] * p[_STIFFNESS] * (p[_SPAN] / total) / total
        return p[_LIMIT] * (p[_STIFFNESS] * w / total), slope
    return _cubic(p, _knot(p, w), w)


@jit
def _backbone_mean(p: Any, w0: float, w1: float) -> float:
    """Return the mean force of the backbone between w0 < w1, without cancellation."""
    if p[_TABLE] == 0.0:
        k = p[_STIFFNESS]
        total = p[_SPAN] + k * w0
        x = k * (w1 - w0) / total
        # 1 - log(1 + x)/x.
        if x < 0.1:
            bend = 0.0
            for n in range(16, 0, -1):
                bend = x * (1.0 / (n + 1) - bend)
        else:
            bend = 1.0 - math.log1p(x) / x
        return p[_LIMIT] * (bend + (k * w0 / total) * (1.0 - bend))
    a, n = _KNOTS, int(p[_COUNT])
    first, last, end = _knot(p, w0), _knot(p, w1), p[_KNOTS + int(p[_COUNT]) - 1]
    if first == last and not (w0 < end < w1):
        return _inside(p, first, w0, w1)
    work = _inside(p, first, w0, p[a + first + 1]) * (p[a + first + 1] - w0)
    if last > first:
        work += p[a + 3 * n + last] - p[a + 3 * n + first + 1]
        middle = min(w1, end)
        work += _inside(p, last, p[a + last], middle) * (middle - p[a + last])
    if w1 > end:
        work += _inside(p, last, end, w1) * (w1 - end)
    return work / (w1 - w0)


@jit
def _inside(p: Any, k: int, w0: float, w1: float) -> float:
    """Return the mean of one cubic: Gauss's rule of two points is exact."""
    middle, half = 0.5 * (w0 + w1), 0.5 * (w1 - w0) * _SQRT
    return 0.5 * (_cubic(p, k, middle - half)[0] + _cubic(p, k, middle + half)[0])


def cyclic_slopes(p: Array, z: Array, u: float) -> tuple[Array, Array, Array]:
    """Return derivatives by the internal variables; see `Law.slopes`."""
    k, one_sided = p[_STIFFNESS], p[_ONE_SIDED] != 0.0
    low = z[_RESIDUAL] - (0.0 if one_sided else z[_DOWN] / k)
    high = z[_RESIDUAL] + z[_UP] / k
    tangent = backbone_law.plain(TANGENT, p, z, u, u)  # type: ignore[attr-defined]
    u -= p[_GAP]
    slopes, past, end = np.zeros(5), np.eye(5), np.zeros(5)
    if low <= u <= high:
        slopes[_RESIDUAL] = -k
        return slopes, past, end
    if u < low and one_sided:
        return slopes, past, end
    # Along the backbone: its elongation grows by the path beyond the edge, and force and residual elongation follow
    # from it.
    at, force, sign = (_UP_AT, _UP, 1.0) if u > high else (_DOWN_AT, _DOWN, -1.0)
    slopes[[at, _RESIDUAL, force]] = sign * tangent, -tangent, -sign * tangent / k
    past[at, _RESIDUAL], past[at, force], end[at] = -sign, -1.0 / k, sign
    past[force], end[force] = tangent * past[at], tangent * end[at]
    past[_RESIDUAL] = -sign * past[force] / k
    end[_RESIDUAL] = 1.0 - sign * end[force] / k
    return slopes, past, end
