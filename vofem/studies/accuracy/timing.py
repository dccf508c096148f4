"""Wall times that can be compared, and the machine on which they were taken."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from vofem.studies.processors import processors

T = TypeVar("T")


def best_time(work: Callable[[], T], repeats: int, cap: float) -> tuple[float, T]:
    """Return the shortest time of several runs, in s, and what the first of them returned.

    `repeats`: largest number of runs.
    `cap`: time in s after which no other run begins.
    """
    begin = time.perf_counter()
    outcome = work()
    best = time.perf_counter() - begin
    for _ in range(repeats - 1):
        start = time.perf_counter()
        if start - begin + best > cap:
            break
        work()
        best = min(best, time.perf_counter() - start)
    return best, outcome


def machine() -> str:
    """Return processor, cores, load and versions on one line; times mean little without them."""
    import scipy

    busy = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    return (
        f"{_processor()}, {processors()} cores{busy}; Python {platform.python_version()}, numpy {np.__version__}, "
        f"scipy {scipy.__version__}, {platform.system()}"
    )


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            for line in file:
                if line.startswith("model name"):
                    return " ".join(line.split(":", 1)[1].split())
    except OSError:
        pass
    return platform.processor() or platform.machine()
