"""Maps of steady states over two parameters: stability, leading multiplier, amplitude."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import series
from vofem.arrays import Array
from vofem.errors import ArgumentError
from vofem.scene import Scene
from vofem.studies.diagrams.bifurcation import first_point
from vofem.studies.steady.steady_state import periodic
from vofem.studies.sweep import FailedPoint, Sweep
from vofem.studies.sweep.sweeping import SweepOptions, sweep


@dataclass(frozen=True, eq=False)
class StabilityMap:
    """Steady states over two parameters.

    Attributes
    ----------
    x, y : ndarray, shapes (n_x,) and (n_y,)
        Values of the parameters.
    stable : ndarray, shape (n_x, n_y)
        1 where the orbit is stable, 0 where it is unstable, NaN where this is unknown or no orbit was found.
    multiplier : ndarray of complex, shape (n_x, n_y)
        The multiplier of largest magnitude.
    amplitude : ndarray, shape (n_x, n_y)
        Half of the difference between the largest and the least displacement, m.
    sweep : Sweep
        The runs.
    """

    x: Array
    y: Array
    stable: Array
    multiplier: NDArray[np.complex128]
    amplitude: Array
    sweep: Sweep

    @property
    def failed(self) -> tuple[FailedPoint, ...]:
        """Points at which no orbit was found."""
        return self.sweep.failed

    def __repr__(self) -> str:
        share = np.nanmean(self.stable) if np.any(np.isfinite(self.stable)) else np.nan
        shape = f"{self.x.size} x {self.y.size} points"
        return f"<StabilityMap: {shape}; {100 * share:.3g} % stable; {len(self.failed)} failed>"


def stability_map(
    build: Callable[[float, float], Scene],
    x: ArrayLike,
    y: ArrayLike,
    *,
    periods: int = 1,
    point: Any = None,
    method: str = "auto",
    **options: Unpack[SweepOptions],
) -> StabilityMap:
    """Return the steady states to which motions from rest lead, over two parameters.

    Parameters
    ----------
    build : callable
        ``build(x, y) -> Scene``. To run in other processes it must be defined at the top level of a module.
    x, y : array_like, shapes (n_x,) and (n_y,)
        Values of the parameters.
    periods : int
        Number of periods of the loads that an orbit takes.
    point : point or name of a mass, optional
        Point whose amplitude is computed; its body is found by name. The default is that of the first contact.
    method : str
        See `vofem.periodic`.
    **options
        Options of `vofem.sweep`, such as ``executor``, ``store`` and ``progress``.

    Returns
    -------
    StabilityMap

    Raises
    ------
    ArgumentError
        For arguments out of range, or if no orbit is found at any point.
    """
    values = {name: series(f"stability_map: {name}", given) for name, given in (("x", x), ("y", y))}
    table = sweep(
        functools.partial(_state, build=build, periods=periods, point=point, method=method),
        {name: given.tolist() for name, given in values.items()},
        **options,
    )
    if not len(table):
        raise ArgumentError(f"stability_map: no orbit was found at any point, at the first: {table.failed[0].error}")
    return StabilityMap(values["x"], values["y"], table["stable"], table["multiplier"], table["amplitude"], table)


def _state(
    x: float, y: float, build: Callable[[float, float], Scene], periods: int, point: Any, method: str
) -> dict[str, Any]:
    scene = build(x, y)
    orbit = periodic(scene, periods=periods, method=method)
    leading = complex(np.nan, np.nan) if orbit.multipliers is None else complex(orbit.multipliers[0])
    stable = np.nan if orbit.stable is None else float(orbit.stable)
    return {
        "stable": stable,
        "multiplier": leading,
        "amplitude": orbit.amplitude(first_point(scene, "point") if point is None else point),
    }
