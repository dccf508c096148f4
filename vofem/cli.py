"""The command line: ``vofem run``, ``explain``, ``verify`` and more. Only this module prints and ends processes.

The first Ctrl-C ends the step that is being computed or the file that is being written. A command then writes what it
has, and returns 130. The second Ctrl-C ends the process. Python hears of Ctrl-C when machine code, such as that of a
compiler or an eigenproblem, has returned to it.

Modules of vofem are imported by the command that needs them, so that ``vofem --version`` need not wait for the others.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from vofem._version import __version__
from vofem.errors import ArgumentError, OutputError, VofemError

if TYPE_CHECKING:
    from vofem.io.scene_file import SceneFile
    from vofem.io.scenes.settings import OutputSettings
    from vofem.result import Result
    from vofem.scene import Scene
    from vofem.studies.steady import Branch
    from vofem.studies.sweep import Sweep

__all__ = ["FAULT", "FINE", "INTERRUPTED", "main", "script"]

#: Where a command adds its parser.
Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"

#: Exit codes of success and of an error that vofem has reported. argparse takes 2 for wrong usage.
FINE, FAULT, INTERRUPTED = 0, 1, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    before, presses = signal.getsignal(signal.SIGINT), _Presses()
    # A process that was started in the background ignores Ctrl-C.
    handled = before is signal.default_int_handler and threading.current_thread() is threading.main_thread()
    if handled:
        signal.signal(signal.SIGINT, presses)
    try:
        return _code(argv, presses)
    finally:
        if handled:
            signal.signal(signal.SIGINT, before)


def script() -> int:
    """Run the command of this process and return its exit code."""
    code = main()
    # While the interpreter ends, Ctrl-C would only add a traceback.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Python ends by the signal, whatever the exit code is, if Ctrl-C ended the last text that was run as a program.
    # Some packages run texts while they are imported.
    eval("0")
    return code


class _Presses:
    """The handler of Ctrl-C in a command, which counts how often it was pressed.

    Runs and other loops defer the first press to the end of a step; see `vofem.integrators.observer`.
    """

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, number: int, frame: Any) -> None:
        """Interrupt the command, or end the process: no exception can get lost then."""
        self.count += 1
        if self.count == 1:
            raise KeyboardInterrupt
        whole = sys.modules.get("vofem.files.whole")
        if whole is not None:
            whole.remove_unfinished()
        # A bar of progress may have hidden the cursor.
        cursor = "\x1b[?25h\n" if sys.stderr.isatty() else ""
        with contextlib.suppress(OSError):
            os.write(2, f"{cursor}vofem: interrupted\n".encode())
        os._exit(INTERRUPTED)


def _code(argv: Sequence[str] | None, presses: _Presses) -> int:
    """Run a command, turn errors into messages, and return its exit code."""
    try:
        code = run_command(argv)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        pass
    except VofemError as error:
        print(f"vofem: {error}", file=sys.stderr)
        return FAULT
    except BrokenPipeError:
        # The program that reads the output has ended, as in `vofem explain ... | head`, so nothing more can be printed.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FINE
    except Exception:
        # Code in C, such as that of matplotlib, may turn a KeyboardInterrupt into another error.
        if not presses.count:
            raise
    print("vofem: interrupted", file=sys.stderr)
    return INTERRUPTED


# -- what commands share


def _command(commands: Commands, handler: Callable[[argparse.Namespace], int], what: str) -> argparse.ArgumentParser:
    """Add the command that a handler is named after, and return its parser."""
    parser = commands.add_parser(handler.__name__.removeprefix("_"), help=what)
    parser.set_defaults(command=handler)
    return parser


def _wrote(paths: Iterable[Path]) -> None:
    """Say which files were written."""
    print("\nwrote " + "\n      ".join(str(path) for path in paths))


def _write_all(numbers: Iterable[Path], pictures: Iterable[Path], interrupted: bool = False) -> int:
    """Write files one by one, say which, and return the exit code.

    Ctrl-C waits for the files of numbers, or for the picture that is being drawn. After it pictures are left out.
    """
    from vofem.integrators.observer import deferred_interrupts

    with deferred_interrupts() as pressed:
        written = list(numbers)
        interrupted = interrupted or pressed()
        for path in () if interrupted else pictures:
            written.append(path)
            interrupted = pressed()
            if interrupted:
                print("interrupted: what is not listed here is left out")
                break
    _wrote(written)
    return INTERRUPTED if interrupted else FINE


def _print_method(file: SceneFile, wanted: str | None) -> None:
    """Say which method is used, where it is not the one that vofem would choose."""
    method = wanted or (file.run.method if file.run is not None else "auto")
    if method != "auto":
        print(f"This run: {method}, as the {'command line' if wanted else 'scene file'} says")


def _limits(file: SceneFile) -> tuple[float | None, float | None]:
    """Return duration in s and tolerance that a file asks for, by which a method is chosen."""
    arguments = file.run.arguments() if file.run is not None else {}
    return arguments.get("t_end"), arguments.get("tol")


def _output(arguments: argparse.Namespace, source: Path) -> Path:
    """Return the folder for what is written, by default one named after the file that is read."""
    return _made(arguments.output or Path("output") / source.stem)


def _made(folder: Path) -> Path:
    """Return a folder, made where it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = "it is a file" if os.path.isfile(folder) else error.strerror or error
        raise OutputError(f"the folder {folder} cannot be made: {reason}; choose another place") from error
    return folder


