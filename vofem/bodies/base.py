"""What a body and a point must offer, and the rows by which bodies are touched."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from vofem._validate import number
from vofem.arrays import Array, IntArray
from vofem.errors import ArgumentError

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


@dataclass(frozen=True)
class Row:
    """A sparse row b of a scalar coordinate ``u = b.q`` over one body's degrees of freedom."""

    indices: IntArray  #: Shape (k,).
    weights: Array  #: Shape (k,).


@dataclass(frozen=True)
class BodyMatrices:
    """The matrices of a body over all its degrees of freedom, supported ones included.

    Attributes
    ----------
    mass, stiffness : csr_matrix or ndarray, shape (n, n)
        Mass and stiffness matrix, symmetric, in kg and N/m where the degree of freedom is a displacement. They are
        arrays if n is small, because sparse objects would make scenes of many masses slow.
    damping : csr_matrix or ndarray, shape (n, n), optional
        Damping matrix; None if the body has no dashpot of its own.
    supported : ndarray of int
        Degrees of freedom that supports keep at zero.
    scale : ndarray, shape (n,)
        Length by which a degree of freedom is multiplied to become a
        displacement (1 for displacements, the element length for slopes).
    """

    mass: csr_matrix | Array
    stiffness: csr_matrix | Array
    damping: csr_matrix | Array | None
    supported: IntArray
    scale: Array


@dataclass(frozen=True)
class DegreesOfFreedom:
    """The places and kinds of the degrees of freedom of a body.

    Attributes
    ----------
    x : ndarray, shape (size,)
        Place on the axis of the body in m; NaN where the body has none.
    rotation : ndarray of bool, shape (size,)
        True for a rotation (rad), False for a displacement (m).
    """

    x: Array
    rotation: NDArray[np.bool_]


@dataclass(frozen=True)
class Shape:
    """The place and the direction of motion of a body in the plane of a picture.

    Attributes
    ----------
    kind : {"line", "block"}
        A line is drawn through all places. A block is drawn at its only place.
    x : ndarray, shape (k,)
        Places along the axis of the body in m, ascending; 0 for a block.
    rows : csr_matrix or ndarray, shape (k, size)
        Matrix that takes the degrees of freedom to the displacements of these places.
    direction : (float, float)
        Unit vector of the displacement in the plane: (0, 1) upward, across the axis; (1, 0) along it.
    """

    kind: Literal["line", "block"]
    x: Array
    rows: Any
    direction: tuple[float, float] = (0.0, 1.0)


