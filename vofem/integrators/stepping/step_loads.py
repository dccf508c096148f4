"""Loads over steps: moments, which contain every impulse however short, and values at the ends of steps.

Let m0, m1, m2 be the moments of a load over a step of size h (see `vofem.time_functions.moments`). The load changes
the momentum by ``h m0``. It changes the displacement by ``-h^2 M^-1 m1`` in addition to what its mean does. It raises
the mean displacement within the step by ``h^2 M^-1 m2/2``, on which the stiffness acts. With all three moments a load
may be much shorter than a step: the remaining error is of higher order in omega h, where omega is a frequency of the
structure, not of the load.
"""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.sampled_loads import FEWEST_SAMPLES, loads_by_values
from vofem.system import Counters, LoadFunction, System
from vofem.time_functions import Piece, carried
from vofem.time_functions.moments import wave

#: Equal parts of a step, from whose moments those of half steps and the load within the step are found.
PARTS = 16

#: Steps in the shortest time of a load that resolve it.
_RESOLVED = 2.0

#: Steps in the shortest time of a smooth load from which on its values at the ends of steps describe it well enough.
_SLOW = 4.0

#: Error of the mean of a plain callable, over its values about the end of a step, up to which values replace the mean.
_SAME = 1e-4

#: Phase in rad by which motion may be late before there is a note.
_OFF = 0.02

#: Equal steps whose phases of a sine follow from that of the first of them.
_TURNED = 128

#: Steps at most in a run whose step was chosen to follow the loads.
_MOST = 10_000


def followed(system: System, dt: float, t_end: float) -> tuple[float, str]:
    """Return a default step in s that follows the loads where that takes no more steps than a bound, and words for it.

    `dt`: the default step without loads, s.
    `t_end`: end of the run, s.
    """
    if not system.loads:
        return dt, ""
    shortest, name = min((load.function.shortest(t_end), load.name) for load in system.loads)
    chosen = max(shortest / _RESOLVED, t_end / _MOST)
    return (chosen, f", which follows load {name!r}") if chosen < dt else (dt, "")


def note_loads(system: System, dt: float | None, t_end: float, notes: list[str]) -> None:
    """Add notes on loads that steps of a size in s do not follow, and on loads known by some of their values only.

    `dt`: size of a step, s; None where steps follow a tolerance.
    `t_end`: in s.
    `notes`: notes are appended.
    """
    if not system.loads:
        return
    shortest, name = min((load.function.shortest(t_end), load.name) for load in system.loads)
    if dt is not None and dt > 1.000001 * shortest:
        notes.append(
            f"load: {name} changes within {shortest:.3g} s, less than a step of {dt:.4g} s. The steps take its impulse "
            "and its moments exactly, but not its course: the answer may be off by more than 2 %. "
            f"dt = {shortest / _RESOLVED:.3g} s resolves it"
        )
    off, name = _lag(system, dt, t_end) if dt is not None else (0.0, "")
    if off > _OFF:
        notes.append(
            f"load: motion that {name} excites falls behind by about {off:.2g} rad until the end, as steps of "
            f"{dt:.4g} s are large against its period; dt = {dt * np.sqrt(0.5 * _OFF / off):.3g} s holds it below "
            f"{0.5 * _OFF:g}"
        )
    notes += loads_by_values(system, t_end)


def _lag(system: System, dt: float | None, t_end: float) -> tuple[float, str]:
    """Return the phase in rad, about, by which steps are late with motion that a load excites, and which load.

    Steps lower an angular frequency omega by about ``omega (omega dt)^2/12``. The frequency is Rayleigh's quotient of
    the shape to which the load bends the structure at rest.
    """
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import splu

    known = [load for load in system.loads if np.isfinite(load.function.shortest(t_end))]
    if not known or dt is None:
        return 0.0, ""
    solver = splu(csc_matrix(system.stiffness + system.mass / t_end**2))
    worst, name = 0.0, ""
    for load in known:
        shape = solver.solve(load.vector)
        mass = float(shape @ (system.mass @ shape))
        square = max(float(shape @ (system.stiffness @ shape)), 0.0) / mass if mass > 0.0 else 0.0
        late = t_end * square**1.5 * dt**2 / 12.0
        if late > worst:
            worst, name = late, load.name
    return worst, name


