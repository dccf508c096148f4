"""Scenes that differ from an earlier one in functions of time alone need not be assembled again."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from vofem.assembly import Model
from vofem.bodies import Body, Point
from vofem.effects import BaseMotion, Contact, DistributedLoad, PointLoad, PointMoment
from vofem.integrators.event_driven.flow import share_modes
from vofem.parameters import declarations, is_declared
from vofem.scene import Scene
from vofem.studies.steady.condensed import condensable
from vofem.studies.steady.segments.shooting import MOST_UNKNOWNS
from vofem.system import Load
from vofem.time_functions import TimeFunction

#: Loads, of whose functions of time nothing but the load depends, and the names of these.
_FUNCTIONS: dict[type, str] = {PointLoad: "f", PointMoment: "f", DistributedLoad: "f", BaseMotion: "acceleration"}


def recompiled(scene: Scene, earlier: Scene) -> Scene:
    """Return a scene with the model of an earlier one where they differ in loads' functions of time alone.

    `earlier`: compiled.
    Returns the given scene itself if anything else differs, or if it is compiled.
    """
    if scene.assembled or len(scene.bodies) != len(earlier.bodies) or len(scene.effects) != len(earlier.effects):
        return scene
    if not all(_same_body(new, old) for new, old in zip(scene.bodies, earlier.bodies, strict=True)):
        return scene
    partners = {id(new): old for new, old in zip(scene.bodies, earlier.bodies, strict=True)}
    for new, old in zip(scene.effects, earlier.effects, strict=True):
        if not _same_effect(new, old, partners):
            return scene
    model = _with_functions(earlier.model, scene, earlier)
    return scene if model is None else scene.compiled_as(model)


def like_guess(scene: Scene, guess: Any) -> Scene:
    """Return a scene that shares assembly and modes with the scene of a guess, as far as both scenes are equal.

    `guess`: A `Result` or a `PeriodicOrbit`. Other guesses have nothing to share.
    """
    known = getattr(guess, "scene", None)
    if not isinstance(known, Scene) or known is scene or not known.assembled:
        return scene
    if not scene.assembled:
        scene = recompiled(scene, known)
    system, earlier = scene.model.system, known.model.system
    if system.size == earlier.size <= MOST_UNKNOWNS and not condensable(earlier):
        share_modes(system, earlier)
    return scene


def _function_of(effect: Any) -> str | None:
    """Return the name of the parameter of a load that is its function of time; None where more depends on it."""
    seen = isinstance(effect, BaseMotion) and effect.displacement is not None
    return None if seen else _FUNCTIONS.get(type(effect))


def _same_body(new: Body, old: Body) -> bool:
    if new is old:
        return True
    if type(old) is not type(new) or not is_declared(type(new)):
        return False
    return all(_same(getattr(new, name), getattr(old, name), {}) for name in declarations(type(new)) if name != "name")


def _same_effect(new: Any, old: Any, partners: dict[int, Body]) -> bool:
    if new is old:
        return True
    if type(new) is not type(old):
        return False
    free = {_function_of(old)} | ({"name"} if type(new) is Contact else set())
    mine, other = vars(new), vars(old)
    kept = [name for name in mine if name not in free]
    return all(name in other and _same(mine[name], other[name], partners) for name in kept)


def _same(new: Any, old: Any, partners: dict[int, Body]) -> bool:
    """Return whether two values are the same; where that is not known, False.

    The body of the earlier scene that belongs to a body of the new one is found by the `id` of the latter.
    """
    if new is old:
        return True
    if id(new) in partners:
        return partners[id(new)] is old
    if type(new) is not type(old):
        return False
    if isinstance(new, Point) and not isinstance(new, Body):
        return partners.get(id(new.body)) is old.body and bool(new.x == old.x)
    if new is None or isinstance(new, (bool, int, float, complex, str, np.generic)):
        return bool(new == old)
    if isinstance(new, np.ndarray):
        return np.array_equal(new, old)
    if isinstance(new, (tuple, list)):
        return len(new) == len(old) and all(_same(a, b, partners) for a, b in zip(new, old, strict=True))
    if isinstance(new, dict):
        return new.keys() == old.keys() and all(_same(new[key], old[key], partners) for key in new)
    if is_dataclass(new):
        return all(_same(getattr(new, f.name), getattr(old, f.name), partners) for f in fields(new))
    return False


def _with_functions(model: Model, scene: Scene, earlier: Scene) -> Model | None:
    """Return a model with the functions of a scene's loads and its contacts' names; None if this is not clear."""
    functions: dict[int, tuple[TimeFunction, str]] = {}
    names: dict[str, str] = {}
    for new, old in zip(scene.effects, earlier.effects, strict=True):
        attribute = _function_of(old)
        if attribute is not None:
            function = getattr(old, attribute)
            if id(function) in functions and functions[id(function)][0] is not getattr(new, attribute):
                return None
            functions[id(function)] = getattr(new, attribute), new.describe()
        if type(new) is Contact and isinstance(old, Contact) and new.name != old.name:
            names[old.name] = new.name
    system = model.system
    loads = []
    for load in system.loads:
        function, name = functions.get(id(load.function), (load.function, load.name))
        loads.append(Load(load.vector, function, name))
    laws = tuple(
        replace(group, names=tuple(names.get(name, name) for name in group.names))
        if names and group is system.contacts
        else group
        for group in system.laws
    )
    changed = replace(system, loads=tuple(loads), laws=laws)
    changed.share(system)
    back = dict(zip(earlier.bodies, scene.bodies, strict=True))
    return replace(model, system=changed, offsets={back[body]: start for body, start in model.offsets.items()})
