"""`vofem.io.animate`: a run, a periodic orbit or a mode shape as a movie."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem._validate import choice, number, whole
from vofem.arrays import Array
from vofem.bodies.base import as_point
from vofem.errors import ArgumentError
from vofem.files.whole import replacing, target
from vofem.histories.impacts import window_of
from vofem.histories.tables import points_of_interest
from vofem.io.movies.views import AxesView, SideView, SpaceView, View, mode_snapshots, side_view
from vofem.io.movies.writing import SUFFIXES, check, true_rate, write
from vofem.io.pictures.histories import end_of
from vofem.progress import Progress, TerminalBar
from vofem.result import Result
from vofem.scene import Scene
from vofem.studies.steady import PeriodicOrbit
from vofem.vibration import Modes

Frame = NDArray[np.uint8]

VIEWS = ("side", "history", "phase", "space")

_SIZES = {"side": (960, 420), "history": (800, 420), "phase": (560, 480), "space": (960, 480)}

#: Frames where neither their number nor the speed is given, and most frames.
_FRAMES, _MOST = 150, 3000

#: Frames of a mode shape or a periodic orbit, which are shown once and then again.
_LOOP = 50


@dataclass(frozen=True)
class MovieOutcome:
    """What was written.

    Attributes
    ----------
    path : Path
    frames : int
    fps : float
        Frames per second.
    speed : float
        Seconds of the motion that pass in a second of the movie; of a mode shape periods.
    """

    path: Path
    frames: int
    fps: float
    speed: float

    @property
    def seconds(self) -> float:
        """Duration of the movie, s."""
        return self.frames / self.fps


def animate(
    subject: Result | PeriodicOrbit | Modes | Mapping[str, Result | PeriodicOrbit],
    path: str | os.PathLike[str],
    view: str = "side",
    *,
    point: Any = None,
    window: tuple[float, float] | None = None,
    speed: float | None = None,
    frames: int | None = None,
    fps: float = 25.0,
    size: tuple[int, int] | None = None,
    magnification: float | None = None,
    mode: int = 0,
    scene: Scene | None = None,
    progress: Progress = None,
) -> MovieOutcome:
    """Write a movie of a run, of a periodic orbit or of a mode shape.

    In side views contacts are highlighted while they are closed, and arrows show the contact forces. A periodic
    orbit and a mode shape are shown over one period, so that the repeated movie has no jump.

    Parameters
    ----------
    subject : Result, PeriodicOrbit or Modes, or mapping of titles to Results or PeriodicOrbits
        What is shown. If there are several, they are shown at the same times, with side views and histories one below
        the other.
    path : path of a .webp, .gif or .mp4
        mp4 needs the extra ``vofem[movie]``. WebP files are smaller than GIF files, and browsers show both.
    view : str
        "side"; "history", the displacement of a point over time; "phase", its velocity over its displacement; or
        "space", the structure in three dimensions, which needs a graphics driver.
    point : point, optional
        The point whose history or phase plot is shown. The default is the point of the first contact.
    window : (float, float), optional
        Begin and end of the time that is drawn, in s. The default is the whole run.
    speed : float, optional
        Seconds of the motion that are shown in one second of the movie. 1 is real time, and 0.1 is ten times slower.
    frames : int, optional
        Number of frames, instead of `speed`. If neither is given, there are 150 frames, or 50 for an orbit or a mode
        shape.
    fps : float
        Frames per second. GIF rounds their duration to 0.01 s.
    size : (int, int), optional
        Width and height of the picture of one run, pixels.
    magnification : float, optional
        Factor by which displacements are enlarged. By default one factor is chosen for the side views of all runs, and
        in three dimensions one for each run.
    mode : int
        Number of the mode shape, counted from 0.
    scene : Scene, optional
        The scene of mode shapes. With it, springs, dashpots and joints are shown too.
    progress : bool or callable, optional
        True shows a progress bar and False shows none. None shows it if the standard error stream is a terminal. A
        function is called with the number of frames that are written and the total number of frames.

    Returns
    -------
    MovieOutcome

    Raises
    ------
    ArgumentError
        If the subject cannot be shown in this view, the window lies outside the run, or there are more frames than 3000
        or than stored times of a stepping method.
    MissingPackageError
        If a package that the kind of file needs is missing.
    OutputError
        If there is no graphics driver for the view "space", or the file cannot be written. An earlier file of that name
        stays as it was, after Ctrl-C too.

    Examples
    --------
    ``animate(result, "run.gif")``; ``animate(orbit, "orbit.webp", "phase")``;
    ``animate({"soft": a, "stiff": b}, "both.webp", speed=0.5)``; ``animate(vf.modes(scene), "mode.gif", scene=scene)``.
    """
    goal = target(path, SUFFIXES)
    suffix = goal.suffix.lower()
    check(suffix)
    view = choice("animate: view", view, VIEWS)
    rate = true_rate(suffix, number("animate: fps", fps, positive=True))
    if speed is not None and frames is not None:
        raise ArgumentError("animate: give speed or frames, not both")
    if frames is not None:
        frames = whole("animate: frames", frames, least=2)
    if speed is not None:
        speed = number("animate: speed", speed, positive=True)
    shown = size or _SIZES[view]
    if isinstance(subject, Modes):
        if view != "side":
            raise ArgumentError(f"animate: mode shapes have no {view!r} view; choose view='side'")
        count = _count(1.0, speed, frames, rate, _LOOP)
        views: list[View] = [SideView(mode_snapshots(subject, mode, scene, count), shown, magnification)]
        length = 1.0
    else:
        views, count, length = _of_runs(subject, view, point, window, (speed, frames, rate), shown, magnification)
    pictures = _together(views, across=view == "phase")
    label = "animate", "the number of frames done and that of all"
    with (
        replacing(goal) as temporary,
        TerminalBar(label, progress, count, "frame {task.completed:.0f} of {task.total:.0f}") as bar,
    ):
        write(_reported(pictures, bar, count), temporary, suffix, rate)
    return MovieOutcome(goal, count, rate, length * rate / count)


def _of_runs(
    subject: Any, view: str, point: Any, window: Any, timing: tuple[float | None, int | None, float],
    size: tuple[int, int], magnification: float | None,
) -> tuple[list[View], int, float]:  # fmt: skip
    """Return the views of all runs, the number of frames, and the time that they show, s."""
    named = dict(subject) if isinstance(subject, Mapping) else {"": subject}
    if not named or not all(isinstance(one, (Result, PeriodicOrbit)) for one in named.values()):
        raise ArgumentError(
            f"animate: subject is {subject!r}, expected what simulate, periodic or modes returns, or a mapping of "
            "titles to runs or orbits"
        )
    repeats = all(isinstance(one, PeriodicOrbit) for one in named.values()) and window is None
    runs = {title: one.result if isinstance(one, PeriodicOrbit) else one for title, one in named.items()}
    begin, end = window_of("animate", window, min(map(end_of, runs.values())))
    count = _count(end - begin, *timing, _LOOP if repeats else _FRAMES)
    times = np.linspace(begin, end, count, endpoint=not repeats)
    views: list[View] = []
    for title, run in runs.items():
        at = _known(run, times)
        if view == "side":
            views.append(side_view(run, at, size, magnification, title))
        elif view == "space":
            views.append(SpaceView(run, at, size, magnification))
        else:
            place = as_point("animate: point", point or points_of_interest(run.scene)[0])
            views.append(AxesView(run, place, at, (begin, end), size, title, view == "phase"))
    sides = [one for one in views if isinstance(one, SideView) and one.magnification is not None]
    if len(sides) > 1 and magnification is None:
        least = min(one.magnification for one in sides if one.magnification is not None)
        views = [one.with_magnification(least) if one in sides else one for one in views]
    return views, count, end - begin


def _count(length: float, speed: float | None, frames: int | None, rate: float, usual: int) -> int:
    """Return the number of frames."""
    count = frames or (usual if speed is None else max(2, round(length / speed * rate)))
    if count > _MOST:
        raise ArgumentError(
            f"animate: {count} frames, expected at most {_MOST}; choose a shorter window, fewer frames, a lower fps "
            "or a higher speed"
        )
    return count


def _known(run: Result, times: Array) -> Array:
    """Return the times at which a run is shown: of a stepping method the nearest that it has stored."""
    if run.solution.continuous:
        return times
    stored = run.times[run.times <= run.solution.t_end]
    near = stored[np.argmin(np.abs(stored[:, None] - times), axis=0)]
    if np.unique(near).size < times.size:
        raise ArgumentError(
            f"animate: the run stored {stored.size} times, which do not give {times.size} different frames; ask for "
            "fewer frames=, a longer window, or name more times in times= when simulating"
        )
    return near


def _together(views: list[View], across: bool) -> Iterator[Frame]:
    """Yield the pictures of all views at the same time as one."""
    for parts in zip(*(view.frames() for view in views), strict=True):
        yield parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1 if across else 0)


def _reported(pictures: Iterator[Frame], bar: TerminalBar, count: int) -> Iterator[Frame]:
    """Yield pictures, and say how many there were."""
    for k, picture in enumerate(pictures, start=1):
        yield picture
        bar.update(k, report=(k, count))
