"""Methods are objects in a registry: one that is written here is taken by all that runs, explains and compares."""

import inspect
import sys
from importlib import import_module

import numpy as np
import pytest
from scenes import on_stop

import vofem as vf
from vofem.cli import main
from vofem.integrators.base import Energies, Samples
from vofem.integrators.method import Method
from vofem.integrators.methods import BUILT_IN, EVENT_DRIVEN
from vofem.integrators.registry import advice, method_names, register, unregister
from vofem.integrators.stepped import SteppedSolution, step_count
from vofem.io.scenes.settings import RunSettings
from vofem.simulate.methods import choose
from vofem.system import Counters, Events
from vofem.verification import PASSED, catalogue, select, verify


def refusal(system):
    if system.laws or system.modal_damping is not None:
        return f"runge_kutta is for linear systems. Use {advice(system, conserves=True)}"
    return None


def run(system, start, t_end, times, *, dt, observer, resume, stages=4):
    """The classical method of Runge and Kutta for M q'' + C q' + K q = f(t); with one stage, Euler's."""
    dt = t_end / 2000 if dt is None else dt
    steps, n = step_count(t_end, dt), system.size
    mass = system.mass.toarray()
    damping = np.zeros((n, n)) if system.sparse_damping is None else system.sparse_damping.toarray()

    def rate(t, y):
        force = system.force(t) - system.stiffness @ y[:n] - damping @ y[n:]
        return np.concatenate([y[n:], np.linalg.solve(mass, force)])

    y, path = np.concatenate([start.q, start.v]), []
    for k in range(steps + 1):
        t, path = k * dt, [*path, y]
        k1 = rate(t, y)
        if stages == 1:
            y = y + dt * k1
            continue
        k2 = rate(t + dt / 2, y + dt / 2 * k1)
        k3 = rate(t + dt / 2, y + dt / 2 * k2)
        y = y + dt / 6 * (k1 + 2 * k2 + 2 * k3 + rate(t + dt, y + dt * k3))
    every = np.minimum(np.arange(steps + 1) * dt, t_end)
    states = np.array(path).T
    states[:, -1:] = states[:, -1:] if np.isclose(steps * dt, t_end) else np.nan
    a = np.array([rate(t, y)[n:] for t, y in zip(every, states.T, strict=True)]).T
    q, v, nothing = states[:n], states[n:], np.zeros(steps + 1)
    kinetic, strain = 0.5 * np.sum(v * (system.mass @ v), axis=0), 0.5 * np.sum(q * (system.stiffness @ q), axis=0)
    stored = Energies(kinetic, strain, nothing, nothing, nothing)
    solution = SteppedSolution(
        system, t_end, every, Samples(q, v, a), stored, float(kinetic[0] + strain[0]), dt, Events(),
        Counters(steps=steps), [],
    )  # fmt: skip
    if times is None:
        return solution
    samples, energies = solution.sample(times), solution.energies(times)
    return SteppedSolution(
        system, t_end, times, samples, energies, solution.start_energy, t_end, Events(), solution.counters, []
    )


@pytest.fixture
def runge_kutta():
    yield register(Method("runge_kutta", run, refusal, {"stages": 4}))
    unregister("runge_kutta")


def oscillator():
    mass = vf.Mass(1.0, stiffness=4.0, name="m")
    return vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(1.0, 1.0))], initial={mass: (0.5, 0.0)}), mass


def exact(t):
    return 0.5 * np.cos(2.0 * t) + np.sin(t) / 3.0 - np.sin(2.0 * t) / 6.0


def test_simulate_takes_a_method_of_ones_own(runge_kutta):
    scene, mass = oscillator()
    errors = []
    for dt in (0.1, 0.05):
        result = vf.simulate(scene, 5.0, method="runge_kutta", dt=dt)
        assert (result.method, result.counters.steps) == ("runge_kutta", round(5.0 / dt))
        errors.append(np.max(np.abs(result.displacement(mass) - exact(result.times))))
    assert 14.0 < errors[0] / errors[1] < 18.0
    rough = vf.simulate(scene, 5.0, method="runge_kutta", dt=0.05, stages=1)
    assert np.max(np.abs(rough.displacement(mass) - exact(rough.times))) > 100 * errors[1]
    with pytest.raises(vf.ArgumentError, match="does not know the option 'stage'; did you mean 'stages'"):
        vf.simulate(scene, 5.0, method="runge_kutta", stage=1)
    with pytest.raises(vf.ArgumentError, match=r"tol was given, but runge_kutta has no steps that follow"):
        vf.simulate(scene, 5.0, method="runge_kutta", tol=1e-6)
    stop = vf.Contact(mass, gap=0.1, stiffness=1.0, acts_on="penetration", side="above")
    with pytest.raises(vf.MethodError, match=r"for linear systems\. Use method='energy_conserving'"):
        vf.simulate(vf.Scene([mass], [stop]), 1.0, method="runge_kutta")


