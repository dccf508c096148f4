"""`vofem.sweep`: one function for many points, on any executor, with rows kept in a file."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypedDict

from vofem._validate import flag, flag_or_none, number
from vofem.blas import blas_threads
from vofem.errors import ArgumentError
from vofem.kernels.mode import compiled as kernel_mode
from vofem.progress import SweepProgress, TerminalBar
from vofem.sharing import sharing_between_scenes
from vofem.studies.sweep.identity import identity
from vofem.studies.sweep.points import Points, as_points
from vofem.studies.sweep.running import Loop, Workers, workers_for
from vofem.studies.sweep.sweep import NOT_REACHED, Sweep, SweepInterrupted, sweep_of
from vofem.studies.sweep.worker import Row, Task

if TYPE_CHECKING:
    from vofem.studies.sweep.store import SweepFile


class SweepOptions(TypedDict, total=False):
    """The options of `sweep`, which studies of many runs take too."""

    executor: Any
    store: str | os.PathLike[str] | None
    progress: SweepProgress
    workers: int | None
    time_limit: float | None
    retry_failed: bool
    compiled: bool | None


def sweep(
    function: Callable[..., Mapping[str, Any]],
    points: Mapping[str, Iterable[Any]] | Iterable[Mapping[str, Any]] | Any,
    *,
    executor: Any = None,
    store: str | os.PathLike[str] | None = None,
    progress: SweepProgress = None,
    workers: int | None = None,
    time_limit: float | None = None,
    retry_failed: bool = False,
    compiled: bool | None = None,
) -> Sweep:
    """Call a function for many points, and return its quantities as arrays over the points.

    If the function raises an error at a point, the point is listed in `Sweep.failed`, and the sweep continues. All
    executors give the same numbers to the last bit, because linear algebra uses one thread in every worker.

    Parameters
    ----------
    function : callable
        ``function(**point)`` returns a dict of numbers or arrays, with the same names and shapes for every point. To
        run in other processes it must be defined at the top level of a module.
    points : mapping, table or iterable
        A mapping of names to lists means the grid of all combinations. A pandas DataFrame, a structured array or an
        iterable of mappings has one point in each row. Values are plain data: numbers, texts, arrays, lists.
    executor : optional
        With None the sweep starts processes. ``"serial"`` computes in this process. Any `concurrent.futures.Executor`
        (threads, loky, mpi4py, executorlib) or a `distributed.Client` can be given, and stays open.
    store : path, optional
        An HDF5 file to which every row is written as soon as it is computed. After an interruption the same call
        computes the missing rows and gives the same table. Rows are valid for what the function reaches: the source of
        functions and classes of your own files, and the content of data and scenes. If this has changed, the old file
        is renamed, and a note says so. Objects whose content cannot be known are named in a note.
    progress : bool or callable, optional
        Whether a progress bar is shown on the standard error stream; None shows it on a terminal. A function is called
        with the numbers of points that are done, of all points, and of points that failed.
    workers : int, optional
        Number of processes to start; the default is that of the processors. For an executor that does not tell its
        number of workers: how many batches are computed at the same time.
    time_limit : float, optional
        Largest wall time of one point in s. A point that takes longer has failed. In threads and on dask the limit
        takes effect between two Python instructions. Processes of the sweep are ended if they do not stop within ten
        seconds.
    retry_failed : bool
        Whether points that failed in an earlier sweep are computed again.
    compiled : bool, optional
        Whether the kernels of vofem run as compiled code in all workers, by default as the environment variable
        VOFEM_COMPILED says, and without it True. They may have to be compiled once on a machine. False runs them as
        plain Python, which suits few and short runs. Results of both ways agree to rounding, but not to the last bit,
        so a store holds rows of one way only.

    Returns
    -------
    Sweep

    Raises
    ------
    ArgumentError
        If the points, the function or the executor cannot be used.
    OutputError
        If the store cannot be written, or another process has it open. Stored rows are kept.
    StorageError
        If the file is not a store, or is damaged.
    ExecutorError
        If the given executor takes no more work.
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
    limit = None if limit is None or limit > threading.TIMEOUT_MAX else limit  # no timer runs for centuries
    table = as_points(points)
    own = workers_for(executor, function, workers)
    retry_failed = flag("sweep: retry_failed", retry_failed)
    asked = flag_or_none("sweep: compiled", compiled, "to follow VOFEM_COMPILED")
    compiled = kernel_mode() if asked is None else asked
    task = Task(function, limit, compiled)
    if store is None:
        return _computed(task, table, own, None, progress)
    from vofem.studies.sweep.store import SweepFile

    about, unknown = identity(function, compiled)
    with contextlib.closing(SweepFile(store, about)) as file:
        if retry_failed:
            file.forget_failed(table.keys)
        try:
            outcome = _computed(task, table, own, file, progress)
        finally:
            file.finish(table.keys)
    if unknown:
        file.notes.append(
            f"the store cannot notice whether this has changed since its rows were computed: {', '.join(unknown)}; if "
            "it has, remove the store. Numbers, arrays, scenes and objects that pickle can copy are noticed"
        )
    return outcome.with_notes(file.notes)


