"""The derivative of a system by a parameter: matrices, rows, gaps and load vectors of the scene, assembled again.

Most numbers enter linearly, so that one difference over a large step is exact to rounding; it goes upward, so that it
exists at the limits of a number too. Lengths and places enter as low powers, for which a difference of order eight is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from vofem.bodies import Point
from vofem.errors import ArgumentError
from vofem.lookup import rows_over
from vofem.scene import Scene
from vofem.sensitivities.change import INITIAL, PLACES, function_at, moved_point, point_of
from vofem.sensitivities.parameter import Parameter
from vofem.sharing import sharing_between_scenes
from vofem.system import System, same_matrix

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix, csr_matrix

Array = NDArray[np.float64]
T = TypeVar("T")

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
    """The derivative of a system by a parameter; None where nothing changes.

    Attributes
    ----------
    mass, stiffness, damping : csc_matrix, shape (n, n), optional
    rayleigh : (float, float)
    modal_damping : float
        Of the ratios, all of which change by the same amount.
    rows : csr_matrix, shape (n_contacts, n), optional
    gap, contact_stiffness, contact_damping : ndarray, shape (n_contacts,)
    vectors : tuple of ndarray, each (n,)
        Of the load vectors.
    displacement, velocity : ndarray, shape (n,)
        Of the initial state.
    functions : dict of int to (str, ...)
        For every load whose function of time holds the parameter, the path to the number.
    points : callable
        Returns the derivative of the rows of points, csr_matrix (k, n), or None.
    assemblies : int
        How often the scene was assembled.
    """

    mass: csc_matrix | None
    stiffness: csc_matrix | None
    damping: csc_matrix | None
    rayleigh: tuple[float, float]
    modal_damping: float
    rows: csr_matrix | None
    gap: Array
    contact_stiffness: Array
    contact_damping: Array
    vectors: tuple[Array, ...]
    displacement: Array
    velocity: Array
    functions: dict[int, tuple[str, ...]]
    points: Callable[[Sequence[Any]], Any]
    assemblies: int

    @cached_property
    def moves_matrices(self) -> bool:
        """Whether mass, stiffness or damping outside of contacts change."""
        parts = (self.mass, self.stiffness, self.damping)
        return any(part is not None for part in parts) or any(self.rayleigh) or self.modal_damping != 0.0


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
                whole, mass=matrices[0], stiffness=matrices[1], vectors=tuple(v * inside for v in whole.vectors),
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
    systems = [one.model.system for one in scenes]
    base = scene.model
    if any(not np.array_equal(one.model.free, base.free) for one in scenes):
        raise ArgumentError(f"{parameter.describe()}: the degrees of freedom themselves change with it")
    if enlarge and (share := _share(systems[0], systems[1])) < _LARGE:
        # The equations are linear, so any step is exact; a large one leaves more digits in the difference.
        factor = 2.0 ** np.ceil(np.log2(_LARGE / share))
        return _difference(scene, parameter, [0.0, factor * steps[1]], weights / factor)
    states = [one.initial_state() for one in scenes]

    def combined(pick: Callable[[System], Any]) -> Any:
        return _combined([pick(system) for system in systems], weights)

    def points(given: Sequence[Any]) -> Any:
        return _combined([rows_over(one.model, one.bodies, [carried(scene, one, point) for point in given])
                          for one in scenes], weights)  # fmt: skip

    laws = [system.contacts for system in systems]
    gap = stiffness = damping = np.zeros(0)
    rows = None
    if laws[0] is not None:
        gap, stiffness, damping = (
            _plain([getattr(law, name) for law in laws], weights) for name in ("gap", "stiffness", "damping")
        )
        rows = _combined([law.rows for law in laws if law is not None], weights)
    rayleigh = _plain([np.array(system.rayleigh or (0.0, 0.0)) for system in systems], weights)
    ratio = [np.atleast_1d(system.modal_damping if system.modal_damping is not None else 0.0) for system in systems]
    count = len(systems[0].loads)
    return SystemChange(
        mass=combined(lambda s: s.mass),
        stiffness=combined(lambda s: s.stiffness),
        damping=combined(lambda s: s.damping),
        rayleigh=(float(rayleigh[0]), float(rayleigh[1])),
        modal_damping=float(_plain(ratio, weights)[0]),
        rows=rows,
        gap=gap,
        contact_stiffness=stiffness,
        contact_damping=damping,
        vectors=tuple(_plain([s.loads[k].vector for s in systems], weights) for k in range(count)),
        displacement=_plain([state.q for state in states], weights),
        velocity=_plain([state.v for state in states], weights),
        functions={},
        points=points,
        assemblies=sum(one is not scene for one in scenes),
    )


def _of_function(scene: Scene, parameter: Parameter, path: tuple[str, ...]) -> SystemChange:
    """Return the derivative by a number of a function of time, which changes nothing but this function."""
    changed = parameter.changed(scene, 1.0).model.system
    system = scene.model.system
    touched = {k: path for k, (a, b) in enumerate(zip(system.loads, changed.loads, strict=True))
               if a.function != b.function}  # fmt: skip
    return unchanged(system, functions=touched)


def unchanged(
    system: System,
    displacement: Array | None = None,
    velocity: Array | None = None,
    functions: dict[int, tuple[str, ...]] | None = None,
) -> SystemChange:
    """Return the derivative by a number that enters the initial state, or functions of time, and nothing else."""
    n, contacts = system.size, 0 if system.contacts is None else len(system.contacts)
    none, blank = np.zeros(contacts), np.zeros(n)
    return SystemChange(
        None, None, None, (0.0, 0.0), 0.0, None, none, none, none, tuple(blank for _ in system.loads),
        blank if displacement is None else displacement, blank if velocity is None else velocity, functions or {},
        lambda given: None, 0 if functions is None else 1,
    )  # fmt: skip


def carried(scene: Scene, other: Scene, point: Any) -> Any:
    """Return a point in a scene whose beams may be longer: at the same fraction of its beam."""
    for body, new in zip(scene.bodies, other.bodies, strict=True):
        if body.name == getattr(point.body, "name", None):
            if isinstance(new, Point):
                return new
            return point if body is new else moved_point(body.at(point.x), new, _stretch(body, new))
    return point


def _stretch(body: Any, new: Any) -> float:
    return float(new.length / body.length) if hasattr(body, "length") else 1.0


def _share(one: System, two: System) -> float:
    """Return the smallest change of a kind of numbers relative to the entries that change, of the kinds that do."""
    shares = []
    laws = [system.contacts for system in (one, two)]
    pairs = [(getattr(one, name), getattr(two, name)) for name in ("mass", "stiffness", "damping")]
    pairs += [(a.vector, b.vector) for a, b in zip(one.loads, two.loads, strict=True)]
    if laws[0] is not None and laws[1] is not None:
        pairs += [(getattr(laws[0], name), getattr(laws[1], name)) for name in ("gap", "stiffness", "damping")]
    for a, b in pairs:
        if a is None or b is None:
            continue
        dense = not hasattr(a, "tocsc")
        if np.array_equal(a, b) if dense else same_matrix(a, b):
            continue
        difference = np.abs(b - a) if dense else abs(b - a)
        entries = np.abs(a)[difference > 0.0] if dense else abs(a).multiply(difference > 0.0)
        largest = float(entries.max()) if entries.shape[0] else 0.0
        if largest > 0.0:
            shares.append(float(difference.max()) / largest)
    return min(shares, default=1.0)


def _combined(parts: Sequence[Any], weights: Array) -> Any:
    """Return the weighted sum of sparse matrices, each of which may be missing; None where they are all the same."""
    if all(same_matrix(parts[0], part) for part in parts[1:]):
        return None
    shape = next(part.shape for part in parts if part is not None)
    from scipy.sparse import csc_matrix

    total = csc_matrix(shape)
    base = csc_matrix(shape) if parts[0] is None else parts[0]
    # Weights of a difference sum up to zero, so that what is the same everywhere drops out exactly.
    for part, weight in zip(parts[1:], weights[1:], strict=True):
        total = total + weight * ((csc_matrix(shape) if part is None else part) - base)
    total = total.tocsc()
    total.eliminate_zeros()
    return total if total.nnz else None


def _plain(parts: Sequence[Any], weights: Array) -> Array:
    """Return the weighted sum of arrays."""
    total = np.zeros(np.shape(parts[0]))
    for part, weight in zip(parts[1:], weights[1:], strict=True):
        total = total + weight * (part - parts[0])
    return np.asarray(total)


def _sum(one: SystemChange, two: SystemChange) -> SystemChange:
    """Return the sum of two derivatives: linked numbers change together."""

    def added(a: T | None, b: T | None) -> T | None:
        return a if b is None else b if a is None else a + b  # type: ignore[operator]

    return SystemChange(
        mass=added(one.mass, two.mass),
        stiffness=added(one.stiffness, two.stiffness),
        damping=added(one.damping, two.damping),
        rayleigh=(one.rayleigh[0] + two.rayleigh[0], one.rayleigh[1] + two.rayleigh[1]),
        modal_damping=one.modal_damping + two.modal_damping,
        rows=added(one.rows, two.rows),
        gap=one.gap + two.gap,
        contact_stiffness=one.contact_stiffness + two.contact_stiffness,
        contact_damping=one.contact_damping + two.contact_damping,
        vectors=tuple(a + b for a, b in zip(one.vectors, two.vectors, strict=True)),
        displacement=one.displacement + two.displacement,
        velocity=one.velocity + two.velocity,
        functions={**one.functions, **two.functions},
        points=lambda given: added(one.points(given), two.points(given)),
        assemblies=one.assemblies + two.assemblies,
    )
