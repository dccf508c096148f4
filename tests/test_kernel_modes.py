"""Kernels as plain Python and as machine code: the same results to rounding, each whole, decided once."""

import os
import random
import subprocess
import sys
import time

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from random_scenes import scene as random_scene
from scenes import broken_off, cantilever, paper_beam

import vofem as vf
from vofem.kernels import choice as compile_choice
from vofem.kernels import mode
from vofem.kernels.jit import jit
from vofem.kernels.mode import Outgrown, kernels


def everything():
    """Return a scene with every kind of law, on a short beam and a mass."""
    beam = cantilever(3, name="beam")
    mass = vf.Mass(0.3, stiffness=2.0, damping=0.05, name="mass")
    tip, middle = beam.at(1.0), beam.at(0.5)
    effects = [
        vf.Contact(tip, mass, gap=0.02, stiffness=5.0, damping=0.1, acts_on="penetration", name="damped"),
        vf.Contact(tip, gap=0.03, stiffness=4.0, side="above", acts_on="displacement", name="jump"),
        vf.Contact(middle, gap=0.01, stiffness=9.0, side="above", acts_on="penetration", switch=vf.Resolved(1e-3)),
        vf.NonlinearSpring(tip, force=lambda u: 2.0 * u**3, potential=lambda u: 0.5 * u**4),
        vf.BilinearSpring(middle, stiffness=3.0, linear_limit=0.005, hardening=0.5, name="yields"),
        vf.HystereticSpring(
            tip, stiffness=1.0, linear_limit=0.01, softening=vf.LinearSoftening(5.0), memory="cyclic", name="softens"
        ),
        vf.CrushingStop(mass, gap=0.05, stiffness=3.0, linear_limit=0.05, side="above", name="crushes"),
        vf.Springpot(mass, coefficient=0.2, order=0.4, name="pot"),
        vf.Springpot(tip, coefficient=0.1, order=lambda t: 0.3 + 0.1 * np.sin(t), name="varies"),
        vf.RayleighDamping(0.05, 1e-3),
        vf.PointLoad(tip, vf.Sine(0.4, 2.0)),
    ]
    return vf.Scene([beam, mass], effects, initial={mass: (0.0, 0.5)})


def both(scene, t_end, **arguments):
    return [vf.simulate(scene, t_end, compiled=compiled, **arguments) for compiled in (True, False)]


def apart(one, two, kind="q"):
    first, second = getattr(one.samples, kind), getattr(two.samples, kind)
    return np.max(np.abs(first - second)) / np.max(np.abs(first))


STEPS = {"energy_conserving": {"dt": 2e-2}, "generalized_alpha": {"dt": 2e-2}, "central_difference": {"dt": 2e-3}}


@pytest.mark.parametrize("method", STEPS)
def test_all_laws_both_ways(method):
    t_end = 3.0 if method != "central_difference" else 0.6
    machine, plain = both(everything(), t_end, method=method, times=np.linspace(0.0, t_end, 31), **STEPS[method])
    assert (machine.compiled, plain.compiled) == (True, False)
    assert machine.counters.events == plain.counters.events > 0 or method == "central_difference"
    assert apart(machine, plain) < 1e-11
    assert np.array_equal(machine.contact_samples.status, plain.contact_samples.status)
    for kind in ("kinetic", "strain", "contact", "dissipated", "work"):
        first, second = getattr(machine.energy, kind), getattr(plain.energy, kind)
        assert np.max(np.abs(first - second)) <= 1e-10 * np.max(np.abs(machine.energy.work))


@pytest.mark.parametrize("scene", [paper_beam("penetration")[1], everything()], ids=["beam", "all laws"])
def test_steps_under_a_tolerance_both_ways(scene):
    machine, plain = both(scene, 0.5, method="energy_conserving", tol=1e-2, times=np.linspace(0.0, 0.5, 11))
    assert apart(machine, plain) < 1e-10
    assert machine.counters.steps == plain.counters.steps


@pytest.mark.parametrize("acts_on", ["displacement", "penetration"])
def test_events_of_the_paper_beam_both_ways(acts_on):
    _, scene = paper_beam(acts_on)
    machine, plain = both(scene, 20.0)
    first, second = machine.contacts["stop"].closings, plain.contacts["stop"].closings
    assert first.size == second.size > 4
    assert np.max(np.abs(first - second)) < 1e-10
    assert plain.energy.balance_error < 1e-12
    growth = [result.sensitivity.growth[-1] for result in (machine, plain)]
    assert growth[0] == pytest.approx(growth[1], abs=1e-8)


