"""Cases and symmetries that codes of this kind get wrong, for event_driven; closed forms unless said otherwise."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import LAWS, paper_beam

import vofem as vf


@pytest.mark.parametrize(("zeta", "impacts"), [(0.05, 39), (0.1, 20), (0.3, 7)])
def test_nearly_zeno(zeta, impacts):
    """A damped stop brings a falling mass to rest in finitely many impacts; counts from an independent program."""
    g, omega = 10.0, 1e4
    mass = vf.Mass(1.0)
    stop = vf.Contact(
        mass, gap=0.0, stiffness=omega**2, damping=2.0 * zeta * omega, side="below", acts_on="penetration", name="stop"
    )
    result = vf.simulate(vf.Scene([mass], [stop, vf.Gravity(g)], initial={mass: (0.0, -1.0)}), 3.0)
    contact = result.contacts["stop"]
    assert contact.closings.size == impacts
    assert contact.openings.size == impacts - 1
    e = np.exp(-np.pi * zeta / np.sqrt(1.0 - zeta**2))
    assert contact.closings[-1] == pytest.approx(2.0 * e / (g * (1.0 - e)), rel=5e-3)
    assert result.displacement(mass)[-1] == pytest.approx(-g / omega**2, rel=1e-12)
    assert result.energy.balance_error < 1e-14


def bouncing_bar(count):
    """Length 10, E 900, density 1, g 10, dropped from 5, as a chain of masses on a stop as stiff as its springs."""
    h = 10.0 / count
    masses = [vf.Mass(h * (0.5 if i in (0, count) else 1.0)) for i in range(count + 1)]
    springs = [vf.Spring(a, b, stiffness=900.0 / h) for a, b in pairwise(masses)]
    stop = vf.Contact(masses[0], gap=5.0, stiffness=900.0 / h, side="below", acts_on="penetration", name="stop")
    scene = vf.Scene(masses, [*springs, stop, vf.Gravity(10.0)])
    return masses[0], vf.simulate(scene, 5.0, times=np.linspace(0.0, 5.0, 2001))


def test_bouncing_bar():
    """Doyen, Ern, Piperno, doi:10.1137/100791440: impacts at 1 and 11/3, releases at 5/3 and 13/3."""
    depths, errors = [], []
    for count in (50, 100, 200, 400):
        foot, result = bouncing_bar(count)
        stop = result.contacts["stop"]
        assert stop.closings[0] == pytest.approx(1.0, rel=1e-12)
        assert result.energy.balance_error < 1e-11
        depths.append(-np.min(result.displacement(foot) + 5.0))
        errors.append([stop.openings[0] - 5.0 / 3.0, stop.closings[1] - 11.0 / 3.0])
    # The depth of penetration is 6.2e-2 at 100 springs by an independent program.
    assert depths[1] == pytest.approx(6.2e-2, rel=5e-3)
    order = np.log2(np.array(depths[:-1]) / depths[1:])
    assert np.all((order > 0.85) & (order < 1.15))
    errors = np.array(errors)
    assert np.all((errors > 0.0) & (errors < 0.05))
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all((orders > 0.5) & (orders < 1.3))


@pytest.mark.parametrize("stiffness", [1e4, 1e8, 1e12])
def test_stiff_stops_finish(stiffness):
    """The paper's beam on a stop up to 1e12 times as stiff: finitely many events, energy in balance."""
    _, scene = paper_beam("penetration", stiffness=stiffness)
    result = vf.simulate(scene, 10.0)
    assert 0 < result.counters.events < 3000
    # Some hundred impacts, each of which amplifies rounding.
    assert result.energy.balance_error < (1e-9 if stiffness < 1e10 else 1e-8)
    assert np.min(result.contacts["stop"].force) >= 0.0


def test_free_beam_keeps_its_rigid_motion():
    """Statics refuses it by name, dynamics moves it exactly."""
    beam = vf.Beam(2.0, 3.0, 0.7, 12, {}, name="loose")
    scene = vf.Scene([beam], [vf.Gravity(2.0)], initial={beam: (0.0, vf.Polynomial([1.0, 0.3]))})
    with pytest.raises(vf.SingularSystemError, match="loose"):
        vf.equilibrium(scene)
    result = vf.simulate(scene, 5.0, times=np.linspace(0.0, 5.0, 11))
    x, t = np.array([0.0, 0.7, 2.0]), result.times
    exact = (1.0 + 0.3 * x)[:, None] * t - t**2
    assert result.deflection(x) == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize("ratio", [1e-6, 1e-12])
