"""The base of all functions of time, and their sums and multiples."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import number, wrong
from vofem.arrays import Array
from vofem.errors import ArgumentError, LoadError
from vofem.parameters import Kind, OneOf, Real, Unwritable, declared
from vofem.parameters.kinds import Either
from vofem.parameters.place import INVALID, Book, Invalid, Place
from vofem.time_functions.moments import gather, sampled, straight
from vofem.time_functions.piece import Piece


class TimeFunction(ABC):
    """A scalar function of time t in s. Sums (``f + g``) and multiples (``2 * f``) are functions of time too."""

    #: Whether `piece` and `derivative` are available.
    closed_form = True

    #: Whether it belongs to a load that travels along a beam.
    travels = False

    #: What keeps it from having a closed form, for messages; empty where a plain callable does.
    obstacle = ""

    #: Whether its parameters tell all of it, so that a scene file can hold it.
    written_out = True

    @abstractmethod
    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t (any shape); continuous from the right at jumps."""

    @abstractmethod
    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return the exact derivative of the given order at times t (from the right at corners)."""

    def breakpoints(self, t_end: float) -> Array:
        """Return the times in (0, t_end) where the function or its slope jumps, sorted."""
        return np.empty(0)

    @abstractmethod
    def piece(self, t0: float) -> Piece:
        """Return the closed form that holds from t0 to the next breakpoint."""

    def polynomials(self, t0: Array) -> Array | None:
        """Return value and derivatives of the pieces from many times on; None if a piece may be no cubic.

        Parameters
        ----------
        t0 : ndarray, shape (n,)
            Start of each interval, s.

        Returns
        -------
        ndarray, shape (4, n)
            Values and the first three derivatives there.
        """
        return None

    @property
    def sample_spacing(self) -> float:
        """Distance in s of the times at which a callable was evaluated; 0 for a known shape, inf for an unknown one."""
        return 0.0

    def shortest(self, t_end: float) -> float:
        """Return the shortest time in s within [0, t_end] over which the function changes noticeably."""
        points = self.breakpoints(t_end)
        if not points.size:
            return np.inf
        return float(np.min(np.diff(np.concatenate([[0.0], points, [t_end]]))))

    def corners(self, left: float, right: float) -> Array:
        """Return the breakpoints in (left, right), sorted."""
        points = self.breakpoints(right)
        return points[points > left]

    def moments(self, left: ArrayLike, right: ArrayLike, width: float = np.inf) -> Array:
        """Return exact moments over intervals, ``x = (t - middle)/length`` in [-1/2, 1/2].

        Parameters
        ----------
        left, right : array_like, shape (n,)
            Ends of the intervals in s, left < right.
        width : float
            Largest distance in s of the times at which a plain callable is evaluated.

        Returns
        -------
        moments : ndarray, shape (3, n)
            The means of f, of ``x f`` and of ``(x^2 - 1/12) f``; the impulse is the first times the length, and the
            first moment about the middle is the second times its square.
        """
        a, b = np.atleast_1d(np.asarray(left, dtype=float)), np.atleast_1d(np.asarray(right, dtype=float))
        if not a.size:
            return np.empty((3, 0))
        corners = self.corners(float(np.min(a)), float(np.max(b)))
        return gather(a, b, corners, lambda low, high: self.smooth_moments(low, high, width))

    def smooth_moments(self, left: Array, right: Array, width: float) -> Array:
        """Return the moments over intervals without breakpoints inside, shape (3, n); by quadrature unless known."""
        return sampled(self, left, right, width)

    def __add__(self, other: Any) -> TimeFunction:
        # One sum of many terms, not sums of sums: these may be nested too deeply.
        return Sum(tuple(term for one in (self, as_time_function(other)) for term in getattr(one, "terms", (one,))))

    __radd__ = __add__

    def __mul__(self, factor: Any) -> TimeFunction:
        return Scaled(self, number("the factor of a time function", factor))

    __rmul__ = __mul__

    def __truediv__(self, divisor: Any) -> TimeFunction:
        value = number("the divisor of a time function", divisor)
        if value == 0.0:
            raise ArgumentError("the divisor of a time function is 0")
        return Scaled(self, 1.0 / value)

    def __neg__(self) -> TimeFunction:
        return self * -1.0

    def __sub__(self, other: Any) -> TimeFunction:
        return self + as_time_function(other) * -1.0

    def __rsub__(self, other: Any) -> TimeFunction:
        return as_time_function(other) + self * -1.0


class PiecewiseStraight(TimeFunction):
    """A function that is a straight line between its breakpoints."""

    def piece(self, t0: float) -> Piece:
        """Return value and slope at t0."""
        return Piece(constant=float(self(t0)), slope=float(self.derivative(t0)))

    def polynomials(self, t0: Array) -> Array | None:
        """Return values, slopes and zeros."""
        return np.stack([self(t0), self.derivative(t0), *np.zeros((2, t0.size))])

    def smooth_moments(self, left: Array, right: Array, width: float) -> Array:
        """Return the moments of straight lines."""
        middle = 0.5 * (left + right)
        return straight(self(middle), self.derivative(middle), right - left)


#: Functions of time that scene files know, by name.
FUNCTIONS: dict[str, type] = {}

_NAMED = OneOf(classes=FUNCTIONS, expected="a function of time such as { sine = { amplitude = 1.0, omega = 2.0 } }")


@dataclass(frozen=True)
class OfTime(Either):
    """A parameter that is a function of time: a number, a `TimeFunction` or a callable."""

    unit: str = ""
    text: str = ""

    shown = "float, TimeFunction or callable of t"
    expected = f"a number or {_NAMED.expected}"
    schema: ClassVar = {"$ref": "#/$defs/function_of_time"}

    @property
    def meaning(self) -> str:
        """What it means, and its unit."""
        return f"{self.text} In {self.unit}. A callable takes one time in s." if self.unit else self.text

    def forms(self) -> tuple[Kind | None, Kind | None, Kind | None]:
        """Return both."""
        return Real(), None, _NAMED

    def check(self, what: str, value: Any) -> TimeFunction:
        """Return the function."""
        return as_time_function(value, what)

    def read(self, value: Any, place: Place) -> TimeFunction | Invalid:
        """Return the function of a number or of a table."""
        read = super().read(value, place)
        return read if isinstance(read, Invalid) else as_time_function(read)

    def write(self, value: Any, book: Book) -> Any:
        """Return a number for a constant, else the table."""
        function = as_time_function(value)
        if type(function) is Constant:
            return float(function.value)
        if not function.written_out:
            raise Unwritable(f"{function!r} is a callable, which a scene file cannot hold; use one of {_NAMED.names()}")
        return _NAMED.write(function, book)

    def described(self) -> dict[str, Any]:
        """Return the definition that all functions of time share."""
        return Kind.described(self)


@dataclass(frozen=True)
class FunctionsOfTime(Kind):
    """A parameter that is several functions of time."""

    text: str = ""

    shown = "tuple of TimeFunction"
    expected = "an array of functions of time"

    def read(self, value: Any, place: Place) -> tuple[Any, ...] | Invalid:
        """Return a tuple of them."""
        if not isinstance(value, list) or not value:
            return place.expected(self.expected, value)
        parts = tuple(OfTime().read(part, place.index(k)) for k, part in enumerate(value))
        return INVALID if any(isinstance(part, Invalid) for part in parts) else parts

    def write(self, value: Any, book: Book) -> list[Any]:
        """Return an array."""
        return [OfTime().write(part, book) for part in value]

    def described(self) -> dict[str, Any]:
        """Return an array."""
        return {"type": "array", "items": OfTime().described(), "minItems": 1}


@declared(frozen=True, bare=True)
class Sum(TimeFunction):
    """A sum of functions of time, written ``f + g``."""

    terms: Annotated[tuple[TimeFunction, ...], FunctionsOfTime("The functions.")]

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        return np.sum([term(t) for term in self.terms], axis=0)

    @property
    def closed_form(self) -> bool:  # type: ignore[override]
        """Whether all terms have closed forms."""
        return all(term.closed_form for term in self.terms)

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return the sum of the derivatives."""
        return np.sum([term.derivative(t, order) for term in self.terms], axis=0)

    def breakpoints(self, t_end: float) -> Array:
        """Return the breakpoints of all terms."""
        return np.unique(np.concatenate([term.breakpoints(t_end) for term in self.terms]))

    @property
    def sample_spacing(self) -> float:
        """The largest distance among the terms."""
        return max(term.sample_spacing for term in self.terms)

    def shortest(self, t_end: float) -> float:
        """Return the shortest of the terms' times."""
        return min(term.shortest(t_end) for term in self.terms)

    def corners(self, left: float, right: float) -> Array:
        """Return the breakpoints of all terms in (left, right)."""
        return np.unique(np.concatenate([term.corners(left, right) for term in self.terms]))

    def smooth_moments(self, left: Array, right: Array, width: float) -> Array:
        """Return the sum of the moments."""
        return np.sum([term.smooth_moments(left, right, width) for term in self.terms], axis=0)

    def polynomials(self, t0: Array) -> Array | None:
        """Return the sum of the terms' polynomials, where all have some."""
        parts = [term.polynomials(t0) for term in self.terms]
        known = [part for part in parts if part is not None]
        return np.sum(known, axis=0) if len(known) == len(parts) else None

    def piece(self, t0: float) -> Piece:
        """Return the sum of the pieces."""
        total = Piece()
        for term in self.terms:
            total = total + term.piece(t0)
        return total


