"""Laws written in Python, called from compiled loops through their addresses."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np

from vofem.errors import InstabilityError
from vofem.kernels.addresses import plain_address
from vofem.laws.group import LawGroup
from vofem.laws.law import KINK, Law

_PROTOTYPE = ctypes.CFUNCTYPE(
    ctypes.c_double, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_double, ctypes.c_double
)


class _Guard:
    """A law written in Python, whose exceptions cannot pass through compiled code."""

    def __init__(self, law: Law, of: Callbacks) -> None:
        self.law, self.of = law, of

    def __call__(self, what: int, p: Any, z: Any, u0: float, u1: float) -> float:
        self.of.calls += 1
        try:
            value = self.law.function(what, p, z, u0, u1)
        except (
            BaseException
        ) as error:  # KeyboardInterrupt is stored too, and raised again after the compiled code has returned.
            if self.of.failure is None:
                self.of.failure = error
            return float("nan")
        if not np.isfinite(value) and what != KINK and self.of.culprit is None:
            self.of.culprit = (self.law.label, u1, value)
        return value


class Callbacks:
    """Laws written in Python, ready to be called from loops.

    The object must live as long as its addresses are in use. An exception is stored, the law returns NaN, and
    `complain` raises the stored exception afterwards.

    `calls`: number of evaluations so far.
    `failure`, `culprit`: the first exception; label, coordinate (m) and value of the first answer that was not finite.
    """

    def __init__(self, laws: Sequence[Law]) -> None:
        self.calls = 0
        self.failure: BaseException | None = None
        self.culprit: tuple[str, float, float] | None = None
        self._guards = [_Guard(law, self) for law in laws]
        self._kept: list[Any] = []

    def addresses(self, compiled: bool) -> list[int]:
        """Return an address for every law, in compiled loops or in plain Python."""
        if not compiled:
            return [plain_address(guard) for guard in self._guards]
        self._kept = self._kept or [_PROTOTYPE(guard) for guard in self._guards]
        return [ctypes.cast(function, ctypes.c_void_p).value or 0 for function in self._kept]

    def complain(self, dt: float) -> None:
        """Raise the exception that a law has raised, or an error if it returned a number that is not finite.

        Raises `InstabilityError` for a force or potential that is not finite.
        """
        if self.failure is not None:
            raise self.failure
        if self.culprit is not None:
            label, u, value = self.culprit
            raise InstabilityError(
                f"{label} returned {value} at u = {u:g} m, expected a finite number; reduce dt = {dt:g} s, or look at "
                "its law"
            )


def callbacks_of(groups: Sequence[LawGroup]) -> Callbacks | None:
    """Return the laws of some groups that are written in Python, ready to be called, or None where there are none."""
    laws = [law for group in groups for law in group.forms if law.in_python]
    return Callbacks(laws) if laws else None
