"""Cases of beams: contacts along them, equilibrium, graded and fine meshes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal

import numpy as np

from vofem.bodies import Beam
from vofem.effects import Contact, DistributedLoad, Foundation, Gravity, PointLoad, Sine
from vofem.scene import Scene
from vofem.verification.case import ALPHA, CENTRAL, CONSERVING, Case, How, Quantity, Run, exact, stepping
from vofem.vibration import modes


def cases() -> Iterator[Case]:
    """Yield the cases."""
    for kappa, root in ((1.0, 2.0100033224), (1e3, 3.8978008052)):
        yield _tip_spring(kappa, root)
    for stiffness in (1e4, 1e8, 1e12):
        yield _stiff_stop(stiffness)
    yield _paper_step()
    yield from _paper_tip()
    yield _many_stops()
    for elements, tolerance in ((60, 3e-2), (240, 3e-3)):
        yield _lift_off(elements, tolerance)
    yield _loose()
    yield _rests_on_contacts()
    for ratio in (1e2, 1e4, 1e6):
        yield _graded(ratio)
    for elements in (800, 10_000, 100_000):
        yield _fine(elements)


# -- Hard cases of beams: 14, 17, 18 and 28

Law = Literal["displacement", "penetration"]

_MULTI_PRECISION = "independent program in multi-precision arithmetic"


def paper_beam(acts_on: Law, stiffness: float = 1.0, elements: int = 25) -> tuple[Beam, Scene]:
    """Return the paper's cantilever (section 4.2) with its stop below the tip."""
    beam = Beam(1.0, 1.0, 1.0, elements, {"left": "clamped"})
    stop = Contact(beam.at(1.0), gap=0.03, stiffness=stiffness, side="below", acts_on=acts_on, name="stop")
    return beam, Scene([beam], [stop, PointLoad(beam.at(1.0), Sine(0.1, 1.0))])


def _tip_spring(kappa: float, root: float) -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        _, scene = paper_beam("displacement", kappa)
        return {"root b1": float(np.sqrt(modes(scene, 1, closed=("stop",)).omega[0]))}

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
        # Energy bounds the penetration: K0 s^2/2 is at most some 1e-2 J.
        Quantity("largest penetration [m]", 0.0, False, float(np.sqrt(0.02 / stiffness))),
    )
    # At 1e12 N/m a penetration of the size of rounding already holds 1e-9 of the energy.
    how = exact(1e-9 if stiffness < 1e10 else 1e-7)
    how[CONSERVING] = How(1e-9, {"dt": 1e-3})
    how[ALPHA] = How(1e-2, {"dt": 1e-3}, "reported", "energy: ")
    how[CENTRAL] = How(1e-2, {"dt": 5e-5})
    if stiffness > 3e6:
        how[CENTRAL] = How(0.0, {"dt": 5e-5}, "refused", "critical step")
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
    how[CENTRAL] = How(0.0, {"dt": 1e-3}, "refused", r"beyond the critical step 5\.34\de-05 s")
    return Case(
        18, "the paper's step of 1e-3 s on its beam", _MULTI_PRECISION,
        _tip_quantities("penetration"), lambda run: _tip(run, "penetration"), how,
    )  # fmt: skip


def _paper_tip() -> Iterator[Case]:
    laws: tuple[tuple[Law, float], ...] = (("penetration", 1e-6), ("displacement", 3e-4))
    for acts_on, tolerance in laws:

        def measure(run: Run, acts_on: Law = acts_on) -> Mapping[str, float]:
            return _tip(run, acts_on)

        yield Case(
            18, f"the paper's beam, acts_on={acts_on!r}, small steps", _MULTI_PRECISION,
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

    quantities = (Quantity("residual of contact", 0.0, relative=False), Quantity("energy balance", 0.0, relative=False))
    how = {"equilibrium": How(1e-10)} | exact(1e-9)
    how[CONSERVING] = How(1e-9, {"dt": 1e-4})
    how[ALPHA] = How(1e-2, {"dt": 1e-4}, "reported", "energy: ")
    how[CENTRAL] = How(1e-2, {"dt": 1e-5}, "reported", "energy: ")
    return Case(28, f"{count} stops along one beam", "complementarity", quantities, measure, how)


# -- Hard cases of equilibrium: 13 and 21


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
        Quantity("half length of contact [m]", np.pi / (2.0 * wave), False, length / elements),
        Quantity("depth w0 [m]", load * wave / (2.0 * k) / np.tanh(np.pi / 2.0), tolerance=tolerance),
        # Any value from 0 to 10 is right.
        Quantity("iterations", 5.0, False, 5.0),
    )
    how = {"equilibrium": How()}
    return Case(13, f"lift-off from a foundation, {elements} elements", "closed form", quantities, measure, how)


def _loose() -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        beam = Beam(1.0, 1.0, 1.0, 10, name="plank")
        scene = Scene([beam], [DistributedLoad(beam, 1.0, 1.0)])
        if run.method == "equilibrium":
            return {"rise in 1 s [m]": run.equilibrium(scene).displacement(beam.at(0.3))}
        result = run.simulate(scene, 1.0)
        return {"rise in 1 s [m]": float(result.displacement(beam.at(0.3))[-1])}

    how = {"equilibrium": How(0.0, expected="refused", says="'plank' can move freely")}
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


# -- Hard cases of meshes: 19 graded, 20 fine. The beam starts in equilibrium under a tip load, where it should stay


def _held_tip(run: Run, elements: Any, t_end: float) -> Mapping[str, float]:
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
    how |= {m: How(1e-6, {"dt": 1e-3}, "reported", "rounding") for m in (CONSERVING, ALPHA)}
    if ratio > 1e5:
        how |= exact(0.0, expected="refused", says="rounding")
        how |= {m: How(0.0, {"dt": 1e-3}, "stopped", "rounding") for m in (CONSERVING, ALPHA)}
    how[CENTRAL] = How(0.0, {"dt": 1e-3}, "refused", "critical step")
    name = f"graded mesh, elements 1 : {ratio:g}"
    return Case(19, name, "closed form", (Quantity("tip [m]", 1.0),), lambda run: _held_tip(run, nodes, 1.0), how)


def _fine(elements: int) -> Case:
    slow = elements > 1000
    how = {"equilibrium": How(1e-9, slow=slow)} | exact(1e-6, slow=slow)
    how |= {m: How(1e-6, {"dt": 1e-3}, "reported", "rounding", slow=slow) for m in (CONSERVING, ALPHA)}
    how[CENTRAL] = How(0.0, {"dt": 1e-3}, "refused", "critical step", slow=slow)
    if elements > 50_000:
        how |= {m: How(0.0, {"dt": 1e-3}, "stopped", "rounding", slow=slow) for m in (CONSERVING, ALPHA)}
    name = f"fine mesh, {elements} elements"
    return Case(20, name, "closed form", (Quantity("tip [m]", 1.0),), lambda run: _held_tip(run, elements, 1.0), how)
