"""A cantilever among four stops, struck at its tip: contact at several places at once (end of section 4.2).

Three stops wait below at gaps that grow towards the tip, one above. Run it with
``python examples/several_stops.py --output output``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import vofem as vf
from vofem.io.plot import time_history
from vofem.io.render import render

ELEMENTS, STIFFNESS, BLOW = 20, 500.0, vf.Pulse(amplitude=-4.0, start=0.0, duration=0.05)
#: Place in m, gap in m and side of each stop.
STOPS = {"near": (0.4, 0.004, "below"), "middle": (0.7, 0.012, "below"), "far": (1.0, 0.03, "below")}
STOPS["upper"] = (0.85, 0.02, "above")


def build() -> tuple[vf.Beam, vf.Scene]:
    """Return the beam and the scene."""
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=ELEMENTS, supports={"left": "clamped"}, name="beam")
    stops = [
        vf.Contact(beam.at(x), gap=gap, stiffness=STIFFNESS, side=side, acts_on="penetration", name=name)
        for name, (x, gap, side) in STOPS.items()
    ]
    return beam, vf.Scene([beam], [*stops, vf.PointLoad(beam.at(1.0), BLOW)])


def main(output: Path) -> vf.Result:
    """Run, print and draw."""
    beam, scene = build()
    result = vf.simulate(scene, t_end=1.0, times=np.linspace(0.0, 1.0, 2001))
    contacts = result.contacts
    print("stop     x [m]   gap [mm]   closings   first [s]      peak force [N]   impulse [N s]")
    for name, (x, gap, _) in STOPS.items():
        history = contacts[name]
        print(
            f"{name:6s}   {x:5.2f}   {1e3 * gap:8.1f}   {history.closings.size:8d}   {history.closings[0]:.9f}"
            f"   {history.force.max():16.4f}   {np.trapezoid(history.force, result.times):13.5f}"
        )
    print(f"\ntip at 0.5 s: {result.displacement(beam.at(1.0), [0.5])[0]:.9f} m", end="")
    print(f"; {result.counters.events} events, energy balance {result.energy.balance_error:.1e}")
    # Where most stops are closed, the moment at which they push most.
    closed = np.sum([history.closed for history in contacts.values()], axis=0)
    force = np.sum([history.force for history in contacts.values()], axis=0)
    k = int(np.argmax(np.where(closed == closed.max(), force, 0.0)))
    held = [name for name, history in contacts.items() if history.closed[k]]
    print(f"at {result.times[k]:.4f} s closed: {', '.join(held)}\n")

    output.mkdir(parents=True, exist_ok=True)
    picture = render(result, result.times[k], output / "several-stops.png")
    history = time_history(result, beam.at(1.0), output / "several-stops-tip.png", contact=list(STOPS))
    print(f"wrote {picture}\n      {history}")
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("output"), help="folder for the figures")
    main(parser.parse_args().output)
