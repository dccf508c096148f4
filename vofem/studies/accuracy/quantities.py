"""The quantities in which two runs are compared: the history of a point, events, impulses and energy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.result import Result


@dataclass(frozen=True)
class Observed:
    """The quantities of a run that are compared."""

    times: Array  #: Times of comparison, s, shape (n_times,).
    history: Array  #: Displacement of the point, m, shape (n_times,).
    events: tuple[Array, ...]  #: Closings and openings of every declared contact, s.
    impulse: Array  #: Time integral of every declared contact's force, N s, shape (n_contacts,).
    energy: Array  #: Kinetic, strain and contact energy together, J, shape (n_times,).


@dataclass(frozen=True)
class Errors:
    """The differences of a run from another one. Pointwise errors are taken up to the horizon of chaos.

    Attributes
    ----------
    largest, rms : float
        Largest and root mean square error of the displacement of the point, m.
    events : float
        Largest shift of a contact event in s; inf if the numbers of events differ, NaN if no contact closes.
    impulse : float
        Largest relative difference of a contact's impulse over the whole run; NaN without contact force.
    energy : float
        Largest difference of the energy, relative to the largest energy.
    level : float
        Relative difference of the rms displacement over the whole run, which has a meaning beyond the horizon too.
    """

    largest: float
    rms: float
    events: float
    impulse: float
    energy: float
    level: float


def observe(result: Result, point: Any) -> Observed:
    """Return the quantities of a run that are compared, at its times."""
    contacts = [result.contacts[contact.name] for contact in result.scene.contacts]
    events = tuple(part.copy() for contact in contacts for part in (contact.closings, contact.openings))
    times = result.times
    impulse = [float(np.trapezoid(contact.force, times)) if contact.closings.size else 0.0 for contact in contacts]
    return Observed(times, result.displacement(point), events, np.array(impulse), result.energy.total)


def compare(run: Observed, other: Observed, horizon: float) -> Errors:
    """Return the errors of a run against another one of the same times."""
    until = run.times <= horizon
    difference = np.abs(run.history - other.history)[until]
    energy, size = np.abs(run.energy - other.energy)[until], float(np.max(np.abs(other.energy)))
    scale = float(np.max(np.abs(other.impulse), initial=0.0))
    level = _rms(other.history)
    return Errors(
        largest=float(np.max(difference)),
        rms=_rms(difference),
        events=_event_error(run.events, other.events, horizon),
        impulse=float(np.max(np.abs(run.impulse - other.impulse))) / scale if scale > 0.0 else np.nan,
        energy=float(np.max(energy)) / size if size > 0.0 else 0.0,
        level=abs(_rms(run.history) - level) / level if level > 0.0 else 0.0,
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _event_error(found: tuple[Array, ...], expected: tuple[Array, ...], horizon: float) -> float:
    shifts = []
    for mine, theirs in zip(found, expected, strict=True):
        wanted = theirs[theirs <= horizon]
        last = np.max(np.append(mine, theirs), initial=0.0)
        if mine.size < wanted.size or (horizon >= last and mine.size != theirs.size):
            return float("inf")
        shifts.append(np.abs(mine[: wanted.size] - wanted))
    every = np.concatenate(shifts) if shifts else np.empty(0)
    return float(np.max(every)) if every.size else np.nan
