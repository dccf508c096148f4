"""Stops that stay in space while the base of a body moves, and contacts between bodies on different bases."""

from itertools import pairwise

import numpy as np
import pytest
from scenes import ledger_error, reference_case
from scipy.integrate import solve_ivp

import vofem as vf


def shaking(body, d):
    return vf.BaseMotion(body, vf.Sine(d["a"], d["Omega"]), displacement=0.0, velocity=-d["a"] / d["Omega"])


def mass_between_stops(d, frame):
    mass = vf.Mass(d["m"], stiffness=d["k"], damping=d["c"], name="mass")
    law = {"stiffness": d["K0"], "acts_on": "penetration", "frame": frame}
    stops = [vf.Contact(mass, gap=d[f"gap_{side}"], side=side, name=side, **law) for side in ("above", "below")]
    return vf.Scene([mass], [shaking(mass, d), *stops]), mass


def cantilever(d, frame):
    beam = vf.Beam(d["L"], EI=d["EI"], rhoA=d["rhoA"], elements=d["elements"], supports={"left": "clamped"}, name="b")
    stop = vf.Contact(
        beam.at("right"), gap=d["gap"], stiffness=d["K0"], acts_on="penetration", side="above", frame=frame, name="stop"
    )
    return vf.Scene([beam], [vf.RayleighDamping(0.0, d["beta"]), shaking(beam, d), stop]), beam.at("right")


CASES = {"space_stops_mass": (mass_between_stops, ""), "space_stop_cantilever": (cantilever, "_tip")}


@pytest.mark.parametrize("frame", ["base", "space"])
@pytest.mark.parametrize(("name", "tolerance"), [("space_stops_mass", 1e-8), ("space_stop_cantilever", 1e-9)])
def test_exact_runs_agree_with_the_reference(name, tolerance, frame):
    d, values, histories = reference_case(f"moving/{name}")
    build, what = CASES[name]
    scene, point = build(d, frame)
    result = vf.simulate(scene, d["t_end"], times=histories["t"], method="event_driven")
    exact = histories[f"{frame}{what}_relative"]
    assert np.max(np.abs(result.displacement(point) - exact)) < tolerance * np.max(np.abs(exact))
    events = [t for t, _ in values[frame]["events"]]
    np.testing.assert_allclose(result.solution.events.time, events, rtol=0, atol=1e-11)
    assert ledger_error(result) < 1e-12


@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("energy_conserving", {}),
        # No other test needs these kernels.
        pytest.param("generalized_alpha", {"rho_infinity": 1.0}, marks=pytest.mark.kernels("plain")),
        ("central_difference", {}),
    ],
)
def test_steps_converge_to_the_reference(method, options):
    d, _, histories = reference_case("moving/space_stops_mass")
    t, errors = histories["t"][:101], []
    exact = histories["space_relative"][:101]
    for steps in (2000, 4000):
        scene, mass = mass_between_stops(d, "space")
        result = vf.simulate(scene, t[-1], times=t, method=method, dt=t[-1] / steps, **options)
        errors.append(np.max(np.abs(result.displacement(mass) - exact)) / np.max(np.abs(exact)))
        assert result.contacts["above"].gap_function == pytest.approx(
            result.displacement(mass) + histories["base_displacement"][:101] - d["gap_above"], abs=1e-12
        )
    assert errors[1] < 3e-4
    assert 3.0 < errors[0] / errors[1] < 5.0
    assert ledger_error(result) < (1e-12 if method == "energy_conserving" else 1e-3)


def test_a_tolerance_holds_with_stops_in_space():
    d, _, histories = reference_case("moving/space_stops_mass")
    scene, mass = mass_between_stops(d, "space")
    t = histories["t"][:51]
    result = vf.simulate(scene, t[-1], times=t, method="energy_conserving", tol=1e-4)
    exact = histories["space_relative"][:51]
    assert np.max(np.abs(result.displacement(mass) - exact)) < 1e-3 * np.max(np.abs(exact))


