"""Laws written in Python, called from compiled loops through their addresses."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.errors import InstabilityError
from vofem.kernels.jit import Intrinsic
from vofem.laws.group import LawGroup
from vofem.laws.smooth import ScalarLaw, SmoothLaws, mean_reaction

#: What is asked of a law; the last two of laws with internal variables only.
FORCE, TANGENT, MEAN, STORED, LOSS, COMMIT = range(6)

_PROTOTYPE = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_int64, ctypes.c_double, ctypes.c_double)


def _call_address() -> Any:
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    @intrinsic
    def call_address(typing_context: Any, address: Any, what: Any, u0: Any, u1: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            double = ir.DoubleType()
            kind = ir.FunctionType(double, [ir.IntType(64), double, double])
            function = builder.inttoptr(arguments[0], kind.as_pointer())
            return builder.call(function, arguments[1:])

        return types.float64(types.int64, types.int64, types.float64, types.float64), generate

    return call_address


#: ``call(address, what, u0, u1)`` in compiled functions.
call: Any = Intrinsic(_call_address, lambda address, what, u0, u1: _PROTOTYPE(int(address))(what, u0, u1))


class Callbacks:
    """Laws written in Python as addresses of C functions, which compiled loops can call.

    The object must live as long as the addresses are in use. An exception cannot
    pass through compiled code. It is therefore stored, the law returns NaN, and
    `complain` raises the stored exception afterwards.
    """

    def __init__(self, laws: Sequence[ScalarLaw]) -> None:
        self._failure: BaseException | None = None
        self._culprit: tuple[str, float, float] | None = None
        self._calls = 0
        self._kept = [self._guard(law) for law in laws]
        self.addresses: NDArray[np.int64] = np.array(
            [ctypes.cast(function, ctypes.c_void_p).value for function in self._kept], dtype=np.int64
        )

    @property
    def calls(self) -> int:
        """Number of evaluations so far."""
        return self._calls

    def _guard(self, law: ScalarLaw) -> Any:
        asked: tuple[Callable[[float, float], float], ...] = (
            lambda u0, u1: law.reaction(u1),
            lambda u0, u1: law.tangent(u1),
            lambda u0, u1: mean_reaction(law, u0, u1),
            lambda u0, u1: law.energy(u1),
        )

        def guarded(what: int, u0: float, u1: float) -> float:
            self._calls += 1
            try:
                value = asked[what](u0, u1)
            except (
                BaseException
            ) as error:  # KeyboardInterrupt is stored too, and raised again after the compiled code has returned.
                if self._failure is None:
                    self._failure = error
                return float("nan")
            if not np.isfinite(value) and self._culprit is None:
                self._culprit = (law.label, u1, value)
            return value

        return _PROTOTYPE(guarded)

    def complain(self, dt: float) -> None:
        """Raise the exception that a law has raised, or an error if it returned a number that is not finite.

        Raises
        ------
        InstabilityError
            For a force or potential that is not finite.
        """
        if self._failure is not None:
            raise self._failure
        if self._culprit is not None:
            label, u, value = self._culprit
            raise InstabilityError(
                f"{label} returned {value} at u = {u:g} m, expected a finite number; reduce dt = {dt:g} s, or look at "
                "its law"
            )


def callbacks_of(groups: Sequence[LawGroup]) -> Callbacks | None:
    """Return the laws of some groups that are written in Python, ready to be called, or None where there are none."""
    laws = [law for group in groups if isinstance(group, SmoothLaws) for law in group.laws]
    return Callbacks(laws) if laws else None
