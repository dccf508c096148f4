"""Compiled functions: numba is imported, and a function compiled, when it is first called."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from functools import cache, update_wrapper
from pathlib import Path
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

#: Rooms of the package that hold compiled functions.
_ROOMS = ("linalg", "laws", "integrators")


@cache
def _stamp() -> tuple[float, int]:
    """Return the latest change and the total size of all sources that hold compiled functions."""
    root = Path(__file__).parent.parent
    found = [path.stat() for part in _ROOMS for path in (root / part).rglob("*.py")]
    return max(status.st_mtime for status in found), sum(status.st_size for status in found)


class Intrinsic:
    """Machine code for compiled functions to call, made when numba is there.

    Parameters
    ----------
    make : callable
        Returns what `numba.extending.intrinsic` has made.
    """

    def __init__(self, make: Callable[[], Any]) -> None:
        self.make = cache(make)

    def __call__(self, *arguments: Any) -> Any:
        """Refuse: plain Python cannot call machine code by its address."""
        raise TypeError("an intrinsic is called from compiled functions only")


class CompiledFunction:
    """A Python function with its compiled form, which is made when it is first asked for.

    A module that holds compiled functions is imported without numba. Other
    compiled functions call this one as if it had been decorated by numba itself.

    Attributes
    ----------
    py_func : callable
        The plain Python function.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.py_func = function
        self._dispatcher: Any = None
        update_wrapper(self, function)

    @property
    def dispatcher(self) -> Any:
        """The function as numba sees it."""
        if self._dispatcher is None:
            self._dispatcher = _compiled(self.py_func)
        return self._dispatcher

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function."""
        return (self._dispatcher or self.dispatcher)(*arguments)


@cache
def _numba() -> Any:
    """Return numba, which from now on takes a `CompiledFunction` for the function that it stands for."""
    import numba
    from numba.extending import typeof_impl

    @typeof_impl.register(CompiledFunction)
    def type_of(function: CompiledFunction, context: Any) -> Any:
        return numba.types.Dispatcher(function.dispatcher)

    @typeof_impl.register(Intrinsic)
    def type_of_intrinsic(function: Intrinsic, purpose: Any) -> Any:
        made = function.make()
        context = numba.core.registry.cpu_target.typing_context
        context.refresh()
        return context.resolve_value_type(made)

    return numba


def _compiled(function: Callable[..., Any]) -> Any:
    numba = _numba()
    try:
        compiled = numba.njit(cache=True)(function)
    except RuntimeError:  # numba: "cannot cache function: no locator available"
        return numba.njit(function)
    # numba looks at a function's own file only, though code that it calls is compiled into it:
    # after a change elsewhere it would go on with the old. Internal names may change with its versions.
    with contextlib.suppress(AttributeError):
        file = compiled._cache._cache_file
        file._source_stamp = (*file._source_stamp, *_stamp())
        file._load_index = _readable(file._load_index)
    return compiled


def _readable(load: Callable[[], Any]) -> Callable[[], Any]:
    """Return a function that finds nothing in an index which names classes that this version no longer has."""

    def load_index() -> Any:
        try:
            return load()
        except (ImportError, AttributeError):
            return {}

    return load_index


def jit(function: F) -> F:
    """Compile a function on its first call and keep the machine code on disk.

    Where the cache folder cannot be written the function is compiled for this
    process only. Arithmetic is IEEE: no reordering, no contraction.
    """
    return cast(F, CompiledFunction(function))
