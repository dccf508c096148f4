"""The growth of a perturbation, against two nearby runs."""

import numpy as np
import pytest
from scenes import LAWS, cantilever, on_stop, paper_beam, two_masses

import vofem as vf
from vofem.integrators.event_driven.sensitivity import first_change


def damped_stop():
    """The force of a damper jumps at closing and at opening."""
    mass = vf.Mass(1.0, stiffness=1.0)
    return on_stop(mass, load=vf.Sine(1.0, 1.3), gap=0.3, stiffness=20.0, damping=2.0)[1]


@pytest.mark.parametrize(
    ("build", "t_end", "events"),
    [
        *((lambda case=case, law=law: two_masses(case, law)[2], 40.0, 6) for case in "bc" for law in LAWS),
        (damped_stop, 15.0, 4),
    ],
)
def test_growth_against_a_nearby_run(build, t_end, events):
    """The jump of a perturbation at events included: ten closings and openings on the way."""
    scene, size = build(), 1e-7
    result = vf.simulate(scene, t_end)
    assert result.counters.events > events
    start, shapes = first_change(result.solution.space), result.solution.space.shapes
    dq, dv = (size * (shapes @ part) for part in start)
    state = scene.initial_state()
    initial = {body: (state.q[k] + dq[k], state.v[k] + dv[k]) for k, body in enumerate(scene.bodies)}
    other = vf.simulate(scene, t_end, initial=initial)
    apart = [getattr(other.samples, kind)[:, -1] - getattr(result.samples, kind)[:, -1] for kind in "qv"]
    assert result.sensitivity.growth[-1] == pytest.approx(np.log10(np.linalg.norm(apart) / size), abs=1e-3)


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


def test_a_run_with_friction_has_none_and_its_accuracy_can_be_studied():
    mass = vf.Mass(1.0, stiffness=1.0, name="mass")
    pad = vf.Friction(mass, coefficient=0.5, normal=1.0, name="pad")
    scene = vf.Scene([mass], [pad, vf.PointLoad(mass, vf.Sine(1.0, 2.0))])
    with pytest.raises(vf.ArgumentError, match="'pad' is in the scene, and runs with friction do not tell"):
        _ = vf.simulate(scene, 1.0, method="event_driven").sensitivity
    found = vf.accuracy.cheapest(scene, 5.0, 1e-3, methods=["event_driven"]).run
    assert found is not None
    assert found.total.largest < 1e-12
