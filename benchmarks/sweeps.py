"""What sweeps cost beyond the runs themselves, and how long the diagrams of the docs take.

python benchmarks/sweeps.py               # overhead a point: serial, processes
python benchmarks/sweeps.py diagram       # 400 frequencies x 300 periods x 3 starts, on one and on two workers
python benchmarks/sweeps.py map           # 100 x 100 steady amplitudes of a cantilever, on two workers
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

import vofem as vf


def nothing(x: float) -> dict[str, float]:
    return {"y": x}


def busy(x: float, seconds: float = 0.005) -> dict[str, float]:
    """Compute for a while."""
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        pass
    return {"y": x}


def impact_oscillator(omega: float) -> vf.Scene:
    """Return the oscillator of Ing et al. (2008), doi:10.1098/rsta.2007.2122, at a = 0.7."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.02, name="mass")
    stop = vf.Contact(mass, gap=1.26, stiffness=29.0, side="above", acts_on="penetration", name="stop")
    return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(0.7 * omega**2, omega, phase=np.pi / 2))])


def cantilever(omega: float, gap: float) -> dict[str, float]:
    """Return the steady amplitude of a cantilever's tip at a stop, after 30 periods of the load."""
    beam = vf.Beam(1.0, 1.0, 1.0, 10, supports={"left": "clamped"}, name="beam")
    tip = beam.at(1.0)
    stop = vf.Contact(tip, gap=gap, stiffness=100.0, side="below", acts_on="penetration", name="stop")
    effects = [stop, vf.PointLoad(tip, vf.Sine(0.1, omega)), vf.RayleighDamping(0.2, 1e-3)]
    period = 2.0 * np.pi / omega
    times = np.linspace(30.0 * period, 35.0 * period, 201)
    u = vf.simulate(vf.Scene([beam], effects), float(times[-1]), times=times).displacement(tip)
    return {"amplitude": 0.5 * float(np.ptp(u))}


def timed(call: Callable[[], object]) -> tuple[float, object]:
    begun = time.perf_counter()
    outcome = call()
    return time.perf_counter() - begun, outcome


def overhead() -> None:
    points = {"x": list(range(20_000))}
    seconds, _ = timed(lambda: vf.sweep(nothing, points, executor="serial"))
    print(f"serial, empty function: {1e6 * seconds / 20_000:.1f} us a point")
    points = {"x": list(range(2000))}
    seconds, table = timed(lambda: vf.sweep(busy, points, executor="serial"))
    print(f"serial, 5 ms a point: {100 * (seconds / table.seconds.sum() - 1):.2f} % beyond the points")  # type: ignore[attr-defined]
    vf.sweep(busy, {"x": [0]}, workers=2)
    start, _ = timed(lambda: vf.sweep(busy, {"x": [0, 1]}, workers=2))
    seconds, table = timed(lambda: vf.sweep(busy, points, workers=2))
    alone = table.seconds.sum() / 2  # type: ignore[attr-defined]
    print(
        f"two processes, 5 ms a point: {100 * (seconds - start) / alone - 100:.2f} % beyond the points, "
        f"after {start:.2f} s for starting"
    )


def diagram() -> None:
    values = np.linspace(0.78, 1.02, 400)
    vf.bifurcation_diagram(impact_oscillator, values[:2], periods=2, skip=2, executor="serial")
    for workers in (1, 2):
        seconds, found = timed(
            lambda workers=workers: vf.bifurcation_diagram(
                impact_oscillator, values, periods=100, skip=200, follow=False, workers=workers
            )
        )
        print(f"400 x 300 periods from rest, {workers} workers: {seconds:.1f} s; {found!r}")
    seconds, found = timed(lambda: vf.bifurcation_diagram(impact_oscillator, values, periods=100, skip=200, workers=2))
    print(f"400 x 300 periods, all three starts, 2 workers: {seconds:.1f} s; {found!r}")


def steady_map() -> None:
    points = {"omega": np.linspace(0.5, 6.0, 100), "gap": np.linspace(0.005, 0.1, 100)}
    seconds, table = timed(lambda: vf.sweep(cantilever, points, workers=2))
    print(f"100 x 100 amplitudes of a cantilever of 10 elements, 2 workers: {seconds:.1f} s; {table!r}")


if __name__ == "__main__":
    {"diagram": diagram, "map": steady_map}.get(sys.argv[1] if len(sys.argv) > 1 else "", overhead)()
