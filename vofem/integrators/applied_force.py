"""The force on a single degree of freedom, and the spans in which it keeps its direction."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from vofem.system import Counters, LoadFunction, System

#: Looks at the direction of the load in a run, and in a period of it.
_SAMPLES, _SAMPLES_IN_A_PERIOD = 4096, 32


class AppliedForce:
    """The applied force and its direction."""

    def __init__(self, system: System, counters: Counters) -> None:
        self._parts: list[tuple[float, LoadFunction]] = [
            (float(load.vector[0]), load.function) for load in system.loads
        ]
        self._counters = counters

    def __call__(self, t: float) -> float:
        """Return F in N."""
        self._counters.load_evaluations += len(self._parts)
        return sum(factor * float(function(t)) for factor, function in self._parts)

    def corners(self, t_end: float) -> list[float]:
        """Return the times at which the force or its rate jumps, and both ends."""
        inner = [t for _, function in self._parts for t in function.breakpoints(t_end).tolist()]
        return sorted({0.0, t_end, *inner})

    def _rate(self, left: float, right: float) -> Callable[[float], float]:
        """Return F' in N/s between two corners; of plain callables by differences that stay between them."""
        step = 1e-7 * (right - left)

        def rate(t: float) -> float:
            total = 0.0
            for factor, function in self._parts:
                if function.closed_form:
                    total += factor * float(function.derivative(t))  # type: ignore[attr-defined]
                else:
                    a = min(max(t, left), right - step)
                    total += factor * (float(function(a + step)) - float(function(a))) / step
            return total

        return rate

    def directions(self, t_end: float) -> list[tuple[float, float, bool]]:
        """Return (begin, end, rising) of all spans in which the force keeps its direction and has no corner."""
        from scipy.optimize import brentq

        spans: list[tuple[float, float, bool]] = []
        rising, before = True, 0.0
        corners = self.corners(t_end)
        for left, right in pairwise(corners):
            rate, begin = self._rate(left, right), left
            at_left = self(left)
            if at_left != before and left > 0.0:
                # A jump of the force is a very fast rise or fall.
                rising = at_left > before
            samples = np.linspace(left, right, self._samples_between(left, right, t_end) + 1)
            # Rates are taken within the span, because at its end a function may return the rate of the next span.
            samples[-1] = right - 1e-9 * (right - left)
            rates = np.array([rate(t) for t in samples.tolist()])
            small = 1e-14 * np.max(np.abs(rates))
            for k, value in enumerate(rates.tolist()):
                if abs(value) <= small or (value > 0.0) == rising:
                    continue
                turn = begin
                if k and rates[k - 1] != 0.0 and (rates[k - 1] > 0.0) != (value > 0.0):
                    turn = float(brentq(rate, samples[k - 1], samples[k], xtol=1e-15 * right, rtol=8.9e-16))
                elif k:
                    turn = float(samples[k - 1])
                if turn > begin:
                    spans.append((begin, turn, rising))
                begin, rising = turn, not rising
            spans.append((begin, right, rising))
            before = self(np.nextafter(right, left))
        return spans

    def _samples_between(self, left: float, right: float, t_end: float) -> int:
        count = max(8, int(np.ceil(_SAMPLES * (right - left) / t_end)))
        for _, function in self._parts:
            if function.closed_form:
                fastest = max((abs(w) for w, _ in function.piece(left).harmonics), default=0.0)  # type: ignore[attr-defined]
                count = max(count, int(np.ceil(_SAMPLES_IN_A_PERIOD * fastest * (right - left) / (2.0 * np.pi))))
        return count
