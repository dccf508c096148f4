"""What a body and a point must offer, and the rows by which bodies are touched."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ArgumentError

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Row:
    """A sparse row b of a scalar coordinate ``u = b.q`` over one body's degrees of freedom.

    Attributes
    ----------
    indices : ndarray of int, shape (k,)
    weights : ndarray, shape (k,)
    """

    indices: IntArray
    weights: Array


@dataclass(frozen=True)
class BodyMatrices:
    """What a body contributes, over all its degrees of freedom, supported ones included.

    Attributes
    ----------
    mass, stiffness : csr_matrix or ndarray, shape (n, n)
        Symmetric; kg and N/m where the degree of freedom is a displacement.
        An array where n is small: many masses would feel the cost of sparse objects.
    damping : csr_matrix or ndarray, shape (n, n), optional
        None where the body has no dashpot of its own.
    supported : ndarray of int
        Degrees of freedom that are held at zero.
    scale : ndarray, shape (n,)
        Length by which a degree of freedom is multiplied to become a
        displacement (1 for displacements, the element length for slopes).
    kind : ndarray of int, shape (n,), optional
        `vofem.system.DISPLACEMENT` or ROTATION of each degree of freedom;
        displacements all where None.
    """

    mass: csr_matrix | Array
    stiffness: csr_matrix | Array
    damping: csr_matrix | Array | None
    supported: IntArray
    scale: Array
    kind: IntArray | None = None


@runtime_checkable
class Body(Protocol):
    """A thing with mass. Bodies compare and hash by identity."""

    name: str

    @property
    def size(self) -> int:
        """Number of degrees of freedom, supported ones included."""

    def matrices(self) -> BodyMatrices:
        """Return mass, stiffness, damping and supports."""

    def strain_rows(self) -> csr_matrix | Array | None:
        """Return D, shape (n_strains, size), with stiffness ``D'D``; None where K is no sum of squares."""

    def translation(self) -> Array:
        """Return the degrees of freedom, shape (size,), of a unit displacement upward as a rigid body."""

    def rigid_motions(self) -> Array:
        """Return a basis, shape (size, r), of the motions that strain the body not at all, supports aside."""

    def interpolate(self, field: Any, what: str) -> Array:
        """Return the degrees of freedom, shape (size,), of an initial field."""

    @property
    def label(self) -> str:
        """Kind and name for messages, such as ``Beam 'deck'``."""

    def describe(self) -> str:
        """Return one line for `vofem.explain`."""


class Point(Protocol):
    """A place where a body can be touched."""

    @property
    def name(self) -> str:
        """A name, such as ``beam@1.0``."""

    @property
    def body(self) -> Body:
        """The body that the point lies on."""

    def row(self) -> Row:
        """Return the row of the displacement eta."""

    def slope_row(self) -> Row:
        """Return the row of the slope d(eta)/dx."""

    def describe(self) -> str:
        """Return a name for messages, such as ``Beam 'beam-1' at x = 1 m``."""


_counter = itertools.count(1)


def automatic_name(name: str | None, kind: str) -> str:
    """Return `name`, or a new unique one such as ``'beam-3'``."""
    if name is None:
        return f"{kind.lower()}-{next(_counter)}"
    if not isinstance(name, str) or not name:
        raise ArgumentError(f"{kind}: name is {name!r}, expected a non-empty string")
    return name


def as_point(what: str, value: Any) -> Point:
    """Return `value` if it is a point, else raise `ArgumentError` naming `what`."""
    if isinstance(getattr(value, "row", None), Callable) and hasattr(value, "body"):  # type: ignore[arg-type]
        return value
    hint = "; take a point of it with .at(x)" if hasattr(value, "at") else ""
    raise ArgumentError(f"{what} is {value!r}, expected a point: beam.at(x) or a Mass{hint}")