class StepLoads:
    """The loads of a system over steps.

    `until`: end of the run in s. The last step may end later. Loads are never evaluated beyond the end, where a
    measured load may be unknown. There the load is continued by a point reflection of its course before the end. The
    centre of the reflection is the value at the end that mean and trend of the last steps predict; the trend is limited
    to that of the means. A load that is a straight line is continued as that line.
    """

    def __init__(self, system: System, counters: Counters, until: float) -> None:
        self.functions = [load.function for load in system.loads]
        self.counters, self.until = counters, until
        self._waves = [_waves(function, until) for function in self.functions]

    def moments(self, left: Array, right: Array) -> Array:
        """Return the moments of all loads over steps, shape (3, n_loads, n)."""
        self.counters.load_evaluations += left.size * len(self.functions)
        result = np.empty((3, len(self.functions), left.size))
        for k, function in enumerate(self.functions):
            result[:, k] = self._of(function, left, right)
        return result

    def period(self, t_end: float) -> float:
        """Return the period in s of the fastest load within [0, t_end], or a few times its shortest part; 0 if none."""
        shortest = min((function.shortest(t_end) for function in self.functions), default=np.inf)
        return 2.0 * np.pi * shortest if np.isfinite(shortest) else 0.0

    def parts(self, left: float, right: float) -> Array:
        """Return the loads' moments over equal parts of one step, shape (3, n_loads, PARTS)."""
        edges = left + (right - left) * np.arange(PARTS + 1) / PARTS
        return self.moments(edges[:-1], edges[1:])

    def nodal(self, first: int, count: int, dt: float) -> Array:
        """Return what stands for the loads' values at the ends of steps, shape (2, n_loads, count).

        The first are means, weighted by the hat function that is 1 at the end of the step and 0 a step away. Sums over
        these means have the impulse and the first moment of the load. At the start the hat has one side only. The
        second are means of m2 over the two adjacent steps. Values take the place of the means for loads without
        breakpoints that change little in a step, and for plain callables whose means follow from their values.
        """
        means = np.zeros((2, len(self.functions), count))
        slow = self._slow(dt)
        for k, function in enumerate(self.functions):
            if not slow[k]:
                self._hats(k, first, dt, means[:, k])
            else:
                # Slow loads enter by their values, as in the published equations of the methods.
                times = np.minimum(np.arange(first, first + count, dtype=float) * dt, self.until)
                means[0, k] = function(times)
                self.counters.load_evaluations += count
            if not function.closed_form and not function.breakpoints(self.until).size:
                self._smooth_callable(function, first, dt, means[:, k])
        return means

    def steps(self, first: int, count: int, dt: float) -> Array:
        """Return the moments over equal steps, shape (3, n_loads, count); the means alone of loads that are slow."""
        result = np.empty((3, len(self.functions), count))
        for k in range(len(self.functions)):
            self._equal(k, first, dt, result[:, k])
        result[1:, self._slow(dt)] = 0.0
        return result

    def _equal(self, k: int, first: int, dt: float, moments: Array) -> None:
        """Enter the moments of a load over equal steps, shape (3, count)."""
        count, waves, known = moments.shape[1], self._waves[k], 0
        self.counters.load_evaluations += count
        if waves is not None:
            known = min(max(int(self.until / dt + 1e-9) - first, 0), count)
            moments[:, :known] = _over_steps(waves, first, known, dt)
        if known < count:
            edges = np.arange(first + known, first + count + 1, dtype=float) * dt
            moments[:, known:] = self._of(self.functions[k], edges[:-1], edges[1:])

    def _slow(self, dt: float) -> NDArray[np.bool_]:
        """Return of each load whether its shape is known and it changes little in a step."""
        return np.array(
            [f.closed_form and f.shortest(self.until) >= _SLOW * dt and not f.breakpoints(self.until).size
             for f in self.functions], dtype=bool,
        )  # fmt: skip

    def _smooth_callable(self, function: LoadFunction, first: int, dt: float, means: Array) -> None:
        """Replace means, shape (2, count), by values of a plain callable where the means follow from the values.

        The mean of a smooth function follows from values one step apart, with an error of the fourth power of the
        step. Where it does not, something happens within a step that the values miss. The choice is made for each end
        of a step separately, from the values at it and at its neighbours.
        """
        begin, count = max(first - 1, 0), means.shape[1]
        last = min(max(first + count, 2), int(self.until / dt * (1.0 + 1e-12)))
        if last < begin + 2:
            return
        values = function(np.minimum(np.arange(begin, last + 1, dtype=float) * dt, self.until))
        three = np.lib.stride_tricks.sliding_window_view(values, 3)
        predicted, at = three @ np.array([1.0, 10.0, 1.0]) / 12.0, begin + 1
        if first == 0:
            three = np.concatenate([three[:1], three])
            predicted, at = np.append(three[0] @ np.array([7.0, 6.0, -1.0]) / 12.0, predicted), 0
        nodes = np.arange(at, at + predicted.size)
        wanted = (nodes >= first) & (nodes < first + count)
        near = np.flatnonzero(
            wanted
            & (np.abs(predicted - means[0, np.clip(nodes - first, 0, count - 1)]) <= _SAME * np.max(np.abs(three), 1))
        )
        means[0, nodes[near] - first] = values[nodes[near] - begin]
        means[1, nodes[near] - first] = 0.0

    def _hats(self, k: int, first: int, dt: float, means: Array) -> None:
        """Enter the means that `nodal` describes of a load, shape (2, count)."""
        # At the start one side alone has half the weight.
        begin, at = (0, 1) if first == 0 else (first - 1, 0)
        m0, m1, m2 = moments = np.empty((3, first + means.shape[1] - begin))
        self._equal(k, begin, dt, moments)
        m0 *= 0.5
        means[0, at:] = (m0 + m1)[:-1] + (m0 - m1)[1:]
        means[1, at:] = 0.5 * (m2[:-1] + m2[1:])
        if first == 0:
            means[:, 0] = 2.0 * (m0[0] - m1[0]), m2[0]

    def start(self, dt: float) -> tuple[Array, Array]:
        """Return the loads' values at t = 0, and the mean over the first step beyond them, each of shape (n_loads,).

        The difference of the hat's mean to the value, times half a step, is an impulse at t = 0. For smooth loads it
        is of second order in the step. Of a pulse shorter than a step it is the whole effect.
        """
        (first, second), values = self.nodal(0, 2, dt)[0].T, np.array([float(f(0.0)) for f in self.functions])
        ahead = 2.0 * first - second
        values = np.clip(values, np.minimum.reduce([first, second, ahead]), np.maximum.reduce([first, second, ahead]))
        return values, first - values

    def _of(self, function: LoadFunction, left: Array, right: Array) -> Array:
        width, until = self.until / FEWEST_SAMPLES, self.until
        near = right <= until + 1e-9 * (right - left)
        if np.all(near):
            return function.moments(left, np.minimum(right, until), width)
        moments = np.empty((3, left.size))
        moments[:, near] = function.moments(left[near], np.minimum(right[near], until), width)
        for k in np.flatnonzero(~near):
            a, b = float(left[k]), float(right[k])
            begin, beyond = max(a, until), b - until
            if beyond > until:
                # A step longer than the run.
                later = function.moments(0.0, until, width)
                later[1:] = 0.0
            else:
                m0, m1, m2 = function.moments(until - beyond, 2.0 * until - begin, width)
                mean, trend, _ = function.moments(until - beyond, until, width)
                point = mean + 6.0 * trend
                if 2.0 * beyond <= until:
                    # The trend of a short or fast load predicts nothing, so it is limited to that of the means.
                    past = function.moments(until - 2.0 * beyond, until - beyond, width)[0]
                    ahead = 2.0 * mean - past
                    low, high = np.minimum.reduce([past, mean, ahead]), np.maximum.reduce([past, mean, ahead])
                    point = np.clip(point, low, high)
                later = np.stack([2.0 * point - m0, m1, -m2])
            share = np.array([(b - begin) / (b - a)])
            moments[:, [k]] = carried(later, share, 0.5 * (1.0 - share))
            if a < until:
                moments[:, [k]] += carried(function.moments(a, until, width), 1.0 - share, -0.5 * share)
        return moments


