"""Work and dissipation of an event-driven run: integrals of quadratic forms of free motions.

The blocks of a status obey ``x' = A x + g(t)``. Loads are written as free motions too: a harmonic is an oscillator
without damping, ``(f, f')`` of a line is one without stiffness. With w for their states and y for what remains of the
blocks beside the steady answers to loads, ``x = y + B w``,

    y' = A y + G w,    w' = S w,

where G drives only blocks that have no steady answer: those that resonate with a load, and those that are slower than
the run. Powers are quadratic forms of (y, w). With P from ``A' P + P A = -Q`` the integral of ``y' Q y`` is the fall of
``y' P y`` plus an integral of products of y and w, and so on. Products of loads integrate in closed form. Only products
of blocks without a steady answer, with such a load or among each other, are integrated by Gauss's rule on panels.
Everything follows from the dampers and the roots, so that the energy balance is an independent check.

Clusters of modes have no such form, so the power of a status with clusters is integrated on panels. The kinetic energy
that is removed when a contact is pinned counts as dissipated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array, Complex
from vofem.integrators.event_driven.exosystem import CONSTANT
from vofem.integrators.event_driven.record import Record
from vofem.integrators.event_driven.regime import Regime, flat
from vofem.linalg.oscillators import DELTA, FREQUENCY, SQUARE

if TYPE_CHECKING:
    from vofem.integrators.event_driven.sliders import SlidingPiece

Integers = NDArray[np.int64]

#: Times that are treated together.
_TOGETHER = 4096

#: Multiple of a block's energy above which its computed loss is rounding of a very small decay rate.
_MORE = 4.0

#: Duration of a segment times the rate of the slowest mode below which it has no forms: where loads travel, and where
#: they do not. In the latter case there are not more than so many panels.
_PASSING, _INSTANT, _MOST_PANELS = 0.3, 1e-4, 1000.0

_EPS = float(np.finfo(float).eps)

#: A determinant, 1/s^4, below which its inverse overflows.
_NOTHING = 1e-290

#: Taylor coefficients of the integral of ``s exp(x s)`` from 0 to 1; enough for |x| < 0.5.
_RAMP_SERIES = np.array([1.0 / (math.factorial(k) * (k + 2)) for k in range(16)])

#: Rules of Gauss for panels, and length of a panel, over the shortest time scale, up to which the first one is exact to
#: rounding.
_FEW_NODES, _NODES = np.polynomial.legendre.leggauss(4), np.polynomial.legendre.leggauss(12)
_SHORT = 0.1


class _Form(NamedTuple):
    """The integral of ``y' Q y + 2 y' R w + w' T w``."""

    blocks: Array | None  #: P of the blocks, or its diagonal; None where they do not enter. Shape (2m, 2m) or (2m,).
    mixed: Array  #: P between blocks and loads, shape (2m, 2e).
    loads: Array  #: What is left between loads, shape (2e, 2e).
    panels: tuple[Array, Array]  #: Q and R of the products that are integrated on panels, shapes (2m, 2m) and (2m, 2e).


