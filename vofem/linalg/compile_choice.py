"""Whether a piece of work pays for compiled kernels.

Plain Python starts at once and is some hundred times slower. Compiled code
costs the import of numba and, where it is not on disk, the compilation. What a
process has spent in plain Python on work of a kind counts too: who has repeated
it for as long as compiling takes is likely to go on.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any, TypeVar

from vofem.kernel_mode import Outgrown, decided, kernels
from vofem.linalg.jit_cache import keep_kind, kinds_on_disk

F = TypeVar("F", bound=Callable[..., Any])

#: Seconds that numba takes to be imported, and compiled code to be read from disk.
_IMPORTING, _READING = 0.6, 0.3

#: Seconds that compiling takes.
_COMPILING = 12.0

_ready: set[str] = set()
_spent: dict[str, float] = {}


@dataclass(frozen=True)
class Choice:
    """How work is done.

    Attributes
    ----------
    kind : str
        What the work is: work of one kind needs the same kernels.
    compiled : bool
    first : bool
        Whether kernels are compiled now that are not on disk.
    patience : float
        Seconds after which work in plain Python had better begin anew, compiled.
    """

    kind: str
    compiled: bool
    first: bool
    patience: float

    def instead(self) -> Choice:
        """Return the choice of compiled kernels, where work in plain Python has lost its patience."""
        return choose(self.kind, float("inf"), True)

    def done(self, seconds: float) -> None:
        """Take notice that work of this kind was done, and of the seconds that it took."""
        if self.compiled:
            if self.kind not in _ready:
                _ready.add(self.kind)
                keep_kind(self.kind)
        else:
            _spent[self.kind] = _spent.get(self.kind, 0.0) + seconds


def by_need(kind: str, effort: Callable[..., float]) -> Callable[[F], F]:
    """Let a function run kernels as plain Python where its work is small, unless somebody has decided.

    Parameters
    ----------
    kind : str
    effort : callable
        Returns, for the arguments of the function, the seconds that it takes in plain Python.
    """

    def decorate(function: F) -> F:
        @wraps(function)
        def call(*arguments: Any, **named: Any) -> Any:
            if decided() is not None:
                return function(*arguments, **named)
            choice = choose(kind, effort(*arguments, **named))
            begun = time.perf_counter()
            try:
                with kernels(compiled=choice.compiled, patience=choice.patience):
                    result = function(*arguments, **named)
            except Outgrown:
                choice = choice.instead()
                with kernels(compiled=True):
                    result = function(*arguments, **named)
            choice.done(time.perf_counter() - begun)
            return result

        return call  # type: ignore[return-value]

    return decorate


def choose(kind: str, seconds: float, wanted: bool | None = None) -> Choice:
    """Return how to do work.

    Parameters
    ----------
    kind : str
    seconds : float
        What it takes at least in plain Python.
    wanted : bool, optional
        Whether kernels shall be compiled, where somebody has decided.
    """
    if wanted is False:
        return Choice(kind, False, False, float("inf"))
    if kind in _ready:
        return Choice(kind, True, False, float("inf"))
    on_disk = kind in kinds_on_disk()
    cost = _READING if on_disk else _COMPILING
    if "numba" not in sys.modules:
        cost += _IMPORTING
    if wanted is None and seconds + _spent.get(kind, 0.0) <= cost:
        return Choice(kind, False, False, cost)
    return Choice(kind, True, not on_disk, float("inf"))
