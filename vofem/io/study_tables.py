"""Studies of accuracy as text and as CSV."""

from __future__ import annotations

import csv
import os
from dataclasses import fields
from pathlib import Path

import numpy as np

from vofem.files.whole import replacing, target
from vofem.studies.accuracy import Study
from vofem.studies.accuracy.quantities import Errors
from vofem.studies.accuracy.study import Run
from vofem.system import Counters

_COUNTERS = tuple(field.name for field in fields(Counters))
_ERRORS = tuple(field.name for field in fields(Errors))


def study_table(study: Study) -> str:
    """Return a study as text: the machine, the reference, a line per run, and what was left out."""
    reference = study.reference
    lines = [
        f"Displacement of {study.point} over {study.t_end:g} s; errors over its largest value, {reference.scale:.4g} m",
        f"Reference: {reference.how}, known to {study.floor:.1e}",
        f"Machine: {study.machine}",
    ]
    if reference.horizon < study.t_end:
        lines.append(f"Chaotic: errors are taken until t = {reference.horizon:.4g} s, beyond which rounding rules")
    head = ("error", "rms", "of steps", "of mesh", "of rounding", "order", "events [s]", "impulse", "energy")
    width = max([len(str(run.setting)) for run in study.runs], default=0)
    lines += [
        "",
        f"{'run':{width}}  {'elements':>8}  {'time [s]':>9}  {'steps':>8}" + "".join(f"  {name:>11}" for name in head),
    ]
    lines += [_line(study, run, width) for run in study.runs]
    if study.left_out:
        lines += ["", "Left out"]
        lines += [f"  {out.setting}, {out.setting.elements} elements: {out.why}" for out in study.left_out]
    return "\n".join(lines)


def _line(study: Study, run: Run, width: int) -> str:
    scale = study.reference.scale or 1.0
    total, setting = run.total, run.setting
    values = [_number(value / scale) for value in (total.largest, total.rms, run.time.largest, run.space, run.rounding)]
    values.append("-" if np.isnan(run.order) else f"{run.order:.2f}")
    values += [_number(value) for value in (total.events, total.impulse, total.energy)]
    start = f"{setting!s:{width}}  {setting.elements:8d}  {run.seconds:9.3g}  {run.steps:8d}"
    return start + "".join(f"  {value:>11}" for value in values)


def _number(value: float) -> str:
    if np.isnan(value):
        return "-"
    return "differ" if np.isinf(value) else f"{value:.1e}"


def write_study(study: Study, path: str | os.PathLike[str]) -> Path:
    """Write a study as CSV, a line per run, whole or not at all.

    Parameters
    ----------
    study : Study
    path : path of a .csv
        Lengths are in m, times in s, as the attributes of `Run` and `Errors` say.

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
    head = ["method", "elements", "dt", "tol", "unknowns", "seconds", "assembly_seconds", "work", *_COUNTERS]
    head += [f"{name}_error" for name in _ERRORS] + [f"steps_{name}_error" for name in _ERRORS]
    head += ["mesh_error", "rounding", "order", "relative_error", "reference_floor", "reference_horizon"]
    with replacing(goal) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(head)
        for run in study.runs:
            setting = run.setting
            row: list[object] = [setting.method, setting.elements, setting.dt, setting.tol, run.unknowns]
            row += [run.seconds, run.assembly, run.work, *(run.counters[name] for name in _COUNTERS)]
            row += [getattr(run.total, name) for name in _ERRORS] + [getattr(run.time, name) for name in _ERRORS]
            row += [run.space, run.rounding, run.order, study.relative(run), study.reference.floor]
            writer.writerow([*row, study.reference.horizon])
    return goal
