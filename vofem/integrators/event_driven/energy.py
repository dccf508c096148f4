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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.load_table import LoadTable
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.integrators.event_driven.motion import RESONANT, Forcing, Motion, add_special, free_changes, start_motion
from vofem.integrators.event_driven.record import Record
from vofem.integrators.event_driven.spectrum import Spectrum
from vofem.linalg.oscillators import free_rows, oscillators
from vofem.system import CLOSED, ContactLaws

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

#: Times that are treated together.
_TOGETHER = 4096

#: Multiple of a block's energy above which its computed loss is rounding of a very small decay rate.
_MORE = 4.0

_EPS = float(np.finfo(float).eps)

#: Taylor coefficients of the integral of ``s exp(x s)`` from 0 to 1; enough for |x| < 0.5.
_RAMP_SERIES = np.array([1.0 / (math.factorial(k) * (k + 2)) for k in range(16)])

#: Rules of Gauss for panels, and length of a panel, over the shortest time scale, up to which the first one is exact to
#: rounding.
_FEW_NODES, _NODES = np.polynomial.legendre.leggauss(4), np.polynomial.legendre.leggauss(12)
_SHORT = 0.1


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

    def at(self, s: int, tau: Array) -> Array:
        """Return the functions of one segment at some times, shape (n_functions, n_times)."""
        wave = np.exp(1j * self.omega[:, None] * tau)
        lines = self.constant[:, s, None] + self.slope[:, s, None] * tau
        return np.asarray(lines + np.einsum("hf,ht->ft", self.amplitude[:, :, s], wave).real)


class _Answers(NamedTuple):
    """Answers of a status to loads of some frequencies, each of e pairs (load, frequency) with its state and rate.

    Attributes
    ----------
    load : ndarray of int, shape (e,)
        Number of the load.
    omega : ndarray, shape (e,)
        Frequency in rad/s, 0 for lines.
    steady, driven : ndarray, shape (2m, 2e)
        B and G.
    apart : ndarray of bool, shape (m, e)
        Blocks that have no steady answer.
    """

    load: Integers
    omega: Array
    steady: Array
    driven: Array
    apart: Flags


class _Form(NamedTuple):
    """The integral of ``y' Q y + 2 y' R w + w' T w``.

    Attributes
    ----------
    blocks : ndarray, shape (2m, 2m) or (2m,), optional
        P of the blocks, or its diagonal; None where they do not enter.
    mixed : ndarray, shape (2m, 2e)
        P between blocks and loads.
    loads : ndarray, shape (2e, 2e)
        What is left between loads.
    panels : (ndarray, ndarray)
        Q and R of the products that are integrated on panels, shapes (2m, 2m) and (2m, 2e).
    """

    blocks: Array | None
    mixed: Array
    loads: Array
    panels: tuple[Array, Array]


