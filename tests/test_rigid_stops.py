"""Rigid stops with a coefficient of restitution, against closed forms and an integration that is written here."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import vofem as vf
from vofem.io import plot

G, HEIGHT = 9.81, 0.5


def dropped(
    restitution: float, mass: float = 1.3, duration: float = 4.0, **options: object
) -> tuple[vf.Result, vf.Mass]:
    """Return the run of a ball that falls on a floor, without any spring."""
    ball = vf.Mass(mass, name="ball")
    floor = vf.RigidStop(ball, gap=0.0, restitution=restitution, side="below", name="floor")
    scene = vf.Scene([ball], [vf.Gravity(G), floor], initial={ball: (HEIGHT, 0.0)})
    return vf.simulate(scene, duration, method="event_driven", times=np.linspace(0.0, duration, 101), **options), ball


def test_a_bouncing_ball_follows_its_closed_form_until_it_rests() -> None:
    """Bounce times t_n = t_0 (1 + 2 e (1 - e^n)/(1 - e)), which accumulate at (1 + e)/(1 - e) sqrt(2 h/g)."""
    e, mass = 0.8, 1.3
    result, ball = dropped(e)
    impacts = result.contacts["floor"].impacts
    first = np.sqrt(2.0 * HEIGHT / G)
    n = np.arange(len(impacts) - 1)
    assert len(impacts) > 90
    np.testing.assert_allclose(impacts.closing[:-1], first * (1.0 + 2.0 * e * (1.0 - e**n) / (1.0 - e)), rtol=1e-14)
    np.testing.assert_array_equal(impacts.closing[:-1], impacts.opening[:-1])
    assert impacts.closing[-1] == pytest.approx(first * (1.0 + e) / (1.0 - e), rel=2e-9)
    speed = np.sqrt(2.0 * G * HEIGHT) * e**n
    np.testing.assert_allclose(impacts.approach_speed[:40], speed[:40], rtol=1e-10)
    np.testing.assert_allclose(impacts.departure_speed[:40], e * speed[:40], rtol=1e-10)
    np.testing.assert_allclose(impacts.impulse[:40], (1.0 + e) * mass * speed[:40], rtol=1e-10)
    np.testing.assert_allclose(impacts.work[:40], 0.5 * mass * speed[:40] ** 2, rtol=1e-10)
    np.testing.assert_allclose(impacts.absorbed[:40], 0.5 * mass * speed[:40] ** 2 * (1.0 - e**2), rtol=1e-10)
    assert np.all(np.isinf(impacts.peak_force[:-1]))
    # It rests exactly, and the floor carries its weight.
    assert result.displacement(ball)[-1] == 0.0
    assert result.velocity(ball)[-1] == 0.0
    assert result.contacts["floor"].force[-1] == pytest.approx(mass * G, rel=1e-13)
    assert not impacts.ended[-1]
    assert impacts.peak_force[-1] == pytest.approx(mass * G, rel=1e-12)
    assert any("accumulate" in note and "floor" in note for note in result.notes)
    assert result.energy.balance_error < 1e-14
    # It has no stiffness to draw.
    assert len(np.ravel(plot.time_history(result, ball))) == 1
    statistics = result.contacts["floor"].statistics()
    # The mean force carries the weight: momentum changes by nothing over the whole run.
    assert statistics.impulse == pytest.approx(mass * G * 4.0, rel=1e-12)
    assert statistics.absorbed == pytest.approx(mass * G * HEIGHT, rel=1e-12)


def test_without_restitution_the_ball_stays_at_once_and_with_all_of_it_for_ever() -> None:
    """e = 0 is pinned at its first touch; e = 1 keeps all energy and bounces to the same height."""
    plastic, ball = dropped(0.0)
    floor = plastic.contacts["floor"]
    np.testing.assert_allclose(floor.pinned, [[np.sqrt(2.0 * HEIGHT / G), 4.0]], rtol=1e-15)
    assert len(floor.impacts) == 1
    assert floor.impacts.impulse[0] == pytest.approx(1.3 * G * 4.0, rel=1e-12)
    assert plastic.energy.balance_error < 1e-14
    elastic, ball = dropped(1.0)
    n = np.arange(len(elastic.contacts["floor"].impacts))
    assert n.size == 6
    first = np.sqrt(2.0 * HEIGHT / G)
    np.testing.assert_allclose(elastic.contacts["floor"].impacts.closing, first * (1.0 + 2.0 * n), rtol=1e-13)
    assert elastic.energy.balance_error < 1e-14
    assert elastic.displacement(ball).min() >= 0.0


def test_a_ball_at_rest_stays_and_is_lifted_when_the_load_says_so() -> None:
    """At rest on the floor it is pinned from the start; a ramp lifts it when it exceeds the weight."""
    ball = vf.Mass(2.0, name="ball")
    floor = vf.RigidStop(ball, gap=0.0, restitution=0.5, side="below", name="floor")
    lift = vf.PointLoad(ball, vf.Ramp(10.0))
    result = vf.simulate(vf.Scene([ball], [vf.Gravity(G), floor, lift]), 5.0, method="event_driven")
    begin, end = result.contacts["floor"].pinned[0]
    assert begin == 0.0
    assert end == pytest.approx(1.962, rel=1e-13)
    late = 5.0 - 1.962
    assert result.displacement(ball)[-1] == pytest.approx(10.0 * late**3 / 12.0, rel=1e-12)


def test_a_load_that_begins_on_a_mass_at_its_stop_presses_it_on() -> None:
    """Nothing pushes at t = 0. The first force that grows decides: towards the stop it is pinned, away it leaves."""
    for sign in (1.0, -1.0):
        mass = vf.Mass(1.0, stiffness=1.0, damping=0.05, name="mass")
        wall = vf.RigidStop(mass, gap=0.0, restitution=0.7, side="above", name="wall")
        result = vf.simulate(
            vf.Scene([mass], [wall, vf.PointLoad(mass, vf.Sine(sign, 2.0))]), 3.0, method="event_driven"
        )
        pinned = result.contacts["wall"].pinned
        if sign > 0.0:
            np.testing.assert_allclose(pinned[0], [0.0, 0.5 * np.pi], rtol=1e-12)
        else:
            assert not np.any(pinned == 0.0)
            assert result.displacement(mass)[100] < 0.0
        assert result.displacement(mass).max() < 1e-14


def test_masses_exchange_their_velocities_one_impact_after_the_other() -> None:
    """Newton's cradle: three equal masses that touch; the last one leaves with the speed of the first."""
    masses = [vf.Mass(1.0, name=f"m{k}") for k in range(3)]
    stops = [vf.RigidStop(masses[0], masses[1], gap=0.1, restitution=1.0, name="first"),
             vf.RigidStop(masses[1], masses[2], gap=0.0, restitution=1.0, name="second")]  # fmt: skip
    scene = vf.Scene(masses, stops, initial={masses[0]: (0.0, 2.0)})
    result = vf.simulate(scene, 1.0, method="event_driven", times=np.array([0.0, 0.04, 0.06, 1.0]))
    velocities = np.array([result.velocity(mass) for mass in masses])
    np.testing.assert_allclose(velocities[:, 1], [2.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(velocities[:, 2:], [[0.0, 0.0], [0.0, 0.0], [2.0, 2.0]], atol=1e-15)
    assert result.contacts["first"].impacts.closing == pytest.approx([0.05], rel=1e-15)
    assert result.contacts["second"].impacts.closing == pytest.approx([0.05], rel=1e-15)
    assert result.energy.balance_error < 1e-14


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("count", [5, 6, 9])
def test_rounding_of_impacts_is_no_impact(count: int, compiled: bool) -> None:
    """Bodies that an impact has left at rest but for rounding neither bounce off each other nor press on each other."""
    masses = [vf.Mass(1.0, stiffness=1.0, name=f"m{k}") for k in range(count)]
    stops = [vf.RigidStop(a, b, gap=0.0, restitution=1.0) for a, b in itertools.pairwise(masses)]
    scene = vf.Scene(masses, stops, initial={masses[-1]: (0.3, 0.0)})
    result = vf.simulate(scene, 10.0, method="event_driven", compiled=compiled)
    assert [len(contact.impacts) for contact in result.contacts.values()] == [3] * (count - 1)
    assert not any(contact.pinned.size for contact in result.contacts.values())
    assert not result.notes
    assert result.displacement(masses[0])[-1] == pytest.approx(0.3 * np.cos(10.0), rel=1e-12)


def test_what_is_pressed_on_its_stop_by_another_body_at_rest_stays_there_from_the_start() -> None:
    """The lower body's own load lifts it, and what lies on it is heavier. It rested 1e-17 s late, after an impact."""
    low, high = vf.Mass(1.0, name="low"), vf.Mass(1.0, name="high")
    floor = vf.RigidStop(low, gap=0.0, restitution=0.0, side="below", name="floor")
    between = vf.RigidStop(low, high, gap=0.0, restitution=0.0, name="between")
    loads = [vf.PointLoad(low, 1.0), vf.PointLoad(high, -2.0)]
    result = vf.simulate(vf.Scene([low, high], [floor, between, *loads]), 1.0, method="event_driven")
    for name, force in (("floor", 1.0), ("between", 2.0)):
        np.testing.assert_array_equal(result.contacts[name].pinned, [[0.0, 1.0]])
        np.testing.assert_allclose(result.contacts[name].force, force, rtol=1e-12)
    assert result.counters.steps == 1


@pytest.mark.parametrize("compiled", [False, True])
def test_bodies_that_a_plastic_impact_joins_press_on_each_other_by_what_they_do_together(compiled: bool) -> None:
    """Alone the third body would slow down as the last one does; the free one beside it presses it on."""
    masses = [
        vf.Mass(m, stiffness=k, name=f"m{j}")
        for j, (m, k) in enumerate([(1.0, 1.0), (2.0, 0.0), (1.0, 1.0), (1.0, 1.0)])
    ]
    stops = [vf.RigidStop(a, b, gap=0.0, restitution=0.0) for a, b in itertools.pairwise(masses)]
    scene = vf.Scene(masses, stops, initial={masses[0]: (0.0, 1.0)})
    result = vf.simulate(scene, 0.5, method="event_driven", compiled=compiled, max_events=400)
    # The first one leaves at once. The others share its momentum: 1/5 of its speed, with 2/4 of its stiffness.
    joined, w = result.displacement(masses[3])[-1], np.sqrt(0.5)
    assert joined == pytest.approx(result.displacement(masses[1])[-1], abs=1e-12)
    assert joined == pytest.approx(0.2 * np.sin(0.5 * w) / w, rel=1e-9)


def test_at_equal_speeds_the_stop_acts_that_the_scene_has_first_and_those_without_restitution_act_last() -> None:
    """Two stops at one place: the speed after the impact tells which of them has acted."""
    mass = vf.Mass(1.0, name="mass")
    for first, second, acts in ((0.5, 0.8, 0.5), (0.8, 0.5, 0.8), (0.0, 0.8, 0.8), (0.8, 0.0, 0.8)):
        stops = [vf.RigidStop(mass, gap=1.0, restitution=e, side="above", name=f"e{e}") for e in (first, second)]
        scene = vf.Scene([mass], stops, initial={mass: (0.0, 1.0)})
        assert vf.simulate(scene, 2.0, method="event_driven").velocity(mass)[-1] == pytest.approx(-acts, rel=1e-12)


def test_endless_bounces_are_refused_with_the_restitution() -> None:
    """What helps against chatter of the displacement law is no advice for a rigid stop."""
    ball = vf.Mass(1.0, name="ball")
    floor = vf.RigidStop(ball, gap=0.0, restitution=0.999, side="below", name="floor")
    scene = vf.Scene([ball], [floor, vf.Gravity(9.81)], initial={ball: (1e-3, 0.0)})
    with pytest.raises(vf.EventStormError, match=r"most of them of RigidStop 'floor'.*, here 0\.999,") as told:
        vf.simulate(scene, 100.0, max_events=20)
    assert "pin_fraction" not in str(told.value)


def test_two_masses_between_walls_agree_with_an_integration_written_for_them() -> None:
    """Masses, springs and dashpots between rigid stops, against DOP853 with impacts by events."""
    one = vf.Mass(1.0, stiffness=30.0, damping=0.2, name="one")
    two = vf.Mass(0.7, stiffness=10.0, name="two")
    effects = [
        vf.Spring(one, two, stiffness=20.0),
        vf.RigidStop(one, gap=0.05, restitution=0.7, side="above", name="wall"),
        vf.RigidStop(one, two, gap=0.02, restitution=0.9, name="between"),
        vf.PointLoad(two, vf.Sine(4.0, 5.0)),
    ]
    scene, t_end = vf.Scene([one, two], effects), 6.0
    result = vf.simulate(scene, t_end, method="event_driven", times=np.linspace(0.0, t_end, 301))
    rows = np.array([[1.0, 0.0], [1.0, -1.0]])
    gaps, back, mass = np.array([0.05, 0.02]), np.array([0.7, 0.9]), np.array([1.0, 0.7])

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        q, v = y[:2], y[2:]
        force = np.array([-30.0 * q[0] - 0.2 * v[0], -10.0 * q[1] + 4.0 * np.sin(5.0 * t)])
        force += 20.0 * (q[1] - q[0]) * np.array([1.0, -1.0])
        return np.concatenate([v, force / mass])

    def touch(j: int) -> object:
        def function(t: float, y: np.ndarray) -> float:
            return float(rows[j] @ y[:2] - gaps[j])

        function.terminal, function.direction = True, 1.0  # type: ignore[attr-defined]
        return function

    t, y, times, found = 0.0, np.zeros(4), [[], []], []
    while t < t_end:
        at = result.times[(result.times >= t) & (result.times <= t_end)]
        step = solve_ivp(rates, (t, t_end), y, method="DOP853", rtol=1e-13, atol=1e-15, events=[touch(0), touch(1)],
                         t_eval=at, max_step=0.02)  # fmt: skip
        hit = [j for j in range(2) if step.t_events[j].size]
        stop = step.t_events[hit[0]][0] if hit else t_end
        found += [(s, *state) for s, state in zip(step.t, step.y.T, strict=True)]
        if not hit:
            break
        t, y = stop, step.y_events[hit[0]][0].copy()
        row = rows[hit[0]]
        y[2:] -= (1.0 + back[hit[0]]) * (row @ y[2:]) / (row @ (row / mass)) * row / mass
        times[hit[0]].append(t)
    for j, name in enumerate(("wall", "between")):
        np.testing.assert_allclose(result.contacts[name].impacts.closing, times[j], atol=1e-9)
        assert len(times[j]) > 5
    motion = np.array(found)[:, 1:3].T
    mine = np.array([result.displacement(one), result.displacement(two)])
    np.testing.assert_allclose(mine, motion[:, : mine.shape[1]], atol=1e-8)
    assert result.energy.balance_error < 1e-12


def test_a_beam_bounces_and_comes_to_rest() -> None:
    """A damped cantilever on a rigid stop: energies balance, and it never penetrates."""
    beam = vf.Beam(1.0, 10.0, 0.5, 4, {"left": "clamped"}, name="beam")
    tip = beam.at("right")
    effects = [
        vf.RayleighDamping(0.0, 1e-3),
        vf.RigidStop(tip, gap=0.005, restitution=0.6, side="below", name="stop"),
        vf.PointLoad(tip, vf.Constant(-1.0)),
    ]
    result = vf.simulate(vf.Scene([beam], effects), 6.0, method="event_driven", times=np.linspace(0.0, 6.0, 601))
    stop = result.contacts["stop"]
    assert stop.impacts.closing.size > 30
    assert result.displacement(tip).min() > -0.005 - 1e-15
    assert stop.pinned.size
    # At rest on a propped cantilever's tip: what the load exceeds.
    assert stop.force[-1] == pytest.approx(1.0 - 3.0 * 10.0 * 0.005, rel=1e-6)
    assert result.energy.balance_error < 1e-12


@pytest.mark.parametrize(("elements", "restitution", "t_end"), [(4, 0.3, 1.0), (6, 0.5, 1.0), (10, 0.3, 2.0)])
def test_a_run_begins_where_another_one_has_come_to_rest(elements: int, restitution: float, t_end: float) -> None:
    """What is left of the speeds is rounding, and no impact."""
    beam = vf.Beam(1.0, EI=70.0, rhoA=0.5, elements=elements, supports={"left": "clamped"}, name="beam")
    tip = beam.at(1.0)
    stop = vf.RigidStop(tip, gap=0.00137, restitution=restitution, side="below", name="stop")
    scene = vf.Scene([beam], [stop, vf.PointLoad(tip, -2.0), vf.RayleighDamping(0.5, 1e-3)])
    first = vf.simulate(scene, t_end, method="event_driven")
    again = vf.simulate(scene, 0.01, method="event_driven", initial=first, max_events=100)
    assert again.displacement(tip) == pytest.approx(-0.00137, abs=1e-16)
    assert again.contacts["stop"].pinned == pytest.approx(np.array([[0.0, 0.01]]), abs=1e-15)


def test_what_cannot_be_answered_is_refused_by_name() -> None:
    """Stepping methods, statics, orbits and harmonic balance name the stop; so does a start inside of it."""
    mass = vf.Mass(1.0, stiffness=10.0, name="mass")
    stop = vf.RigidStop(mass, gap=0.1, restitution=0.5, side="above", name="wall")
    scene = vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(3.0, 2.0))])
    for method in ("energy_conserving", "generalized_alpha", "central_difference"):
        with pytest.raises(vf.MethodError, match=r"RigidStop 'wall' is rigid.*event_driven"):
            vf.simulate(scene, 1.0, dt=0.01, method=method)
    assert vf.simulate(scene, 1.0).method == "event_driven"
    for refused in (
        lambda: vf.equilibrium(scene),
        lambda: vf.quasi_static(scene, 1.0),
        lambda: vf.periodic(scene, harmonics=3),
        lambda: vf.backbone(vf.Scene([mass], [stop]), 1, [1.0]),
    ):
        with pytest.raises(vf.VofemError, match="RigidStop 'wall'"):
            refused()
    with pytest.raises(vf.ArgumentError, match=r"restitution is 1.2, expected a number from 0 to 1"):
        vf.RigidStop(mass, gap=0.1, restitution=1.2, side="above")
    with pytest.raises(vf.ArgumentError, match="side is missing"):
        vf.RigidStop(mass, gap=0.1, restitution=0.2)
    inside = vf.Scene([mass], [stop], initial={mass: (0.2, 0.0)})
    with pytest.raises(vf.ArgumentError, match=r"RigidStop 'wall': at the start the body is 0.1 m inside"):
        vf.simulate(inside, 1.0)


