"""`vofem.io.snapshot`: the deflected structure in three dimensions, drawn by VTK without a window."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem._validate import number
from vofem.errors import ArgumentError
from vofem.files.whole import replacing, target
from vofem.io.interactive import frames_of, run_of, stage, without_warnings
from vofem.result import Result
from vofem.studies.steady import PeriodicOrbit

#: Times by which the magnification and the scale of colours of a run are chosen.
_TIMES = 61

#: The direction to the eye, the direction that is up, and the shares of width and height that the structure may fill.
_VIEW, _UP, _FILLED = (-0.35, 0.3, 1.0), (0.0, 1.0, 0.0), (0.85, 0.6)


def snapshot(
    subject: Result | PeriodicOrbit,
    t: float,
    path: str | os.PathLike[str],
    *,
    size: tuple[int, int] = (1200, 600),
    magnification: float | None = None,
    scalars: str | None = None,
) -> Path:
    """Draw the deflected structure at time t in three dimensions, as ParaView shows a saved run.

    It needs a graphics driver, but no display. `vofem.io.render.render` needs neither.

    Parameters
    ----------
    subject : Result or PeriodicOrbit
    t : float
        Time in s, within the run.
    path : path of a .png
    size : (int, int)
        Width and height in pixels.
    magnification : float, optional
        Factor by which displacements and gaps are enlarged; chosen where not given.
    scalars : str, optional
        The field that is shown in colours, one of `vofem.io.vtk.write_series`; the bending moment where there are
        beams, else the velocity.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    ArgumentError
        If the subject is not a run or an orbit, the time lies outside it, or the field is unknown.
    OutputError
        If there is no graphics driver, or the file cannot be written.
    """
    goal = target(path, (".png",))
    result = run_of("snapshot", subject)
    t, end = number("snapshot: t", t), min(float(result.times[-1]), result.solution.t_end)
    if not 0.0 <= t <= end:
        raise ArgumentError(f"snapshot: t is {t:g}, expected a time of the run, 0 to {end:g} s")
    times = np.linspace(0.0, end, _TIMES) if result.solution.continuous else result.times[result.times <= end]
    frames = frames_of("snapshot", result, np.append(times, t), magnification)
    plotter, _, parts = stage("snapshot", frames, len(frames) - 1, scalars, off_screen=True, window_size=size)
    rest = parts[0][0].copy()
    rest.points = rest.points - frames.magnification * rest.point_data["deflection"]
    plotter.add_mesh(rest, color="white", line_width=3.0, point_size=8.0)
    plotter.add_text(f"t = {t:.4g} s", position="upper_right", font_size=9)
    _frame(plotter, np.vstack([parts[0][0].points, rest.points]), size)
    try:
        with replacing(goal) as temporary, without_warnings():
            plotter.screenshot(temporary)
    finally:
        plotter.close()
    return goal


def _frame(plotter: Any, points: NDArray[np.float64], size: tuple[int, int]) -> None:
    """Look at points (n, 3) from the front left, a little from above, so that they fill the picture of this size."""
    plotter.view_vector(_VIEW, viewup=_UP, render=False)
    plotter.enable_parallel_projection()
    right = np.cross(_UP, _VIEW)
    up = np.cross(_VIEW, right)
    width, height = (np.ptp(points @ (axis / np.linalg.norm(axis))) for axis in (right, up))
    plotter.camera.parallel_scale = 0.5 * max(height / _FILLED[1], width * size[1] / size[0] / _FILLED[0], 1e-9)