class StatusForms:
    """The forms of one status.

    Parameters
    ----------
    spectrum : Spectrum
        Spectrum without clusters.
    vectors : ndarray, shape (n_functions, n)
        Modal load vectors.
    push : ndarray, shape (n,)
        Modal force of closed contacts at zero displacement, and the force that pinned contacts need at their gaps
        beside their reactions.
    horizon : float
        Longest time in s for which a motion is computed.
    """

    def __init__(self, spectrum: Spectrum, vectors: Array, push: Array, horizon: float) -> None:
        self.spectrum, self.horizon = spectrum, horizon
        self.sources = np.vstack([vectors, push])
        m = spectrum.p.size
        self.slow = spectrum.p * horizon**2 < 1.0
        local = np.asarray(spectrum.real.down(vectors.T)).T
        self.lone = np.zeros((2 * m, 2 * m))
        self._known: dict[bytes, tuple[_Answers, list[_Form]]] = {}
        if spectrum.blocks is None:
            self.rows = np.hstack([np.zeros_like(local), local])
            # For real modes P is that of the energy.
            lossy = np.tile(spectrum.delta > 0.0, 2)
            self.power = np.concatenate([np.zeros(m), 2.0 * spectrum.delta])
            self.lost = np.where(lossy, np.concatenate([0.5 * spectrum.p, np.full(m, 0.5)]), 0.0)
            return
        assert spectrum.damping is not None
        out = spectrum.blocks.out
        self.rows = local @ out[m:]
        self.power = power = out[m:].T @ spectrum.damping @ out[m:]
        energy = 0.5 * (spectrum.real.p @ out[:m] ** 2 + np.sum(out[m:] ** 2, axis=0))
        size = np.sqrt(np.maximum(power.diagonal(), 0.0))
        power = np.where(np.abs(power) > 4.0 * _EPS * np.outer(size, size), power, 0.0)
        # What a block loses by itself in the whole run may be rounding, which its decay rate does not show.
        faint = np.flatnonzero(np.all((size**2 * horizon <= _EPS * energy).reshape(2, m), axis=0))
        for both in ((faint, faint), (faint, m + faint), (m + faint, faint), (m + faint, m + faint)):
            power[both] = 0.0
        self.lost = lyapunov(spectrum.delta, spectrum.p, spectrum.delta, spectrum.p, power)
        unsure = (np.abs(self.lost.diagonal()) > _MORE * energy).reshape(2, m).any(axis=0) | self.slow
        if unsure.any():
            self.lone = np.where(np.outer(np.tile(unsure, 2), np.tile(unsure, 2)), power, 0.0)
            self.lost = lyapunov(spectrum.delta, spectrum.p, spectrum.delta, spectrum.p, power - self.lone)

    def taken(self, loads: Loads, displacement: Array, velocity: Array, segment: Integers, tau: Array) -> Array:
        """Return the work of loads and the energy taken by dampers since the starts of segments, shape (2, n_times).

        Parameters
        ----------
        displacement, velocity : ndarray, shape (k, n)
            Modal states at the start of k segments.
        segment : ndarray of int, shape (n_times,)
            Number of the segment of each time, in ascending order.
        tau : ndarray, shape (n_times,)
            Times from the starts, s.
        """
        found = np.zeros((2, tau.size))
        if not self.spectrum.p.size:
            # All contacts of a few masses are pinned: nothing moves.
            return found
        key = loads.omega.tobytes()
        if key not in self._known:
            answers = self._answers(loads.omega)
            self._known[key] = answers, [self._work(answers), self._loss(answers)]
        answers, forms = self._known[key]
        w = self._load_states(answers, loads)
        y = np.concatenate(self.spectrum.to_blocks(displacement.T, velocity.T)) - answers.steady @ w
        for first in range(0, tau.size, _TOGETHER):
            at = slice(first, first + _TOGETHER)
            found[:, at] = self._values(answers, forms, y, w, segment[at], tau[at])
        for total, form in zip(found, forms, strict=True):
            total += _of_loads(form.loads, answers.omega, w, segment, tau)
            if np.any(form.panels[0]) or np.any(form.panels[1]):
                for s, mine in _runs(segment):
                    total[mine] += self._on_panels(answers, form.panels, y[:, s], w[:, s], tau[mine])
        return found

    def _answers(self, omega: Array) -> _Answers:
        """Return the steady answers to loads of some frequencies, and the inputs of blocks that have none."""
        spectrum, horizon, m = self.spectrum, self.horizon, self.spectrum.p.size
        used = [i for i, source in enumerate(self.sources) if np.any(source)]
        pairs = [(i, w) for i in used for w in ([0.0] if i == len(self.rows) else [0.0, *omega])]
        load, frequency = np.array([i for i, _ in pairs], dtype=np.int64), np.array([w for _, w in pairs])
        e, nothing = load.size, np.zeros(self.sources.shape[1])
        steady, driven = np.zeros((2 * m, 2 * e)), np.zeros((2 * m, 2 * e))
        none = Forcing(np.zeros(0), np.zeros((nothing.size, 0), dtype=complex), nothing, nothing)

        def answer(forcing: Forcing, place: int) -> Motion:
            """Return the answer to a forcing, and enter the inputs of blocks that have none, by the state of a load."""
            unit = start_motion(spectrum, nothing, nothing, forcing, horizon)
            for k, g1, g2, ramp in zip(
                unit.special.block, unit.special.g1.real, unit.special.g2.real, unit.special.ramp, strict=True
            ):
                # Inputs that grow with time are those of the state of a line.
                if not ramp:
                    driven[k, place] += g1
                    driven[m + k, place] += g2
            return unit

        for j, (i, w) in enumerate(pairs):
            source = self.sources[i]
            if w:
                unit = answer(none._replace(omega=np.array([w]), harmonic=source[:, None].astype(complex)), j)
                wave = np.concatenate([unit.steady_z[:, 0], unit.steady_v[:, 0]])
                steady[:, j], steady[:, e + j] = wave.real, wave.imag / w
                continue
            unit = answer(none._replace(constant=source), j)
            steady[:, j] = np.concatenate([unit.poly_z[:, 0], unit.poly_v[:, 0]])
            unit = answer(none._replace(slope=source), e + j)
            steady[:, e + j] = np.concatenate([unit.poly_z[:, 0], unit.poly_v[:, 0]])
        impedance = spectrum.p[:, None] - frequency**2 + 2j * spectrum.delta[:, None] * frequency
        apart = np.abs(impedance) < RESONANT * np.maximum(spectrum.p[:, None], frequency**2)
        apart |= self.slow[:, None] & (frequency * horizon < 1.0)
        return _Answers(load, frequency, steady, driven, apart)

    def _work(self, answers: _Answers) -> _Form:
        """Return the form of the work of loads."""
        e = answers.load.size
        rows = np.zeros((2 * e, 2 * self.spectrum.p.size))
        mine = np.flatnonzero(answers.load < len(self.rows))
        rows[mine] = self.rows[answers.load[mine]]
        loads = rows @ answers.steady
        return self._with_loads(None, None, 0.5 * rows.T, 0.5 * (loads + loads.T), answers)

    def _loss(self, answers: _Answers) -> _Form:
        """Return the form of the energy that dampers take."""
        mixed = _times(self.power, answers.steady)
        loads = answers.steady.T @ mixed
        return self._with_loads(self.lost, self.lone, mixed, loads, answers)

    def _with_loads(
        self, blocks: Array | None, lone: Array | None, mixed: Array, loads: Array, answers: _Answers
    ) -> _Form:
        """Return a form, given P of the blocks and the integrands of products with loads."""
        spectrum, squares = self.spectrum, answers.omega**2
        if blocks is not None:
            mixed = mixed + _times(blocks, answers.driven)
        panels = np.where(np.tile(answers.apart, (2, 2)), mixed, 0.0)
        found = lyapunov(spectrum.delta, spectrum.p, np.zeros_like(squares), squares, mixed - panels)
        rest = found.T @ answers.driven
        return _Form(blocks, found, loads + rest + rest.T, (np.zeros((0, 0)) if lone is None else lone, panels))

    def _load_states(self, answers: _Answers, loads: Loads) -> Array:
        """Return the states of all pairs at the starts of k segments, shape (2e, k)."""
        e, count = answers.load.size, loads.constant.shape[1]
        w = np.zeros((2 * e, count))
        for j, (i, omega) in enumerate(zip(answers.load, answers.omega, strict=True)):
            if i == len(self.rows):
                w[j] = 1.0
            elif omega:
                wave = loads.amplitude[int(np.argmax(loads.omega == omega)), i]
                w[j], w[e + j] = wave.real, -omega * wave.imag
            else:
                w[j], w[e + j] = loads.constant[i], loads.slope[i]
        return w

    def _values(
        self, answers: _Answers, forms: list[_Form], y: Array, w: Array, own: Integers, tau: Array
    ) -> list[Array]:
        """Return the fall of the forms at some times, each (n_times,)."""
        spectrum, squares = self.spectrum, answers.omega**2
        d = free_rows(oscillators(spectrum.delta, spectrum.p), y.T, own, tau)
        u = free_rows(oscillators(np.zeros_like(squares), squares), w.T, own, tau)
        if np.any(answers.driven):
            for s, mine in _runs(own):
                z, v = self._from_rest(answers, w[:, s], tau[mine])
                d[mine] += np.concatenate([z, v]).T
        values = []
        for form in forms:
            fall = np.einsum("tk,tk->t", d, (form.mixed @ w).T[own]) + np.einsum(
                "tk,tk->t", u, (form.mixed.T @ y).T[own]
            )
            fall = 2.0 * (fall + np.einsum("tk,tk->t", d @ form.mixed, u))
            if form.blocks is not None:
                fall += np.einsum("tk,tk->t", d, _times(form.blocks, 2.0 * y).T[own])
                fall += np.einsum("tk,tk->t", _times(form.blocks, d.T).T, d)
            values.append(-fall)
        return values

    def _from_rest(self, answers: _Answers, w: Array, tau: Array) -> tuple[Array, Array]:
        """Return the motion of blocks that loads drive from rest, in one segment, each of shape (m, n_times)."""
        m, e = self.spectrum.p.size, answers.load.size
        z, v = np.zeros((2, m, tau.size))
        entries = []
        for k, j in np.argwhere(np.any(answers.driven.reshape(2, m, 2, e), axis=(0, 2))).tolist():
            (a1, b1), (a2, b2) = answers.driven[[k, m + k]][:, [j, e + j]]
            omega, state, rate = answers.omega[j], w[j], w[e + j]
            if omega:
                wave = complex(state, -rate / omega)
                entries.append((k, 1j * omega, a1 * wave, a2 * wave, False))
                continue
            entries.append((k, 0j, complex(a1 * state + b1 * rate), complex(a2 * state + b2 * rate), False))
            entries.append((k, 0j, complex(a1 * rate), complex(a2 * rate), True))
        block, exponent, g1, g2, ramp = (np.array(part) for part in zip(*entries, strict=True))
        add_special(self.spectrum.delta, self.spectrum.p, block, exponent, g1, g2, ramp, tau, z, v)
        return z, v

    def _on_panels(self, answers: _Answers, panels: tuple[Array, Array], y: Array, w: Array, tau: Array) -> Array:
        """Return the integrals in one segment of products that have no form, shape (n_times,)."""
        spectrum, squares = self.spectrum, answers.omega**2
        quadratic, mixed = panels
        used = np.any(mixed, axis=1) if not quadratic.size else np.any(mixed, axis=1) | np.any(quadratic, axis=1)
        blocks = np.flatnonzero(used.reshape(2, -1).any(axis=0))
        both = np.concatenate([blocks, spectrum.p.size + blocks])
        delta, p = spectrum.delta[blocks], spectrum.p[blocks]

        def power(at: Array) -> Array:
            z, v = free_changes(delta, p, y[both[: p.size]], y[both[p.size :]], at)
            state = np.concatenate([z, v]) + y[both, None]
            if np.any(answers.driven):
                state += np.concatenate(self._from_rest(answers, w, at))[both]
            total = np.zeros(at.size)
            if mixed.size:
                z, v = free_changes(np.zeros_like(squares), squares, w[: squares.size], w[squares.size :], at)
                total += 2.0 * np.sum(state * (mixed[both] @ (np.concatenate([z, v]) + w[:, None])), axis=0)
            if quadratic.size:
                total += np.sum(state * (quadratic[np.ix_(both, both)] @ state), axis=0)
            return total

        quickest = np.sqrt(p.max()) + delta.max()
        return quadrature(power, tau, float(2.0 * quickest + answers.omega.max(initial=0.0)))


