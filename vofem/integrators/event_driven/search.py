"""The certified search for the next event.

An event function is ``phi = row . blocks + forced part``, negative until the
event. From values at one time, bounds on its second derivative and on the
amplitude of fast blocks give a step within which it provably stays below a
threshold at rounding level; the step is taken, again and again. Far from an
event the fast blocks count by their amplitude, so the step is set by the slow
motion; close to it the steps converge quadratically, from the left, to the
first root. Nothing is sampled at a fixed rate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.motion import Motion, special_response
from vofem.linalg.exponential import oscillator
from vofem.linalg.jit import jit

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: Event functions are known to this many units of rounding of their largest terms.
_ROUNDING = 64.0 * float(np.finfo(float).eps)


#: Motions smaller than this are searched after multiplication by a power of two.
_TINY = 1e-100


@dataclass(frozen=True)
class EventFunctions:
    """What is watched: ``phi = w z + u v - constant + slope tau + sum Re(harmonic exp(i w tau))`` over block states.

    Attributes
    ----------
    w : ndarray, shape (k, m)
    u : ndarray, shape (k, m) or (k, 0)
    constant, slope : ndarray, shape (k,)
    harmonic : ndarray of complex, shape (k, n_h)
        With the frequencies of the motion.
    """

    w: Array
    u: Array
    constant: Array
    slope: Array
    harmonic: Complex


class _Watch(NamedTuple):
    """Event functions over blocks: ``phi = w z + u v + poly + steady``; u has no columns for classical damping."""

    w: Array
    u: Array
    poly: Array
    steady: Complex
    constant: Array


class _Flow(NamedTuple):
    """The motion of the blocks, as compiled code takes it; the names are those of `Motion` and `Special`."""

    delta: Array
    p: Array
    frequency: Array
    z0: Array
    v0: Array
    omega: Array
    block: NDArray[np.int64]
    exponent: Complex
    g1: Complex
    g2: Complex
    ramp: NDArray[np.bool_]


class _Point(NamedTuple):
    """Work space: block states and rates without the particular part, size of their inputs' shares, phi, its rate."""

    z: Array
    v: Array
    zdot: Array
    vdot: Array
    size: Array
    phi: Array
    rate: Array


def next_event(functions: EventFunctions, motion: Motion, duration: float) -> tuple[float, NDArray[np.bool_], int]:
    """Return the first time at which a function becomes positive.

    Parameters
    ----------
    functions : EventFunctions
        All negative, or zero and about to be, at tau = 0.
    motion : Motion
    duration : float
        Where the search ends, s.

    Returns
    -------
    tau : float
        `duration` where nothing happens.
    hits : ndarray of bool, shape (m,)
        The functions that reach zero there; simultaneous events are one.
    evaluations : int
        How often the functions were evaluated.
    """
    spectrum = motion.spectrum
    w, u = functions.w, functions.u
    poly = w @ motion.poly_z
    steady = w @ motion.steady_z + functions.harmonic
    if u.shape[1]:
        poly = poly + u @ motion.poly_v
        steady = steady + u @ motion.steady_v
    poly[:, 0] -= functions.constant
    poly[:, 1] += functions.slope
    watch = _Watch(w, u, poly, steady, np.abs(functions.constant))
    flow = _Flow(
        spectrum.delta, spectrum.p, spectrum.frequency, motion.z, motion.v, motion.omega,
        motion.special.block, motion.special.exponent, motion.special.g1, motion.special.g2, motion.special.ramp,
    )  # fmt: skip
    factor = _raise(watch, flow)
    if factor != 1.0:
        watch, flow = _raised(watch, flow, factor)
    return _march(watch, flow, spectrum.levels, duration)


def _raise(watch: _Watch, flow: _Flow) -> float:
    """Return the power of two that brings tiny motions to the size of one, as their squares would underflow; else 1."""
    size = _largest(watch, flow)
    return float(np.ldexp(1.0, -int(np.frexp(size)[1]))) if 0.0 < size < _TINY else 1.0


