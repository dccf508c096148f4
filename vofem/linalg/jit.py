"""numba's compiler with a cache on disk where one can be had."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def jit(function: F) -> F:
    """Compile a function on its first call and keep the machine code on disk.

    Where the cache folder cannot be written the function is compiled for this
    process only. Arithmetic is IEEE: no reordering, no contraction.
    """
    try:
        return numba.njit(cache=True)(function)
    except RuntimeError:  # numba: "cannot cache function: no locator available"
        return numba.njit(function)
