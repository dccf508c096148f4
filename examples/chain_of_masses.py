"""A chain of N masses with N - 1 gaps: more bodies than the two of section 4.1, as one system.

Every gap is open or closed, so there are 2^(N-1) contact statuses, and a model with one set of equations each would
need them all. The variable-order model has one set, and visits few statuses. Run it with
``python examples/chain_of_masses.py --output output``.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

import vofem as vf
from vofem.io.plot import space_time

STIFFNESS, GAP, LOAD = 0.1, 0.05, vf.Sine(amplitude=1.0, omega=2.0)


def build(count: int) -> vf.Scene:
    """Return a row of masses of 1 kg, each on a soft spring; the first one is driven."""
    masses = [vf.Mass(1.0, stiffness=STIFFNESS, name=f"mass {k + 1}") for k in range(count)]
    contacts = [
        vf.Contact(left, right, gap=GAP, stiffness=100.0, acts_on="penetration", name=f"gap {k + 1}")
        for k, (left, right) in enumerate(pairwise(masses))
    ]
    return vf.Scene(masses, [*contacts, vf.PointLoad(masses[0], LOAD)])


def main(output: Path) -> dict[int, vf.Result]:
    """Run, print and draw."""
    results = {}
    print("masses   unknowns   first closing [s]   events   statuses visited   of 2^(N-1)   energy balance")
    for count in (4, 8, 12, 16):
        scene = build(count)
        result = results[count] = vf.simulate(scene, t_end=20.0)
        counters = result.counters
        print(
            f"{count:6d}   {scene.model.system.size:8d}   {result.contacts['gap 1'].closings[0]:17.12f}"
            f"   {counters.events:6d}   {counters.statuses:16d}   {2 ** (count - 1):10d}"
            f"   {result.energy.balance_error:14.1e}"
        )
    output.mkdir(parents=True, exist_ok=True)
    path = space_time(results[16], output / "chain-of-masses.png")
    print(f"\nwrote {path}")
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("output"), help="folder for the figures")
    main(parser.parse_args().output)
