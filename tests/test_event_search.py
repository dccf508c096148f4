"""The search for events: nothing is missed, however short, and nothing is found that is not there."""

import numpy as np
import pytest
from scenes import cantilever, on_stop
from scipy.optimize import brentq

import vofem as vf


@pytest.mark.parametrize("eps", [1e-3, 1e-6, 1e-9])
def test_a_near_miss_is_no_event(eps):
    _, scene = on_stop(vf.Mass(1.0, stiffness=1.0), gap=1.0 + eps, stiffness=1.0, start=(0.0, 1.0))
    result = vf.simulate(scene, 20.0 * np.pi)
    assert result.counters.events == 0
    assert result.counters.gap_evaluations < 3000


def overdamped_spring(t):
    """z'' + 100 z' + z = 0 after a kick of 1 m/s."""
    kappa = np.sqrt(50.0**2 - 1.0)
    quick = 50.0 + kappa
    slow = 1.0 / quick
    decays = np.exp(-slow * t), np.exp(-quick * t)
    return (decays[0] - decays[1]) / (2.0 * kappa), (quick * decays[1] - slow * decays[0]) / (2.0 * kappa)


def overdamped_without_spring(t):
    """z'' + 100 z' = sin 2t from rest."""
    c, w = 100.0, 2.0
    decay = np.exp(-c * t)
    z = c / w * (1.0 - np.cos(w * t)) - np.sin(w * t) + w / c * (1.0 - decay)
    v = c * np.sin(w * t) - w * np.cos(w * t) + w * decay
    return z / (c**2 + w**2), v / (c**2 + w**2)


@pytest.mark.parametrize("eps", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize(
    ("exact", "stiffness", "load", "speed", "bracket"),
    [(overdamped_spring, 1.0, 0.0, 1.0, (1e-3, 1.0)), (overdamped_without_spring, 0.0, 1.0, 0.0, (1.0, 2.0))],
)
def test_grazing_of_overdamped_motions(exact, stiffness, load, speed, bracket, eps):
    """The top is reached within a hundredth of the slow decay, or by the load; just below and just above it."""
    top = brentq(lambda t: exact(t)[1], *bracket, xtol=1e-15)
    height = exact(top)[0]
    for gap, events in ((height * (1.0 - eps), 2), (height * (1.0 + eps), 0)):
        scene = on_stop(
            vf.Mass(1.0, stiffness, 100.0), load=vf.Sine(load, 2.0), start=(0.0, speed), gap=gap, stiffness=1e-9
        )[1]
        result = vf.simulate(scene, 2.5, method="event_driven")
        assert result.counters.events == events
        assert result.counters.gap_evaluations < 300
        if events:
            closing = result.contacts["stop"].closings[0]
            expected = brentq(lambda t, gap=gap: exact(t)[0] - gap, 1e-6, top, xtol=1e-15)
            # The root is known to the rounding of z divided by the rate there.
            assert closing == pytest.approx(expected, abs=1e-15 * height / exact(expected)[1] + 1e-14)
            assert closing < top < result.contacts["stop"].openings[0]


@pytest.mark.parametrize("side", ["below", "above"])
def test_a_heavily_damped_beam_that_starts_at_its_stop(side):
    """Its fast modes are overdamped, up to rates of 1e8 1/s, and decay at 100 1/s after that."""
    beam = cantilever(50)
    tip, scene = on_stop(
        beam.at(1.0), vf.RayleighDamping(0.0, 1e-2), load=vf.Sine(1.0, 5.0), gap=0.0, stiffness=100.0, side=side
    )
    times = np.linspace(0.0, 1.0, 101)
    result = vf.simulate(scene, 1.0, times=times, method="event_driven")
    assert result.counters.gap_evaluations < 1200
    assert result.energy.balance_error < 1e-11
    steps = vf.simulate(scene, 1.0, times=times, method="energy_conserving", dt=1e-3)
    apart = np.max(np.abs(result.displacement(tip) - steps.displacement(tip)))
    # The error of the steps; it is a sixteenth of this at a quarter of the step.
    assert 5e-7 < apart < 3e-6


def test_two_crossings_of_a_fast_mode_on_a_slow_one():
    """A ripple of 1 % of the amplitude and a hundred times the frequency crosses the gap many times."""
    a, b = vf.Mass(1.0, stiffness=1.0), vf.Mass(1.0, stiffness=1e4)
    contact = vf.Contact(a, b, gap=0.999, stiffness=1e-9, acts_on="penetration", name="c")
    result = vf.simulate(vf.Scene([a, b], [contact], initial={a: (0.0, 1.0), b: (0.0, 1.0)}), 3.0)
    t = np.linspace(0.0, 3.0, 300_001)
    above = np.sin(t) - 0.01 * np.sin(100.0 * t) > 0.999
    crossings = t[1:][above[1:] != above[:-1]]
    events = np.sort(np.concatenate([result.contacts["c"].closings, result.contacts["c"].openings]))
    assert events == pytest.approx(crossings, abs=2e-5)
    assert events.size >= 4


def test_corners_of_loads_are_segments_not_events():
    mass = vf.Mass(1.0, stiffness=1.0)
    table = vf.Tabulated([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 0.5, 0.0])
    result = vf.simulate(vf.Scene([mass], [vf.PointLoad(mass, table + vf.Pulse(1.0, 0.5, 0.25))]), 4.0)
    assert result.counters.events == 0
    assert result.counters.steps == 6
    assert result.energy.balance_error < 1e-14


def test_start_in_contact():
    """s > 0 is closed; s = 0 is closed where it moves in; both count from t = 0."""
    for displacement, velocity, closed in ((0.2, 0.0, True), (0.1, 1.0, True), (0.1, -1.0, False), (0.0, 0.0, False)):
        _, scene = on_stop(vf.Mass(1.0), gap=0.1, stiffness=1.0, start=(displacement, velocity))
        result = vf.simulate(scene, 0.1)
        history = result.contacts["stop"]
        assert history.closed[0] == closed
        assert (history.closings.size == 1 and history.closings[0] == 0.0) == closed


def test_free_chain_keeps_its_momentum():
    masses = [vf.Mass(m) for m in (1.0, 2.0, 0.5)]
    contacts = [
        vf.Contact(masses[0], masses[1], gap=0.1, stiffness=1e5, acts_on="penetration"),
        vf.Contact(masses[1], masses[2], gap=0.2, stiffness=1e3, acts_on="penetration"),
    ]
    result = vf.simulate(vf.Scene(masses, contacts, {masses[0]: (0.0, 1.0)}), 5.0)
    momentum = sum(m.mass * result.velocity(m) for m in masses)
    assert result.counters.events >= 4
    assert np.max(np.abs(momentum - 1.0)) < 1e-12
