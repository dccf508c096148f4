"""Hysteretic springs in motion: Eq. 22 as printed, and laws that remember in every stepping method."""

import pickle

import numpy as np
import pytest
from hunt_reference import HuntReference
from hunt_scenes import Case
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import cantilever
from scipy.integrate import solve_ivp

import vofem as vf
from vofem.laws import HystereticLaws

METHODS = ("energy_conserving", "generalized_alpha", "central_difference")
PAPER = {"stiffness": 1.0, "linear_limit": 5.0}


def triangle(top):
    return vf.Tabulated([0.0, 100.0, 200.0], [0.0, top, 0.0])


def printed(load, **initial):
    mass = vf.Mass(1.0, damping=1.0, name="m")
    spring = vf.HystereticSpring(mass, **PAPER, memory="printed", name="s")
    return mass, vf.Scene([mass], [spring, vf.PointLoad(mass, load)], **initial)


# -- Eq. 22 -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("top", "at_reversal", "at_end"),
    [(4.0, 3.96, 0.04), (6.0, 7.692670624324, 1.98317), (7.0, 12.88995377173, 6.51498)],
)
def test_a_triangular_load_as_printed(top, at_reversal, at_end):
    """Values of independent programs."""
    mass, scene = printed(triangle(top))
    result = vf.simulate(scene, 200.0, times=np.linspace(0.0, 200.0, 401))
    assert result.method == "force_driven"
    xi = result.displacement(mass)
    assert xi[200] == pytest.approx(at_reversal, abs=1e-12 * 13)
    assert xi[-1] == pytest.approx(at_end, abs=5e-6)
    assert result.energy.balance_error < 1e-13
    # The spring force does not jump at the reversal, and the residual stays.
    force = result.springs["s"].force
    around = vf.simulate(scene, 200.0, times=[100.0 - 1e-7, 100.0, 100.0 + 1e-7]).springs["s"].force
    assert around == pytest.approx(force[200], abs=1e-6)
    residual = xi - force
    assert np.ptp(residual[200:]) < 1e-12
    assert residual[-1] == pytest.approx(at_end - 0.01 * top, abs=5e-6)


def test_loading_follows_equation_22():
    """With a secant stiffness that falls with time, a second solver's values between."""
    mass, scene = printed(triangle(7.0))
    times = np.linspace(0.0, 100.0, 21)
    xi = vf.simulate(scene, 100.0, times=times).displacement(mass)

    def rates(t, y):
        force = 0.07 * t
        stiffness = (9.0 - force) / 4.0 if abs(y[0]) > 5.0 else 1.0
        return [y[1], force - y[1] - stiffness * y[0]]

    other = solve_ivp(rates, (0.0, 100.0), [0.0, 0.0], "LSODA", t_eval=times, rtol=1e-10, atol=1e-12, max_step=0.02)
    assert xi == pytest.approx(other.y[0], abs=2e-5)


def test_a_callable_load_is_followed_too():
    mass, scene = printed(lambda t: 6.0 * (t if t < 100.0 else 200.0 - t) / 100.0)
    result = vf.simulate(scene, 200.0, times=[0.0, 100.0, 200.0])
    assert result.displacement(mass) == pytest.approx([0.0, 7.692670624324, 1.98317], abs=1e-5)


def test_a_load_that_swings_turns_the_law_at_its_turning_points():
    """Within the linear limit Eq. 22 is linear; after a reversal the residual appears, and goes at the next rise."""
    mass, scene = printed(vf.Sine(7.0, 0.01))
    result = vf.simulate(scene, 600.0, times=np.linspace(0.0, 600.0, 6001))
    xi, force = result.displacement(mass), result.springs["s"].force
    turn = int(np.ceil(0.5 * np.pi / 0.01 * 10))
    assert np.max(xi) == pytest.approx(14.0, abs=0.1)
    falling = slice(turn + 5, int(1.5 * np.pi / 0.01 * 10) - 5)
    assert xi[falling] - force[falling] == pytest.approx(7.0, abs=0.1)
    assert result.energy.balance_error < 1e-12


