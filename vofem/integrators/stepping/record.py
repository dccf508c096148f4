"""The record of a stepping run: states at wanted times, and contact events."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.stepped import quintic
from vofem.integrators.stepping.probes import Tap, record
from vofem.kernels.jit import jit, plain_form
from vofem.laws.rows import Rows
from vofem.linalg.vectors import copy
from vofem.system import CLOSED, OPEN

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Room for events between two looks at the record, and for those of how many steps at least.
_EVENTS, _STEPS_OF_EVENTS = 4096, 4

#: Gap functions are known to this many units of rounding of the displacements and gaps of the scene.
_ROUNDING = 64.0 * float(np.finfo(float).eps)


class LastStep(NamedTuple):
    """The end of the last step: state, internal variables of the laws, and the totals of work and dissipation.

    The totals are pairs: at the end of the step, and at its start. `size`, shape (1,), is the largest sum of
    displacements and gap of any contact so far, m.
    """

    q: Array
    v: Array
    a: Array
    work: Array
    dissipated: Array
    internal: Array
    size: Array


def no_step(n: int, internal: Array) -> LastStep:
    """Return an empty record of the last step of n unknowns, with the internal variables of hysteretic laws."""
    return LastStep(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(2), np.zeros(2), internal.copy(), np.zeros(1))


class Motion(NamedTuple):
    """Displacements, velocities and accelerations of all unknowns, each (n,)."""

    q: Array
    v: Array
    a: Array


class Record(NamedTuple):
    """What compiled loops record of a run.

    Attributes
    ----------
    times : ndarray, shape (n_times,)
        Times at which states are stored, s.
    q, v, a : ndarray, shape (n, n_times)
    work, dissipated : ndarray, shape (n_times,)
    histories : ndarray, shape (3, n_laws, n_times)
        Force, stored energy and loss of the hysteretic laws and, last, of the springpots.
    past : ndarray, shape (size, 1)
        Internal variables of the hysteretic laws at the last `wanted` time.
    wanted : ndarray of bool, shape (n_times,)
        Times at which results are wanted; the others serve the checks of the run.
    cursor : ndarray of int, shape (2,)
        Number of times that are stored, now and before the last step.
    events : ndarray, shape (room, 3)
        Time, contact and status of the events since the last call of `take_events`.
    happened : ndarray of int, shape (1,)
        Number of these events.
    probes : Tap or None
        Points that are recorded at every step.
    contact_checks : ndarray, shape (n_contacts, 8)
        What the checks of the run know of every contact, see `checks`.
    """

    times: Array
    q: Array
    v: Array
    a: Array
    work: Array
    dissipated: Array
    histories: Array
    past: Array
    wanted: NDArray[np.bool_]
    cursor: IntArray
    events: Array
    happened: IntArray
    probes: Tap | None
    contact_checks: Array


#: Fields of a record that hold one entry for every time, and what is known at the last one.
_STORED = ("times", "q", "v", "a", "work", "dissipated", "histories", "past", "wanted")


def record_of(
    times: Array, n: int, contacts: int, probes: Tap | None, laws: int = 0, past: int = 0,
    checks: tuple[Array, Array] | None = None,
) -> Record:  # fmt: skip
    """Return an empty record of n unknowns and some contacts.

    Parameters
    ----------
    times : ndarray
        Times at which states are wanted, s.
    n, contacts : int
    probes : Tap or None
    laws, past : int
        Number of laws with internal variables, and of these variables in all.
    checks : (ndarray, ndarray), optional
        Further times, which the checks of the run use, and the record of contacts for these checks.
    """
    wanted = np.ones(times.size, dtype=bool)
    table = np.empty((0, 8))
    if checks is not None:
        further, table = checks
        more = further[~np.isin(further, times)]
        times, wanted = np.concatenate([times, more]), np.append(wanted, np.zeros(more.size, dtype=bool))
        order = np.argsort(times, kind="stable")
        times, wanted = times[order], wanted[order]
    q, v, a = np.full((3, n, times.size), np.nan)
    work, dissipated = np.zeros((2, times.size))
    histories, last = np.zeros((3, laws, times.size)), np.zeros((past, 1))
    events = np.empty((max(_EVENTS, _STEPS_OF_EVENTS * contacts) if contacts else 0, 3))
    cursor, happened = np.zeros(2, dtype=np.int64), np.zeros(1, dtype=np.int64)
    return Record(
        times, q, v, a, work, dissipated, histories, last, wanted, cursor, events, happened, probes, table
    )  # fmt: skip


def stored(out: Record) -> dict[str, Any]:
    """Return views of what is stored, by field."""
    count = int(out.cursor[0])
    return {name: getattr(out, name)[..., :count] for name in _STORED}


def shortened(out: Record) -> Record:
    """Return a copy of a record up to what is stored."""
    return out._replace(**{name: part.copy() for name, part in stored(out).items()})


def take_events(out: Record) -> Array:
    """Return the events (time, contact, status), one a row, and make room for others."""
    found = out.events[: int(out.happened[0])].copy()
    out.happened[0] = 0
    return found


@jit
def store(out: Record, t: float, dt: float, first: bool, before: LastStep, now: Motion, arriving: Array) -> None:
    """Store all wanted times up to t, where a step of size dt ends, and the points that are recorded at every step.

    The state at t is stored as it is. States inside the step are interpolated between both ends; `arriving` is the
    acceleration just before t, which is that of `now` where the motion is smooth at t.
    """
    _store_points(out.probes, t, now)
    out.cursor[1] = out.cursor[0]
    while out.cursor[0] < out.times.size and out.times[out.cursor[0]] <= t + 1e-9 * dt:
        cursor = out.cursor[0]
        x = 1.0 - (t - out.times[cursor]) / dt
        if first or x >= 1.0 - 1e-9:
            x = 1.0
            _set_column(now.q, out.q, cursor)
            _set_column(now.v, out.v, cursor)
            _set_column(now.a, out.a, cursor)
        else:
            for i in range(now.v.size):
                out.q[i, cursor], out.v[i, cursor], out.a[i, cursor] = quintic(
                    x, dt, before.q[i], before.v[i], before.a[i], now.q[i], now.v[i], arriving[i]
                )
        out.work[cursor] = x * before.work[0] + (1.0 - x) * before.work[1]
        out.dissipated[cursor] = x * before.dissipated[0] + (1.0 - x) * before.dissipated[1]
        out.cursor[0] = cursor + 1


@jit
def _store_points(probes: Tap | None, t: float, now: Motion) -> None:
    if probes is not None:
        record(probes, t, now.q, now.v, now.a)


@jit
def _set_column(values: Array, into: Array, column: int) -> None:
    """Copy a vector into a column of a matrix."""
    for i in range(values.size):
        into[i, column] = values[i]


@plain_form(_set_column)
def _set_whole_column(values: Array, into: Array, column: int) -> None:
    into[:, column] = values


@jit
def leave(before: LastStep, q: Array, v: Array, a: Array) -> None:
    """Make a state the end of the last step."""
    copy(q, before.q)
    copy(v, before.v)
    copy(a, before.a)
    before.work[1] = before.work[0]
    before.dissipated[1] = before.dissipated[0]


@jit
def rounding(rows: Rows, j: int, gap: float, q: Array, before: LastStep) -> float:
    """Return the size below which the gap function of contact j at q is rounding, m.

    Displacements are known to the rounding of the largest that any contact has had, and so are gap functions.
    """
    size = abs(gap)
    for e in range(rows.start[j], rows.start[j + 1]):
        size += abs(rows.weight[e] * q[rows.column[e]])
    before.size[0] = max(before.size[0], size)
    return _ROUNDING * before.size[0]


@jit
def switched(s: float, status: int, noise: float) -> bool:
    """Return whether the gap function contradicts a status by more than what may be rounding."""
    return s < -noise if status == CLOSED else s > noise


@jit
def log_event(out: Record, j: int, t: float, dt: float, before: float, s: float) -> int:
    """Enter an event of contact j in the step of size dt to t; return its new status.

    The crossing is placed on the chord of the gap function, from `before` to s.
    """
    part = before / (before - s) if before != s else 1.0
    count, status = out.happened[0], CLOSED if s > 0.0 else OPEN
    out.events[count, 0] = t - dt * (1.0 - min(max(part, 0.0), 1.0))
    out.events[count, 1] = j
    out.events[count, 2] = status
    out.happened[0] = count + 1
    return status
