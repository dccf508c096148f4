"""Functions of time for loads: closed forms with exact derivatives.

A named function is, between its breakpoints, a sum of harmonics and a
polynomial of degree one. `TimeFunction.piece` returns exactly that, and the
event-driven method integrates it in closed form. A plain callable has no
pieces: only the stepping methods take it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import array, number
from vofem.errors import ArgumentError, LoadError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Piece:
    """A function near a time t0: ``sum_k Re(a_k exp(i w_k tau)) + c0 + c1 tau``, tau = t - t0.

    Attributes
    ----------
    harmonics : tuple of (float, complex)
        Pairs (w in rad/s, complex amplitude at t0).
    constant, slope : float
        The polynomial part.
    """

    harmonics: tuple[tuple[float, complex], ...] = ()
    constant: float = 0.0
    slope: float = 0.0

    def __add__(self, other: Piece) -> Piece:
        return Piece(self.harmonics + other.harmonics, self.constant + other.constant, self.slope + other.slope)

    def scaled(self, factor: float) -> Piece:
        """Return the piece times a number."""
        harmonics = tuple((w, factor * a) for w, a in self.harmonics)
        return Piece(harmonics, factor * self.constant, factor * self.slope)


class TimeFunction(ABC):
    """A scalar function of time, t in seconds. Sums and multiples by numbers are functions too."""

    #: Whether `piece` and `derivative` are available.
    closed_form = True

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

    def __add__(self, other: Any) -> TimeFunction:
        return Sum((self, as_time_function(other)))

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


def _inside(times: ArrayLike, t_end: float) -> Array:
    points = np.unique(np.asarray(times, dtype=float))
    return points[(points > 0.0) & (points < t_end)]


def _order(order: int) -> int:
    if not isinstance(order, (int, np.integer)) or order < 0:
        raise ArgumentError(f"the order of a derivative is {order!r}, expected 0, 1, 2, ...")
    return int(order)


@dataclass(frozen=True)
class Sine(TimeFunction):
    """``amplitude * sin(omega t + phase)``.

    Parameters
    ----------
    amplitude : float
        In the unit of the load.
    omega : float
        Angular frequency in rad/s.
    phase : float
        In rad.
    """

    amplitude: float
    omega: float
    phase: float = 0.0

    def __post_init__(self) -> None:
        for name in ("amplitude", "omega", "phase"):
            object.__setattr__(self, name, number(f"Sine: {name}", getattr(self, name)))

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        return self.amplitude * np.sin(self.omega * np.asarray(t, dtype=float) + self.phase)

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return the derivative of the given order."""
        angle = self.omega * np.asarray(t, dtype=float) + self.phase
        turn = _order(order) % 4
        wave = (np.sin(angle), np.cos(angle), -np.sin(angle), -np.cos(angle))[turn]
        return self.amplitude * self.omega**order * wave

    def piece(self, t0: float) -> Piece:
        """Return one harmonic, or a constant where omega is 0."""
        angle = self.omega * t0 + self.phase
        if self.omega == 0.0:
            return Piece(constant=self.amplitude * float(np.sin(angle)))
        sign = 1.0 if self.omega > 0 else -1.0
        amplitude = self.amplitude * complex(np.sin(angle), -sign * np.cos(angle))
        return Piece(harmonics=((abs(self.omega), amplitude),))


@dataclass(frozen=True)
class Constant(TimeFunction):
    """The same value at all times t >= 0."""

    value: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", number("Constant: value", self.value))

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        return np.full(np.shape(t), self.value)

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return zero, or the value for order 0."""
        return np.full(np.shape(t), self.value if _order(order) == 0 else 0.0)

    def piece(self, t0: float) -> Piece:
        """Return the constant."""
        return Piece(constant=self.value)


@dataclass(frozen=True)
class Ramp(TimeFunction):
    """Zero until `start`, then growing with `slope` until `stop`, then held.

    Parameters
    ----------
    slope : float
        Per second, in the unit of the load.
    start : float
        In s.
    stop : float, optional
        In s; without it the ramp never ends.
    """

    slope: float
    start: float = 0.0
    stop: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "slope", number("Ramp: slope", self.slope))
        object.__setattr__(self, "start", number("Ramp: start", self.start))
        if self.stop is not None:
            object.__setattr__(self, "stop", number("Ramp: stop", self.stop))
            if self.stop <= self.start:
                raise ArgumentError(f"Ramp: stop is {self.stop:g}, expected a time after start = {self.start:g}")

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        end = np.inf if self.stop is None else self.stop
        return self.slope * np.clip(np.asarray(t, dtype=float) - self.start, 0.0, end - self.start)

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return the slope while the ramp grows."""
        if _order(order) == 0:
            return self(t)
        t = np.asarray(t, dtype=float)
        end = np.inf if self.stop is None else self.stop
        return np.where((t >= self.start) & (t < end) & (order == 1), self.slope, 0.0)

    def breakpoints(self, t_end: float) -> Array:
        """Return the corners."""
        return _inside([self.start] if self.stop is None else [self.start, self.stop], t_end)

    def piece(self, t0: float) -> Piece:
        """Return value and slope at t0."""
        return Piece(constant=float(self(t0)), slope=float(self.derivative(t0)))


