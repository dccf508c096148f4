"""Between the text of a scene file and a scene: reading, which notes everything that is wrong, and writing."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from vofem.bodies import Body, Point
from vofem.bodies.kinds import Along
from vofem.effects.kinds import OnBody
from vofem.errors import ArgumentError, SceneFileError, VofemError
from vofem.files import toml_text
from vofem.initial import StoredState
from vofem.io.scenes.schema import BODIES, EFFECTS, keys, read_table, write_table
from vofem.io.scenes.settings import OutputSettings, RespondSettings, RunSettings, read_run, write_run
from vofem.parameters import Kind, Name, Real, Unwritable, declarations, is_declared, number_at
from vofem.parameters.declared import read, write
from vofem.parameters.place import Book, Invalid, Place
from vofem.scene import Scene, as_scene

_SINGLE = ("run", "output", "respond", "initial")

#: Tables of studies, which a single run does not need; their own readers look into them.
_STUDIES = ("sweep",)


def _tables() -> tuple[str, ...]:
    """Return the names of all tables of a scene file; looked up when it is read, so that classes can be added."""
    return (*_SINGLE, *BODIES, *EFFECTS)


#: Keys of the initial state of a body; zero where silent.
INITIAL = ("displacement", "velocity")
_HEADER = re.compile(r"^[ \t]*\[{1,2}[ \t]*([A-Za-z0-9_-]+)[ \t]*\]", re.MULTILINE)

#: Name of a table, the table itself, and its place.
Item = tuple[str, Any, Place]


def read_respond(content: dict[str, Any], book: Book) -> RespondSettings | None:
    """Return what ``[respond]`` of a parsed file says, whose bodies are known; problems are added to `book`."""
    table, place = content.get("respond"), Place(book).key("respond")
    if not isinstance(table, dict):
        return None
    found = read(RespondSettings, table, place)
    if isinstance(found, Invalid):
        return None
    for path in found.parameter:
        try:
            number_at(content, path)
        except ArgumentError as error:
            place.key("parameter").report(str(error))
    return found if isinstance(found, RespondSettings) else None


def read_tables(
    content: dict[str, Any], text: str, book: Book
) -> tuple[Scene | None, RunSettings | None, OutputSettings]:
    """Return scene, run and output of a parsed file; problems are added to `book`."""
    root = Place(book)
    root.unknown_keys(content, (*_tables(), *_STUDIES))
    for name in _SINGLE:
        if name in content and not isinstance(content[name], dict):
            root.key(name).expected(f"one table, headed [{name}]", content[name])
    order = _order(content, text, root)
    _check_names(order, book)
    bodies = []
    for name, table, place in order:
        if name in BODIES:
            bodies.append(body := read_table(BODIES[name], table, place))
            if not isinstance(body, Invalid) and body.name not in book.bodies:
                book.bodies[body.name] = body
                book.broken.discard(body.name)
    if not bodies:
        root.report("there are no bodies; expected at least one [[beam]] or [[mass]]")
    effects = _effects([item for item in order if item[0] in EFFECTS])
    initial = _initial(content.get("initial", {}), root.key("initial"))
    run = read_run(content["run"], root.key("run")) if isinstance(content.get("run"), dict) else None
    output = content.get("output")
    output = read(OutputSettings, output, root.key("output")) if isinstance(output, dict) else None
    if isinstance(run, RunSettings) and isinstance(output, OutputSettings):
        for t in output.pictures:
            if t > run.t_end:
                root.key("output").key("pictures").report(f"expected times up to t_end = {run.t_end:g} s, found {t!r}")
    if not book.problems:
        try:
            return Scene(bodies, effects, initial or None), run, output or OutputSettings()
        except VofemError as error:
            root.report(str(error))
    return None, None, OutputSettings()


# -- bodies and effects -----------------------------------------------------------------------------


def _order(content: dict[str, Any], text: str, root: Place) -> list[Item]:
    """Return the tables of bodies and effects in the order in which they stand in the file.

    The parser groups arrays of tables by name. Their headers tell the order;
    where they do not account for every table (inline arrays), groups stay together.
    """
    groups: dict[str, list[Item]] = {}
    for name, tables in content.items():
        meant = _meant(name)
        if meant is None:
            continue
        here, several = root.key(name), isinstance(tables, list)
        found = [(table, here.index(k)) for k, table in enumerate(tables)] if several else [(tables, here)]
        groups[name] = [(meant, *one) for one in found]
    headers = [name for name in _HEADER.findall(text) if name in groups]
    if any(headers.count(name) != len(group) for name, group in groups.items()):
        return [item for group in groups.values() for item in group]
    queues = {name: iter(group) for name, group in groups.items()}
    return [next(queues[name]) for name in headers]


def _meant(name: str) -> str | None:
    """Return the name of a table of a body or an effect; of a misspelt one, which is noted already, the nearest.

    So what is wrong inside it is noted too.
    """
    close = [name] if name in _tables() else get_close_matches(name, _tables(), n=1)
    return close[0] if close and close[0] in BODIES | EFFECTS else None


def _check_names(order: list[Item], book: Book) -> None:
    """Note names that are used twice; every body counts as broken until it is built."""
    first: dict[tuple[str, str], str] = {}
    for kind, table, place in order:
        name = table.get("name") if isinstance(table, dict) else None
        body = kind in BODIES
        if not isinstance(name, str) or not name or not (body or "name" in keys(EFFECTS[kind])):
            continue
        _note_name("body" if body else kind, name, place, first)
        if body:
            book.broken.add(name)


def _note_name(group: str, name: str, place: Place, first: dict[tuple[str, str], str]) -> None:
    """Report a name that another thing of its group has, by the place of the `first` one."""
    if first.setdefault((group, name), place.path) != place.path:
        place.key("name").report(f"{name!r} is already the name of {first[group, name]}; give each its own")


def _effects(items: list[Item]) -> list[Any]:
    """Build effects; contacts without a name are numbered from 1, so that every reading gives the same names."""
    taken = {table["name"] for _, table, _ in items if isinstance(table, dict) and isinstance(table.get("name"), str)}
    counts: dict[str, int] = {}
    effects = []
    for kind, table, place in items:
        extra = {}
        if _numbered(EFFECTS[kind]) and isinstance(table, dict) and "name" not in table:
            k = counts.get(kind, 0) + 1
            while f"{kind}-{k}" in taken:
                k += 1
            counts[kind] = k
            extra["name"] = f"{kind}-{k}"
        effects.append(read_table(EFFECTS[kind], table, place, **extra))
    return effects


def _numbered(cls: type) -> bool:
    """Return whether effects of a class must have a name, so that those without one are numbered."""
    known = declarations(cls) if is_declared(cls) else {}
    return "name" in known and type(known["name"].kind) is Name


# -- the initial state ------------------------------------------------------------------------------


def _initial(table: Any, place: Place) -> dict[Body, tuple[Any, Any]]:
    """Return the initial state by body."""
    if not isinstance(table, dict):
        return {}
    result = {}
    for name, state in table.items():
        here = place.key(name)
        body = OnBody().read(name, here)
        if not isinstance(state, dict):
            here.expected("a table with displacement and velocity", state)
            continue
        here.unknown_keys(state, INITIAL)
        kind: Kind = Along() if isinstance(body, Body) and not isinstance(body, Point) else Real()
        values = [kind.read(state[key], here.key(key)) if key in state else 0.0 for key in INITIAL]
        if isinstance(body, Invalid):
            continue
        for key, value in zip(INITIAL, values, strict=True):
            if not isinstance(value, Invalid):
                try:
                    body.interpolate(value, f"initial {key}")
                except VofemError as error:
                    here.key(key).report(str(error))
        result[body] = (values[0], values[1])
    return result


def scene_to_toml(
    scene: Scene,
    run: RunSettings | None = None,
    output: OutputSettings | None = None,
    folder: Path | None = None,
    respond: RespondSettings | None = None,
    *,
    whole: bool = False,
) -> str:
    """Return the text of a scene file.

    `folder`: where the file will be: paths of meshes are made relative to it. The current folder where not given.
    `whole`: whether nodes of meshes are written, so that no mesh file is needed, in place of these paths.
    Raises `SceneFileError` if a scene file cannot hold something: callables, and initial states that are outcomes; or
    if no number stands where `respond` says. All of it is listed.
    """
    as_scene("scene_to_toml", scene)
    book = Book(Path.cwd() if folder is None else folder, {body.name: body for body in scene.bodies}, whole=whole)
    root = Place(book)
    blocks = []
    if run is not None:
        blocks.append(toml_text.table("[run]", write_run(run, root.key("run"))))
    if output is not None and output != OutputSettings():
        blocks.append(toml_text.table("[output]", write(output, root.key("output"))))
    if respond is not None:
        blocks.append(toml_text.table("[respond]", write(respond, root.key("respond"))))
    blocks += _texts(scene.bodies, BODIES, root) + _texts(scene.effects, EFFECTS, root)
    blocks += _initial_texts(scene.initial, root.key("initial"))
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


def _texts(things: tuple[Any, ...], known: Mapping[str, type], root: Place) -> list[str]:
    counts: dict[str, int] = {}
    first: dict[tuple[str, str], str] = {}
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
        if getattr(thing, "name", None) is not None:
            _note_name(name, thing.name, place, first)
        blocks.append(toml_text.table(f"[[{name}]]", write_table(thing, place)))
    return blocks


def _initial_texts(initial: Any, place: Place) -> list[str]:
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