def _computed(task: Task, points: Points, workers: Workers, store: SweepFile | None, progress: SweepProgress) -> Sweep:
    """Return the rows of the store and those that are computed now as one table.

    Raises `SweepInterrupted` after Ctrl-C.
    """
    known = {} if store is None else store.rows()
    # The first position of each key that is not known.
    wanted = {key: k for k, key in reversed(list(enumerate(points.keys))) if key not in known}
    positions = sorted(wanted.values())
    stored = sum(key in known for key in points.keys)
    failures = sum(key in known and known[key].values is None for key in points.keys)
    done = stored

    def keep(batch: Sequence[int], rows: Sequence[Row]) -> None:
        nonlocal done, failures
        places = [positions[k] for k in batch]
        entries = [(points.keys[k], points.rows[k], row) for k, row in zip(places, rows, strict=True)]
        if store is not None:
            store.add(entries)
        known.update((key, row) for key, _, row in entries)
        done += len(entries)
        failures += sum(row.values is None for row in rows)

    label = "sweep", "the points done, all points and the points that failed"
    counting = "{task.completed:.0f} of {task.total:.0f} points"
    reported: tuple[int, ...] = ()
    with TerminalBar(label, progress, len(points.rows), counting, stored) as bar:

        def show() -> None:
            nonlocal reported
            now = done, len(points.rows), failures
            bar.update(done, f"{failures} failed" if failures else "", report=() if now == reported else now)
            reported = now

        loop = Loop(workers, task, [points.rows[k] for k in positions], keep, show)
        finished = False
        try:
            # Threads of an executor compute in this process: they all find the limit set.
            with blas_threads(0), sharing_between_scenes():
                loop.run()
            finished = True
        except KeyboardInterrupt:
            raise SweepInterrupted(
                _outcome(points, known, loop, done - stored, stored), None if store is None else store.path
            ) from None
        finally:
            workers.end(at_once=not finished)
            show()
    return _outcome(points, known, loop, done - stored, stored)


def _outcome(points: Points, known: Mapping[str, Row], loop: Loop, computed: int, stored: int) -> Sweep:
    """Return the table of the rows that are known, with notes on what a reader of it should know."""
    counters = {"computed": computed, "stored": stored, "batches": loop.batches, "restarts": loop.restarts}
    table = sweep_of(points, [known.get(key, NOT_REACHED) for key in points.keys], counters)
    notes = []
    if table.failed:
        count, total, first = len(table.failed), len(table.points.rows), table.failed[0].error
        notes.append(f"{count} of {total} points failed, the first with {first!r}; see `failed`")
    if loop.restarts:
        notes.append(f"workers had to be started anew {loop.restarts} times; their points were computed again")
    return table.with_notes(notes)
