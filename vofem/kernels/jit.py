"""Kernels: functions that run as compiled code or as plain Python; numba is imported when one is first compiled."""

from __future__ import annotations

import contextlib
import os
import sys
import types
from collections.abc import Callable
from functools import cache, cached_property, update_wrapper
from traceback import walk_tb
from typing import Any, TypeVar, cast
from weakref import WeakSet

import numpy as np

from vofem.kernels.cache import own_name, source_stamp
from vofem.kernels.mode import check_patience, compiled

F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")


class Intrinsic:
    """Machine code for compiled functions to call, made when numba is there.

    Parameters
    ----------
    make : callable
        Returns what `numba.extending.intrinsic` has made.
    plain : callable
        The same function in plain Python.
    """

    def __init__(self, make: Callable[[], Any], plain: Callable[..., Any]) -> None:
        self.make = cache(make)
        self.plain = plain

    def __call__(self, *arguments: Any) -> Any:
        """Run the function in plain Python."""
        return self.plain(*arguments)


class CompiledFunction:
    """A Python function with its compiled form, which is made when it is first needed.

    A module that holds such functions is imported without numba. Other
    compiled functions call this one as if it had been decorated by numba itself.
    Which form runs is decided by `vofem.kernels.mode`.

    Attributes
    ----------
    py_func : callable
        The plain Python function.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.py_func = function
        self._dispatcher: Any = None
        self._callee: Any = None
        update_wrapper(self, function)

    def __reduce__(self) -> str:
        # Pickled by its place in its module, as a plain function is.
        return str(self.py_func.__qualname__)

    @property
    def dispatcher(self) -> Any:
        """The function as numba sees it."""
        if self._dispatcher is None:
            _MADE.add(self)
            self._dispatcher = _compiled(self.py_func)
        return self._dispatcher

    @property
    def prepared(self) -> Callable[..., Any]:
        """The plain function, which numba compiles from now on with the kernels that it calls."""
        _numba()
        return self.py_func

    @property
    def callee(self) -> Any:
        """The function as other compiled functions call it."""
        if self._callee is None:
            _MADE.add(self)
            self._callee = _part(self.py_func) or self.dispatcher
        return self._callee

    def forget(self) -> None:
        """Forget the compiled form, to compile it anew."""
        self._dispatcher = self._callee = None

    @property
    def compilations(self) -> int:
        """Number of times that the function was compiled in this process, once for every kind of arguments."""
        called = self._callee
        own = 0 if self._dispatcher is None else sum(self._dispatcher.stats.cache_misses.values())
        return own if called is None or called is self._dispatcher else own + len(called.signatures)

    @cached_property
    def plain(self) -> Callable[..., Any]:
        """The function in plain Python, which calls others in plain Python, at no more cost than that of the call."""
        function = self.py_func
        known = _plain_globals(function.__module__, function.__globals__)
        plain = types.FunctionType(
            function.__code__, known, function.__name__, function.__defaults__, function.__closure__
        )
        plain.__kwdefaults__ = function.__kwdefaults__
        return plain

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function, or the plain one."""
        if compiled():
            try:
                return (self._dispatcher or self.dispatcher)(*arguments)
            except Exception as error:
                if not _failed_to_compile(error):
                    raise
            return self.dispatcher(*arguments)
        check_patience()
        # Compiled code divides by zero and overflows without a warning.
        with np.errstate(all="ignore"):
            return self.plain(*arguments)


#: Whether kernels are compiled by `vofem.kernels.compiler`. It builds on parts of numba that may change from version to
#: version. If it fails once, numba compiles all kernels in its own way from then on.
_by_own_compiler = True

#: Kernels that have compiled forms.
_MADE: WeakSet[CompiledFunction] = WeakSet()


def compiled_anyhow(work: Callable[[], T]) -> T:
    """Return what work returns that compiles kernels; do it twice where the compiler of kernels fails."""
    try:
        return work()
    except Exception as error:
        if not _failed_to_compile(error):
            raise
    return work()


def _failed_to_compile(error: Exception) -> bool:
    """Return whether an error is one of the compiler of kernels, which is given up then.

    An error within numba comes from a compilation: machine code that raises leaves no trace there.
    """
    inside = (frame.f_globals.get("__name__", "") for frame, _ in walk_tb(error.__traceback__))
    if not (_by_own_compiler and any(name.split(".")[0] == "numba" for name in inside)):
        return False
    _give_up()
    return True