def test_collision_of_very_unequal_masses(ratio):
    heavy, light = vf.Mass(1.0), vf.Mass(ratio)
    contact = vf.Contact(light, heavy, gap=0.1, stiffness=10.0, acts_on="penetration", name="contact")
    result = vf.simulate(vf.Scene([heavy, light], [contact], initial={light: (0.0, 1.0)}), 0.3)
    history = result.contacts["contact"]
    reduced = ratio / (1.0 + ratio)
    assert history.closings == pytest.approx([0.1], rel=1e-13)
    assert history.openings - history.closings == pytest.approx([np.pi * np.sqrt(reduced / 10.0)], rel=1e-9)
    assert result.velocity(light)[-1] == pytest.approx((ratio - 1.0) / (1.0 + ratio), rel=1e-12)
    assert result.velocity(heavy)[-1] == pytest.approx(2.0 * ratio / (1.0 + ratio), rel=1e-10)


@pytest.mark.parametrize("acts_on", LAWS)
@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_decimal_units(acts_on, scale):
    """The paper's beam with lengths, masses and times in other units."""
    length, mass, time = scale, scale**0.5, 1.0 / scale
    outcomes = []
    for l, m, t in ((1.0, 1.0, 1.0), (length, mass, time)):  # noqa: E741
        force = m * l / t**2
        beam = vf.Beam(l, force * l**2, m / l, 10, {"left": "clamped"})
        stop = vf.Contact(
            beam.at("right"), gap=0.03 * l, stiffness=5.0 * force / l, side="below", acts_on=acts_on, name="stop"
        )
        scene = vf.Scene([beam], [stop, vf.PointLoad(beam.at("right"), vf.Sine(0.1 * force, 1.0 / t))])
        result = vf.simulate(scene, 8.0 * t, times=np.linspace(0.0, 8.0, 81) * t)
        outcomes.append((result.displacement(beam.at("right")) / l, result.contacts["stop"].closings / t))
    assert outcomes[0][1].size >= 2
    assert outcomes[1][0] == pytest.approx(outcomes[0][0], abs=1e-10 * np.max(np.abs(outcomes[0][0])))
    assert outcomes[1][1] == pytest.approx(outcomes[0][1], rel=1e-10)


def test_tiny_lengths_underflow_nowhere():
    """Lengths scaled by 4^-230, about 1e-138: products of two gap functions underflow, signs do not."""
    outcomes = []
    for l in (1.0, 4.0**-230):  # noqa: E741
        mass = vf.Mass(1.0, stiffness=1.0)
        stop = vf.Contact(mass, gap=0.5 * l, stiffness=30.0, side="above", acts_on="penetration", name="stop")
        result = vf.simulate(vf.Scene([mass], [stop], initial={mass: (0.0, l)}), 20.0)
        assert result.counters.events >= 8
        outcomes.append((result.displacement(mass) / l, result.contacts["stop"].closings))
    assert np.array_equal(outcomes[0][0], outcomes[1][0])
    assert np.array_equal(outcomes[0][1], outcomes[1][1])


@pytest.mark.parametrize("acts_on", LAWS)
def test_zero_and_unreachable_gaps(acts_on):
    """At gap 0 both laws are one spring on one side; a huge gap changes no bit."""
    times = np.linspace(0.0, 8.0, 201)

    def run(gap):
        mass = vf.Mass(1.0, stiffness=1.0)
        stops = []
        if gap is not None:
            stops.append(vf.Contact(mass, gap=gap, stiffness=8.0, side="above", acts_on=acts_on, name="stop"))
        return vf.simulate(vf.Scene([mass], stops, initial={mass: (0.0, -1.0)}), 8.0, times=times), mass

    result, mass = run(0.0)
    period = np.pi * (1.0 + 1.0 / 3.0)
    phase = np.mod(times, period)
    exact = np.where(phase < np.pi, -np.sin(phase), np.sin(3.0 * (phase - np.pi)) / 3.0)
    assert result.displacement(mass) == pytest.approx(exact, abs=1e-14)
    free, mass = run(None)
    for gap in (1.0 + 1e-9, 1e6, 1e60):
        far, same = run(gap)
        assert far.counters.events == 0
        assert np.array_equal(far.displacement(same), free.displacement(mass))


