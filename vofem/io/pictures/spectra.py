"""Spectra of the motion of a point: amplitudes, power spectral density, spectrogram."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem._validate import choice, number
from vofem.arrays import Array
from vofem.bodies.base import as_point
from vofem.errors import ArgumentError
from vofem.histories.impacts import window_of
from vofem.io.pictures.axes import Canvas, Where, figure, ink, plain, single, stroke, text_size
from vofem.io.pictures.histories import end_of
from vofem.result import Result

_KINDS = ("amplitude", "psd", "spectrogram")
_UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}

#: Samples of a run that is known at any time.
_SAMPLES = 2**15

#: Segments of a window over which a power spectral density is averaged, and into which a spectrogram is divided.
_AVERAGED, _DIVIDED = 8, 24

#: Fewest samples that have a spectrum.
_FEWEST = 16


@figure
def spectrum(
    result: Result,
    point: Any,
    path: Where = None,
    *,
    kind: str = "amplitude",
    quantity: str = "displacement",
    window: tuple[float, float] | None = None,
    limit: float | None = None,
    ax: Any = None,
) -> Any:
    """Draw the spectrum of the motion of a point, without its mean.

    Parameters
    ----------
    result : Result
    point : point of a body, or name of a mass
        ``beam.at(x)`` or a Mass.
    kind : str
        "amplitude": amplitudes over frequency, with a Hann window; the peak of a harmonic motion is its amplitude.
        "psd": power spectral density by Welch's method, one-sided; its integral is the variance. "spectrogram": the
        power spectral density over time and frequency.
    quantity : str
        "displacement", "velocity" or "acceleration".
    window : (float, float), optional
        Begin and end of the time that is drawn, in s. The default is the whole run. Leave the transient out for the
        spectrum of a steady motion.
    limit : float, optional
        Highest frequency that is drawn, Hz. The default is the highest one whose amplitude is above 1e-8 of the
        largest, and whose power is above 1e-14 of it (1e-8 in a spectrogram).

    Raises
    ------
    ArgumentError
        If the point, the kind or the quantity is not valid, or the run has stored too few times.

    Notes
    -----
    P. D. Welch, The use of fast Fourier transform for the estimation of power spectra, IEEE Trans. Audio
    Electroacoust. 15(2), 70-73 (1967), https://doi.org/10.1109/TAU.1967.1161901.
    """
    place = as_point("spectrum: point", point, result.scene.bodies)
    kind = choice("spectrum: kind", kind, _KINDS)
    quantity = choice("spectrum: quantity", quantity, tuple(_UNITS))
    if limit is not None:
        limit = number("spectrum: limit", limit, positive=True)
    times, step = uniform_times(result, window)
    values = np.asarray(getattr(result, quantity)(place, times))
    (canvas, axes), unit = single("spectrum", path, ax, (8.0, 4.8)), _UNITS[quantity]
    if kind == "spectrogram":
        _spectrogram(canvas, times, step, values, unit if unit == "m" else f"({unit})", limit)
    else:
        frequency, height = (amplitudes if kind == "amplitude" else density)(values, step)
        floor = (1e-8 if kind == "amplitude" else 1e-14) * float(height.max())
        limit = _end(frequency, height > floor, limit)
        shown = (frequency > 0.0) & (frequency <= limit)
        axes.plot(frequency[shown], height[shown], color=ink(), linewidth=stroke(1.2))
        top, least = float(height[shown].max(initial=0.0)), float(height[shown].min(initial=np.inf))
        if top > 0.0:
            axes.set_yscale("log")
            axes.set_ylim(max(floor, least / 3.0), 3.0 * top)
        density_unit = f"{unit}^2/Hz" if unit == "m" else f"({unit})^2/Hz"
        label = f"amplitude of the {quantity} [{unit}]" if kind == "amplitude" else f"PSD [{density_unit}]"
        axes.set(xlabel="frequency [Hz]", ylabel=label, xlim=(0.0, limit))
    axes.set_title(plain(f"{place.describe()}, {times[0]:g} to {times[-1] + step:g} s"), fontsize=text_size(11))
    return canvas


def uniform_times(result: Result, window: tuple[float, float] | None) -> tuple[Array, float]:
    """Return equally spaced times of a run within a window, its end left out, and their distance, s."""
    begin, end = window_of("spectrum", window, end_of(result))
    stored = result.times[(result.times >= begin) & (result.times <= end)]
    if result.solution.continuous:
        count = max(_SAMPLES, stored.size)
    else:
        count = stored.size - 1
        if count < _FEWEST:
            raise ArgumentError(
                f"spectrum: the run stored {stored.size} times between {begin:g} and {end:g} s, expected at least "
                f"{_FEWEST + 1}; choose a longer window, or name more times in times= when simulating"
            )
        begin, end = float(stored[0]), float(stored[-1])
        spacing = np.diff(stored)
        if np.ptp(spacing) <= 1e-6 * spacing.mean():
            return stored[:-1], float(spacing.mean())
    step = (end - begin) / count
    return np.asarray(begin + step * np.arange(count), dtype=float), step


def amplitudes(values: Array, step: float) -> tuple[Array, Array]:
    """Return frequencies in Hz and amplitudes of samples that are `step` seconds apart, with a Hann window."""
    n = values.size
    taper = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(n) / n)
    taper /= taper.sum()
    spectrum = 2.0 * np.abs(np.fft.rfft(taper * (values - taper @ values)))
    return np.asarray(np.fft.rfftfreq(n, step), dtype=float), spectrum


def density(values: Array, step: float) -> tuple[Array, Array]:
    """Return frequencies in Hz and the one-sided power spectral density of samples that are `step` seconds apart."""
    from scipy.signal import welch

    size = max(_FEWEST, 2 * values.size // _AVERAGED)
    return welch(values - values.mean(), 1.0 / step, nperseg=size, detrend=False)


def _end(frequency: Array, visible: NDArray[np.bool_], limit: float | None) -> float:
    """Return the highest frequency that is drawn, Hz: the limit that a user gives, or that of what is visible."""
    last = np.flatnonzero(visible)
    end = frequency[last[-1]] if limit is None and last.size else frequency[-1]
    return float(min(limit or np.inf, end))


def _spectrogram(canvas: Canvas, times: Array, step: float, values: Array, unit: str, limit: float | None) -> None:
    from matplotlib.colors import LogNorm
    from scipy.signal import spectrogram

    frequency, middle, power = spectrogram(
        values - values.mean(), 1.0 / step, nperseg=max(_FEWEST, values.size // _DIVIDED), window="hann"
    )
    axes, top = canvas.grid[0, 0], float(power.max(initial=0.0)) or 1.0
    shown = frequency <= _end(frequency, power.max(axis=1) > 1e-8 * top, limit)
    image = axes.pcolormesh(
        times[0] + middle, frequency[shown], np.maximum(power[shown], 1e-12 * top), norm=LogNorm(1e-8 * top, top),
        cmap="viridis", shading="nearest", rasterized=True,
    )  # fmt: skip
    axes.grid(False)
    axes.set(xlabel="time [s]", ylabel="frequency [Hz]")
    canvas.figure.colorbar(image, ax=axes, label=f"PSD [{unit}^2/Hz]")
