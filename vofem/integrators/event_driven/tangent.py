"""Perturbations along an event-driven run, exactly: free motion between events, saltation matrices at events.

A perturbed run meets an event at another time. To first order the state after
it is that of the matrix ``S = D + (f_after - D f_before) g'/(g' f_before)``
with g the gradient of the event function, f the rates of the state on both
sides, and D the derivative of what the event itself does to the state: the
identity, or the projection by which a contact is pinned.

R. I. Leine, H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical
Systems, Springer 2004, doi:10.1007/978-3-540-44398-8.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.bounces import struck
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.integrators.event_driven.pieces import turned
from vofem.integrators.event_driven.spectrum import Spectrum
from vofem.linalg.exponential import matrix_change
from vofem.system import CLOSED, OPEN, PINNED, ContactLaws

Status = NDArray[np.int64]


#: A perturbation that has shrunk to this share of its first size is left out. The share is the square of a tenth of
#: rounding.
_NOTHING = 1e-33


class Event(NamedTuple):
    """The data of an event that determine how perturbations change in it."""

    #: `before`, `after`: contact status, shape (n_contacts,).
    before: Status
    after: Status
    #: `displacement`, `velocity`: modal state before it, shape (n,).
    displacement: Array
    velocity: Array
    load: Array  #: Modal load, shape (n,).


class Tangent:
    """Some perturbations of a modal state, as columns.

    Perturbations that have decayed to nothing, such as those of fast damped modes, are no longer computed.

    `displacement`, `velocity` (shape (n, k)): perturbations at the beginning.
    `z`, `v` (shape (n, number of columns)): the perturbations that are left.
    `columns`: numbers of these perturbations.
    """

    def __init__(self, space: ModalSpace, laws: ContactLaws | None, displacement: Array, velocity: Array) -> None:
        self._space, self._laws = space, laws
        self.z, self.v = displacement, velocity
        self.columns = np.arange(displacement.shape[1])
        self._first_sizes = self._sizes()

    @property
    def matrix(self) -> Array:
        """All perturbations, displacements above velocities, shape (2n, k)."""
        n = self.z.shape[0]
        whole = np.zeros((2 * n, self._first_sizes.size))
        whole[:n, self.columns], whole[n:, self.columns] = self.z, self.v
        return whole

    def _sizes(self) -> Array:
        """Return the largest entry of every remaining column."""
        return np.asarray(np.maximum(np.abs(self.z).max(axis=0, initial=0.0), np.abs(self.v).max(axis=0, initial=0.0)))

    def _drop_what_has_decayed(self) -> None:
        # A column that is not finite stays.
        left = ~(self._sizes() <= _NOTHING * self._first_sizes[self.columns])
        if not left.all():
            self.z, self.v = np.ascontiguousarray(self.z[:, left]), np.ascontiguousarray(self.v[:, left])
            self.columns = self.columns[left]

    def drift(self, spectrum: Spectrum, duration: float) -> None:
        """Follow the free motion of a status for a duration in s."""
        self.z, self.v = drifted(spectrum, self.z, self.v, duration)
        self._drop_what_has_decayed()

    def jump(self, event: Event) -> None:
        """Apply the jump of an event."""
        assert self._laws is not None
        self.z, self.v = jumped(self._space, self._laws, event, self.z, self.v)

    def bounce(self, row: Array, restitution: float, rate: float, push: tuple[Array, Array]) -> None:
        """Pass an impact on a rigid stop; see `bounced`."""
        v = bounced(self.z, self.v, row, restitution, rate, push)
        self.z, self.v = struck(row, restitution, self.z), v


def drifted(spectrum: Spectrum, z: Array, v: Array, duration: float) -> tuple[Array, Array]:
    """Return perturbations, each (n, k), after a duration in s of the free motion of a status."""
    z, v = spectrum.to_blocks(z, v, shifted=False)
    after_z, after_v = turned(spectrum.delta, spectrum.p, duration, z, v)
    for cluster in () if spectrum.blocks is None else spectrum.blocks.clusters:
        k = cluster.member
        both = np.concatenate([z[k], v[k]])
        both = both + matrix_change(np.ascontiguousarray(cluster.generator), duration) @ both
        after_z[k], after_v[k] = both[: k.size], both[k.size :]
    return spectrum.to_modes(after_z, after_v, shifted=False)


def jumped(space: ModalSpace, laws: ContactLaws, event: Event, z: Array, v: Array) -> tuple[Array, Array]:
    """Return perturbations, each (n, k), after an event. Contacts that switch together are treated one by one."""
    now = event.before.copy()
    for j in np.flatnonzero(event.before != event.after).tolist():
        old, new = now[j], event.after[j]
        following = now.copy()
        following[j] = new
        if new == PINNED:
            z, v = _pinned(space, laws, event, (now, following), j, z, v)
        elif old != PINNED:
            v = _switched(space, laws, event, now, j, -1.0 if (old, new) == (OPEN, CLOSED) else 1.0, z, v)
        # A pinned contact is released as its reaction reaches the force of the status that follows: nothing jumps.
        now = following
    return z, v


def _switched(
    space: ModalSpace, laws: ContactLaws, event: Event, now: Status, contact: int, sign: float, z: Array, v: Array
) -> Array:
    """Return velocities after a closing (sign -1) or an opening (sign 1): the force jumps, with it the acceleration."""
    row = space.contacts[contact]
    force, rate = laws.damping[contact], float(row @ event.velocity)
    if laws.jump[contact] and laws.gap[contact] > 0.0:
        force = force + laws.stiffness[contact] * laws.gap[contact] / rate if rate != 0.0 else np.inf
    if force == 0.0:
        return v
    direction = row - _onto(space.contacts[now == PINNED], row)
    return v + sign * force * np.outer(direction, row @ z)


def _pinned(
    space: ModalSpace, laws: ContactLaws, event: Event, statuses: tuple[Status, Status], contact: int, z: Array,
    v: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Return perturbations after the event by which a contact comes to rest at its gap."""
    (now, following), row = statuses, space.contacts[contact]
    rows = space.contacts[following == PINNED]
    velocity, along, rate = event.velocity - _onto(rows, event.velocity), row @ z, float(row @ event.velocity)
    z, v = z - _onto(rows, z), v - _onto(rows, v)
    if rate != 0.0:
        before, after = (
            acceleration(space, laws, status, event.displacement, speed, event.load)
            for status, speed in ((now, event.velocity), (following, velocity))
        )
        # The displacement is continuous, and so are its rates along the surface.
        v = v + np.outer(before - _onto(rows, before) - after, -along / rate)
    return z, v


def bounced(z: Array, v: Array, row: Array, restitution: float, rate: float, push: tuple[Array, Array]) -> Array:
    """Return the velocities of perturbations after an impact on a rigid stop, shape (n,) or (n, k).

    `z`, `v` (shape (n,) or (n, k)): perturbations before.
    `row` has shape (n,).
    `rate`: speed of approach, m/s.
    `push`: modal accelerations before and after, each (n,).
    """
    before, after = push
    change = struck(row, restitution, before) - after
    return np.asarray(struck(row, restitution, v) - np.multiply.outer(change, row @ z / rate))


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
