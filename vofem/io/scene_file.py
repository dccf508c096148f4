"""Scene files: TOML files that describe a scene, with the names of the arguments in Python."""

from __future__ import annotations

import os
import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vofem._validate import nearest, wrong
from vofem.effects.kinds import AtPoint
from vofem.errors import ArgumentError, SceneFileError
from vofem.files.whole import path_of, target, write_text
from vofem.io.scenes.scene_text import read_respond, read_tables
from vofem.io.scenes.scene_text import scene_to_toml as scene_to_toml
from vofem.io.scenes.settings import OutputSettings as OutputSettings
from vofem.io.scenes.settings import RespondSettings
from vofem.io.scenes.settings import RunSettings as RunSettings
from vofem.parameters import changed
from vofem.parameters.place import Book, Place
from vofem.result import Result
from vofem.scene import Scene, as_scene
from vofem.simulate.simulation import simulate


@dataclass(frozen=True)
class SceneFile:
    """The content of a scene file.

    Attributes
    ----------
    scene : Scene
    run : RunSettings, optional
        None if the file has no ``[run]``.
    output : OutputSettings
    path : Path
    respond : RespondSettings, optional
        None if the file has no ``[respond]``.
    content : dict
        The parsed file.
    """

    scene: Scene
    run: RunSettings | None
    output: OutputSettings
    path: Path
    respond: RespondSettings | None = None
    content: dict[str, Any] = field(default_factory=dict, repr=False)

    def at(self, value: float) -> Scene:
        """Return the scene with a value for the parameter that ``[respond]`` names.

        Raises
        ------
        ArgumentError
            If the file has no ``[respond]``.
        SceneFileError
            If there is no valid scene with this value.
        """
        if self.respond is None:
            raise ArgumentError(
                f"{self.path} does not name a parameter; add a table [respond] with "
                'parameter = "point_load[0].f.sine.omega", or another path of a number'
            )
        book = Book(self.path.parent)
        scene, _, _ = read_tables(changed(self.content, dict.fromkeys(self.respond.parameter, float(value))), "", book)
        if book.problems or scene is None:
            raise SceneFileError(f"{self.path} at {value:g}", book.problems)
        return scene

    def simulate(self, **changes: Any) -> Result:
        """Run the scene as the file says. Arguments of `vofem.simulate` given here replace those of the file."""
        arguments = (self.run.arguments() if self.run is not None else {}) | changes
        if "t_end" not in arguments:
            raise ArgumentError(f"{self.path} does not say how long to run; add t_end to a table [run], or give t_end")
        return simulate(self.scene, **arguments)


def load_scene(path: str | os.PathLike[str]) -> SceneFile:
    """Read a scene file.

    Parameters
    ----------
    path : path
        A TOML file in UTF-8. Paths of meshes in it are relative to its folder.

    Returns
    -------
    SceneFile

    Raises
    ------
    SceneFileError
        With all faults of the file: the path of the key, what was expected, what was found, and the nearest valid name.
    """
    file, text, content = scene_text(path)
    return read_content(content, text, file)


def scene_text(path: str | os.PathLike[str]) -> tuple[Path, str, dict[str, Any]]:
    """Return the path of a scene file, its text and its tables; raise `SceneFileError` if it is not valid TOML."""
    file = path_of(path, "a scene file")
    text = _text(file)
    try:
        return file, text, tomllib.loads(text)
    except RecursionError:
        raise SceneFileError(str(file), [("", "arrays or tables are nested too deeply")]) from None
    except ValueError as error:
        raise _syntax_error(file, text, str(error)) from None


def read_content(content: dict[str, Any], text: str, file: Path) -> SceneFile:
    """Return what the tables of a scene file say.

    `content`: the parsed file.
    `text`: the text of the file. The order of its headers is that of the bodies.
    `file`: name of the file. Relative paths start at its folder.
    Raises `SceneFileError` with all faults.
    """
    book = Book(file.parent)
    scene, run, output = read_tables(content, text, book)
    respond = read_respond(content, book)
    if book.problems or scene is None:
        raise SceneFileError(str(file), book.problems)
    return SceneFile(scene, run, output, file, respond, content)


