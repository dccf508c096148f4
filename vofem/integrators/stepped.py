"""The outcome of a method that steps in time: states at stored times, and interpolation between them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.errors import ArgumentError
from vofem.integrators.base import ContactSamples, Energies, ProbeSamples, Samples, SpringSamples
from vofem.kernels.mode import as_it_ran, compiled
from vofem.system import CLOSED, OPEN, Counters, Events, System

if TYPE_CHECKING:
    from vofem.integrators.slider_history import SliderHistory, SliderSamples


#: What second rates may bend the quintic, over the way of the step, before they are left out; motion of which a step is
#: a sixth of the period stays below 2.
_OVERSHOOT = 12.0


@dataclass
class SteppedSolution:
    """States of a stepping run at its stored times."""

    system: System
    t_end: float
    times: Array  #: Stored times, s, shape (n_times,).
    samples: Samples  #: States at the stored times, each of shape (n, n_times).
    stored: Energies  #: Energies at the stored times, in the discrete form that the method balances.
    start_energy: float  #: Energy at t = 0 in the same form, J.
    dt: float  #: Step size, s.
    events: Events
    counters: Counters
    notes: list[str]
    springs: SpringSamples | None = None  #: Springs with memory at the stored times.
    probes: ProbeSamples | None = None  #: Points that were recorded at every step.
    sliders: SliderHistory | None = None  #: Sliders after every step.
    #: Times in s of steps in which another law than a contact began or ceased to act.
    kinks: Array = field(default_factory=lambda: np.empty(0))
    #: How the run was computed, and so how contacts are evaluated later.
    compiled: bool = field(default_factory=compiled)

    continuous: ClassVar[bool] = False
    modes: ClassVar[None] = None
    sensitivity: ClassVar[None] = None
    truncation: ClassVar[None] = None

    def _place(self, times: Array) -> tuple[NDArray[np.int64], Array]:
        """Return the stored interval of every time and the fraction of it."""
        left = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, max(self.times.size - 2, 0))
        if self.times.size == 1:
            return left, np.zeros(times.size)
        width = self.times[left + 1] - self.times[left]
        fraction = (times - self.times[left]) / width
        near = np.minimum(np.abs(fraction), np.abs(1.0 - fraction)) <= 1e-9
        coarse = ~near & (width > 2.0 * self.dt)
        if np.any(coarse):
            raise ArgumentError(
                f"t = {times[coarse][0]:g} s lies between the stored times of this run, which are "
                f"{width[coarse][0]:g} s apart at a step of {self.dt:g} s; name it in times= when simulating"
            )
        return left, np.where(near, np.round(fraction), fraction)

    def sample(self, times: Array) -> Samples:
        """Return the motion at stored times, or between steps by the quintic through q, v and a; a on a line.

        Between two stored times with a contact event, or another law that begins or ceases to act, displacements stay
        between their values there.
        """
        if np.array_equal(times, self.times):
            return self.samples
        left, x = self._place(times)
        if self.times.size == 1:
            return Samples(self.samples.q[:, left], self.samples.v[:, left], self.samples.a[:, left])
        # Events at a stored time belong to both of its sides.
        before, after = self.times[left], self.times[np.minimum(left + 1, self.times.size - 1)]
        kinks = np.sort(np.concatenate([self.events.time, self.kinks]))
        kinked = np.searchsorted(kinks, after, side="right") > np.searchsorted(kinks, before, side="left")
        begin, end = (
            (self.samples.q[:, side], self.samples.v[:, side], self.samples.a[:, side]) for side in (left, left + 1)
        )
        found = interpolated(x, self.times[left + 1] - self.times[left], begin, end, kinked)
        # States at stored times are as they were stored.
        return Samples(
            *(np.select([x == 0.0, x == 1.0], [*ends], free) for *ends, free in zip(begin, end, found, strict=True))
        )

    @as_it_ran
    def contacts(self, times: Array) -> ContactSamples:
        """Return status, K_eq and force at some times, from the gap functions there."""
        laws = self.system.contacts
        assert laws is not None
        samples = self.sample(times)
        u, rate = laws.coordinates(samples.q, times), laws.rates(samples.q, samples.v, times)
        s = u - laws.gap[:, None]
        closed = s > 0.0
        start = times == 0.0
        closed[:, start] = (self.events.initial == CLOSED)[:, None]
        ideal = np.isinf(laws.resolution)[:, None]
        share = np.where(closed, np.where(ideal, 1.0, laws.shares(s)), 0.0)
        force = np.where(closed, share * (laws.elastic(u) + laws.damping[:, None] * rate), 0.0)
        return ContactSamples(np.where(closed, CLOSED, OPEN), share * laws.stiffness[:, None], force)

    def friction(self, times: Array) -> SliderSamples:
        """Return the sliders at some times."""
        group = self.system.sliders
        assert self.sliders is not None
        assert group is not None
        belts = [np.zeros(times.size) if law.belt is None else law.belt(times) for law in group.laws]
        slip = np.asarray(group.rows @ self.sample(times).v) - np.array(belts)
        return self.sliders.samples(times, slip, np.array([np.isinf(law.stiffness) for law in group.laws]))

    def transitions(self, slider: int) -> tuple[Array, Array]:
        """Return the times at which sliding ends, reversals included, and those at which sticking ends, s."""
        assert self.sliders is not None
        return self.sliders.transitions(slider)

    def energies(self, times: Array) -> Energies:
        """Return the stored energies; between stored times they are interpolated linearly."""
        if np.array_equal(times, self.times):
            return self.stored
        self._place(times)
        kinds = ("kinetic", "strain", "contact", "dissipated", "work")
        return Energies(*(np.interp(times, self.times, getattr(self.stored, kind)) for kind in kinds))


def interpolated(
    x: Array, h: Array, begin: tuple[Array, Array, Array], end: tuple[Array, Array, Array],
    kinked: NDArray[np.bool_] | bool = False,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Return values, rates and second rates at fractions x of steps h, from those at both ends, each (n, n_times).

    Values are those of the quintic through all six; the second rate is on the line between both: in that of the
    quintic the errors of values at the ends would come back divided by h squared. Where second rates contradict values
    and rates so much that the quintic would overshoot, as where something stiff was touched between the ends, and where
    `kinked` says so, the value is that of the monotone cubic, whose slopes at the ends are limited, and lies between
    those at both ends; the rate is on a line.

    F. N. Fritsch, R. E. Carlson, Monotone piecewise cubic interpolation, SIAM J. Numer. Anal. 17 (1980) 238-246,
    https://doi.org/10.1137/0717021.
    """
    (q0, v0, a0), (q1, v1, a1) = begin, end
    way, turn = q1 - q0, v1 - v0
    # Newton form about the left end: remainders after the Taylor polynomial there.
    dq = way - h * (v0 + 0.5 * h * a0)
    dv = h * (turn - h * a0)
    da = h * h * (a1 - a0)
    c3 = 10.0 * dq - 4.0 * dv + 0.5 * da
    c4 = -15.0 * dq + 7.0 * dv - da
    c5 = 6.0 * dq - 3.0 * dv + 0.5 * da
    q = q0 + x * (h * v0 + x * (0.5 * h * h * a0 + x * (c3 + x * (c4 + x * c5))))
    v = v0 + x * (h * a0 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)) / h)
    bend = turn / h
    held = kinked | (
        h * h * (np.abs(a0 - bend) + np.abs(a1 - bend)) > _OVERSHOOT * (h * (np.abs(v0) + np.abs(v1)) + np.abs(way))
    )
    if np.any(held):
        # In the direction of the chord, and at most three times as steep.
        side = np.where(way >= 0.0, 1.0, -1.0)
        low = side * np.minimum(np.maximum(side * h * v0, 0.0), 3.0 * np.abs(way))
        high = side * np.minimum(np.maximum(side * h * v1, 0.0), 3.0 * np.abs(way))
        q = np.where(held, q0 + x * (low + x * (3.0 * way - 2.0 * low - high + x * (low + high - 2.0 * way))), q)
        v = np.where(held, v0 + x * turn, v)
    return q, v, a0 + x * (a1 - a0)


def step_count(t_end: float, dt: float) -> int:
    """Return the number of steps of size dt in s of which the last one ends at t_end, but for rounding, or beyond."""
    return max(1, int(np.ceil(t_end / dt - 1e-9)))


def storage_times(times: Array | None, t_end: float, dt: float, steps: int, size: int, notes: list[str]) -> Array:
    """Return the times to store: those asked for, or every step, thinned where memory would run out.

    `steps`: the last one ends at or after t_end.
    `size`: degrees of freedom.
    `notes`: thinning adds a note.
    """
    if times is not None:
        return times
    limit = 512 * 2**20
    stride = int(np.ceil(3 * 8 * size * (steps + 1) / limit))
    if stride > 1:
        notes.append(
            f"storage: every step would take more than {limit // 2**20} MiB, so every {stride}th of {steps} "
            "steps is kept; name the times you need in times=, or points to be recorded at every step in probes="
        )
    kept = np.arange(0, steps + 1, stride)
    if kept[-1] != steps:
        kept = np.append(kept, steps)
    return np.minimum(np.asarray(kept * dt, dtype=float), t_end)
