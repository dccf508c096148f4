"""Springpots in runs: who takes them, checkpoints, files, statics, what is wrong, and what absence costs."""

import h5py
import numpy as np
import pytest
from kept import assert_whole
from scenes import broken_off, cantilever
from test_springpot import METHODS, STARTS, oscillator

import vofem as vf
from vofem.fractional import ConstantOrder, TabulatedOrder


def swinging(t):
    return 0.5 + 0.4 * np.sin(t)


# -- who takes them ---------------------------------------------------------------------------------


def test_auto_and_the_methods_that_refuse():
    _, scene = oscillator(0.5, STARTS["struck"])
    explanation = vf.explain(scene)
    assert explanation.method == "energy_conserving"
    assert "Springpot 's' has a force that its whole past decides" in explanation.why
    assert "hysteretic springs" in explanation.absent
    assert "springpots" not in explanation.absent
    with pytest.raises(vf.MethodError, match=r"Springpot 's' .*Use method='energy_conserving'"):
        vf.simulate(scene, 1.0, method="event_driven")
    with pytest.raises(vf.MethodError, match="choose method='auto'"):
        vf.simulate(scene, 1.0, method="force_driven")
    mass = vf.Mass(1.0)
    printed = vf.HystereticSpring(mass, stiffness=1.0, linear_limit=5.0, memory="printed")
    with pytest.raises(vf.ArgumentError, match="another hysteretic spring"):
        vf.explain(vf.Scene([mass], [printed, vf.Springpot(mass, coefficient=1.0, order=0.5)]))


def test_statics_and_modes_leave_them_out():
    """They yield to every lasting force, and no mode is undamped with them."""
    beam = cantilever(4)
    load = vf.PointLoad(beam.at(1.0), 1.0)
    bare, with_one = (
        vf.Scene([beam], [load, *more]) for more in ([], [vf.Springpot(beam.at(1.0), coefficient=50.0, order=0.1)])
    )
    point = beam.at(1.0)
    assert vf.equilibrium(with_one).displacement(point) == vf.equilibrium(bare).displacement(point)
    assert np.array_equal(vf.modes(with_one, 3).omega, vf.modes(bare, 3).omega)
    factors = [1.0, 2.0, 0.0]
    paths = [vf.quasi_static(scene, factors) for scene in (with_one, bare)]
    assert np.array_equal(paths[0].displacement(point), paths[1].displacement(point))
    mass = vf.Mass(1.0, name="loose")
    with pytest.raises(vf.SingularSystemError, match="loose"):
        vf.equilibrium(vf.Scene([mass], [vf.Springpot(mass, coefficient=1.0, order=0.5), vf.PointLoad(mass, 1.0)]))


@pytest.mark.parametrize("method", METHODS)
def test_beside_springs_with_memory(method):
    """Each is told by its name; a springpot of coefficient 0 changes nothing beside them."""
    mass, other = vf.Mass(1.0, 1.0), vf.Mass(2.0)
    effects = [
        vf.BilinearSpring(mass, other, stiffness=3.0, linear_limit=0.1, name="yields"),
        vf.PointLoad(other, vf.Sine(1.0, 1.3)),
    ]
    pots = [
        vf.Springpot(mass, coefficient=0.0, order=0.5, name="idle"),
        vf.Springpot(other, coefficient=0.0, order=1.0),
    ]
    one, two = (
        vf.simulate(vf.Scene([mass, other], e), 10.0, method=method, dt=0.01) for e in (effects, pots + effects)
    )
    assert list(two.springs) == ["yields", "idle", pots[1].name]
    assert one.springs["yields"].dissipated[-1] > 0.1
    for what in ("force", "elongation", "stored", "dissipated"):
        found, right = getattr(two.springs["yields"], what), getattr(one.springs["yields"], what)
        assert found == pytest.approx(right, abs=1e-11)
        assert np.all(getattr(two.springs["idle"], what) == 0.0) or what == "elongation"
    assert np.array_equal(two.springs["idle"].elongation, two.displacement(mass))
    assert two.counters.memory_updates == one.counters.memory_updates


