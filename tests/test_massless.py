"""Massless parts are refused by name; very light ones are what they tend to, springs."""

import numpy as np
import pytest
from scenes import cantilever

import vofem as vf
from vofem.errors import ArgumentError, StepSizeError

STABLE = ["event_driven", "energy_conserving", "generalized_alpha"]


@pytest.mark.parametrize("mass", [0, 0.0, 5e-324, 1e-61])
def test_a_massless_mass_is_refused_by_name_with_a_cure(mass):
    with pytest.raises(ArgumentError, match=r"Mass 'joint': mass is .*expected a positive number.*join what it conn"):
        vf.Mass(mass, stiffness=1.0, name="joint")


@pytest.mark.parametrize(
    ("rhoA", "where"),
    [
        (0.0, "is 0.0"),
        (1e-300, "is 1e-300"),
        ([1.0, 0.0, 1.0, 1.0], "is 0 in element 1"),
        (lambda x: np.maximum(0.0, x - 0.5), "is 0 at x = 0.125 m"),
        (lambda x: np.where(x < 0.5, 1e-70, 1.0), "is 1e-70 at x = 0.125 m"),
    ],
)
def test_a_massless_stretch_of_beam_is_refused_by_name(rhoA, where):
    with pytest.raises(ArgumentError, match=f"Beam 'rod': rhoA {where}.*expected a positive number"):
        vf.Beam(1.0, 1.0, rhoA, 4, {"left": "clamped"}, name="rod").matrices()


def test_a_point_mass_of_nothing_changes_nothing():
    beam = cantilever(4)
    load = vf.PointLoad(beam.at(1.0), 1.0)
    plain = vf.simulate(vf.Scene([beam], [load]), 1.0)
    loaded = vf.simulate(vf.Scene([beam], [load, vf.PointMass(beam.at(1.0), mass=0.0)]), 1.0)
    assert np.array_equal(plain.samples.q, loaded.samples.q)


def joint(ratio):
    """A mass of 1 kg, a spring of 1.5 N/m, a light joint, and a spring of 3 N/m to ground: 1 N/m in series."""
    heavy, light = vf.Mass(1.0, name="heavy"), vf.Mass(ratio, stiffness=3.0, name="light")
    spring = vf.Spring(heavy, light, stiffness=1.5)
    return heavy, vf.Scene([heavy, light], [spring], initial={heavy: (1.0, 0.0), light: (1.0 / 3.0, 0.0)})


@pytest.mark.parametrize("ratio", [1e-6, 1e-12])
@pytest.mark.parametrize("stiffness", [1.0, 30.0])
@pytest.mark.parametrize("method", STABLE)
def test_contact_of_a_light_part_tends_to_a_contact_with_springs_in_series(ratio, stiffness, method):
    times = np.linspace(0.0, 6.0, 61)
    heavy, light = vf.Mass(1.0, stiffness=1.0), vf.Mass(ratio)
    stop = vf.Contact(light, gap=0.1, side="below", stiffness=stiffness, acts_on="penetration")
    start = {heavy: (0.3, 0.0), light: (0.3, 0.0)}
    scene = vf.Scene([heavy, light], [vf.Spring(heavy, light, stiffness=3.0), stop], initial=start)
    step = {} if method == "event_driven" else {"dt": 2e-3}
    result = vf.simulate(scene, 6.0, method=method, times=times, **step)
    single = vf.Mass(1.0, stiffness=1.0)
    series = 3.0 * stiffness / (3.0 + stiffness)
    stop = vf.Contact(single, gap=0.1, side="below", stiffness=series, acts_on="penetration")
    limit = vf.simulate(vf.Scene([single], [stop], initial={single: (0.3, 0.0)}), 6.0, times=times)
    bound = 2.0 * ratio + (1e-13 if method == "event_driven" else 4e-6)
    assert np.max(np.abs(result.displacement(heavy) - limit.displacement(single))) < bound


@pytest.mark.parametrize("ratio", [1e-6, 1e-12])
def test_a_light_beam_tends_to_a_spring(ratio):
    times = np.linspace(0.0, 2.0, 21)
    beam = vf.Beam(1.0, 1.0, ratio, 10, {"left": "clamped"})
    start = {beam: (lambda x: 0.5 * (3.0 * x**2 - x**3), 0.0)}
    scene = vf.Scene([beam], [vf.PointMass(beam.at(1.0), mass=1.0)], initial=start)
    tip = vf.simulate(scene, 2.0, times=times).displacement(beam.at(1.0))
    assert np.max(np.abs(tip - np.cos(np.sqrt(3.0) * times))) < ratio + 1e-13


def test_central_differences_take_light_joints_while_they_can_and_refuse_lighter_ones():
    heavy, scene = joint(1e-7)
    result = vf.simulate(scene, 1.0, method="central_difference", times=[0.0, 1.0])
    assert result.displacement(heavy)[1] == pytest.approx(np.cos(1.0), abs=1e-6)
    _, scene = joint(1e-30)
    with pytest.raises(StepSizeError, match=r"steps: the critical step is .* masses of 1e-30 to 1 kg.*energy_conservi"):
        vf.simulate(scene, 1.0, method="central_difference")
