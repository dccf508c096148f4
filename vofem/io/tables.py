"""Tables of runs, branches, sweeps and studies of accuracy: as text for a terminal, and as CSV files."""

from __future__ import annotations

import os
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vofem.bodies.base import as_point
from vofem.files.whole import writer
from vofem.histories.table import by_name
from vofem.io.csv_file import write_columns
from vofem.result import Result

if TYPE_CHECKING:
    from vofem.studies.accuracy import Study
    from vofem.studies.accuracy.study import Run
    from vofem.studies.steady import Branch
    from vofem.studies.sweep import Sweep

#: Of forces, which are printed with six digits.
_TOLERANCE = 1e-7


# -- runs ---------------------------------------------------------------------------------------------


def contact_tables(result: Result, most: int = 8, *, forces: bool = True) -> str:
    """Return the tables of the first contacts that close; the rest, those of a foundation say, are counted."""
    touched = [name for name, history in result.contacts.items() if history.closings.size]
    parts = [contact_table(result, name, forces=forces) for name in touched[:most]]
    if len(touched) > most:
        parts.append(f"and {len(touched) - most} more contacts that close")
    idle = len(result.contacts) - len(touched)
    if idle:
        parts.append(f"{idle} of {len(result.contacts)} contacts do not close")
    return "\n\n".join(parts) or "There are no contacts"


def contact_table(result: Result, name: str, most: int = 20, *, forces: bool = True) -> str:
    """Return a line per impact of a contact: when it closes and opens, approach speed, peak force and impulse.

    `name`: name of the contact.
    `most`: how many impacts are shown; the rest is counted.
    `forces`: whether speed, force and impulse are shown. Where the structure is large or damped, they may take as long
    as the run; the times are known at once.
    """
    history = result.contacts[name]
    units = history.units
    head = f"{'':>7}   {'closes [s]':>14}   {'opens [s]':>14}   {'lasts [s]':>11}"
    why = ""
    columns: tuple[NDArray[np.float64], ...] = ()
    if forces:
        impacts = history.first_impacts(most, _TOLERANCE)
        closings, openings, ended, why = impacts.closing, impacts.opening, impacts.ended, impacts.why
        columns = (impacts.approach_speed, impacts.peak_force, impacts.impulse)
        head += (
            f"   {f'at [{units.coordinate}/s]':>11}   {f'peak force [{units.force}]':>14}"
            f"   {f'impulse [{units.impulse}]':>14}"
        )
    else:
        closings, openings = history.closings[:most], history.openings[:most]
        ended = np.arange(closings.size) < openings.size
        openings = np.append(openings, result.solution.t_end)[: closings.size]
    if not closings.size:
        return f"Contact {name!r} does not close"
    lines = [f"Contact {name!r}", head]
    for k, (closing, opening) in enumerate(zip(closings, openings, strict=True)):
        numbers = "".join(f"   {_number(float(column[k]), 14 if i else 11)}" for i, column in enumerate(columns))
        lines.append(
            f"{k + 1:7d}   {closing:14.9f}   {opening:14.9f}{' ' if ended[k] else '+'}  "
            f"{opening - closing:11.6f}{numbers}"
        )
    count = history.closings.size
    if count > most:
        lines.append(f"{'...':>7}   and {count - most} more")
    if not np.all(ended):
        lines.append(f"{'+':>7}   still closed at the end")
    if why:
        lines.append(f"{'-':>7}   not known: {why}")
    return "\n".join(lines)


def _number(value: float, width: int = 14) -> str:
    """Return a number for a column; what is not known is a dash."""
    return f"{value:{width}.6g}" if np.isfinite(value) else f"{'-':>{width}}"


def energy_table(result: Result) -> str:
    """Return energies at six of the run's times, evenly spaced, and the error of their balance."""
    energy = result.energy
    names = ("kinetic", "strain", "contact", "dissipated", "work")
    lines = [f"{'t [s]':>9}" + "".join(f"   {name + ' [J]':>14}" for name in names)]
    wanted = np.linspace(result.times[0], result.times[-1], 6)
    for i in np.unique([int(np.argmin(np.abs(result.times - t))) for t in wanted]):
        values = "".join(f"   {getattr(energy, name)[i]:14.4e}" for name in names)
        lines.append(f"{result.times[i]:9.4g}{values}")
    lines.append(f"energy balance holds to {energy.balance_error:.1e} of the largest energy")
    return "\n".join(lines)


