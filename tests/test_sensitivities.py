"""Derivatives of runs through impacts, against an exact propagation in 300 bits (`data/README.md`)."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vofem as vf
from vofem import Parameter, sensitivities

DATA = Path(__file__).parent / "data" / "derivatives"

pytestmark = pytest.mark.kernels("plain")


def reference(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((DATA / f"{name}.json").read_text())
    return found


def mass_on_stop(p: dict[str, float], law: str, side: str) -> vf.Scene:
    mass = vf.Mass(p["m"], stiffness=p["k"], damping=p["d"], name="m")
    stop = vf.Contact(mass, gap=p["gap"], stiffness=p["K0"], damping=p["c"], side=side, acts_on=law, name="stop")
    load = vf.PointLoad(mass, vf.Sine(p["F"], p["om"], phase=p["ph"]))
    return vf.Scene([mass], [stop, load], initial={mass: (p["u0"], p["v0"])})


def mass_parameters(scene: vf.Scene) -> dict[str, Parameter]:
    mass, stop, load = scene.bodies[0], scene.effects[0], scene.effects[1]
    return {
        "gap": Parameter(stop, "gap"), "K0": Parameter("stop", "stiffness"), "c": Parameter(stop, "damping"),
        "m": Parameter(mass, "mass"), "k": Parameter("m", "stiffness"), "d": Parameter(mass, "damping"),
        "F": Parameter(load, "f.amplitude"), "om": Parameter(load, "f.omega"), "ph": Parameter(load, "f.phase"),
        "u0": Parameter(mass, "initial.displacement"), "v0": Parameter(mass, "initial.velocity"),
    }  # fmt: skip


def beam_between_stops(p: dict[str, float]) -> vf.Scene:
    beam = vf.Beam(
        p["L"], EI=[p["EI"] + p.get("dEI2", 0.0) * (k == 1) for k in range(5)],
        rhoA=[p["rA"] + p.get("drA2", 0.0) * (k == 1) for k in range(5)], elements=5, supports={"left": "clamped"},
        name="beam",
    )  # fmt: skip
    tip = beam.at(p["L"])
    first = vf.Contact(tip, gap=p["gap1"], stiffness=p["K1"], damping=p["c1"], side="below", acts_on="penetration",
                       name="one")  # fmt: skip
    second = vf.Contact(beam.at(0.6 * p["L"]), gap=p["gap2"], stiffness=p["K2"], damping=p["c2"], side="above",
                        acts_on="penetration", name="two")  # fmt: skip
    load = vf.PointLoad(tip, vf.Sine(p["F"], p["om"], phase=p["ph"]))
    return vf.Scene([beam], [first, second, load, vf.RayleighDamping(p["alpha"], p["beta"])])


def beam_parameters(scene: vf.Scene) -> dict[str, Parameter]:
    (beam,), (first, second, load, damping) = scene.bodies, scene.effects
    return {
        "EI": Parameter(beam, "EI"), "rA": Parameter(beam, "rhoA"), "dEI2": Parameter(beam, "EI", element=1),
        "drA2": Parameter(beam, "rhoA", element=1), "L": Parameter(beam, "length"), "dxr": Parameter(second, "x"),
        "gap1": Parameter(first, "gap"), "K1": Parameter(first, "stiffness"), "c1": Parameter(first, "damping"),
        "gap2": Parameter(second, "gap"), "K2": Parameter(second, "stiffness"), "c2": Parameter(second, "damping"),
        "F": Parameter(load, "f.amplitude"), "om": Parameter(load, "f.omega"), "ph": Parameter(load, "f.phase"),
        "alpha": Parameter(damping, "alpha"), "beta": Parameter(damping, "beta"),
    }  # fmt: skip


def rows_of(data: dict[str, Any], d: Any, points: dict[str, Any], contacts: list[str]) -> dict[str, np.ndarray]:
    """Return the rows of the reference by their names, as vofem gives them."""
    rows: dict[str, np.ndarray] = {}
    for name in data["names"]:
        kind, _, rest = name.partition(" @ t=")
        if rest:
            at = int(np.argmin(np.abs(np.array(data["times"]) - float(rest))))
            if kind == "dissipated":
                rows[name] = d.energy.dissipated[at]
            else:
                what = d.displacement if kind[0] == "u" else d.velocity
                rows[name] = what(points[kind[2:]])[at]
    count = dict.fromkeys(range(len(contacts)), (0, 0))
    for k, (_, contact, sign) in enumerate(data["events"]):
        closed, opened = count[contact]
        found = d.contacts[contacts[contact]]
        rows[data["names"][len(rows)]] = found.closings[closed] if sign > 0 else found.openings[opened]
        count[contact] = (closed + (sign > 0), opened + (sign < 0))
        assert data["names"][len(rows) - 1].startswith("t_close" if sign > 0 else "t_open"), k
    seen = dict.fromkeys(range(len(contacts)), 0)
    for name in data["names"]:
        if "of impact" not in name:
            continue
        contact = int(name.rstrip(")").rsplit(" ", 1)[1])
        impacts = d.contacts[contacts[contact]].impacts
        field = {"peak": "peak_force", "time": "peak_time", "impu": "impulse"}[name[:4]]
        rows[name] = getattr(impacts, field)[seen[contact]]
        seen[contact] += field == "impulse"
    return rows


def compare(data: dict[str, Any], rows: dict[str, np.ndarray], columns: list[str]) -> dict[str, float]:
    """Return the error of every row, relative to its largest entry."""
    chosen = [data["parameters"].index(column) for column in columns]
    errors = {}
    for name, whole in zip(data["names"], np.array(data["jacobian"]), strict=True):
        errors[name] = float(np.max(np.abs(rows[name] - whole[chosen])) / np.max(np.abs(whole[chosen])))
    return errors


@pytest.mark.parametrize("name", ["A1", "A2"])
def test_a_mass_on_a_stop_has_the_derivatives_of_the_exact_propagation(name: str) -> None:
    data = reference(name)
    scene = mass_on_stop(data["point"], data["scene"]["law"], data["scene"]["side"])
    run = vf.simulate(scene, data["T"], times=data["times"])
    parameters = mass_parameters(scene)
    d = sensitivities(run, [parameters[column] for column in data["parameters"]])
    errors = compare(data, rows_of(data, d, {"": scene.bodies[0]}, ["stop"]), data["parameters"])
    assert len(errors) == 37
    assert max(errors.values()) < 1e-11, errors
    assert d.work.exponentials == 0


def test_a_beam_between_two_stops_has_the_derivatives_of_the_exact_propagation() -> None:
    data = reference("B1")
    scene = beam_between_stops(data["point"])
    beam = scene.bodies[0]
    run = vf.simulate(scene, data["T"], times=data["times"])
    parameters = beam_parameters(scene)
    columns = [column for column in data["parameters"] if column != "dx"]
    d = sensitivities(run, [parameters[column] for column in columns])
    points = {"tip": beam.at(data["point"]["L"]), "mid": beam.at(0.6 * data["point"]["L"])}
    errors = compare(data, rows_of(data, d, points, ["one", "two"]), columns)
    assert len(errors) == 61
    assert max(errors.values()) < 1e-10, errors


# -- other scenes, against differences of runs ------------------------------------------------------------


def difference(parameter: Parameter, scene: vf.Scene, quantity: Any, step: float) -> np.ndarray:
    """Return a derivative by Richardson's extrapolation of central differences."""
    one, two = (
        (quantity(parameter.changed(scene, h)) - quantity(parameter.changed(scene, -h))) / (2.0 * h)
        for h in (step, 0.5 * step)
    )
    return np.asarray((4.0 * two - one) / 3.0)


