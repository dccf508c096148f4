"""Tables of sweeps as CSV."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from vofem.files.whole import target
from vofem.io.csv_file import write_columns
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
    rows = sweep.points.rows
    columns: dict[str, Any] = {name: [row[name] for row in rows] for name in sweep.points.names}
    for name in sweep:
        column = sweep[name].reshape(len(rows), -1)
        heads = [name] if column.shape[1] == 1 else [f"{name}[{k}]" for k in range(column.shape[1])]
        columns |= zip(heads, column.T, strict=True)
    return write_columns(columns | {sweep.error_column: sweep.errors()}, goal)
