"""`vofem.load` and `vofem.resume`: HDF5 is imported when they are called, not when they are named."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vofem.progress import Progress
    from vofem.result import Result
    from vofem.scene import Scene


def load(path: str | os.PathLike[str]) -> Any:
    """Return the Result that `Result.save` has written, or the Branch that `Branch.save` has written, whole.

    Every quantity at `times` is the same to the last bit, and of an
    event-driven run those at other times too, on a machine with the same
    libraries. Points are found by the name of their body and x, so points of
    the original bodies serve.

    Where the scene held Python callables, the values that the run has taken
    stand for them: what needs another value raises `MissingCallableError`,
    which names the callable.

    Parameters
    ----------
    path : path
        Of a file that `Result.save` or `Branch.save` has written.

    Returns
    -------
    Result or Branch

    Raises
    ------
    StorageError
        If the file is missing, of another kind, damaged, or of a newer vofem.
    """
    from vofem.files.hdf5 import reading
    from vofem.io.storage import branch_file, run_file

    with reading(path) as file:
        return branch_file.read(file) if branch_file.GROUP in file else run_file.read(file)


def resume(
    path: str | os.PathLike[str],
    *,
    scene: Scene | None = None,
    progress: Progress = None,
    checkpoint_every: float = 60.0,
) -> Result:
    """Go on with a run from its checkpoint, to the same outcome, bit for bit, as if it had never stopped.

    The checkpoint is kept up to date on the way.

    Parameters
    ----------
    path : path
        What was given as ``checkpoint`` to `vofem.simulate`.
    scene : Scene, optional
        Needed where the scene holds Python callables, which no file can hold:
        the same scene again.
    progress : bool or callable, optional
        As in `vofem.simulate`.
    checkpoint_every : float
        Seconds of wall time between two checkpoints.

    Returns
    -------
    Result

    Raises
    ------
    StorageError
        If the file is missing, of another kind, damaged, or of a newer vofem.
    ArgumentError
        If the scene is another one.
    MissingCallableError
        If the scene holds callables and was not given.
    """
    from vofem.io.storage import checkpoint

    return checkpoint.resume(path, scene=scene, progress=progress, checkpoint_every=checkpoint_every)
