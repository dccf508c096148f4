"""Work and dissipation of many segments at once, as linear and quadratic forms of the block states.

The blocks of a status obey ``x' = A x + g(t)``, where x holds the displacements z and the velocities v of all blocks.
Their motion is written as ``x = h + s``. The part s is the response to loads, and to springs whose force is zero at a
displacement other than zero. It is a sum of exponentials and a ramp. The part h is free motion, except in blocks that
have no such response (resonance, blocks that are slower than the run).

Dampers take the power ``x' Q x``. The matrix P with ``A' P + P A = -Q`` is computed once for each status, block by
block in closed form. The energy that free motion loses is then ``h' P h`` at its start minus that at its end. Integrals
of ``exp(i w t) r h`` follow in the same way from the row y with ``(A' + i w) y = r``. Each time costs one evaluation of
the blocks and some products of matrices, however many exponentials the motion has. P is computed from the dampers and
the roots alone, so that the energy balance is an independent check.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.energy_by_exponentials import integral, quadrature, ramp_integral
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.integrators.event_driven.motion import (
    RESONANT,
    Forcing,
    Special,
    add_special,
    free_changes,
    start_motion,
)
from vofem.integrators.event_driven.spectrum import Spectrum
from vofem.system import CLOSED, ContactLaws

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Integers = NDArray[np.int64]

#: Times that are treated together.
_TOGETHER = 4096

#: Multiple of a block's energy above which its computed loss is taken as rounding.
_MORE = 4.0

#: Share of coupling by damping below which motions count as not coupled.
_ROUNDING = 4.0 * float(np.finfo(float).eps)


class Loads(NamedTuple):
    """The loads of some segments from their starts: ``constant + slope tau + sum Re(amplitude exp(i omega tau))``.

    Attributes
    ----------
    omega : ndarray, shape (n_h,)
        Angular frequencies in rad/s.
    constant, slope : ndarray, shape (n_functions, k)
    amplitude : ndarray of complex, shape (n_h, n_functions, k)
    """

    omega: Array
    constant: Array
    slope: Array
    amplitude: Complex


class StatusForms:
    """The forms of one status.

    Parameters
    ----------
    space : ModalSpace
    laws : ContactLaws, optional
    status : ndarray of int, shape (n_contacts,)
        Status of the contacts.
    spectrum : Spectrum
        Spectrum without clusters.
    vectors : ndarray, shape (n_functions, n)
        Modal load vectors.
    push : ndarray, shape (n,)
        Modal force of closed contacts at zero displacement, and the force that pinned contacts need at their gaps
        beside their reactions.
    horizon : float
        Longest time in s for which a motion is computed.
    damped : bool
        Whether there are any dampers.
    """

    def __init__(
        self, space: ModalSpace, laws: ContactLaws | None, status: Integers, spectrum: Spectrum, vectors: Array,
        push: Array, horizon: float, damped: bool,
    ) -> None:  # fmt: skip
        self.spectrum, self.horizon, self.damped, self.certain = spectrum, horizon, damped, True
        self.sources = np.vstack([vectors, push])
        n = spectrum.p.size
        self.slow = spectrum.p * horizon**2 < 1.0
        local = np.asarray(spectrum.real.down(vectors.T)).T
        if spectrum.blocks is None:
            self.rows = np.hstack([np.zeros_like(local), local])
            rates = 2.0 * spectrum.delta
            # For real modes P is that of the energy.
            self.power = np.concatenate([np.zeros(n), rates])
            self.lost = np.where(np.tile(rates > 0.0, 2), np.concatenate([0.5 * spectrum.p, np.full(n, 0.5)]), 0.0)
            return
        velocity = spectrum.blocks.out[n:]
        self.rows = local @ velocity
        if damped:
            velocity = spectrum.real.up(velocity)
            force = space.damping_force(velocity)
            if laws is not None:
                active = np.flatnonzero((status == CLOSED) & (laws.damping > 0.0))
                rows = space.contacts[active]
                force = force + rows.T @ (laws.damping[active, None] * (rows @ velocity))
            self.power = velocity.T @ force
            out = spectrum.blocks.out
            energy = 0.5 * (spectrum.real.p @ out[:n] ** 2 + np.sum(out[n:] ** 2, axis=0))
            own = self.power.diagonal()
            # The energy that a block loses by itself in the whole run may be rounding, which its decay rate does not
            # show.
            faint = np.all((own * horizon <= np.finfo(float).eps * energy).reshape(2, n), axis=0)
            self.lost = _lost(spectrum.delta, spectrum.p, self.power, faint)
            # No block can lose more energy than it has, unless its decay rate is rounding.
            self.certain = bool(np.all(np.abs(self.lost.diagonal()) <= _MORE * energy))

    def taken(
        self, loads: Loads, displacement: Array, velocity: Array, segment: Integers, tau: Array
    ) -> tuple[Array, Array] | None:
        """Return the work of loads and the energy dissipated by dampers since the start of a segment, each (n_times,).

        None if these forms do not hold: in damped systems with blocks that are slower than the run or nearly defective.

        Parameters
        ----------
        displacement, velocity : ndarray, shape (k, n)
            Modal states at the start of k segments.
        segment : ndarray of int, shape (n_times,)
            Number of the segment of each time, in ascending order.
        tau : ndarray, shape (n_times,)
            Times from the starts, s.
        """
        if not self.spectrum.p.size:
            # All contacts of a few masses are pinned: nothing moves.
            return np.zeros(tau.size), np.zeros(tau.size)
        if self.damped and not (self.certain and (self.spectrum.classical or not np.any(self.slow))):
            return None
        answer = self._answer(loads)
        if self.damped and np.any(answer.ramp):
            return None
        start = np.concatenate(self.spectrum.to_blocks(displacement.T, velocity.T)) - answer.steady.real.sum(axis=0)
        constant, slope = self.rows.T @ loads.constant, self.rows.T @ loads.slope
        working = np.concatenate([constant[None], np.einsum("fn,hfk->hnk", self.rows, loads.amplitude)])
        forms = [_Form(working, working, slope if np.any(slope) else None, None)]
        if self.damped:
            braking = np.stack([_times(self.power, part) for part in answer.steady])
            forms.append(_Form(2.0 * (braking + self._pushed(answer)), braking, None, _times(self.lost, start)))
        work, *others = self._integrals(forms, answer, start, np.append(0.0, loads.omega), segment, tau)
        return work, others[0] if others else np.zeros(tau.size)

    def _answer(self, loads: Loads) -> _Answer:
        """Return the steady responses to the loads of some segments, and the blocks that have none."""
        spectrum, horizon = self.spectrum, self.horizon
        n, count, waves = spectrum.p.size, loads.constant.shape[1], loads.omega.size
        steady = np.zeros((1 + waves, 2 * n, count), dtype=complex)
        entries: list[tuple[int, int, Complex, Complex, bool]] = []
        nothing = np.zeros(self.sources.shape[1])
        none = Forcing(np.zeros(0), np.zeros((nothing.size, 0), dtype=complex), nothing, nothing)

        def add(forcing: Forcing, amounts: Complex) -> None:
            """Add the answer to a unit forcing times amounts, shape (n_h or 1, k)."""
            unit = start_motion(spectrum, nothing, nothing, forcing, horizon)
            if forcing.omega.size:
                both = np.concatenate([unit.steady_z, unit.steady_v])
                steady[1:] += both.T[:, :, None] * amounts[:, None, :]
            else:
                steady[0] += np.concatenate([unit.poly_z[:, 0], unit.poly_v[:, 0]])[:, None] * amounts
            for k, b, g1, g2, ramp in zip(*unit.special, strict=True):
                place = int(np.argmax(forcing.omega == b.imag)) if forcing.omega.size else 0
                at = 1 + place if forcing.omega.size else 0
                entries.append((int(k), at, g1 * amounts[place], g2 * amounts[place], bool(ramp)))

        constants = np.vstack([loads.constant, np.ones(count)])
        for i, source in enumerate(self.sources):
            if not np.any(source):
                continue
            if np.any(constants[i]):
                add(none._replace(constant=source), constants[i : i + 1].astype(complex))
            if i == loads.slope.shape[0]:
                continue
            if np.any(loads.slope[i]):
                add(none._replace(slope=source), loads.slope[i : i + 1].astype(complex))
            if np.any(loads.amplitude[:, i]):
                wave = np.repeat(source[:, None].astype(complex), waves, axis=1)
                add(none._replace(omega=loads.omega, harmonic=wave), loads.amplitude[:, i])
        entries = _together(entries)
        block, at, g1, g2, ramp = (
            (list(part) for part in zip(*entries, strict=True)) if entries else ([] for _ in "12345")
        )
        apart = self.slow.copy()
        apart[list(block)] = True
        for w in loads.omega:
            impedance = spectrum.p - w * w + 2j * spectrum.delta * w
            apart |= np.abs(impedance) < RESONANT * np.maximum(spectrum.p, w * w)
        first, second = (np.array(part, dtype=complex).reshape(-1, count) for part in (g1, g2))
        return _Answer(
            steady, apart, np.array(block, dtype=np.int64), np.array(at, dtype=np.int64), first, second,
            np.array(ramp, dtype=bool),
        )  # fmt: skip

    def _pushed(self, answer: _Answer) -> Complex:
        """Return ``P g`` of the inputs that have no steady answer, shaped as these are."""
        n = self.spectrum.p.size
        force = np.zeros_like(answer.steady)
        for k, at, g1, g2 in zip(answer.block, answer.at, answer.g1, answer.g2, strict=True):
            force[at, k] += g1
            force[at, n + k] += g2
        return np.stack([_times(self.lost, part) for part in force]) if answer.block.size else force

    def _integrals(
        self, forms: list[_Form], answer: _Answer, start: Array, nu: Array, segment: Integers, tau: Array
    ) -> list[Array]:
        """Return the integrals of the forms from 0 to all tau, each (n_times,)."""
        rows, parts = [], []
        for form in forms:
            y = self._row(form.free, nu, answer.apart)
            rows += [*y.real, *y.imag]
            ramp = twice = np.zeros((0, *start.shape))
            if form.slope is not None:
                ramp = self._row(form.slope[None].astype(complex), nu[:1], answer.apart).real
                twice = self._row(ramp.astype(complex), nu[:1], answer.apart).real
            rows += [*ramp, *twice]
            if form.lost is not None:
                rows.append(2.0 * form.lost)
            begin = np.einsum("jnk,nk->jk", y, start), np.einsum("jnk,nk->jk", ramp, start)
            added = np.einsum("jnk,lnk->jlk", form.own, answer.steady)
            less = np.einsum("jnk,lnk->jlk", form.own, np.conj(answer.steady))
            rising = None if form.slope is None else np.einsum("nk,lnk->lk", form.slope, answer.steady)
            parts.append(_Steady(begin, added, less, rising))
        stacked = np.ascontiguousarray(np.transpose(rows, (2, 0, 1)))
        found = np.zeros((len(forms), tau.size))
        begins = np.ascontiguousarray(start.T)
        for first in range(0, tau.size, _TOGETHER):
            at = slice(first, first + _TOGETHER)
            found[:, at] = self._values(begins, stacked, forms, parts, answer, nu, segment[at], tau[at])
        if np.any(answer.apart):
            for s, own in _runs(segment):
                for form, total in zip(forms, found, strict=True):
                    total[own] += self._apart(form, answer, start[:, s], nu, s, tau[own])
        return list(found)

    def _values(
        self, begins: Array, rows: Array, forms: list[_Form], parts: list[_Steady], answer: _Answer, nu: Array,
        own: Integers, t: Array,
    ) -> list[Array]:  # fmt: skip
        """Return the integrals of the forms from 0 to some times, each (n_times,).

        Parameters
        ----------
        begins : ndarray, shape (k, 2n)
            Free block states at the begins of k segments.
        rows : ndarray, shape (k, n_rows, 2n)
            Rows over the block states.
        """
        delta, p, size = self.spectrum.delta, self.spectrum.p, nu.size
        change, along = np.empty((t.size, 2 * p.size)), np.empty((rows.shape[1], t.size))
        for s, mine in _runs(own):
            z, v = free_changes(delta, p, begins[s, : p.size], begins[s, p.size :], t[mine])
            if answer.block.size:
                add_special(delta, p, *answer.special(s, nu), t[mine], z, v)
            change[mine] = np.concatenate([z, v]).T
            along[:, mine] = rows[s] @ change[mine].T
        turn = np.asarray(1j * nu, dtype=complex)
        wave, at, values = np.expm1(turn[:, None] * t), 0, []
        plus, minus = _of_products(nu, t)
        for form, (begin, added, less, rising) in zip(forms, parts, strict=True):
            dot = along[at : at + size] + 1j * along[at + size : at + 2 * size]
            at += 2 * size
            value = np.sum(wave * begin[0][:, own] + (1.0 + wave) * dot, axis=0).real
            value += 0.5 * np.sum(added.reshape(size**2, -1)[:, own] * plus, axis=0).real
            value += 0.5 * np.sum(less.reshape(size**2, -1)[:, own] * minus, axis=0).real
            if rising is not None:
                value += t * (begin[1][0, own] + along[at]) - along[at + 1]
                value += np.sum(rising[:, own] * ramp_integral(turn, t).T, axis=0).real
                at += 2
            if form.lost is not None:
                value -= _squares(self.lost, change) + along[at]
                at += 1
            values.append(value)
        return values

    def _row(self, r: Complex, nu: Array, apart: NDArray[np.bool_]) -> Complex:
        """Return y with ``(A' + i nu) y = r`` over the blocks that are not apart, and zero over the others."""
        n = self.spectrum.p.size
        p, delta = np.where(apart, 1.0, self.spectrum.p)[:, None], self.spectrum.delta[:, None]
        y = np.empty_like(r)
        for part, row, w in zip(y, r, nu, strict=True):
            first, second = (np.where(apart[:, None], 0.0, half) for half in (row[:n], row[n:]))
            impedance = np.where(apart[:, None], 1.0, p - w * w - 2j * w * delta)
            part[n:] = (1j * w * second - first) / impedance
            part[:n] = second - (1j * w - 2.0 * delta) * part[n:]
        return y

    def _apart(self, form: _Form, answer: _Answer, start: Array, nu: Array, s: int, tau: Array) -> Array:
        """Return what blocks without a steady response, which are about as slow as the loads, contribute to a form."""
        n, keep = self.spectrum.p.size, np.flatnonzero(answer.apart)
        delta, p = self.spectrum.delta[keep], self.spectrum.p[keep]
        both = np.concatenate([keep, n + keep])
        rows, rising = form.free[:, both, s], np.zeros(both.size) if form.slope is None else form.slope[both, s]
        if not (np.any(rows) or np.any(rising)):
            return np.zeros(tau.size)
        begin = start[keep], start[n + keep]
        special = answer.special(s, nu)
        special = special._replace(block=np.searchsorted(keep, special.block))

        def power(at: Array) -> Array:
            z, v = free_changes(delta, p, *begin, at)
            if special.block.size:
                add_special(delta, p, *special, at, z, v)
            state = np.concatenate([z + begin[0][:, None], v + begin[1][:, None]])
            return np.sum(((rows.T @ np.exp(1j * nu[:, None] * at)).real + rising[:, None] * at) * state, axis=0)

        return quadrature(power, tau, float(nu.max() + np.sqrt(p.max()) + delta.max()))


class _Answer(NamedTuple):
    """Steady answers to the loads of k segments.

    Attributes
    ----------
    steady : ndarray of complex, shape (1 + n_h, 2n, k)
        Responses of the block states to the constant part of the loads and to each frequency.
    apart : ndarray of bool, shape (n,)
        Blocks that have no steady response to any load.
    block, at : ndarray of int, shape (e,)
        The blocks that inputs act on, and the number of the frequency of each input, 0 for constant inputs.
    g1, g2 : ndarray of complex, shape (e, k)
        Their amplitudes.
    ramp : ndarray of bool, shape (e,)
        Whether an input grows with time instead.
    """

    steady: Complex
    apart: NDArray[np.bool_]
    block: Integers
    at: Integers
    g1: Complex
    g2: Complex
    ramp: NDArray[np.bool_]

    def special(self, s: int, nu: Array) -> Special:
        """Return the inputs of one segment."""
        exponent = np.asarray(1j * nu[self.at], dtype=complex)
        return Special(self.block, exponent, self.g1[:, s].copy(), self.g2[:, s].copy(), self.ramp)


class _Steady(NamedTuple):
    """What steady answers contribute to a form: rows times the free motion at the start, products of steady answers.

    Attributes
    ----------
    begin : (ndarray of complex, shape (1 + n_h, k); ndarray, shape (0 or 1, k))
        Of constants and frequencies, and of slopes.
    added, less : ndarray of complex, shape (1 + n_h, 1 + n_h, k)
        Products with the answers, and with their conjugates.
    rising : ndarray of complex, shape (1 + n_h, k), optional
        Products of slopes with the answers.
    """

    begin: tuple[Complex, Array]
    added: Complex
    less: Complex
    rising: Complex | None


class _Form(NamedTuple):
    """The integral of ``Re(free exp(i nu t)) h + Re(own exp(i nu t)) s + slope t (h + s)``, and what dampers take.

    Attributes
    ----------
    free, own : ndarray of complex, shape (1 + n_h, 2n, k)
    slope : ndarray, shape (2n, k), optional
    lost : ndarray, shape (2n, k), optional
        ``P h`` at the start, where ``h' Q h`` is integrated too.
    """

    free: Complex
    own: Complex
    slope: Array | None
    lost: Array | None


def _lost(delta: Array, p: Array, power: Array, faint: NDArray[np.bool_]) -> Array:
    """Return P with ``A' P + P A = -Q``, shape (2n, 2n).

    Two blocks give four equations, whose determinant is a sum of terms that are not negative: repeated and critically
    damped roots are no special cases. Blocks that are faint lose nothing by themselves.
    """
    n = p.size
    size = np.sqrt(np.maximum(power.diagonal(), 0.0))
    power = np.where(np.abs(power) > _ROUNDING * np.outer(size, size), power, 0.0)
    zz, zv, vz, vv = power[:n, :n], power[:n, n:], power[n:, :n], power[n:, n:]
    d, e, q = delta[:, None], delta[None, :], p[None, :]
    p = p[:, None]
    s, apart, both = 2.0 * (d + e), p - q, 2.0 * (d * q + e * p)
    determinant = apart**2 + s * both
    known = (determinant > 0.0) & ~np.diag(faint)
    scale = np.where(known, 1.0 / np.where(known, determinant, 1.0), 0.0)
    twist = vz - zv
    g = (s * zz - apart * twist + both * vv) * scale
    c = (apart * (zz + q * vv) + s * (q * twist + 2.0 * e * zz)) * scale
    b = (-apart * (zz + p * vv) + s * (2.0 * d * zz - p * twist)) * scale
    return np.block([[np.where(known, p * g + 2.0 * e * b - zv, 0.0), b], [c, g]])


def _of_products(nu: Array, t: Array) -> tuple[Complex, Complex]:
    """Return the integrals of ``exp(i (a + b) s)`` and ``exp(i (a - b) s)`` from 0 to t, each (n_h^2, n_times)."""
    both = np.concatenate([(nu[:, None] + nu).ravel(), (nu[:, None] - nu).ravel()])
    every, place = np.unique(np.abs(both), return_inverse=True)
    values = integral(np.asarray(1j * every, dtype=complex), t).T[place.ravel()]
    values[both < 0.0] = np.conj(values[both < 0.0])
    return values[: nu.size**2], values[nu.size**2 :]


def _together(
    entries: list[tuple[int, int, Complex, Complex, bool]],
) -> list[tuple[int, int, Complex, Complex, bool]]:
    """Return one entry for all inputs of one block, of one frequency and kind."""
    sums: dict[tuple[int, int, bool], tuple[Complex, Complex]] = {}
    for block, at, g1, g2, ramp in entries:
        before = sums.get((block, at, ramp))
        sums[block, at, ramp] = (g1, g2) if before is None else (before[0] + g1, before[1] + g2)
    return [(block, at, *both, ramp) for (block, at, ramp), both in sums.items()]


def _times(matrix: Array, columns: Any) -> Any:
    """Return ``matrix @ columns`` of a real matrix, of which a vector is the diagonal."""
    if matrix.ndim == 1:
        return matrix[:, None] * columns
    # Real and imaginary parts apart: the product of a real with a complex matrix takes a hundred times as long.
    return matrix @ columns.real + 1j * (matrix @ columns.imag) if np.iscomplexobj(columns) else matrix @ columns


def _squares(matrix: Array, rows: Array) -> Array:
    """Return ``x' matrix x`` of all rows x, shape (n_times,), of a matrix of which a vector is the diagonal."""
    if matrix.ndim == 1:
        return rows**2 @ matrix
    return np.asarray(np.einsum("tk,tk->t", rows @ matrix, rows))


def _runs(segment: Integers) -> list[tuple[int, slice]]:
    """Return segments and the places of their times, which are in ascending order."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(segment)) + 1, [segment.size]])
    return [
        (int(segment[i]), slice(i, j)) for i, j in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True) if j > i
    ]
