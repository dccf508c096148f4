"""Sines, constants, ramps and pulses."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import number
from vofem.errors import ArgumentError
from vofem.time_functions.base import PiecewiseStraight, TimeFunction, inside, order_of
from vofem.time_functions.moments import wave
from vofem.time_functions.piece import Piece

Array = NDArray[np.float64]


@dataclass(frozen=True, init=False, repr=False)
class Sine(TimeFunction):
    """``amplitude * sin(omega t + phase)``; either `omega` or `frequency` is given.

    Parameters
    ----------
    amplitude : float
        Amplitude in the unit of the load.
    omega : float, optional
        Angular frequency in rad/s.
    phase : float
        Phase in rad.
    frequency : float, optional
        Frequency in Hz; omega is ``2 pi frequency``. Texts and scene files repeat what was given.

    Raises
    ------
    ArgumentError
        If neither or both of `omega` and `frequency` are given.
    """

    amplitude: float
    omega: float
    phase: float
    frequency: float | None = field(init=False, compare=False)

    def __init__(
        self, amplitude: float, omega: float | None = None, phase: float = 0.0, *, frequency: float | None = None
    ) -> None:
        if (omega is None) == (frequency is None):
            raise ArgumentError(
                f"Sine: omega is {omega!r} and frequency is {frequency!r}, expected exactly one of them: omega in "
                "rad/s, or frequency in Hz"
            )
        if frequency is not None:
            frequency = number("Sine: frequency", frequency)
            omega = 2.0 * np.pi * frequency
        object.__setattr__(self, "amplitude", number("Sine: amplitude", amplitude))
        object.__setattr__(self, "omega", number("Sine: omega", omega))
        object.__setattr__(self, "phase", number("Sine: phase", phase))
        object.__setattr__(self, "frequency", frequency)

    def __repr__(self) -> str:
        given = f"omega={self.omega!r}" if self.frequency is None else f"frequency={self.frequency!r}"
        return f"Sine(amplitude={self.amplitude!r}, {given}, phase={self.phase!r})"

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        return self.amplitude * np.sin(self.omega * np.asarray(t, dtype=float) + self.phase)

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return the derivative of the given order."""
        angle = self.omega * np.asarray(t, dtype=float) + self.phase
        turn = order_of(order) % 4
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

    def shortest(self, t_end: float) -> float:
        """Return the time in which the phase grows by one radian."""
        return 1.0 / abs(self.omega) if self.omega != 0.0 and self.amplitude != 0.0 else np.inf

    def smooth_moments(self, left: Array, right: Array, width: float) -> Array:
        """Return the moments in closed form."""
        angle = self.omega * (0.5 * (left + right)) + self.phase
        m0, m1, m2 = wave(0.5 * self.omega * (right - left))
        sine, moments = np.sin(angle), np.empty((3, angle.size))
        moments[0], moments[1], moments[2] = m0 * sine, m1 * np.cos(angle), m2 * sine
        moments *= self.amplitude
        return moments


@dataclass(frozen=True)
class Ramp(PiecewiseStraight):
    """A ramp: zero until `start`, then growing with `slope` until `stop`, then constant.

    Parameters
    ----------
    slope : float
        Slope in the unit of the load per second.
    start : float
        Time in s at which the ramp begins.
    stop : float, optional
        Time in s from which the value stays constant. Without it the ramp never ends.
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
        if order_of(order) == 0:
            return self(t)
        t = np.asarray(t, dtype=float)
        end = np.inf if self.stop is None else self.stop
        return np.where((t >= self.start) & (t < end) & (order == 1), self.slope, 0.0)

    def breakpoints(self, t_end: float) -> Array:
        """Return the corners."""
        return inside([self.start] if self.stop is None else [self.start, self.stop], t_end)

    def piece(self, t0: float) -> Piece:
        """Return value and slope at t0."""
        return Piece(constant=float(self(t0)), slope=float(self.derivative(t0)))


@dataclass(frozen=True)
class Pulse(PiecewiseStraight):
    """A rectangular pulse: `amplitude` for start <= t < start + duration, zero elsewhere.

    Parameters
    ----------
    amplitude : float
        Value during the pulse, in the unit of the load.
    start : float
        Time in s at which the pulse begins.
    duration : float
        Length of the pulse in s, positive.
    """

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
        return self(t) if order_of(order) == 0 else np.zeros(np.shape(t))

    def breakpoints(self, t_end: float) -> Array:
        """Return the two edges."""
        return inside([self.start, self.start + self.duration], t_end)

    def piece(self, t0: float) -> Piece:
        """Return the constant that holds from t0 on."""
        return Piece(constant=float(self(t0)))
