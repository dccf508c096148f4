"""A point whose motion was recorded at every step."""

from __future__ import annotations

from dataclasses import dataclass

from vofem.arrays import Array


@dataclass(frozen=True, eq=False)
class ProbeHistory:
    """The motion of a point at every step of a stepping method, or at the times of the run for other methods.

    Attributes
    ----------
    name : str
    times : ndarray, shape (n_steps + 1,)
        Times of the steps in s.
    displacement, velocity, acceleration : ndarray, shape (n_steps + 1,)
        Motion of the point in m, m/s and m/s^2.
    """

    name: str
    times: Array
    displacement: Array
    velocity: Array
    acceleration: Array

    def __repr__(self) -> str:
        return f"ProbeHistory({self.name!r}, {self.times.size} times to {self.times[-1]:g} s)"
