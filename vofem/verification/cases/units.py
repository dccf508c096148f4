"""Hard case 24: the same scene in other units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from vofem.bodies import Mass
from vofem.effects import Contact, PointLoad, Sine
from vofem.integrators.registry import method_named
from vofem.scene import Scene
from vofem.verification.case import DYNAMIC, EVENT_DRIVEN, Case, How, Quantity, Run


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _scaled("by even powers of two", 4.0**5, 4.0**-3, 4.0**2, 0.0, 0.0)
    yield _scaled("by 1e9 and 1e-9", 1e9, 1e-9, 1e-3, 1e-10, 1e-10)


def _masses(length: float, mass: float, time: float) -> tuple[Mass, Scene]:
    stiffness, force = mass / time**2, mass * length / time**2
    first = Mass(mass, stiffness=stiffness, damping=0.1 * mass / time)
    second = Mass(mass, stiffness=stiffness, damping=0.4 * mass / time)
    contact = Contact(first, second, gap=5.0 * length, stiffness=2.0 * stiffness, acts_on="penetration")
    loads = [PointLoad(m, Sine(a * force, 0.8 / time)) for m, a in ((first, 5.0), (second, -5.0))]
    return first, Scene([first, second], [contact, *loads], initial={first: (0.0, -length / time)})


def _scaled(name: str, length: float, mass: float, time: float, exact: float, steps: float) -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        histories = []
        for a, b, c in ((1.0, 1.0, 1.0), (length, mass, time)):
            first, scene = _masses(a, b, c)
            more = {"dt": 2.0**-7 * c} if method_named(run.method).steps else {}
            result = run.simulate(scene, 20.0 * c, times=np.linspace(0.0, 20.0, 641) * c, **more)
            histories.append(result.displacement(first) / a)
        size = np.max(np.abs(histories[0]))
        return {"largest difference": float(np.max(np.abs(histories[1] - histories[0])) / size)}

    quantities = (Quantity("largest difference", 0.0, relative=False),)
    how = {method: How(exact if method == EVENT_DRIVEN else steps) for method in DYNAMIC}
    return Case(24, f"units scaled {name}", "the scene in SI units", quantities, measure, how)
