"""All laws of a system as flat records for compiled loops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.laws.callbacks import Callbacks
from vofem.laws.group import LawGroup
from vofem.laws.kinds import AFFINE, CALLED, CALLED_WITH_PAST, HYPERBOLIC, RESOLVED

Array = NDArray[np.float64]

#: The record of a law holds its kind; where its parameters lie in those of all, `first` to `last`, and its internal
#: variables, `start`
#: to `end`; which histories it records, -1 for none; the address of a law written in Python; and its numbers. Gap,
#: offset, stiffness, damping and resolution are those of `ContactLaws`; an affine law is
#: ``offset + stiffness (u - gap)``. A record costs a compiled loop one pointer where arrays would each be counted.
RECORD = np.dtype(
    [(name, np.int64) for name in ("kind", "first", "last", "start", "end", "history", "address", "one_sided")]
    + [(name, np.float64) for name in ("gap", "offset", "stiffness", "damping", "resolution", "limit")]
)


class Kinds(NamedTuple):
    """The kinds of laws in a system beside contacts with ideal switches. Each is True, or None if there are none.

    Compiled code contains only these kinds: if an argument is None, numba leaves out the branch ``x is not None`` with
    all functions that are called in it.

    Attributes
    ----------
    resolved : True or None
        Contacts with resolved switches.
    dampers : True or None
        Contacts with dampers.
    affine : True or None
        Laws that are affine within a step, such as springpots.
    called : True or None
        Laws that are called through their addresses.
    hysteretic : True or None
        Laws with internal variables.
    """

    resolved: bool | None = None
    dampers: bool | None = None
    affine: bool | None = None
    called: bool | None = None
    hysteretic: bool | None = None


class Way(NamedTuple):
    """How laws act over a step.

    Attributes
    ----------
    mean : bool
        Whether by their mean force over the step, and not by the force at its end.
    explicit : bool
        Whether the coordinate at the end is known, and the rate there is solved for.
    now, before : float
        Weights of a contact damper's mean force over this step, and of that over the step before which is subtracted:
        they extrapolate it to the time of balance.
    dt : float
        In s.
    """

    mean: bool
    explicit: bool
    now: float
    before: float
    dt: float


class Laws(NamedTuple):
    """All laws, one record each, in the order of the groups of a system.

    Attributes
    ----------
    table : ndarray of RECORD, shape (n_laws,)
    parameters : ndarray
        Further numbers of all laws.
    state : ndarray
        Internal variables of all laws at the start of a step.
    kinds : Kinds
    """

    table: NDArray[np.void]
    parameters: Array
    state: Array
    kinds: Kinds


def build_laws(groups: Sequence[LawGroup], callbacks: Callbacks | None = None) -> Laws:
    """Return the laws of some groups as records, with the internal variables that they have before any load."""
    table = np.zeros(sum(len(group) for group in groups), dtype=RECORD)
    table["resolution"], table["history"] = np.inf, -1
    parameters, states = [np.zeros(0)], [np.zeros(0)]
    first, histories = 0, 0
    for group in groups:
        part = table[first : first + len(group)]
        group.fill(part)
        if group.recorded:
            part["history"] = np.arange(histories, histories + len(group))
            histories += len(group)
        parameters += group.parameters()
        states += group.virgin()
        first += len(group)
    for low, high, parts in (("first", "last", parameters), ("start", "end", states)):
        ends = np.cumsum([part.size for part in parts])
        table[low], table[high] = ends[:-1], ends[1:]
    if callbacks is not None:
        table["address"][table["kind"] == CALLED] = callbacks.addresses
    return Laws(table, np.concatenate(parameters), np.concatenate(states), kinds_of(table))


def kinds_of(table: NDArray[np.void]) -> Kinds:
    """Return which laws there are among some records."""
    kind = table["kind"]
    called = (kind == CALLED) | (kind == CALLED_WITH_PAST)
    found = (kind == RESOLVED, table["damping"] > 0.0, kind == AFFINE, called, kind >= HYPERBOLIC)
    return Kinds(*(True if np.any(part) else None for part in found))
