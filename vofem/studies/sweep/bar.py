"""The progress of a sweep: points done, points that failed, time that remains."""

from __future__ import annotations

from collections.abc import Callable
from typing import Self

from vofem.progress import TerminalBar

#: What `progress` may be.
Progress = bool | Callable[[int, int, int], None] | None


class SweepBar:
    """Shows how far a sweep has come; a context manager.

    Parameters
    ----------
    total : int
        Points in all.
    done : int
        Points that a store holds already.
    progress : bool or callable, optional
        See `vofem.sweep`.
    """

    def __init__(self, total: int, done: int, progress: Progress) -> None:
        label = "sweep", "the points done, all points and the points that failed"
        counting = "{task.completed:.0f} of {task.total:.0f} points"
        self._bar = TerminalBar(label, progress, total, counting, done)
        self._total, self._report = total, progress if callable(progress) else None
        self._reported = (-1, -1)

    def __call__(self, done: int, failures: int) -> None:
        """Take note of how many points are done and how many of them failed."""
        if self._report is not None and (done, failures) != self._reported:
            self._reported = (done, failures)
            self._report(done, self._total, failures)
        self._bar.update(done, f"{failures} failed" if failures else "")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.__exit__()