class StatusForms:
    """The forms of one linear piece, without a group."""

    def __init__(self, regime: Regime) -> None:
        self.regime = regime
        spectrum, horizon, power = regime.spectrum, regime.horizon, regime.power
        m = spectrum.p.size
        self.lone = np.zeros((2 * m, 2 * m))
        if power.ndim == 1:
            # For real modes P is that of the energy.
            lossy = np.tile(spectrum.delta > 0.0, 2)
            lost = np.where(lossy, np.concatenate([0.5 * spectrum.p, np.full(m, 0.5)]), 0.0)
        else:
            assert spectrum.blocks is not None
            out = spectrum.blocks.out
            energy = 0.5 * (spectrum.real.p @ out[:m] ** 2 + np.sum(out[m:] ** 2, axis=0))
            size = np.sqrt(np.maximum(power.diagonal(), 0.0))
            known = np.where(np.abs(power) > 4.0 * _EPS * np.outer(size, size), power, 0.0)
            # What blocks lose in the whole run may be rounding, which their decay rates do not show.
            faint = np.tile(np.all((size**2 * horizon <= _EPS * energy).reshape(2, m), axis=0), 2)
            known[np.outer(faint, faint)] = 0.0
            lost = lyapunov(spectrum.delta, spectrum.p, spectrum.delta, spectrum.p, known)
            unsure = (np.abs(lost.diagonal()) > _MORE * energy).reshape(2, m).any(axis=0)
            unsure |= spectrum.p * horizon**2 < 1.0
            if unsure.any():
                self.lone = np.where(np.outer(np.tile(unsure, 2), np.tile(unsure, 2)), known, 0.0)
                lost = lyapunov(spectrum.delta, spectrum.p, spectrum.delta, spectrum.p, known - self.lone)
        work, loss = _with_loads(regime)
        self.work = self._with_loads(None, None, *work)
        self.loss = self._with_loads(lost, self.lone, *loss)

    def _with_loads(self, blocks: Array | None, lone: Array | None, mixed: Array, loads: Array) -> _Form:
        """Return a form, given P of the blocks and the integrands of products with loads."""
        spectrum, (_, drive, apart) = self.regime.spectrum, self.regime.answers
        squares = self.regime.blocks.of[SQUARE, : self.regime.loads]
        if blocks is not None:
            mixed = mixed + _times(blocks, drive)
        panels = np.where(np.tile(apart, (2, 2)), mixed, 0.0)
        found = lyapunov(spectrum.delta, spectrum.p, np.zeros_like(squares), squares, mixed - panels)
        e, bent = self.regime.loads, np.flatnonzero(self.regime.kind.bend >= 0)
        if bent.size:
            # The rate of a line that is bent changes with the line's second derivative.
            second = self.regime.kind.bend[bent]
            columns, none = np.concatenate([second, e + second]), np.zeros(bent.size)
            rest = (mixed - panels)[:, columns]
            rest[:, : bent.size] += found[:, e + bent]
            found[:, columns] = lyapunov(spectrum.delta, spectrum.p, none, none, rest)
        rest = found.T @ drive
        return _Form(blocks, found, loads + rest + rest.T, (np.zeros((0, 0)) if lone is None else lone, panels))

    def taken(self, begins: Array, own: Integers, tau: Array) -> Array:
        """Return the work of loads and the energy taken by dampers since the starts of segments, shape (2, n_times).

        `begins` (shape (k, 2, M)): states of all blocks at the start of k segments.
        `own` (shape (n_times,)): number of the segment of each time, in ascending order.
        `tau` (shape (n_times,)): times from the starts, s.
        """
        regime, found = self.regime, np.zeros((2, tau.size))
        e, omega = regime.loads, regime.blocks.of[FREQUENCY, : regime.loads]
        y, w = flat(begins[:, :, e:]), flat(begins[:, :, :e])
        forms = self.work, self.loss
        for first in range(0, tau.size, _TOGETHER):
            at = slice(first, first + _TOGETHER)
            moved = regime.changes(begins, own[at], tau[at])
            d, u = flat(moved[:, :, e:]), flat(moved[:, :, :e])
            for total, form in zip(found, forms, strict=True):
                fall = _products(d, (w @ form.mixed.T)[own[at]]) + _products(u, (y @ form.mixed)[own[at]])
                fall = 2.0 * (fall + _products(d @ form.mixed, u))
                if form.blocks is not None:
                    fall += _products(d, _times(form.blocks, 2.0 * y.T).T[own[at]])
                    fall += _products(_times(form.blocks, d.T).T, d)
                total[at] = -fall
        for total, form in zip(found, forms, strict=True):
            total += _of_loads(form.loads, omega, regime.kind.bend, w.T, own, tau)
            if np.any(form.panels[0]) or np.any(form.panels[1]):
                for s, mine in _runs(own):
                    total[mine] += self._on_panels(form.panels, begins[s], tau[mine])
        return found

    def _on_panels(self, panels: tuple[Array, Array], begin: Array, tau: Array) -> Array:
        """Return the integrals in one segment of products that have no form, shape (n_times,)."""
        regime, (quadratic, mixed) = self.regime, panels
        e, spectrum = regime.loads, regime.spectrum

        def power(at: Array) -> Array:
            states = begin + regime.changes(begin[None], np.zeros(at.size, dtype=np.int64), at)
            y, w = flat(states[:, :, e:]), flat(states[:, :, :e])
            total = 2.0 * _products(y @ mixed, w)
            return total + _products(y @ quadratic, y) if quadratic.size else total

        used = np.any(mixed, axis=1) if not quadratic.size else np.any(mixed, axis=1) | np.any(quadratic, axis=1)
        blocks = np.flatnonzero(used.reshape(2, -1).any(axis=0))
        quickest = np.sqrt(spectrum.p[blocks].max()) + spectrum.delta[blocks].max()
        return quadrature(power, tau, float(2.0 * quickest + regime.blocks.of[FREQUENCY, :e].max(initial=0.0)))


