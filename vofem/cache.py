"""A cache of values that were computed for an object, by kind and key, with a bound on their number."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from typing import TypeVar

from vofem.kernels.mode import compiled
from vofem.locks import Lock

T = TypeVar("T")


class Cache:
    """Values by kind and key. Threads may share it: if one of them computes a value, the others wait for it."""

    def __init__(self) -> None:
        self._known: dict[str, dict[Hashable, object]] = {}
        self._lock = Lock()

    def adopt(self, kinds: Iterable[str], other: Cache) -> None:
        """Hold values of some kinds together with another cache, from now on; what this one knew of them is dropped."""
        self._lock = other._lock
        with self._lock:
            for kind in kinds:
                self._known[kind] = other._known.setdefault(kind, {})

    def get(self, kind: str, key: Hashable, make: Callable[[], T], most: int = 1) -> T:
        """Return the value of a key, which is made where it is not known.

        `kind`: what the value is.
        `key`: what it depends on beside the object that owns the cache, and beside whether kernels are compiled.
        `make`: returns the value.
        `most`: how many values of the kind are kept; the oldest make room.
        """
        with self._lock:
            known = self._known.setdefault(kind, {})
            # Compiled and plain kernels differ by rounding, and no run may mix them.
            key = compiled(), key
            if key not in known:
                value = make()
                while len(known) >= max(most, 1):
                    del known[next(iter(known))]
                known[key] = value
            return known[key]  # type: ignore[return-value]
