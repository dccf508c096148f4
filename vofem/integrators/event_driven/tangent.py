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


#: What determines the time of an event: the contact's own reaction, or the time of a load's jump, which is fixed.
REACTION, FIXED = -1, -2


class Passage(NamedTuple):
    """What events at one time do to small changes of a modal state at a fixed time, each (n, p).

        z' = z - share (held z + off),    v' = v - share held v + kick (rows z + meets)

    `off` and `meets` are what gap functions change by at a fixed state: zero unless the system itself changes.
    """

    numbers: range  #: The events in the log.
    #: `before`, `after`: contact status before and after, shape (n_contacts,).
    before: Status
    after: Status
    contacts: list[int]  #: The contacts whose gap functions reach zero.
    rows: Array  #: Their modal rows, shape (k, n).
    rates: Array  #: Rates of their gap functions before, m/s, shape (k,).
    kick: Array  #: By which velocities change for each m of a gap function, 1/s, shape (n, k).
    restrained: list[int]  #: The contacts that are pinned from here on, or the rigid stop that is hit.
    held: Array  #: Their modal rows, shape (h, n).
    share: Array  #: What removes their displacements and velocities, or turns these around, shape (n, h).
    factor: float  #: 1 where it removes them, and more where something bounces.
    #: The row that determines when each contact changes, where it does, or `REACTION` or `FIXED`, shape (n_contacts,).
    by: Status

    def passed(self, z: Array, v: Array, *, off: Any = 0.0, meets: Any = 0.0) -> tuple[Array, Array]:
        """Return the changes after the events."""
        kicked = v - self.share @ (self.held @ v) + self.kick @ (self.rows @ z + meets)
        return z - self.share @ (self.held @ z + off), kicked

    def back(self, z: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """Return the transposed map of weights (n,) of the changes after it: those of z, v, off and meets."""
        off, meets = -self.share.T @ z, self.kick.T @ v
        return z + self.held.T @ off + self.rows.T @ meets, v - self.held.T @ (self.share.T @ v), off, meets


def drifted(spectrum: Spectrum, z: Array, v: Array, duration: float) -> tuple[Array, Array]:
    """Return changes, each (n, k), after a duration in s of the free motion of a status."""
    z, v = spectrum.to_blocks(z, v, shifted=False)
    delta, p = spectrum.delta, spectrum.p
    after_z, after_v = np.split(turned(delta, p, *turns(delta, p, duration), np.concatenate([z, v])), 2)
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
    space: ModalSpace, laws: ContactLaws, numbers: range, statuses: tuple[Status, Status, Status], displacement: Array,
    velocity: Array, load: Array, *, struck: int | None = None, fixed: bool = False,
) -> Passage:  # fmt: skip
    """Return what events at one time do to changes.

    `numbers`: those of the events in the log.
    `statuses`: before the events, after them, and after all that their jumps of force let go of at once, each of shape
    (n_contacts,).
    `displacement`, `velocity`, `load`: modal state before the events, and modal load there, each (n,).
    `struck`: the rigid stop off which something bounces.
    `fixed`: whether a load's jump lets go of all that is released.
    """
    contacts, (before, after, last) = space.contacts, statuses
    met, held, factor = np.flatnonzero((before != after) & (before != PINNED)), np.zeros(0, dtype=np.int64), 1.0
    if struck is not None:
        met = held = np.array([struck])
        factor += float(laws.restitution[struck])
    elif np.any(after[met] == PINNED):
        held = np.flatnonzero(after == PINNED)
    rows, rates, pinned = contacts[met], contacts[met] @ velocity, contacts[held]
    share = factor * shares(pinned)
    # A pinned contact is released as its reaction reaches the force of the status that follows: nothing jumps. Bounces
    # and contacts that are pinned change velocities and forces at once.
    whole = (after[met] == PINNED) | (struck is not None)
    direction = rows - _onto(contacts[before == PINNED], rows.T).T
    factors = np.where(whole, 0.0, switch_factors(laws, met, after[met] == CLOSED, rates))
    kick = np.where(factors == 0.0, 0.0, direction.T * factors)
    kick = kick - share @ (pinned @ kick)
    by, stopped = np.full(len(laws), FIXED if fixed else REACTION), velocity - share @ (pinned @ velocity)
    if whole.any():
        # The displacement is continuous, and what is restrained has no acceleration, or turns it around.
        first = acceleration(space, laws, before, displacement, velocity, load)
        later = acceleration(space, laws, last, displacement, stopped, load)
        moving = whole & (rates != 0.0)
        kick[:, moving] = (later - first + share @ (pinned @ first))[:, None] / rates[moving]
        if np.any(laws.rigid[held]):
            # An impact lets go of what it moves away from elsewhere.
            by[:] = int(np.argmax(whole))
    if met.size and np.any(after != last):
        by[after != last] = met.size - 1
        if not whole.any():
            first, later = (acceleration(space, laws, one, displacement, stopped, load) for one in (after, last))
            with np.errstate(divide="ignore", invalid="ignore"):
                kick[:, -1] += (later - first) / rates[-1]
    by[met] = np.arange(met.size)
    return Passage(numbers, before, last, met.tolist(), rows, rates, kick, held.tolist(), pinned, share, factor, by)


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
    try:
        return np.asarray(rows.T @ np.linalg.solve(rows @ rows.T, rows @ vectors))
    except np.linalg.LinAlgError:
        # Rows of stops and of stuck sliders may depend on each other.
        return np.asarray(rows.T @ np.linalg.lstsq(rows.T, vectors, rcond=None)[0])
