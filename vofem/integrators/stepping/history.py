"""Internal variables of springpots in a run: kernels, weights of orders, and their update over a step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.fractional.exponentials import exponentials
from vofem.fractional.streaming import step_integrals
from vofem.laws.springpot import BEFORE, FORCE, MEAN, History, Pace, SpringpotLaws, Springpots
from vofem.system import Counters, State, System

Array = NDArray[np.float64]

#: Relative error of the kernel, at all times of a run.
_TOLERANCE = 1e-10

#: Number of times at which an order that varies is checked before the first step.
_LOOKS = 257


#: Steps whose weights are computed at once where an order varies.
_MOST_STEPS = 512


class Springpotted:
    """The springpots of a system in a run whose steps are not below a size.

    Parameters
    ----------
    system : System
        With springpots.
    shortest, t_end : float
        Shortest step, and the longest time that will be reached, in s.
    counters : Counters

    Raises
    ------
    ArgumentError
        For an order that is beyond [0, 1] at one of some times.
    """

    def __init__(self, system: System, shortest: float, t_end: float, counters: Counters) -> None:
        group = system.group(SpringpotLaws)
        assert group is not None
        self._laws, self._rows = group.laws, group.rows
        self._row = system.first_of(group)
        self._kernel = exponentials(shortest, max(t_end, shortest), _TOLERANCE)
        self.varies = any(law.varies for law in self._laws)
        # A rough run before the run itself takes fewer.
        counters.history_terms = max(counters.history_terms, len(self._laws) * (self._kernel.rates.size + 2))
        for law in self._laws:
            law.orders(np.linspace(0.0, t_end, _LOOKS))
        self._still = self._at(np.zeros(1))

    def most_steps(self, count: int) -> int:
        """Return for how many steps, at most the given number, weights are to be computed at once."""
        return min(count, _MOST_STEPS) if self.varies else count

    def at(self, times: Array) -> Springpots:
        """Return the springpots at the orders of some times, s."""
        return self._at(times) if self.varies else self._still

    def _at(self, times: Array) -> Springpots:
        kernel = self._kernel
        weights = np.empty((len(self._laws), times.size, kernel.rates.size + 2))
        for i, law in enumerate(self._laws):
            orders = law.orders(times)
            weights[i, :, :-2], weights[i, :, -2:] = kernel.weights(orders), kernel.faster(orders)
            weights[i] *= law.coefficient
        return Springpots(self._row, weights)

    def pace(self, dt: float) -> Pace:
        """Return the update of the internal variables over a step of a size in s.

        The last two numbers stand for all elements that are faster than the step. Their y follows the rate of
        elongation at once, so two sums over them are enough: the first is multiplied by the rate of elongation, the
        second by the change of that rate.
        """
        rates = self._kernel.rates
        start, end = step_integrals(rates, dt)
        return Pace(
            dt,
            decay=np.append(np.exp(-rates * dt), [0.0, 0.0]),
            gain=np.append(start + end, [0.0, 1.0]),
            old=np.append((start + end) / dt, [0.0, 1.0 / dt]),
            new=np.append(end, [1.0, -1.0 / dt]),
        )

    def begin(self, start: State) -> History:
        """Return the internal variables at rest; at t = 0 only a dashpot (order 1) has a force."""
        history = History(np.zeros((len(self._laws), self._kernel.rates.size + 2)), np.zeros((len(self._laws), 7)))
        rates = np.asarray(self._rows @ start.v)
        for i, law in enumerate(self._laws):
            if law.orders(np.zeros(1))[0] == 1.0:
                history.told[i, [MEAN, FORCE, BEFORE + FORCE]] = law.coefficient * rates[i]
        return history
