"""The same scene on other meshes: what a study of the error in space needs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vofem._validate import whole
from vofem.arrays import Array
from vofem.bodies.axis import ByNode
from vofem.bodies.base import Body, touching
from vofem.bodies.beam import Beam
from vofem.bodies.kinds import Section
from vofem.errors import ArgumentError
from vofem.parameters import changed, declarations, values_of
from vofem.scene import Scene, as_scene


def element_count(scene: Scene) -> int:
    """Return the number of elements of all beams together."""
    return sum(body.element_lengths.size for body in scene.bodies if isinstance(body, Beam))


def can_have(scene: Scene, elements: int) -> bool:
    """Return whether `remeshed` can give the scene so many elements."""
    try:
        _counts(scene, elements)
    except ArgumentError:
        return False
    return True


def remeshed(scene: Scene, elements: int) -> Scene:
    """Return the scene on another mesh; bodies keep their names, so points are found in its results.

    Beams of equal elements get any number of them that puts a node on every
    support. The elements of other beams, of named subdomains and with one
    coefficient each, are divided into equal parts. Several beams share the
    elements in the proportion that they have.

    Parameters
    ----------
    scene : Scene
    elements : int
        Number of elements of all beams together.

    Returns
    -------
    Scene
        The same object where it has that many elements.

    Raises
    ------
    ArgumentError
        If there is no beam, or the mesh cannot have so many elements.
    """
    as_scene("remeshed", scene)
    if elements == element_count(scene):
        return scene
    beams = {beam: _with_elements(beam, count) for beam, count in _counts(scene, elements).items()}
    bodies = [beams.get(body, body) if isinstance(body, Beam) else body for body in scene.bodies]
    effects = [touching(effect, beams, lambda point, new: new.at(point.x)) for effect in scene.effects]
    return Scene(bodies, effects, _initial(scene, beams))


def _counts(scene: Scene, elements: int) -> dict[Beam, int]:
    """Return the number of elements of every beam."""
    known = element_count(scene)
    if not known:
        raise ArgumentError("the scene has no beam, so its mesh cannot be refined; leave elements out")
    elements = whole("elements", elements)
    counts = {}
    for beam in (body for body in scene.bodies if isinstance(body, Beam)):
        has = beam.element_lengths.size
        count, rest = divmod(has * elements, known)
        if rest or not count:
            raise ArgumentError(
                f"{elements} elements cannot be shared among the beams in the proportion that they have, {has} of "
                f"{known} for {beam.label}; give multiples of {known}, or a function that builds the scene"
            )
        uniform = _uniform(beam)
        if not uniform and count % has:
            raise ArgumentError(
                f"{beam.label} has {has} elements that are not alike, so it can have a multiple of {has}, not {count}; "
                "for other meshes give a function that builds the scene"
            )
        if uniform and any(node * count % has for node in beam.supports):
            raise ArgumentError(
                f"{beam.label} with {count} elements would have no node at a support between its ends; multiples of "
                f"{has} do"
            )
        counts[beam] = count
    return counts


def _uniform(beam: Beam) -> bool:
    """Return whether a beam was given as a number of elements, without coefficients by element."""
    return np.ndim(beam.elements) == 0 and beam.mesh is None and not (_by_element(beam.EI) or _by_element(beam.rhoA))


def _by_element(value: Any) -> bool:
    """Return whether a coefficient is given as one number per element."""
    return isinstance(value, np.ndarray)


def _with_elements(beam: Beam, count: int) -> Beam:
    has = beam.element_lengths.size
    if _uniform(beam):
        return _on(beam, count, {node * count // has: kind for node, kind in beam.supports.items()})
    parts = count // has
    held = {node * parts: kind for node, kind in beam.supports.items()}
    coefficients = {
        name: np.repeat(value, parts)
        for name, value in values_of(beam).items()
        if isinstance(declarations(Beam)[name].kind, Section) and _by_element(value)
    }
    return _on(beam, _divided(beam.nodes, parts), held, **coefficients)


def _on(beam: Beam, elements: Any, held: dict[int, str], **coefficients: Any) -> Beam:
    """Return a beam on other elements, with supports by their nodes."""
    made: Beam = changed(beam, elements=elements, supports=ByNode(held), **coefficients)
    return made


def _divided(nodes: Array, parts: int) -> Array:
    inner = nodes[:-1, None] + np.diff(nodes)[:, None] * (np.arange(parts) / parts)
    return np.append(inner.ravel(), nodes[-1])


def _initial(scene: Scene, beams: Mapping[Beam, Beam]) -> Any:
    initial = scene.initial
    if initial is None:
        return None
    if not isinstance(initial, Mapping):
        return {beams.get(body, body): _fields(body, initial) for body in scene.bodies}  # type: ignore[call-overload]
    return {
        beams.get(body, body): _fields(body, state) if hasattr(state, "state_of") else state
        for body, state in initial.items()
    }


def _fields(body: Body, outcome: Any) -> tuple[Any, Any]:
    """Return the state of an earlier outcome as numbers of a mass, or as callables along a beam."""
    dofs = outcome.state_of(body.name)
    if not isinstance(body, Beam):
        return float(dofs[0][0]), float(dofs[1][0])
    return _Field(body, dofs[0]), _Field(body, dofs[1])


class _Field:
    """The Hermite cubics of a beam as a callable of x."""

    def __init__(self, beam: Beam, dofs: Array) -> None:
        self._beam, self._dofs = beam, dofs

    def __call__(self, x: Any) -> Array:
        at = np.asarray(x, dtype=float)
        return np.asarray(self._beam.field_matrix(at.ravel()) @ self._dofs).reshape(at.shape)
