"""Points that travel along beams: loads, contacts and what is fixed to them."""

import numpy as np
import pytest
from scenes import ledger_error, reference_case

import vofem as vf
from vofem.io import plot

ENDS = {"left": "pinned", "right": "pinned"}


def bridge(d, elements):
    return vf.Beam(d["L"], EI=d["EI"], rhoA=d["rhoA"], elements=elements, supports=ENDS, name="bridge")


def off(found, exact):
    return np.max(np.abs(found - exact)) / np.max(np.abs(exact))


# -- loads ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("elements", [4, 10, 16])
def test_a_moving_force_is_exact(elements):
    d, _, histories = reference_case("moving/moving_force")
    beam, t = bridge(d, elements), histories["t"]
    scene = vf.Scene([beam], [vf.PointLoad(beam.along(vf.Path(d["v"])), -d["F"])])
    result = vf.simulate(scene, t[-1], times=t, method="event_driven")
    assert off(-result.displacement(beam.at(d["x_out"])), histories[f"fe{elements}"]) < 1e-9
    assert ledger_error(result) < 1e-12
    # Segments end where the force passes a node, and when it leaves.
    assert result.counters.steps == elements + 1


def test_a_train_is_a_list_of_loads():
    d, values, histories = reference_case("moving/moving_train")
    beam, t = bridge(d, d["elements"]), histories["t"]
    loads = [vf.PointLoad(beam.along(vf.Path(d["v"], begin=entry)), -d["F"]) for entry in d["entries"]]
    result = vf.simulate(vf.Scene([beam], loads), t[-1], times=t, method="event_driven")
    assert off(-result.displacement(beam.at(d["x_out"])), histories["fe"]) < 1e-9
    # The same train by places beyond the bridge at t = 0, and one load that is met from the other side.
    behind = [vf.PointLoad(beam.along(vf.Path(-d["v"], d["L"] + d["v"] * entry)), -d["F"]) for entry in d["entries"]]
    mirrored = vf.simulate(vf.Scene([beam], behind), t[-1], times=t, method="event_driven")
    np.testing.assert_allclose(
        mirrored.displacement(beam.at(d["x_out"])), result.displacement(beam.at(d["x_out"])), atol=1e-10 * values["max"]
    )


@pytest.mark.parametrize("method", ["energy_conserving", "generalized_alpha"])
def test_steps_take_a_moving_force_by_its_means(method):
    d, _, histories = reference_case("moving/moving_force")
    beam, t, errors = bridge(d, 4), histories["t"], []
    scene = vf.Scene([beam], [vf.PointLoad(beam.along(vf.Path(d["v"])), -d["F"])])
    for steps in (2000, 4000):
        result = vf.simulate(scene, t[-1], times=t, method=method, dt=t[-1] / steps)
        errors.append(off(-result.displacement(beam.at(d["x_out"])), histories["fe4"]))
    assert errors[1] < 1e-4
    assert 3.0 < errors[0] / errors[1] < 5.0


def test_a_slow_free_beam_is_driven_exactly():
    # A free beam has rigid motions, which cubics of time drive from rest.
    beam = vf.Beam(2.0, EI=30.0, rhoA=4.0, elements=3, name="free")
    scene = vf.Scene([beam], [vf.PointLoad(beam.along(vf.Path(1.6)), 5.0), vf.RayleighDamping(0.3, 1e-4)])
    result = vf.simulate(scene, 1.0, times=[0.0, 0.5, 1.0], method="event_driven")
    fine = vf.simulate(scene, 1.0, times=[0.0, 0.5, 1.0], method="energy_conserving", dt=1e-4)
    x = np.linspace(0.0, 2.0, 5)
    assert off(fine.deflection(x, [1.0], beam), result.deflection(x, [1.0], beam)) < 1e-5
    assert ledger_error(result) < 1e-11
    # Momentum and its decay: m V' = F - 0.3 m V.
    speed = result.velocity(beam.at(1.0))
    mean = np.array([result.velocity(beam.at(float(place))) for place in np.linspace(0, 2, 2001)]).mean(axis=0)
    assert mean[-1] == pytest.approx(5.0 / 8.0 * -np.expm1(-0.3) / 0.3, rel=2e-3)
    assert speed.shape == (3,)