def work_and_dissipation(
    space: ModalSpace,
    laws: ContactLaws | None,
    vectors: Array,
    record: Record,
    forms_of: Callable[[int], StatusForms | None],
    motion_of: Callable[[int], Motion],
    groups: Iterator[tuple[Integers, Loads]],
    visits: list[tuple[int, Integers, Array]],
    pinning: Array | None,
    work: Array,
    dissipated: Array,
) -> None:
    """Compute the work of all loads and the energy dissipated by all dampers, from t = 0 to the given times.

    Parameters
    ----------
    vectors : ndarray, shape (n_functions, n)
        Modal load vectors.
    record : Record
    forms_of, motion_of : callable
        Return the forms of the status of a segment, None where it has clusters, and the motion of a segment.
    groups : iterator of (ndarray of int, Loads)
        See `groups_of`; empty where there are neither loads nor dampers.
    visits : list of (int, ndarray of int, ndarray)
        Segments in ascending order with the requested times in them: the places of the times in `work`, and the times
        in s from the start of the segment.
    pinning : ndarray, shape (n_segments,), optional
        Energy lost at the beginning of every segment, J.
    work, dissipated : ndarray, shape (n_times,)
        Filled.
    """
    count = visits[-1][0] + 1
    whole = np.zeros((2, count))
    wanted = {index: (mine, tau) for index, mine, tau in visits}
    nothing = np.empty(0, dtype=np.int64), np.empty(0)
    for members, loads in groups:
        places, taus = zip(*(wanted.get(k, nothing) for k in members.tolist()), strict=True)
        # The times in a segment, and its end.
        of = np.repeat(np.arange(members.size), [part.size + 1 for part in taus])
        tau = np.concatenate(
            [part for k, own in zip(members, taus, strict=True) for part in (own, record.durations[k : k + 1])]
        )
        forms, parts = forms_of(members[0]), record.buffers
        if forms is None:
            taken = np.empty((2, tau.size))
            for s, run in _runs(of):
                k = int(members[s])
                taken[:, run] = _of_clusters(space, laws, record.status(k), vectors, motion_of(k), loads, s, tau[run])
        else:
            taken = forms.taken(loads, parts.displacement[members], parts.velocity[members], of, tau)
        last = np.append(np.diff(of) > 0, True)
        whole[:, members] = taken[:, last]
        at = np.concatenate(places)
        work[at], dissipated[at] = taken[:, ~last]
    if pinning is not None:
        whole[1, :-1] += pinning[1:count]
    begun = np.concatenate([np.zeros((2, 1)), np.cumsum(whole, axis=1)[:, :-1]], axis=1)
    if pinning is not None:
        begun[1] += pinning[0]
    for index, mine, _ in visits:
        work[mine] += begun[0, index]
        dissipated[mine] += begun[1, index]


