"""The command line: ``vofem run``, ``explain``, ``verify`` and more. Only this module prints and ends processes."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vofem._version import __version__
from vofem.errors import ArgumentError, OutputError, VofemError
from vofem.simulate import METHODS

if TYPE_CHECKING:
    from vofem.io.scene_file import SceneFile
    from vofem.io.scenes.settings import OutputSettings
    from vofem.result import Result

#: Exit codes: all went well; vofem found a fault and said which. argparse itself takes 2 for wrong usage.
FINE, FAULT, INTERRUPTED = 0, 1, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    arguments = _parser().parse_args(argv)
    try:
        code: int = arguments.command(arguments)
        sys.stdout.flush()
        return code
    except VofemError as error:
        print(f"vofem: {error}", file=sys.stderr)
        return FAULT
    except KeyboardInterrupt:
        print("vofem: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of the output has gone, as with `vofem explain ... | head`: nothing is left to be said.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FINE


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="vofem", description="Beams and masses that hit, rattle and yield.")
    parser.add_argument("--version", action="version", version=f"vofem {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    run = commands.add_parser("run", help="simulate a scene file; write histories and pictures")
    run.add_argument("scene", type=Path, help="scene file, TOML")
    run.add_argument("--output", type=Path, help="folder for what is written (output/NAME of the scene file)")
    run.add_argument("--method", help=f"{', '.join(('auto', *METHODS))}; instead of the file's")
    run.add_argument("--t-end", type=float, help="in s, instead of the file's")
    run.add_argument("--dt", type=float, help="in s, instead of the file's")
    run.add_argument("--no-pictures", action="store_true", help="write numbers only")
    run.add_argument("--save", type=Path, metavar="RUN", help="file .vtkhdf for the whole run; ParaView opens it too")
    run.add_argument("--overwrite", action="store_true", help="let --save replace a file")
    run.set_defaults(command=_run)

    render = commands.add_parser("render", help="draw pictures of a saved run")
    render.add_argument("run", type=Path, help="file that vofem run --save or Result.save has written")
    render.add_argument("--output", type=Path, help="folder for the pictures (output/NAME of the run)")
    render.add_argument("--times", type=float, nargs="+", default=[], metavar="T", help="of side views, in s")
    render.set_defaults(command=_render)

    explain = commands.add_parser("explain", help="say what would be simulated, how, and what not")
    explain.add_argument("scene", type=Path, help="scene file, TOML")
    explain.set_defaults(command=_explain)

    verify = commands.add_parser("verify", help="run the catalogue of hard and published cases on this machine")
    verify.add_argument("--method", help=f"only {', '.join(METHODS)}, equilibrium or modes")
    verify.add_argument("--case", metavar="PATTERN", help="number of a hard case, or a part of a name or a source")
    verify.add_argument("--markdown", type=Path, metavar="FILE", help="write the tables there, .md")
    verify.add_argument("--junit", type=Path, metavar="FILE", help="write JUnit XML there, .xml")
    verify.add_argument("--quick", action="store_true", help="leave out runs that take long")
    verify.set_defaults(command=_verify)

    accuracy = commands.add_parser("accuracy", help="measure what accuracy costs in time; write a table and a figure")
    accuracy.add_argument("scene", type=Path, help="scene file, TOML")
    accuracy.add_argument("--output", type=Path, help="folder for what is written (output/NAME of the scene file)")
    accuracy.add_argument("--t-end", type=float, help="in s, instead of the file's")
    accuracy.add_argument("--tolerance", type=float, default=1e-6, help="of the largest displacement, for the advice")
    accuracy.add_argument("--methods", nargs="+", metavar="METHOD", help=", ".join(METHODS))
    accuracy.add_argument("--dt", type=float, nargs="+", metavar="DT", help="steps in s")
    accuracy.add_argument("--tol", type=float, nargs="+", default=[], metavar="TOL", help="of energy_conserving")
    accuracy.add_argument("--elements", type=int, nargs="+", metavar="N", help="of all beams together")
    accuracy.add_argument("--point", metavar="BODY@X", help="whose displacement is compared (the first contact's)")
    accuracy.add_argument("--repeats", type=int, default=3, help="runs of which the shortest time counts (3)")
    accuracy.add_argument("--cap", type=float, default=10.0, help="seconds that a run may take (10)")
    accuracy.add_argument("--workers", type=int, default=1, help="processes for what is not timed (1)")
    accuracy.set_defaults(command=_accuracy)

    doctor = commands.add_parser("doctor", help="show versions; say whether off-screen rendering works")
    doctor.set_defaults(command=_doctor)
    return parser


def _explain(arguments: argparse.Namespace) -> int:
    from vofem.io.scene_file import load_scene
    from vofem.simulate import explain

    file = load_scene(arguments.scene)
    print(explain(file.scene))
    _print_method(file, None)
    return FINE


def _print_method(file: SceneFile, wanted: str | None) -> None:
    """Say which method is used, where it is not the one that vofem would choose."""
    method = wanted or (file.run.method if file.run is not None else "auto")
    if method != "auto":
        print(f"This run: {method}, as the {'command line' if wanted else 'scene file'} says")


def _doctor(arguments: argparse.Namespace) -> int:
    from vofem.io.doctor import diagnose

    found = diagnose()
    print(found)
    return FAULT if found.missing else FINE


def _verify(arguments: argparse.Namespace) -> int:
    from vofem.io.files import target, write_text
    from vofem.verification import FAILED, catalogue, select, verify
    from vofem.verification.report import junit, markdown, summary, text_header, text_lines

    # Checked first: minutes of runs shall not end in a file that cannot be.
    files = [(file, suffix, form) for file, suffix, form in (
        (arguments.markdown, ".md", markdown), (arguments.junit, ".xml", junit)
    ) if file is not None]  # fmt: skip
    for file, suffix, _ in files:
        _made(target(file, (suffix,)).parent)
    outcomes = []
    print(text_header(), flush=True)
    for outcome in verify(select(catalogue(), arguments.case), arguments.method, arguments.quick):
        outcomes.append(outcome)
        print(text_lines(outcome), flush=True)
    if not outcomes:
        raise ArgumentError("verify: no case that was chosen has to do with that method; leave out --method or --case")
    print(f"\n{summary(outcomes)}")
    written = [write_text(file, form(outcomes)) for file, _, form in files]
    if written:
        print("wrote " + "\n      ".join(str(path) for path in written))
    return FAULT if any(outcome.verdict == FAILED for outcome in outcomes) else FINE


def _run(arguments: argparse.Namespace) -> int:
    from vofem.io import tables
    from vofem.io.scene_file import load_scene
    from vofem.simulate import explain

    file = load_scene(arguments.scene)
    print(explain(file.scene))
    _print_method(file, arguments.method)
    print(flush=True)
    # Made first: a run that is long shall not end in a folder that cannot be.
    folder = _made(arguments.output or Path("output") / arguments.scene.stem)
    if arguments.save is not None:
        from vofem.io.storage.run_file import check_target

        check_target(arguments.save, arguments.overwrite)
    result = file.simulate(**_changes(arguments, file))
    print(tables.counter_line(result), end="\n\n")
    print(tables.contact_tables(result), end="\n\n")
    print(tables.energy_table(result))
    for note in result.notes:
        print(f"note: {note}")
    saved = [] if arguments.save is None else [result.save(arguments.save, overwrite=arguments.overwrite)]
    written = saved + _write(result, file.output, folder, pictures=not arguments.no_pictures)
    print("\nwrote " + "\n      ".join(str(path) for path in written))
    return FINE


def _render(arguments: argparse.Namespace) -> int:
    from vofem.io.scenes.settings import OutputSettings
    from vofem.io.storage.run_file import load

    result = load(arguments.run)
    for t in arguments.times:
        if not 0.0 <= t <= result.solution.t_end:
            raise ArgumentError(f"--times holds {t:g}, expected times from 0 to {result.solution.t_end:g} s")
    output = OutputSettings(pictures=tuple(arguments.times))
    folder = _made(arguments.output or Path("output") / arguments.run.stem)
    written = _draw(result, output, folder)
    print("wrote " + "\n      ".join(str(path) for path in written))
    return FINE


def _accuracy(arguments: argparse.Namespace) -> int:
    from vofem.io.plot import work_precision as draw
    from vofem.io.scene_file import load_scene, point_named
    from vofem.io.study_tables import study_table, write_study
    from vofem.studies.accuracy import work_precision

    file = load_scene(arguments.scene)
    t_end = arguments.t_end if arguments.t_end is not None else file.run.t_end if file.run is not None else None
    if t_end is None:
        raise ArgumentError(f"{file.path} does not say how long to run; add t_end to a table [run], or give --t-end")
    folder = _made(arguments.output or Path("output") / arguments.scene.stem)
    study = work_precision(
        file.scene, t_end, methods=arguments.methods, dt=arguments.dt, tol=arguments.tol, elements=arguments.elements,
        point=None if arguments.point is None else point_named(file.scene, arguments.point),
        repeats=arguments.repeats, cap=arguments.cap, workers=arguments.workers,
        progress=_show_progress if sys.stderr.isatty() else None,
    )  # fmt: skip
    print(study_table(study), end="\n\n")
    print(study.advice(arguments.tolerance))
    written = [write_study(study, folder / "accuracy.csv")]
    if study.runs:
        written += [draw(study, folder / f"accuracy.{kind}", arguments.scene.stem) for kind in ("png", "svg")]
    print("\nwrote " + "\n      ".join(str(path) for path in written))
    return FINE


def _show_progress(done: int, total: int, what: str) -> None:
    """Say on one line of the terminal how far a study is."""
    text = f"{done} of {total}  {what}" if what else ""
    sys.stderr.write(f"\r\x1b[K{text}")
    sys.stderr.flush()


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"the folder {folder} cannot be made: {error.strerror or error}") from error
    return folder


def _changes(arguments: argparse.Namespace, file: SceneFile) -> dict[str, Any]:
    """Return what the command line says instead of the file."""
    given = {"method": arguments.method, "t_end": arguments.t_end, "dt": arguments.dt}
    changes = {name: value for name, value in given.items() if value is not None}
    if "t_end" in changes and file.run is not None:
        # The times of the file belong to the duration of the file.
        changes["times"] = None
    return changes


def _write(result: Result, output: OutputSettings, folder: Path, *, pictures: bool) -> list[Path]:
    from vofem.io.csv_file import write_csv, write_probes
    from vofem.io.run_pictures import history_points

    written = [write_csv(result, history_points(result.scene, output), folder / "histories.csv")]
    if result.recorded is not None:
        written.append(write_probes(result, folder / "probes.csv"))
    return written + _draw(result, output, folder) if pictures else written


def _draw(result: Result, output: OutputSettings, folder: Path) -> list[Path]:
    from vofem.io.plot import time_history
    from vofem.io.render import render
    from vofem.io.run_pictures import history_points, picture_times

    points = history_points(result.scene, output)
    written = []
    for k, point in enumerate(points):
        name = "history.png" if len(points) == 1 else f"history-{k + 1}.png"
        written.append(time_history(result, point, folder / name))
        if len(points) > 1:
            print(f"{name}: {point.name}")
    message = ""
    times = picture_times(result, output)
    for k, t in enumerate(times):
        outcome = render(result, t, folder / ("scene.png" if len(times) == 1 else f"scene-{k + 1}.png"))
        message = outcome.message or message
        written.append(outcome.path)
    if message:
        print(message)
    return written
