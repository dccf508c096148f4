"""Locks that a forked process finds open.

Of the threads of a process only the one that forks goes on in the child. A lock that another thread held at that moment
would stay closed there for good. What such a lock guards here is changed in one step, when it is complete, so that the
child can begin anew.
"""

from __future__ import annotations

import functools
import os
import sys
import threading
import weakref
from types import TracebackType

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


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew)
