"""Motions and equilibria from the validation manuals of other codes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
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
    PointMoment,
    Pulse,
    RayleighDamping,
    Sine,
    Spring,
)
from vofem.scene import Scene
from vofem.simulate.simulation import simulate
from vofem.verification.case import (
    ALPHA,
    CENTRAL,
    CONSERVING,
    EVENT_DRIVEN,
    REFUSED,
    REPORTED,
    Case,
    How,
    Quantity,
    Run,
)
from vofem.verification.cases.oscillators import bilinear, release_on_a_stop
from vofem.verification.published_data import entry, published, source

Measure = Callable[[Run], Mapping[str, float]]

#: (name, place) of the published quantities of a case.
Names = tuple[tuple[str, str], ...]


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _case("release on a stop, two impacts", "ca_sdnd101_release_stop", _RELEASE, _release, 1e-4)
    yield _case("frequency of a bilinear oscillator", "ca_sdnd122_bilinear_nnm", _BILINEAR, _bilinear, 1e-3)
    yield _case("bouncing ball", "ansys_vm65_ball", _BALL, _ball, 1e-5)
    yield _case("rectangular pulse on two masses", "ansys_vm182_pulse_2dof", _PULSE, _pulse, 1e-3)
    for zeta in ("0", "0.7"):
        yield _case(
            f"impulse on an oscillator, zeta = {zeta}",
            "ansys_vm74_impulse",
            (("y", f"t=0.1 zeta={zeta}"),),
            _impulse(zeta),
            1e-4,
        )
    yield _case(
        "cantilever that hits a stop",
        "ca_sdnl104_cantilever_stop",
        (("kinetic_energy", "t=0.16 converged model"),),
        _cantilever,
        1e-5,
    )
    yield _loose_tube()
    yield _zener()
    yield _softening()
    yield _winkler()


def _case(name: str, file: str, names: Names, measure: Measure, dt: float) -> Case:
    data = published(file)
    entries = [entry(data, *key) for key in names]
    quantities = tuple(Quantity(_label(key), q["value"], relative=False) for key, q in zip(names, entries, strict=True))
    tolerance = {_label(key): q["tolerance"] for key, q in zip(names, entries, strict=True)}
    how = {EVENT_DRIVEN: How(tolerance)}
    for method in (CONSERVING, ALPHA, CENTRAL):
        # Numerical dissipation would change the published digits.
        more = {"rho_infinity": 1.0} if method == ALPHA else {}
        how[method] = How(tolerance, {"dt": dt, **more})
    return Case(None, name, source(data), quantities, measure, how)


def _label(key: tuple[str, str]) -> str:
    return f"{key[0]} ({key[1]})" if key[1] else key[0]


_RELEASE: Names = (
    ("time_of_force_peak", "impact 1"),
    ("max_stop_force", "impact 1"),
    ("time_of_force_peak", "impact 2"),
    ("max_stop_force", "impact 2"),
)
_BILINEAR: Names = (("frequency", "E=0.00650108331626"),)
_BALL: Names = (("impact_time", ""), ("impact_velocity", ""), ("kinetic_energy", "impact"))
_PULSE: Names = (("Y1", "t=1.3"), ("Y2", "t=1.3"), ("Y1", "t=2.4"))


def _release(run: Run) -> Mapping[str, float]:
    mass, scene = release_on_a_stop()
    result = run.simulate(scene, 0.5)
    contact = result.contacts["stop"]
    middle = 0.5 * (contact.closings[:2] + contact.openings[:2])
    peak = 1e6 * result.displacement(mass, t=middle)
    values: dict[str, float] = {}
    for k in (0, 1):
        values[f"time_of_force_peak (impact {k + 1})"] = float(middle[k])
        values[f"max_stop_force (impact {k + 1})"] = float(peak[k])
    return values


def _bilinear(run: Run) -> Mapping[str, float]:
    closings = run.simulate(bilinear(0.00650108331626, 0.01), 20.0).contacts["stop"].closings
    return {_label(_BILINEAR[0]): 1.0 / float(np.diff(closings)[0])}


def _ball(run: Run) -> Mapping[str, float]:
    m, k, g, h = (published("ansys_vm65_ball")["parameters"][key] for key in ("m", "k", "g", "h"))
    ball = Mass(m)
    stop = Contact(ball, gap=h, stiffness=k, side="below", acts_on="penetration", name="stop")
    result = run.simulate(Scene([ball], [stop, Gravity(g)]), 0.2)
    impact = float(result.contacts["stop"].closings[0])
    velocity = float(result.velocity(ball, t=impact)[0])
    return {"impact_time": impact, "impact_velocity": velocity, "kinetic_energy (impact)": 0.5 * m * velocity**2}


def _pulse(run: Run) -> Mapping[str, float]:
    p = published("ansys_vm182_pulse_2dof")["parameters"]
    upper, lower = Mass(p["m1"]), Mass(p["m2"], stiffness=p["k2"])
    effects = [Spring(upper, lower, stiffness=p["k1"]), PointLoad(upper, Pulse(50.0, 0.0, 1.8))]
    result = run.simulate(Scene([upper, lower], effects), 3.0, times=[0.0, 1.3, 2.4])
    one, two = result.displacement(upper), result.displacement(lower)
    return {"Y1 (t=1.3)": float(one[1]), "Y2 (t=1.3)": float(two[1]), "Y1 (t=2.4)": float(one[2])}


def _impulse(zeta: str) -> Measure:
    def measure(run: Run) -> Mapping[str, float]:
        p = published("ansys_vm74_impulse")["parameters"]
        mass = Mass(p["m"], stiffness=p["k"], damping=2.0 * float(zeta) * np.sqrt(p["k"] * p["m"]))
        result = run.simulate(Scene([mass], initial={mass: (0.0, 10.0 / p["m"])}), 0.1, times=[0.0, 0.1])
        return {f"y (t=0.1 zeta={zeta})": float(result.displacement(mass)[-1])}

    return measure


def _cantilever(run: Run) -> Mapping[str, float]:
    p = published("ca_sdnl104_cantilever_stop")["parameters"]
    inertia, area = np.pi * p["R"] ** 4 / 4.0, np.pi * p["R"] ** 2
    beam = Beam(p["L"], p["E"] * inertia, p["rho"] * area, 20, {"left": "clamped"})
    stop = Contact(
        beam.at("right"), gap=p["gap"], stiffness=p["k_stop"], side="below", acts_on="penetration", name="stop"
    )
    result = run.simulate(Scene([beam], [stop, PointLoad(beam.at("right"), -1000.0)]), 0.16)
    return {"kinetic_energy (t=0.16 converged model)": float(result.energy.kinetic[-1])}


def _loose_tube() -> Case:
    data = published("ca_sdnl301_loose_tube")
    p = data["parameters"]
    entries = data["quantities"]
    names = [f"{q['name']} ({q['at']})" for q in entries]

    def measure(run: Run) -> Mapping[str, float]:
        scene = loosely_supported_tube()
        times = np.linspace(0.17, 0.25, 4001)
        stops = run.simulate(scene, 0.25, times=times).contacts
        force = stops["above 4"].force - stops["below 4"].force
        rms = float(np.sqrt(np.trapezoid(force**2, times) / 0.08))
        return dict.fromkeys(names, rms)

    quantities = tuple(Quantity(name, q["value"], relative=False) for name, q in zip(names, entries, strict=True))
    tolerance = {name: q["tolerance"] for name, q in zip(names, entries, strict=True)}
    how = {
        EVENT_DRIVEN: How(tolerance, slow=True),
        CONSERVING: How(tolerance, {"dt": 1e-5}, slow=True),
        ALPHA: How(tolerance, {"dt": 1e-5}, slow=True),
        # The highest modes are overdamped: 7e6 1/s.
        CENTRAL: How(0.0, {"dt": 1e-5}, REFUSED, "critical step"),
    }
    assert p["elements"] % 4 == 0
    return Case(None, "tube that rattles in loose supports", source(data), quantities, measure, how)


def loosely_supported_tube() -> Scene:
    """Return the tube of SDNL301, whose stops "above k" and "below k" stand at k quarters of its length."""
    p = published("ca_sdnl301_loose_tube")["parameters"]
    outer, inner = p["R"], p["R"] - p["wall"]
    area, inertia = np.pi * (outer**2 - inner**2), np.pi / 4.0 * (outer**4 - inner**4)
    count, span = p["elements"], p["elements"] // 4
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
    p = data["parameters"]
    entries = [q for q in data["quantities"] if q["name"] == "u_mass"]
    times = [float(q["at"].removeprefix("t=")) for q in entries]
    names = [f"u_mass ({q['at']})" for q in entries]

    def measure(run: Run) -> Mapping[str, float]:
        light = 1e-9
        mass, middle, inner = Mass(p["m"]), Mass(light, stiffness=p["K2"]), Mass(light, damping=p["C"])
        springs = [Spring(mass, middle, stiffness=p["K1"]), Spring(middle, inner, stiffness=p["K3"])]
        # The dashpot does not move at first, and the massless node jumps to the place where the springs balance.
        at_once = -0.1 * p["K1"] / (p["K1"] + p["K2"] + p["K3"])
        start = {mass: (-0.1, 0.0), middle: (at_once, 0.0), inner: (0.0, 0.0)}
        wanted = np.sort(times)
        result = run.simulate(Scene([mass, middle, inner], springs, initial=start), 5.0, times=np.append(0.0, wanted))
        found = dict(zip(wanted, 0.1 + result.displacement(mass)[1:], strict=True))
        return {name: float(found[t]) for name, t in zip(names, times, strict=True)}

    quantities = tuple(Quantity(name, q["value"], relative=False) for name, q in zip(names, entries, strict=True))
    # The light nodes hold 1e-9 of the energy. Their first motion within 1e-9 s is beyond generalized_alpha's steps.
    how = {
        EVENT_DRIVEN: How(4e-9),
        CONSERVING: How(2e-6, {"dt": 1e-4}),
        ALPHA: How(2e-6, {"dt": 1e-4}, REPORTED, "energy: "),
    }
    how[CENTRAL] = How(0.0, {"dt": 1e-4}, REFUSED, "critical step")
    return Case(None, "mass on a Zener element", source(data), quantities, measure, how)


def _softening() -> Case:
    data = published("ca_sdnd103_softening_mms")
    p = data["parameters"]
    m, k, x0, a, w = p["m"], p["k0"], p["x0"], p["a"], np.pi / 4
    entries = [q for q in data["quantities"] if q["name"] == "x"][:2]
    names = [f"x ({q['at']})" for q in entries]

    def load(t: Any) -> Any:
        x = a * np.sin(w * t)
        return m * (-(w**2) * x + k / m * x * (1 - abs(x) / x0))

    def measure(run: Run) -> Mapping[str, float]:
        mass = Mass(m)
        spring = NonlinearSpring(
            mass,
            potential=lambda u: k * (u**2 / 2 - abs(u) ** 3 / (3 * x0)),
            force=lambda u: k * u * (1 - abs(u) / x0),
        )
        scene = Scene([mass], [spring, PointLoad(mass, load)], {mass: (0.0, w * a)})
        found = run.simulate(scene, 6.0, times=[0.0, 2.0, 6.0]).displacement(mass)[1:]
        return dict(zip(names, found.tolist(), strict=True))

    quantities = tuple(Quantity(name, q["value"], relative=False) for name, q in zip(names, entries, strict=True))
    how = {method: How(1e-9, {"dt": 5e-4}) for method in (ALPHA, CENTRAL)}
    # The error is 2.8e-9 m at the step of the others, and falls with its square.
    how[CONSERVING] = How(1e-9, {"dt": 2.5e-4}, slow=True)
    how[EVENT_DRIVEN] = How(0.0, expected=REFUSED, says="no closed form|not piecewise linear")
    return Case(None, "softening spring, manufactured solution", source(data), quantities, measure, how)


def _winkler() -> Case:
    data = published("vpcs_ssll16_winkler")
    p = data["parameters"]
    names: Names = (
        ("rotation_A", "x=0"),
        ("deflection", "x=L/2"),
        ("support_shear_A", "x=0"),
        ("bending_moment", "x=L/2"),
    )
    entries = [entry(data, *key) for key in names]

    def measure(run: Run) -> Mapping[str, float]:
        length = np.pi * np.sqrt(10.0) / 2.0
        beam = Beam(length, p["E"] * p["I"], 1.0, 40, {"left": "pinned", "right": "pinned"})
        effects = [
            Foundation(beam, stiffness=p["K_foundation"]),
            PointLoad(beam.at(length / 2), -1e4),
            DistributedLoad(beam, -5000.0),
            PointMoment(beam.at("left"), -15000.0),
            PointMoment(beam.at("right"), 15000.0),
        ]
        rest = run.equilibrium(Scene([beam], effects))
        values = (
            rest.slope([0.0])[0],
            rest.deflection([length / 2])[0],
            simulate(Scene([beam], effects, initial=rest), 1e-3).reaction(beam, "left").force[0],
            rest.bending_moment([length / 2])[0],
        )
        return {_label(key): float(value) for key, value in zip(names, values, strict=True)}

    quantities = tuple(Quantity(_label(key), q["value"]) for key, q in zip(names, entries, strict=True))
    how = {"equilibrium": How(dict(zip((_label(key) for key in names), (5e-4, 2e-4, 2e-4, 5e-4), strict=True)))}
    return Case(None, "beam on a Winkler foundation", source(data), quantities, measure, how)
