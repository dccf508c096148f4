"""Hard cases of few masses that meet each other: 4, 5, 11, 12 and 22."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Literal

import numpy as np

from vofem.bodies import Mass
from vofem.effects import Contact, PointLoad, Sine, Spring
from vofem.scene import Scene
from vofem.verification.case import (
    ALPHA,
    CENTRAL,
    CONSERVING,
    REFUSED,
    Case,
    How,
    Quantity,
    Run,
    exact,
    stepping,
)

Law = Literal["displacement", "penetration"]

INDEPENDENT = "independent program"


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _paper(4, "b", "penetration", 12.328983786650, 14.115411317495)
    yield _paper(5, "c", "penetration", 1.878224203370, 3.456593873995)
    yield _paper(5, "c", "displacement", 1.878224203370, 2.610164648343)
    yield _order()
    yield _cradle()
    yield _preload()
    for ratio in (1e-6, 1e-12, 1e-30):
        yield _light_joint(ratio)


def paper_masses(loads: str, acts_on: Law) -> tuple[Mass, Mass, Scene]:
    """Return the paper's two masses (section 4.1) under the loads of case b or c."""
    first = Mass(1.0, stiffness=1.0, damping=0.1, name="first")
    second = Mass(1.0, stiffness=1.0, damping=0.4, name="second")
    contact = Contact(first, second, gap=5.0, stiffness=2.0, acts_on=acts_on, name="contact")
    forces = [PointLoad(first, Sine(-10.0, 0.3))]
    if loads == "c":
        forces = [PointLoad(first, Sine(5.0, 0.8)), PointLoad(second, Sine(-5.0, 0.8))]
    return first, second, Scene([first, second], [contact, *forces], initial={first: (0.0, -1.0)})


def _paper(number: int, loads: str, acts_on: Law, closing: float, opening: float) -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        contact = run.simulate(paper_masses(loads, acts_on)[2], 20.0).contacts["contact"]
        return {"first closing [s]": float(contact.closings[0]), "first opening [s]": float(contact.openings[0])}

    quantities = (Quantity("first closing [s]", closing), Quantity("first opening [s]", opening))
    tolerance = 1e-6 if acts_on == "penetration" else 1e-3
    name = f"two masses, loads {loads}, acts_on={acts_on!r}"
    return Case(number, name, INDEPENDENT, quantities, measure, exact(1e-12) | stepping(1e-3, tolerance))


def _order() -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        ends = []
        dt = run.options["dt"]
        for step in (dt, 0.5 * dt, 0.25 * dt):
            first, _, scene = paper_masses("c", "penetration")
            ends.append(run.simulate(scene, 20.0, dt=step, times=np.linspace(0.0, 20.0, 21)).displacement(first))
        coarse, fine = (float(np.linalg.norm(a - b)) for a, b in pairwise(ends))
        return {"observed order": float(np.log2(coarse / fine))}

    quantities = (Quantity("observed order", 2.0, relative=False),)
    return Case(5, "two masses, order of steps", "theory", quantities, measure, stepping(1e-3, 0.5))


def _cradle(count: int = 5, gap: float = 0.01, stiffness: float = 1e6) -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        masses = [Mass(1.0) for _ in range(count)]
        contacts = [
            Contact(a, b, gap=gap, stiffness=stiffness, acts_on="penetration", name=f"c{i}")
            for i, (a, b) in enumerate(pairwise(masses))
        ]
        result = run.simulate(Scene(masses, contacts, initial={masses[0]: (0.0, 1.0)}), 0.1)
        return {
            "last mass leaves at [s]": float(result.contacts[f"c{count - 2}"].openings[0]),
            "its speed [m/s]": float(result.velocity(masses[-1])[-1]),
        }

    w = np.sqrt(2.0 * stiffness)
    # Each contact lasts pi/w. In this time the struck mass already moves v pi/(2 w) into the next gap.
    leaves = gap + np.pi / w + (count - 2) * (gap + 0.5 * np.pi / w)
    quantities = (Quantity("last mass leaves at [s]", leaves), Quantity("its speed [m/s]", 1.0))
    how = exact(1e-10) | stepping(1e-6, 1e-6)
    return Case(11, f"Newton's cradle of {count} masses", "closed form", quantities, measure, how)


def _preload() -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        first, second = Mass(1.0, stiffness=1.0), Mass(1.0, stiffness=1.0)
        contact = Contact(first, second, gap=0.0, stiffness=2.0, acts_on="penetration")
        effects = [contact, PointLoad(first, 3.0)]
        rest = run.equilibrium(Scene([first, second], effects))
        if run.method == "equilibrium":
            return {"first [m]": rest.displacement(first), "second [m]": rest.displacement(second)}
        start = {first: (1.8, 0.0), second: (1.2, 0.0)}
        result = run.simulate(Scene([first, second], effects, initial=start), 10.0)
        return {
            "first [m]": float(result.displacement(first)[-1]),
            "second [m]": float(result.displacement(second)[-1]),
        }

    how = {"equilibrium": How(1e-15)} | exact(1e-14) | stepping(1e-2, 1e-14)
    quantities = (Quantity("first [m]", 1.8), Quantity("second [m]", 1.2))
    return Case(12, "preload across a gap of zero", "closed form", quantities, measure, how)


def _light_joint(ratio: float) -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        heavy, light = Mass(1.0, name="heavy"), Mass(ratio, stiffness=3.0, name="light")
        start = {heavy: (1.0, 0.0), light: (1.0 / 3.0, 0.0)}
        scene = Scene([heavy, light], [Spring(heavy, light, stiffness=1.5)], initial=start)
        result = run.simulate(scene, 1.0, times=[0.0, 1.0])
        return {"displacement of the heavy mass at 1 s [m]": float(result.displacement(heavy)[-1])}

    how = exact(ratio + 1e-14)
    how |= {method: How(ratio + 2e-7, {"dt": 1e-3}) for method in (CONSERVING, ALPHA)}
    how[CENTRAL] = How(0.0, {}, REFUSED, "critical step") if ratio < 1e-20 else How(ratio + 2e-7, {}, slow=ratio < 1e-9)
    if ratio == 1e-12:
        how[CENTRAL] = How(0.0, {"dt": 1e-3}, REFUSED, "critical step")
    quantities = (Quantity("displacement of the heavy mass at 1 s [m]", float(np.cos(1.0))),)
    return Case(22, f"a joint of {ratio:g} of the mass", "closed form, springs in series", quantities, measure, how)