def test_period_one_orbits_of_the_impact_oscillator_close_and_their_multipliers_follow_the_closed_form() -> None:
    """The impact oscillator of Shaw and Holmes (1983), x'' + x = F cos(w t), x <= gap, v+ = -e v-.

    An orbit with one impact in each period starts at the impact with x = gap and the speed -e V. With
    the response A cos(w t) to the load and T = 2 pi/w, ``x(t) = A cos(w t + phi) + a cos t + b sin t``. Both
    conditions at T give a and b by V, and the first one gives cos(phi); sin(phi) follows from the speed.
    """
    w, force, e, gap = 2.4, 1.0, 0.7, 0.0
    period, amplitude = 2.0 * np.pi / w, 1.0 / (1.0 - w**2)
    c, s = np.cos(period), np.sin(period)
    # a (c - 1) + b s = 0 and -a s + b (c - 1) = (1 + e) V.
    a, b = np.linalg.solve([[c - 1.0, s], [-s, c - 1.0]], [0.0, 1.0 + e])
    # gap = A cos(phi) + a V; -e V = -A w sin(phi) + b V: a quadratic equation for V.
    roots = np.roots([a**2 + ((b + e) / w) ** 2, -2.0 * gap * a, gap**2 - amplitude**2])
    speed = float(np.max(roots.real))
    cosine, sine = (gap - a * speed) / amplitude, (b + e) * speed / (amplitude * w)
    phase = float(np.arctan2(sine, cosine))

    def scene(displacement: float, velocity: float) -> vf.Scene:
        mass = vf.Mass(1.0, stiffness=1.0, name="mass")
        load = vf.PointLoad(mass, vf.Sine(force, w, phase=phase + 0.5 * np.pi))
        stop = vf.RigidStop(mass, gap=gap, restitution=e, side="above", name="stop")
        return vf.Scene([mass], [load, stop], initial={mass: (displacement, velocity)})

    def after(displacement: float, velocity: float, duration: float) -> np.ndarray:
        result = vf.simulate(
            scene(displacement, velocity), duration, method="event_driven", times=np.array([0.0, duration])
        )
        return np.array([result.displacement(result.scene.bodies[0])[-1], result.velocity(result.scene.bodies[0])[-1]])

    result = vf.simulate(scene(gap, -e * speed), 5.5 * period, method="event_driven")
    impacts = result.contacts["stop"].impacts
    np.testing.assert_allclose(impacts.closing, period * np.arange(1, 6), rtol=1e-9)
    np.testing.assert_allclose(impacts.approach_speed, speed, rtol=1e-8)
    # The map from one impact to the next, in the time tau and the speed u after an impact, by implicit derivatives.
    acceleration = force * np.cos(phase) - gap
    arrive = np.array([-e * speed, speed])

    def flow(time: float, speed_after: float, late: float) -> np.ndarray:
        phi = phase + w * late
        k = np.array([gap - amplitude * np.cos(phi), -speed_after + amplitude * w * np.sin(phi)])
        x = amplitude * np.cos(phi + w * time) + k[0] * np.cos(time) + k[1] * np.sin(time)
        v = -amplitude * w * np.sin(phi + w * time) - k[0] * np.sin(time) + k[1] * np.cos(time)
        return np.array([x, v])

    h = 1e-6
    by_speed = (flow(period, e * speed + h, 0.0) - flow(period, e * speed - h, 0.0)) / (2.0 * h)
    by_time = (flow(period, e * speed, h) - flow(period, e * speed, -h)) / (2.0 * h)
    jacobian = np.zeros((2, 2))
    for k, change in enumerate((by_time, by_speed)):
        later = -change[0] / arrive[1]
        jacobian[0, k] = later + (k == 0)
        jacobian[1, k] = e * (change[1] + acceleration * later)
    assert np.linalg.det(jacobian) == pytest.approx(e**2, rel=1e-7)
    # The same multipliers from runs over a period that begin in the middle of the flight.
    middle = 0.5 * period
    base = after(gap, -e * speed, middle)

    def shifted(displacement: float, velocity: float) -> np.ndarray:
        mass = vf.Mass(1.0, stiffness=1.0, name="mass")
        load = vf.PointLoad(mass, vf.Sine(force, w, phase=phase + 0.5 * np.pi + w * middle))
        stop = vf.RigidStop(mass, gap=gap, restitution=e, side="above", name="stop")
        one = vf.Scene([mass], [load, stop], initial={mass: (displacement, velocity)})
        result = vf.simulate(one, period, method="event_driven", times=np.array([0.0, period]))
        return np.array([result.displacement(result.scene.bodies[0])[-1], result.velocity(result.scene.bodies[0])[-1]])

    h = 1e-5
    columns = [(shifted(*(base + h * d)) - shifted(*(base - h * d))) / (2.0 * h) for d in np.eye(2)]
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(np.array(columns).T)), np.sort_complex(np.linalg.eigvals(jacobian)), atol=1e-6
    )


