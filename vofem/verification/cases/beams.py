"""Cases of beams: contacts along them, equilibrium, graded and fine meshes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Literal

import numpy as np

from vofem.bodies import Beam
from vofem.effects import Contact, DistributedLoad, Foundation, Gravity, PointLoad, Sine
from vofem.scene import Scene
from vofem.verification import case as by
from vofem.verification.case import Case, How, Quantity, Run, absolute, case, exact, stepping
from vofem.vibration import modes


def cases() -> Iterator[Case]:
    """Yield the cases."""
    for kappa, root in ((1.0, 2.0100033224), (1e3, 3.8978008052)):
        yield _tip_spring(kappa, root)
    for stiffness in (1e4, 1e8, 1e12):
        yield _stiff_stop(stiffness)
    how = exact(1e-11) | {method: How(1e-4, {"dt": 1e-3}) for method in (by.CONSERVING, by.ALPHA)}
    how[by.CENTRAL] = How(0.0, {"dt": 1e-3}, "refused", r"beyond the critical step 5\.34\de-05 s")
    yield _tip("the paper's step of 1e-3 s on its beam", "penetration", how)
    laws: tuple[tuple[Law, float], ...] = (("penetration", 1e-6), ("displacement", 3e-4))
    for acts_on, tolerance in laws:
        how = exact(1e-11) | stepping(4e-5, tolerance, slow=acts_on == "displacement")
        yield _tip(f"the paper's beam, acts_on={acts_on!r}, small steps", acts_on, how)
    yield _many_stops()
    for elements, tolerance in ((60, 3e-2), (240, 3e-3)):
        yield _lift_off(elements, tolerance)
    yield from (_loose, _rests_on_contacts)
    for ratio in (1e2, 1e4, 1e6):
        yield _graded(ratio)
    for elements in (800, 10_000, 100_000):
        yield _fine(elements)


# -- Hard cases of beams: 14, 17, 18 and 28

Law = Literal["displacement", "penetration"]


def paper_beam(acts_on: Law, stiffness: float = 1.0, elements: int = 25) -> tuple[Beam, Scene]:
    """Return the paper's cantilever (section 4.2) with its stop below the tip."""
    beam = Beam(1.0, 1.0, 1.0, elements, {"left": "clamped"})
    stop = Contact(beam.at(1.0), gap=0.03, stiffness=stiffness, side="below", acts_on=acts_on, name="stop")
    return beam, Scene([beam], [stop, PointLoad(beam.at(1.0), Sine(0.1, 1.0))])


def _tip_spring(kappa: float, root: float) -> Case:
    name = f"beam on a closed tip contact, kappa = {kappa:g}"
    source = "b^3 (1 + cos b cosh b) + kappa (sin b cosh b - cos b sinh b) = 0"

    @case(14, name, source, {"root b1": root}, {"modes": How(4e-7)})
    def measured(run: Run) -> Iterable[float]:
        return [np.sqrt(modes(paper_beam("displacement", kappa)[1], 1, closed=("stop",)).omega[0])]

    return measured


def _stiff_stop(stiffness: float) -> Case:
    # Energy bounds the penetration: K0 s^2/2 is at most some 1e-2 J.
    deepest = absolute(0.0, float(np.sqrt(0.02 / stiffness)))
    # At 1e12 N/m a penetration of the size of rounding already holds 1e-9 of the energy.
    how = exact(1e-9 if stiffness < 1e10 else 1e-7)
    how[by.CONSERVING] = How(1e-9, {"dt": 1e-3})
    how[by.ALPHA] = How(1e-2, {"dt": 1e-3}, "reported", "energy: ")
    how[by.CENTRAL] = How(1e-2, {"dt": 5e-5})
    if stiffness > 3e6:
        how[by.CENTRAL] = How(0.0, {"dt": 5e-5}, "refused", "critical step")
    name = f"stop of {stiffness:g} N/m on the 25-element beam"

    @case(17, name, "balance of energy", {"energy balance": absolute(0.0), "largest penetration [m]": deepest}, how)
    def measured(run: Run) -> Iterable[float]:
        beam, scene = paper_beam("penetration", stiffness)
        result = run.simulate(scene, 20.0, times=np.linspace(0.0, 20.0, 2001))
        return result.energy.balance_error, max(0.0, -0.03 - result.displacement(beam.at(1.0)).min())

    return measured


