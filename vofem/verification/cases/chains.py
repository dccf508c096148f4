"""Cases of chains of masses that stand for a bar."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from vofem.bodies import Mass
from vofem.effects import Contact, Gravity, Spring
from vofem.scene import Scene
from vofem.verification.case import Case, Run, absolute, case, exact, stepping


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
    how = exact(5e-5) | stepping(1e-4, 5e-5)
    if stiffness > 100.0:
        told: Any = {"expected": "reported", "says": "stiffer than"}
        how = exact(1e-2, **told) | stepping(1e-5, 1e-2, **told, slow=True)
    name = f"bar of {count} masses on a stop of {stiffness:g} N/m"
    right = {"largest error of the force [N]": absolute(0.0)}

    @case(15, name, "closed form, Z v (1 - exp(-K0 t/Z))", right, how)
    def measured(run: Run) -> Iterable[float]:
        masses, springs = chain(count, 1.0, 1.0, 1.0)
        stop = Contact(masses[0], gap=0.0, stiffness=stiffness, side="below", acts_on="penetration", name="stop")
        scene = Scene(masses, [*springs, stop], initial={m: (0.0, -1.0) for m in masses})
        force = run.simulate(scene, 1.95, times=times).contacts["stop"].force
        return [np.max(np.abs(force - (1.0 - np.exp(-stiffness * times))))]

    return measured


def _bounce(count: int, error: float) -> Case:
    length, modulus, g, height = 10.0, 900.0, 10.0, 5.0
    thirds = {"first impact [s]": 3, "first release [s]": 5, "second impact [s]": 11, "second release [s]": 13}
    right = {name: absolute(k / 3.0) for name, k in thirds.items()}
    how = exact(error) | stepping(1e-4, error, slow=count > 100)

    @case(16, f"bouncing bar of {count} masses", _DOYEN, right, how)
    def measured(run: Run) -> Iterable[float]:
        masses, springs = chain(count, length, modulus, 1.0)
        # The stop is as stiff as the springs of the bar: the end would chatter on a stiffer stop.
        law: Any = {"gap": height, "stiffness": modulus * count / length, "acts_on": "penetration"}
        stop = Contact(masses[0], side="below", name="stop", **law)
        contact = run.simulate(Scene(masses, [*springs, stop, Gravity(g)]), 4.6).contacts["stop"]
        closings, openings = contact.closings, contact.openings
        # Grazing contacts of the end just after an impact count as part of it.
        return closings[0], openings[openings < 3.0][-1], closings[closings > 3.0][0], openings[-1]

    return measured
