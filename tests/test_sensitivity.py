"""The growth of a perturbation, against two nearby runs."""

import numpy as np
import pytest
from scenes import LAWS, cantilever, paper_beam, two_masses

import vofem as vf
from vofem.integrators.event_driven.sensitivity import Perturbation


@pytest.mark.parametrize("acts_on", LAWS)
@pytest.mark.parametrize("case", ["b", "c"])
def test_growth_against_a_nearby_run(case, acts_on):
    """The jump of a perturbation at events included: ten closings and openings on the way."""
    first, second, scene = two_masses(case, acts_on)
    result = vf.simulate(scene, 40.0)
    assert result.counters.events > 6
    start = Perturbation(result.solution.space, None)
    shapes = result.solution.space.shapes
    size = 1e-7
    dq, dv = size * (shapes @ start._z), size * (shapes @ start._v)
    nearby = vf.Scene(scene.bodies, scene.effects, {first: (dq[0], -1.0 + dv[0]), second: (dq[1], dv[1])})
    other = vf.simulate(nearby, 40.0)
    parts = [f(m)[-1] - g(m)[-1] for m in (first, second) for f, g in (
        (other.displacement, result.displacement), (other.velocity, result.velocity))]  # fmt: skip
    assert result.sensitivity.growth[-1] == pytest.approx(np.log10(np.linalg.norm(parts) / size), abs=1e-3)


def test_growth_with_contact_dampers_against_a_nearby_run():
    """The force of a damper jumps at closing and at opening."""
    mass = vf.Mass(1.0, stiffness=1.0)
    stop = vf.Contact(mass, gap=0.3, stiffness=20.0, damping=2.0, side="above", acts_on="penetration", name="stop")
    effects = [stop, vf.PointLoad(mass, vf.Sine(1.0, 1.3))]
    result = vf.simulate(vf.Scene([mass], effects), 15.0)
    assert result.counters.events > 4
    start = Perturbation(result.solution.space, None)
    size = 1e-7
    nearby = vf.Scene([mass], effects, {mass: (size * start._z[0], size * start._v[0])})
    other = vf.simulate(nearby, 15.0)
    parts = [
        other.displacement(mass)[-1] - result.displacement(mass)[-1],
        other.velocity(mass)[-1] - result.velocity(mass)[-1],
    ]
    assert result.sensitivity.growth[-1] == pytest.approx(np.log10(np.linalg.norm(parts) / size), abs=1e-3)


def test_free_motion_neither_grows_nor_decays():
    beam = cantilever(6)
    result = vf.simulate(vf.Scene([beam], [vf.PointLoad(beam.at(1.0), vf.Sine(1.0, 2.0))]), 50.0)
    assert np.max(np.abs(result.sensitivity.growth)) < 1e-12
    assert result.sensitivity.horizon() == 50.0


def test_a_chaotic_run_says_so():
    """The jump law on a stiff stop: rounding decides after the first few contacts, near 4 s."""
    _, scene = paper_beam("displacement", stiffness=1e4)
    result = vf.simulate(scene, 20.0)
    assert result.sensitivity.growth[-1] > 50.0
    assert 3.8131 < result.sensitivity.horizon() < 4.5
    assert any("chaos: a perturbation grows" in note for note in result.notes)
    _, tame = paper_beam("displacement")
    calm = vf.simulate(tame, 20.0)
    assert calm.sensitivity.growth[-1] < 2.0
    assert not calm.notes


def test_a_stepping_run_has_none():
    _, scene = paper_beam("penetration", elements=2)
    result = vf.simulate(scene, 0.1, method="central_difference")
    with pytest.raises(vf.ArgumentError, match="central_difference does not tell its sensitivity"):
        _ = result.sensitivity