@pytest.mark.parametrize(("method", "within"), list(zip(METHODS, (2e-5, 1e-3, 1e-11), strict=True)))
def test_reactions_know_of_them(method, within):
    """Between a clamp and the first free node: the clamp and the springpot bear load and inertia together."""
    beam = cantilever(4, name="deck")
    load = vf.Sine(1.0, 3.0)
    springpot = vf.Springpot(beam.at(0.1), coefficient=400.0, order=0.5, name="s")
    result = vf.simulate(vf.Scene([beam], [springpot, vf.PointLoad(beam.at(1.0), load)]), 1.0, method=method, dt=4e-4)
    rigid = np.tile([1.0, 0.0], beam.nodes.size)
    inertia = rigid @ (result.model.mass @ result.model.expand(result.samples.a))
    total = result.reaction(beam, "left").force + load(result.times) - result.springs["s"].force
    assert np.max(np.abs(result.springs["s"].force)) > 4.0
    assert total[5:] == pytest.approx(inertia[5:], abs=within)
    with pytest.raises(vf.ArgumentError, match=r"name the times in times="):
        result.reaction(beam, "left", [0.01234])


# -- stopping, saving, going on ---------------------------------------------------------------------


def test_an_order_that_is_a_function_must_be_given_again(tmp_path, monkeypatch):
    monkeypatch.setattr("vofem.integrators.stepping.equal._PLAIN_WORK", 200)
    monkeypatch.setattr("vofem.laws.springpot_past._MOST_STEPS", 150)
    options = {"method": "energy_conserving", "dt": 0.02}
    mass, scene = oscillator(swinging, STARTS["struck"])
    whole, path = vf.simulate(scene, 10.0, **options), tmp_path / "run.checkpoint"
    broken_off(path, 0.4, scene, 10.0, **options)
    assert_whole(vf.resume(path, scene=scene), whole)
    with pytest.raises(vf.MissingCallableError, match="swinging"):
        vf.resume(path)
    other = vf.Springpot(mass, coefficient=0.8, order=swinging, name="s")
    with pytest.raises(vf.ArgumentError, match="springpots"):
        vf.resume(path, scene=vf.Scene(scene.bodies, [other, *scene.effects[1:]], scene.initial))


def test_a_run_that_starts_from_another_says_what_it_forgets():
    mass, scene = oscillator(0.5, STARTS["struck"])
    first = vf.simulate(scene, 2.0, dt=0.01)
    assert not any("springpots:" in note for note in first.notes)
    for initial in (first, {mass: first}):
        second = vf.simulate(vf.Scene(scene.bodies, scene.effects, initial), 2.0, dt=0.01)
        assert any(note.startswith("springpots: Springpot 's' begins without the past") for note in second.notes)
        assert second.springs["s"].force[0] == 0.0
        assert second.displacement(mass)[0] == first.displacement(mass)[-1]
    rest = vf.equilibrium(scene)
    assert not any(
        "springpots:" in note for note in vf.simulate(vf.Scene(scene.bodies, scene.effects, rest), 1.0).notes
    )


# -- what is wrong ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"order": 0.0}, "order is 0, expected a number above 0 and up to 1; a Spring is what order 0 would be"),
        ({"order": -0.1}, "order is -0.1, expected"),
        ({"order": 1.5}, "order is 1.5, expected a number above 0 and up to 1"),
        ({"order": float("nan")}, "order is NaN"),
        ({"order": "half"}, "order is 'half', expected a number from 0 to 1, or a function of time"),
        ({"order": [0.5, 0.6]}, r"order is \[0.5, 0.6\], expected"),
        ({"order": None}, "order is None, expected"),
        ({"order": ConstantOrder(2.0)}, "order is 2, expected"),
        ({"order": TabulatedOrder}, "order is <class"),
        ({"coefficient": -1.0}, "coefficient is -1.0, expected a number that is not negative"),
        ({"coefficient": float("inf")}, "coefficient is inf"),
    ],
    ids=str,
)
def test_bad_arguments(given, message):
    with pytest.raises(vf.ArgumentError, match=f"Springpot 's': {message}"):
        vf.Springpot(vf.Mass(1.0), **{"coefficient": 1.0, "order": 0.5, "name": "s"} | given)


