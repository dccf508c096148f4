"""Shapes of a beam at given times, and maps of a motion over time and place."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import array, series, unknown, wrong
from vofem.arrays import Array
from vofem.bodies import Beam
from vofem.errors import ArgumentError
from vofem.histories.impacts import window_of
from vofem.io.pictures.axes import COLORS, Canvas, Where, figure, ink, legend, plain, single, stroke, text_size
from vofem.io.pictures.histories import closed_intervals, end_of, times_of
from vofem.io.pictures.places import Place, along_beam, between_masses, is_line, one_line
from vofem.io.pictures.units import length
from vofem.lookup import the_beam
from vofem.result import Result
from vofem.scene import Scene
from vofem.statics import Equilibrium
from vofem.system import OPEN

Outcome = Result | Equilibrium
Others = tuple[str, ArrayLike, ArrayLike]

#: Points along a beam at which its shape is drawn, and marks of another result along it.
_POINTS, _MARKS = 401, 26
#: Names of the entries that are not lines; they stand last in the legend.
_CLOSED, _SURFACE = "closed contact", "untouched surface"

#: Lines of a legend that fit beside the axes.
_LEGEND = 16


@figure
def shapes(
    outcome: Outcome | Mapping[str, Outcome],
    times: ArrayLike | None,
    path: Where = None,
    *,
    scene: Scene | None = None,
    body: Beam | str | None = None,
    beside: Others | Mapping[str, Others] | None = None,
    ax: Any = None,
) -> Any:
    """Draw the deflection along a beam at given times, and where its contacts are closed.

    Parameters
    ----------
    outcome : Result or Equilibrium, or mapping of titles to them
        What is drawn. Several outcomes are drawn side by side with the same scales.
    times : array_like or None
        Times in s, each drawn as one line; None for an equilibrium.
    scene : Scene, optional
        The scene of an equilibrium.
    body : Beam or name, optional
        The beam. It must be given if the scene has several.
    beside : (name, x, eta), optional
        Another result, drawn with markers: x in m, shape (n,), and eta in m, shape (n, n_times) or (n,). If `outcome`
        is a mapping, give a mapping with the same titles.
    ax : matplotlib axes, optional
        The axes to draw into, one for each outcome. By default a new figure is made.

    Raises
    ------
    ArgumentError
        If an equilibrium is given without its scene, a scene has several beams and `body` is missing, times lie outside
        the run, or `beside` has another form, wrong shapes or titles that `outcome` has not.
    """
    runs: Mapping[str, Outcome] = outcome if isinstance(outcome, Mapping) else {"": outcome}
    at = [None] if times is None else series("shapes: times", times).tolist()
    others = _others(beside, runs, len(at))
    drawn = {title: _Shapes(run, at, scene, body) for title, run in runs.items()}
    factor, unit = length(max(float(np.max(np.abs(shape.eta))) for shape in drawn.values()))
    width = 9.0 if len(runs) == 1 else 2.0 + 4.6 * len(runs)
    canvas = Canvas("shapes", path, ax, (width, 4.6), 1, len(runs), sharey=True)
    grid = canvas.grid
    for axes, (title, shape) in zip(grid[0], drawn.items(), strict=True):
        shape.draw(axes, factor, others.get(title))
        axes.set_title(plain(title), fontsize=text_size(11))
        axes.set_xlabel("x [m]")
    grid[0, 0].set_ylabel(f"deflection [{unit}]")
    legend(grid[0, -1], grid[0], _LEGEND, last=(_CLOSED, _SURFACE))
    return canvas


def _others(beside: Any, runs: Mapping[str, Outcome], n_times: int) -> dict[str, tuple[str, Array, Array]]:
    """Return what is drawn beside the outcomes, by their titles, with arrays of shapes (n,) and (n, n_times)."""
    if not isinstance(beside, Mapping):
        beside = {} if beside is None else dict.fromkeys(runs, beside)
    found = {}
    for title, other in beside.items():
        if title not in runs:
            raise unknown("outcome", title, runs, what="shapes: beside")
        if not isinstance(other, (tuple, list)) or len(other) != 3 or not isinstance(other[0], str):
            raise wrong("shapes: beside", reprlib.repr(other), "a name, x in m and eta in m: (name, x, eta)")
        name, x, eta = other[0], series("shapes: beside: x", other[1]), array("shapes: beside: eta", other[2])
        eta = eta[:, None] if eta.ndim == 1 else eta
        if eta.shape != (x.size, n_times):
            raise ArgumentError(f"shapes: beside: eta has shape {eta.shape}, expected {(x.size, n_times)}")
        found[title] = (name, x, eta)
    return found


class _Shapes:
    """One beam at several times: x (n,), eta (n, n_times) and which contacts hold it."""

    def __init__(self, outcome: Outcome, times: Sequence[float | None], scene: Scene | None, body: Any) -> None:
        if isinstance(outcome, Equilibrium) and scene is None:
            raise ArgumentError("a picture of an equilibrium needs scene=, the Scene that it is the equilibrium of")
        within = scene if isinstance(outcome, Equilibrium) else outcome.scene
        assert within is not None
        self.times = times
        self.beam = the_beam(within.bodies, body)
        self.places = along_beam(within, self.beam)
        self.x = np.union1d(np.linspace(self.beam.nodes[0], self.beam.nodes[-1], _POINTS), self.beam.nodes)
        self.held = np.array([p.x for p in self.places])
        if isinstance(outcome, Equilibrium):
            self.closed = np.array([[outcome.contacts[p.name].status != "open"] for p in self.places], dtype=bool)
            self.eta, self.at_held = (outcome.deflection(x, self.beam)[:, None] for x in (self.x, self.held))
        else:
            laws, at = outcome.model.system.contacts, np.array(times, dtype=float)
            self.eta, self.at_held = (outcome.deflection(x, at, self.beam) for x in (self.x, self.held))
            if laws is not None:
                rows = [laws.names.index(p.name) for p in self.places]
                self.closed = outcome.solution.contacts(at).status[rows] != OPEN

    def draw(self, axes: Any, factor: float, beside: Any) -> None:
        """Draw lines, closed contacts, stops and another result's markers; lengths are divided by `factor`."""
        _draw_stops(axes, self.places, self.beam.length, factor)
        lines = _colors(len(self.times))
        for k, t in enumerate(self.times):
            label = "deflection" if t is None else f"t = {t:g} s"
            axes.plot(self.x, self.eta[:, k] / factor, color=lines[k], linewidth=stroke(1.6), label=label)
            if self.places and np.any(self.closed[:, k]):
                on = self.closed[:, k]
                dots = {"color": COLORS[0], "linestyle": "", "marker": "o", "markersize": 6.0, "zorder": 3}
                axes.plot(self.held[on], self.at_held[on, k] / factor, **dots, label=_CLOSED)
        if beside is not None:
            name, x, eta = beside
            some = np.unique(np.linspace(0, x.size - 1, _MARKS).round().astype(int))
            marks = {"linestyle": "", "marker": "o", "markersize": 5.0, "markerfacecolor": "none", "zorder": 4}
            for k in range(eta.shape[1]):
                axes.plot(x[some], eta[some, k] / factor, **marks, color=lines[k], label=name)


