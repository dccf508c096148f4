"""The length of a step along a direction in which a convex energy falls."""

from __future__ import annotations

from collections.abc import Callable


def lowest(derivative: Callable[[float], float]) -> float:
    """Return the fraction of a step in (0, 1] at which an energy is least, by bisection on its monotone derivative."""
    if derivative(1.0) <= 0.0:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if derivative(middle) > 0.0:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)
