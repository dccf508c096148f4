"""The choice between compiled kernels and plain Python for a piece of work.

Plain Python starts at once and is some hundred times slower. Compiled code costs the import of numba and, where it is
not on disk, the compilation. The time that a process has already spent in plain Python on work of a kind counts too. A
user who has repeated this work for as long as compiling takes is likely to continue.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any, TypeVar

from vofem.kernels.cache import keep_kind, kinds_on_disk
from vofem.kernels.mode import Outgrown, decided, kernels

F = TypeVar("F", bound=Callable[..., Any])

#: Seconds that numba takes to be imported, and compiled code to be read from disk.
_IMPORTING, _READING = 0.6, 0.3

#: Seconds that compiling takes where nothing else is known.
COMPILING = 12.0

_ready: set[str] = set()
_spent: dict[str, float] = {}


@dataclass(frozen=True)
class Choice:
    """The choice of how a piece of work is done.

    Attributes
    ----------
    kind : str
        The kind of work. All work of one kind needs the same kernels.
    compiled : bool
    first : bool
        Whether kernels that are not on disk are compiled now.
    patience : float
        Seconds of processor time after which it is faster to start the work again with compiled kernels.
    """

    kind: str
    compiled: bool
    first: bool
    patience: float

    def instead(self) -> Choice:
        """Return the choice of compiled kernels, for work that has exceeded `patience` in plain Python."""
        return choose(self.kind, float("inf"), True)

    def done(self, seconds: float) -> None:
        """Store that work of this kind was done, and the seconds of processor time that it took."""
        if self.compiled:
            if self.kind not in _ready:
                _ready.add(self.kind)
                keep_kind(self.kind)
        else:
            _spent[self.kind] = _spent.get(self.kind, 0.0) + seconds


def by_need(kind: str, effort: Callable[..., float]) -> Callable[[F], F]:
    """Let a function run kernels as plain Python if its work is small, unless the user has decided.

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
            begun = time.thread_time()
            try:
                with kernels(compiled=choice.compiled, patience=choice.patience):
                    result = function(*arguments, **named)
            except Outgrown:
                choice = choice.instead()
                with kernels(compiled=True):
                    result = function(*arguments, **named)
            choice.done(time.thread_time() - begun)
            return result

        return call  # type: ignore[return-value]

    return decorate


def choose(kind: str, seconds: float, wanted: bool | None = None, compiling: float = COMPILING) -> Choice:
    """Return the choice for a piece of work.

    Parameters
    ----------
    kind : str
    seconds : float
        Least time of the work in plain Python, s.
    wanted : bool, optional
        Whether kernels are to be compiled, if the user has decided.
    compiling : float
        Seconds that compiling the kernels takes.
    """
    if wanted is False:
        return Choice(kind, False, False, float("inf"))
    if kind in _ready:
        return Choice(kind, True, False, float("inf"))
    on_disk = kind in kinds_on_disk()
    cost = _READING if on_disk else compiling
    if "numba" not in sys.modules:
        cost += _IMPORTING
    if wanted is None and seconds + _spent.get(kind, 0.0) <= cost:
        return Choice(kind, False, False, cost)
    return Choice(kind, True, not on_disk, float("inf"))
