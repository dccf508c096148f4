"""Frames of a run: points and cells in space, and the fields on them at some times, as ParaView and pyvista show them.

The x axis runs along the beams, and y points upward like the displacement. Every body has a plane of its own, whose z
is its number in the scene times a spacing. Bodies are thus separate in space and coincide in the side view. If an
effect connects a body with one that is already placed, the two points get the same x, and b is placed above a by the
gap. In the side view they touch when the gap closes. Bodies that are tied by a joint share a plane.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem._validate import number
from vofem.arrays import Array, IntArray
from vofem.assembly.triplets import stacked
from vofem.bodies import Beam
from vofem.bodies.base import Body, Row
from vofem.bodies.cubics import hermite, rows_on_elements
from vofem.bodies.path import TravellingPoint
from vofem.effects import Joint
from vofem.errors import ArgumentError
from vofem.io.pictures.places import all_contacts, linked
from vofem.result import Result
from vofem.scene import Scene

#: The cell data `kind`.
BEAM, MASS, CONTACT, STOP = range(4)

#: VTK's numbers of cell types.
_VERTEX, _LINE = 1, 3

#: Of the size of the scene: distance of the planes, half the width of a stop.
_SPACING, _STOP = 0.1, 0.02

#: Just left of a node, where a beam is asked for EI on the element that ends there: at the node it gives the next.
_INSIDE = 1.0 - 1e-8

#: Memory for the fields of the frames that are evaluated together.
_BLOCK_BYTES = 8_000_000


class Frames:
    """Points and cells of a scene at rest, and the fields of a run on them.

    The points of lines come first, then masses, then the two ends of every contact, then the two ends of every stop's
    bar. Every element of a beam has its own points, its two ends among them.

    `magnification`: by which gaps are drawn larger.
    `points_per_element`: 2 or more.
    `points` (shape (n_points, 3)): places at rest in m.
    `connectivity`, `offsets`, `types`: the points of all cells, one cell after another; where each cell begins, and the
    end; VTK's types of the cells.
    `point_data`, `cell_data`: arrays that do not change in time.
    """

    def __init__(self, result: Result, magnification: float = 1.0, points_per_element: int = 5) -> None:
        self._result, scene = result, result.scene
        self.magnification = number("magnification", magnification, positive=True)
        if not isinstance(points_per_element, (int, np.integer)) or not 2 <= points_per_element <= 1000:
            raise ArgumentError(f"points_per_element is {points_per_element!r}, expected 2 to 1000")
        size, origins = _placed(scene, self.magnification)
        #: Of every body with points: these points, and the matrices that take degrees of freedom to its fields.
        self._parts: list[tuple[IntArray, Body, dict[str, Any]]] = []
        places: list[Array] = []
        own: list[Array] = []
        cells: list[tuple[IntArray, Array]] = []
        numbers = {body: k for k, body in enumerate(scene.bodies)}

        def add(at: Array, body: Body | None = None, rows: dict[str, Any] | None = None, x: Any = np.nan) -> IntArray:
            """Add points at places of shape (k, 3), and return their numbers."""
            new = sum(map(len, places)) + np.arange(len(at))
            places.append(at)
            own.append(np.broadcast_to(x, new.shape))
            if body is not None:
                self._parts.append((new, body, rows or {}))
            return new

        def connect(points: IntArray, kind: int, body: Body, element: Any = -1, contact: int = -1) -> None:
            """Add cells of points of shape (n_cells, 1 or 2)."""
            told = np.broadcast_arrays(kind, numbers[body], element, contact, np.zeros(len(points)))[:4]
            cells.append((points, np.stack(told)))

        for body in (body for body in scene.bodies if body.shape.kind == "line"):
            x, rows = _of_beam(body, int(points_per_element)) if isinstance(body, Beam) else _of_line(body)
            along = np.stack([x.ravel(), 0.0 * x.ravel(), 0.0 * x.ravel()], axis=1)
            new = add(origins[body] + along, body, rows, x.ravel()).reshape(x.shape)
            pairs = np.stack([new[:, :-1], new[:, 1:]], axis=-1).reshape(-1, 2)
            connect(pairs, BEAM, body, np.repeat(np.arange(x.shape[0]), x.shape[1] - 1))
        for body in (body for body in scene.bodies if body.shape.kind == "block"):
            connect(add(origins[body][None, :], body, {"eta": body.shape.rows})[:, None], MASS, body)
        laws = scene.model.system.contacts
        # A grid has the same points at all times, so contacts that travel are left out.
        known = {c.name: c for c in all_contacts(scene) if not isinstance(c.a, TravellingPoint)}
        shown = [(k, known[name]) for k, name in enumerate(() if laws is None else laws.names) if name in known]
        stops = []
        #: Of the points of stops: the number of the contact, these points, and the direction away from the body.
        self._stops: list[tuple[int, IntArray, Array]] = []
        feet: dict[Body, list[tuple[IntArray, Row]]] = {}
        for k, contact in shown:
            ends = []
            for point in contact.points():
                at = origins[point.body] + np.array([point.x, 0.0, 0.0])
                ends.append(add(at[None, :]))
                feet.setdefault(point.body, []).append((ends[-1], point.row()))
            if contact.b is None:
                up = np.array([*contact.a.body.shape.direction, 0.0])
                face = up if contact.side == "above" else -up
                foot = at + self.magnification * _gap(contact) * face
                ends.append(add(foot[None, :]))
                self._stops.append((k, ends[-1], face))
                stops.append((k, contact, foot, face, _STOP * size * np.array([up[1], -up[0], 0.0])))
            connect(np.stack(ends, axis=1), CONTACT, contact.a.body, contact=k)
        for body, listed in feet.items():
            matrix = stacked([row for _, row in listed], body.size)
            self._parts.append((np.concatenate([points for points, _ in listed]), body, {"eta": matrix}))
        for k, contact, at, face, across in stops:
            self._stops.append((k, add(np.stack([at - across, at + across])), face))
            connect(self._stops[-1][1][None, :], STOP, contact.a.body, contact=k)

        self.points = np.concatenate(places)
        self.connectivity = np.concatenate([points.ravel() for points, _ in cells])
        counts = np.concatenate([np.full(*points.shape) for points, _ in cells])
        self.offsets = np.concatenate([[0], np.cumsum(counts)])
        self.types = np.where(counts == 1, _VERTEX, _LINE).astype(np.uint8)
        told = np.concatenate([values for _, values in cells], axis=1).astype(np.int32)
        self.point_data = {"x": np.concatenate(own)}
        self.cell_data = dict(zip(("kind", "body", "element", "contact"), told, strict=True))

    def fields(self, times: Array) -> tuple[dict[str, Array], dict[str, NDArray]]:
        """Return point data, shape (n_times, n_points) or (n_times, n_points, 3), and cell data (n_times, n_cells)."""
        model, bodies = self._result.model, self._result.scene.bodies
        samples = self._result.solution.sample(times)
        shape = (times.size, self.points.shape[0])
        names = {"slope", "bending_moment", "shear_force"}.union(*(rows for _, _, rows in self._parts))
        data = {name: np.full(shape, np.nan) for name in sorted(names)}
        data |= {name: np.zeros(shape) for name in ("eta", "velocity")}
        deflection = np.zeros((*shape, 3))
        q, v = ({body: model.of_body(body, part) for body in bodies} for part in (samples.q, samples.v))
        for points, body, rows in self._parts:
            for name, matrix in rows.items():
                data[name][:, points] = (matrix @ q[body]).T
            data["velocity"][:, points] = (rows["eta"] @ v[body]).T
            deflection[:, points, :2] = data["eta"][:, points, None] * np.array(body.shape.direction)
        laws = model.system.contacts
        for k, points, face in self._stops:
            assert laws is not None
            deflection[:, points] = (laws.gaps(k, times) - laws.gap[k])[:, None, None] * face
        return {"deflection": deflection, **data}, self._contact_data(times)

    def _contact_data(self, times: Array) -> dict[str, NDArray]:
        """Return state, force and stiffness: -1 or NaN on cells that are no contact."""
        shape, number = (times.size, self.types.size), self.cell_data["contact"]
        state = np.full(shape, -1, dtype=np.int32)
        force, stiffness = np.full(shape, np.nan), np.full(shape, np.nan)
        held = np.flatnonzero(number >= 0)
        if held.size:
            samples = self._result.solution.contacts(times)
            for values, found in ((state, samples.status), (force, samples.force), (stiffness, samples.stiffness)):
                values[:, held] = found[number[held]].T
        return {"contact_state": state, "contact_force": force, "contact_stiffness": stiffness}

    def blocks(self, times: Array) -> Iterator[tuple[slice, dict[str, Array], dict[str, NDArray]]]:
        """Yield the fields at some of the times together, as many as a bounded memory holds, and which times."""
        each = 8 * (20 * self.points.shape[0] + 6 * sum(body.size for body in self._result.scene.bodies))
        count = max(1, _BLOCK_BYTES // each)
        for start in range(0, times.size, count):
            part = slice(start, min(start + count, times.size))
            yield part, *self.fields(times[part])

    def over(self, times: Array) -> Iterator[Any]:
        """Yield the frames at some times in s, each a `pyvista.UnstructuredGrid`; see `vofem.Result.frame`."""
        import pyvista

        counted = np.insert(self.connectivity, self.offsets[:-1], np.diff(self.offsets))
        for part, point_data, cell_data in self.blocks(times):
            for k, t in enumerate(times[part].tolist()):
                mesh = pyvista.UnstructuredGrid(counted, self.types, self.points.copy())
                mesh.point_data.update(self.point_data | {name: values[k] for name, values in point_data.items()})
                mesh.cell_data.update(self.cell_data | {name: values[k] for name, values in cell_data.items()})
                mesh.field_data.update({"TimeValue": [t], "magnification": [self.magnification]})
                yield mesh

    def at(self, t: float) -> Any:
        """Return the frame at time t in s."""
        return next(self.over(np.array([t])))


def _of_beam(beam: Beam, per_element: int) -> tuple[Array, dict[str, Any]]:
    """Return the x of points, shape (n_elements, per_element), and the matrices of their fields."""
    h = beam.element_lengths[:, None]
    xi = np.linspace(0.0, 1.0, per_element)
    x = beam.nodes[:-1, None] + xi * h
    x[:, -1] = beam.nodes[1:]
    stiffness, change = (
        part.reshape(x.shape).copy()
        for part in beam.bending_stiffness((beam.nodes[:-1, None] + np.minimum(xi, _INSIDE) * h).ravel())
    )
    stiffness[:, -1] += change[:, -1] * (1.0 - _INSIDE) * h[:, 0]
    # Of each point, because at a node a beam itself takes the element to the right.
    weights = [np.stack([hermite(i, xi, h, d) for i in range(4)], axis=-1) for d in range(4)]
    fields = {
        "eta": weights[0],
        "slope": weights[1],
        "bending_moment": stiffness[:, :, None] * weights[2],
        "shear_force": stiffness[:, :, None] * weights[3] + change[:, :, None] * weights[2],
    }
    return x, {name: rows_on_elements(part) for name, part in fields.items()}


def _of_line(body: Body) -> tuple[Array, dict[str, Any]]:
    """Return the x of the ends of every piece between places of a line, shape (n, 2), and the matrices of fields."""
    shape = body.shape
    ends = np.stack([np.arange(shape.x.size - 1), np.arange(1, shape.x.size)], axis=1)
    found = {name.partition("[")[0].strip().replace(" ", "_"): rows for name, rows in body.sections().items()}
    return shape.x[ends], {name: rows[ends.ravel()] for name, rows in {"eta": shape.rows, **found}.items()}


def _placed(scene: Scene, magnification: float) -> tuple[float, dict[Body, Array]]:
    """Return the size of a scene in m, and where x = 0 of each body is at rest, shape (3,)."""
    lengths = [float(np.ptp(body.shape.x)) for body in scene.bodies]
    gaps = [abs(magnification * _gap(contact)) for contact in scene.contacts]
    size = max(lengths, default=0.0) or max(gaps, default=0.0) or 1.0
    origins = {body: np.array([0.0, 0.0, k * _SPACING * size]) for k, body in enumerate(scene.bodies)}
    pairs = [effect for effect in scene.effects if len(effect.points()) == 2]
    # Joints first: what is tied stands where it is tied.
    pairs.sort(key=lambda effect: not isinstance(effect, Joint))
    points = [effect.points() for effect in pairs]
    for body, here, there, k in linked(scene.bodies, points):
        if here is None:
            continue
        before, up = origins[here.body], magnification * _gap(pairs[k])
        origins[body][:2] = before[0] + here.x - there.x, before[1] + (up if there is points[k][1] else -up)
        if isinstance(pairs[k], Joint):
            origins[body][2] = before[2]
    return size, origins


def _gap(effect: Any) -> float:
    """Return the gap of an effect in m; 0 where it is one of rotations."""
    return float(getattr(effect, "gap", 0.0)) if getattr(effect, "of", "displacement") == "displacement" else 0.0
