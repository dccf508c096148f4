"""A line on the terminal that says what a command does and for how long, while nothing else shows progress."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Iterator

#: Seconds before the line appears, and between two changes of it.
_PATIENCE, _REFRESH = 0.3, 0.2


@contextlib.contextmanager
def working(what: str) -> Iterator[None]:
    """Show what is being done, with the seconds that it has taken; removed at the end. Nothing without a terminal."""
    if not sys.stderr.isatty():
        yield
        return
    done = threading.Event()
    line = threading.Thread(target=_show, args=(what, done), daemon=True)
    line.start()
    try:
        yield
    finally:
        done.set()
        line.join()


def _show(what: str, done: threading.Event) -> None:
    begun, shown = time.monotonic(), False
    pause = _PATIENCE
    while not done.wait(pause):
        shown, pause = True, _REFRESH
        print(f"\r\x1b[K{what}: {time.monotonic() - begun:.1f} s", end="", file=sys.stderr, flush=True)
    if shown:
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)
