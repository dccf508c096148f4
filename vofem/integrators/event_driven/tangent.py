"""Small changes of a motion, exactly: free motion between events, and one linear map at every event.

A changed motion meets an event at another time. With the gradient c of the function that reaches zero, its rate r, and
the rates of the state just before and after, the state at a fixed time changes there to

    S (z, v) = P (z, v) + (f_after - P f_before) c z / r,

where P is what the event itself does to the state: nothing where a contact closes or opens, the projection by which a
contact is pinned, and Newton's law of impact at a rigid stop. Runs take the growth of changes from this, flows their
derivatives, and derivatives by parameters both directions through a run, forward and backward.

R. I. Leine, H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, Springer 2004,
doi:10.1007/978-3-540-44398-8.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.integrators.event_driven.pieces import turned, turns
from vofem.integrators.event_driven.spectrum import Spectrum
from vofem.linalg.exponential import matrix_change
from vofem.system import CLOSED, PINNED, ContactLaws

Status = NDArray[np.int64]


class Passage(NamedTuple):
    """What events at one time do to small changes of a modal state at a fixed time, each (n, p).

        z' = z - share (held z + off),    v' = v - share (held v + slow) + kick (rows z + meets)

    `off`, `slow` and `meets` are what gap functions and their rates change by at a fixed state: zero unless the system
    itself changes.
    """

    contacts: list[int]  #: The contacts whose gap functions reach zero.
    rows: Array  #: Their modal rows, shape (k, n).
    rates: Array  #: Rates of their gap functions before, m/s, shape (k,).
    kick: Array  #: By which velocities change for each m of a gap function, 1/s, shape (n, k).
    restrained: list[int]  #: The contacts that are pinned from here on, or the rigid stop that is hit.
    held: Array  #: Their modal rows, shape (h, n).
    share: Array  #: What removes their displacements and velocities, or turns these around, shape (n, h).

    def passed(self, z: Array, v: Array, *, off: Any = 0.0, slow: Any = 0.0, meets: Any = 0.0) -> tuple[Array, Array]:
        """Return the changes after the events."""
        kicked = v - self.share @ (self.held @ v + slow) + self.kick @ (self.rows @ z + meets)
        return z - self.share @ (self.held @ z + off), kicked

    def back(self, z: Array, v: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Return the transposed map of weights (n,) of the changes after it: those of z, v, off, slow and meets."""
        off, slow, meets = -self.share.T @ z, -self.share.T @ v, self.kick.T @ v
        return z + self.held.T @ off + self.rows.T @ meets, v + self.held.T @ slow, off, slow, meets


def drifted(spectrum: Spectrum, z: Array, v: Array, duration: float) -> tuple[Array, Array]:
    """Return changes, each (n, k), after a duration in s of the free motion of a status."""
    z, v = spectrum.to_blocks(z, v, shifted=False)
    delta, p = spectrum.delta, spectrum.p
    after_z, after_v = turned(delta, p, *turns(delta, p, duration), z, v)
    for cluster in () if spectrum.blocks is None else spectrum.blocks.clusters:
        k = cluster.member
        both = np.concatenate([z[k], v[k]])
        both = both + matrix_change(np.ascontiguousarray(cluster.generator), duration) @ both
        after_z[k], after_v[k] = both[: k.size], both[k.size :]
    return spectrum.to_modes(after_z, after_v, shifted=False)


def switch_factors(laws: ContactLaws, contacts: Any, closing: Any, rates: Array | float) -> Array:
    """Return the jumps of the forces of contacts that close or open, over the rates of their gap functions, N s/m."""
    jump = np.where(laws.jump, laws.stiffness * laws.gap, 0.0)[contacts]
    with np.errstate(divide="ignore", invalid="ignore"):
        force = laws.damping[contacts] + np.where(jump > 0.0, jump / rates, 0.0)
    return np.where(closing, -force, force)


def shares(rows: Array) -> Array:
    """Return what removes the parts along some rows (h, n): ``v - shares (rows v)`` has none. Shape (n, h)."""
    return np.asarray(np.linalg.solve(rows @ rows.T, rows).T, dtype=float)