def _write(result: Result, output: OutputSettings, folder: Path, arguments: argparse.Namespace) -> Iterator[Path]:
    """Write a run, where it is to be saved, and its histories; return the files one by one."""
    from vofem.io.csv_file import write_csv, write_probes

    if arguments.save is not None:
        yield result.save(arguments.save, overwrite=arguments.overwrite)
    yield write_csv(result, _history_points(result.scene, output), folder / "histories.csv")
    if result.recorded is not None:
        yield write_probes(result, folder / "probes.csv")


def _draw(result: Result, output: OutputSettings, folder: Path, snapshot: bool) -> Iterator[Path]:
    """Draw the pictures that a scene file asks for, and a snapshot if it is wanted; return the files one by one.

    A snapshot that cannot be drawn is left out, and the reason is printed.
    """
    from vofem.io.pictures.histories import time_history
    from vofem.io.render import render

    points, times = _history_points(result.scene, output), _picture_times(result, output)
    for k, point in enumerate(points, start=1):
        history = time_history(result, point, folder / _numbered("history", k, len(points)))
        if len(points) > 1:
            print(f"{history.name}: {point.name}")
        yield history
    for k, t in enumerate(times, start=1):
        yield render(result, t, folder / _numbered("scene", k, len(times)))
    if snapshot:
        from vofem.io.space import snapshot as drawn

        try:
            yield drawn(result, times[0] if times else result.times[-1], folder / "snapshot.png")
        except OutputError as error:
            print(f"left out: {error}")


def _history_points(scene: Scene, output: OutputSettings) -> tuple[Any, ...]:
    """Return the points that the settings name, or some telling ones."""
    from vofem.histories.tables import MOST, points_of_interest

    return output.history or points_of_interest(scene)[:MOST]


def _picture_times(result: Result, output: OutputSettings) -> tuple[float, ...]:
    """Return the times that the settings name, or the middle of the first contact, or when most is displaced.

    Of the times named those are left out that a shorter run does not reach.
    """
    import numpy as np

    from vofem.io.pictures.histories import closed_intervals

    named = tuple(t for t in output.pictures if t <= result.times[-1])
    if named or output.pictures:
        return named
    intervals = [span for name in result.contacts for span in closed_intervals(result, name)[:1]]
    if intervals:
        middle = 0.5 * sum(min(intervals))
        # A stepping method may have stored few times; event_driven knows them all.
        nearest = float(result.times[int(np.argmin(np.abs(result.times - middle)))])
        return (middle if result.solution.continuous else nearest,)
    motion = np.max(np.abs([result.displacement(point) for point in _history_points(result.scene, output)]), axis=0)
    return (float(result.times[int(np.argmax(motion))]),)


def _numbered(name: str, k: int, count: int) -> str:
    """Return the name of the k-th of some pictures."""
    return f"{name}.png" if count == 1 else f"{name}-{k}.png"


# -- vofem run