#: Multi-precision histories by an independent program.
_TIPS = {
    "penetration": (-0.024552024433279536, -0.010349018522161624, 0.027849807814162252),
    "displacement": (-0.029689094860905523, -0.01633856310461327, 0.02273413112725796),
}


def _tip(name: str, acts_on: Law, how: Mapping[str, How]) -> Case:
    right = {f"tip at {t} s [m]": value for t, value in zip((5, 10, 20), _TIPS[acts_on], strict=True)}

    @case(18, name, "independent program in multi-precision arithmetic", right, how)
    def measured(run: Run) -> Iterable[float]:
        beam, scene = paper_beam(acts_on)
        return run.simulate(scene, 20.0, times=[0.0, 5.0, 10.0, 20.0]).displacement(beam.at(1.0))[1:]

    return measured


def _many_stops(count: int = 25) -> Case:
    gaps = 0.002 * np.abs(np.sin(7.0 * np.arange(1, count + 1)))
    how = {"equilibrium": How(1e-10)} | exact(1e-9)
    how[by.CONSERVING] = How(1e-9, {"dt": 1e-4})
    how[by.ALPHA] = How(1e-2, {"dt": 1e-4}, "reported", "energy: ")
    how[by.CENTRAL] = How(1e-2, {"dt": 1e-5}, "reported", "energy: ")
    right = {"residual of contact": absolute(0.0), "energy balance": absolute(0.0)}

    @case(28, f"{count} stops along one beam", "complementarity", right, how)
    def measured(run: Run) -> Iterable[float]:
        beam = Beam(1.0, 1.0, 1.0, count, {"left": "clamped"})
        stops: list[Any] = [
            Contact(beam.at(x), gap=gap, stiffness=1e4, side="below", acts_on="penetration")
            for x, gap in zip(beam.nodes[1:], gaps, strict=True)
        ]
        scene, balance, found = Scene([beam], [*stops, Gravity(20.0)]), 0.0, None
        if run.method == "equilibrium":
            found = run.equilibrium(scene).contacts.values()
        else:
            result = run.simulate(scene, 1.0, times=np.linspace(0.0, 1.0, 201))
            found, balance = result.contacts.values(), result.energy.balance_error
        wrong = max(np.max(np.abs(c.force - 1e4 * np.maximum(c.gap_function, 0.0))) for c in found)
        return wrong / max(np.max(c.force) for c in found), balance

    return measured


# -- Hard cases of equilibrium: 13 and 21


def _lift_off(elements: int, tolerance: float) -> Case:
    length, k, load = 12.0, 4.0, 1.0
    wave = (k / 4.0) ** 0.25
    deepest = load * wave / (2.0 * k) / np.tanh(np.pi / 2.0)
    right = {
        "half length of contact [m]": absolute(np.pi / (2.0 * wave), length / elements),
        "depth w0 [m]": Quantity("", deepest, tolerance=tolerance),
        # Any value from 0 to 10 is right.
        "iterations": absolute(5.0, 5.0),
    }

    @case(13, f"lift-off from a foundation, {elements} elements", "closed form", right, {"equilibrium": How()})
    def measured(run: Run) -> Iterable[float]:
        beam = Beam(length, 1.0, 1.0, elements)
        bed = Foundation(beam, stiffness=k, one_sided=True, name="bed")
        rest = run.equilibrium(Scene([beam], [bed, PointLoad(beam.at(length / 2), -load)]))
        h = beam.element_lengths
        shares = 0.5 * (np.append(h, 0.0) + np.insert(h, 0, 0.0))
        held = sum(share for share, c in zip(shares, rest.contacts.values(), strict=True) if c.closed)
        return 0.5 * held, -rest.displacement(beam.at(length / 2)), rest.iterations

    return measured


