"""Springs, dashpots and masses at points that travel along a beam."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vofem.laws.group import ListedLaws
from vofem.laws.law import Law, affine
from vofem.laws.moving import Moving, gathered

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


@dataclass(frozen=True)
class TravellingLaw:
    """A spring and a dashpot, or a tie, in a coordinate that travels."""

    group: ClassVar[type[Any]]

    label: str
    name: str
    #: `stiffness`, `damping`: in N/m and N s/m.
    stiffness: float = 0.0
    damping: float = 0.0
    tied: bool = False  #: Whether the coordinate is held at zero, exactly.
    moving: tuple[tuple[Any, float], ...] = ()
    track: Any = None  #: The point, and its sign in the coordinate.
    rider: Any = None  #: The same over the unknowns, see `Moving`.


@dataclass(frozen=True)
class TravellingLaws(ListedLaws):
    """What is fixed to points that travel, one per row; rows hold the part at rest."""

    place: ClassVar[int] = 2
    kind: ClassVar[str] = "springs, dashpots and masses that travel"

    rows: csr_matrix
    laws: tuple[TravellingLaw, ...]
    moving: Moving | None = None

    @classmethod
    def gather(cls, rows: csr_matrix, laws: tuple[Any, ...]) -> TravellingLaws:
        """Return the group of some laws."""
        return cls(rows, laws, gathered(laws))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the laws."""
        return tuple(law.name for law in self.laws)

    @property
    def tied(self) -> NDArray[np.bool_]:
        """Whether a law is a tie."""
        return np.array([law.tied for law in self.laws])

    def nonlinearity(self, method: str) -> str:
        """Return why methods for systems that do not depend on time cannot treat them."""
        return (
            f"{self.labels[0]} travels along a beam, so that the equations of motion depend on time; {method} does not "
            "treat them"
        )

    def modes_refusal(self) -> str:
        """Return why there are no modes."""
        return f"{self.labels[0]} travels along a beam; put it at rest at a place of interest, beam.at(x)"

    @cached_property
    def forms(self) -> tuple[Law, ...]:
        """The laws as functions."""
        return tuple(
            Law(law.label, law.name, affine, np.array([0.0, law.stiffness, 0.0, law.damping]),
                stiffness=law.stiffness, damped=law.damping > 0.0)
            for law in self.laws
        )  # fmt: skip

    def shifted(self, start: float) -> TravellingLaws:
        """Return the laws for a run that begins at a time in s."""
        return self if self.moving is None else replace(self, moving=self.moving.shifted(start))


TravellingLaw.group = TravellingLaws
