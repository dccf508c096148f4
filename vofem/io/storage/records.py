"""Scenes as plain data: writing and reading.

A scene is stored as what its bodies and effects declare, and assembled again when it is loaded. A loaded run therefore
needs no mesh files and no Python functions; `recorded` describes how values of Python functions are stored.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.bodies import Beam, Mass, Path, Point, TravellingPoint
from vofem.bodies.axis import ByNode
from vofem.effects import LinearSoftening, NonlinearSpring, Resolved
from vofem.errors import ArgumentError, MissingCallableError
from vofem.fractional import TabulatedOrder
from vofem.initial import StoredState
from vofem.io.scenes.schema import BODIES, EFFECTS
from vofem.io.storage.recorded import RecordedLoad, Recorder, Recording, is_plain, name_of
from vofem.io.storage.tree import Encode
from vofem.laws import past_of
from vofem.laws.law import FORCE, STORED
from vofem.parameters import content_of, values_of
from vofem.parameters.declared import table_name, was_chosen
from vofem.polynomial import Polynomial
from vofem.scene import Scene, as_scene
from vofem.system import System
from vofem.time_functions import TimeFunction
from vofem.time_functions.base import FUNCTIONS

#: Declared classes by their names in files.
_CLASSES: dict[str, type] = {
    **BODIES,
    **EFFECTS,
    **FUNCTIONS,
    **{table_name(cls): cls for cls in (LinearSoftening, NonlinearSpring, Path, Polynomial, Resolved, TabulatedOrder)},
}
_NAMES_OF = {cls: name for name, cls in _CLASSES.items()}


def scene_record(scene: Scene, q: Array, times: Array) -> dict[str, Any]:
    """Return what a file keeps of a scene: its parts if their classes are known here, and what its equations are.

    `q` (shape (n, n_times)): displacements at which the run has used laws written in Python.
    `times` (shape (n_times,)): times of the loads in s at which it has used Python functions.
    """
    points = [point for effect in scene.effects for point in effect.points()]
    foreign = [body.label for body in scene.bodies if type(body) not in (Beam, Mass)]
    foreign += [effect.describe() for effect in scene.effects if type(effect) not in _NAMES_OF]
    foreign += [point.describe() for point in points if type(point) not in (Point, Mass, TravellingPoint)]
    record = {"foreign": list(dict.fromkeys(foreign)), "equations": equations(scene.model.system), "whole": None}
    record["compared"] = _compared(scene)
    if foreign:
        return record
    copy = Recorder().scene(scene)
    if copy is not scene:
        _use(copy, q, times)
    whole = {"bodies": copy.bodies, "effects": copy.effects, "initial": _initial(scene)}
    return {**record, "whole": whole}


def _use(scene: Scene, q: Array, times: Array) -> None:
    """Ask the functions of a scene for all that a loaded run needs: assembly, loads and laws."""
    system = scene.model.system
    for body in scene.bodies:
        body.strain_rows()
    for load in system.loads:
        load.function(np.unique(times))
    for group in system.laws:
        for index, law in enumerate(() if group.linear else group.forms):
            if law.in_python:
                for u in np.unique((group.rows @ q)[index]).tolist():
                    for what in (FORCE, STORED):
                        law.function(what, law.parameters, law.past, u, u)


def restored_scene(record: Mapping[str, Any], scene: Scene | None, call: str, file: str) -> Scene:
    """Return the scene of a file, or the given one if it has the same equations.

    Functions in Python are not compared: loads and laws. Messages name `call`, such as "resume", and `file`.

    Raises `ArgumentError` if the given scene has other equations.
    Raises `MissingCallableError` if the scene has bodies that the file does not hold, and none is given.
    """
    if scene is not None:
        kept, given = record.get("compared"), _compared(as_scene(call, scene))
        if equations(scene.model.system) != record["equations"] or (kept is not None and _differ(kept, given)):
            raise ArgumentError(
                f"{call}: the scene is another one than that of the {file}: masses, stiffnesses, damping, springpots, "
                "contacts, loads, functions of time, paths or names of effects differ; give the scene that the run "
                "began with, or simulate anew"
            )
        return scene
    if record["foreign"]:
        raise MissingCallableError(
            f"{call}: the run has {', '.join(record['foreign'])}, of a class of another package, which a file cannot "
            f"hold; give the scene that the run began with: vofem.{call}(path, scene=scene)"
        )
    whole, initial = record["whole"], record["whole"]["initial"]
    if isinstance(initial, dict):
        initial = {body: initial[body.name] for body in whole["bodies"] if body.name in initial}
    return Scene(whole["bodies"], whole["effects"], initial)


def _compared(scene: Scene) -> list[Any]:
    """Return what the equations do not tell of effects: names, paths and functions of time; None for what is not known.

    Not known are names that the constructor chose, and functions in Python.
    """
    found: list[Any] = []
    effects = (effect for effect in scene.effects if type(effect) in _NAMES_OF)
    for effect in sorted(effects, key=lambda effect: _NAMES_OF[type(effect)]):
        for name, value in values_of(effect).items():
            if name == "name":
                found.append(None if was_chosen(value) else value)
            elif isinstance(value, TravellingPoint):
                found.append(value.path)
            elif isinstance(value, TimeFunction):
                plain = not isinstance(value, RecordedLoad) and Recorder().function(value) is value
                found.append(value if plain else None)
    return found


def _differ(kept: list[Any], given: list[Any]) -> bool:
    """Return whether anything that is known on both sides differs."""

    def content(value: Any) -> Any:
        try:
            return None if value is None else content_of(value)
        except TypeError:
            return None

    pairs = [(content(one), content(other)) for one, other in zip(kept, given, strict=False)]
    return len(kept) != len(given) or any(None not in pair and pair[0] != pair[1] for pair in pairs)


def equations(system: System) -> str:
    """Return a checksum of the equations: two systems have the same one if they have the same numbers."""
    found = hashlib.sha256()

    def add(value: Any) -> None:
        if hasattr(value, "tocsr"):
            matrix = value.tocsr()
            matrix.sum_duplicates()
            for part in (matrix.indptr, matrix.indices, matrix.data):
                add(part)
        else:
            array = np.asarray(value if value is not None else np.nan)
            found.update(repr(array.shape).encode() + np.ascontiguousarray(array, dtype=float).tobytes())

    for matrix in (system.mass, system.stiffness, system.damping):
        add(matrix)
    add(system.rayleigh)
    add(system.modal_damping)
    for group in system.laws:
        found.update(type(group).__name__.encode())
        add(group.rows)
        add(group.numbers())
    for load in system.loads:
        add(load.vector)
    return found.hexdigest()


def encoder(times: Array) -> Encode:
    """Return what turns the parts of a scene into plain data; see `tree.write_tree`.

    `times` (shape (n_times,)): times of the loads in s at which a run has used functions of other packages.
    """

    def encode(value: Any) -> tuple[str, Any] | None:
        name = _NAMES_OF.get(type(value))
        if name is not None:
            values = values_of(value)
            return name, values | {"supports": dict(values["supports"])} if isinstance(value, Beam) else values
        if type(value) is Point:
            return "point", (value.body, float(value.x))
        if type(value) is TravellingPoint:
            return "travelling", (value.body, value.path)
        if isinstance(value, Recording):
            return "plain", value.recorded()
        if isinstance(value, TimeFunction) and not is_plain(value):
            function = Recorder().function(value).function
            function(times)
            return "recorded_load", function
        if callable(value) and not is_plain(value):
            return "plain", Recording(value, name_of(value)).recorded()
        return None

    return encode


def _initial(scene: Scene) -> Any:
    initial = scene.initial
    if initial is None or isinstance(initial, StoredState):
        return initial
    if isinstance(initial, Mapping) and not any(hasattr(state, "state_of") for state in initial.values()):
        parts = [part for state in initial.values() for part in state]
        if all(isinstance(part, (int, float, np.number, Polynomial)) for part in parts):
            return {body.name: tuple(state) for body, state in initial.items()}
    state, model = scene.initial_state(), scene.model
    states = {body.name: (model.of_body(body, state.q), model.of_body(body, state.v)) for body in scene.bodies}
    if state.internal is None:
        return StoredState(states, {})
    names = [name for group in model.system.laws for name in group.names]
    pasts = {name: past for name in names if (past := past_of(model.system.laws, state.internal, name)) is not None}
    return StoredState(states, pasts)


def decode(tag: str, record: Any) -> Any:
    """Return the object that a tag and its data describe; see `tree.read_tree`."""
    if tag == "plain":
        return record
    if tag == "recorded_load":
        return RecordedLoad(record)
    if tag == "point":
        return Point(*record)
    if tag == "travelling":
        return TravellingPoint(*record)
    if tag not in _CLASSES:
        raise KeyError(f"{tag!r} is no part of a scene")
    if tag == "beam":
        record = {**record, "supports": ByNode(record["supports"])}
    return _CLASSES[tag](**record)
