"""Derivatives of runs and orbits with impacts on rigid stops, beside differences of runs and closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_impact_orbits import closed, oscillator

import vofem as vf

DURATION = 6.0

#: What is changed: gap, restitution, load, stiffness, damping and mass.
NOMINAL = {"gap": 0.05, "restitution": 0.7, "load": 4.0, "stiffness": 30.0, "damping": 0.4, "mass": 1.1}


def scene(**changed: float) -> tuple[vf.Scene, list[vf.Parameter], vf.Mass]:
    """Return two masses with a stop at a wall and one between them, and the parameters."""
    value = {**NOMINAL, **changed}
    one = vf.Mass(value["mass"], stiffness=value["stiffness"], damping=value["damping"], name="one")
    two = vf.Mass(0.7, stiffness=10.0, damping=0.1, name="two")
    wall = vf.RigidStop(one, gap=value["gap"], restitution=value["restitution"], side="above", name="wall")
    load = vf.PointLoad(two, vf.Sine(value["load"], 5.0))
    between = vf.RigidStop(one, two, gap=0.02, restitution=0.9, name="between")
    effects: list[Any] = [vf.Spring(one, two, stiffness=20.0), wall, between, load]
    parameters = [
        vf.Parameter(wall, "gap"), vf.Parameter(wall, "restitution"), vf.Parameter(load, "f.amplitude"),
        vf.Parameter(one, "stiffness"), vf.Parameter(one, "damping"), vf.Parameter(one, "mass"),
    ]  # fmt: skip
    return vf.Scene([one, two], effects), parameters, one


def run(**changed: float) -> vf.Result:
    """Return a run."""
    return vf.simulate(scene(**changed)[0], DURATION, method="event_driven", times=np.linspace(0.0, DURATION, 50))


def differences(read: Any, **base: float) -> np.ndarray:
    """Return the derivatives by all numbers, by central differences of fourth order."""
    columns = []
    for name, value in {**NOMINAL, **base}.items():
        if name == "restitution" and not value:
            continue
        step = 1e-4 * (abs(value) or 1.0)
        near, far = ((read(run(**{**base, name: value + k * step})) - read(run(**{**base, name: value - k * step})))
                     / (2.0 * k * step) for k in (1, 2))  # fmt: skip
        columns.append((4.0 * near - far) / 3.0)
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("restitution", [0.7, 0.0])
def test_derivatives_of_a_run_agree_with_differences(restitution: float) -> None:
    """Motion, times and impulses of impacts; without restitution the body rests at the wall and is let go again."""
    base = {"restitution": restitution}
    model, parameters, one = scene(**base)
    result = vf.simulate(model, DURATION, method="event_driven", times=np.linspace(0.0, DURATION, 50))
    if not restitution:
        assert len(result.contacts["wall"].pinned)
        # A body that rests at once has no derivative by a restitution that cannot be negative.
        parameters = [each for each in parameters if each.field != "restitution"]
    found = vf.sensitivities(result, parameters)

    def displacement(other: vf.Result) -> np.ndarray:
        return other.displacement(other.scene.bodies[0])

    def checked(mine: np.ndarray, read: Any, tolerance: float = 2e-7) -> None:
        expected = differences(read, **base)
        np.testing.assert_allclose(mine, expected, atol=tolerance * np.abs(expected).max())

    checked(found.displacement(one), displacement)
    checked(found.contacts["wall"].closings, lambda other: other.contacts["wall"].closings)
    checked(found.contacts["wall"].impacts.impulse, lambda other: other.contacts["wall"].impacts.impulse)
    assert np.all(np.isnan(found.contacts["wall"].impacts.peak_force))
    times, data = np.linspace(0.3, DURATION, 20), np.linspace(-0.02, 0.03, 20)
    objective = vf.objectives.sum_of_squares(one, times, data)
    gradient = vf.gradient(result, objective, parameters)
    apart = result.displacement(one, times) - data
    forward = 2.0 * apart @ found.displacement(one, times)
    np.testing.assert_allclose(gradient, forward, rtol=1e-10, atol=1e-11 * np.abs(forward).max())
    for refused in (
        lambda: found.energy,
        lambda: vf.gradient(result, vf.objectives.dissipated(), parameters),
        lambda: vf.gradient(result, vf.objectives.peak_force("wall"), parameters),
        lambda: vf.gradient(result, vf.objectives.impulse("wall"), parameters),
    ):
        with pytest.raises(vf.MethodError, match="RigidStop 'wall'"):
            refused()


def test_a_damper_that_an_impact_elsewhere_turns_around_has_the_derivatives_of_differences() -> None:
    """Its force jumps at impacts of the body on a rigid stop, whose times move; of some of them it is largest there."""

    def pressed(gap: float) -> tuple[Any, Any]:
        body = vf.Mass(1.0, stiffness=20.0, name="body")
        wall = vf.RigidStop(body, gap=gap, restitution=0.8, side="above", name="wall")
        pad = vf.Contact(body, gap=0.05, stiffness=50.0, damping=6.0, side="above", acts_on="penetration", name="pad")
        scene = vf.Scene([body], [pad, wall, vf.PointLoad(body, vf.Sine(15.0, 3.0))], {body: (0.0, 2.0)})
        result = vf.simulate(scene, 3.0, method="event_driven", times=[0.0])
        return result.contacts["pad"].impacts, vf.sensitivities(result, [vf.Parameter(wall, "gap")])

    impacts, found = pressed(0.2)
    near, far = ([pressed(0.2 + sign * step)[0] for sign in (1.0, -1.0)] for step in (1e-5, 2e-5))
    for name in ("impulse", "peak_force"):
        one, two = ((getattr(a, name) - getattr(b, name)) / step for (a, b), step in ((near, 2e-5), (far, 4e-5)))
        mine = getattr(found.contacts["pad"].impacts, name)[:, 0]
        np.testing.assert_allclose(mine, (4.0 * one - two) / 3.0, rtol=1e-6, atol=1e-7)
    at_wall = np.isin(impacts.peak_time, pressed(0.2)[1].result.contacts["wall"].closings)
    assert at_wall.any()
    assert not at_wall.all()


@pytest.mark.parametrize("restitution", [0.6, 0.0])
def test_a_body_that_rests_on_the_floor_from_the_start_is_struck(restitution: float) -> None:
    """The ball that strikes it is thrown back after several impacts at one time, at which the floor is hit too."""

    def struck(height: float) -> tuple[vf.Result, list[vf.Mass]]:
        body, ball = vf.Mass(1.0, name="body"), vf.Mass(0.7, name="ball")
        floor = vf.RigidStop(body, gap=0.0, restitution=restitution, side="below", name="floor")
        hit = vf.RigidStop(body, ball, gap=0.1, restitution=0.6, name="hit")
        scene = vf.Scene([body, ball], [vf.Gravity(9.81), floor, hit], {body: (0.0, 0.0), ball: (height, 0.0)})
        return vf.simulate(scene, 0.32, method="event_driven", times=[0.2, 0.3]), [body, ball]

    result, bodies = struck(0.3)
    assert result.contacts["floor"].pinned[0, 0] == 0.0
    found = vf.sensitivities(result, [vf.Parameter("ball", "initial.displacement")])
    ends = [struck(0.3 + step)[0] for step in (1e-6, -1e-6)]
    for k, body in enumerate(bodies):
        one, two = (each.displacement(each.scene.bodies[k]) for each in ends)
        np.testing.assert_allclose(found.displacement(body)[:, 0], (one - two) / 2e-6, atol=1e-8)
    one, two = (each.contacts["hit"].closings for each in ends)
    np.testing.assert_allclose(found.contacts["hit"].closings[:, 0], (one - two) / 2e-6, rtol=1e-7)


def test_bodies_that_hit_stops_at_the_same_time_have_the_derivatives_of_one_alone() -> None:
    """One of them bounces, the other one comes to rest."""
    pair = [vf.Mass(1.0, stiffness=20.0, damping=0.3, name=name) for name in ("one", "two")]
    stops = [vf.RigidStop(body, gap=0.1, restitution=e, side="above", name=f"stop of {body.name}")
             for body, e in zip(pair, (0.6, 0.0), strict=True)]  # fmt: skip
    loads = [vf.PointLoad(body, vf.Sine(9.0, 4.0)) for body in pair]
    found = []
    for count in (1, 2):
        scene = vf.Scene(pair[:count], [*stops[:count], *loads[:count]], {body: (0.0, 1.0) for body in pair[:count]})
        result = vf.simulate(scene, 4.0, method="event_driven", times=np.linspace(0.0, 4.0, 21))
        found.append(vf.sensitivities(result, [vf.Parameter("one", "stiffness"), vf.Parameter("stop of one", "gap")]))
    alone, both = found
    np.testing.assert_allclose(both.displacement(pair[0]), alone.displacement(pair[0]), atol=1e-11)
    stop = [each.contacts["stop of one"] for each in found]
    np.testing.assert_allclose(stop[1].closings, stop[0].closings, atol=1e-9)
    np.testing.assert_allclose(stop[1].impacts.impulse, stop[0].impacts.impulse, atol=1e-9)
    assert not np.any(both.displacement(pair[1]))


def test_bodies_that_come_to_rest_at_the_same_time_have_impulses_of_their_own() -> None:
    """The impulse of each stop depends on its own body alone, as where there is one body only."""

    def impulses(count: int) -> np.ndarray:
        pair = [vf.Mass(1.0, stiffness=20.0, damping=0.3, name=f"mass {k}") for k in range(count)]
        stops = [
            vf.RigidStop(body, gap=0.1, restitution=0.0, side="above", name=f"stop {k}") for k, body in enumerate(pair)
        ]
        loads = [vf.PointLoad(body, vf.Sine(9.0, 4.0)) for body in pair]
        result = vf.simulate(vf.Scene(pair, [*stops, *loads]), 0.5, method="event_driven", times=[0.0])
        assert all(len(result.contacts[stop.name].pinned) == 1 for stop in stops)
        parameters = [vf.Parameter(thing, field) for k in range(count) for thing, field in (
            (stops[k], "gap"), (pair[k], "mass"), (loads[k], "f.amplitude")
        )]  # fmt: skip
        found = vf.sensitivities(result, parameters)
        return np.stack([found.contacts[stop.name].impacts.impulse[0] for stop in stops])

    alone, both = impulses(1)[0], impulses(2)
    np.testing.assert_allclose(both, np.kron(np.eye(2), alone), atol=1e-12 * np.abs(alone).max())


def test_a_force_that_jumps_lets_go_of_what_rests_and_moves_its_release() -> None:
    """Two masses move as one until one of them meets a contact whose force jumps, which parts them at once."""

    def parted(stiffness: float) -> vf.Result:
        left, right = (
            vf.Mass(0.95, stiffness=27.0, damping=0.3, name="left"),
            vf.Mass(0.87, stiffness=17.6, name="right"),
        )
        stop = vf.RigidStop(right, gap=0.068, restitution=0.4, side="above", name="stop")
        jump = vf.Contact(
            right, gap=0.059, stiffness=82.0, damping=1.0, side="below", acts_on="displacement", name="jump"
        )
        between = vf.RigidStop(left, right, gap=0.022, restitution=0.0, name="between")
        load = vf.PointLoad(right, vf.Sine(4.0, 8.0))
        effects = [vf.Spring(left, right, stiffness=stiffness), stop, jump, between, load]
        return vf.simulate(
            vf.Scene([left, right], effects), 0.8, method="event_driven", times=np.linspace(0.0, 0.8, 25)
        )

    result, step = parted(16.0), 1e-5
    events = result.solution.events
    closing = np.flatnonzero(events.contact == 1)[0]
    assert events.contact[closing + 1] == 2
    assert events.time[closing + 1] == events.time[closing]
    found = vf.sensitivities(result, [vf.Parameter(result.scene.effects[0], "stiffness")])
    above, below = parted(16.0 + step), parted(16.0 - step)
    body = result.scene.bodies[0]
    for mine, one, two in (
        (found.displacement(body), *(each.displacement(each.scene.bodies[0]) for each in (above, below))),
        (
            found.contacts["between"].impacts.opening,
            *(each.contacts["between"].impacts.opening for each in (above, below)),
        ),
    ):
        expected = (one - two) / (2.0 * step)
        np.testing.assert_allclose(mine[:, 0], expected, atol=1e-7 * np.abs(expected).max())
    objective = vf.objectives.sum_of_squares(body, result.times, np.zeros(result.times.size))
    gradient = vf.gradient(result, objective, found.parameters)
    np.testing.assert_allclose(gradient, 2.0 * result.displacement(body) @ found.displacement(body), rtol=1e-10)


@pytest.mark.parametrize("cause", ["another contact", "a load"])
def test_jumps_of_force_let_go_of_all_that_rests_at_their_own_time(cause: str) -> None:
    """A jump lifts a body off another one, which its own load then lifts off the floor; the jump of a load is fixed."""

    def parted(speed: float) -> vf.Result:
        low, high, striker = (vf.Mass(1.0, stiffness=k, damping=0.1, name=f"k = {k:g}") for k in (3.0, 4.0, 5.0))
        floor = vf.RigidStop(low, gap=0.0, restitution=0.0, side="below", name="floor")
        between = vf.RigidStop(low, high, gap=0.0, restitution=0.0, name="between")
        jump = vf.Contact(striker, high, gap=0.1, stiffness=90.0, acts_on="displacement", name="jump")
        push = vf.Pulse(6.0, 0.15, 1.0) if cause == "a load" else vf.Constant(0.0)
        loads = [vf.PointLoad(low, vf.Constant(1.0) + vf.Sine(0.5, 3.0)), vf.PointLoad(high, vf.Constant(-2.0) + push)]
        effects: list[Any] = [floor, between, vf.Spring(low, striker, stiffness=0.2), *loads]
        if cause == "another contact":
            effects.append(jump)
        return vf.simulate(
            vf.Scene([low, high, striker], effects, {low: (0.0, 0.0), high: (0.0, 0.0), striker: (0.0, speed)}), 0.35,
            method="event_driven", times=np.linspace(0.0, 0.35, 15),
        )  # fmt: skip

    result, above, below = (parted(1.0 + step) for step in (0.0, 1e-5, -1e-5))
    releases = [result.contacts[name].pinned[0, 1] for name in ("floor", "between")]
    assert releases[0] == releases[1]
    assert cause != "a load" or releases[0] == 0.15
    striker = result.scene.bodies[2]
    found = vf.sensitivities(result, [vf.Parameter(striker, "initial.velocity")])
    for name in ("floor", "between"):
        expected = (above.contacts[name].pinned[0, 1] - below.contacts[name].pinned[0, 1]) / 2e-5
        assert found.contacts[name].impacts.opening[0, 0] == pytest.approx(expected, abs=1e-9)
    for k, body in enumerate(result.scene.bodies):
        one, two = (each.displacement(each.scene.bodies[k]) for each in (above, below))
        np.testing.assert_allclose(found.displacement(body)[:, 0], (one - two) / 2e-5, atol=1e-9)
    low = result.scene.bodies[0]
    objective = vf.objectives.sum_of_squares(low, result.times, np.zeros(result.times.size))
    gradient = vf.gradient(result, objective, found.parameters)
    np.testing.assert_allclose(gradient, 2.0 * result.displacement(low) @ found.displacement(low), rtol=1e-7)


def test_a_bouncing_ball_has_the_derivatives_of_its_closed_form() -> None:
    """Times t_n = t_0 (1 + 2 e (1 - e^n)/(1 - e)), up to their accumulation, by e, g's load and the height."""
    e, height, g, mass = 0.6, 0.5, 9.81, 1.3
    ball = vf.Mass(mass, name="ball")
    floor = vf.RigidStop(ball, gap=height, restitution=e, side="below", name="floor")
    weight = vf.PointLoad(ball, vf.Constant(-mass * g))
    result = vf.simulate(vf.Scene([ball], [weight, floor]), 2.0, method="event_driven")
    found = vf.sensitivities(result, [vf.Parameter(floor, "restitution"), vf.Parameter(floor, "gap")])
    times = result.contacts["floor"].closings
    n = np.arange(20)
    first = np.sqrt(2.0 * height / g)
    by_e = first * 2.0 * np.array([sum((k + 1) * e**k for k in range(one)) for one in n.tolist()])
    np.testing.assert_allclose(found.contacts["floor"].closings[:20, 0], by_e, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(found.contacts["floor"].closings[:20, 1], times[:20] / (2.0 * height), rtol=1e-9)
    # Where impacts accumulate, at t_0 (1 + e)/(1 - e); it rests from a billionth of the first speed on.
    np.testing.assert_allclose(
        found.contacts["floor"].closings[-1], [2.0 * first / (1.0 - e) ** 2, times[-1] / (2.0 * height)], rtol=1e-6
    )


def test_derivatives_of_an_orbit_agree_with_its_closed_form() -> None:
    """The time and the place of an orbit with one impact by gap and load; the fold's gap scales with the load."""
    omega, gap = 2.6, -0.2
    orbit = vf.periodic(oscillator(omega, gap))
    mass, (stop, load) = orbit.scene.bodies[0], orbit.scene.effects
    found = vf.sensitivities(orbit, [vf.Parameter(stop, "gap"), vf.Parameter(load, "f.amplitude")])
    # Displacements are linear in gap and load together: u = gap du/dgap + F du/dF.
    both = found.displacement(mass)
    np.testing.assert_allclose(gap * both[:, 0] + both[:, 1], orbit.result.displacement(mass), atol=1e-12)
    step = 1e-4
    near, far = ((vf.periodic(oscillator(omega, gap + k * step), guess=orbit).result.displacement(mass)
                  - vf.periodic(oscillator(omega, gap - k * step), guess=orbit).result.displacement(mass))
                 / (2.0 * k * step) for k in (1, 2))  # fmt: skip
    np.testing.assert_allclose(both[:, 0], (4.0 * near - far) / 3.0, atol=1e-8)
    assert closed(omega).speeds(gap)[1] == pytest.approx(orbit.result.contacts["stop"].impacts.approach_speed[0])
    with pytest.raises(vf.MethodError, match="rigid stops have no second derivatives"):
        _ = found.multipliers


def test_a_fold_of_orbits_with_impacts_moves_with_the_load() -> None:
    """The gap at the fold is in proportion to the load, and so is that at the grazing."""
    branch = vf.continuation(lambda gap: oscillator(1.7, gap), 0.3, 1.2)
    assert [mark.kind for mark in branch.special] == ["fold", "grazing"]
    for mark in branch.special:
        stop, load = mark.orbit.scene.effects
        found = vf.sensitivities(mark, [vf.Parameter(load, "f.amplitude")], along=vf.Parameter(stop, "gap"))
        assert found.value[0] == pytest.approx(mark.value, rel=1e-8)
