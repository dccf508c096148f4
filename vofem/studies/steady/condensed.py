"""Shooting for large structures in a few coordinates, which represent the lowest modes and all static responses.

Only few of the modes of a fine mesh move in a steady motion. The other modes follow the forces at once or decay within
a period. Orbits of large systems are therefore computed in load-dependent Ritz vectors
(`reduction.py`): static responses to contacts, loads and dashpots, and the vectors that are generated from them and
from loads of any shape. The latter converge to the lowest modes. Their number is doubled until the orbit no longer
changes. Equal bodies that are not touched by contacts or loads have several modes of the same frequency. Of these only
one is included for each load.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vofem.arrays import Array
from vofem.errors import MethodError
from vofem.integrators.base import Truncation
from vofem.integrators.event_driven.flow import modes_of
from vofem.integrators.event_driven.run import run
from vofem.integrators.event_driven.solution import EventSolution
from vofem.integrators.event_driven.truncated import lifted
from vofem.integrators.reduction import Reduction, input_rows
from vofem.studies.steady.orbit import OrbitTruncation
from vofem.system import Counters, State, System

#: Number of degrees of freedom up to which all modes are used.
FULL = 200

#: First number of vectors; number for each load, contact and rigid motion; largest number.
_FIRST, _EACH, _MOST = 48, 6, 384

#: Relative change of displacements by doubling the vectors that is small enough.
GOOD = 1e-8

#: Relative change of a frequency by doubling the vectors, up to which it is that of a mode.
_CONVERGED = 1e-6

#: Loss of digits in static responses above which a system is refused.
_WORST_ROUNDING = 1e-6

#: Number of frequencies at which decay rates are computed. They lie between the lowest one that is left out and this
#: multiple of it.
_RATES, _RANGE = 200, 1e6


def condensable(system: System) -> bool:
    """Return whether a system is so large, with so few loads and contacts, that it is reduced to a few vectors."""
    if system.sliders is not None or (system.contacts is not None and system.contacts.rigid.any()):
        # Impacts on rigid stops and sliders that stick meet the inertia of all modes.
        return False
    return system.size > FULL and 2 * first_count(system) <= min(_MOST, system.size // 2)


def first_count(system: System) -> int:
    """Return the first number of vectors of a system."""
    return max(_FIRST, _EACH * (len(input_rows(system)) + system.rigid.shape[1] + 1))


@dataclass(frozen=True)
class Condensed:
    """A system in a few vectors."""

    #: `full`, `system`: the system with all degrees of freedom, and the system in the vectors.
    full: System
    system: System
    vectors: Array  #: M-orthonormal, shape (n, count).
    rounding: float  #: Relative difference of static responses between two orders of elimination.

    def lift(self, state: State) -> State:
        """Return a state over the free degrees of freedom."""
        return State(self.vectors @ state.q, self.vectors @ state.v)

    def project(self, state: State) -> State:
        """Return the state in the vectors that is nearest to one over the free degrees of freedom."""
        momentum = self.full.mass @ np.stack([state.q, state.v], axis=1)
        q, v = (self.vectors.T @ momentum).T
        return State(q, v)

    @cached_property
    def lowest_left_out(self) -> float:
        """A lower bound in rad/s on the frequencies of the modes that the vectors do not represent.

        Modes converge from the lowest one on. A mode has converged if half of the vectors represent it too.
        """
        count = self.vectors.shape[1]
        half, _ = _in_vectors(self.full, count // 2)
        few = modes_of(half, Counters()).stiffness
        many = modes_of(self.system, Counters()).stiffness[: few.size]
        moved = np.flatnonzero(np.abs(few - many) > _CONVERGED * many)
        return float(np.sqrt(many[moved[0]] if moved.size else many[-1]))

    def doubled(self) -> Iterator[Condensed]:
        """Yield the system in twice as many vectors, and again in twice as many, until these are too many."""
        count = 2 * self.vectors.shape[1]
        while count <= min(_MOST, self.full.size // 2):
            yield condensed(self.full, count, None)
            count *= 2

    def change(self, one: State, other: State) -> float:
        """Return the relative difference of two states, displacements and velocities each in the mean over the mass."""

        def size(x: Array) -> float:
            return float(np.sqrt(x @ (self.full.mass @ x)))

        parts = [(size(b - a), size(b)) for a, b in ((one.q, other.q), (one.v, other.v))]
        return max(away / whole if whole > 0.0 else away for away, whole in parts)

    def solution(self, state: State, duration: float, times: Array, error: float | None) -> EventSolution:
        """Return the run of `event_driven` over an orbit from a state over all degrees of freedom; see `truncation`."""
        solution = run(self.system, self.project(state), duration, times, truncation=0.0)
        left_out = self.truncation(duration, error)
        kept = Truncation(self.vectors.shape[1], self.full.size, left_out.error, duration, self.rounding)
        lifted(solution, self.vectors, kept, GOOD, bool(np.any(self.full.rotation)))
        solution.notes[0] = f"truncation: {left_out.what}"
        return solution

    def truncation(self, duration: float, error: float | None) -> OrbitTruncation:
        """Return the error of an orbit of some duration in s by the modes that are left out.

        `error`: relative change of displacements by doubling the vectors, where it is known.
        """
        lowest = self.lowest_left_out
        largest = float(np.exp(-slowest_decay(self.full, lowest) * duration))
        left, kept = self.full.size - self.vectors.shape[1], self.vectors.shape[1]
        change = "" if error is None else f"twice as many would change displacements by {error:.1e} of themselves; "
        return OrbitTruncation(
            left,
            largest,
            f"{kept} vectors, static responses and the lowest modes, stand for {self.full.size} degrees of freedom; "
            f"{change}{left} modes above {lowest:.4g} rad/s are left out, whose multipliers are at most {largest:.1e}",
            np.nan if error is None else error,
        )


def condensed(full: System, count: int, earlier: Condensed | None) -> Condensed:
    """Return a system in a number of vectors; those of an earlier system where both are equal.

    Raises `MethodError` if rounding spoils the static responses of the mesh.
    """
    if (
        earlier is not None
        and full.cache is not earlier.full.cache
        and full.has_matrices_of(earlier.full)
        and full.has_contact_rows_of(earlier.full)
        and full.has_load_vectors_of(earlier.full)
    ):
        full.cache.adopt([_KIND], earlier.full.cache)
    small, vectors = _in_vectors(full, count)
    # The cache may be that of a system with other functions of time.
    loads = tuple(replace(mine, function=load.function, name=load.name)
                  for mine, load in zip(small.loads, full.loads, strict=True))  # fmt: skip
    own = replace(small, loads=loads)
    own.share(small)
    return Condensed(full, own, vectors, _reduction(full).rounding)


def reduced(full: System, least: int = 0) -> Condensed | None:
    """Return a system in the first number of vectors, or in more; None where all modes are used."""
    return condensed(full, max(first_count(full), least), None) if condensable(full) else None


#: What `System.cache` holds for all systems of the same matrices, contact rows and load vectors.
_KIND = "vectors of orbits"


def _reduction(full: System) -> Reduction:
    """Return the object that computes vectors of a system."""

    def make() -> Reduction:
        any_shape = np.random.default_rng(0).standard_normal((1 + full.rigid.shape[1], full.size))
        nothing = State(np.zeros(full.size), np.zeros(full.size))
        found = Reduction(full, nothing, more=[full.mass @ shape for shape in any_shape])
        if found.rounding > _WORST_ROUNDING:
            raise MethodError(
                f"rounding spoils {found.rounding:.1e} of the static response of {full.size} degrees of freedom: use "
                "fewer elements, or method='harmonic_balance'"
            )
        return found

    return full.cache.get(_KIND, None, make)


def _in_vectors(full: System, count: int) -> tuple[System, Array]:
    """Return a system in a number of vectors, shape (n, count), and these."""

    def make() -> tuple[System, Array]:
        reduction = copy.copy(_reduction(full))
        reduction.system = full
        small, _, vectors = reduction.to(count)
        return small, vectors

    return full.cache.get("system in vectors of orbits", count, make, 4)


def slowest_decay(system: System, lowest: float) -> float:
    """Return the least rate in 1/s at which free vibrations above a frequency in rad/s decay by material damping.

    A vibration with ``x'' + c x' + w^2 x = 0`` decays at the rate c/2, and where it is overdamped at the slower one of
    two rates. Dashpots increase this rate.
    """
    squares = np.geomspace(max(lowest, np.finfo(float).tiny) ** 2, (_RANGE * lowest) ** 2, _RATES)
    rates = np.zeros(squares.size)
    if system.rayleigh is not None:
        rates += system.rayleigh[0] + system.rayleigh[1] * squares
    if system.modal_damping is not None:
        ratios = np.atleast_1d(np.asarray(system.modal_damping, dtype=float))
        rates += 2.0 * float(ratios.min()) * np.sqrt(squares)
    root = np.sqrt(np.maximum(rates**2 - 4.0 * squares, 0.0))
    decay = np.where(root > 0.0, 2.0 * squares / np.where(root > 0.0, rates + root, 1.0), 0.5 * rates)
    return float(decay.min())
