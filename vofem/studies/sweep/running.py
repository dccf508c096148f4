"""The loop of a sweep: an executor gets points in batches, and rows come back, fail or get lost."""

from __future__ import annotations

import ast
import contextlib
import math
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from pathlib import Path
from types import FrameType
from typing import Any

from vofem._validate import whole
from vofem.errors import ArgumentError, ExecutorError
from vofem.studies.processors import processors
from vofem.studies.sweep.identity import name_of
from vofem.studies.sweep.worker import Row, Task, compute, timed_out

#: Wall time that a batch is to take, in s: long against the cost of sending it, short enough to lose with a worker.
_BATCH = 0.4

#: How often a point may be in a worker that ends abruptly, alone the second time, before it counts as the cause.
_ATTEMPTS = 2

#: Wall time beyond its limit after which a batch that does not come back ends its worker, in s.
_GRACE = 10.0

#: Wall time in s between two checks of progress, limits and the keyboard.
_INTERVAL = 0.2


class Serial(Executor):
    """An executor that computes in this process, as soon as it gets something."""

    def submit(self, call: Callable[..., Any], /, *arguments: Any, **options: Any) -> Future[Any]:
        """Call a function, and return its answer as a future that is done."""
        future: Future[Any] = Future()
        future.set_result(call(*arguments, **options))
        return future


class Workers:
    """An executor and the number of its workers. Processes that the sweep has started itself can be replaced.

    `executor`: None for processes of the sweep's own (method "spawn").
    `own`: whether the processes are the sweep's own.
    `room`: how many batches are handed over at the same time.
    """

    def __init__(self, executor: Executor | None, count: int) -> None:
        self._executor = executor
        self.count, self.own = count, executor is None
        # One in reserve for each worker, so that none waits while this process writes rows.
        self.room = 1 if isinstance(executor, Serial) else 2 * count
        self._processes: set[Any] = set()

    def submit(self, task: Task, points: Sequence[dict[str, Any]]) -> Future[list[Row]]:
        """Hand over a batch; start the processes where there are none."""
        if self._executor is None:
            context = multiprocessing.get_context("spawn")
            self._executor = ProcessPoolExecutor(self.count, mp_context=context, initializer=_begin_worker)
        others = set(multiprocessing.active_children()) - self._processes
        future = self._executor.submit(compute, task, points)
        self._processes = set(multiprocessing.active_children()) - others
        return future

    def end(self, at_once: bool) -> None:
        """End the sweep's own processes, if any; with `at_once` kill them. New ones start with the next batch."""
        if not self.own or self._executor is None:
            return
        executor, self._executor = self._executor, None
        processes, self._processes = self._processes, set()
        executor.shutdown(wait=not at_once, cancel_futures=True)
        for process in processes if at_once else ():
            with contextlib.suppress(OSError, ValueError):
                process.kill()


def workers_for(executor: Any, function: Callable[..., Any], count: int | None) -> Workers:
    """Return the workers for the argument `executor` of a sweep.

    Raises `ArgumentError` if it is nothing that computes, or if the function cannot be sent to other processes.
    """
    if count is not None:
        count = whole("sweep: workers", count)
    if executor is None:
        _refuse_unguarded()
        _check_sendable(function)
        return Workers(None, count or processors())
    if executor == "serial":
        return Workers(Serial(), 1)
    if hasattr(executor, "get_executor") and hasattr(executor, "nthreads"):
        # A client of dask.distributed: each thread of its workers computes.
        threads = sum(executor.nthreads().values())
        _check_sendable(function)
        return Workers(executor.get_executor(pure=False), count or max(1, threads))
    if hasattr(executor, "submit") and hasattr(executor, "shutdown"):
        return Workers(executor, count or _size(executor))
    raise ArgumentError(
        f"sweep: executor is {executor!r}, expected None (processes), 'serial', a concurrent.futures.Executor, "
        "or a distributed.Client"
    )


#: Positions of points that were handed over together.
Batch = list[int]


