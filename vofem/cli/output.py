"""What commands write: folders, tables, pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from vofem.errors import OutputError

if TYPE_CHECKING:
    from vofem.io.pictures.drawing import Drawing
    from vofem.io.pictures.studio import Studio
    from vofem.io.scenes.settings import OutputSettings
    from vofem.result import Result


def made(folder: Path) -> Path:
    """Return a folder, made where it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"the folder {folder} cannot be made: {error.strerror or error}") from error
    return folder


def write(result: Result, output: OutputSettings, folder: Path, studio: Studio | None) -> list[Path]:
    """Write the histories of a run, and pictures where there is a studio for them; return what was written."""
    from vofem.io.csv_file import write_csv, write_probes
    from vofem.io.run_pictures import history_points

    pictures = [] if studio is None else begin_pictures(result, output, folder, studio)
    written = [write_csv(result, history_points(result.scene, output), folder / "histories.csv")]
    if result.recorded is not None:
        written.append(write_probes(result, folder / "probes.csv"))
    return written if studio is None else written + draw(result, output, folder, studio, pictures)


def begin_pictures(
    result: Result, output: OutputSettings, folder: Path, studio: Studio
) -> list[tuple[Path, Drawing, Path]]:
    """Start drawing the side views in another process.

    Returns the temporary path of each, what it shows, and its final path.
    """
    from vofem.io.render import sketched
    from vofem.io.run_pictures import picture_times

    pictures = []
    times = picture_times(result, output)
    for k, t in enumerate(times):
        goal, drawing = sketched(result, t, folder / ("scene.png" if len(times) == 1 else f"scene-{k + 1}.png"))
        pictures.append((studio.ask(drawing), drawing, goal))
    return pictures


def draw(
    result: Result, output: OutputSettings, folder: Path, studio: Studio, pictures: list[tuple[Path, Drawing, Path]]
) -> list[Path]:
    """Draw the histories that a scene file asks for, collect the side views; say what is on them, return the files."""
    from vofem.io.pictures.histories import time_history
    from vofem.io.render import collect
    from vofem.io.run_pictures import history_points

    points = history_points(result.scene, output)
    written = []
    for k, point in enumerate(points):
        name = "history.png" if len(points) == 1 else f"history-{k + 1}.png"
        written.append(time_history(result, point, folder / name))
        if len(points) > 1:
            print(f"{name}: {point.name}")
    message = ""
    for picture in pictures:
        outcome = collect(studio, *picture)
        message = outcome.message or message
        written.append(outcome.path)
    if message:
        print(message)
    return written
