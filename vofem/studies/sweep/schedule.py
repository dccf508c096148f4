"""Gives points to an engine in batches, and handles rows that come back, fail or get lost."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass, field
from typing import Any

from vofem.errors import ExecutorError
from vofem.studies.sweep.engines import Engine
from vofem.studies.sweep.worker import Row, Task, failed, timed_out

#: Wall time that a batch is to take, in s: long against the cost of sending it, short enough to lose with a worker.
_BATCH = 0.4

#: How often a point may be in a worker that ends abruptly, alone the second time, before it counts as the cause.
_ATTEMPTS = 2

#: Wall time beyond its limit after which a batch that does not come back ends its worker, in s.
_GRACE = 10.0

#: Wall time in s between two checks of progress, limits and the keyboard.
_INTERVAL = 0.2


@dataclass
class _Batch:
    """Positions of points that were handed over together."""

    positions: Sequence[int]
    begun: float = field(default_factory=time.monotonic)


class Schedule:
    """One sweep over points that are not in its store.

    Parameters
    ----------
    engine : Engine
    task : Task
    points : sequence of dict
    keep : callable
        Called with positions and rows as batches come back.
    check : callable
        Called a few times a second.

    Attributes
    ----------
    restarts : int
        How often workers had to be started anew.
    batches : int
        Batches that were handed over.
    """

    def __init__(
        self,
        engine: Engine,
        task: Task,
        points: Sequence[dict[str, Any]],
        keep: Callable[[Sequence[int], Sequence[Row]], None],
        check: Callable[[], None],
    ) -> None:
        self._engine, self._task, self._points = engine, task, points
        self._keep, self._check = keep, check
        self._waiting = deque(range(len(points)))
        self._alone: deque[int] = deque()
        self._abrupt_ends = [0] * len(points)
        self._flying: dict[Future[list[Row]], _Batch] = {}
        self._seconds, self._counted = 0.0, 0
        self.restarts = self.batches = 0

    def run(self) -> None:
        """Compute all points.

        Raises
        ------
        ExecutorError
            If the executor breaks and cannot be started anew.
        """
        while self._waiting or self._alone or self._flying:
            self._fill()
            finished, _ = wait(self._flying, timeout=_INTERVAL, return_when=FIRST_COMPLETED)
            broken = [batch for future in finished if (batch := self._take(future)) is not None]
            if broken:
                self._recover(broken)
            else:
                self._end_overdue()
            self._check()

    def _fill(self) -> None:
        """Hand over as many batches as the engine takes."""
        while len(self._flying) < self._room():
            if self._alone:
                positions = [self._alone.popleft()]
            elif self._waiting:
                positions = [self._waiting.popleft() for _ in range(self._size())]
            else:
                return
            self._submit(_Batch(positions))

    def _room(self) -> int:
        """Return how many batches may be on their way."""
        if self._alone or any(self._abrupt_ends[batch.positions[0]] for batch in self._flying.values()):
            # A point whose worker ended abruptly is computed alone next time, which shows whether it was the cause.
            return 1
        if not self._counted:
            # The first point goes alone: code is compiled once, and its time says how large batches are to be.
            return 1
        # Without a batch in reserve where time is limited: a batch that waits would seem to take long.
        return self._engine.workers if self._task.limit is not None else self._engine.capacity

    def _size(self) -> int:
        """Return the number of points of the next batch."""
        if not self._counted:
            return 1
        by_time = _BATCH / max(self._seconds / self._counted, 1e-7)
        share = math.ceil(len(self._waiting) / (2 * self._engine.workers))
        return max(1, min(int(by_time), share, len(self._waiting)))

    def _submit(self, batch: _Batch) -> None:
        try:
            future = self._engine.submit(self._task, [self._points[k] for k in batch.positions])
        except RuntimeError as error:  # among them BrokenExecutor
            if not self._engine.restarts:
                raise ExecutorError(_NO_MORE.format(error)) from None
            self._recover([batch])
            return
        self._flying[future] = batch
        self.batches += 1

    def _take(self, future: Future[list[Row]]) -> _Batch | None:
        """Keep the rows of a batch that came back; return the batch where it was lost with its worker."""
        batch = self._flying.pop(future)
        error = None if future.cancelled() else future.exception()
        if future.cancelled() or _worker_ended(error):
            return batch
        if error is not None:
            # The executor could not send the batch or its rows; every other error is a row already.
            self._keep(batch.positions, [failed(f"{type(error).__name__}: {error}") for _ in batch.positions])
            return None
        rows = future.result()
        self._keep(batch.positions, rows)
        self._seconds += sum(row.seconds for row in rows)
        self._counted += len(rows)
        # The first point may have compiled code, which says nothing of the next ones.
        if self._counted > 1 == self._counted - len(rows):
            self._seconds, self._counted = sum(row.seconds for row in rows), len(rows)
        return None

    def _recover(self, broken: list[_Batch]) -> None:
        """Go on after workers have ended abruptly: their points are computed again, one at a time."""
        if self._engine.restarts:
            broken += self._flying.values()
            self._flying.clear()
            self._engine.restart()
        self.restarts += 1
        positions = sorted(k for batch in broken for k in batch.positions)
        alone = len(positions) == 1
        for k in positions:
            self._abrupt_ends[k] += 1
            if alone and self._abrupt_ends[k] >= _ATTEMPTS:
                self._keep([k], [failed(_ABRUPT)])
            else:
                self._alone.append(k)

    def _end_overdue(self) -> None:
        """End workers that hang where no timer reaches them: in a compiled loop, or with signals switched off."""
        limit = self._task.limit
        if limit is None or not self._engine.restarts:
            return
        now = time.monotonic()
        late = [batch for batch in self._flying.values() if now - batch.begun > limit * len(batch.positions) + _GRACE]
        if not late:
            return
        others = [batch for batch in self._flying.values() if batch not in late]
        self._flying.clear()
        self._engine.restart()
        self.restarts += 1
        for batch in late:
            if len(batch.positions) == 1:
                self._keep(batch.positions, [failed(timed_out(limit), now - batch.begun)])
            else:
                self._alone.extend(batch.positions)
        for batch in others:
            self._waiting.extendleft(reversed(batch.positions))


_NO_MORE = (
    "sweep: the executor takes no more work ({}): it was shut down, or its workers ended abruptly (killed, "
    "out of memory, or a crash); make a new one and run again: rows in a store are not computed again"
)
_ABRUPT = "WorkerError: the process of the worker ended abruptly at this point: out of memory, killed, or a crash"


def _worker_ended(error: BaseException | None) -> bool:
    """Return whether an error says that a worker has ended, whatever the executor."""
    return isinstance(error, BrokenExecutor) or type(error).__name__ in ("KilledWorker", "TerminatedWorkerError")
