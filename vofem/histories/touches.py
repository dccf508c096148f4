"""The force of a contact, and the rate of its gap function, as piecewise polynomials over the times in touch.

Between events a run of ``event_driven`` is analytic. Chebyshev polynomials on panels that are halved until their last
coefficients are small give force and rate to a tolerance. Integrals and extremes then follow from the polynomials. A
stepping method knows its motion between neighbouring steps as polynomials of degree five: there a panel is a step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array, IntArray
from vofem.errors import ArgumentError
from vofem.histories.motion import Motion
from vofem.integrators.base import status_at
from vofem.system import CLOSED, PINNED, ContactLaws

#: Number of Chebyshev coefficients of a panel of a continuous motion, and of a step.
_SMOOTH, _STEP = 16, 6

#: Last coefficients, over the largest value of the quantity, below which a panel counts as resolved. What is left
#: alternates in sign, so that integrals are better by orders.
RESOLVED = 1e-10

#: Largest number of halvings of a panel, and of panels of one contact. Panels are halved no further then.
_DEPTH, _PANELS = 40, 40_000

#: Largest number of entries of one evaluation of the motion, which bounds the memory.
_NUMBERS = 4_000_000

#: Points at which a polynomial is evaluated to find changes of sign and extremes, and rounds of refinement of these.
_LOOKS, _ROUNDS = 33, 5

_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(_SMOOTH)


@dataclass(frozen=True)
class Span:
    """Stretches of time in which a contact is in touch: closed, or pinned at its gap."""

    #: `begin`, `end`: begin and end of every touch, s, shape (k,).
    begin: Array
    end: Array
    ended: NDArray[np.bool_]  #: False where the run ends first, shape (k,).


def spans_of(run: Motion, index: int) -> Span:
    """Return when a contact, known by its number, is in touch."""
    events, t_end = run.solution.events, run.solution.t_end
    begin, end = events.times(index, CLOSED, PINNED)
    begin, end = begin[begin <= t_end], end[end <= t_end]
    ended = np.ones(begin.size, dtype=bool)
    if end.size < begin.size:
        end, ended[-1] = np.append(end, t_end), False
    return Span(begin, end, ended)


@dataclass(frozen=True)
class Parts:
    """Pieces of panels over which force and rate are integrated; the rate changes its sign nowhere within one."""

    panel: IntArray  #: Shape (k,).
    #: `low`, `high`: ends, from -1 to 1 along the panel, shape (k,).
    low: Array
    high: Array


@dataclass(frozen=True)
class Integrals:
    """Integrals over parts, each of shape (k,)."""

    #: `force`, `square`: integrals of the force, N s, and of its square, N^2 s.
    force: Array
    square: Array
    work: Array  #: Done on the contact, J.
    pressed: Array  #: The part of `work` that is done while the contact is pressed in, J.


@dataclass(frozen=True)
class Touches:
    """Force and rate of a contact as polynomials, for some stretches of time."""

    span: IntArray  #: The stretch that each panel belongs to, shape (n_panels,).
    #: `begin`, `end`: in s, shape (n_panels,).
    begin: Array
    end: Array
    #: `force`, `rate`: Chebyshev coefficients, of N and m/s, shape (n_coefficients, n_panels).
    force: Array
    rate: Array
    #: Largest last coefficient over the largest value: 0 of a stepping method, whose motion is known as polynomials.
    error: float = 0.0
    stiffness: float | None = None  #: Stiffness of a contact whose force is that of a spring alone, N/m.

    def parts(self, window: tuple[float, float] | None = None) -> Parts:
        """Return the pieces of all panels within a window of time in s, cut where the rate changes its sign."""
        low, high = np.full(self.span.size, -1.0), np.ones(self.span.size)
        if window is not None:
            half = np.maximum(0.5 * (self.end - self.begin), 1e-300)
            middle = 0.5 * (self.end + self.begin)
            low = np.clip((window[0] - middle) / half, -1.0, 1.0)
            high = np.clip((window[1] - middle) / half, -1.0, 1.0)
        panel = np.flatnonzero(high > low)
        low, high = low[panel], high[panel]
        x = low + (high - low) * np.linspace(0.0, 1.0, _LOOKS)[:, None]
        positive = _values(self.rate[:, panel], x) > 0.0
        row, column = np.nonzero(positive[1:] != positive[:-1])
        left, right, rising = x[row, column], x[row + 1, column], positive[row + 1, column]
        coefficients = self.rate[:, panel[column]]
        for _ in range(50):
            middle = 0.5 * (left + right)
            beyond = (_values(coefficients, middle[None])[0] > 0.0) == rising
            left, right = np.where(beyond, left, middle), np.where(beyond, middle, right)
        edges = np.concatenate([low, 0.5 * (left + right)])
        of = np.concatenate([np.arange(panel.size), column])
        order = np.lexsort((edges, of))
        edges, of = edges[order], of[order]
        last = np.append(of[1:] != of[:-1], True) if of.size else np.empty(0, dtype=bool)
        following = np.append(edges[1:], 0.0)
        return Parts(panel[of], edges, np.where(last, high[of], following))

    def integrals(self, parts: Parts) -> Integrals:
        """Return integrals over some parts, exact for the polynomials."""
        half = 0.25 * (parts.high - parts.low) * (self.end - self.begin)[parts.panel]
        x = parts.low + 0.5 * (parts.high - parts.low) * (1.0 + _GAUSS[:, None])
        force, rate = (_values(values[:, parts.panel], x) for values in (self.force, self.rate))
        impulse, square, work = (half * (_WEIGHTS @ values) for values in (force, force**2, force * rate))
        if self.stiffness is not None:
            work = self._stored(parts)
        inwards = rate[_SMOOTH // 2] > 0.0
        return Integrals(impulse, square, work, np.where(inwards, work, 0.0))

    def _stored(self, parts: Parts) -> Array:
        """Return by how much the energy of an elastic contact grows over each part, J.

        Where two panels meet, their polynomials differ by what they leave out, and the mean of both is taken: else the
        sum over many panels would not be the energy at the end.
        """
        coefficients = self.force[:, parts.panel]
        low, high = _values(coefficients, parts.low[None])[0], _values(coefficients, parts.high[None])[0]
        of = self.span[parts.panel]
        meet = np.flatnonzero(of[1:] == of[:-1])
        low[meet + 1] = high[meet] = 0.5 * (low[meet + 1] + high[meet])
        moving = np.any(self.rate[:, parts.panel] != 0.0, axis=0)
        assert self.stiffness is not None
        return np.where(moving, 0.5 * (high + low) * (high - low) / self.stiffness, 0.0)

    def peaks(self, parts: Parts) -> tuple[Array, Array]:
        """Return the force of largest magnitude within each part in N, and the time in s at which it is reached."""
        coefficients = self.force[:, parts.panel]
        ends = np.stack([parts.low, parts.high])
        values = _values(coefficients, ends)
        best, every = np.argmax(np.abs(values), axis=0), np.arange(parts.low.size)
        found, place = values[best, every], ends[best, every]
        # The force of a spring grows or falls throughout a part.
        elastic = self.stiffness is not None and np.any(self.rate[:, parts.panel] != 0.0, axis=0)
        left = np.flatnonzero(~np.broadcast_to(elastic, every.shape))
        low, high, coefficients, columns = parts.low[left], parts.high[left], coefficients[:, left], every[: left.size]
        for _ in range(_ROUNDS if left.size else 0):
            x = low + (high - low) * np.linspace(0.0, 1.0, _LOOKS)[:, None]
            values = _values(coefficients, x)
            best = np.argmax(np.abs(values), axis=0)
            found[left], place[left] = values[best, columns], x[best, columns]
            low, high = x[np.maximum(best - 1, 0), columns], x[np.minimum(best + 1, _LOOKS - 1), columns]
        begin, end = self.begin[parts.panel], self.end[parts.panel]
        return np.asarray(found, dtype=float), begin + 0.5 * (1.0 + place) * (end - begin)


def resolve(
    run: Motion, laws: ContactLaws, index: int, begin: Array, end: Array, tolerance: float = RESOLVED
) -> Touches | None:
    """Return force and rate of a contact over stretches of time in touch; None where the run does not know them.

    `index`: number of the contact.
    `begin`, `end` (shape (k,)): begin and end of the intervals, s, in ascending order and without overlap.
    `tolerance`: error of force and rate between events that is accepted, over their largest values.
    """
    # Under an undamped ideal law the rate follows from the force, which is smoother: fast modes have large velocities.
    elastic = run.solution.continuous and laws.damping[index] == 0.0 and np.isinf(laws.resolution[index])
    motion = _Sampler(run, laws, index, rates=not elastic)
    span, low, high = _smooth_pieces(run, begin, end)
    try:
        if not run.solution.continuous:
            return Touches(span, low, high, *_fit(motion, low, high, _STEP))
        found = _adapted(motion, span, low, high, tolerance)
        # What rests at a rigid stop does not move.
        with_rates = elastic and not laws.rigid[index]
        return _with_rates(found, run, float(laws.stiffness[index]), index) if with_rates else found
    except ArgumentError:
        # A stepping run with few stored times knows the forces of its contacts at those times only.
        return None


class _Sampler:
    """Force of a contact and, where wanted, its rate at any times, in blocks that a bounded memory holds."""

    def __init__(self, run: Motion, laws: ContactLaws, index: int, *, rates: bool) -> None:
        self._solution, self._laws, self._index, self._rates = run.solution, laws, index, rates
        self._block = max(64, _NUMBERS // max(1, run.model.system.size + len(laws)))

    def __call__(self, times: Array) -> tuple[Array, Array]:
        force, rate = np.zeros((2, times.size))
        for start in range(0, times.size, self._block):
            part = slice(start, start + self._block)
            # One thread at a time, so that the forces that both need are computed once.
            force[part] = self._solution.contacts(times[part]).force[self._index]
            if self._rates:
                rate[part] = self._laws.gap_rate(self._solution.sample(times[part]), self._index, times[part])
        return force, rate


def _smooth_pieces(run: Motion, begin: Array, end: Array) -> tuple[IntArray, Array, Array]:
    """Return stretches cut where the motion is not smooth: the stretch of each piece, and its ends in s."""
    solution = run.solution
    kinks = [np.asarray(solution.events.time, dtype=float)]
    if solution.continuous:
        kinks += [np.asarray(load.function.breakpoints(solution.t_end)) for load in run.model.system.loads]
    else:
        kinks.append(run.times)
    inner = np.unique(np.concatenate(kinks))
    edges = np.unique(np.concatenate([begin, end, inner]))
    middle = 0.5 * (edges[:-1] + edges[1:])
    span = np.searchsorted(begin, middle, side="right") - 1
    within = (span >= 0) & (middle < end[np.maximum(span, 0)]) if begin.size else np.zeros(middle.size, dtype=bool)
    return span[within].astype(np.int64), edges[:-1][within], edges[1:][within]


def _nodes(count: int) -> tuple[Array, Array]:
    """Return Chebyshev's points inside (-1, 1) and the matrix that makes coefficients of values there."""
    angle = (np.arange(count) + 0.5) * np.pi / count
    matrix = 2.0 / count * np.cos(np.arange(count)[:, None] * angle)
    matrix[0] *= 0.5
    return np.cos(angle), matrix