def _waves(function: LoadFunction, until: float) -> Piece | None:
    """Return a function that is a sum of harmonics and a constant until a time in s; None where it is not."""
    if not function.closed_form or function.breakpoints(until).size:
        return None
    piece: Piece = function.piece(0.0)  # type: ignore[attr-defined]
    return None if piece.slope or piece.curvature or piece.jerk else piece


def _over_steps(waves: Piece, first: int, count: int, dt: float) -> Array:
    """Return the moments of a sum of harmonics over equal steps, shape (3, count).

    Phases are those of the first of some steps, turned. Which ones these are does not depend on where a call begins.
    """
    moments = np.zeros((3, count))
    moments[0] = waves.constant
    begins = np.arange(first // _TURNED, -(-(first + count) // _TURNED)) * _TURNED
    for omega, amplitude in waves.harmonics:
        later, (m0, m1, m2) = _turn(omega, dt)
        turned = np.outer(amplitude * np.exp(1j * omega * ((begins + 0.5) * dt)), later).ravel()
        turned = turned[first % _TURNED :][:count]
        moments[0] += m0 * turned.real
        moments[1] -= m1 * turned.imag
        moments[2] += m2 * turned.real
    return moments


@lru_cache(maxsize=64)
def _turn(omega: float, dt: float) -> tuple[NDArray[np.complex128], list[float]]:
    """Return the turns of a phase over some steps, shape (_TURNED,), and the moments of a wave over a step."""
    return np.exp(1j * omega * (np.arange(_TURNED) * dt)), [float(m) for m in wave(np.array(0.5 * omega * dt))]


@cache
def _joining(count: int) -> Array:
    """Return what each of so many equal parts contributes to the moments of the whole, shape (3, 3, count)."""
    middle, share = (np.arange(count) + 0.5) / count - 0.5, np.full(count, 1.0 / count)
    units = np.repeat(np.eye(3)[:, :, None], count, axis=2)
    return np.stack([carried(unit, share, middle) for unit in units], axis=1)


def joined(parts: Array) -> Array:
    """Return the moments over a whole step from those over its equal parts, shape (3, n_loads)."""
    base = parts[0, :, 0]
    rest = parts.copy()
    # Sums of a constant's parts would leave rounding in m1 and m2.
    rest[0] -= base[:, None]
    whole = np.einsum("jip,ilp->jl", _joining(parts.shape[2]), rest)
    whole[0] += base
    return whole


def of_halves(parts: Array) -> tuple[Array, Array]:
    """Return the moments over a step and both halves, (3, n_loads, 3), and `fluctuation` over the halves, (2, n_loads).

    `parts`, shape (3, n_loads, PARTS), are the moments over equal parts of the step.
    """
    cut = parts.shape[2] // 2
    moments, fluctuations = np.empty((3, parts.shape[1], 3)), np.empty((2, parts.shape[1]))
    moments[:, :, 0] = joined(parts)
    for k, part in enumerate((parts[:, :, :cut], parts[:, :, cut:])):
        moments[:, :, k + 1] = joined(part)
        fluctuations[k] = fluctuation(part, moments[0, :, k + 1], moments[1, :, k + 1])
    return moments, fluctuations


def fluctuation(parts: Array, m0: Array, m1: Array) -> Array:
    """Return the displacement of a unit mass, over the step squared, by loads from which mean and trend are removed.

    `parts` (shape (3, n_loads, n_parts)): moments over equal parts of a step.
    `m0`, `m1` (shape (n_loads,)): mean and first moment over the whole step.
    Returns `fluctuation` (shape (n_loads,)).
    """
    count = parts.shape[2]
    x = (np.arange(count) + 0.5) / count - 0.5
    rest = parts[0] - m0[:, None] - 12.0 * m1[:, None] * x
    place = rest.cumsum(axis=1).cumsum(axis=1)
    return np.asarray(np.abs(place).max(axis=1)) / count**2
