"""``vofem respond``: the response curve of a scene file along a parameter."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vofem.cli.common import FINE, INTERRUPTED, Commands, made
from vofem.errors import ArgumentError

if TYPE_CHECKING:
    from vofem.io.scene_file import SceneFile
    from vofem.studies.steady import Branch


def add_respond(commands: Commands) -> None:
    """Add the command to a parser."""
    respond = commands.add_parser("respond", help="follow steady states along a parameter; write curve and branch")
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
    respond.set_defaults(command=_respond)


def _respond(arguments: argparse.Namespace) -> int:
    from vofem.integrators.observer import deferred_interrupts
    from vofem.io.scene_file import load_scene
    from vofem.studies.steady import continuation

    file = load_scene(arguments.scene)
    # Raises for missing arguments before any work is done.
    file.at(arguments.start)
    point, options = _point(arguments, file), _options(arguments, file)
    assert file.respond is not None
    folder = made(arguments.output or Path("output") / arguments.scene.stem)
    saved = folder / "branch.h5"
    if saved.exists() and not arguments.overwrite:
        raise ArgumentError(f"{saved} exists; add --overwrite, or choose another folder by --output")
    branch = continuation(
        file.at, arguments.start, arguments.stop, progress=True if sys.stderr.isatty() else None, **options
    )
    written = []
    # Ctrl-C waits for the file that is being written, and ends the command then. After an interrupted continuation, the
    # numbers are written and the pictures are not.
    with deferred_interrupts() as pressed:
        written.append(branch.save(saved, overwrite=True))
        interrupted = branch.interrupted
        for path in _reported(branch, point, folder, file.respond.parameter[0], not arguments.no_pictures):
            written.append(path)
            interrupted = interrupted or pressed()
            if interrupted:
                print("interrupted: what is not listed here is left out")
                break
    print("\nwrote " + "\n      ".join(str(path) for path in written))
    return INTERRUPTED if interrupted else FINE


def _reported(branch: Branch, point: Any, folder: Path, name: str, pictures: bool) -> Iterator[Path]:
    """Print and write what is shown of a branch, one file after the other; return their paths."""
    from vofem.io.branch_tables import branch_table, write_branch

    print(branch_table(branch, point, name))
    for note in branch.notes:
        print(f"note: {note}")
    yield write_branch(branch, point, folder / "branch.csv", name)
    if pictures:
        from vofem.io.plot import multipliers, response_curve

        yield response_curve(branch, point, folder / "response.png", parameter=name)
        if all(orbit.multipliers is not None for orbit in branch.orbits):
            yield multipliers(branch, folder / "multipliers.png")


def _options(arguments: argparse.Namespace, file: SceneFile) -> dict[str, Any]:
    """Return options of the continuation: the command line's, else the file's."""
    assert file.respond is not None
    names = ("periods", "method", "harmonics")
    given = {name: getattr(arguments, name) for name in names}
    return {name: getattr(file.respond, name) if value is None else value for name, value in given.items()}


def _point(arguments: argparse.Namespace, file: SceneFile) -> Any:
    """Return the point whose amplitude is drawn: the one asked for, that of the first contact, or a body's."""
    from vofem.io.run_pictures import history_points
    from vofem.io.scene_file import point_named

    assert file.respond is not None
    if arguments.point is not None:
        return point_named(file.scene, arguments.point)
    return file.respond.point or history_points(file.scene, file.output)[0]
