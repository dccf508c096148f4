"""Hard case 25: a value that is not a number ends a run with an error that says where and when."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from vofem.bodies import Mass
from vofem.effects import Contact, PointLoad
from vofem.scene import Scene
from vofem.time_functions import Load
from vofem.verification.case import DYNAMIC, EVENT_DRIVEN, REFUSED, STOPPED, Case, How, Quantity, Run


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _load(np.nan)
    yield _load(np.inf)
    yield _state()


def _oscillator(velocity: float, load: Load) -> Scene:
    mass = Mass(1.0, stiffness=1.0, name="ball")
    stop = Contact(mass, gap=0.1, stiffness=10.0, side="above", acts_on="penetration")
    return Scene([mass], [stop, PointLoad(mass, load)], initial={mass: (0.0, velocity)})


def _load(value: float) -> Case:
    def function(t: float) -> float:
        return value if t > 1.0 else 0.1

    def measure(run: Run) -> Mapping[str, float]:
        run.simulate(_oscillator(0.0, function), 2.0)
        return {"none": 0.0}

    how = {method: How(0.0, expected=STOPPED, says=r"load function .* at t = 1\.00") for method in DYNAMIC[1:]}
    how[EVENT_DRIVEN] = How(0.0, expected=REFUSED, says="no closed form")
    name = f"a load that turns {value} at 1 s"
    return Case(25, name, "a typed error", (Quantity("none", 0.0, False),), measure, how)


def _state() -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        run.simulate(_oscillator(np.nan, 0.1), 2.0)
        return {"none": 0.0}

    how = {method: How(0.0, expected=REFUSED, says="initial velocity of Mass 'ball'") for method in DYNAMIC}
    return Case(
        25, "a start velocity that is not a number", "a typed error", (Quantity("none", 0.0, False),), measure, how
    )
