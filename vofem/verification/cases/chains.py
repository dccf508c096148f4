"""Cases of chains of masses that stand for a bar."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from vofem.bodies import Mass
from vofem.effects import Contact, Gravity, Spring
from vofem.scene import Scene
from vofem.verification.case import Case, Quantity, Run, exact, stepping


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _impact(5.0)
    yield _impact(1e4)
    for count, error in ((100, 4e-2), (400, 1.2e-2)):
        yield _bounce(count, error)


_DOYEN = "Doyen, Ern, Piperno, SIAM J. Sci. Comput. 33 (2011) 223, doi:10.1137/100791440"


def chain(count: int, length: float, stiffness: float, mass: float) -> tuple[list[Mass], list[Spring]]:
    """Return the masses and springs of a bar of axial stiffness EA (N) and mass per length (kg/m)."""
    h = length / count
    masses = [Mass(mass * h * (0.5 if i in (0, count) else 1.0), name=f"m{i}") for i in range(count + 1)]
    return masses, [Spring(masses[i], masses[i + 1], stiffness=stiffness / h) for i in range(count)]


def _impact(stiffness: float, count: int = 400) -> Case:
    times = np.linspace(0.02, 1.9, 189)

    def measure(run: Run) -> Mapping[str, float]:
        masses, springs = chain(count, 1.0, 1.0, 1.0)
        stop = Contact(masses[0], gap=0.0, stiffness=stiffness, side="below", acts_on="penetration", name="stop")
        scene = Scene(masses, [*springs, stop], initial={m: (0.0, -1.0) for m in masses})
        force = run.simulate(scene, 1.95, times=times).contacts["stop"].force
        return {"largest error of the force [N]": float(np.max(np.abs(force - (1.0 - np.exp(-stiffness * times)))))}

    quantities = (Quantity("largest error of the force [N]", 0.0, relative=False),)
    name = f"bar of {count} masses on a stop of {stiffness:g} N/m"
    if stiffness < 100.0:
        how = exact(5e-5) | stepping(1e-4, 5e-5)
    else:
        told: Any = {"expected": "reported", "says": "stiffer than"}
        how = exact(1e-2, **told) | stepping(1e-5, 1e-2, **told, slow=True)
    return Case(15, name, "closed form, Z v (1 - exp(-K0 t/Z))", quantities, measure, how)


def _bounce(count: int, error: float) -> Case:
    length, modulus, g, height = 10.0, 900.0, 10.0, 5.0

    def measure(run: Run) -> Mapping[str, float]:
        masses, springs = chain(count, length, modulus, 1.0)
        # The stop is as stiff as the springs of the bar: the end would chatter on a stiffer stop.
        stiffness = modulus * count / length
        stop = Contact(masses[0], gap=height, stiffness=stiffness, side="below", acts_on="penetration", name="stop")
        contact = run.simulate(Scene(masses, [*springs, stop, Gravity(g)]), 4.6).contacts["stop"]
        # Grazing contacts of the end just after an impact count as part of it.
        second = contact.closings[contact.closings > 3.0][0]
        return {
            "first impact [s]": float(contact.closings[0]),
            "first release [s]": float(contact.openings[contact.openings < 3.0][-1]),
            "second impact [s]": float(second),
            "second release [s]": float(contact.openings[-1]),
        }

    quantities = (
        Quantity("first impact [s]", 1.0, relative=False),
        Quantity("first release [s]", 5.0 / 3.0, relative=False),
        Quantity("second impact [s]", 11.0 / 3.0, relative=False),
        Quantity("second release [s]", 13.0 / 3.0, relative=False),
    )
    how = exact(error) | stepping(1e-4, error, slow=count > 100)
    return Case(16, f"bouncing bar of {count} masses", _DOYEN, quantities, measure, how)