def test_a_force_that_accelerates_or_varies_is_left_to_steps():
    beam = vf.Beam(2.0, EI=50.0, rhoA=1.0, elements=2, supports=ENDS, name="beam")
    for path, force in ((vf.Path(0.5, acceleration=1.0), 2.0), (vf.Path(1.0), vf.Sine(2.0, 9.0))):
        scene = vf.Scene([beam], [vf.PointLoad(beam.along(path), force)])
        assert vf.explain(scene).method == "energy_conserving"
        with pytest.raises(vf.MethodError, match=r"PointLoad on Beam 'beam'.*travels.*energy_conserving"):
            vf.simulate(scene, 1.0, method="event_driven")
        # An independent answer: the equations of the nodes by an adaptive method.
        from scipy.integrate import solve_ivp

        system = scene.model.system
        mass, stiffness = system.mass.toarray(), system.stiffness.toarray()
        inverse, n = np.linalg.inv(mass), system.size
        function = force if callable(force) else lambda t, force=force: force

        free = scene.model.free

        def rates(t, y, path=path, function=function, inverse=inverse, stiffness=stiffness, n=n, free=free):
            x = path.start + path.speed * t + path.acceleration * t * t / 2
            full = np.zeros(beam.size)
            row = beam.row_at(min(x, 2.0))
            full[row.indices] = row.weights * float(function(t)) * (x <= 2.0)
            return np.concatenate([y[n:], inverse @ (full[free] - stiffness @ y[:n])])

        exact = solve_ivp(rates, (0.0, 1.0), np.zeros(2 * n), method="DOP853", rtol=1e-7, atol=1e-10, max_step=0.05)
        result = vf.simulate(scene, 1.0, times=[0.0, 1.0], method="energy_conserving", dt=5e-4)
        found = scene.model.of_body(beam, result.solution.samples.q)[:, -1]
        assert off(found, scene.model.of_body(beam, exact.y[:n, -1:])[:, 0]) < 2e-3


def test_pulses_of_a_moving_force_and_impacts_beneath_it_are_exact():
    beam = vf.Beam(2.0, EI=50.0, rhoA=1.0, elements=4, supports=ENDS, name="beam")
    stop = vf.Contact(beam.at(1.0), gap=0.004, stiffness=3e3, side="below", acts_on="penetration", name="stop")
    load = vf.PointLoad(beam.along(vf.Path(-1.5, start=2.0, begin=0.1)), vf.Pulse(-9.0, 0.3, 0.5) + -4.0)
    scene = vf.Scene([beam], [stop, load, vf.RayleighDamping(0.1, 1e-4)])
    t = np.linspace(0.0, 1.6, 33)
    result = vf.simulate(scene, 1.6, times=t, method="event_driven")
    fine = vf.simulate(scene, 1.6, times=t, method="energy_conserving", dt=4e-4)
    assert result.contacts["stop"].closings.size >= 2
    assert off(fine.displacement(beam.at(1.0)), result.displacement(beam.at(1.0))) < 5e-3
    assert ledger_error(result) < 1e-11
    later = vf.simulate(scene, 0.8, initial=vf.simulate(scene, 0.8), t_start=0.8, times=[0.0, 0.8])
    assert later.displacement(beam.at(1.0))[-1] == pytest.approx(result.displacement(beam.at(1.0))[-1], abs=1e-9)


def test_travelling_loads_stand_in_scene_files_and_are_drawn(tmp_path):
    beam = vf.Beam(2.0, EI=50.0, rhoA=1.0, elements=4, supports=ENDS, name="beam")
    path = vf.Path(1.5, start=-0.2, begin=0.1, ends="rigid")
    scene = vf.Scene([beam], [vf.PointLoad(beam.along(path), -4.0)])
    vf.dump_scene(scene, tmp_path / "scene.toml")
    assert "path = { speed = 1.5" in (tmp_path / "scene.toml").read_text()
    assert vf.load_scene(tmp_path / "scene.toml").scene.effects[0].point.path == path
    result = vf.simulate(scene, 1.0)
    from vofem.io.pictures.snapshot import snapshots

    views = snapshots(result, np.array([0.05, 0.5]))
    assert not views[0].pushes
    assert views[1].pushes[0].points[0].x == pytest.approx(-0.2 + 1.5 * 0.4)
    assert "at 1.5 m/s from x = -0.2 m" in str(vf.explain(scene))


