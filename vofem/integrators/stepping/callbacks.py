"""Python functions of one number, called from compiled loops through their addresses."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from vofem.errors import InstabilityError
from vofem.system import NonlinearLaw

_PROTOTYPE = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)


@intrinsic
def call(typing_context: Any, address: Any, u: Any) -> Any:
    """Call the function at an address, float64 to float64."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        double = ir.DoubleType()
        function = builder.inttoptr(arguments[0], ir.FunctionType(double, [double]).as_pointer())
        return builder.call(function, [arguments[1]])

    return types.float64(types.int64, types.float64), generate


class Callbacks:
    """Force and potential of smooth laws as addresses; keep the object as long as they are in use.

    An exception cannot cross compiled code: it is kept, the law returns NaN,
    and `complain` raises it again.
    """

    def __init__(self, laws: tuple[NonlinearLaw, ...]) -> None:
        self._failure: BaseException | None = None
        self._culprit: tuple[str, float, float] | None = None
        self._calls = 0
        self._kept = [(self._guard(law, law.reaction), self._guard(law, law.energy)) for law in laws]
        self.addresses: NDArray[np.int64] = np.array(
            [[ctypes.cast(function, ctypes.c_void_p).value for function in pair] for pair in self._kept],
            dtype=np.int64,
        ).reshape(-1, 2)

    @property
    def calls(self) -> int:
        """Number of evaluations so far."""
        return self._calls

    def _guard(self, law: NonlinearLaw, function: Callable[[float], float]) -> Any:
        def guarded(u: float) -> float:
            self._calls += 1
            try:
                value = function(u)
            except BaseException as error:  # KeyboardInterrupt too: it is raised again once compiled code is left.
                if self._failure is None:
                    self._failure = error
                return float("nan")
            if not np.isfinite(value) and self._culprit is None:
                self._culprit = (law.name, u, value)
            return value

        return _PROTOTYPE(guarded)

    def complain(self, dt: float) -> None:
        """Raise what a law raised, or what it returned that is not finite.

        Raises
        ------
        InstabilityError
            For a force or potential that is not finite.
        """
        if self._failure is not None:
            raise self._failure
        if self._culprit is not None:
            name, u, value = self._culprit
            raise InstabilityError(
                f"NonlinearSpring {name!r} returned {value} at u = {u:g} m, expected a finite number; "
                f"reduce dt = {dt:g} s, or look at its law"
            )
