"""The derivative of a system by a parameter: matrices, rows, gaps and load vectors of the scene, assembled again.

Most numbers enter linearly, so that one difference over a large step is exact to rounding; it goes upward, so that it
exists at the limits of a number too. Lengths and places enter as low powers, for which a difference of order eight is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from vofem.arrays import Array
from vofem.bodies import Point
from vofem.errors import ArgumentError
from vofem.lookup import rows_over
from vofem.scene import Scene
from vofem.sensitivities.change import INITIAL, PLACES, function_at, moved_point, point_of
from vofem.sensitivities.parameter import Parameter
from vofem.sharing import sharing_between_scenes
from vofem.system import same_matrix

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix, csr_matrix


#: Weights of a central difference of order eight, at steps -4 to 4.
_CENTRAL = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
#: Weights of a forward difference that is exact for polynomials of degree eight, at steps 0 to 8.
_FORWARD = np.array([-761 / 280, 8.0, -14.0, 56 / 3, -35 / 2, 56 / 5, -14 / 3, 8 / 7, -1 / 8])

#: Relative step for lengths: with the power -3 of an element's length both errors of a difference are below 1e-13.
_RELATIVE = 0.005

#: A step over which the largest change is this share of the entries that change keeps their digits.
_LARGE = 0.25


@dataclass(frozen=True)
class SystemChange:
    """The derivative of a system by a parameter; None where nothing changes."""

    #: `mass`, `stiffness`, `damping`: shape (n, n).
    mass: csc_matrix | None
    stiffness: csc_matrix | None
    damping: csc_matrix | None
    rayleigh: Array  #: Shape (2,).
    modal_damping: Array  #: Of the ratios, all of which change by the same amount, shape ().
    rows: csr_matrix | None  #: Shape (n_contacts, n).
    #: `gap`, `contact_stiffness`, `contact_damping`, `restitution`: shape (n_contacts,).
    gap: Array
    contact_stiffness: Array
    contact_damping: Array
    restitution: Array
    vectors: Array  #: Of the load vectors, shape (n_loads, n).
    #: `displacement`, `velocity`: of the initial state, shape (n,).
    displacement: Array
    velocity: Array
    #: For every load whose function of time holds the parameter, the path to the number.
    functions: dict[int, tuple[str, ...]]
    points: Callable[[Sequence[Any]], Any]  #: Returns the derivative of the rows of points, csr_matrix (k, n), or None.
    assemblies: int  #: How often the scene was assembled.

    @cached_property
    def moves_matrices(self) -> bool:
        """Whether mass, stiffness or damping outside of contacts change."""
        parts = (self.mass, self.stiffness, self.damping)
        return any(part is not None for part in parts) or bool(np.any(self.rayleigh) or self.modal_damping)


def system_changes(scene: Scene, parameters: Sequence[Parameter]) -> list[SystemChange]:
    """Return the derivatives of the system of a scene by parameters."""
    with sharing_between_scenes():
        known = _of_elements(scene, parameters)
        return [known[k] if k in known else _of_targets(scene, one) for k, one in enumerate(parameters)]


def _of_elements(scene: Scene, parameters: Sequence[Parameter]) -> dict[int, SystemChange]:
    """Return the derivatives by single elements of beams, by number of the parameter.

    Elements that share no node are changed together, and what changes is divided among them: two assemblies do for a
    beam. Joints may eliminate degrees of freedom; then nothing is divided.
    """
    groups: dict[tuple[Any, str, int], dict[int, int]] = {}
    for k, one in enumerate(parameters):
        if one.elements is not None and len(one.elements) == 1 and len(one.targets) == 1:
            (beam,), (element,) = one.found(scene), one.elements
            groups.setdefault((beam, one.field, element % 2), {})[k] = element
    model, found = scene.model, {}
    for (beam, field, _), numbers in groups.items():
        elements = sorted(set(numbers.values()))
        if len(elements) == 1 or model.transform is not None:
            continue
        whole = _of_targets(scene, Parameter(beam, field, element=elements))
        if whole.damping is not None or whole.rows is not None:
            continue
        parts = {}
        for place, element in enumerate(elements):
            first = model.offsets[beam] + 2 * element
            inside = ((model.free >= first) & (model.free < first + 4)).astype(float)
            matrices = [None if m is None else m.multiply(inside).multiply(inside[:, None]).tocsc()
                        for m in (whole.mass, whole.stiffness)]  # fmt: skip
            parts[element] = replace(
                whole, mass=matrices[0], stiffness=matrices[1], vectors=whole.vectors * inside,
                assemblies=whole.assemblies if place == 0 else 0,
            )  # fmt: skip
        found.update({k: parts[element] for k, element in numbers.items()})
    return found


def _of_targets(scene: Scene, parameter: Parameter) -> SystemChange:
    """Return the derivative by a parameter, the sum over its targets."""
    total: SystemChange | None = None
    for target in parameter.found(scene):
        single = Parameter(target, parameter.field, element=parameter.elements)
        change = _change(scene, single, target)
        total = change if total is None else _sum(total, change)
    assert total is not None
    return total


def _change(scene: Scene, parameter: Parameter, target: Any) -> SystemChange:
    if (known := function_at(target, parameter.field)) is not None:
        return _of_function(scene, parameter, known[3])
    value, field = parameter.value(scene), parameter.field
    if field in INITIAL:
        return _difference(scene, parameter, [0.0, 1.0], np.array([-1.0, 1.0]))
    if field == "length":
        step = _RELATIVE * value
        return _difference(scene, parameter, [k * step for k in range(-4, 5)], _CENTRAL / step)
    if field == "restitution":
        step = -value if value > 0.5 else 1.0 - value
        return _difference(scene, parameter, [0.0, step], np.array([-1.0, 1.0]) / step)
    if field in PLACES:
        step = _room(target, field) / 8.0
        return _difference(scene, parameter, [k * step for k in range(9)], _FORWARD / step)
    largest = float(np.max(np.abs(np.asarray(getattr(target, field), dtype=float)))) or 1.0
    return _difference(scene, parameter, [0.0, largest], np.array([-1.0, 1.0]) / largest, enlarge=True)


def _room(target: Any, field: str) -> float:
    """Return how far a point can move within its element, with the sign of the direction, m."""
    point = getattr(target, point_of(target, field))
    beam, x = point.body, point.x
    nodes = beam.nodes
    right = int(np.searchsorted(nodes, x, side="right"))
    up = nodes[right] - x if right < nodes.size else 0.0
    left = int(np.searchsorted(nodes, x, side="left")) - 1
    down = x - nodes[left] if left >= 0 else 0.0
    return float(up if up >= down else -down) * 0.9


def _difference(
    scene: Scene, parameter: Parameter, steps: Sequence[float], weights: Array, enlarge: bool = False
) -> SystemChange:
    """Return the weighted sum over the systems of changed scenes."""
    scenes = [scene if step == 0.0 else parameter.changed(scene, step) for step in steps]
    if any(not np.array_equal(one.model.free, scene.model.free) for one in scenes):
        raise ArgumentError(f"{parameter.describe()}: the degrees of freedom themselves change with it")
    known = [_numbers(one) for one in scenes]
    if enlarge and (share := _share(*known)) < _LARGE:
        # The equations are linear, so any step is exact; a large one leaves more digits in the difference.
        factor = 2.0 ** np.ceil(np.log2(_LARGE / share))
        return _difference(scene, parameter, [0.0, factor * steps[1]], weights / factor)

    def points(given: Sequence[Any]) -> Any:
        return _combined([rows_over(one.model, one.bodies, [carried(scene, one, point) for point in given])
                          for one in scenes], weights)  # fmt: skip

    return SystemChange(
        **{name: _combined([one[name] for one in known], weights) for name in known[0]},
        functions={}, points=points, assemblies=sum(one is not scene for one in scenes),
    )  # fmt: skip


def _numbers(scene: Scene) -> dict[str, Any]:
    """Return the numbers of the system of a scene by the names of their derivatives."""
    system, state, none = scene.model.system, scene.initial_state(), np.zeros(0)
    laws = system.contacts
    ratio = 0.0 if system.modal_damping is None else float(np.atleast_1d(system.modal_damping)[0])
    return {
        "mass": system.mass, "stiffness": system.stiffness, "damping": system.damping,
        "rayleigh": np.array(system.rayleigh or (0.0, 0.0)), "modal_damping": np.array(ratio),
        "rows": None if laws is None else laws.rows, "gap": none if laws is None else laws.gap,
        "contact_stiffness": none if laws is None else laws.stiffness,
        "contact_damping": none if laws is None else laws.damping,
        "restitution": none if laws is None else np.nan_to_num(laws.restitution),
        "vectors": np.array([load.vector for load in system.loads]).reshape(-1, system.size),
        "displacement": state.q, "velocity": state.v,
    }  # fmt: skip


def _of_function(scene: Scene, parameter: Parameter, path: tuple[str, ...]) -> SystemChange:
    """Return the derivative by a number of a function of time, which changes nothing but this function."""
    # Large enough to change any of the numbers.
    changed = parameter.changed(scene, max(1.0, abs(parameter.value(scene)))).model.system
    system = scene.model.system
    touched = {k: path for k, (a, b) in enumerate(zip(system.loads, changed.loads, strict=True))
               if a.function != b.function}  # fmt: skip
    return replace(unchanged(scene), functions=touched, assemblies=1)


def unchanged(scene: Scene) -> SystemChange:
    """Return the derivative by a number that does not enter the system of a scene."""
    none = {name: _combined([value], np.zeros(1)) for name, value in _numbers(scene).items()}
    return SystemChange(**none, functions={}, points=lambda given: None, assemblies=0)


def carried(scene: Scene, other: Scene, point: Any) -> Any:
    """Return a point in a scene whose beams may be longer: at the same fraction of its beam."""
    if isinstance(point, str):  # the name of a mass, by which either scene knows it
        return point
    for body, new in zip(scene.bodies, other.bodies, strict=True):
        if body.name == getattr(point.body, "name", None):
            if isinstance(new, Point):
                return new
            return point if body is new else moved_point(body.at(point.x), new, _stretch(body, new))
    return point


def _stretch(body: Any, new: Any) -> float:
    return float(new.length / body.length) if hasattr(body, "length") else 1.0


def _share(one: dict[str, Any], two: dict[str, Any]) -> float:
    """Return the smallest change of a kind of numbers relative to the entries that change, of the kinds that do."""
    shares = []
    for name in (
        "mass",
        "stiffness",
        "damping",
        "gap",
        "contact_stiffness",
        "contact_damping",
        "restitution",
        "vectors",
    ):
        a, b = one[name], two[name]
        if a is None or b is None:
            continue
        difference = abs(b - a)
        moved = difference > 0.0
        entries = abs(a)[moved] if isinstance(a, np.ndarray) else abs(a).multiply(moved)
        largest = float(entries.max()) if entries.shape[0] else 0.0
        if largest > 0.0:
            shares.append(float(difference.max()) / largest)
    return min(shares, default=1.0)


def _combined(parts: Sequence[Any], weights: Array) -> Any:
    """Return the weighted sum of arrays, or of sparse matrices, each of which may be missing; None where all are equal.

    Weights of a difference sum up to zero, so that what is the same everywhere drops out exactly.
    """
    if isinstance(parts[0], np.ndarray):
        total = np.zeros_like(parts[0], dtype=float)
        for part, weight in zip(parts[1:], weights[1:], strict=True):
            total = total + weight * (part - parts[0])
        return np.asarray(total)
    if all(same_matrix(parts[0], part) for part in parts[1:]):
        return None
    from scipy.sparse import csc_matrix

    blank = csc_matrix(next(part.shape for part in parts if part is not None))
    base, total = blank if parts[0] is None else parts[0], blank
    for part, weight in zip(parts[1:], weights[1:], strict=True):
        total = total + weight * ((blank if part is None else part) - base)
    total = total.tocsc()
    total.eliminate_zeros()
    return total if total.nnz else None


def _sum(one: SystemChange, two: SystemChange) -> SystemChange:
    """Return the sum of two derivatives: linked numbers change together."""

    def added(a: Any, b: Any) -> Any:
        return a if b is None else b if a is None else a + b

    numbers = {part.name: added(getattr(one, part.name), getattr(two, part.name)) for part in fields(one)
               if part.name not in ("functions", "points")}  # fmt: skip
    return SystemChange(
        **numbers, functions={**one.functions, **two.functions},
        points=lambda given: added(one.points(given), two.points(given)),
    )  # fmt: skip
