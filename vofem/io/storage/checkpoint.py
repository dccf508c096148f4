"""Checkpoints: the state of a run in one file, from which `vofem.resume` continues it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from vofem.errors import OutputError
from vofem.files.hdf5 import CHECKPOINT, mark_format, writing
from vofem.files.whole import target, try_to_write
from vofem.io.storage.records import encoder, scene_record
from vofem.io.storage.tree import write_tree
from vofem.scene import Scene
from vofem.simulate.plan import Plan

SUFFIXES = (".checkpoint", ".h5", ".hdf")

#: Version of the format. It is increased when this version could not read the new files.
FORMAT = 4


#: Takes the plan of a run, and returns what writes snapshots of it.
Writers = Callable[[Plan], Callable[[dict[str, Any]], None]]


def checkpoint_writer(path: str | os.PathLike[str], scene: Scene) -> Writers:
    """Return a function that writes snapshots of a run to a file, each whole or not at all, given the plan of the run.

    Raises `ArgumentError` for another suffix.
    Raises `OutputError` if the folder is missing or cannot be written, or the file is there already.
    """
    goal = target(path, SUFFIXES)
    try_to_write(goal)
    if goal.exists():
        raise OutputError(
            f"{goal} exists already; go on from it with vofem.resume({str(path)!r}), or remove it to begin anew"
        )
    return writers_of(goal, scene, None)


def identity_of(file: Path) -> tuple[int, int, int] | None:
    """Return numbers that change whenever a file is written anew; None where no file can be seen."""
    try:
        status = os.stat(file)
    except OSError:
        return None
    return status.st_dev, status.st_ino, status.st_mtime_ns


def writers_of(goal: Path, scene: Scene, last: tuple[int, int, int] | None) -> Writers:
    """Return what makes functions that write snapshots to one file; `last`: the file that may be replaced, if any."""

    def for_plan(plan: Plan) -> Callable[[dict[str, Any]], None]:
        start = scene.initial_state() if plan.start is None else plan.start
        times = np.array([plan.t_start])
        kept = scene_record(scene, start.q[:, None], times)

        def write(snapshot: dict[str, Any]) -> None:
            nonlocal last
            if identity_of(goal) not in (last, None):
                raise OutputError(
                    f"{goal} was written by another run meanwhile and was left as it is; give every run a "
                    "checkpoint of its own"
                )
            with writing(goal, overwrite=True) as blocks:
                own = blocks.file.create_group(CHECKPOINT)
                mark_format(own, FORMAT)
                record = {"scene": kept, "plan": plan, "snapshot": snapshot}
                write_tree(own.create_group("run"), record, encoder(times))
            last = identity_of(goal)

        return write

    return for_plan