class Loop:
    """Computes points with an executor.

    `keep`: called with positions and rows as batches come back.
    `check`: called a few times a second.
    `restarts`: how often workers had to be started anew.
    `batches`: batches that were handed over.
    """

    def __init__(
        self,
        workers: Workers,
        task: Task,
        points: Sequence[dict[str, Any]],
        keep: Callable[[Sequence[int], Sequence[Row]], None],
        check: Callable[[], None],
    ) -> None:
        self._workers, self._task, self._points = workers, task, points
        self._keep, self._check = keep, check
        self._waiting = deque(range(len(points)))
        # Points that are computed alone, which shows whether they are the cause of what happened in their batch.
        self._alone: deque[int] = deque()
        self._abrupt_ends: Counter[int] = Counter()
        #: Batches on their way, and when they were handed over.
        self._flying: dict[Future[list[Row]], tuple[Batch, float]] = {}
        self._seconds, self._counted = 0.0, 0
        self.restarts = self.batches = 0

    def run(self) -> None:
        """Compute all points.

        Raises `ExecutorError` if the executor breaks and cannot be started anew.
        """
        while self._waiting or self._alone or self._flying:
            lost = self._hand_over()
            finished, _ = wait(self._flying, timeout=_INTERVAL, return_when=FIRST_COMPLETED)
            for future in finished:
                batch, _ = self._flying.pop(future)
                if not self._took(future, batch):
                    lost.append(batch)
            if lost:
                self._go_on_after(lost)
            else:
                self._end_overdue()
            self._check()

    def _hand_over(self) -> list[Batch]:
        """Hand over as many batches as may be on their way; return the one that the executor could not take."""
        while (self._alone or self._waiting) and len(self._flying) < self._room():
            queue, size = (self._alone, 1) if self._alone else (self._waiting, self._size())
            batch, begun = [queue.popleft() for _ in range(size)], time.monotonic()
            try:
                future = self._workers.submit(self._task, [self._points[k] for k in batch])
            except RuntimeError as error:  # among them BrokenExecutor
                if not self._workers.own:
                    raise ExecutorError(_NO_MORE.format(error)) from None
                return [batch]
            self._flying[future] = batch, begun
            self.batches += 1
        return []

    def _room(self) -> int:
        """Return how many batches may be on their way."""
        suspect = self._alone or any(k in self._abrupt_ends for batch, _ in self._flying.values() for k in batch)
        if suspect or not self._counted:
            # The first point goes alone too: code is compiled once, and its time says how large batches are to be.
            return 1
        # Without a batch in reserve where time is limited: a batch that waits would seem to take long.
        return self._workers.room if self._task.limit is None else self._workers.count

    def _size(self) -> int:
        """Return the number of points of the next batch."""
        if not self._counted:
            return 1
        by_time = _BATCH / max(self._seconds / self._counted, 1e-7)
        share = math.ceil(len(self._waiting) / (2 * self._workers.count))
        return max(1, min(int(by_time), share, len(self._waiting)))

    def _took(self, future: Future[list[Row]], batch: Batch) -> bool:
        """Keep the rows of a batch that came back; return False where it was lost with its worker."""
        error = None if future.cancelled() else future.exception()
        ended = isinstance(error, BrokenExecutor) or type(error).__name__ in ("KilledWorker", "TerminatedWorkerError")
        if future.cancelled() or ended:
            return False
        if error is not None:
            # The executor could not send the batch or its rows; every other error is a row already.
            self._keep(batch, [Row(None, f"{type(error).__name__}: {error}")] * len(batch))
            return True
        rows = future.result()
        self._keep(batch, rows)
        if self._counted == 1:
            # The first point may have compiled code, which says nothing of the next ones.
            self._seconds, self._counted = 0.0, 0
        self._seconds += sum(row.seconds for row in rows)
        self._counted += len(rows)
        return True

    def _go_on_after(self, lost: list[Batch]) -> None:
        """Go on after workers have ended abruptly: their points are computed again, one at a time."""
        if self._workers.own:
            lost = lost + [batch for batch, _ in self._all_ended()]
        self.restarts += 1
        positions = sorted(k for batch in lost for k in batch)
        self._abrupt_ends.update(positions)
        if len(positions) == 1 and self._abrupt_ends[positions[0]] >= _ATTEMPTS:
            self._keep(positions, [Row(None, _ABRUPT)])
        else:
            self._alone.extend(positions)

    def _end_overdue(self) -> None:
        """End workers that hang where no timer reaches them: in a compiled loop, or with signals switched off."""
        limit = self._task.limit
        if limit is None or not self._workers.own:
            return
        now = time.monotonic()

        def late(batch: Batch, begun: float) -> bool:
            return now - begun > limit * len(batch) + _GRACE

        if not any(late(*one) for one in self._flying.values()):
            return
        self.restarts += 1
        for batch, begun in self._all_ended():
            if not late(batch, begun):
                self._waiting.extendleft(reversed(batch))
            elif len(batch) == 1:
                self._keep(batch, [Row(None, timed_out(limit), seconds=now - begun)])
            else:
                self._alone.extend(batch)

    def _all_ended(self) -> list[tuple[Batch, float]]:
        """End all workers, and return the batches that they had, and when they were handed over."""
        batches = list(self._flying.values())
        self._flying.clear()
        self._workers.end(at_once=True)
        return batches


_NO_MORE = (
    "sweep: the executor takes no more work ({}): it was shut down, or its workers ended abruptly (killed, "
    "out of memory, or a crash); make a new one and run again: rows in a store are not computed again"
)
_ABRUPT = "WorkerError: the process of the worker ended abruptly at this point: out of memory, killed, or a crash"


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


def _refuse_unguarded() -> None:
    """Refuse to start processes from a script that would start them again in each of these, which import it."""
    main = sys.modules["__main__"]
    frame: FrameType | None = sys._getframe()
    while frame is not None and not (frame.f_globals is vars(main) and frame.f_code.co_name == "<module>"):
        frame = frame.f_back
    path = getattr(main, "__file__", None)
    if frame is None or path is None:
        return
    try:
        statements = ast.parse(Path(path).read_bytes()).body
    except (OSError, SyntaxError, ValueError):
        return
    for statement in statements:
        names = {node.id for node in ast.walk(statement) if isinstance(node, ast.Name)}
        here = statement.lineno <= frame.f_lineno <= (statement.end_lineno or statement.lineno)
        # Earlier tests of the name may end the import.
        if "__name__" in names and (here or isinstance(statement, ast.If)):
            return
        if here:
            raise ArgumentError(
                f"sweep: line {frame.f_lineno} of {path} starts processes, and each of them imports this script and "
                "would start more; put what the script runs under `if __name__ == '__main__':`, or pass "
                "executor='serial'"
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
