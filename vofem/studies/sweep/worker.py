"""What happens in a worker: the function is called for a batch of points, and every outcome becomes a row."""

from __future__ import annotations

import contextlib
import ctypes
import re
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import FrameType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.blas import blas_threads
from vofem.kernels.mode import kernels
from vofem.sharing import sharing_between_scenes


class TimeUp(BaseException):
    """The time limit of a point has passed. It is no `Exception`, so that handlers in the function do not catch it."""


def time_limit(seconds: float | None) -> contextlib.AbstractContextManager[None]:
    """Raise `TimeUp` in the block once it has taken longer than `seconds`.

    In the main thread a timer of the operating system interrupts the block, even while it waits. In other threads, and
    on Windows, the interpreter raises the error between two Python instructions, so a compiled loop must end first.
    """
    if seconds is None:
        return contextlib.nullcontext()
    own_timer = threading.current_thread() is threading.main_thread() and hasattr(signal, "setitimer")
    return _alarm(seconds) if own_timer else _raised_in_thread(seconds)


@contextlib.contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    def ring(number: int, frame: FrameType | None) -> None:
        raise TimeUp

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextlib.contextmanager
def _raised_in_thread(seconds: float) -> Iterator[None]:
    thread = ctypes.c_ulong(threading.get_ident())
    raise_in = ctypes.pythonapi.PyThreadState_SetAsyncExc
    lock = threading.Lock()
    over = False

    def ring() -> None:
        with lock:
            if not over:
                raise_in(thread, ctypes.py_object(TimeUp))

    timer = threading.Timer(seconds, ring)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        with lock:
            over = True
            # An error that was set and not raised yet belongs to this block only.
            raise_in(thread, None)
        timer.cancel()


#: Kinds of arrays that a row may hold: booleans, integers, floats, complex numbers, texts.
_KINDS = "biufcU"

#: Characters in texts that no store can hold.
_NO_TEXT = re.compile("[\0\ud800-\udfff]")

#: How names begin that a store uses itself.
RESERVED = "sweep_"


@dataclass(frozen=True)
class Row:
    """The outcome of one point."""

    values: dict[str, NDArray] | None  #: What the function returned; None where it failed.
    error: str = ""  #: Type and message of the error; empty where there was none.
    traceback: str = ""  #: Where the error was raised.
    seconds: float = 0.0  #: Wall time of the call.


@dataclass(frozen=True)
class Task:
    """What a worker needs beside the points of a batch."""

    function: Callable[..., Any]
    limit: float | None  #: Largest wall time of one point, in s.
    compiled: bool  #: Whether kernels run as compiled code: the same in all workers.


def compute(task: Task, points: Sequence[dict[str, Any]]) -> list[Row]:
    """Return the rows of a batch of points, in order."""
    # With one thread of linear algebra results have the same bits whatever the number of processors.
    with blas_threads(0), kernels(compiled=task.compiled), sharing_between_scenes(keep=True):
        return [_row(task, point) for point in points]


def _row(task: Task, point: dict[str, Any]) -> Row:
    begun = time.perf_counter()
    try:
        with time_limit(task.limit):
            values = _values(task.function(**point), point)
    except TimeUp:
        return Row(None, timed_out(task.limit), traceback.format_exc(), time.perf_counter() - begun)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # SystemExit of the function must not end the worker
        return Row(None, f"{type(error).__name__}: {error}", _where(error), time.perf_counter() - begun)
    return Row(values, seconds=time.perf_counter() - begun)


def timed_out(limit: float | None) -> str:
    """Return the error of a point that took longer than its limit."""
    return f"TimeLimitError: the point took longer than the time limit of {limit:g} s"


def _where(error: BaseException) -> str:
    """Return the traceback of an error from the user's function on, without the lines of this module."""
    trace = error.__traceback__
    while trace is not None and trace.tb_frame.f_code.co_filename == __file__ and trace.tb_next is not None:
        trace = trace.tb_next
    return "".join(traceback.format_exception(type(error), error, trace))


def _values(returned: Any, point: dict[str, Any]) -> dict[str, NDArray]:
    """Return what a function returned as arrays, or raise `TypeError` that says what is wrong with it."""
    if not isinstance(returned, Mapping):
        raise TypeError(f"the function returned {returned!r:.100}, expected a dict of names to numbers or arrays")
    values = {}
    for name, value in returned.items():
        if not isinstance(name, str) or not name or "/" in name or name.startswith(RESERVED):
            expected = f"texts without '/' that do not begin with {RESERVED!r}"
            raise TypeError(f"the function returned the name {name!r}, expected {expected}")
        if name in point:
            raise TypeError(f"the function returned {name!r}, which is the name of a parameter; choose another name")
        array = np.asarray(value)
        if array.dtype.kind not in _KINDS:
            large = "; this whole number does not fit into 64 bits, so return float()" if isinstance(value, int) else ""
            raise TypeError(
                f"the function returned {name!r} of type {type(value).__name__}, expected a number or array{large}"
            )
        if array.dtype.kind == "U" and any(map(_NO_TEXT.search, array.ravel().tolist())):
            raise TypeError(f"the function returned {name!r}: {value!r:.100}, expected valid Unicode without '\\0'")
        values[name] = array
    return values
