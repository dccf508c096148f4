"""Cases from the validation manuals of other codes: frequencies, motions and equilibria."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache, partial
from importlib.resources import files
from typing import Any

import numpy as np

from vofem.bodies import Beam, Mass
from vofem.effects import (
    Contact,
    DistributedLoad,
    Foundation,
    Gravity,
    NonlinearSpring,
    PointLoad,
    PointMass,
    PointMoment,
    Pulse,
    RayleighDamping,
    RotationalSpring,
    Sine,
    Spring,
)
from vofem.scene import Scene
from vofem.simulate.simulation import simulate
from vofem.verification import case as by
from vofem.verification.case import Case, How, Quantity, Run, absolute, case, exact, on_stop, stepping
from vofem.verification.cases import masses
from vofem.vibration import modes


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _frequencies("simply supported beam", "vpcs_sdll05_ss_beam", _simply_supported, ("f1", "f2"))
    bare, sprung_mass = "beam with a sprung mass, bare", "vpcs_sdll04_sprung_mass"
    yield _frequencies(bare, sprung_mass, _simply_supported, ("f1", "f2"), "bare")
    for index in (1, 2):
        m, build = published(sprung_mass)["parameters"]["m"][index], partial(_sprung, index=index)
        name = f"beam with a sprung mass of {m:g} kg"
        yield _frequencies(name, sprung_mass, build, ("f1", "f2", "f3"), f"m={m:g}")
    lowest = ("f1", "f2", "f3", "f4", "f5")
    yield _frequencies("cantilever tube with a tip mass", "vpcs_sdll15_tip_mass", _tip_mass, lowest[:4], "bending")
    for at, width in (("case 1", 0.04), ("case 2", 0.05)):
        build = partial(_tapered, root_width=width)
        yield _frequencies(f"tapered cantilever, {at}", "vpcs_sdll09_tapered", build, lowest, at)
    pairs = ("f1,f2", "f3,f4", "f5,f6", "f7,f8")
    yield _frequencies("beam folded on itself", "vpcs_sdll02_folded", _folded, pairs, each=2, own=1e-4)
    yield from (_release, _bilinear, _ball, _pulse, _impulse("0"), _impulse("0.7"), _cantilever)
    yield from (_loose_tube, _zener(), _softening(), _winkler)


@cache
def published(name: str) -> dict[str, Any]:
    """Return a published test case: statement, parameters, sources, and quantities with what is known of them."""
    text = (files("vofem.verification") / "published" / f"{name}.json").read_text(encoding="utf-8")
    case: dict[str, Any] = json.loads(text)
    return case


def entry(case: dict[str, Any], name: str, at: str | None = None) -> dict[str, Any]:
    """Return one quantity of a published case: value, tolerance and independent recomputation."""
    found = [q for q in case["quantities"] if q["name"] == name and (at is None or q["at"] == at)]
    if len(found) != 1:
        raise KeyError(f"{case['id']} has {len(found)} quantities {name!r} at {at!r}")
    quantity: dict[str, Any] = found[0]
    return quantity


def source(case: dict[str, Any]) -> str:
    """Return the test case's name and where it is published."""
    return f"{case['id']}, {case['source'][0].split(' ')[0]}"


# -- Frequencies from the validation manuals of other codes

PINNED = {"left": "pinned", "right": "pinned"}


def _frequencies(
    name: str, file: str, build: Callable[[Mapping[str, Any]], Scene], names: Sequence[str], at: str = "",
    each: int = 1, own: float = 1e-5,
) -> Case:  # fmt: skip
    """Return a case that compares with the printed values, and with independent recomputations to more digits."""
    data = published(file)
    entries = [entry(data, key, at) for key in names]
    right: dict[str, float | Quantity] = {
        f"{key} as printed [Hz]": printed(q) for key, q in zip(names, entries, strict=True)
    }
    right |= {f"{key} recomputed [Hz]": q["our_value"] for key, q in zip(names, entries, strict=True)}

    @case(None, name, source(data), right, {"modes": How(own)})
    def measured(run: Run) -> Iterable[float]:
        found = modes(build(data["parameters"]), each * len(names)).frequencies.reshape(len(names), each)
        wanted = [(some, q[value]) for value in ("value", "our_value") for some, q in zip(found, entries, strict=True)]
        return [some[np.argmax(np.abs(some - value))] for some, value in wanted]

    return measured


def printed(quantity: Mapping[str, Any]) -> Quantity:
    """Return a published quantity with the tolerance that its digits allow."""
    return absolute(quantity["value"], quantity["tolerance"])


def _simply_supported(p: Mapping[str, Any]) -> Scene:
    return Scene([Beam(p["L"], p["E"] * p["I"], p["rho"] * p["A"], 40, PINNED)])


