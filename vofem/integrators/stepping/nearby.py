"""What a second run says of a run: whether it is chaotic, and how large the errors of its steps are.

Chaos shows in a second run of the same steps from a start nearby, disturbed by
a billionth of the motion, in the shape that the motion has at one time. Two
regular runs part slowly: where frequencies depend on amplitudes, in proportion
to time. Two chaotic runs part exponentially, so a thousandfold growth takes no
longer the second time than the first. Steps of `generalized_alpha` and
`central_difference` that do not resolve impacts can be chaotic where the
structure is not, because the energy that they lose or gain depends on where in
a step a contact closes.

Errors of steps show in a second run from the same start with larger steps: of
a method of second order, steps of r times the size make r^2 times the error.
Where a contact decides on the motion, neither the balance of energy nor the
errors of single steps tell how much impacts make of them.

A second run costs as much as the run itself or half of it, without its set-up,
and is made where that takes less than one or two seconds.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vofem._validate import flag_or_none
from vofem.arrays import Array
from vofem.errors import VofemError
from vofem.integrators.observer import deferred_interrupts
from vofem.integrators.registry import advice
from vofem.integrators.stepping.record import Record
from vofem.integrators.stepping.run import Run
from vofem.kernels.mode import compiled
from vofem.system import State

#: Disturbance of the start over the largest displacement.
_DISTURBANCE = 1e-9

#: Growth of the disturbance by whose time the second run is judged, once and twice.
_GROWTH = 1e3

#: Time of twice that growth over the time of the first, from which on runs part slowly.
_SLOWLY = 2.5

#: Errors of steps, over the largest displacement, above which there is a note.
_ERRORS = 0.02

#: Size of larger steps over that of the run. It is less where steps have a critical size, of which they may take a
#: part; where little is left, the second run has smaller steps.
_LARGER, _CRITICAL, _LITTLE, _SMALLER = 2.0, 0.95, 1.2, 0.5

#: Seconds that a run may take whose errors are looked for; larger steps take half of it.
_LONGER = 4.0

#: Events below which no chaos is to be expected.
_FEWEST_EVENTS = 8

#: Steps times unknowns, of which a step has some for itself, that take about a second: in compiled code, and in plain
#: Python. A second run that takes longer is made only if it was asked for.
_WORK, _WORK_PLAIN, _OWN = 5e6, 1e5, 20


def check_nearby(nearby: object) -> None:
    """Raise where the option is none that `note_growth` knows.

    Raises `ArgumentError`.
    """
    flag_or_none("simulate: nearby", nearby, "to make second runs where they take less than a second")


def note_growth(nearby: bool | None, run: Run, out: Record, again: Callable[[State], Run]) -> list[str]:
    """Return a note where a finished run of equal steps is chaotic.

    `nearby`: whether to make a second run; None makes it where it is worth its cost.
    `out`: the record of the run, with the states at the times of its checks.
    `again`: takes a start; returns a run of the same steps.
    """
    start = run.start
    if nearby is None:
        nearby = (run.counters.events >= _FEWEST_EVENTS or run.laws.state.size > 0) and _cheap(run)
    rows, motion = _checked(run, out) if nearby and run.finished else (np.empty(0, dtype=np.int64), np.empty(0))
    size = float(np.max(np.abs(motion), initial=0.0))
    if size == 0.0 or rows.size < 3:
        return []
    at = rows[rows.size // 2]
    moved = float(np.max(np.abs(motion[rows.size // 2])))
    factor = _DISTURBANCE * size / max(moved, _GROWTH * _DISTURBANCE * size)
    beside = State(start.q + factor * out.q[at, run.back], start.v + factor * out.v[at, run.back], start.internal)
    apart = _apart(run, again(beside), out.times[rows], motion)
    return [] if apart is None else _judge(out.times[rows], apart)


def note_errors(
    nearby: bool | None, run: Run, out: Record, critical: float | None, again: Callable[[float], Run]
) -> list[str]:
    """Return a note where steps of another size lead to another motion.

    `nearby`, `run`, `out`: as `note_growth` has them.
    `critical`: size in s that no step may reach.
    `again`: takes a size of steps in s; returns a run from the same start.
    """
    if nearby is None:
        nearby = (run.counters.events > 0 or run.laws.state.size > 0) and _cheap(run, _LONGER)
    rows, motion = _checked(run, out) if nearby and run.finished else (np.empty(0, dtype=np.int64), np.empty(0))
    if not np.any(motion):
        return []
    assert run.dt is not None
    ratio = _LARGER if critical is None else min(_LARGER, _CRITICAL * critical / run.dt)
    ratio = ratio if ratio > _LITTLE else _SMALLER
    apart = _apart(run, again(ratio * run.dt), out.times[rows], motion)
    if apart is None:
        return []
    errors = apart / abs(ratio**2 - 1.0)
    if errors[-1] <= _ERRORS:
        return []
    return [
        f"step: steps of {ratio * run.dt:.4g} s lead to another motion than these of {run.dt:.4g} s: errors of the "
        f"steps are some {min(errors[-1], 1.0):.2g} of the displacements, and more than {_ERRORS:g} from t = "
        f"{out.times[rows][np.argmax(errors > _ERRORS)]:.4g} s on. Give a smaller dt, or choose {advice(exact=True)} "
        "where it applies"
    ]


def _cheap(run: Run, seconds: float = 1.0) -> bool:
    """Return whether the steps of a run take less than about so many seconds."""
    return run.counters.steps * (_OWN + run.system.size) <= seconds * (_WORK if compiled() else _WORK_PLAIN)


def _checked(run: Run, out: Record) -> tuple[NDArray[np.int64], Array]:
    """Return the rows of a record that are compared, and the displacements there in comparable units."""
    known = np.flatnonzero(np.isfinite(out.q[:, 0]))
    rows = known[~out.wanted[known]] if np.any(~out.wanted[known]) else known
    return rows, run.system.scale[run.order] * out.q[rows]


def _apart(run: Run, second: Run, times: Array, motion: Array) -> Array | None:
    """Return the largest distance of a second run so far, over the largest displacement; None where it found none."""
    found = _second(second, times)
    if found is None:
        return None
    distance = np.max(np.abs(run.system.scale[run.order] * found - motion), axis=1) / np.max(np.abs(motion))
    return np.maximum.accumulate(np.where(np.isfinite(distance), distance, np.inf))


def _second(run: Run, times: Array) -> Array | None:
    """Return the displacements of a second run at some times, or None where it found none or was interrupted."""
    out = run.record(times, None)
    with deferred_interrupts() as interrupted:
        try:
            while not run.finished:
                run.advance(out)
                run.switches.log.clear()
                if interrupted():
                    return None
        except VofemError:
            return None
    return out.q


def _judge(times: Array, apart: Array) -> list[str]:
    """Return a note where a disturbance grows exponentially; `apart` is relative, and does not fall."""
    first, second = (_DISTURBANCE * growth for growth in (_GROWTH, _GROWTH**2))
    if not apart[-1] >= second:
        return []
    once, twice = (float(times[np.argmax(apart >= level)]) for level in (first, second))
    if twice > _SLOWLY * once:
        return []
    tenfold = twice / np.log10(_GROWTH**2)
    return [
        f"chaos: two runs of these steps whose starts differ by {_DISTURBANCE:.0e} of the displacements are "
        f"{apart[-1]:.2g} of them apart at the end; a difference grows tenfold in some {tenfold:.2g} s. Errors of the "
        f"steps grow as quickly: one of 1e-4 is as large as the motion after some {4.0 * tenfold:.2g} s. What comes "
        f"later is a motion that the structure may have, not the one from this start: use statistics of it, or "
        f"choose {advice(exact=True)} where it applies, which says until when it holds. Where smaller steps leave "
        "this note out, the growth is that of steps which do not resolve the impacts"
    ]
