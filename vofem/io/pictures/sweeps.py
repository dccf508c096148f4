"""Pictures of sweeps: curves over one parameter, maps over two."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vofem.errors import ArgumentError
from vofem.io.pictures.axes import COLORS, Canvas, Where, figure, plain, stroke
from vofem.studies.sweep import Sweep

#: Width and height of one panel, inches.
_PANEL = (6.4, 3.6)


@figure
def sweep_curves(
    sweep: Sweep,
    path: Where = None,
    names: tuple[str, ...] | str | None = None,
    *,
    units: Mapping[str, str] | None = None,
    ax: Any = None,
) -> Any:
    """Draw quantities of a sweep over its parameters.

    A grid of one parameter gives curves, and a grid of two parameters gives maps, the first parameter along x. There is
    one panel for each quantity.
    Points that failed are left blank.

    Parameters
    ----------
    sweep : Sweep
        A grid of one or two parameters that are numbers.
    names : tuple of str, or str, optional
        Names of the quantities that are drawn. The default is all quantities that are numbers.
    units : dict of str to str, optional
        Units of parameters and quantities by their names, for the axes.
    ax : matplotlib axes, optional
        The axes to draw into, one for each quantity. By default a new figure is made.

    Raises
    ------
    ArgumentError
        If the points are not a grid of one or two parameters, or no quantity can be drawn.
    """
    names = (names,) if isinstance(names, str) else names
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
    canvas = Canvas("sweep_curves", path, ax, (_PANEL[0], _PANEL[1] * len(chosen)), len(chosen), 1)
    for axes, name in zip(canvas.grid[:, 0], chosen, strict=True):
        (_curve if dimensions == 1 else _map)(canvas.figure, axes, sweep, name, units or {})
    return canvas


def _curve(figure: Any, axes: Any, sweep: Sweep, name: str, units: Mapping[str, str]) -> None:
    ((parameter, values),) = (sweep.points.axes or {}).items()
    axes.plot(values, sweep[name], ".-", color=COLORS[1], linewidth=stroke(1.2), markersize=4)
    axes.set(xlabel=_named(parameter, units), ylabel=_named(name, units))


def _map(figure: Any, axes: Any, sweep: Sweep, name: str, units: Mapping[str, str]) -> None:
    rows: Any
    columns: Any
    (first, rows), (second, columns) = (sweep.points.axes or {}).items()
    values = np.ma.masked_invalid(np.asarray(sweep[name], dtype=float))
    x, y = np.argsort(rows), np.argsort(columns)
    rows, columns, values = np.asarray(rows)[x], np.asarray(columns)[y], values[x][:, y]
    image = axes.pcolormesh(rows, columns, values.T, shading="nearest", cmap="viridis")
    axes.grid(False)
    axes.set(xlabel=_named(first, units), ylabel=_named(second, units))
    # Cells reach half a distance beyond the outermost points, where nothing was computed.
    for limits, series in ((axes.set_xlim, rows), (axes.set_ylim, columns)):
        if min(series) < max(series):
            limits(min(series), max(series))
    figure.colorbar(image, ax=axes, label=_named(name, units))


def _named(name: str, units: Mapping[str, str]) -> str:
    """Return a name with its unit, where that is known."""
    return plain(f"{name} [{units[name]}]" if name in units else name)