def test_what_cannot_travel_is_refused_by_name():
    beam = vf.Beam(2.0, EI=50.0, rhoA=1.0, elements=4, supports=ENDS, name="beam")
    point = beam.along(vf.Path(1.0))
    scene = vf.Scene([beam], [vf.PointLoad(point, -4.0)])
    for refused in (
        lambda: vf.equilibrium(scene),
        lambda: vf.quasi_static(scene, [1.0]),
        lambda: vf.periodic(scene, period=1.0),
        lambda: vf.periodic(scene, period=1.0, harmonics=3),
        lambda: vf.frequency_response(scene, [1.0], loads="scene"),
        lambda: vf.sensitivities(vf.simulate(scene, 0.5), [vf.Parameter(beam, "EI")]),
    ):
        with pytest.raises(vf.VofemError, match=r"PointLoad on Beam 'beam'.*travels along a beam"):
            refused()
    for refused in (
        lambda: vf.PointMoment(point, 1.0),
        lambda: vf.Springpot(point, coefficient=1.0, order=0.5),
        lambda: vf.Joint(point, beam.at(1.0), kind="hinge"),
        lambda: vf.simulate(scene, 0.5).displacement(point),
    ):
        with pytest.raises(vf.VofemError, match=r"Beam 'beam' at 1 m/s.*travels"):
            refused()
    with pytest.raises(vf.ArgumentError, match=r"PointMass.* has a profile"):
        vf.PointMass(beam.along(vf.Path(1.0, profile=0.01)), mass=0.1)
    with pytest.raises(vf.ArgumentError, match=r"vofem\.Path"):
        beam.along(1.0)
    with pytest.raises(vf.ArgumentError, match="begin"):
        vf.Path(1.0, begin=-1.0)


@pytest.mark.parametrize("field", ["x", "point.x"])
def test_the_place_of_what_travels_is_no_parameter(field):
    beam = vf.Beam(2.0, EI=50.0, rhoA=1.0, elements=4, supports=ENDS, name="beam")
    load = vf.PointLoad(beam.along(vf.Path(1.0)), -4.0)
    scene, parameter = vf.Scene([beam], [load]), vf.Parameter(load, field)
    for refused in (
        lambda: parameter.check(scene),
        lambda: parameter.value(scene),
        lambda: parameter.at(scene, 0.1),
        lambda: vf.fit(scene, parameter, vf.Measured(beam.at(1.0), [0.1, 0.2], [0.0, 0.0])),
    ):
        with pytest.raises(vf.ArgumentError, match=rf"'{field}' is not the place .* travels along the beam"):
            refused()
    with pytest.raises(vf.ArgumentError, match=r"there are \['f\.value'\]"):
        vf.Parameter(load, "place").check(scene)


def test_times_at_which_a_path_passes_places():
    path = vf.Path(2.0, start=1.0, begin=0.5, acceleration=-1.0)
    # x = 1 + 2 s - s^2/2 turns at s = 2, x = 3.
    np.testing.assert_allclose(path.times_at([1.0, 2.5, 3.5, -1.0]), 0.5 + np.array([0.0, 1.0, 3.0, 4.0, 2 + 8**0.5]))
    np.testing.assert_allclose(vf.Path(-2.0, start=1.0).times_at([0.0, 2.0]), [0.5])
    assert vf.Path(0.0, start=1.0).times_at([0.0, 2.0]).size == 0


# -- contacts and attachments -----------------------------------------------------------------------------


def beam_on_a_travelling_stop(d):
    """Return the scene of the reference data, and its beam."""
    beam = bridge(d, d["elements"])
    stop = vf.Contact(
        beam.along(vf.Path(d["v"], start=d["x0"])), gap=d["gap"], stiffness=d["K0"], side="above",
        acts_on="penetration", name="stop",
    )  # fmt: skip
    load = vf.PointLoad(beam.at(d["L"] / 2), vf.Sine(d["F"], d["Omega"]))
    return vf.Scene([beam], [stop, load, vf.RayleighDamping(0.0, d["beta"])]), beam


