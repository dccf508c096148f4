"""Sliders after every step of a run in steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array

Integers = NDArray[np.int64]


class SliderSamples(NamedTuple):
    """Sliders at some times, each of shape (n_sliders, n_times)."""

    force: Array  #: Mean of the friction force over the step before, N.
    slip_speed: Array  #: m/s, of a slider behind a spring the mean over the step before.
    status: Integers  #: 1 and -1 while it slides up and down, 0 while it sticks.
    dissipated: Array  #: Since t = 0, J.
    normal: Array  #: Mean of the normal force over the step before, N.
    stored: Array  #: Energy in the springs of the sliders, J.


@dataclass(frozen=True)
class SliderHistory:
    """The sliders of a run after every step."""

    times: Array  #: Ends of the steps, s, shape (n_steps + 1,).
    log: Array  #: The quantities of `SliderSamples`, shape (n_steps + 1, 6, n_sliders).
    turns: Array  #: Time in s, slider, and 0 where sliding ends, 1 where sticking ends, shape (n_turns, 3).

    def samples(self, times: Array, slip: Array, rigid: NDArray[np.bool_]) -> SliderSamples:
        """Return the sliders at times, given the slip speeds of rigid ones, shape (n_sliders, n_times)."""
        step = np.clip(np.searchsorted(self.times * (1.0 + 1e-12), times), 0, self.times.size - 1)
        force, speed, entered, dissipated, normal, stored = self.log[step].transpose(1, 2, 0)
        status = entered.astype(np.int64)
        speed = np.where(rigid[:, None], slip, speed)
        return SliderSamples(force, speed, status, dissipated, normal, stored)

    def stored(self, times: Array) -> Array:
        """Return the energy in the springs of sliders at times, J, shape (n_times,)."""
        step = np.clip(np.searchsorted(self.times * (1.0 + 1e-12), times), 0, self.times.size - 1)
        return np.asarray(self.log[step, 5].sum(axis=1))

    def transitions(self, slider: int) -> tuple[Array, Array]:
        """Return the times at which sliding ends, and those at which sticking ends, s."""
        time, which, kind = self.turns.T
        return time[(which == slider) & (kind == 0)], time[(which == slider) & (kind == 1)]
