"""Kernels: functions that run as compiled code or as plain Python; numba is imported when one is first compiled."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
import threading
import types
from collections.abc import Callable, Iterator
from functools import cache, cached_property, update_wrapper
from typing import Any, TypeVar, cast

import numpy as np

from vofem.kernels.cache import Turn, code_folder
from vofem.kernels.mode import check_patience, compiled

F = TypeVar("F", bound=Callable[..., Any])


class Intrinsic:
    """Machine code for compiled functions to call, made when numba is there.

    `make`: returns what `numba.extending.intrinsic` has made.
    `plain`: the same function in plain Python.
    """

    def __init__(self, make: Callable[[], Any], plain: Callable[..., Any]) -> None:
        self._make, self.plain = make, plain

    @cached_property
    def callee(self) -> Any:
        """The function as compiled functions call it."""
        return self._make()

    def __call__(self, *arguments: Any) -> Any:
        """Run the function in plain Python."""
        return self.plain(*arguments)


class CompiledFunction:
    """A Python function with its compiled form, which is made when it is first needed.

    A module that holds such functions is imported without numba. Which form runs is decided by `vofem.kernels.mode`.

    `py_func`: the plain Python function.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.py_func = function
        update_wrapper(self, function)

    def __reduce__(self) -> str:
        # Pickled by its place in its module, as a plain function is.
        return str(self.py_func.__qualname__)

    @cached_property
    def dispatcher(self) -> Any:
        """The function as Python calls it, kept on disk."""
        return compiled_form(imported_numba().njit, self.prepared, no_cfunc_wrapper=True)

    @cached_property
    def callee(self) -> Any:
        """The function as other compiled functions call it: without the wrappers that calls from Python need."""
        if "dispatcher" in vars(self):
            return self.dispatcher
        njit = imported_numba().njit
        return njit(no_cfunc_wrapper=True, no_cpython_wrapper=True, error_model="numpy")(self.prepared)

    @cached_property
    def prepared(self) -> Any:
        """The function for numba: with the compiled forms of the kernels that it calls."""
        return _linked(self.py_func, "callee")

    @cached_property
    def plain(self) -> Any:
        """The function in plain Python, which calls others in plain Python, at no more cost than that of the call."""
        return _linked(self.py_func, "plain")

    @property
    def compilations(self) -> int:
        """Number of times that the function was compiled in this process, once for every kind of arguments."""
        made = vars(self)
        entry, part = made.get("dispatcher"), made.get("callee")
        own = 0 if entry is None else sum(entry.stats.cache_misses.values())
        return own if part is None or part is entry else own + len(part.signatures)

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function, or the plain one."""
        if compiled():
            if "dispatcher" in vars(self):
                return self.dispatcher(*arguments)
            with compiling():
                return self.dispatcher(*arguments)
        check_patience()
        # Compiled code divides by zero and overflows without a warning.
        with np.errstate(all="ignore"):
            return self.plain(*arguments)


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Compile within this block, which ends in KeyboardInterrupt where Ctrl-C was pressed.

    LLVM calls Python back, hears of Ctrl-C there, and drops the exception. Python does not look for garbage: it would
    look through all of numba's trees in vain.
    """
    active, before, dropped = gc.isenabled(), sys.unraisablehook, list[Any]()

    def hook(unraisable: Any) -> None:
        if unraisable.exc_type is KeyboardInterrupt:
            dropped.append(unraisable.exc_value)
        else:
            before(unraisable)

    gc.disable()
    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before
        if active:
            gc.enable()
    if dropped:
        raise KeyboardInterrupt


def _linked(function: Callable[..., Any], form: str) -> Callable[..., Any]:
    """Return a function that calls one form (`plain` or `callee`) of all kernels that it names."""
    known = function.__globals__
    own = {name: known[name] for name in ("__name__", "__builtins__", *_names(function.__code__)) if name in known}
    linked = types.FunctionType(function.__code__, own, function.__name__, function.__defaults__, function.__closure__)
    linked.__kwdefaults__, linked.__qualname__ = function.__kwdefaults__, function.__qualname__
    for name, value in own.items():
        if isinstance(value, CompiledFunction | Intrinsic):
            own[name] = getattr(value, form)
    return linked


