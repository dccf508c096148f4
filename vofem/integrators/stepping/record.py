"""The record of a stepping run: states at wanted times, and contact events."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.stepped import quintic
from vofem.integrators.stepping.probes import Tap, record
from vofem.laws.rows import Rows
from vofem.linalg.jit import jit
from vofem.system import CLOSED, OPEN

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Gap functions are known to this many units of rounding of the displacements and gaps of the scene.
_ROUNDING = 64.0 * float(np.finfo(float).eps)


class Trail(NamedTuple):
    """The last step: its state, the internal variables of its laws, and the totals of work and dissipation.

    The totals are pairs: at the end of the step, and at its start. `size`, shape (1,), is the largest sum of
    displacements and gap of any contact so far, m.
    """

    q: Array
    v: Array
    a: Array
    work: Array
    dissipated: Array
    memory: Array
    size: Array


def trail(n: int, memory: Array) -> Trail:
    """Return an empty record of the last step of n unknowns, with the internal variables of hysteretic laws."""
    return Trail(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(2), np.zeros(2), memory.copy(), np.zeros(1))


class Output(NamedTuple):
    """Wanted times and what is stored there: q, v, a of shape (n, n_times), and work and dissipation.

    `memory`, shape (3, n_laws, n_times), holds force, stored energy and loss of the hysteretic laws and, last, of the
    springpots. `past`, shape (size, 1), holds the internal variables of the hysteretic laws at the last `wanted` time.
    The times that are not `wanted` serve the checks of the run. Where `every_step` is true, the points of `tap` and
    the contacts in `watch` (see `checks`) are recorded at every step.
    """

    times: Array
    q: Array
    v: Array
    a: Array
    work: Array
    dissipated: Array
    memory: Array
    past: Array
    wanted: NDArray[np.bool_]
    every_step: bool
    tap: Tap
    watch: Array


def output(
    times: Array, n: int, tap: Tap, laws: int = 0, past: int = 0, looks: tuple[Array, Array] | None = None
) -> Output:
    """Return an empty record of n unknowns and some laws with internal variables, `past` numbers in all.

    States are stored at `times`. `looks` holds further times, which the checks of the run use, and the record of
    contacts for these checks.
    """
    wanted = np.ones(times.size, dtype=bool)
    table = np.empty((0, 8))
    if looks is not None:
        checks, table = looks
        more = checks[~np.isin(checks, times)]
        times, wanted = np.concatenate([times, more]), np.append(wanted, np.zeros(more.size, dtype=bool))
        order = np.argsort(times, kind="stable")
        times, wanted = times[order], wanted[order]
    q, v, a = np.full((3, n, times.size), np.nan)
    work, dissipated = np.zeros((2, times.size))
    histories, last = np.zeros((3, laws, times.size)), np.zeros((past, 1))
    return Output(times, q, v, a, work, dissipated, histories, last, wanted, tap.times.size > 0, tap, table)


def stored(out: Output, count: int) -> dict[str, Any]:
    """Return views of what is stored at the first `count` times, by field."""
    return {
        name: part[..., :count] for name, part in out._asdict().items() if name not in ("tap", "every_step", "watch")
    }


@jit
def store(
    out: Output,
    cursor: int,
    t: float,
    dt: float,
    first: bool,
    before: Trail,
    q: Array,
    v: Array,
    a: Array,
    arriving: Array,
) -> int:
    """Store all wanted times up to t, where a step of size dt ends; return the next one's index.

    The state at t is stored as it is. States inside the step are interpolated between both ends; `arriving` is the
    acceleration just before t, which is a where the motion is smooth at t. Points that are recorded at every step
    are recorded first.
    """
    if out.every_step:
        record(out.tap, t, q, v, a)
    while cursor < out.times.size and out.times[cursor] <= t + 1e-9 * dt:
        x = 1.0 - (t - out.times[cursor]) / dt
        if first or x >= 1.0 - 1e-9:
            x = 1.0
            out.q[:, cursor] = q
            out.v[:, cursor] = v
            out.a[:, cursor] = a
        else:
            for i in range(v.size):
                out.q[i, cursor], out.v[i, cursor], out.a[i, cursor] = quintic(
                    x, dt, before.q[i], before.v[i], before.a[i], q[i], v[i], arriving[i]
                )
        out.work[cursor] = x * before.work[0] + (1.0 - x) * before.work[1]
        out.dissipated[cursor] = x * before.dissipated[0] + (1.0 - x) * before.dissipated[1]
        cursor += 1
    return cursor


@jit
def leave(before: Trail, q: Array, v: Array, a: Array) -> None:
    """Make a state the one before."""
    before.q[:] = q
    before.v[:] = v
    before.a[:] = a
    before.work[1] = before.work[0]
    before.dissipated[1] = before.dissipated[0]


@jit
def rounding(rows: Rows, j: int, gap: float, q: Array, before: Trail) -> float:
    """Return the size below which the gap function of contact j at q is rounding, m.

    Displacements are known to the rounding of the largest that any contact has had, and so are gap functions.
    """
    size = abs(gap)
    for e in range(rows.start[j], rows.start[j + 1]):
        size += abs(rows.weight[e] * q[rows.column[e]])
    before.size[0] = max(before.size[0], size)
    return _ROUNDING * before.size[0]


@jit
def switched(s: float, status: int, noise: float = 0.0) -> bool:
    """Return whether the gap function contradicts a status by more than what may be rounding."""
    return s < -noise if status == CLOSED else s > noise


@jit
def log_event(events: Array, count: int, j: int, t: float, dt: float, before: float, s: float) -> Array:
    """Enter (time, contact, status) as event `count`; the crossing is placed on the chord of the gap function."""
    if count == events.shape[0]:
        more = np.empty((2 * count, 3))
        more[:count] = events
        events = more
    part = before / (before - s) if before != s else 1.0
    events[count, 0] = t - dt * (1.0 - min(max(part, 0.0), 1.0))
    events[count, 1] = j
    events[count, 2] = CLOSED if s > 0.0 else OPEN
    return events
