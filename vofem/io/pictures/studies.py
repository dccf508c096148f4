"""Pictures of studies: bifurcation diagrams, basins, maps of steady states, sweeps and fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem._validate import array, choice, listed, wrong
from vofem.errors import ArgumentError
from vofem.fitting import Fit
from vofem.io.pictures.axes import COLORS, Canvas, Where, beside, figure, ink, legend, plain, single, stroke, text_size
from vofem.io.pictures.steady import LINES, MARKS, stretches
from vofem.io.scene_file import point_named
from vofem.studies.diagrams import Basins, BifurcationDiagram, StabilityMap
from vofem.studies.steady import Branch
from vofem.studies.sweep import Sweep

#: How the samples of each start are named in a legend.
_STARTS = {"rest": "from the initial state", "up": "along rising values", "down": "along falling values"}

#: Size of the points of a diagram of one value, in points; of many values it is divided among them.
_AREA = 240.0

#: Most attractors that have a colour of their own.
_MOST = len(COLORS)


@figure
def bifurcation(
    diagram: BifurcationDiagram,
    path: Where = None,
    *,
    point: Any = None,
    branches: Branch | Sequence[Branch] = (),
    label: str = "parameter",
    ylim: tuple[float, float] | None = None,
    ax: Any = None,
) -> Any:
    """Draw stroboscopic samples of a displacement over a parameter, with continued branches of orbits on top.

    Parameters
    ----------
    diagram : BifurcationDiagram
    point : point, optional
        The point whose displacement is drawn. The default is the first one of the diagram.
    branches : Branch, or sequence of Branch
        Their stable parts are drawn as solid lines, the others dashed.
    label : str
        Label of the axis: name and unit of the parameter.
    ylim : tuple of float, optional
        Limits of the displacement, m.

    Raises
    ------
    ArgumentError
        If the diagram has no such point, or an argument is of another kind.
    """
    drawn = (branches,) if isinstance(branches, Branch) else branches
    if not isinstance(drawn, (list, tuple)) or not all(isinstance(one, Branch) for one in drawn):
        raise wrong("bifurcation: branches", repr(branches), "a Branch of vofem.continuation, or a list of them")
    limits = None if ylim is None else array("bifurcation: ylim", ylim, shape=(2,))
    canvas, axes = single("bifurcation", path, ax, (9.0, 5.2))
    size = float(np.clip(_AREA / diagram.values.size, 0.8, 3.5))
    for color, start in zip((COLORS[1], COLORS[0], COLORS[2]), diagram.samples, strict=False):
        samples = diagram.displacement(point, start)
        values = np.broadcast_to(diagram.values[:, None], samples.shape)
        axes.plot(
            values.ravel(), samples.ravel(), "o", color=color, markersize=size, markeredgewidth=0, rasterized=True
        )
        axes.plot([], [], "o", color=color, markersize=4, label=_STARTS[start])
    for branch in drawn:
        positions, marked = (
            np.array([_positions(one, branch.periods, diagram, point) for one in every])
            for every in (branch.orbits, [special.orbit for special in branch.special])
        )
        for stable, along, shown in stretches(branch, positions, marked):
            style, width, name = LINES[stable]
            axes.plot(along, shown, style, color=ink(), linewidth=stroke(0.6 * width), label=name)
        for special, position in zip(branch.special, marked, strict=True):
            values = np.full(position.shape, special.value)
            mark, _, name = MARKS[special.kind]
            axes.plot(values, position, mark, color=ink(), mfc="white", markersize=6, linestyle="none", label=name)
    axes.set(xlabel=plain(label), ylabel="displacement once a period [m]")
    if limits is not None:
        axes.set_ylim(*limits)
    legend(axes, most=12)
    return canvas


def _positions(orbit: Any, periods: int, diagram: BifurcationDiagram, point: Any) -> NDArray:
    """Return the displacements of an orbit at the beginning of each period of the loads."""
    place = diagram.points[0] if point is None else point
    if isinstance(place, str):
        place = point_named(orbit.scene, place)
    displacement: NDArray = orbit.result.displacement(place, orbit.period / periods * np.arange(periods))
    return displacement


@figure
def basin_map(basins: Basins, path: Where = None, *, labels: tuple[str, str] | None = None, ax: Any = None) -> Any:
    """Draw to which attractor each initial state leads. Each attractor has its colour.

    Parameters
    ----------
    basins : Basins
        The outcome of `vofem.basins` over a grid of two parameters.
    labels : tuple of str, optional
        Labels of the axes: names and units of the two parameters. The default is their names, with m and m/s for
        "displacement" and "velocity".

    Raises
    ------
    ArgumentError
        If the grid has not two dimensions.
    """
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.patches import Patch

    axes_values = basins.sweep.points.axes
    if axes_values is None or len(axes_values) != 2:
        raise ArgumentError(f"basin_map: {basins!r} is no grid of two parameters")
    (first, rows), (second, columns) = axes_values.items()
    names = [one.name for one in basins.attractors]
    colors = [*COLORS[: min(len(names), _MOST)], "#d7dade"]
    index = np.where(basins.index < 0, len(colors) - 1, np.minimum(basins.index, len(colors) - 1))
    canvas, axes = single("basin_map", path, ax, (7.4, 5.2))
    norm = BoundaryNorm(np.arange(len(colors) + 1) - 0.5, len(colors))
    _mesh(axes, rows, columns, index, cmap=ListedColormap(colors), norm=norm)
    units = {"displacement": " [m]", "velocity": " [m/s]"}
    named = tuple(name + units.get(name, "") for name in (first, second))
    _name_axes(axes, "basin_map", named if labels is None else labels)
    handles = [Patch(color=color, label=plain(name)) for color, name in zip(colors[:-1], names, strict=False)]
    if np.any(index == len(colors) - 1):
        handles.append(Patch(color=colors[-1], label="others, or failed" if len(names) > _MOST else "failed"))
    beside(axes, handles, [str(handle.get_label()) for handle in handles])
    return canvas


_LABELS = {"amplitude": "amplitude [m]", "multiplier": "modulus of the leading multiplier [1]"}


@figure
def state_map(
    found: StabilityMap,
    path: Where = None,
    *,
    quantity: str = "amplitude",
    labels: tuple[str, str] = ("x", "y"),
    ax: Any = None,
) -> Any:
    """Draw a quantity of the steady states over two parameters; where they are unstable, the map is hatched.

    Parameters
    ----------
    found : StabilityMap
    quantity : {"amplitude", "multiplier"}
        The amplitude in m, or the modulus of the leading multiplier.
    labels : tuple of str
        Labels of the axes: names and units of the two parameters.

    Raises
    ------
    ArgumentError
        If the quantity is another one.
    """
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Patch

    choice("state_map: quantity", quantity, tuple(_LABELS))
    values = found.amplitude if quantity == "amplitude" else np.abs(found.multiplier)
    canvas, axes = single("state_map", path, ax, (7.8, 5.2))
    # Grey shows where no orbit was found.
    axes.set_facecolor("#d7dade")
    mesh = _mesh(axes, found.x, found.y, values, cmap="viridis", rasterized=True)
    canvas.figure.colorbar(mesh, ax=axes, label=_LABELS[quantity])
    cells = _cells(found.x, found.y, found.stable == 0.0)
    handles = []
    if cells:
        axes.add_collection(PatchCollection(cells, facecolor="none", edgecolor=ink(), linewidth=0.0, hatch="////"))
        handles.append(Patch(facecolor="white", edgecolor=ink(), hatch="////", label="unstable"))
    if found.failed:
        handles.append(Patch(color="#d7dade", label="no such orbit found"))
    _name_axes(axes, "state_map", labels)
    if handles:
        axes.legend(handles=handles, loc="upper right", fontsize=text_size(9.0))
    return canvas


def _name_axes(axes: Any, what: str, labels: Any) -> None:
    """Write the labels of two parameters at the axes; raise `ArgumentError` if these are not two texts."""
    if not isinstance(labels, (tuple, list)) or len(labels) != 2:
        raise wrong(f"{what}: labels", repr(labels), "two texts, one for each axis")
    axes.set(xlabel=plain(labels[0]), ylabel=plain(labels[1]))


def _cells(x: NDArray[np.float64], y: NDArray[np.float64], chosen: NDArray[np.bool_]) -> list[Any]:
    """Return the chosen cells of a map as rectangles whose sides are halfway to the neighbours."""
    from matplotlib.patches import Rectangle

    i, j = np.argsort(x), np.argsort(y)
    left, bottom = _sides(x[i]), _sides(y[j])
    return [
        Rectangle((left[k], bottom[m]), left[k + 1] - left[k], bottom[m + 1] - bottom[m])
        for k, m in np.argwhere(chosen[i][:, j]).tolist()
    ]


def _mesh(axes: Any, x: Any, y: Any, values: NDArray[Any], **look: Any) -> Any:
    """Draw a map of values, shape (x.size, y.size), as cells about x and y, which have any order; return the mesh."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    i, j = np.argsort(x), np.argsort(y)
    axes.grid(False)
    return axes.pcolormesh(_sides(x[i]), _sides(y[j]), values[i][:, j].T, **look)


