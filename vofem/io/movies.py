"""Movies of runs, periodic orbits and mode shapes: what their frames show, and how these become WebP, GIF or mp4."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem._validate import choice, number, whole
from vofem.arrays import Array
from vofem.bodies import Beam
from vofem.bodies.base import Point, as_point
from vofem.errors import ArgumentError, MissingPackageError
from vofem.files.whole import replacing, target
from vofem.histories.impacts import window_of
from vofem.histories.tables import points_of_interest
from vofem.io.pictures import drawing, links
from vofem.io.pictures.histories import closed_intervals, end_of, times_of
from vofem.io.pictures.layout import arrange, picture_size
from vofem.io.pictures.sketch import sketch
from vofem.io.pictures.snapshot import BodyState, Snapshot, fixed_parts, snapshots
from vofem.io.pictures.units import length
from vofem.io.space import Stage
from vofem.progress import Progress, TerminalBar
from vofem.result import Result
from vofem.scene import Scene, as_scene
from vofem.studies.steady import PeriodicOrbit
from vofem.vibration import Modes

Frame = NDArray[np.uint8]

#: Suffixes of movies.
SUFFIXES = (".webp", ".gif", ".mp4")

#: Shades of every colour of a picture towards white in the palette of a GIF, and colours of bending moments.
_SHADES, _MOMENTS = 8, 64

#: GIF counts time in hundredths of a second, and players take less than two of them for ten.
_GIF_TICK, _GIF_FEWEST = 100.0, 2


def true_rate(suffix: str, fps: float) -> float:
    """Return the frames per second that a movie of this kind will have: GIF rounds their duration to 0.01 s."""
    return _GIF_TICK / max(_GIF_FEWEST, round(_GIF_TICK / fps)) if suffix == ".gif" else fps


def check(suffix: str) -> None:
    """Raise `MissingPackageError` where a movie of this kind cannot be written here."""
    if suffix == ".mp4":
        _ffmpeg()
    elif suffix == ".webp":
        from PIL import features

        if not features.check("webp"):
            raise MissingPackageError(
                "animate: this Pillow cannot write WebP; install another one with python -m pip install -U pillow, or "
                "choose a path that ends in .gif"
            )


def write(frames: Iterable[Frame], path: Path, suffix: str, fps: float) -> None:
    """Write frames, each of shape (height, width, 3), to a file.

    `path`: where they are written; its own suffix does not matter.
    `suffix`: one of `SUFFIXES`.
    `fps`: frames per second.
    """
    if suffix == ".mp4":
        _write_mp4(iter(frames), path, fps)
    else:
        _write_images(iter(frames), path, suffix, fps)


def _write_images(frames: Iterator[Frame], path: Path, suffix: str, fps: float) -> None:
    """Write frames by Pillow."""
    from PIL import Image

    shown = (Image.fromarray(frame) for frame in frames)
    options: dict[str, Any] = {"format": "WEBP", "quality": 80, "method": 2}
    if suffix == ".gif":
        # One palette for all frames: with palettes of their own, flat areas would flicker.
        palette = _palette()
        shown = (image.quantize(palette=palette, dither=Image.Dither.NONE) for image in shown)
        options = {"format": "GIF", "disposal": 1}
    duration = round(1000.0 / true_rate(suffix, fps))
    with path.open("wb") as file:
        next(shown).save(file, save_all=True, append_images=shown, duration=duration, loop=0, **options)


def _palette() -> Any:
    """Return an image whose palette holds the colours of side views in shades towards white, and those of moments."""
    from matplotlib import colormaps
    from matplotlib.colors import to_rgb
    from PIL import Image

    shades = np.linspace(0.0, 1.0, _SHADES, endpoint=False)[:, None]
    named = [(1.0 - shades) * np.array(to_rgb(name)) + shades for name in (*drawing.PALETTE, links.LOAD, links.GLOW)]
    moments = colormaps[drawing.COLORMAP](np.linspace(0.0, 1.0, _MOMENTS))[:, :3]
    image = Image.new("P", (1, 1))
    image.putpalette(np.round(255.0 * np.concatenate([np.ones((1, 3)), *named, moments])).astype(np.uint8).tobytes())
    return image


def _write_mp4(frames: Iterator[Frame], path: Path, fps: float) -> None:
    first = _even(next(frames))
    writer = _ffmpeg().write_frames(
        str(path), first.shape[1::-1], fps=fps, codec="libx264", macro_block_size=2, quality=7,
        output_params=["-f", "mp4", "-movflags", "+faststart"],
    )  # fmt: skip
    writer.send(None)
    try:
        writer.send(np.ascontiguousarray(first))
        for frame in frames:
            writer.send(np.ascontiguousarray(_even(frame)))
    finally:
        writer.close()


def _even(frame: Frame) -> Frame:
    """Return a frame with even numbers of rows and columns, which the encoder needs."""
    return frame[: frame.shape[0] // 2 * 2, : frame.shape[1] // 2 * 2]


def _ffmpeg() -> Any:
    try:
        return importlib.import_module("imageio_ffmpeg")
    except ImportError as error:
        raise MissingPackageError(
            f"animate: mp4 needs the package imageio-ffmpeg, which cannot be imported ({error}); install it with "
            "python -m pip install 'vofem[movie]', or choose a path that ends in .webp or .gif"
        ) from error


#: Times over which the whole motion is drawn behind the present one.
_DENSE = 2001

#: Pixels per inch of views with axes.
_DPI = 100.0

_SHADE, _LINE, _DOT = "#c9ccd2", "#16181d", "#e07b21"


def side_frames(
    states: list[Snapshot], size: tuple[int, int], magnification: float | None, title: str = ""
) -> Iterator[Frame]:
    """Yield side views of a scene; `title` stands before the time."""
    for state in states:
        yield sketch(state, size, magnification, forces=True, title=title).pixels()


def _space_frames(result: Result, times: Array, size: tuple[int, int], magnification: float | None) -> Iterator[Frame]:
    """Yield the structure in three dimensions, drawn by VTK without a window."""
    stage = Stage("animate", result, times, 0, magnification, None, off_screen=True, window_size=size)
    try:
        stage.look(size, times)
        for t in times.tolist():
            stage.move(t)
            stage.tell(t)
            yield stage.pixels()
    finally:
        stage.plotter.close()


def _axes_frames(
    result: Result, point: Point, times: Array, window: tuple[float, float], size: tuple[int, int], title: str,
    phase: bool,
) -> Iterator[Frame]:  # fmt: skip
    """Yield the motion of a point as it happens: the whole motion, drawn once, and on it its past and the present.

    Displacement over time, with closed contacts of the scene shaded, or velocity over displacement (`phase`).
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(size[0] / _DPI, size[1] / _DPI), dpi=_DPI, layout="constrained", facecolor="white")
    canvas, axes = FigureCanvasAgg(figure), figure.add_subplot()
    axes.grid(color="#e3e5e9", linewidth=0.7)
    axes.set_axisbelow(True)
    dense = times_of(result, *window, _DENSE)
    factor, unit = length(float(np.max(np.abs(result.displacement(point, dense)), initial=0.0)))

    def curve(at: Array) -> Array:
        u = result.displacement(point, at) / factor
        return np.stack([u, result.velocity(point, at) / factor] if phase else [at, u])

    if phase:
        axes.set(xlabel=f"displacement [{unit}]", ylabel=f"velocity [{unit}/s]")
    else:
        for name in result.contacts:
            for start, end in closed_intervals(result, name):
                if end >= window[0] and start <= window[1]:
                    axes.axvspan(start, end, color=_DOT, alpha=0.12, linewidth=0)
        axes.set(xlabel="time [s]", ylabel=f"displacement [{unit}]", xlim=window)
    path = curve(dense)
    axes.plot(*path, color=_SHADE, linewidth=1.1)
    line = axes.plot([], [], color=_LINE, linewidth=1.5, animated=True)[0]
    dot = axes.plot([], [], "o", color=_DOT, markersize=8, animated=True)[0]
    axes.set_title(title or point.describe(), fontsize=11)
    canvas.draw()
    background = canvas.copy_from_bbox(figure.bbox)
    for t, now in zip(times, curve(times).T, strict=True):
        past = dense < t
        line.set_data(*(np.append(part[past], end) for part, end in zip(path, now, strict=True)))
        dot.set_data(now[:1], now[1:])
        canvas.restore_region(background)
        axes.draw_artist(line)
        axes.draw_artist(dot)
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()


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
    shown = picture_size(size or _SIZES[view])
    if isinstance(subject, Modes):
        if view != "side":
            raise ArgumentError(f"animate: mode shapes have no {view!r} view; choose view='side'")
        count, length = _count(1.0, speed, frames, rate, _LOOP), 1.0
        states = mode_snapshots(subject, mode, scene, count)
        pictures = side_frames(states, shown, _magnification(states, shown, magnification))
    else:
        views, count, length = _of_runs(subject, view, point, window, (speed, frames, rate), shown, magnification)
        # The pictures of all views at the same time become one.
        pictures = (np.concatenate(parts, axis=int(view == "phase")) for parts in zip(*views, strict=True))
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
) -> tuple[list[Iterator[Frame]], int, float]:  # fmt: skip
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
    known = {title: _known(run, times) for title, run in runs.items()}
    if view == "side":
        states = {title: snapshots(run, known[title]) for title, run in runs.items()}
        own = {title: _magnification(some, size, magnification) for title, some in states.items()}
        # One for all, but for scenes without a length.
        least = min(filter(None, own.values()), default=None)
        views = [side_frames(some, size, own[title] and least, title) for title, some in states.items()]
    elif view == "space":
        views = [_space_frames(run, known[title], size, magnification) for title, run in runs.items()]
    else:
        places = [as_point("animate: point", point or points_of_interest(run.scene)[0], run.scene.bodies)
                  for run in runs.values()]  # fmt: skip
        views = [
            _axes_frames(run, place, known[title], (begin, end), size, title, view == "phase")
            for (title, run), place in zip(runs.items(), places, strict=True)
        ]
    return views, count, end - begin


def _magnification(states: list[Snapshot], size: tuple[int, int], wanted: float | None) -> float | None:
    """Return by how much displacements are enlarged; None if that is not given and the scene has no length."""
    return arrange(states[0], size, None).magnification if wanted is None else wanted


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


def _reported(pictures: Iterator[Frame], bar: TerminalBar, count: int) -> Iterator[Frame]:
    """Yield pictures, and say how many there were."""
    for k, picture in enumerate(pictures, start=1):
        yield picture
        bar.update(k, report=(k, count))
