"""Study files: a scene file with a table ``[sweep]`` that names keys, their values, and what is measured."""

from __future__ import annotations

import functools
import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vofem._validate import MANY, nearest
from vofem.arrays import Array
from vofem.effects.kinds import AtPoint
from vofem.errors import ArgumentError, SceneFileError, VofemError
from vofem.io.scene_file import SceneFile, read_content, scene_text
from vofem.parameters import changed
from vofem.parameters.place import Book, Place
from vofem.result import Result

#: Of the displacement of a point at the stored times, in m: how the numbers are drawn together.
OF_POINTS: dict[str, Callable[[Array], Any]] = {
    "amplitude": lambda u: 0.5 * np.ptp(u),
    "largest": lambda u: np.abs(u).max(),
    "mean": np.mean,
    "rms": lambda u: np.sqrt(np.mean(np.square(u))),
    "maximum": np.max,
    "minimum": np.min,
    "final": lambda u: u[-1],
}

#: Of a contact over a window of time: quantities of its statistics. The number of closings is that of its history.
OF_CONTACTS = ("closings", "peak_force", "rms_force", "closed_share")

#: Of the run as a whole.
OF_RUNS: dict[str, Callable[[Result], Any]] = {
    "balance_error": lambda result: result.energy.balance_error,
    "segments": lambda result: result.counters.steps,
}


def quantity(result: Result, kind: str, of: Any, after: float) -> float:
    """Return a quantity of a run, a point or a contact from the time `after` on, in s; of a point, at stored times.

    Raises `ArgumentError` for what a run with steps does not tell of a contact.
    """
    if kind in OF_POINTS:
        return float(OF_POINTS[kind](result.displacement(of)[result.times >= after]))
    if kind == "closings":
        return float(np.count_nonzero(result.contacts[of].closings >= after))
    if kind in OF_CONTACTS:
        found = result.contacts[of].statistics((after, result.solution.t_end))
        value = float(getattr(found, kind))
        if np.isnan(value):
            raise ArgumentError(f"{kind} of contact {of!r} is not known: {found.why}")
        return value
    return float(OF_RUNS[kind](result))


_KEYS = ("values", "measure", "after")
_LINE = ("start", "stop", "count")


@dataclass(frozen=True)
class StudyFile:
    """What a study file holds."""

    path: Path
    #: The values of each parameter, by the dotted path of its key; the grid of all combinations is meant.
    values: dict[str, list[Any]]
    measure: dict[str, dict[str, str]]  #: What is measured, by name, as the file says it.
    after: float  #: Quantities are taken from this time on, s.
    content: dict[str, Any]  #: The tables of the scene.
    text: str  #: The file as it stands: the order of its tables is that of the bodies.

    def function(self) -> Any:
        """Return the function of a point that a sweep calls, which other processes can import."""
        # Of the text, reading needs the headers beside the tables.
        order = "\n".join(line.strip() for line in self.text.splitlines() if line.lstrip().startswith("["))
        return functools.partial(
            measured, content=json.dumps(self.content), order=order, folder=str(self.path.parent),
            measure=self.measure, after=self.after,
        )  # fmt: skip


def load_study(path: str | os.PathLike[str]) -> StudyFile:
    """Read a study file.

    `path`: TOML in UTF-8: a scene file with a table ``[sweep]``.
    Raises `SceneFileError` with all that is wrong in the table ``[sweep]``, in the scene, and in the scenes with the
    first and the last value of each parameter.
    """
    file, text, content = scene_text(path)
    sweep = content.pop("sweep", None)
    if not isinstance(sweep, dict):
        message = "missing, expected a table [sweep] with values and measure" if sweep is None else "expected one table"
        raise SceneFileError(str(file), [("sweep", message)])
    scene_file = read_content(content, text, file)
    book = Book(file.parent, {body.name: body for body in scene_file.scene.bodies})
    place = Place(book).key("sweep")
    place.unknown_keys(sweep, _KEYS)
    values = _values(sweep.get("values"), place.key("values"))
    after = sweep.get("after", 0.0)
    t_end = None if scene_file.run is None else scene_file.run.t_end
    if t_end is None:
        Place(book).key("run").report("missing, expected a table [run] with t_end: how long each run lasts")
    if isinstance(after, bool) or not isinstance(after, (int, float)) or not 0.0 <= after < (t_end or np.inf):
        place.key("after").expected(f"a time in s, not negative and before t_end = {t_end} s", after)
        after = 0.0
    measure = sweep.get("measure")
    _measures(measure, scene_file, place.key("measure"))
    for name, series in values.items():
        _try_values(name, series, content, text, file, place.key("values").key(name))
    if book.problems:
        raise SceneFileError(str(file), book.problems)
    return StudyFile(file, values, dict(measure or {}), float(after), content, text)


