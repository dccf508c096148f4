"""Runs on several processes, for runs that are not timed. Timed runs take place alone, after them."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from typing import Any


def spread(function: Callable[..., Any], jobs: Sequence[tuple[Any, ...]], workers: int) -> Iterator[tuple[int, Any]]:
    """Give the index of every job and what the function returns for it, as they are done.

    `function`: a function of a module, so that other processes can import it.
    `jobs`: arguments.
    `workers`: processes. With 1, or where a job cannot be sent to another process (a lambda in a scene cannot), all is
    done in this one.
    """
    if workers > 1 and len(jobs) > 1 and _can_be_sent(jobs):
        yield from _elsewhere(function, jobs, min(workers, len(jobs)))
        return
    for index, job in enumerate(jobs):
        yield index, function(*job)


def _can_be_sent(jobs: Sequence[tuple[Any, ...]]) -> bool:
    try:
        pickle.dumps(jobs)
    except Exception:  # whatever a user's class raises
        return False
    return True


def _elsewhere(
    function: Callable[..., Any], jobs: Sequence[tuple[Any, ...]], workers: int
) -> Iterator[tuple[int, Any]]:
    from concurrent.futures import ProcessPoolExecutor, as_completed
    from multiprocessing import get_context

    # Spawned, not forked: a fork of a process with threads, as of BLAS, may hang.
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        waiting = {pool.submit(function, *job): index for index, job in enumerate(jobs)}
        for done in as_completed(waiting):
            yield waiting[done], done.result()
