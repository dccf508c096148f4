"""Free motion of blocks ``z' = v, v' = -2 delta v - p z``, the one form in which every motion is computed.

The blocks of a contact status come from its eigenproblem. Loads are blocks too: a harmonic is an oscillator without
damping, a line ``(f, f')`` is one without stiffness, and the constant 1 is a line. A load acts on the structure through
the steady answer, which is a constant matrix. So nothing is forced, and every quantity (a gap, a velocity, the reaction
of a pinned contact) is a row over the states of all blocks.

A steady answer would divide by almost zero where a block resonates with a load, or is slower than the run. Such a block
is coupled: it has no answer to this load and is driven by it from rest,

    z' = v + a1 f + b1 f',    v' = -2 delta v - p z + a2 f + b2 f'.

All motions are evaluated as changes since the beginning of a segment, which are accurate however small they are. The
small penetration of a stiff contact is therefore far more accurate than the displacement to which it is added.
"""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.clusters import Group, group_change
from vofem.kernels.addresses import address_of, call
from vofem.kernels.jit import CompiledFunction, borrowed, jit, plain_form
from vofem.kernels.mode import kernels
from vofem.linalg.exponential import exponential_response, oscillator_change, power_response, ramp_response
from vofem.linalg.oscillators import (
    DELTA,
    SQUARE,
    oscillator_times,
    oscillators_at,
    oscillators_at_once,
)

Integers = NDArray[np.int64]


#: Equal steps in which states are followed before rows over them are computed.
_AT_ONCE = 128

#: Numbers that `respond` takes: delta, p, the load's squared frequency, value and rate, four gains, two derivatives.
_TAKES = 11


class Response(NamedTuple):
    """What computes the responses of coupled blocks from rest."""

    address: int  #: Of `respond`; 0 where no block is coupled, and the function is not compiled.
    numbers: Array  #: Work space, shape (_TAKES + 2,).


def response(coupled: bool) -> Response:
    """Return what computes responses from rest, for the way in which kernels run at present."""
    return Response(address_of(cast(CompiledFunction, respond)) if coupled else 0, np.empty(_TAKES + 2))


class Blocks(NamedTuple):
    """The blocks of loads, and after them those of the structure."""

    of: Array  #: See `linalg.oscillators`, shape (8, m).
    #: Coupled blocks, the loads that drive them, and the second derivatives of these loads, -1 for none, as numbers of
    #: blocks. A line that is bent is driven by its second derivative; the third number is then -2. Shape (r, 3).
    pair: Integers
    gain: Array  #: a1, b1, a2, b2 of each pair, shape (r, 4).
    #: Blocks that are not independent. Without them what is computed for them is left out of the machine code.
    group: Group | None
    work: Array  #: Work space, shape (7, m).
    response: Response


def ready(blocks: Blocks) -> Blocks:
    """Return blocks that kernels may move, in the way in which these run at present."""
    return blocks._replace(response=response(blocks.pair.size > 0))


def blocks_of(of: Array, pair: Integers, gain: Array, group: Group | None) -> Blocks:
    """Return blocks with work space. They may be kept for long, so addresses are set by `ready` where they move."""
    return Blocks(of, pair, gain, group, np.empty((7, of.shape[1])), response(False))


@jit
def _special_response(delta: float, p: float, b: complex, g1: complex, g2: complex, tau: float) -> tuple[float, float]:
    """Return the response (z, v) from rest of a block to ``exp(b tau)``."""
    d = exponential_response(delta, p, b, tau)
    rate = b * d + oscillator_change(delta, p, tau)[1]
    return (g1 * (rate + 2.0 * delta * d) + g2 * d).real, (g2 * rate - p * g1 * d).real


@jit
def respond(bent: int, p: Any, z: Any, tau: float, unused: float) -> float:
    """Write the response (z, v) from rest of a block to a load at tau.

    `bent`: whether the load has second and third derivatives.
    `p`: of the block delta in 1/s and p in 1/s^2; the load's squared frequency in 1/s^2, 0 for a line; its value and
    rate at tau = 0; the four gains; and the load's derivatives.
    `z`: filled.
    """
    delta, square, f, rate = p[0], p[2], p[3], p[4]
    if square > 0.0:
        w = np.sqrt(square)
        wave = complex(f, -rate / w)
        g1, g2 = complex(p[5], w * p[6]) * wave, complex(p[7], w * p[8]) * wave
        z[0], z[1] = _special_response(delta, p[1], complex(0.0, w), g1, g2, tau)
        return 0.0
    g1, g2 = complex(p[5] * f + p[6] * rate, 0.0), complex(p[7] * f + p[8] * rate, 0.0)
    z[0], z[1] = _special_response(delta, p[1], 0.0j, g1, g2, tau)
    if rate != 0.0:
        d0 = ramp_response(delta, p[1], tau)
        d1 = exponential_response(delta, p[1], 0.0j, tau).real
        r1, r2 = p[5] * rate, p[7] * rate
        z[0] += r1 * (d1 + 2.0 * delta * d0) + r2 * d0
        z[1] += r2 * d1 - p[1] * r1 * d0
    if bent:
        _add_bent(p, z, tau)
    return 0.0


