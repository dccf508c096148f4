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
from vofem.io.tables import contact_table, counter_line, energy_table


def build() -> tuple[vf.Beam, vf.Contact, vf.Scene]:
    """Return the beam, its stop and the scene."""
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=25, supports={"left": "clamped"}, name="cantilever")
    stop = vf.Contact(beam.at(1.0), gap=0.03, stiffness=1.0, side="below", acts_on="displacement", name="stop")
    load = vf.PointLoad(beam.at(1.0), vf.Sine(amplitude=0.1, omega=1.0))
    return beam, stop, vf.Scene(bodies=[beam], effects=[stop, load])


def main(output: Path) -> vf.Result:
    """Run, print and draw."""
    beam, stop, scene = build()
    tip = beam.at(1.0)
    print(vf.explain(scene), end="\n\n")
    result = vf.simulate(scene, t_end=20.0, times=np.linspace(0.0, 20.0, 2001))
    print(counter_line(result), end="\n\n")
    print(contact_table(result, stop.name), end="\n\n")
    print(energy_table(result), end="\n\n")
    for note in result.notes:
        print(f"note: {note}")

    output.mkdir(parents=True, exist_ok=True)
    written = [time_history(result, tip, output / "tip-history.png")]
    closing, opening = result.contacts["stop"].closings[0], result.contacts["stop"].openings[0]
    written.append(render(result, 0.5 * (closing + opening), output / "beam-in-contact.png"))
    print("wrote " + "\n      ".join(str(path) for path in written))
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("output"), help="folder for the figures")
    main(parser.parse_args().output)
