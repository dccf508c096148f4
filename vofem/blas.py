"""Threads of the linear algebra libraries: one for small matrices, for which several only wait for each other."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from typing import Any

from vofem.locks import Lock

#: Up to this many unknowns products and factors of dense matrices are small.
_SMALL = 400


class _Limit(contextlib.ContextDecorator):
    """One thread for all libraries, from the first entry to the last exit, in whatever threads these are."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._depth = 0
        self._limiter: Any = None
        self._known: tuple[bool, Any] | None = None

    def _controller(self) -> Any:
        """Return what sets the threads of the libraries that are loaded; None where it is not installed."""
        # SciPy brings a library of its own.
        loaded = "scipy.linalg" in sys.modules
        if self._known is None or self._known[0] != loaded:
            try:
                from threadpoolctl import ThreadpoolController
            except ImportError:
                return None
            self._known = loaded, ThreadpoolController()
        return self._known[1]

    def __enter__(self) -> None:
        with self._lock:
            if self._depth == 0:
                controller = self._controller()
                if controller is not None:
                    self._limiter = controller.limit(limits=1, user_api="blas")
            self._depth += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._depth -= 1
            if self._depth == 0 and self._limiter is not None:
                self._limiter.restore_original_limits()
                self._limiter = None


#: Keeps BLAS and LAPACK to one thread: a context, or a decorator of functions whose dense matrices are mostly small.
one_thread = _Limit()


@contextlib.contextmanager
def blas_threads(size: int) -> Iterator[None]:
    """Keep BLAS and LAPACK to one thread within, where matrices have few rows; what was set before comes back.

    `size`: rows of the largest dense matrix.
    """
    if size > _SMALL:
        yield
        return
    with one_thread:
        yield