def test_a_stop_that_travels_converges_and_its_ledger_is_exact():
    d, values, histories = reference_case("moving/travelling_stop")
    (scene, beam), t, errors = beam_on_a_travelling_stop(d), histories["t"], []
    for steps in (800, 1600):
        result = vf.simulate(scene, d["t_end"], times=t, dt=d["t_end"] / steps)
        assert result.method == "energy_conserving"
        errors.append(off(result.displacement(beam.at(d["L"] / 2)), histories["w_mid"]))
    assert errors[1] < 5e-3
    assert 3.0 < errors[0] / errors[1] < 5.0
    assert ledger_error(result) < 1e-12
    events = [time for time, _ in values["events"]]
    np.testing.assert_allclose(result.solution.events.time, events, rtol=0, atol=2e-3)


@pytest.mark.parametrize(("method", "count"), [("generalized_alpha", 1000), ("central_difference", 2500)])
def test_other_steps_take_what_travels_with_second_order(method, count):
    d, _, histories = reference_case("moving/travelling_stop")
    (scene, beam), t = beam_on_a_travelling_stop(d), histories["t"]
    runs = [vf.simulate(scene, d["t_end"], times=t, method=method, dt=d["t_end"] / n) for n in (count, 2 * count)]
    errors = [off(run.displacement(beam.at(d["L"] / 2)), histories["w_mid"]) for run in runs]
    assert errors[1] < 5e-3
    assert 3.0 < errors[0] / errors[1] < 5.0
    # A wheel with a damper in its suspension, and a tied mass whose beam gets modes that steps do not resolve.
    d, _, histories = reference_case("moving/moving_oscillator_touching")
    scene, _, _, body = oscillator(d)
    t = histories["t"]
    runs = [vf.simulate(scene, t[-1], times=t, method=method, dt=t[-1] / n) for n in (1500, 3000)]
    errors = [off(run.displacement(body), histories["u_s"]) for run in runs]
    assert errors[1] < 1e-6
    assert 3.5 < errors[0] / errors[1] < 4.5
    d, _, histories = reference_case("moving/moving_mass")
    beam, t = bridge(d, d["elements"]), histories["t"]
    point = beam.along(vf.Path(d["v"]))
    scene = vf.Scene([beam], [vf.PointMass(point, mass=d["Mm"]), vf.PointLoad(point, -d["Mm"] * d["g"])])
    result = vf.simulate(scene, t[-1], times=t, method=method, dt=t[-1] / 4000)
    assert off(result.displacement(beam.at(d["x_out"])), histories["w"]) < 5e-5
    if method == "generalized_alpha":
        chosen = vf.simulate(scene, t[-1], times=t, method=method, tol=1e-3)
        assert off(chosen.displacement(beam.at(d["x_out"])), histories["w"]) < 2e-3


def oscillator(d, roughness=None, ends="free", start=0.0):
    beam = bridge(d, d["elements"])
    wheel, body = vf.Mass(d["mw"], name="wheel"), vf.Mass(d["ms"], name="body")
    path = vf.Path(d["v"], start=start, profile=roughness, ends=ends)
    weight = (d["mw"] + d["ms"]) * d["g"]
    low = -weight / d["kc"]
    effects = [
        vf.Contact(beam.along(path), wheel, gap=0.0, stiffness=d["kc"], acts_on="penetration", name="rail"),
        vf.Spring(body, wheel, stiffness=d["ks"]), vf.Dashpot(body, wheel, damping=d["cs"]),
        vf.PointLoad(wheel, -d["mw"] * d["g"]), vf.PointLoad(body, -d["ms"] * d["g"]),
    ]  # fmt: skip
    start_at = {wheel: (low, 0.0), body: (low - d["ms"] * d["g"] / d["ks"], 0.0)}
    return vf.Scene([beam, wheel, body], effects, initial=start_at), beam, wheel, body


