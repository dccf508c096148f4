"""Checkpoints: the state of a run in one file, from which `resume` continues it."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vofem.errors import OutputError
from vofem.files.hdf5 import CHECKPOINT, checked_group, mark_format, reading, writing
from vofem.files.whole import path_of, target, try_to_write
from vofem.io.storage.records import decode, encoder, restored_scene, scene_record
from vofem.io.storage.tree import read_tree, write_tree
from vofem.progress import Progress
from vofem.result import Result
from vofem.scene import Scene
from vofem.simulate.plan import Plan, run_plan

_SUFFIXES = (".checkpoint", ".h5", ".hdf")

#: Version of the format. It is increased when this version could not read the new files.
FORMAT = 3


def checkpoint_writer(path: str | os.PathLike[str], scene: Scene) -> Callable[[Plan], Callable[[dict[str, Any]], None]]:
    """Return a function that writes snapshots of a run to a file, each whole or not at all, given the plan of the run.

    Raises `ArgumentError` for another suffix.
    Raises `OutputError` if the folder is missing or cannot be written, or the file is there already.
    """
    goal = target(path, _SUFFIXES)
    if goal.exists():
        raise OutputError(
            f"{goal} exists already; go on from it with vofem.resume({str(path)!r}), or remove it to begin anew"
        )
    try_to_write(goal)
    return _Writers(goal, scene, None)


def _identity(file: Path) -> tuple[int, int, int] | None:
    """Return numbers that change whenever a file is written anew; None where there is no file."""
    try:
        status = os.stat(file)
    except FileNotFoundError:
        return None
    return status.st_dev, status.st_ino, status.st_mtime_ns


@dataclass
class _Writers:
    """Makes functions that write snapshots to one file."""

    goal: Path
    scene: Scene
    last: tuple[int, int, int] | None  #: The file that may be replaced, if any; see `_identity`.

    def __call__(self, plan: Plan) -> Callable[[dict[str, Any]], None]:
        """Return the function for a plan."""
        scene = self.scene
        start = scene.initial_state() if plan.start is None else plan.start
        times = np.array([plan.t_start])
        kept = scene_record(scene, start.q[:, None], times)

        def write(snapshot: dict[str, Any]) -> None:
            if _identity(self.goal) not in (self.last, None):
                raise OutputError(
                    f"{self.goal} was written by another run meanwhile and was left as it is; give every run a "
                    "checkpoint of its own"
                )
            with writing(self.goal, overwrite=True) as blocks:
                own = blocks.file.create_group(CHECKPOINT)
                mark_format(own, FORMAT)
                record = {"scene": kept, "plan": plan, "snapshot": snapshot}
                write_tree(own.create_group("run"), record, encoder(times))
            self.last = _identity(self.goal)

        return write


def resume(
    path: str | os.PathLike[str],
    *,
    scene: Scene | None = None,
    progress: Progress = None,
    checkpoint_every: float = 60.0,
) -> Result:
    """Continue a run from its checkpoint; see `vofem.resume`."""
    expected = "a checkpoint of vofem.simulate"
    found = _identity(path_of(path, expected))
    with reading(path, expected) as file:
        record = read_tree(checked_group(file, (CHECKPOINT,), FORMAT, expected)["run"], decode)
    scene = restored_scene(record["scene"], scene, "resume", "checkpoint")
    writers = _Writers(target(path, _SUFFIXES), scene, found)
    return run_plan(scene, record["plan"], progress, writers, checkpoint_every, record["snapshot"])
