"""Maps of a motion over time and place, with the times at which contacts are closed."""

from __future__ import annotations

from typing import Any

import numpy as np

from vofem.bodies import Beam
from vofem.errors import ArgumentError
from vofem.histories.impacts import window_of
from vofem.io.pictures.axes import Canvas, Where, figure, ink, stroke, text_size
from vofem.io.pictures.histories import closed_intervals, end_of, times_of
from vofem.io.pictures.places import along_beam, between_masses, is_line, one_line
from vofem.io.pictures.units import length
from vofem.result import Result

#: Times, and points along a beam, at which the motion is drawn.
_TIMES, _POINTS = 1201, 201


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
            x = np.linspace(line.nodes[0], line.nodes[-1], _POINTS)
            eta = result.deflection(x, times, line)
        else:
            x, eta = line.shape.x, result.along_shape(line, times)
        places = along_beam(result.scene, line)
    peak = float(np.max(np.abs(eta)))
    bound = min(peak, 3.0 * float(np.sqrt(np.mean(eta**2))))
    factor, unit = length(bound)
    canvas = Canvas("space_time", path, ax, (10.0, 5.2))
    axes = canvas.grid[0, 0]
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
