"""The linear part of a structure at given frequencies: dynamic compliance in modes or Ritz vectors.

Without its nonlinear laws the response of a structure to a load ``f exp(i omega t)`` is ``q = A^-1 f``, ``A = K + i
omega C - omega^2 M + sum_s c_s (i omega)^alpha_s b_s b_s'``; the last sum is that of springpots, which act on harmonic
motions exactly in this way. In modes A is diagonal except for dashpots, springpots and contacts that are held closed.
These are few and enter as a small system of equations (Woodbury). Modes near resonance stay in that system, so that
nothing is divided by a small number.

Large systems are expressed in load-dependent Ritz vectors. These are nested, so the change of the response from half of
them to all of them is known. Their number is doubled until this change is small.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array, Complex
from vofem.errors import ArgumentError, ConvergenceError, SingularSystemError
from vofem.integrators.event_driven.flow import modes_of
from vofem.integrators.event_driven.modal_space import ModalSpace, modal_space
from vofem.integrators.reduction import Reduction
from vofem.system import Counters, State, System

#: Number of degrees of freedom up to which all modes are used.
FULL = 200

#: First and largest number of Ritz vectors, and the relative change of responses that ends their doubling.
_FIRST, _MOST, _CHANGE = 32, 2048, 1e-10

#: Largest change that is accepted, with a note, if it does not fall further because of rounding.
_ROUNDING = 1e-7

#: A mode whose dynamic stiffness is below this fraction of its terms is solved together with dashpots and springpots.
_NEAR = 1e-3

#: Eigenvalues of a damping matrix below this fraction of the largest count as zero.
_NO_DAMPING = 1e-14

#: Condition of the small system from which on the response counts as unbounded.
_SINGULAR = 1e14


@dataclass(frozen=True)
class Attached:
    """The force ``b factor(omega) (b.q)`` of a linear law or a closed contact on a row."""

    rows: Any  #: Shape (k, n).
    factor: Callable[[float], Complex]  #: Takes omega in rad/s, returns complex stiffnesses in N/m, shape (k,).


class LinearRest:
    """The linear part of a system in modes or Ritz vectors.

    `attached`: linear laws that are not part of the system's matrices.
    `inputs` (shape (k, n)): rows of laws and load vectors through which forces act.
    `largest` (shape (n_frequencies,)): angular frequencies in rad/s at which Ritz vectors must be accurate.
    `vectors` (shape (n, m)): modes or their combinations; M-orthonormal.
    `squares`, `damping` (shape (m,)): squared frequencies, and classical damping rates.
    `error`: relative change of responses under the last doubling of Ritz vectors; 0 for all modes.
    """

    def __init__(
        self,
        system: System,
        attached: Sequence[Attached],
        inputs: Array,
        largest: Array,
        counters: Counters | None = None,
    ) -> None:
        self.system, self._attached = system, tuple(attached)
        self.error = 0.0
        counters = Counters() if counters is None else counters
        if system.size <= FULL:
            space = modes_of(system, counters)
            self._take(space, space.shapes)
            return
        self._reduce(inputs, largest, counters)

    # -- modes and Ritz vectors -----------------------------------------------------------------------

    def _take(self, space: ModalSpace, vectors: Array) -> None:
        """Store modes and their vectors, and the terms that couple them as columns, dashpots first."""
        self.vectors, self.squares, self.damping = vectors, space.stiffness, space.damping
        #: Directions in modes and rates of the dampers that couple modes, shapes (m, k) and (k,).
        self.dashpots: tuple[Array, Array] = np.zeros((space.size, 0)), np.zeros(0)
        if space.coupling is not None:
            values, shapes = np.linalg.eigh(0.5 * (space.coupling + space.coupling.T))
            kept = np.abs(values) > _NO_DAMPING * np.abs(values).max(initial=0.0)
            self.dashpots = shapes[:, kept], values[kept]
        attached = [np.asarray(part.rows @ vectors).T for part in self._attached]
        self.columns = np.concatenate([self.dashpots[0], *attached], axis=1)

    def _reduce(self, inputs: Array, largest: Array, counters: Counters) -> None:
        """Double the number of Ritz vectors until responses at all frequencies no longer change."""
        structure = replace(self.system, laws=(), loads=())
        rows = [row for row in inputs if np.any(row)]
        rows += [row for part in self._attached for row in np.asarray(part.rows.toarray())]
        nothing = np.zeros(structure.size)
        reduction = Reduction(structure, State(nothing, nothing), more=rows)
        counters.factorizations += 1
        sampled = np.unique(np.concatenate([[largest.min(), largest.max()], np.quantile(largest, [0.25, 0.5, 0.75])]))
        before: Complex | None = None
        count = max(_FIRST, 4 * len(rows))
        while True:
            small, _, vectors = reduction.to(count)
            space = modal_space(small, counters)
            self._take(space, vectors @ space.shapes)
            # Responses to all inputs in Ritz vectors, shape (n_frequencies, m, n_inputs).
            now = np.asarray(space.shapes @ self.response(sampled, (inputs @ self.vectors).T))
            if before is not None:
                self.error = _largest_change(before, now)
                if self.error <= _CHANGE:
                    return
            if vectors.shape[1] < count:
                # The loads generate no further vectors, so this is the whole response.
                self.error = 0.0
                return
            if count >= _MOST:
                break
            before, count = now, 2 * count
        if self.error > _ROUNDING:
            raise ConvergenceError(
                f"{count} Ritz vectors leave the response at {sampled.max():.4g} rad/s "
                f"({sampled.max() / (2.0 * np.pi):.4g} Hz) uncertain by {self.error:.1e} of itself: the frequency is "
                "too high for so many degrees of freedom. Ask for lower frequencies or fewer harmonics"
            )

    def with_attached(self, part: Attached) -> LinearRest:
        """Return the same structure with further linear laws."""
        other = copy.copy(self)
        other._attached = (*self._attached, part)
        other.columns = np.concatenate([self.columns, np.asarray(part.rows @ self.vectors).T], axis=1)
        return other

    def dissipation(self, rates: Array) -> Array:
        """Return the power in W that dashpots and material damping dissipate at modal velocities (m, n_times)."""
        columns, dampers = self.dashpots
        return np.asarray(self.damping @ rates**2 + dampers @ (columns.T @ rates) ** 2)

    # -- responses ------------------------------------------------------------------------------------

    def response(self, omegas: Array, forces: Array | Complex) -> Complex:
        """Return modal displacements under modal forces of angular frequencies omegas.

        `omegas`: angular frequencies in rad/s, shape (n_frequencies,).
        `forces` has shape (m, k), the same at all frequencies, or (n_frequencies, m, k).
        Returns an array of shape (n_frequencies, m, k).
        Raises `SingularSystemError` if a response is unbounded: an undamped resonance, or a rigid motion at rest.
        """
        w = omegas[:, None]
        diagonal = self.squares - w * w + 1j * w * self.damping
        size = self.squares + w * w
        near = np.abs(diagonal) <= _NEAR * np.where(size > 0.0, size, 1.0)
        given = np.broadcast_to(np.asarray(forces, dtype=complex), (omegas.size, *forces.shape[-2:]))
        out = np.zeros(given.shape, dtype=complex)
        np.divide(given, diagonal[..., None], out=out, where=~near[..., None])
        # Frequencies at which the same modes are near are solved together.
        patterns, pattern = near[:1], np.zeros(omegas.size, dtype=np.int64)
        if near.any():
            patterns, pattern = np.unique(near, axis=0, return_inverse=True)
        for number, modes in enumerate(patterns):
            if modes.any() or self.columns.shape[1]:
                at = np.flatnonzero(pattern == number)
                out[at] = self._coupled(omegas[at], diagonal[at], modes, given[at], out[at])
        return out

    def _coupled(
        self, omegas: Array, diagonal: Complex, near: NDArray[np.bool_], forces: Complex, out: Complex
    ) -> Complex:
        """Return responses (f, m, k) at f frequencies, given those of far modes alone without coupling."""
        far, columns, dampers = ~near, self.columns, self.dashpots[1]
        # Complex stiffnesses of the terms that couple modes, shape (f, r, 1).
        attached = [[part.factor(omega) for part in self._attached] for omega in omegas.tolist()]
        factors = np.array([np.concatenate([1j * w * dampers, *own]) for w, own in zip(omegas, attached, strict=True)])
        factors = factors[:, :, None]
        k, r = int(near.sum()), columns.shape[1]
        # Unknowns: displacements of the near modes, forces of what couples.
        spread = columns[far] / diagonal[:, far, None]
        matrix = np.zeros((omegas.size, k + r, k + r), dtype=complex)
        matrix[:, np.arange(k), np.arange(k)] = diagonal[:, near]
        matrix[:, :k, k:] = columns[near]
        matrix[:, k:, :k] = -factors * columns[near].T
        matrix[:, k:, k:] = np.eye(r) + factors * (columns[far].T @ spread)
        right = np.concatenate([forces[:, near], factors * (columns[far].T @ out[:, far])], axis=1)
        found, singular = _solved(matrix, right)
        if singular.any():
            omega = omegas[np.argmax(singular)]
            raise SingularSystemError(
                f"the response at {omega:.9g} rad/s ({omega / (2.0 * np.pi):.9g} Hz) is unbounded: "
                + (
                    "nothing holds a rigid motion against a constant load"
                    if omega == 0.0
                    else "it is a natural frequency without damping. Add damping, or choose another frequency"
                )
            )
        out[:, near] = found[:, :k]
        out[:, far] -= spread @ found[:, k:]
        return out


def _solved(matrix: Complex, right: Complex) -> tuple[Complex, NDArray[np.bool_]]:
    """Return solutions of f small systems, and whether the condition of each, balanced, is too large, shape (f,).

    Where one is, there are no solutions.
    """
    rows = np.abs(matrix).max(axis=2, keepdims=True)
    rows[rows == 0.0] = 1.0
    scaled = matrix / rows
    columns = np.abs(scaled).max(axis=1, keepdims=True)
    columns[columns == 0.0] = 1.0
    scaled = scaled / columns
    singular = ~(np.linalg.cond(scaled) < _SINGULAR)
    if singular.any():
        return right, singular
    return np.linalg.solve(scaled, right / rows) / columns.transpose(0, 2, 1), singular


def _largest_change(before: Complex, now: Complex) -> float:
    """Return the largest change of responses, in the norm of the mass matrix, over their size."""
    m = before.shape[1]
    change = now.copy()
    change[:, :m] -= before
    size = np.linalg.norm(now, axis=1)
    relative = np.linalg.norm(change, axis=1) / np.where(size > 0.0, size, 1.0)
    return float(relative.max(initial=0.0))


def linear_laws(what: str, system: System) -> list[Attached]:
    """Return the laws of a system that are linear in harmonic motions, such as springpots, as complex stiffnesses.

    Raises `ArgumentError` if a law has no response to a single frequency, such as a springpot whose order varies in
    time.
    """
    groups = [group for group in system.laws if group.linear]
    for group in groups:
        reason = group.harmonic_refusal()
        if reason is not None:
            raise ArgumentError(f"{what}: {reason}")
    return [Attached(group.rows, group.harmonic_stiffness) for group in groups]
