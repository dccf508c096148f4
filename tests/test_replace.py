"""Scenes that differ in numbers: what is replaced, and what is not computed again."""

import inspect
import pickle

import numpy as np
import pytest
from scenes import cantilever, on_stop, paper_beam

import vofem as vf
from vofem.assembly import SystemBuilder


def fresh(**changes):
    return paper_beam("displacement", **changes)[1]


@pytest.mark.parametrize("change", [{"gap": 0.02}, {"stiffness": 3.0}, {"gap": 0.01, "stiffness": 0.5}])
@pytest.mark.parametrize("options", [{}, {"method": "energy_conserving", "dt": 0.01}])
def test_a_replaced_scene_gives_the_results_of_a_new_one(change, options):
    scene = fresh()
    first = vf.simulate(scene, 5.0, **options)
    found = vf.simulate(scene.replace("stop", **change), 5.0, **options)
    expected = vf.simulate(fresh(**change), 5.0, **options)
    assert np.array_equal(found.samples.q, expected.samples.q)
    assert not np.array_equal(found.samples.q, first.samples.q)
    # The scene itself is what it was.
    assert np.array_equal(vf.simulate(scene, 5.0, **options).samples.q, first.samples.q)


def test_eigensystems_are_shared_as_far_as_they_are_the_same():
    scene = fresh()
    stop, load = scene.effects
    first = vf.simulate(scene, 5.0).counters
    assert (first.eigensolves, first.rank_one_updates) == (1, 1)
    for change, updates in (({"gap": 0.02}, 0), ({"stiffness": 2.0}, 1), ({"acts_on": "penetration"}, 0)):
        counters = vf.simulate(scene.replace(stop, **change), 5.0).counters
        assert counters.events > 0
        assert (counters.eigensolves, counters.rank_one_updates) == (0, updates)
    counters = vf.simulate(scene.replace(load, f=vf.Sine(0.2, 3.0)), 5.0).counters
    assert (counters.eigensolves, counters.rank_one_updates) == (0, 0)
    # What changes the matrices or the rows is computed anew.
    point = stop.a.body.at(0.8)
    assert vf.simulate(scene.replace(stop, a=point), 5.0).counters.eigensolves == 1
    assert vf.simulate(scene.replace(load, vf.PointMass(point, mass=0.1)), 5.0).counters.eigensolves == 1


def test_steps_share_factors_where_only_loads_in_time_differ():
    scene = fresh()
    options = {"method": "energy_conserving", "dt": 0.01}
    assert vf.simulate(scene, 1.0, **options).counters.factorizations == 1
    other = scene.replace(scene.effects[1], f=vf.Sine(0.2, 3.0))
    assert vf.simulate(other, 1.0, **options).counters.factorizations == 0


def test_every_effect_can_be_made_anew():
    """Every argument of a constructor is an attribute."""
    beam, other, mass = cantilever(4), vf.Beam(1.0, 1.0, 1.0, 4), vf.Mass(1.0)
    tip = beam.at(1.0)
    effects = [
        vf.Contact(tip, mass, gap=0.1, stiffness=1.0, damping=0.1, acts_on="penetration", switch=vf.Resolved(1e-3)),
        vf.Spring(tip, mass, stiffness=2.0),
        vf.RotationalSpring(tip, stiffness=2.0),
        vf.Dashpot(tip, damping=1.0),
        vf.PointMass(tip, mass=1.0),
        vf.PointLoad(tip, vf.Sine(1.0, 2.0)),
        vf.PointMoment(tip, 2.0),
        vf.DistributedLoad(beam, 1.0),
        vf.Gravity(9.81),
        vf.BaseMotion(beam, acceleration=vf.Sine(1.0, 2.0)),
        vf.Foundation(beam, stiffness=1.0),
        vf.NonlinearSpring(tip, force=lambda u: u, potential=lambda u: 0.5 * u * u),
        vf.RayleighDamping(0.1, 0.2),
        vf.ModalDamping(0.1),
        vf.HystereticSpring(tip, stiffness=1.0, linear_limit=0.1, memory="cyclic"),
        vf.BilinearSpring(tip, stiffness=1.0, linear_limit=0.1),
        vf.IwanSpring(tip, elongation=[0.1, 0.2], force=[1.0, 1.5]),
        vf.CrushingStop(tip, gap=0.1, stiffness=1.0, linear_limit=0.1, side="above"),
        vf.Springpot(tip, coefficient=1.0, order=0.5),
        vf.Joint(tip, other.at(0.0), kind="hinge"),
    ]
    for effect in effects:
        names = list(inspect.signature(type(effect).__init__).parameters)[1:]
        lacking = [name for name in names if not hasattr(effect, name)]
        assert not lacking, f"{type(effect).__name__}: {lacking}"
        changed = names[-1] if names[-1] != "name" else names[-2]
        bodies = [beam, other, mass]
        scene = vf.Scene(bodies, [effect]).replace(effect, **{changed: getattr(effect, changed)})
        assert scene.effects[0] is not effect
        assert scene.effects[0].describe() == effect.describe()
        assert scene.bodies == tuple(bodies)


