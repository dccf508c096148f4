"""Hard cases with events that accumulate in time or are easily missed: 8, 9 and 10."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from vofem.bodies import Mass
from vofem.effects import Contact, Gravity, PointLoad
from vofem.scene import Scene
from vofem.verification.case import ALPHA, CENTRAL, CONSERVING, REPORTED, Case, How, Quantity, Run, exact, stepping

INDEPENDENT = "independent program"


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _chatter()
    for zeta, impacts in ((0.05, 39), (0.1, 20), (0.3, 7)):
        yield _nearly_zeno(zeta, impacts)
    for depth in (1e-6, 1e-9, 1e-12):
        yield _grazing(depth)


def _chatter() -> Case:
    counts = {50.0: 63, 100.0: 208, 150.0: 541, 200.0: 1307, 250.0: 3068}

    def measure(run: Run) -> Mapping[str, float]:
        mass = Mass(1.0, damping=0.05)
        stop = Contact(mass, gap=1.0, stiffness=1.0, side="above", acts_on="displacement", name="stop")
        scene = Scene([mass], [stop, PointLoad(mass, 0.4)], initial={mass: (1.0, 0.3)})
        result = run.simulate(scene, 250.0)
        events = result.solution.events.time
        found = {f"events by {t:g} s": float(np.sum(events <= t)) for t in counts}
        late = result.displacement(mass)[result.times >= 225.0]
        return found | {"distance from the gap after 225 s [m]": float(np.max(np.abs(late - 1.0)))}

    quantities = (
        *(Quantity(f"events by {t:g} s", float(count)) for t, count in counts.items()),
        Quantity("distance from the gap after 225 s [m]", 0.0, relative=False),
    )
    counted = {q.name: 0.0 for q in quantities[:-1]}
    near = quantities[-1].name
    how = exact(counted | {near: 1e-4}) | stepping(1e-3, {near: 3e-3}, says="chatter")
    return Case(8, "chatter of the displacement law", INDEPENDENT, quantities, measure, how)


def _nearly_zeno(zeta: float, impacts: int) -> Case:
    omega = 1e4
    e = np.exp(-np.pi * zeta / np.sqrt(1.0 - zeta**2))
    rest = 2.0 * e / (10.0 * (1.0 - e))

    def measure(run: Run) -> Mapping[str, float]:
        mass = Mass(1.0)
        stop = Contact(
            mass, gap=0.0, stiffness=omega**2, damping=2.0 * zeta * omega, side="below", acts_on="penetration",
            name="stop",
        )  # fmt: skip
        scene = Scene([mass], [stop, Gravity(10.0)], initial={mass: (0.0, -1.0)})
        t_end = 1.1 * rest + 0.02
        result = run.simulate(scene, t_end, times=[0.0, t_end])
        closings = result.contacts["stop"].closings
        return {"impacts": float(closings.size), "final position [m]": float(result.displacement(mass)[-1])}

    quantities = (Quantity("impacts", float(impacts)), Quantity("final position [m]", -10.0 / omega**2))
    how = exact({"impacts": 0.0, "final position [m]": 1e-6})
    how |= stepping(1e-6, {"impacts": 0.0, "final position [m]": 1e-6}, slow=zeta < 0.2)
    return Case(9, f"nearly Zeno, zeta = {zeta:g}", INDEPENDENT, quantities, measure, how)


def _grazing(depth: float) -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        mass = Mass(1.0, stiffness=1.0)
        stop = Contact(mass, gap=1.0 - depth, stiffness=1e-9, side="above", acts_on="penetration", name="stop")
        result = run.simulate(Scene([mass], [stop], initial={mass: (0.0, 1.0)}), 20.0 * np.pi)
        return {"crossings": float(result.counters.events)}

    how = exact(0.0)
    for method in (CONSERVING, ALPHA, CENTRAL):
        # Numerical dissipation would take the motion out of the stop's reach.
        more = {"rho_infinity": 1.0} if method == ALPHA else {}
        how[method] = (
            How(0.0, {"dt": 1e-3, **more}, REPORTED, "passed over") if depth < 1e-7 else How(0.0, {"dt": 1e-3, **more})
        )
    quantities = (Quantity("crossings", 20.0),)
    name = f"grazing by {depth:g} m, ten periods"
    return Case(10, name, "closed form", quantities, measure, how)
