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


def write(result: Result, output: OutputSettings, folder: Path, *, pictures: bool) -> list[Path]:
    """Write the histories of a run, and pictures where wanted; return what was written."""
    from vofem.io.csv_file import write_csv, write_probes
    from vofem.io.run_pictures import history_points

    written = [write_csv(result, history_points(result.scene, output), folder / "histories.csv")]
    if result.recorded is not None:
        written.append(write_probes(result, folder / "probes.csv"))
    return written + draw(result, output, folder) if pictures else written


def draw(result: Result, output: OutputSettings, folder: Path) -> list[Path]:
    """Draw the pictures that a scene file asks for, and say what is on them; return what was written."""
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
