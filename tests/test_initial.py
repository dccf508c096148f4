"""The start state and the time of the loads are arguments of a run; runs of one scene share what they can."""

import copy
import gc
import pickle
import threading
import weakref

import numpy as np
import pytest
from scenes import cantilever

import vofem as vf

STEPPING = ("energy_conserving", "generalized_alpha", "central_difference")


def beam_on_stop(acts_on="penetration", damping=None, initial=None, load=None):
    beam = cantilever(8, name="beam")
    tip = beam.at(1.0)
    stop = vf.Contact(tip, gap=0.03, stiffness=1.0, side="below", acts_on=acts_on, name="stop")
    effects = [stop, vf.PointLoad(tip, load or vf.Sine(0.1, 1.0)), *([] if damping is None else [damping])]
    return vf.Scene([beam], effects, initial), tip


def oscillator(load, initial=None):
    mass = vf.Mass(1.0, stiffness=4.0, name="m")
    return vf.Scene([mass], [vf.PointLoad(mass, load)], initial), mass


def same(one, other):
    return np.array_equal(one.samples.q, other.samples.q) and np.array_equal(one.samples.v, other.samples.v)


# -- initial ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["auto", *STEPPING])
def test_initial_of_a_run_is_that_of_a_scene(method):
    other = vf.Mass(7.0, name="m")
    scene, mass = oscillator(vf.Sine(1.0, 1.0))
    expected = vf.simulate(vf.Scene(scene.bodies, scene.effects, {mass: (0.3, -1.0)}), 2.0, method=method)
    for start in ({mass: (0.3, -1.0)}, {other: (0.3, -1.0)}):
        result = vf.simulate(scene, 2.0, initial=start, method=method)
        assert same(result, expected)
        assert result.energy.start == expected.energy.start
    # The scene itself still starts as it says.
    assert vf.simulate(scene, 2.0, method=method).displacement(mass)[0] == 0.0


def test_initial_replaces_that_of_the_scene():
    a, b = vf.Mass(1.0, stiffness=1.0, name="a"), vf.Mass(1.0, stiffness=4.0, name="b")
    scene = vf.Scene([a, b], initial={a: (1.0, 0.0), b: (1.0, 0.0)})
    result = vf.simulate(scene, 3.0, initial={b: (0.0, 2.0)})
    assert not np.any(result.displacement(a))
    assert result.displacement(b) == pytest.approx(np.sin(2.0 * result.times), abs=1e-12)


def test_a_run_goes_on_from_an_earlier_one():
    scene, tip = beam_on_stop()
    whole = vf.simulate(scene, 8.0)
    first = vf.simulate(scene, 3.0)
    # Loads go on where they were; the times of the second run count from its own beginning.
    second = vf.simulate(scene, 5.0, initial=first, t_start=3.0)
    assert second.times[0] == 0.0
    assert second.displacement(tip, 5.0 - 1e-9) == pytest.approx(whole.displacement(tip, 8.0 - 1e-9), abs=1e-11)
    t = np.linspace(0.0, 5.0, 301)
    assert second.displacement(tip, t) == pytest.approx(whole.displacement(tip, 3.0 + t), abs=1e-11)
    assert second.velocity(tip, t) == pytest.approx(whole.velocity(tip, 3.0 + t), abs=1e-9)
    # A scene that is built anew has bodies of the same names.
    again, _ = beam_on_stop()
    third = vf.simulate(again, 5.0, initial=first, t_start=3.0)
    assert third.displacement(tip, t) == pytest.approx(whole.displacement(tip, 3.0 + t), abs=1e-11)


def test_a_run_starts_from_an_equilibrium():
    scene, tip = beam_on_stop(load=0.2)
    rest = vf.equilibrium(scene)
    result = vf.simulate(scene, 3.0, initial=rest)
    assert result.displacement(tip) == pytest.approx(np.full(result.times.size, rest.displacement(tip)), rel=1e-9)


