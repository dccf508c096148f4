"""Ctrl-C while kernels are compiled: the compiler may not return to Python for seconds, so a thread ends the process.

Python calls the handler of a signal between two of its own instructions. A thread hears of the signal at once, through
a pipe, and waits a second for the handler.
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
    """Let Ctrl-C end the process soon while machine code is made, which is all that is lost."""
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
    """Wait for signals; end the process where Ctrl-C finds the compiler at work, and a second later still does."""
    while told := os.read(hears, 1):
        if told[0] == signal.SIGINT and _compiling():
            time.sleep(_PATIENCE)
            if _compiling():
                _end()


def _compiling() -> bool:
    kernels = sys.modules.get("vofem.linalg.jit")
    return kernels is not None and bool(kernels.compiling())


def _end() -> None:
    """End the process without a word to Python, which does not listen."""
    # A bar of progress may have hidden the cursor.
    cursor = "\x1b[?25h\n" if sys.stderr.isatty() else ""
    with contextlib.suppress(OSError):
        os.write(2, f"{cursor}vofem: interrupted while compiling\n".encode())
    os._exit(INTERRUPTED)
