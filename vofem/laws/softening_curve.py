"""The backbone of a spring whose softening is a function of force: its limit load, and a table of cubics for it."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from vofem.arrays import Array
from vofem.errors import ArgumentError

#: Elongation, divided by the linear limit, up to which a backbone is tabulated. Beyond it the backbone is straight.
_RANGE = 1e4

#: Largest force, divided by the force at the linear limit, up to which a limit load is searched.
_LARGEST = 1e4

#: Accepted relative error of a tabulated force.
_ACCURACY = 1e-11

_MOST_KNOTS = 20_000


def checked_level(label: str, level: Callable[[float], float], force: float) -> float:
    """Return the softening at a force; raise `ArgumentError` if it is not a finite number."""
    try:
        value = float(level(force))
    except (TypeError, ValueError, ArithmeticError) as error:
        raise ArgumentError(f"{label}: softening({force:g}) raised {error!r}, expected a number") from error
    if not np.isfinite(value):
        raise ArgumentError(f"{label}: softening({force:g}) is {value}, expected a finite number")
    return value


def limit_load(label: str, level: Callable[[float], float], onset: float) -> float:
    """Return the force at which the softening reaches 1, or inf if it never does.

    Raises `ArgumentError` if the softening does not begin at 0, decreases, or is not finite.
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

    The force is a monotone cubic between knots. Knots are added until its error
    between them is below 1e-11, or until they coincide at a kink.
    """
    curve = _Curve(label, level, stiffness, onset, limit)
    linear_limit = onset / stiffness
    targets = np.geomspace(linear_limit, _RANGE * linear_limit, 160)[1:]
    forces = [onset, *(curve.roughly(w) for w in targets.tolist())]
    knots = {force: (curve.elongation(force), curve.slope(force)) for force in forces}
    todo = list(pairwise(sorted(knots)))
    while todo and len(knots) < _MOST_KNOTS:
        left, right = todo.pop()
        middle = 0.5 * (left + right)
        w, (w0, s0), (w1, s1) = curve.elongation(middle), knots[left], knots[right]
        h = w1 - w0
        x = (w - w0) / h
        rise = right - left
        found = left + x * (h * s0 + x * (3.0 * rise - h * (2.0 * s0 + s1) + x * (h * (s0 + s1) - 2.0 * rise)))
        if abs(found - middle) > _ACCURACY * middle and h > 1e-8 * w1 and left < middle < right:
            knots[middle] = w, curve.slope(middle)
            todo += [(left, middle), (middle, right)]
    force = np.array(sorted(knots))
    w, rate = np.array([knots[f] for f in force.tolist()]).T
    rate = _monotone(w, force, np.clip(rate, 0.0, stiffness))
    h = np.diff(w)
    parts = 0.5 * h * (force[:-1] + force[1:]) + h**2 / 12.0 * (rate[:-1] - rate[1:])
    return np.concatenate([w, force, rate, [0.0], np.cumsum(parts)])


class _Curve:
    """A backbone as elongation over force."""

    def __init__(
        self, label: str, level: Callable[[float], float], stiffness: float, onset: float, limit: float
    ) -> None:
        self._label, self._level, self._stiffness, self._onset = label, level, stiffness, onset
        self._top = limit if np.isfinite(limit) else onset * _RANGE

    def elongation(self, force: float) -> float:
        """Return the elongation at a force, inf from the limit load on."""
        secant = 1.0 - checked_level(self._label, self._level, force)
        return force / (self._stiffness * secant) if secant > 0.0 else float("inf")

    def roughly(self, w: float) -> float:
        """Return a force at which the elongation is about w."""
        low, high = self._onset, self._top
        while high - low > 1e-3 * min(low, self._top - low):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self.elongation(middle) >= w else (middle, high)
        return low + 0.5 * (high - low)

    def slope(self, force: float) -> float:
        """Return force over elongation by differences of fourth order; from the right where the curve begins."""
        h = 1e-3 * min(force, self._top - force)
        if force - 2.0 * h < self._onset:
            values = [self.elongation(force + k * h) for k in range(5)]
            weights = [-25.0, 48.0, -36.0, 16.0, -3.0]
        else:
            values = [self.elongation(force + k * h) for k in (-2, -1, 1, 2)]
            weights = [1.0, -8.0, 8.0, -1.0]
        rate = float(np.dot(weights, values)) / (12.0 * h)
        return 1.0 / rate if rate > 0.0 else self._stiffness


def _monotone(w: Array, force: Array, rate: Array) -> Array:
    """Return slopes that keep cubics monotone: at most three times those of the chords (Fritsch and Carlson)."""
    chord = np.diff(force) / np.diff(w)
    bound = 3.0 * np.minimum(np.append(chord, chord[-1]), np.append(chord[0], chord))
    return np.minimum(rate, bound)
