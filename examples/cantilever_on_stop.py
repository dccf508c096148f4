"""The paper's cantilever against its stop (section 4.2): 25 elements, 20 s, exact between events.

The first figure is the paper's history of the tip with K_eq; ``beam_shapes.py`` has the shapes. Run it with
``python examples/cantilever_on_stop.py --output output``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import vofem as vf
from vofem.io.plot import time_history
from vofem.io.render import render


def build() -> tuple[vf.Beam, vf.Contact, vf.Scene]:
    """Return the beam, its stop and the scene."""
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=25, supports={"left": "clamped"}, name="cantilever")
    stop = vf.Contact(beam.at(1.0), gap=0.03, stiffness=1.0, side="below", acts_on="displacement", name="stop")
    load = vf.PointLoad(beam.at(1.0), vf.Sine(amplitude=0.1, omega=1.0))
    return beam, stop, vf.Scene(bodies=[beam], effects=[stop, load])


def event_table(result: vf.Result, stop: vf.Contact, tip: object) -> list[str]:
    """Return one line per contact: when it closes and opens, its peak force and what goes through it."""
    history = result.contacts[stop.name]
    lines = ["contact   closes [s]     opens [s]      lasts [s]   peak force [N]   impulse [N s]"]
    for k, closing in enumerate(history.closings):
        ended = k < history.openings.size
        opening = history.openings[k] if ended else result.times[-1]
        t = np.linspace(closing, opening, 2001)
        force = -stop.stiffness * result.displacement(tip, t=t)
        lines.append(
            f"{k + 1:7d}   {closing:12.9f}   {opening:12.9f}{' ' if ended else '+'}  {opening - closing:9.6f}"
            f"   {force.max():14.6f}   {np.trapezoid(force, t):13.6f}"
        )
    return lines


def energy_table(result: vf.Result) -> list[str]:
    """Return energies every 4 s and the error of their balance."""
    energy = result.energy
    lines = ["  t [s]   kinetic [J]   strain [J]    contact [J]   work [J]"]
    for t in (0.0, 4.0, 8.0, 12.0, 16.0, 20.0):
        i = int(np.argmin(np.abs(result.times - t)))
        lines.append(
            f"{result.times[i]:7.2f}   {energy.kinetic[i]:11.4e}   {energy.strain[i]:11.4e}"
            f"   {energy.contact[i]:11.4e}   {energy.work[i]:11.4e}"
        )
    lines.append(f"energy balance holds to {energy.balance_error:.1e} of the largest energy")
    return lines


def main(output: Path) -> vf.Result:
    """Run, print and draw."""
    beam, stop, scene = build()
    tip = beam.at(1.0)
    print(vf.explain(scene), end="\n\n")
    result = vf.simulate(scene, t_end=20.0, times=np.linspace(0.0, 20.0, 2001))
    counters = result.counters
    print(
        f"{counters.events} contact events in {counters.steps} closed-form segments, "
        f"{counters.gap_evaluations} looks at the gap, {counters.statuses} statuses\n"
    )
    print("\n".join(event_table(result, stop, tip)), end="\n\n")
    print("\n".join(energy_table(result)), end="\n\n")
    for note in result.notes:
        print(f"note: {note}")

    output.mkdir(parents=True, exist_ok=True)
    written = [time_history(result, tip, output / "tip-history.png")]
    closing, opening = result.contacts["stop"].closings[0], result.contacts["stop"].openings[0]
    picture = render(result, 0.5 * (closing + opening), output / "beam-in-contact.png")
    written.append(picture.path)
    if picture.message:
        print(picture.message)
    print("wrote " + "\n      ".join(str(path) for path in written))
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("output"), help="folder for the figures")
    main(parser.parse_args().output)
