"""Scalar laws with their rows, checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vofem.assembly.effect import ContactEntry
from vofem.assembly.triplets import stacked
from vofem.assembly.unknowns import Unknowns
from vofem.bodies.base import Row
from vofem.errors import ArgumentError
from vofem.memory import MemoryLaw, SpringpotLaw
from vofem.system import ContactLaws, MemoryLaws, NonlinearLaw, NonlinearLaws, SpringpotLaws


def contact_laws(entries: Sequence[ContactEntry], size: int, unknown: Unknowns) -> tuple[Any, ContactLaws | None]:
    """Return the rows of contacts over all degrees of freedom and their laws over the free ones, or None twice."""
    if not entries:
        return None, None
    names = [e.name for e in entries]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ArgumentError(f"contacts named {twice!r} occur more than once; give each its own name")
    rows = stacked([e.row for e in entries], size)
    laws = ContactLaws(
        names=tuple(e.name for e in entries),
        rows=unknown.rows(rows),
        gap=np.array([e.gap for e in entries]),
        stiffness=np.array([e.stiffness for e in entries]),
        damping=np.array([e.damping for e in entries]),
        jump=np.array([e.jump for e in entries]),
        resolution=np.array([e.resolution for e in entries]),
    )
    for name, row in zip(laws.names, laws.rows, strict=True):
        if not np.any(row.data):
            raise ArgumentError(f"Contact {name!r} can never move: its points lie on supports or are tied by a joint")
    return rows, laws


def nonlinear_laws(
    laws: Sequence[tuple[Row, NonlinearLaw]], size: int, unknown: Unknowns
) -> tuple[Any, NonlinearLaws | None]:
    """Return the rows of nonlinear springs over all degrees of freedom and their laws, or None twice."""
    if not laws:
        return None, None
    rows = stacked([row for row, _ in laws], size)
    return rows, NonlinearLaws(unknown.rows(rows), tuple(law for _, law in laws))


def memory_laws(laws: Sequence[tuple[Row, MemoryLaw]], size: int, unknown: Unknowns) -> tuple[Any, MemoryLaws | None]:
    """Return the rows of springs with memory over all degrees of freedom and their laws, or None twice."""
    if not laws:
        return None, None
    rows = stacked([row for row, _ in laws], size)
    return rows, MemoryLaws(unknown.rows(rows), tuple(law for _, law in laws))


def springpot_laws(
    laws: Sequence[tuple[Row, SpringpotLaw]], size: int, unknown: Unknowns
) -> tuple[Any, SpringpotLaws | None]:
    """Return the rows of springpots over all degrees of freedom and their laws, or None twice."""
    if not laws:
        return None, None
    rows = stacked([row for row, _ in laws], size)
    return rows, SpringpotLaws(unknown.rows(rows), tuple(law for _, law in laws))


def check_springs(memory: MemoryLaws | None, springpots: SpringpotLaws | None) -> None:
    """Raise where a name, by which histories are told, occurs twice, or a row is empty."""
    found = [group for group in (memory, springpots) if group is not None]
    names = [law.name for group in found for law in group.laws]
    for group in found:
        known: tuple[MemoryLaw | SpringpotLaw, ...] = group.laws
        for law, row in zip(known, group.rows, strict=True):
            if names.count(law.name) > 1:
                raise ArgumentError(f"springs named {law.name!r} occur more than once; give each its own name")
            if not np.any(row.data):
                raise ArgumentError(f"{law.label} can never move: its points lie on supports or are tied by a joint")
