"""Hard cases of equilibrium: 13 and 21."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from vofem.bodies import Beam
from vofem.effects import Contact, DistributedLoad, Foundation, Gravity, PointLoad
from vofem.scene import Scene
from vofem.verification.case import REFUSED, Case, How, Quantity, Run, exact, stepping


def cases() -> Iterator[Case]:
    """Yield the cases."""
    for elements, tolerance in ((60, 3e-2), (240, 3e-3)):
        yield _lift_off(elements, tolerance)
    yield _loose()
    yield _rests_on_contacts()


def _lift_off(elements: int, tolerance: float) -> Case:
    length, k, load = 12.0, 4.0, 1.0
    wave = (k / 4.0) ** 0.25

    def measure(run: Run) -> Mapping[str, float]:
        beam = Beam(length, 1.0, 1.0, elements)
        bed = Foundation(beam, stiffness=k, one_sided=True, name="bed")
        rest = run.equilibrium(Scene([beam], [bed, PointLoad(beam.at(length / 2), -load)]))
        h = beam.element_lengths
        shares = 0.5 * (np.append(h, 0.0) + np.insert(h, 0, 0.0))
        held = sum(share for share, c in zip(shares, rest.contacts.values(), strict=True) if c.closed)
        return {
            "half length of contact [m]": 0.5 * float(held),
            "depth w0 [m]": -rest.displacement(beam.at(length / 2)),
            "iterations": float(rest.iterations),
        }

    quantities = (
        Quantity("half length of contact [m]", np.pi / (2.0 * wave), relative=False),
        Quantity("depth w0 [m]", load * wave / (2.0 * k) / np.tanh(np.pi / 2.0)),
        # Any value from 0 to 10 is right.
        Quantity("iterations", 5.0, relative=False),
    )
    how = {
        "equilibrium": How(
            {"half length of contact [m]": length / elements, "depth w0 [m]": tolerance, "iterations": 5.0}
        )
    }
    return Case(13, f"lift-off from a foundation, {elements} elements", "closed form", quantities, measure, how)


def _loose() -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        beam = Beam(1.0, 1.0, 1.0, 10, name="plank")
        scene = Scene([beam], [DistributedLoad(beam, 1.0, 1.0)])
        if run.method == "equilibrium":
            return {"rise in 1 s [m]": run.equilibrium(scene).displacement(beam.at(0.3))}
        result = run.simulate(scene, 1.0)
        return {"rise in 1 s [m]": float(result.displacement(beam.at(0.3))[-1])}

    how = {"equilibrium": How(0.0, expected=REFUSED, says="'plank' can move freely")}
    how |= exact(1e-11) | stepping(2e-4, 1e-9)
    quantities = (Quantity("rise in 1 s [m]", 0.5),)
    return Case(21, "free beam under a uniform load", "closed form", quantities, measure, how)


def _rests_on_contacts() -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        beam = Beam(2.0, 1.0, 3.0, 10)
        stops: list[Any] = [
            Contact(beam.at(x), gap=0.0, stiffness=50.0, side="below", acts_on="penetration", name=name)
            for x, name in ((0.0, "left"), (2.0, "right"))
        ]
        scene = Scene([beam], [*stops, Gravity(1.0)])
        rest = run.equilibrium(scene)
        if run.method == "equilibrium":
            return {"force on the left [N]": rest.contacts["left"].force}
        result = run.simulate(Scene([beam], [*stops, Gravity(1.0)], initial=rest), 1.0)
        force = result.contacts["left"].force
        return {"force on the left [N]": float(force[np.argmax(np.abs(force - 3.0))])}

    how = {"equilibrium": How(1e-11)} | exact(1e-9) | stepping(1e-3, 1e-8)
    quantities = (Quantity("force on the left [N]", 3.0),)
    return Case(21, "free beam that rests on contacts alone", "closed form", quantities, measure, how)