def groups_of(record: Record, loads: LoadTable, segments: Integers) -> Iterator[tuple[Integers, Loads]]:
    """Yield segments of one status under loads of the same frequencies, and these loads from their starts."""
    starts = record.starts[segments]
    interval = np.clip(np.searchsorted(loads.edges, starts, side="right") - 1, 0, loads.constant.shape[0] - 1)
    _, kind = np.unique(np.column_stack([loads.counts, loads.omega]), axis=0, return_inverse=True)
    keys = np.column_stack([record.status_numbers[segments], kind.ravel()[interval]])
    _, group = np.unique(keys, axis=0, return_inverse=True)
    order = np.argsort(group.ravel(), kind="stable")
    edges = np.flatnonzero(np.diff(group.ravel()[order])) + 1
    for members in np.split(order, edges):
        own = interval[members]
        late = starts[members] - loads.edges[own]
        omega = loads.omega[own[0], : loads.counts[own[0]]]
        amplitude = (
            np.transpose(loads.amplitude[own][:, :, : omega.size], (2, 1, 0))
            * np.exp(1j * omega[:, None] * late)[:, None, :]
        )
        constant = (loads.constant[own] + loads.slope[own] * late[:, None]).T
        yield segments[members], Loads(omega, constant, loads.slope[own].T, amplitude)