def passage(
    space: ModalSpace, laws: ContactLaws, before: Status, after: Status, displacement: Array, velocity: Array,
    load: Array,
) -> Passage | None:  # fmt: skip
    """Return what switches and pinning do to changes; None where no force jumps and nothing is pinned.

    `before`, `after`: contact status, shape (n_contacts,).
    `displacement`, `velocity`, `load`: modal state before the events, and modal load there, each (n,).
    """
    contacts, now = space.contacts, np.flatnonzero(after == PINNED)
    # A pinned contact is released as its reaction reaches the force of the status that follows: nothing jumps.
    met = np.flatnonzero((before != after) & (before != PINNED))
    pins = after[met] == PINNED
    rows, rates = contacts[met], contacts[met] @ velocity
    factors = np.where(pins, 0.0, switch_factors(laws, met, after[met] == CLOSED, rates))
    direction = rows - _onto(contacts[before == PINNED], rows.T).T
    kick = np.where(factors == 0.0, 0.0, direction.T * factors)
    if not pins.any():
        none = np.zeros((0, space.size))
        return Passage(met.tolist(), rows, rates, kick, [], none, none.T) if met.size else None
    held = contacts[now]
    share = shares(held)
    kick = kick - share @ (held @ kick)
    stopped = velocity - share @ (held @ velocity)
    first, later = (
        acceleration(space, laws, status, displacement, speed, load)
        for status, speed in ((before, velocity), (after, stopped))
    )
    # The displacement is continuous, and so are its rates along the surface.
    change = first - share @ (held @ first) - later
    for k in np.flatnonzero(pins & (rates != 0.0)).tolist():
        kick[:, k] = -change / rates[k]
    return Passage(met.tolist(), rows, rates, kick, now.tolist(), held, share)


def bounce(
    space: ModalSpace, laws: ContactLaws, contact: int, statuses: tuple[Status, Status], displacement: Array,
    velocity: Array, load: Array,
) -> Passage:  # fmt: skip
    """Return what an impact on a rigid stop does to changes, given the statuses before and after; see `passage`."""
    row = space.contacts[[contact]]
    share = (1.0 + laws.restitution[contact]) * row.T / (row[0] @ row[0])
    rates = row @ velocity
    first, later = (
        acceleration(space, laws, status, displacement, speed, load)
        for status, speed in zip(statuses, (velocity, velocity - share @ rates), strict=True)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        kick = (later - first + share @ (row @ first))[:, None] / rates
    return Passage([contact], row, rates, kick, [contact], row, share)


def let_go(
    space: ModalSpace, laws: ContactLaws, contact: int, statuses: tuple[Status, Status], displacement: Array,
    velocity: Array, load: Array,
) -> Passage:  # fmt: skip
    """Return what a release does to changes that the switch of another contact causes at once; see `bounce`."""
    row, none = space.contacts[[contact]], np.zeros((0, space.size))
    rates = row @ velocity
    first, later = (acceleration(space, laws, status, displacement, velocity, load) for status in statuses)
    with np.errstate(divide="ignore", invalid="ignore"):
        kick = (later - first)[:, None] / rates
    return Passage([contact], row, rates, kick, [], none, none.T)


def acceleration(
    space: ModalSpace, laws: ContactLaws | None, status: Status, displacement: Array, velocity: Array, load: Array
) -> Array:
    """Return the modal acceleration of a state under a contact status, shape (n,)."""
    force = load - space.stiffness * displacement - space.damping_force(velocity)
    if laws is None:
        return np.asarray(force)
    rows = space.contacts
    push = laws.force(rows @ displacement - laws.gap, rows @ velocity, status)
    force = force - push @ rows
    return np.asarray(force - _onto(rows[status == PINNED], force))


def _onto(rows: Array, vectors: Array) -> Array:
    """Return the parts of vectors, shape (n,) or (n, k), that lie in the space of some rows."""
    if not rows.shape[0]:
        return np.zeros_like(vectors)
    return np.asarray(rows.T @ np.linalg.solve(rows @ rows.T, rows @ vectors))
