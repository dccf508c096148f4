"""From a scene to the text of a scene file."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vofem.bodies.kinds import Along
from vofem.errors import ArgumentError, SceneFileError
from vofem.files import toml_text
from vofem.initial import StoredState
from vofem.io.scenes.reader import INITIAL
from vofem.io.scenes.schema import BODIES, EFFECTS, write_table
from vofem.io.scenes.settings import OutputSettings, RespondSettings, RunSettings, write_run
from vofem.parameters import Unwritable, number_at
from vofem.parameters.declared import write
from vofem.parameters.place import Book, Place
from vofem.scene import Scene, as_scene


def scene_to_toml(
    scene: Scene,
    run: RunSettings | None = None,
    output: OutputSettings | None = None,
    folder: Path | None = None,
    respond: RespondSettings | None = None,
) -> str:
    """Return the text of a scene file.

    `folder`: where the file will be: paths of meshes are made relative to it. The current folder where not given.
    Raises `SceneFileError` if a scene file cannot hold something: callables, and initial states that are outcomes; or
    if no number stands where `respond` says. All of it is listed.
    """
    as_scene("scene_to_toml", scene)
    book = Book(Path.cwd() if folder is None else folder, {body.name: body for body in scene.bodies})
    root = Place(book)
    blocks = []
    if run is not None:
        blocks.append(toml_text.table("[run]", write_run(run, root.key("run"))))
    if output is not None and output != OutputSettings():
        blocks.append(toml_text.table("[output]", write(output, root.key("output"))))
    if respond is not None:
        blocks.append(toml_text.table("[respond]", write(respond, root.key("respond"))))
    blocks += _tables(scene.bodies, BODIES, root) + _tables(scene.effects, EFFECTS, root)
    blocks += _initial(scene.initial, root.key("initial"))
    if book.problems:
        raise SceneFileError("this scene cannot be written to a scene file", book.problems)
    text = "\n".join(blocks)
    if respond is not None:
        _check_parameter(text, respond)
    return text


def _check_parameter(text: str, respond: RespondSettings) -> None:
    """Raise where the path of a parameter leads to no number in the text of a scene file."""
    content = tomllib.loads(text)
    for path in respond.parameter:
        try:
            number_at(content, path)
        except ArgumentError as error:
            problems = [("respond.parameter", str(error))]
            raise SceneFileError("this scene cannot be written with [respond]", problems) from error


def _tables(things: tuple[Any, ...], known: Mapping[str, type], root: Place) -> list[str]:
    counts: dict[str, int] = {}
    blocks = []
    for k, thing in enumerate(things):
        name = next((name for name, cls in known.items() if type(thing) is cls), None)
        if name is None:
            kind = "bodies" if known is BODIES else "effects"
            root.key(kind).index(k).report(
                f"{type(thing).__name__} cannot be written to a scene file; build this scene in Python"
            )
            continue
        place = root.key(name).index(counts.get(name, 0))
        counts[name] = counts.get(name, 0) + 1
        blocks.append(toml_text.table(f"[[{name}]]", write_table(thing, place)))
    return blocks


def _initial(initial: Any, place: Place) -> list[str]:
    if initial is None:
        return []
    if not isinstance(initial, Mapping):
        place.report(f"{_kind(initial)} cannot be written to a scene file; give displacements and velocities")
        return []
    blocks = []
    for body, state in initial.items():
        here = place.key(body.name)
        if hasattr(state, "state_of"):
            here.report(f"{_kind(state)} cannot be written to a scene file; give displacements and velocities")
            continue
        table = {}
        for name, value in zip(INITIAL, state, strict=True):
            try:
                table[name] = Along().write(value, place.book)
            except Unwritable as error:
                here.key(name).report(f"{error}; vofem.Polynomial has one" if callable(value) else str(error))
        blocks.append(toml_text.table(f"[initial.{toml_text.key(body.name)}]", table))
    return blocks


def _kind(outcome: Any) -> str:
    """Return the class of the outcome that a state was taken from."""
    return outcome.source if isinstance(outcome, StoredState) else type(outcome).__name__
