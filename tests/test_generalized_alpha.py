"""The generalized-alpha method: its family, order, dissipation, contact inside the step, and where it stops."""

import numpy as np
import pytest
from scenes import alone, on_stop, two_masses

import vofem as vf
from vofem.integrators.stepping.methods import parameters

METHOD = {"method": "generalized_alpha"}


def test_parameters_of_chung_and_hulbert():
    def numbers(*given, **named):
        return parameters(*given, **named)[:4]

    assert numbers(0.8) == pytest.approx((0.6 / 1.8, 0.8 / 1.8, 0.5 + 0.2 / 1.8, 0.25 * (1 + 0.2 / 1.8) ** 2))
    assert numbers(1.0) == pytest.approx((0.5, 0.5, 0.5, 0.25))
    # Hilber, Hughes and Taylor at alpha = -0.1, and Newmark's average acceleration.
    assert numbers(alpha_m=0.0, alpha_f=0.1) == pytest.approx((0.0, 0.1, 0.6, 0.3025))
    assert numbers(alpha_m=0.0, alpha_f=0.0) == pytest.approx((0.0, 0.0, 0.5, 0.25))


def test_dissipation_grows_with_the_step_and_follows_rho():
    """At infinite frequency a step multiplies by rho; at small steps hardly anything is lost."""
    for rho in (0.0, 0.5, 0.8):
        mass, scene = alone(vf.Mass(1.0, stiffness=1.0), start=(1.0, 0.0))
        fast = vf.simulate(scene, 200e3, dt=1e3, rho_infinity=rho, **METHOD)
        # A double root at infinity: rho^n times a line in n, after an overshoot of (omega dt)^2.
        size = np.abs(fast.displacement(mass))
        assert size[100] <= 1e8 * 100 * max(rho, 0.1) ** 100
        assert rho < 0.5 or size[100] >= 1e-3 * rho**100
        slow = vf.simulate(scene, 20.0, dt=0.02, rho_infinity=rho, **METHOD)
        assert slow.energy.total[-1] == pytest.approx(0.5, rel=1e-3)
    still = vf.simulate(scene, 40e2, dt=1e2, rho_infinity=1.0, **METHOD)
    assert still.energy.total == pytest.approx(np.full(still.times.size, 0.5), rel=1e-9)


def test_order_two_for_smooth_scenes_and_penetration():
    mass, scene = alone(vf.Mass(1.0, stiffness=4.0, damping=0.3), load=vf.Sine(1.0, 1.3), start=(0.2, -1.0))
    first, _, contact = two_masses("c", "penetration")
    damped, impact = on_stop(vf.Mass(1.0), gap=0.05, stiffness=100.0, damping=4.0, start=(0.0, 1.0))
    cases = ((scene, mass, 10.0, 0.04), (contact, first, 40.0, 0.01), (impact, damped, 0.2, 2e-3))
    for options in ({}, {"rho_infinity": 0.3}, {"alpha_m": 0.0, "alpha_f": 0.0}):
        for case, point, t_end, dt in cases:
            times = np.linspace(0.0, t_end, 101)
            exact = vf.simulate(case, t_end, times=times).displacement(point)
            runs = [vf.simulate(case, t_end, dt=dt / 2**k, times=times, **METHOD, **options) for k in range(4)]
            errors = [np.max(np.abs(run.displacement(point) - exact)) for run in runs]
            found = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
            assert 1.8 < np.mean(found) < 2.2, (options, errors)


@pytest.mark.parametrize("rho", [1.0, 0.8])
def test_energy_grows_at_a_stiff_contact_and_the_run_stops(rho):
    """What energy_conserving holds to 1e-11 (its tests): here a typed error that names it."""
    _, scene = on_stop(vf.Mass(1.0, stiffness=1.0), gap=0.3, stiffness=1e4, start=(0.0, 1.0))
    for phase in (1.0, 5.0):
        with pytest.raises(vf.InstabilityError, match=r"blew up before t = .*method='energy_conserving'"):
            vf.simulate(scene, 1e6 * phase / 1e2, dt=phase / 1e2, rho_infinity=rho, times=[0.0], **METHOD)