def dump_scene(
    scene: Scene,
    path: str | os.PathLike[str],
    run: RunSettings | None = None,
    output: OutputSettings | None = None,
    respond: RespondSettings | None = None,
    *,
    overwrite: bool = False,
) -> Path:
    """Write a scene to a scene file. The file is written completely or not at all.

    Reading it gives the same scene, bit for bit.

    Parameters
    ----------
    scene : Scene
    path : path
        The file, which ends in .toml.
    run : RunSettings, optional
    output : OutputSettings, optional
    respond : RespondSettings, optional
        The contents of the table ``[respond]``. With ``file = vf.load_scene(...)`` all of a file is written by
        ``vf.dump_scene(file.scene, path, file.run, file.output, file.respond)``.
    overwrite : bool
        Whether a file of that name is replaced. Comments in it are lost then.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    ArgumentError
        If the path has another suffix, or an argument is of another kind.
    SceneFileError
        If the scene contains something that a scene file cannot hold, such as a Python function or two springs of one
        name, or if no number stands where `respond` says.
    OutputError
        If the file exists and is not to be overwritten, or cannot be written. What was there stays as it was.
    """
    as_scene("dump_scene", scene)
    for name, given, kind in (
        ("run", run, RunSettings),
        ("output", output, OutputSettings),
        ("respond", respond, RespondSettings),
    ):
        if not (given is None or isinstance(given, kind)):
            cure = f"; give file.{name} of the file that vf.load_scene returns"
            raise wrong(f"dump_scene: {name}", repr(given), f"vofem.io.scene_file.{kind.__name__}", cure)
    file = target(path, (".toml",))
    text = scene_to_toml(scene, run, output, file.parent, respond)
    return write_text(file, text, overwrite=overwrite)


def point_named(scene: Scene, text: str) -> Any:
    """Return the point of a text such as 'beam@1.0', as in scene files; raise `ArgumentError` if there is none."""
    book = Book(Path.cwd(), {body.name: body for body in scene.bodies})
    point = AtPoint().read(text, Place(book))
    if book.problems:
        raise ArgumentError(f"point: {book.problems[0][1]}")
    return point


def _text(file: Path) -> str:
    try:
        # A pipe may bring a scene; a device such as /dev/zero never ends.
        if file.is_char_device() or file.is_block_device():
            raise SceneFileError(str(file), [("", "this is a device, expected a scene file")])
        raw = file.read_bytes()
    except FileNotFoundError:
        folder = file.parent
        others = tuple(p.name for p in folder.glob("*.toml")) if folder.is_dir() else ()
        message = f"the file does not exist; relative paths start at '{Path.cwd()}'{nearest(file.name, others)}"
        raise SceneFileError(str(file), [("", message)]) from None
    except OSError as error:
        # Of a folder that may not be entered, methods of Path raise.
        folder_itself = os.path.isdir(file)
        what = "this is a directory, expected a scene file" if folder_itself else f"the file cannot be read: {error}"
        raise SceneFileError(str(file), [("", what)]) from error
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        message = f"line {line} is not UTF-8 (byte 0x{raw[error.start]:02x}); save the file as UTF-8"
        raise SceneFileError(str(file), [("", message)]) from None


def _syntax_error(file: Path, text: str, message: str) -> SceneFileError:
    """Return the error of a file that is no TOML, with line, column and the line itself."""
    lines = text.split("\n")
    place = re.search(r" \(at line (\d+), column (\d+)\)", message)
    end = " (at end of document)"
    if place is not None:
        line, column = int(place[1]), int(place[2])
        shown = f"{message.replace(place[0], '')}, in {lines[line - 1].strip()[:80]!r}"
    elif end in message:
        line, column = len(lines), len(lines[-1]) + 1
        shown = f"{message.replace(end, '')}, at the end of the file"
    else:
        return SceneFileError(str(file), [("", f"this is not TOML: {message}")])
    return SceneFileError(str(file), [("", f"line {line}, column {column}: {shown}")])
