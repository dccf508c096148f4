"""Ctrl-C in a command: the first press interrupts it, the second one ends it at once.

A compiler, a large eigenproblem or the writing of a file does not return to Python before it is done, and Python calls
the handler of a signal between two of its own instructions. A thread hears of the signal at once, through a pipe, and
waits a second for the handler. Then it ends the process if there is nothing to lose, or if Ctrl-C was pressed twice.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from typing import Any

from vofem.cli.common import INTERRUPTED

#: Seconds that Python's own handling of Ctrl-C has.
_PATIENCE = 1.0

#: Of each command of this process that runs: how often its own handler was called.
_presses: list[int] = []


def pressed() -> bool:
    """Return whether Ctrl-C has interrupted the command. Code in C may turn the interrupt into another error."""
    return bool(_presses) and _presses[-1] > 0


@contextlib.contextmanager
def prompt_end() -> Iterator[None]:
    """Let Ctrl-C end the process soon while a run has no results yet, and let a second Ctrl-C end it in any case."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _presses.append(0)
    before = signal.getsignal(signal.SIGINT)
    # A process that was started in the background ignores Ctrl-C.
    handled = before is signal.default_int_handler
    try:
        with _listener() if os.name == "posix" else contextlib.nullcontext():
            if handled:
                signal.signal(signal.SIGINT, _handle)
            yield
    finally:
        if handled:
            signal.signal(signal.SIGINT, before)
        _presses.pop()


def _handle(number: int, frame: Any) -> None:
    """Interrupt the command, or end it: no error can get lost in the code that the second press meets."""
    _presses[-1] += 1
    if _presses[-1] > 1:
        _end()
    raise KeyboardInterrupt


@contextlib.contextmanager
def _listener() -> Iterator[None]:
    """Start the thread that hears of signals."""
    hears, tells = os.pipe()
    os.set_blocking(tells, False)
    before = signal.set_wakeup_fd(tells, warn_on_full_buffer=False)
    done = threading.Event()
    listener = threading.Thread(target=_listen, args=(hears, done), daemon=True)
    listener.start()
    try:
        yield
    finally:
        done.set()
        signal.set_wakeup_fd(before)
        # The end of the pipe ends the thread.
        os.close(tells)
        listener.join()
        os.close(hears)


def _listen(hears: int, done: threading.Event) -> None:
    """Wait for signals; end the process where Ctrl-C finds it busy without results, and a second later still does."""
    presses = 0
    while told := os.read(hears, 1):
        if told[0] != signal.SIGINT:
            continue
        presses += 1
        if (presses > 1 or _busy()) and not done.wait(_PATIENCE):
            busy = _busy()
            if presses > 1 or busy:
                _end(busy)


def _busy() -> str:
    """Return what the process does that may be given up, for a message; "" if there is something to be lost."""
    kernels = sys.modules.get("vofem.kernels.jit")
    if kernels is None:
        return ""
    if kernels.compiling():
        return "while compiling"
    return "before the first result" if kernels.waiting_interrupts and not kernels.runs_with_results else ""


def _end(busy: str = "") -> None:
    """End the process without a word to Python, which does not listen. Files that are not whole yet are removed."""
    # A bar of progress may have hidden the cursor.
    cursor = "\x1b[?25h\n" if sys.stderr.isatty() else ""
    with contextlib.suppress(OSError):
        os.write(2, f"{cursor}vofem: interrupted{' ' * bool(busy)}{busy}\n".encode())
    end_now(INTERRUPTED)


def end_now(code: int) -> None:
    """End the process with an exit code, whatever its threads do, and remove files that are not whole yet."""
    whole = sys.modules.get("vofem.files.whole")
    if whole is not None:
        whole.remove_unfinished()
    os._exit(code)