@pytest.mark.parametrize(
    ("name", "steps", "wanted"),
    [("moving_oscillator_touching", 1000, 5e-4), ("moving_oscillator_separates", 2000, 1e-2)],
)
def test_a_sprung_wheel_on_a_beam(name, steps, wanted):
    d, values, histories = reference_case(f"moving/{name}")
    rough, errors = d["roughness"], []
    profile = rough and (lambda x: rough["amplitude"] * np.sin(2.0 * np.pi * x / rough["wavelength"]))
    scene, beam, wheel, body = oscillator(d, profile)
    t = histories["t"]
    for count in (steps, 2 * steps):
        result = vf.simulate(scene, t[-1], times=t, dt=t[-1] / count)
        found = (result.displacement(beam.at(d["x_out"])), result.displacement(body))
        errors.append(max(off(u, histories[key]) for u, key in zip(found, ("w_mid", "u_s"), strict=True)))
    assert errors[1] < wanted
    assert off(result.displacement(wheel), histories["u_w"]) < wanted
    assert 2.5 < errors[0] / errors[1] < 6.0
    assert ledger_error(result) < 1e-11
    # The wheel leaves and lands when it should.
    times = [time for time, _ in values["events"]]
    inside = result.solution.events.time[result.solution.events.time < t[-1] * (1 - 1e-9)]
    np.testing.assert_allclose(inside, times[: inside.size], rtol=0, atol=3e-4)
    assert abs(inside.size - len(times)) <= 1


def test_a_wheel_drives_on_and_off_a_rigid_road():
    d, _, _ = reference_case("moving/moving_oscillator_touching")
    scene, beam, _, body = oscillator(d, ends="rigid", start=-0.1 * d["L"])
    duration = 1.2 * d["L"] / d["v"]
    result = vf.simulate(scene, duration, dt=duration / 1500)
    before = result.times < 0.09 * d["L"] / d["v"]
    assert np.max(np.abs(result.displacement(beam.at(12.5))[before])) < 1e-15
    assert np.ptp(result.displacement(body)[before]) < 1e-12
    # Behind the bridge the body rests on the road again, and swings a little.
    weight = (d["mw"] + d["ms"]) * d["g"]
    assert result.contacts["rail"].force[-1] == pytest.approx(weight, rel=0.05)
    assert np.all(result.contacts["rail"].closed)
    assert ledger_error(result) < 1e-9
    away = vf.simulate(oscillator(d)[0], duration, dt=duration / 600)
    assert np.isnan(away.contacts["rail"].gap_function[-1])
    assert away.contacts["rail"].force[-1] == 0.0
    assert ledger_error(away) < 1e-11


def test_a_mass_that_is_tied_to_the_beam_below_it():
    d, _, histories = reference_case("moving/moving_mass")
    beam, t, errors = bridge(d, d["elements"]), histories["t"], []
    point = beam.along(vf.Path(d["v"]))
    weighed = vf.Scene([beam], [vf.PointMass(point, mass=d["Mm"]), vf.PointLoad(point, -d["Mm"] * d["g"])])
    for steps in (2000, 4000):
        result = vf.simulate(weighed, t[-1], times=t, dt=t[-1] / steps)
        errors.append(off(result.displacement(beam.at(d["x_out"])), histories["w"]))
    # The force jumps where the mass passes a node, and excites modes that these steps do not resolve.
    assert errors[1] < 5e-5
    assert 2.0 < errors[0] / errors[1] < 5.0
    assert ledger_error(result) < 1e-12
    # A run that goes on from the middle of the bridge finds the mass where it is, and as fast as it is.
    first = vf.simulate(weighed, 0.5, dt=1e-3)
    later = vf.simulate(weighed, 0.5, dt=1e-3, initial=first, t_start=0.5)
    whole = vf.simulate(weighed, 1.0, dt=1e-3)
    assert later.displacement(beam.at(5.0))[-1] == pytest.approx(whole.displacement(beam.at(5.0))[-1], rel=1e-3)
    assert ledger_error(later) < 1e-12
    # A mass that rests is the mass at that point.
    still = beam.along(vf.Path(0.0, start=3.0))
    scenes = [
        vf.Scene([beam], [vf.PointMass(p, mass=50.0), vf.PointLoad(beam.at(5.0), 1e3)]) for p in (still, beam.at(3.0))
    ]
    one, two = (vf.simulate(s, 0.2, method="energy_conserving", dt=1e-3).displacement(beam.at(5.0)) for s in scenes)
    np.testing.assert_allclose(one, two, rtol=0, atol=1e-12 * np.max(np.abs(two)))


