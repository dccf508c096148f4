"""Cases of few masses: on a stop that does not move, against each other, on a springpot."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import Literal

import numpy as np

from vofem.bodies import Mass
from vofem.effects import Constant, Contact, PointLoad, Sine, Spring, Springpot
from vofem.scene import Scene
from vofem.verification import case as by
from vofem.verification.case import Case, How, Quantity, Run, exact, on_stop, stepping


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
    yield _paper(4, "b", "penetration", 12.328983786650, 14.115411317495)
    yield _paper(5, "c", "penetration", 1.878224203370, 3.456593873995)
    yield _paper(5, "c", "displacement", 1.878224203370, 2.610164648343)
    yield _order()
    yield _cradle()
    yield _preload()
    for ratio in (1e-6, 1e-12, 1e-30):
        yield _light_joint(ratio)
    yield _fractional("released", 1.0, 0.0, 0.0)
    yield _fractional("struck", 0.0, 1.0, 0.0)
    yield _fractional("loaded", 0.0, 0.0, 1.0)


# -- Hard cases of one degree of freedom on a stop that does not move: 1, 2, 7, 23, 26, 27 and 29


def release_on_a_stop() -> tuple[Mass, Scene]:
    """Return a mass released on an elastic stop, and its scene (code_aster SDND101)."""
    mass = Mass(100.0, stiffness=1e4)
    return mass, on_stop(mass, 0.0, 1e6, (0.0, 1.0))


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
    return Case(1, "release on a stop", "closed form", quantities, measure, how)


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
    return on_stop(Mass(1.0, stiffness=10.0), gap, 50.0, (-np.sqrt(2.0 * energy / 10.0), 0.0))


def _bilinear(energy: float, gap: float) -> Case:
    period = bilinear_period(energy, gap)

    def measure(run: Run) -> Mapping[str, float]:
        periods = np.diff(run.simulate(bilinear(energy, gap), 30.0).contacts["stop"].closings)
        return {"period, the worst of all [s]": float(periods[np.argmax(np.abs(periods - period))])}

    quantities = (Quantity("period, the worst of all [s]", period),)
    name = f"bilinear oscillator, E = {energy:g} J, gap {gap:g} m"
    return Case(2, name, "closed form", quantities, measure, exact(1e-12) | stepping(1e-3, 3e-5))


def _long_time(phase: float, steps: int = 1_000_000) -> Case:
    k_stop = 1e4
    dt = phase / np.sqrt(1.0 + k_stop)

    def measure(run: Run) -> Mapping[str, float]:
        scene = on_stop(Mass(1.0, stiffness=1.0), 0.1, k_stop, (0.0, 1.0))
        result = run.simulate(scene, steps * dt, times=np.linspace(0.0, steps * dt, 2001))
        return {"energy drift": result.energy.balance_error}

    slow = phase != 1.0
    how = exact(1e-9, slow=slow) | {by.CONSERVING: How(1e-10, {"dt": dt}, slow=slow)}
    how[by.CENTRAL] = How(0.01, {"dt": dt}, "reported", "energy: ")
    if phase >= 2.0:
        how[by.CENTRAL] = How(0.0, {"dt": dt}, "refused", "critical step")
    options = {"dt": dt, "rho_infinity": 1.0}
    how[by.ALPHA] = (
        How(0.01, options, "reported", "energy: ") if phase < 0.5 else How(0.0, options, "stopped", "blew up")
    )
    quantities = (Quantity("energy drift", 0.0, relative=False),)
    return Case(7, f"long-time energy, 1e6 steps, omega dt = {phase:g}", "closed form", quantities, measure, how)


def _rounding_of_steps(dt: float = 1e-5, steps: int = 1_000_000) -> Case:
    angles: dict[str, Callable[[], float]] = {
        # The result of the recurrences in exact arithmetic.
        by.CENTRAL: lambda: float(np.cos(steps * 2.0 * np.arcsin(0.5 * dt))),
        by.CONSERVING: lambda: float(np.cos(steps * 2.0 * np.arctan(0.5 * dt))),
        by.ALPHA: lambda: float(np.cos(steps * 2.0 * np.arctan(0.5 * dt))),
    }

    def measure(run: Run) -> Mapping[str, float]:
        mass = Mass(1.0, stiffness=1.0)
        result = run.simulate(Scene([mass], initial={mass: (1.0, 0.0)}), steps * dt, times=[0.0, steps * dt])
        expected = angles[run.method]() if run.method in angles else np.cos(steps * dt)
        return {"loss to rounding [m]": float(result.displacement(mass)[-1] - expected)}

    how = exact(1e-14) | stepping(dt, 1e-9)
    how[by.ALPHA] = How(1e-9, {"dt": dt, "rho_infinity": 1.0})
    source = "closed form of the recurrence in exact arithmetic"
    quantities = (Quantity("loss to rounding [m]", 0.0, relative=False),)
    return Case(23, "a million small steps, dt = 1e-5", source, quantities, measure, how)


def _underflow() -> Case:
    period = bilinear_period(1.0, 0.0)

    def measure(run: Run) -> Mapping[str, float]:
        scene = on_stop(Mass(1.0, stiffness=10.0), 0.0, 50.0, (-1e-170, 0.0))
        closings = run.simulate(scene, 10.0).contacts["stop"].closings
        return {"closings": closings.size, "period [s]": float(np.diff(closings)[0]) if closings.size > 1 else np.nan}

    quantities = (Quantity("closings", 7.0, tolerance=0.0), Quantity("period [s]", period))
    how = exact(1e-12) | stepping(1e-3, 3e-5)
    return Case(26, "gaps of 1e-170 m, whose products underflow", "closed form", quantities, measure, how)


def _gaps() -> Iterator[Case]:
    def preloaded(run: Run) -> Mapping[str, float]:
        mass = Mass(1.0, stiffness=10.0)
        result = run.simulate(on_stop(mass, -0.1, 50.0, (-0.07, 0.0)), 3.0)
        contact = result.contacts["stop"]
        return {"displacement at 3 s [m]": float(result.displacement(mass)[-1]), "openings": contact.openings.size}

    rest = -50.0 * 0.1 / 60.0
    end = rest + (-0.07 - rest) * np.cos(3.0 * np.sqrt(60.0))
    quantities = (Quantity("displacement at 3 s [m]", end), Quantity("openings", 0.0, False, 0.0))
    how = exact(1e-13) | stepping(1e-4, 3e-6)
    yield Case(27, "negative gap: preloaded and never open", "closed form", quantities, preloaded, how)

    for gap in (10.0, 1e50):

        def unreached(run: Run, gap: float = gap) -> Mapping[str, float]:
            mass, start = Mass(1.0, stiffness=10.0), (1.0, 0.0)
            scenes = on_stop(mass, gap, 50.0, start), Scene([mass], initial={mass: start})
            held, free = (run.simulate(scene, 20.0).displacement(mass) for scene in scenes)
            return {"difference to no contact [m]": float(np.max(np.abs(held - free)))}

        only = (Quantity("difference to no contact [m]", 0.0, relative=False),)
        name = f"a gap of {gap:g} m that is never reached"
        yield Case(27, name, "bitwise", only, unreached, exact(0.0) | stepping(1e-2, 0.0))


def _huge_step() -> Case:
    def measure(run: Run) -> Mapping[str, float]:
        mass = Mass(1.0, stiffness=1e12)
        result = run.simulate(Scene([mass], initial={mass: (1.0, 1e6)}), 1000.0, times=np.linspace(0.0, 1000.0, 1001))
        return {"energy drift": result.energy.balance_error}

    how = exact(1e-9)
    how[by.CONSERVING] = How(1e-10, {"dt": 1.0}, says="do not resolve")
    how[by.ALPHA] = How(0.01, {"dt": 1.0}, "reported", "do not resolve")
    how[by.CENTRAL] = How(0.0, {"dt": 1.0}, "refused", "critical step")
    quantities = (Quantity("energy drift", 0.0, relative=False),)
    return Case(29, "huge steps, omega dt = 1e6", "closed form", quantities, measure, how)


# -- Hard cases of few masses that meet each other: 4, 5, 11, 12 and 22

Law = Literal["displacement", "penetration"]


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
    return Case(number, name, "independent program", quantities, measure, exact(1e-12) | stepping(1e-3, tolerance))


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
    how |= {method: How(ratio + 2e-7, {"dt": 1e-3}) for method in (by.CONSERVING, by.ALPHA)}
    how[by.CENTRAL] = How(ratio + 2e-7)
    if ratio < 1e-9:
        how[by.CENTRAL] = How(0.0, {} if ratio < 1e-20 else {"dt": 1e-3}, "refused", "critical step")
    quantities = (Quantity("displacement of the heavy mass at 1 s [m]", float(np.cos(1.0))),)
    return Case(22, f"a joint of {ratio:g} of the mass", "closed form, springs in series", quantities, measure, how)


# -- A mass on a spring and a springpot, beside the solution in Mittag-Leffler functions

#: Mass in kg, coefficient in N s^(1/2)/m and stiffness in N/m.
_MASS, _COEFFICIENT, _STIFFNESS = 1.0, 0.7, 4.0

_MITTAG_LEFFLER = (
    "Mittag-Leffler functions of order 1/2, by R. L. Bagley, P. J. Torvik, AIAA J. 21 (1983) 741, "
    "https://doi.org/10.2514/3.8142"
)


def _fractional_end(t: float, u0: float, v0: float, force: float) -> float:
    """Return the displacement in m of the oscillator at rest before t = 0, under a constant force in N.

    With ``z = sqrt(s)`` the transform is a rational function of z, a sum of
    poles ``1/(z - r)``, each of which is ``1/sqrt(pi t) + r E_{1/2}(r sqrt(t))``.
    """
    from scipy.special import wofz

    # The displacement from the place where the force of the spring is that of the load.
    start = u0 - force / _STIFFNESS
    bottom = np.array([_MASS, 0.0, 0.0, _COEFFICIENT, _STIFFNESS])
    roots = np.roots(bottom)
    slopes = np.polyval(np.polyder(bottom), roots)
    # A pole at z = 0 adds nothing: its function is the first one, and these cancel in the sum of all poles.
    top = _MASS * (start * roots**2 + v0) + _COEFFICIENT * start / roots
    functions = wofz(-1j * roots * np.sqrt(t))
    return force / _STIFFNESS + float(np.sum(top / slopes * roots * functions).real)


def _fractional(name: str, u0: float, v0: float, force: float) -> Case:
    times = np.array([0.5, 2.0, 6.0])

    def measure(run: Run) -> Mapping[str, float]:
        mass = Mass(_MASS, stiffness=_STIFFNESS)
        springpot = Springpot(mass, coefficient=_COEFFICIENT, order=0.5, name="springpot")
        scene = Scene([mass], [springpot, PointLoad(mass, Constant(force))], initial={mass: (u0, v0)})
        result = run.simulate(scene, 6.0, times=np.append(0.0, times))
        found = result.displacement(mass)[1:]
        return {f"displacement at {t:g} s [m]": float(u) for t, u in zip(times, found, strict=True)}

    quantities = tuple(
        Quantity(f"displacement at {t:g} s [m]", _fractional_end(t, u0, v0, force), relative=False) for t in times
    )
    how = stepping(1e-3, 5e-6) | {by.EVENT_DRIVEN: How(expected="refused", says=by.CONSERVING)}
    return Case(None, f"fractional oscillator of order 1/2, {name}", _MITTAG_LEFFLER, quantities, measure, how)
