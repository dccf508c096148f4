"""Kernels that other kernels call through their addresses, and arrays that kernels find by theirs.

All such kernels are functions ``function(what, p, z, x0, x1) -> float`` of a whole number, two arrays, which they take
by indices only, and two numbers. They are compiled apart: a kernel that calls them contains nothing of them, and is
compiled once for all of them.

A kernel that takes dozens of arrays would spend most of its time for compiling on their arguments. It takes one array
of their places instead. Whoever writes these places keeps the arrays.
"""

from __future__ import annotations

import ctypes
import math
from functools import cache, partial
from typing import Any
from weakref import WeakValueDictionary

from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.kernels.jit import CompiledFunction, Intrinsic, compiled_form, compiling, imported_numba
from vofem.kernels.mode import compiled

#: Functions and arrays by the negative numbers that stand for their addresses in plain Python.
_KNOWN: WeakValueDictionary[int, Any] = WeakValueDictionary()

#: Machine code that must live as long as its address is in use.
_KEPT: list[Any] = []


def place_of(array: NDArray[Any]) -> int:
    """Return where kernels find an array that lies in memory row by row, in the way in which they run at present."""
    assert array.flags.c_contiguous
    return int(array.__array_interface__["data"][0]) if compiled() else plain_address(array)


def address_of(function: CompiledFunction) -> int:
    """Return where kernels find a function, in the way in which they run at present; it holds in this process only."""
    return _compiled_address(function) if compiled() else plain_address(function.plain)


def called(function: CompiledFunction, what: int, p: Array, z: Array, x0: float, x1: float) -> float:
    """Call a function from Python in the form in which kernels call it, so that it is not compiled for Python too."""
    if not compiled():
        return float(function(what, p, z, x0, x1))
    return float(_from_python(_compiled_address(function))(what, place_of(p), place_of(z), x0, x1))


@cache
def _from_python(address: int) -> Any:
    number, place = ctypes.c_double, ctypes.c_void_p
    return ctypes.CFUNCTYPE(number, ctypes.c_int64, place, place, number, number)(address)


def plain_address(known: Any) -> int:
    """Return a number by which plain Python knows a function or an array, as long as this lives."""
    number = -1 - id(known)
    _KNOWN[number] = known
    return number


@cache
def _compiled_address(function: CompiledFunction) -> int:
    types = imported_numba().types
    numbers = types.CPointer(types.float64)
    kind = types.float64(types.int64, numbers, numbers, types.float64, types.float64)
    with compiling():
        _KEPT.append(compiled_form(partial(imported_numba().cfunc, kind), function.prepared))
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


def _pointer(kind: str) -> Any:
    from numba import types
    from numba.extending import intrinsic

    numbers = types.CPointer(getattr(types, kind))

    @intrinsic
    def pointer(typing_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            return builder.inttoptr(given[0], context.get_value_type(numbers))

        return numbers(types.int64), generate

    return pointer


def _carray() -> Any:
    from numba import carray

    return carray


def _shaped(array: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    return array if array.shape == shape else array.reshape(-1)[: math.prod(shape)].reshape(shape)


#: ``shaped(floats(place), shape)`` is the array at a place, or its first part in another shape.
floats: Any = Intrinsic(lambda: _pointer("float64"), lambda place: _KNOWN[place])
integers: Any = Intrinsic(lambda: _pointer("int64"), lambda place: _KNOWN[place])
shaped: Any = Intrinsic(_carray, _shaped)
