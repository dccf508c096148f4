"""Hysteretic springs with the backbone of Eq. 24: the law that the paper prints, and one for cyclic loads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any, Literal

from vofem.assembly import SystemBuilder
from vofem.effects.two_points import Side, Stop, TwoPoints
from vofem.errors import ArgumentError
from vofem.fractional.constants import ideal
from vofem.laws import HystereticLaw, LinearLevel, PrintedLaw
from vofem.laws.hysteretic import cyclic
from vofem.laws.softening_curve import checked_level, limit_load, tabulate
from vofem.parameters import Choice, Kind, OneOf, Real, declared, label_of, rule
from vofem.parameters.place import Book, Place


@declared(frozen=True)
class LinearSoftening:
    """A secant stiffness that falls linearly with the force, as in Eq. 24, where the span is 4 N.

    Beyond the linear limit the secant stiffness is ``K (1 - (|F| - F_Y)/span)``
    with ``F_Y = K d0``. The curve of force over elongation is then a hyperbola
    with the asymptote ``F_Y + span``.
    """

    span: Annotated[
        float, Real("N", "Increase of the force over which the secant stiffness falls from K to 0.", above=0.0)
    ] = 4.0


#: `LinearSoftening`, or the softening number as a function of the magnitude of the force in N.
Softening = LinearSoftening | Callable[[float], float]


_LINEAR = OneOf(classes={"linear": LinearSoftening}, expected="{ linear = { span = 4.0 } }")


@dataclass(frozen=True)
class SofteningKind(Kind):
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

    def read(self, value: Any, place: Place) -> Any:
        """Return the object of a table."""
        return _LINEAR.read(value, place)

    def write(self, value: Any, book: Book) -> Any:
        """Return the table."""
        return _LINEAR.write(value, book)

    def described(self) -> dict[str, Any]:
        """Return the table."""
        return {**_LINEAR.described(), **super().described()}


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

    def law(self, name: str, one_sided: bool = False, gap: float = 0.0, unit: str = "N") -> HystereticLaw:
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
      elongation as soon as the load rises again: loaded to 7 N and unloaded to
      3 N, it jumps from 10 m to 3 m at the first step of reloading. The law is
      driven by the applied force. It therefore holds only for a spring that
      is the single support of a single loaded mass.
    - "cyclic" stores the largest force that was reached. Unloading and reloading are
      elastic up to this force; beyond it the spring follows the backbone.
      Compression has a largest force of its own.

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

    The approach s is ``u_a - u_b`` between two points, ``-eta`` for a stop below,
    and ``eta`` for a stop above. The stop pushes back when s exceeds the gap.
    While it is crushed further than before, its force follows the backbone of
    `HystereticSpring`. When it unloads and is hit again, it is elastic with
    `stiffness`. It never pulls.

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
