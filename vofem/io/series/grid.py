"""The grid of a series of VTU files: points and cells at rest, and the fields on them at some times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vofem.bodies import Beam
from vofem.bodies.base import Body, Row
from vofem.bodies.cubics import hermite
from vofem.io.series.placement import Placement
from vofem.result import Result

Array = NDArray[np.float64]

#: The cell data `kind`.
BEAM, MASS, CONTACT, STOP = range(4)

#: The numbers that VTK gives to cell types; the names are meshio's.
_CELL_TYPES = {"vertex": 1, "line": 3}

#: Just left of a node, where a beam is asked for EI on the element that ends there: at the node it gives the next.
_INSIDE = 1.0 - 1e-8


@dataclass(frozen=True)
class Frames:
    """Fields at some times; first axis: times.

    Attributes
    ----------
    point_data : dict of str to ndarray, shape (n_times, n_points) or (n_times, n_points, 3)
    cell_data : dict of str to ndarray, shape (n_times, n_cells)
    """

    point_data: dict[str, Array]
    cell_data: dict[str, NDArray]


@dataclass(frozen=True)
class Cells:
    """Cells of an unstructured grid.

    Attributes
    ----------
    blocks : tuple of (str, ndarray of int, shape (n_cells, n_points_per_cell))
        Type of the cells, "line" or "vertex", and the points of each cell. No block is empty.
    """

    blocks: tuple[tuple[str, NDArray[np.int64]], ...]

    @property
    def connectivity(self) -> NDArray[np.int64]:
        """The points of all cells, one cell after another."""
        return np.concatenate([points.ravel() for _, points in self.blocks])

    @property
    def offsets(self) -> NDArray[np.int64]:
        """Where each cell ends in `connectivity`, shape (n_cells,)."""
        return np.cumsum(np.concatenate([np.full(len(points), points.shape[1]) for _, points in self.blocks]))

    @property
    def types(self) -> NDArray[np.uint8]:
        """VTK's number of the type of each cell, shape (n_cells,)."""
        return np.concatenate([np.full(len(points), _CELL_TYPES[kind], np.uint8) for kind, points in self.blocks])


class _BeamPoints:
    """The points of a beam: every element has its own, its two ends among them."""

    def __init__(self, beam: Beam, per_element: int) -> None:
        self.body = beam
        h = beam.element_lengths[:, None]
        xi = np.linspace(0.0, 1.0, per_element)
        self.x = beam.nodes[:-1, None] + xi * h
        self.x[:, -1] = beam.nodes[1:]
        stiffness, change = beam.bending_stiffness((beam.nodes[:-1, None] + np.minimum(xi, _INSIDE) * h).ravel())
        self.stiffness, self.change = stiffness.reshape(self.x.shape).copy(), change.reshape(self.x.shape)
        self.stiffness[:, -1] += self.change[:, -1] * (1.0 - _INSIDE) * h[:, 0]
        self.weights = [np.stack([hermite(i, xi, h, d) for i in range(4)], axis=-1) for d in range(4)]

    def fields(self, q: Array, v: Array) -> dict[str, Array]:
        """Return the fields, each (n_times, n_points), from degrees of freedom and rates, each (size, n_times)."""
        eta, slope, curvature, third = (self._derivative(q, d) for d in range(4))
        shear = self.stiffness * third + self.change * curvature
        fields = {
            "eta": eta,
            "velocity": self._derivative(v, 0),
            "slope": slope,
            "bending_moment": self.stiffness * curvature,
            "shear_force": shear,
        }
        return {name: values.reshape(values.shape[0], -1) for name, values in fields.items()}

    def _derivative(self, q: Array, d: int) -> Array:
        """Return a derivative, shape (n_times, n_elements, per_element)."""
        # The four degrees of freedom of every element: a view of shape (n_times, n_elements, 4).
        local = np.lib.stride_tricks.sliding_window_view(np.ascontiguousarray(q.T), 4, axis=1)[:, ::2]
        return np.einsum("tei,epi->tep", local, self.weights[d])


