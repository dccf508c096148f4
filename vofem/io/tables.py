"""Tables of a run as text: contact events and energies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.result import Result

#: Of forces, which are printed with six digits.
_TOLERANCE = 1e-7


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

    Parameters
    ----------
    result : Result
    name : str
        Name of the contact.
    most : int
        How many impacts are shown; the rest is counted.
    forces : bool
        Whether speed, force and impulse are shown. Where the structure is large or damped, they may take as long as
        the run; the times are known at once.
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


def energy_table(result: Result, rows: int = 6) -> str:
    """Return energies at some of the run's times, evenly spaced, and the error of their balance."""
    energy = result.energy
    names = ("kinetic", "strain", "contact", "dissipated", "work")
    lines = [f"{'t [s]':>9}" + "".join(f"   {name + ' [J]':>14}" for name in names)]
    wanted = np.linspace(result.times[0], result.times[-1], rows)
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
