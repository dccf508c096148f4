"""Euler-Bernoulli beams on Hermite elements."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from vofem.bodies.axis import SUPPORTS, Axis, supported_nodes
from vofem.bodies.base import Array, BodyMatrices
from vofem.bodies.beam_matrices import beam_matrices, beam_strains, consistent_load
from vofem.bodies.coefficient import Coefficient, positive_coefficient, project
from vofem.bodies.kinds import Elements, Section, Supports
from vofem.bodies.mesh import LineMesh
from vofem.bodies.path import Path, TravellingPoint
from vofem.errors import ArgumentError
from vofem.parameters import CHOSEN, Name, Real, content_of, declared, rule
from vofem.sharing import recent

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

#: What a coefficient of a beam may be: a number, one for each element or named part, or a callable of x.
Along = float | ArrayLike | Callable[[Any], Any] | Mapping[str, float]

__all__ = ["SUPPORTS", "Beam"]


@declared()
class Beam(Axis):
    """A straight Euler-Bernoulli beam: ``rhoA eta_tt + (EI eta'')'' - (T eta')' = p``.

    The degrees of freedom of every node are the displacement eta in m, positive upward, and the slope d(eta)/dx. For
    constant EI and rhoA the element matrices are those of Eq. 19 of the paper, with the slope as the derivative of eta.

    Raises
    ------
    ArgumentError
        For a length, a coefficient, nodes or supports that are not valid.

    Notes
    -----
    Beams compare and hash by identity and are not meant to be changed. The attribute `supports` has the numbers of the
    nodes, from 0, as keys in place of the names or places that were given.
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
        self._divide(self.elements)
        if not isinstance(self.elements, LineMesh):
            self.elements = np.array(self.elements)[()]

    @rule("EI", "elements", "length")
    def _bend(self) -> None:
        self._EI = positive_coefficient(f"{self.label}: EI", self.EI, self)
        self.EI = self._EI.value

    @rule("rhoA", "elements", "length")
    def _weigh(self) -> None:
        self._rhoA = positive_coefficient(f"{self.label}: rhoA", self.rhoA, self)
        self.rhoA = self._rhoA.value

    @rule("supports", "elements", "length")
    def _hold(self) -> None:
        self.supports = supported_nodes(self, self.supports)

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

        The file holds one straight, open chain of two-node lines; the nodes may be in any order. Lines of higher order
        are refused, because the Hermite element needs end nodes only. The left end is the one with the smaller x; if
        these are equal, the smaller y, then z. A beam along the x axis keeps the x of the file. For any other direction
        x is the distance from the left end.

        Names of sets of nodes can be used in `supports` (for all nodes of the set) and in `at` (for a set of one node).
        Names of sets of elements can be used in dicts for `EI` and `rhoA`, such as ``{"thick": 2.0, "thin": 1.0}``;
        each element must get one value. "left" and "right" are always the ends.

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
        from vofem.bodies.mesh import read_mesh

        mesh = replace(read_mesh(path), file=os.path.abspath(path))
        return cls(mesh.length, EI, rhoA, mesh, supports or {}, tension, name)  # type: ignore[arg-type]

    # -- description ------------------------------------------------------------------------------

    def __repr__(self) -> str:
        return f"Beam(name={self.name!r}, length={self.length:g}, elements={self.element_lengths.size})"

    def summary(self) -> str:
        """Return name, elements and supports."""
        held = ", ".join(f"{kind} at x = {self.nodes[node]:g}" for node, kind in self.supports.items())
        return f"{self.label}: {self.element_lengths.size} elements, {held or 'free'}"

    # -- places -----------------------------------------------------------------------------------

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

    # -- matrices ---------------------------------------------------------------------------------

    @cached_property
    def _matrices(self) -> BodyMatrices:
        def make() -> BodyMatrices:
            return beam_matrices(self, self._EI, self._rhoA, self.tension, self.supports)

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
        return None if self.tension < 0.0 else beam_strains(self, self._EI, self.tension)

    def load_vector(self, p: Any) -> Array:
        """Return the consistent load vector, shape (size,), of a force per length p (number or callable, N/m)."""
        return consistent_load(Coefficient(f"a distributed load on {self.label}", p, self, positive=False))

    def rigid_motions(self) -> Array:
        """Return the translation, and the rotation where no tension resists it."""
        if self.tension:
            return self.translation()[:, None]
        rotation = np.empty(self.size)
        rotation[0::2] = self.arc / self.length - 0.5
        rotation[1::2] = 1.0 / self.length
        return np.stack([self.translation(), rotation], axis=1)

    # -- fields -----------------------------------------------------------------------------------

    def bending_stiffness(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return EI and its derivative d(EI)/dx at x (m), each of shape (k,); at a node, to its right."""
        return self._EI.with_slope(x)

    def mass_per_length(self, x: ArrayLike) -> Array:
        """Return rhoA in kg/m at x (m), shape (k,); at a node, to its right."""
        return self._rhoA.with_slope(x)[0]

    def interpolate(self, field: Any, what: str) -> Array:
        """Return the degrees of freedom, shape (size,), of an initial field.

        The field is projected in L2 on the supported space, so cubics are reproduced exactly.

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
        return project(f"{what} of {self.label}", field, self, self.supports)