def close_to_differences(scene: vf.Scene, parameters: list[Parameter], t_end: float, point: Any, share: float) -> Any:
    """Compare displacement, dissipation, times of events, peaks and impulses; return the derivatives."""
    times = np.linspace(0.0, t_end, 6)
    d = sensitivities(vf.simulate(scene, t_end, times=times, method="event_driven"), parameters)

    def quantities(changed: vf.Scene) -> np.ndarray:
        run = vf.simulate(changed, t_end, times=times, method="event_driven")
        body = next(body for body in changed.bodies if body.name == point.body.name)
        own: Any = body
        if isinstance(body, vf.Beam):
            own = body.at(point.x * body.length / point.body.length)
        parts = [run.displacement(own), run.energy.dissipated]
        for contact in run.contacts.values():
            impacts = contact.impacts
            parts += [contact.closings, contact.openings, impacts.peak_force, impacts.impulse]
        return np.concatenate(parts)

    mine = [d.displacement(point), d.energy.dissipated]
    for contact in d.contacts.values():
        mine += [contact.closings, contact.openings, contact.impacts.peak_force, contact.impacts.impulse]
    sizes = np.cumsum([part.shape[0] for part in mine])[:-1]
    for k, parameter in enumerate(parameters):
        value = parameter.value(scene)
        expected = np.split(difference(parameter, scene, quantities, 1e-4 * (abs(value) or 1.0)), sizes)
        for part, right in zip(mine, expected, strict=True):
            if right.size:
                size = max(float(np.max(np.abs(right))), 1e-12)
                assert np.allclose(part[:, k], right, rtol=0.0, atol=share * size), parameter.name
    return d


