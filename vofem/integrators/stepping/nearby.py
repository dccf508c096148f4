"""Whether a run is chaotic: how far a second run of the same steps, from a start nearby, departs from it.

The start of the second run is disturbed by a billionth of the motion, in the
shape that the motion has at one time. Two regular runs part slowly: where
frequencies depend on amplitudes, in proportion to time. Two chaotic runs part
exponentially, so a thousandfold growth takes no longer the second time
than the first. Steps of `generalized_alpha` and `central_difference` that do
not resolve impacts can be chaotic where the structure is not, because the
energy that they lose or gain depends on where in a step a contact closes.

The second run costs as much as the run itself, without its set-up, and is
made where that takes less than a second.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ArgumentError, VofemError
from vofem.integrators.observer import deferred_interrupts
from vofem.integrators.registry import advice
from vofem.integrators.stepping.checks import DRIFT, LOWEST, PEAK
from vofem.integrators.stepping.record import Record
from vofem.integrators.stepping.run import Run
from vofem.kernels.mode import compiled
from vofem.system import State

Array = NDArray[np.float64]

#: Disturbance of the start over the largest displacement.
_DISTURBANCE = 1e-9

#: Growth of the disturbance by whose time the second run is judged, once and twice.
_GROWTH = 1e3

#: Time of twice that growth over the time of the first, from which on runs part slowly.
_SLOWLY = 2.5

#: Errors of steps over the motion of a contact, grown as differences do, above which there is a note, and the part of
#: the run in which differences that grow exponentially have not yet grown to the root of their last size.
_DRIFT, _EXPONENTIAL = 0.03, 0.2

#: Events below which no growth like that is to be expected.
_FEWEST_EVENTS = 8

#: Steps times unknowns, of which a step has some for itself, that take about a second: in compiled code, and in plain
#: Python. A second run that takes longer is made only if it was asked for.
_WORK, _WORK_PLAIN, _OWN = 5e6, 1e5, 20


def check_nearby(nearby: object) -> None:
    """Raise where the option is none that `note_growth` knows.

    Raises
    ------
    ArgumentError
    """
    if nearby is not None and not isinstance(nearby, bool):
        raise ArgumentError(
            f"simulate: nearby is {nearby!r}, expected True or False, or None to look for chaos where it takes less "
            "than a second"
        )


def note_growth(nearby: bool | None, run: Run, out: Record, again: Callable[[State], Run]) -> list[str]:
    """Return a note where a finished run of equal steps is chaotic, or where differences make much of its errors.

    Parameters
    ----------
    nearby : bool, optional
        Whether to make a second run; None makes it where it is worth its cost.
    run : Run
    out : Record
        The record of the run, with the states at the times of its checks.
    again : callable
        Takes a start; returns a run of the same steps.
    """
    system, start = run.system, run.start
    steps, events = run.counters.steps, run.counters.events
    if nearby is None:
        acts = events >= _FEWEST_EVENTS or run.laws.state.size > 0
        nearby = acts and steps * (_OWN + system.size) <= (_WORK if compiled() else _WORK_PLAIN)
    if not nearby or not run.finished:
        return []
    known = np.flatnonzero(np.isfinite(out.q[:, 0]))
    rows = known[~out.wanted[known]] if np.any(~out.wanted[known]) else known
    weight = system.scale[run.order]
    motion = weight * out.q[rows]
    size = float(np.max(np.abs(motion), initial=0.0))
    if size == 0.0 or rows.size < 3:
        return []
    at = rows[rows.size // 2]
    moved = float(np.max(np.abs(weight * out.q[at])))
    factor = _DISTURBANCE * size / max(moved, _GROWTH * _DISTURBANCE * size)
    beside = State(start.q + factor * out.q[at, run.back], start.v + factor * out.v[at, run.back], start.internal)
    found = _second(again(beside), out.times[rows])
    if found is None:
        return []
    apart = np.max(np.abs(weight * found - motion), axis=1) / size
    times, apart = out.times[rows], np.maximum.accumulate(apart)
    assert run.dt is not None
    return _judge(times, apart) or _grown(times, apart, out.contact_checks, run.dt)


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


def _grown(times: Array, apart: Array, contacts: Array, dt: float) -> list[str]:
    """Return a note where errors of steps of dt s, made all along a run, grow exponentially to a noticeable size."""
    growth = float(apart[-1]) / _DISTURBANCE
    if not contacts.size or not growth >= _GROWTH:
        return []
    root = np.sqrt(growth)
    drift, way = contacts[:, DRIFT], contacts[:, PEAK] - contacts[:, LOWEST]
    off = root * float(np.max(np.divide(drift, way, out=np.zeros(way.size), where=way > 0.0)))
    if off <= _DRIFT or times[np.argmax(apart >= root * _DISTURBANCE)] < _EXPONENTIAL * times[-1]:
        return []
    return [
        f"step: the errors of steps of {dt:.4g} s may add up to {min(off, 1.0):.2g} of the motion by the end of the "
        f"run, as differences grow {growth:.2g} times in it; reduce dt, or choose {advice(exact=True)} where it applies"
    ]
