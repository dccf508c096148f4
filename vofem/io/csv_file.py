"""Histories as a CSV file: one line per time, a header with units, numbers that read back bit for bit."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vofem.io.files import replacing, target
from vofem.result import Result


def write_csv(result: Result, points: Mapping[str, Any] | Iterable[Any], path: str | os.PathLike[str]) -> Path:
    """Write displacement and velocity of points, and force and K_eq of contacts, at the run's times.

    Parameters
    ----------
    result : Result
    points : dict of str to point, or iterable of points
        By the names that the header gives them.
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
    named = points if isinstance(points, Mapping) else {point_name(point): point for point in points}
    columns: dict[str, Any] = {"t [s]": result.times}
    for name, point in named.items():
        columns[f"{name} displacement [m]"] = result.displacement(point)
        columns[f"{name} velocity [m/s]"] = result.velocity(point)
    for name, history in result.contacts.items():
        columns[f"{name} force [N]"] = history.force
        columns[f"{name} stiffness [N/m]"] = history.stiffness
    rows = np.stack(list(columns.values()), axis=1)
    with replacing(goal) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows([repr(value) for value in row] for row in rows.tolist())
    return goal


def point_name(point: Any) -> str:
    """Return a point as scene files name it: ``beam@1.0``, or the name of a mass."""
    return f"{point.body.name}@{float(point.x)!r}" if hasattr(point, "x") else str(point.body.name)