@pytest.mark.parametrize("elements", [60, 510])
def test_runs_in_ritz_vectors_have_the_derivatives_of_differences(elements: int) -> None:
    """By request of `truncation`, and above 1000 degrees of freedom by default."""
    beam = vf.Beam(1.0, EI=70.0, rhoA=0.5, elements=elements, supports={"left": "clamped"}, name="beam")
    tip = beam.at(1.0)
    stop = vf.Contact(tip, gap=0.01, stiffness=3000.0, damping=2.0, side="below", acts_on="penetration", name="stop")
    load = vf.PointLoad(tip, vf.Sine(4.0, frequency=5.0), name="load")
    scene = vf.Scene([beam], [stop, load, vf.ModalDamping(0.01, name="loss")])
    fields = (("beam", "EI"), ("stop", "stiffness"), ("load", "f.omega"))[: 3 if elements == 60 else 1]
    parameters = [Parameter(name, field) for name, field in fields]

    def run(changed: vf.Scene) -> vf.Result:
        truncation = {} if elements == 510 else {"truncation": 1e-4}
        return vf.simulate(changed, 0.3, times=np.linspace(0.0, 0.3, 7), method="event_driven", **truncation)

    def quantities(changed: vf.Scene) -> np.ndarray:
        found = run(changed)
        contact = found.contacts["stop"]
        return np.concatenate([found.displacement(tip), contact.closings, contact.openings])

    result = run(scene)
    kept = result.solution.truncation
    assert kept is not None
    assert kept.vectors < kept.unknowns == 2 * elements
    d = sensitivities(result, parameters)
    contact = d.contacts["stop"]
    assert contact.openings.size
    mine = np.concatenate([d.displacement(tip), contact.closings, contact.openings])
    for k, parameter in enumerate(parameters):
        expected = difference(parameter, scene, quantities, 1e-4 * parameter.value(scene))
        split = result.times.size
        # Terms of the stiffness of short elements cancel, which costs (1/510)^-3 roundings.
        share = 5e-7 if elements == 510 else 2e-9
        for part in (slice(split), slice(split, None)):
            assert np.allclose(mine[part, k], expected[part], rtol=0.0, atol=share * np.max(np.abs(expected[part]))), (
                parameter.name
            )
    assert any(note.startswith("truncation: derivatives are those of the run in its Ritz vectors") for note in d.notes)


def test_a_ball_that_bounces_has_derivatives_without_an_eigenbasis() -> None:
    ball = vf.Mass(1.0, name="ball")
    floor = vf.Contact(ball, gap=0.5, stiffness=5000.0, damping=3.0, side="below", acts_on="penetration", name="floor")
    weight = vf.Gravity(9.81)
    scene = vf.Scene([ball], [floor, weight])
    d = close_to_differences(
        scene, [Parameter(ball, "mass"), Parameter(floor, "gap"), Parameter(weight, "g")], 1.55, ball, 1e-7
    )
    assert d.work.exponentials > 0
    # The first impact comes when the ball has fallen by the gap.
    assert d.contacts["floor"].closings[0, 1] == pytest.approx(1.0 / np.sqrt(2.0 * 9.81 * 0.5), rel=1e-12)