def _add_run(commands: Commands) -> None:
    from vofem.integrators.registry import method_names

    run = _command(commands, _run, "simulate a scene file; write histories and pictures")
    run.add_argument("scene", type=Path, help="scene file, TOML")
    run.add_argument("--output", type=Path, help="folder for what is written (output/NAME of the scene file)")
    run.add_argument("--method", help=f"{', '.join(('auto', *method_names()))}; instead of the file's")
    run.add_argument("--t-end", type=float, help="in s, instead of the file's")
    run.add_argument(
        "--t-start", type=float, help="time of the loads at which the run begins, s, instead of the file's"
    )
    run.add_argument("--dt", type=float, help="in s, instead of the file's")
    run.add_argument("--no-pictures", action="store_true", help="write numbers only")
    run.add_argument("--snapshot", action="store_true", help="draw snapshot.png in three dimensions too, with VTK")
    run.add_argument(
        "--save", type=Path, metavar="RUN", nargs="?", const=Path(),
        help="file .vtkhdf for the whole run, which ParaView opens too (run.vtkhdf in the folder of --output)",
    )  # fmt: skip
    run.add_argument("--overwrite", action="store_true", help="let --save replace a file")


def _run(arguments: argparse.Namespace) -> int:
    from vofem._validate import choice, number
    from vofem.blas import blas_threads
    from vofem.integrators.registry import method_names
    from vofem.io.scene_file import load_scene
    from vofem.simulate.explanation import explain

    file = load_scene(arguments.scene)
    # Checked before anything is made or printed.
    if arguments.method is not None:
        choice("--method", arguments.method, ("auto", *method_names()))
    if arguments.t_end is not None:
        number("--t-end", arguments.t_end, positive=True)
    if arguments.t_start is not None:
        number("--t-start", arguments.t_start, minimum=0)
    # The folder is made first, so that a long run does not end because it cannot be made.
    folder = _output(arguments, arguments.scene)
    if arguments.save is not None:
        from vofem.files.whole import refuse_existing
        from vofem.io.storage.run_file import check_target

        arguments.save = folder / "run.vtkhdf" if arguments.save == Path() else arguments.save
        if not arguments.overwrite:
            refuse_existing(arguments.save, "add --overwrite, or choose another name")
        check_target(arguments.save, overwrite=True)
    print(explain(file.scene, *_limits(file)))
    _print_method(file, arguments.method)
    print(flush=True)
    with blas_threads(file.scene.model.system.size):
        return _simulated(arguments, file, folder)


def _simulated(arguments: argparse.Namespace, file: SceneFile, folder: Path) -> int:
    """Run, print tables, write what is wanted; return the exit code."""
    from vofem.io import tables

    result = file.simulate(**_changes(arguments, file))
    interrupted = result.interrupted
    # Forces of impacts, energies and pictures may take as long as the run, and a user who has pressed Ctrl-C does not
    # want to wait.
    if interrupted:
        print(
            "interrupted: speeds and forces of impacts, energies and pictures are left out; Ctrl-C ends at once",
            flush=True,
        )
    try:
        print(tables.counter_line(result), end="\n\n")
        print(tables.contact_tables(result, forces=not interrupted), end="\n\n", flush=True)
        if not interrupted:
            print(tables.energy_table(result))
    except KeyboardInterrupt:
        # The run is complete, so its histories are written.
        interrupted = True
        print("interrupted: what is not printed yet and pictures are left out", flush=True)
    for note in result.notes:
        print(f"note: {note}")
    pictures = () if arguments.no_pictures else _draw(result, file.output, folder, arguments.snapshot)
    return _write_all(_write(result, file.output, folder, arguments), pictures, interrupted)


def _changes(arguments: argparse.Namespace, file: SceneFile) -> dict[str, Any]:
    """Return what the command line says instead of the file."""
    import numpy as np

    given = {"method": arguments.method, "t_end": arguments.t_end, "t_start": arguments.t_start, "dt": arguments.dt}
    changes = {name: value for name, value in given.items() if value is not None}
    times = None if file.run is None else file.run.arguments()["times"]
    if file.run is not None and times is not None and "t_end" in changes:
        t_end = changes["t_end"]
        within = [t for t in np.asarray(times, dtype=float).tolist() if t <= t_end]
        # A single time gives no history.
        kept = len(within) > 1
        changes["times"] = within if kept else None
        if len(within) < len(times):
            what = "these are kept" if kept else "results are stored as if the file gave none"
            print(f"note: {len(within)} of the {len(times)} times of the file lie within --t-end; {what}", flush=True)
        elif max(within) < t_end and t_end > file.run.t_end:
            print(
                f"note: the times of the file end at {max(within):g} s, so no states are stored between there and "
                f"--t-end at {t_end:g} s; take times out of the file, or let them go on to {t_end:g} s",
                flush=True,
            )
    return changes


