"""Histories as CSV files: a header with units and a line for each time. Numbers are written with all digits."""

from __future__ import annotations

import csv
import os
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vofem.errors import ArgumentError
from vofem.files.whole import replacing, target
from vofem.histories.tables import history_columns, named_points
from vofem.result import Result

#: Rows that are written first if time is short, and by how many times more at most the next time.
_FIRST_ROWS, _FINER = 256, 8


def write_csv(result: Result, points: Mapping[str, Any] | Iterable[Any], path: str | os.PathLike[str]) -> Path:
    """Write displacement and velocity of points, and force and K_eq of contacts, at the times of the run.

    Parameters
    ----------
    result : Result
    points : dict of str to point, or iterable of points
        The points; the keys of a dict are their names in the header.
    path : path of a .csv

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    goal = target(path, (".csv",))
    return _write_histories(result, named_points("write_csv", result.scene, points), None, goal)


def write_csv_within(
    seconds: float, result: Result, points: Mapping[str, Any] | Iterable[Any], path: str | os.PathLike[str]
) -> int:
    """Write what `write_csv` does at as many of the stored times as some seconds suffice for, evenly spread.

    Parameters
    ----------
    seconds : float
    result, points, path
        As for `write_csv`.

    Returns
    -------
    int
        How many stored times there are for each one that is written; 1 if all are.
    """
    goal, named = target(path, (".csv",)), named_points("write_csv", result.scene, points)
    each, end = 1, time.monotonic() + seconds
    while result.times.size > _FIRST_ROWS * each:
        each *= _FINER
    while True:
        begun = time.monotonic()
        _write_histories(result, named, None if each == 1 else result.times[::each], goal)
        now = time.monotonic()
        fits = (end - now) / max(now - begun, 1e-9)
        if each == 1 or fits < 2.0:
            return each
        each //= min(_FINER, each, 2 ** int(np.log2(fits)))


def _write_histories(result: Result, points: dict[str, Any], t: Any, goal: Path) -> Path:
    """Write histories at some times in s, or at all stored times."""
    columns: dict[str, Any] = {"t [s]": result.times if t is None else t}
    found = history_columns(result, points, t)
    return write_columns(columns | {f"{name} [{unit}]": values for name, (values, unit) in found.items()}, goal)


def write_probes(result: Result, path: str | os.PathLike[str], each: int = 1) -> Path:
    """Write displacement, velocity and acceleration of the points that were recorded at every step.

    Parameters
    ----------
    result : Result
    path : path of a .csv
    each : int
        One of so many steps is written.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    ArgumentError
        If nothing was recorded.
    OutputError
        If the file cannot be written.
    """
    goal = target(path, (".csv",))
    if result.recorded is None:
        raise ArgumentError("this run has recorded no points; name them in probes= when simulating")
    columns: dict[str, Any] = {"t [s]": result.recorded.times}
    for name, history in result.probes.items():
        columns[f"{name} displacement [m]"] = history.displacement
        columns[f"{name} velocity [m/s]"] = history.velocity
        columns[f"{name} acceleration [m/s^2]"] = history.acceleration
    return write_columns({name: values[::each] for name, values in columns.items()}, goal)


def write_columns(columns: dict[str, Any], goal: Path) -> Path:
    """Write columns of equal length, arrays of numbers or lists of text, under their names."""
    rows = zip(*(column if isinstance(column, list) else column.tolist() for column in columns.values()), strict=True)
    with replacing(goal) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows([value if isinstance(value, str) else repr(value) for value in row] for row in rows)
    return goal