def test_a_saved_run_of_ones_own_method_is_read(runge_kutta, tmp_path):
    scene, mass = oscillator()
    result = vf.simulate(scene, 1.0, method="runge_kutta", dt=0.1)
    loaded = vf.load(result.save(tmp_path / "run.h5"))
    assert loaded.method == "runge_kutta"
    np.testing.assert_array_equal(loaded.displacement(mass), result.displacement(mass))


def test_auto_and_explain_take_a_method_of_ones_own_by_its_rank():
    scene, _ = oscillator()
    assert vf.explain(scene).method == "event_driven"
    register(Method("runge_kutta", run, refusal, rank=90, reason=lambda system: "it is the dearest"))
    try:
        told = vf.explain(scene)
        assert (told.method, told.why) == ("runge_kutta", "it is the dearest")
        assert vf.simulate(scene, 1.0).method == "runge_kutta"
        _, bumped = on_stop(vf.Mass(1.0), gap=0.1, stiffness=1.0)
        assert vf.explain(bumped).method == "event_driven"
    finally:
        unregister("runge_kutta")
    assert vf.explain(scene).method == "event_driven"


def test_verify_takes_a_method_of_ones_own(runge_kutta, capsys):
    chosen = select(catalogue(), "24")
    assert {outcome.verdict for outcome in verify(chosen, "runge_kutta")} == {"refused"}
    assert main(["verify", "--case", "24", "--method", "runge_kutta"]) == 0
    assert "runge_kutta" in capsys.readouterr().out
    (passed,) = verify(select(catalogue(), "impulse on an oscillator, zeta = 0.7"), "runge_kutta")
    assert passed.verdict == PASSED, passed.message


def test_accuracy_takes_a_method_of_ones_own(runge_kutta, tmp_path, capsys):
    scene, mass = oscillator()
    study = vf.accuracy.work_precision(scene, 3.0, dt=[0.1, 0.05], point=mass, repeats=1)
    mine = [run for run in study.runs if run.setting.method == "runge_kutta"]
    assert [run.setting.dt for run in mine] == [0.1, 0.05]
    assert mine[1].order == pytest.approx(4.0, abs=0.2)
    file = tmp_path / "scene.toml"
    vf.dump_scene(scene, file)
    arguments = ["accuracy", str(file), "--methods", "runge_kutta", "--t-end", "3", "--dt", "0.1", "--repeats", "1"]
    assert main([*arguments, "--output", str(tmp_path / "out")]) == 0
    assert "runge_kutta" in capsys.readouterr().out


def test_scene_files_take_a_method_of_ones_own(runge_kutta, tmp_path):
    scene, _ = oscillator()
    file = tmp_path / "scene.toml"
    vf.dump_scene(scene, file, RunSettings(1.0, "runge_kutta", 0.1, options={"stages": 1}))
    assert vf.load_scene(file).simulate().counters.steps == 10
    unregister("runge_kutta")
    try:
        with pytest.raises(vf.SceneFileError, match="runge_kutta"):
            vf.load_scene(file)
    finally:
        register(runge_kutta)


def test_a_name_is_taken_once():
    with pytest.raises(vf.ArgumentError, match="already"):
        register(Method("event_driven", run))
    with pytest.raises(vf.ArgumentError, match="already"):
        register(Method("auto", run))
    with pytest.raises(vf.ArgumentError, match="no method that was registered"):
        unregister("event_driven")


@pytest.mark.parametrize("method", BUILT_IN, ids=lambda method: method.name)
def test_options_have_the_defaults_that_they_tell(method):
    stepping = import_module("vofem.integrators.stepping.methods")
    run = getattr(stepping, method.name, None) or import_module(f"vofem.integrators.{method.name}").run
    taken = inspect.signature(run).parameters
    assert ("dt" in taken, "tol" in taken, "probes" in taken) == (method.steps, method.adaptive, method.records)
    if method.name == "generalized_alpha":
        taken = {**taken, **inspect.signature(stepping.parameters).parameters}
    assert {name: taken[name].default for name in method.options} == dict(method.options)
    assert method.name in method_names()


def test_tol_is_refused_where_it_means_nothing():
    scene, mass = oscillator()
    for method in ("event_driven", "central_difference"):
        with pytest.raises(
            vf.ArgumentError, match=rf"tol was given, but {method} has no .*'energy_conserving' or 'generalized_alpha'"
        ):
            vf.simulate(scene, 1.0, method=method, tol=1e-6)
    # Who leaves the choice to "auto" asks for accuracy, and gets it.
    result = vf.simulate(scene, 1.0, tol=1e-6)
    assert result.method == EVENT_DRIVEN.name
    assert result.displacement(mass) == pytest.approx(exact(result.times), abs=1e-12)
    with pytest.raises(vf.ArgumentError, match="tol"):
        vf.simulate(scene, 1.0, tol=-1.0)


def test_choose_says_what_refuses_all(monkeypatch):
    scene, _ = oscillator()
    never = Method("never", run, lambda system: "it is Monday")
    monkeypatch.setattr(sys.modules["vofem.simulate.methods"], "ranked", lambda: [never])
    with pytest.raises(vf.MethodError, match="never: it is Monday"):
        choose(scene.model.system)
