"""The deflected structure in three dimensions: a window with a slider for the time, and pictures without a window."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem._validate import number
from vofem.arrays import Array
from vofem.errors import ArgumentError, OutputError
from vofem.files.whole import writer
from vofem.histories.impacts import window_of
from vofem.io.frames import BEAM, MASS, Frames
from vofem.io.pictures.drawing import COLORMAP
from vofem.io.pictures.histories import end_of, times_of
from vofem.io.pictures.layout import picture_size
from vofem.io.pictures.units import nice_below
from vofem.result import Result
from vofem.studies.steady import PeriodicOrbit

#: Times over which the slider moves, and by which a scale of colours is chosen; largest displacement that is shown,
#: over the size of the scene.
_TIMES, _SOME, _SHARE = 401, 61, 0.15

#: Of a snapshot: the direction to the eye, the direction that is up, and the shares of width and height that the
#: structure may fill.
_VIEW, _UP, _FILLED = (-0.35, 0.3, 1.0), (0.0, 1.0, 0.0), (0.85, 0.6)

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
        The field that is shown in colours, one of `vofem.Result.frame`; the bending moment where there are beams, else
        the velocity.

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
    result = _run_of("show", subject)
    begin, end = window_of("show", window, end_of(result))
    times = times_of(result, begin, end, _TIMES)
    if not times.size:
        raise ArgumentError(f"show: the run stored no times from {begin:g} to {end:g} s; choose a longer window")
    stage = Stage("show", result, times, 0, magnification, scalars, off_screen=off_screen)

    def move(t: float) -> None:
        stage.move(float(times[np.argmin(np.abs(times - t))]))

    stage.plotter.add_slider_widget(
        move, (float(times[0]), float(times[-1])), value=float(times[0]), title="time [s]", fmt="%.4g",
        interaction_event="always", pointa=(0.2, 0.08), pointb=(0.8, 0.08),
    )  # fmt: skip
    stage.plotter.view_xy()
    return stage.plotter, move


@writer(".png")
def snapshot(
    subject: Result | PeriodicOrbit,
    t: float,
    path: str | os.PathLike[str],
    *,
    size: tuple[int, int] = (1200, 600),
    magnification: float | None = None,
    scalars: str | None = None,
) -> None:
    """Draw the deflected structure at time t in three dimensions, as ParaView shows a saved run.

    It needs a graphics driver, but no display. `vofem.io.render.render` needs neither.

    Parameters
    ----------
    subject : Result or PeriodicOrbit
    t : float
        Time in s, within the run.
    size : (int, int)
        Width and height in pixels.
    magnification : float, optional
        Factor by which displacements and gaps are enlarged; chosen where not given.
    scalars : str, optional
        The field that is shown in colours, one of `vofem.Result.frame`; the bending moment where there are beams, else
        the velocity.

    Raises
    ------
    ArgumentError
        If the subject is not a run or an orbit, the time lies outside it, or the field is unknown.
    OutputError
        If there is no graphics driver.
    """
    result, size = _run_of("snapshot", subject), picture_size(size)
    t, end = number("snapshot: t", t), end_of(result)
    if not 0.0 <= t <= end:
        raise ArgumentError(f"snapshot: t is {t:g}, expected a time of the run, 0 to {end:g} s")
    times = np.append(times_of(result, 0.0, end, _SOME), t)
    stage = Stage("snapshot", result, times, -1, magnification, scalars, off_screen=True, window_size=size)
    stage.plotter.add_mesh(stage.rest, color="white", line_width=3.0, point_size=8.0)
    stage.tell(t)
    stage.look(size, times[-1:])
    try:
        with _without_warnings():
            stage.plotter.screenshot(path)
    finally:
        stage.plotter.close()


class Stage:
    """A plotter with the frame of one time: bodies coloured by a field, contacts coloured by their state.

    `what`: the function that draws, for messages.
    `times`: times by which the magnification and the scale of colours are chosen, s.
    `k`: number of the time that is shown first.
    `magnification`, `scalars`: as of `show`.
    `options`: of the plotter.
    """

    def __init__(
        self, what: str, result: Result, times: Array, k: int, magnification: float | None, scalars: str | None,
        **options: Any,
    ) -> None:  # fmt: skip
        fault = graphics_fault()
        if fault:
            raise OutputError(f"{what}: {fault}")
        import pyvista

        factor = _magnification(result, times) if magnification is None else magnification
        self._frames = Frames(result, number(f"{what}: magnification", factor, positive=True))
        still = self._frames.at(float(times[k]))
        kind = still.cell_data["kind"]
        self._shown = scalars or ("bending_moment" if np.any(kind == BEAM) else "velocity")
        if self._shown not in still.point_data:
            known = sorted(still.point_data.keys())
            raise ArgumentError(f"{what}: scalars is {self._shown!r}, expected one of {known}")
        self.rest = still.extract_cells(np.flatnonzero(kind <= MASS))
        mesh = self._moved(still)
        self._bodies, self._links = (mesh.extract_cells(np.flatnonzero(part)) for part in (kind <= MASS, kind > MASS))
        with _without_warnings():
            self.plotter = pyvista.Plotter(**options)
        self.plotter.set_background(_BACKGROUND)
        some = times[np.unique(np.linspace(0, times.size - 1, _SOME).round().astype(int))]
        values = [np.nan_to_num(data[self._shown]) for _, data, _ in self._frames.blocks(some) if self._shown in data]
        limit = max((float(np.max(np.abs(part))) for part in values), default=0.0) or 1.0
        self.plotter.add_mesh(
            self._bodies, scalars=self._shown, cmap=COLORMAP, clim=(-limit, limit), line_width=14.0, point_size=26.0,
            render_points_as_spheres=True, render_lines_as_tubes=True,
            scalar_bar_args={
                "title": f"{self._shown.replace('_', ' ')} [{_UNITS.get(self._shown, '-')}]\n", "vertical": False,
                "position_x": 0.3, "position_y": 0.84, "width": 0.4, "height": 0.13, "fmt": "%.3g",
            },
        )  # fmt: skip
        if self._links.n_cells:
            self.plotter.add_mesh(
                self._links, scalars="contact_state", cmap=["#9aa0aa", "#e07b21", "#b23a48"], clim=(0, 2),
                line_width=5.0, render_lines_as_tubes=True, show_scalar_bar=False,
            )  # fmt: skip
        self.plotter.add_text(f"motion shown x{factor:g}", position="upper_left", font_size=9)

    def _moved(self, frame: Any) -> Any:
        return frame.warp_by_vector("deflection", factor=self._frames.magnification)

    def move(self, t: float) -> None:
        """Show the frame at time t in s."""
        mesh = self._moved(self._frames.at(t))
        for part in (self._bodies, self._links):
            points, cells = part.point_data["vtkOriginalPointIds"], part.cell_data["vtkOriginalCellIds"]
            part.points = mesh.points[points]
            part.point_data[self._shown] = mesh.point_data[self._shown][points]
            part.cell_data["contact_state"] = mesh.cell_data["contact_state"][cells]

    def tell(self, t: float) -> None:
        """Write the time in s."""
        self.plotter.add_text(f"t = {t:.4g} s", position="upper_right", font_size=9, name="time", render=False)

    def pixels(self) -> NDArray[np.uint8]:
        """Return what is shown as colours of pixels, shape (height, width, 3)."""
        with _without_warnings():
            self.plotter.render()
            return np.array(self.plotter.screenshot(None, return_img=True))

    def look(self, size: tuple[int, int], times: Array) -> None:
        """Look from the front left, a little from above, so that all parts stay within a picture of this size."""
        points = np.vstack([self._frames.points, *(self._moved(frame).points for frame in self._frames.over(times))])
        self.plotter.view_vector(_VIEW, viewup=_UP, render=False)
        self.plotter.enable_parallel_projection()
        right = np.cross(_UP, _VIEW)
        up = np.cross(_VIEW, right)
        width, height = (np.ptp(points @ (axis / np.linalg.norm(axis))) for axis in (right, up))
        scale = 0.5 * max(height / _FILLED[1], width * size[1] / size[0] / _FILLED[0], 1e-9)
        self.plotter.camera.parallel_scale = scale


def _run_of(what: str, subject: Any) -> Result:
    """Return the run that is shown; raise `ArgumentError` if there is none."""
    if not isinstance(subject, (Result, PeriodicOrbit)):
        raise ArgumentError(f"{what}: subject is {subject!r}, expected what simulate or periodic returns")
    return subject.result if isinstance(subject, PeriodicOrbit) else subject


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

    with _without_warnings():
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
def _without_warnings() -> Iterator[None]:
    """Keep warnings of VTK from the terminal: without a display it tells of each driver that it tries in turn."""
    import pyvista

    with pyvista.vtk_verbosity("off"):
        yield
