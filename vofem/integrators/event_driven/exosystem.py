"""The loads of a run as free motions: harmonics are oscillators without damping, lines have a value and a slope.

A polynomial of a higher degree, up to the third, is a line too, which is bent by another: its second derivative.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.linalg.oscillators import oscillators
from vofem.system import ContactLaws, Load
from vofem.time_functions import TimeFunction

Integers = NDArray[np.int64]

#: The load that is 1 at all times; its force is that of the offsets of closed and pinned contacts.
CONSTANT = -1

#: The place of a load where others have more.
_NONE = -2


@dataclass(frozen=True)
class Kind:
    """The loads of one kind of interval.

    Attributes
    ----------
    function, omega, bend : ndarray, shape (e,)
        See `Exosystem`.
    of : ndarray, shape (8, e)
        The loads as oscillators.
    """

    function: Integers
    omega: Array
    bend: Integers
    of: Array

    @cached_property
    def lines(self) -> Integers:
        """Numbers of the lines."""
        return np.flatnonzero(self.omega == 0.0)

    @cached_property
    def waves(self) -> Integers:
        """Numbers of the harmonics."""
        return np.flatnonzero(self.omega)

    @cached_property
    def layout(self) -> tuple[bytes, ...]:
        """What tells the kind from those that do not differ in frequencies of harmonics alone."""
        return self.function.tobytes(), (self.omega != 0.0).tobytes(), self.bend.tobytes()

    @cached_property
    def key(self) -> tuple[bytes, ...]:
        """What tells the kind from others."""
        return self.function.tobytes(), self.omega.tobytes(), self.bend.tobytes()


@dataclass(frozen=True)
class Exosystem:
    """Functions of time as sums of loads ``(f, f')`` between breakpoints, with ``f'' = -omega^2 f`` or ``f'' = w``.

    Intervals with the same frequencies are of one kind.

    Attributes
    ----------
    edges : ndarray, shape (k + 1,)
        Ends of the intervals in s.
    states : ndarray, shape (k, 2, e)
        Values and rates of the loads at the beginnings of the intervals.
    kind : ndarray of int, shape (k,)
        Kinds of the intervals.
    function : ndarray of int, shape (n_kinds, e)
        The function that each load is a part of, or `CONSTANT`.
    omega : ndarray, shape (n_kinds, e)
        Frequencies in rad/s, 0 for lines.
    bend : ndarray of int, shape (e,)
        The load w that is the second derivative of each line; -1 for none.
    """

    edges: Array
    states: Array
    kind: Integers
    function: Integers
    omega: Array
    bend: Integers

    @property
    def size(self) -> int:
        """Number of loads e."""
        return int(self.states.shape[2])

    @cached_property
    def kinds(self) -> list[Kind]:
        """The loads of each kind of interval."""
        still = np.zeros(self.size)
        return [
            Kind(function, omega, self.bend, oscillators(still, omega**2))
            for function, omega in zip(self.function, self.omega, strict=True)
        ]

    @property
    def horizon(self) -> float:
        """The next power of two above the duration of all intervals, in s, so that similar durations have one."""
        return math.ldexp(1.0, math.frexp(float(self.edges[-1] - self.edges[0]))[1])

    def interval(self, times: Array) -> Integers:
        """Return the interval in which each time lies, the later one of two that meet there."""
        # All inner edges count, so times outside belong to the first and the last interval.
        return np.searchsorted(self.edges[1:-1], times, side="right")

    def at(self, times: Array) -> Array:
        """Return values and rates of the loads at some times, shape (n_times, 2, e).

        A time is counted from the beginning of its interval, so times beyond the last interval belong to that.
        """
        interval = self.interval(times)
        omega = self.omega[self.kind[interval]]
        late, first = (times - self.edges[interval])[:, None], self.states[interval]
        waves = omega > 0.0
        cosine = np.cos(omega * late)
        sine = np.where(waves, np.sin(omega * late) / np.where(waves, omega, 1.0), late)
        value, rate = first[:, 0], first[:, 1]
        result = np.stack([cosine * value + sine * rate, cosine * rate - omega**2 * sine * value], axis=1)
        bent = np.flatnonzero(self.bend >= 0)
        if bent.size:
            second, third = first[:, 0, self.bend[bent]], first[:, 1, self.bend[bent]]
            result[:, 0, bent] += late**2 * (second / 2.0 + late * third / 6.0)
            result[:, 1, bent] += late * (second + late * third / 2.0)
        return result


def load_bounds(loads: Exosystem, vectors: Array) -> Array:
    """Return bounds on the modal loads in each interval, shape (k, n).

    `vectors` (shape (n_functions, n)): modal load vectors.
    """
    late = np.diff(loads.edges)[:, None]
    value, rate = np.abs(loads.states[:, 0]), np.abs(loads.states[:, 1])
    omega, function = loads.omega[loads.kind], loads.function[loads.kind]
    waves, bent = omega > 0.0, np.flatnonzero(loads.bend >= 0)
    bounds = np.where(waves, np.hypot(value, rate / np.where(waves, omega, 1.0)), value + late * rate)
    second, third = value[:, loads.bend[bent]], rate[:, loads.bend[bent]]
    bounds[:, bent] += late**2 * (second / 2.0 + late * third / 6.0)
    size = np.concatenate([np.abs(vectors), np.zeros((1, vectors.shape[1]))])
    return np.asarray(np.einsum("ke,ken->kn", bounds, size[np.where(function >= 0, function, len(vectors))]))


def gathered(loads: Sequence[Load], rows: Array) -> tuple[list[Any], Array]:
    """Return the functions of time of some loads, equal ones once, and for each the sum of its modal load vectors.

    Parameters
    ----------
    loads : sequence of Load
    rows : ndarray, shape (n_loads, n)
        Modal load vectors.
    """
    places: dict[Any, int] = {}
    functions: list[Any] = []
    owner = []
    for load in loads:
        function = load.function
        key = function if getattr(type(function), "__hash__", None) is not None else id(function)
        if key not in places:
            places[key] = len(functions)
            functions.append(function)
        owner.append(places[key])
    vectors = np.zeros((len(functions), rows.shape[1]))
    for place, vector in zip(owner, rows, strict=True):
        vectors[place] += vector
    return functions, vectors


def pushes(laws: ContactLaws | None) -> bool:
    """Return whether contacts push at their gaps, by offsets or by what holds them there, so that 1 is a load."""
    return laws is not None and bool(laws.offset.any() or laws.jump.any() or laws.rigid.any())


def exosystem(functions: Sequence[TimeFunction], edges: Array, *, constant: bool) -> Exosystem:
    """Return some functions of time as loads.

    Parameters
    ----------
    functions : sequence of TimeFunction
        Functions with closed forms.
    edges : ndarray, shape (k + 1,)
        Increasing times in s with all breakpoints in between.
    constant : bool
        Whether the first load is the constant 1.
    """
    edges = np.array(edges, dtype=float)
    begin = edges[:-1]
    k = begin.size
    lines, waves = np.zeros((k, 2, len(functions))), [dict[tuple[int, float], complex]() for _ in range(k)]
    bends = np.zeros((k, 2, len(functions)))
    for f, function in enumerate(functions):
        cubic = function.polynomials(begin)
        if cubic is not None:
            lines[:, :, f], bends[:, :, f] = cubic[:2].T, cubic[2:].T
            continue
        for i, t in enumerate(begin.tolist()):
            piece = function.piece(t)
            lines[i, :, f] = piece.constant, piece.slope
            bends[i, :, f] = piece.curvature, piece.jerk
            for w, wave in piece.harmonics:
                waves[i][f, float(w)] = waves[i].get((f, float(w)), 0.0j) + wave
    curved = bends.any(axis=(0, 1))
    bent, used = np.flatnonzero(curved), np.flatnonzero(lines.any(axis=(0, 1)) | curved)
    kinds: dict[tuple[tuple[int, float], ...], int] = {}
    kind = np.array([kinds.setdefault(tuple(found), len(kinds)) for found in waves], dtype=np.int64)
    straight_end = int(constant) + used.size
    first = straight_end + bent.size
    e = first + max((len(found) for found in kinds), default=0)
    states = np.zeros((k, 2, e))
    owner, omega = np.full((len(kinds), e), _NONE), np.zeros((len(kinds), e))
    if constant:
        states[:, 0, 0], owner[:, 0] = 1.0, CONSTANT
    states[:, :, int(constant) : straight_end], owner[:, int(constant) : straight_end] = lines[:, :, used], used
    bend = np.full(e, -1)
    if bent.size:
        states[:, :, straight_end:first] = bends[:, :, bent]
        bend[int(constant) + np.searchsorted(used, bent)] = np.arange(straight_end, first)
    for i, found in enumerate(waves):
        for j, ((f, w), wave) in enumerate(found.items(), first):
            owner[kind[i], j], omega[kind[i], j] = f, w
            states[i, :, j] = wave.real, -w * wave.imag
    return Exosystem(edges, states, kind, owner, omega, bend)
