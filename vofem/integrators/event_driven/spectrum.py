"""Eigensystems of the linear pieces: one per contact status, as a set of oscillators.

Everything happens in the modal space of the contact-free system, where M is
the identity, K and classical C are diagonal and a contact is a row c. A
status is turned into independent blocks

    z' = v + g1,    v' = -2 delta v - p z + g2,

one per pair of roots. Undamped statuses, and damped ones whose C stays
diagonal, keep real orthogonal modes, gained from the diagonal by rank-one
updates; the others need complex modes, written as real blocks all the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.errors import SingularSystemError
from vofem.linalg.eigen import modal_basis
from vofem.linalg.secular import rank_one
from vofem.system import CLOSED, Counters, System

Array = NDArray[np.float64]

#: Damping counts as classical while its off-diagonal part stays below this fraction.
_CLASSICAL = 1e-13

#: Ratio of frequencies between two levels of a spectrum.
_LEVEL_RATIO = 6.0

#: Condition number of complex eigenvectors beyond which a solution would lose too many digits.
_WORST_CONDITION = 1e9


@dataclass(frozen=True)
class ModalSpace:
    """The contact-free system in its own modes.

    Attributes
    ----------
    shapes : ndarray, shape (n, n)
        Phi, M-orthonormal columns.
    stiffness : ndarray, shape (n,)
        omega^2, ascending; 0 for rigid motions.
    damping : ndarray, shape (n,)
        Diagonal part of ``Phi' C Phi`` from Rayleigh and modal damping.
    coupling : ndarray, shape (n, n), optional
        ``Phi' C Phi`` of the dashpots where there are any.
    contacts : ndarray, shape (n_contacts, n)
        Rows c.
    loads : ndarray, shape (n_loads, n)
        Modal load vectors.
    """

    shapes: Array
    stiffness: Array
    damping: Array
    coupling: Array | None
    contacts: Array
    loads: Array

    @property
    def size(self) -> int:
        """Number of modes."""
        return int(self.stiffness.size)


def modal_space(system: System, counters: Counters) -> ModalSpace:
    """Solve the contact-free eigenproblem and express all rows in its modes."""
    squares, shapes = modal_basis(system.mass, system.stiffness, system.scale, system.rigid, system.strain)
    counters.eigensolves += 1
    n = squares.size
    damping, coupling = np.zeros(n), None
    if system.damped:
        counters.damping_evaluations += 1
        omega = np.sqrt(squares)
        if system.rayleigh is not None:
            damping += system.rayleigh[0] + system.rayleigh[1] * squares
        if system.modal_damping is not None:
            damping += 2.0 * system.modal_damping * omega
        if system.damping is not None:
            coupling = shapes.T @ (system.damping @ shapes)
            diagonal = np.diag(coupling)
            bound = _CLASSICAL * np.sqrt(np.abs(np.outer(diagonal, diagonal)))
            if np.all(np.abs(coupling - np.diag(diagonal)) <= bound):
                damping, coupling = damping + diagonal, None
    contacts = np.empty((0, n)) if system.contacts is None else np.asarray(system.contacts.rows @ shapes)
    loads = np.empty((0, n))
    if system.loads:
        loads = np.stack([load.vector for load in system.loads]) @ shapes
    return ModalSpace(shapes, squares, damping, coupling, contacts, loads)


@dataclass(frozen=True)
class Spectrum:
    """The blocks of one contact status, ordered by p, and the maps between modes and blocks.

    Attributes
    ----------
    delta, p : ndarray, shape (n,)
        Decay rate in 1/s and squared frequency in 1/s^2 of each block.
    modes : ndarray, shape (n, n), optional
        Classical statuses: orthogonal V with modal displacement ``V z``. None
        stands for the identity.
    out, into : ndarray, shape (2n, 2n), optional
        Other statuses: modal ``(displacement, velocity) = out @ (z, v)`` and its inverse.
    """

    delta: Array
    p: Array
    modes: Array | None = None
    out: Array | None = None
    into: Array | None = None

    @cached_property
    def frequency(self) -> Array:
        """Undamped frequency of each block in rad/s, ascending, shape (n,)."""
        return np.sqrt(self.p)

    @cached_property
    def levels(self) -> NDArray[np.int64]:
        """Block counts at which the frequency has grown by another factor; the last is all blocks."""
        positive = self.frequency[self.frequency > 0]
        if positive.size < 2:
            return np.array([self.p.size], dtype=np.int64)
        count = int(np.ceil(np.log(positive[-1] / positive[0]) / np.log(_LEVEL_RATIO)))
        edges = positive[0] * _LEVEL_RATIO ** np.arange(1, min(count, 40))
        return np.unique(np.append(np.searchsorted(self.frequency, edges), self.p.size)).astype(np.int64)

    @property
    def classical(self) -> bool:
        """Whether blocks are real modes."""
        return self.out is None

    def to_blocks(self, displacement: Array, velocity: Array) -> tuple[Array, Array]:
        """Return block states (z, v) of a modal state, each of shape (n,)."""
        if self.into is not None:
            both = self.into @ np.concatenate([displacement, velocity])
            return both[: self.p.size], both[self.p.size :]
        if self.modes is None:
            return displacement, velocity
        return self.modes.T @ displacement, self.modes.T @ velocity

    def to_modes(self, z: Array, v: Array) -> tuple[Array, Array]:
        """Return modal displacement and velocity of block states, shape (n,) or (n, n_times)."""
        if self.out is not None:
            both = self.out @ np.concatenate([z, v])
            return both[: self.p.size], both[self.p.size :]
        if self.modes is None:
            return z, v
        return self.modes @ z, self.modes @ v

    def inputs(self, force: Any) -> tuple[Any, Any]:
        """Return block inputs (g1, g2) of a modal force, shape (n,), real or complex."""
        if self.into is not None:
            both = self.into[:, self.p.size :] @ force
            return both[: self.p.size], both[self.p.size :]
        g2 = force if self.modes is None else self.modes.T @ force
        return np.zeros_like(g2), g2

    def rows(self, rows: Array) -> tuple[Array, Array]:
        """Return (W, U) with ``rows @ displacement = W z + U v``, each (n_rows, n)."""
        if self.out is not None:
            both = rows @ self.out[: self.p.size]
            return np.ascontiguousarray(both[:, : self.p.size]), np.ascontiguousarray(both[:, self.p.size :])
        w = rows if self.modes is None else rows @ self.modes
        return np.ascontiguousarray(w), np.zeros((rows.shape[0], 0))


class Spectra:
    """Eigensystems of the statuses that a run visits, computed when first visited.

    Parameters
    ----------
    space : ModalSpace
    stiffness, damping : ndarray, shape (n_contacts,)
        Of the contacts while closed.
    counters : Counters
    """

    def __init__(self, space: ModalSpace, stiffness: Array, damping: Array, counters: Counters) -> None:
        self._space = space
        self._stiffness = stiffness
        self._damping = damping
        self._counters = counters
        self._known: dict[bytes, Spectrum] = {}
        self._undamped: dict[bytes, tuple[Array, Array | None]] = {}

    def __getitem__(self, status: NDArray[np.int64]) -> Spectrum:
        """Return the eigensystem of a status, shape (n_contacts,)."""
        closed = status == CLOSED
        key = closed.tobytes()
        if key not in self._known:
            self._counters.statuses += 1
            self._known[key] = self._compute(closed)
        return self._known[key]

    def _compute(self, closed: NDArray[np.bool_]) -> Spectrum:
        space = self._space
        uniform = space.damping.size == 0 or bool(np.all(space.damping == space.damping[0]))
        contact_damped = bool(np.any(self._damping[closed] > 0))
        classical = space.coupling is None and not contact_damped and (uniform or not np.any(closed))
        if not classical:
            return self._complex(closed)
        p, modes = self._real(closed)
        return Spectrum(delta=0.5 * space.damping, p=p, modes=modes)

    def _real(self, closed: NDArray[np.bool_]) -> tuple[Array, Array | None]:
        """Return eigenvalues and modes of ``Omega^2 + sum K0 c c'``, by one rank-one update per contact."""
        key = closed.tobytes()
        if key not in self._undamped:
            if not np.any(closed):
                self._undamped[key] = (self._space.stiffness, None)
            else:
                last = int(np.flatnonzero(closed)[-1])
                parent = closed.copy()
                parent[last] = False
                p, modes = self._real(parent)
                row = self._space.contacts[last]
                row = row if modes is None else row @ modes
                values, vectors = rank_one(p, row, float(self._stiffness[last]))
                self._counters.rank_one_updates += 1
                self._undamped[key] = (values, vectors if modes is None else modes @ vectors)
        return self._undamped[key]

    def _complex(self, closed: NDArray[np.bool_]) -> Spectrum:
        """Return the blocks of a status with non-classical damping, from its complex modes."""
        space = self._space
        self._counters.eigensolves += 1
        self._counters.damping_evaluations += 1
        rows = space.contacts[closed]
        damping = np.diag(space.damping) + (rows.T * self._damping[closed]) @ rows
        if space.coupling is not None:
            damping = damping + space.coupling
        spring = (rows.T * self._stiffness[closed]) @ rows
        loose = _undamped_rigid(space.stiffness, damping, spring)
        return _block_spectrum(space.stiffness, damping, spring, loose)


