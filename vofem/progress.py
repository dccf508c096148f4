"""Progress of a long run: a bar on a terminal, checkpoints at intervals."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any, Self

from vofem.errors import ArgumentError

#: Seconds of wall time before a bar appears: most runs are over by then.
_PATIENCE = 1.0

#: Seconds of wall time between two changes of a bar.
_REFRESH = 0.1

#: What a bar says while kernels are compiled, with the kind of work.
COMPILING = "compiling {}, once on this machine"

#: Type of the argument `progress`.
Progress = bool | Callable[[float, float], None] | None

#: The same of a sweep, whose function takes the numbers of points done, of all points, and of those that failed.
SweepProgress = bool | Callable[[int, int, int], None] | None


class TerminalBar:
    """A progress bar on the standard error stream; a context manager.

    `label`: name of the function that was called and what a function given as `progress` is called with, for the error
    message: ``("simulate", "the time")``.
    `progress`: True shows the bar, False does not, None shows it where the stream is a terminal. With a function there
    is no bar.
    `total`: amount of work, in any unit.
    `counting`: text beside the bar, as rich formats it: ``{task.completed}`` and ``{task.total}`` stand for the
    numbers.
    `done`: work that was done before, which the estimate of the remaining time leaves out.
    `shown`: whether the bar will appear.
    Raises `ArgumentError` if `progress` is none of these.
    """

    def __init__(self, label: tuple[str, str], progress: Any, total: float, counting: str, done: float = 0.0) -> None:
        if not (progress is None or isinstance(progress, bool) or callable(progress)):
            caller, arguments = label
            raise ArgumentError(
                f"{caller}: progress is {progress!r}, expected True, False, or a function of {arguments}"
            )
        self.shown = progress is True or (progress is None and sys.stderr is not None and sys.stderr.isatty())
        self._total, self._counting, self._begin = total, counting, done
        self._label, self._report = label, progress if callable(progress) else None
        self._drawn = time.monotonic() + _PATIENCE - _REFRESH
        self._bar: Any = None
        self._task: Any = None

    @property
    def idle(self) -> bool:
        """Whether nothing is to be shown or called."""
        return self._report is None and not self.shown

    def update(
        self, done: float, description: str = "", *, at_once: bool = False, report: tuple[Any, ...] = ()
    ) -> None:
        """Show the work done and a description; seldom, unless `at_once`. Call the user's function with a report."""
        if self._report is not None and report:
            self._call(self._report, report)
        now = time.monotonic()
        if not self.shown or not (at_once or now - self._drawn >= _REFRESH):
            return
        if self._bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

            columns = (
                TextColumn("{task.description}"),
                TextColumn(self._counting),
                BarColumn(),
                TextColumn("{task.percentage:3.0f} %"),
                TimeRemainingColumn(),
            )
            self._bar = Progress(*columns, console=Console(file=sys.stderr), transient=True, auto_refresh=False)
            self._bar.start()
            self._task = self._bar.add_task("", total=self._total, completed=self._begin)
        self._bar.update(self._task, completed=done, description=description, refresh=True)
        self._drawn = now

    def _call(self, function: Callable[..., Any], report: tuple[Any, ...]) -> None:
        """Call the user's function; raise `ArgumentError` if it does not take the arguments."""
        try:
            function(*report)
        except TypeError as error:
            if error.__traceback__ is not None and error.__traceback__.tb_next is not None:
                raise  # from within the function
            caller, arguments = self._label
            raise ArgumentError(
                f"{caller}: progress is {function!r}, expected True, False, or a function of {arguments}; a call says: "
                f"{error}"
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()


class RunProgress:
    """Shows how far a run has come and saves it from time to time; a context manager.

    `t_end`: end of the run, s.
    `progress`: as for `TerminalBar`. A function is called with the time reached and t_end, in s.
    `save`: takes a snapshot.
    `every`: seconds of wall time between two snapshots.
    `first`: work that takes long before the first step; shown until the run reports its first time.
    `hint`: shown beside the bar: what would make the run shorter.
    """

    def __init__(
        self, t_end: float, progress: Progress, save: Callable[[dict[str, Any]], None] | None, every: float,
        first: str = "", hint: str = "",
    ) -> None:  # fmt: skip
        label = "simulate", "the time reached and t_end"
        self._bar = TerminalBar(label, progress, t_end, "t = {task.completed:.4g} of {task.total:.4g} s")
        self._t_end, self._save, self._every, self._first, self._hint = t_end, save, every, first, hint
        self._saved = time.monotonic()

    @property
    def idle(self) -> bool:
        """Whether nothing is to be shown, called or saved."""
        return self._save is None and self._bar.idle

    def __call__(self, t: float, snapshot: Callable[[], dict[str, Any]] | None, last: bool = False) -> None:
        """Take note of the time reached in s, without a snapshot that of a coarser run before the run."""
        if snapshot is None:
            self._bar.update(t, self._hint or "a coarser run first", at_once=bool(self._first))
            self._first = ""
            return
        if self._save is not None and (last or time.monotonic() - self._saved >= self._every):
            self._save(snapshot())
            self._saved = time.monotonic()
        # The work before the first step, such as compilation, is over, so its description is removed at once.
        self._bar.update(t, self._hint, at_once=bool(self._first), report=(t, self._t_end))
        self._first = ""

    def __enter__(self) -> Self:
        if self._first:
            self._bar.update(0.0, self._first, at_once=True)
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.__exit__()
