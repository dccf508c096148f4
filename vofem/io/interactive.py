"""`vofem.io.show`: a window in which a run is looked at from all sides, with a slider for the time."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from vofem._validate import number
from vofem.errors import ArgumentError, OutputError
from vofem.histories.impacts import window_of
from vofem.io.pictures.drawing import COLORMAP
from vofem.io.pictures.units import nice_below
from vofem.io.series.grid import BEAM, MASS
from vofem.io.series.meshes import Meshes, meshes
from vofem.result import Result
from vofem.studies.steady import PeriodicOrbit

#: Times over which the slider moves, and largest displacement that is shown, over the size of the scene.
_TIMES, _SHARE = 401, 0.15

#: Units of the fields. Bodies where a field is zero are white, so the background is not.
_UNITS = {"eta": "m", "velocity": "m/s", "slope": "rad", "bending_moment": "N m", "shear_force": "N", "x": "m"}
_BACKGROUND = "#cfd3da"


def show(
    subject: Result | PeriodicOrbit,
    *,
    window: tuple[float, float] | None = None,
    magnification: float | None = None,
    scalars: str | None = None,
) -> None:
    """Open a window of pyvista with the scene in motion, and a slider for the time.

    Parameters
    ----------
    subject : Result or PeriodicOrbit
    window : (float, float), optional
        Begin and end of the slider in s. The default is the whole run.
    magnification : float, optional
        Factor by which displacements and gaps are enlarged; chosen where not given.
    scalars : str, optional
        The field that is shown in colours, one of `vofem.io.vtk.write_series`; the bending moment where there are
        beams, else the velocity.

    Raises
    ------
    ArgumentError
        If the subject is not a run or an orbit, the window lies outside it, or the field is unknown.
    OutputError
        If there is no display or no graphics driver.
    """
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise OutputError(
            "show: there is no display to open a window on; write a movie with vofem.io.animate, or a picture with "
            "vofem.io.snapshot or vofem.io.render.render, which need none"
        )
    plotter_of(subject, window=window, magnification=magnification, scalars=scalars)[0].show()


def plotter_of(
    subject: Result | PeriodicOrbit,
    *,
    window: tuple[float, float] | None = None,
    magnification: float | None = None,
    scalars: str | None = None,
    off_screen: bool = False,
) -> tuple[Any, Callable[[float], None]]:
    """Return the plotter that `show` opens, with its slider; for plots of one's own.

    Parameters
    ----------
    subject, window, magnification, scalars
        As of `show`.
    off_screen : bool
        Whether it draws without a window.

    Returns
    -------
    plotter : pyvista.Plotter
    move : callable
        The function of the time in s that the slider calls.
    """
    result = run_of("show", subject)
    last = min(float(result.times[-1]), result.solution.t_end)
    begin, end = window_of("show", window, last)
    stored = result.times[(result.times >= begin) & (result.times <= end)]
    times = np.linspace(begin, end, _TIMES) if result.solution.continuous else stored
    if not times.size:
        raise ArgumentError(f"show: the run stored no times from {begin:g} to {end:g} s; choose a longer window")
    frames = frames_of("show", result, times, magnification)
    plotter, shown, parts = stage("show", frames, 0, scalars, off_screen=off_screen)

    def move(t: float) -> None:
        mesh = frames[int(np.argmin(np.abs(times - t)))]
        for part, cells in parts:
            part.points = mesh.points
            part.point_data[shown] = mesh.point_data[shown]
            part.cell_data["contact_state"] = mesh.cell_data["contact_state"][cells]

    plotter.add_slider_widget(
        move, (float(times[0]), float(times[-1])), value=float(times[0]), title="time [s]", fmt="%.4g",
        interaction_event="always", pointa=(0.2, 0.08), pointb=(0.8, 0.08),
    )  # fmt: skip
    plotter.view_xy()
    return plotter, move


def run_of(what: str, subject: Any) -> Result:
    """Return the run that is shown; raise `ArgumentError` if there is none."""
    if not isinstance(subject, (Result, PeriodicOrbit)):
        raise ArgumentError(f"{what}: subject is {subject!r}, expected what simulate or periodic returns")
    return subject.result if isinstance(subject, PeriodicOrbit) else subject


def frames_of(what: str, result: Result, times: Any, magnification: float | None) -> Meshes:
    """Return the frames of a run at some times in s, at a magnification that is chosen where none is given."""
    factor = _magnification(result, times) if magnification is None else number(f"{what}: magnification", magnification)
    return meshes(result, times, magnification=factor)


def stage(
    what: str, frames: Meshes, k: int, scalars: str | None, **options: Any
) -> tuple[Any, str, list[tuple[Any, Any]]]:
    """Return a plotter that shows frame k, the field in colours, and the meshes of the parts with their cells."""
    fault = graphics_fault()
    if fault:
        raise OutputError(f"{what}: {fault}")
    import pyvista

    mesh = frames[k]
    shown = scalars or ("bending_moment" if np.any(mesh.cell_data["kind"] == BEAM) else "velocity")
    if shown not in mesh.point_data:
        raise ArgumentError(f"{what}: scalars is {shown!r}, expected one of {sorted(mesh.point_data.keys())}")
    with without_warnings():
        plotter = pyvista.Plotter(**options)
    plotter.set_background(_BACKGROUND)
    parts = _add(plotter, mesh, shown, _limit(frames, shown))
    plotter.add_text(f"motion shown x{frames.magnification:g}", position="upper_left", font_size=9)
    return plotter, shown, parts


def _add(plotter: Any, mesh: Any, shown: str, limit: float) -> list[tuple[Any, Any]]:
    """Add bodies, coloured by a field, and contacts, coloured by their state; return meshes and their cells."""
    kind = np.asarray(mesh.cell_data["kind"])
    parts = []
    for cells in (np.flatnonzero((kind == BEAM) | (kind == MASS)), np.flatnonzero((kind != BEAM) & (kind != MASS))):
        if not cells.size:
            continue
        part = _some(mesh, cells)
        bodies = kind[cells[0]] in (BEAM, MASS)
        if bodies:
            plotter.add_mesh(
                part, scalars=shown, cmap=COLORMAP, clim=(-limit, limit), line_width=14.0, point_size=26.0,
                render_points_as_spheres=True, render_lines_as_tubes=True,
                scalar_bar_args={
                    "title": f"{shown.replace('_', ' ')} [{_UNITS.get(shown, '-')}]\n", "vertical": False,
                    "position_x": 0.3, "position_y": 0.84, "width": 0.4, "height": 0.13, "fmt": "%.3g",
                },
            )  # fmt: skip
        else:
            plotter.add_mesh(
                part, scalars="contact_state", cmap=["#9aa0aa", "#e07b21", "#b23a48"], clim=(0, 2), line_width=5.0,
                render_lines_as_tubes=True,
                show_scalar_bar=False,
            )  # fmt: skip
        parts.append((part, cells))
    return parts


def _some(mesh: Any, cells: Any) -> Any:
    """Return a mesh of some cells and of all points, so that points can be moved without another search."""
    import pyvista

    listed = [np.asarray(mesh.get_cell(int(k)).point_ids) for k in cells]
    counted = np.concatenate([np.concatenate([[ids.size], ids]) for ids in listed])
    part = pyvista.UnstructuredGrid(counted, np.asarray(mesh.celltypes)[cells], np.asarray(mesh.points).copy())
    for name in mesh.point_data:
        part.point_data[name] = mesh.point_data[name]
    for name in mesh.cell_data:
        part.cell_data[name] = mesh.cell_data[name][cells]
    return part


def _limit(frames: Meshes, shown: str) -> float:
    """Return the largest magnitude of a field, at some of the frames."""
    some = np.unique(np.linspace(0, len(frames) - 1, 60).round().astype(int))
    values = [np.nanmax(np.abs(np.append(np.nan_to_num(frames[int(k)].point_data[shown]), 0.0))) for k in some]
    return float(max(values)) or 1.0


def _magnification(result: Result, times: Any) -> float:
    """Return the magnification at which the largest displacement is a fair share of the scene; 1 without beams."""
    size = max((float(np.ptp(body.shape.x)) for body in result.scene.bodies), default=0.0)
    peak = max(float(np.max(np.abs(result.along_shape(body, times)))) for body in result.scene.bodies)
    return nice_below(_SHARE * size / peak) if size and peak else 1.0


def graphics_fault() -> str:
    """Return why VTK cannot draw without a window here, and what would help; "" where it can.

    VTK crashes if it draws into a window for which it has found no driver.
    """
    from vtkmodules import vtkRenderingOpenGL2  # noqa: F401, without it there are no windows
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    with without_warnings():
        window = vtkRenderWindow()
        window.SetOffScreenRendering(1)
        window.Initialize()
        found = bool(window.GetInitialized())
        window.Finalize()
    if found:
        return ""
    cure = "install a graphics driver with OpenGL 3.2 or later"
    if sys.platform.startswith("linux"):
        cure = "on Debian and Ubuntu, apt-get install libegl1 libgl1-mesa-dri"
    return f"VTK finds no graphics driver to draw with; {cure}"


@contextlib.contextmanager
def without_warnings() -> Iterator[None]:
    """Keep warnings of VTK from the terminal: without a display it tells of each driver that it tries in turn."""
    import pyvista

    with pyvista.vtk_verbosity("off"):
        yield