def test_a_load_between_both_equilibria_holds_the_contact_at_its_gap():
    """The reaction lies between 0 and K0 gap: 0.9 N here. A step cannot rest there, but stays near."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=1.0)
    stop = vf.Contact(mass, gap=0.1, stiffness=100.0, side="above", acts_on="displacement", name="stop")
    scene = vf.Scene([mass], [stop, vf.PointLoad(mass, 1.0)])
    ends = []
    for dt in (1e-2, 1e-3):
        result = vf.simulate(scene, 20.0, dt=dt, rho_infinity=0.5, **METHOD)
        ends.append(np.max(np.abs(result.displacement(mass)[-200:] - 0.1)))
        assert any("chatter" in note for note in result.notes)
    # Two steps of the whole reaction of 10 N throw the mass against 0.9 N; which steps act is chance.
    assert ends[0] < (2.0 * 10.0 * 1e-2) ** 2 / (2.0 * 0.9) * 1.05
    assert ends[1] < 1e-3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rho_infinity": 1.2}, r"rho_infinity is 1.2, expected a number in \[0, 1\]"),
        ({"rho_infinity": -0.1}, "rho_infinity"),
        ({"rho_infinity": "high"}, "rho_infinity"),
        ({"newmark_beta": 0.0}, "not unconditionally stable"),
        ({"alpha_m": 0.9}, "not unconditionally stable"),
        ({"rho": 0.9}, "does not know the option 'rho'"),
    ],
)
def test_bad_parameters(options, message):
    mass = vf.Mass(1.0, stiffness=1.0)
    with pytest.raises(vf.ArgumentError, match=message):
        vf.simulate(vf.Scene([mass]), 1.0, dt=0.1, **METHOD, **options)


def driven(kind):
    """A mass that is loaded slowly, by a pulse, with a springpot, or against a soft stop; and its exact motion."""
    mass = vf.Mass(1.0, stiffness=4.0, damping=0.05, name="mass")
    load = vf.Pulse(100.0, 0.003, 1.234) if kind == "pulse" else vf.Sine(1.0, 1.7)
    effects = [vf.PointLoad(mass, load)]
    if kind == "stop":
        effects.append(vf.Contact(mass, side="above", gap=0.3, stiffness=100.0, acts_on="penetration"))
    if kind == "springpot":
        effects.append(vf.Springpot(mass, coefficient=0.5, order=0.5))
    scene, times = vf.Scene([mass], effects, initial={mass: (0.1, 0.0)}), np.linspace(0.0, 5.0, 501)
    exact = {"method": "energy_conserving", "dt": 5e-5} if kind == "springpot" else {"method": "event_driven"}
    return mass, scene, times, vf.simulate(scene, 5.0, times=times, **exact).displacement(mass)


@pytest.mark.parametrize("kind", ["smooth", "pulse", "stop", "springpot"])
def test_steps_that_follow_a_tolerance(kind):
    mass, scene, times, right = driven(kind)
    errors, steps = [], []
    # What was made before an impact grows by it as any perturbation does.
    growth = vf.simulate(scene, 5.0, method="event_driven").sensitivity.growth if kind == "stop" else [0.0]
    for tol in (1e-3, 1e-5):
        result = vf.simulate(scene, 5.0, times=times, tol=tol, **METHOD)
        errors.append(np.max(np.abs(result.displacement(mass) - right)) / np.max(np.abs(right)))
        steps.append(result.counters.steps)
        assert errors[-1] < 2.0 * tol * 10.0 ** max(growth)
        # A coarser run may differ by more than the tolerance after impacts, which is told.
        assert kind == "stop" or not any(note.startswith("tol:") for note in result.notes)
    # Errors follow the tolerance, and the steps of a method of order 2 its root.
    assert 20.0 < errors[0] / errors[1] < 500.0
    assert 5.0 < steps[1] / steps[0] < 20.0
    assert steps[0] < 1000


@pytest.mark.parametrize("rho", [0.0, 0.5, 1.0])
def test_the_acceleration_is_moved_where_the_step_changes(rho):
    mass, scene, times, right = driven("smooth")
    result = vf.simulate(scene, 5.0, times=times, tol=1e-4, rho_infinity=rho, **METHOD)
    assert np.max(np.abs(result.displacement(mass) - right)) < 2e-4 * np.max(np.abs(right))
    exact = vf.simulate(scene, 5.0, times=times, method="event_driven").acceleration(mass)
    assert np.max(np.abs(result.acceleration(mass)[1:] - exact[1:])) < 5e-3 * np.max(np.abs(exact))


def test_a_step_and_a_tolerance_are_refused():
    _, scene, _, _ = driven("smooth")
    with pytest.raises(vf.ArgumentError, match="dt and tol were both given"):
        vf.simulate(scene, 1.0, dt=0.1, tol=1e-3, **METHOD)


def test_a_tolerance_holds_between_the_ends_of_steps():
    """Three pulses leave neither velocity nor displacement behind, so that steps which contain them see nothing."""
    mass = vf.Mass(1.0, stiffness=1.0)
    begin, width, height, tol = 1.013, 0.002, 0.05, 1e-2
    push = height / (0.75 * width**2)
    load = vf.Pulse(push, begin, width) + vf.Pulse(-2.0 * push, begin + width, width)
    load += vf.Pulse(push, begin + 2.0 * width, width)
    scene = vf.Scene([mass], [vf.PointLoad(mass, load)], {mass: (1.0, 0.0)})
    times = np.linspace(0.0, 2.0, 4001)
    result = vf.simulate(scene, 2.0, method="generalized_alpha", tol=tol, times=times)
    exact = vf.simulate(scene, 2.0, method="event_driven", times=times).displacement(mass)
    bump = exact - np.cos(times)
    assert height * 0.9 < np.max(np.abs(bump)) < height * 1.1
    assert np.max(np.abs(result.displacement(mass) - exact)) < tol * np.max(np.abs(exact))
