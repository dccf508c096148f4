"""Histories as CSV files: a header with units and a line for each time. Numbers are written with all digits."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Mapping
from typing import Any

from vofem.errors import ArgumentError
from vofem.files.whole import writer
from vofem.histories.tables import history_columns, named_points
from vofem.histories.variables import MOTION
from vofem.result import Result


@writer(".csv")
def write_csv(result: Result, points: Mapping[str, Any] | Iterable[Any], path: str | os.PathLike[str]) -> None:
    """Write the motion of points, force and K_eq of contacts, and force and slip speed of sliders, at the run's times.

    Parameters
    ----------
    result : Result
    points : dict of str to point, or iterable of points
        The points; the keys of a dict are their names in the header.
    """
    if not isinstance(result, Result):
        raise ArgumentError(f"write_csv: result is {result!r}, expected the Result of vofem.simulate")
    columns: dict[str, Any] = {"t [s]": result.times}
    found = history_columns(result, named_points("write_csv", result.scene, points))
    write_columns(columns | {f"{name} [{unit}]": values for name, (values, unit) in found.items()}, path)


@writer(".csv")
def write_probes(result: Result, path: str | os.PathLike[str]) -> None:
    """Write displacement, velocity and acceleration of the points that were recorded at every step.

    Parameters
    ----------
    result : Result

    Raises
    ------
    ArgumentError
        If nothing was recorded.
    """
    if result.recorded is None:
        raise ArgumentError("this run has recorded no points; name them in probes= when simulating")
    columns: dict[str, Any] = {"t [s]": result.recorded.times}
    for name, history in result.probes.items():
        columns |= {f"{name} {what} [{unit}]": getattr(history, what) for what, _, unit in MOTION}
    write_columns(columns, path)


def write_columns(columns: dict[str, Any], path: str | os.PathLike[str]) -> None:
    """Write columns of equal length, arrays of numbers or lists of numbers and text, under their names."""
    rows = zip(*(column if isinstance(column, list) else column.tolist() for column in columns.values()), strict=True)
    with open(path, "w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(columns)
        lines.writerows([value if isinstance(value, str | None) else repr(value) for value in row] for row in rows)