def measured(
    content: str, order: str, folder: str, measure: dict[str, dict[str, str]], after: float, **point: Any
) -> dict[str, float]:
    """Run a scene with the values of a point and return what is measured."""
    tables = changed(json.loads(content), point)
    file = read_content(tables, order, Path(folder) / "study")
    result = file.simulate()
    found = _measures(measure, file, Place(Book(Path(folder), {body.name: body for body in file.scene.bodies})))
    return {name: quantity(result, *one, after) for name, one in found.items()}


def _values(given: Any, place: Place) -> dict[str, list[Any]]:
    """Return the values of each parameter by its dotted path."""
    if not isinstance(given, dict) or not given:
        place.expected("a table such as { 'contact.stop.gap' = [0.01, 0.02] }", given)
        return {}
    result: dict[str, list[Any]] = {}

    def add(table: dict[str, Any], before: str, here: Place) -> None:
        for key, value in table.items():
            path, at = f"{before}{key}", here.key(key)
            if isinstance(value, dict) and set(value) == set(_LINE):
                series = _line(value, at)
            elif isinstance(value, dict) and value:
                add(value, f"{path}.", at)
                continue
            elif isinstance(value, list) and value:
                series = value
            else:
                at.expected("an array of values, or { start = ..., stop = ..., count = ... }", value)
                continue
            result[path] = series

    add(given, "", place)
    return result


def _line(given: dict[str, Any], place: Place) -> list[float]:
    start, stop, count = (given[name] for name in _LINE)
    sound = all(isinstance(v, (int, float)) and not isinstance(v, bool) and np.isfinite(v) for v in (start, stop))
    if not sound or isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MANY:
        place.report(f"expected numbers start and stop and a whole number count from 1 to {MANY}")
        return []
    return [float(value) for value in np.linspace(start, stop, count)]


def _measures(given: Any, file: SceneFile, place: Place) -> dict[str, tuple[str, Any]]:
    """Return what is measured, a quantity and what it is one of, by name; what is wrong is noted at `place`."""
    if not isinstance(given, dict) or not given:
        place.expected("a table such as { tip = { amplitude = 'beam@1.0' } }", given)
        return {}
    contacts = tuple(effect.name for effect in file.scene.contacts)
    result: dict[str, tuple[str, Any]] = {}
    for name, one in given.items():
        here = place.key(name)
        kinds = (*OF_POINTS, *OF_CONTACTS, *OF_RUNS)
        if not isinstance(one, dict) or len(one) != 1:
            here.expected(
                f"a table with one key, such as {{ amplitude = 'beam@1.0' }}; keys are {', '.join(kinds)}", one
            )
            continue
        ((kind, of),) = one.items()
        if kind in OF_POINTS:
            result[name] = kind, AtPoint().read(of, here.key(kind))
        elif kind in OF_CONTACTS:
            if of not in contacts:
                hint = nearest(of, contacts) if isinstance(of, str) else ""
                here.key(kind).expected(f"the name of a contact, one of {list(contacts)}", of, hint)
            result[name] = kind, of
        elif kind in OF_RUNS:
            result[name] = kind, None
        else:
            here.unknown_keys(one, kinds)
    return result


def _try_values(name: str, series: list[Any], content: dict[str, Any], text: str, file: Path, place: Place) -> None:
    """Note what is wrong with the first and the last value of a parameter."""
    for value in (series[0], series[-1]) if series else ():
        try:
            read_content(changed(content, {name: value}), text, file)
        except SceneFileError as error:
            for key, message in error.problems:
                place.report(f"with the value {value!r}: {key}: {message}")
        except ArgumentError as error:
            place.report(str(error).removeprefix(f"{name!r}: "))
        except VofemError as error:
            place.report(f"with the value {value!r}: {error}")
        else:
            continue
        return
