"""Observers of a run (progress bars, checkpoints), and interruption of a run between two steps."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from vofem.kernels.mode import have_patience

#: Plain data from which a run goes on as if it had never stopped.
Snapshot = dict[str, Any]


class Observer(Protocol):
    """A function that a run calls from time to time, to show progress and to save checkpoints."""

    def __call__(self, t: float, snapshot: Callable[[], Snapshot] | None, last: bool = False) -> None:
        """Take notice of the time t in s that the run has reached.

        `snapshot`: returns the state of the run as plain data, from which it can be resumed. None in a coarser run
        before it.
        `last`: whether the run is interrupted after this call.
        """


class _Deferred:
    """A handler of Ctrl-C that counts presses, tells them to the handler of before, and interrupts from the second on.

    The handler of before may be that of a command, which ends the process at the second press, or that of a loop around
    this one, which ends too.
    """

    def __init__(self) -> None:
        self.presses = 0
        self.before = signal.getsignal(signal.SIGINT)

    def __call__(self, number: int, frame: Any) -> None:
        """Count a press."""
        self.presses += 1
        have_patience()
        try:
            if callable(self.before):
                self.before(number, frame)
        except KeyboardInterrupt:
            if self.presses > 1 or isinstance(self.before, _Deferred):
                raise
        if self.presses > 1:
            raise KeyboardInterrupt


@contextlib.contextmanager
def deferred_interrupts() -> Iterator[Callable[[], bool]]:
    """Let the first Ctrl-C wait for the end of a step; the second one interrupts at once.

    The context is a function that returns whether Ctrl-C was pressed. Outside the main thread, where Python hears no
    signals, nothing is deferred.
    """
    handler = _Deferred()
    handled = True
    try:
        signal.signal(signal.SIGINT, handler)
    except ValueError:  # another thread, or an interpreter within another program
        handled = False
    try:
        yield lambda: handler.presses > 0
    finally:
        if handled:
            signal.signal(signal.SIGINT, signal.SIG_DFL if handler.before is None else handler.before)


def advanced(
    advance: Callable[[], object], finished: Callable[[], bool], reached: Callable[[], float],
    snapshot: Callable[[], Snapshot], observer: Observer | None,
) -> bool:  # fmt: skip
    """Advance a run, part by part, until it has finished; return False where Ctrl-C ended it before.

    `reached`: returns the time reached, s.
    """
    with deferred_interrupts() as interrupted:
        while not finished():
            advance()
            last = interrupted() and not finished()
            if observer is not None:
                observer(reached(), snapshot, last)
            if last:
                return False
    return True


def interruption(t: float, t_end: float) -> str:
    """Return the note of a run that was interrupted at a time in s before its end."""
    return f"interrupted at t = {t:g} s of {t_end:g} s: what was computed until then is here"