def _fit(motion: _Sampler, low: Array, high: Array, count: int) -> tuple[Array, Array]:
    """Return coefficients of force and rate over some panels, each of shape (count, n_panels)."""
    x, matrix = _nodes(count)
    times = (0.5 * (low + high) + 0.5 * (high - low) * x[:, None]).T
    # In the order of time, as segments are visited.
    force, rate = (matrix @ values.reshape(times.shape).T for values in motion(times.ravel()))
    return force, rate


def _with_rates(found: Touches, run: Motion, stiffness: float, index: int) -> Touches:
    """Return an undamped contact with the rates that follow from its force; a pinned contact does not move."""
    rate = np.zeros_like(found.force)
    rate[:-1] = np.polynomial.chebyshev.chebder(found.force) * (2.0 / (stiffness * (found.end - found.begin)))
    pinned = status_at(run.solution.events, 0.5 * (found.begin + found.end))[index] == PINNED
    rate[:, pinned] = 0.0
    return replace(found, rate=rate, stiffness=stiffness)


def _adapted(motion: _Sampler, span: IntArray, low: Array, high: Array, tolerance: float) -> Touches:
    """Return panels that are halved until the polynomials on them are the motion."""
    done: list[tuple[IntArray, Array, Array, Array, Array]] = []
    scale = np.zeros(2)
    count, error = 0, 0.0
    for depth in range(_DEPTH):
        force, rate = _fit(motion, low, high, _SMOOTH)
        for k, values in enumerate((force, rate)):
            scale[k] = max(scale[k], float(np.max(np.abs(values[0]) + np.abs(values[1]), initial=0.0)))
        size = np.where(scale > 0.0, scale, 1.0)
        tail = np.maximum(*(np.max(np.abs(c[-3:]), axis=0) / s for c, s in zip((force, rate), size, strict=True)))
        count += span.size
        ready = (tail <= tolerance) | (count > _PANELS) | (depth == _DEPTH - 1)
        error = max(error, float(np.max(tail[ready], initial=0.0)))
        done.append((span[ready], low[ready], high[ready], force[:, ready], rate[:, ready]))
        left = ~ready
        if not np.any(left):
            break
        middle = 0.5 * (low[left] + high[left])
        span = np.repeat(span[left], 2)
        low, high = np.stack([low[left], middle], axis=1).ravel(), np.stack([middle, high[left]], axis=1).ravel()
    parts = [np.concatenate([one[k] for one in done], axis=-1) for k in range(5)]
    order = np.argsort(parts[1], kind="stable")
    of, begin, end, force, rate = (part[..., order] for part in parts)
    return Touches(of, begin, end, force, rate, error)


def _values(coefficients: Array, x: Array) -> Array:
    """Return polynomials at points x of shape (k, n_panels), by Clenshaw's recurrence."""
    ahead, beyond = np.zeros_like(x), np.zeros_like(x)
    for c in coefficients[:0:-1]:
        ahead, beyond = c + 2.0 * x * ahead - beyond, ahead
    return np.asarray(coefficients[0] + x * ahead - beyond)
