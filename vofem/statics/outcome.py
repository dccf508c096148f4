"""Outcomes of statics: an equilibrium, and a path of equilibria over load factors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import Named, array
from vofem.arrays import Array
from vofem.assembly import Effect, Model
from vofem.effects.line_loads import balanced_sections
from vofem.effects.two_points import units_of
from vofem.initial import StoredState
from vofem.laws import past_of
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


class AtRest:
    """What an equilibrium and a path of equilibria share: displacements at rest, from which a run can start.

    `q`: free degrees of freedom, shape (n,) or, along a path, (n, n_factors).
    """

    def __init__(self, model: Model, q: Array, contacts: Mapping[str, Any], iterations: int) -> None:
        self.model: Model = model  #: The assembled scene.
        self._q = q
        self.contacts = Named(dict(contacts))
        self.iterations = iterations

    def state_of(self, body_name: str) -> tuple[Array, Array]:
        """Return the degrees of freedom of a body, at the end of a path, and their rates, zero, each (size,)."""
        cure = "; as the start of a scene give the outcome for the bodies that it holds: initial={body: outcome}"
        body = body_named(self.model.offsets, body_name, cure)
        values = self.model.of_body(body, self._q if self._q.ndim == 1 else self._q[:, -1])
        return values, np.zeros_like(values)

    def _pasts(self) -> dict[str, Array]:
        """Return the internal variables of springs by name."""
        return {}

    def as_start(self) -> StoredState:
        """Return the state, with which a run can start, without keeping this outcome in memory."""
        states = {body.name: self.state_of(body.name) for body in self.model.offsets}
        return StoredState(states, self._pasts(), source=type(self).__name__)

    def _displacement(self, point: Any) -> Any:
        body, row = row_of(self.model.offsets, point)
        return row.weights @ self.model.of_body(body, self._q)[row.indices]

    def _field(self, x: ArrayLike, body: Any, derivative: int) -> Array:
        """Return a derivative of eta, of the shape of x and, along a path, (n_factors,)."""
        beam = the_beam(self.model.offsets, body)
        # Of the shape of x, so that a field serves as the initial state of another scene.
        places = array(f"a point of {beam.label}", x)
        values = beam.field_matrix(places.ravel(), derivative) @ self.model.of_body(beam, self._q)
        return np.reshape(values, (places.shape or (1,)) + self._q.shape[1:])


class Equilibrium(AtRest):
    """The outcome of `equilibrium`.

    Attributes
    ----------
    contacts : dict of str to StaticContact
        The contacts by name.
    iterations : int
        Number of Newton steps.
    notes : list of str
        Sentences about the outcome that a user should read.
    effects : tuple of effects
        The effects of the scene.
    t : float
        Time in s at which the loads act.
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
        super().__init__(model, q, contacts, iterations)
        self.effects, self.t = effects, t
        self.notes = [
            f"contact {name!r} is pinned at its gap with a reaction of {contact.force:.6g} "
            f"{units_of(effects, f'Contact {name!r}').force}: the load lies between "
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
    def free_displacement(self) -> Array:
        """Free degrees of freedom, shape (n,)."""
        return self._q

    def displacement(self, point: Any) -> float:
        """Return the displacement of a point in m."""
        return float(self._displacement(point))

    def deflection(self, x: ArrayLike, body: Any = None) -> Array:
        """Return eta in m, in the shape of x."""
        return self._field(x, body, 0)

    def slope(self, x: ArrayLike, body: Any = None) -> Array:
        """Return d(eta)/dx, in the shape of x."""
        return self._field(x, body, 1)

    def bending_moment(self, x: ArrayLike, body: Any = None) -> Array:
        """Return ``M = EI eta''`` in N m, in the shape of x; at a node, that of the element to its right.

        Within an element the moment balances distributed loads, weight, foundations and tension. It is as exact as the
        displacements of the nodes. Point loads and springs between nodes are replaced by forces and moments at the ends
        of their element.
        """
        return self._sections(x, body)[0]

    def shear_force(self, x: ArrayLike, body: Any = None) -> Array:
        """Return ``V = (EI eta'')'`` in N, in the shape of x; as `bending_moment`."""
        return self._sections(x, body)[1]

    def _sections(self, x: ArrayLike, body: Any) -> tuple[Array, Array]:
        beam = the_beam(self.model.offsets, body)
        places = array(f"a point of {beam.label}", x)
        shape = places.shape or (1,)
        q = self.model.of_body(beam, self._q)[:, None]
        moment, shear = balanced_sections(self.effects, beam, places.ravel(), np.array([self.t]), q)
        return moment.reshape(shape), shear.reshape(shape)


class QuasiStatic(AtRest):
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
        notes: list[str],
    ) -> None:
        super().__init__(model, q, contacts, iterations)
        self._past = past
        self.load_factors = load_factors
        self.springs = Named(springs, "hysteretic spring")
        self.notes = notes

    def __repr__(self) -> str:
        notes = f", {len(self.notes)} notes: see .notes" if self.notes else ""
        return f"QuasiStatic({self.load_factors.size} load factors, {self.iterations} iterations{notes})"

    def spring_state(self, name: str) -> Array | None:
        """Return the internal variables of a hysteretic spring at the last factor, or None if there are none."""
        groups = [group for group in self.model.system.laws if group.static and self._past.size]
        return past_of(groups, self._past, name)

    def _pasts(self) -> dict[str, Array]:
        found = {name: self.spring_state(name) for name in self.springs}
        return {name: state for name, state in found.items() if state is not None}

    def displacement(self, point: Any) -> Array:
        """Return the displacement of a point in m, shape (n_factors,)."""
        return np.asarray(self._displacement(point))

    def deflection(self, x: ArrayLike, body: Any = None) -> Array:
        """Return eta in m, shape (len(x), n_factors)."""
        return self._field(x, body, 0)
