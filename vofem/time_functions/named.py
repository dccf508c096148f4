"""Sines, constants, ramps and pulses."""

from __future__ import annotations

from dataclasses import KW_ONLY, field
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import wrong
from vofem.arrays import Array
from vofem.errors import ArgumentError
from vofem.parameters import Real, declared, rule
from vofem.time_functions.base import PiecewiseStraight, TimeFunction, inside, order_of
from vofem.time_functions.moments import wave
from vofem.time_functions.piece import Piece


@declared(frozen=True, either=("omega", "frequency"))
class Sine(TimeFunction):
    """``amplitude * sin(omega t + phase)``; either `omega` or `frequency` is given.

    Raises
    ------
    ArgumentError
        If neither or both of `omega` and `frequency` are given.
    """

    amplitude: Annotated[float, Real("the unit of the load", "Amplitude.")]
    omega: Annotated[float, Real("rad/s", "Angular frequency.")] = None  # type: ignore[assignment]
    phase: Annotated[float, Real("rad", "Phase.")] = 0.0
    _: KW_ONLY
    frequency: Annotated[
        float | None,
        Real("Hz", "Frequency; omega is ``2 pi frequency``. Texts and scene files repeat what was given."),
    ] = field(default=None, compare=False)

    @rule("omega", "frequency")
    def _one_frequency(self) -> None:
        if (self.omega is None) == (self.frequency is None):
            found = "neither omega nor frequency is" if self.omega is None else "both omega and frequency are"
            raise ArgumentError(f"Sine: {found} given, expected one of them: omega in rad/s, or frequency in Hz")
        if self.frequency is not None:
            object.__setattr__(self, "omega", 2.0 * np.pi * self.frequency)

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
        m0, m1, m2 = self.amplitude * np.array(wave(0.5 * self.omega * (right - left)))
        sine, cosine = np.sin(angle), np.cos(angle)
        return np.stack([m0 * sine, m1 * cosine, m2 * sine])


@declared(frozen=True)
class Ramp(PiecewiseStraight):
    """A ramp: zero until `start`, then growing with `slope` until `stop`, then constant."""

    slope: Annotated[float, Real("the unit of the load per second", "Slope.")]
    start: Annotated[float, Real("s", "Time at which the ramp begins.")] = 0.0
    stop: Annotated[
        float | None, Real("s", "Time from which the value stays constant. Without it the ramp never ends.")
    ] = None

    @rule("stop", "start")
    def _ends_after_start(self) -> None:
        if self.stop is not None and self.stop <= self.start:
            raise wrong("Ramp: stop", f"{self.stop:g}", f"a time after start = {self.start:g}")

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


@declared(frozen=True)
class Pulse(PiecewiseStraight):
    """A rectangular pulse: `amplitude` for start <= t < start + duration, zero elsewhere."""

    amplitude: Annotated[float, Real("the unit of the load", "Value during the pulse.")]
    start: Annotated[float, Real("s", "Time at which the pulse begins.")]
    duration: Annotated[float, Real("s", "Length of the pulse.", above=0.0)]

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