def test_mistakes_are_told():
    scene = fresh()
    stop = scene.effects[0]
    cases = [
        ((("stopp",), {"gap": 1.0}), "'stopp' is no effect of the scene; did you mean 'stop'"),
        (((stop,), {"gab": 1.0}), "no argument 'gab'"),
        (((stop,), {}), "give either another effect"),
        (((stop, stop), {"gap": 1.0}), "give either another effect"),
        (((stop,), {"stiffness": -1.0}), "stiffness is -1"),
        (((vf.Gravity(9.81),), {"g": 1.0}), "is no effect of the scene"),
    ]
    for (arguments, changes), message in cases:
        with pytest.raises(vf.ArgumentError, match=message):
            scene.replace(*arguments, **changes)


def test_the_initial_state_stays():
    ball = vf.Mass(1.0, stiffness=1.0)
    stop = vf.Contact(ball, gap=0.1, stiffness=9.0, acts_on="penetration", side="above")
    scene = vf.Scene([ball], [stop], initial={ball: (0.0, 1.0)})
    assert vf.simulate(scene.replace(stop, gap=0.2), 1.0).velocity(ball)[0] == 1.0


def test_scenes_share_through_one_that_never_runs():
    _, base = on_stop(vf.Mass(1.0, 1.0, name="mass"), gap=0.1, stiffness=8.0, load=vf.Sine(1.0, 0.5))
    solved = [vf.simulate(base.replace("stop", gap=gap), 5.0).counters.eigensolves for gap in (0.1, 0.2, 0.3)]
    assert solved == [1, 0, 0]


def test_a_replaced_scene_is_assembled_when_it_runs():
    """A branch asks for many scenes that never run, and a loop may replace one thing after another."""
    scene = other = fresh()
    for gap in np.linspace(0.01, 0.02, 2000):
        other = other.replace("stop", gap=gap)
    assert not scene.assembled
    assert not other.assembled
    run = vf.simulate(pickle.loads(pickle.dumps(other)), 1.0)
    found = vf.simulate(other, 1.0)
    assert np.array_equal(found.samples.q, run.samples.q)
    assert found.counters.eigensolves == 1
    assert vf.simulate(scene, 1.0).counters.eigensolves == 0


def test_scenes_of_a_locus_are_not_assembled_anew(monkeypatch):
    """They differ in functions of time alone, whichever way the function makes them."""
    scene, compiled = on_stop(vf.Mass(1.0, 1.0, name="mass"), gap=0.5, stiffness=8.0, load=vf.Sine(0.1, 0.5))[1], []
    load, original = scene.effects[-1], SystemBuilder.build
    scene = vf.Scene(scene.bodies, [*scene.effects, vf.ModalDamping(0.05)])
    monkeypatch.setattr(SystemBuilder, "build", lambda self: compiled.append(self) or original(self))
    branch = vf.continuation(lambda w: scene.replace(load, f=vf.Sine(0.1, w)), 0.8, 1.1)
    (grazing, *_) = branch.special
    vf.locus(lambda w, a: scene.replace(load, f=vf.Sine(a, w)), grazing, 0.1, 0.11)
    assert len(compiled) <= 4