def test_a_tied_mass_steps_onto_a_beam_and_off_it_at_supports_only():
    # Between the level of the supports and a deflected beam a tie would move it within one step, however short.
    cantilever = vf.Beam(1.0, EI=1.0, rhoA=1.0, elements=4, supports={"left": "clamped"}, name="cantilever")
    load = vf.PointLoad(cantilever.at(0.4), 1.0)
    for path, when in ((vf.Path(1.0, start=0.4), 0.6), (vf.Path(-0.5, start=1.3), 0.6), (vf.Path(0.3, 0.4, 0.5), 0.5)):
        scene = vf.Scene([cantilever], [vf.PointMass(cantilever.along(path), mass=0.1), load])
        with pytest.raises(vf.MethodError, match=f"at t = {when:g} s, where no support holds"):
            vf.simulate(scene, 1.0, dt=1e-2)
        with pytest.raises(vf.MethodError, match=f"at t = {when - 0.1:g} s, where no support holds"):
            vf.simulate(scene, 1.0, tol=1e-3, t_start=0.1)
        vf.simulate(scene, 0.4, dt=1e-2)
    # It may turn round before, and come and leave at the clamp.
    for path in (vf.Path(1.0, start=0.4, acceleration=-2.0), vf.Path(0.5, start=-0.1), vf.Path(-1.0, start=0.4)):
        vf.simulate(vf.Scene([cantilever], [vf.PointMass(cantilever.along(path), mass=0.1), load]), 1.0, dt=1e-2)


def test_a_tied_mass_takes_the_velocity_with_which_the_beam_guides_it():
    """The velocity at a support jumps by slope times speed: a mass that kept it would shake the beam in every step."""
    beam = vf.Beam(1.0, EI=1.0, rhoA=1.0, elements=4, supports=ENDS, name="beam")
    carried = vf.PointMass(beam.along(vf.Path(1.0, start=-0.3)), mass=0.5)
    scene, times = vf.Scene([beam], [carried, vf.PointLoad(beam.at(0.5), -1.0)]), [0.55, 0.95, 1.25, 1.45, 1.75]
    # Of the same elements, by an integration of order eight with a relative tolerance of 1e-11.
    known = np.array([0.10510254360, -0.11811123580, 0.20133607368, -0.01432384169, -0.02652456188])
    result = vf.simulate(scene, 1.8, method="energy_conserving", dt=5e-4, times=times)
    assert off(result.velocity(beam.at(0.5)), known) < 0.03
    assert ledger_error(result) < 1e-12
    assert vf.simulate(scene, 1.8, method="energy_conserving", tol=1e-2).counters.steps < 2000
    damped = vf.Scene([beam], [carried, *scene.effects[1:], vf.RayleighDamping(5.0)])
    settled = vf.simulate(damped, 8.0, method="energy_conserving", dt=5e-3, times=[0.0, 8.0])
    # Nothing that has left the beam moves on.
    assert settled.energy.kinetic[-1] < 1e-9
    assert ledger_error(settled) < 1e-12


@pytest.mark.kernels("plain")
@pytest.mark.parametrize(
    ("method", "options"),
    [("generalized_alpha", {"dt": 2e-3}), ("generalized_alpha", {"tol": 1e-2}), ("central_difference", {"dt": 1e-3})],
)
def test_a_tied_mass_comes_onto_a_beam_with_the_work_of_its_jump_by_all_methods(method, options):
    """The drive does the work m (speed slope)^2/2. It was lost, and steps under a tolerance became tiny there."""
    beam = vf.Beam(1.0, EI=1.0, rhoA=1.0, elements=4, supports=ENDS, name="beam")
    carried = vf.PointMass(beam.along(vf.Path(1.0, start=-0.3)), mass=0.5)
    scene = vf.Scene([beam], [carried, vf.PointLoad(beam.at(0.5), -1.0)])
    result = vf.simulate(scene, 0.45, method=method, times=[0.0, 0.25, 0.45], **options)
    # As `energy_conserving` finds with steps of 1e-4 s.
    assert result.displacement(beam.at(0.5))[1:] == pytest.approx([-0.037084, -0.027442], abs=3.7e-4)
    assert result.energy.balance_error < 3e-3
    assert result.counters.steps < 500


