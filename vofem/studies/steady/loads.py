"""The common period of all loads of a system, and their Fourier coefficients over it."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import gcd, lcm

import numpy as np

from vofem._validate import number
from vofem.arrays import Complex
from vofem.errors import ArgumentError
from vofem.system import Load, System, refuse_travelling
from vofem.time_functions import Sine, TimeFunction
from vofem.time_functions.parts import frequency_words, parts_of
from vofem.time_functions.piece import Piece

#: Largest whole number in a ratio of two frequencies of loads, and the accepted relative error of the ratio.
_LARGEST, _EXACT = 1000, 1e-12

#: Number of times in a period at which loads are compared with their values a period later, and the accepted
#: difference.
_LOOKS, _SAME = 97, 1e-9

#: Number of times in a period at which loads without closed form are sampled.
_SAMPLES = 8192

#: Coefficients below this fraction of the largest are rounding.
_NONE = 1e-14


@dataclass(frozen=True)
class LoadPeriod:
    """The common period of all loads."""

    omega: float  #: Angular frequency in rad/s.

    @property
    def period(self) -> float:
        """Period in s."""
        return 2.0 * np.pi / self.omega


def load_period(what: str, system: System, period: float | None = None) -> LoadPeriod:
    """Return the common period of all loads, or the given one, checked.

    `what`: name of the function whose argument it is, for messages.
    `period`: period in s.
    Raises `ArgumentError` if a load is not periodic or loads have no common period; the message names it. If no load
    varies and no period is given.
    """
    refuse_travelling(what, system)
    # Where no load varies, because all amplitudes are 0 here, they have a period all the same.
    for still in (False, True):
        frequencies = [(load, w) for load in system.loads for w in _frequencies(what, load, period, still)]
        if frequencies:
            break
    if period is not None:
        omega = 2.0 * np.pi / number(f"{what}: period", period, positive=True)
        # To the last bit where the given period is that of a load.
        close = [w for _, w in frequencies if abs(w - omega) <= 4.0 * np.finfo(float).eps * omega]
        omega = close[0] if close else omega
    elif frequencies:
        omega = _fundamental(what, frequencies)
    elif resting := _at_rest(system):
        raise ArgumentError(
            f"{what}: {resting} has the frequency 0 here and is constant, so nothing sets the period; "
            f"{_or_period(what)}begin at a small positive frequency"
        )
    elif bent := with_corners(system):
        raise ArgumentError(
            f"{what}: {bent} has no harmonics that set its period; {_or_period(what)}write it with Sine and sums of it"
        )
    else:
        raise ArgumentError(
            f"{what}: no load varies in time, so nothing sets the period. Add a load such as "
            f"PointLoad(point, Sine(...)), {_or_period(what)}follow free oscillations with vofem.backbone"
        )
    found = LoadPeriod(float(omega))
    for load in system.loads:
        # Harmonics whose fundamental frequency this is repeat after its period.
        if period is not None or _harmonic(load, found.period) is None:
            _check(what, load, found.period)
    return found


def _harmonic(load: Load, period: float) -> Piece | None:
    """Return the closed form of a load that is a sum of harmonics and a constant, or None."""
    function = load.function
    if not isinstance(function, TimeFunction) or not function.closed_form or function.breakpoints(4.0 * period).size:
        return None
    piece = function.piece(0.0)
    return piece if piece.slope == piece.curvature == piece.jerk == 0.0 else None


def _frequencies(what: str, load: Load, period: float | None, still: bool = False) -> list[float]:
    """Return the angular frequencies of a load's harmonics, also of those of amplitude 0 if `still`.

    There are none where the load has no closed form.
    """
    function = load.function
    if isinstance(function, TimeFunction) and function.closed_form:
        return [w for w, amplitude in function.piece(0.0).harmonics if w > 0.0 and (still or amplitude != 0.0)]
    if period is None:
        raise ArgumentError(
            f"{what}: {load.name} is a function whose period is not known; {_or_period(what)}write the load with Sine "
            "and sums of it"
        )
    return []


def _or_period(what: str) -> str:
    """Return the advice to give the period where a function takes it, as the begin of a choice."""
    return "give period= in s, or " if what in ("periodic", "stroboscope") else ""


def _at_rest(system: System) -> str:
    """Return the name of a load with a `Sine` of frequency 0; empty where there is none."""
    zero = (
        load.name
        for load in system.loads
        for part in parts_of(load.function)
        if isinstance(part, Sine) and part.omega == 0.0
    )
    return next(zero, "")


def with_corners(system: System) -> str:
    """Return the name of a load that has corners or jumps; empty where there is none."""
    functions = ((load.name, load.function) for load in system.loads)
    return next((name for name, f in functions if isinstance(f, TimeFunction) and f.corners(0.0, np.inf).size), "")


def _fundamental(what: str, frequencies: list[tuple[Load, float]]) -> float:
    first, base = frequencies[0]
    if all(w == base for _, w in frequencies):
        return base
    ratios = []
    for load, w in frequencies:
        ratio = Fraction(w / base).limit_denominator(_LARGEST)
        if ratio == 0 or ratio.numerator > _LARGEST or abs(float(ratio) - w / base) > _EXACT * w / base:
            other = "another of its terms" if load is first else first.name
            raise ArgumentError(
                f"{what}: {load.name} has {frequency_words(w, [load.function], 17)} and {other} has "
                f"{frequency_words(base, [first.function], 17)}, which have no common period; choose frequencies in "
                "the ratio of small whole numbers"
            )
        ratios.append(ratio)
    divisor = Fraction(gcd(*(r.numerator for r in ratios)), lcm(*(r.denominator for r in ratios)))
    for (_, w), ratio in zip(frequencies, ratios, strict=True):
        if ratio == divisor:
            return w
    return base * float(divisor)


def _values(load: Load, period: float, later: float) -> np.ndarray:
    times = (np.arange(_LOOKS) + 0.381966) / _LOOKS * period
    return np.asarray(load.function(times + later), dtype=float)


def _check(what: str, load: Load, period: float) -> None:
    """Raise where a load differs from itself a period later."""
    now, waves = _values(load, period, 0.0), _frequencies(what, load, period)
    own = "if this one repeats later, give its period as period="
    if len(waves) == 1:
        own = f"this one repeats after {2.0 * np.pi / waves[0]:.9g} s, so give that or a multiple of it as period="
    size = float(np.abs(now).max())
    for count in (1, 2, 3):
        later = _values(load, period, count * period)
        if np.abs(later - now).max() > _SAME * max(size, float(np.abs(later).max())):
            raise ArgumentError(
                f"{what}: {load.name} is not periodic with {period:.9g} s: it differs from itself {count} "
                f"period{'s' * (count > 1)} later by {np.abs(later - now).max():.3g}. Loads of steady states are sums "
                f"of Sine and Constant; {own}"
            )


def load_series(what: str, system: System, omega: float, harmonics: int) -> Complex:
    """Return the Fourier coefficients of all loads, shape (n_loads, harmonics + 1).

    `what`: name of the argument in messages.
    `system`: a system whose loads are periodic with ``2 pi/omega``.
    `omega`: angular frequency of the first harmonic, rad/s.
    Returns ``f(t) = Re sum_k c_k exp(i k omega t)``.
    Raises `ArgumentError` if a closed-form load has a harmonic beyond these.
    """
    return np.array([_series(what, load, omega, harmonics) for load in system.loads]).reshape(-1, harmonics + 1)


def _series(what: str, load: Load, omega: float, harmonics: int) -> Complex:
    found = np.zeros(harmonics + 1, dtype=complex)
    function, period = load.function, 2.0 * np.pi / omega
    piece = _harmonic(load, period)
    if piece is not None:
        found[0] = piece.constant
        for w, amplitude in piece.harmonics:
            k = round(w / omega)
            if k > harmonics:
                raise ArgumentError(
                    f"{what}: {load.name} acts at {frequency_words(w, [function], 9)}, which is harmonic {k} of the "
                    f"orbit; give harmonics={2 * k} or more"
                )
            found[k] += amplitude if k else amplitude.real
        return found
    values = np.asarray(function(np.arange(_SAMPLES) * (period / _SAMPLES)), dtype=float)
    spectrum = 2.0 * np.fft.rfft(values)[: harmonics + 1] / _SAMPLES
    spectrum[0] *= 0.5
    found[: spectrum.size] = np.where(np.abs(spectrum) > _NONE * np.abs(spectrum).max(initial=0.0), spectrum, 0.0)
    return found
