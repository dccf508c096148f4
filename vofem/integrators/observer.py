"""Observers of a run (progress bars, checkpoints), and interruption of a run between two steps."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from vofem.kernels.jit import compiling, runs_with_results, waiting_interrupts
from vofem.linalg.aside import giving_up, waiting

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


class Interrupts:
    """Whether Ctrl-C was pressed in a run.

    Attributes
    ----------
    presses : int
        How often Ctrl-C was pressed.
    """

    def __init__(self) -> None:
        self.presses = 0

    def __call__(self) -> bool:
        """Return whether Ctrl-C was pressed. A run makes the first call when it has results."""
        if self not in runs_with_results:
            runs_with_results.append(self)
        return self.presses > 0

    def pressed(self) -> bool:
        """Return whether Ctrl-C was pressed, without saying that there are results."""
        return self.presses > 0


@contextlib.contextmanager
def deferred_interrupts(keeps: bool = False) -> Iterator[Interrupts]:
    """Let Ctrl-C wait for the end of a step. The context is a function that returns whether it was pressed.

    A second Ctrl-C interrupts at once. So does the first one while kernels are compiled, or where they would be next,
    and during a large eigenproblem, as long as the function has not been called: until then a run has computed nothing
    that could be lost. Outside the main thread nothing is deferred.

    Parameters
    ----------
    keeps : bool
        Whether the run itself keeps its results after a `KeyboardInterrupt` with `presses` of 1. Then a large
        eigenproblem is given up also where there are results.
    """
    run = Interrupts()
    try:
        if threading.current_thread() is not threading.main_thread():
            yield run
        else:
            with _handled(run, keeps):
                yield run
    finally:
        if run in runs_with_results:
            runs_with_results.remove(run)


@contextlib.contextmanager
def _handled(run: Interrupts, keeps: bool) -> Iterator[None]:
    """Let a run count presses of Ctrl-C within this block, and decide which of them interrupt at once."""
    before = signal.getsignal(signal.SIGINT)

    def gives_up() -> bool:
        return run.pressed() and (keeps or not runs_with_results)

    def handle(number: int, frame: Any) -> None:
        run.presses += 1
        if run.presses > 1 and callable(before):
            # What started the run counts the presses that it hears of.
            before(number, frame)
        if run.presses > 1 or (waiting() and gives_up()) or compiling():
            raise KeyboardInterrupt

    try:
        signal.signal(signal.SIGINT, handle)
    except ValueError:  # an interpreter within another program
        yield
        return
    waiting_interrupts.append(run.pressed)
    giving_up.append(gives_up)
    try:
        yield
    finally:
        waiting_interrupts.remove(run.pressed)
        giving_up.remove(gives_up)
        signal.signal(signal.SIGINT, before if before is not None else signal.SIG_DFL)