def test_a_limit_load_in_time():
    _, scene = printed(vf.Ramp(0.1))
    with pytest.raises(vf.LimitLoadError, match=r"the load reaches 9 N at t = 90 s.* less than 9 N") as caught:
        vf.simulate(scene, 200.0)
    assert caught.value.time == pytest.approx(90.0, abs=1e-9)
    assert caught.value.limit == 9.0
    again = type(caught.value)(*caught.value.__reduce__()[1])
    assert (str(again), again.load) == (str(caught.value), caught.value.load)


# -- laws that remember -----------------------------------------------------------------------------


def swinging(kind, **options):
    mass = vf.Mass(1.0, damping=0.1, name="m")
    if kind == "bilinear":
        spring = vf.BilinearSpring(mass, stiffness=1.0, linear_limit=5.0, hardening=0.2, name="s")
    else:
        spring = vf.HystereticSpring(mass, **PAPER, memory="cyclic", name="s")
    return mass, vf.Scene([mass], [spring, vf.PointLoad(mass, vf.Sine(4.0, 0.8))], **options)


@pytest.fixture(scope="module")
def exact():
    """Times and motions by the independent integration of the searches over random scenes."""
    times, motions = np.linspace(0.0, 30.0, 31), {}
    for kind in ("cyclic", "bilinear"):
        mass, scene = swinging(kind)
        scene = vf.Scene(scene.bodies, scene.effects, {mass: (0.3, 1.0)})
        laws = {"contact": [], "smooth": [], "memory": [scene.effects[0]], "springpot": []}
        case = HuntReference(Case(scene, 30.0, "", {}, laws))
        motions[kind] = case.run(times, 100_000)[0]
        assert motions[kind].size == times.size
    return times, motions


@pytest.mark.parametrize("kind", ["cyclic", "bilinear"])
@pytest.mark.parametrize("method", METHODS)
def test_second_order_to_an_independent_solution(kind, method, exact):
    times, motions = exact
    errors = []
    # Yielding begins and ends within steps, so the error falls with the square of dt on the whole only.
    for dt in (0.04, 0.0025):
        mass, scene = swinging(kind)
        scene = vf.Scene(scene.bodies, scene.effects, {mass: (0.3, 1.0)})
        options = {"rho_infinity": 1.0} if method == "generalized_alpha" else {}
        result = vf.simulate(scene, 30.0, method=method, dt=dt, times=times, **options)
        errors.append(np.max(np.abs(result.displacement(mass) - motions[kind])))
    order = np.log2(errors[0] / errors[1]) / 4.0
    assert 1.75 < order < 2.25, (order, errors)
    assert errors[1] < 5e-5


@pytest.mark.parametrize("kind", ["cyclic", "bilinear"])
def test_steps_that_follow_a_tolerance(kind, exact):
    times, motions = exact
    mass, scene = swinging(kind)
    scene = vf.Scene(scene.bodies, scene.effects, {mass: (0.3, 1.0)})
    result = vf.simulate(scene, 10.0, method="energy_conserving", tol=1e-5, times=times[:11])
    assert result.counters.rejected > 0
    right = motions[kind][:11]
    assert np.max(np.abs(right)) > 5.0  # the springs yield
    assert np.max(np.abs(result.displacement(mass) - right)) < 3e-5 * np.max(np.abs(right))


def springs_on(points, kinds):
    """Return springs of several kinds on some points."""
    makers = {
        "cyclic": lambda p: vf.HystereticSpring(p, stiffness=3.0, linear_limit=0.2, memory="cyclic",
                                                softening=vf.LinearSoftening(0.5)),
        "tabulated": lambda p: vf.HystereticSpring(p, stiffness=3.0, linear_limit=0.2, memory="cyclic",
                                                   softening=lambda f: 1.0 - (0.6 / f) ** 0.7),
        "bilinear": lambda p: vf.BilinearSpring(p, stiffness=3.0, linear_limit=0.2, hardening=0.1),
        "iwan": lambda p: vf.IwanSpring(p, elongation=[0.1, 0.2, 0.5, 1.0], force=[0.5, 0.8, 1.2, 1.4]),
        "stop": lambda p: vf.CrushingStop(p, gap=0.1, side="below", stiffness=10.0, linear_limit=0.02,
                                          softening=vf.LinearSoftening(2.0)),
    }  # fmt: skip
    return [makers[kind](point) for point, kind in zip(points, kinds, strict=True)]


