"""Extremes of functions of time that tell where contacts and sliders of an orbit might switch."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from vofem.arrays import Array
from vofem.integrators.event_driven.regime import Integers

#: Steps in the search for an extreme in its bracket, and the last of them as a share of the bracket. What is left of it
#: changes the extreme by the square.
_CUTS, _FINE = 60, 1e-9

#: Least number of equal steps in a segment among which extremes are searched. A stiff contact rebounds quickly.
LEAST = 128

#: Parts of the bracket of a slider's extreme, and how often one is searched anew.
_ZOOM, _ZOOMS = 16, 5

#: Least rate between two samples, as a share of the lower one of them, that may be below zero in truth.
_DOUBT = 0.2


class Extreme(NamedTuple):
    """An extreme of a gap function: its contact, segment, phase in rad, and height over the size of the motion.

    The height is positive on the wrong side, where the contact would switch. Sliders have them too: of their speeds
    while they slide, of their reactions over their limits while they stick, and where they come to rest.

    `hit`: whether the gap function has a corner there, at an impact on a rigid stop that ends the segment.
    """

    contact: int
    segment: int
    phase: float
    height: float
    hit: bool = False


def turning_points(
    rows: Callable[[Array], tuple[Array, Array]], of: Integers, low: Array, high: Array
) -> tuple[Array, Array]:
    """Return where rows of the motion turn, one in each bracket of times, and their values there; all of shape (k,).

    `rows`: see `Path.rows`; `of` is the row of each bracket. At both ends of it the rate has opposite signs.
    """
    every = np.arange(of.size)

    def at(tau: Array) -> Array:
        return rows(tau)[1][of, every]

    first, last, enough = at(low), at(high), _FINE * (high - low)
    going = first * last < 0.0
    for _ in range(_CUTS):
        if not going.any():
            break
        # Secants, and the value at an end that stays is halved: the rule of Illinois.
        with np.errstate(divide="ignore", invalid="ignore"):
            middle = np.where(going, high - last * (high - low) / (last - first), high)
        value = at(middle)
        across = value * last < 0.0
        low, first = np.where(across, high, low), np.where(across, last, np.where(going, 0.5 * first, first))
        going &= np.abs(middle - high) > enough
        high, last = middle, value
        going &= first * last < 0.0
    # One value of both may be rounding.
    places = np.where((first * last >= 0.0) & (np.abs(first) < np.abs(last)), low, high)
    return places, rows(places)[0][of, every]


def peak(function: Callable[[Array], Array], low: float, high: float, sign: float = 1.0) -> tuple[float, float]:
    """Return the time and the value of the maximum of a smooth function, times a sign, between two times.

    The last of narrower and narrower brackets is a parabola.
    """
    for _ in range(_ZOOMS):
        times = np.linspace(low, high, _ZOOM + 1)
        values = sign * function(times)
        k = min(max(int(np.argmax(values)), 1), _ZOOM - 1)
        low, high = times[k - 1], times[k + 1]
    times, values = times[k - 1 : k + 2], values[k - 1 : k + 2]
    bend, rise = values[2] - 2.0 * values[1] + values[0], 0.5 * (values[2] - values[0])
    shift = float(np.clip(-rise / bend, -1.0, 1.0)) if bend < 0.0 else 0.0
    return float(times[1] + shift * (times[1] - times[0])), float(values[1] + shift * (rise + 0.5 * shift * bend))


def least_rate(first: Array, last: Array, ways: Array, steps: Array) -> Array:
    """Return at which share between samples rates of one sign may have changed it, shape (k,); NaN where they have not.

    They follow parabolas, roughly. `ways`, `steps` (shape (k,)): what is passed between the samples, and times of this.
    """
    with np.errstate(all="ignore"):
        bend = 3.0 * (first + last) - 6.0 * ways / steps
        slope = last - first - bend
        place = -0.5 * slope / bend
        least = (first + 0.5 * slope * place) * np.sign(first)
        turns = (np.sign(first) == np.sign(last)) & (least < _DOUBT * np.minimum(np.abs(first), np.abs(last)))
        return np.where(turns & (place > 0.0) & (place < 1.0), place, np.nan)
