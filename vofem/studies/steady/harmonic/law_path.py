"""Forces of scalar laws along periodic motions: Fourier coefficients and their derivatives.

The period is divided where the force or its tangent jumps, and each part is integrated by Gauss's rule. The
coefficients are therefore exact up to rounding, also for very short contacts. Sampling at equal times would cause
aliasing in proportion to the square of their distance. Laws with internal variables are
followed from turning point to turning point, until they repeat.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.laws import LawGroup, LawSet
from vofem.studies.steady.harmonic.trigonometric import basis, crossings, rate, roots, stretches
from vofem.system import System

#: Gauss's rule on one panel, and the phase of the fastest product of harmonics that a panel may cover, rad.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_PHASE = 8.0

#: Forces and tangents, in N and N/m, above which squares overflow. Such a trial point is much too far away.
_LARGEST = 1e150

#: Equal angles in a period of the highest harmonic at which smooth laws are evaluated.
_SAMPLES = 8

#: Largest number of passes over the period for a law with internal variables, and the change that ends the passes.
PASSES, _SETTLED = 40, 1e-12

_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class LawMotion:
    """One law whose force does not depend on the past, along a periodic motion."""

    cuts: Array  #: Angles in [0, 2 pi) at which the tangent jumps, shape (n_cuts,).
    #: Angles at which the force jumps too, the coordinate's rate there (m/s), and the jumps of the spring (N) and of
    #: the damper (N s/m) as the coordinate rises, shape (n_jumps, 4).
    jumps: Array
    harmonics: int  #: Number of harmonics of the coordinate.
    #: Returns force in N, stiffness in N/m and damping in N s/m, shape (3, n), from `basis` at n angles.
    at: Callable[[Array], Array]


class LawForce:
    """The force of one law along a periodic motion, a sum over nodes.

    `harmonics`, `wanted`: numbers of harmonics of the coordinate, H, and of the force, K.
    `force` (shape (2K + 1,)): Fourier series of the force, N.
    `slope` (shape (2K + 1, 2H + 1)): derivative of `force` with respect to the series of the coordinate.
    `remark`: what is to be known of internal variables; empty if they repeat and depend on this motion alone.
    """

    def __init__(self, harmonics: int, wanted: int, derivative: bool) -> None:
        self.harmonics, self.wanted, self.derivative = harmonics, wanted, derivative
        self.force, self.remark = np.zeros(2 * wanted + 1), ""
        self.slope = np.zeros((2 * wanted + 1, 2 * harmonics + 1))
        self._norm = np.full(2 * wanted + 1, 1.0 / np.pi)
        self._norm[0] = 0.5 / np.pi

    def functions(self, angles: Array) -> tuple[Array, Array]:
        """Return `basis` at n angles for the coordinate, (n, 2H + 1), and for the force, (n, 2K + 1)."""
        most = max(self.harmonics, self.wanted)
        every = basis(angles, most)
        columns = [np.append(np.arange(h + 1), most + 1 + np.arange(h)) for h in (self.harmonics, self.wanted)]
        return every[:, columns[0]], every[:, columns[1]]

    def add(self, projecting: Array, weights: Array, force: Array, slopes: Array | None) -> None:
        """Add nodes with their `functions` for the force, their forces, and derivatives of these, (n, 2H + 1)."""
        projected = (projecting * self._norm).T * weights
        self.force += projected @ force
        if slopes is not None:
            self.slope += projected @ slopes

    def add_jump(self, angle: float, size: float) -> None:
        """Add the effect of a moving jump; `size` is the jump of the force over the rate of the coordinate."""
        if self.derivative:
            left = basis(np.array([angle]), self.wanted)[0] * self._norm
            self.slope += size * np.outer(left, basis(np.array([angle]), self.harmonics)[0])


class LawPaths:
    """The laws of a system that are not linear, along periodic motions.

    `groups`: groups of laws that are not linear in harmonic motions.
    `size`: number of laws.
    `passes`: largest number of cycles over which internal variables were computed.
    """

    passes = PASSES

    def __init__(self, groups: tuple[LawGroup, ...]) -> None:
        self.groups = groups
        self.size = sum(len(group) for group in groups)
        self.laws = LawSet(groups)

    def first_of(self, group: LawGroup) -> int:
        """Return the number of a group's first law."""
        return sum(len(one) for one in self.groups[: self.groups.index(group)])

    def along(self, j: int, series: Array, omega: float, wanted: int, *, derivative: bool = True) -> LawForce:
        """Return the force of law j along a motion.

        `series` (shape (2H + 1,)): series of the coordinate, m.
        `omega`: angular frequency of the first harmonic in rad/s, which dampers need.
        `wanted`: number of harmonics of the force.
        """
        total = LawForce(series.size // 2, wanted, derivative)
        if self.laws.laws[j].remembers:
            total.remark = _with_past(self.laws.fresh(), j, series, total)
        elif self.laws.kinks(j):
            _between_kinks(self.motion(j, series, omega), self.laws.kinks(j)[0], omega, series, total)
        else:
            _smooth(self.motion(j, series, omega), self.laws.laws[j].label, series, total)
        return total

    def with_past(self) -> str | None:
        """Return the label of the first law whose force depends on the past, or None."""
        return next((law.label for law in self.laws.laws if law.remembers), None)

    def motion(self, j: int, series: Array, omega: float) -> LawMotion:
        """Return law j, whose force does not depend on the past, along a motion."""
        laws, levels, slope, harmonics = self.laws, self.laws.kinks(j), omega * rate(series), series.size // 2
        edges = [np.mod(crossings(series, level), _TURN) for level in levels]
        moved = np.zeros((edges[0].size if edges and any(laws.jumps(j)) else 0, 4))
        if moved.size:
            moved[:, 0], moved[:, 1] = edges[0], basis(edges[0], harmonics) @ slope
            moved[:, 2:] = laws.jumps(j)
        least = np.nextafter(levels[0], np.inf) if levels else -np.inf

        def at(functions: Array) -> Array:
            along = functions @ series
            u = np.maximum(along, least)
            force, stiffness, damping = laws.force(j, u), laws.tangent(j, u), np.zeros(u.size)
            if laws.laws[j].damped:
                speed = functions @ slope
                damping, change = laws.damping(j, u)
                force, stiffness = force + damping * speed, stiffness + change * speed
            return np.where(along >= least, np.stack([force, stiffness, damping]), 0.0)

        return LawMotion(np.unique(np.concatenate([np.zeros(0), *edges])), moved, harmonics, at)


def panels(low: Array, high: Array, harmonics: int) -> tuple[Array, Array, NDArray[np.int64]]:
    """Return nodes and weights for products of harmonics between pairs of angles (k,), and the pair of each node."""
    counts = np.maximum(1, np.ceil((high - low) * harmonics / _PHASE)).astype(np.int64)
    pair = np.repeat(np.arange(low.size), counts)
    number, width = np.arange(pair.size) - (np.cumsum(counts) - counts)[pair], ((high - low) / counts)[pair]
    half = 0.5 * width[:, None]
    angles = (low[pair] + number * width)[:, None] + half * (1.0 + _NODES)
    return angles.ravel(), (half * _WEIGHTS).ravel(), np.repeat(pair, _NODES.size)


def _smooth(law: LawMotion, label: str, series: Array, total: LawForce) -> None:
    """Sum over equal angles, which for smooth forces converges faster than any power."""
    count = 1 << int(np.ceil(np.log2(_SAMPLES * (max(total.harmonics, total.wanted) + 1))))
    angles = np.asarray(np.arange(count) * (_TURN / count), dtype=float)
    functions, projecting = total.functions(angles)
    try:
        force, tangent, _ = law.at(functions)
    except OverflowError:
        # Newton's method has tried a point that is much too far away.
        force = tangent = np.full(count, np.inf)
    usable = (np.abs(force) < _LARGEST) & (np.abs(tangent) < _LARGEST)
    if not np.all(usable):
        k = int(np.argmin(usable))
        raise ConvergenceError(f"{label} has a force of {force[k]:.3g} N at u = {functions[k] @ series:.3g} m")
    slopes = tangent[:, None] * functions if total.derivative else None
    total.add(projecting, np.full(count, _TURN / count), force, slopes)


def _between_kinks(law: LawMotion, level: float, omega: float, series: Array, total: LawForce) -> None:
    """Integrate over the times at which a law acts that has kinks, as a contact does while it is beyond its level."""
    for angle, speed, spring, damper in law.jumps.tolist():
        # A place where the force jumps moves by -du over the rate of u, on closing as on opening.
        if speed != 0.0:
            total.add_jump(angle, omega * (spring + damper * speed) / abs(speed))
    low = law.cuts if law.cuts.size else np.zeros(1)
    high = np.append(low[1:], low[0] + _TURN)
    acts = basis(0.5 * (low + high), total.harmonics) @ series > level
    angles, weights, _ = panels(low[acts], high[acts], total.harmonics + total.wanted)
    functions, projecting = total.functions(angles)
    force, stiffness, damping = law.at(functions)
    slopes = stiffness[:, None] * functions if total.derivative else None
    if slopes is not None and np.any(damping):
        slopes = slopes + omega * damping[:, None] * _rates_of(functions)
    total.add(projecting, weights, force, slopes)


def _rates_of(functions: Array) -> Array:
    """Return the derivatives by the angle of the basis functions, shape (n, 2H + 1)."""
    harmonics = functions.shape[1] // 2
    order = np.arange(1, harmonics + 1)
    cosines, sines = functions[:, 1 : harmonics + 1], functions[:, harmonics + 1 :]
    return np.concatenate([np.zeros((functions.shape[0], 1)), -order * sines, order * cosines], axis=1)


def _with_past(laws: LawSet, j: int, series: Array, total: LawForce) -> str:
    """Follow the internal variables over the period until they repeat, then integrate; return `LawForce.remark`."""
    harmonics = series.size // 2
    begin, end = stretches(series)
    functions = basis(begin, harmonics)
    u = functions @ series
    state = laws.of(j)
    slopes = np.zeros((state.size, series.size))
    # Derivatives of the internal variables by those a period before.
    kept = np.eye(state.size)
    # Internal variables where each stretch begins, and their derivatives by the series.
    past: list[tuple[Array, Array]] = [(state, slopes)] * begin.size

    def carry(i: int) -> None:
        nonlocal slopes, kept
        if total.derivative:
            _, by_past, now = laws.past_slopes(j, u[i])
            slopes, kept = by_past @ slopes + np.outer(now, functions[i]), by_past @ kept
        laws.commit(j, u[i])
        past[i] = state.copy(), slopes

    size, label = float(np.abs(series).sum()), laws.laws[j].label
    remark = (
        f"{label} still changes after {PASSES} cycles of this motion, as laws that harden under cyclic loads do; the "
        "orbit is that after as many cycles"
    )
    carry(0)
    for _ in range(PASSES):
        before, kept = state.copy(), np.eye(state.size)
        for i in (*range(1, begin.size), 0):
            carry(i)
        change = np.abs(state - before)[1:]
        if np.all(change <= _SETTLED * (size + np.abs(before[1:]))):
            farther = (
                f"{label} keeps traces of what came before this motion. Here nothing did; after loads that went "
                "farther the motion may be another one"
            )
            remark = farther if total.derivative and np.any(np.abs(kept[1:, 1:]) > _SETTLED) else ""
            break
    kinks = []
    for known, _ in past:
        state[:] = known
        kinks.append(np.array(laws.kinks(j)))
    levels, stretch = np.concatenate(kinks), np.repeat(np.arange(begin.size), [one.size for one in kinks])
    crossed = (u[stretch] > levels) != (np.roll(u, -1)[stretch] > levels)
    levels, stretch = levels[crossed], stretch[crossed]
    inside = roots(series, begin[stretch], end[stretch], levels)
    # Parts between kinks, in the order of their stretches.
    low, stretch = np.append(begin, inside), np.append(np.arange(begin.size), stretch)
    order = np.lexsort((low, stretch))
    low, stretch = low[order], stretch[order]
    high = np.where(np.append(stretch[1:], -1) == stretch, np.append(low[1:], 0.0), end[stretch])
    long = high > low
    low, high, stretch = low[long], high[long], stretch[long]
    angles, weights, part = panels(low, high, total.harmonics + total.wanted)
    moving, projecting = total.functions(angles)
    along, (force, tangent) = moving @ series, np.empty((2, angles.size))
    by_series = np.empty((angles.size if total.derivative else 0, series.size))
    bounds = np.searchsorted(part, np.arange(low.size + 1)).tolist()
    for i, nodes in zip(stretch.tolist(), map(slice, bounds[:-1], bounds[1:]), strict=True):
        state[:], slopes = past[i]
        force[nodes], tangent[nodes] = laws.force(j, along[nodes]), laws.tangent(j, along[nodes])
        if total.derivative:
            # Between kinks the internal variables act as the coordinate does, in proportion to the tangent.
            middle = (nodes.start + nodes.stop) // 2
            by_past = laws.past_slopes(j, along[middle])[0]
            share = tangent[nodes] / tangent[middle] if tangent[middle] != 0.0 else np.ones(nodes.stop - nodes.start)
            by_series[nodes] = tangent[nodes, None] * moving[nodes] + np.outer(share, by_past @ slopes)
    total.add(projecting, weights, force, by_series if total.derivative else None)
    return remark


def nonlinear_groups(system: System) -> tuple[LawGroup, ...]:
    """Return the groups of a system that are not linear in harmonic motions: all but springpots."""
    return tuple(group for group in system.laws if not group.linear)
