"""Cases at the limits of numbers and steps: damped and stiff stops, chatter, grazing, faults, short loads."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from vofem.bodies import Mass
from vofem.effects import BaseMotion, Contact, Gravity, PointLoad, Pulse, Sine, Tabulated, TimeFunction
from vofem.integrators.registry import method_named
from vofem.scene import Scene
from vofem.time_functions import Load
from vofem.verification import case as by
from vofem.verification.case import Case, How, Quantity, Run, absolute, case, every, exact, on_stop, stepping


def cases() -> Iterator[Case]:
    """Yield the cases."""
    for zeta in (0.01, 0.1, 0.5):
        yield _restitution(zeta)
    for phase in (0.1, 1.0, 10.0, 1e3):
        yield _rebound(phase)
    yield _chatter
    for zeta, impacts in ((0.05, 39), (0.1, 20), (0.3, 7)):
        yield _nearly_zeno(zeta, impacts)
    for depth in (1e-6, 1e-9, 1e-12):
        yield _grazing(depth)
    yield _scaled("by even powers of two", 4.0**5, 4.0**-3, 4.0**2, 0.0, 0.0)
    yield _scaled("by 1e9 and 1e-9", 1e9, 1e-9, 1e-3, 1e-10, 1e-10)
    yield _bad_load(np.nan)
    yield _bad_load(np.inf)
    yield _bad_start
    corners = np.array([0.0, _BEGIN, _BEGIN + 0.5 * _WIDTH, _BEGIN + _WIDTH, 10.0])
    spike = Tabulated(corners, np.array([0.0, 0.0, _HEIGHT, 0.0, 0.0]))
    yield _short_load("pulse of 1 ms", Pulse(_HEIGHT, _BEGIN, _WIDTH), _pulse)
    yield _short_load("spike of 1 ms in a table", spike, _spike)
    yield _short_load("spike of 1 ms in the motion of the base", spike, lambda t: -_spike(t), base=True)
    yield _short_load("sine faster than the step", Sine(100.0, _FAST), _sine)
    for stiffness in (1e4, 1e6, 1e8, 1e12):
        yield _between_stops(stiffness)


# -- Hard cases of free masses that meet a stop: 3 and 6


def _restitution(zeta: float) -> Case:
    stiffness, e = 1e4, np.exp(-np.pi * zeta / np.sqrt(1.0 - zeta**2))
    right = {"restitution": e, "dissipated [J]": 0.5 * (1.0 - e**2), "closes at [s]": 0.1, "openings": 1.0}
    # The damper's force jumps at closing, and central differences notice it one step late.
    how = exact(1e-11) | stepping(1e-5, 2e-6) | {by.CENTRAL: How(1e-3, {"dt": 1e-5})}

    @case(3, f"damped stop, zeta = {zeta:g}", "closed form", right, how)
    def measured(run: Run) -> Iterable[float]:
        mass, damping = Mass(1.0), 2.0 * zeta * np.sqrt(stiffness)
        result = run.simulate(on_stop(mass, 0.1, stiffness, (0.0, -1.0), side="below", damping=damping), 0.5)
        contact, dissipated = result.contacts["stop"], result.energy.dissipated[-1]
        return result.velocity(mass)[-1], dissipated, contact.closings[0], contact.openings.size

    return measured


def _rebound(phase: float, entries: int = 40) -> Case:
    omega = 1e4
    dt = phase / omega
    reported = How(0.01, {"dt": dt}, "reported", "energy: ")
    how = exact(1e-12) | {by.CONSERVING: How(5e-13, {"dt": dt})}
    how[by.ALPHA] = reported if phase < 5.0 else How(0.01, {"dt": dt}, "stopped", "blew up")
    how[by.CENTRAL] = reported if phase < 2.0 else How(0.01, {"dt": dt}, "refused", "critical step")
    name = f"rebound of a free mass, {entries} entries, omega dt = {phase:g}"

    @case(6, name, "closed form", {"speed out, the worst of all [m/s]": 1.0}, how)
    def measured(run: Run) -> Iterable[float]:
        speeds = []
        for entry in np.arange(entries) / entries:
            mass, t_end = Mass(1.0), 12.0 * dt + 2.0 * np.pi / omega
            result = run.simulate(on_stop(mass, 0.0, omega**2, (-(3.0 + entry) * dt, 1.0)), t_end)
            speeds.append(-float(result.velocity(mass)[-1]))
        return [max(speeds, key=lambda v: abs(v - 1.0))]

    return measured


# -- Hard cases with events that accumulate in time or are easily missed: 8, 9 and 10

#: Events of the chatter by some times, s.
_EVENTS = {50.0: 63, 100.0: 208, 150.0: 541, 200.0: 1307, 250.0: 3068}


@case(
    8, "chatter of the displacement law", "independent program",
    {
        **{f"events by {t:g} s": Quantity("", float(n), tolerance={by.EVENT_DRIVEN: 0.0}) for t, n in _EVENTS.items()},
        "distance from the gap after 225 s [m]": absolute(0.0),
    },
    exact(1e-4) | stepping(1e-3, 3e-3, says="chatter"),
)  # fmt: skip
def _chatter(run: Run) -> Iterable[float]:
    mass = Mass(1.0, damping=0.05)
    stop = Contact(mass, gap=1.0, stiffness=1.0, side="above", acts_on="displacement", name="stop")
    scene = Scene([mass], [stop, PointLoad(mass, 0.4)], initial={mass: (1.0, 0.3)})
    result = run.simulate(scene, 250.0)
    late = result.displacement(mass)[result.times >= 225.0]
    return *(np.sum(result.solution.events.time <= t) for t in _EVENTS), np.max(np.abs(late - 1.0))


def _nearly_zeno(zeta: float, impacts: int) -> Case:
    omega = 1e4
    e = np.exp(-np.pi * zeta / np.sqrt(1.0 - zeta**2))
    rest = 2.0 * e / (10.0 * (1.0 - e))
    right = {
        "impacts": Quantity("", float(impacts), tolerance=0.0),
        "final position [m]": Quantity("", -10.0 / omega**2, tolerance=1e-6),
    }

    @case(9, f"nearly Zeno, zeta = {zeta:g}", "independent program", right, exact() | stepping(1e-6, slow=zeta < 0.2))
    def measured(run: Run) -> Iterable[float]:
        mass, t_end = Mass(1.0), 1.1 * rest + 0.02
        scene = on_stop(mass, 0.0, omega**2, (0.0, -1.0), Gravity(10.0), side="below", damping=2.0 * zeta * omega)
        result = run.simulate(scene, t_end, times=[0.0, t_end])
        return result.contacts["stop"].closings.size, result.displacement(mass)[-1]

    return measured


def _grazing(depth: float) -> Case:
    how = exact(0.0)
    for method in (by.CONSERVING, by.ALPHA, by.CENTRAL):
        # Numerical dissipation would take the motion out of the stop's reach.
        options = {"dt": 1e-3, **({"rho_infinity": 1.0} if method == by.ALPHA else {})}
        how[method] = How(0.0, options, "reported", "passed over") if depth < 1e-7 else How(0.0, options)

    @case(10, f"grazing by {depth:g} m, ten periods", "closed form", {"crossings": 20.0}, how)
    def measured(run: Run) -> Iterable[float]:
        scene = on_stop(Mass(1.0, stiffness=1.0), 1.0 - depth, 1e-9, (0.0, 1.0))
        return [run.simulate(scene, 20.0 * np.pi).counters.events]

    return measured


# -- Hard case 24: the same scene in other units


def _two_masses(length: float, mass: float, time: float) -> tuple[Mass, Scene]:
    stiffness, force = mass / time**2, mass * length / time**2
    first = Mass(mass, stiffness=stiffness, damping=0.1 * mass / time)
    second = Mass(mass, stiffness=stiffness, damping=0.4 * mass / time)
    contact = Contact(first, second, gap=5.0 * length, stiffness=2.0 * stiffness, acts_on="penetration")
    loads = [PointLoad(m, Sine(a * force, 0.8 / time)) for m, a in ((first, 5.0), (second, -5.0))]
    return first, Scene([first, second], [contact, *loads], initial={first: (0.0, -length / time)})


def _scaled(name: str, length: float, mass: float, time: float, exact: float, steps: float) -> Case:
    right, how = {"largest difference": absolute(0.0)}, every(steps) | {by.EVENT_DRIVEN: How(exact)}

    @case(24, f"units scaled {name}", "the scene in SI units", right, how)
    def measured(run: Run) -> Iterable[float]:
        histories = []
        for a, b, c in ((1.0, 1.0, 1.0), (length, mass, time)):
            first, scene = _two_masses(a, b, c)
            more = {"dt": 2.0**-7 * c} if method_named(run.method).steps else {}
            result = run.simulate(scene, 20.0 * c, times=np.linspace(0.0, 20.0, 641) * c, **more)
            histories.append(result.displacement(first) / a)
        return [np.max(np.abs(histories[1] - histories[0])) / np.max(np.abs(histories[0]))]

    return measured


# -- Hard case 25: a value that is not a number ends a run with an error that says where and when


def _oscillator(velocity: float, load: Load) -> Scene:
    mass = Mass(1.0, stiffness=1.0, name="ball")
    return on_stop(mass, 0.1, 10.0, (0.0, velocity), PointLoad(mass, load))


#: No method comes to a quantity.
_NONE = {"none": absolute(0.0)}


def _bad_load(value: float) -> Case:
    def function(t: float) -> float:
        return value if t > 1.0 else 0.1

    how = every(expected="stopped", says=r"load function .* at t = 1\.00")
    how |= exact(expected="refused", says="no closed form")

    @case(25, f"a load that turns {value} at 1 s", "a typed error", _NONE, how)
    def measured(run: Run) -> Iterable[float]:
        run.simulate(_oscillator(0.0, function), 2.0)
        return [0.0]

    return measured


_REFUSED = every(expected="refused", says="initial velocity of Mass 'ball'")


@case(25, "a start velocity that is not a number", "a typed error", _NONE, _REFUSED)
def _bad_start(run: Run) -> Iterable[float]:
    run.simulate(_oscillator(np.nan, 0.1), 2.0)
    return [0.0]


# -- Hard case 31: loads that are shorter, or faster, than a step

Array = NDArray[np.float64]

#: Angular frequency of a mass of 1 kg on 4 N/m, 1/s.
_PULSED = 2.0

#: Step of all stepping methods, ten times as long as the loads.
_STEP = 0.01

#: When displacements are compared, s.
_LATER = (6.0, 8.0, 10.0)

#: Begin in s, width in s and height of the pulse and of the spikes.
_BEGIN, _WIDTH, _HEIGHT = 5.0123, 1e-3, 1000.0

#: Angular frequency of the fast sine, 1/s: with steps of 0.01 s its values pass for a slow motion near resonance.
_FAST = 630.3


def _short_load(name: str, load: TimeFunction, right: Callable[[Array], Array], base: bool = False) -> Case:
    """Return a case of an oscillator under a load in N, or on a base with an acceleration in m/s^2."""
    values = right(np.array(_LATER)).tolist()
    named = {f"displacement at {t:g} s [m]": absolute(u) for t, u in zip(_LATER, values, strict=True)}
    how = exact(1e-9) | stepping(_STEP, 1e-3, says=r"^load: .* less than a step")

    @case(31, name, "closed form", named, how)
    def measured(run: Run) -> Iterable[float]:
        mass = Mass(1.0, stiffness=_PULSED**2)
        effect = BaseMotion(mass, load) if base else PointLoad(mass, load)
        return run.simulate(Scene([mass], [effect]), 10.0, times=[0.0, *_LATER]).displacement(mass)[1:]

    return measured


def _pulse(t: Array) -> Array:
    """Return the displacement in m after the pulse; sums of cosines are written as products, which lose no digits."""
    middle = t - (_BEGIN + 0.5 * _WIDTH)
    return 2.0 * _HEIGHT / _PULSED**2 * np.sin(0.5 * _PULSED * _WIDTH) * np.sin(_PULSED * middle)


def _spike(t: Array) -> Array:
    """Return the displacement in m after a triangle, which is the convolution of two pulses of half its width."""
    middle = t - (_BEGIN + 0.5 * _WIDTH)
    share = np.sin(0.25 * _PULSED * _WIDTH) / (0.25 * _PULSED * _WIDTH)
    return 0.5 * _HEIGHT * _WIDTH / _PULSED * share**2 * np.sin(_PULSED * middle)


def _sine(t: Array) -> Array:
    """Return the displacement in m of a mass at rest at t = 0 under the fast sine."""
    return 100.0 / (_PULSED**2 - _FAST**2) * (np.sin(_FAST * t) - _FAST / _PULSED * np.sin(_PULSED * t))


# -- Hard case 32: a free mass between two stops so stiff that impacts are far shorter than what a tolerance suggests

#: Gap on both sides, m, and end of the run, s. The speed is 1 m/s.
_GAP, _T_END = 0.5, 9.7

#: Tolerance of the steps.
_TOL = 1e-4


def _between_stops(stiffness: float) -> Case:
    omega = np.sqrt(stiffness)
    touch, deepest = np.pi / omega, _GAP + 1.0 / omega
    # The motion from one stop to the other takes one second and the duration of a contact.
    crossings, since = divmod(_T_END - _GAP, 2.0 * _GAP + touch)
    inside = _GAP + np.sin(omega * since) / omega if since < touch else _GAP - (since - touch)
    right = {
        "displacement at the end [m]": absolute((-1.0) ** crossings * inside),
        "largest displacement [m]": absolute(deepest),
        "largest speed [m/s]": absolute(1.0, {by.EVENT_DRIVEN: 1e-8, by.CONSERVING: 1e-3, by.ALPHA: 1e-3}),
    }
    how = exact(1e-8) | {method: How(_TOL * deepest, {"tol": _TOL}) for method in (by.CONSERVING, by.ALPHA)}
    # This method has no steps under a tolerance, and refuses the argument.
    how |= {by.CENTRAL: How(0.0, {"tol": _TOL}, "refused", "tol was given")}

    @case(32, f"free mass between stops of {stiffness:.0e} N/m, tol = {_TOL:g}", "closed form", right, how)
    def measured(run: Run) -> Iterable[float]:
        mass = Mass(1.0)
        stops = [
            Contact(mass, gap=_GAP, stiffness=stiffness, side=side, acts_on="penetration", name=side)
            for side in ("above", "below")
        ]
        # A time within the last contact is included, because the displacement is largest there.
        times = np.append(np.linspace(0.0, _T_END, 1001), _GAP + 0.5 * touch)
        result = run.simulate(Scene([mass], stops, initial={mass: (0.0, 1.0)}), _T_END, times=np.sort(times))
        u = result.displacement(mass)
        return u[-1], np.max(np.abs(u)), np.max(np.abs(result.velocity(mass)))

    return measured
