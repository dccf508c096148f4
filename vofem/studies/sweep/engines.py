"""Where a sweep computes: in this process, in processes of its own, or on an executor of the user."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from typing import Any

from vofem.errors import ArgumentError
from vofem.studies.processors import processors
from vofem.studies.sweep.identity import name_of
from vofem.studies.sweep.worker import Row, Task, compute

Points = Sequence[dict[str, Any]]


class Engine:
    """Takes batches of points and returns futures of their rows.

    This one computes in the present process, one batch after the other. The others derive from it.
    """

    #: How many batches are computed at the same time.
    workers: int = 1
    #: How many batches may be handed over at the same time.
    capacity: int = 1
    #: Whether `restart` replaces workers that have ended abruptly.
    restarts: bool = False

    def submit(self, task: Task, points: Points) -> Future[list[Row]]:
        """Hand over a batch."""
        future: Future[list[Row]] = Future()
        future.set_result(compute(task, points))
        return future

    def restart(self) -> None:
        """End all workers at once; new ones start with the next batch."""
        self.close(at_once=True)

    def close(self, at_once: bool) -> None:
        """End what the engine has started itself; with `at_once` do not wait for batches."""


class Processes(Engine):
    """Processes that the sweep starts and ends itself (method "spawn").

    Parameters
    ----------
    workers : int
    """

    restarts = True

    def __init__(self, workers: int) -> None:
        self.workers = workers
        # One more than there are workers, so that none waits while this process writes rows.
        self.capacity = workers + 1
        self._pool: ProcessPoolExecutor | None = None

    def submit(self, task: Task, points: Points) -> Future[list[Row]]:
        """Hand over a batch; start the processes where there are none."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(self.workers, mp_context=context, initializer=_begin_worker)
        return self._pool.submit(compute, task, points)

    def close(self, at_once: bool) -> None:
        """End the processes."""
        pool, self._pool = self._pool, None
        if pool is None:
            return
        processes = list((getattr(pool, "_processes", None) or {}).values()) if at_once else []
        pool.shutdown(wait=not at_once, cancel_futures=True)
        for process in processes:
            with contextlib.suppress(OSError, ValueError, AttributeError):
                process.kill()


class Given(Engine):
    """An executor that the user has made, and ends.

    Parameters
    ----------
    executor : concurrent.futures.Executor
    workers : int
    """

    def __init__(self, executor: Executor, workers: int) -> None:
        self.workers = workers
        self.capacity = 2 * workers
        self._executor = executor

    def submit(self, task: Task, points: Points) -> Future[list[Row]]:
        """Hand over a batch."""
        return self._executor.submit(compute, task, points)


def engine_for(executor: Any, function: Callable[..., Any], workers: int | None) -> Engine:
    """Return the engine for the argument `executor` of a sweep.

    Raises
    ------
    ArgumentError
        If it is nothing that computes, or if the function cannot be sent to other processes.
    """
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int) or workers < 1):
        raise ArgumentError(f"sweep: workers is {workers!r}, expected a positive integer")
    if executor is None:
        _refuse_child()
        _check_sendable(function)
        return Processes(workers or processors())
    if executor == "serial":
        return Engine()
    if hasattr(executor, "get_executor") and hasattr(executor, "nthreads"):
        # A client of dask.distributed: each thread of its workers computes.
        threads = sum(executor.nthreads().values())
        _check_sendable(function)
        return Given(executor.get_executor(pure=False), workers or max(1, threads))
    if hasattr(executor, "submit") and hasattr(executor, "shutdown"):
        return Given(executor, workers or _size(executor))
    raise ArgumentError(
        f"sweep: executor is {executor!r}, expected None (processes), 'serial', a concurrent.futures.Executor, "
        "or a distributed.Client"
    )


def _size(executor: Any) -> int:
    """Return the number of workers of an executor, by the names that the known ones use."""
    for name in ("_max_workers", "num_workers", "max_workers"):
        size = getattr(executor, name, None)
        if isinstance(size, int) and size > 0:
            return size
    return processors()


def _check_sendable(function: Callable[..., Any]) -> None:
    try:
        pickle.dumps(function)
    except Exception as error:
        raise ArgumentError(
            f"sweep: {name_of(function)} cannot be sent to other processes ({error}); define it with def at the top "
            "level of a module (not inside a function, no lambda), or pass executor='serial'"
        ) from None


def _refuse_child() -> None:
    """Refuse to start processes while the main script is imported in a process of a sweep."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise ArgumentError(
            "sweep: a script starts a sweep whenever it is imported, and its processes import it; put the call under "
            "`if __name__ == '__main__':`"
        )


def _begin_worker() -> None:
    """Prepare a process: Ctrl-C is for the main process, and with that one it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: Any) -> None:
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)
