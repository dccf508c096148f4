"""Measurements that a scene is fitted to. Each knows its residuals, and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import array, choice, name_of, number, public
from vofem.bodies.base import Point, as_point
from vofem.errors import ArgumentError
from vofem.result import Result
from vofem.scene import Scene
from vofem.sensitivities import Parameter, RunSensitivities, sensitivities
from vofem.sensitivities.system_change import carried
from vofem.statics import equilibrium
from vofem.vibration import modes

Array = NDArray[np.float64]

_UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}


class Trial:
    """A scene with trial values of its parameters; its run is computed once, and only if it is needed.

    Attributes
    ----------
    base, scene : Scene
        The scene that is fitted, and the one with trial values.
    parameters : tuple of Parameter
        Of `scene`.
    until : float
        Data after this time in s are left out.
    """

    def __init__(
        self, base: Scene, scene: Scene, parameters: tuple[Parameter, ...], until: float, times: Array, method: str
    ) -> None:
        self.base, self.scene, self.parameters, self.until = base, scene, parameters, until
        self._times, self._method = times, method
        self._run: Result | None = None
        self._derivatives: RunSensitivities | None = None

    @property
    def run(self) -> Result:
        """The run."""
        if self._run is None:
            # Late, because most measurements of statics and modes need no run.
            from vofem.simulate.simulation import simulate

            end = float(self._times[-1])
            self._run = simulate(self.scene, end, times=self._times, method=self._method, progress=False)
        return self._run

    @property
    def derivatives(self) -> RunSensitivities:
        """The derivatives of the run."""
        if self._derivatives is None:
            found = sensitivities(self.run, self.parameters)
            assert isinstance(found, RunSensitivities)
            self._derivatives = found
        return self._derivatives

    def point(self, point: Any) -> Any:
        """Return a point of the base scene in the scene with trial values."""
        return carried(self.base, self.scene, point)


class Measured:
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

    in_time = True

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
        self.times = array("Measured: times", times)
        if self.times.ndim != 1 or not self.times.size or np.any(np.diff(self.times) <= 0.0) or self.times[0] < 0.0:
            raise ArgumentError("Measured: times must be one row of increasing numbers, not negative")
        self.values = array("Measured: values", values, shape=self.times.shape)
        self.noise = noise_of("Measured", noise, self.times.size)
        self.quantity = choice("Measured: quantity", quantity, tuple(_UNITS))
        self.offset = bool(offset)

    def __len__(self) -> int:
        return int(self.times.size)

    @property
    def unit(self) -> str:
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


class MeasuredEvents:
    """Measured times at which a contact closes or opens.

    Parameters
    ----------
    contact : Contact or str
    closings, openings : array_like, optional
        Times in s of the first events, in their order. A run that has fewer of them is as far off as its end.
    noise : float, optional
        Standard deviation of the times in s.
    """

    in_time = True
    offset = False
    unit = "s"

    def __init__(
        self,
        contact: Any,
        closings: ArrayLike = (),
        openings: ArrayLike = (),
        noise: float | ArrayLike | None = None,
    ) -> None:
        self.contact = name_of(contact)
        self.closings = np.atleast_1d(array("MeasuredEvents: closings", closings))
        self.openings = np.atleast_1d(array("MeasuredEvents: openings", openings))
        self.values = np.concatenate([self.closings, self.openings])
        if not self.values.size or np.any(np.diff(self.closings) <= 0.0) or np.any(np.diff(self.openings) <= 0.0):
            raise ArgumentError("MeasuredEvents: give increasing times of closings, openings or both")
        self.times = np.sort(self.values)
        self.noise = noise_of("MeasuredEvents", noise, self.values.size)

    def __len__(self) -> int:
        return int(self.values.size)

    def describe(self) -> str:
        """Return contact and numbers of events."""
        return f"MeasuredEvents of {self.contact!r}: {self.closings.size} closings, {self.openings.size} openings"

    def used(self, until: float) -> NDArray[np.bool_]:
        """Return which values lie within a window, shape (n,)."""
        return np.asarray(self.values <= until)

    def model(self, trial: Trial) -> Array:
        """Return the times of the same events in a trial."""
        found = trial.run.contacts[self.contact]
        end = float(trial.run.solution.t_end)
        parts = [_first(known, wanted.size, end)
                 for known, wanted in ((found.closings, self.closings), (found.openings, self.openings))]  # fmt: skip
        return np.concatenate(parts)[self.used(trial.until)]

    def jacobian(self, trial: Trial) -> Array:
        """Return the derivatives of `model`, shape (n, p); zero for events that do not happen."""
        found = trial.derivatives.contacts[self.contact]
        pairs = ((found.closings, self.closings), (found.openings, self.openings))
        rows = np.concatenate([_first(known, wanted.size, 0.0) for known, wanted in pairs])[self.used(trial.until)]
        return np.where(np.isfinite(rows), rows, 0.0)


class MeasuredFrequencies:
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

    in_time = False
    offset = False
    unit = "Hz"

    def __init__(
        self, frequencies: ArrayLike, noise: float | ArrayLike | None = None, *, closed: Sequence[Any] = ()
    ) -> None:
        self.values = np.atleast_1d(array("MeasuredFrequencies: frequencies", frequencies))
        if np.any(self.values <= 0.0) or np.any(np.diff(self.values) <= 0.0):
            raise ArgumentError("MeasuredFrequencies: frequencies must be positive and increasing")
        self.noise = noise_of("MeasuredFrequencies", noise, self.values.size)
        self.closed = tuple(name_of(one) for one in ((closed,) if isinstance(closed, str) else closed))

    def __len__(self) -> int:
        return int(self.values.size)

    def describe(self) -> str:
        """Return the number of frequencies."""
        return f"MeasuredFrequencies: {len(self)} of {self.values[0]:g} to {self.values[-1]:g} Hz"

    def used(self, until: float) -> NDArray[np.bool_]:
        """Return all values: they do not belong to times."""
        return np.ones(len(self), dtype=bool)

    def _modes(self, trial: Trial) -> tuple[Any, slice]:
        rigid = trial.scene.model.system.rigid.shape[1]
        found = modes(trial.scene, len(self) + rigid, closed=self.closed)
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


class MeasuredStatics:
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

    in_time = False
    unit = "m"

    def __init__(
        self, point: Point, times: ArrayLike, values: ArrayLike, noise: float | ArrayLike | None = None, *,
        offset: bool = False,
    ) -> None:  # fmt: skip
        self.point = as_point("MeasuredStatics: point", point)
        self.times = np.atleast_1d(array("MeasuredStatics: times", times))
        self.values = array("MeasuredStatics: values", values, shape=self.times.shape)
        self.noise = noise_of("MeasuredStatics", noise, self.values.size)
        self.offset = bool(offset)

    def __len__(self) -> int:
        return int(self.values.size)

    def describe(self) -> str:
        """Return point and number of values."""
        return f"MeasuredStatics of {self.point.describe()}: {len(self)} equilibria"

    def used(self, until: float) -> NDArray[np.bool_]:
        """Return all values: they do not belong to a run."""
        return np.ones(len(self), dtype=bool)

    def model(self, trial: Trial) -> Array:
        """Return the displacements of a trial."""
        point = trial.point(self.point)
        return np.array([equilibrium(trial.scene, float(t)).displacement(point) for t in self.times])

    def jacobian(self, trial: Trial) -> Array:
        """Return the derivatives of `model`, shape (n, p)."""
        point = trial.point(self.point)
        found = [sensitivities(equilibrium(trial.scene, float(t)), trial.parameters) for t in self.times]
        return np.stack([one.displacement(point) for one in found])


public(Measured, MeasuredEvents, MeasuredFrequencies, MeasuredStatics)

#: What a scene can be fitted to.
Data = Measured | MeasuredEvents | MeasuredFrequencies | MeasuredStatics


def noise_of(what: str, noise: Any, count: int) -> Array | None:
    """Return standard deviations, shape (count,), or None."""
    if noise is None:
        return None
    if np.ndim(noise) == 0:
        return np.full(count, number(f"{what}: noise", noise, positive=True))
    found = array(f"{what}: noise", noise, shape=(count,))
    if np.any(found <= 0.0):
        raise ArgumentError(f"{what}: noise holds {found.min():g}, expected positive numbers")
    return found


def _first(known: Array, count: int, missing: float) -> Array:
    """Return the first rows of an array, with a number in place of those that it does not have."""
    found = np.full((count, *known.shape[1:]), missing)
    found[: known.shape[0]] = known[:count]
    return found
