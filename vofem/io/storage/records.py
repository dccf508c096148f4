"""Bodies, effects, scenes and solutions as plain data: writing and reading.

A scene is stored as its bodies and effects with their arguments, and as the
assembled model. A loaded run therefore needs no mesh files and no Python
functions, and nothing is assembled again. `stand_ins` and `stored_field` describe
how values of Python functions are stored.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.bodies import Beam, BeamPoint, Mass
from vofem.bodies.supports import ByNode
from vofem.effects import Resolved
from vofem.errors import ArgumentError, MissingCallableError
from vofem.initial import StoredState
from vofem.io.scenes.schema import EFFECTS
from vofem.io.storage.stand_ins import (
    StoredCallable,
    StoredEffect,
    StoredFunction,
    StoredLaw,
    name_of,
)
from vofem.io.storage.stored_field import StoredField
from vofem.io.storage.tree import class_named, name_of_class
from vofem.kernels.jit import CompiledFunction
from vofem.laws import LawGroup, ScalarLaw, past_of
from vofem.parameters import values_of
from vofem.polynomial import Polynomial
from vofem.scene import Scene, as_scene
from vofem.system import System, same_matrix
from vofem.time_functions import TimeFunction

Array = NDArray[np.float64]


def scene_record(scene: Scene) -> dict[str, Any]:
    """Return what a file keeps of a scene: its equations, and all of it where its bodies are of classes known here."""
    model = scene.model
    points = (point for effect in scene.effects for point in effect.points())
    foreign = [body.label for body in scene.bodies if type(body) not in (Beam, Mass)]
    foreign += [point.describe() for point in points if type(point) not in (BeamPoint, Mass)]
    return {
        "foreign": list(dict.fromkeys(foreign)),
        "system": model.system,
        "whole": None if foreign else {"scene": scene, "model": model},
    }


def restored_scene(record: Mapping[str, Any], scene: Scene | None, call: str, file: str) -> Scene:
    """Return the scene of a file, or the given one if it has the same equations.

    Functions of time and laws in Python are not compared. Messages name `call`, such as "resume", and `file`.

    Raises
    ------
    ArgumentError
        If the given scene has other equations.
    MissingCallableError
        If the scene has bodies that the file does not hold, and none is given.
    """
    if scene is not None:
        if not _same_equations(as_scene(call, scene).model.system, record["system"]):
            raise ArgumentError(
                f"{call}: the scene is another one than that of the {file}: masses, stiffnesses, damping, springpots, "
                "contacts or loads differ; give the scene that the run began with, or simulate anew"
            )
        return scene
    if record["foreign"]:
        raise MissingCallableError(
            f"{call}: the run has {', '.join(record['foreign'])}, of a class of another package, which a file cannot "
            f"hold; give the scene that the run began with: vofem.{call}(path, scene=scene)"
        )
    whole = record["whole"]
    return whole["scene"].compiled_as(whole["model"])


def _same_equations(mine: System, other: System) -> bool:
    return (
        mine.size == other.size
        and all(same_matrix(getattr(mine, name), getattr(other, name)) for name in ("mass", "stiffness", "damping"))
        and mine.rayleigh == other.rayleigh
        and np.array_equal(mine.modal_damping, other.modal_damping)  # type: ignore[arg-type]
        and [type(group) for group in mine.laws] == [type(group) for group in other.laws]
        and all(
            same_matrix(one.rows, two.rows) and np.array_equal(one.numbers(), two.numbers())
            for one, two in zip(mine.laws, other.laws, strict=True)
        )
        and mine.has_load_vectors_of(other)
    )


class Encoder:
    """Turns the parts of a run into plain data; see `tree.write_tree`.

    Parameters
    ----------
    laws : sequence of LawGroup
    q : ndarray, shape (n, n_times)
        Displacements at which the run has used laws written in Python.
    times : ndarray, shape (n_times,)
        Times of the loads in s at which it has used Python functions.
    """

    def __init__(self, laws: Sequence[LawGroup], q: Array, times: Array) -> None:
        self._laws, self._q, self._times = laws, q, times

    def __call__(self, value: Any) -> tuple[str, Any] | None:
        """Return tag and plain data, or None for what is plain."""
        if type(value) is Beam:
            return "beam", self._beam(value)
        if type(value) is Mass:
            return "mass", values_of(value)
        if type(value) is BeamPoint:
            return "point", (value.body, float(value.x))
        if type(value) is Resolved:
            return "resolved", value.s0
        if isinstance(value, Scene):
            return "scene", self._scene(value)
        if isinstance(value, ScalarLaw) and not isinstance(value, StoredLaw):
            return "plain", self._law(value)
        if isinstance(value, TimeFunction) and name_of_class(type(value)) is None:
            return "plain", StoredFunction.of(value, self._times)
        if isinstance(value, FunctionType | CompiledFunction) and name_of_class(value) is not None:
            return "function", name_of_class(value)
        if callable(value) and name_of_class(type(value)) is None:
            return "plain", StoredCallable(name_of(value))
        return None

    def _beam(self, beam: Beam) -> dict[str, Any]:
        values = {**values_of(beam), "supports": dict(beam.supports)}
        return {**values, **{name: self._field(values[name], beam, name) for name in ("EI", "rhoA")}}

    def _field(self, value: Any, beam: Beam, what: str) -> Any:
        plain = not callable(value) or isinstance(value, (Polynomial, StoredField, TimeFunction))
        return value if plain else StoredField.of(value, beam, what)

    def _law(self, law: ScalarLaw) -> StoredLaw:
        places = ((group, group.place_of(law)) for group in self._laws)
        group, index = next((group, index) for group, index in places if index is not None)
        u = np.unique((group.rows @ self._q)[index])
        reactions, energies = (np.array([of(x) for x in u.tolist()]) for of in (law.reaction, law.energy))
        return StoredLaw(law.name, _callables(law), u, reactions, energies, law.label)

    def _scene(self, scene: Scene) -> dict[str, Any]:
        return {
            "bodies": scene.bodies,
            "effects": [self._effect(effect) for effect in scene.effects],
            "initial": self._initial(scene),
        }

    def _effect(self, effect: Any) -> Any:
        if isinstance(effect, StoredEffect):
            return effect
        entry = next((name for name, cls in EFFECTS.items() if type(effect) is cls), None)
        shown = StoredEffect(
            type(effect).__name__,
            effect.describe(),
            tuple(effect.points()),
            _callables(effect),
            getattr(effect, "name", ""),
            getattr(effect, "of", "displacement"),
        )
        if entry is None:
            return shown
        beam = getattr(effect, "beam", None)
        values = {
            name: self._field(value, beam, f"{name} of {type(effect).__name__}") if isinstance(beam, Beam) else value
            for name, value in values_of(effect).items()
        }
        return {"entry": entry, "values": values, "otherwise": shown}

    def _initial(self, scene: Scene) -> Any:
        initial = scene.initial
        if initial is None or isinstance(initial, StoredState):
            return initial
        if isinstance(initial, Mapping) and not any(hasattr(state, "state_of") for state in initial.values()):
            parts = [part for state in initial.values() for part in state]
            if all(isinstance(part, (int, float, np.number, Polynomial)) for part in parts):
                return {body: tuple(state) for body, state in initial.items()}
        state, model = scene.initial_state(), scene.model
        states = {body.name: (model.of_body(body, state.q), model.of_body(body, state.v)) for body in scene.bodies}
        if state.internal is None:
            return StoredState(states, {})
        names = [name for group in model.system.laws for name in group.names]
        pasts = {name: past for name in names if (past := past_of(model.system.laws, state.internal, name)) is not None}
        return StoredState(states, pasts)


def _callables(effect: Any) -> str:
    """Return the names of the callables that an effect or a law holds, or the name of its class."""
    values = [value for value in vars(effect).values() if not isinstance(value, type)]
    values += [getattr(value, field.name) for value in values if is_dataclass(value) for field in fields(value)]
    names = [name_of(value) for value in values if callable(value) and not is_dataclass(value)]
    return ", ".join(dict.fromkeys(names)) or type(effect).__name__


def decode(tag: str, record: Any) -> Any:
    """Return the object that a tag and its data describe; see `tree.read_tree`."""
    if tag == "plain":
        return record
    if tag == "beam":
        return Beam(**{**record, "supports": ByNode(record["supports"])})
    if tag == "mass":
        return Mass(**record)
    if tag == "point":
        return BeamPoint(*record)
    if tag == "resolved":
        return Resolved(record)
    if tag == "function":
        return class_named(record)
    if tag == "scene":
        return Scene(record["bodies"], [_effect(effect) for effect in record["effects"]], record["initial"])
    raise KeyError(f"{tag!r} is no part of a scene")


def _effect(record: Any) -> Any:
    if isinstance(record, StoredEffect):
        return record
    try:
        return EFFECTS[record["entry"]](**record["values"])
    except MissingCallableError:
        return record["otherwise"]