def test_hysteretic_springs_go_on_with_their_past():
    mass = vf.Mass(1.0, name="m")
    slip = vf.BilinearSpring(mass, stiffness=10.0, linear_limit=0.1, hardening=0.1, name="slip")
    scene = vf.Scene([mass], [slip], {mass: (0.0, 3.0)})
    whole = vf.simulate(scene, 2.0, dt=1e-3, method="energy_conserving")
    first = vf.simulate(scene, 1.0, dt=1e-3, method="energy_conserving")
    second = vf.simulate(scene, 1.0, initial=first, dt=1e-3, method="energy_conserving")
    assert second.springs["slip"].force[0] == pytest.approx(whole.springs["slip"].force[1000], rel=1e-12)
    assert second.displacement(mass) == pytest.approx(whole.displacement(mass)[1000:], abs=1e-12)


@pytest.mark.parametrize(
    ("initial", "message"),
    [
        (3.0, "simulate: initial is 3.0, expected a dict"),
        ({"m": (0.0, 0.0)}, "simulate: initial names 'm', which is not among the bodies; use the Beam or Mass"),
        ({vf.Mass(1.0, name="x"): (0.0, 0.0)}, "not among the bodies"),
        ({vf.Mass(1.0, name="m"): 1.0}, r"simulate: initial of Mass 'm' is 1.0, expected a pair"),
        ({vf.Mass(1.0, name="m"): (float("nan"), 0.0)}, "initial displacement of Mass 'm'"),
    ],
)
def test_bad_initial(initial, message):
    scene, _ = oscillator(0.0)
    with pytest.raises(vf.ArgumentError, match=message):
        vf.simulate(scene, 1.0, initial=initial)


def test_outcomes_of_other_meshes_and_bodies_are_refused():
    scene, _ = beam_on_stop()
    other = vf.Scene([cantilever(4, name="beam")])
    with pytest.raises(vf.ArgumentError, match=r"simulate: initial has 10 degrees of freedom .* expected 18"):
        vf.simulate(scene, 1.0, initial=vf.simulate(other, 1.0))
    with pytest.raises(vf.ArgumentError, match="no body is named 'beam'"):
        vf.simulate(scene, 1.0, initial=vf.simulate(oscillator(0.0)[0], 1.0))


@pytest.mark.parametrize("way", ["argument", "scene", "part of a scene"])
def test_a_start_holds_a_state_and_not_a_run(way):
    scene, mass = oscillator(vf.Sine(1.0, 1.0))
    scene = vf.Scene(scene.bodies, scene.effects, {mass: (1.0, 0.0)})
    result, dead = vf.simulate(scene, 0.5), []
    for _ in range(5):
        dead.append(weakref.ref(result))
        if way == "argument":
            result = vf.simulate(scene, 0.5, initial=result)
        else:
            start = result if way == "scene" else {mass: result}
            result = vf.simulate(vf.Scene(scene.bodies, scene.effects, start), 0.5)
    start = None
    gc.collect()
    assert [reference() for reference in dead] == [None] * 5


# -- t_start ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["auto", *STEPPING])
def test_t_start_shifts_the_loads(method):
    options = {} if method == "auto" else {"dt": 2.0**-9}
    scene, mass = oscillator(vf.Sine(1.0, 1.0, 0.3))
    result = vf.simulate(scene, 3.0, t_start=2.0, method=method, **options)
    expected = vf.simulate(oscillator(vf.Sine(1.0, 1.0, 2.3))[0], 3.0, method=method, **options)
    assert result.times[-1] == 3.0
    assert result.displacement(mass) == pytest.approx(expected.displacement(mass), abs=1e-13)
    assert result.energy.work == pytest.approx(expected.energy.work, abs=1e-13)


def test_t_start_shifts_corners_and_jumps():
    """Before the last bit: a piece that holds from its breakpoint on is taken there, wherever the run begins."""
    times = np.array([0.1, 0.7, 1.3, 2.9])
    for load in (vf.Pulse(1.0, 0.7, 0.6), vf.Ramp(2.0, 0.7, 1.3), vf.Tabulated(times, [0.0, 1.0, -1.0, 0.5])):
        scene, mass = oscillator(load)
        whole = vf.simulate(scene, 3.0)
        for t_start in (0.1, 1.0 / 3.0, 0.5, 0.7, 1e-9):
            first = vf.simulate(scene, t_start)
            rest = vf.simulate(scene, 3.0 - t_start, initial=first, t_start=t_start)
            t = np.linspace(0.0, 3.0 - t_start, 101)
            assert rest.displacement(mass, t) == pytest.approx(whole.displacement(mass, t_start + t), abs=1e-13)