class Wrapped(TimeFunction):
    """A function of time that is made of another one, `function`, and is as well known as that."""

    function: TimeFunction

    @property
    def closed_form(self) -> bool:  # type: ignore[override]
        """Whether the function has a closed form."""
        return self.function.closed_form

    @property
    def travels(self) -> bool:  # type: ignore[override]
        """Whether the function belongs to a load that travels."""
        return self.function.travels

    @property
    def obstacle(self) -> str:  # type: ignore[override]
        """What keeps the function from having a closed form."""
        return self.function.obstacle

    @property
    def sample_spacing(self) -> float:
        """Distance in s of the times at which a callable was evaluated."""
        return self.function.sample_spacing


@declared(frozen=True)
class Scaled(Wrapped):
    """A function of time multiplied by a number, written ``2 * f``."""

    function: Annotated[TimeFunction, OfTime("", "The function.")]
    factor: Annotated[float, Real("", "The number.")]

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        return self.factor * self.function(t)

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return the derivative times the factor."""
        return self.factor * self.function.derivative(t, order)

    def breakpoints(self, t_end: float) -> Array:
        """Return the function's breakpoints."""
        return self.function.breakpoints(t_end)

    def shortest(self, t_end: float) -> float:
        """Return the time of the function."""
        return self.function.shortest(t_end)

    def corners(self, left: float, right: float) -> Array:
        """Return the function's breakpoints in (left, right)."""
        return self.function.corners(left, right)

    def smooth_moments(self, left: Array, right: Array, width: float) -> Array:
        """Return the function's moments times the factor."""
        return self.factor * self.function.smooth_moments(left, right, width)

    def polynomials(self, t0: Array) -> Array | None:
        """Return the function's polynomials times the factor."""
        known = self.function.polynomials(t0)
        return None if known is None else self.factor * known

    def piece(self, t0: float) -> Piece:
        """Return the function's piece times the factor."""
        return self.function.piece(t0).scaled(self.factor)