def _of_clusters(
    space: ModalSpace, laws: ContactLaws | None, status: Integers, vectors: Array, motion: Motion, loads: Loads, s: int,
    tau: Array,
) -> Array:  # fmt: skip
    """Return work and loss in a segment whose modes form clusters, shape (2, n_times), by panels."""
    spectrum = motion.spectrum

    def work(at: Array) -> Array:
        return np.asarray(np.sum(loads.at(s, at) * (vectors @ motion.modes(at)[1]), axis=0))

    def loss(at: Array) -> Array:
        v = motion.modes(at)[1]
        total = np.sum(v * space.damping_force(v), axis=0)
        if laws is not None:
            total += np.sum((laws.damping * (status == CLOSED))[:, None] * (space.contacts @ v) ** 2, axis=0)
        return np.asarray(total)

    rate = 2.0 * float(spectrum.frequency.max() + spectrum.delta.max()) + 2.0 * loads.omega.max(initial=0.0)
    return np.stack([quadrature(work, tau, rate) if len(vectors) else np.zeros(tau.size), quadrature(loss, tau, rate)])


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
    known = determinant > 0.0
    scale = np.where(known, 1.0 / np.where(known, determinant, 1.0), 0.0)
    twist = vz - zv
    g = (s * zz - apart * twist + both * vv) * scale
    c = (apart * (zz + q * vv) + s * (q * twist + 2.0 * e * zz)) * scale
    b = (-apart * (zz + p * vv) + s * (2.0 * d * zz - p * twist)) * scale
    # Rigid motions with dampers.
    g = np.where(~known & (s > 0.0), vv / np.where(s > 0.0, s, 1.0), g)
    return np.block([[np.where(known, p * g + 2.0 * e * b - zv, 0.0), b], [c, g]])


