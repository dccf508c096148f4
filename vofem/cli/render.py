"""``vofem render``: draw pictures of a saved run."""

from __future__ import annotations

import argparse
from pathlib import Path

from vofem.cli.common import FINE, Commands, draw, made
from vofem.errors import ArgumentError


def add_render(commands: Commands) -> None:
    """Add the command to a parser."""
    render = commands.add_parser("render", help="draw pictures of a saved run")
    render.add_argument("run", type=Path, help="file that vofem run --save or Result.save has written")
    render.add_argument("--output", type=Path, help="folder for the pictures (output/NAME of the run)")
    render.add_argument("--movie", type=Path, metavar="PATH", help="write a movie instead: .webp, .gif or .mp4")
    render.add_argument("--view", default="side", help="of the movie: side, history or phase")
    render.add_argument("--speed", type=float, help="seconds of the run in a second of the movie; 1 is real time")
    render.add_argument("--frames", type=int, help="number of frames, instead of --speed (150)")
    render.add_argument("--point", metavar="BODY@X", help="of histories and phase portraits")
    render.add_argument("--snapshot", action="store_true", help="draw snapshot.png in three dimensions too, with VTK")
    render.add_argument("--times", type=float, nargs="+", default=[], metavar="T", help="of side views, in s")
    render.set_defaults(command=_render)


def _render(arguments: argparse.Namespace) -> int:
    if arguments.movie is not None:
        return _movie(arguments)
    from vofem.io.scenes.settings import OutputSettings
    from vofem.io.storage.run_file import load

    result = load(arguments.run)
    for t in arguments.times:
        if not 0.0 <= t <= result.solution.t_end:
            raise ArgumentError(f"--times holds {t:g}, expected times from 0 to {result.solution.t_end:g} s")
    folder = made(arguments.output or Path("output") / arguments.run.stem)
    written = list(draw(result, OutputSettings(pictures=tuple(arguments.times)), folder, arguments.snapshot))
    print("wrote " + "\n      ".join(str(path) for path in written))
    return FINE


def _movie(arguments: argparse.Namespace) -> int:
    """Write a movie; return the exit code."""
    from vofem.io.movies.animate import animate
    from vofem.io.scene_file import point_named
    from vofem.io.storage.run_file import load

    if arguments.times:
        raise ArgumentError("--times are those of pictures; leave them out with --movie, or --movie with them")
    result = load(arguments.run)
    point = None if arguments.point is None else point_named(result.scene, arguments.point)
    outcome = animate(
        result, arguments.movie, arguments.view, point=point, speed=arguments.speed, frames=arguments.frames
    )
    print(
        f"wrote {outcome.path}: {outcome.frames} frames, {outcome.seconds:.3g} s, {outcome.speed:.3g} s of the run a "
        "second"
    )
    return FINE
