"""The motion between two events in closed form.

A block's motion is a free part from its own state, a particular part (the
steady answer to harmonics, constants and ramps) and, where the particular
part would divide by almost zero (resonance, rigid motion), the response from
rest instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.spectrum import Spectrum
from vofem.linalg.exponential import exponential_response, oscillator, ramp_response
from vofem.linalg.jit import jit

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: A harmonic counts as resonant where the steady answer would exceed ten times the static one.
_RESONANT = 0.1


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
    z, v : ndarray, shape (n,)
        Free part at tau = 0.
    omega : ndarray, shape (n_h,)
    steady_z, steady_v : ndarray of complex, shape (n, n_h)
        Steady answers to the harmonics.
    poly_z, poly_v : ndarray, shape (n, 2)
        Constant and slope of the answers to constants and ramps.
    special : Special
    """

    spectrum: Spectrum
    z: Array
    v: Array
    omega: Array
    steady_z: Complex
    steady_v: Complex
    poly_z: Array
    poly_v: Array
    special: Special

    def blocks(self, tau: Array) -> tuple[Array, Array]:
        """Return the block states (z, v), each of shape (n, n_times)."""
        z, v = _free(self.spectrum.delta, self.spectrum.p, self.z, self.v, tau)
        z += self.poly_z[:, :1] + self.poly_z[:, 1:] * tau
        v += self.poly_v[:, :1] + self.poly_v[:, 1:] * tau
        if self.omega.size:
            wave = np.exp(1j * self.omega[:, None] * tau)
            z += (self.steady_z @ wave).real
            v += (self.steady_v @ wave).real
        if self.special.block.size:
            _add_special(self.spectrum.delta, self.spectrum.p, *self.special, tau, z, v)
        return z, v

    def modes(self, tau: Array) -> tuple[Array, Array]:
        """Return modal displacements and velocities, each of shape (n, n_times)."""
        return self.spectrum.to_modes(*self.blocks(tau))


def start_motion(spectrum: Spectrum, displacement: Array, velocity: Array, forcing: Forcing, horizon: float) -> Motion:
    """Return the motion that starts from a modal state under a forcing.

    Parameters
    ----------
    displacement, velocity : ndarray, shape (n,)
        Modal state at tau = 0.
    horizon : float
        For how long the motion may be followed, s; a block slower than that is treated as rigid.
    """
    delta, p = spectrum.delta, spectrum.p
    n, n_h = p.size, forcing.omega.size
    z, v = spectrum.to_blocks(displacement, velocity)
    steady_z, steady_v = np.zeros((n, n_h), dtype=complex), np.zeros((n, n_h), dtype=complex)
    special: list[tuple[int, complex, complex, complex, bool]] = []
    slow = p * horizon**2 < 1.0
    for h, w in enumerate(forcing.omega):
        g1, g2 = spectrum.inputs(forcing.harmonic[:, h])
        impedance = p - w * w + 2j * delta * w
        apart = np.abs(impedance) >= _RESONANT * np.maximum(p, w * w)
        apart &= ~(slow & (w * horizon < 1.0))
        steady_z[apart, h] = ((1j * w + 2.0 * delta[apart]) * g1[apart] + g2[apart]) / impedance[apart]
        steady_v[apart, h] = 1j * w * steady_z[apart, h] - g1[apart]
        special.extend(
            (int(k), 1j * w, g1[k], g2[k], False) for k in np.flatnonzero(~apart) if g1[k] != 0 or g2[k] != 0
        )
    poly_z, poly_v = _polynomial(spectrum, forcing, slow, special)
    z = z - poly_z[:, 0] - steady_z.real.sum(axis=1)
    v = v - poly_v[:, 0] - steady_v.real.sum(axis=1)
    late = _special(special) if special else _NOTHING
    return Motion(spectrum, z, v, forcing.omega, steady_z, steady_v, poly_z, poly_v, late)


def _special(entries: list[tuple[int, complex, complex, complex, bool]]) -> Special:
    block, exponent, g1, g2, ramp = zip(*entries, strict=True) if entries else ((), (), (), (), ())
    first, second, third = (np.array(part, dtype=complex) for part in (exponent, g1, g2))
    return Special(np.array(block, dtype=np.int64), first, second, third, np.array(ramp, dtype=bool))


#: No responses from rest: the usual case, so one for all.
_NOTHING = _special([])


def _polynomial(
    spectrum: Spectrum,
    forcing: Forcing,
    slow: NDArray[np.bool_],
    special: list[tuple[int, complex, complex, complex, bool]],
) -> tuple[Array, Array]:
    """Return the particular answers to ``constant + slope tau``; slow blocks go to `special`."""
    delta, p = spectrum.delta, spectrum.p
    poly_z, poly_v = np.zeros((p.size, 2)), np.zeros((p.size, 2))
    if not np.any(forcing.constant) and not np.any(forcing.slope):
        return poly_z, poly_v
    c1, c2 = spectrum.inputs(forcing.constant)
    r1, r2 = spectrum.inputs(forcing.slope)
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
def _add_special(
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
    for e in range(block.size):
        k = block[e]
        for i in range(tau.size):
            dz, dv = special_response(delta[k], p[k], exponent[e], g1[e], g2[e], ramp[e], tau[i])
            z[k, i] += dz
            v[k, i] += dv


@jit
def _free(delta: Array, p: Array, z0: Array, v0: Array, tau: Array) -> tuple[Array, Array]:
    n, m = p.size, tau.size
    z, v = np.empty((n, m)), np.empty((n, m))
    for k in range(n):
        for i in range(m):
            c, s = oscillator(delta[k], p[k], tau[i])
            z[k, i] = c * z0[k] + s * (v0[k] + delta[k] * z0[k])
            v[k, i] = c * v0[k] - s * (p[k] * z0[k] + delta[k] * v0[k])
    return z, v
