"""Hysteretic springs: on the backbone of Eq. 24, as printed and for cyclic loads, and of parallel Jenkins elements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from vofem.arrays import Array
from vofem.assembly import SystemBuilder
from vofem.effects.two_points import Side, Stop, TwoPoints, Units
from vofem.errors import ArgumentError
from vofem.fractional.constants import ideal
from vofem.laws import Law, LinearLevel, PrintedLaw
from vofem.laws.hysteretic import cyclic, jenkins
from vofem.laws.softening_curve import checked_level, limit_load, tabulate
from vofem.parameters import Choice, Kind, Numbers, OneOf, Real, declared, label_of, rule
from vofem.parameters.kinds import Either


@declared(frozen=True)
class LinearSoftening:
    """A secant stiffness that falls linearly with the force, as in Eq. 24, where the span is 4 N.

    Beyond the linear limit the secant stiffness is ``K (1 - (|F| - F_Y)/span)``
    with ``F_Y = K d0``. The curve of force over elongation is then a hyperbola with the asymptote ``F_Y + span``.
    """

    span: Annotated[
        float, Real("N", "Increase of the force over which the secant stiffness falls from K to 0.", above=0.0)
    ] = 4.0


#: `LinearSoftening`, or the softening number as a function of the magnitude of the force in N.
Softening = LinearSoftening | Callable[[float], float]


_LINEAR = OneOf(classes={"linear": LinearSoftening}, expected="{ linear = { span = 4.0 } }")


@dataclass(frozen=True)
class SofteningKind(Either):
    """The softening of a spring: a `LinearSoftening`, or a callable of the force."""

    text: str = (
        "The share by which the secant stiffness has fallen, as a function of the magnitude of the force in N. It is 0 "
        "at ``K d0`` and does not decrease. It reaches 1 at the limit load. The default is Eq. 24, ``(|F| - K d0)/(4 "
        "N)``. A callable is tabulated once, up to 1e4 linear limits, with an error of 1e-11."
    )

    shown = "LinearSoftening or callable"
    expected = _LINEAR.expected

    def check(self, what: str, value: Any) -> Any:
        """Return the softening."""
        if not callable(value) and not isinstance(value, LinearSoftening):
            raise ArgumentError(f"{what} is {value!r}, expected a LinearSoftening or a callable of the force in N")
        return value

    def forms(self) -> tuple[Kind | None, Kind | None, Kind | None]:
        """Return the table."""
        return None, None, _LINEAR


#: The parameters of a backbone that softens.
InitialStiffness = Annotated[float, Real("N/m", "Stiffness K before yielding.", above=0.0)]
LinearLimit = Annotated[float, Real("m", "Elongation d0 up to which the spring is linear.", above=0.0)]
SofteningOf = Annotated[Softening | None, SofteningKind()]


class Backbone:
    """The curve of a first loading: ``F = K (1 - softening(F)) u`` beyond the linear limit.

    `label`: name of the spring in messages.
    `stiffness`, `linear_limit`: initial stiffness, N/m, and the elongation up to which the spring is linear, m.
    `softening`: the softening. The default is Eq. 24.
    """

    def __init__(self, label: str, stiffness: float, linear_limit: float, softening: Softening | None) -> None:
        self.label = label
        self.stiffness, self.linear_limit = stiffness, linear_limit
        self.onset = stiffness * linear_limit
        self.softening: Softening = LinearSoftening() if softening is None else softening
        self.level: Callable[[float], float]
        if isinstance(self.softening, LinearSoftening):
            self.limit = self.onset + self.softening.span
            self.level = LinearLevel(self.onset, self.softening.span)
        else:
            self.level = self._called
            self.limit = limit_load(label, self.level, self.onset)

    def _called(self, force: float) -> float:
        """Return the value of the callable at the magnitude of a force in N; 0 up to the linear limit."""
        if force <= self.onset * (1.0 - 1e-12):
            return 0.0
        assert not isinstance(self.softening, LinearSoftening)
        return checked_level(self.label, self.softening, force)

    def law(self, name: str, one_sided: bool = False, gap: float = 0.0, unit: str = "N") -> Law:
        """Return the cyclic law on this backbone."""
        span, table = None, None
        if isinstance(self.softening, LinearSoftening):
            span = self.softening.span
        else:
            table = tabulate(self.label, self.level, self.stiffness, self.onset, self.limit)
        return cyclic(
            self.label, name, self.stiffness, self.onset, self.limit, span=span, table=table, one_sided=one_sided,
            gap=gap, unit=unit,
        )  # fmt: skip


@declared()
class HystereticSpring(TwoPoints):
    """A spring between two points, or from a point to ground, that softens and keeps a residual elongation.

    The spring is linear up to `linear_limit`. Beyond it, a first loading follows
    the backbone ``F = K (1 - softening(F)) u``, and unloading is elastic with
    stiffness K. `memory` chooses how earlier loading acts on the spring:

    - "printed" is Eqs. 22-25 as they stand. The spring loses its residual
      elongation as soon as the load rises again: loaded to 7 N and unloaded to 3 N, it jumps from 10 m to 3 m at the
      first step of reloading. The law is driven by the applied force. It therefore holds only for a spring that is the
      single support of a single loaded mass.
    - "cyclic" stores the largest force that was reached. Unloading and reloading are
      elastic up to this force; beyond it the spring follows the backbone. Compression has a largest force of its own.

    Raises
    ------
    ArgumentError
        For arguments out of range, or a softening that does not begin at 0 or decreases.
    """

    _: KW_ONLY
    stiffness: InitialStiffness
    linear_limit: LinearLimit
    softening: SofteningOf = None
    memory: Annotated[
        Literal["printed", "cyclic"] | None,
        Choice(
            ("printed", "cyclic"),
            "The memory of the spring for earlier loading, see above. There is no default.",
            "one of 'printed', 'cyclic': 'printed' is Eq. 22 of the paper, which forgets at reloading; 'cyclic' "
            "remembers",
        ),
    ] = None

    @rule("softening", "stiffness", "linear_limit", "memory", "of")
    def _follow_the_backbone(self) -> None:
        self._backbone = Backbone(label_of(self), self.stiffness, self.linear_limit, self.softening)
        self.softening = self._backbone.softening
        name, unit = self.name, self.units.force
        self._law = self._backbone.law(name, unit=unit) if self.memory == "cyclic" else None

    @property
    def limit_load(self) -> float:
        """The limit load in N, which the spring approaches and never reaches; inf where there is none."""
        return self._backbone.limit

    def operator_stiffness(self, elongation: float, force: float, rising: bool) -> float:
        """Return the stiffness of Eqs. 22 and 25 in N/m: K minus the product of two variable-order operators.

        Parameters
        ----------
        elongation : float
            Elongation of the spring, m.
        force : float
            The applied force in N.
        rising : bool
            Whether the force rises. While the force is constant: whether it rose before.
        """
        softened = ideal(self._backbone.level(abs(force)), abs(elongation) - self.linear_limit)
        loading = ideal(self.stiffness, 1.0 if rising else -1.0)
        return float(self.stiffness - softened * loading)

    def integer_stiffness(self, elongation: float, force: float, rising: bool) -> float:
        """Return the stiffness of Eq. 26 in N/m, the integer-order law of the paper.

        The arguments are those of `operator_stiffness`.
        """
        if rising and elongation > self.linear_limit:
            return self.stiffness * (1.0 - self._backbone.level(abs(force)))
        return self.stiffness

    def compile(self, builder: SystemBuilder) -> None:
        """Add row and law."""
        if self._law is not None:
            builder.add_law(self._row(builder), self._law)
            return
        backbone = self._backbone
        law = PrintedLaw(backbone.label, self.name, self.stiffness, self.linear_limit, backbone.level, backbone.limit)
        builder.add_law(self._row(builder), law)

    def describe(self) -> str:
        """Return name, points and numbers."""
        return (
            f"HystereticSpring {self.name!r} from {self._where()}: {self.stiffness:g} {self.units.stiffness}, "
            f"linear to {self.linear_limit:g} {self.units.coordinate}, "
            f"limit load {self.limit_load:g} {self.units.force}, memory {self.memory}"
        )


@declared()
class CrushingStop(Stop):
    """A stop behind a gap that yields under force and keeps its residual deformation.

    The approach s is ``u_a - u_b`` between two points, ``-eta`` for a stop below, and ``eta`` for a stop above. The
    stop pushes back when s exceeds the gap. While it is crushed further than before, its force follows the backbone of
    `HystereticSpring`. When it unloads and is hit again, it is elastic with `stiffness`. It never pulls.

    Raises
    ------
    ArgumentError
        For arguments out of range.
    """

    _: KW_ONLY
    gap: Annotated[float, Real("m", "Gap before the stop is touched.")]
    side: Side = None
    stiffness: InitialStiffness
    linear_limit: LinearLimit
    softening: SofteningOf = None

    @rule("softening", "stiffness", "linear_limit", "gap", "of")
    def _follow_the_backbone(self) -> None:
        backbone = Backbone(label_of(self), self.stiffness, self.linear_limit, self.softening)
        self.softening = backbone.softening
        self._law = backbone.law(self.name, one_sided=True, gap=self.gap, unit=self.units.force)

    @property
    def limit_load(self) -> float:
        """The limit load in N, which the stop approaches and never reaches; inf where there is none."""
        return self._law.limit

    def compile(self, builder: SystemBuilder) -> None:
        """Add row and law."""
        builder.add_law(self._row(builder, -1.0 if self.side == "below" else 1.0), self._law)

    def describe(self) -> str:
        """Return name, place and numbers."""
        units = self.units
        return (
            f"CrushingStop {self.name!r} {self._place()}, {self.stiffness:g} {units.stiffness}, "
            f"linear to {self.linear_limit:g} {units.coordinate}, limit load {self.limit_load:g} {units.force}"
        )


@declared()
class JenkinsSpring(TwoPoints):
    """A spring of parallel Jenkins elements; subclasses say of which ones by their rules, which set the law."""

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

    The curve is piecewise linear from the origin through the given points. It is reproduced by parallel Jenkins
    elements, one for each bend, beside a spring of the last slope. After a reversal the force follows the same curve,
    doubled in both directions. Closed loops are therefore the same in every cycle.

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