def _sides(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sides of cells about values that rise, shape (n + 1,)."""
    if values.size == 1:
        half = 0.05 * abs(values[0]) or 0.5
        return np.array([values[0] - half, values[0] + half])
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2.0 * values[0] - middle[0]], middle, [2.0 * values[-1] - middle[-1]]])


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
    one panel for each quantity. Points that failed are left blank.

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
    wanted = list(sweep) if names is None else listed(names)
    if not (units is None or isinstance(units, Mapping)):
        raise wrong("sweep_curves: units", repr(units), "a dict of units by names, such as {'gap': 'mm'}")
    axes_values = sweep.points.axes
    every = [value for values in (axes_values or {}).values() for value in values]
    numbers = all(np.isscalar(value) and not isinstance(value, (str, bool)) for value in every)
    if axes_values is None or len(axes_values) > 2 or not numbers:
        raise ArgumentError(f"sweep_curves: {sweep!r} is no grid of one or two parameters that are numbers")
    dimensions = len(axes_values)
    chosen = [name for name in wanted if sweep[name].ndim == dimensions and sweep[name].dtype.kind in "biuf"]
    if not chosen:
        raise ArgumentError(f"sweep_curves: {sweep!r} has no quantity that is one number a point")
    canvas = Canvas("sweep_curves", path, ax, (_PANEL[0], _PANEL[1] * len(chosen)), len(chosen), 1)
    words = {name: plain(f"{name} [{(units or {})[name]}]" if name in (units or {}) else name)
             for name in (*axes_values, *chosen)}  # fmt: skip
    first, *others = (words[name] for name in axes_values)
    rows, *columns = axes_values.values()
    for axes, name in zip(canvas.grid[:, 0], chosen, strict=True):
        axes.set(xlabel=first, ylabel=(*others, words[name])[0])
        if not columns:
            order = np.argsort(rows)
            x, y = np.asarray(rows)[order], sweep[name][order]
            axes.plot(x, y, ".-", color=COLORS[1], linewidth=stroke(1.2), markersize=4)
            continue
        values = np.ma.masked_invalid(np.asarray(sweep[name], dtype=float))
        image = _mesh(axes, rows, columns[0], values, cmap="viridis")
        # Cells reach half a distance beyond the outermost points, where nothing was computed.
        for limits, series in ((axes.set_xlim, rows), (axes.set_ylim, columns[0])):
            if min(series) < max(series):
                limits(min(series), max(series))
        canvas.figure.colorbar(image, ax=axes, label=words[name])
    return canvas


@figure
def fit(result: Fit, path: Where = None, *, ax: Any = None) -> Any:
    """Draw measurements with the model that was fitted to them, and below the residuals.

    Parameters
    ----------
    result : Fit
    ax : matplotlib axes, optional
        The axes to draw into, in the order of rows: those of all measurements, then those of their residuals. By
        default a new figure is made.
    """
    count = len(result.data)
    canvas = Canvas("fit", path, ax, (6.0 + 2.0 * count, 5.6), rows=2, columns=count)
    row, shift = 0, 0
    for k, one in enumerate(result.data):
        used = one.used(result.until)
        size = int(used.sum())
        residuals = result.residuals[row : row + size]
        row += size
        x, values = one.places[used], one.values[used]
        if one.offset:
            values, shift = values - float(result.offsets[shift]), shift + 1
        upper, lower = canvas.grid[0, k], canvas.grid[1, k]
        marker = "o" if size < 60 else "."
        upper.plot(x, values, marker, color=COLORS[0], markersize=4.0, label="measured")
        upper.plot(x, values + residuals, color=ink(), linewidth=stroke(1.0), label="fitted")
        upper.set_title(plain(one.describe()), fontsize=text_size(10))
        upper.legend()
        lower.axhline(0.0, color=ink(), linewidth=stroke(0.6))
        lower.plot(x, residuals, marker, color=COLORS[1], markersize=4.0)
        lower.set(xlabel=one.along, ylabel=f"residual [{one.unit}]")
        upper.set(xlabel=one.along, ylabel=f"value [{one.unit}]")
    return canvas