def _of_loads(own: Array, omega: Array, w: Array, segment: Integers, tau: Array) -> Array:
    """Return the integrals of ``w' own w`` from 0 to all tau, for load states w (2e, k) at the starts of segments."""
    parts: list[tuple[int, float, int, Complex]] = []
    for j, nu in enumerate(omega):
        state, rate = w[j].astype(complex), w[omega.size + j]
        if nu:
            wave = state - 1j * rate / nu
            parts += [(j, nu, 0, wave), (omega.size + j, nu, 0, 1j * nu * wave)]
        else:
            line = rate.astype(complex)
            parts += [(j, 0.0, 0, state), (j, 0.0, 1, line), (omega.size + j, 0.0, 0, line)]
    moments: dict[tuple[int, float], Complex] = {}

    def moment(power: int, nu: float) -> Complex:
        if (power, nu) not in moments:
            moments[power, nu] = _moment(power, nu, tau)
        return moments[power, nu]

    total = np.zeros(tau.size)
    for i, nu, power, x in parts:
        for j, mu, other, y in parts:
            if own[i, j] and np.any(x) and np.any(y):
                both = (x * y)[segment] * moment(power + other, nu + mu)
                total += 0.5 * own[i, j] * (both + (x * np.conj(y))[segment] * moment(power + other, nu - mu)).real
    return total


def _moment(power: int, nu: float, tau: Array) -> Complex:
    """Return the integral of ``s^power exp(i nu s)`` from 0 to all tau, shape (n_times,); nu is 0 for squares."""
    if not nu:
        return np.asarray(tau ** (power + 1) / (power + 1), dtype=np.complex128)
    x = 1j * nu * tau
    if not power:
        return np.asarray(np.expm1(x) / (1j * nu))
    small = np.abs(x) < 0.5
    result = np.empty_like(x)
    near, far = x[small], x[~small]
    result[small] = np.polynomial.polynomial.polyval(near, _RAMP_SERIES)
    result[~small] = (far * np.exp(far) - np.expm1(far)) / far**2
    return np.asarray(result * tau**2)


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
