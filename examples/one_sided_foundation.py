"""A beam on a foundation that only pushes: the paper's remark on contact along the whole length (end of section 4.2).

A long beam without weight, pressed down in its middle, keeps contact over pi/(2 lambda) on each side with
lambda^4 = k/(4 EI) and lifts off beyond; it sinks by w0 = (P lambda/2k) coth(pi/2). Then the same beam with some
weight is let go. Run it with ``python examples/one_sided_foundation.py --output output``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import vofem as vf
from vofem.io.plot import shapes, space_time

LENGTH, EI, K, P = 12.0, 1.0, 4.0, 1.0
LAMBDA = (K / (4.0 * EI)) ** 0.25


def build(elements: int, weight: float = 0.0, pressed: bool = True) -> tuple[vf.Beam, vf.Scene]:
    """Return the beam and the scene: pressed down in the middle, or with its weight alone."""
    beam = vf.Beam(length=LENGTH, EI=EI, rhoA=1.0, elements=elements, name="beam")
    effects: list[object] = [vf.Foundation(beam, stiffness=K, one_sided=True, name="bed")]
    if pressed:
        effects.append(vf.PointLoad(beam.at(LENGTH / 2), -P))
    if weight:
        effects.append(vf.Gravity(weight))
    return beam, vf.Scene([beam], effects)


def closed_form(x: np.ndarray) -> np.ndarray:
    """Return the deflection of the pressed beam: bent over the contact, straight beyond."""
    y = np.pi / 2 - LAMBDA * np.abs(x - LENGTH / 2)
    bent = 0.5 * (np.cosh(y) * np.sin(y) + np.sinh(y) * np.cos(y))
    return -P * LAMBDA / (K * np.sinh(np.pi / 2)) * np.where(y > 0.0, bent, y)


def static(output: Path) -> tuple[Path, list[tuple[int, float, float]]]:
    """Print the convergence under the load, and draw the finest mesh."""
    exact, rows = -closed_form(np.array([LENGTH / 2]))[0], []
    print(f"closed form: half contact length {np.pi / (2 * LAMBDA):.6f} m, w0 = {exact:.9f} m\n")
    print("elements   half contact length [m]   w0 [m]        error of w0   error / h^2 [1/m^2]")
    for elements in (30, 60, 120, 240):
        beam, scene = build(elements)
        outcome = vf.equilibrium(scene)
        contact = sum(length for length, c in zip(shares(beam), outcome.contacts.values(), strict=True) if c.closed)
        w0 = -outcome.displacement(beam.at(LENGTH / 2))
        rows.append((elements, 0.5 * contact, w0))
        error = w0 / exact - 1.0
        h = LENGTH / elements
        print(f"{elements:8d}   {0.5 * contact:23.6f}   {w0:.9f}   {error:11.1e}   {error / h**2:19.1e}")
    print("(how fast the error falls depends on where the edge of contact lies between two nodes)")
    x = np.linspace(0.0, LENGTH, 25)
    beside = ("closed form", x, closed_form(x))
    return shapes(outcome, None, output / "foundation-lift-off.png", scene=scene, beside=beside), rows


def shares(beam: vf.Beam) -> np.ndarray:
    """Return the length of beam that each node stands for, m."""
    h = beam.element_lengths
    return 0.5 * (np.append(h, 0.0) + np.insert(h, 0, 0.0))


def main(output: Path) -> tuple[list[tuple[int, float, float]], vf.Result]:
    """Run, print and draw."""
    output.mkdir(parents=True, exist_ok=True)
    path, rows = static(output)
    pressed = vf.equilibrium(build(40, weight=0.05)[1])
    _, scene = build(40, weight=0.05, pressed=False)
    result = vf.simulate(vf.Scene(scene.bodies, scene.effects, initial=pressed), t_end=10.0)
    first = min((c.openings[0], name) for name, c in result.contacts.items() if c.openings.size)
    print(f"\nlet go: {result.counters.events} events, {result.counters.statuses} statuses in 10 s, ", end="")
    print(f"first opening of {first[1]} at {first[0]:.6f} s, energy balance {result.energy.balance_error:.1e}")
    print(f"\nwrote {path}\n      {space_time(result, output / 'foundation-let-go.png')}")
    return rows, result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("output"), help="folder for the figures")
    main(parser.parse_args().output)
