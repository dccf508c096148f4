"""``vofem run``: simulate a scene file, write histories and pictures."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vofem.cli.common import FINE, INTERRUPTED, Commands, draw, limits, made, print_method, write
from vofem.integrators.registry import method_names

if TYPE_CHECKING:
    from vofem.io.scene_file import SceneFile


def add_run(commands: Commands) -> None:
    """Add the command to a parser."""
    run = commands.add_parser("run", help="simulate a scene file; write histories and pictures")
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
    run.add_argument("--save", type=Path, metavar="RUN", help="file .vtkhdf for the whole run; ParaView opens it too")
    run.add_argument("--overwrite", action="store_true", help="let --save replace a file")
    run.set_defaults(command=_run)


def _run(arguments: argparse.Namespace) -> int:
    from vofem.blas import blas_threads
    from vofem.io.scene_file import load_scene
    from vofem.simulate.explanation import explain

    file = load_scene(arguments.scene)
    print(explain(file.scene, *limits(file)))
    print_method(file, arguments.method)
    print(flush=True)
    # The folder is made first, so that a long run does not end because it cannot be made.
    folder = made(arguments.output or Path("output") / arguments.scene.stem)
    if arguments.save is not None:
        from vofem.io.storage.run_file import check_target

        check_target(arguments.save, arguments.overwrite)
    with blas_threads(file.scene.model.system.size):
        return _simulated(arguments, file, folder)


def _simulated(arguments: argparse.Namespace, file: SceneFile, folder: Path) -> int:
    """Run, print tables, write what is wanted; return the exit code."""
    from vofem.integrators.observer import deferred_interrupts
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
    written: list[Path] = []
    # Ctrl-C waits for the files of numbers, or for the picture that is being drawn.
    with deferred_interrupts() as pressed:
        if arguments.save is not None:
            written.append(result.save(arguments.save, overwrite=arguments.overwrite))
        written += write(result, file.output, folder)
        interrupted = interrupted or pressed()
        if not (interrupted or arguments.no_pictures):
            for path in draw(result, file.output, folder, arguments.snapshot):
                written.append(path)
                interrupted = pressed()
                if interrupted:
                    print("interrupted: pictures that are not listed here are left out")
                    break
    print("\nwrote " + "\n      ".join(str(path) for path in written))
    return INTERRUPTED if interrupted else FINE


def _changes(arguments: argparse.Namespace, file: SceneFile) -> dict[str, Any]:
    """Return what the command line says instead of the file."""
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