def counter_line(result: Result) -> str:
    """Return what the run took, on one line; zeros are left out."""
    counters = vars(result.counters)
    shown = ", ".join(
        f"{name.replace('_', ' ')} {value}" for name, value in counters.items() if value and name != "events"
    )
    return f"{result.counters.events} contact events; work by {result.method}: {shown}"


# -- branches and sweeps ------------------------------------------------------------------------------


@writer(".csv")
def write_branch(branch: Branch, point: Any, path: str | os.PathLike[str], parameter: str = "parameter") -> None:
    """Write a line for each orbit and, among them, each special point of a branch.

    It has the parameter, the frequency, the amplitude, the stability (1 or 0) and the largest multiplier, the last two
    empty where they are not known, and the kind of a special point.
    """
    table = branch.table(point, parameter)
    heads = zip(table.headings(), table, strict=True)
    columns: dict[str, Any] = by_name("write_branch: parameter", ((head, table[name].tolist()) for head, name in heads))
    columns["stable"] = [None if known is None else int(known) for known in columns["stable"]]
    columns["largest multiplier"] = [None if np.isnan(one) else one for one in columns["largest multiplier"]]
    write_columns(columns, path)


def branch_table(branch: Branch, point: Any, parameter: str = "parameter") -> str:
    """Return the special points of a branch as text, a line for each."""
    place = as_point("branch_table: point", point, branch.orbits[0].scene.bodies if len(branch) else ())
    stable = branch.stable.tolist()
    known = f"{stable.count(True)} stable, {stable.count(False)} unstable, {stable.count(None)} not decided"
    lines = [f"{len(branch)} orbits: {known}"]
    if branch.special:
        lines += ["", f"{'special point':16}  {parameter:>24}  {f'amplitude of {place.name} [m]':>28}"]
    for special in branch.special:
        name = special.kind.replace("_", " ") + (f" ({special.contact})" if special.contact else "")
        lines.append(f"{name:16}  {special.value:24.15g}  {special.orbit.amplitude(place):28.9g}")
    return "\n".join(lines)


@writer(".csv")
def write_sweep(sweep: Sweep, path: str | os.PathLike[str]) -> None:
    """Write a line for each point of a sweep.

    Columns are the parameters, the quantities (one column an entry where they are arrays), and the error of a point
    that failed.
    """
    rows = sweep.points.rows
    columns: list[tuple[str, Any]] = [(name, [row[name] for row in rows]) for name in sweep.points.names]
    for name in sweep:
        column = sweep[name].reshape(len(rows), -1)
        heads = [name] if column.shape[1] == 1 else [f"{name}[{k}]" for k in range(column.shape[1])]
        columns += zip(heads, column.T, strict=True)
    write_columns(by_name("write_sweep", [*columns, (sweep.error_column, sweep.errors())]), path)


# -- studies of accuracy ------------------------------------------------------------------------------


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
    values = [_short(value / scale) for value in (total.largest, total.rms, run.time.largest, run.space, run.rounding)]
    values.append("-" if np.isnan(run.order) else f"{run.order:.2f}")
    values += [_short(value) for value in (total.events, total.impulse, total.energy)]
    start = f"{setting!s:{width}}  {setting.elements:8d}  {run.seconds:9.3g}  {run.steps:8d}"
    return start + "".join(f"  {value:>11}" for value in values)


def _short(value: float) -> str:
    if np.isnan(value):
        return "-"
    return "differ" if np.isinf(value) else f"{value:.1e}"


@writer(".csv")
def write_study(study: Study, path: str | os.PathLike[str]) -> None:
    """Write a line for each run of a study, lengths in m and times in s, as `Run` and `Errors` say."""
    rows = [
        {
            **{name: getattr(run.setting, name) for name in ("method", "elements", "dt", "tol")},
            **{name: getattr(run, name) for name in ("unknowns", "seconds")},
            "assembly_seconds": run.assembly,
            "work": run.work,
            **run.counters,
            **{f"{name}_error": value for name, value in asdict(run.total).items()},
            **{f"steps_{name}_error": value for name, value in asdict(run.time).items()},
            "mesh_error": run.space,
            "rounding": run.rounding,
            "order": run.order,
            "relative_error": study.relative(run),
            "reference_floor": study.reference.floor,
            "reference_horizon": study.reference.horizon,
        }
        for run in study.runs
    ]
    write_columns({name: [row[name] for row in rows] for name in (rows[0] if rows else ())}, path)
