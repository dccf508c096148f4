"""How small changes grow along an event-driven run: free motion between events and the maps of `tangent` at events."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.loop import from_blocks, to_blocks
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.integrators.event_driven.search import BLOCKS
from vofem.integrators.event_driven.table import OF, Statuses
from vofem.integrators.event_driven.tangent import drifted
from vofem.kernels.addresses import floats, shaped
from vofem.kernels.jit import jit
from vofem.kernels.mode import compiled
from vofem.linalg.exponential import oscillator_change
from vofem.linalg.oscillators import DELTA, SQUARE
from vofem.linalg.vectors import inner
from vofem.system import CLOSED, OPEN, PINNED

Status = NDArray[np.int64]

#: Segments whose impacts are computed together.
_BLOCK = 4096

#: Largest number of statuses for which the growth is computed in compiled code.
_MOST_STATUSES = 1000


def first_change(space: ModalSpace) -> tuple[Array, Array]:
    """Return the change, (n,) and (n,), whose growth is computed: all modes have one energy and different phases."""
    phase = 2.0 * np.pi * np.modf(np.arange(1, space.size + 1) * 0.6180339887498949)[0]
    amplitude = 1.0 / np.sqrt(space.size)
    return amplitude * np.cos(phase) / _frequency(space), amplitude * np.sin(phase)


def _frequency(space: ModalSpace) -> Array:
    return np.sqrt(np.where(space.stiffness > 0, space.stiffness, 1.0))


def growth_along(solution: Any) -> Array:
    """Return the decimal logarithm of the size of a change at the ends of segments, shape (n_segments + 1,).

    `solution`: an `EventSolution`.
    An event that is met without speed, as at a grazing, is left out.
    """
    record, space = solution.record, solution.space
    table, bounces_in = _free_table(solution), lru_cache(1)(lambda block: _bounces_in(solution, block))
    growth, index, frequency = np.zeros(record.segments + 1), 0, _frequency(space)
    z, v = (part[:, None] for part in first_change(space))
    while index < record.segments:
        if table is not None:
            z, v = np.ascontiguousarray(z[:, 0]), np.ascontiguousarray(v[:, 0])
            done = _follow(table, solution, bounces_in(index // _BLOCK), index, z, v, growth)
            z, v = z[:, None], v[:, None]
            if done > index:
                index = done
                continue
        z, v = drifted(solution.spectrum(index), z, v, record.durations[index])
        events = solution.passage(index)
        if events is not None:
            moved = events.passed(z, v)
            z, v = moved if np.isfinite(moved[1]).all() else (z, v)
        index += 1
        size = float(np.hypot(np.linalg.norm(v), np.linalg.norm(frequency * z[:, 0])))
        growth[index] = growth[index - 1] + (np.log10(size) if size > 0.0 else 0.0)
        z, v = (z / size, v / size) if size > 0.0 else (z, v)
    return growth


def _free_table(solution: Any) -> Statuses | None:
    """Return the statuses of a run without pinned contacts and groups, for compiled code; None where there are none."""
    statuses = solution.record.statuses
    if not compiled() or len(statuses) > _MOST_STATUSES:
        return None
    held = Statuses(1)
    for number, status in enumerate(statuses):
        if not np.any(status == PINNED):
            regime = solution.regime(status, 0)
            if regime.blocks.group is None:
                held.enter(regime, number, 0)
    held.make_room(len(statuses))
    return held if len(held.table) else None


class _Bounced(NamedTuple):
    """The impacts at the ends of some segments that turn the speed at one rigid stop and do nothing else."""

    first: int  #: Number of the first of the segments.
    stop: Status  #: The stop, -1 where there is no impact, and -2 where one does more, shape (k,).
    turned: Array  #: One plus the restitution, over the squared norm of the modal row, shape (k,).
    kick: Array  #: By which velocities change for each m of the gap function, 1/s, shape (k, n).


def _bounces_in(solution: Any, block: int) -> _Bounced:
    """Return the bounces in a block of segments; see `tangent.passage`."""
    record, space, laws = solution.record, solution.space, solution.system.contacts
    part = slice(block * _BLOCK, min((block + 1) * _BLOCK, record.segments))
    count = part.stop - part.start
    found = _Bounced(part.start, np.full(count, -1), np.zeros(count), np.zeros((count, space.size)))
    if laws is None or not laws.rigid.any():
        return found
    contact, status = (array[: record.events] for array in record.buffers[-2:])
    logged = np.append(record.logged, record.events)[part.start : part.stop + 1]
    mine = np.flatnonzero(laws.rigid[contact[logged[0] : logged[-1]]]) + logged[0]
    found.stop[np.searchsorted(logged, mine, side="right") - 1] = -2
    twice = np.flatnonzero((found.stop == -2) & (np.diff(logged) == 2))
    one = logged[twice]
    single = (contact[one] == contact[one + 1]) & (status[one] == CLOSED) & (status[one + 1] == OPEN)
    k, stop = twice[single], contact[one[single]]
    rows, index = space.contacts[stop], part.start + k
    z, before = record.buffers.displacement[index].T, record.buffers.velocity[index].T
    rates, turned = np.einsum("mn,nm->m", rows, before), (1.0 + laws.restitution[stop]) / np.sum(rows**2, axis=1)
    later = before - rows.T * (turned * rates)
    statuses, gaps = np.array(record.statuses)[record.status_numbers[index]].T, space.contacts @ z - laws.gap[:, None]
    first, last = (
        solution.acceleration(record.starts[index], z, v, laws.force(gaps, space.contacts @ v, statuses))
        for v in (before, later)
    )
    found.stop[k], found.turned[k] = stop, turned
    met = rates > 0.0
    change = last - first + rows.T * (turned * np.einsum("mn,nm->m", rows, first))
    found.kick[k[met]] = (change[:, met] / rates[met]).T
    return found


def _follow(table: Statuses, solution: Any, bounces: _Bounced, index: int, z: Array, v: Array, growth: Array) -> int:
    """Follow segments from one on in compiled code, until a status has no slot; return the first one not treated."""
    record, laws, none = solution.record, solution.system.contacts, np.zeros(0)
    force, damping = none, none
    if laws is not None:
        force, damping = np.where(laws.jump, laws.stiffness * laws.gap, 0.0), np.array(laws.damping, dtype=float)
    return int(
        _travel(
            table.table, table.slots[:, 0].copy(), np.array(record.statuses), record.status_numbers, record.durations,
            record.buffers.velocity, np.array(solution.space.contacts), force, damping, _frequency(solution.space),
            *bounces, index, z, v, growth,
        )
    )  # fmt: skip


@jit
def _drift(delta: Array, p: Array, z: Array, v: Array, t: float) -> None:
    for k in range(p.size):
        c, s = oscillator_change(delta[k], p[k], t)
        c += 1.0
        z[k], v[k] = c * z[k] + s * (v[k] + delta[k] * z[k]), c * v[k] - s * (p[k] * z[k] + delta[k] * v[k])


@jit
def _travel(
    table: Status, slots: Status, statuses: Status, numbers: Status, durations: Array, velocity: Array, rows: Array,
    force: Array, damping: Array, frequency: Array, begin: int, stop: Status, turned: Array, kick: Array, index: int,
    z: Array, v: Array, growth: Array,
) -> int:  # fmt: skip
    """Do what `growth_along` does, for many segments without pinned contacts; return the first one not treated."""
    n, segments = z.size, numbers.size
    both, change = np.empty((3, 2 * n)), np.empty(n)
    while index < begin + stop.size:
        s, struck = slots[numbers[index]], stop[index - begin]
        after = numbers[index + 1] if index + 1 < segments else numbers[index]
        if s < 0 or slots[after] < 0 or struck == -2:
            return index
        before, after_status = statuses[numbers[index]], statuses[after]
        slot = table[s]
        of, loads = shaped(floats(slot[OF]), (SQUARE + 1, slot[BLOCKS])), slot[BLOCKS] - n
        to_blocks(slot, z, v, both)
        _drift(of[DELTA, loads:], of[SQUARE, loads:], both[0, :n], both[0, n:], durations[index])
        from_blocks(slot, both, z, v)
        growth[index + 1] = growth[index] + _scaled(frequency, z, v)
        if after != numbers[index]:
            change[:] = 0.0
            for j in range(rows.shape[0]):
                if before[j] == after_status[j]:
                    continue
                speed = inner(rows[j], velocity[index + 1])
                if speed == 0.0:
                    continue
                push = damping[j] * speed + force[j]
                factor = (-1.0 if after_status[j] == CLOSED else 1.0) * push * inner(rows[j], z) / speed
                for k in range(n):
                    change[k] += factor * rows[j, k]
            for k in range(n):
                v[k] += change[k]
            growth[index + 1] += _scaled(frequency, z, v)
        elif struck >= 0:
            row, factor = rows[struck], turned[index - begin]
            met, rate = inner(row, z), inner(row, v)
            for k in range(n):
                z[k] -= factor * met * row[k]
                v[k] += kick[index - begin, k] * met - factor * rate * row[k]
            growth[index + 1] += _scaled(frequency, z, v)
        index += 1
    return index


@jit
def _scaled(frequency: Array, z: Array, v: Array) -> float:
    """Scale a perturbation to size 1; return the decimal logarithm of its size."""
    square = 0.0
    for k in range(z.size):
        square += v[k] ** 2 + (frequency[k] * z[k]) ** 2
    size = np.sqrt(square)
    if size == 0.0:
        return 0.0
    for k in range(z.size):
        z[k] /= size
        v[k] /= size
    return float(np.log10(size))