def test_laws_that_never_change_are_numbers():
    mass = vf.Mass(1.0)
    for order in (0.5, ConstantOrder(0.5), vf.Constant(0.5), np.float64(0.5)):
        assert vf.Springpot(mass, coefficient=1.0, order=order).order == 0.5
    assert vf.Springpot(mass, coefficient=1.0, order=1).order == 1.0
    assert "N s^0.5/m" in vf.Springpot(mass, coefficient=1.0, order=0.5, name="s").describe()
    assert "order swinging" in vf.Springpot(mass, coefficient=1.0, order=swinging, name="s").describe()


@pytest.mark.parametrize("method", METHODS)
def test_orders_that_turn_wrong(method):
    """Told before the first step where they can be seen at some times, and else when they come."""
    for law, message in (
        (lambda t: 0.5 + t, r"Springpot 's': order is 1\.0.* at t = "),
        (lambda t: np.where(t > 0.5, np.nan, 0.5), "Springpot 's': order is nan at t = "),
        (lambda t: [0.5, 0.5], r"Springpot 's': order has shape \(2,\)"),
        (lambda t: 1.0 / 0.0, "Springpot 's': order raised ZeroDivisionError: .* array of times"),
        (lambda t: "half", "Springpot 's': order is 'half'"),
        (lambda t: np.where((t > 0.51) & (t < 0.513), 2.0, 0.5), "Springpot 's': order is 2 at t = 0.51"),
    ):
        _, scene = oscillator(law, STARTS["struck"])
        with pytest.raises(vf.ArgumentError, match=message):
            vf.simulate(scene, 1.0, method=method, dt=1e-3)


def test_names_and_places():
    mass = vf.Mass(1.0)
    pots = [vf.Springpot(mass, coefficient=1.0, order=0.5, name="s") for _ in range(2)]
    with pytest.raises(vf.ArgumentError, match="springs named 's' occur more than once"):
        vf.explain(vf.Scene([mass], pots))
    spring = vf.BilinearSpring(mass, stiffness=1.0, linear_limit=1.0, name="s")
    with pytest.raises(vf.ArgumentError, match="springs named 's' occur more than once"):
        vf.explain(vf.Scene([mass], [spring, pots[0]]))
    beam = cantilever(4)
    with pytest.raises(vf.ArgumentError, match="Springpot 's' can never move"):
        vf.explain(vf.Scene([beam], [vf.Springpot(beam.at(0.0), coefficient=1.0, order=0.5, name="s")]))
    result = vf.simulate(vf.Scene([mass], pots[:1]), 1.0)
    assert result.springs[pots[0]].name == "s"
    with pytest.raises(vf.ArgumentError, match="no hysteretic spring is named 'x'"):
        result.springs["x"]


# -- absence ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["energy_conserving", "generalized_alpha", "central_difference"])
def test_a_checkpoint_without_springpots_holds_no_history(name, tmp_path):
    mass, path = vf.Mass(1.0, 1.0), tmp_path / "run.checkpoint"
    vf.simulate(vf.Scene([mass], initial={mass: (0.0, 1.0)}), 1.0, method=name, dt=0.1, checkpoint=path,
                checkpoint_every=0.0)  # fmt: skip
    with h5py.File(path) as file:
        assert b"history" not in file["vofem_checkpoint/run/tree"][()].split(b'"snapshot"')[1].split(b'"counters"')[0]
