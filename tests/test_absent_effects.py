"""What a scene does not call for is not built, not evaluated and not counted."""

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest
from scenes import cantilever, paper_beam

import vofem as vf
from vofem.assembly import SystemBuilder
from vofem.integrators import event_driven
from vofem.integrators.stepping import run as stepping
from vofem.laws import ContactLaws, LawGroup, python

pytestmark = pytest.mark.kernels("plain")

METHODS = ("event_driven", "energy_conserving", "generalized_alpha", "central_difference")


def run(scene, method, t_end=0.5, **options):
    return vf.simulate(scene, t_end, method=method, times=np.linspace(0.0, t_end, 11), **options)


def nonzero(counters):
    return {field.name for field in dataclasses.fields(counters) if getattr(counters, field.name)}


def refuse(*_args, **_kwargs):
    raise AssertionError("an absent effect was built or evaluated")


@pytest.mark.parametrize("method", METHODS)
def test_counters_of_a_bare_beam(method):
    beam = cantilever(5)
    scene = vf.Scene([beam], initial={beam: (lambda x: 0.01 * x**2, 0.0)})
    result = run(scene, method)
    expected = {
        "event_driven": {"steps", "eigensolves", "statuses"},
        "energy_conserving": {"steps", "factorizations"},
        "generalized_alpha": {"steps", "factorizations"},
        "central_difference": {"steps", "eigensolves", "factorizations"},
    }
    assert nonzero(result.counters) == expected[method]
    assert scene.model.system.damping is None
    assert scene.model.system.contacts is None
    assert scene.model.system.loads == ()
    assert np.all(result.energy.dissipated == 0.0)
    assert np.all(result.energy.work == 0.0)
    assert np.all(result.energy.contact == 0.0)


@pytest.mark.parametrize("method", METHODS)
def test_builders_of_absent_effects_are_never_called(method, monkeypatch):
    for name in (
        "add_stiffness", "add_strains", "add_damping", "add_mass", "add_rayleigh", "add_modal_damping",
        "add_point_load", "add_body_load", "add_acceleration", "add_contact", "add_law", "add_tied_mass",
        "add_travelling_load", "add_travelling_law",
    ):  # fmt: skip
        monkeypatch.setattr(SystemBuilder, name, refuse)
    monkeypatch.setattr(ContactLaws, "force", refuse)
    monkeypatch.setattr(stepping, "initial_status", refuse)
    monkeypatch.setattr(python, "Callbacks", refuse)
    monkeypatch.setattr(LawGroup, "virgin", refuse)
    monkeypatch.setattr(LawGroup, "alone", property(refuse))
    beam = cantilever(5)
    result = run(vf.Scene([beam], initial={beam: (lambda x: 0.01 * x**2, 0.0)}), method)
    assert np.max(np.abs(result.displacement(beam.at(1.0)))) > 0.0
    assert result.counters.gap_evaluations == 0


def test_contact_without_reach_costs_gap_evaluations_only():
    _, scene = paper_beam("penetration", gap=10.0)
    result = run(scene, "event_driven")
    assert result.counters.gap_evaluations > 0
    assert result.counters.rank_one_updates == 0
    assert result.counters.statuses == 1


def test_undamped_scene_never_touches_damping():
    _, scene = paper_beam("displacement", elements=5)
    for method in METHODS:
        result = run(scene, method, 4.0)
        assert result.counters.events > 0
        assert result.counters.damping_evaluations == 0


def test_fast_modes_do_not_drive_the_search():
    """Four times the elements, sixteen times the highest frequency: the same number of gap evaluations."""
    looks = []
    for elements in (25, 100):
        _, scene = paper_beam("penetration", elements=elements)
        looks.append(vf.simulate(scene, 20.0).counters.gap_evaluations)
    assert looks[1] <= 1.5 * looks[0]


def test_explain_says_what_the_scene_does_not_have():
    beam = cantilever(5, name="deck")
    text = str(vf.explain(vf.Scene([beam], [vf.PointLoad(beam.at(1.0), vf.Sine(1.0, 1.0))])))
    assert "Beam 'deck': 5 elements, clamped at x = 0" in text
    assert "Method: event_driven" in text
    assert "Not in the scene: contacts, contact dampers, damping" in text
    explanation = vf.explain(vf.Scene([beam], [vf.PointLoad(beam.at(1.0), lambda t: t)]))
    assert explanation.method == "energy_conserving"
    assert "closed form" in explanation.why


def test_explain_says_where_bodies_start():
    beam, mass = cantilever(5, name="deck"), vf.Mass(1.0, name="ball")
    assert "Start\n  at rest\n" in str(vf.explain(vf.Scene([beam, mass])))
    start = {mass: (0.1, -2.0), beam: vf.equilibrium(vf.Scene([beam]))}
    assert vf.explain(vf.Scene([beam, mass], initial=start)).start == (
        "Mass 'ball': displacement 0.1 m, velocity -2 m/s",
        "Beam 'deck': Equilibrium",
    )


def test_displacements_do_not_cost_accelerations(monkeypatch):
    """What is not asked of a run in modes is not computed, and parts of it have the bits of the whole."""
    beam, scene = paper_beam("penetration", elements=5)
    result = run(scene, "event_driven", 4.0)
    monkeypatch.setattr(event_driven.EventSolution, "acceleration", refuse)
    point = beam.at(1.0)
    whole = result.samples.q
    np.testing.assert_array_equal(result.displacement(point), whole[-2])
    np.testing.assert_array_equal(result.samples.take(np.array([3, 1])).v, result.samples.v[[3, 1]])
    with pytest.raises(AssertionError, match="absent effect"):
        result.acceleration(point)


def test_ideal_switches_have_no_quadrature(monkeypatch):
    monkeypatch.setattr(np.polynomial.legendre, "leggauss", refuse)
    _, scene = paper_beam("penetration", elements=5)
    for method in METHODS[1:]:
        assert run(scene, method, 4.0).energy.contact.max() > 0.0


@pytest.mark.parametrize("added", ["", "Friction(beam.at(0.5), coefficient=0.5, normal=1.0)"], ids=["idle", "friction"])
def test_what_travels_slides_or_bounces_is_imported_where_it_is_declared(added):
    code = (
        "import sys, vofem as vf\n"
        "beam = vf.Beam(1.0, 1.0, 1.0, 3, {'left': 'clamped'})\n"
        "stop = vf.Contact(beam.at(1.0), gap=0.01, stiffness=1.0, side='above', acts_on='penetration')\n"
        f"more = [{'vf.' * bool(added)}{added}]\n"
        "scene = vf.Scene([beam], [stop, vf.PointLoad(beam.at(1.0), vf.Sine(1.0, 2.0)), *more])\n"
        "vf.simulate(scene, 0.1, method='event_driven').energy\n"
        "vf.simulate(scene, 0.1, method='energy_conserving', dt=0.01).energy\n"
        "if not more: vf.periodic(scene, method='harmonic_balance', harmonics=2)\n"
        "words = 'travel', 'slid', 'walk'\n"
        "print(sum(word in name for name in sys.modules for word in words if name.startswith('vofem')))\n"
    )
    environment = os.environ | {"VOFEM_COMPILED": "0"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    assert (int(done.stdout) > 0) == bool(added)
