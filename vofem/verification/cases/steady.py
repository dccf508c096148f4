"""Cases of steady states: special points of branches, a springpot's resonance, nonlinear normal modes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from vofem.bodies import Mass
from vofem.effects import Contact, Dashpot, PointLoad, Sine, Spring, Springpot
from vofem.scene import Scene
from vofem.studies.steady import backbone
from vofem.verification.case import HARMONIC_BALANCE, SHOOTING, Case, How, Run, absolute, case, on_stop


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield from (_bilinear_branch, _two_masses_branch, _two_masses_orbit, _springpot, _two_mode_backbones)


_INDEPENDENT = "independent program: matrix exponentials between events, shooting, special points refined to 1e-11"

#: State of the orbit at 0.635 rad/s where the cosine of the load is 1: q1, q2, v1, v2.
_ORBIT = (0.9613616024620069, 0.6578832109672325, 0.3167908536144315, 0.08600155491013046)


def bilinear(omega: float) -> Scene:
    """Return a mass that touches a stop without a gap, under a sine of 1 N."""
    mass = Mass(1.0, stiffness=1.0, damping=0.1, name="mass")
    return on_stop(mass, 0.0, 8.0, None, PointLoad(mass, Sine(1.0, omega)))


_BILINEAR = {"doubling": 2.338157973248634, "lower doubling": 1.003873309250901, "grazing": 0.7555856254177264}


@case(
    None, "branch of a mass at a stop without gap", "independent programs, one of them in 40-digit arithmetic",
    {f"{name} [rad/s]": value for name, value in _BILINEAR.items()}, {SHOOTING: How(1e-11)},
)  # fmt: skip
def _bilinear_branch(run: Run) -> Iterable[float]:
    special = run.continuation(bilinear, 2.5, 0.75).special
    lower, upper = sorted(point.value for point in special if point.kind == "period_doubling")[-2:]
    return upper, lower, next(point.value for point in special if point.kind == "grazing")


def two_masses(omega: float) -> Scene:
    """Return the scene of NLvib's example 03."""
    first, second = Mass(1.0, name="first"), Mass(1.0, stiffness=1.0, damping=0.03, name="second")
    stop = Contact(first, gap=1.0, stiffness=100.0, side="above", acts_on="penetration", name="stop")
    load = PointLoad(second, Sine(0.1, omega, phase=0.5 * np.pi))
    return Scene(
        [first, second], [Spring(first, second, stiffness=1.0), Dashpot(first, second, damping=0.03), stop, load]
    )


_NLVIB = "NLvib, example 03 (M. Krack, J. Gross, Harmonic Balance, Springer 2019); " + _INDEPENDENT


_TWO_MASSES = {
    "upper grazing": ("grazing", 0.6534401404162605),
    "fold": ("fold", 0.755627352609),
    "doubling": ("period_doubling", 0.755586159356),
    "lower grazing": ("grazing", 0.5818996390393119),
}


@case(
    None, "response curve of two masses before a stop", _NLVIB,
    {f"{name} [rad/s]": value for name, (_, value) in _TWO_MASSES.items()}, {SHOOTING: How(2e-12)},
)  # fmt: skip
def _two_masses_branch(run: Run) -> Iterable[float]:
    special = run.continuation(two_masses, 0.8, 0.5).special
    for kind, value in _TWO_MASSES.values():
        near = np.array([point.value for point in special if point.kind == kind])
        yield near[np.argmin(np.abs(near - value))]


@case(
    None, "steady state of two masses before a stop", _NLVIB,
    dict(zip(("q1 [m]", "q2 [m]", "v1 [m/s]", "v2 [m/s]"), map(absolute, _ORBIT), strict=True)),
    {SHOOTING: How(1e-10), HARMONIC_BALANCE: How(2e-4, {"harmonics": 60})},
)  # fmt: skip
def _two_masses_orbit(run: Run) -> Iterable[float]:
    scene, start = two_masses(0.635), np.zeros(1)
    result = run.periodic(scene).result
    return [motion(body, start)[0] for motion in (result.displacement, result.velocity) for body in scene.bodies]


#: Stiffness, damping, coefficient and order of an oscillator with a springpot; frequencies in rad/s.
_STIFFNESS, _DAMPING, _COEFFICIENT, _ORDER, _OMEGAS = 1.0, 0.02, 0.3, 0.5, (0.5, 1.1, 3.0)


def _amplitude(omega: float) -> float:
    impedance = _STIFFNESS - omega**2 + 1j * omega * _DAMPING + _COEFFICIENT * (1j * omega) ** _ORDER
    return float(abs(1.0 / impedance))


@case(
    None, "steady state of an oscillator with a springpot", "closed form",
    {f"amplitude at {omega:g} rad/s [m]": _amplitude(omega) for omega in _OMEGAS},
    {HARMONIC_BALANCE: How(1e-12, {"harmonics": 3})},
)  # fmt: skip
def _springpot(run: Run) -> Iterable[float]:
    for omega in _OMEGAS:
        mass = Mass(1.0, stiffness=_STIFFNESS, damping=_DAMPING, name="mass")
        pot = Springpot(mass, coefficient=_COEFFICIENT, order=_ORDER, name="springpot")
        yield run.periodic(Scene([mass], [pot, PointLoad(mass, Sine(1.0, omega))])).amplitude(mass)


@case(
    None, "nonlinear normal modes at a stop without gap",
    "closed form for one mass, " + _INDEPENDENT + " for two",
    # Of one mass 2 w1 w2/(w1 + w2) of the frequencies 1 and 3.
    {"mode 1 [rad/s]": 1.2188014992545873, "mode 2 [rad/s]": 1.9431067213088353, "one mass [rad/s]": 1.5},
    {SHOOTING: How(1e-10)},
)  # fmt: skip
def _two_mode_backbones(run: Run) -> Iterable[float]:
    """Measure frequencies of masses without a gap at the stop, which do not depend on energy."""
    left, right = Mass(1.0, stiffness=1.0, name="left"), Mass(1.0, stiffness=1.0, name="right")
    stop = Contact(right, gap=0.0, stiffness=5.0, side="above", acts_on="penetration", name="stop")
    scene = Scene([left, right], [Spring(left, right, stiffness=1.0), stop])
    alone = on_stop(Mass(1.0, stiffness=1.0, name="mass"), 0.0, 8.0)
    return [backbone(one, mode, [1.0]).omega[0] for one, mode in ((scene, 1), (scene, 2), (alone, 1))]
