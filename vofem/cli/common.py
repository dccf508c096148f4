"""What the commands share: exit codes, a line on the method, and what they write."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from vofem.errors import OutputError

if TYPE_CHECKING:
    from vofem.io.scene_file import SceneFile
    from vofem.io.scenes.settings import OutputSettings
    from vofem.result import Result

#: Where a command adds its parser.
Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"

#: Exit codes of success and of an error that vofem has reported. argparse takes 2 for wrong usage.
FINE, FAULT, INTERRUPTED = 0, 1, 130


def print_method(file: SceneFile, wanted: str | None) -> None:
    """Say which method is used, where it is not the one that vofem would choose."""
    method = wanted or (file.run.method if file.run is not None else "auto")
    if method != "auto":
        print(f"This run: {method}, as the {'command line' if wanted else 'scene file'} says")


def limits(file: SceneFile) -> tuple[float | None, float | None]:
    """Return duration in s and tolerance that a file asks for, by which a method is chosen."""
    arguments = file.run.arguments() if file.run is not None else {}
    return arguments.get("t_end"), arguments.get("tol")


def made(folder: Path) -> Path:
    """Return a folder, made where it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"the folder {folder} cannot be made: {error.strerror or error}") from error
    return folder


def write(result: Result, output: OutputSettings, folder: Path) -> Iterator[Path]:
    """Write the histories of a run; return the files one by one."""
    from vofem.io.csv_file import write_csv, write_probes
    from vofem.io.run_pictures import history_points

    yield write_csv(result, history_points(result.scene, output), folder / "histories.csv")
    if result.recorded is not None:
        yield write_probes(result, folder / "probes.csv")


def draw(result: Result, output: OutputSettings, folder: Path, snapshot: bool) -> Iterator[Path]:
    """Draw the pictures that a scene file asks for, and a snapshot if it is wanted; return the files one by one.

    A snapshot that cannot be drawn is left out, and the reason is printed.
    """
    from vofem.io.pictures.histories import time_history
    from vofem.io.render import render
    from vofem.io.run_pictures import history_points, picture_times

    points, times = history_points(result.scene, output), picture_times(result, output)
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


def _numbered(name: str, k: int, count: int) -> str:
    """Return the name of the k-th of some pictures."""
    return f"{name}.png" if count == 1 else f"{name}-{k}.png"