class Body:
    """A thing with mass. Bodies compare and hash by identity.

    `Beam` and `Mass` derive from it, and so can a class that is written outside the package. A subclass sets `name` and
    offers `size`, `degrees_of_freedom`, `matrices` and `shape`; all else follows from these. The methods suit bodies
    whose degrees of freedom are displacements in one direction. A body with rotations overrides `rigid_motions` and
    `interpolate`.
    """

    name: str

    if TYPE_CHECKING:  # as attributes or as properties

        @property
        def size(self) -> int:
            """Number of degrees of freedom, supported ones included."""

        @property
        def degrees_of_freedom(self) -> DegreesOfFreedom:
            """Place and kind of every degree of freedom."""

        @property
        def shape(self) -> Shape:
            """How the body lies and moves in a picture."""

    def matrices(self) -> BodyMatrices:
        """Return mass, stiffness, damping and supports."""
        raise NotImplementedError(f"{type(self).__name__} has no method matrices")

    @property
    def label(self) -> str:
        """Kind and name."""
        return f"{type(self).__name__} {self.name!r}"

    def summary(self) -> str:
        """Return one line for `vofem.explain`: kind, name and number of degrees of freedom."""
        return f"{self.label}: {self.size} degrees of freedom"

    def describe(self) -> str:
        """Return the summary."""
        return self.summary()

    def strain_rows(self) -> csr_matrix | Array | None:
        """Return D, shape (n_strains, size), with stiffness ``D'D``; None where K is not known as a sum of squares."""
        return None

    def sections(self) -> Mapping[str, Any]:
        """Return what else is known along the shape: matrices, shape (k, size), by name and unit, ``"force [N]"``."""
        return {}

    def translation(self) -> Array:
        """Return the degrees of freedom, shape (size,), of a unit displacement upward; zero along the axis."""
        return np.where(self.degrees_of_freedom.rotation, 0.0, self.shape.direction[1])

    def rigid_motions(self) -> Array:
        """Return a basis, shape (size, r), of the motions that do not strain the body, supports aside."""
        motion = np.where(self.degrees_of_freedom.rotation, 0.0, 1.0)[:, None]
        stiffness = self.matrices().stiffness
        resisted = np.abs(stiffness @ motion) > 1e-12 * (abs(stiffness) @ motion)
        return motion[:, : 0 if np.any(resisted) else 1]

    def interpolate(self, field: Any, what: str) -> Array:
        """Return the degrees of freedom, shape (size,), of an initial field: a number or a callable of x."""
        known = self.degrees_of_freedom
        if np.any(known.rotation):
            raise ArgumentError(f"{what} of {self.label}: this body says nothing of fields; start from an outcome")
        values = np.asarray(field(known.x) if callable(field) else field, dtype=float)
        if values.shape not in ((), known.x.shape) or not np.all(np.isfinite(values)):
            raise ArgumentError(f"{what} of {self.label} is {field!r}, expected a finite number or a callable of x")
        held = self.matrices().supported
        values = np.broadcast_to(values, known.x.shape).copy()
        if np.any(np.abs(values[held]) > 1e-9 * np.max(np.abs(values), initial=0.0)):
            raise ArgumentError(f"{what} of {self.label} does not vanish where a support holds it")
        values[held] = 0.0
        return values

    def at(self, where: float | str) -> Point:
        """Return the point at x (m), or at "left" or "right"; between the places of the shape u is linear in x."""
        x = self.shape.x
        if isinstance(where, str):
            ends = {"left": float(x[0]), "right": float(x[-1])}
            if where not in ends:
                raise ArgumentError(f"a point of {self.label} is {where!r}, expected an x, 'left' or 'right'")
            return Point(self, ends[where])
        place, slack = number(f"a point of {self.label}", where), 1e-9 * (x[-1] - x[0])
        if not x[0] - slack <= place <= x[-1] + slack:
            raise ArgumentError(
                f"a point of {self.label} is {place:g} m, expected a place from {x[0]:g} to {x[-1]:g} m"
            )
        return Point(self, place)

    def row_at(self, x: float, derivative: int = 0) -> Row:
        """Return the row of the displacement at x: that of a place of the shape, or between two in proportion."""
        from scipy.sparse import csr_matrix

        if derivative:
            raise ArgumentError(f"{self.label} at x = {x:g} m has no rotation that is known; moments need a beam")
        places, rows = self.shape.x, csr_matrix(self.shape.rows)
        if places.size == 1:
            return Row(rows.indices.astype(np.int64), rows.data)
        right = int(np.clip(np.searchsorted(places, x), 1, places.size - 1))
        share = float(np.clip((x - places[right - 1]) / (places[right] - places[right - 1]), 0.0, 1.0))
        share = round(share) if min(share, 1.0 - share) < 1e-9 else share
        mixed = csr_matrix((1.0 - share) * rows[right - 1] + share * rows[right])
        mixed.eliminate_zeros()
        return Row(mixed.indices.astype(np.int64), mixed.data)

    def resolve(self, point: Point) -> Row:
        """Return the row of a point. A point of another body stands for the point of this body at the same x."""
        return point.row() if point.body is self else self.at(point.x).row()

    def supported_at(self, where: Any) -> IntArray:
        """Return the supported degrees of freedom at x, "left" or "right"."""
        x, held = self.degrees_of_freedom.x, self.matrices().supported
        place = self.at(where).x
        found = held[np.isclose(x[held], place, rtol=1e-9, atol=1e-9 * (np.nanmax(x) - np.nanmin(x)))]
        if not found.size:
            places = ", ".join(f"x = {value:g}" for value in np.unique(x[held])) or "none"
            raise ArgumentError(f"{self.label} has no support at {where!r}; its supports: {places}")
        return found


class Point:
    """A point on the axis of a body, by its x; made by `Beam.at` and `Body.at`. A `Mass` is a point itself.

    Attributes
    ----------
    body : Body
    x : float
        Place on the axis, m.
    """

    body: Any
    x: float

    def __init__(self, body: Any, x: float) -> None:
        self.body, self.x = body, x

    @property
    def name(self) -> str:
        """Body and place as scene files name them, such as ``beam@1.0``."""
        return f"{self.body.name}@{float(self.x)!r}"

    def __repr__(self) -> str:
        return f"{self.body!r}.at({self.x:g})"

    def row(self) -> Row:
        """Return the row of the displacement."""
        row: Row = self.body.row_at(self.x)
        return row

    def slope_row(self) -> Row:
        """Return the row of the slope."""
        row: Row = self.body.row_at(self.x, 1)
        return row

    def describe(self) -> str:
        """Return body and place."""
        return f"{self.body.label} at x = {self.x:g} m"


def touching(effect: Any, bodies: Mapping[Any, Any], moved: Callable[[Point, Any], Any]) -> Any:
    """Return an effect as a copy that touches other bodies; the effect itself where it touches none of them.

    `bodies`: bodies, and those that take their place.
    `moved`: returns the point on a new body that takes the place of a point on the old one.
    """
    changes = {}
    for name, value in vars(effect).items():
        if isinstance(value, Body):
            if value in bodies:
                changes[name] = bodies[value]
        elif isinstance(value, Point) and value.body in bodies:
            new = bodies[value.body]
            changes[name] = new.along(value.path) if hasattr(value, "path") else moved(value, new)
    if not changes:
        return effect
    made = copy.copy(effect)
    for name, value in changes.items():
        setattr(made, name, value)
    return made


def as_point(what: str, value: Any, bodies: Iterable[Body] = ()) -> Point:
    """Return a point, or the mass of a name among bodies; raise `ArgumentError` naming `what` for another value."""
    if isinstance(value, str):
        value = next((body for body in bodies if body.name == value), value)
    if isinstance(value, Point):
        return value
    known = ", a Mass or its name" if bodies else " or a Mass"
    hint = "; take a point of it with .at(x)" if hasattr(value, "at") else ""
    raise ArgumentError(f"{what} is {value!r}, expected a point: beam.at(x), beam.along(path){known}{hint}")