def test_t_start_shifts_callables_and_orders():
    mass = vf.Mass(1.0, stiffness=4.0, name="m")
    seen = []

    def push(t):
        seen.append(t)
        return np.sin(t)

    def order(t):
        return 0.2 + 0.1 * np.asarray(t)

    results = []
    for t_start, force, varying in ((2.0, push, order), (0.0, lambda t: np.sin(t + 2.0), lambda t: order(t + 2.0))):
        scene = vf.Scene([mass], [vf.PointLoad(mass, force), vf.Springpot(mass, coefficient=0.5, order=varying)])
        results.append(vf.simulate(scene, 2.0, dt=1e-2, t_start=t_start, method="energy_conserving"))
    assert min(seen) >= 2.0
    assert results[0].displacement(mass) == pytest.approx(results[1].displacement(mass), abs=1e-13)


def test_t_start_reaches_reactions():
    beam = cantilever(4, name="b")
    results = [
        vf.simulate(vf.Scene([beam], [vf.DistributedLoad(beam, 1.0, vf.Sine(1.0, 1.0, phase))]), 1.0, t_start=t)
        for t, phase in ((2.0, 0.0), (0.0, 2.0))
    ]
    forces = [result.reaction(beam, "left").force for result in results]
    assert forces[0] == pytest.approx(forces[1], abs=1e-10)


@pytest.mark.parametrize("t_start", [-1.0, float("nan"), "now"])
def test_bad_t_start(t_start):
    with pytest.raises(vf.ArgumentError, match="simulate: t_start"):
        vf.simulate(oscillator(0.0)[0], 1.0, t_start=t_start)


# -- runs of one scene --------------------------------------------------------------------------------


@pytest.mark.parametrize("acts_on", ["penetration", "displacement"])
@pytest.mark.parametrize("damping", [None, vf.RayleighDamping(0.1, 1e-3), vf.ModalDamping(0.02)])
def test_a_second_run_solves_no_eigenproblem(acts_on, damping):
    scene, _tip = beam_on_stop(acts_on, damping)
    model = scene.model
    first = vf.simulate(scene, 8.0)
    assert first.counters.eigensolves >= 1
    assert first.counters.rank_one_updates == 1
    start = {scene.bodies[0]: (lambda x: 0.01 * x**2, lambda x: -0.05 * x**2)}
    second = vf.simulate(scene, 8.0, initial=start)
    assert scene.model is model
    assert second.counters.events
    assert (second.counters.eigensolves, second.counters.rank_one_updates) == (0, 0)
    assert second.counters.statuses == 2
    # To the last bit as on a scene that is built anew.
    fresh = vf.simulate(beam_on_stop(acts_on, damping)[0], 8.0, initial=start)
    assert fresh.counters.eigensolves == first.counters.eigensolves
    assert same(second, fresh)


@pytest.mark.parametrize("method", STEPPING)
def test_a_second_run_factors_nothing(method):
    scene, _tip = beam_on_stop(damping=vf.ModalDamping(0.02))
    first = vf.simulate(scene, 0.1, method=method, dt=1e-4)
    assert first.counters.factorizations >= 1
    assert first.counters.eigensolves >= 1
    second = vf.simulate(scene, 0.1, method=method, dt=1e-4, initial={scene.bodies[0]: (lambda x: 0.01 * x**2, 0.0)})
    assert (second.counters.factorizations, second.counters.eigensolves) == (0, 0)
    fresh, _ = beam_on_stop(damping=vf.ModalDamping(0.02))
    assert same(
        second, vf.simulate(fresh, 0.1, method=method, dt=1e-4, initial={fresh.bodies[0]: (lambda x: 0.01 * x**2, 0.0)})
    )


