"""A branch that has been followed: its orbits at any value, and the branches that leave it."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from vofem.arrays import Array
from vofem.errors import ArgumentError, ConvergenceError
from vofem.studies.steady.branch import Branch
from vofem.studies.steady.following.family import Family
from vofem.studies.steady.following.follow import FIRST, Follower
from vofem.studies.steady.following.point import Point, corrected, level, point_at
from vofem.studies.steady.orbit import PeriodicOrbit
from vofem.studies.steady.segments.shooting import CLOSES
from vofem.studies.steady.segments.signature import Signature
from vofem.studies.steady.segments.sticking import names_of, places_of
from vofem.studies.steady.special import SpecialPoint

#: Relative difference below which two solutions are the same orbit, and first steps that are tried on a leaving branch.
_SAME, _TRIED = 1e-8, (1.0, 0.1, 1e-2, 1e-3)

#: Step of the second differences, in scaled coordinates.
_DIFFERENCE = 1e-4


def branch_of(walker: Follower) -> Branch:
    """Return a branch that has been followed, without orbits that an ordinary run does not repeat."""
    orbits, values = [point.orbit() for point in walker.points], np.array([point.value for point in walker.points])
    missed = np.array([_missed(point) for point in walker.points])
    listed, left = np.flatnonzero(missed <= CLOSES), ~(missed <= CLOSES)
    found = walker.found()
    if left.any():
        found["notes"] = [
            f"{left.sum()} of {left.size} orbits are left out, between {values[left].min():.9g} and "
            f"{values[left].max():.9g}: an ordinary run over one period, which magnifies rounding there, repeats them "
            f"to {missed[left].max():.1e} of the motion only, and not to {CLOSES:g}",
            *found["notes"],
        ]
        # Where no orbit is listed, all points have the place 0.
        known = (listed, np.arange(listed.size)) if listed.size else ([0], [0])
        places = np.interp([one.place for one in found["special"]], *known)
        found["special"] = [replace(one, place=float(at)) for one, at in zip(found["special"], places, strict=True)]
    found["counters"] = replace(found["counters"], points=listed.size, check_flows=walker.family.work.checks)
    return Branch(
        values=values[listed],
        orbits=[orbits[k] for k in listed],
        periods=walker.family.periods,
        _source=Sheets(walker),
        **found,
    )


def _missed(point: Point) -> float:
    """Return what an ordinary run over an orbit may miss, with rounding; 0 for harmonics, whose error is another."""
    return float(point.evaluation.missed) if point.chart.segmented else 0.0


class Sheets:
    """Finds further orbits of a branch; see `branch.Source`.

    `walker`: the follower of the branch.
    """

    def __init__(self, walker: Follower) -> None:
        self.walker, self.family = walker, walker.family

    def at(self, value: float) -> list[PeriodicOrbit]:
        """Return all orbits at a value of the parameter, one for each part of the branch between folds."""
        found: list[tuple[Array, PeriodicOrbit]] = []
        for first, last in self._with_turns():
            if (first.value - value) * (last.value - value) > 0.0:
                continue
            solution = self._solved(first, last, value)
            if solution is None:
                continue
            unknowns, orbit = solution
            if not any(_same(unknowns, other) for other, _ in found):
                found.append((unknowns, orbit))
        return [orbit for _, orbit in found]

    def _with_turns(self) -> list[tuple[Point, Point]]:
        """Return neighbours on the branch, folds among them, so that the value is monotone from one to the next."""
        parts: list[tuple[Point, Point]] = []
        for k, step in enumerate(self.walker.steps):
            if step is None:
                continue
            inside = [one for one in self.walker.special if k < one.place < k + 1]
            turns = [one.point for one in inside if one.kind in ("fold", "branch_point")]
            chain = [step.first, *turns, step.last]
            parts += list(itertools.pairwise(chain))
        return parts

    def _solved(self, first: Point, last: Point, value: float) -> tuple[Array, PeriodicOrbit] | None:
        """Return unknowns and orbit at a value between two neighbours, or None where there is none."""
        span = last.value - first.value
        share = (value - first.value) / span if span else 0.0
        # Between a fold and its neighbour orbits change like the square root of the value.
        if abs(last.tangent[-1]) < 1e-6:
            share = 1.0 - np.sqrt(max(1.0 - share, 0.0))
        elif abs(first.tangent[-1]) < 1e-6:
            share = np.sqrt(share)
        guess = first.y + share * (last.y - first.y)
        guess[-1] = value
        by_value = np.zeros(guess.size - 1)
        try:
            y, evaluation = corrected(self.family, first.chart, guess, first.scales, None, by_value, steps=20)
        except ConvergenceError:
            return None
        point = Point(first.chart, y, self.family.at(value), evaluation, first.scales, by_value, first.tangent)
        return (point.unknowns(), point.orbit()) if _missed(point) <= CLOSES else None

    def switch(self, special: SpecialPoint) -> Branch:
        """Return the branch that leaves at a special point."""
        same = [one for one in self.walker.special if one.kind == special.kind and one.value == special.value]
        if not same:
            raise ArgumentError("switch: the special point is not one of this branch; take it from branch.special")
        special = special if any(one is special for one in same) else same[0]
        point: Point = special.point
        doubles = special.kind == "period_doubling" and point.problem.periods == self.family.periods
        if special.kind == "period_doubling" and point is self.walker.points[-1]:
            raise ArgumentError(
                "switch: the branch ends at this point, on orbits over fewer periods; follow those with "
                f"vofem.continuation(..., periods={self.family.periods // 2})"
            )
        family = self.family.over(2 * self.family.periods) if doubles else self.family.over(self.family.periods)
        start = self._origin(point, family, doubles)
        direction = self._direction(family, start, special, doubles)
        why = ""
        known = self.walker
        for factor in _TRIED:
            walker = Follower(family, largest=known.largest, most=known.most, seconds=known.seconds)
            try:
                walker.follow(replace(start, tangent=direction), FIRST * factor, leaving=True)
            except ConvergenceError as error:
                why = f": {error}"
                continue
            if len(walker.points) > 1:
                found = branch_of(walker)
                if len(found):
                    return found
                why = f": {'; '.join(found.notes)}"
        raise ConvergenceError(
            f"switch: no orbit was found beside the {special.kind} at {special.value:.12g}"
            + why
            + _where_one_sticks(point)
        )

    def _origin(self, point: Point, family: Family, doubles: bool) -> Point:
        """Return the special orbit as a point of the leaving branch."""
        if not doubles:
            return point
        problem = family.at(point.value)
        if point.chart.segmented:
            chart, y = point.chart.doubled(point.y[:-1])
        else:
            chart, y = point.chart, problem.from_orbit(point.orbit())
        return point_at(family, chart, np.append(y, point.value), level(y.size + 1))

    def _direction(self, family: Family, start: Point, special: SpecialPoint, doubles: bool) -> Array:
        """Return the direction in which the other branch leaves: at a period doubling that of the eigenvector."""
        n = start.y.size - 1
        if doubles:
            matrix = start.evaluation.jacobian * start.scales[:n]
            norms = np.linalg.norm(matrix, axis=1)
            return np.append(np.linalg.svd(matrix / np.where(norms > 0.0, norms, 1.0)[:, None])[2][-1], 0.0)
        step = self.walker.steps[int(special.place)] if int(special.place) < len(self.walker.steps) else None
        along = np.append(np.zeros(n), 1.0)
        if step is not None:
            along = (step.last.y - step.first.y) / start.scales
        return _other_direction(family, start, along)


def _where_one_sticks(point: Point) -> str:
    """Return the end of a message about an orbit in which sliders stick all along; "" where none does."""
    chart, problem = point.chart, point.problem
    places = places_of(problem, chart.statuses) if isinstance(chart, Signature) else None
    if places is None:
        return ""
    names = names_of(problem, places)
    return f". {names} sticks all along: orbits with the slider at this place turn here, and no branch need leave"


def _same(a: Array, b: Array) -> bool:
    return bool(np.linalg.norm(a - b) <= _SAME * max(np.linalg.norm(a), np.linalg.norm(b), np.finfo(float).tiny))


def _other_direction(family: Family, point: Point, along: Array) -> Array:
    """Return the direction of the branch that crosses another one at a branch point.

    There the matrix of the equations by unknowns and parameter loses one rank more than along a branch. Its null space
    is a plane, and second derivatives of the equations say which two directions in it are those of branches; see H. B.
    Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems, in Applications of Bifurcation Theory,
    Academic Press 1977, p. 359.

    `point`: a point with its derivative with respect to the parameter.
    `along` (shape (n + 1,)): approximate direction of the known branch, in scaled coordinates.
    Returns the direction in scaled coordinates, of length 1.
    """
    n = point.y.size - 1
    matrix = np.concatenate([point.evaluation.jacobian, point.by_value[:, None]], axis=1)
    left, _, right = np.linalg.svd(matrix * point.scales / point.scales[:n, None])
    plane, normal = right[-2:], left[:, -1] / point.scales[:n]

    def bent(direction: Array) -> float:
        """Return the second derivative of the equations along a direction of the plane, on the left null vector."""
        ends = [point.y + sign * _DIFFERENCE * (direction @ plane) * point.scales for sign in (1.0, -1.0)]
        residuals = [point.chart.evaluate(family.of(y), y[:-1], derivative=False).residual for y in (*ends, point.y)]
        return float(normal @ (residuals[0] + residuals[1] - 2.0 * residuals[2]))

    first, second = bent(np.array([1.0, 0.0])), bent(np.array([0.0, 1.0]))
    mixed = 0.5 * (bent(np.array([1.0, 1.0])) - first - second)
    mine = plane @ along
    mine = mine / np.linalg.norm(mine)
    across = np.array([-mine[1], mine[0]])
    # Where the quadratic form vanishes: a x^2 + 2 b x y + c y^2 = 0 has two directions if it is indefinite.
    root = mixed**2 - first * second
    if root > 0.0:
        pull = mixed + np.copysign(np.sqrt(root), mixed)
        found = [np.array([-pull, first]), np.array([second, -pull])]
        found = [one / np.linalg.norm(one) for one in found]
        across = min(found, key=lambda one: abs(float(one @ mine)))
    return np.asarray(across @ plane)
