"""Where the exact method is not the cheapest, a tolerance lets steps take its place, and a note says so."""

import sys

import numpy as np
import pytest
from scenes import cantilever, on_stop

import vofem as vf
from vofem.simulate import methods
from vofem.simulate.methods import cheaper, choose

pytestmark = pytest.mark.kernels("plain")

T_END = 4.0


def recorded(count, *, stop=True):
    """Return a mass with a stop, or without, whose base moves as a record of many values says."""
    times = np.linspace(0.0, T_END, count)
    values = np.sin(3.0 * times) + 0.3 * np.sin(40.0 * times)
    mass = vf.Mass(1.0, stiffness=25.0, damping=0.2)
    contact = vf.Contact(mass, gap=0.02, stiffness=100.0, side="above", acts_on="penetration")
    return mass, vf.Scene([mass], [*[contact] * stop, vf.BaseMotion(mass, acceleration=vf.Tabulated(times, values))])


def test_records_are_followed_by_steps_where_these_are_faster():
    _, scene = recorded(400_001)
    system = scene.model.system
    assert choose(system).method == "event_driven"
    assert choose(system, T_END).method == "event_driven"
    rough, fine = choose(system, T_END, 1e-3), choose(system, T_END, 1e-11)
    assert (rough.method, fine.method) == ("energy_conserving", "event_driven")
    assert "for the breakpoints of the loads" in rough.why
    said = str(vf.explain(scene, T_END, 1e-3))
    assert "Method: energy_conserving, because steps that follow tol = 0.001 take" in said
    assert "Method: event_driven" in str(vf.explain(scene))
    [note] = cheaper(system, T_END)
    assert note.startswith("cost: with tol=0.001, method='auto' would take energy_conserving")


def test_few_breakpoints_leave_the_choice_as_it_was():
    _, scene = recorded(81)
    assert choose(scene.model.system, T_END, 1e-2).method == "event_driven"
    assert cheaper(scene.model.system, T_END) == []


@pytest.mark.parametrize("s", [1.0, 2.0**30])
def test_the_choice_for_what_nothing_holds_does_not_depend_on_the_unit_of_time(s):
    times = np.linspace(0.0, T_END, 400_001)
    mass = vf.Mass(1.0)
    scene = vf.Scene([mass], [vf.PointLoad(mass, vf.Tabulated(s * times, np.sin(3.0 * times)))])
    assert choose(scene.model.system, s * T_END, 1e-3).method == "energy_conserving"


def test_the_run_that_is_chosen_keeps_the_tolerance(monkeypatch):
    # The function `vofem.simulate` hides the package of the same name from dotted paths.
    monkeypatch.setattr(sys.modules[choose.__module__], "_SOON", 0.03)
    # Without a stop: impacts may magnify errors beyond the tolerance.
    mass, scene = recorded(12_001, stop=False)
    times = np.linspace(0.0, T_END, 201)
    by_steps = vf.simulate(scene, T_END, tol=1e-3, times=times)
    exact = vf.simulate(scene, T_END, times=times)
    assert (by_steps.method, exact.method) == ("energy_conserving", "event_driven")
    assert any(note.startswith("cost: ") for note in exact.notes)
    q = exact.displacement(mass)
    assert np.max(np.abs(by_steps.displacement(mass) - q)) < 1e-3 * np.max(np.abs(q))


def test_a_method_that_is_named_is_taken():
    _, scene = recorded(3001)
    result = vf.simulate(scene, 0.05, method="event_driven", times=[0.0, 0.05])
    assert result.method == "event_driven"
    with pytest.raises(vf.ArgumentError, match="tol is -1"):
        vf.simulate(scene, 1.0, tol=-1.0)
    with pytest.raises(vf.ArgumentError, match="explain: tol is 0"):
        vf.explain(scene, T_END, 0.0)


def test_many_steps_where_none_are_needed_are_told():
    """Before the run `explain` says what "auto" takes; after a run with another method a note does."""
    beam = cantilever(4)
    tip, scene = on_stop(beam.at(1.0), load=vf.Sine(0.1, 3.0), gap=0.01, stiffness=100.0, side="below")
    assert "Method: event_driven" in str(vf.explain(scene, 2.0, 1e-4))
    assert vf.simulate(scene, 2.0, tol=1e-4).method == "event_driven"
    result = vf.simulate(scene, 2.0, method="energy_conserving", tol=2e-4)
    assert result.counters.steps * scene.model.system.size > 10_000
    assert any("method='auto' chooses it" in note and "event_driven takes no steps" in note for note in result.notes)
    damped = vf.Scene([beam], [vf.PointLoad(tip, vf.Sine(0.1, 3.0))])
    few = vf.simulate(damped, 0.5, method="energy_conserving", tol=1e-2)
    assert not any(note.startswith("cost:") for note in few.notes)


def test_many_steps_for_vibration_on_a_stiff_spring_are_told(monkeypatch):
    """A slider that does not yield: 13 periods of its vibration in a fifth of a period of the load."""
    monkeypatch.setattr(methods, "_VERY_MUCH", 500)
    mass = vf.Mass(1.0, stiffness=1.0)
    for stiffness, told in ((1e4, 1), (1.0, 0)):
        spring = vf.BilinearSpring(mass, stiffness=stiffness, linear_limit=1.0)
        scene = vf.Scene([mass], [spring, vf.PointLoad(mass, vf.Sine(1.0, 1.0))])
        result = vf.simulate(scene, 0.8, method="energy_conserving", tol=1e-3)
        notes = [note for note in result.notes if note.startswith("cost: ")]
        assert len(notes) == told
        assert all(f"took {result.counters.steps} steps" in note and "Vibration on stiff" in note for note in notes)