@jit
def _largest(watch: _Watch, flow: _Flow) -> float:
    """Return the largest magnitude of what the event functions are made of."""
    size = 0.0
    for k in range(flow.z0.size):
        size = max(size, abs(flow.z0[k]), abs(flow.v0[k]))
    for e in range(flow.g1.size):
        size = max(size, abs(flow.g1[e]), abs(flow.g2[e]))
    for j in range(watch.constant.size):
        size = max(size, watch.constant[j], abs(watch.poly[j, 0]), abs(watch.poly[j, 1]))
        for h in range(watch.steady.shape[1]):
            size = max(size, abs(watch.steady[j, h]))
    return size


def _raised(watch: _Watch, flow: _Flow, factor: float) -> tuple[_Watch, _Flow]:
    """Return the same motion, which is linear in its state and its loads, multiplied by a factor."""
    return (
        watch._replace(poly=factor * watch.poly, steady=factor * watch.steady, constant=factor * watch.constant),
        flow._replace(z0=factor * flow.z0, v0=factor * flow.v0, g1=factor * flow.g1, g2=factor * flow.g2),
    )


@jit
def _evaluate(tau: float, watch: _Watch, flow: _Flow, at: _Point) -> None:
    """Fill `at` with the states, the event functions and their rates at tau."""
    n, m = flow.p.size, watch.w.shape[0]
    z, v, zdot, vdot = at.z, at.v, at.zdot, at.vdot
    for k in range(n):
        delta, p, z0, v0 = flow.delta[k], flow.p[k], flow.z0[k], flow.v0[k]
        c, s = oscillator(delta, p, tau)
        z[k] = c * z0 + s * (v0 + delta * z0)
        v[k] = c * v0 - s * (p * z0 + delta * v0)
        zdot[k] = 0.0
        vdot[k] = 0.0
        at.size[k] = 0.0
    for e in range(flow.block.size):
        k = flow.block[e]
        dz, dv = special_response(flow.delta[k], flow.p[k], flow.exponent[e], flow.g1[e], flow.g2[e], flow.ramp[e], tau)
        z[k] += dz
        v[k] += dv
        at.size[k] += abs(dz) + abs(dv) * tau
        wave = complex(tau, 0.0) if flow.ramp[e] else np.exp(flow.exponent[e] * tau)
        zdot[k] += (flow.g1[e] * wave).real
        vdot[k] += (flow.g2[e] * wave).real
    for k in range(n):
        zdot[k] += v[k]
        vdot[k] -= 2.0 * flow.delta[k] * v[k] + flow.p[k] * z[k]
    for j in range(m):
        value = watch.poly[j, 0] + watch.poly[j, 1] * tau
        slope = watch.poly[j, 1]
        for h in range(flow.omega.size):
            wave = watch.steady[j, h] * np.exp(1j * flow.omega[h] * tau)
            value += wave.real
            slope -= flow.omega[h] * wave.imag
        for k in range(n):
            value += watch.w[j, k] * z[k]
            slope += watch.w[j, k] * zdot[k]
        for k in range(watch.u.shape[1]):
            value += watch.u[j, k] * v[k]
            slope += watch.u[j, k] * vdot[k]
        at.phi[j] = value
        at.rate[j] = slope


@jit
def _noise(watch: _Watch, flow: _Flow, tau: float, at: _Point, noise: Array) -> None:
    """Fill in the level below which each function is lost in the rounding of the terms that make it up by tau."""
    for j in range(watch.w.shape[0]):
        size = watch.constant[j] + abs(watch.poly[j, 0]) + abs(watch.poly[j, 1]) * tau
        for h in range(flow.omega.size):
            size += abs(watch.steady[j, h])
        for k in range(flow.p.size):
            energy = np.sqrt(flow.v0[k] ** 2 + flow.p[k] * flow.z0[k] ** 2)
            amplitude = abs(flow.z0[k]) + abs(flow.v0[k]) * tau
            if flow.frequency[k] > 0.0:
                amplitude = min(amplitude, energy / flow.frequency[k])
            size += abs(watch.w[j, k]) * (amplitude + at.size[k])
            if watch.u.shape[1]:
                size += abs(watch.u[j, k]) * (energy + abs(at.v[k]))
        noise[j] = _ROUNDING * size + 1e-300