# A seed says everything and does not shrink.
@settings(max_examples=12, phases=[Phase.explicit, Phase.generate])
@given(st.integers(0, 2**32 - 1))
def test_random_scenes_both_ways(seed):
    scene, t_end = random_scene(random.Random(seed))
    t_end /= 4.0
    times = np.linspace(0.0, t_end, 101)
    try:
        machine, plain = both(scene, t_end, times=times, method="event_driven", max_events=100)
    except vf.EventStormError:
        return
    horizon = min(result.sensitivity.horizon(1e-7, 1e-11) for result in (machine, plain))
    kept = machine.samples.q[:, times <= horizon], plain.samples.q[:, times <= horizon]
    assert np.max(np.abs(kept[0] - kept[1])) <= 1e-7 * np.max(np.abs(machine.samples.q)), vf.explain(scene)
    assert plain.energy.balance_error < 1e-9


# -- each run is whole ---------------------------------------------------------------------------


def test_a_run_is_sampled_in_the_way_it_was_computed(monkeypatch):
    """What is read later has the same bits as what was read at once, whatever runs in between."""
    _, scene = paper_beam("displacement")
    for compiled in (True, False):
        early, late = (vf.simulate(scene, 6.0, compiled=compiled) for _ in range(2))
        q = early.solution.sample(early.times).q
        with kernels(compiled=not compiled):
            assert np.array_equal(late.solution.sample(late.times).q, q)
            assert np.array_equal(late.energy.kinetic, early.energy.kinetic)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("method", ["event_driven", "energy_conserving"])
def test_runs_in_files_go_on_in_the_same_way(tmp_path, method, compiled):
    beam, scene = paper_beam("displacement")
    step = {} if method == "event_driven" else {"dt": 0.02}
    times = np.linspace(0.0, 6.0, 61)
    arguments = {"method": method, "times": times, **step}
    whole = vf.simulate(scene, 6.0, compiled=compiled, **arguments)
    with kernels(compiled=not compiled):
        loaded = vf.load(whole.save(tmp_path / "run.vtkhdf"))
        assert loaded.compiled is compiled
        between = np.linspace(0.0, 6.0, 31) if step else np.linspace(0.0, 5.9, 23)
        assert np.array_equal(loaded.displacement(beam.at(0.3), between), whole.displacement(beam.at(0.3), between))
    broken_off(tmp_path / "run.checkpoint", 0.5, scene, 6.0, compiled=compiled, **arguments)
    with kernels(compiled=not compiled):
        resumed = vf.resume(tmp_path / "run.checkpoint")
    assert resumed.compiled is compiled
    assert np.array_equal(resumed.samples.q, whole.samples.q)


def test_what_one_way_has_computed_does_not_serve_the_other():
    _, scene = paper_beam("displacement")
    first = vf.simulate(scene, 6.0, compiled=False).samples.q
    _, fresh = paper_beam("displacement")
    vf.simulate(fresh, 6.0, compiled=True)
    assert np.array_equal(vf.simulate(fresh, 6.0, compiled=False).samples.q, first)


# -- the choice ----------------------------------------------------------------------------------


@pytest.fixture
def choice(monkeypatch):
    """Nothing was done yet, nothing is on disk, nothing is entered into the index."""
    monkeypatch.setattr(compile_choice, "_ready", set())
    monkeypatch.setattr(compile_choice, "_spent", {})
    monkeypatch.setattr(compile_choice, "kinds_on_disk", frozenset)
    kept = []
    monkeypatch.setattr(compile_choice, "keep_kind", kept.append)
    return kept


def test_work_begins_plain_and_is_compiled_if_somebody_wants_it(choice):
    way = compile_choice.choose("steps")
    assert (way.compiled, way.patience) == (False, compile_choice.COMPILING)
    assert not compile_choice.choose("steps", False).compiled
    wanted = compile_choice.choose("steps", True)
    assert wanted.compiled
    assert wanted.first
    wanted.done(1.0)
    assert choice == ["steps"]
    # From now on it costs nothing.
    again = compile_choice.choose("steps")
    assert again.compiled
    assert not again.first
    assert not compile_choice.choose("steps", False).compiled
    assert not compile_choice.choose("events").compiled


def test_steady_states_begin_plain_and_branches_are_compiled_at_once(choice, undecided):
    mass = vf.Mass(1.0, stiffness=1.0)
    rest = [vf.Contact(mass, gap=0.1, stiffness=10.0, side="above", acts_on="penetration"), vf.ModalDamping(0.05)]

    def build(omega):
        return vf.Scene([mass], [*rest, vf.PointLoad(mass, vf.Sine(0.05, omega))])

    plain = vf.periodic(build(1.1)).amplitude(mass)
    assert choice == []
    branch = vf.continuation(build, 1.1, 1.11)
    assert choice == ["steady states"]
    assert compile_choice.choose("steady states").compiled
    assert branch.orbits[0].amplitude(mass) == pytest.approx(plain, rel=1e-12)


def test_code_on_disk_is_used_sooner(choice, monkeypatch):
    monkeypatch.setattr(compile_choice, "kinds_on_disk", lambda: frozenset({"steps"}))
    assert compile_choice.choose("steps").patience == compile_choice.READING < compile_choice.COMPILING
    assert compile_choice.choose("events").patience == compile_choice.COMPILING
    assert not compile_choice.choose("steps", True).first