@case(
    21, "free beam under a uniform load", "closed form", {"rise in 1 s [m]": 0.5},
    {"equilibrium": How(0.0, expected="refused", says="'plank' can move freely")}
    | exact(1e-11) | stepping(2e-4, 1e-9),
)  # fmt: skip
def _loose(run: Run) -> Iterable[float]:
    beam = Beam(1.0, 1.0, 1.0, 10, name="plank")
    scene = Scene([beam], [DistributedLoad(beam, 1.0, 1.0)])
    if run.method == "equilibrium":
        return [run.equilibrium(scene).displacement(beam.at(0.3))]
    return run.simulate(scene, 1.0).displacement(beam.at(0.3))[-1:]


@case(
    21, "free beam that rests on contacts alone", "closed form", {"force on the left [N]": 3.0},
    {"equilibrium": How(1e-11)} | exact(1e-9) | stepping(1e-3, 1e-8),
)  # fmt: skip
def _rests_on_contacts(run: Run) -> Iterable[float]:
    beam = Beam(2.0, 1.0, 3.0, 10)
    stops: list[Any] = [
        Contact(beam.at(x), gap=0.0, stiffness=50.0, side="below", acts_on="penetration", name=name)
        for x, name in ((0.0, "left"), (2.0, "right"))
    ]
    rest = run.equilibrium(Scene([beam], [*stops, Gravity(1.0)]))
    if run.method == "equilibrium":
        return [rest.contacts["left"].force]
    scene = Scene([beam], [*stops, Gravity(1.0)], initial=rest)
    force = run.simulate(scene, 1.0).contacts["left"].force
    return [force[np.argmax(np.abs(force - 3.0))]]


# -- Hard cases of meshes: 19 graded, 20 fine. The beam starts in equilibrium under a tip load, where it should stay


def _held_tip(number: int, name: str, elements: Any, how: Mapping[str, How]) -> Case:
    @case(number, name, "closed form", {"tip [m]": 1.0}, how)
    def measured(run: Run) -> Iterable[float]:
        beam = Beam(1.0, 1.0, 1.0, elements, {"left": "clamped"})
        load = PointLoad(beam.at(1.0), 3.0)
        if run.method == "equilibrium":
            return [run.equilibrium(Scene([beam], [load])).displacement(beam.at(1.0))]
        scene = Scene([beam], [load], initial={beam: (lambda x: 0.5 * (3.0 * x**2 - x**3), 0.0)})
        tip = run.simulate(scene, 1.0, times=np.linspace(0.0, 1.0, 11)).displacement(beam.at(1.0))
        return [tip[np.argmax(np.abs(tip - 1.0))]]

    return measured


def _graded(ratio: float) -> Case:
    lengths = np.geomspace(1.0, 1.0 / ratio, 13)
    nodes = np.concatenate([[0.0], np.cumsum(lengths) / np.sum(lengths)])
    nodes[-1] = 1.0
    how = {"equilibrium": How(1e-9)} | exact(1e-6)
    how |= {m: How(1e-6, {"dt": 1e-3}, "reported", "rounding") for m in (by.CONSERVING, by.ALPHA)}
    if ratio > 1e5:
        how |= exact(0.0, expected="refused", says="rounding")
        how |= {m: How(0.0, {"dt": 1e-3}, "stopped", "rounding") for m in (by.CONSERVING, by.ALPHA)}
    how[by.CENTRAL] = How(0.0, {"dt": 1e-3}, "refused", "critical step")
    return _held_tip(19, f"graded mesh, elements 1 : {ratio:g}", nodes, how)


def _fine(elements: int) -> Case:
    slow = elements > 1000
    how = {"equilibrium": How(1e-9, slow=slow)} | exact(1e-6, slow=slow)
    how |= {m: How(1e-6, {"dt": 1e-3}, "reported", "rounding", slow=slow) for m in (by.CONSERVING, by.ALPHA)}
    how[by.CENTRAL] = How(0.0, {"dt": 1e-3}, "refused", "critical step", slow=slow)
    if elements > 50_000:
        how |= {m: How(0.0, {"dt": 1e-3}, "stopped", "rounding", slow=slow) for m in (by.CONSERVING, by.ALPHA)}
    return _held_tip(20, f"fine mesh, {elements} elements", elements, how)
