"""Lets numba compile its own functions, such as `numpy.empty`, as parts of kernels, and do less work for it."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import ir
from numba.core.decorators import jit
from numba.core.target_extension import jit_registry, target_registry
from numba.core.types import functions

_BASE: Any = functions.BaseFunction

#: Types of values that are no variables.
_NO_VARIABLES = frozenset([str, int, float, bool, complex, type(None), ir.Loc])

#: Signatures of functions by the function and the types of its arguments.
_SIGNATURES: dict[Any, Any] = {}


@contextmanager
def own_overloads(compiler: Any) -> Iterator[None]:
    """Within this block numba compiles its own functions by a compiler for functions that only kernels call.

    Nothing else is compiled meanwhile, because numba holds its lock.

    Parameters
    ----------
    compiler : type
        Compiler of functions that are called by kernels only (`pipeline_class` of numba).

    Notes
    -----
    Wherever a function is called, such as that which reads an element, numba tries all its implementations. Within
    this block it does so once for each kind of arguments. This saves a sixth of the time of compilation. Another fifth
    are Python's search for garbage and the lists of variables that numba makes again and again.
    """

    def decorator(*arguments: Any, **options: Any) -> Any:
        options.update(nopython=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, pipeline_class=compiler)
        return jit(*arguments, **options)

    processor = target_registry["cpu"]
    before, resolve = jit_registry[processor], _BASE.get_call_type

    def remembered(function: Any, context: Any, args: Any, kws: Any) -> Any:
        key = (function, context, args, tuple(kws.items()))
        try:
            signature = _SIGNATURES.get(key)
        except TypeError:  # types that cannot be a key
            return resolve(function, context, args, kws)
        if signature is None:
            signature = _SIGNATURES[key] = resolve(function, context, args, kws)
        return signature

    _register(processor, decorator)
    _BASE.get_call_type = remembered
    # Nearly all objects that a compilation makes are kept, and looking for others takes a tenth of its time.
    collects = gc.isenabled()
    gc.disable()
    listed, ir.Inst._rec_list_vars = ir.Inst._rec_list_vars, _variables
    try:
        yield
    finally:
        ir.Inst._rec_list_vars = listed
        if collects:
            gc.enable()
        _BASE.get_call_type = resolve
        _register(processor, before)


def _variables(self: Any, value: Any) -> list[Any]:
    """Return the variables in a part of numba's intermediate language, as numba does, with fewer calls."""
    kind = type(value)
    if kind is ir.Var:
        return [value]
    if kind is dict:
        value = value.values()
    elif kind is not list and kind is not tuple:
        return value.list_vars() if isinstance(value, ir.Inst) else []
    found = []
    for one in value:
        kind = type(one)
        if kind is ir.Var:
            found.append(one)
        elif kind not in _NO_VARIABLES:
            found.extend(_variables(self, one))
    return found


def _register(processor: Any, decorator: Any) -> None:
    """Let a decorator compile numba's own functions; a key of the registry cannot be set twice."""
    jit_registry.pop(processor)
    jit_registry[processor] = decorator
