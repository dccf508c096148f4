"""Measurements that a scene is fitted to. Each knows its residuals, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import array, choice, listed, name_of, number, public, series
from vofem.arrays import Array
from vofem.bodies.base import Point, as_point
from vofem.errors import ArgumentError, ConvergenceError
from vofem.parameters import Flag
from vofem.result import Result
from vofem.scene import Scene
from vofem.sensitivities import EquilibriumSensitivities, Parameter, RunSensitivities, sensitivities
from vofem.sensitivities.change import FUNCTIONS, INITIAL
from vofem.sensitivities.system_change import carried
from vofem.simulate.simulation import simulate
from vofem.statics import equilibrium
from vofem.studies.steady import PeriodicOrbit, continuation
from vofem.time_functions import Sine
from vofem.time_functions.base import Scaled, Sum
from vofem.vibration import modes

_UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}

#: What is least for the orbit that is meant, of the differences of amplitude and value.
_SHEETS: dict[str, Callable[[float], float]] = {"nearest": abs, "upper": lambda d: -d, "lower": lambda d: d}


class Trial:
    """A scene with trial values of its parameters; what data need of it is computed once, and only if they do.

    `base`, `scene`: the scene that is fitted, and the one with trial values.
    `parameters`: of `scene`.
    `until`: data after this time in s are left out.
    """

    def __init__(
        self, base: Scene, scene: Scene, parameters: tuple[Parameter, ...], until: float, times: Array
    ) -> None:
        self.base, self.scene, self.parameters, self.until = base, scene, parameters, until
        self._times = times
        self._known: dict[Any, Any] = {}

    def once(self, key: Any, compute: Callable[[], Any]) -> Any:
        """Return what a function returned when it was first called for a key."""
        if key not in self._known:
            self._known[key] = compute()
        return self._known[key]

    @cached_property
    def run(self) -> Result:
        """The run."""
        end = float(self._times[-1])
        return simulate(self.scene, end, times=self._times, method="event_driven", progress=False)

    @cached_property
    def derivatives(self) -> RunSensitivities:
        """The derivatives of the run."""
        return sensitivities(self.run, self.parameters)

    def point(self, point: Any) -> Any:
        """Return a point of the base scene in the scene with trial values."""
        return carried(self.base, self.scene, point)


class Data:
    """What a scene can be fitted to.

    Attributes
    ----------
    values : ndarray, shape (n,)
    noise : ndarray, shape (n,), optional
        Standard deviation of each value.
    offset : bool
        Whether an unknown constant is added to the values.
    times : ndarray, optional
        Times in s of data that belong to a run.
    unit, along : str
        Unit of the values, and what they are drawn over.
    places : ndarray, shape (n,)
        Where the values are drawn.
    """

    unit: ClassVar[str] = "m"
    along: str = "number [-]"
    values: Array
    noise: Array | None
    offset = False
    times: Array | None = None
    places: Array

    def _hold(self, values: Array, noise: Any, places: Array | None = None) -> None:
        """Take values and their noise, drawn over their numbers where no places are given."""
        self.values, self.noise = values, _noise(type(self).__name__, noise, values.size)
        self.places = np.arange(1.0, values.size + 1.0) if places is None else places

    def __len__(self) -> int:
        return int(self.values.size)

    def describe(self) -> str:
        """Return what was measured."""
        raise NotImplementedError

    def used(self, until: float) -> NDArray[np.bool_]:
        """Return which values lie within a window that ends at a time in s, shape (n,)."""
        return np.ones(len(self), dtype=bool)

    def model(self, trial: Trial) -> Array:
        """Return what a trial gives in place of the used values."""
        raise NotImplementedError

    def jacobian(self, trial: Trial) -> Array:
        """Return the derivatives of `model`, shape (n, p)."""
        raise NotImplementedError


@dataclass(eq=False, repr=False, kw_only=True)
class StoredData(Data):
    """Data of a fit that was read from a file: its numbers, and not the point or the contact that was measured."""

    described: str  #: What `describe` returns.
    values: Array
    noise: Array | None
    offset: bool
    times: Array | None
    unit: str  # type: ignore[misc]
    along: str
    places: Array
    within: NDArray[np.bool_]  #: Which values the fit has used, shape (n,).

    def describe(self) -> str:
        """Return what was measured."""
        return self.described

    def used(self, until: float) -> NDArray[np.bool_]:
        """Return which values the fit has used, shape (n,)."""
        return self.within

    def model(self, trial: Trial) -> Array:
        """Refuse."""
        raise ArgumentError(
            f"{self.described}: data of a fit from a file have their numbers only; to fit them, make them again, as in "
            "vofem.Measured(point, data.places, data.values)"
        )


class Measured(Data):
    """The measured motion of a point.

    Parameters
    ----------
    point : point
        ``beam.at(x)`` or a `Mass`.
    times : array_like, shape (n,)
        Times in s, increasing, from the begin of the run on.
    values : array_like, shape (n,)
        What was measured, in m, m/s or m/s^2.
    noise : float or array_like, optional
        Standard deviation of the noise, in the unit of the values. Without it all values have the same, unknown one.
    quantity : {"displacement", "velocity", "acceleration"}
    offset : bool
        Whether an unknown constant is added to the measurement, such as the zero of the instrument.

    Raises
    ------
    ArgumentError
        If times and values do not fit together, or the noise is not positive.
    """

    along = "time [s]"
    times: Array

    def __init__(
        self,
        point: Point,
        times: ArrayLike,
        values: ArrayLike,
        noise: float | ArrayLike | None = None,
        *,
        quantity: str = "displacement",
        offset: bool = False,
    ) -> None:
        self.point = as_point("Measured: point", point)
        self.times = series("Measured: times", times)
        if np.any(np.diff(self.times) <= 0.0) or self.times[0] < 0.0:
            raise ArgumentError("Measured: times must be increasing numbers, not negative")
        self._hold(array("Measured: values", values, shape=self.times.shape), noise, self.times)
        self.quantity = choice("Measured: quantity", quantity, tuple(_UNITS))
        self.offset = Flag().check("Measured: offset", offset)

    @property
    def unit(self) -> str:  # type: ignore[override]
        """Unit of the values."""
        return _UNITS[self.quantity]

    def describe(self) -> str:
        """Return quantity, point and number of values."""
        return f"Measured {self.quantity} of {self.point.describe()}: {len(self)} values to {self.times[-1]:g} s"

    def used(self, until: float) -> NDArray[np.bool_]:
        """Return which values lie within a window that ends at a time in s, shape (n,)."""
        return np.asarray(self.times <= until)

    def model(self, trial: Trial) -> Array:
        """Return what a trial gives at the times of the window."""
        times = self.times[self.used(trial.until)]
        return np.asarray(getattr(trial.run, self.quantity)(trial.point(self.point), times))

    def jacobian(self, trial: Trial) -> Array:
        """Return the derivatives of `model`, shape (n, p)."""
        times = self.times[self.used(trial.until)]
        return np.asarray(getattr(trial.derivatives, self.quantity)(trial.point(self.point), times))


class MeasuredEvents(Data):
    """Measured times at which a contact closes or opens.

    Parameters
    ----------
    contact : Contact or str
    closings, openings : array_like, optional
        Times in s of the first events, in their order. A run that has fewer of them is as far off as its end.
    noise : float, optional
        Standard deviation of the times in s.
    """

    unit = "s"

    def __init__(
        self, contact: Any, closings: ArrayLike = (), openings: ArrayLike = (), noise: float | ArrayLike | None = None
    ) -> None:
        self.contact = name_of(contact)
        self.closings, self.openings = _times("closings", closings), _times("openings", openings)
        self._hold(np.concatenate([self.closings, self.openings]), noise)
        steps = np.concatenate([np.diff(self.closings), np.diff(self.openings)])
        if not self.values.size or np.any(steps <= 0.0) or np.any(self.values < 0.0):
            raise ArgumentError("MeasuredEvents: give increasing times of closings, openings or both, none negative")
        self.times = np.sort(self.values)

    def describe(self) -> str:
        """Return contact and numbers of events."""
        return f"MeasuredEvents of {self.contact!r}: {self.closings.size} closings, {self.openings.size} openings"

    def used(self, until: float) -> NDArray[np.bool_]:
        """Return which values lie within a window, shape (n,)."""
        return np.asarray(self.values <= until)

    def model(self, trial: Trial) -> Array:
        """Return the times of the same events in a trial."""
        found = trial.run.contacts[self.contact]
        return self._first(found, float(trial.run.solution.t_end))[self.used(trial.until)]

    def jacobian(self, trial: Trial) -> Array:
        """Return the derivatives of `model`, shape (n, p); zero for events that do not happen."""
        found = trial.derivatives.contacts[self.contact]
        rows = self._first(found, 0.0)[self.used(trial.until)]
        return np.where(np.isfinite(rows), rows, 0.0)

    def _first(self, contact: Any, missing: float) -> Array:
        """Return what a contact tells of as many events as were measured, a number for those that it has not."""
        parts = []
        for known, wanted in ((contact.closings, self.closings), (contact.openings, self.openings)):
            found = np.full((wanted.size, *known.shape[1:]), missing)
            found[: known.shape[0]] = known[: wanted.size]
            parts.append(found)
        return np.concatenate(parts)


class MeasuredFrequencies(Data):
    """Measured natural frequencies, from the lowest on that is not zero.

    Parameters
    ----------
    frequencies : array_like, shape (n,)
        In Hz, increasing.
    noise : float or array_like, optional
        Standard deviation in Hz.
    closed : sequence of str or Contact
        Contacts that were closed during the test.
    """

    unit = "Hz"

    def __init__(
        self, frequencies: ArrayLike, noise: float | ArrayLike | None = None, *, closed: Sequence[Any] = ()
    ) -> None:
        self._hold(series("MeasuredFrequencies: frequencies", frequencies), noise)
        if np.any(self.values <= 0.0) or np.any(np.diff(self.values) <= 0.0):
            raise ArgumentError("MeasuredFrequencies: frequencies must be positive and increasing")
        self.closed = tuple(name_of(one) for one in listed(closed))

    def describe(self) -> str:
        """Return the number of frequencies."""
        return f"MeasuredFrequencies: {len(self)} of {self.values[0]:g} to {self.values[-1]:g} Hz"

    def _modes(self, trial: Trial) -> tuple[Any, slice]:
        rigid = trial.scene.model.system.rigid.shape[1]
        found = trial.once(self, lambda: modes(trial.scene, len(self) + rigid, closed=self.closed))
        first = int(np.sum(found.omega == 0.0))
        if found.omega.size < first + len(self):
            raise ArgumentError(f"{self.describe()}: the scene has only {found.omega.size - first} of them")
        return found, slice(first, first + len(self))

    def model(self, trial: Trial) -> Array:
        """Return the frequencies of a trial."""
        found, part = self._modes(trial)
        return np.asarray(found.frequencies[part])

    def jacobian(self, trial: Trial) -> Array:
        """Return the derivatives of `model`, shape (n, p)."""
        found, part = self._modes(trial)
        return np.asarray(sensitivities(found, trial.parameters).frequencies[part])


class MeasuredStatics(Data):
    """Measured static displacements of a point under loads that change slowly.

    Parameters
    ----------
    point : point
    times : array_like, shape (n,)
        Times in s at which the loads of the scene are taken; the scene is in equilibrium at each of them.
    values : array_like, shape (n,)
        Displacements in m.
    noise : float or array_like, optional
        Standard deviation in m.
    offset : bool
        Whether an unknown constant is added to the measurement.
    """

    along = "time [s]"

    def __init__(
        self, point: Point, times: ArrayLike, values: ArrayLike, noise: float | ArrayLike | None = None, *,
        offset: bool = False,
    ) -> None:  # fmt: skip
        self.point = as_point("MeasuredStatics: point", point)
        at = series("MeasuredStatics: times", times)
        self._hold(array("MeasuredStatics: values", values, shape=at.shape), noise, at)
        self.offset = Flag().check("MeasuredStatics: offset", offset)

    def describe(self) -> str:
        """Return point and number of values."""
        return f"MeasuredStatics of {self.point.describe()}: {len(self)} equilibria"

    def _equilibria(self, trial: Trial) -> Any:
        return trial.once(self, lambda: [equilibrium(trial.scene, float(t)) for t in self.places])

    def model(self, trial: Trial) -> Array:
        """Return the displacements of a trial."""
        point = trial.point(self.point)
        return np.array([one.displacement(point) for one in self._equilibria(trial)])

    def jacobian(self, trial: Trial) -> Array:
        """Return the derivatives of `model`, shape (n, p)."""
        point, rows = trial.point(self.point), []
        known: EquilibriumSensitivities | None = None
        for one in self._equilibria(trial):
            known = EquilibriumSensitivities(one, trial.parameters, known)
            rows.append(known.displacement(point))
        return np.stack(rows)


class MeasuredCurve(Data):
    """Measured amplitudes of steady states over the frequency of the loads.

    Each trial follows the branch of steady states from the first frequency on, through its folds, and takes the exact
    orbits at the measured frequencies.

    Parameters
    ----------
    point : point
        ``beam.at(x)`` or a `Mass`.
    frequencies : array_like, shape (n,)
        Frequencies of the loads in Hz. The loads of the scene are sines; if they have several frequencies, these keep
        their ratios, and the lowest one is meant.
    amplitudes : array_like, shape (n,)
        Half the difference of the largest and the least displacement, m.
    noise : float or array_like, optional
        Standard deviation of the amplitudes in m.
    sheet : {"nearest", "upper", "lower"}
        Which orbit is meant where the branch has several ones at a frequency: that of the nearest, of the largest or of
        the least amplitude. A sweep upward of a structure that a stop makes stiffer measures the upper sheet.
    guess : PeriodicOrbit, Result or anything that ``simulate(initial=)`` takes, optional
        The motion from which the search for the first orbit starts, as in `vofem.continuation`.
    span : (float, float), optional
        Frequencies in Hz between which the branch is followed. By default those of the data; a fold beyond them, which
        leads to another sheet, needs more.

    Raises
    ------
    ArgumentError
        If frequencies and amplitudes do not fit together, or the span does not hold the frequencies.
    """

    along = "frequency [Hz]"

    def __init__(
        self,
        point: Point,
        frequencies: ArrayLike,
        amplitudes: ArrayLike,
        noise: float | ArrayLike | None = None,
        *,
        sheet: str = "nearest",
        guess: Any = None,
        span: tuple[float, float] | None = None,
    ) -> None:
        self.point = as_point("MeasuredCurve: point", point)
        self.frequencies = series("MeasuredCurve: frequencies", frequencies)
        if np.any(self.frequencies <= 0.0) or np.ptp(self.frequencies) == 0.0:
            raise ArgumentError("MeasuredCurve: frequencies must be positive, and at least two of them different")
        values = array("MeasuredCurve: amplitudes", amplitudes, shape=self.frequencies.shape)
        self._hold(values, noise, self.frequencies)
        self.sheet = choice("MeasuredCurve: sheet", sheet, tuple(_SHEETS))
        self.guess = guess
        low, high = float(self.frequencies.min()), float(self.frequencies.max())
        if span is not None:
            given = array("MeasuredCurve: span", span, shape=(2,))
            if not 0.0 < given[0] <= low or not given[1] >= high:
                raise ArgumentError(
                    f"MeasuredCurve: span is {span!r}, expected two frequencies in Hz with the data, {low:g} to "
                    f"{high:g} Hz, between them"
                )
            low, high = float(given[0]), float(given[1])
        # The branch begins where the measurement did.
        upward = self.frequencies[0] - low <= high - self.frequencies[0]
        self.span = (low, high) if upward else (high, low)

    def describe(self) -> str:
        """Return point, number of values and frequencies."""
        low, high = sorted(self.span)
        return f"MeasuredCurve of {self.point.describe()}: {len(self)} amplitudes, {low:g} to {high:g} Hz"

    def _orbits(self, trial: Trial) -> list[PeriodicOrbit]:
        """Return the orbit that is meant at each frequency."""
        branch = continuation(
            lambda frequency: driven_at(trial.scene, frequency), *self.span, guess=self.guess, method="shooting",
            progress=False,
        )  # fmt: skip
        found = []
        for frequency, value in zip(self.frequencies.tolist(), self.values.tolist(), strict=True):
            several = branch.at(frequency)
            if not several:
                raise ConvergenceError(
                    f"{self.describe()}: the branch of steady states has no orbit at {frequency:g} Hz. "
                    f"{''.join(f'The branch: {note}. ' for note in branch.notes)}Start the fit from better numbers, or "
                    "give guess= or span="
                )
            point = trial.point(self.point)
            found.append(min(several, key=lambda orbit: _SHEETS[self.sheet](orbit.amplitude(point) - value)))
        return found

    def model(self, trial: Trial) -> Array:
        """Return the amplitudes of a trial."""
        point = trial.point(self.point)
        return np.array([orbit.amplitude(point) for orbit in trial.once(self, lambda: self._orbits(trial))])

    def jacobian(self, trial: Trial) -> Array:
        """Return the derivatives of `model` at fixed frequencies, shape (n, p)."""
        # Neither frequencies, which the data give, nor initial states change an orbit.
        own = [k for k, one in enumerate(trial.parameters) if not one.field.endswith(("omega", *INITIAL))]
        out = np.zeros((len(self), len(trial.parameters)))
        for k, orbit in enumerate(trial.once(self, lambda: self._orbits(trial)) if own else ()):
            chosen = [trial.parameters[j].carried(trial.scene, orbit.scene) for j in own]
            point = carried(trial.scene, orbit.scene, trial.point(self.point))
            out[k, own] = sensitivities(orbit, chosen).amplitude(point)
        return out


def driven_at(scene: Scene, frequency: float) -> Scene:
    """Return a scene whose slowest load has a frequency in Hz; the ratios of several frequencies stay.

    Raises `ArgumentError` if the scene has no load with a sine.
    """
    sines = [(Parameter(effect, f"{place}.omega"), omega) for effect in scene.effects for name in FUNCTIONS
             for place, omega in _sines(name, getattr(effect, name, None))]  # fmt: skip
    own = [omega for _, omega in sines if omega]
    if not own:
        raise ArgumentError(
            "fit: MeasuredCurve sets the frequency of the loads, but no load of the scene has a Sine; expected a "
            "PointLoad, DistributedLoad, PointMoment or BaseMotion with one"
        )
    factor, base = 2.0 * np.pi * frequency / min(own), scene
    for parameter, omega in sines:
        scene = parameter.carried(base, scene).at(scene, factor * omega)
    return scene


def _sines(place: str, function: Any) -> Iterator[tuple[str, float]]:
    """Return the places of the sines in a function of time, as paths from its own, and their frequencies in rad/s."""
    if isinstance(function, Sine):
        yield place, function.omega
    elif isinstance(function, Scaled):
        yield from _sines(f"{place}.function", function.function)
    elif isinstance(function, Sum):
        for k, term in enumerate(function.terms):
            yield from _sines(f"{place}.terms.{k}", term)


public(Measured, MeasuredCurve, MeasuredEvents, MeasuredFrequencies, MeasuredStatics)


def _times(name: str, given: Any) -> Array:
    """Return the times of events, of which there may be none."""
    found = array(f"MeasuredEvents: {name}", given)
    return found if found.shape == (0,) else series(f"MeasuredEvents: {name}", found)


def _noise(what: str, noise: Any, count: int) -> Array | None:
    """Return standard deviations, shape (count,), or None."""
    if noise is None:
        return None
    if not isinstance(noise, (list, tuple)) and np.ndim(noise) == 0:
        return np.full(count, number(f"{what}: noise", noise, positive=True))
    found = array(f"{what}: noise", noise, shape=(count,))
    if np.any(found <= 0.0):
        raise ArgumentError(f"{what}: noise holds {found.min():g}, expected positive numbers")
    return found
