"""The pinned state of a contact under the displacement law: it rests at its gap, with a reaction in [0, K0 gap].

If the accelerations of the open and of the closed contact both point towards the gap, neither status can last, and
events accumulate (a Filippov sliding state). A contact is pinned when an event finds ``a_open > 0 > a_closed`` and the
predicted excursion ``v^2 / (2 min(a_open, -a_closed))`` below a fraction of its gap. The remaining normal velocity is
removed along ``M^-1 b``; the accelerations are those of the motion without it. The contact is released when the
reaction leaves its interval.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.integrators.event_driven.spectrum import Spectrum
from vofem.system import CLOSED, PINNED, ContactLaws

Status = NDArray[np.int64]

#: Predicted excursion, as a fraction of the gap, below which a chattering contact is pinned.
PIN_FRACTION = 1e-7


class Reactions(NamedTuple):
    """Reactions of the pinned contacts of a status, ``A x + B x' + S f - R``, with f the modal forces of the loads."""

    #: `displacement`, `velocity`: A and B over the real modes x of the status, shape (k, m).
    displacement: Array
    velocity: Array
    share: Array  #: S, shape (k, n).
    shift: Array  #: R, shape (k,).


def reactions(space: ModalSpace, laws: ContactLaws, status: Status, spectrum: Spectrum) -> Reactions:
    """Return the reactions that keep the pinned contacts of a status at their gaps."""
    real = spectrum.real
    rows = real.pinned
    assert real.shift_reaction is not None
    share = np.asarray(np.linalg.solve(rows @ rows.T, rows), dtype=float)
    damped = space.damping_force(share.T)
    closed = (status == CLOSED) & (laws.damping > 0)
    touching = space.contacts[closed]
    damped = damped + touching.T @ (laws.damping[closed, None] * (touching @ share.T))
    return Reactions(-real.force, -real.down(damped).T, share, real.shift_reaction)


def may_pin(space: ModalSpace, laws: ContactLaws, contact: int, velocity: Array, fraction: float) -> bool:
    """Return whether a contact is slow enough to be pinned under any load. This is a cheap test before `should_pin`.

    The accelerations of both statuses differ by at most ``c.c (K0 gap + C0 v)``, so the weaker of two
    opposite ones is at most half of that.
    """
    if not laws.jump[contact]:
        return False
    row = space.contacts[contact]
    speed = abs(row @ velocity)
    push = laws.stiffness[contact] * laws.gap[contact] + laws.damping[contact] * speed
    return bool(speed**2 < 1.01 * (row @ row) * push * fraction * laws.gap[contact])


def should_pin(
    space: ModalSpace, laws: ContactLaws, status: Status, contact: int, state: tuple[Array, Array], load: Array,
    fraction: float,
) -> bool:  # fmt: skip
    """Return whether a contact at an event is to be pinned.

    `status` (shape (n_contacts,)): status of all contacts; that of the contact itself does not matter.
    `state`: modal state at the event.
    `load` (shape (n,)): modal load at the event.
    `fraction`: fraction of the gap below which the predicted excursion leads to pinning.
    """
    jump = laws.stiffness[contact] * laws.gap[contact]
    if not laws.jump[contact] or jump <= 0.0:
        return False
    displacement, velocity = state
    row = space.contacts[contact]
    others = np.arange(len(laws)) != contact
    held = space.contacts[(status == PINNED) & others]
    gram = held @ held.T

    def beside(change: Array) -> Array:
        """Return the part of a change of the velocity that moves no contact at rest, shape (n,)."""
        return change - held.T @ np.linalg.solve(gram, held @ change) if held.shape[0] else change

    direction = beside(row)
    # The motion at rest decides: damping of the speed that is lost does not hold the contact.
    speed = row @ velocity
    velocity = velocity - direction * (speed / (row @ direction))
    closed = (status == CLOSED) & others
    rows = space.contacts[closed]
    force = laws.elastic(space.contacts @ displacement)[closed] + laws.damping[closed] * (rows @ velocity)
    opened = row @ beside(load - space.stiffness * displacement - space.damping_force(velocity) - force @ rows)
    weaker = min(opened, (row @ direction) * jump - opened)
    return bool(weaker > 0.0 and speed**2 < 2.0 * weaker * fraction * laws.gap[contact])