@pytest.mark.parametrize("kind", [vf.Spring, vf.Dashpot, vf.Contact])
def test_an_end_without_support_is_a_step_of_a_rigid_road(kind):
    """The beam that the wheel has left moves as without a road, by all methods, and dampers take no infinite rate."""
    numbers = {
        vf.Spring: {"stiffness": 20.0},
        vf.Dashpot: {"damping": 2.0},
        vf.Contact: {"gap": 0.0, "stiffness": 20.0, "damping": 1.0, "acts_on": "penetration"},
    }[kind]
    found, methods = [], ("energy_conserving", "generalized_alpha", "central_difference")
    for ends, method in (("free", "energy_conserving"), *(("rigid", m) for m in methods)):
        beam = vf.Beam(1.0, EI=1.0, rhoA=1.0, elements=4, supports={"left": "clamped"}, name="beam")
        wheel = vf.Mass(0.5, stiffness=2.0, name="wheel")
        law = kind(beam.along(vf.Path(1.0, start=0.4, ends=ends)), wheel, **numbers)
        effects = [law, vf.PointLoad(beam.at(1.0), -1.0), vf.PointLoad(wheel, -0.3)]
        result = vf.simulate(vf.Scene([beam, wheel], effects), 1.2, method=method, dt=1e-3, times=[0.8, 1.2])
        assert result.energy.balance_error < (1e-11 if method == "energy_conserving" else 5e-3)
        found.append((result.displacement(beam.at(1.0)), result.displacement(wheel)))
    np.testing.assert_allclose([beam for beam, _ in found[1:]], [found[0][0]] * 3, rtol=2e-3)
    np.testing.assert_allclose([wheel for _, wheel in found[2:]], [found[1][1]] * 2, rtol=5e-3)


def test_springs_and_dashpots_that_rest_on_a_path_are_ordinary_ones():
    beam = vf.Beam(2.0, EI=50.0, rhoA=1.0, elements=4, supports=ENDS, name="beam")
    load = vf.PointLoad(beam.at(1.0), vf.Sine(3.0, 11.0))
    runs = []
    for point in (beam.along(vf.Path(0.0, start=0.7)), beam.at(0.7)):
        effects = [load, vf.Spring(point, stiffness=400.0), vf.Dashpot(point, damping=3.0)]
        runs.append(vf.simulate(vf.Scene([beam], effects), 1.0, method="energy_conserving", dt=2e-3))
    np.testing.assert_allclose(
        runs[0].displacement(beam.at(1.0)), runs[1].displacement(beam.at(1.0)), rtol=0, atol=1e-12
    )  # fmt: skip
    np.testing.assert_allclose(runs[0].energy.dissipated, runs[1].energy.dissipated, rtol=0, atol=1e-12)
    moving = [
        load,
        vf.Spring(beam.along(vf.Path(1.3)), stiffness=400.0),
        vf.Dashpot(beam.along(vf.Path(0.8)), damping=3.0),
    ]
    assert ledger_error(vf.simulate(vf.Scene([beam], moving), 1.2, dt=4e-3)) < 1e-11


def test_contacts_that_travel_are_refused_where_they_must_be_and_drawn():
    beam, wheel = vf.Beam(2.0, EI=50.0, rhoA=1.0, elements=4, supports=ENDS, name="beam"), vf.Mass(0.1, name="wheel")
    path = vf.Path(1.0, profile=vf.Polynomial([0.0, 0.01]))
    rail = vf.Contact(beam.along(path), wheel, gap=0.0, stiffness=1e3, acts_on="penetration", name="rail")
    scene = vf.Scene([beam, wheel], [rail, vf.PointLoad(wheel, -1.0)])
    with pytest.raises(vf.MethodError, match=r"Contact 'rail' travels"):
        vf.simulate(scene, 1.0, method="event_driven")
    for refused in (
        lambda: vf.equilibrium(scene),
        lambda: vf.periodic(scene, period=1.0),
        lambda: vf.modes(vf.Scene([beam], [vf.Spring(beam.along(path), stiffness=1.0)]), 2),
    ):
        with pytest.raises(vf.VofemError, match="travels along a beam"):
            refused()
    result = vf.simulate(scene, 0.5, dt=5e-3)
    from vofem.io.pictures.snapshot import snapshots

    links = snapshots(result, np.array([0.25]))[0].links
    assert links[0].a.x == pytest.approx(0.25)


