"""Lyapunov exponents: the rates at which nearby motions of a scene separate or approach each other.

Perturbations are computed exactly along the motion, across events by saltation matrices. They are made orthogonal again
after every stretch of time.

G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Meccanica 15 (1980) 9, doi:10.1007/BF02128236;
P. Mueller, Chaos Solitons Fractals 5 (1995) 1671, doi:10.1016/0960-0779(94)00170-U (systems with impacts).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vofem._validate import number, whole
from vofem.arrays import Array
from vofem.blas import one_thread
from vofem.errors import ArgumentError, MethodError
from vofem.integrators.event_driven.flow import Start, flow, modal_state, modes_of
from vofem.scene import Scene, as_scene
from vofem.studies.steady.condensed import Condensed, reduced, slowest_decay
from vofem.studies.steady.loads import load_period
from vofem.studies.steady.segments.shooting import flow_refusal
from vofem.system import Counters, State, System

#: Stretches of time where no load sets a period, and at least; parts of the run from whose exponents the error is
#: estimated.
_STRETCHES, _LEAST, _PARTS = 400, 32, 16

#: Relative difference of exponents in few and in twice as many vectors that is small enough, beside their errors.
_ALIKE = 1e-4


@dataclass(frozen=True)
class LyapunovExponents:
    """The outcome of `lyapunov`.

    Attributes
    ----------
    exponents : ndarray, shape (count,)
        The largest exponents in descending order, 1/s. Where a contact rests at its gap under the displacement law,
        perturbations across it vanish, and their exponents are -inf.
    error : ndarray, shape (count,)
        Estimated errors, 1/s: the largest of the standard error from the scatter over parts of the run, half the
        difference between the two halves of the run, and what perturbations that grow like t add to an exponent 0,
        which is ``ln(t_end/skip)/(t_end - skip)`` after a transient.
    t_end, skip : float
        The arguments of `lyapunov`, in s.
    notes : tuple of str
        What was left out of a large system.
    """

    exponents: Array
    error: Array
    t_end: float
    skip: float
    notes: tuple[str, ...] = ()


@one_thread
def lyapunov(scene: Scene, t_end: float, *, count: int = 1, skip: float = 0.0) -> LyapunovExponents:
    """Return the largest Lyapunov exponents of a motion of a scene, from its initial state.

    Parameters
    ----------
    scene : Scene
        A scene that event_driven can treat.
    t_end : float
        Duration of the motion in s.
    count : int
        Number of exponents.
    skip : float
        Time in s at the beginning of the motion, the transient, that is left out.

    Returns
    -------
    LyapunovExponents
        The first exponent is positive for a chaotic motion. It is negative for motions that settle on a stable orbit,
        and is then ``log|multiplier|/period`` of the largest multiplier.

    Raises
    ------
    ArgumentError
        For arguments out of range.
    MethodError
        If event_driven cannot treat the scene.
    """
    as_scene("lyapunov", scene)
    t_end = number("lyapunov: t_end", t_end, positive=True)
    skip = number("lyapunov: skip", skip, minimum=0)
    count = whole("lyapunov: count", count)
    if skip >= t_end:
        raise ArgumentError(f"lyapunov: skip is {skip:g} s, expected a time before t_end = {t_end:g} s")
    system = scene.model.system
    if system.sliders is not None:
        raise MethodError(system.sliders.refusal("lyapunov"))
    reason = flow_refusal("lyapunov", system)
    if reason is not None:
        raise MethodError(reason)
    if count > 2 * system.size:
        raise ArgumentError(f"lyapunov: count is {count}, and the scene has {2 * system.size} exponents")
    times = np.concatenate([[0.0], _stretches(system, skip, t_end)])
    few = reduced(system, count)
    found = _exponents(scene, system if few is None else few.system, few, times, count, skip)
    if few is None:
        return LyapunovExponents(*found, t_end, skip)
    change = np.inf
    for finer in few.doubled():
        after = _exponents(scene, finer.system, finer, times, count, skip)
        with np.errstate(invalid="ignore"):
            apart = np.nan_to_num(np.abs(after[0] - found[0]), nan=0.0)
        # Two runs of a chaotic motion differ by their statistical errors.
        change = float(np.max(apart / (after[1] + found[1] + _ALIKE * np.abs(after[0]) + _ALIKE / t_end)))
        few, found = finer, after
        if change <= 1.0:
            break
    lowest = few.lowest_left_out
    note = (
        f"{few.vectors.shape[1]} vectors, static responses and the lowest modes, stand for {system.size} degrees of "
        f"freedom; modes above {lowest:.4g} rad/s are left out, whose exponents are at most "
        f"{-slowest_decay(system, lowest):.3g} 1/s"
    )
    if change > 1.0:
        note += ". With half as many vectors the exponents differ by more than their errors: trust them less"
    return LyapunovExponents(*found, t_end, skip, (note,))


def _exponents(
    scene: Scene, system: System, few: Condensed | None, times: Array, count: int, skip: float
) -> tuple[Array, Array]:
    """Return exponents and their standard errors, in few vectors where these are given."""
    start = scene.initial_state()
    growth = _growth(system, start if few is None else few.project(start), times, count)
    counted = times[1:] > skip * (1.0 + 1e-12)
    begins = float(times[:-1][counted][0])
    return _estimated(growth[counted], np.diff(times)[counted], begins, float(times[-1]))


def _stretches(system: System, skip: float, t_end: float) -> Array:
    """Return the times at which perturbations are made orthogonal: whole periods of the loads where enough."""
    try:
        step = load_period("lyapunov", system).period
    except ArgumentError:
        step = t_end
    parts = max(int(np.ceil((t_end - skip) / step)), 1)
    if parts < _LEAST:
        step = (t_end - skip) / _STRETCHES
        parts = _STRETCHES
    before = max(int(np.ceil(skip / step)), 1) if skip > 0.0 else 0
    lead = np.linspace(0.0, skip, before + 1)[1:] if before else np.empty(0)
    whole_steps = skip + step * np.arange(1, parts)
    return np.concatenate([lead, whole_steps[whole_steps < t_end], [t_end]])


def _growth(system: System, initial: State, times: Array, count: int) -> Array:
    """Return logarithms of the growth of perturbations over stretches of time, shape (n_stretches, count)."""
    space = modes_of(system, Counters())
    n = space.size
    z, v = modal_state(system, space, initial)
    positive = space.stiffness[space.stiffness > 0.0]
    typical = float(positive[0]) if positive.size else 1.0
    # Displacements and velocities are compared by energy.
    scale = np.concatenate([np.sqrt(np.where(space.stiffness > 0.0, space.stiffness, typical)), np.ones(n)])
    frame = np.linalg.qr(np.random.default_rng(0).normal(size=(2 * n, count)))[0]
    status = None
    growth = np.empty((times.size - 1, count))
    for k, (start, stop) in enumerate(zip(times[:-1].tolist(), times[1:].tolist(), strict=True)):
        one = flow(system, Start(start, z, v, status), stop, derivative=frame / scale[:, None], most_events=10**6)
        z, v, status = one.displacement, one.velocity, one.status
        assert one.monodromy is not None
        frame, factor = np.linalg.qr(one.monodromy * scale[:, None])
        with np.errstate(divide="ignore"):
            growth[k] = np.log(np.abs(np.diag(factor)))
    return growth


def _estimated(growth: Array, durations: Array, begins: float, ends: float) -> tuple[Array, Array]:
    """Return exponents and their standard errors from the growth over stretches of time."""
    exponents = growth.sum(axis=0) / (ends - begins)
    order = np.argsort(-exponents)
    parts = min(_PARTS, growth.shape[0])
    groups = np.array_split(np.arange(growth.shape[0]), parts)
    with np.errstate(invalid="ignore"):
        grown = np.array([growth[group].sum(axis=0) for group in groups])
        lasting = np.array([durations[group].sum() for group in groups])
        rates = grown / lasting[:, None]
        scatter = rates.std(axis=0, ddof=1) / np.sqrt(parts) if parts > 1 else np.full(exponents.shape, np.inf)
        half = parts // 2
        halves = 0.5 * np.abs(rates[:half].mean(axis=0) - rates[half:].mean(axis=0)) if half else scatter
        steady = _without_powers(np.cumsum(grown, axis=0), begins + np.cumsum(lasting))
        largest = np.max([scatter, halves, np.abs(exponents - steady)], axis=0)
        error = np.where(np.isfinite(exponents), largest, 0.0)
    return exponents[order], error[order]


def _without_powers(grown: Array, times: Array) -> Array:
    """Return exponents without what perturbations that grow like a power of time add to them.

    The growth up to a time t is fitted by ``a + exponent t + power ln(t)``. A neutral perturbation grows like t at
    most: this is what a motion whose frequency depends on its energy does to it.
    """
    line, powers = np.vander(times / times[-1], 2), np.log(times / times[-1])
    power = (np.linalg.pinv(np.column_stack([line, powers])) @ grown)[2]
    fitted = np.linalg.pinv(line) @ (grown - np.clip(power, -1.0, 1.0) * powers[:, None])
    return np.asarray(fitted[0] / times[-1])
