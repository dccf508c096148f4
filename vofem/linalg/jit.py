"""numba's compiler with a cache on disk where one can be had."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


@cache
def _stamp() -> tuple[float, int]:
    """Return the latest change and the total size of all sources that hold compiled functions."""
    root = Path(__file__).parent.parent
    found = [path.stat() for part in ("linalg", "integrators") for path in (root / part).rglob("*.py")]
    return max(status.st_mtime for status in found), sum(status.st_size for status in found)


def jit(function: F) -> F:
    """Compile a function on its first call and keep the machine code on disk.

    Where the cache folder cannot be written the function is compiled for this
    process only. Arithmetic is IEEE: no reordering, no contraction.
    """
    try:
        compiled = numba.njit(cache=True)(function)
    except RuntimeError:  # numba: "cannot cache function: no locator available"
        return numba.njit(function)
    # numba looks at a function's own file only, though code that it calls is compiled into it:
    # after a change elsewhere it would go on with the old. Internal names may change with its versions.
    with contextlib.suppress(AttributeError):
        file = compiled._cache._cache_file
        file._source_stamp = (*file._source_stamp, *_stamp())
    return compiled
