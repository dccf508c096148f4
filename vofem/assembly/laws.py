"""Scalar laws gathered into groups with their rows, checked; a contact as it hands itself over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from vofem.assembly.triplets import stacked
from vofem.assembly.unknowns import Unknowns
from vofem.bodies.base import Body, Row
from vofem.bodies.path import TravellingPoint
from vofem.errors import ArgumentError
from vofem.laws import ContactLaws, HystereticLaws, LawGroup, SmoothLaws
from vofem.laws.moving import Rider


@dataclass(frozen=True)
class ContactEntry:
    """A contact or rigid stop as `SystemBuilder.add_contact` takes it: fields of `ContactLaws`, and four more."""

    group: ClassVar[type[LawGroup]] = ContactLaws

    name: str
    row: Row
    gap: float
    stiffness: float = 0.0
    damping: float = 0.0
    jump: bool = False
    resolution: float = np.inf
    restitution: float = np.nan
    #: Bodies whose absolute displacements the contact sees, with their signs.
    bases: tuple[tuple[Body, float], ...] = ()
    #: What the motion of bases adds to the coordinate, functions of time and their factors; found from `bases`.
    moving: tuple[tuple[Any, float], ...] = ()
    track: tuple[TravellingPoint, float] | None = None  #: A point that travels, with its sign in the coordinate.
    rider: Rider | None = None  #: The same over the unknowns; found from `track`.


def law_groups(
    entries: Sequence[tuple[Row, Any]], size: int, unknown: Unknowns
) -> tuple[tuple[Any, ...], tuple[LawGroup, ...]]:
    """Return the rows of every group over all degrees of freedom, and the groups over the free ones.

    `entries`: in the order of declaration.
    `size`: number of all degrees of freedom.
    Raises `ArgumentError` if a law can never move, or names by which histories are found occur twice.
    """
    gathered: dict[type[LawGroup], list[tuple[Row, Any]]] = {}
    for row, law in entries:
        # A plain `Law` names no group.
        group = getattr(law, "group", None) or (HystereticLaws if law.remembers else SmoothLaws)
        gathered.setdefault(group, []).append((row, law))
    rows, groups = [], []
    for kind in sorted(gathered, key=lambda group: (group.place, group.kind, group.__name__)):
        mine = gathered[kind]
        rows.append(stacked([row for row, _ in mine], size))
        groups.append(kind.gather(unknown.rows(rows[-1]), tuple(law for _, law in mine)))
    for what in dict.fromkeys(group.named for group in groups if group.named):
        _check(what, [group for group in groups if group.named == what])
    return tuple(rows), tuple(groups)


def _check(what: str, groups: Sequence[LawGroup]) -> None:
    """Raise where a name, by which histories are found, occurs twice, or a row is empty."""
    names = [name for group in groups for name in group.names]
    twice = next((name for name in names if names.count(name) > 1), None) if len(set(names)) < len(names) else None
    if twice is not None:
        raise ArgumentError(f"{what} named {twice!r} occur more than once; give each its own name")
    for group in groups:
        riders = () if group.moving is None else tuple(group.moving.riders)
        held = np.asarray(abs(group.rows).sum(axis=1)).ravel() == 0.0
        held[list(riders)] = False
        if np.any(held):
            label = group.labels[int(np.argmax(held))]
            raise ArgumentError(f"{label} can never move: its points lie on supports or are tied by a joint")
