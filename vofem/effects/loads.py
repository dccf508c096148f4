"""Loads: at points, along beams, and gravity."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem._validate import number
from vofem.assembly import SystemBuilder
from vofem.bodies.base import Point, as_point
from vofem.bodies.beam import Beam
from vofem.bodies.coefficient import evaluate_along
from vofem.errors import ArgumentError
from vofem.time_functions import Constant, Load, TimeFunction, as_time_function


class PointLoad:
    """A force at a point, positive upward.

    Parameters
    ----------
    point : point
        ``beam.at(x)`` or a `Mass`.
    f : float, TimeFunction or callable of t
        The force in N. A callable takes an array of times in s.
    """

    def __init__(self, point: Point, f: Load) -> None:
        self.point = as_point("PointLoad: point", point)
        self.f = as_time_function(f)

    def points(self) -> tuple[Point, ...]:
        """Return the point."""
        return (self.point,)

    def compile(self, builder: SystemBuilder) -> None:
        """Add the load."""
        builder.add_point_load(builder.row(self.point), self.f, self.describe())

    def describe(self) -> str:
        """Return point and function."""
        return f"PointLoad on {self.point.describe()}: {self.f!r} N"


class PointMoment:
    """A moment at a point of a beam. A positive moment does positive work when the slope grows.

    Parameters
    ----------
    point : point of a beam
        ``beam.at(x)``.
    f : float, TimeFunction or callable of t
        The moment in N m. A callable takes an array of times in s.
    """

    def __init__(self, point: Point, f: Load) -> None:
        self.point = as_point("PointMoment: point", point)
        self.point.slope_row()
        self.f = as_time_function(f)

    def points(self) -> tuple[Point, ...]:
        """Return the point."""
        return (self.point,)

    def compile(self, builder: SystemBuilder) -> None:
        """Add the load."""
        builder.add_point_load(builder.row(self.point, slope=True), self.f, self.describe())

    def describe(self) -> str:
        """Return point and function."""
        return f"PointMoment on {self.point.describe()}: {self.f!r} N m"


class DistributedLoad:
    """A force per length on a beam, ``p(x) f(t)``, positive upward.

    Parameters
    ----------
    beam : Beam
        The beam on which the load acts.
    p : float or callable of an array x
        The load along the beam in N/m.
    f : float, TimeFunction or callable of t
        A factor over time, without unit.
    """

    def __init__(self, beam: Beam, p: float | Callable[[Any], Any], f: Load = 1.0) -> None:
        if not isinstance(beam, Beam):
            raise ArgumentError(f"DistributedLoad: beam is {beam!r}, expected a Beam")
        self.beam = beam
        if isinstance(p, TimeFunction):
            raise ArgumentError(
                f"DistributedLoad: p is {p!r}, a function of time; give it as f=, and p as a number or a function of x"
            )
        self.p = p if callable(p) else number("DistributedLoad: p", p)
        self.f = as_time_function(f)

    def points(self) -> tuple[Point, ...]:
        """Return a point of the beam, so that the scene can check it."""
        return (self.beam.at("left"),)

    def compile(self, builder: SystemBuilder) -> None:
        """Add the consistent load vector."""
        builder.add_body_load(self.beam, self.beam.load_vector(self.p), self.f, self.describe())

    def along(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return p in N/m at points x, shape (k,)."""
        if not callable(self.p):
            return np.full(x.shape, self.p)
        return evaluate_along(f"a distributed load on {self.beam.label}", self.p, x)

    def describe(self) -> str:
        """Return beam and functions."""
        p = "p(x)" if callable(self.p) else f"{self.p:g} N/m"
        return f"DistributedLoad on Beam {self.beam.name!r}: {p} times {self.f!r}"


class Gravity:
    """The weight of everything that has mass, point masses included, acting downward from t = 0 on.

    A scene that starts undeformed is dropped into its own weight: it swings to
    twice the deflection of the equilibrium. ``initial=vofem.equilibrium(scene)``
    starts it in equilibrium.

    Parameters
    ----------
    g : float
        Acceleration in m/s^2, positive downward.
    """

    def __init__(self, g: float = 9.81) -> None:
        self.g = number("Gravity: g", g)

    def points(self) -> tuple[Point, ...]:
        """Return nothing: it acts on all bodies."""
        return ()

    def compile(self, builder: SystemBuilder) -> None:
        """Add a constant load in proportion to mass."""
        builder.add_acceleration(-self.g, Constant(1.0), self.describe())

    def describe(self) -> str:
        """Return g and its direction."""
        return f"Gravity: {abs(self.g):g} m/s^2 {'upward' if self.g < 0.0 else 'downward'}"
