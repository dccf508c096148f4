"""``vofem accuracy``: what accuracy costs in time, for one scene."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from vofem.cli.common import FINE, Commands, made
from vofem.errors import ArgumentError
from vofem.integrators.registry import method_names


def add_accuracy(commands: Commands) -> None:
    """Add the command to a parser."""
    accuracy = commands.add_parser("accuracy", help="measure what accuracy costs in time; write a table and a figure")
    accuracy.add_argument("scene", type=Path, help="scene file, TOML")
    accuracy.add_argument("--output", type=Path, help="folder for what is written (output/NAME of the scene file)")
    accuracy.add_argument("--t-end", type=float, help="in s, instead of the file's")
    accuracy.add_argument("--tolerance", type=float, default=1e-6, help="of the largest displacement, for the advice")
    accuracy.add_argument("--methods", nargs="+", metavar="METHOD", help=", ".join(method_names()))
    accuracy.add_argument("--dt", type=float, nargs="+", metavar="DT", help="steps in s")
    accuracy.add_argument("--tol", type=float, nargs="+", default=[], metavar="TOL", help="of methods that follow it")
    accuracy.add_argument("--elements", type=int, nargs="+", metavar="N", help="of all beams together")
    accuracy.add_argument("--point", metavar="BODY@X", help="whose displacement is compared (the first contact's)")
    accuracy.add_argument("--repeats", type=int, default=3, help="runs of which the shortest time counts (3)")
    accuracy.add_argument("--cap", type=float, default=10.0, help="seconds that a run may take (10)")
    accuracy.add_argument("--workers", type=int, default=1, help="processes for what is not timed (1)")
    accuracy.set_defaults(command=_accuracy)


def _accuracy(arguments: argparse.Namespace) -> int:
    from vofem.io.plot import work_precision as draw
    from vofem.io.scene_file import load_scene, point_named
    from vofem.io.study_tables import study_table, write_study
    from vofem.studies.accuracy import work_precision

    file = load_scene(arguments.scene)
    t_end = arguments.t_end if arguments.t_end is not None else file.run.t_end if file.run is not None else None
    if t_end is None:
        raise ArgumentError(f"{file.path} does not say how long to run; add t_end to a table [run], or give --t-end")
    folder = made(arguments.output or Path("output") / arguments.scene.stem)
    study = work_precision(
        file.scene, t_end, methods=arguments.methods, dt=arguments.dt, tol=arguments.tol, elements=arguments.elements,
        point=None if arguments.point is None else point_named(file.scene, arguments.point),
        repeats=arguments.repeats, cap=arguments.cap, workers=arguments.workers,
        progress=show_progress if sys.stderr.isatty() else None,
    )  # fmt: skip
    print(study_table(study), end="\n\n")
    print(study.advice(arguments.tolerance))
    written = [write_study(study, folder / "accuracy.csv")]
    if study.runs:
        paths = [folder / f"accuracy.{kind}" for kind in ("png", "svg")]
        written += [draw(study, path, arguments.scene.stem) for path in paths]
    print("\nwrote " + "\n      ".join(str(path) for path in written))
    return FINE


def show_progress(done: int, total: int, what: str) -> None:
    """Show the progress of a study on one line of the terminal."""
    text = f"{done} of {total}  {what}" if what else ""
    sys.stderr.write(f"\r\x1b[K{text}")
    sys.stderr.flush()