kinds = st.sampled_from(["cyclic", "tabulated", "bilinear", "iwan", "stop"])


@given(
    st.lists(kinds, min_size=1, max_size=3), st.floats(-2.0, 1.0), st.floats(-1.0, 2.0), st.floats(0.0, 5.0),
    st.floats(0.1, 5.0),
)  # fmt: skip
@settings(max_examples=40)
def test_the_balance_of_energy_closes(chosen, log_dt, log_speed, force, omega):
    """Whatever the step, with several springs at once, loads, dampers and a contact beside them."""
    masses = [vf.Mass(1.0 + k, 0.1, damping=0.02 * k) for k in range(len(chosen))]
    effects = springs_on(masses, chosen)
    effects.append(vf.PointLoad(masses[0], vf.Sine(force, omega)))
    effects.append(vf.Contact(masses[-1], gap=0.5, stiffness=50.0, side="above", acts_on="penetration"))
    initial = {masses[0]: (0.1, 10.0**log_speed)}
    dt = 10.0**log_dt
    result = vf.simulate(vf.Scene(masses, effects, initial), 200 * dt, method="energy_conserving", dt=dt)
    assert result.energy.balance_error < 1e-10
    assert result.counters.memory_updates == len(chosen) * 200
    total = np.zeros(result.times.size)
    for spring in result.springs.values():
        assert np.all(np.diff(spring.dissipated) >= 0.0)
        assert np.all(spring.stored >= 0.0)
        total += spring.dissipated
    assert np.all(result.energy.dissipated >= total - 1e-12 * total)


@pytest.mark.parametrize("method", METHODS)
def test_hysteretic_supports_of_a_beam(method):
    """Between nodes and at the tip, several at once; both the balance and the loop's area."""
    beam = cantilever(6)
    effects = springs_on([beam.at(0.4), beam.at(0.77), beam.at(1.0)], ["bilinear", "cyclic", "iwan"])
    effects.append(vf.PointLoad(beam.at(1.0), vf.Sine(3.0, 2.0)))
    dt = {"energy_conserving": 2e-3, "generalized_alpha": 1e-3, "central_difference": 5e-4}[method]
    result = vf.simulate(vf.Scene([beam], effects), 8.0, method=method, dt=dt)
    assert result.energy.balance_error < {"energy_conserving": 1e-10}.get(method, 2e-4)
    for spring in result.springs.values():
        work = np.sum(0.5 * (spring.force[1:] + spring.force[:-1]) * np.diff(spring.elongation))
        assert work == pytest.approx(spring.dissipated[-1] + spring.stored[-1], rel=2e-4)
    assert result.springs[effects[2].name].dissipated[-1] > 0.1
    reaction = result.reaction(beam, "left")
    inertia = (beam.matrices().mass @ np.zeros(beam.size)).sum()
    assert np.all(np.isfinite(reaction.force))
    assert inertia == 0.0


def test_reaction_with_a_hysteretic_support():
    """At rest under a constant load, damped: the support bears what the spring does not."""
    beam = cantilever(4)
    spring = vf.HystereticSpring(
        beam.at(1.0), stiffness=10.0, linear_limit=0.05, softening=vf.LinearSoftening(0.4), memory="cyclic", name="s"
    )
    effects = [spring, vf.PointLoad(beam.at(1.0), 1.5), vf.RayleighDamping(5.0, 0.02)]
    result = vf.simulate(vf.Scene([beam], effects), 40.0, dt=0.02)
    assert result.reaction(beam, "left").force[-1] == pytest.approx(result.springs["s"].force[-1] - 1.5, abs=1e-6)
    with pytest.raises(vf.ArgumentError, match="name the times in times="):
        result.reaction(beam, "left", [0.01])