def test_linked_parts_of_a_beam_and_a_mass_with_modal_damping() -> None:
    beam = vf.Beam(1.0, EI=10.0, rhoA=1.0, elements=4, supports={"left": "clamped"}, tension=2.0, name="beam")
    mass = vf.Mass(0.3, stiffness=40.0, name="mass")
    stop = vf.Contact(beam.at(0.77), mass, gap=0.01, stiffness=3000.0, damping=1.0, acts_on="penetration", name="stop")
    load = vf.PointLoad(beam.at(0.9), vf.Sine(3.0, 12.0) + vf.Ramp(1.0, 0.2, 0.5) + vf.Pulse(2.0, 0.3, 0.2))
    ratio, point = vf.ModalDamping(0.03), vf.PointMass(beam.at(1.0), mass=0.1)
    spring, dashpot = vf.Spring(beam.at(0.6), stiffness=50.0), vf.Dashpot(beam.at(0.4), mass, damping=0.2)
    scene = vf.Scene([beam, mass], [stop, load, ratio, point, spring, dashpot, vf.Gravity(1.0)])
    parameters = [
        Parameter(beam, "EI"), Parameter(beam, "rhoA", element=[2, 3]), Parameter(beam, "length"),
        Parameter(beam, "tension"), Parameter(ratio, "ratio"), Parameter(point, "mass"), Parameter(spring, "x"),
        Parameter([spring, mass], "stiffness"), Parameter(dashpot, "damping"), Parameter(stop, "x"),
        Parameter(load, "f.terms.1.slope"), Parameter(load, "f.terms.0.omega"), Parameter(load, "f.terms.2.amplitude"),
    ]  # fmt: skip
    d = close_to_differences(scene, parameters, 1.0, beam.at(0.63), 1e-6)
    assert d.names[1] == "beam.rhoA[2, 3]"
    assert d.units[:5] == ["N m^2", "kg/m", "m", "N", ""]


def test_a_contact_that_rests_at_its_gap_forgets_what_was_before() -> None:
    mass = vf.Mass(1.0, stiffness=10.0, damping=2.0, name="mass")
    stop = vf.Contact(mass, gap=0.1, stiffness=200.0, side="above", acts_on="displacement", name="stop")
    scene = vf.Scene([mass], [stop, vf.PointLoad(mass, 6.0)])
    run = vf.simulate(scene, 40.0, times=[10.0, 20.0, 39.0], method="event_driven", pin_fraction=1e-3)
    assert run.contacts["stop"].pinned.size
    d = sensitivities(run, [Parameter(stop, "gap"), Parameter(mass, "mass"), Parameter(stop, "stiffness")])
    assert np.allclose(d.displacement(mass)[-1], [1.0, 0.0, 0.0], atol=1e-12)
    assert np.allclose(d.velocity(mass)[-1], 0.0, atol=1e-12)
    # The reaction is the load less the force of the own spring.
    assert np.allclose(d.contacts["stop"].force[-1], [-10.0, 0.0, 0.0], atol=1e-9)


def test_scaling_identities_hold() -> None:
    data = reference("A1")
    scene = mass_on_stop(data["point"], data["scene"]["law"], data["scene"]["side"])
    run = vf.simulate(scene, data["T"], times=data["times"], method="event_driven")
    found = mass_parameters(scene)
    d = sensitivities(run, list(found.values()))
    values = np.array([parameter.value(scene) for parameter in found.values()])
    u = d.displacement(scene.bodies[0]) * values
    lengths = [list(found).index(name) for name in ("gap", "F", "u0", "v0")]
    forces = [list(found).index(name) for name in ("m", "k", "d", "K0", "c", "F")]
    # All lengths and forces times a factor: the motion is multiplied. All masses, stiffnesses and loads: it stays.
    assert np.allclose(u[:, lengths].sum(axis=1), run.displacement(scene.bodies[0]), rtol=0.0, atol=1e-12)
    assert np.allclose(u[:, forces].sum(axis=1), 0.0, atol=1e-12)


