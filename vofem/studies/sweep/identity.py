"""The identity of a function, by its source. Rows of a store belong to one identity."""

from __future__ import annotations

import functools
import inspect
import types
from collections.abc import Callable
from typing import Any

from vofem._version import __version__
from vofem.studies.sweep.content import NoContentError, content, digest


def identity(function: Callable[..., Any], compiled: bool = True) -> dict[str, str]:
    """Return the identity of a function, by which stored rows are recognised as its own.

    It covers the source of the function and of the functions of the same
    module that it calls, the plain constants of the module that they use, the
    values bound by `functools.partial`, closures and defaults, and the
    version of vofem. It does not cover other modules and files that are read.

    Returns
    -------
    dict
        ``name``, ``source`` (64 hexadecimal digits), ``vofem`` (its version) and ``kernels`` (how they
        run).
    """
    parts: list[str] = []
    _collect(function, parts, set())
    return {
        "name": name_of(function).rpartition(".")[2],
        "source": digest("\n".join(parts)),
        "vofem": __version__,
        "kernels": "compiled" if compiled else "plain Python",
    }


def name_of(function: Any) -> str:
    """Return the module and the name of a function, for messages."""
    while isinstance(function, functools.partial):
        function = function.func
    module = getattr(function, "__module__", None)
    name = getattr(function, "__qualname__", None) or type(function).__qualname__
    return f"{module}.{name}" if module not in (None, "__main__", "__mp_main__") else name


def _collect(value: Any, parts: list[str], seen: set[int]) -> None:
    """Add the texts that stand for a function, or for a value that it uses."""
    if id(value) in seen:
        return
    seen.add(id(value))
    if isinstance(value, functools.partial):
        _collect(value.func, parts, seen)
        for item in (*value.args, *(pair for pair in sorted(value.keywords.items()))):
            _collect(item, parts, seen)
    elif isinstance(value, tuple) and any(callable(item) for item in value):
        for item in value:
            _collect(item, parts, seen)
    elif isinstance(value, types.MethodType):
        _collect(value.__func__, parts, seen)
        _collect(getattr(value.__self__, "__dict__", {}), parts, seen)
    elif isinstance(value, types.FunctionType):
        _function(value, parts, seen)
    elif callable(value) and not isinstance(value, type):
        parts.append(type(value).__qualname__)
        _collect(getattr(value, "__dict__", {}), parts, seen)
        call = type(value).__call__
        if isinstance(call, types.FunctionType):
            _function(call, parts, seen)
    else:
        try:
            parts.append(content(value))
        except NoContentError:
            # An object that is no plain data counts by its type: its module is not covered, as documented.
            parts.append(type(value).__qualname__)


def _function(function: types.FunctionType, parts: list[str], seen: set[int]) -> None:
    try:
        parts.append(inspect.getsource(function))
    except (OSError, TypeError):
        parts.append(_code(function.__code__))
    for default in (*(function.__defaults__ or ()), *sorted((function.__kwdefaults__ or {}).items())):
        _collect(default, parts, seen)
    for cell in function.__closure__ or ():
        try:
            _collect(cell.cell_contents, parts, seen)
        except ValueError:  # a name that is bound later
            continue
    for name in sorted(_names(function.__code__)):
        if name in function.__globals__:
            value = function.__globals__[name]
            if isinstance(value, types.FunctionType) and value.__module__ != function.__module__:
                continue
            if not isinstance(value, (types.ModuleType, type)):
                parts.append(name)
                _collect(value, parts, seen)


def _names(code: types.CodeType) -> set[str]:
    """Return the names that the code of a function uses, with those of functions inside it."""
    inner = (_names(constant) for constant in code.co_consts if isinstance(constant, types.CodeType))
    return set(code.co_names).union(*inner)


def _code(code: types.CodeType) -> str:
    """Return what stands for a function whose source is not there."""
    constants = [_code(c) if isinstance(c, types.CodeType) else repr(c) for c in code.co_consts]
    return f"{code.co_code.hex()} {code.co_names} {constants}"
