"""How a perturbation grows along an event-driven run.

Between events a small perturbation follows the free motion of the status; at
an event its velocity jumps, because the perturbed run meets the event at
another time (the saltation, or jump, matrix
``I + (f_after - f_before) grad(s)' / (grad(s)' f_before)``). Both are known in
closed form, so the growth is too.

R. I. Leine, H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical
Systems, Springer 2004, doi:10.1007/978-3-540-44398-8.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.bounces import struck
from vofem.integrators.event_driven.loop import from_blocks, to_blocks
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.integrators.event_driven.record import Record
from vofem.integrators.event_driven.spectrum import Spectrum
from vofem.integrators.event_driven.table import BLOCKS, OF, Statuses
from vofem.integrators.event_driven.tangent import Event, bounced, drifted, jumped
from vofem.kernels.addresses import floats, shaped
from vofem.kernels.jit import jit
from vofem.linalg.exponential import oscillator
from vofem.linalg.oscillators import DELTA, SQUARE
from vofem.linalg.vectors import inner
from vofem.system import CLOSED, ContactLaws

Status = NDArray[np.int64]


class Perturbation:
    """A perturbation along a run: free motion between events, and a jump at every event."""

    def __init__(self, space: ModalSpace, laws: ContactLaws | None) -> None:
        self._space = space
        self._laws = laws
        self._frequency = np.sqrt(np.where(space.stiffness > 0, space.stiffness, 1.0))
        # All modes have the same energy and different phases. The perturbation is the same in every run.
        phase = 2.0 * np.pi * np.modf(np.arange(1, space.size + 1) * 0.6180339887498949)[0]
        amplitude = 1.0 / np.sqrt(space.size)
        self._z = amplitude * np.cos(phase) / self._frequency
        self._v = amplitude * np.sin(phase)
        self.growth = 0.0

    def drift(self, spectrum: Spectrum, duration: float) -> None:
        """Follow the free motion of a status."""
        self._take(*drifted(spectrum, self._z[:, None], self._v[:, None], duration))

    def jump(self, event: Event) -> None:
        """Pass an event. One that is met without speed, as at a grazing, is left out."""
        assert self._laws is not None
        z, v = jumped(self._space, self._laws, event, self._z[:, None], self._v[:, None])
        if np.isfinite(v).all():
            self._take(z, v)

    def _take(self, z: Array, v: Array) -> None:
        self._z, self._v = np.ascontiguousarray(z[:, 0]), np.ascontiguousarray(v[:, 0])
        self._renormalise()

    def bounce(self, row: Array, restitution: float, rate: float, push: tuple[Array, Array]) -> None:
        """Pass an impact on a rigid stop; see `tangent.bounced`."""
        v = bounced(self._z, self._v, row, restitution, rate, push)
        self._z, self._v = struck(row, restitution, self._z), v
        self._renormalise()

    def follow(self, statuses: Statuses, record: Record, index: int, growth: Array) -> int:
        """Follow segments in compiled code until a status has no slot.

        `statuses`: those of the record under loads of any one kind, those without pinned contacts and without groups.
        `index`: the first segment.
        `growth` (shape (n_segments + 1,)): growth at the ends of segments; filled.
        Returns `index`: the first segment that was not treated.
        """
        rows, none = self._space.contacts, np.zeros(0)
        force, damping = none, none
        if self._laws is not None:
            force = np.where(self._laws.jump, self._laws.stiffness * self._laws.gap, 0.0)
            damping = np.array(self._laws.damping, dtype=float)
        growth[index] = self.growth
        z, v = np.array(self._z), np.array(self._v)
        done = _travel(
            statuses.table, statuses.slots[:, 0].copy(), np.array(record.statuses), record.status_numbers,
            record.durations, record.buffers.velocity, np.array(rows), force, damping, self._frequency, index, z, v,
            growth,
        )  # fmt: skip
        self._z, self._v, self.growth = z, v, float(growth[done])
        return int(done)

    def _renormalise(self) -> None:
        scaled = self._frequency * self._z
        size = math.sqrt(float(self._v @ self._v + scaled @ scaled))
        if size > 0.0:
            self.growth += math.log10(size)
            self._z, self._v = self._z / size, self._v / size


@jit
def _drift(delta: Array, p: Array, z: Array, v: Array, t: float) -> None:
    for k in range(p.size):
        c, s = oscillator(delta[k], p[k], t)
        z[k], v[k] = c * z[k] + s * (v[k] + delta[k] * z[k]), c * v[k] - s * (p[k] * z[k] + delta[k] * v[k])


@jit
def _travel(
    table: Status, slots: Status, statuses: Status, numbers: Status, durations: Array, velocity: Array, rows: Array,
    force: Array, damping: Array, frequency: Array, index: int, z: Array, v: Array, growth: Array,
) -> int:  # fmt: skip
    """Do what `Perturbation.drift` and `Perturbation.jump` do, for many segments; return the first one not treated."""
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