def test_a_damper_of_zero_has_a_derivative_to_one_side() -> None:
    mass = vf.Mass(1.0, stiffness=30.0, name="mass")
    stop = vf.Contact(mass, gap=0.02, stiffness=900.0, side="above", acts_on="penetration", name="stop")
    scene = vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(1.0, 4.0))])
    parameter = Parameter(stop, "damping")
    times = [1.0, 2.0]
    d = sensitivities(vf.simulate(scene, 2.0, times=times, method="event_driven"), parameter)

    def u(c: float) -> np.ndarray:
        return vf.simulate(parameter.changed(scene, c), 2.0, times=times, method="event_driven").displacement(mass)

    h = 1e-4
    ahead = (-u(2 * h) + 4 * u(h) - 3 * u(0.0)) / (2 * h)
    assert np.allclose(d.displacement(mass)[:, 0], ahead, rtol=0.0, atol=1e-6 * np.max(np.abs(ahead)))


def test_notes_tell_of_grazing_and_of_events_at_the_times_asked_for() -> None:
    mass = vf.Mass(1.0, stiffness=1.0, name="mass")
    fast = vf.Contact(mass, gap=0.5, stiffness=1.0, side="above", acts_on="displacement", name="fast")
    meets = float(np.arcsin(0.5))
    scene = vf.Scene([mass], [fast], initial={mass: (0.0, 1.0)})
    d = sensitivities(vf.simulate(scene, 1.0, times=[meets, 1.0], method="event_driven"), Parameter(fast, "gap"))
    assert any(note.startswith("one-sided") for note in d.notes)
    # The first impact is a grazing, the load makes later ones fast.
    gap = 1.0 - 1e-12
    slow = vf.Contact(mass, gap=gap, stiffness=1.0, side="above", acts_on="penetration", name="slow")
    push = vf.PointLoad(mass, vf.Pulse(3.0, 4.0, 2.0))
    grazing = vf.Scene([mass], [slow, push], initial={mass: (0.0, 1.0)})
    d = sensitivities(vf.simulate(grazing, 7.0, times=[7.0], method="event_driven"), Parameter(slow, "gap"))
    assert any(note.startswith("grazing") for note in d.notes)
    assert np.all(np.isfinite(d.displacement(mass)))
    calm = sensitivities(vf.simulate(scene, 1.0, times=[0.9], method="event_driven"), Parameter(fast, "gap"))
    assert calm.notes == []


def test_what_has_no_derivative_is_refused_by_name() -> None:
    beam = vf.Beam(1.0, EI=lambda x: 1.0 + x, rhoA=1.0, elements=4, supports={"left": "clamped"}, name="beam")
    load = vf.PointLoad(beam.at(1.0), vf.Sine(1.0, 3.0))
    stop = vf.Contact(beam.at(0.5), gap=0.1, stiffness=10.0, side="above", acts_on="penetration", name="stop")
    scene = vf.Scene([beam], [load, stop])
    run = vf.simulate(scene, 0.1, method="event_driven")
    with pytest.raises(vf.ArgumentError, match="EI is a Python function"):
        sensitivities(run, [Parameter(beam, "EI")])
    with pytest.raises(vf.ArgumentError, match="did you mean 'gap'"):
        sensitivities(run, [Parameter(stop, "gaps")])
    with pytest.raises(vf.ArgumentError, match="did you mean 'stop'"):
        sensitivities(run, [Parameter("stp", "gap")])
    with pytest.raises(vf.ArgumentError, match="no number by which to differentiate"):
        sensitivities(run, [Parameter(load, "f.frequency")])
    with pytest.raises(vf.ArgumentError, match="elements count from 0 to 3"):
        sensitivities(run, [Parameter(beam, "rhoA", element=4)])
    with pytest.raises(vf.ArgumentError, match="only for a Mass"):
        sensitivities(run, [Parameter(beam, "initial.velocity")])
    with pytest.raises(vf.ArgumentError, match=r"expected a list of vofem\.Parameter"):
        sensitivities(run, ["gap"])
    with pytest.raises(vf.ArgumentError, match="two increasing numbers"):
        Parameter(stop, "gap", bounds=(1.0, 0.0))
    stepped = vf.simulate(scene, 0.1, method="energy_conserving", dt=0.01)
    with pytest.raises(vf.MethodError, match="event_driven"):
        sensitivities(stepped, [Parameter(stop, "gap")])
    shaken = vf.Scene([beam], [vf.PointLoad(beam.at(1.0), lambda t: t), stop])
    with pytest.raises(vf.ArgumentError, match="f is a Python function"):
        Parameter(shaken.effects[0], "f.amplitude").check(shaken)