@jit
def _add_bent(p: Any, z: Any, tau: float) -> None:
    """Add the response from rest of a slow block to the bent part of a load, by its derivatives."""
    delta, second, third, before = p[0], p[9], p[10], power_response(p[0], p[1], 0, tau)
    for k in range(1, 4):
        # The share of tau^k/k! in the load and in its rate.
        f = second if k == 2 else (third if k == 3 else 0.0)
        rate = second if k == 1 else (third if k == 2 else 0.0)
        now = power_response(p[0], p[1], k, tau)
        g1, g2 = p[5] * f + p[6] * rate, p[7] * f + p[8] * rate
        z[0] += g1 * (before + 2.0 * delta * now) + g2 * now
        z[1] += g2 * before - p[1] * g1 * now
        before = now


@jit
def add_from_rest(
    of: Array, pair: Integers, gain: Array, address: int, numbers: Array, start: Array, tau: float, out: Array
) -> None:  # fmt: skip
    """Add the responses of coupled blocks from rest to changes of states, shape (2, m); see `Blocks` and `Response`."""
    for e in range(pair.shape[0]):
        k, j, bend = pair[e, 0], pair[e, 1], pair[e, 2]
        if bend == -2:
            out[0, k] += 0.5 * tau * tau * (start[0, j] + tau * start[1, j] / 3.0)
            out[1, k] += tau * (start[0, j] + 0.5 * tau * start[1, j])
            continue
        numbers[0], numbers[1], numbers[2] = of[DELTA, k], of[SQUARE, k], of[SQUARE, j]
        numbers[3], numbers[4] = start[0, j], start[1, j]
        for i in range(4):
            numbers[5 + i] = gain[e, i]
        if bend >= 0:
            numbers[9], numbers[10] = start[0, bend], start[1, bend]
        call(address, 1 if bend >= 0 else 0, numbers, 0, numbers, _TAKES, tau, 0.0)
        out[0, k] += numbers[_TAKES]
        out[1, k] += numbers[_TAKES + 1]


@jit
def _respond_all(blocks: Blocks, start: Array, tau: float, out: Array) -> None:
    respond = blocks.response
    add_from_rest(blocks.of, blocks.pair, blocks.gain, respond.address, respond.numbers, start, tau, out)


@jit
def change(blocks: Blocks, start: Array, tau: float, out: Array) -> None:
    """Write by how much the states of all blocks, shape (2, m), have changed at tau."""
    blocks, start, out = borrowed((blocks, start, out))
    of, both = blocks.of, blocks.work[5:]
    oscillators_at(of, tau, both, blocks.work)
    for k in range(of.shape[1]):
        z, v, delta = start[0, k], start[1, k], of[DELTA, k]
        out[0, k] = both[0, k] * z + both[1, k] * (v + delta * z)
        out[1, k] = both[0, k] * v - both[1, k] * (of[SQUARE, k] * z + delta * v)
    if blocks.pair.shape[0] > 0:
        _respond_all(blocks, start, tau, out)
    group_change(blocks.group, start, tau, out)


@plain_form(change)
def change_at_once(blocks: Blocks, start: Array, tau: float, out: Array) -> None:
    """Do what `change` does, for all blocks at once."""
    moved_at_once(blocks.of, start, tau, blocks.work, out)
    if blocks.pair.size:
        _respond_all(blocks, start, tau, out)
    if blocks.group is not None:
        group_change(blocks.group, start, tau, out)


def moved_at_once(of: Array, start: Array, tau: float, work: Array, out: Array) -> None:
    """Write by how much free motion has changed states of blocks, shape (2, m), at tau; `work` is of shape (7, m)."""
    both = work[5:]
    oscillators_at_once(of, tau, both, work)
    z, v = start
    delta = of[DELTA]
    np.add(both[0] * z, both[1] * (v + delta * z), out=out[0])
    np.subtract(both[0] * v, both[1] * (of[SQUARE] * z + delta * v), out=out[1])


def changes(blocks: Blocks, starts: Array, own: Integers, tau: Array) -> Array:
    """Return by how much states have changed, shape (n_times, 2, m).

    `starts` (shape (k, 2, m)): states at the beginnings of some segments.
    `own`, `tau` (shape (n_times,)): the row of `starts` for each time, and times from these beginnings, s.
    """
    found = np.empty((tau.size, *starts.shape[1:]))
    _changes(ready(blocks)._replace(group=None), np.ascontiguousarray(starts), own, tau, found)
    if blocks.group is not None:
        with kernels(compiled=False):
            for i, t in enumerate(tau.tolist()):
                group_change(blocks.group, starts[own[i]], t, found[i])
    return found


