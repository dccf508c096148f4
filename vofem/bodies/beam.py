"""Euler-Bernoulli beams on Hermite elements."""

from __future__ import annotations

import os
import pathlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.bodies.axis import axis_of
from vofem.bodies.base import Array, BodyMatrices, BodyPoint, DegreesOfFreedom, IntArray, Point, Row, Shape
from vofem.bodies.beam_matrices import beam_matrices, beam_strains, consistent_load
from vofem.bodies.coefficient import Coefficient, basis_for, positive_coefficient
from vofem.bodies.initial_field import project
from vofem.bodies.kinds import Elements, Section, Supports
from vofem.bodies.mesh import LineMesh
from vofem.bodies.path import Path, TravellingPoint
from vofem.bodies.supports import SUPPORTS, supported_nodes
from vofem.errors import ArgumentError
from vofem.parameters import CHOSEN, Name, Real, content_of, declared, rule
from vofem.sharing import recent

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix
    from skfem import Basis

#: What a coefficient of a beam may be: a number, one for each element or named part, or a callable of x.
Along = float | ArrayLike | Callable[[Any], Any] | Mapping[str, float]

__all__ = ["SUPPORTS", "Beam"]


@declared()
class Beam:
    """A straight Euler-Bernoulli beam: ``rhoA eta_tt + (EI eta'')'' - (T eta')' = p``.

    The degrees of freedom of every node are the displacement eta in m, positive
    upward, and the slope d(eta)/dx. For constant EI and rhoA the element matrices
    are those of Eq. 19 of the paper, with the slope as the derivative of eta.

    Raises
    ------
    ArgumentError
        For a length, a coefficient, nodes or supports that are not valid.

    Notes
    -----
    Beams compare and hash by identity and are not meant to be changed.
    """

    length: Annotated[float, Real("m", "Length.", above=0.0)]
    EI: Annotated[
        Along,
        Section(
            "N m^2",
            "Bending stiffness: a number, a callable of an array x, one number for each element, or a dict with a "
            "number for every named subdomain of a mesh.",
        ),
    ]
    rhoA: Annotated[Along, Section("kg/m", "Mass per length, given like EI.")]
    elements: Annotated[
        Any,
        Elements(
            "The number of equal elements, with x from 0; or the increasing x of all nodes in m, with ``x[-1] - x[0]`` "
            "equal to `length`. `Beam.from_mesh` reads a mesh file."
        ),
    ]
    supports: Annotated[
        Mapping[Any, str],
        Supports(
            tuple(SUPPORTS),
            'Maps "left", "right", a named point of a mesh or the x of a node to "clamped" (eta = eta\' = 0), "pinned" '
            '(eta = 0) or "guided" (eta\' = 0). Without supports the beam is free.',
        ),
    ] = None  # type: ignore[assignment]
    tension: Annotated[float, Real("N", "Axial force, constant in time, positive in tension.")] = 0.0
    name: Annotated[str, Name("Unique in a scene. In Python, a name is chosen if none is given.", needed=True)] = CHOSEN

    @rule("elements", "length")
    def _lay_out(self) -> None:
        self._axis = axis_of(self.label, self.length, self.elements)
        if not isinstance(self.elements, LineMesh):
            self.elements = np.array(self.elements)[()]

    @rule("EI", "elements", "length")
    def _bend(self) -> None:
        self._EI = positive_coefficient(f"{self.label}: EI", self.EI, self._axis)
        self.EI = self._EI.value

    @rule("rhoA", "elements", "length")
    def _weigh(self) -> None:
        self._rhoA = positive_coefficient(f"{self.label}: rhoA", self.rhoA, self._axis)
        self.rhoA = self._rhoA.value

    @rule("supports", "elements", "length")
    def _hold(self) -> None:
        self.supports = supported_nodes(self._axis, self.supports)

    @classmethod
    def from_mesh(
        cls,
        path: str | os.PathLike[str],
        EI: Along,
        rhoA: Along,
        supports: Mapping[Any, str] | None = None,
        tension: float = 0.0,
        name: str | None = None,
    ) -> Beam:
        """Return a beam on the nodes of a mesh file.

        The file holds one straight, open chain of two-node lines; the nodes may
        be in any order. Lines of higher order are refused, because the Hermite
        element needs end nodes only. The left end is the one with the smaller x;
        if these are equal, the smaller y, then z. A beam along the x axis keeps
        the x of the file. For any other direction x is the distance from the
        left end.

        Names of sets of nodes can be used in `supports` (for all nodes of the set)
        and in `at` (for a set of one node). Names of sets of elements can be used
        in dicts for `EI` and `rhoA`, such as ``{"thick": 2.0, "thin": 1.0}``; each
        element must get one value. "left" and "right" are always the ends.

        =========  =====================================================================
        file       names come from
        =========  =====================================================================
        Gmsh .msh  physical names of points and curves
        MED .med   groups of nodes and of elements
        VTU .vtu   the names of integer arrays of 0 and 1: point data mark the nodes of
                   a set, cell data the elements (a marked vertex counts as its node)
        =========  =====================================================================

        Parameters
        ----------
        path : str or path
            A file that ends in .msh, .vtu or .med, with lengths in m.
        EI, rhoA, supports, tension, name
            The same as for `Beam`.

        Raises
        ------
        MeshError
            If the file is missing, damaged, or holds no such chain.
        ArgumentError
            If coefficients or supports do not suit the mesh.
        """
        from vofem.bodies.mesh_file import read_mesh

        mesh = replace(read_mesh(path), file=os.path.abspath(path))
        return cls(mesh.length, EI, rhoA, mesh, supports or {}, tension, name)  # type: ignore[arg-type]

    # -- description ------------------------------------------------------------------------------

    @property
    def label(self) -> str:
        """Kind and name."""
        return f"Beam {self.name!r}"

    def __repr__(self) -> str:
        return f"Beam(name={self.name!r}, length={self.length:g}, elements={self.element_lengths.size})"

    def summary(self) -> str:
        """Return name, elements and supports."""
        held = ", ".join(f"{kind} at x = {self.nodes[node]:g}" for node, kind in self.supports.items())
        return f"{self.label}: {self.element_lengths.size} elements, {held or 'free'}"

    def describe(self) -> str:
        """Return name, elements and supports."""
        return self.summary()

    # -- places -----------------------------------------------------------------------------------

    @property
    def mesh(self) -> LineMesh | None:
        """The named points and subdomains of a mesh file, or None."""
        return self._axis.mesh

    @property
    def mesh_file(self) -> pathlib.Path | None:
        """The mesh file, absolute, of a beam that was made from one."""
        return pathlib.Path(self.mesh.file) if self.mesh is not None and self.mesh.file else None

    @property
    def origin(self) -> float:
        """The x of the left end in m."""
        return self._axis.origin

    @property
    def element_lengths(self) -> Array:
        """Lengths of the elements in m, shape (n_elements,)."""
        return self._axis.element_lengths

    @property
    def nodes(self) -> Array:
        """The x of all nodes in m, shape (n_elements + 1,)."""
        return self._axis.nodes

    @property
    def size(self) -> int:
        """Number of degrees of freedom, two per node, supported ones included."""
        return self._axis.size

    @property
    def degrees_of_freedom(self) -> DegreesOfFreedom:
        """Displacement and slope of every node."""
        return DegreesOfFreedom(np.repeat(self.nodes, 2), np.tile([False, True], self.nodes.size))

    @cached_property
    def shape(self) -> Shape:
        """The axis through its nodes, which moves upward."""
        return Shape("line", self.nodes, self.field_matrix(self.nodes))

    def sections(self) -> dict[str, Any]:
        """Return nothing: bending moment and shear force are methods of results."""
        return {}

    def resolve(self, point: Point) -> Row:
        """Return the row of the point at the same x."""
        return self.at(point.x).row() if hasattr(point, "x") else point.row()

    def supported_at(self, where: Any) -> IntArray:
        """Return the degrees of freedom that the support at a node holds.

        Raises
        ------
        ArgumentError
            If there is no support at that place.
        """
        node = self.node_at(where)
        if node not in self.supports:
            places = ", ".join(f"x = {self.nodes[k]:g}" for k in self.supports) or "none"
            raise ArgumentError(f"Beam {self.name!r} has no support at {where!r}; its supports: {places}")
        return 2 * node + np.array(SUPPORTS[self.supports[node]], dtype=np.int64)

    def at(self, where: float | str) -> BodyPoint:
        """Return the point at x (m, any place on the axis), at "left" or "right", or at a named point of a mesh.

        Raises
        ------
        ArgumentError
            If the point is not on the beam, or a name is unknown or names several nodes.
        """
        return BodyPoint(self, self._axis.position(f"a point of {self.label}", where))

    def along(self, path: Path) -> TravellingPoint:
        """Return a point that travels along the beam; loads, contacts and attachments take it in place of a point.

        Parameters
        ----------
        path : Path
            Where it is at which time.

        Raises
        ------
        ArgumentError
            If `path` is no `Path`.
        """
        if not isinstance(path, Path):
            raise ArgumentError(f"a path along {self.label} is {path!r}, expected vofem.Path(speed, start=, ...)")
        return TravellingPoint(self, path)

    def node_at(self, where: Any) -> int:
        """Return the number of the node at "left", "right", a named point or x, counted from the left.

        Raises
        ------
        ArgumentError
            If there is no node at x, or a name is unknown or names several nodes.
        """
        return self._axis.node(f"a node of {self.label}", where)

    # -- matrices ---------------------------------------------------------------------------------

    @cached_property
    def _matrices(self) -> BodyMatrices:
        def make() -> BodyMatrices:
            return beam_matrices(self._axis, self._EI, self._rhoA, self.tension, self.supports)

        try:
            key = content_of(self)
        except TypeError:  # a Python function
            return make()
        return recent(key, make)

    def matrices(self) -> BodyMatrices:
        """Return mass and stiffness over all nodes, and the supported degrees of freedom."""
        return self._matrices

    def strain_rows(self) -> csr_matrix | None:
        """Return strains whose squares sum to twice the energy; None under compression."""
        return None if self.tension < 0.0 else beam_strains(self._axis, self._EI, self.tension)

    def load_vector(self, p: Any) -> Array:
        """Return the consistent load vector, shape (size,), of a force per length p (number or callable, N/m)."""
        return consistent_load(Coefficient(f"a distributed load on {self.label}", p, self._axis, positive=False))

    def translation(self) -> Array:
        """Return the degrees of freedom of a unit displacement upward."""
        return np.tile([1.0, 0.0], self._axis.arc.size)

    def rigid_motions(self) -> Array:
        """Return the translation, and the rotation where no tension resists it."""
        if self.tension:
            return self.translation()[:, None]
        rotation = np.empty(self.size)
        rotation[0::2] = self._axis.arc / self.length - 0.5
        rotation[1::2] = 1.0 / self.length
        return np.stack([self.translation(), rotation], axis=1)

    def basis(self, *values: Any) -> Basis:
        """Return a scikit-fem basis whose quadrature suits coefficients like `values`."""
        return basis_for(self._axis, *values)

    def at_quadrature(self, what: str, value: Any, basis: Basis, *, positive: bool = True) -> Any:
        """Return a coefficient at the quadrature points: a number, or values of shape (n_elements, n_points)."""
        return Coefficient(what, value, self._axis, positive).at_quadrature(basis)

    # -- fields -----------------------------------------------------------------------------------

    def field_matrix(self, x: ArrayLike, derivative: int = 0) -> csr_matrix:
        """Return the matrix that takes the degrees of freedom to a derivative of eta at x.

        At a node the value is that of the element to its right, and at the last node that of the element to its left.

        Parameters
        ----------
        x : array_like, shape (k,)
            Place on the axis, m.
        derivative : int
            0 to 3.

        Returns
        -------
        csr_matrix, shape (k, size)
        """
        from scipy.sparse import csr_matrix

        columns, weights = self._axis.cubics(x, derivative)
        count = weights.shape[0]
        ends = 4 * np.arange(count + 1)
        return csr_matrix((weights.ravel(), columns.ravel(), ends), shape=(count, self.size))

    def row_at(self, x: float, derivative: int = 0) -> Row:
        """Return the row of eta or of a derivative at x; one entry at a node, four between nodes."""
        columns, weights = self._axis.cubics([x], derivative)
        keep: NDArray[np.bool_] = weights[0] != 0.0
        return Row(columns[0][keep], weights[0][keep])

    def bending_stiffness(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return EI and its derivative d(EI)/dx at x (m), each of shape (k,); at a node, to its right."""
        return self._EI.with_slope(x)

    def mass_per_length(self, x: ArrayLike) -> Array:
        """Return rhoA in kg/m at x (m), shape (k,); at a node, to its right."""
        return self._rhoA.with_slope(x)[0]

    def locate(self, x: ArrayLike) -> tuple[IntArray, Array]:
        """Return elements and places in them, from 0 to 1, of points x (m); at a node, the element to its right."""
        return self._axis.locate(f"a point of {self.label}", x)

    def interpolate(self, field: Any, what: str) -> Array:
        """Return the degrees of freedom, shape (size,), of an initial field.

        The field is projected in L2 on the supported space, so cubics are
        reproduced exactly.

        Parameters
        ----------
        field : number or callable of an array x
            The field: a number or a callable of x, m or m/s.
        what : str
            "initial displacement" or the like, for messages.

        Raises
        ------
        ArgumentError
            If the field is not finite, or is not zero at a support.
        """
        return project(f"{what} of {self.label}", field, self._axis, self.supports)
