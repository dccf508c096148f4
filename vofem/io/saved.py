"""`vofem.load` and `vofem.resume`. HDF5 is imported when they are called."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vofem.errors import ArgumentError, StorageError

if TYPE_CHECKING:
    from vofem.progress import Progress
    from vofem.result import Result
    from vofem.scene import Scene


def load(path: str | os.PathLike[str], *, scene: Scene | None = None) -> Any:
    """Read a file that `Result.save`, `Branch.save`, `Locus.save`, `Fit.save` or `vofem.sweep` has written.

    Every quantity at `times` is the same as before, to the last bit. For an event-driven run this also holds at other
    times, on a machine with the same libraries. Points are found by the name of their body and x, so points of the
    original bodies can be used.

    A file cannot hold Python functions. If the scene contained some, the file holds the values that the run needed of
    them. Whatever needs another value raises `MissingCallableError`, which names the function. Bodies and effects of
    classes that you have written are not in the file. Give the scene again to load such a run.

    Parameters
    ----------
    path : path
        Name of the file.
    scene : Scene, optional
        The scene of the run or of the fit, made again in Python. It takes the place of the scene in the file. Python
        functions in it cannot be compared with those of the run.

    Returns
    -------
    Result, Branch, Locus, Fit or Sweep
        Of the store of a sweep its table, with all rows that are stored. The function is not in the file.

    Raises
    ------
    StorageError
        If the file is missing, of another kind, damaged, or of another format.
    ArgumentError
        If the scene is not the same, or is given with a branch, a locus or a sweep, which need none.
    MissingCallableError
        If the run has bodies or effects of other classes and the scene was not given.
    """
    from vofem.files.hdf5 import BRANCH, FIT, KINDS, LOCUS, SAVED, SWEEP, kind_of, reading
    from vofem.io.storage import branch_file, fit_file, run_file
    from vofem.studies.sweep.store import stored_sweep

    with reading(path) as file:
        kind = kind_of(file)
        if not kind:
            raise StorageError(f"{path} is an HDF5 file of another program, expected {SAVED}")
        if scene is not None and kind in (BRANCH, LOCUS, SWEEP):
            raise ArgumentError(f"load: {path} is {KINDS[kind]} without a scene; leave out scene=")
        if kind in (BRANCH, LOCUS):
            return branch_file.read(file)
        if kind != SWEEP:
            return (fit_file if kind == FIT else run_file).read(file, scene)
    return stored_sweep(Path(path))


def resume(
    path: str | os.PathLike[str],
    *,
    scene: Scene | None = None,
    progress: Progress = None,
    checkpoint_every: float = 60.0,
) -> Result:
    """Continue a run from its checkpoint. The result is the same, bit for bit, as without the interruption.

    The checkpoint is updated while the run continues.

    Parameters
    ----------
    path : path
        The file that was given as ``checkpoint`` to `vofem.simulate`.
    scene : Scene, optional
        The same scene again. It is needed if the scene contains Python
        functions, or bodies or effects of your own classes, which a file cannot hold. Python functions cannot be
        compared with those of the run.
    progress : bool or callable, optional
        See `vofem.simulate`.
    checkpoint_every : float
        Seconds of wall time between two checkpoints.

    Returns
    -------
    Result

    Raises
    ------
    StorageError
        If the file is missing, of another kind, damaged, or of another format.
    ArgumentError
        If the scene is not the same.
    MissingCallableError
        If the scene holds callables or bodies of other classes and was not given.
    """
    from vofem.files.hdf5 import CHECKPOINT, checked_group, reading
    from vofem.files.whole import path_of, target
    from vofem.io.storage.checkpoint import FORMAT, SUFFIXES, identity_of, writers_of
    from vofem.io.storage.records import decode, restored_scene
    from vofem.io.storage.tree import read_tree
    from vofem.simulate.plan import run_plan

    expected = "a checkpoint of vofem.simulate"
    found = identity_of(path_of(path, expected))
    with reading(path, expected) as file:
        record = read_tree(checked_group(file, (CHECKPOINT,), FORMAT, expected)["run"], decode)
    scene = restored_scene(record["scene"], scene, "resume", "checkpoint")
    writers = writers_of(target(path, SUFFIXES), scene, found)
    return run_plan(scene, record["plan"], progress, writers, checkpoint_every, record["snapshot"])