# -- vofem render


def _add_render(commands: Commands) -> None:
    render = _command(commands, _render, "draw pictures of a saved run")
    render.add_argument("run", type=Path, help="file that vofem run --save or Result.save has written")
    render.add_argument("--output", type=Path, help="folder for the pictures (output/NAME of the run)")
    render.add_argument("--movie", type=Path, metavar="PATH", help="write a movie instead: .webp, .gif or .mp4")
    render.add_argument("--view", help="of the movie: side, history, phase or space (side)")
    render.add_argument("--speed", type=float, help="seconds of the run in a second of the movie; 1 is real time")
    render.add_argument("--frames", type=int, help="number of frames of the movie, instead of --speed (150)")
    render.add_argument("--point", metavar="BODY@X", help="of movies of histories and phase portraits")
    render.add_argument(
        "--snapshot", action="store_const", const=True, help="draw snapshot.png in three dimensions too, with VTK"
    )
    render.add_argument("--times", type=float, nargs="+", metavar="T", help="of side views, in s")


def _render(arguments: argparse.Namespace) -> int:
    foreign: tuple[str, ...] = ("view", "speed", "frames", "point")
    what, cure = "movies", "give --movie too"
    if arguments.movie is not None:
        foreign, what, cure = ("output", "snapshot", "times"), "pictures", "leave out --movie"
    for name in foreign:
        if getattr(arguments, name) is not None:
            raise ArgumentError(f"--{name} is for {what}; leave it out, or {cure}")
    if arguments.movie is not None:
        return _movie(arguments)
    from vofem.io.scenes.settings import OutputSettings

    result, times = _loaded(arguments.run), tuple(arguments.times or ())
    for t in times:
        if not 0.0 <= t <= result.solution.t_end:
            raise ArgumentError(f"--times holds {t:g}, expected times from 0 to {result.solution.t_end:g} s")
    folder = _output(arguments, arguments.run)
    written = list(_draw(result, OutputSettings(pictures=times), folder, arguments.snapshot))
    print("wrote " + "\n      ".join(str(path) for path in written))
    return FINE


def _loaded(path: Path) -> Result:
    """Return the run in a file."""
    from vofem.files.hdf5 import reading
    from vofem.io.storage.run_file import read

    with reading(path) as file:
        return read(file)


def _movie(arguments: argparse.Namespace) -> int:
    """Write a movie; return the exit code."""
    from vofem.io.movies import animate
    from vofem.io.scene_file import point_named

    result = _loaded(arguments.run)
    point = None if arguments.point is None else point_named(result.scene, arguments.point)
    outcome = animate(
        result, arguments.movie, arguments.view or "side", point=point, speed=arguments.speed, frames=arguments.frames
    )
    print(
        f"wrote {outcome.path}: {outcome.frames} frames, {outcome.seconds:.3g} s, {outcome.speed:.3g} s of the run a "
        "second"
    )
    return FINE


# -- vofem respond


def _add_respond(commands: Commands) -> None:
    respond = _command(commands, _respond, "follow steady states along a parameter; write curve and branch")
    respond.add_argument("scene", type=Path, help="scene file, TOML, with a table [respond]")
    respond.add_argument("--from", dest="start", type=float, required=True, help="value at which the branch begins")
    respond.add_argument("--to", dest="stop", type=float, required=True, help="value at which it ends")
    respond.add_argument("--output", type=Path, help="folder for what is written (output/NAME of the scene file)")
    respond.add_argument("--point", metavar="BODY@X", help="whose amplitude is drawn, instead of the file's")
    respond.add_argument("--periods", type=int, help="periods of the loads that an orbit takes, instead of the file's")
    respond.add_argument("--method", help="auto, shooting or harmonic_balance; instead of the file's")
    respond.add_argument("--harmonics", type=int, help="of harmonic balance, instead of the file's")
    respond.add_argument("--no-pictures", action="store_true", help="write numbers only")
    respond.add_argument("--overwrite", action="store_true", help="replace a branch that was written before")


