"""Fourier coefficients of loads over a period."""

from __future__ import annotations

import numpy as np

from vofem.arrays import Complex
from vofem.errors import ArgumentError
from vofem.system import Load, System
from vofem.time_functions import TimeFunction
from vofem.time_functions.parts import frequency_words

#: Number of times in a period at which loads without closed form are sampled.
_SAMPLES = 8192

#: Coefficients below this fraction of the largest are rounding.
_NONE = 1e-14


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
    function = load.function
    period = 2.0 * np.pi / omega
    smooth = isinstance(function, TimeFunction) and function.closed_form
    if smooth and not function.breakpoints(period).size:
        assert isinstance(function, TimeFunction)
        piece = function.piece(0.0)
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
