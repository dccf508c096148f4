"""Steady states: processor times and counts of whole branches.

    OPENBLAS_NUM_THREADS=1 python benchmarks/steady_states.py

NLvib's example 03 (Krack and Gross, 2019) with stability and all special points, the bilinear oscillator through its 42
special points, and the paper's cantilever on a stop, by 25 elements. Programs to compare with, where they are
installed: pyHarm-os follows NLvib's example 03 by harmonic balance, without stability.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import vofem as vf

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from orbit_scenes import bilinear, nlvib_03


def cantilever(omega):
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=25, supports={"left": "clamped"}, name="beam")
    tip = beam.at(1.0)
    effects = [
        vf.Contact(tip, gap=0.03, stiffness=10.0, side="below", acts_on="penetration", name="stop"),
        vf.PointLoad(tip, vf.Sine(0.05, omega)),
        vf.RayleighDamping(0.1, 1e-3),
    ]
    return vf.Scene([beam], effects)


CASES = {
    "NLvib's example 03": (nlvib_03, 0.8, 0.5),
    "bilinear oscillator": (bilinear, 3.0, 0.19),
    "cantilever, 25 elements": (cantilever, 5.0, 2.6),
}


def main():
    print("| branch | orbits | special points | flows an orbit | all flows | s | ms an orbit |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for name, (build, start, stop) in CASES.items():
        vf.continuation(build, start, start + 0.01 * (stop - start))
        begun = time.process_time()
        branch = vf.continuation(build, start, stop)
        seconds = time.process_time() - begun
        counters = branch.counters
        flows = counters.flows + counters.refinement_flows + counters.rejected_flows + counters.search_flows
        print(
            f"| {name} | {len(branch)} | {len(branch.special)} | {counters.flows / len(branch):.1f} | {flows} "
            f"| {seconds:.2f} | {1e3 * seconds / len(branch):.1f} |"
        )
    orbit = vf.periodic(cantilever(4.5))
    begun, count = time.process_time(), 20
    for k in range(count):
        orbit = vf.periodic(cantilever(4.5 + 1e-3 * k), guess=orbit)
    print(f"one frequency of the cantilever from its neighbour: {1e3 * (time.process_time() - begun) / count:.1f} ms")
    scene = cantilever(4.5)
    begun = time.process_time()
    for _ in range(count):
        vf.periodic(scene, guess=orbit)
    print(f"the same scene again: {1e3 * (time.process_time() - begun) / count:.1f} ms")


if __name__ == "__main__":
    main()