def _sprung(p: Mapping[str, Any], index: int) -> Scene:
    """Return a beam and a mass, two bodies joined by a spring at a quarter of the span."""
    beam = Beam(p["L"], p["E"] * p["I"], p["rho"] * p["A"], 40, PINNED)
    mass = Mass(p["m"][index])
    return Scene([beam, mass], [Spring(beam.at(p["L"] / 4.0), mass, stiffness=p["k"][index])])


def _tip_mass(p: Mapping[str, Any]) -> Scene:
    inertia = np.pi / 64.0 * (p["De"] ** 4 - p["Di"] ** 4)
    area = np.pi / 4.0 * (p["De"] ** 2 - p["Di"] ** 2)
    beam = Beam(p["L"], p["E"] * inertia, p["rho"] * area, 40, {"left": "clamped"})
    return Scene([beam], [PointMass(beam.at("right"), mass=p["tip_mass"])])


def _tapered(p: Mapping[str, Any], root_width: float) -> Scene:
    def height(x: Any) -> Any:
        return 0.04 - 0.03 * x / p["L"]

    def width(x: Any) -> Any:
        return root_width - (root_width - 0.01) * x / p["L"]

    def bending(x: Any) -> Any:
        return p["E"] * width(x) * height(x) ** 3 / 12.0

    def mass(x: Any) -> Any:
        return p["rho"] * width(x) * height(x)

    return Scene([Beam(p["L"], bending, mass, 60, {"left": "clamped"})])


def _folded(p: Mapping[str, Any]) -> Scene:
    """Return two arms side by side, one clamped and one free at the far end, stiffly joined there."""
    width, height, arm = 0.050, 0.005, p["arm"]
    EI, rhoA = p["E"] * width * height**3 / 12.0, p["rho"] * width * height
    outer = Beam(arm, EI, rhoA, 40, {"left": "clamped"})
    inner = Beam(arm, EI, rhoA, 40)
    fold = [
        Spring(outer.at("right"), inner.at("right"), stiffness=1e8 * EI / arm**3),
        RotationalSpring(outer.at("right"), inner.at("right"), stiffness=1e8 * EI / arm),
    ]
    return Scene([outer, inner], fold)


# -- Motions and equilibria from the validation manuals of other codes

#: (name, place) of the published quantities of a case.
Names = Sequence[tuple[str, str]]

#: Energy of the bilinear oscillator, J.
_ENERGY = 0.00650108331626


def _motion(
    name: str, file: str, names: Names, dt: float
) -> Callable[[Callable[[Run, Mapping[str, Any]], Iterable[float]]], Case]:
    """Make a case of a function of a run and of the published parameters."""
    data = published(file)
    # Numerical dissipation would change the published digits.
    how = exact() | stepping(dt) | {by.ALPHA: How(options={"dt": dt, "rho_infinity": 1.0})}
    made = case(None, name, source(data), {_label(*key): printed(entry(data, *key)) for key in names}, how)
    return lambda measure: made(lambda run: measure(run, data["parameters"]))


def _label(name: str, at: str) -> str:
    return f"{name} ({at})" if at else name


_IMPACTS = [(name, f"impact {k}") for k in (1, 2) for name in ("time_of_force_peak", "max_stop_force")]


@_motion("release on a stop, two impacts", "ca_sdnd101_release_stop", _IMPACTS, 1e-4)
def _release(run: Run, p: Mapping[str, Any]) -> Iterable[float]:
    mass, scene = masses.release_on_a_stop()
    result = run.simulate(scene, 0.5)
    contact = result.contacts["stop"]
    middle = 0.5 * (contact.closings[:2] + contact.openings[:2])
    return np.stack([middle, 1e6 * result.displacement(mass, t=middle)], axis=1).ravel()


_FREQUENCY = [("frequency", f"E={_ENERGY!r}")]


@_motion("frequency of a bilinear oscillator", "ca_sdnd122_bilinear_nnm", _FREQUENCY, 1e-3)
def _bilinear(run: Run, p: Mapping[str, Any]) -> Iterable[float]:
    closings = run.simulate(masses.bilinear(_ENERGY, 0.01), 20.0).contacts["stop"].closings
    return [1.0 / np.diff(closings)[0]]


_IMPACT = [("impact_time", ""), ("impact_velocity", ""), ("kinetic_energy", "impact")]


@_motion("bouncing ball", "ansys_vm65_ball", _IMPACT, 1e-5)
def _ball(run: Run, p: Mapping[str, Any]) -> Iterable[float]:
    ball = Mass(p["m"])
    result = run.simulate(on_stop(ball, p["h"], p["k"], None, Gravity(p["g"]), side="below"), 0.2)
    impact = float(result.contacts["stop"].closings[0])
    velocity = float(result.velocity(ball, t=impact)[0])
    return impact, velocity, 0.5 * p["m"] * velocity**2


