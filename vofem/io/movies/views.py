"""What the frames of a movie show: side views, histories and phase portraits, one picture for each time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.bodies import Beam
from vofem.bodies.base import Point
from vofem.errors import ArgumentError
from vofem.io.pictures.histories import closed_intervals, times_of
from vofem.io.pictures.layout import arrange
from vofem.io.pictures.sketch import sketch
from vofem.io.pictures.snapshot import BodyState, Snapshot, fixed_parts, snapshots
from vofem.io.pictures.units import length
from vofem.io.space import Stage
from vofem.result import Result
from vofem.scene import Scene, as_scene
from vofem.vibration import Modes

Frame = NDArray[np.uint8]

#: Times over which the whole motion is drawn behind the present one.
_DENSE = 2001

#: Pixels per inch of views with axes.
_DPI = 100.0

_SHADE, _LINE, _DOT = "#c9ccd2", "#16181d", "#e07b21"


class View(Protocol):
    """A picture for each of some times."""

    def frames(self) -> Iterator[Frame]:
        """Yield the pictures in order, each of shape (height, width, 3)."""


class SideView:
    """Side views of a scene.

    `size`: width and height in pixels.
    `magnification`: factor by which displacements are enlarged.
    `title`: stands before the time.
    """

    def __init__(
        self, states: list[Snapshot], size: tuple[int, int], magnification: float | None, title: str = ""
    ) -> None:
        self._states, self._size, self._title = states, size, title
        self.magnification = arrange(states[0], size, magnification).magnification
        self._wanted = magnification if self.magnification is None else self.magnification

    def with_magnification(self, magnification: float) -> SideView:
        """Return the same view with another magnification."""
        return SideView(self._states, self._size, magnification, self._title)

    def frames(self) -> Iterator[Frame]:
        """Yield the pictures in order."""
        for state in self._states:
            yield sketch(state, self._size, self._wanted, forces=True, title=self._title).pixels()


def side_view(
    result: Result, times: Array, size: tuple[int, int], magnification: float | None, title: str = ""
) -> SideView:
    """Return side views of a run at some times in s."""
    return SideView(snapshots(result, times), size, magnification, title)


class SpaceView:
    """The structure in three dimensions, drawn by VTK without a window."""

    def __init__(self, result: Result, times: Array, size: tuple[int, int], magnification: float | None) -> None:
        self._times = times
        self._stage = Stage("animate", result, times, 0, magnification, None, off_screen=True, window_size=size)
        self._stage.look(size, times)

    def frames(self) -> Iterator[Frame]:
        """Yield the pictures in order."""
        try:
            for t in self._times.tolist():
                self._stage.move(t)
                self._stage.tell(t)
                yield self._stage.pixels()
        finally:
            self._stage.plotter.close()


class AxesView:
    """The motion of a point, drawn as it happens: the whole motion once, and for every frame its past and the present.

    Displacement over time, with closed contacts of the scene shaded, or velocity over displacement (`phase`).
    """

    def __init__(
        self, result: Result, point: Point, times: Array, window: tuple[float, float], size: tuple[int, int],
        title: str, phase: bool,
    ) -> None:  # fmt: skip
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=(size[0] / _DPI, size[1] / _DPI), dpi=_DPI, layout="constrained", facecolor="white")
        self._canvas = FigureCanvasAgg(figure)
        self._axes = axes = figure.add_subplot()
        axes.grid(color="#e3e5e9", linewidth=0.7)
        axes.set_axisbelow(True)
        self._times, self._dense = times, times_of(result, *window, _DENSE)
        factor, unit = length(float(np.max(np.abs(result.displacement(point, self._dense)), initial=0.0)))

        def curve(at: Array) -> Array:
            u = result.displacement(point, at) / factor
            return np.stack([u, result.velocity(point, at) / factor] if phase else [at, u])

        #: Abscissa and ordinate of the curve, at the times at which it is drawn, and at those of the frames.
        self._path, self._now = curve(self._dense), curve(times)
        if phase:
            axes.set(xlabel=f"displacement [{unit}]", ylabel=f"velocity [{unit}/s]")
        else:
            for name in result.contacts:
                for start, end in closed_intervals(result, name):
                    if end >= window[0] and start <= window[1]:
                        axes.axvspan(start, end, color=_DOT, alpha=0.12, linewidth=0)
            axes.set(xlabel="time [s]", ylabel=f"displacement [{unit}]", xlim=window)
        axes.plot(*self._path, color=_SHADE, linewidth=1.1)
        self._line = axes.plot([], [], color=_LINE, linewidth=1.5, animated=True)[0]
        self._dot = axes.plot([], [], "o", color=_DOT, markersize=8, animated=True)[0]
        axes.set_title(title or point.describe(), fontsize=11)

    def frames(self) -> Iterator[Frame]:
        """Yield the pictures in order."""
        self._canvas.draw()
        background = self._canvas.copy_from_bbox(self._axes.figure.bbox)
        for t, now in zip(self._times, self._now.T, strict=True):
            past = self._dense < t
            self._line.set_data(*(np.append(part[past], end) for part, end in zip(self._path, now, strict=True)))
            self._dot.set_data(now[:1], now[1:])
            self._canvas.restore_region(background)
            self._axes.draw_artist(self._line)
            self._axes.draw_artist(self._dot)
            yield np.asarray(self._canvas.buffer_rgba())[..., :3].copy()


#: Largest displacement that is shown, over the length of the scene.
_SHARE = 0.05

#: Points along a beam.
_POINTS = 241


def mode_snapshots(modes: Modes, number: int, scene: Scene | None, count: int) -> list[Snapshot]:
    """Return a mode shape at `count` equal parts of its period.

    Its size is arbitrary: the largest displacement is shown as a twentieth of the longest beam.

    Raises `ArgumentError` for a number that there is no mode of, and for a scene of other bodies.
    """
    if isinstance(number, bool) or not isinstance(number, (int, np.integer)) or not 0 <= number < modes.omega.size:
        raise ArgumentError(f"animate: mode is {number!r}, expected 0 to {modes.omega.size - 1}")
    bodies = modes.bodies
    if scene is not None and {*as_scene("animate", scene).bodies} != {*bodies}:
        names, others = ([body.name for body in some] for some in (bodies, scene.bodies))
        raise ArgumentError(
            f"animate: the mode shapes are those of the bodies {names}, and the scene has others, {others}; give the "
            "scene of which vofem.modes found them"
        )
    places = {b: np.linspace(b.nodes[0], b.nodes[-1], _POINTS) if isinstance(b, Beam) else b.shape.x for b in bodies}
    shapes = {b: modes.shape(number, places[b] if isinstance(b, Beam) else None, b) for b in bodies}
    largest = max(float(np.max(np.abs(shape), initial=0.0)) for shape in shapes.values())
    length = max(float(np.ptp(body.shape.x)) for body in bodies) or 1.0
    scale = _SHARE * length / largest if largest else 0.0
    title = f"mode {number + 1}: {modes.frequencies[number]:.4g} Hz"
    still = Snapshot(None, (), (), title=title) if scene is None else replace(fixed_parts(scene), title=title)
    found = []
    for turn in np.arange(count) / count:
        states = []
        for body in bodies:
            eta = scale * shapes[body]
            extent, nothing, depth = float(np.max(np.abs(eta), initial=0.0)), np.zeros(eta.size), np.ones(eta.size)
            now = eta * np.cos(2.0 * np.pi * turn)
            states.append(BodyState(body, places[body], now, nothing, depth, -extent, extent, 0.0, 0.0))
        found.append(replace(still, bodies=tuple(states)))
    return found
