"""Pictures with matplotlib: histories, spectra, impacts, shapes, maps of the motion, side views, steady states.

Every function writes a file where it is given a path, and returns the path. Without one it draws into the axes given as
``ax=``, or into a figure of ``matplotlib.pyplot``, and returns the axes. Style sheets of matplotlib restyle them all.
"""

from __future__ import annotations

import os
from pathlib import Path

from vofem.files.whole import replacing
from vofem.io.pictures.axes import goal_of
from vofem.io.pictures.diagrams import basin_map, bifurcation
from vofem.io.pictures.histories import time_history
from vofem.io.pictures.impacts import event_raster, force_histogram, impact_statistics
from vofem.io.pictures.maps import state_map
from vofem.io.pictures.profiles import shapes
from vofem.io.pictures.space_time import space_time
from vofem.io.pictures.spectra import spectrum
from vofem.io.pictures.steady import backbone_curve, multipliers, phase_portrait, poincare_section, response_curve
from vofem.io.pictures.sweeps import sweep_curves
from vofem.io.pictures.work_precision import work_precision
from vofem.result import Result
from vofem.scene import Scene
from vofem.statics import Equilibrium

__all__ = [
    "backbone_curve",
    "basin_map",
    "bifurcation",
    "draw_scene",
    "event_raster",
    "force_histogram",
    "impact_statistics",
    "multipliers",
    "phase_portrait",
    "poincare_section",
    "response_curve",
    "shapes",
    "space_time",
    "spectrum",
    "state_map",
    "sweep_curves",
    "time_history",
    "work_precision",
]


def draw_scene(
    outcome: Result | Equilibrium,
    t: float | None,
    path: str | os.PathLike[str],
    *,
    scene: Scene | None = None,
    size: tuple[int, int] = (1600, 700),
    magnification: float | None = None,
) -> Path:
    """Draw the side view of a scene at time t; see `vofem.io.render.render`, which needs a graphics driver.

    Parameters
    ----------
    outcome : Result or Equilibrium
    t : float or None
        Time, s; None for an equilibrium.
    path : path of a .png, .pdf or .svg
    scene : Scene, optional
        The scene of an equilibrium.
    size : tuple of int
        Width and height in pixels.
    magnification : float, optional
        Factor by which displacements are enlarged; chosen where not given.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    from vofem.io.pictures.backend_matplotlib import draw
    from vofem.io.pictures.sketch import sketch
    from vofem.io.pictures.snapshot import snapshot

    goal = goal_of(path)
    assert goal is not None
    drawing = sketch(snapshot(outcome, t, scene), size, magnification)
    with replacing(goal) as temporary:
        draw(drawing, temporary)
    return goal