def test_a_mass_may_be_named_as_in_the_outcome() -> None:
    numbers = {"m": 1.0, "k": 4.0, "d": 0.1, "gap": 0.1, "K0": 9.0, "c": 0.0, "F": 1.0, "om": 1.0, "ph": 0.0}
    scene = mass_on_stop({**numbers, "u0": 0.0, "v0": 0.0}, "penetration", "above")
    for outcome in (vf.simulate(scene, 3.0), vf.periodic(scene), vf.equilibrium(scene, 1.0)):
        derived = sensitivities(outcome, [Parameter("stop", "gap"), Parameter("m", "mass")])
        assert np.array_equal(derived.displacement("m"), derived.displacement(scene.bodies[0]))


def test_value_and_at_refuse_what_is_no_number() -> None:
    beam = vf.Beam(1.0, EI=lambda x: 1.0 + x, rhoA=1.0, elements=3, supports={"left": "clamped"}, name="beam")
    slider = vf.Friction(beam.at(0.5), coefficient=0.3, normal=1.0, name="slider")
    bed = vf.Foundation(beam, stiffness=20.0, name="bed")
    load = vf.PointLoad(beam.at(1.0), vf.Sine(1.0, 2.0) + vf.Sine(2.0, 3.0))
    scene = vf.Scene([beam], [slider, load, bed])
    for parameter, message in (
        (Parameter(slider, "stiffness"), r"no number 'stiffness' .*; there are \['x'\]"),
        (Parameter(slider, "coefficient"), r"no number 'coefficient' .*; there are \['x'\]"),
        (Parameter(bed, "gap"), r"no number 'gap' .*; there are \['stiffness'\]"),
        (Parameter(load, "f.terms.2.amplitude"), r"'f\.terms\.2\.amplitude' is no number .* of Sum\("),
        (Parameter(load, "f.terms.\u00b2.amplitude"), "is no number"),
        (Parameter(beam, "EI"), "EI is a Python function"),
        (Parameter(beam, "nope"), "no number 'nope'"),
        (Parameter(beam, "rhoA", element=7), "there is no element 7; elements count from 0 to 2"),
    ):
        for refused in (parameter.check, parameter.value, lambda scene, p=parameter: p.at(scene, 1.0)):
            with pytest.raises(vf.ArgumentError, match=message):
                refused(scene)
    for element in ([], [0, 0]):
        with pytest.raises(vf.ArgumentError, match="expected one or more elements, each once"):
            Parameter(beam, "rhoA", element=element)


def test_both_places_of_a_rotational_spring_are_parameters() -> None:
    beam = vf.Beam(1.0, EI=5.0, rhoA=1.0, elements=3, supports={"left": "clamped"}, name="beam")
    spring = vf.RotationalSpring(beam.at(0.3), beam.at(0.6), stiffness=2.0)
    scene = vf.Scene([beam], [spring, vf.PointLoad(beam.at(1.0), vf.Sine(1.0, 9.0))])
    with pytest.raises(vf.ArgumentError, match=r"there is point\.x and other\.x"):
        Parameter(spring, "x").check(scene)
    places = [Parameter(spring, f"{name}.x") for name in ("point", "other")]
    close_to_differences(scene, places, 1.0, beam.at(1.0), 1e-6)


def test_elements_are_derivatives_of_their_sum() -> None:
    data = reference("B1")
    scene = beam_between_stops(data["point"])
    beam, tip = scene.bodies[0], scene.effects[0].a
    run = vf.simulate(scene, 0.3, times=[0.3], method="event_driven")
    each = sensitivities(run, [Parameter(beam, "EI", element=k) for k in range(5)]).displacement(tip)
    whole = sensitivities(run, Parameter(beam, "EI")).displacement(tip)
    assert np.allclose(each.sum(axis=1), whole[:, 0], rtol=1e-11)
    # Elements that share no node are assembled together; one alone has the same derivative.
    shaken = vf.Scene([beam], [*scene.effects, vf.Gravity()])
    run = vf.simulate(shaken, 0.3, times=[0.3], method="event_driven")
    every = sensitivities(run, [Parameter(beam, field, element=k) for field in ("EI", "rhoA") for k in range(5)])
    assert every.work.assemblies == 4
    for k in range(10):
        alone = sensitivities(run, every.parameters[k]).displacement(tip)[:, 0]
        assert np.allclose(every.displacement(tip)[:, k], alone, rtol=1e-12)


