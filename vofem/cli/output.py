"""What commands write: folders, tables, pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from vofem.errors import OutputError

if TYPE_CHECKING:
    from vofem.io.pictures.drawing import Drawing
    from vofem.io.pictures.history_figure import RunView
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

    pictures = None if studio is None else Pictures(result, output, folder, studio)
    written = [write_csv(result, history_points(result.scene, output), folder / "histories.csv")]
    if result.recorded is not None:
        written.append(write_probes(result, folder / "probes.csv"))
    return written if pictures is None else written + pictures.collected()


class Pictures:
    """The pictures that a scene file asks for; other processes begin to draw them at once."""

    def __init__(self, result: Result, output: OutputSettings, folder: Path, studio: Studio) -> None:
        from vofem.io.pictures.histories import history_views
        from vofem.io.render import sketched
        from vofem.io.run_pictures import history_points, picture_times

        self._studio = studio
        # Of each picture: its temporary path, what it shows, its final path.
        self._side_views: list[tuple[Path | None, Drawing, Path]] = []
        self._histories: list[tuple[Path, list[RunView], Path]] = []
        times = picture_times(result, output)
        for k, t in enumerate(times):
            goal, drawing = sketched(result, t, folder / ("scene.png" if len(times) == 1 else f"scene-{k + 1}.png"))
            self._side_views.append((studio.ask(drawing), drawing, goal))
        points = history_points(result.scene, output)
        self._names = [point.name for point in points]
        for k, point in enumerate(points):
            views = history_views(result, point)
            name = "history.png" if len(points) == 1 else f"history-{k + 1}.png"
            self._histories.append((studio.ask_history(views), views, folder / name))

    def collected(self) -> list[Path]:
        """Wait for all pictures, put them in their places, say what is on them; return the files."""
        from vofem.io.render import collect, collect_history

        written = []
        for history, name in zip(self._histories, self._names, strict=True):
            written.append(collect_history(self._studio, *history))
            if len(self._names) > 1:
                print(f"{written[-1].name}: {name}")
        message = ""
        for side_view in self._side_views:
            outcome = collect(self._studio, *side_view)
            message = outcome.message or message
            written.append(outcome.path)
        if message:
            print(message)
        return written
