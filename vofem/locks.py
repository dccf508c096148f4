"""Locks that a forked process finds open.

Of the threads of a process only the one that forks goes on in the child. A lock that another thread held at that moment
would stay closed there for good. What such a lock guards here is changed in one step, when it is complete, so that the
child can begin anew. A module that another thread was importing could not be imported in the child any more, so a fork
waits for imports.
"""

from __future__ import annotations

import functools
import os
import sys
import threading
import time
import weakref
from types import FrameType, TracebackType

#: Time in s for which a fork waits for imports at most.
_LONGEST = 10.0

_LOCKS: weakref.WeakSet[Lock] = weakref.WeakSet()


class Lock:
    """A lock that a thread can enter again while it holds it, and that is open in a forked process."""

    def __init__(self) -> None:
        self.renew()
        _LOCKS.add(self)

    def renew(self) -> None:
        """Open the lock, whoever held it."""
        self._lock = threading.RLock()

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.release()


def _renew() -> None:
    for lock in list(_LOCKS):
        lock.renew()
    if sys.version_info < (3, 12):
        # Until then `functools.cached_property` takes a lock, one for all instances of a class.
        modules = [module for name, module in sys.modules.items() if name.startswith("vofem.")]
        kinds = [kind for module in modules for kind in vars(module).values() if isinstance(kind, type)]
        for part in [part for kind in kinds for part in vars(kind).values()]:
            if isinstance(part, functools.cached_property):
                vars(part)["lock"] = threading.RLock()


def _imports_elsewhere() -> bool:
    """Return whether another thread is importing a module."""
    own = threading.get_ident()
    for thread, frame in sys._current_frames().items():
        above: FrameType | None = frame
        while above is not None and thread != own:
            if above.f_code.co_filename.startswith("<frozen importlib"):
                return True
            above = above.f_back
    return False


def _wait_for_imports() -> None:
    end = time.monotonic() + _LONGEST
    while _imports_elsewhere() and time.monotonic() < end:
        time.sleep(0.001)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_wait_for_imports, after_in_child=_renew)