def test_the_growth_of_perturbations_passes_impacts() -> None:
    """The sensitivity of a run equals a difference of two runs."""

    def run(z: float, v: float) -> vf.Result:
        mass = vf.Mass(1.0, stiffness=1.0, name="mass")
        effects = [
            vf.PointLoad(mass, vf.Sine(1.0, 2.4)),
            vf.RigidStop(mass, gap=0.1, restitution=0.8, side="above", name="s"),
        ]
        return vf.simulate(vf.Scene([mass], effects, initial={mass: (z, v)}), 12.0, method="event_driven")

    phase, h = 2.0 * np.pi * 0.6180339887498949, 1e-7
    result, other = run(0.0, 0.0), run(h * np.cos(phase), h * np.sin(phase))
    assert len(result.contacts["s"].impacts) > 3
    ends = [
        np.array([one.displacement(one.scene.bodies[0])[-1], one.velocity(one.scene.bodies[0])[-1]])
        for one in (result, other)
    ]
    growth = np.log10(np.linalg.norm(ends[1] - ends[0]) / h)
    assert result.sensitivity.growth[-1] == pytest.approx(growth, abs=1e-4)


def test_a_plastic_impact_lifts_a_body_off_the_stop_on_which_it_rests() -> None:
    """It presses on the other body from then on; both slow down by the load until they are back at the stop."""
    upper, lower = vf.Mass(2.0, name="upper"), vf.Mass(1.0, name="lower")
    floor = vf.RigidStop(upper, gap=0.0, restitution=0.0, side="below", name="floor")
    hit = vf.RigidStop(lower, upper, gap=0.1, restitution=0.0, name="hit")
    scene = vf.Scene([upper, lower], [floor, hit, vf.PointLoad(upper, vf.Constant(-2.0))], {lower: (0.0, 1.0)})
    times = np.linspace(0.0, 1.0, 11)
    result = vf.simulate(scene, 1.0, method="event_driven", times=times)
    late = np.maximum(times - 0.1, 0.0)
    np.testing.assert_allclose(result.displacement(upper), late * (1.0 - late) / 3.0, atol=1e-14)
    np.testing.assert_allclose(result.contacts["floor"].pinned, [[0.0, 0.1]], atol=1e-15)
    np.testing.assert_allclose(result.contacts["hit"].pinned, [[0.1, 1.0]], atol=1e-15)
    assert result.energy.balance_error < 1e-14
    assert result.energy.dissipated[-1] == pytest.approx(1.0 / 3.0, rel=1e-13)