@jit
def _changes(blocks: Blocks, starts: Array, own: Integers, tau: Array, out: Array) -> None:
    for i in range(tau.size):
        change(blocks, starts[own[i]], tau[i], out[i])


@plain_form(_changes)
def _changes_at_once(blocks: Blocks, starts: Array, own: Integers, tau: Array, out: Array) -> None:
    c, s = oscillator_times(blocks.of, tau)
    z, v, delta = starts[own, 0], starts[own, 1], blocks.of[DELTA]
    out[:, 0] = c * z + s * (v + delta * z)
    out[:, 1] = c * v - s * (blocks.of[SQUARE] * z + delta * v)
    if not blocks.pair.size:
        return
    bends = blocks.pair[:, 2] == -2
    for k, j, _ in blocks.pair[bends].tolist():
        second, third = starts[own, 0, j], starts[own, 1, j]
        out[:, 0, k] += 0.5 * tau**2 * (second + tau * third / 3.0)
        out[:, 1, k] += tau * (second + 0.5 * tau * third)
    others = blocks._replace(pair=blocks.pair[~bends], gain=blocks.gain[~bends])
    for i in range(tau.size) if others.pair.size else ():
        _respond_all(others, starts[own[i]], tau[i], out[i])


def at_steps(
    blocks: Blocks, starts: Array, steps: Array, counts: Integers, rows: Array, begin: Array, places: Integers,
    out: Array,
) -> None:  # fmt: skip
    """Write values of rows after 0, 1, 2, ... equal steps in segments, into `out` (k, n_times).

    `starts` (shape (j, 2, m)): states at the beginnings of the segments.
    `steps`, `counts`, `places` (shape (j,)): lengths and numbers of the steps, and the columns of the first values.
    `rows` (shape (k, 2m)), `begin` (k, j): rows over all blocks, and their values at the beginnings.
    """
    with kernels(compiled=False) if blocks.group is not None else nullcontext():
        _at_steps(ready(blocks), np.ascontiguousarray(starts), steps, counts, rows, begin, places, out)


@jit
def _at_steps(
    blocks: Blocks, starts: Array, steps: Array, counts: Integers, rows: Array, begin: Array, places: Integers,
    out: Array,
) -> None:  # fmt: skip
    of, m, both = blocks.of, starts.shape[2], blocks.work[5:]
    now, moved = np.empty((2, m)), np.empty((2, m))
    # Sums of changes keep small motions exact.
    total, own = np.empty((_AT_ONCE, 2 * m)), np.empty((4, m))
    loads = 0
    for driver in blocks.pair[:, 1:].ravel():
        loads = max(loads, int(driver) + 1)
    for j in range(steps.size):
        oscillators_at(of, steps[j], both, blocks.work)
        # Responses from rest are linear in values and rates of the loads.
        driven = np.zeros((2, loads, 2, m))
        for i in range(2 * loads):
            now[:] = 0.0
            now[i % 2, i // 2] = 1.0
            _respond_all(blocks, now, steps[j], driven[i % 2, i // 2])
        for k in range(m):
            c, s, delta = both[0, k], both[1, k], of[DELTA, k]
            own[0, k], own[1, k], own[2, k], own[3, k] = c + s * delta, s, -s * of[SQUARE, k], c - s * delta
        first, last = starts[j], np.zeros((2, m))
        for done in range(0, counts[j] + 1, _AT_ONCE):
            some = min(_AT_ONCE, counts[j] + 1 - done)
            for i in range(some):
                for k in range(m):
                    total[i, k], total[i, m + k] = last[0, k], last[1, k]
                    z, v = first[0, k] + last[0, k], first[1, k] + last[1, k]
                    moved[0, k], moved[1, k] = own[0, k] * z + own[1, k] * v, own[2, k] * z + own[3, k] * v
                for e in range(loads):
                    z, v = first[0, e] + last[0, e], first[1, e] + last[1, e]
                    for k in range(m):
                        moved[0, k] += driven[0, e, 0, k] * z + driven[1, e, 0, k] * v
                        moved[1, k] += driven[0, e, 1, k] * z + driven[1, e, 1, k] * v
                for k in range(m):
                    last[0, k] += moved[0, k]
                    last[1, k] += moved[1, k]
            found = rows @ total[:some].T
            for r in range(rows.shape[0]):
                for i in range(some):
                    out[r, places[j] + done + i] = begin[r, j] + found[r, i]


@plain_form(_at_steps)
def _at_steps_at_once(
    blocks: Blocks, starts: Array, steps: Array, counts: Integers, rows: Array, begin: Array, places: Integers,
    out: Array,
) -> None:  # fmt: skip
    for j in range(steps.size):
        tau = steps[j] * np.arange(counts[j] + 1)
        moved = changes(blocks, starts[j : j + 1], np.zeros(tau.size, dtype=np.int64), tau)
        out[:, places[j] : places[j] + tau.size] = rows @ moved.reshape(tau.size, rows.shape[1]).T + begin[:, j : j + 1]
