"""Orbits between two neighbours on a branch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vofem.arrays import Array
from vofem.studies.steady.following.family import Family
from vofem.studies.steady.following.point import Point, corrected, level, point_at

#: Error of an evaluation that the orbits reach with which special points are located.
_EXACT = 1e-14

#: Points of a step by their share of it.
Known = Mapping[float, Point]

_NONE: Known = {}

#: Number of known points inside of a step that are used for a guess.
_NEAREST = 3

#: Least distance of two such points, as a share of their distance from the guess.
_APART = 1e-2

#: The parameter is held where the least of its rates in scaled coordinates is at least so much of the largest one, and
#: at least so much. A problem at a known value costs nothing.
_STEADY, _LEVEL = 0.5, 1e-3


@dataclass
class Step:
    """Two neighbours on a branch in the same coordinates."""

    first: Point
    last: Point

    @property
    def secant(self) -> Array:
        """The difference of the two points, in the scaled coordinates of the first one."""
        return np.asarray((self.last.y - self.first.y) / self.first.scales)

    @property
    def length(self) -> float:
        """Distance of the two in scaled coordinates."""
        return float(np.linalg.norm(self.secant))

    @property
    def legs(self) -> Array:
        """Distances of both ends from where their directions meet, in their own scaled coordinates, shape (2,)."""
        last = self.last.tangent * self.last.scales / self.first.scales
        return np.asarray(np.linalg.lstsq(np.column_stack([self.first.tangent, last]), self.secant)[0])

    @property
    def steady(self) -> bool:
        """Whether no fold is near."""
        return steady(self.secant[-1] / self.length, self.first.tangent[-1], self.last.tangent[-1])


def steady(*rates: float) -> bool:
    """Return whether a parameter with some rates along a branch changes evenly, so that it may be held."""
    ahead = np.array(rates) * np.sign(rates[0])
    return bool(ahead.min() > max(_STEADY * ahead.max(), _LEVEL))


def interpolated(places: list[float], values: list[Array], slopes: list[Array], at: float) -> Array:
    """Return the polynomial through values at places, of which the first and second pair have a slope, by Newton."""
    differences, total, factor = list(values), values[0].copy(), 1.0
    for order in range(1, len(places)):
        differences = [
            slopes[k // 2]
            if places[k + order] == places[k]
            else (differences[k + 1] - differences[k]) / (places[k + order] - places[k])
            for k in range(len(differences) - 1)
        ]
        factor *= at - places[order - 1]
        total += factor * differences[0]
    return total


def point_between(
    family: Family,
    step: Step,
    share: float,
    known: Known = _NONE,
    *,
    tangent: bool = True,
) -> Point:
    """Return the point at a share of the way between two neighbours; `known` ones between them make the guess better.

    They are given by their shares.
    """
    first, last, scales = step.first, step.last, step.first.scales
    normal = step.secant / step.length
    # Hermite's polynomial through both points with their tangents, and through the nearest of the other known ones.
    near: list[float] = []
    for other in sorted(known, key=lambda other: abs(other - share)):
        # Places that are close to each other, seen from here, would make rounding large.
        if min(abs(other - place) for place in (0.0, 1.0, *near)) > _APART * abs(other - share):
            near.append(other)
    near = near[:_NEAREST]
    places = [0.0, 0.0, 1.0, 1.0, *near]
    values = [point.y / scales for point in (first, first, last, last, *(known[other] for other in near))]
    slopes = [point.tangent * point.scales / scales for point in (first, last)]
    slopes = [slope * step.length / max(float(slope @ normal), 0.1) for slope in slopes]
    guess = interpolated(places, values, slopes, share)
    if step.steady:
        plane = level(guess.size)
    else:
        # The orbit is found on the plane at this share.
        plane = normal
        guess = guess + normal * (normal @ (values[0] + share * step.secant - guess))
    by_value = (1.0 - share) * first.by_value + share * last.by_value
    every = {0.0: first, 1.0: last, **known}
    nearest = every[min(every, key=lambda one: abs(one - share))]
    y, evaluation = corrected(
        family, first.chart, guess * scales, scales, plane, by_value, tolerance=_EXACT, near=nearest.evaluation
    )  # fmt: skip
    if tangent:
        return point_at(family, first.chart, y, normal, evaluation, scales=scales)
    return Point(first.chart, y, family.of(y), evaluation, scales, by_value, first.tangent)
