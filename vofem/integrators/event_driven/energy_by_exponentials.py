"""Work and dissipation of one segment by its exponentials, where the forms of `energy_forms` do not hold.

Velocities and loads are sums of exponentials, so their products integrate in
closed form, independently of the energies that they must balance. Blocks whose
motion is no plain sum of exponentials (resonant, rigid, critically damped, in
clusters) are integrated by Gauss-Legendre panels that resolve them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.clusters import ClusterFlow
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.integrators.event_driven.motion import Motion, Special
from vofem.integrators.event_driven.segment import Segment
from vofem.system import CLOSED, ContactLaws
from vofem.time_functions import Piece

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: Roots closer than this, relatively, make a block degenerate: squares of its exponentials lose twice the digits.
_DOUBLE = 3e-2

#: Taylor coefficients of the integral of ``s exp(x s)`` from 0 to 1; enough for |x| < 0.5.
_RAMP_SERIES = np.array([1.0 / (math.factorial(k) * (k + 2)) for k in range(16)])

#: Exponentials that are so many times faster than odd blocks are integrated by parts.
_FASTER = 8.0

#: Decay, as a power of e, beyond which a term counts as zero; ratio of the last to the first of the times that are
#: treated together; and number of times up to which all are treated together.
_DECAYED, _BATCH, _FEW = 45.0, 2.0, 16

#: Rules of Gauss for panels, and length of a panel, over the shortest time scale, up to which the first one is exact to
#: rounding.
_FEW_NODES, _NODES = np.polynomial.legendre.leggauss(4), np.polynomial.legendre.leggauss(12)
_SHORT = 0.1


class Velocities:
    """Velocities of one segment as sums of exponentials, block by block.

    Block k has the exponents ``mu[k]``, shape (n, e): its two roots, plus and
    minus every load frequency, and zero; `z` and `v` hold the coefficients.
    """

    def __init__(self, space: ModalSpace, laws: ContactLaws | None, segment: Segment) -> None:
        self.motion = segment.motion
        self.space = space
        self.laws = laws
        self.status = segment.status
        motion, spectrum = self.motion, self.motion.spectrum
        n, h = spectrum.p.size, motion.omega.size
        root = np.sqrt(np.asarray(spectrum.delta**2 - spectrum.p, dtype=complex))
        first, second = -spectrum.delta + root, -spectrum.delta - root
        overdamped = spectrum.delta > np.abs(root.imag)
        first = np.where(overdamped & (second != 0), spectrum.p / np.where(second == 0, 1.0, second), first)
        self.odd = np.abs(first - second) <= _DOUBLE * np.maximum(np.abs(first), np.abs(second))
        self.odd[motion.special.block] = True
        self.odd[motion.clusters.member] = True
        gap = np.where(self.odd, 1.0, first - second)
        self.mu = np.zeros((n, 3 + 2 * h), dtype=complex)
        self.z, self.v = np.zeros_like(self.mu), np.zeros_like(self.mu)
        self.mu[:, 0], self.mu[:, 1] = first, second
        self.z[:, 0] = (motion.v - second * motion.z) / gap
        self.z[:, 1] = (first * motion.z - motion.v) / gap
        self.v[:, :2] = self.mu[:, :2] * self.z[:, :2]
        for i, w in enumerate(motion.omega):
            self.mu[:, 2 + 2 * i], self.mu[:, 3 + 2 * i] = 1j * w, -1j * w
        self.z[self.odd], self.v[self.odd] = 0.0, 0.0
        self._steady(self.z, self.v, ~self.odd)

    def _velocity_rows(self, rows: Any) -> tuple[Any, Any]:
        """Return (W, U) with ``rows @ modal velocity = W z + U v``."""
        spectrum = self.motion.spectrum
        local = rows if spectrum.real.modes is None else rows @ spectrum.real.modes
        if spectrum.blocks is None:
            return np.zeros_like(local), local
        both = local @ spectrum.blocks.out[spectrum.p.size :]
        return both[:, : spectrum.p.size], both[:, spectrum.p.size :]

    def work(self, rows: Array, pieces: list[Piece], tau: Array) -> Array:
        """Return the work of all loads from the segment's start to tau.

        Loads are added up first: constants, slopes, and harmonics of one frequency are one load each.
        """
        total = np.zeros(tau.size)
        constant = sum((piece.constant * row for piece, row in zip(pieces, rows, strict=True) if piece.constant), 0.0)
        slope = sum((piece.slope * row for piece, row in zip(pieces, rows, strict=True) if piece.slope), 0.0)
        if np.any(constant):
            c, mu, drift = self._power(np.asarray(constant))
            total += _integrals(c, mu, tau) + drift.real * tau**2 / 2.0
        if np.any(slope):
            c, mu, drift = self._power(np.asarray(slope))
            total += (ramp_integral(mu, tau) @ c).real + drift.real * tau**3 / 3.0
        waves: dict[float, Complex] = {}
        for piece, row in zip(pieces, rows, strict=True):
            for omega, amplitude in piece.harmonics:
                waves[omega] = waves.get(omega, 0.0) + amplitude * row
        for omega, wave in waves.items():
            c, mu, drift = self._power(wave)
            total += _integrals(c, 1j * omega + mu, tau)
            if drift != 0.0:
                total += (drift * ramp_integral(np.array([1j * omega]), tau)[:, 0]).real
        if np.any(self.odd):
            w, u = self._velocity_rows(rows)
            total += self._odd_work(w, u, pieces, tau)
        return total

    def _power(self, row: Array | Complex) -> tuple[Complex, Complex, complex]:
        """Return ``row @ modal velocity`` of the even blocks as a sum: coefficients, exponents, linear part.

        Exponents that several blocks share, which are those of the loads, occur once in the sum. Parts that grow
        linearly cancel in the sum over all blocks, but not in the sum over some of them.
        """
        w, u = self._velocity_rows(row[None])
        w, u = w[0], u[0]
        (c,), mu = _gathered((w[:, None] * self.z + u[:, None] * self.v)[None], self.mu)
        drift = 0j
        if np.any(self.odd):
            even = ~self.odd
            drift = complex(w[even] @ self.motion.poly_z[even, 1] + u[even] @ self.motion.poly_v[even, 1])
        return c, mu, drift

    def _odd_work(self, w: Array, u: Array, pieces: list[Piece], tau: Array) -> Array:
        motion = _only(self.motion, self.odd)

        def power(at: Array) -> Array:
            z, v = motion.blocks(at)
            speed = w[:, self.odd] @ z + u[:, self.odd] @ v
            force = np.stack([_value(piece, at) for piece in pieces])
            return np.sum(force * speed, axis=0)

        quickest = max((w for piece in pieces for w, _ in piece.harmonics), default=0.0)
        return quadrature(power, tau, quickest + _quickest(motion))

    def dissipation(self, tau: Array) -> Array:
        """Return the energy dissipated by all dampers from the segment's start to tau."""
        if self.motion.spectrum.classical:
            return self._classical_dissipation(tau)
        rows = self._damping_rows()
        w, u = self._velocity_rows(rows)
        if np.any(self.odd) and (self.motion.ramps or self.motion.clusters.rate.size):

            def power(at: Array) -> Array:
                z, v = self.motion.blocks(at)
                return np.sum((w @ z + u @ v) ** 2, axis=0)

            return quadrature(power, tau, _quickest(self.motion))
        z, v = self.z.copy(), self.v.copy()
        if np.any(self.odd):
            # The response to loads and constants is a sum of exponentials in all blocks.
            self._steady(z, v, self.odd)
        gathered, unique = _gathered(w[:, :, None] * z + u[:, :, None] * v, self.mu)
        gram = gathered.T @ gathered
        total = unique[:, None] + unique[None, :]
        steady = np.abs(total) * max(float(tau.max()), 1e-300) < 1e-12
        quotient = np.where(steady, 0.0, gram / np.where(steady, 1.0, total))
        taken = _moving(quotient, unique, tau) + gram[steady].sum().real * tau
        if np.any(self.odd):
            taken += self._odd_dissipation(w[:, self.odd], u[:, self.odd], gathered, unique, tau)
        return taken

    def _odd_dissipation(self, w: Array, u: Array, others: Complex, mu: Complex, tau: Array) -> Array:
        """Return the energy that is dissipated by the free motion of odd blocks and by their responses from rest.

        Squares and products with exponentials of similar rates are smooth, and a few panels integrate them. Products
        with faster exponentials follow from the equation of motion of the blocks, by integration by parts.

        Parameters
        ----------
        w, u : ndarray, shape (k, n_odd)
            The damping rows of these blocks.
        others : ndarray of complex, shape (k, n_mu)
            The rows' velocities without them, as a sum of ``exp(mu t)``.
        """
        motion = _only(self.motion, self.odd)
        still = np.zeros_like(motion.steady_z), np.zeros_like(motion.poly_z)
        motion = replace(motion, start=(motion.z, motion.v), steady_z=still[0], steady_v=still[0], poly_z=still[1],
                         poly_v=still[1])  # fmt: skip
        rate = _quickest(motion)
        slow = np.abs(mu) <= _FASTER * rate
        near, mu_near = others[:, slow], mu[slow]

        def power(at: Array) -> Array:
            z, v = motion.blocks(at)
            own = w @ z + u @ v
            return np.asarray(np.sum(own * (own + 2.0 * (near @ np.exp(np.outer(mu_near, at))).real), axis=0))

        end = np.inf
        if not motion.special.block.size:
            # The free motion alone ends when its slowest root has decayed.
            delta, p = motion.spectrum.delta, motion.spectrum.p
            slowest = delta - np.sqrt(np.maximum(delta**2 - p, 0.0))
            end = _DECAYED / float(slowest.min()) if slowest.min() > 0.0 else np.inf
        total = quadrature(power, np.minimum(tau, end), (1.0 + _FASTER) * rate)
        s = mu[~slow]
        begin = motion.blocks(np.zeros(1))
        change = motion.changes(tau)
        wave = np.expm1(np.outer(tau, s))
        for k in range(w.shape[1]):
            delta, p = motion.spectrum.delta[k], motion.spectrum.p[k]
            # exp(s t) y(t) - y(0), less the contribution of the inputs.
            parts = [wave * (begin[i][k] + change[i][k][:, None]) + change[i][k][:, None] for i in (0, 1)]
            for e in np.flatnonzero(motion.special.block == k):
                exponent, inputs = motion.special.exponent[e], (motion.special.g1[e], motion.special.g2[e])
                for b, g in ((exponent, inputs), (np.conj(exponent), np.conj(inputs))):
                    grown = 0.5 * integral(s + b, tau)
                    parts = [part - amount * grown for part, amount in zip(parts, g, strict=True)]
            determinant = s * (s - 2.0 * delta) + p
            alpha, beta = w[:, k] @ others[:, ~slow], u[:, k] @ others[:, ~slow]
            on_z, on_v = (alpha * (s - 2.0 * delta) + beta * p) / determinant, (beta * s - alpha) / determinant
            total = total + 2.0 * (parts[0] @ on_z + parts[1] @ on_v).real
        return total

    def _steady(self, z: Complex, v: Complex, which: NDArray[np.bool_]) -> None:
        """Fill in the coefficients of the load frequencies and of constants of some blocks, shape (n, e)."""
        own = self.motion
        for coefficients, steady, constant in ((z, own.steady_z, own.poly_z), (v, own.steady_v, own.poly_v)):
            coefficients[which, 2:-1:2] = 0.5 * steady[which]
            coefficients[which, 3:-1:2] = 0.5 * np.conj(steady[which])
            coefficients[which, -1] = constant[which, 0]

    def _classical_dissipation(self, tau: Array) -> Array:
        rate = 2.0 * self.motion.spectrum.delta
        total = np.zeros(tau.size)
        plain = (rate > 0) & ~self.odd
        v, mu = self.v[plain], self.mu[plain]
        for a in range(mu.shape[1]):
            for b in range(a, mu.shape[1]):
                product = rate[plain] * v[:, a] * v[:, b] * (1.0 if a == b else 2.0)
                used = product != 0
                total += (integral(mu[used, a] + mu[used, b], tau) @ product[used]).real
        odd = self.odd & (rate > 0)
        if np.any(odd):
            motion = _only(self.motion, odd)
            total += quadrature(
                lambda at: np.sum(rate[odd][:, None] * motion.blocks(at)[1] ** 2, axis=0),
                tau,
                2 * _quickest(motion),
            )
        return total

    def _damping_rows(self) -> Array:
        """Return rows F with ``C = F'F`` for the damping that acts in this segment."""
        rows = []
        if np.any(self.space.damping):
            rows.append(np.diag(np.sqrt(self.space.damping)))
        if self.space.coupling is not None:
            values, vectors = np.linalg.eigh(self.space.coupling)
            kept = values > 1e-14 * values[-1]
            rows.append(np.sqrt(values[kept])[:, None] * vectors[:, kept].T)
        if self.laws is not None:
            active = (self.status == CLOSED) & (self.laws.damping > 0)
            rows.append(np.sqrt(self.laws.damping[active])[:, None] * self.space.contacts[active])
        return np.concatenate(rows)


