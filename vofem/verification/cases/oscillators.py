"""Hard cases of one degree of freedom on a stop that does not move: 1, 2, 7, 23, 26, 27 and 29."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

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
    yield _release()
    for energy, gap in ((1e-3, 0.01), (1.0, 0.01), (1.0, 0.0)):
        yield _bilinear(energy, gap)
    for phase in (0.05, 0.2, 1.0, 5.0):
        yield _long_time(phase)
    yield _rounding_of_steps()
    yield _underflow()
    yield from _gaps()
    yield _huge_step()


def release_on_a_stop() -> tuple[Mass, Scene]:
    """Return a mass released on an elastic stop, and its scene (code_aster SDND101)."""
    mass = Mass(100.0, stiffness=1e4)
    stop = Contact(mass, gap=0.0, stiffness=1e6, side="above", acts_on="penetration", name="stop")
    return mass, Scene([mass], [stop], initial={mass: (0.0, 1.0)})


def _release() -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        mass, scene = release_on_a_stop()
        result = run.simulate(scene, 0.1)
        duration = float(result.contacts["stop"].openings[0])
        nodes, weights = np.polynomial.legendre.leggauss(30)
        force = 1e6 * result.displacement(mass, t=0.5 * duration * (1.0 + nodes))
        return {
            "duration [s]": duration,
            "peak force [N]": 1e6 * float(result.displacement(mass, t=0.5 * duration)[0]),
            "impulse [N s]": 0.5 * duration * float(weights @ force),
        }

    w = np.sqrt(1.01e6 / 100.0)
    quantities = (
        Quantity("duration [s]", np.pi / w),
        Quantity("peak force [N]", 1e6 / w),
        Quantity("impulse [N s]", 2e6 / w**2),
    )
    how = exact(1e-12) | stepping(1e-5, 1e-6)
    return Case(1, "release on a stop", CLOSED_FORM, quantities, measure, how)


def bilinear_period(energy: float, gap: float, k: float = 10.0, k_stop: float = 50.0, m: float = 1.0) -> float:
    """Return the period in s of a mass on a spring with a one-sided stop."""
    w1, w2 = np.sqrt(k / m), np.sqrt((k + k_stop) / m)
    if gap == 0.0:
        return float(np.pi * (1.0 / w1 + 1.0 / w2))
    amplitude = np.sqrt(2.0 * energy / k)
    rest = k * gap / (k + k_stop)
    speed = np.sqrt((2.0 * energy - k * gap**2) / m)
    free = (2.0 / w1) * (0.5 * np.pi + np.arcsin(gap / amplitude))
    return float(free + (2.0 / w2) * (0.5 * np.pi - np.arctan(rest * w2 / speed)))


def bilinear(energy: float, gap: float) -> Scene:
    """Return the oscillator with its stop, started on the far side with an energy in J."""
    mass = Mass(1.0, stiffness=10.0)
    stop = Contact(mass, gap=gap, stiffness=50.0, side="above", acts_on="penetration", name="stop")
    return Scene([mass], [stop], initial={mass: (-np.sqrt(2.0 * energy / 10.0), 0.0)})


def _bilinear(energy: float, gap: float) -> Case:
    period = bilinear_period(energy, gap)

    def measure(run: Run) -> Mapping[str, float]:
        periods = np.diff(run.simulate(bilinear(energy, gap), 30.0).contacts["stop"].closings)
        return {"period, the worst of all [s]": float(periods[np.argmax(np.abs(periods - period))])}

    quantities = (Quantity("period, the worst of all [s]", period),)
    name = f"bilinear oscillator, E = {energy:g} J, gap {gap:g} m"
    return Case(2, name, CLOSED_FORM, quantities, measure, exact(1e-12) | stepping(1e-3, 3e-5))


def _long_time(phase: float, steps: int = 1_000_000) -> Case:
    k_stop = 1e4
    dt = phase / np.sqrt(1.0 + k_stop)

    def measure(run: Run) -> Mapping[str, float]:
        mass = Mass(1.0, stiffness=1.0)
        stop = Contact(mass, gap=0.1, stiffness=k_stop, side="above", acts_on="penetration", name="stop")
        scene = Scene([mass], [stop], initial={mass: (0.0, 1.0)})
        result = run.simulate(scene, steps * dt, times=np.linspace(0.0, steps * dt, 2001))
        return {"energy drift": result.energy.balance_error}

    slow = phase != 1.0
    how = exact(1e-9, slow=slow) | {CONSERVING: How(1e-10, {"dt": dt}, slow=slow)}
    how[CENTRAL] = (
        How(0.01, {"dt": dt}, REPORTED, "energy: ") if phase < 2.0 else How(0.0, {"dt": dt}, REFUSED, "critical step")
    )
    options = {"dt": dt, "rho_infinity": 1.0}
    how[ALPHA] = How(0.01, options, REPORTED, "energy: ") if phase < 0.5 else How(0.0, options, STOPPED, "blew up")
    quantities = (Quantity("energy drift", 0.0, relative=False),)
    return Case(7, f"long-time energy, 1e6 steps, omega dt = {phase:g}", CLOSED_FORM, quantities, measure, how)


def _rounding_of_steps(dt: float = 1e-5, steps: int = 1_000_000) -> Case:
    angles: dict[str, Callable[[], float]] = {
        # The result of the recurrences in exact arithmetic.
        CENTRAL: lambda: float(np.cos(steps * 2.0 * np.arcsin(0.5 * dt))),
        CONSERVING: lambda: float(np.cos(steps * 2.0 * np.arctan(0.5 * dt))),
        ALPHA: lambda: float(np.cos(steps * 2.0 * np.arctan(0.5 * dt))),
    }

    def measure(run: Run) -> Mapping[str, float]:
        mass = Mass(1.0, stiffness=1.0)
        result = run.simulate(Scene([mass], initial={mass: (1.0, 0.0)}), steps * dt, times=[0.0, steps * dt])
        expected = angles[run.method]() if run.method in angles else np.cos(steps * dt)
        return {"loss to rounding [m]": float(result.displacement(mass)[-1] - expected)}

    how = exact(1e-14) | stepping(dt, 1e-9)
    how[ALPHA] = How(1e-9, {"dt": dt, "rho_infinity": 1.0})
    source = "closed form of the recurrence in exact arithmetic"
    quantities = (Quantity("loss to rounding [m]", 0.0, relative=False),)
    return Case(23, "a million small steps, dt = 1e-5", source, quantities, measure, how)


def _underflow() -> Case:
    period = bilinear_period(1.0, 0.0)

    def measure(run: Run) -> Mapping[str, float]:
        mass = Mass(1.0, stiffness=10.0)
        stop = Contact(mass, gap=0.0, stiffness=50.0, side="above", acts_on="penetration", name="stop")
        closings = run.simulate(Scene([mass], [stop], initial={mass: (-1e-170, 0.0)}), 10.0).contacts["stop"].closings
        return {"closings": closings.size, "period [s]": float(np.diff(closings)[0]) if closings.size > 1 else np.nan}

    quantities = (Quantity("closings", 7.0), Quantity("period [s]", period))
    how = exact({"closings": 0.0, "period [s]": 1e-12}) | stepping(1e-3, {"closings": 0.0, "period [s]": 3e-5})
    return Case(26, "gaps of 1e-170 m, whose products underflow", CLOSED_FORM, quantities, measure, how)


def _gaps() -> Iterator[Case]:
    def preloaded(run: Run) -> Mapping[str, float]:
        mass = Mass(1.0, stiffness=10.0)
        stop = Contact(mass, gap=-0.1, stiffness=50.0, side="above", acts_on="penetration", name="stop")
        result = run.simulate(Scene([mass], [stop], initial={mass: (-0.07, 0.0)}), 3.0)
        contact = result.contacts["stop"]
        return {"displacement at 3 s [m]": float(result.displacement(mass)[-1]), "openings": contact.openings.size}

    rest = -50.0 * 0.1 / 60.0
    end = rest + (-0.07 - rest) * np.cos(3.0 * np.sqrt(60.0))
    quantities = (Quantity("displacement at 3 s [m]", end), Quantity("openings", 0.0, relative=False))
    names = [q.name for q in quantities]
    how = exact(dict(zip(names, (1e-13, 0.0), strict=True))) | stepping(
        1e-4, dict(zip(names, (3e-6, 0.0), strict=True))
    )
    yield Case(27, "negative gap: preloaded and never open", CLOSED_FORM, quantities, preloaded, how)

    for gap in (10.0, 1e50):

        def unreached(run: Run, gap: float = gap) -> Mapping[str, float]:
            ends = []
            for with_stop in (True, False):
                mass = Mass(1.0, stiffness=10.0)
                stop = Contact(mass, gap=gap, stiffness=50.0, side="above", acts_on="penetration", name="stop")
                scene = Scene([mass], [stop] if with_stop else [], initial={mass: (1.0, 0.0)})
                ends.append(run.simulate(scene, 20.0).displacement(mass))
            return {"difference to no contact [m]": float(np.max(np.abs(ends[0] - ends[1])))}

        only = (Quantity("difference to no contact [m]", 0.0, relative=False),)
        yield Case(
            27,
            f"a gap of {gap:g} m that is never reached",
            "bitwise",
            only,
            unreached,
            exact(0.0) | stepping(1e-2, 0.0),
        )


def _huge_step() -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        mass = Mass(1.0, stiffness=1e12)
        result = run.simulate(Scene([mass], initial={mass: (1.0, 1e6)}), 1000.0, times=np.linspace(0.0, 1000.0, 1001))
        return {"energy drift": result.energy.balance_error}

    how = exact(1e-9)
    how[CONSERVING] = How(1e-10, {"dt": 1.0}, says="do not resolve")
    how[ALPHA] = How(0.01, {"dt": 1.0}, REPORTED, "do not resolve")
    how[CENTRAL] = How(0.0, {"dt": 1.0}, REFUSED, "critical step")
    quantities = (Quantity("energy drift", 0.0, relative=False),)
    return Case(29, "huge steps, omega dt = 1e6", CLOSED_FORM, quantities, measure, how)