def _names(code: types.CodeType) -> set[str]:
    """Return the names that a function and the functions within it use."""
    inner = (_names(part) for part in code.co_consts if isinstance(part, types.CodeType))
    return set(code.co_names).union(*inner)


def _borrowed() -> Any:
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    def strip(context: Any, builder: Any, kind: Any, value: Any) -> Any:
        if isinstance(kind, types.Array):
            array = context.make_array(kind)(context, builder, value)
            array.meminfo, array.parent = (ir.Constant(part.type, None) for part in (array.meminfo, array.parent))
            return array._getvalue()
        if isinstance(kind, types.BaseTuple):
            for i, part in enumerate(kind):
                inner = strip(context, builder, part, builder.extract_value(value, i))
                value = builder.insert_value(value, inner, i)
        return value

    @intrinsic
    def borrowed(typing_context: Any, bundle: Any) -> Any:
        return bundle(bundle), lambda context, builder, signature, given: strip(context, builder, bundle, given[0])

    return borrowed


#: ``borrowed(argument)`` in a kernel is the same array, or tuple of arrays, without an owner. The caller keeps the
#: arrays for the time of the call, so numba need not count references wherever the kernel passes one on or takes a row
#: of it. Only arguments may be borrowed, and they must not be returned.
borrowed: Any = Intrinsic(_borrowed, lambda bundle: bundle)


#: Which process compiles, and which thread of this one. A fork waits for the thread, not for other processes: in the
#: child nobody would open numba's lock.
_TURN, _COMPILES = Turn(), threading.RLock()

if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_COMPILES.acquire, after_in_parent=_COMPILES.release, after_in_child=_COMPILES.release)


@cache
def imported_numba() -> Any:
    """Return numba, whose threads from now on take their turn to compile, each before it takes numba's lock."""
    import numba
    from numba.core import event

    class Compiling(event.Listener):
        def on_start(self, event: Any) -> None:
            _TURN.__enter__()
            _COMPILES.acquire()

        def on_end(self, event: Any) -> None:
            _COMPILES.release()
            _TURN.__exit__()

    event.register("numba:compiler_lock", Compiling())
    return numba


def compiled_form(decorator: Callable[..., Any], function: Callable[..., Any], **options: bool) -> Any:
    """Return what a decorator of numba makes of a function, kept in the folder for code of these sources.

    The arithmetic is that of numpy: a division by zero gives infinity or NaN. numba checks only a function's own file,
    although code that it calls is compiled into it; the name of the folder contains a key of all sources.
    """
    config, folder = imported_numba().config, code_folder()
    before = config.CACHE_DIR
    config.CACHE_DIR = before if folder is None else str(folder)
    try:
        return decorator(cache=True, error_model="numpy", **options)(function)
    except RuntimeError:  # numba: "cannot cache function: no locator available"
        return decorator(error_model="numpy", **options)(function)
    finally:
        config.CACHE_DIR = before


def plain_form(kernel: Any) -> Callable[[F], F]:
    """Let a function take the place of a kernel in plain Python, as one that uses arrays where the kernel has loops."""

    def decorate(function: F) -> F:
        kernel.plain = function
        return function

    return decorate


def jit(function: F) -> F:
    """Make a function a kernel: compiled on its first call and kept on disk, or run as plain Python.

    Where no cache folder can be written the function is compiled for this
    process only. Arithmetic is IEEE: no reordering, no contraction; a division by zero gives infinity or NaN, where
    Python's own numbers, which are not numpy's, raise ZeroDivisionError: a kernel checks a divisor that may be zero.
    """
    return cast(F, CompiledFunction(function))
