"""Scenes that are made anew for every point of a sweep share what is equal in them: matrices of beams, and modes.

A function of a sweep often builds its scene from nothing, with other numbers each time. Where matrices, rows and load
vectors are the same as those of a scene before it, the modes are the same too. Within `sharing_between_scenes` every
scene that is assembled looks for them in the scenes before it. Results keep their bits: what is shared does not depend
on the scene that has computed it.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from vofem.system import System

T = TypeVar("T")

#: How many systems, and how many matrices of bodies, a thread remembers. A point of a sweep mostly builds one or two
#: scenes.
_MOST = 4


class _Recent(threading.local):
    """The systems that one thread has assembled last, the latest first, and values by the data that they depend on."""

    def __init__(self) -> None:
        self.systems: deque[System] = deque(maxlen=_MOST)
        self.values: dict[Hashable, object] = {}
        self.active = 0


_recent = _Recent()


@contextmanager
def sharing_between_scenes(*, keep: bool = False) -> Iterator[None]:
    """Let scenes that this thread assembles share with those that it has assembled before.

    `keep`: whether the thread remembers its latest systems after the end, for the next time. Workers of sweeps do.
    """
    _recent.active += 1
    try:
        yield
    finally:
        _recent.active -= 1
        if not (keep or _recent.active):
            _recent.systems.clear()
            _recent.values.clear()


def share_with_recent(system: System) -> None:
    """Share with the latest system that this thread has assembled and that is equal to it where it matters."""
    if not _recent.active:
        return
    for known in _recent.systems:
        if system.share_what_is_equal(known):
            break
    _recent.systems.appendleft(system)


def recent(key: Hashable, make: Callable[[], T]) -> T:
    """Return a value that scenes share by what it depends on; made where it is not known, or nothing is shared.

    `key`: all that the value depends on.
    `make`: returns the value, which nobody changes.
    """
    if not _recent.active:
        return make()
    if key not in _recent.values:
        value = make()
        while len(_recent.values) >= _MOST:
            del _recent.values[next(iter(_recent.values))]
        _recent.values[key] = value
    return _recent.values[key]  # type: ignore[return-value]


__all__ = ["recent", "share_with_recent", "sharing_between_scenes"]
