"""Pictures of sweeps: curves over one parameter, maps over two."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from vofem.errors import ArgumentError
from vofem.io.pictures.axes import COLORS, goal_of, panels, plain, save
from vofem.studies.sweep import Sweep

#: Width and height of one panel, inches.
_PANEL = (6.4, 3.6)


def sweep_curves(sweep: Sweep, path: str | os.PathLike[str], names: tuple[str, ...] | None = None) -> Path:
    """Draw quantities of a sweep over its parameters.

    A grid of one parameter gives curves, a grid of two gives maps; one panel
    a quantity. Points that failed are left blank.

    Parameters
    ----------
    sweep : Sweep
        A grid of one or two parameters that are numbers.
    path : path of a .png, .pdf or .svg
    names : tuple of str, optional
        Of the quantities; all that are numbers where not given.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    ArgumentError
        If the points are no such grid, or no quantity can be drawn.
    OutputError
        If the file cannot be written.
    """
    goal = goal_of(path)
    axes_values = sweep.points.axes
    if (
        axes_values is None
        or len(axes_values) > 2
        or any(
            isinstance(value, (str, bool)) or not np.isscalar(value)
            for values in axes_values.values()
            for value in values
        )
    ):
        raise ArgumentError(f"sweep_curves: {sweep!r} is no grid of one or two parameters that are numbers")
    dimensions = len(axes_values)
    chosen = [name for name in names or sweep if sweep[name].ndim == dimensions and sweep[name].dtype.kind in "biuf"]
    if not chosen:
        raise ArgumentError(f"sweep_curves: {sweep!r} has no quantity that is one number a point")
    figure, grid = panels((_PANEL[0], _PANEL[1] * len(chosen)), len(chosen), 1)
    for axes, name in zip(grid[:, 0], chosen, strict=True):
        (_curve if dimensions == 1 else _map)(figure, axes, sweep, name)
    return save(figure, goal)


def _curve(figure: Any, axes: Any, sweep: Sweep, name: str) -> None:
    ((parameter, values),) = (sweep.points.axes or {}).items()
    axes.plot(values, sweep[name], ".-", color=COLORS[1], linewidth=1.2, markersize=4)
    axes.set(xlabel=plain(parameter), ylabel=plain(name))


def _map(figure: Any, axes: Any, sweep: Sweep, name: str) -> None:
    (first, rows), (second, columns) = (sweep.points.axes or {}).items()
    values = np.ma.masked_invalid(np.asarray(sweep[name], dtype=float))
    image = axes.pcolormesh(columns, rows, values, shading="nearest", cmap="viridis")
    axes.grid(False)
    axes.set(xlabel=plain(second), ylabel=plain(first))
    figure.colorbar(image, ax=axes, label=plain(name))
