"""The past of springpots in a run: kernels, weights of orders, and the update over a step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.fractional.exponentials import exponentials
from vofem.fractional.streaming import step_integrals
from vofem.laws.springpot_steps import Springpots, Update, affine

#: Relative error of the kernel, at all times of a run.
_TOLERANCE = 1e-10

#: Number of times at which an order that varies is checked before the first step.
_LOOKS = 257

#: Steps whose weights are computed at once where an order varies.
_MOST_STEPS = 512


class SpringpotPast:
    """The past of springpots in a run whose steps are not below a size; see `group.StepPast`.

    `rows` has shape (n_laws, n).
    `row`: number of the first of these laws among all laws.
    `shortest`, `t_end`: shortest step, and the longest time that will be reached, in s.
    Raises `ArgumentError` if the order lies outside [0, 1] at one of the times at which it is checked.
    """

    def __init__(self, laws: Sequence[Any], rows: Any, row: int, shortest: float, t_end: float) -> None:
        self._laws, self._rows, self.row = laws, rows, row
        self._kernel = exponentials(shortest, max(t_end, shortest), _TOLERANCE)
        self._varies = any(law.varies for law in self._laws)
        self._updates: dict[float, Update] = {}
        self.count = len(self._laws)
        width = self._kernel.rates.size + 2
        self.terms = self.count * width
        for law in self._laws:
            law.orders(np.linspace(0.0, t_end, _LOOKS))
        self._constant = self._weights(np.zeros(1))
        self.y = np.zeros((self.count, width))

    def begin(self, start: Any, dt: float | None) -> Array:
        """Set the internal variables to those at rest; return the forces at t = 0, N, shape (n_laws,).

        At t = 0 only a dashpot (order 1) has a force. Where a step in s is given, it is the mean over the first step
        instead: the force grows from t = 0 like a power of time below 1, so explicit steps would have a lower order of
        accuracy with its value at t = 0.
        """
        self.y[:] = 0.0
        rates = np.asarray(self._rows @ start.v)
        if dt is not None:
            first = self.over(dt, np.array([0.5 * dt]))
            return np.array([affine(first, i, 0)[0] * rate for i, rate in enumerate(rates.tolist())])
        dashpots = np.array([law.orders(np.zeros(1))[0] == 1.0 for law in self._laws])
        return np.where(dashpots, [law.coefficient for law in self._laws] * rates, 0.0)

    def most_steps(self, count: int) -> int:
        """Return for how many steps, at most the given number, weights are to be computed at once."""
        return min(count, _MOST_STEPS) if self._varies else count

    def over(self, dt: float, times: Array) -> Springpots:
        """Return the springpots over steps of a size in s, at the orders of some times, s."""
        weights = self._weights(times) if self._varies else self._constant
        return Springpots(self.row, weights, self._update(dt), self.y)

    def _weights(self, times: Array) -> Array:
        kernel = self._kernel
        weights = np.empty((self.count, times.size, kernel.rates.size + 2))
        for i, law in enumerate(self._laws):
            orders = law.orders(times)
            weights[i, :, :-2], weights[i, :, -2:] = kernel.weights(orders), kernel.faster(orders)
            weights[i] *= law.coefficient
        return weights

    def _update(self, dt: float) -> Update:
        """Return the update of the internal variables over a step of a size in s.

        The last two numbers stand for all elements that are faster than the step. Their y follows the rate of
        elongation at once, so two sums over them are enough: the first is multiplied by the rate of elongation, the
        second by the change of that rate.
        """
        if dt not in self._updates:
            rates = self._kernel.rates
            start, end = step_integrals(rates, dt)
            self._updates[dt] = Update(
                dt,
                decay=np.append(np.exp(-rates * dt), [0.0, 0.0]),
                gain=np.append(start + end, [0.0, 1.0]),
                old=np.append((start + end) / dt, [0.0, 1.0 / dt]),
                new=np.append(end, [1.0, -1.0 / dt]),
            )
        return self._updates[dt]