def _respond(arguments: argparse.Namespace) -> int:
    from vofem.files.whole import refuse_existing
    from vofem.io.scene_file import load_scene, point_named
    from vofem.studies.steady import continuation

    file = load_scene(arguments.scene)
    # Raises for missing arguments before any work is done.
    file.at(arguments.start)
    assert file.respond is not None
    names = ("periods", "method", "harmonics")
    given = {name: getattr(arguments, name) for name in names}
    options = {name: getattr(file.respond, name) if value is None else value for name, value in given.items()}
    # The point that is asked for, that of the first contact, or a body's.
    point = file.respond.point or _history_points(file.scene, file.output)[0]
    if arguments.point is not None:
        point = point_named(file.scene, arguments.point)
    folder = _output(arguments, arguments.scene)
    saved = folder / "branch.h5"
    if not arguments.overwrite:
        refuse_existing(saved, "add --overwrite, or choose another folder by --output")
    branch = continuation(
        file.at, arguments.start, arguments.stop, progress=True if sys.stderr.isatty() else None, **options
    )
    name = file.respond.parameter[0]
    pictures = () if arguments.no_pictures else _branch_pictures(branch, point, folder, name)
    return _write_all(_branch_numbers(branch, point, saved, name), pictures, branch.interrupted)


def _branch_numbers(branch: Branch, point: Any, saved: Path, name: str) -> Iterator[Path]:
    """Print what is special of a branch, and write it; return the files one by one."""
    from vofem.io.tables import branch_table, write_branch

    yield branch.save(saved, overwrite=True)
    print(branch_table(branch, point, name))
    for note in branch.notes:
        print(f"note: {note}")
    yield write_branch(branch, point, saved.with_suffix(".csv"), name)


def _branch_pictures(branch: Branch, point: Any, folder: Path, name: str) -> Iterator[Path]:
    """Draw a branch; return the files one by one."""
    from vofem.io.plot import multipliers, response_curve

    yield response_curve(branch, point, folder / "response.png", parameter=name)
    if any(orbit.multipliers is not None for orbit in branch.orbits):
        yield multipliers(branch, folder / "multipliers.png")


# -- vofem sweep


def _add_sweep(commands: Commands) -> None:
    sweep = _command(commands, _sweep, "run a scene file for many values of its keys; go on where it stopped")
    sweep.add_argument("study", type=Path, help="scene file with a table [sweep], TOML")
    sweep.add_argument("--output", type=Path, help="folder for what is written (output/NAME of the study file)")
    sweep.add_argument("--workers", type=int, metavar="N", help="processes (as many as there are processors)")
    sweep.add_argument("--scheduler", metavar="ADDRESS", help="of dask.distributed, instead of processes")
    sweep.add_argument("--time-limit", type=float, metavar="S", help="wall time that a point may take, s")
    sweep.add_argument("--retry-failed", action="store_true", help="compute points again that failed before")
    sweep.add_argument("--no-pictures", action="store_true", help="write numbers only")


def _sweep(arguments: argparse.Namespace) -> int:
    from vofem.io.study_file import load_study
    from vofem.io.tables import write_sweep
    from vofem.studies.sweep import SweepInterrupted
    from vofem.studies.sweep.sweeping import sweep

    study = load_study(arguments.study)
    for name, series in study.values.items():
        print(f"{name}: {len(series)} values, {series[0]} ... {series[-1]}")
    print(f"measured: {', '.join(study.measure)}", flush=True)
    folder = _output(arguments, arguments.study)
    store = folder / "sweep.h5"
    try:
        with _executor(arguments.scheduler) as executor:
            table = sweep(
                study.function(), study.values, executor=executor, store=store, workers=arguments.workers,
                time_limit=arguments.time_limit, retry_failed=arguments.retry_failed,
            )  # fmt: skip
    except SweepInterrupted as interrupted:
        done = sum(interrupted.sweep.counters[name] for name in ("computed", "stored"))
        print(f"stopped after {done} points, which are kept in {store}; the same command goes on from there")
        raise
    stored, seconds = table.counters["stored"], table.seconds.sum()
    kept = f", {stored} of them kept from before" * bool(stored)
    print(f"{len(table.points.rows)} points{kept}; {len(table.failed)} failed; {seconds:.3g} s of computing in all")
    for one in table.failed[:5]:
        print(f"failed: {one}")
    for note in table.notes:
        print(f"note: {note}")
    numbers = (store, write_sweep(table, folder / "sweep.csv"))
    code = _write_all(numbers, () if arguments.no_pictures else _sweep_pictures(table, folder))
    return code or (FAULT if len(table.failed) == len(table.points.rows) else FINE)


