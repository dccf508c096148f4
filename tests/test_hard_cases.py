"""Cases and symmetries that codes of this kind get wrong, for event_driven; closed forms unless said otherwise."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import LAWS, cantilever

import vofem as vf


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
        beam = cantilever(5)
        stops = [vf.Contact(beam.at(1.0), gap=0.02, stiffness=k, side="below", acts_on=acts_on) for k in parts]
        scene = vf.Scene([beam], [*stops, vf.PointLoad(beam.at(1.0), vf.Sine(-0.2, 2.0))])
        result = vf.simulate(scene, 4.0, times=np.linspace(0.0, 4.0, 41))
        outcomes.append(result.displacement(beam.at(1.0)))
        horizon = result.solution.sensitivity.horizon(1e-11)
    within = np.linspace(0.0, 4.0, 41) <= horizon
    assert within.sum() > 10
    assert np.max(np.abs(outcomes[0] - outcomes[1])[within]) < 1e-10 * np.max(np.abs(outcomes[1]))


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_decimal_units(scale):
    """The paper's beam under the jump law, with lengths, masses and times in other units."""
    length, mass, time = scale, scale**0.5, 1.0 / scale
    outcomes = []
    for l, m, t in ((1.0, 1.0, 1.0), (length, mass, time)):  # noqa: E741
        force = m * l / t**2
        beam = vf.Beam(l, force * l**2, m / l, 10, {"left": "clamped"})
        stop = vf.Contact(
            beam.at("right"), gap=0.03 * l, stiffness=5.0 * force / l, side="below", acts_on="displacement", name="stop"
        )
        scene = vf.Scene([beam], [stop, vf.PointLoad(beam.at("right"), vf.Sine(0.1 * force, 1.0 / t))])
        result = vf.simulate(scene, 8.0 * t, times=np.linspace(0.0, 8.0, 81) * t)
        outcomes.append((result.displacement(beam.at("right")) / l, result.contacts["stop"].closings / t))
    assert outcomes[0][1].size >= 2
    assert outcomes[1][0] == pytest.approx(outcomes[0][0], abs=1e-10 * np.max(np.abs(outcomes[0][0])))
    assert outcomes[1][1] == pytest.approx(outcomes[0][1], rel=1e-10)