def test_dissipation_is_the_loop_area_in_a_steady_state():
    mass, scene = swinging("bilinear")
    result = vf.simulate(scene, 400.0, dt=0.01)
    period = 2.0 * np.pi / 0.8
    times = np.linspace(400.0 - period, 400.0, 2001)
    late = vf.simulate(scene, 400.0, dt=0.01, times=times)
    spring = late.springs["s"]
    area = np.sum(0.5 * (spring.force[1:] + spring.force[:-1]) * np.diff(spring.elongation))
    plastic = 0.5 * np.ptp(spring.elongation) - 5.0
    assert spring.dissipated[-1] - spring.dissipated[0] == pytest.approx(area, rel=1e-4)
    assert area == pytest.approx(4.0 * 0.8 * 5.0 * plastic, rel=1e-3)
    assert late.displacement(mass)[-1] == pytest.approx(late.displacement(mass)[0], abs=1e-3)
    assert result.energy.balance_error < 1e-10


@pytest.mark.parametrize("method", METHODS)
def test_a_run_goes_on_with_the_past_of_its_springs(method):
    """Two runs one after the other, the load shifted, are one run."""
    load = vf.Tabulated([0.0, 5.0, 20.0], [0.0, 8.0, -8.0])
    shifted = vf.Tabulated([0.0, 10.0], [float(load(10.0)), -8.0])
    options = {"method": method, "dt": 0.01} | ({"rho_infinity": 1.0} if method == "generalized_alpha" else {})
    mass = vf.Mass(1.0, damping=0.5, name="m")
    spring = vf.HystereticSpring(mass, **PAPER, memory="cyclic", name="s")
    whole = vf.simulate(vf.Scene([mass], [spring, vf.PointLoad(mass, load)]), 20.0, **options)
    first = vf.simulate(vf.Scene([mass], [spring, vf.PointLoad(mass, load)]), 10.0, **options)
    assert first.springs["s"].dissipated[-1] > 1.0
    second = vf.simulate(vf.Scene([mass], [spring, vf.PointLoad(mass, shifted)], first), 10.0, **options)
    assert second.displacement(mass)[-1] == pytest.approx(whole.displacement(mass)[-1], abs=2e-4)
    assert second.springs["s"].dissipated[0] == 0.0
    forgetful = vf.Scene(
        [mass], [spring, vf.PointLoad(mass, shifted)], {mass: tuple(float(part[0]) for part in first.state_of("m"))}
    )
    assert abs(vf.simulate(forgetful, 10.0, **options).displacement(mass)[-1] - whole.displacement(mass)[-1]) > 0.1


def test_a_run_starts_from_the_end_of_a_path():
    """Loaded to 7 N and unloaded, the mass hangs at rest at its residual elongation."""
    mass = vf.Mass(1.0, name="m")
    spring = vf.HystereticSpring(mass, **PAPER, memory="cyclic", name="s")
    rest = vf.quasi_static(vf.Scene([mass], [spring, vf.PointLoad(mass, 1.0)]), [7.0, 0.0])
    result = vf.simulate(vf.Scene([mass], [spring], rest), 5.0, dt=0.01)
    assert result.displacement(mass) == pytest.approx(7.0, abs=1e-12)
    result = vf.simulate(vf.Scene([mass], [spring], {mass: rest}), 5.0, dt=0.01)
    assert result.displacement(mass) == pytest.approx(7.0, abs=1e-12)


