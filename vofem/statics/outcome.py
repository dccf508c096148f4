"""The outcome of a static solution: displacements, fields of beams, contacts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import Named
from vofem.arrays import Array
from vofem.assembly import Effect, Model
from vofem.bodies.beam import Beam
from vofem.effects.line_loads import balanced_sections
from vofem.effects.two_points import units_of
from vofem.initial import StoredState
from vofem.lookup import body_named, row_of, the_beam


@dataclass(frozen=True)
class StaticContact:
    """A contact in equilibrium.

    Attributes
    ----------
    force : float
        Contact force in N; positive pushes the bodies apart.
    status : str
        "open", "closed", or "pinned" for a contact that rests exactly at its gap.
    gap_function : float
        The gap function s in m; positive is penetration.
    """

    force: float
    status: str
    gap_function: float

    @property
    def closed(self) -> bool:
        """Whether the contact is closed."""
        return self.status == "closed"

    @property
    def pinned(self) -> bool:
        """Whether the contact is pinned."""
        return self.status == "pinned"


class Equilibrium:
    """The outcome of `equilibrium`.

    Attributes
    ----------
    contacts : dict of str to StaticContact
        The contacts by name.
    iterations : int
        Number of Newton steps.
    notes : list of str
        Sentences about the outcome that a user should read.
    """

    def __init__(
        self,
        model: Model,
        q: Array,
        contacts: Mapping[str, StaticContact],
        iterations: int,
        effects: tuple[Effect, ...] = (),
        t: float = 0.0,
    ) -> None:
        self._model = model
        self._effects, self._t = effects, t
        self._q = q
        self.contacts = Named(dict(contacts))
        self.iterations = iterations
        self.notes = [
            f"contact {name!r} is pinned at its gap with a reaction of {contact.force:.6g} "
            f"{units_of(effects, name).force}: the load lies between "
            "the open and the closed equilibrium of acts_on='displacement'"
            for name, contact in self.contacts.items()
            if contact.pinned
        ]

    def __repr__(self) -> str:
        states = [contact.status for contact in self.contacts.values()]
        pinned = f", {states.count('pinned')} pinned" if "pinned" in states else ""
        held = f"{states.count('closed')} of {len(states)} contacts closed{pinned}" if states else "no contacts"
        return f"Equilibrium({held})"

    @property
    def model(self) -> Model:
        """The assembled scene."""
        return self._model

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects of the scene."""
        return self._effects

    @property
    def t(self) -> float:
        """Time in s at which the loads act."""
        return self._t

    @property
    def free_displacement(self) -> Array:
        """Free degrees of freedom, shape (n,)."""
        return self._q

    def state_of(self, body_name: str) -> tuple[Array, Array]:
        """Return the degrees of freedom of a body and their rates, which are zero, each (size,)."""
        cure = "; as the start of a scene give the outcome for the bodies that it holds: initial={body: outcome}"
        values = self._model.of_body(body_named(self._model.offsets, body_name, cure), self._q)
        return values, np.zeros_like(values)

    def as_start(self) -> StoredState:
        """Return the state, with which a run can start, without keeping this outcome in memory."""
        return StoredState({b.name: self.state_of(b.name) for b in self._model.offsets}, {}, source="Equilibrium")

    def displacement(self, point: Any) -> float:
        """Return the displacement of a point in m."""
        body, row = row_of(self._model.offsets, point)
        return float(row.weights @ self._model.of_body(body, self._q)[row.indices])

    def _field(self, x: ArrayLike, body: Any, derivative: int) -> tuple[Beam, Array]:
        beam = the_beam(self._model.offsets, body)
        # Of the shape of x, so that a field serves as the initial state of another scene.
        values = beam.field_matrix(np.ravel(np.asarray(x)), derivative) @ self._model.of_body(beam, self._q)
        return beam, np.reshape(values, np.shape(x) or (1,))

    def deflection(self, x: ArrayLike, body: Any = None) -> Array:
        """Return eta in m, in the shape of x."""
        return self._field(x, body, 0)[1]

    def slope(self, x: ArrayLike, body: Any = None) -> Array:
        """Return d(eta)/dx, shape (len(x),)."""
        return self._field(x, body, 1)[1]

    def bending_moment(self, x: ArrayLike, body: Any = None) -> Array:
        """Return ``M = EI eta''`` in N m, in the shape of x; at a node, that of the element to its right.

        Within an element the moment balances distributed loads, weight,
        foundations and tension. It is as exact as the displacements of the nodes.
        Point loads and springs between nodes are replaced by forces and moments
        at the ends of their element.
        """
        return self._sections(x, body)[0]

    def shear_force(self, x: ArrayLike, body: Any = None) -> Array:
        """Return ``V = (EI eta'')'`` in N, in the shape of x; as `bending_moment`."""
        return self._sections(x, body)[1]

    def _sections(self, x: ArrayLike, body: Any) -> tuple[Array, Array]:
        beam, shape = the_beam(self._model.offsets, body), np.shape(x) or (1,)
        q = self._model.of_body(beam, self._q)[:, None]
        moment, shear = balanced_sections(self._effects, beam, np.ravel(np.asarray(x)), np.array([self._t]), q)
        return moment.reshape(shape), shear.reshape(shape)
