"""Cases of steady states: special points of branches, a springpot's resonance, nonlinear normal modes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from vofem.bodies import Mass
from vofem.effects import Contact, Dashpot, PointLoad, Sine, Spring, Springpot
from vofem.scene import Scene
from vofem.studies.steady import backbone
from vofem.verification.case import HARMONIC_BALANCE, SHOOTING, Case, How, Quantity, Run, on_stop


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _bilinear_branch()
    yield _two_masses_branch()
    yield _two_masses_orbit()
    yield _springpot()
    yield _two_mode_backbones()


_INDEPENDENT = "independent program: matrix exponentials between events, shooting, special points refined to 1e-11"

#: State of the orbit at 0.635 rad/s where the cosine of the load is 1: q1, q2, v1, v2.
_ORBIT = (0.9613616024620069, 0.6578832109672325, 0.3167908536144315, 0.08600155491013046)


def bilinear(omega: float) -> Scene:
    """Return a mass that touches a stop without a gap, under a sine of 1 N."""
    mass = Mass(1.0, stiffness=1.0, damping=0.1, name="mass")
    return on_stop(mass, 0.0, 8.0, None, PointLoad(mass, Sine(1.0, omega)))


def _bilinear_branch() -> Case:
    known = {"doubling": 2.338157973248634, "lower doubling": 1.003873309250901, "grazing": 0.7555856254177264}

    def measure(run: Run) -> Mapping[str, float]:
        branch = run.continuation(bilinear, 2.5, 0.75)
        doublings = [point.value for point in branch.special if point.kind == "period_doubling"]
        grazing = next(point.value for point in branch.special if point.kind == "grazing")
        found = {"doubling": max(doublings), "lower doubling": sorted(doublings)[-2], "grazing": grazing}
        return {f"{name} [rad/s]": value for name, value in found.items()}

    quantities = tuple(Quantity(f"{name} [rad/s]", value) for name, value in known.items())
    source = "independent programs, one of them in 40-digit arithmetic"
    return Case(None, "branch of a mass at a stop without gap", source, quantities, measure, {SHOOTING: How(1e-11)})


def two_masses(omega: float) -> Scene:
    """Return the scene of NLvib's example 03."""
    first, second = Mass(1.0, name="first"), Mass(1.0, stiffness=1.0, damping=0.03, name="second")
    stop = Contact(first, gap=1.0, stiffness=100.0, side="above", acts_on="penetration", name="stop")
    load = PointLoad(second, Sine(0.1, omega, phase=0.5 * np.pi))
    return Scene(
        [first, second], [Spring(first, second, stiffness=1.0), Dashpot(first, second, damping=0.03), stop, load]
    )


_NLVIB = "NLvib, example 03 (M. Krack, J. Gross, Harmonic Balance, Springer 2019); " + _INDEPENDENT


def _two_masses_branch() -> Case:
    known = {
        "upper grazing": ("grazing", 0.6534401404162605),
        "fold": ("fold", 0.755627352609),
        "doubling": ("period_doubling", 0.755586159356),
        "lower grazing": ("grazing", 0.5818996390393119),
    }

    def measure(run: Run) -> Mapping[str, float]:
        branch = run.continuation(two_masses, 0.8, 0.5)
        found = {}
        for name, (kind, value) in known.items():
            near = [point.value for point in branch.special if point.kind == kind]
            found[f"{name} [rad/s]"] = min(near, key=lambda one, value=value: abs(one - value))  # type: ignore[misc]
        return found

    quantities = tuple(Quantity(f"{name} [rad/s]", value) for name, (_, value) in known.items())
    return Case(None, "response curve of two masses before a stop", _NLVIB, quantities, measure, {SHOOTING: How(2e-12)})


def _two_masses_orbit() -> Case:
    names = ("q1 [m]", "q2 [m]", "v1 [m/s]", "v2 [m/s]")

    def measure(run: Run) -> Mapping[str, float]:
        scene = two_masses(0.635)
        result = run.periodic(scene).result
        start = np.zeros(1)
        values = [result.displacement(body, start)[0] for body in scene.bodies]
        values += [result.velocity(body, start)[0] for body in scene.bodies]
        return dict(zip(names, map(float, values), strict=True))

    quantities = tuple(Quantity(name, value, relative=False) for name, value in zip(names, _ORBIT, strict=True))
    how = {SHOOTING: How(1e-10), HARMONIC_BALANCE: How(2e-4, {"harmonics": 60})}
    return Case(None, "steady state of two masses before a stop", _NLVIB, quantities, measure, how)


def _springpot() -> Case:
    stiffness, damping, coefficient, order = 1.0, 0.02, 0.3, 0.5

    def amplitude(omega: float) -> float:
        impedance = stiffness - omega**2 + 1j * omega * damping + coefficient * (1j * omega) ** order
        return float(abs(1.0 / impedance))

    def measure(run: Run) -> Mapping[str, float]:
        found = {}
        for omega in (0.5, 1.1, 3.0):
            mass = Mass(1.0, stiffness=stiffness, damping=damping, name="mass")
            pot = Springpot(mass, coefficient=coefficient, order=order, name="springpot")
            orbit = run.periodic(Scene([mass], [pot, PointLoad(mass, Sine(1.0, omega))]))
            found[f"amplitude at {omega:g} rad/s [m]"] = orbit.amplitude(mass)
        return found

    quantities = tuple(Quantity(f"amplitude at {omega:g} rad/s [m]", amplitude(omega)) for omega in (0.5, 1.1, 3.0))
    how = {HARMONIC_BALANCE: How(1e-12, {"harmonics": 3})}
    return Case(None, "steady state of an oscillator with a springpot", "closed form", quantities, measure, how)


def _two_mode_backbones() -> Case:
    """Two masses without a gap at the stop, whose frequencies do not depend on energy; one mass in closed form."""
    known = {1: 1.2188014992545873, 2: 1.9431067213088353}

    def measure(run: Run) -> Mapping[str, float]:
        left, right = Mass(1.0, stiffness=1.0, name="left"), Mass(1.0, stiffness=1.0, name="right")
        stop = Contact(right, gap=0.0, stiffness=5.0, side="above", acts_on="penetration", name="stop")
        scene = Scene([left, right], [Spring(left, right, stiffness=1.0), stop])
        found = {f"mode {mode} [rad/s]": float(backbone(scene, mode, [1.0]).omega[0]) for mode in known}
        alone = on_stop(Mass(1.0, stiffness=1.0, name="mass"), 0.0, 8.0)
        return found | {"one mass [rad/s]": float(backbone(alone, 1, [1.0]).omega[0])}

    quantities = tuple(Quantity(f"mode {mode} [rad/s]", value) for mode, value in known.items())
    # 2 w1 w2/(w1 + w2) of the frequencies 1 and 3.
    quantities += (Quantity("one mass [rad/s]", 1.5),)
    source = "closed form for one mass, " + _INDEPENDENT + " for two"
    return Case(
        None, "nonlinear normal modes at a stop without gap", source, quantities, measure, {SHOOTING: How(1e-10)}
    )