def _with_loads(regime: Regime) -> tuple[list[Array], list[Array]]:
    """Return the products with loads in the power of loads and in that of dampers.

    Each is a list of those of blocks and loads, (2m, 2e), and of loads, (2e, 2e): ``2 y' first w + w' second w``.
    """
    steady = regime.answers.steady
    loads = regime.load_rows @ steady
    mixed = _times(regime.power, steady)
    parts = [0.5 * regime.load_rows.T, 0.5 * (loads + loads.T)], [mixed, steady.T @ mixed]
    for own, added in zip(parts, _beside(regime), strict=False):
        own[0], own[1] = own[0] + added[0], own[1] + added[1]
    return parts


def _beside(regime: Regime) -> tuple[tuple[Array, Array], ...]:
    """Return what belts and stops that move add to work and loss, each as in `_with_loads`; empty where none moves."""
    if regime.sliding is not None and regime.sliding.moves:
        return _of_belts(regime, regime.sliding)
    return () if regime.stops is None else _of_stops(regime)


def _of_belts(regime: Regime, sliding: SlidingPiece) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return what belts add to work and loss: products of blocks and loads, (2m, 2e), and of loads, (2e, 2e)."""
    e, pushes = regime.loads, sliding.pushes
    none, every = np.zeros_like(pushes.anchors), np.eye(sliding.space.size)
    blocks = regime.velocities(every)
    # Velocities of the modes that belts carry along, and by the loads as a whole.
    carried = np.concatenate([np.zeros_like(pushes.carried), pushes.carried], axis=1)
    along = blocks @ regime.answers.steady
    contacts, dampers = sliding.space.contacts, sliding.dampers[:, None]

    def damped(velocities: Array) -> Array:
        force = sliding.space.damping_force(velocities) + contacts.T @ (dampers * (contacts @ velocities))
        return np.asarray(force)

    taken = damped(carried)
    lost = (along + 0.5 * carried).T @ taken
    belts = np.concatenate([none, pushes.anchors], axis=1)
    forces = sliding.forces.reshape(len(belts), 2, -1)
    of_loads = -flat(forces[:, :, :e]).T @ belts
    mine = np.flatnonzero(regime.kind.function >= 0)
    of_loads[mine] += regime.base.vectors[regime.kind.function[mine]] @ carried
    work = -0.5 * flat(forces[:, :, e:]).T @ belts, 0.5 * (of_loads + of_loads.T)
    return work, (blocks.T @ taken, lost + lost.T)


def _of_stops(regime: Regime) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return what moving stops add to work and loss: products of blocks and loads, (2m, 2e), and of loads, (2e, 2e)."""
    stops, e, m = regime.stops, regime.loads, regime.spectrum.p.size
    assert stops is not None
    k, c = stops.stiffness[:, None], stops.damping[:, None]
    rate = np.concatenate([np.zeros_like(stops.drift), stops.drift], axis=1)
    place = regime.coordinates.reshape(len(k), 2, e + m)
    at_blocks, at_loads = (flat(part) for part in (place[:, :, e:], place[:, :, :e].copy()))
    at_loads[:, :1] -= np.where(regime.kind.function[:1] == CONSTANT, stops.offset[:, None], 0.0)
    speed = regime.velocities(stops.rows)
    carried = speed @ regime.answers.steady
    force = k * at_loads + c * (carried + rate)
    of_loads = force.T @ rate
    lost = (c * rate).T @ (carried + 0.5 * rate)
    work = 0.5 * (k * at_blocks + c * speed).T @ rate, 0.5 * (of_loads + of_loads.T)
    return work, ((c * speed).T @ rate, lost + lost.T)


def work_and_dissipation(
    record: Record,
    regimes: Callable[[Integers], Iterator[tuple[Regime, Integers]]],
    begins: Callable[[Regime, Integers], Array],
    times: Array,
    pinning: Array | None,
) -> tuple[Array, Array]:
    """Return the work of all loads and the energy dissipated by all dampers, from t = 0 to the given times.

    `regimes`, `begins`: those of `EventSolution`.
    `pinning` (shape (n_segments,)): energy lost at the beginning of every segment, J.
    """
    segments = np.clip(np.searchsorted(record.starts, times, side="right") - 1, 0, None)
    count = int(segments.max()) + 1
    # The times in segments, and the ends of segments.
    every = np.arange(count)
    of, tau = np.append(segments, every), np.append(times - record.starts[segments], record.durations[:count])
    order = np.argsort(of, kind="stable")
    found = np.empty((2, of.size))
    for regime, mine in regimes(of[order]):
        places = order[mine]
        used, own = np.unique(of[places], return_inverse=True)
        starts = begins(regime, used)
        alone = np.full(used.size, regime.blocks.group is not None) | _steep(regime, record.durations[used])
        formed = ~alone[own]
        if formed.any():
            if "forms" not in regime.kept:
                regime.kept["forms"] = StatusForms(regime)
            found[:, places[formed]] = regime.kept["forms"].taken(starts, own[formed], tau[places[formed]])
        for s, run in _runs(own):
            if alone[s]:
                found[:, places[run]] = _on_panels(regime, starts[s], tau[places[run]])
    whole = found[:, times.size :].copy()
    if pinning is not None:
        whole[1, :-1] += pinning[1:count]
    begun = np.concatenate([np.zeros((2, 1)), np.cumsum(whole, axis=1)[:, :-1]], axis=1)
    if pinning is not None:
        begun[1] += pinning[0]
    work, dissipated = found[:, : times.size] + begun[:, segments]
    return work, dissipated


