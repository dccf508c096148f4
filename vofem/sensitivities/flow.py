"""A segment in closed form: the motion, and its derivatives by parameters.

With any eigenbasis ``A = V diag(l) V^-1`` the derivative of ``exp(A t)`` in a direction A_p is ``V ((V^-1 A_p V) o Phi)
V^-1``, Phi being the divided differences of ``exp(x t)`` over the eigenvalues. They are smooth where eigenvalues meet,
so that clusters and resonances are no special cases.

Where the eigenbasis itself is nearly singular, as for rigid motion and critical damping, the exponential of a block
matrix takes its place. This is noticed because the motion that the basis gives is not the motion of the run.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array, Complex
from vofem.sensitivities.forcing import Forcing

#: Distance of two eigenvalues times the duration, below which their divided difference is computed as one function.
_NEAR = 1.0

#: Difference of the motion in the eigenbasis and that of the run, relative to its size, from which on the eigenbasis is
#: not used.
_OFF = 3e-11

#: Condition number (in the 1-norm) of eigenvectors from which on they count as singular.
_SINGULAR = 1e13

#: Smallest eigenvalue times the duration with which integrals are computed by division.
_SLOW = 1e-4

#: Times whose divided differences are computed together.
_NUMBERS = 2_000_000


class Segment(NamedTuple):
    """What a segment begins with."""

    start: Array  #: Shape (2n,).
    starts: Array  #: Derivatives of `start`, shape (2n, p).
    force: Forcing  #: Of loads and contacts, projected: rows of length n.
    forces: list[Forcing | None]  #: Its derivatives, one for each parameter.
    duration: float
    end: Array  #: The state of the run at the end, shape (2n,).


class Basis(NamedTuple):
    """An eigenbasis of a status and the derivatives of A in it."""

    values: Complex  #: Shape (N,).
    #: `vectors`, `inverse`: shape (N, N).
    vectors: Complex
    inverse: Complex
    changes: Complex  #: Shape (q, N, N).
    owners: NDArray[np.int64]  #: The parameters to which the changes belong; others do not change A. Shape (q,).


def basis_of(matrix: Array, changes: list[Array | None]) -> Basis | None:
    """Return the eigenbasis of a status; None where it is singular."""
    values, vectors = np.linalg.eig(matrix)
    values, vectors = values.astype(complex), vectors.astype(complex)
    try:
        inverse = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:
        return None
    if not np.linalg.norm(vectors, 1) * np.linalg.norm(inverse, 1) < _SINGULAR:
        return None
    owners = np.array([k for k, change in enumerate(changes) if change is not None], dtype=np.int64)
    n = matrix.shape[0]
    seen = [inverse @ (change @ vectors) for change in changes if change is not None]
    return Basis(values, vectors, inverse, np.array(seen).reshape(-1, n, n), owners)


def divided(a: Complex, b: Complex, t: Array | float) -> Complex:
    """Return the divided differences ``(exp(a t) - exp(b t))/(a - b)``, accurate also where a and b meet."""
    z = 0.5 * (a - b) * t
    zero = z == 0.0
    ratio = np.sinh(z) / np.where(zero, 1.0, z)
    return np.asarray(t * np.exp(0.5 * (a + b) * t) * np.where(zero, 1.0, ratio))


def divided_far(a: Complex, b: Complex, t: Array | float) -> Complex:
    """Return `divided` for any distance of a and b, without overflow."""
    apart = np.abs((a - b) * t) > 20.0
    direct = (np.exp(a * t) - np.exp(b * t)) / np.where(apart, a - b, 1.0)
    return np.where(apart, direct, divided(np.where(apart, b, a), b, t))


def ramped(a: Complex, b: Complex, t: Array | float) -> Complex:
    """Return ``integral_0^t exp(a (t - s)) s exp(b s) ds``."""
    z = (a - b) * t
    small = np.abs(z) < 0.7
    y = np.where(small, z, 0.0)
    series, term = np.zeros_like(y), np.full_like(y, 0.5)
    for k in range(16):
        series = series + term
        term = term * y / (k + 3)
    away = np.where(small, 1.0, a - b)
    direct = (np.exp(a * t) - np.exp(b * t) * (1.0 + z)) / away**2
    return np.where(small, t * t * np.exp(b * t) * series, direct)


class Closed:
    """A segment in the eigenbasis of its status."""

    def __init__(self, basis: Basis, segment: Segment) -> None:
        self.basis, self.segment = basis, segment
        n = segment.start.size // 2
        self._into = basis.inverse[:, n:]
        force = segment.force
        self.sigma, level, growth = self._waves(force)
        with np.errstate(divide="ignore", invalid="ignore"):
            away = self.sigma[:, None] - basis.values
            self.y1 = growth / away
            self.y0 = (level - self.y1) / away
        self.a = basis.inverse @ segment.start - self.y0.sum(axis=0)

    def _waves(self, force: Forcing) -> tuple[Complex, Complex, Complex]:
        """Return exponents (k,), and level and growth in the eigenbasis, each (k, N)."""
        level, growth = force.level @ self._into.T, force.growth @ self._into.T
        # A real wave is two complex ones.
        waves = force.omega != 0.0
        other = force.level[waves].conj() @ self._into.T, force.growth[waves].conj() @ self._into.T
        half = np.where(waves, 0.5, 1.0)[:, None]
        sigma = 1j * np.concatenate([force.omega, -force.omega[waves]])
        return (
            sigma, np.concatenate([half * level, 0.5 * other[0]]), np.concatenate([half * growth, 0.5 * other[1]])
        )  # fmt: skip

    def states(self, times: Array) -> Array:
        """Return the motion at times after the start, shape (N, n_times)."""
        return np.asarray((self.basis.vectors @ self._coordinates(times)).real)

    def _coordinates(self, times: Array) -> Complex:
        x = self.a[:, None] * np.exp(self.basis.values[:, None] * times)
        for sigma, y0, y1 in zip(self.sigma, self.y0, self.y1, strict=True):
            x = x + (y0[:, None] + y1[:, None] * times) * np.exp(sigma * times)
        return np.asarray(x)

    @property
    def good(self) -> bool:
        """Whether the motion at the end is that of the run."""
        with np.errstate(all="ignore"):
            end = self.states(np.array([self.segment.duration]))[:, 0]
            size = max(float(np.max(np.abs(self.segment.end))), float(np.max(np.abs(self.segment.start))), 1e-300)
            off = float(np.max(np.abs(end - self.segment.end)))
        return bool(off <= _OFF * size)

    def _pushes(self) -> list[tuple[complex, Complex, Complex]]:
        """Return what drives the derivatives besides the motion's own exponentials: exponents, and (N, p) twice."""
        basis, p = self.basis, self.segment.starts.shape[1]
        known: dict[complex, list[Complex]] = {}
        n = basis.values.size

        def at(sigma: complex) -> list[Complex]:
            return known.setdefault(sigma, [np.zeros((n, p), dtype=complex), np.zeros((n, p), dtype=complex)])

        if basis.owners.size:
            for sigma, y0, y1 in zip(self.sigma, self.y0, self.y1, strict=True):
                parts = at(complex(sigma))
                parts[0][:, basis.owners] += (basis.changes @ y0).T
                parts[1][:, basis.owners] += (basis.changes @ y1).T
        for k, force in enumerate(self.segment.forces):
            if force is None:
                continue
            for sigma, level, growth in zip(*self._waves(force), strict=True):
                parts = at(complex(sigma))
                parts[0][:, k] += level
                parts[1][:, k] += growth
        return [(sigma, q0, q1) for sigma, (q0, q1) in known.items()]

    def ends(self) -> Array:
        """Return the derivatives of the state at the end, shape (N, p)."""
        basis, t, segment = self.basis, self.segment.duration, self.segment
        x = np.exp(basis.values * t)[:, None] * (basis.inverse @ segment.starts)
        if basis.owners.size:
            phi = self._phi(t)
            x[:, basis.owners] += np.einsum("pij,ij->ip", basis.changes, phi * self.a)
        for sigma, q0, q1 in self._pushes():
            x += divided_far(basis.values, np.full_like(basis.values, sigma), t)[:, None] * q0
            if np.any(q1):
                x += ramped(basis.values, np.full_like(basis.values, sigma), t)[:, None] * q1
        return np.asarray((basis.vectors @ x).real)

    def _phi(self, t: float) -> Complex:
        """Return the divided differences over all pairs of eigenvalues, shape (N, N)."""
        values = self.basis.values
        e = np.exp(values * t)
        away = values[:, None] - values[None, :]
        near = np.abs(away) * t < _NEAR
        phi = (e[:, None] - e[None, :]) / np.where(near, 1.0, away)
        i, j = np.nonzero(near)
        phi[i, j] = divided(values[i], values[j], t)
        return np.asarray(phi)

    def transitions(self) -> tuple[Array, dict[int, Array]]:
        """Return ``exp(A tau)`` (N, N) and its derivatives, for the parameters that change A."""
        basis = self.basis
        whole = (basis.vectors * np.exp(basis.values * self.segment.duration)) @ basis.inverse
        phi = self._phi(self.segment.duration)
        return whole.real, {
            int(owner): (basis.vectors @ (change * phi) @ basis.inverse).real
            for owner, change in zip(basis.owners, basis.changes, strict=True)
        }

    def integrals(self) -> tuple[Array, Array] | None:
        """Return the integrals over the segment of u (N,) and of its derivatives (N, p); None where A is singular."""
        basis, t, segment = self.basis, self.segment.duration, self.segment
        values, zero = basis.values, np.zeros_like(basis.values)
        if np.min(np.abs(values)) * t < _SLOW:
            return None
        x = divided_far(values, zero, t) * self.a
        for sigma, y0, y1 in zip(self.sigma, self.y0, self.y1, strict=True):
            one, two = divided_far(np.array(sigma), np.array(0j), t), ramped(np.array(0j), np.array(sigma), t)
            x = x + y0 * one + y1 * two
        rest = basis.inverse @ (self.ends() - segment.starts)
        if basis.owners.size:
            rest[:, basis.owners] -= (basis.changes @ x).T
        for k, force in enumerate(segment.forces):
            if force is None:
                continue
            for sigma, level, growth in zip(*self._waves(force), strict=True):
                one, two = divided_far(np.array(sigma), np.array(0j), t), ramped(np.array(0j), np.array(sigma), t)
                rest[:, k] -= level * one + growth * two
        return (basis.vectors @ x).real, (basis.vectors @ (rest / values[:, None])).real

    def sample(self, rows: Array, times: Array) -> Array:
        """Return the derivatives of ``rows @ u`` at times after the start, rows being fixed, shape (k, n_times, p)."""
        basis, segment = self.basis, self.segment
        values, p = basis.values, segment.starts.shape[1]
        left = rows @ basis.vectors
        e = np.exp(values[:, None] * times)
        x0 = basis.inverse @ segment.starts
        out = np.einsum("ki,ip,it->ktp", left, x0, e, optimize=True)
        if basis.owners.size and times.size:
            away = values[:, None] - values[None, :]
            near = np.abs(away) * segment.duration < _NEAR
            kernel = self.a / np.where(near, np.inf, away)
            i, j = np.nonzero(near)
            for q, owner in enumerate(basis.owners.tolist()):
                far = basis.changes[q] * kernel
                gain = left * far.sum(axis=1)
                out[:, :, owner] += (gain - left @ far) @ e
            block = max(1, _NUMBERS // max(1, i.size))
            for first in range(0, times.size, block):
                part = slice(first, first + block)
                phi = divided(values[i, None], values[j, None], times[part])
                # Pairs are summed for each row i first.
                for q, owner in enumerate(basis.owners.tolist()):
                    weight = left[:, i] * (basis.changes[q][i, j] * self.a[j])
                    out[:, part, owner] += weight @ phi
        for sigma, q0, q1 in self._pushes():
            exponent = np.full((values.size, 1), sigma)
            response = divided_far(values[:, None], exponent, times)
            out += np.einsum("ki,ip,it->ktp", left, q0, response, optimize=True)
            if np.any(q1):
                response = ramped(values[:, None], exponent, times)
                out += np.einsum("ki,ip,it->ktp", left, q1, response, optimize=True)
        assert out.shape == (rows.shape[0], times.size, p)
        return np.asarray(out.real)


def _largest(forcing: Forcing | None, duration: float) -> float:
    """Return the largest number of a force within a segment."""
    if forcing is None:
        return 0.0
    level, growth = (float(np.max(np.abs(part), initial=0.0)) for part in (forcing.level, forcing.growth))
    return max(level, growth * duration)


class Block:
    """A segment by exponentials of block matrices, for statuses without a good eigenbasis.

    `matrix` has shape (N, N).
    `changes`: derivatives of the matrix, one for each parameter.
    """

    good = True

    def __init__(self, matrix: Array, changes: list[Array | None], segment: Segment) -> None:
        self.matrix, self.changes, self.segment = matrix, changes, segment

    def _system(self, k: int | None) -> tuple[Array, Array, float]:
        """Return the generator of (u_p, u, waves) for one parameter, or for none, the values at the start, and a size.

        The waves are measured by the force, times by the duration, and u_p by the size that is returned. All numbers of
        the generator are then rates of the motion, in any units; exponentials of larger ones would lose digits of it.
        """
        matrix, segment, t = self.matrix, self.segment, self.segment.duration or 1.0
        big = matrix.shape[0]
        n = big // 2
        force, other = segment.force, None if k is None else segment.forces[k]
        change = None if k is None else self.changes[k]
        omegas = force.omega if other is None else np.union1d(force.omega, other.omega)
        wave = t * _largest(force, t) or 1.0
        moved = t * max(0.0 if change is None else float(np.max(np.abs(change))), _largest(other, t) / wave) or 1.0
        size = 2 * big + 4 * omegas.size
        generator, start = np.zeros((size, size)), np.zeros(size)
        generator[:big, :big] = generator[big : 2 * big, big : 2 * big] = matrix
        start[big : 2 * big] = segment.start
        if k is not None:
            start[:big] = segment.starts[:, k] / moved
            if change is not None:
                generator[:big, big : 2 * big] = change / moved
        for place, w in enumerate(omegas.tolist()):
            at = 2 * big + 4 * place
            # cos, sin, and both times tau.
            generator[at, at + 1], generator[at + 1, at] = -w, w
            generator[at + 2, at + 3], generator[at + 3, at + 2] = -w, w
            generator[at + 2, at] = generator[at + 3, at + 1] = 1.0 / t
            start[at] = wave
            for rows, forcing, unit in ((slice(n, big), other, wave * moved), (slice(big + n, 2 * big), force, wave)):
                if forcing is None:
                    continue
                for h in np.flatnonzero(forcing.omega == w):
                    generator[rows, at] += forcing.level[h].real / unit
                    generator[rows, at + 1] -= forcing.level[h].imag / unit
                    generator[rows, at + 2] += forcing.growth[h].real * (t / unit)
                    generator[rows, at + 3] -= forcing.growth[h].imag * (t / unit)
        return generator, start, moved

    def _run(self, k: int | None, times: Array) -> Array:
        """Return (u_p, u) at ascending times, shape (2N, n_times)."""
        from scipy.linalg import expm

        generator, state, moved = self._system(k)
        big, before = 2 * self.matrix.shape[0], 0.0
        out = np.empty((big, times.size))
        for place, t in enumerate(times.tolist()):
            if t > before:
                state = expm(generator * (t - before)) @ state
                before = t
            out[:, place] = state[:big]
        out[: big // 2] *= moved
        return out

    def states(self, times: Array) -> Array:
        """Return the motion at times after the start, shape (N, n_times)."""
        order = np.argsort(times, kind="stable")
        out = np.empty((self.matrix.shape[0], times.size))
        out[:, order] = self._run(None, times[order])[self.matrix.shape[0] :]
        return out

    def ends(self) -> Array:
        """Return the derivatives of the state at the end, shape (N, p)."""
        end = np.array([self.segment.duration])
        big = self.matrix.shape[0]
        return np.column_stack([self._run(k, end)[:big, 0] for k in range(len(self.changes))])

    def sample(self, rows: Array, times: Array) -> Array:
        """Return the derivatives of ``rows @ u`` at times after the start, shape (k, n_times, p)."""
        order = np.argsort(times, kind="stable")
        out = np.empty((rows.shape[0], times.size, len(self.changes)))
        big = self.matrix.shape[0]
        for k in range(len(self.changes)):
            out[:, order, k] = rows @ self._run(k, times[order])[:big]
        return out

    def integrals(self) -> tuple[Array, Array]:
        """Return the integrals over the segment of u (N,) and of its derivatives (N, p)."""
        from scipy.linalg import expm

        big, duration = self.matrix.shape[0], self.segment.duration
        both = np.empty((2 * big, len(self.changes)))
        for k in range(len(self.changes)):
            generator, start, moved = self._system(k)
            count, size = start.size, float(np.max(np.abs(start))) or 1.0
            wide = np.zeros((count + 1, count + 1))
            wide[:count, :count], wide[:count, count] = generator * duration, start / size
            both[:, k] = expm(wide)[: 2 * big, count] * (size * duration)
            both[:big, k] *= moved
        return both[big:, 0], both[:big]

    def transitions(self) -> tuple[Array, dict[int, Array]]:
        """Return ``exp(A tau)`` (N, N) and its derivatives, for the parameters that change A."""
        from scipy.linalg import expm, expm_frechet

        whole, t = expm(self.matrix * self.segment.duration), self.segment.duration
        return whole, {
            k: expm_frechet(self.matrix * t, change * t, compute_expm=False)
            for k, change in enumerate(self.changes)
            if change is not None
        }