def pushed_on(rigid: bool) -> vf.Result:
    """Return the run of a body that rests against something at 1 m, which a ball hits without restitution."""
    body, ball = vf.Mass(1.0, name="body"), vf.Mass(2.0, name="ball")
    under: vf.RigidStop | vf.Contact = vf.RigidStop(body, gap=1.0, restitution=0.0, side="above", name="under")
    if not rigid:
        under = vf.Contact(body, gap=1.0, stiffness=3.0, side="above", acts_on="displacement", name="under")
    between = vf.RigidStop(ball, body, gap=0.1, restitution=0.0, name="between")
    push = vf.PointLoad(ball, vf.Constant(0.5), name="push")
    effects = [under, between, vf.PointLoad(body, vf.Constant(1.0)), push]
    scene = vf.Scene([body, ball], effects, {body: (1.0 if rigid else 1.0 - 1e-9, 0.0), ball: (0.9, 0.3)})
    return vf.simulate(scene, 1.5, method="event_driven", times=np.linspace(0.0, 1.5, 31))


def test_a_contact_that_rests_at_its_gap_yields_to_a_plastic_impact() -> None:
    """Its force is finite: after the impact both masses are on its spring, with the momentum that they have."""
    result = pushed_on(rigid=False)
    meeting = (np.sqrt(0.3**2 + 0.5 * 0.2) - 0.3) / 0.25
    speed = 2.0 * (0.3 + 0.25 * meeting) / 3.0
    tau = np.maximum(result.times - meeting, 0.0)
    # 3 u'' + 3 u = 1.5, from u = 1.
    expected = 0.5 + 0.5 * np.cos(tau) + speed * np.sin(tau)
    np.testing.assert_allclose(
        result.displacement(result.scene.bodies[0]), np.where(tau > 0.0, expected, 1.0), atol=2e-9
    )
    # The body comes to rest at its gap after 1e-9 m under 1 N.
    lost = 1e-9 + 0.5 * 2.0 * (1.5 * speed) ** 2 - 0.5 * 3.0 * speed**2
    assert result.energy.dissipated[-1] == pytest.approx(lost, rel=1e-12)


