"""Loads that are short or fast against the steps: exact moments, exact impulses, and notes where that is not enough."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import alone
from scipy.integrate import quad

import vofem as vf
from vofem.io import plot

METHODS = ["energy_conserving", "generalized_alpha", "central_difference"]

numbers = st.floats(-5.0, 5.0)
times = st.floats(0.0, 2.0)
functions = st.one_of(
    st.builds(vf.Constant, numbers),
    st.builds(vf.Sine, numbers, st.floats(-300.0, 300.0), numbers),
    st.builds(lambda slope, start, more: vf.Ramp(slope, start, start + more), numbers, times, st.floats(1e-3, 1.0)),
    st.builds(vf.Pulse, numbers, times, st.floats(1e-4, 1.0)),
    st.builds(lambda values: vf.Tabulated(np.linspace(0.1, 1.9, len(values)), values), st.lists(numbers, min_size=1)),
)


def moments(f, a, b):
    """By quadrature between breakpoints."""
    inner = f.breakpoints(b)
    edges = [a, *inner[inner > a], b]
    total = np.zeros(3)
    for left, right in itertools.pairwise(edges):
        for k, weight in enumerate((lambda x: 1.0, lambda x: x, lambda x: x * x - 1.0 / 12.0)):

            def part(t, weight=weight, right=right, left=left):
                inside = min(t, float(np.nextafter(right, left)))
                return float(f(inside)) * weight((t - 0.5 * (a + b)) / (b - a)) / (b - a)

            total[k] += quad(part, left, right, limit=400, epsabs=1e-12, epsrel=1e-12)[0]
    return total


@settings(max_examples=60, deadline=None)
@given(f=functions, other=functions, a=times, length=st.floats(1e-3, 1.5))
def test_moments_agree_with_quadrature(f, other, a, length):
    for function in (f, 2.0 * f - other):
        assert function.moments([a], [a + length])[:, 0] == pytest.approx(moments(function, a, a + length), abs=1e-9)


def test_moments_of_an_approximation_and_of_a_callable():
    def bell(t):
        return np.exp(-(((t - 1.0) / 0.2) ** 2))

    for f in (vf.Approximated(bell, 2.0, 1e-10), vf.PointLoad(vf.Mass(1.0), bell).f):
        for a, b in ((0.3, 0.5), (0.9, 1.4)):
            middle, h = 0.5 * (a + b), b - a
            weights = (lambda x: 1.0, lambda x: x, lambda x: x * x - 1.0 / 12.0)
            expected = [quad(lambda t, w=w, m=middle, h=h: bell(t) * w((t - m) / h) / h, a, b)[0] for w in weights]
            assert f.moments([a], [b], 1e-3)[:, 0] == pytest.approx(expected, abs=1e-9)


def response(times, impulse, at):
    """Return the motion of 1 kg on 4 N/m after an impulse."""
    return np.where(times > at, impulse / 2.0 * np.sin(2.0 * (times - at)), 0.0)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("width", [1e-4, 1e-3])
@pytest.mark.parametrize("options", [{}, {"dt": 0.01}, {"dt": 0.03}])
def test_no_pulse_is_passed_over(method, width, options):
    m, scene = alone(vf.Mass(1.0, 4.0), load=vf.Pulse(1.0 / width, 5.0123, width))
    result = vf.simulate(scene, 10.0, method=method, **options)
    expected = response(result.times, 1.0, 5.0123 + 0.5 * width)
    assert np.max(np.abs(result.displacement(m) - expected)) < 0.02 * 0.5
    if options:
        assert any("load" in note for note in result.notes)


@pytest.mark.parametrize("method", METHODS)
def test_a_sine_faster_than_the_steps_does_not_meet_the_resonance(method):
    m = vf.Mass(1.0, 4.0)
    omega = 630.3
    result = vf.simulate(vf.Scene([m], [vf.PointLoad(m, vf.Sine(100.0, omega))]), 10.0, method=method, dt=0.01)
    t = result.times
    expected = 100.0 / (4.0 - omega**2) * (np.sin(omega * t) - omega / 2.0 * np.sin(2.0 * t))
    assert np.max(np.abs(result.displacement(m) - expected)) < 0.02 * np.max(np.abs(expected))
    assert any(note.startswith("load") and "dt = " in note for note in result.notes)


@pytest.mark.parametrize("tol", [1e-3, 1e-5])
@pytest.mark.parametrize("stiffness", [4.0, 0.0])
def test_a_tolerance_holds_across_a_pulse_also_between_steps(tol, stiffness):
    m, scene = alone(vf.Mass(1.0, stiffness), load=vf.Pulse(1000.0, 5.0123, 1e-3))
    result = vf.simulate(scene, 10.0, method="energy_conserving", tol=tol)
    t = result.times
    late = np.clip(t - 5.0123, 0.0, 1e-3)
    after = np.maximum(t - 5.0133, 0.0)
    if stiffness:
        start, end = np.maximum(t - 5.0123, 0.0), after
        expected = 250.0 * ((1.0 - np.cos(2.0 * start)) - (1.0 - np.cos(2.0 * end)))
    else:
        expected = 500.0 * late**2 + after
    assert np.max(np.abs(result.displacement(m) - expected)) < 10.0 * tol * np.max(np.abs(expected))


@pytest.mark.parametrize("tol", [3e-3, 3e-2])
def test_steps_that_become_shorter_at_a_pulse_take_its_impulse_once(tol):
    linear, bilinear = vf.Mass(1.0, 100.1, damping=20.0), vf.Mass(1.0, 0.1, damping=20.0)
    spring = vf.BilinearSpring(bilinear, stiffness=100.0, linear_limit=0.01, hardening=0.01)
    pulse, times = vf.Pulse(3.0, 15.0, 0.02), np.linspace(14.9, 16.0, 401)
    right = vf.simulate(vf.Scene([linear], [vf.PointLoad(linear, pulse)]), 20.0, times=times).displacement(linear)
    # The spring does not yield.
    scene = vf.Scene([bilinear], [spring, vf.PointLoad(bilinear, pulse)])
    found = vf.simulate(scene, 20.0, method="generalized_alpha", tol=tol, times=times).displacement(bilinear)
    assert np.max(np.abs(found - right)) < 2.0 * tol * np.max(right)


def test_a_tolerance_holds_under_a_sine_whose_phase_the_steps_might_follow():
    """Steps that are large at one phase of the load only would add up to 1e-4."""
    m = vf.Mass(1.0, 4.0)
    omega, tol = 630.3, 1e-5
    result = vf.simulate(
        vf.Scene([m], [vf.PointLoad(m, vf.Sine(100.0, omega))]), 4.0, method="energy_conserving", tol=tol
    )
    t = result.times
    expected = 100.0 / (4.0 - omega**2) * (np.sin(omega * t) - omega / 2.0 * np.sin(2.0 * t))
    assert np.max(np.abs(result.displacement(m) - expected)) < 5.0 * tol * np.max(np.abs(expected))


def test_work_of_a_short_load_balances_the_energy():
    _, scene = alone(vf.Mass(1.0, 4.0), load=vf.Pulse(1000.0, 5.0123, 1e-3))
    for method, bound in (("energy_conserving", 1e-12), ("central_difference", 1e-12)):
        assert vf.simulate(scene, 10.0, method=method, dt=0.01).energy.balance_error < bound


def test_a_callable_is_looked_at_within_steps_and_a_note_says_how_often():
    m = vf.Mass(1.0, 4.0)

    def knock(t):
        return 100.0 * np.exp(-(((t - 5.0123) / 2e-3) ** 2))

    result = vf.simulate(vf.Scene([m], [vf.PointLoad(m, knock)]), 10.0, method="energy_conserving", dt=0.01)
    expected = response(result.times, 0.2 * np.sqrt(np.pi), 5.0123)
    assert np.max(np.abs(result.displacement(m) - expected)) < 0.02 * np.max(np.abs(expected))
    assert any(note.startswith("load") and "apart" in note for note in result.notes)


def test_approximated_finds_a_short_feature_and_tells_what_it_may_miss():
    f = vf.Approximated(lambda t: np.exp(-(((t - 5.0123) / 2e-3) ** 2)), 10.0, 1e-6)
    assert float(f(5.0123)) == pytest.approx(1.0, abs=1e-5)
    _, scene = alone(vf.Mass(1.0, 4.0), load=f)
    for method in ("energy_conserving", "event_driven"):
        notes = vf.simulate(scene, 10.0, method=method).notes
        assert any("load" in note and "0.00122 s apart" in note and "may be missed" in note for note in notes)


def test_a_ramp_on_steps_too_large_for_the_period_is_told():
    m = vf.Mass(1.0, 4.0)
    result = vf.simulate(vf.Scene([m], [vf.PointLoad(m, vf.Ramp(3.0, 1.2))]), 10.0, method="energy_conserving", dt=0.1)
    assert any(note.startswith("load") and "rad" in note for note in result.notes)


def test_a_frequency_in_hertz():
    assert vf.Sine(2.0, frequency=3.0) == vf.Sine(2.0, 6.0 * np.pi)
    for wrong in ({}, {"omega": 1.0, "frequency": 1.0}):
        with pytest.raises(vf.ArgumentError, match="expected one of them"):
            vf.Sine(1.0, **wrong)


def test_what_was_given_in_hertz_stays_in_hertz(tmp_path):
    m, scene = alone(vf.Mass(1.0, 100.0, damping=0.4, name="m"), load=vf.Sine(1.0, frequency=1.5))
    vf.dump_scene(scene, tmp_path / "scene.toml")
    assert "frequency = 1.5" in (tmp_path / "scene.toml").read_text()
    for one in (scene, vf.load_scene(tmp_path / "scene.toml").scene):
        assert "frequency=1.5" in repr(one.effects[0].f)
        orbit = vf.periodic(one)
        assert "1.5 Hz" in repr(orbit)
        assert plot.phase_portrait(orbit, one.bodies[0]).get_title().endswith("1.5 Hz")
    with pytest.raises(vf.ArgumentError, match=r"1\.5 Hz"):
        vf.periodic(vf.Scene([m], [*scene.effects, vf.PointLoad(m, vf.Sine(1.0, frequency=2.0**0.5))]))


@pytest.mark.parametrize("method", ["central_difference", "energy_conserving"])
def test_digits_do_not_depend_on_how_steps_fall_into_chunks(method, monkeypatch):
    mass = vf.Mass(1.0, stiffness=2.0, damping=0.1)
    scene = vf.Scene([mass], [vf.PointLoad(mass, 2 * vf.Sine(1.0, 3.1, 0.3) + 0.5)])
    runs = []
    for steps, chunk in ((300, 16384), (400, 16384), (400, 7)):
        monkeypatch.setattr("vofem.integrators.stepping.equal._MOST_STEPS", chunk)
        times = 0.37 * np.arange(290.0)
        runs.append(vf.simulate(scene, t_end=0.37 * steps, dt=0.37, method=method, times=times).displacement(mass))
    assert np.array_equal(runs[0], runs[1])
    assert np.array_equal(runs[1], runs[2])
