"""Kernels that other kernels call through their addresses.

All of them are functions ``function(what, p, z, x0, x1) -> float`` of a whole number, two arrays, which they take by
indices only, and two numbers. They are compiled apart: a kernel that calls them contains nothing of them, and is
compiled once for all of them.
"""

from __future__ import annotations

from functools import cache
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from vofem.kernels.jit import CompiledFunction, Intrinsic
from vofem.kernels.mode import compiled

Array = NDArray[np.float64]

#: Functions by the negative numbers that stand for their addresses in plain Python.
_KNOWN: WeakValueDictionary[int, Any] = WeakValueDictionary()

#: Machine code that must live as long as its address is in use.
_KEPT: list[Any] = []


def address_of(function: CompiledFunction) -> int:
    """Return where kernels find a function, in the way in which they run at present; it holds in this process only."""
    return _compiled_address(function) if compiled() else plain_address(function.plain)


def plain_address(function: Any) -> int:
    """Return a number by which plain Python knows a function, as long as the function lives."""
    number = -1 - id(function)
    _KNOWN[number] = function
    return number


@cache
def _compiled_address(function: CompiledFunction) -> int:
    from numba import cfunc, types

    numbers = types.CPointer(types.float64)
    kind = types.float64(types.int64, numbers, numbers, types.float64, types.float64)
    try:
        _KEPT.append(cfunc(kind, cache=True, error_model="numpy")(function.prepared))
    except RuntimeError:  # numba: "cannot cache function: no locator available"
        _KEPT.append(cfunc(kind, error_model="numpy")(function.prepared))
    return int(_KEPT[-1].address)


def _call_address() -> Any:
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    @intrinsic
    def call_address(
        typing_context: Any, address: Any, what: Any, p: Any, first: Any, z: Any, start: Any, x0: Any, x1: Any
    ) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            double, integer = ir.DoubleType(), ir.IntType(64)
            numbers, kinds = double.as_pointer(), signature.args

            def part(array: int, begin: int) -> Any:
                data = context.make_array(kinds[array])(context, builder, given[array]).data
                return builder.gep(data, [given[begin]])

            kind = ir.FunctionType(double, [integer, numbers, numbers, double, double])
            function = builder.inttoptr(given[0], kind.as_pointer())
            return builder.call(function, [given[1], part(2, 3), part(4, 5), *given[6:]])

        integer, double = types.int64, types.float64
        return double(integer, integer, p, integer, z, integer, double, double), generate

    return call_address


def _call_plain(address: int, what: int, p: Array, first: int, z: Array, start: int, x0: float, x1: float) -> float:
    return float(_KNOWN[address](what, p[first:], z[start:], x0, x1))


#: ``call(address, what, p, first, z, start, x0, x1)`` calls a function with the parts of two arrays from two places on.
call: Any = Intrinsic(_call_address, _call_plain)