def test_a_stop_at_which_a_body_rests_holds_it_in_a_plastic_impact() -> None:
    """All momentum goes into that stop: 1.5 N for 1.5 s, and 0.6 N s of the ball; the impulse between both is less."""
    result = pushed_on(rigid=True)
    under, between = (result.contacts[name].impacts for name in ("under", "between"))
    assert not np.any(result.velocity(result.scene.bodies[0]))
    assert under.impulse == pytest.approx([1.5 * 1.5 + 0.6], rel=1e-13)
    assert between.impulse == pytest.approx([0.5 * 1.5 + 0.6], rel=1e-13)
    assert np.isinf(under.peak_force).all()
    assert result.contacts["under"].statistics().impulse == pytest.approx(2.85, rel=1e-13)
    assert under.absorbed == pytest.approx([0.0], abs=1e-14)
    # By the load on the ball and by its mass: 1.5 s and 0.3 m/s.
    found = vf.sensitivities(result, [vf.Parameter("push", "f.value"), vf.Parameter("ball", "mass")])
    for name in ("under", "between"):
        np.testing.assert_allclose(found.contacts[name].impacts.impulse, [[1.5, 0.3]], atol=1e-13)


def test_stops_that_share_a_load_in_no_unique_way_are_told() -> None:
    """Two bodies rest at their own stops and at each other."""
    one, two = vf.Mass(1.0, stiffness=3.0, name="one"), vf.Mass(1.0, stiffness=3.0, name="two")
    stops = [
        vf.RigidStop(body, gap=0.0, restitution=0.0, side="below", name=f"under {body.name}") for body in (one, two)
    ]
    between = vf.RigidStop(one, two, gap=0.0, restitution=0.0, name="between")
    loads = [vf.PointLoad(one, vf.Sine(0.5, 3.0) + vf.Constant(-2.0)), vf.PointLoad(two, vf.Constant(-2.0))]
    scene = vf.Scene([one, two], [*stops, between, *loads])
    with pytest.raises(vf.SingularSystemError, match=r"'under one' and .*'between' hold bodies at rest at once"):
        vf.simulate(scene, 1.0, method="event_driven")