def _colors(count: int) -> list[Any]:
    """Return colours of lines: easily distinguished ones for a few lines, a scale over time for many lines."""
    if count <= len(COLORS):
        return [ink(), *COLORS[1:]]
    from matplotlib import colormaps

    return [colormaps["viridis"](0.92 * k / (count - 1)) for k in range(count)]


def _draw_stops(axes: Any, places: list[Place], size: float, factor: float) -> None:
    """Draw the surfaces of stops that are not touched. Surfaces in a row are drawn as one line."""
    surfaces = sorted({p.surface for p in places if p.surface is not None})
    for surface in surfaces:
        at = np.array(sorted(p.x for p in places if p.surface == surface))
        near = 0.02 * size
        for group in np.split(at, np.flatnonzero(np.diff(at) > 5.0 * near) + 1):
            ends = (group[0] - near, group[-1] + near)
            axes.plot(ends, [surface / factor] * 2, color="#8d929b", linewidth=stroke(2.5), label=_SURFACE)


#: Times, and points along a beam, at which the motion is drawn.
_TIMES, _PLACES = 1201, 201


@figure
def space_time(
    result: Result, path: Where = None, *, body: Beam | str | None = None, ax: Any = None,
    window: tuple[float, float] | None = None,
) -> Any:  # fmt: skip
    """Draw displacements as colours over time and place, and closed contacts as lines.

    The place is x along a beam. In a scene that has only masses it is the number of the mass, and a contact lies
    between the two that it joins. If a few places move much further than the others, the colours end at three times the
    root mean square displacement, and the colour bar has arrows.

    Parameters
    ----------
    result : Result
    body : Beam or name, optional
        The beam. It must be given if the scene has several beams, or beams and masses.

    Raises
    ------
    ArgumentError
        If `body` is needed and missing.
    """
    times = times_of(result, *window_of("space_time", window, end_of(result)), _TIMES)
    if times.size < 2:
        raise ArgumentError(f"space_time: the run stored {times.size} times in this window, expected two or more")
    lines = [b for b in result.scene.bodies if is_line(b)]
    masses = body is None and not lines
    if body is None and lines and len(lines) < len(result.scene.bodies):
        raise ArgumentError("the scene has beams and masses; say which beam with body=")
    if masses:
        eta = np.array([result.displacement(b, times) for b in result.scene.bodies])
        x = np.arange(1.0, 1.0 + len(eta))
        places = between_masses(result.scene)
    else:
        line = one_line(result.scene, body)
        if isinstance(line, Beam):
            x = np.linspace(line.nodes[0], line.nodes[-1], _PLACES)
            eta = result.deflection(x, times, line)
        else:
            x, eta = line.shape.x, result.along_shape(line, times)
        places = along_beam(result.scene, line)
    peak = float(np.max(np.abs(eta)))
    bound = min(peak, 3.0 * float(np.sqrt(np.mean(eta**2))))
    factor, unit = length(bound)
    canvas, axes = single("space_time", path, ax, (10.0, 5.2))
    axes.grid(False)
    limit = bound / factor or 1.0
    style: dict[str, Any] = {"cmap": "RdBu_r", "vmin": -limit, "vmax": limit, "rasterized": True}
    # Masses are bands with an edge where their contact lies; a beam has no edges.
    colors = axes.pcolormesh(times, x, eta / factor, shading="nearest" if masses else "gouraud", **style)
    spans = [(p.x, start, stop) for p in places for start, stop in closed_intervals(result, p.name)]
    if spans:
        at, start, stop = np.array(spans).T
        axes.hlines(at, start, stop, color=ink(), linewidth=stroke(2.4) if masses else 1.4, label="closed contact")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=text_size(9))
    if masses:
        axes.yaxis.get_major_locator().set_params(integer=True)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("mass number [-]" if masses else "x [m]")
    axes.set_xlim(times[0], times[-1])
    axes.set_ylim((0.5, x[-1] + 0.5) if masses else (x[0], x[-1]))
    extend = "both" if bound < peak else "neither"
    canvas.figure.colorbar(colors, ax=axes, label=f"displacement [{unit}]", pad=0.02, extend=extend)
    return canvas
