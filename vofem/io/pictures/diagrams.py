"""Pictures of bifurcation diagrams and basins of attraction."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ArgumentError
from vofem.io.pictures.axes import COLORS, INK, goal_of, legend, panels, plain, save
from vofem.studies.diagrams import Basins, BifurcationDiagram
from vofem.studies.steady import Branch

#: How the samples of each start are named in a legend.
_STARTS = {"rest": "from the initial state", "up": "along rising values", "down": "along falling values"}

#: Marks of special points; the others are squares.
_MARKS = {"grazing": "v", "fold": "o", "period_doubling": "D"}

#: Size of the points of a diagram of one value, in points; of many values it is divided among them.
_INK = 240.0

#: Most attractors that have a colour of their own.
_MOST = len(COLORS)


def bifurcation(
    diagram: BifurcationDiagram,
    path: str | os.PathLike[str],
    *,
    point: Any = None,
    branches: Sequence[Branch] = (),
    label: str = "parameter",
    ylim: tuple[float, float] | None = None,
) -> Path:
    """Draw where motions are once a period, over a parameter, with continued branches of orbits over them.

    Parameters
    ----------
    diagram : BifurcationDiagram
    path : path of a .png, .pdf or .svg
    point : point, optional
        Whose displacement is drawn; the first of the diagram where not given.
    branches : sequence of Branch
        Their stable parts are drawn as solid lines, the others dashed.
    label : str
        Of the parameter, with its unit.
    ylim : tuple of float, optional
        Limits of the displacement, m.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    ArgumentError
        If the diagram has no such point.
    OutputError
        If the file cannot be written.
    """
    goal = goal_of(path)
    figure, ((axes,),) = panels((9.0, 5.2))
    size = float(np.clip(_INK / diagram.values.size, 0.8, 3.5))
    for color, start in zip((COLORS[1], COLORS[0], COLORS[2]), diagram.looks, strict=False):
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
            axes.plot(along, positions, style, color=INK, linewidth=1.1, label=None if name in named else name)
            named.add(name)
        for special in branch.special:
            position = _positions(special.orbit, branch.periods, diagram, point)
            values = np.full(position.shape, special.value)
            name = special.kind.replace("_", " ")
            once = None if name in named else name
            axes.plot(values, position, _MARKS.get(special.kind, "s"), color=INK, mfc="white", markersize=6, label=once)
            named.add(name)
    axes.set(xlabel=plain(label), ylabel="displacement once a period [m]")
    if ylim is not None:
        axes.set_ylim(*ylim)
    legend(axes)
    return save(figure, goal)


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
    place = _place(orbit.scene, diagram.points[0] if point is None else point)
    displacement: NDArray = orbit.result.displacement(place, orbit.period / periods * np.arange(periods))
    return displacement


def _place(scene: Any, name: Any) -> Any:
    """Return the point of a scene that a diagram names."""
    if not isinstance(name, str):
        return name
    points = [place for effect in scene.effects for place in effect.points()] + list(scene.bodies)
    for place in points:
        if getattr(place, "name", None) == name:
            return place
    raise ArgumentError(f"bifurcation: the scenes of the branch have no point named {name!r}; give point=")


def basin_map(basins: Basins, path: str | os.PathLike[str], *, labels: tuple[str, str] | None = None) -> Path:
    """Draw which attractor each initial state leads to, a colour each.

    Parameters
    ----------
    basins : Basins
        Over a grid of two parameters.
    path : path of a .png, .pdf or .svg
    labels : tuple of str, optional
        Of the two parameters, with their units.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    ArgumentError
        If the grid has not two dimensions.
    OutputError
        If the file cannot be written.
    """
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.patches import Patch

    goal = goal_of(path)
    axes_values = basins.sweep.points.axes
    if axes_values is None or len(axes_values) != 2:
        raise ArgumentError(f"basin_map: {basins!r} is no grid of two parameters")
    (first, rows), (second, columns) = axes_values.items()
    names = [one.name for one in basins.attractors]
    colors = [*COLORS[: min(len(names), _MOST)], "#d7dade"]
    index = np.where(basins.index < 0, len(colors) - 1, np.minimum(basins.index, len(colors) - 1))
    figure, ((axes,),) = panels((7.4, 5.2))
    norm = BoundaryNorm(np.arange(len(colors) + 1) - 0.5, len(colors))
    axes.grid(False)
    axes.pcolormesh(rows, columns, index.T, shading="nearest", cmap=ListedColormap(colors), norm=norm)
    xlabel, ylabel = labels or (first, second)
    axes.set(xlabel=plain(xlabel), ylabel=plain(ylabel))
    handles = [Patch(color=color, label=plain(name)) for color, name in zip(colors[:-1], names, strict=False)]
    if np.any(index == len(colors) - 1):
        handles.append(Patch(color=colors[-1], label="others, or failed" if len(names) > _MOST else "failed"))
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)
    return save(figure, goal)
