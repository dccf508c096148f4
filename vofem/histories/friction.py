"""The history of a slider: its force, its slip, and when it stuck."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.effects.two_points import UNITS, Units
from vofem.histories.motion import Motion
from vofem.laws import FrictionLaw


class FrictionHistory:
    """One slider along a run.

    Histories are at the times of the run, each of shape (n_times,). For a slider that acts on rotations read rad for m,
    and N m for N.

    Attributes
    ----------
    name : str
    units : Units
        Units of force and slip.
    """

    def __init__(self, run: Motion, law: FrictionLaw, index: int, units: Units = UNITS["displacement"]) -> None:
        self._run, self._law, self._index = run, law, index
        self.name, self.units = law.name, units

    def __repr__(self) -> str:
        return f"FrictionHistory({self.name!r}, {self.stops.size} stops, {self.breaks.size} breaks)"

    @cached_property
    def _samples(self) -> Any:
        solution: Any = self._run.solution
        return solution.friction(self._run.times)

    @property
    def force(self) -> Array:
        """Friction force in N, positive where the slip speed is: it acts on a as ``-force`` and on b as ``+force``.

        While the slider sticks it is the reaction, with the same sign. In time steps it is the mean over the step
        before.
        """
        return np.asarray(self._samples.force[self._index])

    @property
    def slip_speed(self) -> Array:
        """Speed of a relative to b, or to the belt, m/s; behind a spring the slider's own. It is 0 while it sticks."""
        return np.where(self.status == 0, 0.0, self._samples.slip_speed[self._index])

    @property
    def status(self) -> NDArray[np.int64]:
        """1 while it slides with a positive slip speed, -1 with a negative one, and 0 while it sticks."""
        return np.asarray(self._samples.status[self._index])

    @property
    def dissipated(self) -> Array:
        """Energy that friction has taken since t = 0, J."""
        return np.asarray(self._samples.dissipated[self._index])

    @property
    def wear_power(self) -> Array:
        """Normal force times slip speed, ``N |w|``, W; the power that becomes heat is `coefficient` times that."""
        constant = self._law.contact is None and self._law.varies is None
        normal = self._law.normal if constant else self._samples.normal[self._index]
        return np.asarray(normal * np.abs(self.slip_speed))

    @cached_property
    def _transitions(self) -> tuple[Array, Array]:
        solution: Any = self._run.solution
        found: tuple[Array, Array] = solution.transitions(self._index)
        return found

    @property
    def stops(self) -> Array:
        """Times in s at which the slip speed becomes zero, reversals included."""
        return self._transitions[0]

    @property
    def breaks(self) -> Array:
        """Times in s at which sticking ends."""
        return self._transitions[1]