def test_work_that_is_repeated_is_compiled_in_the_end(choice):
    spent = 0.0
    while not (way := compile_choice.choose("steps")).compiled:
        assert way.patience == pytest.approx(compile_choice.COMPILING - spent)
        way.done(0.3)
        spent += 0.3
    assert way.first
    assert compile_choice.COMPILING <= spent < compile_choice.COMPILING + 0.31


@pytest.fixture
def undecided():
    """Let each piece of work decide itself how kernels run, as in a process of a user."""
    before = mode._MODE.set(None)
    yield
    mode._MODE.reset(before)


def test_a_run_that_outlasts_the_patience_begins_anew(choice, undecided, monkeypatch):
    _, scene = paper_beam("displacement")
    plain = vf.simulate(scene, 2.0)
    assert not plain.compiled
    whole = vf.simulate(scene, 2.0, compiled=True)
    monkeypatch.setattr(compile_choice, "_ready", set())
    monkeypatch.setattr(compile_choice, "_spent", {})
    monkeypatch.setattr(compile_choice, "COMPILING", 1e-6)
    del choice[:]
    told = []
    result = vf.simulate(scene, 2.0, progress=lambda t, t_end: told.append(t))
    assert result.compiled
    assert np.array_equal(result.samples.q, whole.samples.q)
    assert choice == ["event_driven"]


def test_a_run_that_ended_in_plain_python_is_compiled_once_it_goes_on(choice, undecided, monkeypatch, tmp_path):
    """Power is lost in the first seconds: what goes on is not bound to the slow way that a run begins in."""
    _, scene = paper_beam("displacement")
    broken_off(tmp_path / "run.checkpoint", 0.5, scene, 6.0, method="event_driven")
    whole = vf.simulate(scene, 6.0, compiled=True, method="event_driven")
    monkeypatch.setattr(compile_choice, "_ready", set())
    monkeypatch.setattr(compile_choice, "_spent", {})
    monkeypatch.setattr(compile_choice, "COMPILING", 1e-6)
    resumed = vf.resume(tmp_path / "run.checkpoint")
    assert resumed.compiled
    assert np.array_equal(resumed.samples.q, whole.samples.q)


def test_statics_that_outlast_the_patience_begin_anew(choice, undecided, monkeypatch):
    mass = vf.Mass(1.0, stiffness=1.0)
    spring = vf.BilinearSpring(mass, stiffness=3.0, linear_limit=0.005, hardening=0.5)
    scene, factors = vf.Scene([mass], [spring, vf.PointLoad(mass, 1.0)]), [0.5, -0.2, 1.0]
    plain = vf.quasi_static(scene, factors).displacement(mass)
    assert choice == []
    monkeypatch.setattr(compile_choice, "_spent", {"statics": compile_choice.COMPILING - 1e-6})
    assert vf.quasi_static(scene, factors).displacement(mass) == pytest.approx(plain, rel=1e-12)
    assert choice == ["statics"]


def test_patience_ends_plain_work():
    double = jit(lambda x: 2.0 * x)
    with kernels(compiled=False, patience=-1.0), pytest.raises(Outgrown):
        double(1.0)
    # Waiting is no work: on a busy machine compiling would take longer too.
    with kernels(compiled=False, patience=0.1):
        time.sleep(0.2)
        assert double(1.0) == 2.0
    with kernels(compiled=False):
        assert double(1.0) == 2.0


def test_compiled_says_what_it_takes():
    _, scene = paper_beam("displacement")
    with pytest.raises(vf.ArgumentError, match="compiled is 'yes', expected True or False, or None to let"):
        vf.simulate(scene, 1.0, compiled="yes")


def test_a_wrong_environment_variable_is_told():
    run = subprocess.run(
        [sys.executable, "-c", "import vofem.kernels.mode"], env={**os.environ, "VOFEM_COMPILED": "never"},
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert run.returncode == 1
    assert "VOFEM_COMPILED is 'never', expected 1 for compiled code or 0 for plain Python" in run.stderr


def test_extremes_of_orbits_both_ways():
    """At the natural frequency, where a load drives the mass without a steady answer, extremes are the same."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="mass")
    stops = [
        vf.Contact(mass, gap=0.8, stiffness=2.0, side="above", acts_on="penetration", name="one"),
        vf.Contact(mass, gap=0.95, stiffness=2.0, side="below", acts_on="penetration", name="two"),
    ]
    found = []
    for compiled in (True, False):
        with kernels(compiled=compiled):
            branch = vf.continuation(
                lambda omega: vf.Scene([mass], [*stops, vf.PointLoad(mass, vf.Sine(0.1, omega))]), 1.0, 1.02
            )
        grazings = [point.value for point in branch.special if point.kind == "grazing"]
        found.append((*grazings, *branch.orbits[0].extremes(mass), *branch.orbits[-1].extremes(mass)))
    assert len(found[0]) > 4
    assert found[0] == pytest.approx(found[1], rel=1e-11)