# -- statics and modes ------------------------------------------------------------------------------------


def test_natural_frequencies_have_the_derivatives_of_closed_forms() -> None:
    beam = vf.Beam(1.0, EI=10.0, rhoA=2.0, elements=8, supports={"left": "clamped"}, name="beam")
    modes = vf.modes(vf.Scene([beam]), 4)
    d = sensitivities(modes, [Parameter(beam, "EI"), Parameter(beam, "rhoA"), Parameter(beam, "length")])
    assert np.allclose(d.omega, modes.omega[:, None] * np.array([0.5 / 10.0, -0.5 / 2.0, -2.0]), rtol=1e-10)
    assert np.allclose(d.frequencies, d.omega / (2.0 * np.pi))


def test_frequencies_that_coincide_split_in_ascending_order() -> None:
    one, two = vf.Mass(1.0, stiffness=4.0, name="one"), vf.Mass(1.0, stiffness=4.0, name="two")
    d = sensitivities(vf.modes(vf.Scene([one, two])), [Parameter(one, "stiffness")])
    assert np.allclose(d.omega[:, 0], [0.0, 0.25], atol=1e-14)


@pytest.mark.parametrize("law", ["penetration", "displacement"])
@pytest.mark.parametrize("load", [6.0, 30.0])
def test_equilibria_have_the_derivatives_of_closed_forms(law: str, load: float) -> None:
    mass = vf.Mass(1.0, stiffness=10.0, name="mass")
    stop = vf.Contact(mass, gap=0.1, stiffness=200.0, side="above", acts_on=law, name="stop")
    push = vf.PointLoad(mass, vf.Sine(load, 0.0, phase=0.5 * np.pi))
    scene = vf.Scene([mass], [stop, push])
    parameters = [Parameter(mass, "stiffness"), Parameter(stop, "gap"), Parameter(stop, "stiffness"),
                  Parameter(push, "f.amplitude")]  # fmt: skip
    outcome = vf.equilibrium(scene)
    d = sensitivities(outcome, parameters)
    u = outcome.displacement(mass)
    pinned = law == "displacement" and load == 6.0
    lever = 0.1 if law == "penetration" else 0.0
    moved = [0.0, 1.0, 0.0, 0.0] if pinned else [-u, 200.0 * (law == "penetration"), lever - u, 1.0]
    assert np.allclose(d.displacement(mass), np.array(moved) / (1.0 if pinned else 210.0), atol=1e-14)
    balance = np.array([-u, 0.0, 0.0, 1.0]) - 10.0 * d.displacement(mass)
    assert np.allclose(d.contacts["stop"].force, balance, atol=1e-11)


def test_loads_and_attachments_are_found_by_their_names() -> None:
    mass = vf.Mass(1.0, stiffness=10.0, name="mass")
    scene = vf.Scene(
        [mass],
        [
            vf.PointLoad(mass, 3.0, name="push"), vf.PointLoad(mass, vf.Sine(1.0, frequency=0.5), name="shake"),
            vf.Spring(mass, stiffness=2.0, name="spring"), vf.Gravity(name="weight"),
        ],
    )  # fmt: skip
    run = vf.simulate(scene, 1.0, times=[0.7], method="event_driven")
    parameters = [
        Parameter("push", "f.value"), Parameter("shake", "f.amplitude"), Parameter("shake", "f.omega"),
        Parameter("spring", "stiffness"), Parameter("weight", "g"),
    ]  # fmt: skip
    d = sensitivities(run, parameters).displacement(mass)[0]
    still, w = 1.0 / 12.0 * (1.0 - np.cos(np.sqrt(12.0) * 0.7)), np.pi
    assert d[0] == pytest.approx(still, rel=1e-12)
    assert d[4] == pytest.approx(-still, rel=1e-12)
    root = np.sqrt(12.0)
    assert d[1] == pytest.approx((np.sin(w * 0.7) - w / root * np.sin(root * 0.7)) / (12.0 - w * w), rel=1e-11)
    changed = Parameter("shake", "f.omega").changed(scene, 0.1)
    assert changed.effects[1].f.omega == pytest.approx(np.pi + 0.1)