@given(st.sampled_from(METHODS), st.sampled_from(["cyclic", "bilinear"]), st.integers(-3, 3))
@settings(max_examples=15)
def test_mirror_and_units_change_no_bit(method, kind, power):
    """Forces, masses and stiffnesses by a power of four; all in the other direction."""
    results = []
    for scale, sign in ((1.0, 1.0), (4.0**power, 1.0), (1.0, -1.0)):
        mass = vf.Mass(scale, damping=0.1 * scale, name="m")
        if kind == "cyclic":
            spring = vf.HystereticSpring(
                mass, stiffness=scale, linear_limit=5.0, softening=vf.LinearSoftening(4.0 * scale), memory="cyclic"
            )
        else:
            spring = vf.BilinearSpring(mass, stiffness=scale, linear_limit=5.0, hardening=0.25)
        load = vf.PointLoad(mass, vf.Sine(4.0 * scale * sign, 0.8))
        scene = vf.Scene([mass], [spring, load], {mass: (0.3 * sign, sign)})
        results.append(sign * vf.simulate(scene, 20.0, method=method, dt=0.05).displacement(mass))
    assert np.array_equal(results[0], results[1])
    assert np.array_equal(results[0], results[2])


def test_critical_step_counts_the_first_stiffness():
    mass = vf.Mass(1.0, name="m")
    spring = vf.BilinearSpring(mass, stiffness=100.0, linear_limit=1.0, hardening=0.1)
    with pytest.raises(vf.StepSizeError, match=r"0\.2 s"):
        vf.simulate(vf.Scene([mass], [spring]), 10.0, method="central_difference", dt=0.21)


def test_absent_memory_costs_nothing():
    mass = vf.Mass(1.0, 1.0, name="m")
    for method in METHODS:
        result = vf.simulate(vf.Scene([mass], initial={mass: (0.0, 1.0)}), 1.0, method=method, dt=0.01)
        assert result.counters.memory_updates == 0
        assert len(result.springs) == 0
        assert result.solution.springs is None
        assert not result.model.system.recorded
        assert not any(isinstance(group, HystereticLaws) for group in result.model.system.laws)


def test_cycles_of_a_slider_in_closed_form():
    """Of a slider that yields at F_y: 4 F_y (a - d) in a cycle of the amplitude a, and a secant stiffness F_y/a."""
    mass = vf.Mass(1.0, stiffness=50.0)
    slider = vf.BilinearSpring(mass, stiffness=200.0, linear_limit=0.01, name="slider")
    scene = vf.Scene([mass], [slider, vf.PointLoad(mass, vf.Sine(6.0, 1.0))])
    times = np.linspace(0.0, 60.0, 6001)
    cycles = vf.simulate(scene, 60.0, method="energy_conserving", dt=0.01, times=times).springs["slider"].cycles()
    steady = np.array([cycles[name][-1] for name in ("amplitude", "loss", "stiffness", "damping_ratio")])
    a, loss, stiffness, ratio = steady
    assert a > 0.05
    assert loss == pytest.approx(4.0 * 2.0 * (a - 0.01), rel=0.02)
    assert stiffness == pytest.approx(2.0 / a, rel=0.02)
    assert ratio == pytest.approx(2.0 / np.pi * (1.0 - 0.01 / a), rel=0.03)
    assert cycles.units["loss"] == "J"
    assert vf.simulate(scene, 0.1, method="energy_conserving", dt=0.01).springs["slider"].cycles().rows == 0


def test_a_scene_that_was_run_can_be_sent_to_another_process():
    """What a run keeps with the laws of a scene, such as addresses of machine code, stays behind."""
    mass = vf.Mass(1.0, name="m")
    stop = vf.Contact(mass, gap=0.2, stiffness=50.0, side="above", acts_on="penetration")
    spring = vf.BilinearSpring(mass, stiffness=1.0, linear_limit=0.1, hardening=0.2)
    scene = vf.Scene([mass], [spring, stop, vf.PointLoad(mass, vf.Sine(0.3, 1.3))])
    result = vf.simulate(scene, 5.0, method="energy_conserving", dt=0.01)
    assert result.energy.strain[-1] > 0.0
    other = vf.simulate(pickle.loads(pickle.dumps(scene)), 5.0, method="energy_conserving", dt=0.01)
    assert np.array_equal(other.samples.q, result.samples.q)