def integrated(masses, springs, dampers, stops, base, t):
    """Integrate masses on their bases by an adaptive method of order 8, in small pieces that end at kinks of `base`.

    `stops` are tuples (signs, gap, stiffness, damping); `base` returns displacements and velocities of the bases.
    """
    n = len(masses)

    def rates(time, y):
        u, v = y[:n], y[n:]
        z, w, a = base(time)
        force = -springs * u - dampers * v - masses * a
        for signs, gap, stiffness, damping in stops:
            s = signs @ (u + z) - gap
            if s > 0.0:
                force = force - signs * (stiffness * s + damping * (signs @ (v + w)))
        return np.concatenate([v, force / masses])

    def events():
        for signs, gap, *_ in stops:

            def reached(time, y, signs=signs, gap=gap):
                return signs @ (y[:n] + base(time)[0]) - gap

            reached.terminal = True
            yield reached

    y, now, found = np.zeros(2 * n), 0.0, [np.zeros(n)]
    for end in t[1:]:
        while now < end:
            step = solve_ivp(rates, (now, end), y, method="DOP853", rtol=1e-12, atol=1e-15, events=list(events()))
            y, now = step.y[:, -1], float(step.t[-1])
            if step.status == 1 and now < end:
                # Past the event by the shortest way that changes the sign of the gap function.
                y = y + 1e-12 * rates(now, y)
                now += 1e-12
        found.append(y[:n])
    return np.array(found)


def test_a_tabulated_acceleration_is_integrated_exactly_and_dampers_see_the_motion_of_the_stop():
    times = np.linspace(0.0, 1.0, 11)
    accelerations = 29.0 * np.sin(7.0 * times) + 23.0 * np.cos(23.0 * times)
    mass = vf.Mass(1.5, stiffness=300.0, damping=1.0, name="m")
    scene = vf.Scene(
        [mass],
        [
            vf.BaseMotion(mass, vf.Tabulated(times, accelerations), displacement=0.004, velocity=-5.0),
            vf.Contact(
                mass,
                gap=0.01,
                stiffness=4e3,
                damping=15.0,
                acts_on="penetration",
                side="below",
                frame="space",
                name="s",
            ),
        ],
    )
    t = np.linspace(0.0, 1.0, 101)
    steps = np.diff(times)
    slopes = np.diff(accelerations) / steps
    velocity = -5.0 + np.append(0.0, np.cumsum(steps * (accelerations[:-1] + accelerations[1:]) / 2))
    way = steps * (velocity[:-1] + steps * (accelerations[:-1] / 2 + steps * slopes / 6))
    displacement = 0.004 + np.append(0.0, np.cumsum(way))

    def base(time):
        k = min(int(time * 10.0 * (1 + 1e-14)), 9)
        h, a, s = time - times[k], accelerations[k], slopes[k]
        z = displacement[k] + h * (velocity[k] + h * (a / 2 + h * s / 6))
        return np.array([z]), np.array([velocity[k] + h * (a + h * s / 2)]), np.array([a + h * s])

    one = np.array([1.0])
    exact = integrated(1.5 * one, 300.0 * one, one, [(-one, 0.01, 4e3, 15.0)], base, t)[:, 0]
    result = vf.simulate(scene, 1.0, times=t, method="event_driven")
    assert result.solution.events.time.size >= 3
    assert np.max(np.abs(result.displacement(mass) - exact)) < 1e-8 * np.max(np.abs(exact))
    assert ledger_error(result) < 1e-12
    stepped = vf.simulate(scene, 1.0, times=t, method="energy_conserving", dt=1e-4)
    assert np.max(np.abs(stepped.displacement(mass) - exact)) < 1e-3 * np.max(np.abs(exact))


def test_bodies_on_different_bases_see_the_displacements_of_both():
    a, b = vf.Mass(1.0, stiffness=400.0, damping=2.0, name="a"), vf.Mass(2.0, stiffness=500.0, damping=1.0, name="b")
    scene = vf.Scene(
        [a, b],
        [
            vf.BaseMotion(a, vf.Sine(26.0, 11.0), displacement=0.01, velocity=-1.0),
            vf.BaseMotion(b, vf.Ramp(4.0, 0.1, 0.4), displacement=0.0, velocity=0.1),
            vf.Contact(a, b, gap=0.02, stiffness=3e3, damping=4.0, acts_on="penetration", name="between"),
        ],
    )
    t = np.linspace(0.0, 0.9, 91)

    def base(time):
        wave = 26.0 / 11.0
        za, va = 0.01 - wave / 11.0 * np.sin(11.0 * time) + (wave - 1.0) * time, wave * (1 - np.cos(11.0 * time)) - 1.0
        up, held = np.clip(time - 0.1, 0.0, 0.3), max(time - 0.4, 0.0)
        zb = 0.1 * time + 4.0 * (up**3 / 6 + up**2 / 2 * held + up * held**2 / 2)
        vb, ab = 0.1 + 4.0 * (up**2 / 2 + up * held), 4.0 * up
        return np.array([za, zb]), np.array([va, vb]), np.array([26.0 * np.sin(11.0 * time), ab])

    exact = integrated(
        np.array([1.0, 2.0]), np.array([400.0, 500.0]), np.array([2.0, 1.0]),
        [(np.array([1.0, -1.0]), 0.02, 3e3, 4.0)], base, t,
    )  # fmt: skip
    result = vf.simulate(scene, 0.9, times=t, method="event_driven")
    assert result.solution.events.time.size >= 2
    found = np.stack([result.displacement(a), result.displacement(b)], axis=1)
    assert np.max(np.abs(found - exact)) < 1e-8 * np.max(np.abs(exact))
    assert ledger_error(result) < 1e-12


