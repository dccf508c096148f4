"""A cantilever that meets a stop under a harmonic load: its steady amplitude over the load's frequency and the gap.

At every point of the map `vf.periodic` finds the orbit that motion from rest leads to, with its stability. A stop
that the tip does not reach changes nothing: there the amplitude depends on the frequency alone, with its resonance at
3.52 rad/s. A closer stop stiffens the beam, and the resonance moves to higher frequencies. Beside the bent resonance
lie motions that do not repeat after one period of the load: there the map is grey, or hatched where the orbit is
unstable. Run it with ``python examples/cantilever_map.py --output output``, or with ``--count 100`` for the full map
of 10 000 orbits. The rows are kept in a file, so a run that was stopped goes on.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import vofem as vf
from vofem.io.plot import state_map

FORCE = 0.1


def scene_at(omega: float, gap: float) -> vf.Scene:
    """Return the cantilever with a stop at `gap`, m, under a load of angular frequency `omega`, rad/s."""
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=10, supports={"left": "clamped"}, name="beam")
    tip = beam.at(1.0)
    stop = vf.Contact(tip, gap=gap, stiffness=100.0, side="below", acts_on="penetration", name="stop")
    load = vf.PointLoad(tip, vf.Sine(FORCE, omega))
    return vf.Scene([beam], [stop, load, vf.RayleighDamping(0.2, 1e-3)])


def main(output: Path, count: int = 5) -> vf.StabilityMap:
    """Draw the map of `count` frequencies and gaps."""
    omegas, gaps = np.linspace(1.0, 7.0, count), np.linspace(0.01, 0.2, count)
    # Few runs are over before processes have started.
    executor = "serial" if count < 20 else None
    found = vf.stability_map(scene_at, omegas, gaps, executor=executor, store=output / f"cantilever-map-{count}.h5")
    print(found)
    row, column = np.unravel_index(np.nanargmax(found.amplitude), found.amplitude.shape)
    print(
        f"largest amplitude {found.amplitude[row, column]:.6f} m at {omegas[row]:.4g} rad/s, gap {gaps[column]:.4g} m"
    )
    labels = ("angular frequency of the load [rad/s]", "gap [m]")
    print(f"wrote {state_map(found, output / 'cantilever_map.png', labels=labels)}")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("output"))
    parser.add_argument("--count", type=int, default=5, help="frequencies, and gaps (5)")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    main(arguments.output, arguments.count)
