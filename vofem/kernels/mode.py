"""Whether numerical kernels run as compiled code or as plain Python.

This is decided once, at the start of a run or of another piece of work, and holds
for all of it, because results of both ways agree to rounding and not to the last
bit. Without a decision kernels are compiled. The environment variable
``VOFEM_COMPILED`` decides for a whole process: 1 for compiled code, 0 for plain Python.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from functools import wraps
from typing import Any, NamedTuple, TypeVar

from vofem.errors import ArgumentError

F = TypeVar("F", bound=Callable[..., Any])


class Outgrown(Exception):  # noqa: N818
    """Raised where work in plain Python has taken longer than compiling would, to begin it anew with compiled code."""


class _Mode(NamedTuple):
    """How kernels run, when (by `time.thread_time`) work in plain Python gives up, and whether it compiles first."""

    compiled: bool
    deadline: float
    first: bool = False


def _asked() -> _Mode | None:
    """Return the decision of the environment variable VOFEM_COMPILED."""
    asked = os.environ.get("VOFEM_COMPILED", "")
    if asked not in ("", "0", "1"):
        raise ArgumentError(
            f"the environment variable VOFEM_COMPILED is {asked!r}, expected 1 for compiled code or 0 for plain Python"
        )
    return _Mode(asked == "1", float("inf")) if asked else None


_ASKED = _asked()

_MODE: ContextVar[_Mode | None] = ContextVar("vofem: how kernels run", default=_ASKED)


def decided() -> bool | None:
    """Return whether kernels are compiled at this point of the program; None where this was not decided."""
    mode = _MODE.get()
    return None if mode is None else mode.compiled


def compiled() -> bool:
    """Return whether kernels are compiled at this point of the program."""
    mode = _MODE.get()
    return mode is None or mode.compiled


def compiling_first() -> bool:
    """Return whether the kernels of this work are compiled now, because they are not on disk."""
    mode = _MODE.get()
    return mode is not None and mode.first


def check_patience() -> None:
    """Raise where work in plain Python has taken longer than it may.

    Raises `Outgrown`.
    """
    mode = _MODE.get()
    if mode is not None and time.thread_time() > mode.deadline:
        raise Outgrown


def have_patience() -> None:
    """Let work in plain Python go on to its end, as where Ctrl-C asks for what it has: begun anew, it would forget."""
    mode = _MODE.get()
    if mode is not None:
        _MODE.set(mode._replace(deadline=float("inf")))


@contextlib.contextmanager
def kernels(*, compiled: bool, patience: float = float("inf"), first: bool = False) -> Iterator[None]:
    """Run all kernels that are called within as compiled code, or as plain Python.

    `patience`: seconds of processor time after which work in plain Python ends in `Outgrown`, at the next call of a
    kernel. On a busy machine compiling would take longer too, so wall time does not count.
    `first`: whether they are not on disk, so that compiling them comes first.
    """
    before = _MODE.set(_Mode(compiled, time.thread_time() + patience, first))
    try:
        yield
    finally:
        _MODE.reset(before)


def as_it_ran(method: F) -> F:
    """Let a method of an object with an attribute `compiled` call kernels in that way."""

    @wraps(method)
    def call(self: Any, *arguments: Any, **named: Any) -> Any:
        if decided() is self.compiled:
            return method(self, *arguments, **named)
        with kernels(compiled=self.compiled):
            return method(self, *arguments, **named)

    return call  # type: ignore[return-value]
