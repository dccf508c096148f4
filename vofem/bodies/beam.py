"""Euler-Bernoulli beams on Hermite elements."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import array, choice, nearest, number, one_of
from vofem.bodies.base import Array, BodyMatrices, IntArray, Row, automatic_name
from vofem.bodies.cubics import hermite
from vofem.bodies.mesh import LineMesh
from vofem.errors import ArgumentError

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix
    from skfem import Basis

#: Degrees of freedom (0: displacement, 1: slope) that a support holds at its node.
SUPPORTS: dict[str, tuple[int, ...]] = {"clamped": (0, 1), "pinned": (0,), "guided": (1,)}

#: Quadrature for coefficients that vary: exact for a product of degree 12.
_VARIABLE_ORDER = 12

_MOST_ELEMENTS = 10_000_000


class Beam:
    """A straight Euler-Bernoulli beam: ``rhoA eta_tt + (EI eta'')'' - (T eta')' = p``.

    Degrees of freedom are the displacement eta (m, positive upward) and the
    slope d(eta)/dx of every node, interleaved along the axis. Element matrices
    are Eq. 19 of the paper for constant coefficients, with the slope positive
    as the derivative of eta.

    Parameters
    ----------
    length : float
        In m.
    EI : float, callable of x, array_like of shape (n_elements,) or dict
        Bending stiffness in N m^2; positive. A callable is given an array of x.
        A dict gives a number for every named subdomain of a mesh.
    rhoA : float, callable of x, array_like of shape (n_elements,) or dict
        Mass per length in kg/m; positive.
    elements : int or array_like
        The number of equal elements, or the x of all nodes, increasing, with
        ``x[-1] - x[0]`` equal to `length`. With a number, x runs from 0. For a
        mesh file use `Beam.from_mesh`.
    supports : dict
        Maps "left", "right", a named point of a mesh or the x of a node to
        "clamped" (eta = eta' = 0), "pinned" (eta = 0) or "guided" (eta' = 0).
        Empty: a free beam.
    tension : float
        Axial force in N, positive in tension, constant in time.
    name : str, optional
        Unique in a scene; automatic where none is given.

    Raises
    ------
    ArgumentError
        For lengths, coefficients, nodes or supports that make no beam.

    Notes
    -----
    Beams compare and hash by identity and are not meant to be changed. `mesh`
    holds the named points and subdomains of a mesh file, or is None.
    """

    #: The mesh file, absolute, of a beam that was made from one.
    mesh_file: Path | None = None

    _arc: Array
    element_lengths: Array

    def __init__(
        self,
        length: float,
        EI: Any,
        rhoA: Any,
        elements: int | ArrayLike | LineMesh,
        supports: Mapping[Any, str] | None = None,
        tension: float = 0.0,
        name: str | None = None,
    ) -> None:
        self.name = automatic_name(name, "Beam")
        label = f"Beam {self.name!r}"
        self.length = number(f"{label}: length", length, positive=True)
        self.mesh = elements if isinstance(elements, LineMesh) else None
        self._set_nodes(label, elements)
        #: As given: the number of equal elements, the x of all nodes, or a mesh.
        self.elements: Any = self.mesh if self.mesh is not None else np.array(elements)[()]
        self.EI = self._coefficient(f"{label}: EI", EI)
        self.rhoA = self._coefficient(f"{label}: rhoA", rhoA)
        self.tension = number(f"{label}: tension", tension)
        if supports is not None and not isinstance(supports, Mapping):
            raise ArgumentError(f"{label}: supports is {supports!r}, expected a dict such as {{'left': 'clamped'}}")
        self.supports = self._supports(label, supports or {})

    @classmethod
    def from_mesh(
        cls,
        path: str | os.PathLike[str],
        EI: Any,
        rhoA: Any,
        supports: Mapping[Any, str] | None = None,
        tension: float = 0.0,
        name: str | None = None,
    ) -> Beam:
        """Return a beam on the nodes of a mesh file.

        The file holds one straight, open chain of two-node lines, its nodes in
        any order; lines of higher order are refused, as the Hermite element
        needs end nodes only. The left end is the one with the smaller x; where
        these agree the smaller y, then z. An axis along x keeps the x of the
        file; on any other, in the plane or in space, x is the arc length from
        the left end, from 0.

        Named sets of nodes serve in `supports` (all nodes of the set) and
        `at` (a set of one node), named sets of elements in `EI` and `rhoA` as
        dicts such as ``{"thick": 2.0, "thin": 1.0}``, which together must give
        every element one value. "left" and "right" are always the ends.

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
            With the extension .msh, .vtu or .med; lengths in m.
        EI, rhoA, supports, tension, name
            As for `Beam`.

        Raises
        ------
        MeshError
            If the file is missing, damaged, or holds no such chain.
        ArgumentError
            For coefficients or supports that do not suit the mesh.
        """
        from vofem.bodies.mesh_file import read_mesh

        mesh = read_mesh(path)
        beam = cls(mesh.length, EI, rhoA, mesh, supports, tension, name)
        beam.mesh_file = Path(os.path.abspath(path))
        return beam

    # -- geometry ---------------------------------------------------------------------------------

    def _set_nodes(self, label: str, elements: Any) -> None:
        if isinstance(elements, LineMesh):
            self.origin, self._arc, self.element_lengths = elements.origin, elements.arc, elements.lengths
            return
        if isinstance(elements, (int, np.integer)) and not isinstance(elements, bool):
            if not 1 <= elements <= _MOST_ELEMENTS:
                raise ArgumentError(f"{label}: elements is {elements}, expected 1 to {_MOST_ELEMENTS}")
            count = int(elements)
            self.origin = 0.0
            self._arc = np.arange(count + 1, dtype=float) * (self.length / count)
            self._arc[-1] = self.length
            self.element_lengths = np.full(count, self.length / count)
            return
        if isinstance(elements, (float, str, bool)):
            raise ArgumentError(f"{label}: elements is {elements!r}, expected a whole number or the x of all nodes")
        nodes = array(f"{label}: elements", elements)
        if nodes.ndim != 1 or nodes.size < 2:
            raise ArgumentError(f"{label}: elements has shape {nodes.shape}, expected the x of two or more nodes")
        lengths = np.diff(nodes)
        if np.any(lengths <= 0):
            k = int(np.argmax(lengths <= 0))
            raise ArgumentError(
                f"{label}: node x must increase, found x[{k}] = {nodes[k]:g} followed by x[{k + 1}] = {nodes[k + 1]:g}"
            )
        if not np.isclose(nodes[-1] - nodes[0], self.length, rtol=1e-9, atol=0.0):
            raise ArgumentError(
                f"{label}: the nodes span {nodes[-1] - nodes[0]:g} m, expected the length {self.length:g} m"
            )
        self.origin = float(nodes[0])
        self._arc = nodes - nodes[0]
        self.element_lengths = lengths

    @property
    def nodes(self) -> Array:
        """The x of all nodes in m, shape (n_elements + 1,)."""
        return np.asarray(self.origin + self._arc)

    @property
    def size(self) -> int:
        """Number of degrees of freedom, two per node, supported ones included."""
        return 2 * self._arc.size

    def _locate(self, what: str, x: ArrayLike) -> tuple[IntArray, Array]:
        """Return element indices and element coordinates of the points x."""
        arc = array(what, x) - self.origin
        slack = 1e-9 * self.length
        if np.any(arc < -slack) or np.any(arc > self.length + slack):
            bad = float(np.ravel(arc)[int(np.argmax(np.ravel((arc < -slack) | (arc > self.length + slack))))])
            raise ArgumentError(
                f"{what} is {self.origin + bad:g} m, expected a point on Beam {self.name!r}, "
                f"from {self.origin:g} to {self.origin + self.length:g} m"
            )
        arc = np.clip(arc, 0.0, self._arc[-1])
        element = np.clip(np.searchsorted(self._arc, arc, side="right") - 1, 0, self.element_lengths.size - 1)
        xi = (arc - self._arc[element]) / self.element_lengths[element]
        # A point given in decimal and a node computed in binary are meant to be the same.
        snap = 1e-9
        at_end = (xi > 1.0 - snap) & (element < self.element_lengths.size - 1)
        element = np.where(at_end, element + 1, element)
        xi = np.where(at_end | (xi < snap), 0.0, np.where(xi > 1.0 - snap, 1.0, xi))
        return element, xi

    def _named_nodes(self, what: str, where: str) -> IntArray:
        """Return the nodes called `where`: one for an end, one or more for a named point set of a mesh."""
        ends = {"left": 0, "right": self._arc.size - 1}
        if where in ends:
            return np.array([ends[where]])
        if self.mesh is not None and where in self.mesh.points:
            return self.mesh.nodes_named(what, where)
        names = (*ends, *(self.mesh.points if self.mesh is not None else ()))
        raise ArgumentError(f"{what} is {where!r}, expected an x or {one_of(names)}{nearest(where, names)}")

    def _one_node(self, what: str, where: str) -> int:
        nodes = self._named_nodes(what, where)
        if nodes.size > 1:
            places = ", ".join(f"{x:g}" for x in self.nodes[nodes[:5]]) + (", ..." if nodes.size > 5 else "")
            raise ArgumentError(f"{what} is {where!r}, which names {nodes.size} nodes (x = {places} m); give one x")
        return int(nodes[0])

    def _position(self, label: str, where: Any) -> float:
        if isinstance(where, str):
            return float(self.nodes[self._one_node(label, where)])
        x = number(label, where)
        self._locate(label, x)
        return x

    def node_at(self, where: Any) -> int:
        """Return the number of the node at "left", "right", a named point or x, counted from the left.

        Raises
        ------
        ArgumentError
            If there is no node at x, or a name is unknown or names several nodes.
        """
        what = f"a node of Beam {self.name!r}"
        return self._one_node(what, where) if isinstance(where, str) else self._node_by_x(what, where)

    def _node_by_x(self, what: str, where: Any) -> int:
        element, xi = self._locate(what, number(what, where))
        if xi not in (0.0, 1.0):
            left, right = self.nodes[int(element)], self.nodes[int(element) + 1]
            raise ArgumentError(
                f"{what} is {where!r}, which is not a node; the nearest are {left:g} and {right:g} m. "
                + ("Put a node there in the mesh" if self.mesh else "Give elements= the x of all nodes with this one")
            )
        return int(element) + int(xi == 1.0)

    def _supports(self, label: str, supports: Mapping[Any, str]) -> dict[int, str]:
        what = f"{label}: the place of a support"
        held: dict[int, str] = {}
        for where, given in supports.items():
            kind = choice(f"{label}: support at {where!r}", given, tuple(SUPPORTS))
            named = isinstance(where, str)
            for node in self._named_nodes(what, where).tolist() if named else [self._node_by_x(what, where)]:
                if held.setdefault(node, kind) != kind:
                    raise ArgumentError(
                        f"{label}: the support at {where!r} is {kind!r}, but that node (x = {self.nodes[node]:g} m) "
                        f"is {held[node]!r} under another name; keep one ('clamped' is pinned and guided)"
                    )
        return held

    def at(self, where: float | str) -> BeamPoint:
        """Return the point at x (m, any place on the axis), at "left" or "right", or at a named point of a mesh.

        Raises
        ------
        ArgumentError
            If the point is not on the beam, or a name is unknown or names several nodes.
        """
        return BeamPoint(self, self._position(f"a point of Beam {self.name!r}", where))

    def __repr__(self) -> str:
        return f"Beam(name={self.name!r}, length={self.length:g}, elements={self.element_lengths.size})"

    # -- coefficients -----------------------------------------------------------------------------

    def _coefficient(self, what: str, value: Any) -> Any:
        if callable(value):
            self._values(what, value, self.origin + 0.5 * (self._arc[:-1] + self._arc[1:]))
            return value
        if isinstance(value, Mapping):
            if self.mesh is None:
                raise ArgumentError(f"{what} is {value!r}, but only a beam from a mesh has named subdomains")
            return self.mesh.coefficient(what, value)
        if np.ndim(value) == 0:
            return number(what, value, positive=True)
        values = array(what, value, shape=self.element_lengths.shape)
        if np.any(values <= 0):
            raise ArgumentError(f"{what} is {values.min():g} in element {values.argmin()}, expected a positive number")
        return values

    def _values(self, what: str, function: Any, x: Array, *, positive: bool = True) -> Array:
        """Evaluate a callable of x and check what it returns."""
        try:
            values = np.broadcast_to(np.asarray(function(x), dtype=float), x.shape)
        except (TypeError, ValueError) as error:
            raise ArgumentError(f"{what} must be a callable that takes an array of x; it raised: {error}") from error
        bad = ~np.isfinite(values) | ((values <= 0) if positive else False)
        if np.any(bad):
            k = np.unravel_index(int(np.argmax(bad)), x.shape)
            expected = "a positive number" if positive else "a finite number"
            raise ArgumentError(f"{what} is {values[k]:g} at x = {x[k]:g} m, expected {expected}")
        return values

    def at_quadrature(self, what: str, value: Any, basis: Basis, *, positive: bool = True) -> Any:
        """Return a coefficient where scikit-fem wants it: a number, or values of shape (n_elements, n_points)."""
        if callable(value):
            x = self.origin + basis.mapping.F(basis.X)[0]
            return self._values(what, value, x, positive=positive)
        if np.ndim(value) == 0:
            return float(value)
        return np.broadcast_to(np.asarray(value)[:, None], (self.element_lengths.size, basis.X.shape[-1])).copy()

    def basis(self, *values: Any) -> Basis:
        """Return a scikit-fem basis whose quadrature suits coefficients like `values`."""
        from vofem.bodies.hermite import line_basis

        order = _VARIABLE_ORDER if any(callable(value) for value in values) else 6
        return line_basis(self._arc, self.element_lengths, order)

    # -- matrices ---------------------------------------------------------------------------------

    @cached_property
    def _matrices(self) -> BodyMatrices:
        from vofem.bodies import hermite as forms

        basis = self.basis(self.EI, self.rhoA)
        label = f"Beam {self.name!r}"
        bending = self.at_quadrature(f"{label}: EI", self.EI, basis)
        inertia = self.at_quadrature(f"{label}: rhoA", self.rhoA, basis)
        # What overflows here is found, and named, when the matrices are gathered.
        with np.errstate(over="ignore", invalid="ignore"):
            stiffness = forms.bending.assemble(basis, coefficient=bending)
            mass = forms.inertia.assemble(basis, coefficient=inertia)
        if self.tension:
            stiffness = stiffness + forms.string.assemble(basis, coefficient=self.tension)
        held = [2 * node + dof for node, kind in self.supports.items() for dof in SUPPORTS[kind]]
        scale = np.ones(self.size)
        scale[1::2] = np.minimum(np.append(self.element_lengths, np.inf), np.insert(self.element_lengths, 0, np.inf))
        return BodyMatrices(
            mass=mass.tocsr(),
            stiffness=stiffness.tocsr(),
            damping=None,
            supported=np.unique(np.array(held, dtype=np.int64)),
            scale=scale,
        )

    def matrices(self) -> BodyMatrices:
        """Return mass and stiffness over all nodes, and the supported degrees of freedom."""
        return self._matrices

    @np.errstate(over="ignore")
    def strain_rows(self) -> csr_matrix | None:
        """Return strains whose squares sum to twice the energy; None under an axial force.

        Of an element with constant EI they are the difference of its slopes
        and its deviation from a parabola, both free of the cancellation in K.
        """
        from scipy.sparse import csr_matrix

        if self.tension:
            return None
        h = self.element_lengths
        if callable(self.EI):
            nodes, weights = np.polynomial.legendre.leggauss(_VARIABLE_ORDER // 2 + 1)
            xi = 0.5 * (1.0 + nodes)
            x = self.origin + self._arc[:-1, None] + xi * h[:, None]
            root = np.sqrt(self._values(f"{self.label}: EI", self.EI, x) * 0.5 * weights * h[:, None])
            entries = np.stack([root * hermite(i, xi, h[:, None], 2) for i in range(4)], axis=-1)
        else:
            stiffness = np.broadcast_to(np.asarray(self.EI, dtype=float), h.shape)
            entries = np.zeros((h.size, 2, 4))
            entries[:, 0] = np.sqrt(12.0 * stiffness / h**3)[:, None] * np.stack(
                [np.ones_like(h), 0.5 * h, -np.ones_like(h), 0.5 * h], axis=1
            )
            entries[:, 1, 1] = np.sqrt(stiffness / h)
            entries[:, 1, 3] = -entries[:, 1, 1]
        rows = entries.shape[0] * entries.shape[1]
        columns = np.repeat(2 * np.arange(h.size), entries.shape[1])[:, None] + np.arange(4)
        return csr_matrix((entries.ravel(), columns.ravel(), 4 * np.arange(rows + 1)), shape=(rows, self.size))

    def load_vector(self, p: Any) -> Array:
        """Return the consistent load vector, shape (size,), of a force per length p (number or callable, N/m)."""
        from vofem.bodies import hermite as forms

        basis = self.basis(p)
        values = self.at_quadrature(f"a distributed load on Beam {self.name!r}", p, basis, positive=False)
        return np.asarray(forms.distributed.assemble(basis, coefficient=values))

    def translation(self) -> Array:
        """Return the degrees of freedom of a unit displacement upward."""
        return np.tile([1.0, 0.0], self._arc.size)

    def rigid_motions(self) -> Array:
        """Return the translation, and the rotation where no tension resists it."""
        if self.tension:
            return self.translation()[:, None]
        rotation = np.empty(self.size)
        rotation[0::2] = self._arc / self.length - 0.5
        rotation[1::2] = 1.0 / self.length
        return np.stack([self.translation(), rotation], axis=1)

    # -- fields -----------------------------------------------------------------------------------

    def field_matrix(self, x: ArrayLike, derivative: int = 0) -> csr_matrix:
        """Return the matrix that takes the degrees of freedom to a derivative of eta at x.

        At a node the element to its right is taken (the last node: to its left).

        Parameters
        ----------
        x : array_like, shape (k,)
            In m.
        derivative : int
            0 to 3.

        Returns
        -------
        csr_matrix, shape (k, size)
        """
        from scipy.sparse import csr_matrix

        columns, weights = self._cubics(x, derivative)
        count = weights.shape[0]
        ends = 4 * np.arange(count + 1)
        return csr_matrix((weights.ravel(), columns.ravel(), ends), shape=(count, self.size))

    def _cubics(self, x: ArrayLike, derivative: int) -> tuple[IntArray, Array]:
        """Return degrees of freedom and weights of a derivative of eta at x, each of shape (len(x), 4)."""
        element, xi = self._locate(f"a point of Beam {self.name!r}", np.atleast_1d(np.asarray(x, dtype=float)))
        h = self.element_lengths[element]
        weights = np.stack([hermite(i, xi, h, derivative) for i in range(4)], axis=1)
        return 2 * element[:, None] + np.arange(4), weights

    def row_at(self, x: float, derivative: int = 0) -> Row:
        """Return the row of eta or of a derivative at x; one entry at a node, four between nodes."""
        columns, weights = self._cubics([x], derivative)
        keep: NDArray[np.bool_] = weights[0] != 0.0
        return Row(columns[0][keep], weights[0][keep])

    def bending_stiffness(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return EI and its derivative d(EI)/dx at x (m), each of shape (k,); at a node, to its right."""
        x = np.atleast_1d(np.asarray(x, dtype=float))
        element, xi = self._locate(f"a point of Beam {self.name!r}", x)
        if np.ndim(self.EI) == 1:
            return self.EI[element], np.zeros(x.shape)
        if not callable(self.EI):
            return np.full(x.shape, self.EI), np.zeros(x.shape)
        # The polynomial through five Chebyshev points of the element: exact for a tapered section.
        points = 0.5 - 0.5 * np.cos(np.pi * (np.arange(5) + 0.5) / 5)
        h = self.element_lengths[element]
        sample = self.origin + self._arc[element][:, None] + points * h[:, None]
        values = self._values(f"Beam {self.name!r}: EI", self.EI, sample)
        coefficients = np.linalg.solve(np.vander(points, 5, increasing=True), values.T)
        powers = np.arange(1, 5)
        slope = np.sum(powers[:, None] * coefficients[1:] * xi ** (powers[:, None] - 1), axis=0) / h
        return self._values(f"Beam {self.name!r}: EI", self.EI, x), slope

    def interpolate(self, field: Any, what: str) -> Array:
        """Return the degrees of freedom, shape (size,), of an initial field.

        The field is projected in L2 on the supported space, so cubics are
        reproduced exactly.

        Parameters
        ----------
        field : number or callable of an array x
            In m or m/s.
        what : str
            "initial displacement" or the like, for messages.

        Raises
        ------
        ArgumentError
            If the field is not finite, or does not vanish where a support holds it.
        """
        label = f"{what} of Beam {self.name!r}"
        if not callable(field):
            constant = number(label, field)
            if constant == 0.0:
                return np.zeros(self.size)
            return self.interpolate(lambda x: np.full(np.shape(x), constant), what)
        self._check_supports(label, field)
        from scipy.sparse.linalg import spsolve

        from vofem.bodies import hermite as forms

        basis = self.basis(field)
        values = self.at_quadrature(label, field, basis, positive=False)
        held = self._matrices.supported
        free = np.setdiff1d(np.arange(self.size), held)
        scale = self._matrices.scale
        gram = forms.inertia.assemble(basis, coefficient=1.0)
        moments = np.asarray(forms.distributed.assemble(basis, coefficient=values))
        result = np.zeros(self.size)
        if free.size:
            # Slopes in units of one element length keep the system well conditioned on any mesh.
            balance = 1.0 / scale[free]
            scaled = gram.tocsc()[free][:, free].multiply(balance[:, None]).multiply(balance[None, :])
            result[free] = balance * spsolve(scaled.tocsc(), balance * moments[free])
        return result

    def _check_supports(self, label: str, field: Any) -> None:
        values = self._values(label, field, self.nodes, positive=False)
        size = float(np.max(np.abs(values)))
        for node, kind in self.supports.items():
            x = self.nodes[node]
            if 0 in SUPPORTS[kind] and abs(values[node]) > 1e-9 * size:
                raise ArgumentError(f"{label} is {values[node]:g} at x = {x:g} m, where the beam is {kind}; expected 0")
            if 1 in SUPPORTS[kind]:
                inward = 1.0 if node == 0 else -1.0
                element = min(node, self.element_lengths.size - 1) if inward > 0 else node - 1
                step = 1e-3 * self.element_lengths[element] * inward
                near = self._values(label, field, x + step * np.arange(4), positive=False)
                slope = float(near @ np.array([-11.0, 18.0, -9.0, 2.0])) / (6.0 * step)
                if abs(slope) * self.length > 1e-6 * size:
                    raise ArgumentError(
                        f"{label} has the slope {slope:g} at x = {x:g} m, where the beam is {kind}; expected 0"
                    )

    @property
    def label(self) -> str:
        """Kind and name."""
        return f"Beam {self.name!r}"

    def describe(self) -> str:
        """Return name, elements and supports."""
        held = ", ".join(f"{kind} at x = {self.nodes[node]:g}" for node, kind in self.supports.items())
        return f"{self.label}: {self.element_lengths.size} elements, {held or 'free'}"


class BeamPoint:
    """A point on a beam's axis; made by `Beam.at`.

    Attributes
    ----------
    body : Beam
    x : float
        In m.
    """

    def __init__(self, body: Beam, x: float) -> None:
        self.body = body
        self.x = x

    def row(self) -> Row:
        """Return the row of eta: one entry at a node, four between nodes."""
        return self.body.row_at(self.x)

    def slope_row(self) -> Row:
        """Return the row of the slope."""
        return self.body.row_at(self.x, 1)

    def __repr__(self) -> str:
        return f"{self.body!r}.at({self.x:g})"

    def describe(self) -> str:
        """Return beam and place."""
        return f"Beam {self.body.name!r} at x = {self.x:g} m"
