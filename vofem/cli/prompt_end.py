"""Ctrl-C before there are results: a thread ends the process, because Python may not hear of the signal for seconds.

A compiler or a large eigenproblem does not return to Python before it is done, and Python calls the handler of a signal
between two of its own instructions. A thread hears of the signal at once, through a pipe, and waits a second for the
handler.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator

from vofem.cli.common import INTERRUPTED

#: Seconds that Python's own handling of Ctrl-C has.
_PATIENCE = 1.0


@contextlib.contextmanager
def prompt_end() -> Iterator[None]:
    """Let Ctrl-C end the process soon while a run has no results yet, so that nothing else is lost."""
    if os.name != "posix" or threading.current_thread() is not threading.main_thread():
        yield
        return
    hears, tells = os.pipe()
    os.set_blocking(tells, False)
    before = signal.set_wakeup_fd(tells, warn_on_full_buffer=False)
    listener = threading.Thread(target=_listen, args=(hears,), daemon=True)
    listener.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        # The end of the pipe ends the thread.
        os.close(tells)
        listener.join()
        os.close(hears)


def _listen(hears: int) -> None:
    """Wait for signals; end the process where Ctrl-C finds it busy without results, and a second later still does."""
    while told := os.read(hears, 1):
        if told[0] == signal.SIGINT and _busy():
            time.sleep(_PATIENCE)
            busy = _busy()
            if busy:
                _end(busy)


def _busy() -> str:
    """Return what the process does that may be given up, for a message; "" if there is something to be lost."""
    kernels = sys.modules.get("vofem.kernels.jit")
    if kernels is None:
        return ""
    if kernels.compiling():
        return "while compiling"
    return "before the first result" if kernels.waiting_interrupts and not kernels.runs_with_results else ""


def _end(busy: str) -> None:
    """End the process without a word to Python, which does not listen."""
    # A bar of progress may have hidden the cursor.
    cursor = "\x1b[?25h\n" if sys.stderr.isatty() else ""
    with contextlib.suppress(OSError):
        os.write(2, f"{cursor}vofem: interrupted {busy}\n".encode())
    os._exit(INTERRUPTED)