@jit
def _still(j: int, watch: _Watch, flow: _Flow, at: _Point) -> bool:
    """Return whether the rate of a function is the rounding of its terms."""
    size = abs(watch.poly[j, 1])
    for h in range(flow.omega.size):
        size += flow.omega[h] * abs(watch.steady[j, h])
    for k in range(flow.p.size):
        size += abs(watch.w[j, k] * at.zdot[k])
        if watch.u.shape[1]:
            size += abs(watch.u[j, k] * at.vdot[k])
    return abs(at.rate[j]) <= _ROUNDING * size


@jit
def _reach(distance: float, rate: float, curvature: float) -> float:
    """Return how long a function with this rate and curvature bound stays below `distance`."""
    root = np.sqrt(rate * rate + 2.0 * curvature * distance)
    if rate > 0.0:
        return 2.0 * distance / (rate + root)
    if curvature > 0.0:
        return (root - rate) / curvature
    return np.inf


@jit
def _march(
    watch: _Watch, flow: _Flow, levels: NDArray[np.int64], duration: float
) -> tuple[float, NDArray[np.bool_], int]:
    n, m = flow.p.size, watch.w.shape[0]
    delta, p, frequency = flow.delta, flow.p, flow.frequency
    mixed = watch.u.shape[1] > 0
    at = _Point(np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(m), np.empty(m))
    noise = np.empty(m)
    hits = np.zeros(m, dtype=np.bool_)
    evaluations = 0

    # Bounds on the inputs of the special blocks and on their rates, and the longest step that they allow.
    g1, g2, g1_rate, g2_rate = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    longest = duration
    for e in range(flow.block.size):
        k = flow.block[e]
        size, quickness = (duration, 1.0) if flow.ramp[e] else (1.0, abs(flow.exponent[e]))
        g1[k] += abs(flow.g1[e]) * size
        g2[k] += abs(flow.g2[e]) * size
        g1_rate[k] += abs(flow.g1[e]) * quickness
        g2_rate[k] += abs(flow.g2[e]) * quickness
        if frequency[k] > 0.0:
            longest = min(longest, 4.0 / frequency[k])
    steady_curvature = np.zeros(m)
    for j in range(m):
        for h in range(flow.omega.size):
            steady_curvature[j] += abs(watch.steady[j, h]) * flow.omega[h] ** 2

    speed, amplitude, push, jerk = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    tau, before = 0.0, 0.0
    # When each function was last seen at or below zero: one above it within rounding has its root before `before`.
    below = np.zeros(m)
    # A gap that stays closed to rounding, such as that of masses which fall together, allows no certified step worth
    # the name. Its steps double while value and rate are rounding, up to a fraction of the shortest time scale.
    idle = np.zeros(m)
    quickest = 0.0
    for k in range(n):
        quickest = max(quickest, frequency[k], 2.0 * delta[k])
    for h in range(flow.omega.size):
        quickest = max(quickest, flow.omega[h])
    patience = 0.1 / quickest if quickest > 0.0 else np.inf
    while True:
        _evaluate(tau, watch, flow, at)
        _noise(watch, flow, tau, at, noise)
        evaluations += 1
        if tau > 0.0:
            found = False
            for j in range(m):
                hits[j] = at.phi[j] > noise[j]
                found = found or hits[j]
            if found:
                break
        if tau >= duration:
            return duration, hits, evaluations
        for j in range(m):
            if at.phi[j] <= 0.0:
                below[j] = tau
        step = min(duration - tau, longest)
        # Free energy never grows; inputs make sqrt(2 E) grow at most in proportion to time.
        for k in range(n):
            speed[k] = np.sqrt(at.v[k] ** 2 + p[k] * at.z[k] ** 2) + (g2[k] + frequency[k] * g1[k]) * step
            if frequency[k] > 0.0:
                amplitude[k] = min(speed[k] / frequency[k], abs(at.z[k]) + (speed[k] + g1[k]) * step)
            else:
                amplitude[k] = abs(at.z[k]) + (speed[k] + g1[k]) * step
            push[k] = (2.0 * delta[k] + frequency[k]) * speed[k] + g2[k]
            jerk[k] = 2.0 * delta[k] * push[k] + p[k] * (speed[k] + g1[k]) + g2_rate[k]
        for j in range(m):
            # Blocks below a level count by value, rate and curvature bound, those above by amplitude.
            fast, value, rate, curvature = 0.0, at.phi[j], at.rate[j], steady_curvature[j]
            for k in range(n):
                fast += abs(watch.w[j, k]) * amplitude[k]
                value -= watch.w[j, k] * at.z[k]
                rate -= watch.w[j, k] * at.zdot[k]
                if mixed:
                    fast += abs(watch.u[j, k]) * speed[k]
                    value -= watch.u[j, k] * at.v[k]
                    rate -= watch.u[j, k] * at.vdot[k]
            safe = 0.0
            k = 0
            for level in range(levels.size - 1):
                while k < levels[level]:
                    fast -= abs(watch.w[j, k]) * amplitude[k]
                    value += watch.w[j, k] * at.z[k]
                    rate += watch.w[j, k] * at.zdot[k]
                    curvature += abs(watch.w[j, k]) * (push[k] + g1_rate[k])
                    if mixed:
                        fast -= abs(watch.u[j, k]) * speed[k]
                        value += watch.u[j, k] * at.v[k]
                        rate += watch.u[j, k] * at.vdot[k]
                        curvature += abs(watch.u[j, k]) * jerk[k]
                    k += 1
                if -value > fast:
                    safe = max(safe, _reach(2.0 * noise[j] - value - fast, rate, curvature))
            while k < n:
                curvature += abs(watch.w[j, k]) * (push[k] + g1_rate[k])
                if mixed:
                    curvature += abs(watch.u[j, k]) * jerk[k]
                k += 1
            distance = max(-at.phi[j], 0.0) + 2.0 * noise[j]
            reach = max(safe, _reach(distance, at.rate[j], curvature))
            if abs(at.phi[j]) <= noise[j] and _still(j, watch, flow, at):
                idle[j] = min(2.0 * max(idle[j], reach), patience)
                reach = max(reach, idle[j])
            else:
                idle[j] = 0.0
            step = min(step, reach)
        before = tau
        tau = duration if step >= duration - tau else tau + step
        if tau == before:
            # The step is below the resolution of time itself.
            tau = np.nextafter(before, np.inf)

    # The first root lies in (below, tau]: a bracketed Newton iteration for each candidate; the earliest wins.
    first, winner = tau, 0
    for j in range(m):
        if not hits[j]:
            continue
        low, high, x = below[j], tau, tau
        for _ in range(100):
            _evaluate(x, watch, flow, at)
            evaluations += 1
            if at.phi[j] > 0.0:
                high = x
            else:
                low = x
            new = x - at.phi[j] / at.rate[j] if at.rate[j] != 0.0 else low
            if not low < new < high:
                new = 0.5 * (low + high)
            close = abs(new - x) <= 2.3e-16 * x or high - low <= 2.3e-16 * high
            x = new
            if close:
                break
        if x <= first:
            first, winner = x, j
    _evaluate(first, watch, flow, at)
    _noise(watch, flow, first, at, noise)
    evaluations += 1
    for j in range(m):
        hits[j] = abs(at.phi[j]) <= noise[j] and at.rate[j] > 0.0
    hits[winner] = True
    return first, hits, evaluations
