"""Hard cases of beams: 14, 17, 18 and 28."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal

import numpy as np

from vofem.bodies import Beam
from vofem.effects import Contact, Gravity, PointLoad, Sine
from vofem.scene import Scene
from vofem.verification.case import (
    ALPHA,
    CENTRAL,
    CONSERVING,
    REFUSED,
    REPORTED,
    Case,
    How,
    Quantity,
    Run,
    exact,
    stepping,
)

Law = Literal["displacement", "penetration"]

INDEPENDENT = "independent program in multi-precision arithmetic"


def cases() -> Iterator[Case]:
    """Yield the cases."""
    for kappa, root in ((1.0, 2.0100033224), (1e3, 3.8978008052)):
        yield _tip_spring(kappa, root)
    for stiffness in (1e4, 1e8, 1e12):
        yield _stiff_stop(stiffness)
    yield _paper_step()
    yield from _paper_tip()
    yield _many_stops()


def paper_beam(acts_on: Law, stiffness: float = 1.0, elements: int = 25) -> tuple[Beam, Scene]:
    """Return the paper's cantilever (section 4.2) with its stop below the tip."""
    beam = Beam(1.0, 1.0, 1.0, elements, {"left": "clamped"})
    stop = Contact(beam.at(1.0), gap=0.03, stiffness=stiffness, side="below", acts_on=acts_on, name="stop")
    return beam, Scene([beam], [stop, PointLoad(beam.at(1.0), Sine(0.1, 1.0))])


def _tip_spring(kappa: float, root: float) -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        _, scene = paper_beam("displacement", kappa)
        return {"root b1": float(np.sqrt(run.modes(scene, 1, ("stop",)).omega[0]))}

    source = "b^3 (1 + cos b cosh b) + kappa (sin b cosh b - cos b sinh b) = 0"
    name = f"beam on a closed tip contact, kappa = {kappa:g}"
    return Case(14, name, source, (Quantity("root b1", root),), measure, {"modes": How(4e-7)})


def _stiff_stop(stiffness: float) -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        beam, scene = paper_beam("penetration", stiffness)
        result = run.simulate(scene, 20.0, times=np.linspace(0.0, 20.0, 2001))
        tip = result.displacement(beam.at(1.0))
        return {
            "energy balance": result.energy.balance_error,
            "largest penetration [m]": float(max(0.0, -0.03 - tip.min())),
        }

    quantities = (
        Quantity("energy balance", 0.0, relative=False),
        Quantity("largest penetration [m]", 0.0, relative=False),
    )
    # Energy bounds the penetration: K0 s^2/2 is at most some 1e-2 J.
    deep = {"largest penetration [m]": float(np.sqrt(0.02 / stiffness))}
    # At 1e12 N/m a penetration of the size of rounding already holds 1e-9 of the energy.
    how = exact({"energy balance": 1e-9 if stiffness < 1e10 else 1e-7} | deep)
    how[CONSERVING] = How({"energy balance": 1e-9} | deep, {"dt": 1e-3})
    how[ALPHA] = How({"energy balance": 1e-2} | deep, {"dt": 1e-3}, REPORTED, "energy: ")
    how[CENTRAL] = How({"energy balance": 1e-2} | deep, {"dt": 5e-5})
    if stiffness > 3e6:
        how[CENTRAL] = How(0.0, {"dt": 5e-5}, REFUSED, "critical step")
    return Case(17, f"stop of {stiffness:g} N/m on the 25-element beam", "balance of energy", quantities, measure, how)


def _tip(run: Run, acts_on: Law) -> Mapping[str, float]:
    beam, scene = paper_beam(acts_on)
    tip = run.simulate(scene, 20.0, times=[0.0, 5.0, 10.0, 20.0]).displacement(beam.at(1.0))
    return {f"tip at {t} s [m]": float(tip[k + 1]) for k, t in enumerate((5, 10, 20))}


#: Multi-precision histories by an independent program.
_TIPS = {
    "penetration": (-0.024552024433279536, -0.010349018522161624, 0.027849807814162252),
    "displacement": (-0.029689094860905523, -0.01633856310461327, 0.02273413112725796),
}


def _tip_quantities(acts_on: str) -> tuple[Quantity, ...]:
    return tuple(Quantity(f"tip at {t} s [m]", value) for t, value in zip((5, 10, 20), _TIPS[acts_on], strict=True))


def _paper_step() -> Case:
    how: dict[str, How] = exact(1e-11) | {method: How(1e-4, {"dt": 1e-3}) for method in (CONSERVING, ALPHA)}
    how[CENTRAL] = How(0.0, {"dt": 1e-3}, REFUSED, r"beyond the critical step 5\.34\de-05 s")
    return Case(
        18, "the paper's step of 1e-3 s on its beam", INDEPENDENT,
        _tip_quantities("penetration"), lambda run: _tip(run, "penetration"), how,
    )  # fmt: skip


def _paper_tip() -> Iterator[Case]:
    laws: tuple[tuple[Law, float], ...] = (("penetration", 1e-6), ("displacement", 3e-4))
    for acts_on, tolerance in laws:

        def measure(run: Run, acts_on: Law = acts_on) -> Mapping[str, float]:
            return _tip(run, acts_on)

        yield Case(
            18, f"the paper's beam, acts_on={acts_on!r}, small steps", INDEPENDENT,
            _tip_quantities(acts_on), measure, exact(1e-11) | stepping(4e-5, tolerance, slow=acts_on == "displacement"),
        )  # fmt: skip


def _many_stops(count: int = 25) -> Case:
    gaps = 0.002 * np.abs(np.sin(7.0 * np.arange(1, count + 1)))

    def measure(run: Run) -> Mapping[str, float]:
        beam = Beam(1.0, 1.0, 1.0, count, {"left": "clamped"})
        stops: list[Any] = [
            Contact(beam.at(x), gap=gap, stiffness=1e4, side="below", acts_on="penetration")
            for x, gap in zip(beam.nodes[1:], gaps, strict=True)
        ]
        scene = Scene([beam], [*stops, Gravity(20.0)])
        if run.method == "equilibrium":
            rest = run.equilibrium(scene)
            laws = rest.contacts.values()
            wrong = max(abs(c.force - 1e4 * max(c.gap_function, 0.0)) for c in laws)
            return {"residual of contact": wrong / max(c.force for c in laws), "energy balance": 0.0}
        result = run.simulate(scene, 1.0, times=np.linspace(0.0, 1.0, 201))
        wrong = max(
            float(np.max(np.abs(c.force - 1e4 * np.maximum(c.gap_function, 0.0)))) for c in result.contacts.values()
        )
        largest = max(float(np.max(c.force)) for c in result.contacts.values())
        return {"residual of contact": wrong / largest, "energy balance": result.energy.balance_error}

    quantities = (
        Quantity("residual of contact", 0.0, relative=False),
        Quantity("energy balance", 0.0, relative=False),
    )
    how = {"equilibrium": How(1e-10)} | exact(1e-9)
    how[CONSERVING] = How(1e-9, {"dt": 1e-4})
    how[ALPHA] = How(1e-2, {"dt": 1e-4}, REPORTED, "energy: ")
    how[CENTRAL] = How(1e-2, {"dt": 1e-5}, REPORTED, "energy: ")
    return Case(28, f"{count} stops along one beam", "complementarity", quantities, measure, how)