def _give_up() -> None:
    """Let numba compile all kernels in its own way."""
    global _by_own_compiler
    _by_own_compiler = False
    for kernel in _MADE:
        kernel.forget()


def _part(function: Callable[..., Any]) -> Any:
    """Return the form of a function that only compiled functions call, or None where numba makes no such form."""
    if _by_own_compiler:
        try:
            from vofem.kernels.compiler import callee

            return callee(function)
        except Exception:
            _give_up()
    return None


def _entry() -> dict[str, Any]:
    """Return options by which numba compiles functions that are called from Python."""
    if _by_own_compiler:
        try:
            from vofem.kernels.compiler import entry_compiler

            return {"pipeline_class": entry_compiler()}
        except Exception:
            _give_up()
    return {}


_PLAIN_GLOBALS: dict[str, dict[str, Any]] = {}


def _plain_globals(module: str, names: dict[str, Any]) -> dict[str, Any]:
    """Return the names of a module with kernels in plain Python."""
    known = _PLAIN_GLOBALS.get(module)
    if known is None:
        # Entered before it is filled: modules may use each other's kernels.
        known = _PLAIN_GLOBALS[module] = {}
        for name, value in names.items():
            known[name] = value.plain if isinstance(value, CompiledFunction | Intrinsic) else value
    return known


@cache
def _numba() -> Any:
    """Return numba, which from now on takes a `CompiledFunction` for the function that it stands for."""
    import numba
    from numba.extending import typeof_impl

    @typeof_impl.register(CompiledFunction)
    def type_of(function: CompiledFunction, context: Any) -> Any:
        return numba.types.Dispatcher(function.callee)

    @typeof_impl.register(Intrinsic)
    def type_of_intrinsic(function: Intrinsic, purpose: Any) -> Any:
        made = function.make()
        context = numba.core.registry.cpu_target.typing_context
        context.refresh()
        return context.resolve_value_type(made)

    return numba


#: The compiler's lock where it is held for a fork.
_held: list[Any] = []


def _before_fork() -> None:
    """Let compilations of other threads end: their lock would stay closed in the child."""
    lock = getattr(sys.modules.get("numba.core.compiler_lock"), "global_compiler_lock", None)
    if lock is not None:
        lock.acquire()
        _held.append(lock)


def _after_fork() -> None:
    while _held:
        _held.pop().release()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_parent=_after_fork, after_in_child=_after_fork)


def _compiled(function: Callable[..., Any]) -> Any:
    numba = _numba()
    options = {"no_cfunc_wrapper": True} | _entry()
    try:
        made = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # numba: "cannot cache function: no locator available"
        return numba.njit(**options)(function)
    # numba checks only a function's own file, although code that it calls is compiled into it. After a change elsewhere
    # it would use the old code. Internal names may change with its versions.
    with contextlib.suppress(AttributeError):
        file = made._cache._cache_file
        file._source_stamp = (*file._source_stamp, *source_stamp())
        file._load_index = _readable(file._load_index)
        # Two processes that compile one function for different arguments at once would give both files one name, and
        # the index of one of them would stand beside the code of the other.
        file._data_name = own_name(file._data_name)
    return made


def _readable(load: Callable[[], Any]) -> Callable[[], Any]:
    """Return a function that finds nothing in an index which names classes that this version no longer has."""

    def load_index() -> Any:
        try:
            return load()
        except (ImportError, AttributeError):
            return {}

    return load_index


def plain_form(kernel: Any) -> Callable[[F], F]:
    """Let a function take the place of a kernel in plain Python, as one that uses arrays where the kernel has loops."""

    def decorate(function: F) -> F:
        kernel.plain = function
        return function

    return decorate


def jit(function: F) -> F:
    """Make a function a kernel: compiled on its first call and kept on disk, or run as plain Python.

    Where no cache folder can be written the function is compiled for this
    process only. Arithmetic is IEEE: no reordering, no contraction. Compiled code
    raises ZeroDivisionError where a divisor is zero. In plain Python numbers of
    numpy become infinite instead: a kernel therefore checks a divisor that may be zero.
    """
    return cast(F, CompiledFunction(function))
