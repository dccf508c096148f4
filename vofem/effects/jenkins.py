"""Springs of parallel Jenkins elements: the bilinear spring, and that of Prandtl and Iwan.

A Jenkins element is a spring in series with a slider that slips at a given force.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, field
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from vofem.arrays import Array
from vofem.assembly import SystemBuilder
from vofem.effects.kinds import Named
from vofem.effects.two_points import TwoPoints, Units
from vofem.errors import ArgumentError
from vofem.laws import Law
from vofem.laws.hysteretic import jenkins
from vofem.parameters import CHOSEN, Numbers, Real, declared, label_of, rule


@declared()
class JenkinsSpring(TwoPoints):
    """A spring of parallel Jenkins elements; subclasses say of which ones by their rules, which set the law."""

    name: Named = field(default=CHOSEN, kw_only=True)
    _law: Law = field(init=False)

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


@declared()
class IwanSpring(JenkinsSpring):
    """A spring that follows a given curve of first loading, and Masing's rules after every reversal.

    The curve is piecewise linear from the origin through the given points. It is
    reproduced by parallel Jenkins elements, one for each bend, beside a spring
    of the last slope. After a reversal the force follows the same curve, doubled
    in both directions. Closed loops are therefore the same in every cycle.

    Raises
    ------
    ArgumentError
        If a slope of the curve is larger than the one before it, or negative.

    References
    ----------
    W. D. Iwan, A distributed-element model for hysteresis and its steady-state dynamic response,
    J. Appl. Mech. 33 (1966) 893-900, https://doi.org/10.1115/1.3625199.
    """

    _: KW_ONLY
    elongation: Annotated[ArrayLike, Numbers("m", "Points of the first loading, positive, increasing.")]
    force: Annotated[
        ArrayLike,
        Numbers(
            "N",
            "Force at these points. The slopes decrease and are not negative. Beyond the last point the curve "
            "continues with the last slope.",
        ),
    ]

    @rule("elongation", "force", "of")
    def _follow_the_curve(self) -> None:
        self.elongation, self.force = np.atleast_1d(self.elongation), np.atleast_1d(self.force)
        self._law = _law(label_of(self), self.name, self.elongation, self.force, self.units)


@declared()
class BilinearSpring(JenkinsSpring):
    """A spring with two slopes and kinematic hardening: one Jenkins element beside a linear spring.

    Raises
    ------
    ArgumentError
        For arguments out of range.
    """

    _: KW_ONLY
    stiffness: Annotated[float, Real("N/m", "Stiffness before yielding.", above=0.0)]
    linear_limit: Annotated[float, Real("m", "Elongation at which the spring first yields.", above=0.0)]
    hardening: Annotated[
        float,
        Real("", "Slope after yielding divided by `stiffness`; 0 is elastic, perfectly plastic.", least=0.0, below=1.0),
    ] = 0.0

    @rule("stiffness", "linear_limit", "hardening", "of")
    def _follow_two_slopes(self) -> None:
        slopes = self.stiffness * np.array([1.0, self.hardening])
        self._law = _jenkins(label_of(self), self.name, slopes, np.array([self.linear_limit]), self.units)


def _law(label: str, name: str, elongation: Array, force: Array, units: Units) -> Law:
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


def _jenkins(label: str, name: str, slopes: Array, bends: Array, units: Units) -> Law:
    """Return the law of given slopes, shape (n + 1,), with bends between them, shape (n,)."""
    stiffness = slopes[:-1] - slopes[1:]
    kept = stiffness > 1e-12 * slopes[0]
    slip = stiffness * bends
    limit = float(np.sum(slip[kept])) if slopes[-1] == 0.0 else float("inf")
    return jenkins(label, name, float(slopes[0]), float(slopes[-1]), stiffness[kept], slip[kept], limit, units.force)