class _LinePoints:
    """The points of a line that is no beam: the two ends of every piece between neighbouring places of its shape."""

    def __init__(self, body: Body) -> None:
        self.body = body
        shape = body.shape
        self.x = np.stack([shape.x[:-1], shape.x[1:]], axis=1)
        self._matrices = {"eta": shape.rows, **{_plain_name(name): rows for name, rows in body.sections().items()}}

    def fields(self, q: Array, v: Array) -> dict[str, Array]:
        """Return the fields, each (n_times, n_points), from degrees of freedom and rates, each (size, n_times)."""
        fields = {name: self._spread(matrix @ q) for name, matrix in self._matrices.items()}
        return {**fields, "velocity": self._spread(self._matrices["eta"] @ v)}

    @staticmethod
    def _spread(values: Array) -> Array:
        """Return values at places, shape (k, n_times), at the ends of all pieces."""
        return np.stack([values[:-1], values[1:]], axis=1).reshape(-1, values.shape[1]).T


def _plain_name(name: str) -> str:
    """Return the name of a section quantity without its unit, as fields have it."""
    return name.partition("[")[0].strip().replace(" ", "_")


class Grid:
    """Points and cells of a scene, and the fields on them.

    The points of beams come first, then masses, then the two ends of every
    contact, then the two ends of every stop's bar.

    Parameters
    ----------
    result : Result
    placement : Placement
    points_per_element : int

    Attributes
    ----------
    points : ndarray, shape (n_points, 3)
        Places at rest in m.
    cells : Cells
    point_data, cell_data : dict of str to ndarray
        Arrays that do not change in time.
    """

    def __init__(self, result: Result, placement: Placement, points_per_element: int) -> None:
        self._result = result
        bodies = result.scene.bodies
        self._beams: list[_BeamPoints | _LinePoints] = [
            _BeamPoints(body, points_per_element) if isinstance(body, Beam) else _LinePoints(body)
            for body in bodies
            if body.shape.kind == "line"
        ]
        self._masses = [body for body in bodies if body.shape.kind == "block"]
        self._sections = sorted({_plain_name(name) for body in bodies for name in body.sections()})
        self._touches = placement.touches
        stops = [touch for touch in self._touches if touch.b is None]

        points: list[Array] = []
        own: list[Array] = []
        for beam in self._beams:
            x = beam.x.ravel()
            points.append(placement.origins[beam.body] + np.stack([x, 0 * x, 0 * x], axis=1))
            own.append(x)
        points.extend(placement.origins[mass][None, :] for mass in self._masses)
        for touch in self._touches:
            points.append(np.stack([touch.a.place, touch.stop if touch.b is None else touch.b.place]))
        for touch in stops:
            up = touch.a.body.shape.direction
            across = placement.half_stop * np.array([up[1], -up[0], 0.0])
            points.append(np.stack([touch.stop - across, touch.stop + across]))
        self.points = np.concatenate(points)
        self._beam_points = sum(x.size for x in own)
        rest = self.points.shape[0] - self._beam_points
        self.point_data = {"x": np.concatenate([*own, np.full(rest, np.nan)])}

        counts = [beam.x.shape[0] * (beam.x.shape[1] - 1) for beam in self._beams]
        numbers = {body: k for k, body in enumerate(bodies)}
        shown = [*self._touches, *stops]
        self._contact = np.array([touch.index for touch in shown], dtype=np.int64)
        self.cells = _cells([beam.x.shape for beam in self._beams], len(self._masses), len(shown))
        groups = (sum(counts), len(self._masses), len(self._touches), len(stops))
        none = np.full(sum(groups[:2]), -1)
        of_body = np.concatenate(
            [
                np.repeat([numbers[beam.body] for beam in self._beams], counts),
                [numbers[mass] for mass in self._masses],
                [numbers[touch.a.body] for touch in shown],
            ]
        )
        elements = [np.repeat(np.arange(beam.x.shape[0]), beam.x.shape[1] - 1) for beam in self._beams]
        self.cell_data = {
            "body": of_body.astype(np.int32),
            "kind": np.repeat([BEAM, MASS, CONTACT, STOP], groups).astype(np.int32),
            "element": np.concatenate([*elements, np.full(sum(groups[1:]), -1)]).astype(np.int32),
            "contact": np.concatenate([none, self._contact]).astype(np.int32),
        }

    def frames(self, times: Array) -> Frames:
        """Return the fields at some times."""
        model = self._result.model
        samples = self._result.solution.sample(times)
        q = {body: model.of_body(body, samples.q) for body in self._result.scene.bodies}
        v = {body: model.of_body(body, samples.v) for body in self._result.scene.bodies}
        shape = (times.size, self.points.shape[0])
        data = {name: np.full(shape, np.nan) for name in ("slope", "bending_moment", "shear_force", *self._sections)}
        data |= {name: np.zeros(shape) for name in ("eta", "velocity")}
        upward = np.tile([0.0, 1.0], (shape[1], 1))
        at = 0
        for beam in self._beams:
            part = slice(at, at + beam.x.size)
            upward[part] = beam.body.shape.direction
            for name, values in beam.fields(q[beam.body], v[beam.body]).items():
                data[name][:, part] = values
            at = part.stop
        for k, mass in enumerate(self._masses):
            rows = mass.shape.rows
            upward[at + k] = mass.shape.direction
            data["eta"][:, at + k], data["velocity"][:, at + k] = (rows @ q[mass])[0], (rows @ v[mass])[0]
        at += len(self._masses)
        for k, touch in enumerate(self._touches):
            for end, foot in enumerate((touch.a, touch.b)):
                if foot is not None:
                    upward[at + 2 * k + end] = foot.body.shape.direction
                    data["eta"][:, at + 2 * k + end] = _of(foot.row, q[foot.body])
                    data["velocity"][:, at + 2 * k + end] = _of(foot.row, v[foot.body])
        deflection = np.zeros((*shape, 3))
        deflection[:, :, :2] = data["eta"][:, :, None] * upward
        return Frames({"deflection": deflection, **data}, self._contact_data(times))

    def _contact_data(self, times: Array) -> dict[str, NDArray]:
        """Return state, force and stiffness: -1 or NaN on cells that are no contact."""
        shape = (times.size, self.cells.types.size)
        state = np.full(shape, -1, dtype=np.int32)
        force, stiffness = np.full(shape, np.nan), np.full(shape, np.nan)
        if self._contact.size:
            samples = self._result.solution.contacts(times)
            first = shape[1] - self._contact.size
            state[:, first:] = samples.status[self._contact].T
            force[:, first:] = samples.force[self._contact].T
            stiffness[:, first:] = samples.stiffness[self._contact].T
        return {"contact_state": state, "contact_force": force, "contact_stiffness": stiffness}

    @property
    def bytes_per_frame(self) -> int:
        """Approximate memory of the fields of one frame."""
        bodies: tuple[Body, ...] = self._result.scene.bodies
        return 8 * (20 * self.points.shape[0] + 6 * sum(body.size for body in bodies))


def _of(row: Row, values: Array) -> Array:
    return np.asarray(row.weights @ values[row.indices])


def _cells(beams: list[tuple[int, ...]], masses: int, lines: int) -> Cells:
    """Return lines along each element, vertices, and lines of two points each.

    Parameters
    ----------
    beams : list of (n_elements, points_per_element)
    """
    along: list[NDArray[np.int64]] = [np.empty((0, 2), dtype=np.int64)]
    at = 0
    for elements, per_element in beams:
        number = at + np.arange(elements * per_element).reshape(elements, per_element)
        along.append(np.stack([number[:, :-1], number[:, 1:]], axis=-1).reshape(-1, 2))
        at += number.size
    blocks = (
        ("line", np.concatenate(along)),
        ("vertex", at + np.arange(masses)[:, None]),
        ("line", at + masses + np.arange(2 * lines).reshape(lines, 2)),
    )
    return Cells(tuple((kind, points) for kind, points in blocks if points.size))
