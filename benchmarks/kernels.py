"""Microseconds per step of the stepping methods, beside LAPACK's banded solve: ``python benchmarks/kernels.py``.

Set-up (assembly, factors, storage) is taken out: a step is the difference of a
long and a short run over the difference of their steps.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any
from unittest import mock

import numpy as np
from cases import chain, many_contacts

from vofem.kernels.mode import kernels as running
from vofem.linalg.banded import band_order, to_band
from vofem.system import State, System

METHODS = ("central_difference", "generalized_alpha", "energy_conserving")
CONTACTS = (0, 1, 25)


def _beam(elements: int) -> Callable[[int], tuple[System, State]]:
    def build(contacts: int) -> tuple[System, State]:
        scene = many_contacts(elements, contacts)
        return scene.model.system, scene.initial_state()

    return build


def _chain(contacts: int) -> tuple[System, State]:
    system = chain(100_000, contacts)
    return system, State(np.zeros(system.size), np.zeros(system.size))


#: What is measured: a title, a function of the number of contacts, and a step in s within the stability limit: the
#: beam's highest frequency is 59.9 N^2 rad/s, the chain's at most sqrt(5).
SYSTEMS: tuple[tuple[str, Callable[[int], tuple[System, State]], float], ...] = (
    ("beam, 25 elements", _beam(25), 1.8 / (59.9 * 25**2)),
    ("beam, 1 000 elements", _beam(1000), 1.8 / (59.9 * 1000**2)),
    ("beam, 10 000 elements", _beam(10_000), 1.8 / (59.9 * 10_000**2)),
    ("chain of 100 000 masses", _chain, 0.8),
)

#: Seconds of work in the long run of a measurement.
_WORK = 0.2

#: Seconds that a step takes at least for every unknown, whatever a busy machine makes of the difference of two runs.
_LEAST = 5e-9

#: Steps of the short run.
_SHORT = 20


@dataclass(frozen=True)
class Row:
    """One system: microseconds per step by method, and of one banded solve."""

    system: str
    contacts: int
    unknowns: int
    solve: float
    steps: dict[str, float]


def banded_solve(system: System) -> float:
    """Return the microseconds of LAPACK's pbtrs with a factor of M + K at hand, best of many."""
    from scipy.linalg import cholesky_banded
    from scipy.linalg.lapack import dpbtrs

    order = band_order(system.mass, system.stiffness)
    band = to_band((system.mass + system.stiffness).tocsc(), order)
    factor = np.asfortranarray(cholesky_banded(band, lower=True))
    right = np.ones(system.size)
    best, spent = np.inf, 0.0
    while spent < 0.1:
        start = time.perf_counter()
        dpbtrs(factor, right, lower=1)
        took = time.perf_counter() - start
        best, spent = min(best, took), spent + took
    return 1e6 * best


def step_time(system: System, start: State, method: str, limit: float) -> float:
    """Return the microseconds of a step of 1 ms, or of 0.9 of the critical step `limit`."""
    stepping = getattr(import_module("vofem.integrators.stepping.methods"), method)
    dt = 0.9 * limit if method == "central_difference" else 1e-3

    def run(steps: int) -> float:
        t_end = steps * dt
        begin = time.perf_counter()
        stepping(system, start, t_end, np.array([0.0, t_end]), dt, nearby=False)
        return time.perf_counter() - begin

    # Looking for the critical step takes longer than thousands of steps; it is known here.
    with mock.patch("vofem.integrators.stepping.methods.critical_step", return_value=limit):
        run(2)
        base = min(run(_SHORT) for _ in range(3))
        # As many steps as make the work, by what some take.
        rate = max((run(_SHORT + 30) - base) / 30, _LEAST * system.size)
        count = int(np.clip(_WORK / rate, 30, 100_000))
        long = min(run(_SHORT + count) for _ in range(2))
        base = min(base, run(_SHORT))
    return 1e6 * max(long - base, 0.0) / count


def measure(report: Any = None) -> list[Row]:
    """Return a row per system and number of contacts."""
    rows = []
    for title, build, limit in SYSTEMS:
        for contacts in CONTACTS:
            if report is not None:
                report(f"kernels: {title}, {contacts} contacts")
            system, start = build(contacts)
            steps = {method: step_time(system, start, method, limit) for method in METHODS}
            rows.append(Row(title, contacts, system.size, banded_solve(system), steps))
    return rows


def table(rows: list[Row]) -> str:
    """Return Markdown: microseconds, and over LAPACK's solve."""
    head = ["system", "contacts", "unknowns", "LAPACK solve", *(method.replace("_", " ") for method in METHODS)]
    lines = ["| " + " | ".join(head) + " |", "| --- |" + " ---: |" * (len(head) - 1)]
    for row in rows:
        cells = [f"{row.steps[m]:.3g} ({row.steps[m] / row.solve:.1f})" for m in METHODS]
        start = [row.system, str(row.contacts), str(row.unknowns), f"{row.solve:.3g}"]
        lines.append("| " + " | ".join(start + cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    with running(compiled=True):
        print(table(measure(lambda text: print(text, file=sys.stderr))))
