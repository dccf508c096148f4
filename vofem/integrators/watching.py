"""How a run is looked at from outside, and how it is interrupted between two steps."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from vofem.linalg.jit import compiling, waiting_interrupts

#: Plain data from which a run goes on as if it had never stopped.
Snapshot = dict[str, Any]


class Watch(Protocol):
    """Looks at a run from time to time."""

    def __call__(self, t: float, snapshot: Callable[[], Snapshot], last: bool = False) -> None:
        """Note the time reached in s; `snapshot` returns the run's state, `last` is true before an interruption."""


@contextlib.contextmanager
def deferred_interrupts() -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C wait for the end of a step; the function given tells whether it was pressed.

    A second Ctrl-C interrupts at once. So does the first one while kernels are compiled, or where they would be next:
    this takes longer than the steps that came before. Outside the main thread nothing is deferred.
    """
    pressed = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield pressed.is_set
        return
    before = signal.getsignal(signal.SIGINT)

    def handle(number: int, frame: Any) -> None:
        if pressed.is_set() or compiling():
            raise KeyboardInterrupt
        pressed.set()

    try:
        signal.signal(signal.SIGINT, handle)
    except ValueError:  # an interpreter within another program
        yield pressed.is_set
        return
    waiting_interrupts.append(pressed.is_set)
    try:
        yield pressed.is_set
    finally:
        waiting_interrupts.remove(pressed.is_set)
        signal.signal(signal.SIGINT, before if before is not None else signal.SIG_DFL)
