"""Compiles all kernels ahead of use, by short runs of small scenes that need them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise

import numpy as np

from vofem.bodies import Beam, Mass
from vofem.effects import (
    BilinearSpring,
    Contact,
    CrushingStop,
    Dashpot,
    HystereticSpring,
    LinearSoftening,
    NonlinearSpring,
    PointLoad,
    Ramp,
    RayleighDamping,
    Resolved,
    Sine,
    Springpot,
)
from vofem.integrators.event_driven.along import Course
from vofem.integrators.methods import ENERGY_CONSERVING, EVENT_DRIVEN
from vofem.kernels.cache import keep_kind
from vofem.kernels.mode import kernels
from vofem.scene import Scene
from vofem.simulate.simulation import simulate
from vofem.statics import equilibrium, quasi_static
from vofem.system import OPEN, Counters


def _exact(*more: object) -> Scene:
    """Return a scene for event_driven: contacts that push, pin and meet at once."""
    beam = Beam(1.0, 1.0, 1.0, 4, {"left": "clamped"})
    mass, other = Mass(1.0, stiffness=3.0), Mass(0.5)
    tip = beam.at(1.0)
    effects = [
        Contact(tip, gap=0.03, stiffness=1.0, side="below", acts_on="displacement"),
        Contact(beam.at(0.4), mass, gap=0.01, stiffness=50.0, acts_on="penetration"),
        Contact(mass, other, gap=0.02, stiffness=20.0, acts_on="penetration"),
        PointLoad(tip, Sine(0.1, 1.0)),
        PointLoad(other, Ramp(0.1, 0.0, 2.0)),
    ]
    return Scene([beam, mass, other], [*effects, *more], initial={mass: (0.0, 0.1), other: (0.0, -0.2)})


def _damped() -> Scene:
    """Return a scene for event_driven with damping that couples the modes, equal decays and contact dampers."""
    one, two, three = (Mass(1.0, stiffness=k, damping=2.0) for k in (1.0, 1.0, 4.0))
    stop = Contact(one, gap=0.01, stiffness=5.0, damping=0.5, side="above", acts_on="penetration")
    effects = [stop, Dashpot(one, two, damping=0.5), Dashpot(two, three, damping=1.0), PointLoad(one, Sine(1.0, 2.0))]
    return Scene([one, two, three], effects, initial={one: (0.0, 1.0)})


def _several() -> Scene:
    """Return a mass between two stops."""
    mass = Mass(1.0, stiffness=1.0)
    stops = [Contact(mass, gap=0.1, stiffness=5.0, side=side, acts_on="penetration") for side in ("above", "below")]
    return Scene([mass], [*stops, PointLoad(mass, Sine(0.4, 2.0))], initial={mass: (0.0, 0.5)})


def _every_law() -> Scene:
    """Return a scene for methods that step in time, with every law."""
    beam = Beam(1.0, 1.0, 1.0, 3, {"left": "clamped"})
    mass = Mass(0.3, stiffness=2.0, damping=0.05)
    tip, middle = beam.at(1.0), beam.at(0.5)
    effects = [
        Contact(tip, mass, gap=0.02, stiffness=5.0, damping=0.1, acts_on="penetration"),
        Contact(tip, gap=0.03, stiffness=4.0, side="above", acts_on="displacement"),
        Contact(middle, gap=0.01, stiffness=9.0, side="above", acts_on="penetration", switch=Resolved(1e-3)),
        NonlinearSpring(tip, force=lambda u: 2.0 * u**3, potential=lambda u: 0.5 * u**4),
        BilinearSpring(middle, stiffness=3.0, linear_limit=0.005, hardening=0.5),
        HystereticSpring(tip, stiffness=1.0, linear_limit=0.01, softening=LinearSoftening(5.0), memory="cyclic"),
        CrushingStop(mass, gap=0.05, stiffness=3.0, linear_limit=0.05, side="above"),
        Springpot(mass, coefficient=0.2, order=0.4),
        RayleighDamping(0.05, 1e-3),
        PointLoad(tip, Sine(0.4, 2.0)),
    ]
    return Scene([beam, mass], effects, initial={mass: (0.0, 0.5)})


def _chain() -> Scene:
    """Return masses with as many contacts as unknowns, whose steps are solved on the unknowns themselves."""
    masses = [Mass(1.0, stiffness=1.0) for _ in range(24)]
    effects = [Contact(a, b, gap=0.01, stiffness=10.0, acts_on="penetration") for a, b in pairwise(masses)]
    return Scene(masses, effects, initial={masses[0]: (0.0, 1.0)})


#: Scenes for methods that step in time, by what `simulate.plan.kind_of_run` says of their laws.
STEPPED: dict[str, Callable[[], Scene]] = {
    "steps, laws": _several,
    "steps, many laws": _chain,
    "steps, laws, springpots": _every_law,
}


def _events() -> None:
    result = simulate(_exact(), 4.0, times=np.linspace(0.0, 4.0, 41))
    result.energy.balance_error, result.sensitivity  # noqa: B018
    # A mass on a plane under its weight: resonance and rigid motion.
    free = Mass(1.0)
    stop = Contact(free, gap=0.1, stiffness=9.0, side="above", acts_on="penetration")
    simulate(Scene([free], [stop, PointLoad(free, 1.0)]), 4.0)


def _damped_events() -> None:
    simulate(_damped(), 1.5, times=np.linspace(0.0, 1.5, 16)).energy.balance_error  # noqa: B018
    simulate(_exact(RayleighDamping(0.1, 1e-3)), 1.0, times=np.linspace(0.0, 1.0, 11)).energy.balance_error  # noqa: B018


def _steps(laws: str) -> None:
    """Run what needs all kernels of methods that step in time, whatever the method."""
    simulate(STEPPED[laws](), 0.04, method=ENERGY_CONSERVING.name, tol=1e-2)


def _orbits() -> None:
    """Follow segments between switches, as steady states do, and look for extremes in them."""
    system = _several().model.system
    course = Course(system, 4.0, Counters())
    whole, n = np.eye(2 * course.space.size), len(course.space.contacts)
    path = course.along(0.0, whole[0], [np.full(n, OPEN)], np.array([4.0]), whole, np.zeros((1, len(whole))))
    path.sampled(course.space.contacts, np.array([0]), np.array([8]))


def _statics() -> None:
    beam = Beam(1.0, 1.0, 1.0, 4, {"left": "clamped"})
    tip = beam.at(1.0)
    spring = HystereticSpring(tip, stiffness=1.0, linear_limit=0.01, softening=LinearSoftening(5.0), memory="cyclic")
    stop = Contact(beam.at(0.5), gap=0.03, stiffness=1.0, side="below", acts_on="displacement")
    quasi_static(Scene([beam], [stop, spring, PointLoad(tip, -0.3)]), [1.0, -1.0, 0.5])
    many = Beam(1.0, 1.0, 1.0, 250, {"left": "clamped"})
    equilibrium(Scene([many], [PointLoad(many.at(1.0), 1.0)]))


#: What is compiled, in the order of use.
_WORK: tuple[tuple[str, Callable[[], None]], ...] = (
    (EVENT_DRIVEN.name, _events),
    (f"{EVENT_DRIVEN.name}, damped", _damped_events),
    *((laws, partial(_steps, laws)) for laws in STEPPED),
    ("steady states", _orbits),
    ("statics", _statics),
)

#: Kinds of work that have kernels, by the names that the index on disk knows.
KINDS = tuple(kind for kind, _ in _WORK)


def compile_ahead() -> Iterator[tuple[str, float]]:
    """Compile the kernels of all methods, or find them on disk; yield the kind and the seconds of each.

    The machine code goes where `vofem.kernels.cache.cache_folder` says.
    """
    for kind, work in _WORK:
        begun = time.perf_counter()
        with kernels(compiled=True):
            work()
        keep_kind(kind)
        yield kind, time.perf_counter() - begun
