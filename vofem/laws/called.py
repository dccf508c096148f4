"""Laws with internal variables that are one compiled function in a module of their own, called through its address.

Compiled loops contain no formulas of such a law, so no other code changes for it, and no loop is compiled again. The
function is compiled for itself; a call costs some nanoseconds more than formulas within the loop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vofem.kernels.jit import CompiledFunction, Intrinsic, compiled_anyhow, jit
from vofem.kernels.mode import compiled
from vofem.laws.group import LawGroup
from vofem.laws.hysteretic import HystereticLaws
from vofem.laws.kinds import CALLED_WITH_PAST
from vofem.laws.table import Laws

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CalledLaw:
    """A rate-independent law with internal variables on a row, given by one function; see `HystereticLaw`.

    The function is ``function(what, parameters, past, u0, u1)``, decorated with `vofem.kernels.jit.jit`. `past` holds
    the internal variables at u0. What it returns belongs to the monotone path from u0 to u1:

    ========== =======================================================
    FORCE      force at u1, N; for this and the next three, u0 is u1
    TANGENT    its derivative by u1, N/m
    STORED     recoverable energy stored at u1, J
    LOSS       energy dissipated on the path to u1, J
    MEAN       mean force over the path, N: its work over its length
    COMMIT     anything; changes `past` to the internal variables at u1
    ========== =======================================================

    Only COMMIT changes `past`. The force must not fall as u1 rises.

    Attributes
    ----------
    label : str
        Class and name of its spring, for messages.
    name : str
    function : CompiledFunction
    stiffness : float
        Largest tangent in N/m.
    parameters, past : ndarray
        Parameters of the function, and internal variables before any load.
    limit : float
        Limit load in N, which the force never reaches; inf where there is none.
    unit : str
        Unit of the force, for messages.
    """

    kind: ClassVar[int] = CALLED_WITH_PAST
    one_sided: ClassVar[bool] = False
    gap: ClassVar[float] = 0.0
    onset: ClassVar[float] = 0.0

    label: str
    name: str
    function: Callable[[int, Array, Array, float, float], float]
    stiffness: float
    parameters: Array
    past: Array
    limit: float = float("inf")
    unit: str = "N"

    @property
    def group(self) -> type[LawGroup]:
        """The group that gathers all laws with internal variables."""
        return HystereticLaws

    @property
    def address(self) -> int:
        """Where compiled loops find the function; a negative number, by which plain Python knows it, in other loops."""
        return _compiled_address(self.function) if compiled() else _plain_address(self.function)

    def virgin(self) -> Array:
        """Return the internal variables before any load: energy dissipated (J), then those of the function."""
        return np.append(0.0, self.past)


#: Functions by the negative numbers that stand for their addresses in plain Python.
_KNOWN: dict[int, Callable[..., float]] = {}


@cache
def _plain_address(function: Any) -> int:
    number = -1 - len(_KNOWN)
    _KNOWN[number] = function.plain if isinstance(function, CompiledFunction) else function
    return number


@cache
def _compiled_address(function: CompiledFunction) -> int:
    from numba import carray, cfunc, types

    numbers = types.CPointer(types.float64)

    def made() -> Any:
        inner = function.dispatcher

        def outer(what, parameters, count, past, size, u0, u1):  # type: ignore[no-untyped-def]
            return inner(what, carray(parameters, (count,)), carray(past, (size,)), u0, u1)

        kind = types.float64(types.int64, numbers, types.int64, numbers, types.int64, types.float64, types.float64)
        return cfunc(kind)(outer)

    _KEPT.append(compiled_anyhow(made))
    return int(_KEPT[-1].address)


#: Machine code that must live as long as its address is in use.
_KEPT: list[Any] = []


def _call_address() -> Any:
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    @intrinsic
    def call_address(
        typing_context: Any, address: Any, what: Any, parameters: Any, first: Any, last: Any, state: Any, start: Any,
        end: Any, u0: Any, u1: Any,
    ) -> Any:  # fmt: skip
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            double, integer = ir.DoubleType(), ir.IntType(64)
            numbers, types_of = double.as_pointer(), signature.args

            def part(array: int, begin: int, stop: int) -> tuple[Any, Any]:
                data = context.make_array(types_of[array])(context, builder, given[array]).data
                return builder.gep(data, [given[begin]]), builder.sub(given[stop], given[begin])

            kind = ir.FunctionType(double, [integer, numbers, integer, numbers, integer, double, double])
            function = builder.inttoptr(given[0], kind.as_pointer())
            return builder.call(function, [given[1], *part(2, 3, 4), *part(5, 6, 7), *given[8:]])

        integer, double = types.int64, types.float64
        return double(integer, integer, parameters, integer, integer, state, integer, integer, double, double), generate

    return call_address


def _call_plain(
    address: int, what: int, parameters: Array, first: int, last: int, state: Array, start: int, end: int, u0: float,
    u1: float,
) -> float:  # fmt: skip
    return _KNOWN[address](what, parameters[first:last], state[start:end], u0, u1)


_call: Any = Intrinsic(_call_address, _call_plain)


@jit
def call_law(laws: Laws, j: int, what: int, u0: float, u1: float) -> float:
    """Return what is asked of law j, which is a `CalledLaw`, on the path from u0 to u1."""
    law = laws.table[j]
    return _call(
        law["address"], what, laws.parameters, law["first"], law["last"], laws.state, law["start"] + 1, law["end"],
        u0, u1,
    )  # fmt: skip