def _moving(quotient: Complex, mu: Complex, tau: Array) -> Array:
    """Return ``sum over a, b of quotient_ab (exp((mu_a + mu_b) t) - 1)`` at all t.

    Each product is computed from ``exp(mu t) - 1``, because only this is accurate in short segments. Terms that have
    decayed before a batch of times are constant there, so that few terms remain for late times.
    """
    result = np.empty(tau.size)
    for mine, alive in _batches(mu, tau):
        over = ~alive
        wave = np.expm1(np.outer(tau[mine], mu[alive]))
        kept = quotient[np.ix_(alive, alive)]
        linear = 2.0 * (quotient[alive].sum(axis=1) - quotient[np.ix_(alive, over)].sum(axis=1))
        constant = quotient[np.ix_(over, over)].sum() - 2.0 * quotient[over].sum()
        result[mine] = (np.einsum("ti,ti->t", wave @ kept, wave) + wave @ linear + constant).real
    return result


def _integrals(c: Complex, mu: Complex, tau: Array) -> Array:
    """Return the real part of the integral of ``sum c exp(mu s)`` from 0 to all tau."""
    result = np.empty(tau.size)
    for mine, alive in _batches(mu, tau):
        over = np.sum(c[~alive] / mu[~alive])
        result[mine] = (integral(mu[alive], tau[mine]) @ c[alive] - over).real
    return result