def test_a_contact_comes_to_rest_beside_a_dashpot():
    """As its motion ends, the dashpot pushes what else it holds; differences of runs say the same, and the adjoint."""

    def run(force: float) -> tuple[vf.Mass, Any]:
        a, b = vf.Mass(1.0, damping=2.5, name="a"), vf.Mass(1.0, stiffness=3.0, name="b")
        stop = vf.Contact(a, gap=0.1, stiffness=200.0, side="below", acts_on="displacement", name="stop")
        load = vf.PointLoad(b, vf.Sine(force, 2.0), name="load")
        scene = vf.Scene([a, b], [stop, vf.Dashpot(a, b, damping=1.5), vf.PointLoad(a, -10.0), load])
        return b, vf.simulate(scene, 3.0, times=[3.0], pin_fraction=0.1)

    b, result = run(0.3)
    assert result.contacts["stop"].pinned.size
    parameters, step = [Parameter("load", "f.amplitude")], 1e-5
    moved = sensitivities(result, parameters).displacement(b)[0, 0]
    ends = [one.displacement(body)[0] for body, one in (run(0.3 + step), run(0.3 - step))]
    assert moved == pytest.approx((ends[0] - ends[1]) / (2.0 * step), rel=1e-8)
    found = vf.gradient(result, vf.objectives.sum_of_squares(b, [3.0], [0.0]), parameters)
    assert found[0] == pytest.approx(2.0 * result.displacement(b)[0] * moved, rel=1e-12)


def test_derivatives_by_large_numbers_of_loads_are_not_zero() -> None:
    """A load of 1e18 N plus 1 N is the same load, and counted as one that does not hold the number."""
    found = []
    for mass in (1.0, 2.0**60):
        body = vf.Mass(mass, stiffness=mass, damping=0.1 * mass, name="m")
        stop = vf.Contact(body, gap=0.1, stiffness=8.0 * mass, side="above", acts_on="penetration", name="stop")
        scene = vf.Scene([body], [stop, vf.PointLoad(body, vf.Sine(mass, 1.3), name="load")])
        run = vf.simulate(scene, 6.0, times=[3.0, 6.0], method="event_driven")
        found.append(mass * vf.sensitivities(run, vf.Parameter("load", "f.amplitude")).displacement(body)[:, 0])
    np.testing.assert_allclose(found[1], found[0], rtol=1e-10)
    assert np.all(found[0] != 0.0)


@pytest.mark.parametrize(("kg", "s"), [(2.0**-40, 1.0), (1.0, 2.0**-40), (2.0**-20, 2.0**30)])
def test_derivatives_of_free_bodies_do_not_depend_on_the_units(kg: float, s: float) -> None:
    """Rigid motions have no eigenbasis; their exponentials lost up to all digits, or all memory to a long time."""

    def found(kg: float, s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        a, b = vf.Mass(kg, name="a"), vf.Mass(2.0 * kg, name="b")
        shock = vf.PointLoad(a, kg / s**2 * vf.Sine(1.0, 2.0 / s) + vf.Ramp(0.3 * kg / s**3, 0.5 * s, 3.0 * s))
        stop = vf.Contact(a, b, gap=1.0, stiffness=10.0 * kg / s**2, acts_on="penetration", name="stop")
        scene = vf.Scene([a, b], [vf.Dashpot(a, b, damping=kg / s, name="d"), shock, stop], {a: (0.0, 1.0 / s)})
        run = vf.simulate(scene, 4.0 * s, times=s * np.linspace(0.0, 4.0, 5), method="event_driven")
        parameters = [Parameter(a, "mass"), Parameter("d", "damping"), Parameter(stop, "stiffness")]
        units, each = np.array([kg, kg / s, kg / s**2]), sensitivities(run, parameters)
        assert run.contacts["stop"].closings.size
        impulse = vf.gradient(run, vf.objectives.impulse(stop), parameters)
        return (
            each.displacement(a) * units, each.energy.dissipated * units * s**2 / kg, impulse * units * s / kg
        )  # fmt: skip

    for mine, one in zip(found(kg, s), found(1.0, 1.0), strict=True):
        np.testing.assert_allclose(mine, one, rtol=0.0, atol=1e-12 * np.max(np.abs(one)))