def _steep(regime: Regime, durations: Array) -> NDArray[np.bool_]:
    """Return whether loads pass segments that are short beside all motions, shape (k,).

    So do loads that travel fast, and steep parts of tables. Forms would be small differences of large terms there.
    """
    moves = regime.spectrum.p > 0.0
    if not (regime.loads and np.any(moves)):
        return np.zeros(durations.size, dtype=bool)
    p, delta = regime.spectrum.p[moves], regime.spectrum.delta[moves]
    slowest = float(np.min(p / np.maximum(np.sqrt(p), 2.0 * delta)))
    if np.any(regime.kind.bend >= 0):
        return np.asarray(slowest * durations < _PASSING)
    return np.asarray((slowest * durations < _INSTANT) & (_rate(regime) * durations < _MOST_PANELS))


def _rate(regime: Regime) -> float:
    """Return the rate of the fastest changes of power, 1/s."""
    e, of = regime.loads, regime.blocks.of
    fastest = [of[FREQUENCY, e:].max(initial=0.0), of[DELTA, e:].max(initial=0.0), of[FREQUENCY, :e].max(initial=0.0)]
    return 2.0 * float(sum(fastest))


def _on_panels(regime: Regime, begin: Array, tau: Array) -> Array:
    """Return work and loss in a segment that has no forms, shape (2, n_times)."""
    e, steady = regime.loads, regime.answers.steady
    if "beside" not in regime.kept:
        regime.kept["beside"] = _beside(regime)

    def power(at: Array, loss: bool) -> Array:
        states = begin + regime.changes(begin[None], np.zeros(at.size, dtype=np.int64), at)
        y, w = flat(states[:, :, e:]), flat(states[:, :, :e])
        # The motion itself: it may be a small difference of y and the answers to loads.
        x = y + w @ steady.T
        total = _products(_times(regime.power, x.T).T, x) if loss else _products(x @ regime.load_rows.T, w)
        for mixed, loads in regime.kept["beside"][loss : loss + 1]:
            total += _products(2.0 * (y @ mixed) + w @ loads, w)
        return total

    rate = _rate(regime)
    return np.stack([quadrature(partial(power, loss=loss), tau, rate) for loss in (False, True)])


def lyapunov(delta: Array, p: Array, e: Array, q: Array, power: Array) -> Array:
    """Return P with ``A' P + P B = -Q`` for blocks (delta, p) and (e, q), shape (2n, 2k).

    Two blocks give four equations, whose determinant is a sum of terms that are not negative: repeated and critically
    damped roots are no special cases.
    """
    n, k = p.size, q.size
    zz, zv, vz, vv = power[:n, :k], power[:n, k:], power[n:, :k], power[n:, k:]
    d, e, p, q = delta[:, None], e[None, :], p[:, None], q[None, :]
    s, apart, both = 2.0 * (d + e), p - q, 2.0 * (d * q + e * p)
    determinant = apart**2 + s * both
    known = determinant > _NOTHING
    scale = np.where(known, 1.0 / np.where(known, determinant, 1.0), 0.0)
    twist = vz - zv
    g = (s * zz - apart * twist + both * vv) * scale
    c = (apart * (zz + q * vv) + s * (q * twist + 2.0 * e * zz)) * scale
    b = (-apart * (zz + p * vv) + s * (2.0 * d * zz - p * twist)) * scale
    # Rigid motions with dampers.
    g = np.where(~known & (s > 0.0), vv / np.where(s > 0.0, s, 1.0), g)
    return np.block([[np.where(known, p * g + 2.0 * e * b - zv, 0.0), b], [c, g]])