_PULSE = [("Y1", "t=1.3"), ("Y2", "t=1.3"), ("Y1", "t=2.4")]


@_motion("rectangular pulse on two masses", "ansys_vm182_pulse_2dof", _PULSE, 1e-3)
def _pulse(run: Run, p: Mapping[str, Any]) -> Iterable[float]:
    upper, lower = Mass(p["m1"]), Mass(p["m2"], stiffness=p["k2"])
    effects = [Spring(upper, lower, stiffness=p["k1"]), PointLoad(upper, Pulse(50.0, 0.0, 1.8))]
    result = run.simulate(Scene([upper, lower], effects), 3.0, times=[0.0, 1.3, 2.4])
    one, two = result.displacement(upper), result.displacement(lower)
    return one[1], two[1], one[2]


def _impulse(zeta: str) -> Case:
    name, at = f"impulse on an oscillator, zeta = {zeta}", f"t=0.1 zeta={zeta}"

    @_motion(name, "ansys_vm74_impulse", [("y", at)], 1e-4)
    def measured(run: Run, p: Mapping[str, Any]) -> Iterable[float]:
        mass = Mass(p["m"], stiffness=p["k"], damping=2.0 * float(zeta) * np.sqrt(p["k"] * p["m"]))
        result = run.simulate(Scene([mass], initial={mass: (0.0, 10.0 / p["m"])}), 0.1, times=[0.0, 0.1])
        return [result.displacement(mass)[-1]]

    return measured


_CONVERGED = [("kinetic_energy", "t=0.16 converged model")]


@_motion("cantilever that hits a stop", "ca_sdnl104_cantilever_stop", _CONVERGED, 1e-5)
def _cantilever(run: Run, p: Mapping[str, Any]) -> Iterable[float]:
    inertia, area = np.pi * p["R"] ** 4 / 4.0, np.pi * p["R"] ** 2
    beam = Beam(p["L"], p["E"] * inertia, p["rho"] * area, 20, {"left": "clamped"})
    law = {"gap": p["gap"], "stiffness": p["k_stop"], "acts_on": "penetration"}
    stop = Contact(beam.at("right"), side="below", name="stop", **law)
    return [run.simulate(Scene([beam], [stop, PointLoad(beam.at("right"), -1000.0)]), 0.16).energy.kinetic[-1]]


_TUBE = published("ca_sdnl301_loose_tube")


@case(
    None, "tube that rattles in loose supports", source(_TUBE),
    {_label(q["name"], q["at"]): printed(q) for q in _TUBE["quantities"]},
    # The highest modes are overdamped: 7e6 1/s.
    exact(slow=True) | stepping(1e-5, slow=True) | {by.CENTRAL: How(0.0, {"dt": 1e-5}, "refused", "critical step")},
)  # fmt: skip
def _loose_tube(run: Run) -> Iterable[float]:
    times = np.linspace(0.17, 0.25, 4001)
    stops = run.simulate(loosely_supported_tube(), 0.25, times=times).contacts
    force = stops["above 4"].force - stops["below 4"].force
    return [float(np.sqrt(np.trapezoid(force**2, times) / 0.08))] * len(_TUBE["quantities"])


def loosely_supported_tube() -> Scene:
    """Return the tube of SDNL301, whose stops "above k" and "below k" stand at k quarters of its length."""
    p = _TUBE["parameters"]
    outer, inner = p["R"], p["R"] - p["wall"]
    area, inertia = np.pi * (outer**2 - inner**2), np.pi / 4.0 * (outer**4 - inner**4)
    count, span = p["elements"], p["elements"] // 4
    assert 4 * span == count
    tube = Beam(p["L"], p["E"] * inertia, p["rho"] * area, count, {"left": "clamped"}, name="tube")
    effects: list[Any] = [RayleighDamping(*p["rayleigh"])]
    for quarter in range(1, 5):
        place = tube.at(0.25 * quarter * p["L"])
        for side in ("above", "below"):
            law = {"gap": p["gap"], "stiffness": p["k_stop"], "damping": p["c_stop"], "acts_on": "penetration"}
            effects.append(Contact(place, side=side, name=f"{side} {quarter}", **law))
        push = Sine((-1.0) ** (quarter - 1) * p["force"], p["omega"])
        nodes = range((quarter - 1) * span + 1, quarter * span)
        effects += [PointLoad(tube.at(node * p["L"] / count), push) for node in nodes]
    return Scene([tube], effects)