def _sweep_pictures(table: Sweep, folder: Path) -> Iterator[Path]:
    """Draw a sweep, where it can be drawn."""
    from vofem.io.pictures.studies import sweep_curves

    try:
        yield sweep_curves(table, folder / "sweep.png")
    except ArgumentError as error:
        print(f"no picture: {error}")


@contextlib.contextmanager
def _executor(address: str | None) -> Iterator[Any]:
    """Give the client of a scheduler, or None for processes."""
    if address is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError:
        raise ArgumentError("--scheduler needs dask.distributed; install vofem[distributed]") from None
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError) as error:
        raise ArgumentError(f"--scheduler: no scheduler answers at {address} ({error}); check the address") from None
    with client:
        yield client


# -- vofem verify


def _add_verify(commands: Commands) -> None:
    from vofem.integrators.registry import method_names

    verify = _command(commands, _verify, "run the catalogue of hard and published cases on this machine")
    methods = ", ".join((*method_names(), "equilibrium", "modes", "shooting", "harmonic_balance"))
    verify.add_argument("--method", help=f"only {methods}")
    verify.add_argument("--case", metavar="PATTERN", help="number of a hard case, or a part of a name or a source")
    verify.add_argument(
        "--markdown", type=Path, metavar="FILE", help="write a summary there, .md, and tables beside it"
    )
    verify.add_argument("--junit", type=Path, metavar="FILE", help="write JUnit XML there, .xml")
    verify.add_argument("--quick", action="store_true", help="leave out runs that take long")


def _verify(arguments: argparse.Namespace) -> int:
    from vofem.files.whole import target, write_text
    from vofem.verification import FAILED, catalogue, select, verify
    from vofem.verification.report import junit, markdown, markdown_details, summary, text_header, text_lines

    # The file is checked first, so that minutes of runs do not end because it cannot be written.
    files: list[tuple[Path, str, Callable[..., str]]]
    files = [] if arguments.junit is None else [(arguments.junit, ".xml", junit)]
    if arguments.markdown is not None:
        beside = arguments.markdown.with_name(f"{arguments.markdown.stem}-details.md")
        files.append((arguments.markdown, ".md", partial(markdown, details=beside.name)))
        files.append((beside, ".md", markdown_details))
    for file, suffix, _ in files:
        _made(target(file, (suffix,)).parent)
    outcomes = []
    found = verify(select(catalogue(), arguments.case), arguments.method, arguments.quick)
    print(text_header(), flush=True)
    for outcome in found:
        outcomes.append(outcome)
        print(text_lines(outcome), flush=True)
    print(f"\n{summary(outcomes)}")
    written = [write_text(file, form(outcomes)) for file, _, form in files]
    if written:
        print("wrote " + "\n      ".join(str(path) for path in written))
    return FAULT if any(outcome.verdict == FAILED for outcome in outcomes) else FINE


# -- vofem accuracy


def _add_accuracy(commands: Commands) -> None:
    from vofem.integrators.registry import method_names

    accuracy = _command(commands, _accuracy, "measure what accuracy costs in time; write a table and a figure")
    accuracy.add_argument("scene", type=Path, help="scene file, TOML")
    accuracy.add_argument("--output", type=Path, help="folder for what is written (output/NAME of the scene file)")
    accuracy.add_argument("--t-end", type=float, help="in s, instead of the file's")
    accuracy.add_argument(
        "--error", type=float, default=1e-6, help="over the largest displacement, for which advice is given (1e-6)"
    )
    accuracy.add_argument("--methods", nargs="+", metavar="METHOD", help=", ".join(method_names()))
    accuracy.add_argument("--dt", type=float, nargs="+", metavar="DT", help="steps in s")
    accuracy.add_argument("--tol", type=float, nargs="+", default=[], metavar="TOL", help="of methods that follow it")
    accuracy.add_argument("--elements", type=int, nargs="+", metavar="N", help="of all beams together")
    accuracy.add_argument("--point", metavar="BODY@X", help="whose displacement is compared (the first contact's)")
    accuracy.add_argument("--repeats", type=int, default=3, help="runs of which the shortest time counts (3)")
    accuracy.add_argument("--cap", type=float, default=10.0, help="seconds that a run may take (10)")
    accuracy.add_argument("--workers", type=int, default=1, help="processes for what is not timed (1)")


