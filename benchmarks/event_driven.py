"""Wall time and events of event_driven runs: `python benchmarks/event_driven.py [REPEATS]` prints a table.

Times are the best of some repetitions after one run that compiles and fills caches; events and evaluations tell
whether two machines did the same work.
"""

from __future__ import annotations

import itertools
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np

import vofem as vf
from vofem.kernels.mode import kernels as running

LAWS = ("displacement", "penetration")


def paper_beam(acts_on: str, stiffness: float = 1.0) -> tuple[vf.Scene, float]:
    """Return the paper's cantilever of 25 elements over its stop, and 20 s."""
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=25, supports={"left": "clamped"})
    tip = beam.at(1.0)
    stop = vf.Contact(tip, gap=0.03, stiffness=stiffness, side="below", acts_on=acts_on)
    return vf.Scene([beam], [stop, vf.PointLoad(tip, vf.Sine(0.1, 1.0))]), 20.0


def chain(count: int) -> tuple[vf.Scene, float]:
    """Masses in a row, apart by gaps, struck by the first, until the last has left."""
    masses = [vf.Mass(1.0) for _ in range(count)]
    contacts = [vf.Contact(a, b, gap=0.01, stiffness=1e6, acts_on="penetration") for a, b in itertools.pairwise(masses)]
    return vf.Scene(masses, contacts, initial={masses[0]: (0.0, 1.0)}), 0.015 * count


def bar(count: int) -> tuple[vf.Scene, float]:
    """Return a bar of masses and springs (length 10, E 900, density 1) dropped from 5 m on a stiff stop, and 5 s."""
    h = 10.0 / count
    masses = [vf.Mass(h * (0.5 if i in (0, count) else 1.0)) for i in range(count + 1)]
    springs = [vf.Spring(a, b, stiffness=900.0 / h) for a, b in itertools.pairwise(masses)]
    stop = vf.Contact(masses[0], gap=5.0, stiffness=900.0 / h, side="below", acts_on="penetration")
    return vf.Scene(masses, [*springs, stop, vf.Gravity(10.0)]), 5.0


def cases() -> Iterator[tuple[str, Callable[[], tuple[vf.Scene, float]]]]:
    """Yield names and builders."""
    for law in LAWS:
        yield f"paper's beam, {law}", lambda law=law: paper_beam(law)  # type: ignore[misc]
    for stiffness in (1e2, 1e4, 1e6, 1e9):
        for law in LAWS:
            yield (
                f"beam, K0 = {stiffness:.0e}, {law}",
                lambda law=law, stiffness=stiffness: paper_beam(law, stiffness),  # type: ignore[misc]
            )
    for count in (10, 50, 200):
        yield f"chain of {count} masses", lambda count=count: chain(count)  # type: ignore[misc]
    for count in (10, 50, 200):
        yield f"bouncing bar of {count} springs", lambda count=count: bar(count)  # type: ignore[misc]


def measure(build: Callable[[], tuple[vf.Scene, float]], repeats: int) -> tuple[float, vf.Result]:
    """Return the best time in s of some runs after a first one, and the last result."""
    scene, t_end = build()
    times = np.linspace(0.0, t_end, 1001)
    result = vf.simulate(scene, t_end, method="event_driven", times=times)
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        result = vf.simulate(scene, t_end, method="event_driven", times=times)
        best = min(best, time.perf_counter() - start)
    return best, result


def main(repeats: int = 5) -> None:
    """Print the table."""
    print(f"{'case':36s} {'ms':>9s} {'events':>7s} {'statuses':>8s} {'gap evaluations':>15s} {'balance':>8s}")
    for name, build in cases():
        seconds, result = measure(build, repeats)
        counters = result.counters
        print(
            f"{name:36s} {1e3 * seconds:9.2f} {counters.events:7d} {counters.statuses:8d} "
            f"{counters.gap_evaluations:15d} {result.energy.balance_error:8.1e}",
            flush=True,
        )


if __name__ == "__main__":
    with running(compiled=True):
        main(*(int(argument) for argument in sys.argv[1:]))
