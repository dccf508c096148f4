"""Large eigenproblems and drawing in a thread of their own, so that Ctrl-C does not wait for their end.

LAPACK may work for many seconds in one call, and Python handles a signal only between two calls of the main thread. A
thread that Ctrl-C leaves behind cannot be stopped. The interpreter waits for it at its end, because the libraries of
linear algebra may hang if they are closed while they work.

Matplotlib calls Python from code in C, which turns a `KeyboardInterrupt` into other errors or loses it. Python raises
`KeyboardInterrupt` in the main thread only, so that drawing in another one never meets it.
"""

from __future__ import annotations

import contextvars
import threading
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")

#: Rows from which on work is done aside: below, an eigenproblem takes some tenths of a second.
LARGE = 200

#: Seconds of one wait. On Windows Ctrl-C is heard only between two waits.
_WAIT = 0.2

#: Functions that return whether Ctrl-C has been pressed and large work is to be given up.
giving_up: list[Callable[[], bool]] = []

_waiting: list[object] = []
_left: list[threading.Thread] = []


def aside(work: Callable[[], T], rows: int) -> T:
    """Return what a piece of work returns, and leave it behind after Ctrl-C.

    Parameters
    ----------
    work : callable
        Must not change anything that others see, because it continues after Ctrl-C, and must not use a
        `vofem.cache.Cache`, which the main thread may have locked. It sees the context variables of the caller.
    rows : int
        Of the largest matrix. Small work, and that of other threads than the main one, is done where it is.

    Raises
    ------
    KeyboardInterrupt
        After Ctrl-C, if a run does not want to finish its step; also where it was pressed just before.
    """
    return work() if rows < LARGE else apart(work, "eigenproblem")


def apart(work: Callable[[], T], what: str) -> T:
    """Return what a piece of work returns, done in a thread of that name; see `aside`."""
    if threading.current_thread() is not threading.main_thread():
        return work()
    if any(asked() for asked in giving_up):
        raise KeyboardInterrupt
    done, results, errors = threading.Event(), list[T](), list[BaseException]()
    context = contextvars.copy_context()

    def run() -> None:
        try:
            results.append(context.run(work))
        except BaseException as error:
            errors.append(error)
        finally:
            done.set()

    thread = threading.Thread(target=run, name=f"vofem: {what}")
    _waiting.append(thread)
    try:
        thread.start()
        while not done.wait(_WAIT):
            pass
    except BaseException:
        _left.append(thread)
        raise
    finally:
        _waiting.remove(thread)
    if errors:
        raise errors[0]
    return results[0]


def waiting() -> bool:
    """Return whether the main thread waits for work that Ctrl-C may leave behind."""
    return bool(_waiting)


def left_behind() -> bool:
    """Return whether work that Ctrl-C has left behind is still running."""
    return any(thread.is_alive() for thread in _left)
