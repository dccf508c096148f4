"""What the frames of a movie show: side views, histories and phase portraits, one picture for each time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vofem.bodies.base import Point
from vofem.io.pictures.backend_pillow import pixels
from vofem.io.pictures.layout import arrange
from vofem.io.pictures.sketch import sketch
from vofem.io.pictures.snapshot import Snapshot, snapshots
from vofem.io.pictures.units import length
from vofem.result import Result

Array = NDArray[np.float64]
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

    Parameters
    ----------
    states : list of Snapshot
    size : (int, int)
        Width and height in pixels.
    magnification : float, optional
        Factor by which displacements are enlarged.
    title : str
        Stands before the time.
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
            yield pixels(sketch(state, self._size, self._wanted, forces=True, title=self._title))


def side_view(
    result: Result, times: Array, size: tuple[int, int], magnification: float | None, title: str = ""
) -> SideView:
    """Return side views of a run at some times in s."""
    return SideView(snapshots(result, times), size, magnification, title)


class _AxesView:
    """A view with axes: the whole motion is drawn once, and what moves over it for every frame."""

    def __init__(self, size: tuple[int, int]) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=(size[0] / _DPI, size[1] / _DPI), dpi=_DPI, layout="constrained", facecolor="white")
        self._canvas = FigureCanvasAgg(figure)
        self.axes = figure.add_subplot()
        self.axes.grid(color="#e3e5e9", linewidth=0.7)
        self.axes.set_axisbelow(True)
        self._moving: list[Any] = []

    def moving(self, artist: Any) -> Any:
        """Keep an artist for every frame."""
        artist.set_animated(True)
        self._moving.append(artist)
        return artist

    def frames(self) -> Iterator[Frame]:
        """Yield the pictures in order."""
        self._canvas.draw()
        background = self._canvas.copy_from_bbox(self.axes.figure.bbox)
        for k in range(self.count()):
            self.move(k)
            self._canvas.restore_region(background)
            for artist in self._moving:
                self.axes.draw_artist(artist)
            yield np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def count(self) -> int:
        """Return the number of frames."""
        raise NotImplementedError

    def move(self, k: int) -> None:
        """Put what moves to its place in a frame."""
        raise NotImplementedError


class HistoryView(_AxesView):
    """The displacement of a point over time, drawn as it happens; shaded while a contact of the scene is closed."""

    def __init__(
        self, result: Result, point: Point, times: Array, window: tuple[float, float], size: tuple[int, int], title: str
    ) -> None:
        super().__init__(size)
        dense = _whole(result, window)
        motion = result.displacement(point, dense)
        factor, unit = length(float(np.max(np.abs(motion), initial=0.0)))
        self._times, self._dense, self._motion = times, dense, motion / factor
        self._now = result.displacement(point, times) / factor
        self.axes.plot(dense, motion / factor, color=_SHADE, linewidth=1.2)
        for history in result.contacts.values():
            ends = np.append(history.openings, window[1])
            for start, end in zip(history.closings, ends, strict=False):
                if end >= window[0] and start <= window[1]:
                    self.axes.axvspan(start, end, color=_DOT, alpha=0.12, linewidth=0)
        self._line = self.moving(self.axes.plot([], [], color=_LINE, linewidth=1.6)[0])
        self._dot = self.moving(self.axes.plot([], [], "o", color=_DOT, markersize=8)[0])
        self.axes.set(xlabel="time [s]", ylabel=f"displacement [{unit}]", xlim=window)
        self.axes.set_title(title or point.describe(), fontsize=11)

    def count(self) -> int:
        """Return the number of frames."""
        return int(self._times.size)

    def move(self, k: int) -> None:
        """Draw the past up to a frame."""
        t = self._times[k]
        past = self._dense < t
        self._line.set_data(np.append(self._dense[past], t), np.append(self._motion[past], self._now[k]))
        self._dot.set_data([t], [self._now[k]])


class PhaseView(_AxesView):
    """Velocity over displacement of a point, drawn as it happens."""

    def __init__(
        self, result: Result, point: Point, times: Array, window: tuple[float, float], size: tuple[int, int], title: str
    ) -> None:
        super().__init__(size)
        dense = _whole(result, window)
        u, v = result.displacement(point, dense), result.velocity(point, dense)
        factor, unit = length(float(np.max(np.abs(u), initial=0.0)))
        self._times, self._dense, self._path = times, dense, np.stack([u, v]) / factor
        self._now = np.stack([result.displacement(point, times), result.velocity(point, times)]) / factor
        self.axes.plot(*self._path, color=_SHADE, linewidth=1.0)
        self._line = self.moving(self.axes.plot([], [], color=_LINE, linewidth=1.4)[0])
        self._dot = self.moving(self.axes.plot([], [], "o", color=_DOT, markersize=8)[0])
        self.axes.set(xlabel=f"displacement [{unit}]", ylabel=f"velocity [{unit}/s]")
        self.axes.set_title(title or point.describe(), fontsize=11)

    def count(self) -> int:
        """Return the number of frames."""
        return int(self._times.size)

    def move(self, k: int) -> None:
        """Draw the past up to a frame."""
        past = self._dense < self._times[k]
        self._line.set_data(*(np.append(part[past], now[k]) for part, now in zip(self._path, self._now, strict=True)))
        self._dot.set_data(self._now[:1, k], self._now[1:, k])


def _whole(result: Result, window: tuple[float, float]) -> Array:
    """Return times at which the whole motion of a window is drawn."""
    if result.solution.continuous:
        return np.linspace(*window, _DENSE)
    return result.times[(result.times >= window[0]) & (result.times <= window[1])]
