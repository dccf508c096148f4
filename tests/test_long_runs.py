"""Runs of many events: nothing grows but the record, and roots are as good after a thousand events as after one."""

import numpy as np
import pytest
from scenes import alone, on_stop

import vofem as vf
from vofem.integrators.event_driven.search import EVALUATION_WORK, SEARCH_WORK


def bouncing(drop=0.05):
    """A mass that bounces on a stop under gravity."""
    return on_stop(vf.Mass(1.0), vf.Gravity(10.0), gap=0.0, stiffness=1e6, side="below", start=(drop, 0.0))


def test_energy_over_a_hundred_thousand_events():
    """A bilinear oscillator: energy to rounding, events where its period says, work per event constant."""
    stiffness = 1e4
    mass = vf.Mass(1.0, stiffness=1.0)
    stop = vf.Contact(mass, gap=0.0, stiffness=stiffness, side="above", acts_on="penetration", name="stop")
    period = np.pi * (1.0 + 1.0 / np.sqrt(1.0 + stiffness))
    scene = vf.Scene([mass], [stop], initial={mass: (0.0, -1.0)})
    few = vf.simulate(scene, 50.25 * period)
    many = vf.simulate(scene, 50_000.25 * period)
    assert many.counters.events == 100_000
    assert many.energy.balance_error < 1e-14
    assert many.contacts["stop"].closings[-1] == pytest.approx(50_000 * period - (period - np.pi), rel=1e-12)
    assert many.counters.gap_evaluations / many.counters.events < 1.1 * few.counters.gap_evaluations / 100
    assert many.counters.statuses == 2


def test_work_adds_up_over_many_bounces():
    """Durations of segments are kept, not taken as differences of times, whose rounding grows with time."""
    ball, scene = bouncing()
    result = vf.simulate(scene, 300.0, times=np.linspace(0.0, 300.0, 301))
    assert result.counters.events > 2500
    assert result.energy.balance_error < 1e-12
    assert result.displacement(ball).max() == pytest.approx(0.05, abs=1e-3)


def test_tables_of_many_knots():
    """A table of 10 000 knots: a segment each, at a constant cost."""
    t = np.linspace(0.0, 20.0, 10_001)
    mass, scene = alone(vf.Mass(1.0, stiffness=4.0), load=vf.Tabulated(t, np.sin(t)))
    result = vf.simulate(scene, 20.0, times=[0.0, 7.0, 20.0])
    assert result.counters.steps == 10_000
    exact = (np.sin(result.times) - 0.5 * np.sin(2.0 * result.times)) / 3.0
    # The table itself is off by h^2/8 = 5e-7 at most.
    assert result.displacement(mass) == pytest.approx(exact, abs=5e-7)


@pytest.mark.parametrize(
    ("heavier", "speed", "acts_on", "stiffness"),
    [(3.0, 0.7, "penetration", 0.0), (7.3, 0.3, "displacement", 0.0), (1.0, 0.3, "penetration", 5.0)],
)
def test_masses_that_fall_together_do_not_touch(heavier, speed, acts_on, stiffness):
    """A gap that stays zero is no contact: the rounding of the fall is no penetration, and costs no small steps."""
    a, b = vf.Mass(1.0, stiffness=stiffness), vf.Mass(heavier, stiffness=stiffness)
    contact = vf.Contact(a, b, gap=0.0, stiffness=1e6, acts_on=acts_on, name="contact")
    scene = vf.Scene([a, b], [contact, vf.Gravity()], initial={a: (0.1, speed), b: (0.1, speed)})
    result = vf.simulate(scene, 10.0)
    assert result.counters.events == 0
    assert result.counters.gap_evaluations < 2000
    assert np.all(result.contacts["contact"].force == 0.0)


def test_roots_within_rounding_of_a_sample():
    """A sample that lands on the root within rounding is no bound for it: 1e3 chattering events lose no energy."""
    mass = vf.Mass(0.18416499, damping=0.8762)
    below = [
        vf.Contact(mass, gap=-0.00148178, stiffness=0.00128961, side="below", acts_on="penetration"),
        vf.Contact(mass, gap=0.0129097, stiffness=4308.39, side="below", acts_on="displacement", name="jump"),
    ]
    start = {mass: (0.028386119557920933, -0.17137200139845143)}
    result = vf.simulate(vf.Scene([mass], [*below, vf.PointLoad(mass, -0.5847992)], start), 3.0)
    assert result.counters.events > 300
    gap = result.solution.contacts(result.contacts["jump"].closings).force / 4308.39 - 0.0129097
    assert np.max(np.abs(gap[1])) < 1e-16
    assert result.energy.balance_error < 1e-12


def test_a_field_on_one_element_between_two_supports():
    """At the nodes it is zero within rounding, which is no violation of a support."""
    beam = vf.Beam(0.582875, 1.0, 1.0, 1, {"left": "pinned", "right": "pinned"})
    length = beam.length
    shape = vf.Polynomial([0.0, 0.7 * 4.0 / length, -0.7 * 4.0 / length**2])
    result = vf.simulate(vf.Scene([beam], initial={beam: (0.0, shape)}), 0.1)
    assert result.velocity(beam.at(0.5 * length))[0] == pytest.approx(0.7, rel=1e-12)


def test_a_segment_ends_after_bounded_work():
    """A mass that swings beside a stop for long: the search returns from time to time, so that Ctrl-C is heard."""
    mass, scene = on_stop(vf.Mass(1.0, stiffness=4e4), gap=0.5, stiffness=1.0, start=(0.0, 90.0))
    result = vf.simulate(scene, 60.0, times=np.linspace(0.0, 60.0, 7), compiled=False)
    each = SEARCH_WORK // (1 + EVALUATION_WORK)
    assert result.counters.events == 0
    # Within rounding of the gap a search may take twice as many.
    assert each < result.counters.gap_evaluations <= 2 * each * result.counters.steps
    assert 2 <= result.counters.steps <= 2 + result.counters.gap_evaluations // each
    assert result.displacement(mass) == pytest.approx(0.45 * np.sin(200.0 * result.times), abs=1e-11)
    assert result.energy.balance_error < 1e-13
