"""The place and the gap of a stop that is hit as softly as possible, by optimisation with exact gradients.

A cantilever is struck, and its tip must not sink below a limit. A stop close to the beam is hit hard, and one that is
far away does not hold the tip. `scipy.optimize` finds the best place and gap from exact gradients:
`vofem.sensitivities` differentiates the largest force and the lowest position of the tip through all impacts.
There are several minima; the start is a good point of a coarse search. Run it with
``python examples/stop_placement.py --output output``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, minimize

import vofem as vf
from vofem.io import plot

#: Deepest allowed position of the tip, m; bounds of place and gap, m.
LIMIT, PLACES, GAPS = 0.015, (0.55, 0.95), (0.001, 0.02)

#: Sizes by which the unknowns of the optimiser are divided, m, m and N; and the number of impacts whose force counts.
PLACE, GAP, FORCE, IMPACTS = 1.0, 0.01, 50.0, 8

TIMES = np.linspace(0.0, 0.5, 2001)

Vector = NDArray[np.float64]


def scene_of(x: float, gap: float) -> vf.Scene:
    """Return the struck cantilever with a stop below it."""
    beam = vf.Beam(length=1.0, EI=70.0, rhoA=0.5, elements=10, supports={"left": "clamped"}, name="beam")
    stop = vf.Contact(beam.at(x), gap=gap, stiffness=5e4, side="below", acts_on="penetration", name="stop")
    struck = {beam: (0.0, lambda s: -6.0 * s**2 * (1.0 - s))}
    return vf.Scene([beam], [stop, vf.ModalDamping(0.01)], initial=struck)


class Trial:
    """One run: the peak forces of its first impacts, its lowest tip, and the derivatives of both by place and gap."""

    def __init__(self, x: float, gap: float) -> None:
        self.result = vf.simulate(scene_of(x, gap), TIMES[-1], times=TIMES, method="event_driven")
        self.tip = self.result.scene.bodies[0].at(1.0)
        d = vf.sensitivities(self.result, [vf.Parameter("stop", "x"), vf.Parameter("stop", "gap")])
        found = self.result.contacts["stop"].impacts.peak_force[:IMPACTS]
        # An impact that does not happen needs no force.
        self.peaks, self.peaks_by = np.zeros(IMPACTS), np.zeros((IMPACTS, 2))
        self.peaks[: found.size] = found
        self.peaks_by[: found.size] = d.contacts["stop"].impacts.peak_force[:IMPACTS]
        u = self.result.displacement(self.tip)
        lowest = int(np.argmin(u))
        self.lowest, self.lowest_by = float(u[lowest]), d.displacement(self.tip)[lowest]


def optimise(start: tuple[float, float]) -> tuple[OptimizeResult, list[Trial]]:
    """Return the best place and gap with the largest force there, and all trials on the way.

    The largest of several forces has kinks, which gradients do not see. So the optimiser lowers a bound, from which
    each force keeps its distance.
    """
    trials: dict[tuple[float, float], Trial] = {}

    def trial(p: Vector) -> Trial:
        key = PLACE * float(p[0]), GAP * float(p[1])
        if key not in trials:
            trials[key] = Trial(*key)
        return trials[key]

    def room(p: Vector) -> Vector:
        one = trial(p)
        return np.append(p[2] - one.peaks / FORCE, (one.lowest + LIMIT) / LIMIT)

    def room_by(p: Vector) -> Vector:
        one, scale = trial(p), np.array([PLACE, GAP])
        by = np.vstack([-one.peaks_by / FORCE, one.lowest_by / LIMIT]) * scale
        return np.column_stack([by, np.append(np.ones(IMPACTS), 0.0)])

    first = np.array([start[0] / PLACE, start[1] / GAP])
    bounds = [tuple(x / PLACE for x in PLACES), tuple(gap / GAP for gap in GAPS), (0.0, None)]
    best = minimize(
        lambda p: p[2],
        np.append(first, trial(first).peaks.max() / FORCE),
        jac=lambda p: np.array([0.0, 0.0, 1.0]),
        bounds=bounds,
        constraints={"type": "ineq", "fun": room, "jac": room_by},
        method="SLSQP",
        options={"ftol": 1e-9},
    )
    best.x = best.x * np.array([PLACE, GAP, FORCE])
    return best, list(trials.values())


def main(output: Path, start: tuple[float, float] = (0.7, 0.005)) -> tuple[OptimizeResult, list[Trial]]:
    """Optimise from a place and gap, and draw the motion of the tip with the best stop."""
    best, trials = optimise(start)
    first, last = trials[0], Trial(*best.x[:2])
    for name, one, (x, gap) in (("first", first, start), ("best", last, best.x[:2])):
        print(
            f"{name}: stop at {x:.4f} m behind {1e3 * gap:.3f} mm, largest force {one.peaks.max():.3f} N, "
            f"lowest tip {1e3 * one.lowest:.3f} mm"
        )
    print(f"{len(trials)} runs")
    print(f"wrote {plot.time_history(last.result, last.tip, output / 'stop_placement.png')}")
    return best, trials


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("output"))
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    main(arguments.output)
