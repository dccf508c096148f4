"""Contacts that stay open far from their gaps for a whole run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.system import OPEN, ContactLaws, Events

#: Part of its gap that a contact must cross, or its gap may be a mistake.
_PART = 0.1


def open_throughout(laws: ContactLaws, events: Events) -> NDArray[np.bool_]:
    """Return which contacts with a gap above zero are open from the start to the end of a run, (n_contacts,)."""
    never = (events.initial == OPEN) & (laws.gap > 0.0)
    never[events.contact] = False
    return never


def never_closed(laws: ContactLaws, events: Events, peak: Array) -> list[str]:
    """Return a note on contacts that never closed, nor came near it.

    `peak` (shape (n_contacts,)): largest value of ``b.q`` in the run, m.
    """
    far = np.flatnonzero(open_throughout(laws, events) & (peak < _PART * laws.gap))
    if not far.size:
        return []
    j = int(far[0])
    moved = f"came within {laws.gap[j] - peak[j]:.4g} m of closing, its gap being {laws.gap[j]:.4g} m"
    others = "" if far.size == 1 else f"; so did {far.size - 1} other contacts"
    return [f"contacts: contact {laws.names[j]!r} never closed: at its nearest it {moved}{others}. Check gap and side"]
