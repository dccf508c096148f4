"""The protocol of effects."""

from __future__ import annotations

from typing import Protocol

from vofem.assembly.builder import SystemBuilder
from vofem.bodies.base import Point


class Effect(Protocol):
    """Something that acts on bodies. Effects compare and hash by identity.

    One that moves the base on which a body stands has a property `base`, a `vofem.assembly.bases.Base`.
    """

    def compile(self, builder: SystemBuilder) -> None:
        """Add the contributions of the effect to the system, by the ``add_*`` methods of the builder."""

    def points(self) -> tuple[Point, ...]:
        """Return the points that the effect touches; their bodies must be in the scene."""

    def describe(self) -> str:
        """Return one line for `vofem.explain`."""
