"""Tables of sweeps as CSV."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np

from vofem.files.whole import replacing, target
from vofem.studies.sweep import Sweep


def write_sweep(sweep: Sweep, path: str | os.PathLike[str]) -> Path:
    """Write a sweep as CSV, a line per point, whole or not at all.

    Columns are the parameters, the quantities (one column an entry where they
    are arrays), and the error of a point that failed.

    Parameters
    ----------
    sweep : Sweep
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
    count = len(sweep.points.rows)
    head, columns = list(sweep.points.names), []
    for name in sweep:
        column = sweep[name].reshape(count, -1)
        head += [name] if column.shape[1] == 1 else [f"{name}[{k}]" for k in range(column.shape[1])]
        columns.append(column)
    errors = {one.index: one.error for one in sweep.failed}
    with replacing(goal) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*head, "error"])
        for k, point in enumerate(sweep.points.rows):
            values = [value.item() if isinstance(value, np.generic) else value for c in columns for value in c[k]]
            writer.writerow([*point.values(), *values, errors.get(k, "")])
    return goal