def test_a_force_that_begins_to_press_bodies_at_rest_on_each_other_makes_no_bounces() -> None:
    """The first speeds are below the rounding of times, where bounces would repeat without end."""
    lower, upper = vf.Mass(1.0, stiffness=1.0), vf.Mass(1.0, stiffness=1.0)
    stop = vf.RigidStop(lower, upper, gap=0.0, restitution=0.5, name="stop")
    scene = vf.Scene([lower, upper], [stop, vf.PointLoad(upper, vf.Pulse(-1.0, 1.0, 1.0))])
    result = vf.simulate(scene, 1.9, times=[0.0, 1.9], method="event_driven", max_events=100)
    np.testing.assert_allclose(result.displacement(lower)[-1], -0.5 * (1.0 - np.cos(0.9)), rtol=1e-12)
    np.testing.assert_allclose(result.contacts["stop"].pinned, [[1.0, 1.9]], atol=1e-9)


@pytest.mark.parametrize("stiffness", [0.0, 1.0])
@pytest.mark.parametrize(
    "force",
    [
        vf.Ramp(-1.0, 0.7, 2.0),
        vf.Tabulated([0.0, 0.7, 1.5, 2.0], [0.0, 0.0, -1.0, -0.5]),
        vf.Sine(1.0, 2.0, np.pi / 2.0) - 1.0,
        vf.Sine(1.0, 2.0) + vf.Ramp(-2.0),
    ],
    ids=["ramp", "samples", "second derivative", "third derivative"],
)
def test_a_force_that_begins_at_zero_presses_bodies_at_rest_on_each_other(force: object, stiffness: float) -> None:
    # However slowly it begins, there is no bounce, and both move as one body.
    lower, upper = (vf.Mass(1.0, stiffness=stiffness, name=name) for name in ("lower", "upper"))
    stop = vf.RigidStop(lower, upper, gap=0.0, restitution=0.5, name="stop")
    run = vf.simulate(vf.Scene([lower, upper], [stop, vf.PointLoad(upper, force)]), 1.4, method="event_driven")
    assert len(run.contacts["stop"].impacts) == 1
    one = vf.Mass(2.0, stiffness=2.0 * stiffness, name="one")
    both = vf.simulate(vf.Scene([one], [vf.PointLoad(one, force)]), 1.4, method="event_driven").displacement(one)
    np.testing.assert_allclose(run.displacement(lower), both, rtol=0, atol=1e-13 * np.max(np.abs(both)))
    np.testing.assert_allclose(run.displacement(upper), both, rtol=0, atol=1e-13 * np.max(np.abs(both)))