def test_a_free_mass_is_pushed_by_a_stop_that_moves():
    # Nothing but the stop holds the mass: a slow block that cubics of time drive.
    mass = vf.Mass(1.0, name="free")
    acceleration = vf.Tabulated([0.0, 0.2, 0.5, 1.0], [0.0, 3.0, -6.0, 1.0])
    scene = vf.Scene(
        [mass],
        [
            vf.BaseMotion(mass, acceleration, displacement=0.0, velocity=0.0),
            vf.Contact(
                mass,
                gap=-0.001,
                stiffness=0.2,
                damping=0.1,
                acts_on="penetration",
                side="above",
                frame="space",
                name="s",
            ),
        ],
    )
    t = np.linspace(0.0, 1.0, 21)

    def rates(time, y):
        s = y[0] + y[2] + 0.001
        a = float(acceleration(time))
        force = 0.2 * s + 0.1 * (y[1] + y[3]) if s > 0 else 0.0
        return [y[1], -force - a, y[3], a]

    y, exact = np.zeros(4), [0.0]
    for begin, end in pairwise(t):
        y = solve_ivp(rates, (begin, end), y, method="DOP853", rtol=1e-13, atol=1e-16).y[:, -1]
        exact.append(y[0])
    result = vf.simulate(scene, 1.0, times=t, method="event_driven")
    # The stop stays closed: the absolute displacement falls by itself only.
    assert np.max(np.abs(result.displacement(mass) - exact)) < 1e-9 * np.max(np.abs(exact))
    assert ledger_error(result) < 1e-11


def test_a_later_start_sees_the_base_where_it_is_then():
    d, _, histories = reference_case("moving/space_stops_mass")
    scene, mass = mass_between_stops(d, "space")
    first = vf.simulate(scene, 0.8, method="event_driven")
    again = vf.simulate(scene, 0.4, initial=first, t_start=0.8, times=[0.0, 0.2, 0.4], method="event_driven")
    at = [200, 250, 300]
    np.testing.assert_allclose(again.displacement(mass), histories["space_relative"][at], rtol=0, atol=1e-12)


