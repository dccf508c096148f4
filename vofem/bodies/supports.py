"""The supports of a beam: which nodes they hold, and how."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vofem._validate import choice
from vofem.bodies.axis import Axis
from vofem.bodies.base import IntArray
from vofem.errors import ArgumentError

#: Degrees of freedom (0: displacement, 1: slope) that a support holds at its node.
SUPPORTS: dict[str, tuple[int, ...]] = {"clamped": (0, 1), "pinned": (0,), "guided": (1,)}


class ByNode(dict[int, str]):
    """The kind of support of every supported node, counted from the left."""


def supported_nodes(axis: Axis, supports: Mapping[Any, str] | None) -> ByNode:
    """Return the kind of support of every supported node, from kinds by place.

    What is known by node already stays, because the x of a node may differ from the node in its last bit.

    Raises `ArgumentError` if a place or a kind is unknown, or one node is given two kinds.
    """
    label = axis.label
    if isinstance(supports, ByNode):
        return ByNode(supports)
    if supports is not None and not isinstance(supports, Mapping):
        raise ArgumentError(f"{label}: supports is {supports!r}, expected a dict such as {{'left': 'clamped'}}")
    held = ByNode()
    for where, given in (supports or {}).items():
        kind = choice(f"{label}: support at {where!r}", given, tuple(SUPPORTS))
        for node in axis.nodes_at(f"{label}: the place of a support", where).tolist():
            if held.setdefault(node, kind) != kind:
                raise ArgumentError(
                    f"{label}: the support at {where!r} is {kind!r}, but that node (x = {axis.nodes[node]:g} m) "
                    f"is {held[node]!r} under another name; keep one ('clamped' is pinned and guided)"
                )
    return held


def supported_dofs(supports: Mapping[int, str]) -> IntArray:
    """Return the degrees of freedom, in order, that are held at zero."""
    held = [2 * node + dof for node, kind in supports.items() for dof in SUPPORTS[kind]]
    return np.unique(np.array(held, dtype=np.int64))
