"""The paper's cases against histories made by independent programs (tests/data/README.md)."""

import numpy as np
import pytest
from scenes import LAWS, paper_beam, reference, two_masses

import vofem as vf


@pytest.mark.parametrize("acts_on", LAWS)
@pytest.mark.parametrize("case", ["a", "b", "c"])
def test_two_masses_event_driven(case, acts_on):
    data = reference(f"two_masses_{case}_{acts_on}")
    first, second, scene = two_masses(case, acts_on)
    result = vf.simulate(scene, 100.0, times=data["t"])
    assert result.method == "event_driven"
    for mass, name in ((first, "xi1"), (second, "xi2")):
        assert np.max(np.abs(result.displacement(mass) - data[f"w_{name}"])) < 1e-9
        assert np.max(np.abs(result.velocity(mass) - data[f"v_{name}"])) < 1e-9
    contact = result.contacts["contact"]
    events = np.sort(np.concatenate([contact.closings, contact.openings]))
    assert events.shape == data["event_time"].shape
    assert np.max(np.abs(events - data["event_time"]), initial=0.0) < 1e-11
    assert np.max(np.abs(contact.force - data["contact_force"][0])) < 1e-9
    assert np.array_equal(contact.closed, data["contact_closed"][0])
    assert np.max(np.abs(result.energy.kinetic - data["kinetic"])) < 1e-8
    assert np.max(np.abs(result.energy.strain - data["strain"])) < 1e-8
    assert np.max(np.abs(result.energy.contact - data["contact_energy"])) < 1e-8
    assert result.energy.balance_error < 1e-12


@pytest.mark.parametrize("acts_on", LAWS)
def test_beam_tip_event_driven(acts_on):
    data = reference(f"beam_tip_{acts_on}")
    beam, scene = paper_beam(acts_on)
    result = vf.simulate(scene, 20.0, times=data["t"])
    for x, displacement, velocity in ((1.0, "tip", "tip_velocity"), (0.6, "at_0.6", "velocity_at_0.6")):
        for got, expected in (
            (result.displacement(beam.at(x)), data[displacement]),
            (result.velocity(beam.at(x)), data[velocity]),
        ):
            assert np.max(np.abs(got - expected)) < 1e-7 * np.max(np.abs(expected))
    stop = result.contacts["stop"]
    events = np.sort(np.concatenate([stop.closings, stop.openings]))
    assert events.shape == data["event_time"].shape
    assert np.max(np.abs(events - data["event_time"])) < 1e-9
    assert np.max(np.abs(stop.force - data["contact_force"][0])) < 1e-9
    for kind, name in (("kinetic", "kinetic"), ("strain", "strain"), ("contact", "contact_energy")):
        assert np.max(np.abs(getattr(result.energy, kind) - data[name])) < 1e-8 * np.max(data["strain"])
    assert result.energy.balance_error < 1e-12


@pytest.mark.parametrize("acts_on", LAWS)
def test_beam_shape_event_driven(acts_on):
    data = reference(f"beam_shape_{acts_on}")
    beam, scene = paper_beam(acts_on, gap=0.1, load=vf.Sine(1.0, 4.0))
    result = vf.simulate(scene, 5.0, times=data["t"])
    assert np.max(np.abs(result.displacement(beam.at(1.0)) - data["tip"])) < 1e-7
    x = beam.nodes[1:]
    shape, slope = result.deflection(x, data["snap_t"]), result.slope(x, data["snap_t"])
    assert np.max(np.abs(shape - data["snap_X"][0:50:2])) < 1e-8
    assert np.max(np.abs(slope - data["snap_X"][1:50:2])) < 1e-8
    assert np.array_equal(result.contacts["stop"].closed[[300, 1196]], data["snap_active"][0])


def observed_orders(errors):
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


def test_central_difference_is_of_second_order_for_the_penetration_law():
    data = reference("beam_tip_penetration")
    errors = []
    for dt in (4.8e-5, 2.4e-5, 1.2e-5):
        beam, scene = paper_beam("penetration")
        result = vf.simulate(scene, 20.0, method="central_difference", dt=dt, times=data["t"])
        errors.append(np.max(np.abs(result.displacement(beam.at(1.0)) - data["tip"])))
    assert errors[0] < 1e-8
    assert np.all(np.abs(observed_orders(errors) - 1.9) < 0.4)
