"""Observers of a run (progress bars, checkpoints), and interruption of a run between two steps."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from vofem.kernels.jit import compiling, runs_with_results, waiting_interrupts

#: Plain data from which a run goes on as if it had never stopped.
Snapshot = dict[str, Any]


class Observer(Protocol):
    """A function that a run calls from time to time, to show progress and to save checkpoints."""

    def __call__(self, t: float, snapshot: Callable[[], Snapshot], last: bool = False) -> None:
        """Take notice of the time t in s that the run has reached.

        Parameters
        ----------
        t : float
        snapshot : callable
            Returns the state of the run as plain data, from which it can be resumed.
        last : bool
            Whether the run is interrupted after this call.
        """


@contextlib.contextmanager
def deferred_interrupts() -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C wait for the end of a step. The context is a function that returns whether it was pressed.

    A second Ctrl-C interrupts at once. So does the first one while kernels are compiled, or where they would be next,
    as long as the function has not been called: until then a run has computed nothing that could be lost. Outside the
    main thread nothing is deferred.
    """
    pressed, run = threading.Event(), object()
    if threading.current_thread() is not threading.main_thread():
        yield pressed.is_set
        return

    def asked() -> bool:
        if run not in runs_with_results:
            runs_with_results.append(run)
        return pressed.is_set()

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
        yield asked
    finally:
        waiting_interrupts.remove(pressed.is_set)
        if run in runs_with_results:
            runs_with_results.remove(run)
        signal.signal(signal.SIGINT, before if before is not None else signal.SIG_DFL)
