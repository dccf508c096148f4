"""Progress and interruption of a walk along a branch."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from vofem.integrators.watching import deferred_interrupts
from vofem.progress import Progress, Watcher
from vofem.studies.steady.point import Interval


@contextlib.contextmanager
def watched(interval: Interval, progress: Progress) -> Iterator[Callable[[float], bool]]:
    """Show how far a walk has come; the function given takes the value reached and says whether Ctrl-C was pressed."""
    reached = 0.0
    tell = (lambda _, __: None) if callable(progress) else progress
    with Watcher(interval.size, tell, None, 60.0) as watcher, deferred_interrupts() as interrupted:

        def told(value: float) -> bool:
            nonlocal reached
            # Branches go back and forth: the bar shows how far they have come.
            reached = max(reached, min(abs(value - interval.start), interval.size))
            if callable(progress):
                progress(value, interval.stop)
            elif not watcher.idle:
                watcher(reached, dict)
            return interrupted()

        yield told
