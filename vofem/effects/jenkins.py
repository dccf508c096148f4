"""Springs of parallel Jenkins elements: the bilinear spring, and that of Prandtl and Iwan.

A Jenkins element is a spring in series with a slider that slips at a given force.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import array, number
from vofem.assembly import SystemBuilder
from vofem.bodies.base import Point, automatic_name
from vofem.effects.two_points import TwoPoints, Units
from vofem.errors import ArgumentError
from vofem.laws import HystereticLaw
from vofem.laws.hysteretic import jenkins

Array = NDArray[np.float64]


class IwanSpring(TwoPoints):
    """A spring that follows a given curve of first loading, and Masing's rules after every reversal.

    The curve is piecewise linear from the origin through the given points. It is
    reproduced by parallel Jenkins elements, one for each bend, beside a spring
    of the last slope. After a reversal the force follows the same curve, doubled
    in both directions. Closed loops are therefore the same in every cycle.

    Parameters
    ----------
    a, b : points
        ``beam.at(x)`` or a `Mass`. Without b it acts between a and the ground.
    elongation : array_like, shape (n,)
        Points of the first loading in m, positive, increasing.
    force : array_like, shape (n,)
        Force at these points in N. The slopes decrease and are not negative.
        Beyond the last point the curve continues with the last slope.
    of : {"displacement", "rotation"}
        Whether it acts on displacements (m, N) or on rotations of beams (rad, N m).
    name : str, optional
        Unique in a scene.

    Raises
    ------
    ArgumentError
        If a slope of the curve is larger than the one before it, or negative.

    References
    ----------
    W. D. Iwan, A distributed-element model for hysteresis and its steady-state dynamic response,
    J. Appl. Mech. 33 (1966) 893-900, https://doi.org/10.1115/1.3625199.
    """

    def __init__(
        self,
        a: Point,
        b: Point | None = None,
        *,
        elongation: ArrayLike,
        force: ArrayLike,
        of: str = "displacement",
        name: str | None = None,
    ) -> None:
        self.name = automatic_name(name, "IwanSpring")
        label = f"IwanSpring {self.name!r}"
        self._attach(label, a, b, of)
        self.elongation = np.atleast_1d(array(f"{label}: elongation", elongation))
        self.force = np.atleast_1d(array(f"{label}: force", force))
        self._law = _law(label, self.name, self.elongation, self.force, self.units)

    @property
    def limit_load(self) -> float:
        """The largest force of the spring in N; inf if the last slope is not zero."""
        return self._law.limit

    def compile(self, builder: SystemBuilder) -> None:
        """Add row and law."""
        builder.add_law(self._row(builder), self._law)

    def describe(self) -> str:
        """Return name, points and numbers."""
        return (
            f"{type(self).__name__} {self.name!r} from {self._where()}: {self._law.stiffness:g} "
            f"{self.units.stiffness} at first, {self._law.past.size} Jenkins elements"
        )


class BilinearSpring(IwanSpring):
    """A spring with two slopes and kinematic hardening: one Jenkins element beside a linear spring.

    Parameters
    ----------
    a, b : points
        ``beam.at(x)`` or a `Mass`. Without b it acts between a and the ground.
    stiffness : float
        Stiffness before yielding in N/m, positive.
    linear_limit : float
        Elongation in m at which the spring first yields, positive.
    hardening : float
        Slope after yielding divided by `stiffness`; at least 0 (elastic, perfectly plastic) and below 1.
    of : {"displacement", "rotation"}
        Whether it acts on displacements (m, N) or on rotations of beams (rad, N m).
    name : str, optional
        Unique in a scene.

    Raises
    ------
    ArgumentError
        For arguments out of range.
    """

    def __init__(
        self,
        a: Point,
        b: Point | None = None,
        *,
        stiffness: float,
        linear_limit: float,
        hardening: float = 0.0,
        of: str = "displacement",
        name: str | None = None,
    ) -> None:
        name = automatic_name(name, "BilinearSpring")
        label = f"BilinearSpring {name!r}"
        self.stiffness = number(f"{label}: stiffness", stiffness, positive=True)
        self.linear_limit = number(f"{label}: linear_limit", linear_limit, positive=True)
        self.hardening = number(f"{label}: hardening", hardening, minimum=0)
        if not self.hardening < 1.0:
            raise ArgumentError(f"{label}: hardening is {self.hardening:g}, expected a number from 0 to below 1")
        elongations = np.array([1.0, 2.0]) * self.linear_limit
        forces = self.stiffness * self.linear_limit * np.array([1.0, 1.0 + self.hardening])
        super().__init__(a, b, elongation=elongations, force=forces, of=of, name=name)
        self._law = _jenkins(label, name, self.stiffness * np.array([1.0, self.hardening]), elongations[:1], self.units)


def _law(label: str, name: str, elongation: Array, force: Array, units: Units) -> HystereticLaw:
    """Return the law of a curve through the origin and some points."""
    if elongation.ndim != 1 or elongation.shape != force.shape:
        raise ArgumentError(
            f"{label}: elongation and force have shapes {elongation.shape} and {force.shape}, expected two lists of "
            "the same length"
        )
    steps = np.diff(elongation, prepend=0.0)
    if not np.all(steps > 0.0):
        k = int(np.argmax(~(steps > 0.0)))
        raise ArgumentError(
            f"{label}: elongation[{k}] is {elongation[k]:g} {units.coordinate}, expected numbers that increase "
            "from above zero"
        )
    slopes = np.diff(force, prepend=0.0) / steps
    # A change of slope below the rounding of the given forces does not count as a bend.
    noise = 1e-12 * slopes[0]
    slopes[np.abs(slopes) <= noise] = 0.0
    if slopes[-1] < 0.0 or slopes[0] <= 0.0:
        raise ArgumentError(
            f"{label}: force falls to {force[-1]:g} {units.force} at {elongation[-1]:g} {units.coordinate}, expected a "
            "curve that rises from the origin and does not fall"
        )
    bends = slopes[:-1] - slopes[1:]
    if np.any(bends < -noise):
        k = int(np.argmax(bends < -noise))
        raise ArgumentError(
            f"{label}: force bends upward at {elongation[k]:g} {units.coordinate}, from {slopes[k]:g} to "
            f"{slopes[k + 1]:g} {units.stiffness}, expected slopes that do not increase; leave out points, "
            "or smooth them"
        )
    return _jenkins(label, name, slopes, elongation[:-1], units)


def _jenkins(label: str, name: str, slopes: Array, bends: Array, units: Units) -> HystereticLaw:
    """Return the law of given slopes, shape (n + 1,), with bends between them, shape (n,)."""
    stiffness = slopes[:-1] - slopes[1:]
    kept = stiffness > 1e-12 * slopes[0]
    slip = stiffness * bends
    limit = float(np.sum(slip[kept])) if slopes[-1] == 0.0 else float("inf")
    return jenkins(label, name, float(slopes[0]), float(slopes[-1]), stiffness[kept], slip[kept], limit, units.force)