def test_supports_carry_what_travels_beside_them():
    """A slow wheel beside a support; a travelling spring there leaves the reaction open."""
    beam = vf.Beam(4.0, EI=1e6, rhoA=1.0, elements=4, supports=ENDS, name="beam")
    wheel = vf.Mass(1.0, damping=5.0, name="wheel")
    tyre = vf.Contact(beam.along(vf.Path(1.0)), wheel, gap=0.0, stiffness=1e4, acts_on="penetration", name="tyre")
    effects = [tyre, vf.PointLoad(wheel, -100.0), vf.RayleighDamping(20.0, 1e-4)]
    scene = vf.Scene([beam, wheel], effects, initial={wheel: (-0.01, 0.0)})
    result = vf.simulate(scene, 1.0, times=[0.3, 0.6, 0.9], method="energy_conserving", dt=1e-3)
    left, right = (result.reaction(beam, end).force for end in ("left", "right"))
    np.testing.assert_allclose(left + right, result.contacts["tyre"].force, rtol=1e-3)
    np.testing.assert_allclose(left, 100.0 * (1.0 - result.times / 4.0), rtol=2e-2)
    # Pictures leave out where the contact is on the beam, which no place at rest shows.
    upper, lower = np.ravel(plot.time_history(result, wheel))
    assert [line.get_label() for line in lower.lines] == ["tyre"]
    assert not any("closes" in str(line.get_label()) for line in upper.lines)
    assert not plot.shapes(result, [0.6]).get_legend_handles_labels()[1][1:]
    spring = vf.Spring(beam.along(vf.Path(1.0)), stiffness=1e3)
    held = vf.simulate(vf.Scene([beam], [spring]), 1.5, times=[0.5, 1.4], method="energy_conserving", dt=1e-2)
    np.testing.assert_array_equal(np.isnan(held.reaction(beam, "left").force), [True, False])


@pytest.mark.parametrize(("speed", "rounding"), [(100.0, 1e-6), (300.0, 1e-5), (1000.0, 1e-3)])
def test_a_force_that_crosses_a_beam_in_much_less_than_its_period_does_the_work_that_the_beam_takes(
    speed: float, rounding: float
) -> None:
    """Without dampers the work is the energy of the beam. Closed forms of it would be lost in rounding."""
    beam = vf.Beam(1.0, EI=1.0, rhoA=1.0, elements=10, supports={"left": "pinned", "right": "pinned"}, name="beam")
    force = vf.PointLoad(beam.along(vf.Path(speed)), -1.0)
    energy = vf.simulate(vf.Scene([beam], [force]), 1.0, method="event_driven").energy
    # Rounding grows with the fourth power of the speed, and depends on the machine.
    assert energy.balance_error < rounding
    assert energy.work[-1] == pytest.approx(energy.kinetic[-1] + energy.strain[-1], rel=rounding)
    # An impulse of all modes in the limit of infinite speed.
    assert energy.work[-1] == pytest.approx(0.5 / speed**2, rel=0.05)


@pytest.mark.parametrize("length", [1.0, 2.0**-20, 2.0**10])
def test_a_contact_that_comes_onto_its_beam_pressed_closes_at_that_moment(length):
    """The time lay anywhere in the step, and depended on the unit of length: points beside a beam stood 1 m away."""
    supports = {"left": "clamped"}
    beam = vf.Beam(length, EI=length**3, rhoA=1.0 / length, elements=4, supports=supports, name="beam")
    wheel = vf.Mass(1.0, stiffness=1.0, name="wheel")
    point = beam.along(vf.Path(0.5 * length, start=0.3 * length, begin=0.3))
    tyre = vf.Contact(point, wheel, gap=0.01 * length, stiffness=20.0, acts_on="penetration", name="tyre")
    scene = vf.Scene([beam, wheel], [tyre], initial={wheel: (-0.3 * length, 0.0)})
    result = vf.simulate(scene, 0.5, method="energy_conserving", dt=2.0**-6)
    np.testing.assert_allclose(result.contacts["tyre"].closings, [0.3], rtol=1e-12)