def test_what_is_missing_or_impossible_is_told():
    mass, other = vf.Mass(1.0, stiffness=10.0, name="m"), vf.Mass(1.0, stiffness=10.0, name="o")
    law = {"gap": 0.1, "stiffness": 10.0, "acts_on": "penetration", "name": "stop"}
    stop = vf.Contact(mass, side="above", frame="space", **law)
    with pytest.raises(vf.ArgumentError, match=r"Contact 'stop'.*displacement= and velocity="):
        vf.Scene([mass], [vf.BaseMotion(mass, vf.Sine(1.0, 2.0)), stop])
    with pytest.raises(vf.ArgumentError, match=r"velocity=\.\.\."):
        vf.Scene([mass], [vf.BaseMotion(mass, vf.Sine(1.0, 2.0), displacement=0.0), stop])
    with pytest.raises(vf.ArgumentError, match="Approximated"):
        vf.Scene([mass], [vf.BaseMotion(mass, lambda t: t, displacement=0.0, velocity=0.0), stop])
    with pytest.raises(vf.ArgumentError, match="frame"):
        vf.Contact(mass, other, frame="space", **law)
    with pytest.raises(vf.ArgumentError, match="displacement"):
        vf.Scene([mass, other], [vf.BaseMotion(mass, 1.0), vf.Contact(mass, other, **law)])
    # The same motion of both bases needs no displacement, and a stop in space without a motion is an ordinary one.
    vf.Scene([mass, other], [vf.BaseMotion(mass, 1.0), vf.BaseMotion(other, 1.0), vf.Contact(mass, other, **law)])
    assert vf.Scene([mass], [stop]).model.system.contacts.moving is None
    scene = vf.Scene([mass], [vf.BaseMotion(mass, vf.Sine(1.0, 2.0), displacement=0.0, velocity=0.0), stop])
    for refused in (
        lambda: vf.equilibrium(scene),
        lambda: vf.periodic(scene),
        lambda: vf.periodic(scene, harmonics=5),
        lambda: vf.sensitivities(vf.simulate(scene, 1.0), [vf.Parameter(stop, "gap")]),
    ):
        with pytest.raises(vf.VofemError, match="Contact 'stop' sees the displacement of a base"):
            refused()
    jumping = vf.Contact(mass, side="below", **{**law, "acts_on": "displacement", "name": "jump"})
    both = vf.Scene([mass], [*scene.effects, jumping])
    with pytest.raises(vf.MethodError, match=r"'jump' acts on .*: give Contact 'jump' acts_on='penetration'"):
        vf.simulate(both, 1.0, method="event_driven")
    floor = vf.RigidStop(mass, gap=0.1, restitution=0.5, side="below", name="floor")
    with pytest.raises(vf.MethodError, match=r"'floor' is rigid, .*: replace RigidStop 'floor' by a stiff Contact"):
        vf.simulate(vf.Scene([mass], [*scene.effects, floor]), 1.0, method="event_driven")
    rubbed = vf.Scene([mass], [*scene.effects, vf.Friction(mass, coefficient=0.3, normal=1.0, name="pad")])
    with pytest.raises(vf.MethodError, match=r"'pad' acts beside contacts .* Or choose method='energy_conserving', "):
        vf.simulate(rubbed, 1.0, method="event_driven")


def test_a_published_mass_between_a_shaken_base_and_a_stop_in_space():
    """SDND102 of code_aster, its stop in space: relative displacements of an independent integration."""
    m, k, omega = 25.0, 98696.0, 20.0 * np.pi
    mass = vf.Mass(m, stiffness=k, damping=2.0 * 0.07 * np.sqrt(k * m), name="mass")
    stop = vf.Contact(mass, gap=5e-4, stiffness=5.76e7, side="above", acts_on="penetration", frame="space", name="stop")
    base = vf.BaseMotion(mass, vf.Sine(1.0, omega), displacement=0.0, velocity=-1.0 / omega)
    times = np.array([0.05, 0.25, 0.4, 0.5, 1.0])
    result = vf.simulate(vf.Scene([mass], [stop, base]), 1.0, times=times, method="event_driven")
    known = [-3.58004e-4, -1.88702e-4, -1.89840e-4, -7.02148e-5, -1.08559e-4]
    np.testing.assert_allclose(result.displacement(mass), known, rtol=0.0, atol=5e-10)
    assert len(result.contacts["stop"].impacts) > 0


def test_pictures_show_a_stop_in_space_where_the_body_meets_it():
    from vofem.io.plot import time_history

    tip = vf.Beam(1.0, 1.0, 1.0, 4, {"left": "clamped"}, name="b").at(1.0)
    wall = vf.Contact(tip, gap=0.02, stiffness=50.0, side="above", acts_on="penetration", frame="space", name="wall")
    scene = vf.Scene([tip.body], [wall, vf.BaseMotion(tip.body, vf.Sine(3.0, 6.0), displacement=0.0, velocity=-0.5)])
    run = vf.simulate(scene, 3.0, times=np.linspace(0.0, 3.0, 301))
    closing = run.contacts["wall"].closings[0]
    frame = run.frame(closing).warp_by_vector("deflection")
    contact, stop = (frame.get_cell(int(np.flatnonzero(frame["kind"] == kind)[0])).point_ids for kind in (2, 3))
    met = run.displacement(tip, [closing])[0]
    np.testing.assert_allclose(frame.points[[*contact, *stop], 1], met, rtol=1e-8)
    motion, surface = (line for line in time_history(run, tip)[0].lines if len(line.get_xdata()) > 300)
    at = np.flatnonzero(motion.get_xdata() == closing)
    np.testing.assert_allclose(surface.get_ydata()[at], motion.get_ydata()[at], rtol=1e-8)