@dataclass(frozen=True)
class Pulse(TimeFunction):
    """A rectangular pulse: `amplitude` for start <= t < start + duration, zero elsewhere."""

    amplitude: float
    start: float
    duration: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "amplitude", number("Pulse: amplitude", self.amplitude))
        object.__setattr__(self, "start", number("Pulse: start", self.start))
        object.__setattr__(self, "duration", number("Pulse: duration", self.duration, positive=True))

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        t = np.asarray(t, dtype=float)
        return np.where((t >= self.start) & (t < self.start + self.duration), self.amplitude, 0.0)

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return zero: the jumps are breakpoints, not impulses."""
        return self(t) if _order(order) == 0 else np.zeros(np.shape(t))

    def breakpoints(self, t_end: float) -> Array:
        """Return the two edges."""
        return _inside([self.start, self.start + self.duration], t_end)

    def piece(self, t0: float) -> Piece:
        """Return the constant that holds from t0 on."""
        return Piece(constant=float(self(t0)))


@dataclass(frozen=True, eq=False)
class Tabulated(TimeFunction):
    """Linear interpolation of a table; held constant before the first and after the last time.

    Parameters
    ----------
    t : array_like, shape (n,)
        Strictly increasing times in s.
    values : array_like, shape (n,)
        In the unit of the load.
    """

    t: Array
    values: Array
    _slopes: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        times = array("Tabulated: t", self.t)
        values = array("Tabulated: values", self.values)
        if times.ndim != 1 or times.shape != values.shape or times.size < 1:
            raise ArgumentError(
                f"Tabulated: t has shape {times.shape} and values {values.shape}, expected two equal (n,)"
            )
        if np.any(np.diff(times) <= 0):
            k = int(np.argmax(np.diff(times) <= 0))
            raise ArgumentError(
                f"Tabulated: t must increase strictly, found {times[k]:g} s followed by {times[k + 1]:g} s"
            )
        object.__setattr__(self, "t", times)
        object.__setattr__(self, "values", values)
        slopes = np.concatenate([[0.0], np.diff(values) / np.diff(times), [0.0]])
        object.__setattr__(self, "_slopes", slopes)

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        return np.interp(np.asarray(t, dtype=float), self.t, self.values)

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return the slope of the interval that starts at or holds t."""
        if _order(order) == 0:
            return self(t)
        interval = np.searchsorted(self.t, np.asarray(t, dtype=float), side="right")
        return self._slopes[interval] if order == 1 else np.zeros(np.shape(t))

    def breakpoints(self, t_end: float) -> Array:
        """Return the times of the table."""
        return _inside(self.t, t_end)

    def piece(self, t0: float) -> Piece:
        """Return value and slope at t0."""
        return Piece(constant=float(self(t0)), slope=float(self.derivative(t0)))


@dataclass(frozen=True)
class Sum(TimeFunction):
    """A sum of time functions; made by ``+``."""

    terms: tuple[TimeFunction, ...]

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

    def piece(self, t0: float) -> Piece:
        """Return the sum of the pieces."""
        total = Piece()
        for term in self.terms:
            total = total + term.piece(t0)
        return total


@dataclass(frozen=True)
class Scaled(TimeFunction):
    """A time function times a number; made by ``*``."""

    function: TimeFunction
    factor: float

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        return self.factor * self.function(t)

    @property
    def closed_form(self) -> bool:  # type: ignore[override]
        """Whether the function has a closed form."""
        return self.function.closed_form

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return the derivative times the factor."""
        return self.factor * self.function.derivative(t, order)

    def breakpoints(self, t_end: float) -> Array:
        """Return the function's breakpoints."""
        return self.function.breakpoints(t_end)

    def piece(self, t0: float) -> Piece:
        """Return the function's piece times the factor."""
        return self.function.piece(t0).scaled(self.factor)


@dataclass(frozen=True)
class Arbitrary(TimeFunction):
    """A plain callable of t in s, wrapped and watched: a value that is not a finite number raises `LoadError`."""

    function: Callable[[Any], Any]

    closed_form = False

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
        """Refuse: a plain callable has no known derivative."""
        raise ArgumentError(f"load function {self._name} has no derivative; use Sine, Ramp, Tabulated, ...")

    def piece(self, t0: float) -> Piece:
        """Refuse: a plain callable has no closed form."""
        raise ArgumentError(f"load function {self._name} has no closed form; use Sine, Ramp, Tabulated, ...")


def as_time_function(value: Any) -> TimeFunction:
    """Return `value` as a `TimeFunction`: one already, a number, or any callable of t."""
    if isinstance(value, TimeFunction):
        return value
    if callable(value):
        return Arbitrary(value)
    if isinstance(value, str) or not np.isscalar(value):
        raise ArgumentError(
            f"a load's time function is {value!r}, expected a number, a callable of t, Sine, Ramp, Tabulated, ..."
        )
    return Constant(number("a load's time function", value))
