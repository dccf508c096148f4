"""A contact status whatever its loads: the blocks of the structure, event functions over them, and the forces on them.

A continuation in the frequency or the amplitude of a load meets few statuses under many loads. What is here is computed
once for all of these; see `regime` for the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.pinned import Reactions, reactions
from vofem.integrators.event_driven.spectrum import Spectrum
from vofem.linalg.oscillators import oscillators
from vofem.system import CLOSED, OPEN, PINNED, ContactLaws

if TYPE_CHECKING:
    from vofem.integrators.event_driven.modal_space import ModalSpace

Integers = NDArray[np.int64]


class Exits(NamedTuple):
    """Event functions, which are negative until an event: k functions over some blocks."""

    #: `rows`, `sizes`: the functions as rows over the states of blocks, and bounds on their terms, shape (k, 2,
    #: blocks).
    rows: Array
    sizes: Array
    #: Sign of the gap function that an event function is; 0 for reactions, which are their rows at any time. Shape
    #: (k,).
    sign: Array
    level: Array  #: Size of the constants in the event functions, shape (k,).
    #: `owner`, `leads`: the contact of each event function, and the status to which it leads, shape (k,).
    owner: Integers
    leads: Integers


class Quantities(NamedTuple):
    """Coordinates of the c contacts without their shift, and after them reactions, from which the exits follow."""

    #: `rows`, `sizes`: rows over the structure's blocks, and bounds on their terms, shape (c + number of pinned
    #: contacts, 2, m).
    rows: Array
    sizes: Array
    number: Integers  #: The quantity that each exit is, shape (k,).
    #: `factor`, `upper`: each exit is its quantity times 1 or -1, less a constant, shape (k,).
    factor: Array
    upper: Array
    reactions: Reactions | None  #: Those of the pinned contacts; None where none is pinned.


@dataclass(frozen=True)
class Unloaded:
    """A contact status whatever its loads: m blocks, n modes, f functions of time."""

    spectrum: Spectrum
    space: ModalSpace
    laws: ContactLaws | None
    status: Integers  #: Shape (n_contacts,).
    vectors: Array  #: Modal load vectors, shape (f, n).
    row_sizes: Array  #: Bounds on the terms that the modal rows of the contacts are summed of, shape (n_contacts, n).

    @cached_property
    def of(self) -> Array:
        """The blocks as oscillators, shape (8, m)."""
        return oscillators(self.spectrum.delta, self.spectrum.p)

    @cached_property
    def forces(self) -> tuple[Array, Array | None]:
        """Modal forces of values of functions, and of their rates where there are any, each (n, f + 2).

        The constant 1 comes first. The last column is zero and belongs to no function.
        """
        space, laws, f = self.space, self.laws, len(self.vectors)
        forces = np.zeros((space.size, f + 2))
        forces[:, 1:-1] = self.vectors.T
        if laws is None:
            return forces, None
        closed = self.status == CLOSED
        forces[:, 0] = (laws.stiffness * laws.offset * closed) @ space.contacts
        if self.spectrum.real.shift_force is not None:
            forces[:, 0] += self.spectrum.real.shift_force
        if laws.moving is None:
            return forces, None
        # Offsets of contacts are the last functions.
        weights, rates = laws.moving.weights, np.zeros_like(forces)
        mine = slice(1 + f - weights.shape[1], 1 + f)
        stiffness, damping = np.where(closed, laws.stiffness, 0.0), np.where(closed, laws.damping, 0.0)
        forces[:, mine] -= space.contacts.T @ (stiffness[:, None] * weights)
        rates[:, mine] = -space.contacts.T @ (damping[:, None] * weights)
        return forces, rates

    @cached_property
    def local(self) -> tuple[Array, Array | None]:
        """`forces` on the real modes, each (m, f + 2)."""
        forces, rates = self.forces
        down = self.spectrum.real.down
        return down(forces), None if rates is None else down(rates)

    @cached_property
    def inputs(self) -> tuple[Array, Array | None]:
        """`forces` as inputs to the blocks, each (2m, f + 2)."""
        forces, rates = self.local
        inputs = self.spectrum.real_inputs
        return inputs(forces), None if rates is None else inputs(rates)

    @cached_property
    def quantities(self) -> Quantities:
        """Coordinates of the contacts and reactions, from which the exits follow."""
        return self._exits[0]

    @cached_property
    def exits(self) -> Exits:
        """The event functions over the structure's blocks."""
        return self._exits[1]

    @cached_property
    def lines(self) -> dict[Any, Any]:
        """What the blocks do under lines, by the functions that have some."""
        return {}

    @cached_property
    def regimes(self) -> dict[Any, Any]:
        """The status under loads, by what these depend on."""
        return {}

    @cached_property
    def _exits(self) -> tuple[Quantities, Exits]:
        spectrum, laws, status, contacts = self.spectrum, self.laws, self.status, self.space.contacts
        c, m = len(contacts), spectrum.p.size
        parts = spectrum.rows(contacts, self.row_sizes)
        w, u, w_size, u_size = (part if part.shape[1] else np.zeros((c, m)) for part in parts)
        rows, sizes = np.stack([w, u], axis=1), np.stack([w_size, u_size], axis=1)
        plain = np.zeros(0, dtype=np.int64) if laws is None else np.flatnonzero(status != PINNED)
        held = np.zeros(0, dtype=np.int64) if laws is None else np.flatnonzero(status == PINNED)
        sign = np.where(status[plain] == CLOSED, -1.0, 1.0)
        number, factor, force = plain, sign, None
        owner, leads = plain, np.where(sign < 0.0, OPEN, CLOSED)
        level = np.zeros(0) if laws is None else laws.gap[plain]
        upper = np.zeros(plain.size)
        if laws is not None and held.size:
            if spectrum.real.shift is not None:
                level = level - contacts[plain] @ spectrum.real.shift
            force = reactions(self.space, laws, status, spectrum)
            own = np.stack(spectrum.functions(force.displacement, force.velocity), axis=1)
            own_sizes = np.stack(spectrum.sizes(np.abs(force.displacement), np.abs(force.velocity)), axis=1)
            rows, sizes = np.concatenate([rows, own]), np.concatenate([sizes, own_sizes])
            # The reaction of a rigid stop has no upper limit.
            limited, places, none = np.flatnonzero(~laws.rigid[held]), c + np.arange(held.size), np.zeros(held.size)
            jump = (laws.stiffness * laws.gap)[held[limited]]
            number = np.concatenate([number, places, places[limited]])
            factor = np.concatenate([factor, none - 1.0, np.ones(limited.size)])
            upper = np.concatenate([upper, none, jump])
            level = np.concatenate([level, none, jump])
            owner = np.concatenate([owner, held, held[limited]])
            leads = np.concatenate([leads, np.full(held.size, OPEN), np.full(limited.size, CLOSED)])
            sign = np.concatenate([sign, none, np.zeros(limited.size)])
        exits = Exits(factor[:, None, None] * rows[number], sizes[number], sign, np.abs(level), owner, leads)
        return Quantities(rows, sizes, number, factor, upper, force), exits
