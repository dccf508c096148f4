"""`vofem.sweep`: one function for many points, on any executor, with rows kept in a file."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from vofem._validate import number
from vofem.errors import ArgumentError
from vofem.studies.sweep import Sweep
from vofem.studies.sweep.bar import Progress
from vofem.studies.sweep.engines import engine_for
from vofem.studies.sweep.identity import identity
from vofem.studies.sweep.points import as_points
from vofem.studies.sweep.run import run_sweep
from vofem.studies.sweep.worker import Task


def sweep(
    function: Callable[..., Mapping[str, Any]],
    points: Mapping[str, Iterable[Any]] | Iterable[Mapping[str, Any]] | Any,
    *,
    executor: Any = None,
    store: str | os.PathLike[str] | None = None,
    progress: Progress = None,
    workers: int | None = None,
    time_limit: float | None = None,
    retry_failed: bool = False,
    compiled: bool = True,
) -> Sweep:
    """Call a function for many points, and return its quantities as arrays over the points.

    A point whose function raises an error is a row of `Sweep.failed`, and the
    sweep goes on. All executors give the same bits: linear algebra uses one
    thread in every worker.

    Parameters
    ----------
    function : callable
        ``function(**point)`` returns a dict of numbers or arrays, the same
        names and shapes for every point. For other processes it stands at the
        top level of a module.
    points : mapping, table or iterable
        A mapping of names to lists: the grid of all combinations. A pandas
        DataFrame, a structured array, or an iterable of mappings: one point a
        row. Values are plain data: numbers, texts, arrays, lists.
    executor : optional
        None starts processes. ``"serial"`` computes in this process. Or any
        `concurrent.futures.Executor` (threads, loky, mpi4py, executorlib), or
        a `distributed.Client`. These stay open.
    store : path, optional
        An HDF5 file that keeps every row as it is computed. The same call
        after an interruption computes what is missing, and gives the same
        table. Rows belong to the source of the function and of what it calls
        in its own module; where that has changed, the old file is renamed and
        a note says so.
    progress : bool or callable, optional
        A bar on the standard error stream: True always, False never, None
        where that is a terminal. A function is called with the points done,
        all points, and the points that failed.
    workers : int, optional
        Processes to start (as many as there are processors), or how many
        batches the executor computes at the same time where it does not say.
    time_limit : float, optional
        Wall time in s that one point may take. Beyond it the point has
        failed. In threads and on dask it takes effect between two Python
        instructions; processes of the sweep are ended where that does not
        help within ten seconds.
    retry_failed : bool
        Whether points that failed in an earlier sweep are computed again.
    compiled : bool
        Whether kernels of vofem run as compiled code in all workers, which may have to be compiled once on a machine;
        False runs them as plain Python, which suits few and short runs. Results agree to rounding, not to the last
        bit, so rows of a store belong to one of both.

    Returns
    -------
    Sweep

    Raises
    ------
    ArgumentError
        For points, a function or an executor that cannot serve.
    OutputError
        If the store cannot be written (a full disk), or another process has it open. Stored rows stay.
    StorageError
        If the store is another file, or damaged.
    ExecutorError
        If an executor that was given takes no more work.
    SweepInterrupted
        After Ctrl-C; a `KeyboardInterrupt` that holds what was computed.

    Examples
    --------
    >>> def amplitude(omega: float, gap: float) -> dict:
    ...     return {"amplitude": 1.0 / abs(1.0 - omega**2) - gap}
    >>> table = vf.sweep(amplitude, {"omega": [0.2, 0.5], "gap": [0.0, 0.1, 0.2]}, executor="serial")
    >>> table["amplitude"].shape
    (2, 3)
    """
    if not callable(function):
        raise ArgumentError(f"sweep: function is {function!r}, expected a function that returns a dict of numbers")
    limit = None if time_limit is None else number("sweep: time_limit", time_limit, positive=True)
    table = as_points(points)
    engine = engine_for(executor, function, workers)
    task = Task(function, limit, bool(compiled))
    if store is None:
        return run_sweep(task, table, engine, None, progress)
    from vofem.studies.sweep.store import SweepFile

    file = SweepFile(store, identity(function, bool(compiled)))
    try:
        if retry_failed:
            file.forget_failed()
        try:
            outcome = run_sweep(task, table, engine, file, progress)
        finally:
            file.finish(table.keys)
    finally:
        file.close()
    return outcome.with_notes(file.notes)
