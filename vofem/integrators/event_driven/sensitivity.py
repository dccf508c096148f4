"""How small changes grow along an event-driven run: free motion between events and the maps of `tangent` at events."""

from __future__ import annotations

from typing import Any

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
from vofem.system import CLOSED, PINNED

Status = NDArray[np.int64]

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
    table = _free_table(solution) if solution.bounces is None else None
    growth, index, frequency = np.zeros(record.segments + 1), 0, _frequency(space)
    z, v = (part[:, None] for part in first_change(space))
    while index < record.segments:
        if table is not None:
            z, v = np.ascontiguousarray(z[:, 0]), np.ascontiguousarray(v[:, 0])
            done = _follow(table, solution, index, z, v, growth)
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


def _follow(table: Statuses, solution: Any, index: int, z: Array, v: Array, growth: Array) -> int:
    """Follow segments from one on in compiled code, until a status has no slot; return the first one not treated."""
    record, laws, none = solution.record, solution.system.contacts, np.zeros(0)
    force, damping = none, none
    if laws is not None:
        force, damping = np.where(laws.jump, laws.stiffness * laws.gap, 0.0), np.array(laws.damping, dtype=float)
    return int(
        _travel(
            table.table, table.slots[:, 0].copy(), np.array(record.statuses), record.status_numbers, record.durations,
            record.buffers.velocity, np.array(solution.space.contacts), force, damping, _frequency(solution.space),
            index, z, v, growth,
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
    force: Array, damping: Array, frequency: Array, index: int, z: Array, v: Array, growth: Array,
) -> int:  # fmt: skip
    """Do what `growth_along` does, for many segments without pinned contacts; return the first one not treated."""
    n, segments = z.size, numbers.size
    both, change = np.empty((3, 2 * n)), np.empty(n)
    while index < segments:
        s = slots[numbers[index]]
        after = numbers[index + 1] if index + 1 < segments else numbers[index]
        if s < 0 or slots[after] < 0:
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