def _accuracy(arguments: argparse.Namespace) -> int:
    from vofem._validate import number
    from vofem.io.plot import work_precision as draw
    from vofem.io.scene_file import load_scene, point_named
    from vofem.io.tables import study_table, write_study
    from vofem.studies.accuracy import work_precision

    file = load_scene(arguments.scene)
    t_end = arguments.t_end if arguments.t_end is not None else file.run.t_end if file.run is not None else None
    if t_end is None:
        raise ArgumentError(f"{file.path} does not say how long to run; add t_end to a table [run], or give --t-end")
    # Checked first, so that a minute of runs does not end without its table.
    number("--error", arguments.error, positive=True)
    folder = _output(arguments, arguments.scene)
    study = work_precision(
        file.scene, t_end, methods=arguments.methods, dt=arguments.dt, tol=arguments.tol, elements=arguments.elements,
        point=None if arguments.point is None else point_named(file.scene, arguments.point),
        repeats=arguments.repeats, cap=arguments.cap, workers=arguments.workers,
        progress=show_progress if sys.stderr.isatty() else None,
    )  # fmt: skip
    print(study_table(study), end="\n\n")
    print(study.advice(arguments.error))
    written = [write_study(study, folder / "accuracy.csv")]
    if study.runs:
        paths = [folder / f"accuracy.{kind}" for kind in ("png", "svg")]
        written += [draw(study, path, arguments.scene.stem) for path in paths]
    _wrote(written)
    return FINE


def show_progress(done: int, total: int, what: str) -> None:
    """Show the progress of a study on one line of the terminal."""
    text = f"{done} of {total}  {what}" if what else ""
    sys.stderr.write(f"\r\x1b[K{text}")
    sys.stderr.flush()


# -- vofem explain, vofem compile, vofem doctor, and the parser of all


def run_command(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; errors and Ctrl-C are for the caller."""
    arguments = _parser().parse_args(argv)
    code: int = arguments.command(arguments)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="vofem", description="Beams and masses that hit, rattle and yield.")
    parser.add_argument("--version", action="version", version=f"vofem {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for add in (
        _add_run, _add_render, _add_explain, _add_respond, _add_sweep, _add_verify, _add_accuracy, _add_compile,
        _add_doctor,
    ):  # fmt: skip
        add(commands)
    return parser


def _add_explain(commands: Commands) -> None:
    explain = _command(commands, _explain, "say what would be simulated, how, and what not")
    explain.add_argument("scene", type=Path, help="scene file, TOML")


def _explain(arguments: argparse.Namespace) -> int:
    from vofem.io.scene_file import load_scene
    from vofem.simulate.explanation import explain

    file = load_scene(arguments.scene)
    print(explain(file.scene, *_limits(file)))
    _print_method(file, None)
    return FINE


def _add_compile(commands: Commands) -> None:
    _command(commands, _compile, "compile all kernels ahead, so that no run has to wait for it")


def _compile(arguments: argparse.Namespace) -> int:
    from vofem.kernels.cache import cache_folder
    from vofem.simulate.ahead import KINDS, compile_ahead

    folder = cache_folder()
    if folder is None:
        print(
            "vofem: compiled code cannot be kept: neither the folder of the package nor that of the user's caches can "
            "be written. Set NUMBA_CACHE_DIR to a folder that can"
        )
        return FAULT
    print(f"compiling for {len(KINDS)} kinds of work; code that is on disk already is read", flush=True)
    for kind, seconds in compile_ahead():
        print(f"{kind:<82} {seconds:6.1f} s", flush=True)
    print(f"compiled code is in {folder}")
    return FINE


def _add_doctor(commands: Commands) -> None:
    _command(commands, _doctor, "show versions; say whether VTK can draw without a window")


def _doctor(arguments: argparse.Namespace) -> int:
    from vofem.io.doctor import diagnose

    text, complete = diagnose()
    print(text)
    return FINE if complete else FAULT