def inside(times: ArrayLike, t_end: float) -> Array:
    """Return those of some times that lie in (0, t_end), sorted."""
    points = np.unique(np.asarray(times, dtype=float))
    return points[(points > 0.0) & (points < t_end)]


def order_of(order: int) -> int:
    """Return the order of a derivative, checked."""
    if isinstance(order, bool) or not isinstance(order, (int, np.integer)) or order < 0:
        raise ArgumentError(f"the order of a derivative is {order!r}, expected 0, 1, 2, ...")
    return int(order)


@declared(frozen=True, bare=True)
class Constant(PiecewiseStraight):
    """A constant: the same value at all times t >= 0."""

    value: Annotated[float, Real("the unit of the load", "The value.")]

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        return np.full(np.shape(t), self.value)

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return zero, or the value for order 0."""
        return np.full(np.shape(t), self.value if order_of(order) == 0 else 0.0)


@dataclass(frozen=True)
class Arbitrary(TimeFunction):
    """A plain callable of t in s. A value that is not a finite number raises `LoadError`."""

    function: Callable[[Any], Any]

    closed_form = False
    written_out = False
    sample_spacing = np.inf

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        times = np.asarray(t, dtype=float)
        values = np.array([self._value(time) for time in times.ravel()])
        return values.reshape(times.shape)

    def _value(self, t: float) -> float:
        try:
            value = self.function(float(t))
        except Exception as error:
            raise LoadError(
                f"load function {self._name} raised {type(error).__name__}: {error} at t = {t:g} s; it must take one "
                "time in s and return a number"
            ) from error
        try:
            result = float(value)
        except (TypeError, ValueError):
            raise LoadError(
                f"load function {self._name} returned {value!r} at t = {t:g} s, expected a number"
            ) from None
        if not np.isfinite(result):
            raise LoadError(
                f"load function {self._name} returned {result} at t = {t:g} s, expected a finite number; "
                "a division by zero or a table that ends too early is the usual cause"
            )
        return result

    def __repr__(self) -> str:
        return f"function {self._name}"

    @property
    def _name(self) -> str:
        return repr(getattr(self.function, "__name__", self.function))

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Raise an error, because the derivative of a plain callable is not known."""
        raise ArgumentError(f"load function {self._name} has no derivative; use Sine, Ramp, Tabulated, ...")

    def piece(self, t0: float) -> Piece:
        """Raise an error, because a plain callable has no closed form."""
        raise ArgumentError(f"load function {self._name} has no closed form; use Sine, Ramp, Tabulated, ...")


def as_time_function(value: Any, what: str = "a function of time") -> TimeFunction:
    """Return a number, a callable of t or a `TimeFunction` as a `TimeFunction`; `what` names it in messages."""
    if isinstance(value, TimeFunction):
        return value
    if callable(value) and not isinstance(value, type):
        return Arbitrary(value)
    if isinstance(value, str) or not np.isscalar(value):
        cure = f"; write {value.__name__}(...)" if isinstance(value, type) and issubclass(value, TimeFunction) else ""
        raise wrong(what, repr(value), "a number, a callable of t, Sine, Ramp, Tabulated, ...", cure)
    return Constant(number(what, value))


#: What `as_time_function` takes.
Load = TimeFunction | float | Callable[[float], Any]
