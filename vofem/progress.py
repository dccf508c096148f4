"""Progress of a long run: a bar on a terminal, checkpoints at intervals."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

from vofem.errors import ArgumentError

#: Seconds of wall time before a bar appears: most runs are over by then.
_PATIENCE = 1.0

#: Seconds of wall time between two changes of a bar.
_REFRESH = 0.1

#: What `progress` may be.
Progress = bool | Callable[[float, float], None] | None


class Watcher:
    """Shows how far a run has come and saves it from time to time; a context manager.

    Parameters
    ----------
    t_end : float
        In s.
    progress : bool or callable, optional
        A bar on the standard error stream: True always, False never, None
        where that is a terminal. A function is called with the time reached
        and t_end, in s.
    save : callable, optional
        Takes a snapshot.
    every : float
        Seconds of wall time between two snapshots.
    first : str
        What is done before the run begins, and takes long; shown until the run tells how far it is.
    """

    def __init__(
        self, t_end: float, progress: Progress, save: Callable[[dict[str, Any]], None] | None, every: float,
        first: str = "",
    ) -> None:  # fmt: skip
        if not (progress is None or isinstance(progress, bool) or callable(progress)):
            raise ArgumentError(
                f"simulate: progress is {progress!r}, expected True, False, or a function of the time reached and t_end"
            )
        self._t_end, self._save, self._every, self._first = t_end, save, every, first
        self._tell = progress if callable(progress) else None
        self._shown = progress is True or (progress is None and sys.stderr is not None and sys.stderr.isatty())
        self._begun = self._saved = time.monotonic()
        self._drawn = self._begun + _PATIENCE - _REFRESH
        self._bar: Any = None
        self._task: Any = None

    @property
    def idle(self) -> bool:
        """Whether there is nothing to watch for."""
        return self._save is None and self._tell is None and not self._shown

    def __call__(self, t: float, snapshot: Callable[[], dict[str, Any]], last: bool = False) -> None:
        """Be told the time reached in s."""
        now = time.monotonic()
        if self._save is not None and (last or now - self._saved >= self._every):
            self._save(snapshot())
            self._saved = time.monotonic()
        if self._tell is not None:
            self._tell(t, self._t_end)
        # What was announced before the run is over.
        over = bool(self._first) and self._bar is not None
        if self._shown and (over or now - self._drawn >= _REFRESH):
            self._first = ""
            self._draw(t)
            self._drawn = now

    def _draw(self, t: float) -> None:
        if self._bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

            columns = (
                TextColumn("{task.description}"),
                TextColumn("t = {task.completed:.4g} of {task.total:.4g} s"),
                BarColumn(),
                TextColumn("{task.percentage:3.0f} %"),
                TimeRemainingColumn(),
            )
            self._bar = Progress(*columns, console=Console(file=sys.stderr), transient=True, auto_refresh=False)
            self._bar.start()
            self._task = self._bar.add_task("", total=self._t_end)
        self._bar.update(self._task, completed=t, description=self._first, refresh=True)

    def __enter__(self) -> Watcher:
        if self._shown and self._first:
            self._draw(0.0)
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()
