"""Impacts on rigid stops: Newton's law of impact, and what each impact did to a run that is known by its segments.

An impact on the row c with the speed r = c v and the restitution e changes the velocity at once to
``v - (1 + e) r c'/(c c')``, in coordinates in which M is the identity. A run records the state before each bounce as a
segment of no duration. Forces of finite size do nothing in no time: contacts that are pinned by their chatter cannot
resist an impact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.record import Record
from vofem.system import CLOSED, OPEN, PINNED, ContactLaws, Events

Integers = NDArray[np.int64]

#: Share of the largest impulse at a time below which an impulse is rounding.
_NOTHING = 1e-12

#: Part of a row that others do not have, over its size, below which it is rounding.
_DEPENDENT = 1e-9

#: Speed of approach, over the largest one of the stop, below which the body comes to rest at the stop.
REST = 1e-9


class Bounces(NamedTuple):
    """The impacts on rigid stops in a run, those included with which a body comes to rest."""

    event: Integers  #: Number of the event among those of the run, shape (k,).
    segment: Integers  #: Number of the segment that begins with the impact, shape (k,).
    contact: Integers  #: The stop, or one at which something rests and that is pressed on by the impact, shape (k,).
    #: `approach`, `departure`: speeds before and after, m/s, shape (k,).
    approach: Array
    departure: Array
    impulse: Array  #: N s, shape (k,).
    #: `pressed`, `lost`: kinetic energy of the approach, and the part that was lost, J, shape (k,).
    pressed: Array
    lost: Array


def struck(row: Array, restitution: float, velocity: Array) -> Array:
    """Return the modal velocity (n,), or velocities (n, k), after an impact on a modal row (n,)."""
    return np.asarray(velocity - np.multiply.outer(row, (1.0 + restitution) * (row @ velocity) / (row @ row)))


def shares(row: Array, rows: Array) -> Array | None:
    """Return the factors (k,) with which a row (n,) is a sum of others (k, n); None where it is none."""
    found = np.asarray(np.linalg.lstsq(rows.T, row, rcond=None)[0]) if len(rows) else np.zeros(0)
    return found if np.linalg.norm(row - found @ rows) <= _DEPENDENT * np.linalg.norm(row) else None


def bounces_of(laws: ContactLaws, rows: Array, record: Record, events: Events) -> Bounces:
    """Return the impacts on the rigid stops of a run, given the modal rows of the contacts, (n_contacts, n)."""
    mine = np.flatnonzero(laws.rigid[events.contact] & (events.status != OPEN))
    # The segment that an impact begins; the one before a bounce holds the state before it.
    segment = np.searchsorted(record.logged, mine, side="right")
    found: list[tuple[float, ...]] = []
    # Stops that are counted with another event, by the segments that impacts begin.
    entered: dict[int, set[int]] = {index: set() for index in segment.tolist()}
    for j, index in zip(events.contact[mine].tolist(), segment.tolist(), strict=True):
        entered[index].add(j)
    for number, j, index in zip(mine.tolist(), events.contact[mine].tolist(), segment.tolist(), strict=True):
        if events.status[number] == CLOSED:
            e, inverse, speed = laws.restitution[j], rows[j] @ rows[j], rows[j] @ record.state(index - 1)[1]
            pressed = 0.5 * speed**2 / inverse
            lost = (1.0 - e**2) * pressed
            found.append((number, index, j, speed, e * speed, (1.0 + e) * speed / inverse, pressed, lost))
        elif index < record.segments and record.status(index)[j] == PINNED:
            # It was not let go at the same time.
            # Sliders, which are further rows, resist no impact.
            held = np.flatnonzero(record.status(index)[: events.initial.size] == PINNED)
            speeds = rows[held] @ record.state(index)[1]
            impulses = np.linalg.solve(rows[held] @ rows[held].T, speeds)
            least = _NOTHING * np.abs(impulses).max()
            for k, speed, impulse in zip(held.tolist(), speeds.tolist(), impulses.tolist(), strict=True):
                lost = 0.5 * speed * impulse
                if k == j:
                    found.append((number, index, j, speed, 0.0, impulse, lost, lost))
                elif laws.restitution[j] == 0.0 and laws.rigid[k] and k not in entered[index] and abs(impulse) > least:
                    # What rests there already is held by its stop.
                    found.append((number, index, k, 0.0, 0.0, impulse, 0.0, 0.0))
            entered[index].update(held.tolist())
    columns = np.array(found).reshape(-1, 8).T
    return Bounces(*columns[:3].astype(np.int64), *columns[3:])
