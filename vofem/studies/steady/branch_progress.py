"""Progress and interruption of a continuation."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from vofem.integrators.observer import deferred_interrupts
from vofem.progress import Progress, TerminalBar
from vofem.studies.steady.point import Interval


@contextlib.contextmanager
def branch_progress(
    interval: Interval, progress: Progress, what: str = "continuation"
) -> Iterator[Callable[[float], bool]]:
    """Give a function that shows the parameter's value reached and returns whether Ctrl-C was pressed."""
    label = what, "the value reached and stop"
    counting = "{task.completed:.4g} of {task.total:.4g} along the interval"
    farthest = 0.0
    with TerminalBar(label, progress, interval.size, counting) as bar, deferred_interrupts() as interrupted:

        def report(value: float) -> bool:
            nonlocal farthest
            # A branch goes back and forth: the bar shows the farthest value.
            farthest = max(farthest, min(abs(value - interval.start), interval.size))
            bar.update(farthest, report=(value, interval.stop))
            return interrupted()

        yield report