def _undamped_rigid(stiffness: Array, damping: Array, spring: Array) -> Array:
    """Return an orthonormal basis, shape (n, r), of rigid motions that neither C nor the contacts resist."""
    rigid = np.flatnonzero(stiffness == 0.0)
    basis = np.zeros((stiffness.size, 0))
    if rigid.size:
        small = (damping + spring)[np.ix_(rigid, rigid)]
        values, vectors = np.linalg.eigh(small)
        scale = max(float(np.abs(small).max()), np.finfo(float).tiny)
        loose = vectors[:, values <= 1e-12 * scale]
        basis = np.zeros((stiffness.size, loose.shape[1]))
        basis[rigid] = loose
    return basis


def _block_spectrum(stiffness: Array, damping: Array, spring: Array, loose: Array) -> Spectrum:
    """Split ``z'' + C z' + (Omega^2 + S) z = f`` into real blocks by way of its complex modes.

    Rigid motions that nothing resists have a defective double root 0; they are
    taken out first and make blocks of their own.
    """
    n, r = loose.shape
    # An orthonormal frame whose first columns are the loose motions. Where there
    # are none it is the identity, which keeps the graded diagonal of Omega^2.
    frame = np.eye(n) if r == 0 else np.linalg.qr(np.hstack([loose, np.eye(n)]))[0]
    if r:
        frame[:, :r] = loose
    rest = frame[:, r:]
    k = (rest.T * stiffness) @ rest + rest.T @ spring @ rest
    c = rest.T @ damping @ rest
    m = n - r
    # Velocities divided by a frequency: both halves of the state are of one size.
    omega = np.sqrt(np.maximum(np.diag(k), np.finfo(float).tiny))
    omega = np.where(omega > 1e-8 * omega.max(), omega, omega.max()) if m else omega
    state = np.zeros((2 * m, 2 * m))
    state[:m, m:] = np.diag(omega)
    state[m:, :m] = -k / omega
    state[m:, m:] = -c
    roots, right = np.linalg.eig(state)
    condition = np.linalg.cond(right)
    if not condition < _WORST_CONDITION:
        raise SingularSystemError(
            f"the damped modes of a contact status are not independent (condition number {condition:.1e}): two of "
            "them are critically damped together. Change a damping coefficient slightly, or use "
            "method='central_difference'"
        )
    left = np.linalg.inv(right)
    unscale = np.concatenate([1.0 / omega, np.ones(m)])
    right, left = right * unscale[:, None], left / unscale[None, :]

    delta, p = np.zeros(n), np.zeros(n)
    out_m, into_m = np.zeros((2 * m, 2 * m)), np.zeros((2 * m, 2 * m))
    pairs = _pair(roots)
    for i, (a, b) in enumerate(pairs):
        s = roots[a]
        if b is None:
            d, w = -s.real, s.imag
            delta[r + i], p[r + i] = d, abs(s) ** 2
            out_m[:, i] = right[:, a].real + right[:, a].imag * (d / w)
            out_m[:, m + i] = right[:, a].imag / w
            into_m[i] = 2.0 * left[a].real
            into_m[m + i] = 2.0 * (s * left[a]).real
        else:
            s1, s2 = roots[a].real, roots[b].real
            delta[r + i], p[r + i] = -0.5 * (s1 + s2), s1 * s2
            out_m[:, i] = ((s1 * right[:, b] - s2 * right[:, a]) / (s1 - s2)).real
            out_m[:, m + i] = ((right[:, a] - right[:, b]) / (s1 - s2)).real
            into_m[i] = (left[a] + left[b]).real
            into_m[m + i] = (s1 * left[a] + s2 * left[b]).real
    out, into = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    blocks = np.concatenate([np.arange(r, n), np.arange(n + r, 2 * n)])
    double = np.zeros((2 * n, 2 * m))
    double[:n, :m] = rest
    double[n:, m:] = rest
    out[:, blocks] = double @ out_m
    into[blocks] = into_m @ double.T
    out[:n, :r] = loose
    out[n:, n : n + r] = loose
    into[:r, :n] = loose.T
    into[n : n + r, n:] = loose.T
    order = np.argsort(p, kind="stable")
    both = np.concatenate([order, n + order])
    return Spectrum(delta=delta[order], p=np.maximum(p[order], 0.0), out=out[:, both], into=into[both])


def _pair(roots: NDArray[np.complex128]) -> list[tuple[int, int | None]]:
    """Return conjugate pairs as (index, None) and pairs of real roots as (index, index).

    Real roots are paired far from each other, so that equal ones never meet in a block.
    """
    pairs: list[tuple[int, int | None]] = [(int(i), None) for i in np.flatnonzero(roots.imag > 0)]
    real = np.flatnonzero(roots.imag == 0)
    real = real[np.argsort(roots[real].real)]
    half = real.size // 2
    pairs.extend((int(real[i + half]), int(real[i])) for i in range(half))
    return pairs