def _of_loads(own: Array, omega: Array, bend: Integers, w: Array, segment: Integers, tau: Array) -> Array:
    """Return the integrals of ``w' own w`` from 0 to all tau, for load states w (2e, k) at the starts of segments."""
    e, bent = omega.size, np.flatnonzero(bend >= 0)
    # Factors of s^power exp(i nu s), by nu and power.
    parts: dict[tuple[float, int], Complex] = {}
    for nu in np.unique(omega).tolist():
        mine = np.flatnonzero(omega == nu)
        state, rate, second, third = w[mine], w[e + mine], w[bend[bent]], w[e + bend[bent]]
        wave = state - 1j * rate / nu if nu else state
        terms = [(0, mine, wave), (0, e + mine, 1j * nu * wave if nu else rate)]
        if not nu:
            terms += [(1, mine, rate), (1, e + bent, second), (2, bent, second / 2.0), (2, e + bent, third / 2.0)]
            terms += [(3, bent, third / 6.0)]
        for power, at, factor in terms:
            parts.setdefault((nu, power), np.zeros(w.shape, dtype=complex))[at] = factor
    moments: dict[tuple[int, float], Complex] = {}

    def moment(power: int, nu: float) -> Complex:
        if (power, nu) not in moments:
            moments[power, nu] = _moment(power, nu, tau)
        return moments[power, nu]

    total = np.zeros(tau.size)
    for (nu, power), x in parts.items():
        pushed = own.T @ x
        for (mu, other), y in parts.items():
            both, apart = np.sum(pushed * y, axis=0), np.sum(pushed * np.conj(y), axis=0)
            if np.any(both) or np.any(apart):
                found = both[segment] * moment(power + other, nu + mu) + apart[segment] * moment(power + other, nu - mu)
                total += 0.5 * found.real
    return total


def _moment(power: int, nu: float, tau: Array) -> Complex:
    """Return the integral of ``s^power exp(i nu s)`` from 0 to all tau, shape (n_times,); nu is 0 for squares."""
    if not nu:
        return np.asarray(tau ** (power + 1) / (power + 1), dtype=np.complex128)
    x = 1j * nu * tau
    if not power:
        return np.asarray(np.expm1(x) / (1j * nu))
    small = np.abs(x) < (0.5 if power == 1 else 2.0 + power)
    result = np.empty_like(x)
    near, far = x[small], x[~small]
    if power == 1:
        result[small] = np.polynomial.polynomial.polyval(near, _RAMP_SERIES)
        result[~small] = (far * np.exp(far) - np.expm1(far)) / far**2
        return np.asarray(result * tau**2)
    series = np.array([1.0 / (math.factorial(k) * (k + power + 1)) for k in range(40)])
    result[small] = np.polynomial.polynomial.polyval(near, series)
    found = np.expm1(far) / far
    for k in range(1, power + 1):
        found = (np.exp(far) - k * found) / far
    result[~small] = found
    return np.asarray(result * tau ** (power + 1))


def quadrature(function: Callable[[Array], Array], tau: Array, rate: float) -> Array:
    """Return the integral of a function from 0 to each tau, by panels shorter than 1/rate."""
    targets, inverse = np.unique(np.append(tau, 0.0), return_inverse=True)
    widths = np.diff(targets)
    panels = np.maximum(1, np.ceil(widths * max(rate, 1e-300))).astype(int)
    size = np.repeat(widths / panels, panels)
    number = np.arange(size.size) - np.repeat(np.cumsum(panels) - panels, panels)
    edges = np.repeat(targets[:-1], panels) + size * number
    values, short = np.zeros(edges.size), size * rate <= _SHORT
    chunk = 4096
    for which, (nodes, weights) in ((short, _FEW_NODES), (~short, _NODES)):
        own = np.flatnonzero(which)
        for k in range(0, own.size, chunk):
            part = own[k : k + chunk]
            at = edges[part, None] + 0.5 * size[part, None] * (1.0 + nodes)
            values[part] = 0.5 * size[part] * (function(at.ravel()).reshape(at.shape) @ weights)
    ends = np.concatenate([[0.0], np.cumsum(values)[np.cumsum(panels) - 1]]) if edges.size else np.zeros(1)
    return ends[inverse.ravel()[:-1]]


def _times(matrix: Array, columns: Array) -> Array:
    """Return ``matrix @ columns``, where a vector is the diagonal of the matrix."""
    return matrix[:, None] * columns if matrix.ndim == 1 else matrix @ columns


def _products(rows: Array, others: Array) -> Array:
    """Return the scalar products of the rows of two matrices, shape (n_times,)."""
    return np.asarray(np.einsum("tk,tk->t", rows, others))


def _runs(segment: Integers) -> list[tuple[int, slice]]:
    """Return segments and the places of their times, which are in ascending order."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(segment)) + 1, [segment.size]])
    return [
        (int(segment[i]), slice(i, j)) for i, j in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True) if j > i
    ]
