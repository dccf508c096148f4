"""What commands write: folders, tables, pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from vofem.errors import OutputError

if TYPE_CHECKING:
    from vofem.io.scenes.settings import OutputSettings
    from vofem.result import Result


def made(folder: Path) -> Path:
    """Return a folder, made where it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"the folder {folder} cannot be made: {error.strerror or error}") from error
    return folder


def write(result: Result, output: OutputSettings, folder: Path) -> list[Path]:
    """Write the histories of a run; return what was written."""
    from vofem.io.csv_file import write_csv, write_probes
    from vofem.io.run_pictures import history_points

    written = [write_csv(result, history_points(result.scene, output), folder / "histories.csv")]
    if result.recorded is not None:
        written.append(write_probes(result, folder / "probes.csv"))
    return written


def draw(result: Result, output: OutputSettings, folder: Path, snapshot: bool) -> list[Path]:
    """Draw the pictures that a scene file asks for, and a snapshot if it is wanted; return the files.

    A snapshot that cannot be drawn is left out, and the reason is printed.
    """
    from vofem.io.pictures.histories import time_history
    from vofem.io.render import render
    from vofem.io.run_pictures import history_points, picture_times

    written = []
    points, times = history_points(result.scene, output), picture_times(result, output)
    for k, point in enumerate(points, start=1):
        written.append(time_history(result, point, folder / _numbered("history", k, len(points))))
        if len(points) > 1:
            print(f"{written[-1].name}: {point.name}")
    for k, t in enumerate(times, start=1):
        written.append(render(result, t, folder / _numbered("scene", k, len(times))))
    if snapshot:
        from vofem.io.off_screen import snapshot as drawn

        try:
            written.append(drawn(result, times[0] if times else result.times[-1], folder / "snapshot.png"))
        except OutputError as error:
            print(f"left out: {error}")
    return written


def _numbered(name: str, k: int, count: int) -> str:
    """Return the name of the k-th of some pictures."""
    return f"{name}.png" if count == 1 else f"{name}-{k}.png"
