"""A mass that hits an elastic stop under harmonic load: stroboscopic points and continued orbits in one diagram.

The oscillator of Ing, Pavlovskaia, Wiercigroch and Banerjee (2008), Experimental study of impact oscillator with
one-sided elastic constraint, doi:10.1098/rsta.2007.2122: x'' + 2 z x' + x + beta (x - e) H(x - e) = a w^2 cos(w t).
Each value of w is run from rest, and along rising and falling values of w. The branch of orbits of period 1 is followed
through its period doubling. Where it is stable, runs that fall along w lie on it. Run it with
``python examples/impact_oscillator.py --output output``, or with ``--count 400`` for the full picture (minutes).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import vofem as vf
from vofem.io.plot import bifurcation

DAMPING_RATIO, STIFFNESS, GAP, AMPLITUDE = 0.01, 29.0, 1.26, 0.7

#: On the stable orbit of period 1 at w = 1.01, where the load's cosine is 1.
START = (1.4825, 0.2920)


def scene_at(omega: float) -> vf.Scene:
    """Return the oscillator under a load of angular frequency `omega`, rad/s."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=2.0 * DAMPING_RATIO, name="mass")
    stop = vf.Contact(mass, gap=GAP, stiffness=STIFFNESS, side="above", acts_on="penetration", name="stop")
    load = vf.PointLoad(mass, vf.Sine(AMPLITUDE * omega**2, omega, phase=np.pi / 2))
    return vf.Scene([mass], [stop, load], initial={mass: START})


def main(output: Path, count: int = 9) -> tuple[vf.Branch, object]:
    """Draw the diagram with `count` values of the frequency."""
    values = np.linspace(0.81, 1.01, count)
    # Few runs are over before processes have started.
    executor = "serial" if count < 50 else None
    diagram = vf.bifurcation_diagram(
        scene_at, values, periods=100, skip=200, executor=executor, store=output / f"impact-{count}.h5"
    )
    branch = vf.continuation(scene_at, 1.01, 0.81, guess={vf.Mass(1.0, name="mass"): START})
    for special in branch.special:
        print(f"{special.kind} at w = {special.value:.12f}")
    for start in diagram.samples:
        regular = np.count_nonzero(diagram.order(start, tolerance=1e-3))
        print(f"{start}: {regular} of {count} motions repeat after at most 50 periods")
    picture = bifurcation(
        diagram, output / "impact_oscillator.png", branches=[branch], label="angular frequency w [rad/s]"
    )
    print(f"wrote {picture}")
    return branch, diagram


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("output"))
    parser.add_argument("--count", type=int, default=9, help="values of the frequency (9)")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    main(arguments.output, arguments.count)
