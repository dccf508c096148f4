"""Pictures of bifurcation diagrams and basins of attraction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ArgumentError
from vofem.io.pictures.axes import COLORS, Canvas, Where, beside, figure, ink, legend, plain, stroke
from vofem.io.scene_file import point_named
from vofem.studies.diagrams import Basins, BifurcationDiagram
from vofem.studies.steady import Branch

#: How the samples of each start are named in a legend.
_STARTS = {"rest": "from the initial state", "up": "along rising values", "down": "along falling values"}

#: Marks of special points; the others are squares.
_MARKS = {"grazing": "v", "fold": "o", "period_doubling": "D"}

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
    branches: Sequence[Branch] = (),
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
    branches : sequence of Branch
        Their stable parts are drawn as solid lines, the others dashed.
    label : str
        Label of the axis: name and unit of the parameter.
    ylim : tuple of float, optional
        Limits of the displacement, m.

    Raises
    ------
    ArgumentError
        If the diagram has no such point.
    """
    canvas = Canvas("bifurcation", path, ax, (9.0, 5.2))
    axes = canvas.grid[0, 0]
    size = float(np.clip(_AREA / diagram.values.size, 0.8, 3.5))
    for color, start in zip((COLORS[1], COLORS[0], COLORS[2]), diagram.samples, strict=False):
        samples = diagram.displacement(point, start)
        values = np.broadcast_to(diagram.values[:, None], samples.shape)
        axes.plot(
            values.ravel(), samples.ravel(), "o", color=color, markersize=size, markeredgewidth=0, rasterized=True
        )
        axes.plot([], [], "o", color=color, markersize=4, label=_STARTS[start])
    named: set[str] = set()
    for branch in branches:
        for stable, along, positions in _pieces(branch, diagram, point):
            style = "-" if stable else "--"
            name = "stable orbits" if stable else "unstable orbits"
            axes.plot(
                along, positions, style, color=ink(), linewidth=stroke(1.1), label=None if name in named else name
            )
            named.add(name)
        for special in branch.special:
            position = _positions(special.orbit, branch.periods, diagram, point)
            values = np.full(position.shape, special.value)
            name = special.kind.replace("_", " ")
            once = None if name in named else name
            axes.plot(
                values, position, _MARKS.get(special.kind, "s"), color=ink(), mfc="white", markersize=6, label=once
            )
            named.add(name)
    axes.set(xlabel=plain(label), ylabel="displacement once a period [m]")
    if ylim is not None:
        axes.set_ylim(*ylim)
    legend(axes)
    return canvas


def _pieces(branch: Branch, diagram: BifurcationDiagram, point: Any) -> list[tuple[bool, list[float], NDArray]]:
    """Return the parts of a branch of one stability: values, and displacements at the beginning of each period.

    Neighbouring parts meet at the special point between them.
    """
    pieces: list[tuple[bool, list[float], list[NDArray]]] = []
    for k, (value, orbit) in enumerate(zip(branch.values, branch.orbits, strict=True)):
        position = _positions(orbit, branch.periods, diagram, point)
        stable = bool(orbit.stable)
        if pieces and pieces[-1][0] != stable:
            joint = next((special for special in branch.special if k - 1 <= special.place <= k), None)
            if joint is not None:
                between = _positions(joint.orbit, branch.periods, diagram, point)
                pieces[-1][1].append(joint.value)
                pieces[-1][2].append(between)
                pieces.append((stable, [joint.value], [between]))
        if not pieces or pieces[-1][0] != stable:
            pieces.append((stable, [], []))
        pieces[-1][1].append(float(value))
        pieces[-1][2].append(position)
    return [(stable, values, np.array(positions)) for stable, values, positions in pieces]


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
        Labels of the axes: names and units of the two parameters.

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
    canvas = Canvas("basin_map", path, ax, (7.4, 5.2))
    axes = canvas.grid[0, 0]
    norm = BoundaryNorm(np.arange(len(colors) + 1) - 0.5, len(colors))
    axes.grid(False)
    axes.pcolormesh(rows, columns, index.T, shading="nearest", cmap=ListedColormap(colors), norm=norm)
    xlabel, ylabel = labels or (first, second)
    axes.set(xlabel=plain(xlabel), ylabel=plain(ylabel))
    handles = [Patch(color=color, label=plain(name)) for color, name in zip(colors[:-1], names, strict=False)]
    if np.any(index == len(colors) - 1):
        handles.append(Patch(color=colors[-1], label="others, or failed" if len(names) > _MOST else "failed"))
    beside(axes, handles, [str(handle.get_label()) for handle in handles])
    return canvas
