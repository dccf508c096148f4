"""Branches of steady states as text and as CSV."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from vofem.bodies.base import as_point
from vofem.files.whole import target
from vofem.io.csv_file import write_columns
from vofem.studies.steady import Branch

_STABLE = {True: "1", False: "0", None: ""}


def write_branch(branch: Branch, point: Any, path: str | os.PathLike[str], parameter: str = "parameter") -> Path:
    """Write a branch as CSV: a line for each orbit.

    It has the parameter, the frequency, the amplitude, the stability and the largest multiplier. Special points are
    lines among the orbits, with their kind. Stability (1 or 0) and multipliers are empty if they are not known.

    Parameters
    ----------
    branch : Branch
    point : point of a body
    path : path of a .csv
    parameter : str
        Name of the parameter, for the header.

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
    place = as_point("write_branch: point", point)
    rows: list[tuple[float, float, Any, str]] = [
        (float(k), float(value), orbit, "")
        for k, (value, orbit) in enumerate(zip(branch.values, branch.orbits, strict=True))
    ]
    rows += [(special.place, special.value, special.orbit, special.kind) for special in branch.special]
    rows.sort(key=lambda row: row[0])
    orbits = [orbit for _, _, orbit, _ in rows]
    extremes = np.array([orbit.extremes(place) for orbit in orbits]).reshape(-1, 2)
    omega = np.array([orbit.omega for orbit in orbits])
    columns: dict[str, Any] = {
        parameter: np.array([value for _, value, _, _ in rows]),
        "frequency [Hz]": omega / (2.0 * np.pi),
        "angular frequency [rad/s]": omega,
        f"{place.name} amplitude [m]": 0.5 * (extremes[:, 1] - extremes[:, 0]),
        f"{place.name} least [m]": extremes[:, 0],
        f"{place.name} largest [m]": extremes[:, 1],
        "stable": [_STABLE[orbit.stable] for orbit in orbits],
        "largest multiplier": [_largest(orbit) for orbit in orbits],
        "special": [kind for _, _, _, kind in rows],
    }
    return write_columns(columns, goal)


def _largest(orbit: Any) -> str:
    known = orbit.multipliers
    return "" if known is None else repr(float(np.abs(known).max(initial=0.0)))


def branch_table(branch: Branch, point: Any, parameter: str = "parameter") -> str:
    """Return the special points of a branch as text, a line for each."""
    place = as_point("branch_table: point", point)
    stable = branch.stable.tolist()
    known = f"{stable.count(True)} stable, {stable.count(False)} unstable, {stable.count(None)} not decided"
    lines = [f"{len(branch)} orbits: {known}"]
    if branch.special:
        lines += ["", f"{'special point':16}  {parameter:>24}  {f'amplitude of {place.name} [m]':>28}"]
    for special in branch.special:
        name = special.kind.replace("_", " ") + (f" ({special.contact})" if special.contact else "")
        lines.append(f"{name:16}  {special.value:24.15g}  {special.orbit.amplitude(place):28.9g}")
    return "\n".join(lines)
