"""The choice between compiled kernels and plain Python for a piece of work.

Plain Python starts at once and is some hundred times slower. Work begins in it, and begins anew with compiled kernels
if it takes longer than these take to be ready. So it takes at most twice the time of the better choice. The time that a
process has already spent in plain Python on work of a kind counts too, because somebody who repeats this work is likely
to continue.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any, TypeVar

from vofem.kernels.cache import keep_kind, kinds_on_disk
from vofem.kernels.mode import Outgrown, decided, kernels

F = TypeVar("F", bound=Callable[..., Any])

#: Seconds of processor time after which work in plain Python is given up: about what compiling its kernels takes, and
#: what importing numba and reading them takes where they are on disk. The speed of the machine is not measured: with
#: figures that are wrong by a factor f, work takes at most 1 + f times the time of the better choice.
COMPILING, READING = 8.0, 0.6

_ready: set[str] = set()
_spent: dict[str, float] = {}


@dataclass(frozen=True)
class Choice:
    """The choice of how a piece of work is done."""

    kind: str  #: The kind of work. All work of one kind needs the same kernels.
    compiled: bool
    first: bool  #: Whether kernels that are not on disk are compiled now.
    #: Seconds of processor time after which it is faster to start the work again with compiled kernels.
    patience: float

    def instead(self) -> Choice:
        """Return the choice of compiled kernels, for work that has exceeded `patience` in plain Python."""
        return choose(self.kind, True)

    def done(self, seconds: float) -> None:
        """Store that work of this kind was done, and the seconds of processor time that it took."""
        if self.compiled:
            if self.kind not in _ready:
                _ready.add(self.kind)
                keep_kind(self.kind)
        else:
            _spent[self.kind] = _spent.get(self.kind, 0.0) + seconds


def by_need(kind: str, *, small: bool = True) -> Callable[[F], F]:
    """Let a function run kernels as plain Python if its work is small, unless the user has decided.

    `small`: whether its work may be small. Otherwise kernels are compiled at once.
    """

    def decorate(function: F) -> F:
        @wraps(function)
        def call(*arguments: Any, **named: Any) -> Any:
            if decided() is not None:
                return function(*arguments, **named)
            choice = choose(kind, None if small else True)
            begun = time.thread_time()
            try:
                with kernels(compiled=choice.compiled, patience=choice.patience, first=choice.first):
                    result = function(*arguments, **named)
            except Outgrown:
                choice = choice.instead()
                with kernels(compiled=True, first=choice.first):
                    result = function(*arguments, **named)
            choice.done(time.thread_time() - begun)
            return result

        return call  # type: ignore[return-value]

    return decorate


def choose(kind: str, wanted: bool | None = None) -> Choice:
    """Return the choice for work of a kind; `wanted` is whether kernels are compiled, where somebody has said so."""
    if wanted is False:
        return Choice(kind, False, False, float("inf"))
    if kind in _ready:
        return Choice(kind, True, False, float("inf"))
    on_disk = kind in kinds_on_disk()
    patience = (READING if on_disk else COMPILING) - _spent.get(kind, 0.0)
    if wanted is None and patience > 0.0:
        return Choice(kind, False, False, patience)
    return Choice(kind, True, not on_disk, float("inf"))
