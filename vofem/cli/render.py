"""``vofem render``: draw pictures of a saved run."""

from __future__ import annotations

import argparse
from pathlib import Path

from vofem.cli.common import FINE, Commands
from vofem.cli.output import begin_pictures, draw, made
from vofem.errors import ArgumentError


def add_render(commands: Commands) -> None:
    """Add the command to a parser."""
    render = commands.add_parser("render", help="draw pictures of a saved run")
    render.add_argument("run", type=Path, help="file that vofem run --save or Result.save has written")
    render.add_argument("--output", type=Path, help="folder for the pictures (output/NAME of the run)")
    render.add_argument("--times", type=float, nargs="+", default=[], metavar="T", help="of side views, in s")
    render.set_defaults(command=_render)


def _render(arguments: argparse.Namespace) -> int:
    from vofem.io.pictures.studio import Studio
    from vofem.io.scenes.settings import OutputSettings
    from vofem.io.storage.run_file import load

    with Studio() as studio:
        result = load(arguments.run)
        for t in arguments.times:
            if not 0.0 <= t <= result.solution.t_end:
                raise ArgumentError(f"--times holds {t:g}, expected times from 0 to {result.solution.t_end:g} s")
        output = OutputSettings(pictures=tuple(arguments.times))
        folder = made(arguments.output or Path("output") / arguments.run.stem)
        written = draw(result, output, folder, studio, begin_pictures(result, output, folder, studio))
    print("wrote " + "\n      ".join(str(path) for path in written))
    return FINE
