"""The outcome of a path of equilibria: histories over the load factors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import Named
from vofem.arrays import Array
from vofem.assembly import Model
from vofem.initial import StoredState
from vofem.laws import past_of
from vofem.lookup import body_named, row_of, the_beam


@dataclass(frozen=True)
class ContactPath:
    """A contact along a path of equilibria, each array of shape (n_factors,).

    Attributes
    ----------
    force : ndarray
        Contact force in N; positive pushes the bodies apart.
    closed, pinned : ndarray of bool
        Whether the contact is closed, and whether it rests exactly at its gap.
    gap_function : ndarray
        The gap function s in m; positive is penetration.
    """

    force: Array
    closed: NDArray[np.bool_]
    pinned: NDArray[np.bool_]
    gap_function: Array


@dataclass(frozen=True)
class SpringPath:
    """A hysteretic spring along a path of equilibria, each array of shape (n_factors,).

    Attributes
    ----------
    elongation : ndarray
        Elongation in m; for a crushing stop the approach.
    force : ndarray
        Force in N, positive in tension; for a crushing stop positive when it pushes back.
    stored : ndarray
        Recoverable energy in J.
    dissipated : ndarray
        Energy dissipated since the path began, in J.
    """

    elongation: Array
    force: Array
    stored: Array
    dissipated: Array


class QuasiStatic:
    """The outcome of `quasi_static`. A run can start from it, at rest in the last equilibrium.

    Attributes
    ----------
    load_factors : ndarray, shape (n_factors,)
        The factors of the loads.
    contacts : dict of str to ContactPath
        The contacts by name.
    springs : dict of str to SpringPath
        The hysteretic springs by name.
    iterations : int
        Number of Newton steps in total.
    notes : list of str
        Sentences that say where the work of the loads is not balanced.
    """

    def __init__(
        self,
        model: Model,
        load_factors: Array,
        q: Array,
        contacts: dict[str, ContactPath],
        springs: dict[str, SpringPath],
        iterations: int,
        past: Array,
        notes: list[str] | None = None,
    ) -> None:
        self._model = model
        self._q = q
        self._past = past
        self.load_factors = load_factors
        self.contacts = Named(contacts)
        self.springs = Named(springs, "hysteretic spring")
        self.iterations = iterations
        self.notes = [] if notes is None else notes

    def __repr__(self) -> str:
        notes = f", {len(self.notes)} notes: see .notes" if self.notes else ""
        return f"QuasiStatic({self.load_factors.size} load factors, {self.iterations} iterations{notes})"

    def state_of(self, body_name: str) -> tuple[Array, Array]:
        """Return the degrees of freedom of a body at the last factor and their rates, which are zero, each (size,)."""
        values = self._model.of_body(body_named(self._model.offsets, body_name), self._q[:, -1])
        return values, np.zeros_like(values)

    def spring_state(self, name: str) -> Array | None:
        """Return the internal variables of a hysteretic spring at the last factor, or None if there are none."""
        groups = [group for group in self._model.system.laws if group.static and self._past.size]
        return past_of(groups, self._past, name)

    def as_start(self) -> StoredState:
        """Return the state, with which a run can start, without keeping this outcome in memory."""
        springs = {name: self.spring_state(name) for name in self.springs}
        known = {name: state for name, state in springs.items() if state is not None}
        return StoredState({b.name: self.state_of(b.name) for b in self._model.offsets}, known, source="QuasiStatic")

    def displacement(self, point: Any) -> Array:
        """Return the displacement of a point in m, shape (n_factors,)."""
        body, row = row_of(self._model.offsets, point)
        return np.asarray(row.weights @ self._model.of_body(body, self._q)[row.indices])

    def deflection(self, x: ArrayLike, body: Any = None) -> Array:
        """Return eta in m, shape (len(x), n_factors)."""
        beam = the_beam(self._model.offsets, body)
        return np.asarray(beam.field_matrix(np.ravel(np.asarray(x)), 0) @ self._model.of_body(beam, self._q))
