"""Hard cases of meshes: 19 graded, 20 fine. The beam starts in equilibrium under a tip load, where it should stay."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from vofem.bodies import Beam
from vofem.effects import PointLoad
from vofem.scene import Scene
from vofem.verification.case import (
    ALPHA,
    CENTRAL,
    CONSERVING,
    REFUSED,
    REPORTED,
    STOPPED,
    Case,
    How,
    Quantity,
    Run,
    exact,
)


def cases() -> Iterator[Case]:
    """Yield the cases."""
    for ratio in (1e2, 1e4, 1e6):
        yield _graded(ratio)
    for elements in (800, 10_000, 100_000):
        yield _fine(elements)


def _tip(run: Run, elements: Any, t_end: float) -> Mapping[str, float]:
    beam = Beam(1.0, 1.0, 1.0, elements, {"left": "clamped"})
    load = PointLoad(beam.at(1.0), 3.0)
    if run.method == "equilibrium":
        return {"tip [m]": run.equilibrium(Scene([beam], [load])).displacement(beam.at(1.0))}
    start = {beam: (lambda x: 0.5 * (3.0 * x**2 - x**3), 0.0)}
    tip = run.simulate(Scene([beam], [load], initial=start), t_end, times=np.linspace(0.0, t_end, 11)).displacement(
        beam.at(1.0)
    )
    return {"tip [m]": float(tip[np.argmax(np.abs(tip - 1.0))])}


def _graded(ratio: float) -> Case:
    lengths = np.geomspace(1.0, 1.0 / ratio, 13)
    nodes = np.concatenate([[0.0], np.cumsum(lengths) / np.sum(lengths)])
    nodes[-1] = 1.0
    how = {"equilibrium": How(1e-9)} | exact(1e-6)
    how |= {m: How(1e-6, {"dt": 1e-3}, REPORTED, "rounding") for m in (CONSERVING, ALPHA)}
    if ratio > 1e5:
        how |= exact(0.0, expected=REFUSED, says="rounding")
        how |= {m: How(0.0, {"dt": 1e-3}, STOPPED, "rounding") for m in (CONSERVING, ALPHA)}
    how[CENTRAL] = How(0.0, {"dt": 1e-3}, REFUSED, "critical step")
    name = f"graded mesh, elements 1 : {ratio:g}"
    return Case(19, name, "closed form", (Quantity("tip [m]", 1.0),), lambda run: _tip(run, nodes, 1.0), how)


def _fine(elements: int) -> Case:
    slow = elements > 1000
    how = {"equilibrium": How(1e-9, slow=slow)} | exact(1e-6, slow=slow)
    how |= {m: How(1e-6, {"dt": 1e-3}, REPORTED, "rounding", slow=slow) for m in (CONSERVING, ALPHA)}
    how[CENTRAL] = How(0.0, {"dt": 1e-3}, REFUSED, "critical step", slow=slow)
    if elements > 50_000:
        how |= {m: How(0.0, {"dt": 1e-3}, STOPPED, "rounding", slow=slow) for m in (CONSERVING, ALPHA)}
    name = f"fine mesh, {elements} elements"
    return Case(20, name, "closed form", (Quantity("tip [m]", 1.0),), lambda run: _tip(run, elements, 1.0), how)
