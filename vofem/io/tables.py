"""Tables of a run as text: contact events and energies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.effects.two_points import units_of
from vofem.errors import ArgumentError
from vofem.histories import ContactHistory
from vofem.result import Result

#: Times at which a contact's force is looked at, per closed interval.
_SAMPLES = 2000


def contact_tables(result: Result, most: int = 8) -> str:
    """Return the tables of the first contacts that close; the rest, those of a foundation say, are counted."""
    touched = [name for name, history in result.contacts.items() if history.closings.size]
    parts = [contact_table(result, name) for name in touched[:most]]
    if len(touched) > most:
        parts.append(f"and {len(touched) - most} more contacts that close")
    idle = len(result.contacts) - len(touched)
    if idle:
        parts.append(f"{idle} of {len(result.contacts)} contacts do not close")
    return "\n\n".join(parts) or "There are no contacts"


def contact_table(result: Result, name: str, most: int = 20) -> str:
    """Return a line per closed interval of a contact: when it closes and opens, peak force and impulse.

    Parameters
    ----------
    result : Result
    name : str
        Of the contact.
    most : int
        How many intervals are shown; the rest is counted.
    """
    history = result.contacts[name]
    closings, openings = history.closings, history.openings
    if not closings.size:
        return f"Contact {name!r} does not close"
    units = units_of(result.scene.effects, name)
    lines = [
        f"Contact {name!r}",
        f"{'':>7}   {'closes [s]':>14}   {'opens [s]':>14}   {'lasts [s]':>11}"
        f"   {f'peak force [{units.force}]':>14}   {f'impulse [{units.impulse}]':>14}",
    ]
    for k, closing in enumerate(closings[:most]):
        ended = k < openings.size
        opening = float(openings[k]) if ended else float(result.times[-1])
        peak, impulse = _peak_and_impulse(result, history, closing, max(closing, opening))
        lines.append(
            f"{k + 1:7d}   {closing:14.9f}   {opening:14.9f}{' ' if ended else '+'}  {opening - closing:11.6f}"
            f"   {_number(peak)}   {_number(impulse)}"
        )
    if closings.size > most:
        lines.append(f"{'...':>7}   and {closings.size - most} more")
    if openings.size < closings.size <= most:
        lines.append(f"{'+':>7}   still closed at the end")
    return "\n".join(lines)


def _number(value: float) -> str:
    """Return a number for a column; what the stored times are too few for is a dash."""
    return f"{value:14.6g}" if np.isfinite(value) else f"{'-':>14}"


def _peak_and_impulse(result: Result, history: ContactHistory, closing: float, opening: float) -> tuple[float, float]:
    """Return the largest force and the impulse of a closed interval; NaN where the run did not store enough of it."""
    # Midpoints: at the ends the force of the jump law has jumped, and the contact may already count as open.
    step = (opening - closing) / _SAMPLES
    try:
        force = _force(result, history, closing + step * (np.arange(_SAMPLES, dtype=float) + 0.5))
    except ArgumentError:
        # A stepping method that was asked for few times knows its contacts at those times only.
        return np.nan, np.nan
    return float(force[np.argmax(np.abs(force))]), float(step * np.sum(force))


def _force(result: Result, history: ContactHistory, times: NDArray[np.float64]) -> NDArray[np.float64]:
    index = list(result.contacts).index(history.name)
    return np.asarray(result.solution.contacts(times).force[index])


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
