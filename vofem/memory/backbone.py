"""The backbone of a spring that softens as a function of force: its limit load, and its inverse as cubics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ArgumentError

Array = NDArray[np.float64]

#: Elongation, in linear limits, up to which a backbone is tabulated; beyond it goes on straight.
_REACH = 1e4

#: Largest force, in forces at the linear limit, up to which a limit load is looked for.
_LARGEST = 1e6

#: Error of a tabulated force that is allowed, relative.
_ACCURACY = 1e-11

_MOST_KNOTS = 20_000


def checked_level(label: str, level: Callable[[float], float], force: float) -> float:
    """Return the softening number at a force; raise `ArgumentError` for what is no finite number."""
    try:
        value = float(level(force))
    except (TypeError, ValueError, ArithmeticError) as error:
        raise ArgumentError(f"{label}: softening({force:g}) raised {error!r}, expected a number") from error
    if not np.isfinite(value):
        raise ArgumentError(f"{label}: softening({force:g}) is {value}, expected a finite number")
    return value


def limit_load(label: str, level: Callable[[float], float], onset: float) -> float:
    """Return the force at which the softening number reaches 1, inf where it never does.

    Raises
    ------
    ArgumentError
        If the number does not begin at 0, falls, or is not finite.
    """
    begin = checked_level(label, level, onset)
    if abs(begin) > 1e-9:
        raise ArgumentError(
            f"{label}: softening({onset:g}) is {begin:g} at the force of the linear limit, expected 0: "
            "the stiffness would jump there"
        )
    forces = onset * np.concatenate([1.0 + np.linspace(0.0, 1.0, 101), 2.0 * np.geomspace(1.01, 0.5 * _LARGEST, 700)])
    before, low = 0.0, onset
    for force in forces[1:].tolist():
        value = checked_level(label, level, force)
        if value < before - 1e-12:
            raise ArgumentError(
                f"{label}: softening falls from {before:g} to {value:g} at {force:g} N, expected a function that "
                "does not decrease with the force"
            )
        if value >= 1.0:
            return _where(lambda f: checked_level(label, level, f), 1.0, low, force)
        before, low = value, force
    return float("inf")


def _where(function: Callable[[float], float], value: float, low: float, high: float) -> float:
    """Return where a function that does not decrease reaches a value, by bisection to the last bit."""
    while True:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return high
        if function(middle) >= value:
            high = middle
        else:
            low = middle


def tabulate(label: str, level: Callable[[float], float], stiffness: float, onset: float, limit: float) -> Array:
    """Return elongation, force, slope and work at the knots of the backbone, one after the other.

    The force is a monotone cubic between knots; knots are added until it is
    right to 1e-11 between them, or they lie together at a kink.
    """
    top = limit * (1.0 - 1e-15) if np.isfinite(limit) else stiffness * (onset / stiffness) * _REACH

    def elongation(force: float) -> float:
        secant = 1.0 - checked_level(label, level, force)
        return force / (stiffness * secant) if secant > 0.0 else float("inf")

    def at(w: float) -> float:
        return _where(elongation, w, onset, top)

    def slope(w: float) -> float:
        h = 1e-4 * w
        # From the right at the linear limit, where the slope may have a kink.
        if w - 2.0 * h < reach:
            near = -25.0 * at(w) + 48.0 * at(w + h) - 36.0 * at(w + 2 * h) + 16.0 * at(w + 3 * h) - 3.0 * at(w + 4 * h)
            return near / (12.0 * h)
        return (8.0 * (at(w + h) - at(w - h)) - (at(w + 2.0 * h) - at(w - 2.0 * h))) / (12.0 * h)

    reach = onset / stiffness
    first = np.geomspace(reach, _REACH * reach, 160)
    knots = {float(w): (at(float(w)), slope(float(w))) for w in first}
    todo = list(zip(first[:-1].tolist(), first[1:].tolist(), strict=True))
    while todo and len(knots) < _MOST_KNOTS:
        left, right = todo.pop()
        middle = 0.5 * (left + right)
        (f0, s0), (f1, s1) = knots[left], knots[right]
        h = right - left
        exact = at(middle)
        if abs(0.5 * (f0 + f1) + 0.125 * h * (s0 - s1) - exact) > _ACCURACY * exact and h > 1e-8 * right:
            knots[middle] = exact, slope(middle)
            todo += [(left, middle), (middle, right)]
    w = np.array(sorted(knots))
    force, rate = np.array([knots[x] for x in w.tolist()]).T
    rate = _monotone(w, force, np.clip(rate, 0.0, stiffness))
    h = np.diff(w)
    parts = 0.5 * h * (force[:-1] + force[1:]) + h**2 / 12.0 * (rate[:-1] - rate[1:])
    return np.concatenate([w, force, rate, [0.0], np.cumsum(parts)])


def _monotone(w: Array, force: Array, rate: Array) -> Array:
    """Return slopes that keep cubics monotone: at most three times those of the chords (Fritsch and Carlson)."""
    chord = np.diff(force) / np.diff(w)
    bound = 3.0 * np.minimum(np.append(chord, chord[-1]), np.append(chord[0], chord))
    return np.minimum(rate, bound)
