"""Stroboscopic (bifurcation) diagrams: the motion once a period, over a parameter."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import choice, flag, listed, name_of, series, unknown, whole
from vofem.arrays import Array
from vofem.bodies.base import as_point
from vofem.errors import ArgumentError
from vofem.initial import StoredState
from vofem.scene import Scene, as_scene
from vofem.simulate.simulation import simulate
from vofem.studies.steady.loads import load_period
from vofem.studies.steady.stroboscope import poincare
from vofem.studies.sweep.sweeping import SweepOptions, sweep


@dataclass(frozen=True)
class Stroboscope:
    """The times and points at which a run is sampled."""

    #: Points, whose bodies are found by name in every scene; empty for the point of the first contact.
    points: tuple[Any, ...]
    period: float | None  #: Time between two samples in s. The default is the common period of the loads.
    periods: int  #: Number of samples.
    skip: int  #: Periods before the first sample.
    method: str  #: See `vofem.simulate`.

    def samples(self, scene: Scene, initial: Any = None) -> tuple[Array, float, StoredState]:
        """Return the samples of displacements and velocities, the time between two, and the state at the last one.

        Returns `samples` (shape (2, n_points, periods)): displacements, m, and velocities, m/s.
        """
        period = load_period("stroboscope", scene.model.system, self.period).period
        times = period * np.arange(self.skip + 1, self.skip + self.periods + 1)
        result = simulate(scene, float(times[-1]), times=times, initial=initial, method=self.method, progress=False)
        section = poincare(result, period, skip=self.skip + 1)
        samples = [(section.displacement(point), section.velocity(point)) for point in self._of(scene)]
        return np.array(samples).transpose(1, 0, 2), period, result.as_start()

    def names(self, scene: Scene) -> tuple[str, ...]:
        """Return the names of the points that are sampled."""
        return tuple(point.name for point in self._of(scene))

    def _of(self, scene: Scene) -> tuple[Any, ...]:
        given = tuple(as_point("points", point, scene.bodies) for point in self.points)
        return given or (first_point(scene, "points"),)


def stroboscope(what: str, points: Any, period: float | None, periods: int, skip: int, method: str) -> Stroboscope:
    """Return the stroboscope that the arguments of a diagram describe, and check them."""
    chosen = () if points is None else tuple(listed(points))
    skipped = whole(f"{what}: skip", skip, least=0)
    return Stroboscope(chosen, period, whole(f"{what}: periods", periods), skipped, method)


def first_point(scene: Scene, argument: str) -> Any:
    """Return the point of the first contact of a scene.

    `argument`: how a user names another one.
    Raises `ArgumentError` if there is none.
    """
    if not scene.contacts:
        raise ArgumentError(f"the scene has no contact whose point could be looked at; give {argument}=")
    return scene.contacts[0].points()[0]


def sizes_of(samples: Array, period: Array) -> Array:
    """Return sizes of displacements in m and velocities in m/s for samples, shape (2, n_points, ..., periods).

    `period` (shape (k,)): times between two samples in s.
    The result has the shape (2, n_points, k). One of both may be zero whenever a sample is taken, so each is at least
    as large as in a harmonic motion with the other one.
    """
    largest = np.nanmax(np.abs(samples).reshape(*samples.shape[:2], -1), axis=2, keepdims=True)
    rate = 2.0 * np.pi / period
    return np.maximum(largest, np.stack([largest[1] / rate, largest[0] * rate]))


def order_of(samples: Array, tolerance: Array) -> int:
    """Return the number of samples after which they repeat, or 0 if they do not.

    `samples` has shape (..., periods).
    `tolerance` (shape (..., 1)): by which samples may differ, in their unit.
    """
    periods = samples.shape[-1]
    if not np.all(np.isfinite(samples)):
        return 0
    for k in range(1, periods // 2 + 1):
        if np.all(np.abs(samples[..., k:] - samples[..., :-k]) <= tolerance):
            return k
    return 0


@dataclass(frozen=True, eq=False)
class BifurcationDiagram:
    """Stroboscopic samples over a parameter.

    Attributes
    ----------
    values : ndarray, shape (n_values,)
        Values of the parameter.
    points : tuple of str
        Names of the points that were sampled.
    samples : dict of str to ndarray, shape (2, n_points, n_values, periods)
        Displacements in m and velocities in m/s, by the start of the runs. The runs of "rest" start from the initial
        state of their scene. Those of "up" and "down" start from the end of the run before, along rising and falling
        values. NaN where a run failed.
    failed : tuple of str
        A message for each run that failed.
    period : ndarray, shape (n_values,)
        Time between two samples in s; NaN where the run from rest failed.
    """

    values: Array
    points: tuple[str, ...]
    samples: dict[str, Array]
    failed: tuple[str, ...]
    period: Array

    def __repr__(self) -> str:
        periods = self.samples["rest"].shape[-1]
        runs = f"{self.values.size} values x {periods} periods; starts {', '.join(self.samples)}"
        return f"<BifurcationDiagram: {runs}; points {', '.join(self.points)}; {len(self.failed)} failed>"

    def _of(self, kind: int, point: Any, start: str) -> Array:
        choice("BifurcationDiagram: start", start, tuple(self.samples))
        name = self.points[0] if point is None else name_of(point)
        if name not in self.points:
            raise unknown("point", name, self.points)
        found: Array = self.samples[start][kind, self.points.index(name)]
        return found

    def displacement(self, point: Any = None, start: str = "rest") -> Array:
        """Return the displacements of a point in m, by default of the first one, shape (n_values, periods)."""
        return self._of(0, point, start)

    def velocity(self, point: Any = None, start: str = "rest") -> Array:
        """Return the velocities of a point in m/s, by default of the first one, shape (n_values, periods)."""
        return self._of(1, point, start)

    def order(self, start: str = "rest", tolerance: float = 1e-6) -> NDArray[np.int64]:
        """Return the number of periods after which each motion repeats, shape (n_values,); 0 if it does not.

        Parameters
        ----------
        start : {"rest", "up", "down"}
        tolerance : float
            Difference up to which samples count as equal, relative to the largest sample of the point; velocities are
            compared with displacements too, as in a harmonic motion.

        Raises
        ------
        ArgumentError
            For a diagram of one sample at each value: a motion repeats only if two of them are equal.
        """
        choice("BifurcationDiagram: start", start, tuple(self.samples))
        whole("BifurcationDiagram.order: periods of the diagram", self.samples[start].shape[-1], least=2)
        samples, known = self.samples[start], np.where(np.isfinite(self.period), self.period, np.nanmax(self.period))
        allowed = tolerance * sizes_of(samples, known)[..., None]
        orders = [order_of(samples[:, :, k], allowed[:, :, k]) for k in range(self.values.size)]
        return np.array(orders, dtype=np.int64)


def bifurcation_diagram(
    build: Callable[[float], Scene],
    values: ArrayLike,
    *,
    periods: int = 100,
    skip: int = 200,
    follow: bool = True,
    points: Any = None,
    period: float | None = None,
    method: str = "auto",
    **options: Unpack[SweepOptions],
) -> BifurcationDiagram:
    """Return a stroboscopic diagram: displacement and velocity once a period of the loads, over a parameter.

    Parameters
    ----------
    build : callable
        ``build(value) -> Scene``. To run in other processes it must be defined at the top level of a module.
    values : array_like, shape (n_values,)
        Values of the parameter.
    periods : int
        Number of samples at each value.
    skip : int
        Periods of the loads before the first sample: the transient.
    follow : bool
        Whether the values are also run in rising and in falling order, each run starting where the one before it ended.
        Where several motions coexist, the three diagrams differ.
    points : point or name of a mass, or sequence of them, optional
        Points that are sampled; their bodies are found by name. The default is the point of the first contact.
    period : float, optional
        Time between two samples in s. The default is the common period of the loads.
    method : str
        See `vofem.simulate`.
    **options
        Options of `vofem.sweep`, such as ``executor``, ``store`` and ``progress``. A ``time_limit`` is that of one
        value; rising and falling values have it once for each of them, and fail together.

    Returns
    -------
    BifurcationDiagram

    Raises
    ------
    ArgumentError
        For arguments out of range. Loads without a common period make every run fail; `failed` says so.
    """
    given = series("bifurcation_diagram: values", values)
    follow = flag("bifurcation_diagram: follow", follow)
    how = stroboscope("bifurcation_diagram", points, period, periods, skip, method)
    rest = sweep(
        functools.partial(_from_rest, build=build, how=how), {"value": given.tolist()}, **_beside(options, "rest")
    )
    if not len(rest):
        raise ArgumentError(f"bifurcation_diagram: every run failed, the first with: {rest.failed[0].error}")
    failed = [str(one) for one in rest.failed]
    samples = {"rest": np.moveaxis(rest["looks"], 0, 2)}
    if follow:
        orders = {"up": np.argsort(given, kind="stable"), "down": np.argsort(-given, kind="stable")}
        rows = [{"values": given[order].tolist()} for order in orders.values()]
        series_options = _beside(options, "follow")
        if (limit := options.get("time_limit")) is not None:
            series_options["time_limit"] = given.size * limit
        chains = sweep(functools.partial(_chain, build=build, how=how), rows, **series_options)
        lost = {one.index: one.error for one in chains.failed}
        for k, (name, order) in enumerate(orders.items()):
            samples[name] = np.full_like(samples["rest"], np.nan)
            if k not in lost:
                samples[name][:, :, order] = chains["looks"][k]
            errors = [lost[k]] if k in lost else chains["errors"][k]
            failed += [f"{name}: {message}" for message in errors if message]
    names = next(names for names in rest["names"] if all(names))
    return BifurcationDiagram(given, tuple(map(str, names)), samples, tuple(failed), rest["period"])


def _beside(options: SweepOptions, part: str) -> SweepOptions:
    """Return the options of one part of a diagram, which has a store of its own."""
    store = options.get("store")
    if store is None:
        return {**options}
    path = Path(store)
    return {**options, "store": path.with_name(f"{path.stem}-{part}{path.suffix}")}


def _from_rest(value: float, build: Callable[[float], Scene], how: Stroboscope) -> dict[str, Any]:
    scene = as_scene("bifurcation_diagram", build(value))
    samples, period, _ = how.samples(scene)
    return {"looks": samples, "names": how.names(scene), "period": period}


def _chain(values: Sequence[float], build: Callable[[float], Scene], how: Stroboscope) -> dict[str, Any]:
    """Run scenes one after the other, each from the end of the one before."""
    end = None
    found: list[Array] = []
    errors: list[str] = []
    for value in values:
        error = ""
        try:
            samples, _, end = how.samples(as_scene("bifurcation_diagram", build(value)), end)
        except Exception as fault:  # As in a sweep, whatever `build` raises.
            samples = np.full((2, len(how.points) or 1, how.periods), np.nan)
            error = f"value {value!r}: {type(fault).__name__}: {fault}"
        found.append(samples)
        errors.append(error)
    return {"looks": np.stack(found, axis=2), "errors": errors}
