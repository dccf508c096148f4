"""The paper's two masses across a gap (section 4.1), cases a, b and c: displacements and K_eq.

Case a never closes the gap, case b does after a while, case c in every period of the load. Run it with
``python examples/two_masses.py --output output``.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Literal

import numpy as np

import vofem as vf
from vofem.io.plot import time_history

LAWS: tuple[Literal["displacement", "penetration"], ...] = ("displacement", "penetration")
FORCES = {
    "a: no contact": (vf.Sine(-3.0, 0.3), None),
    "b: contact now and then": (vf.Sine(-10.0, 0.3), None),
    "c: contact in every period": (vf.Sine(5.0, 0.8), vf.Sine(-5.0, 0.8)),
}


def build(case: str, acts_on: Literal["displacement", "penetration"]) -> tuple[vf.Mass, vf.Mass, vf.Scene]:
    """Return both masses and the scene."""
    first = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="first")
    second = vf.Mass(1.0, stiffness=1.0, damping=0.4, name="second")
    contact = vf.Contact(first, second, gap=5.0, stiffness=2.0, acts_on=acts_on, name="contact")
    loads = [vf.PointLoad(m, f) for m, f in zip((first, second), FORCES[case], strict=True) if f is not None]
    return first, second, vf.Scene([first, second], [contact, *loads], initial={first: (0.0, -1.0)})


def main(output: Path) -> dict[tuple[str, str], vf.Result]:
    """Run, print and draw."""
    output.mkdir(parents=True, exist_ok=True)
    times = np.linspace(0.0, 100.0, 2001)
    results, written = {}, []
    print("acts_on        case   xi1(25 s) [m]   xi1(100 s) [m]   xi2(100 s) [m]   events   first closings [s]")
    for acts_on in LAWS:
        cases = {}
        for case in FORCES:
            first, second, scene = build(case, acts_on)
            result = vf.simulate(scene, t_end=100.0, times=times)
            early, late = result.displacement(first, [25.0, 100.0])
            other = result.displacement(second, [100.0])[0]
            closings = "   ".join(f"{t:.9f}" for t in result.contacts["contact"].closings[:2])
            print(
                f"{acts_on:12s}   {case[0]:4s}   {early:13.9f}   {late:14.9f}   {other:14.9f}"
                f"   {result.counters.events:6d}   {closings or 'none'}"
            )
            cases[case] = results[acts_on, case[0]] = result
        written.append(time_history(cases, [first, second], output / f"two-masses-{acts_on}.png"))
    print("\nwrote " + "\n      ".join(str(path) for path in written))
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("output"), help="folder for the figures")
    main(parser.parse_args().output)