def _batches(mu: Complex, tau: Array) -> Iterator[tuple[NDArray[np.int64], NDArray[np.bool_]]]:
    """Yield the places of times that are treated together, and which ``exp(mu t)`` have not decayed before them."""
    order = np.argsort(tau, kind="stable")
    at = 0
    while at < tau.size:
        first = tau[order[at]]
        few = tau.size <= _FEW
        until = tau.size if few else at + int(np.searchsorted(tau[order[at:]], _BATCH * first, side="right"))
        yield order[at:until], mu.real * first > -_DECAYED
        at = until


def _gathered(coefficients: Complex, mu: Complex) -> tuple[Complex, Complex]:
    """Return coefficients (k, n_mu) and exponents (n_mu,) of sums over blocks, from (k, n, e) and (n, e).

    Exponents that blocks share, which are those of the loads and zero, stand in it once.
    """
    count = coefficients.shape[0]
    own, shared = coefficients[:, :, :2].reshape(count, -1), coefficients[:, :, 2:].sum(axis=1)
    together = np.hstack([own, shared])
    exponents = np.concatenate([mu[:, :2].ravel(), mu[0, 2:] if mu.size else np.zeros(shared.shape[1])])
    used = np.any(together != 0, axis=0)
    return together[:, used], exponents[used]


