"""Softening: the relative loss of secant stiffness of a spring, as a function of the force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

from vofem.errors import ArgumentError
from vofem.laws import Law, LinearLevel
from vofem.laws.hysteretic import cyclic
from vofem.laws.softening_curve import checked_level, limit_load, tabulate
from vofem.parameters import Kind, OneOf, Real, declared
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
