"""What an effect offers, and a contact as it hands itself over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol

from vofem.bodies.base import Point, Row
from vofem.laws import ContactLaws, LawGroup

if TYPE_CHECKING:
    from vofem.assembly.builder import SystemBuilder


class Effect(Protocol):
    """Something that acts on bodies. Effects compare and hash by identity."""

    def compile(self, builder: SystemBuilder) -> None:
        """Add to the system what the effect is, by the builder's ``add_*`` methods."""

    def points(self) -> tuple[Point, ...]:
        """Return the points that the effect touches; their bodies must be in the scene."""

    def describe(self) -> str:
        """Return one line for `vofem.explain`."""


@dataclass(frozen=True)
class ContactEntry:
    """One contact as `SystemBuilder.add_contact` takes it; the fields are those of `ContactLaws`."""

    group: ClassVar[type[LawGroup]] = ContactLaws

    name: str
    row: Row
    gap: float
    stiffness: float
    damping: float
    jump: bool
    resolution: float