def test_many_stops_that_close_together():
    """A free beam falls flat on 25 stops: one event for all, symmetric ever after, finitely many events."""
    beam = vf.Beam(1.0, 0.1, 1.0, 24, {})
    stops = [
        vf.Contact(beam.at(x), gap=0.1, stiffness=1e3, side="below", acts_on="penetration", name=f"s{i}")
        for i, x in enumerate(beam.nodes)
    ]
    result = vf.simulate(vf.Scene([beam], stops, initial={beam: (0.0, -1.0)}), 0.3)
    closings = np.array([result.contacts[stop.name].closings[0] for stop in stops])
    assert closings == pytest.approx(np.full(25, 0.1), rel=1e-12)
    assert result.counters.events < 2000
    assert result.energy.balance_error < 1e-10
    shape = result.deflection(beam.nodes, np.linspace(0.0, 0.2, 21))
    assert np.max(np.abs(shape - shape[::-1])) < 1e-9
    assert np.all(np.array([result.contacts[stop.name].force for stop in stops]) >= 0.0)


def test_left_and_right():
    """A beam and its mirror image, loads, stops and all."""

    def run(side):
        at = (lambda x: x) if side == "left" else (lambda x: 1.0 - x)
        nodes = np.sort([at(x) for x in (0.0, 0.1, 0.25, 0.5, 0.8, 1.0)])
        beam = vf.Beam(1.0, 1.0, 1.0, nodes, {side: "clamped"})
        stop = vf.Contact(beam.at(at(0.8)), gap=0.01, stiffness=50.0, side="below", acts_on="penetration", name="stop")
        load = vf.PointLoad(beam.at(at(1.0)), vf.Sine(-0.2, 3.0))
        result = vf.simulate(vf.Scene([beam], [stop, load]), 5.0)
        return result.displacement(beam.at(at(1.0))), result.contacts["stop"].closings

    (tip, closings), (other, others) = run("left"), run("right")
    assert closings.size >= 2
    assert np.max(np.abs(tip - other)) < 1e-11 * np.max(np.abs(tip))
    assert others == pytest.approx(closings, rel=1e-11)


def test_chain_read_backwards():
    """Reversed and mirrored in sign: contacts of a before b become contacts of b after a."""

    def run(sign):
        masses = [vf.Mass(1.0 + 0.3 * i, stiffness=1.0, damping=0.02 * i) for i in range(4)]
        contacts = [
            vf.Contact(*((a, b) if sign > 0 else (b, a)), gap=0.05, stiffness=200.0, acts_on="penetration")
            for a, b in pairwise(masses)
        ]
        order = masses if sign > 0 else masses[::-1]
        result = vf.simulate(vf.Scene(order, contacts, {masses[0]: (0.0, sign * 1.0)}), 4.0)
        assert result.counters.events > 6
        return sign * np.stack([result.displacement(m) for m in masses])

    forward, backward = run(1.0), run(-1.0)
    assert np.max(np.abs(forward - backward)) < 1e-11 * np.max(np.abs(forward))


@settings(max_examples=10)
@given(share=st.floats(0.05, 0.95), stiffness=st.floats(0.5, 50.0), acts_on=st.sampled_from(LAWS))
def test_parallel_contacts_on_a_beam_add(share, stiffness, acts_on):
    """Eq. 14, within the chaos horizon."""
    outcomes = []
    for parts in ((share * stiffness, (1.0 - share) * stiffness), (stiffness,)):
        beam = vf.Beam(1.0, 1.0, 1.0, 5, {"left": "clamped"})
        stops = [vf.Contact(beam.at(1.0), gap=0.02, stiffness=k, side="below", acts_on=acts_on) for k in parts]
        scene = vf.Scene([beam], [*stops, vf.PointLoad(beam.at(1.0), vf.Sine(-0.2, 2.0))])
        result = vf.simulate(scene, 4.0, times=np.linspace(0.0, 4.0, 41))
        outcomes.append(result.displacement(beam.at(1.0)))
        horizon = result.solution.sensitivity.horizon(1e-11)
    within = np.linspace(0.0, 4.0, 41) <= horizon
    assert within.sum() > 10
    assert np.max(np.abs(outcomes[0] - outcomes[1])[within]) < 1e-10 * np.max(np.abs(outcomes[1]))
