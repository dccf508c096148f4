"""Hard cases of free masses that meet a stop: 3 and 6."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from vofem.bodies import Mass
from vofem.effects import Contact
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
    stepping,
)

CLOSED_FORM = "closed form"


def cases() -> Iterator[Case]:
    """Yield the cases."""
    for zeta in (0.01, 0.1, 0.5):
        yield _restitution(zeta)
    for phase in (0.1, 1.0, 10.0, 1e3):
        yield _rebound(phase)


def _restitution(zeta: float) -> Case:
    stiffness = 1e4

    def measure(run: Run) -> Mapping[str, float]:
        mass = Mass(1.0)
        stop = Contact(
            mass, gap=0.1, stiffness=stiffness, damping=2.0 * zeta * np.sqrt(stiffness), side="below",
            acts_on="penetration", name="stop",
        )  # fmt: skip
        result = run.simulate(Scene([mass], [stop], initial={mass: (0.0, -1.0)}), 0.5)
        contact = result.contacts["stop"]
        return {
            "restitution": float(result.velocity(mass)[-1]),
            "dissipated [J]": float(result.energy.dissipated[-1]),
            "closes at [s]": float(contact.closings[0]),
            "openings": contact.openings.size,
        }

    e = np.exp(-np.pi * zeta / np.sqrt(1.0 - zeta**2))
    quantities = (
        Quantity("restitution", e),
        Quantity("dissipated [J]", 0.5 * (1.0 - e**2)),
        Quantity("closes at [s]", 0.1),
        Quantity("openings", 1.0),
    )
    how = exact(1e-11) | stepping(1e-5, 2e-6)
    # The damper's force jumps at closing, and central differences notice it one step late.
    how[CENTRAL] = How(1e-3, {"dt": 1e-5})
    return Case(3, f"damped stop, zeta = {zeta:g}", CLOSED_FORM, quantities, measure, how)


def _rebound(phase: float, entries: int = 40) -> Case:
    omega = 1e4
    dt = phase / omega

    def measure(run: Run) -> Mapping[str, float]:
        speeds = []
        for entry in np.arange(entries) / entries:
            mass = Mass(1.0)
            stop = Contact(mass, gap=0.0, stiffness=omega**2, side="above", acts_on="penetration", name="stop")
            scene = Scene([mass], [stop], initial={mass: (-(3.0 + entry) * dt, 1.0)})
            t_end = 12.0 * dt + 2.0 * np.pi / omega
            speeds.append(-float(run.simulate(scene, t_end).velocity(mass)[-1]))
        return {"speed out, the worst of all [m/s]": max(speeds, key=lambda v: abs(v - 1.0))}

    how = exact(1e-12) | {CONSERVING: How(1e-10, {"dt": dt})}
    reported = How(0.01, {"dt": dt}, REPORTED, "energy: ")
    how[ALPHA] = reported if phase < 5.0 else How(0.01, {"dt": dt}, STOPPED, "blew up")
    how[CENTRAL] = reported if phase < 2.0 else How(0.01, {"dt": dt}, REFUSED, "critical step")
    quantities = (Quantity("speed out, the worst of all [m/s]", 1.0),)
    name = f"rebound of a free mass, {entries} entries, omega dt = {phase:g}"
    return Case(6, name, CLOSED_FORM, quantities, measure, how)
