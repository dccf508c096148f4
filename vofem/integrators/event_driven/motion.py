"""The motion between two events in closed form.

A block's motion is a free part from its own state, a particular part (the steady answer to harmonics, constants and
ramps) and, where the particular part would divide by almost zero (resonance, rigid motion), the response from rest
instead. All parts are evaluated as changes since the beginning of the segment, which are accurate however small they
are. The small penetration of a stiff contact is therefore far more accurate than the displacement to which it is added.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.clusters import NO_CLUSTERS, ClusterFlow, add_clusters, cluster_flow
from vofem.integrators.event_driven.spectrum import Spectrum
from vofem.kernels.jit import jit, plain_form
from vofem.linalg.exponential import (
    exponential_response,
    oscillator,
    oscillator_change,
    oscillator_changes,
    ramp_response,
)

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: A harmonic counts as resonant where the steady answer would exceed ten times the static one.
RESONANT = 0.1


class Special(NamedTuple):
    """Responses from rest, one entry per block and input.

    Attributes
    ----------
    block : ndarray of int, shape (k,)
    exponent : ndarray of complex, shape (k,)
        b of the input ``exp(b tau)``.
    g1, g2 : ndarray of complex, shape (k,)
        Amplitudes.
    ramp : ndarray of bool, shape (k,)
        Whether the input is ``tau`` instead; then g1, g2 are real.
    """

    block: NDArray[np.int64]
    exponent: Complex
    g1: Complex
    g2: Complex
    ramp: NDArray[np.bool_]


class Forcing(NamedTuple):
    """Modal force near a time: ``sum_h Re(harmonic_h exp(i w_h tau)) + constant + slope tau``.

    Attributes
    ----------
    omega : ndarray, shape (n_h,)
    harmonic : ndarray of complex, shape (n, n_h)
    constant, slope : ndarray, shape (n,)
    """

    omega: Array
    harmonic: Complex
    constant: Array
    slope: Array


@dataclass(frozen=True)
class Motion:
    """The motion of all blocks of one status from ``tau = 0`` on.

    Attributes
    ----------
    spectrum : Spectrum
    displacement, velocity : ndarray, shape (n,)
        Modal state at tau = 0, pinned contacts at their gaps.
    start : (ndarray, ndarray)
        Block states (z, v) at tau = 0, each of shape (m,).
    z, v : ndarray, shape (m,)
        Free part at tau = 0.
    omega : ndarray, shape (n_h,)
    steady_z, steady_v : ndarray of complex, shape (m, n_h)
        Steady answers to the harmonics.
    poly_z, poly_v : ndarray, shape (m, 2)
        Constant and slope of the answers to constants and ramps.
    ramps : bool
        Whether any of these slopes is not zero.
    special : Special
    clusters : ClusterFlow
        The motion of blocks that belong to clusters. The attributes above do not contain it.
    """

    spectrum: Spectrum
    displacement: Array
    velocity: Array
    start: tuple[Array, Array]
    z: Array
    v: Array
    omega: Array
    steady_z: Complex
    steady_v: Complex
    poly_z: Array
    poly_v: Array
    ramps: bool
    special: Special
    clusters: ClusterFlow = NO_CLUSTERS

    def free_changes(self, tau: Array) -> tuple[Array, Array]:
        """Return by how much the free parts of blocks outside clusters have changed at tau, each (m, n_times)."""
        z, v = free_changes(self.spectrum.delta, self.spectrum.p, self.z, self.v, tau)
        return z, v

    def changes(self, tau: Array) -> tuple[Array, Array]:
        """Return by how much the block states (z, v) have changed at tau, each of shape (m, n_times)."""
        z, v = self.free_changes(tau)
        if self.clusters.rate.size:
            add_clusters(self.clusters, tau, z, v)
        if self.ramps:
            z += self.poly_z[:, 1:] * tau
            v += self.poly_v[:, 1:] * tau
        if self.omega.size:
            turned = np.expm1(1j * self.omega[:, None] * tau)
            z += (self.steady_z @ turned).real
            v += (self.steady_v @ turned).real
        if self.special.block.size:
            add_special(self.spectrum.delta, self.spectrum.p, *self.special, tau, z, v)
        return z, v

    def blocks(self, tau: Array) -> tuple[Array, Array]:
        """Return the block states (z, v), each of shape (m, n_times)."""
        z, v = self.changes(tau)
        z += self.start[0][:, None]
        v += self.start[1][:, None]
        return z, v

    def mode_changes(self, tau: Array) -> tuple[Array, Array]:
        """Return by how much modal displacements and velocities have changed, each of shape (n, n_times)."""
        return self.spectrum.to_modes(*self.changes(tau), shifted=False)

    def modes(self, tau: Array) -> tuple[Array, Array]:
        """Return modal displacements and velocities, each of shape (n, n_times)."""
        displacement, velocity = self.mode_changes(tau)
        return displacement + self.displacement[:, None], velocity + self.velocity[:, None]


def start_motion(spectrum: Spectrum, displacement: Array, velocity: Array, forcing: Forcing, horizon: float) -> Motion:
    """Return the motion that starts from a modal state under a forcing.

    Parameters
    ----------
    displacement, velocity : ndarray, shape (n,)
        Modal state at tau = 0.
    horizon : float
        Longest time in s for which the motion is computed. A block that is slower than that is treated as rigid.
    """
    delta, p = spectrum.delta, spectrum.p
    n, n_h = p.size, forcing.omega.size
    z, v = spectrum.to_blocks(displacement, velocity)
    start = z, v
    if spectrum.real.pinned.shape[0]:
        # Pinned contacts are put at their gaps.
        displacement, velocity = spectrum.to_modes(z, v)
    steady_z, steady_v = np.zeros((n, n_h), dtype=complex), np.zeros((n, n_h), dtype=complex)
    special: list[tuple[int, complex, complex, complex, bool]] = []
    slow = p * horizon**2 < 1.0
    plain = spectrum.plain
    waves = []
    for h, w in enumerate(forcing.omega):
        g1, g2 = spectrum.inputs(forcing.harmonic[:, h])
        if plain is not None:
            waves.append((g1, g2))
            g1, g2 = g1 * plain, g2 * plain
        impedance, rate, apart = spectrum.response(w, horizon, partial(_response, delta, p, slow, w, horizon))
        if apart is None:
            steady_z[:, h] = (rate * g1 + g2) / impedance
            steady_v[:, h] = 1j * w * steady_z[:, h] - g1
            continue
        steady_z[apart, h] = (rate[apart] * g1[apart] + g2[apart]) / impedance[apart]
        steady_v[apart, h] = 1j * w * steady_z[apart, h] - g1[apart]
        special.extend(
            (int(k), 1j * w, g1[k], g2[k], False) for k in np.flatnonzero(~apart) if g1[k] != 0 or g2[k] != 0
        )
    nothing = np.zeros(n), np.zeros(n)
    constant, slope = nothing, nothing
    pushed = bool(forcing.constant.any() or forcing.slope.any())
    if pushed:
        (poly_z, poly_v), forcing = static_answer(spectrum, forcing, horizon)
        constant = spectrum.inputs(forcing.constant) if np.any(forcing.constant) else nothing
        slope = spectrum.inputs(forcing.slope) if np.any(forcing.slope) else nothing
        more_z, more_v = _polynomial(spectrum, constant, slope, slow, special)
        poly_z, poly_v = poly_z + more_z, poly_v + more_v
    else:
        poly_z, poly_v = np.zeros((n, 2)), np.zeros((n, 2))
    ramps = pushed and bool(np.any(poly_z[:, 1]) or np.any(poly_v[:, 1]))
    z = z - poly_z[:, 0] - steady_z.real.sum(axis=1)
    v = v - poly_v[:, 0] - steady_v.real.sum(axis=1)
    together = NO_CLUSTERS
    if plain is not None:
        assert spectrum.blocks is not None
        together = cluster_flow(spectrum.blocks.clusters, z, v, forcing.omega, waves, constant, slope, horizon)
        z, v = z * plain, v * plain
    late = _special(special) if special else _NOTHING
    return Motion(
        spectrum, displacement, velocity, start, z, v, forcing.omega, steady_z, steady_v, poly_z, poly_v, ramps, late,
        together,
    )  # fmt: skip


def _response(
    delta: Array, p: Array, slow: NDArray[np.bool_], w: float, horizon: float
) -> tuple[Complex, Complex, NDArray[np.bool_] | None]:
    """Return impedance and ``i w + 2 delta`` of the blocks at a frequency, and which have steady answers; None: all."""
    impedance = p - w * w + 2j * delta * w
    apart = np.abs(impedance) >= RESONANT * np.maximum(p, w * w)
    if w * horizon < 1.0:
        apart &= ~slow
    return np.asarray(impedance), np.asarray(1j * w + 2.0 * delta), None if apart.all() else apart


def _special(entries: list[tuple[int, complex, complex, complex, bool]]) -> Special:
    block, exponent, g1, g2, ramp = zip(*entries, strict=True) if entries else ((), (), (), (), ())
    first, second, third = (np.array(part, dtype=complex) for part in (exponent, g1, g2))
    return Special(np.array(block, dtype=np.int64), first, second, third, np.array(ramp, dtype=bool))


#: No responses from rest. This is the usual case, so one object serves all segments.
_NOTHING = _special([])


def static_answer(spectrum: Spectrum, forcing: Forcing, horizon: float) -> tuple[tuple[Array, Array], Forcing]:
    """Return the static response of complex modes to constants and ramps, and the remaining forcing.

    The force of a stiff contact behind a gap is so large that its rounding would spoil slow blocks. Its static
    displacement is small and does not.
    """
    m = spectrum.p.size
    nothing = np.zeros((m, 2)), np.zeros((m, 2))
    if spectrum.blocks is None:
        return nothing, forcing
    assert spectrum.damping is not None
    p = spectrum.real.p
    fast = p * horizon**2 >= 1.0
    safe = np.where(fast, p, 1.0)
    constant, slope = spectrum.real.down(forcing.constant), spectrum.real.down(forcing.slope)
    rate = np.where(fast, slope / safe, 0.0)
    constant = constant - spectrum.damping @ rate
    rest = np.where(fast, constant / safe, 0.0)
    state = np.stack([np.concatenate([rest, rate]), np.concatenate([rate, np.zeros(m)])], axis=1)
    both = spectrum.blocks.into @ state
    left = (spectrum.real.up(np.where(fast, 0.0, force)) for force in (constant, slope))
    return (both[:m], both[m:]), Forcing(forcing.omega, forcing.harmonic, *left)


def _polynomial(
    spectrum: Spectrum,
    constant: tuple[Array, Array],
    slope: tuple[Array, Array],
    slow: NDArray[np.bool_],
    special: list[tuple[int, complex, complex, complex, bool]],
) -> tuple[Array, Array]:
    """Return the particular answers to inputs ``constant + slope tau``; slow blocks go to `special`."""
    delta, p = spectrum.delta, spectrum.p
    poly_z, poly_v = np.zeros((p.size, 2)), np.zeros((p.size, 2))
    (c1, c2), (r1, r2) = constant, slope
    if spectrum.plain is not None:
        c1, c2, r1, r2 = (g * spectrum.plain for g in (c1, c2, r1, r2))
    if not slow.any():
        poly_v[:, 1] = -r1
        poly_z[:, 1] = (r2 - 2.0 * delta * poly_v[:, 1]) / p
        poly_v[:, 0] = poly_z[:, 1] - c1
        poly_z[:, 0] = (c2 - 2.0 * delta * poly_v[:, 0] - poly_v[:, 1]) / p
        return poly_z, poly_v
    fast = ~slow
    d, q = delta[fast], p[fast]
    poly_v[fast, 1] = -r1[fast]
    poly_z[fast, 1] = (r2[fast] - 2.0 * d * poly_v[fast, 1]) / q
    poly_v[fast, 0] = poly_z[fast, 1] - c1[fast]
    poly_z[fast, 0] = (c2[fast] - 2.0 * d * poly_v[fast, 0] - poly_v[fast, 1]) / q
    for k in np.flatnonzero(slow):
        if c1[k] or c2[k]:
            special.append((int(k), 0j, complex(c1[k]), complex(c2[k]), False))
        if r1[k] or r2[k]:
            special.append((int(k), 0j, complex(r1[k]), complex(r2[k]), True))
    return poly_z, poly_v


@jit
def special_response(
    delta: float, p: float, b: complex, g1: complex, g2: complex, ramp: bool, tau: float
) -> tuple[float, float]:
    """Return the response (z, v) from rest of one block to one input."""
    if ramp:
        d0 = ramp_response(delta, p, tau)
        d1 = exponential_response(delta, p, 0j, tau).real
        return (g1 * (d1 + 2.0 * delta * d0) + g2 * d0).real, (g2 * d1 - p * g1 * d0).real
    d = exponential_response(delta, p, b, tau)
    rate = b * d + oscillator(delta, p, tau)[1]
    return (g1 * (rate + 2.0 * delta * d) + g2 * d).real, (g2 * rate - p * g1 * d).real


@jit
def add_special(
    delta: Array,
    p: Array,
    block: NDArray[np.int64],
    exponent: Complex,
    g1: Complex,
    g2: Complex,
    ramp: NDArray[np.bool_],
    tau: Array,
    z: Array,
    v: Array,
) -> None:
    """Add the responses from rest to block states, shape (n_blocks, n_times)."""
    for e in range(block.size):
        k = block[e]
        for i in range(tau.size):
            dz, dv = special_response(delta[k], p[k], exponent[e], g1[e], g2[e], ramp[e], tau[i])
            z[k, i] += dz
            v[k, i] += dv


@jit
def free_changes(delta: Array, p: Array, z0: Array, v0: Array, tau: Array) -> tuple[Array, Array]:
    """Return by how much free blocks have changed at all tau, each of shape (n, n_times)."""
    n, m = p.size, tau.size
    z, v = np.empty((n, m)), np.empty((n, m))
    for k in range(n):
        push, pull = p[k] * z0[k] + delta[k] * v0[k], v0[k] + delta[k] * z0[k]
        for i in range(m):
            c, s = oscillator_change(delta[k], p[k], tau[i])
            z[k, i] = c * z0[k] + s * pull
            v[k, i] = c * v0[k] - s * push
    return z, v


@plain_form(free_changes)
def _free_changes_of_all(delta: Array, p: Array, z0: Array, v0: Array, tau: Array) -> tuple[Array, Array]:
    """Do what `free_changes` does, for all blocks and times at once."""
    push, pull = p * z0 + delta * v0, v0 + delta * z0
    c, s = oscillator_changes(delta, p, tau)
    return c * z0[:, None] + s * pull[:, None], c * v0[:, None] - s * push[:, None]
