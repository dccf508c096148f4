"""What exact answers say beyond the catalogue of `vofem.verification`, which test_verification.py runs."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import published, quantity

import vofem as vf
from vofem.verification.cases.masses import bilinear, bilinear_period, release_on_a_stop


def test_second_contact_of_a_release_on_a_stop():
    """Its time and velocity, published as code_aster SDND101; the impulse there is 1.5e-4 off."""
    mass, scene = release_on_a_stop()
    result = vf.simulate(scene, 0.5)
    contact = result.contacts["stop"]
    assert contact.closings[0] == 0.0
    case = published("ca_sdnd101_release_stop")
    q = quantity(case, "impact_duration")
    assert contact.openings[1] - contact.closings[1] == pytest.approx(q["value"], abs=q["tolerance"])
    leaving = result.velocity(mass, t=contact.openings[1])[0]
    q = quantity(case, "impact_velocity")
    assert leaving == pytest.approx(q["value"], abs=q["tolerance"])


@pytest.mark.parametrize(("energy", "gap", "period"), [(1e-3, 0.01, 1.7956890733), (1.0, 0.01, 1.4108224620)])
def test_formula_of_the_bilinear_period(energy, gap, period):
    assert bilinear_period(energy, gap) == pytest.approx(period, abs=1e-10)


def test_frequency_of_the_bilinear_oscillator_as_recomputed():
    closings = vf.simulate(bilinear(0.00650108331626, 0.01), 20.0).contacts["stop"].closings
    q = quantity(published("ca_sdnd122_bilinear_nnm"), "frequency")
    assert 1.0 / np.diff(closings)[0] == pytest.approx(q["our_value"], rel=1e-9)


def test_rectangular_pulse_on_two_masses_as_recomputed():
    case = published("ansys_vm182_pulse_2dof")
    p = case["parameters"]
    upper, lower = vf.Mass(p["m1"]), vf.Mass(p["m2"], stiffness=p["k2"])
    effects = [vf.Spring(upper, lower, stiffness=p["k1"]), vf.PointLoad(upper, vf.Pulse(50.0, 0.0, 1.8))]
    result = vf.simulate(vf.Scene([upper, lower], effects), 3.0, times=[0.0, 1.3, 2.4])
    for name, mass, index in (("Y1", upper, 1), ("Y2", lower, 1), ("Y1", upper, 2)):
        q = quantity(case, name, f"t={(1.3, 2.4)[index - 1]}")
        assert result.displacement(mass)[index] == pytest.approx(q["our_value"], abs=5e-6)


def test_contact_times_of_a_cantilever_that_hits_a_stop():
    """Times of a converged beam; the other numbers of code_aster SDNL104 belong to its scheme."""
    p = published("ca_sdnl104_cantilever_stop")["parameters"]
    inertia, area = np.pi * p["R"] ** 4 / 4.0, np.pi * p["R"] ** 2
    beam = vf.Beam(p["L"], p["E"] * inertia, p["rho"] * area, 20, {"left": "clamped"})
    stop = vf.Contact(
        beam.at("right"), gap=p["gap"], stiffness=p["k_stop"], side="below", acts_on="penetration", name="stop"
    )
    result = vf.simulate(vf.Scene([beam], [stop, vf.PointLoad(beam.at("right"), -1000.0)]), 0.16)
    assert result.contacts["stop"].closings[0] == pytest.approx(0.03614, abs=1e-5)
    assert result.contacts["stop"].openings[0] == pytest.approx(0.09256, abs=1e-5)