def _zener() -> Case:
    """Nodes between springs have no mass there, here hardly any. Displacements count from the far end's new place."""
    data = published("ca_sdnd107_zener")
    p, entries = data["parameters"], [q for q in data["quantities"] if q["name"] == "u_mass"]
    times = [float(q["at"].removeprefix("t=")) for q in entries]
    # The light nodes hold 1e-9 of the energy. Their first motion within 1e-9 s is beyond generalized_alpha's steps.
    how = {
        by.EVENT_DRIVEN: How(4e-9),
        by.CONSERVING: How(2e-6, {"dt": 1e-4}),
        by.ALPHA: How(2e-6, {"dt": 1e-4}, "reported", "energy: "),
        by.CENTRAL: How(0.0, {"dt": 1e-4}, "refused", "critical step"),
    }
    right = {_label(q["name"], q["at"]): absolute(q["value"]) for q in entries}

    @case(None, "mass on a Zener element", source(data), right, how)
    def measured(run: Run) -> Iterable[float]:
        light = 1e-9
        mass, middle, inner = Mass(p["m"]), Mass(light, stiffness=p["K2"]), Mass(light, damping=p["C"])
        springs = [Spring(mass, middle, stiffness=p["K1"]), Spring(middle, inner, stiffness=p["K3"])]
        # The dashpot does not move at first, and the massless node jumps to the place where the springs balance.
        at_once = -0.1 * p["K1"] / (p["K1"] + p["K2"] + p["K3"])
        start = {mass: (-0.1, 0.0), middle: (at_once, 0.0), inner: (0.0, 0.0)}
        wanted = np.sort(times)
        result = run.simulate(Scene([mass, middle, inner], springs, initial=start), 5.0, times=np.append(0.0, wanted))
        found = dict(zip(wanted, 0.1 + result.displacement(mass)[1:], strict=True))
        return [found[t] for t in times]

    return measured


def _softening() -> Case:
    data = published("ca_sdnd103_softening_mms")
    p = data["parameters"]
    m, k, x0, a, w = p["m"], p["k0"], p["x0"], p["a"], np.pi / 4
    entries = [q for q in data["quantities"] if q["name"] == "x"][:2]
    how = {method: How(1e-9, {"dt": 5e-4}) for method in (by.ALPHA, by.CENTRAL)}
    # The error is 2.8e-9 m at the step of the others, and falls with its square.
    how[by.CONSERVING] = How(1e-9, {"dt": 2.5e-4}, slow=True)
    how[by.EVENT_DRIVEN] = How(0.0, expected="refused", says="no closed form|not piecewise linear")
    right = {_label(q["name"], q["at"]): absolute(q["value"]) for q in entries}

    def load(t: Any) -> Any:
        x = a * np.sin(w * t)
        return m * (-(w**2) * x + k / m * x * (1 - abs(x) / x0))

    @case(None, "softening spring, manufactured solution", source(data), right, how)
    def measured(run: Run) -> Iterable[float]:
        mass = Mass(m)
        spring = NonlinearSpring(
            mass, potential=lambda u: k * (u**2 / 2 - abs(u) ** 3 / (3 * x0)), force=lambda u: k * u * (1 - abs(u) / x0)
        )
        scene = Scene([mass], [spring, PointLoad(mass, load)], {mass: (0.0, w * a)})
        return run.simulate(scene, 6.0, times=[0.0, 2.0, 6.0]).displacement(mass)[1:]

    return measured


_WINKLER = published("vpcs_ssll16_winkler")

#: Name, place and tolerance of what is compared.
_COMPARED = (
    ("rotation_A", "x=0", 5e-4), ("deflection", "x=L/2", 2e-4), ("support_shear_A", "x=0", 2e-4),
    ("bending_moment", "x=L/2", 5e-4),
)  # fmt: skip


@case(
    None, "beam on a Winkler foundation", source(_WINKLER),
    {_label(*key): Quantity("", entry(_WINKLER, *key)["value"], tolerance=within) for *key, within in _COMPARED},
    {"equilibrium": How()},
)  # fmt: skip
def _winkler(run: Run) -> Iterable[float]:
    p, length = _WINKLER["parameters"], np.pi * np.sqrt(10.0) / 2.0
    beam = Beam(length, p["E"] * p["I"], 1.0, 40, PINNED)
    effects = [
        Foundation(beam, stiffness=p["K_foundation"]),
        PointLoad(beam.at(length / 2), -1e4),
        DistributedLoad(beam, -5000.0),
        PointMoment(beam.at("left"), -15000.0),
        PointMoment(beam.at("right"), 15000.0),
    ]
    rest = run.equilibrium(Scene([beam], effects))
    shear = simulate(Scene([beam], effects, initial=rest), 1e-3).reaction(beam, "left").force[0]
    return rest.slope([0.0])[0], rest.deflection([length / 2])[0], shear, rest.bending_moment([length / 2])[0]
