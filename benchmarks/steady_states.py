"""Steady states: processor times and counts of whole branches.

    OPENBLAS_NUM_THREADS=1 python benchmarks/steady_states.py [--pyharm PYTHON]

NLvib's example 03 (Krack and Gross, 2019) with stability and all special points, by shooting and by harmonic balance;
the bilinear oscillator through its 42 special points; and the paper's cantilever on a stop, by 25 elements. With
``--pyharm`` the same example by pyHarm-os goes before, with long and with short steps, in the environment of the given
Python; see `peers/pyharm_nlvib_03.py`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
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
    "NLvib's example 03": (nlvib_03, 0.8, 0.5, {}),
    "NLvib's example 03, 21 harmonics": (nlvib_03, 0.8, 0.5, {"harmonics": 21}),
    "bilinear oscillator": (bilinear, 3.0, 0.19, {}),
    "cantilever, 25 elements": (cantilever, 5.0, 2.6, {}),
}

#: Largest steps of pyHarm-os, in its own measure.
STEPS = (0.05, 0.001)


def pyharm(python):
    script = Path(__file__).resolve().parent / "peers" / "pyharm_nlvib_03.py"
    command = [str(Path(python).absolute()), str(script)]
    print("| pyHarm-os, NLvib's example 03 | orbits | changes of direction | s |")
    print("| --- | --- | --- | --- |")
    for step in STEPS:
        # It leaves files where it runs.
        with tempfile.TemporaryDirectory() as folder:
            done = subprocess.run([*command, str(step)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=folder)
        told = json.loads(done.stdout)
        print(f"| largest step {step:g} | {told['points']} | {told['turns']} | {told['processor_seconds']:.2f} |")
    print()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--pyharm", help="Python of an environment with pyHarm-os")
    python = parser.parse_args().pyharm
    if python is not None:
        pyharm(python)
    print("| branch | orbits | special points | flows an orbit | all flows | s | ms an orbit |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for name, (build, start, stop, options) in CASES.items():
        vf.continuation(build, start, start + 0.01 * (stop - start), **options)
        begun = time.process_time()
        branch = vf.continuation(build, start, stop, **options)
        seconds = time.process_time() - begun
        counters = branch.counters
        flows = (
            counters.flows
            + counters.refinement_flows
            + counters.rejected_flows
            + counters.search_flows
            + counters.check_flows
        )
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
