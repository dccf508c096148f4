"""Cases of few masses: on a stop that does not move, against each other, on a springpot."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Literal

import numpy as np

from vofem.bodies import Mass
from vofem.effects import Constant, Contact, PointLoad, Sine, Spring, Springpot
from vofem.scene import Scene
from vofem.verification import case as by
from vofem.verification.case import Case, How, Quantity, Run, absolute, case, exact, on_stop, stepping


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _release
    for energy, gap in ((1e-3, 0.01), (1.0, 0.01), (1.0, 0.0)):
        yield _bilinear(energy, gap)
    for phase in (0.05, 0.2, 1.0, 5.0):
        yield _long_time(phase)
    yield _rounding_of_steps
    yield _underflow
    yield _preloaded
    for gap in (10.0, 1e50):
        yield _unreached(gap)
    yield _huge_step
    yield _paper(4, "b", "penetration", 12.328983786650, 14.115411317495)
    yield _paper(5, "c", "penetration", 1.878224203370, 3.456593873995)
    yield _paper(5, "c", "displacement", 1.878224203370, 2.610164648343)
    yield _order
    yield _cradle()
    yield _preload
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


#: Frequency of this mass in touch with the stop, rad/s.
_TOUCHED = np.sqrt(1.01e6 / 100.0)


@case(
    1, "release on a stop", "closed form",
    {"duration [s]": np.pi / _TOUCHED, "peak force [N]": 1e6 / _TOUCHED, "impulse [N s]": 2e6 / _TOUCHED**2},
    exact(1e-12) | stepping(1e-5, 1e-6),
)  # fmt: skip
def _release(run: Run) -> Iterable[float]:
    mass, scene = release_on_a_stop()
    result = run.simulate(scene, 0.1)
    duration = result.contacts["stop"].openings[0]
    nodes, weights = np.polynomial.legendre.leggauss(30)
    force = 1e6 * result.displacement(mass, t=0.5 * duration * (1.0 + nodes))
    peak = 1e6 * result.displacement(mass, t=0.5 * duration)[0]
    return duration, peak, 0.5 * duration * (weights @ force)


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
    period, name = bilinear_period(energy, gap), f"bilinear oscillator, E = {energy:g} J, gap {gap:g} m"

    @case(2, name, "closed form", {"period, the worst of all [s]": period}, exact(1e-12) | stepping(1e-3, 3e-5))
    def measured(run: Run) -> Iterable[float]:
        periods = np.diff(run.simulate(bilinear(energy, gap), 30.0).contacts["stop"].closings)
        return [periods[np.argmax(np.abs(periods - period))]]

    return measured


def _long_time(phase: float, steps: int = 1_000_000) -> Case:
    k_stop = 1e4
    dt, slow = phase / np.sqrt(1.0 + k_stop), phase != 1.0
    how = exact(1e-9, slow=slow) | {by.CONSERVING: How(1e-10, {"dt": dt}, slow=slow)}
    how[by.CENTRAL] = How(0.01, {"dt": dt}, "reported", "energy: ")
    if phase >= 2.0:
        how[by.CENTRAL] = How(0.0, {"dt": dt}, "refused", "critical step")
    options = {"dt": dt, "rho_infinity": 1.0}
    how[by.ALPHA] = (
        How(0.01, options, "reported", "energy: ") if phase < 0.5 else How(0.0, options, "stopped", "blew up")
    )
    name = f"long-time energy, 1e6 steps, omega dt = {phase:g}"

    @case(7, name, "closed form", {"energy drift": absolute(0.0)}, how)
    def measured(run: Run) -> Iterable[float]:
        scene = on_stop(Mass(1.0, stiffness=1.0), 0.1, k_stop, (0.0, 1.0))
        return [run.simulate(scene, steps * dt, times=np.linspace(0.0, steps * dt, 2001)).energy.balance_error]

    return measured


_SMALL, _MILLION = 1e-5, 1_000_000


@case(
    23, "a million small steps, dt = 1e-5", "closed form of the recurrence in exact arithmetic",
    {"loss to rounding [m]": absolute(0.0)},
    exact(1e-14) | stepping(_SMALL, 1e-9) | {by.ALPHA: How(1e-9, {"dt": _SMALL, "rho_infinity": 1.0})},
)  # fmt: skip
def _rounding_of_steps(run: Run) -> Iterable[float]:
    mass, end = Mass(1.0, stiffness=1.0), _MILLION * _SMALL
    result = run.simulate(Scene([mass], initial={mass: (1.0, 0.0)}), end, times=[0.0, end])
    # The angle of the recurrences in exact arithmetic.
    angle = _MILLION * 2.0 * (np.arcsin if run.method == by.CENTRAL else np.arctan)(0.5 * _SMALL)
    recurs = run.method in (by.CENTRAL, by.CONSERVING, by.ALPHA)
    return [result.displacement(mass)[-1] - np.cos(angle if recurs else end)]


@case(
    26, "gaps of 1e-170 m, whose products underflow", "closed form",
    {"closings": Quantity("", 7.0, tolerance=0.0), "period [s]": bilinear_period(1.0, 0.0)},
    exact(1e-12) | stepping(1e-3, 3e-5),
)  # fmt: skip
def _underflow(run: Run) -> Iterable[float]:
    scene = on_stop(Mass(1.0, stiffness=10.0), 0.0, 50.0, (-1e-170, 0.0))
    closings = run.simulate(scene, 10.0).contacts["stop"].closings
    return closings.size, np.diff(closings)[0] if closings.size > 1 else np.nan


#: Where the preloaded mass would rest, m.
_REST = -50.0 * 0.1 / 60.0


@case(
    27, "negative gap: preloaded and never open", "closed form",
    {
        "displacement at 3 s [m]": _REST + (-0.07 - _REST) * np.cos(3.0 * np.sqrt(60.0)),
        "openings": absolute(0.0, 0.0),
    },
    exact(1e-13) | stepping(1e-4, 3e-6),
)  # fmt: skip
def _preloaded(run: Run) -> Iterable[float]:
    mass = Mass(1.0, stiffness=10.0)
    result = run.simulate(on_stop(mass, -0.1, 50.0, (-0.07, 0.0)), 3.0)
    return result.displacement(mass)[-1], result.contacts["stop"].openings.size


def _unreached(gap: float) -> Case:
    right, how = {"difference to no contact [m]": absolute(0.0)}, exact(0.0) | stepping(1e-2, 0.0)

    @case(27, f"a gap of {gap:g} m that is never reached", "bitwise", right, how)
    def measured(run: Run) -> Iterable[float]:
        mass, start = Mass(1.0, stiffness=10.0), (1.0, 0.0)
        scenes = on_stop(mass, gap, 50.0, start), Scene([mass], initial={mass: start})
        held, free = (run.simulate(scene, 20.0).displacement(mass) for scene in scenes)
        return [np.max(np.abs(held - free))]

    return measured


@case(
    29, "huge steps, omega dt = 1e6", "closed form", {"energy drift": absolute(0.0)},
    {
        by.EVENT_DRIVEN: How(1e-9),
        by.CONSERVING: How(1e-10, {"dt": 1.0}, says="do not resolve"),
        by.ALPHA: How(0.01, {"dt": 1.0}, "reported", "do not resolve"),
        by.CENTRAL: How(0.0, {"dt": 1.0}, "refused", "critical step"),
    },
)  # fmt: skip
def _huge_step(run: Run) -> Iterable[float]:
    mass = Mass(1.0, stiffness=1e12)
    scene = Scene([mass], initial={mass: (1.0, 1e6)})
    return [run.simulate(scene, 1000.0, times=np.linspace(0.0, 1000.0, 1001)).energy.balance_error]


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
    right = {"first closing [s]": closing, "first opening [s]": opening}
    how = exact(1e-12) | stepping(1e-3, 1e-6 if acts_on == "penetration" else 1e-3)

    @case(number, f"two masses, loads {loads}, acts_on={acts_on!r}", "independent program", right, how)
    def measured(run: Run) -> Iterable[float]:
        contact = run.simulate(paper_masses(loads, acts_on)[2], 20.0).contacts["contact"]
        return contact.closings[0], contact.openings[0]

    return measured


@case(5, "two masses, order of steps", "theory", {"observed order": absolute(2.0)}, stepping(1e-3, 0.5))
def _order(run: Run) -> Iterable[float]:
    ends = []
    for share in (1.0, 0.5, 0.25):
        first, _, scene = paper_masses("c", "penetration")
        dt, times = share * run.options["dt"], np.linspace(0.0, 20.0, 21)
        ends.append(run.simulate(scene, 20.0, dt=dt, times=times).displacement(first))
    coarse, fine = (np.linalg.norm(a - b) for a, b in pairwise(ends))
    return [np.log2(coarse / fine)]


def _cradle(count: int = 5, gap: float = 0.01, stiffness: float = 1e6) -> Case:
    w = np.sqrt(2.0 * stiffness)
    # Each contact lasts pi/w. In this time the struck mass already moves v pi/(2 w) into the next gap.
    leaves = gap + np.pi / w + (count - 2) * (gap + 0.5 * np.pi / w)
    right = {"last mass leaves at [s]": leaves, "its speed [m/s]": 1.0}

    @case(11, f"Newton's cradle of {count} masses", "closed form", right, exact(1e-10) | stepping(1e-6, 1e-6))
    def measured(run: Run) -> Iterable[float]:
        masses = [Mass(1.0) for _ in range(count)]
        contacts = [
            Contact(a, b, gap=gap, stiffness=stiffness, acts_on="penetration", name=f"c{i}")
            for i, (a, b) in enumerate(pairwise(masses))
        ]
        result = run.simulate(Scene(masses, contacts, initial={masses[0]: (0.0, 1.0)}), 0.1)
        return result.contacts[f"c{count - 2}"].openings[0], result.velocity(masses[-1])[-1]

    return measured


@case(
    12, "preload across a gap of zero", "closed form", {"first [m]": 1.8, "second [m]": 1.2},
    {"equilibrium": How(1e-15)} | exact(1e-14) | stepping(1e-2, 1e-14),
)  # fmt: skip
def _preload(run: Run) -> Iterable[float]:
    first, second = Mass(1.0, stiffness=1.0), Mass(1.0, stiffness=1.0)
    contact = Contact(first, second, gap=0.0, stiffness=2.0, acts_on="penetration")
    effects = [contact, PointLoad(first, 3.0)]
    rest = run.equilibrium(Scene([first, second], effects))
    if run.method == "equilibrium":
        return rest.displacement(first), rest.displacement(second)
    result = run.simulate(Scene([first, second], effects, initial={first: (1.8, 0.0), second: (1.2, 0.0)}), 10.0)
    return result.displacement(first)[-1], result.displacement(second)[-1]


def _light_joint(ratio: float) -> Case:
    how = exact(ratio + 1e-14)
    how |= {method: How(ratio + 2e-7, {"dt": 1e-3}) for method in (by.CONSERVING, by.ALPHA)}
    how[by.CENTRAL] = How(ratio + 2e-7)
    if ratio < 1e-9:
        how[by.CENTRAL] = How(0.0, {} if ratio < 1e-20 else {"dt": 1e-3}, "refused", "critical step")
    right = {"displacement of the heavy mass at 1 s [m]": np.cos(1.0)}

    @case(22, f"a joint of {ratio:g} of the mass", "closed form, springs in series", right, how)
    def measured(run: Run) -> Iterable[float]:
        heavy, light = Mass(1.0, name="heavy"), Mass(ratio, stiffness=3.0, name="light")
        start = {heavy: (1.0, 0.0), light: (1.0 / 3.0, 0.0)}
        scene = Scene([heavy, light], [Spring(heavy, light, stiffness=1.5)], initial=start)
        return [run.simulate(scene, 1.0, times=[0.0, 1.0]).displacement(heavy)[-1]]

    return measured


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
    times = (0.5, 2.0, 6.0)
    right = {f"displacement at {t:g} s [m]": absolute(_fractional_end(t, u0, v0, force)) for t in times}
    how = stepping(1e-3, 5e-6) | {by.EVENT_DRIVEN: How(expected="refused", says=by.CONSERVING)}

    @case(None, f"fractional oscillator of order 1/2, {name}", _MITTAG_LEFFLER, right, how)
    def measured(run: Run) -> Iterable[float]:
        mass = Mass(_MASS, stiffness=_STIFFNESS)
        springpot = Springpot(mass, coefficient=_COEFFICIENT, order=0.5, name="springpot")
        scene = Scene([mass], [springpot, PointLoad(mass, Constant(force))], initial={mass: (u0, v0)})
        return run.simulate(scene, 6.0, times=[0.0, *times]).displacement(mass)[1:]

    return measured