def _value(piece: Piece, tau: Array) -> Array:
    values = piece.constant + piece.slope * tau
    for omega, amplitude in piece.harmonics:
        values = values + (amplitude * np.exp(1j * omega * tau)).real
    return values


def integral(mu: Complex, tau: Array) -> Complex:
    """Return the integral of ``exp(mu s)`` from 0 to tau, shape (n_times, n_mu)."""
    zero = mu == 0
    return np.where(zero, tau[:, None], np.expm1(np.outer(tau, mu)) / np.where(zero, 1.0, mu))


def ramp_integral(mu: Complex, tau: Array) -> Complex:
    """Return the integral of ``s exp(mu s)`` from 0 to tau, shape (n_times, n_mu)."""
    x = np.outer(tau, mu)
    small = np.abs(x) < 0.5
    result = np.empty_like(x)
    near, far = x[small], x[~small]
    result[small] = np.polynomial.polynomial.polyval(near, _RAMP_SERIES)
    result[~small] = (far * np.exp(far) - np.expm1(far)) / far**2
    return np.asarray(result * (tau**2)[:, None])


def _only(motion: Motion, keep: NDArray[np.bool_]) -> Motion:
    """Return the motion of some of the blocks."""
    spectrum = replace(motion.spectrum, delta=motion.spectrum.delta[keep], p=motion.spectrum.p[keep])
    number = np.cumsum(keep) - 1
    entries = keep[motion.special.block]
    old = motion.special
    special = Special(
        number[old.block[entries]].astype(np.int64),
        old.exponent[entries],
        old.g1[entries],
        old.g2[entries],
        old.ramp[entries],
    )
    together: ClusterFlow = motion.clusters
    return replace(
        motion,
        spectrum=spectrum,
        start=(motion.start[0][keep], motion.start[1][keep]),
        z=motion.z[keep],
        v=motion.v[keep],
        steady_z=motion.steady_z[keep],
        steady_v=motion.steady_v[keep],
        poly_z=motion.poly_z[keep],
        poly_v=motion.poly_v[keep],
        special=special,
        # The members of clusters are always kept, or there are none.
        clusters=together._replace(member=number[together.member].astype(np.int64)),
    )


def _quickest(motion: Motion) -> float:
    """Return the largest rate at which blocks or their inputs change, 1/s."""
    rates = [np.sqrt(motion.spectrum.p), motion.spectrum.delta, np.abs(motion.special.exponent), motion.omega]
    return float(np.max(np.concatenate(rates)))


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