def test_what_ran_before_leaves_no_trace():
    """Two contacts close in another order in an earlier run; eigensystems gained in that order are not taken."""

    def scene():
        masses = [vf.Mass(1.0 + 0.1 * k, stiffness=1.0, name=f"m{k}") for k in range(3)]
        springs = [vf.Spring(masses[0], masses[1], stiffness=2.0), vf.Spring(masses[1], masses[2], stiffness=3.0)]
        stops = [vf.Contact(masses[k], gap=0.1, stiffness=50.0, side="above", acts_on="penetration") for k in (0, 2)]
        return vf.Scene(masses, [*springs, *stops])

    used = scene()
    starts = [{0: (0.0, 1.0), 2: (0.0, 0.8)}, {0: (0.0, 0.8), 2: (0.0, 1.0)}, {0: (0.0, 2.0), 2: (0.0, -1.0)}]
    for start in starts:
        fresh = scene()
        mine, its = (vf.simulate(s, 10.0, initial={s.bodies[k]: v for k, v in start.items()}) for s in (used, fresh))
        assert mine.counters.events > 4
        assert same(mine, its)


def test_threads_may_run_one_scene():
    scene, _tip = beam_on_stop()
    found = [None] * 4

    def work(k):
        start = {scene.bodies[0]: (lambda x: 0.01 * k * x**2, 0.0)}
        found[k] = vf.simulate(scene, 8.0, initial=start, compiled=False)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sum(result.counters.eigensolves for result in found) == 1
    for k, result in enumerate(found):
        fresh, _ = beam_on_stop()
        start = {fresh.bodies[0]: (lambda x, k=k: 0.01 * k * x**2, 0.0)}
        assert same(result, vf.simulate(fresh, 8.0, initial=start, compiled=False))


def test_what_is_kept_is_neither_copied_nor_pickled():
    scene, _ = beam_on_stop()
    vf.simulate(scene, 1.0)
    system = scene.model.system
    assert "_cache" in vars(system)
    for other in (copy.copy(system), copy.deepcopy(system), pickle.loads(pickle.dumps(system))):
        assert "_cache" not in vars(other)
        assert np.array_equal(other.mass.toarray(), system.mass.toarray())


# -- files --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["event_driven", "energy_conserving"])
def test_saved_runs_know_their_start(method, tmp_path):
    scene, tip = beam_on_stop()
    first = vf.simulate(scene, 1.0)
    result = vf.simulate(scene, 2.0, initial=first, t_start=1.0, method=method)
    loaded = vf.load(result.save(tmp_path / "run.h5"))
    assert loaded.t_start == 1.0
    assert np.array_equal(loaded.start.q, result.start.q)
    t = np.linspace(0.0, 2.0, 37)
    assert np.array_equal(loaded.displacement(tip, t), result.displacement(tip, t))
    assert np.array_equal(loaded.acceleration(tip, t), result.acceleration(tip, t))
    force, again = (r.reaction("beam", "left").force for r in (result, loaded))
    assert np.array_equal(force, again)
    # The scene of the file is that of the run: its loads begin at 0.
    again = vf.simulate(loaded.scene, 1.0)
    assert again.displacement(tip) == pytest.approx(first.displacement(tip), abs=1e-12)
    longer = [vf.simulate(s, 1.0, initial=r, t_start=3.0) for s, r in ((scene, result), (loaded.scene, loaded))]
    assert longer[0].displacement(tip) == pytest.approx(longer[1].displacement(tip), abs=1e-11)


def test_saved_runs_with_callables_know_their_time(tmp_path):
    scene, mass = oscillator(lambda t: np.sin(t))
    result = vf.simulate(scene, 1.0, t_start=2.0, dt=0.01, method="energy_conserving", initial={mass: (0.1, 0.0)})
    loaded = vf.load(result.save(tmp_path / "run.h5"))
    assert np.array_equal(loaded.displacement(mass), result.displacement(mass))
    assert np.array_equal(loaded.scene.effects[0].f(2.0 + result.times), np.sin(2.0 + result.times))