def test_a_load_that_jumps_pulls_a_body_off_its_stop_although_it_pushes_again_soon() -> None:
    """A stop cannot pull: the force is -1.5 + 3 (t - 1) from t = 1 on, until it pushes the body back."""
    mass = vf.Mass(2.0, name="mass")
    stop = vf.RigidStop(mass, gap=0.0, restitution=0.0, side="above", name="stop")
    force = vf.Constant(0.5) + vf.Pulse(-2.0, 1.0, 1.0) + vf.Ramp(3.0, 1.0, 2.0)
    scene = vf.Scene([mass], [stop, vf.PointLoad(mass, force)])
    result = vf.simulate(scene, 1.9, times=[0.0, 1.0, 1.25, 1.5, 1.9], method="event_driven")
    tau = np.array([0.0, 0.0, 0.25, 0.5, 0.9])
    np.testing.assert_allclose(result.displacement(mass), -0.375 * tau**2 + 0.25 * tau**3, atol=1e-14)
    assert result.energy.balance_error < 1e-13


def test_a_load_that_jumps_takes_a_contact_off_its_gap_although_it_pushes_it_back_soon() -> None:
    """A contact under the displacement law, which rests at its gap, opens; its force, from 0 to K0 gap, cannot pull."""
    mass = vf.Mass(2.0, name="mass")
    stop = vf.Contact(mass, gap=0.1, stiffness=20.0, damping=50.0, side="above", acts_on="displacement", name="stop")
    force = vf.Constant(1.0) + vf.Pulse(-2.0, 2.0, 0.8) + vf.Ramp(3.0, 2.0, 3.0)
    scene = vf.Scene([mass], [stop, vf.PointLoad(mass, force)], initial={mass: (0.1, 0.0)})
    result = vf.simulate(scene, 2.6, times=[0.0, 2.0, 2.25, 2.5], method="event_driven")
    tau = np.array([0.0, 0.0, 0.25, 0.5])
    np.testing.assert_allclose(result.displacement(mass), 0.1 - 0.25 * tau**2 + 0.25 * tau**3, atol=1e-14)
