"""Runs on several processes, for runs that are not timed. Timed runs take place alone, after them."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import Any


def spread(function: Callable[..., Any], jobs: Sequence[tuple[Any, ...]], workers: int) -> Iterator[tuple[int, Any]]:
    """Give the index of every job and what a function of a module returns for its arguments, as they are done.

    With one worker, or where a job cannot be sent to another process (a lambda in a scene cannot), all is done in this
    one.
    """
    try:
        sent = workers > 1 and len(jobs) > 1 and bool(pickle.dumps(jobs))
    except Exception:  # whatever a user's class raises
        sent = False
    if not sent:
        yield from ((index, function(*job)) for index, job in enumerate(jobs))
        return
    # Spawned, not forked: a fork of a process with threads, as of BLAS, may hang.
    with ProcessPoolExecutor(min(workers, len(jobs)), mp_context=get_context("spawn")) as pool:
        waiting = {pool.submit(function, *job): index for index, job in enumerate(jobs)}
        for done in as_completed(waiting):
            yield waiting[done], done.result()
