"""``vofem sweep``: run a scene file for many values of its keys."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vofem.cli.common import FAULT, FINE, INTERRUPTED, Commands, made
from vofem.errors import ArgumentError

if TYPE_CHECKING:
    from vofem.io.study_file import StudyFile
    from vofem.studies.sweep import Sweep


def add_sweep(commands: Commands) -> None:
    """Add the command to a parser."""
    sweep = commands.add_parser("sweep", help="run a scene file for many values of its keys; go on where it stopped")
    sweep.add_argument("study", type=Path, help="scene file with a table [sweep], TOML")
    sweep.add_argument("--output", type=Path, help="folder for what is written (output/NAME of the study file)")
    sweep.add_argument("--workers", type=int, metavar="N", help="processes (as many as there are processors)")
    sweep.add_argument("--scheduler", metavar="ADDRESS", help="of dask.distributed, instead of processes")
    sweep.add_argument("--time-limit", type=float, metavar="S", help="wall time that a point may take, s")
    sweep.add_argument("--retry-failed", action="store_true", help="compute points again that failed before")
    sweep.add_argument("--no-pictures", action="store_true", help="write numbers only")
    sweep.set_defaults(command=_sweep)


def _sweep(arguments: argparse.Namespace) -> int:
    from vofem.io.study_file import load_study
    from vofem.io.sweep_tables import write_sweep
    from vofem.studies.sweep import SweepInterrupted
    from vofem.studies.sweep.sweeping import sweep

    study = load_study(arguments.study)
    print(_summary(study), flush=True)
    folder = made(arguments.output or Path("output") / arguments.study.stem)
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
    print(_outcome(table))
    for one in table.failed[:5]:
        print(f"failed: {one}")
    for note in table.notes:
        print(f"note: {note}")
    written = [store, write_sweep(table, folder / "sweep.csv")]
    pressed = False
    try:
        if not arguments.no_pictures:
            written += _pictures(table, folder)
    except KeyboardInterrupt:
        pressed = True
        print("interrupted: the picture is left out")
    print("\nwrote " + "\n      ".join(str(path) for path in written))
    if pressed:
        return INTERRUPTED
    return FAULT if len(table.failed) == len(table.points.rows) else FINE


def _summary(study: StudyFile) -> str:
    lines = [f"{name}: {len(series)} values, {series[0]} ... {series[-1]}" for name, series in study.values.items()]
    return "\n".join([*lines, f"measured: {', '.join(study.measure)}"])


def _outcome(table: Sweep) -> str:
    counters = table.counters
    seconds = table.seconds.sum()
    kept = f", {counters['stored']} of them kept from before" if counters["stored"] else ""
    return f"{len(table.points.rows)} points{kept}; {len(table.failed)} failed; {seconds:.3g} s of computing in all"


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


def _pictures(table: Sweep, folder: Path) -> list[Path]:
    from vofem.io.pictures.sweeps import sweep_curves

    try:
        return [sweep_curves(table, folder / "sweep.png")]
    except ArgumentError as error:
        print(f"no picture: {error}")
        return []
