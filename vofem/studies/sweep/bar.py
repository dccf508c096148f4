"""The progress bar of a sweep: points done, points that failed, time that remains."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

from vofem.errors import ArgumentError

#: What `progress` may be.
Progress = bool | Callable[[int, int, int], None] | None

#: Wall time before a bar appears, and between two changes of it, in s.
_PATIENCE, _REFRESH = 1.0, 0.1


class SweepBar:
    """Shows how far a sweep has come; a context manager.

    Parameters
    ----------
    total : int
        Points in all.
    done : int
        Points that a store holds already.
    progress : bool or callable, optional
        As in `vofem.sweep`.
    """

    def __init__(self, total: int, done: int, progress: Progress) -> None:
        if not (progress is None or isinstance(progress, bool) or callable(progress)):
            raise ArgumentError(
                f"sweep: progress is {progress!r}, expected True, False, or a function of the points done, all points "
                "and the points that failed"
            )
        self._total, self._first = total, done
        self._tell = progress if callable(progress) else None
        self._shown = progress is True or (progress is None and sys.stderr is not None and sys.stderr.isatty())
        self._begun = time.monotonic()
        self._drawn = self._begun + _PATIENCE - _REFRESH
        self._told = (-1, -1)
        self._bar: Any = None
        self._task: Any = None

    def __call__(self, done: int, failures: int) -> None:
        """Be told how many points are done and how many of them failed."""
        if self._tell is not None and (done, failures) != self._told:
            self._told = (done, failures)
            self._tell(done, self._total, failures)
        now = time.monotonic()
        if self._shown and now - self._drawn >= _REFRESH:
            self._draw(done, failures)
            self._drawn = now

    def _draw(self, done: int, failures: int) -> None:
        if self._bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            columns = (
                MofNCompleteColumn(),
                TextColumn("points"),
                BarColumn(),
                TimeRemainingColumn(),
                TextColumn("{task.description}"),
            )
            self._bar = Progress(*columns, console=Console(file=sys.stderr), transient=True, auto_refresh=False)
            self._bar.start()
            self._task = self._bar.add_task("", total=self._total, completed=self._first)
        self._bar.update(self._task, completed=done, description=f"{failures} failed" if failures else "", refresh=True)

    def __enter__(self) -> SweepBar:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()
