"""Shapes of the paper's beam before and in contact (section 4.2), beside its integer-order model.

The integer-order model is the same cantilever written as an if-else over two sets of matrices and stepped by
Eq. 21, in numpy alone. Run it with ``python examples/beam_shapes.py --output output``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import vofem as vf
from vofem.io.plot import shapes

ELEMENTS, GAP, K0, TIMES, DT = 25, 0.1, 1.0, (0.75, 2.99), 5e-5


def vo_model(acts_on: str, method: str = "event_driven", dt: float | None = None) -> vf.Result:
    """Return the beam's run under one force law, with the contact stiffness as an operator of variable order."""
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=ELEMENTS, supports={"left": "clamped"}, name="beam")
    stop = vf.Contact(beam.at(1.0), gap=GAP, stiffness=K0, side="below", acts_on=acts_on, name="stop")
    scene = vf.Scene([beam], [stop, vf.PointLoad(beam.at(1.0), vf.Sine(amplitude=1.0, omega=4.0))])
    return vf.simulate(scene, TIMES[-1], method=method, dt=dt, times=TIMES)


def cantilever(elements: int) -> tuple[np.ndarray, np.ndarray]:
    """Return M and K of Eq. 19, clamped at the left, with slopes positive upward."""
    h = 1.0 / elements
    mass = np.array([[156, 22 * h, 54, -13 * h], [0, 4 * h**2, 13 * h, -3 * h**2], [0, 0, 156, -22 * h]])
    stiffness = np.array([[6, 3 * h, -6, 3 * h], [0, 2 * h**2, -3 * h, h**2], [0, 0, 6, -3 * h]])
    M, K = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    for e in range(elements):
        for whole, upper, last, factor in ((M, mass, 4, h / 420), (K, stiffness, 2, 2 / h**3)):
            full = np.vstack([upper, [0, 0, 0, last * h**2]])
            whole[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += factor * (full + np.triu(full, 1).T)
    return M[2:, 2:], K[2:, 2:]


def integer_order_model(acts_on: str) -> np.ndarray:
    """Return the displacements of all nodes at TIMES, shape (ELEMENTS + 1, 2)."""
    M, K = cantilever(ELEMENTS)
    tip = np.zeros(len(M))
    tip[-2] = 1.0
    inverse = np.linalg.inv(M)
    opened, closed, unit = inverse @ K, inverse @ (K + K0 * np.outer(tip, tip)), inverse @ tip
    preload = K0 * GAP if acts_on == "penetration" else 0.0
    keep = [round(t / DT) for t in TIMES]
    eta, rate, kept = np.zeros(len(M)), np.zeros(len(M)), []
    for n in range(keep[-1] + 1):
        if n in keep:
            kept.append(np.append(0.0, eta[::2]))
        load = np.sin(4.0 * n * DT)
        matrix, force = (opened, load) if eta[-2] >= -GAP else (closed, load - preload)
        rate += (DT if n else 0.5 * DT) * (force * unit - matrix @ eta)
        eta += DT * rate
    return np.array(kept).T


def main(output: Path) -> dict[str, tuple[vf.Result, np.ndarray, np.ndarray]]:
    """Run, print and draw; return the exact run, and nodes by Eq. 21 with variable and with integer order."""
    nodes = np.linspace(0.0, 1.0, ELEMENTS + 1)
    runs = {}
    print("acts_on        t [s]   contact   tip [m]        largest |VO - integer order| [m]: both by Eq. 21   VO exact")
    for acts_on in ("displacement", "penetration"):
        exact, stepped = vo_model(acts_on), vo_model(acts_on, "central_difference", DT)
        same, plain = stepped.deflection(nodes, TIMES), integer_order_model(acts_on)
        runs[acts_on] = exact, same, plain
        for k, t in enumerate(TIMES):
            tip = exact.deflection([1.0], [t])[0, 0]
            status = "closed" if tip < -GAP else "open"
            errors = [np.abs(eta[:, k] - plain[:, k]).max() for eta in (same, exact.deflection(nodes, TIMES))]
            print(f"{acts_on:12s}   {t:5.2f}   {status:7s}   {tip:12.9f}   {errors[0]:46.1e}   {errors[1]:8.1e}")
    output.mkdir(parents=True, exist_ok=True)
    drawn = {f"acts on {acts_on}": exact for acts_on, (exact, _, _) in runs.items()}
    beside = {f"acts on {acts_on}": ("integer-order model", nodes, plain) for acts_on, (_, _, plain) in runs.items()}
    print(f"\nwrote {shapes(drawn, TIMES, output / 'beam-shapes.png', beside=beside)}")
    return runs


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("output"), help="folder for the figures")
    main(parser.parse_args().output)
