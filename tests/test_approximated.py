"""Callables as closed forms: the tolerance holds, and what cannot be done says so."""

import itertools

import numpy as np
import pytest
from scenes import alone, on_stop

import vofem as vf

FUNCTIONS = {
    "sine": (np.sin, 20.0),
    "bump": (lambda t: np.exp(-((t - 3.0) ** 2)), 10.0),
    "corner": (lambda t: abs(t - np.pi), 10.0),
    "jump": (lambda t: 1.0 if t >= np.pi else 0.3 * np.sin(t), 10.0),
    "chirp": (lambda t: np.sin(t**2), 6.0),
    "root": (np.sqrt, 2.0),
    "zero": (lambda t: 0.0, 1.0),
    "large": (lambda t: 1e12 + 1e6 * t**3, 3.0),
}


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_tolerance_holds(name, tolerance):
    function, t_end = FUNCTIONS[name]
    approximated = vf.Approximated(function, t_end, tolerance)
    t = np.sort(np.random.default_rng(1).uniform(0.0, t_end, 4001))
    exact = np.array([function(x) for x in t])
    size = np.max(np.abs(exact))
    assert np.max(np.abs(approximated(t) - exact)) <= tolerance * size
    assert approximated.error <= 1.01 * tolerance * size
    assert approximated.starts.size < 600


def test_pieces_and_derivatives_are_those_of_the_approximation():
    f = vf.Approximated(lambda t: np.sin(3.0 * t) + t, 4.0, 1e-9, breaks=[1.234])
    assert 1.234 in f.breakpoints(4.0)
    edges = np.concatenate([[0.0], f.breakpoints(4.0), [4.0]])
    for left, right in itertools.pairwise(edges):
        for start in (left, 0.5 * (left + right)):
            piece, tau = f.piece(start), 0.4 * (right - start)
            value = piece.constant + piece.slope * tau
            value += sum((a * np.exp(1j * w * tau)).real for w, a in piece.harmonics)
            assert value == pytest.approx(float(f(start + tau)), abs=1e-13)
    t = np.linspace(0.1, 3.9, 41)
    assert f.derivative(t) == pytest.approx(3.0 * np.cos(3.0 * t) + 1.0, abs=1e-6)
    assert f.derivative(t, 2) == pytest.approx(-9.0 * np.sin(3.0 * t), abs=1e-3)
    assert f(0.3).shape == ()


@pytest.mark.parametrize(("tolerance", "bound"), [(1e-6, 1e-6), (1e-9, 1e-9), (1e-12, 1e-12)])
def test_event_driven_run(tolerance, bound):
    """The motion is as good as the load: x'' + 4 x = sin t from rest."""
    mass = vf.Mass(1.0, stiffness=4.0)
    load = vf.PointLoad(mass, vf.Approximated(np.sin, 6.0, tolerance))
    result = vf.simulate(vf.Scene([mass], [load]), 6.0)
    assert result.method == "event_driven"
    exact = (np.sin(result.times) - 0.5 * np.sin(2.0 * result.times)) / 3.0
    assert np.max(np.abs(result.displacement(mass) - exact)) < bound
    assert result.energy.balance_error < 1e-9


def test_contact_under_an_approximated_load():
    """Events as with the closed form."""

    def run(f):
        _, scene = on_stop(vf.Mass(1.0, stiffness=1.0), gap=0.2, stiffness=50.0, load=f)
        result = vf.simulate(scene, 10.0)
        return result.solution.events.time

    exact = run(vf.Sine(0.5, 0.7) + vf.Pulse(0.2, 1.0, 2.0))
    assert exact.size > 4
    wave = vf.Approximated(lambda t: 0.5 * np.sin(0.7 * t) + 0.2 * (1.0 <= t < 3.0), 10.0, 1e-11)
    assert run(wave) == pytest.approx(exact, abs=1e-9)
    assert run(wave * 0.5 + wave * 0.5) == pytest.approx(exact, abs=1e-9)


def test_what_is_refused():
    with pytest.raises(vf.LoadError, match=r"returned nan at t = .* s"):
        vf.Approximated(lambda t: np.nan if t > 0.5 else 1.0, 1.0, 1e-6)
    with pytest.raises(vf.LoadError, match="ZeroDivisionError"):
        vf.Approximated(lambda t: 1 / 0, 1.0, 1e-6)
    rng = np.random.default_rng(0)
    with pytest.raises(vf.ConvergenceError, match="more than max_pieces = 500 pieces"):
        vf.Approximated(lambda t: rng.normal(), 1.0, 1e-6, max_pieces=500)
    for arguments, message in (
        ((1.0, 1.0, 1e-6), "expected a callable of t"),
        ((np.sin, -1.0, 1e-6), "t_end"),
        ((np.sin, 1.0, 0.0), "tolerance"),
        ((np.sin, 1.0, 1e-15), "below is rounding"),
    ):
        with pytest.raises(vf.ArgumentError, match=message):
            vf.Approximated(*arguments)
    with pytest.raises(vf.ArgumentError, match="max_pieces"):
        vf.Approximated(np.sin, 1.0, 1e-6, max_pieces=0)
    with pytest.raises(vf.ArgumentError, match="breaks"):
        vf.Approximated(np.sin, 1.0, 1e-6, breaks=[np.nan])
    with pytest.raises(vf.ArgumentError, match="order of a derivative"):
        vf.Approximated(np.sin, 1.0, 1e-6).derivative(0.5, -1)
    short = vf.Approximated(np.sin, 1.0, 1e-6)
    mass = vf.Mass(1.0, stiffness=1.0)
    with pytest.raises(vf.ArgumentError, match="ends at 1 s, before 2 s"):
        vf.simulate(vf.Scene([mass], [vf.PointLoad(mass, short)]), 2.0)
    with pytest.raises(vf.ArgumentError, match=r"was asked for t = 1\.5 s"):
        short(1.5)


def test_a_scene_file_refuses_it(tmp_path):
    _, scene = alone(vf.Mass(1.0, name="m"), load=vf.Approximated(np.sin, 1.0, 1e-6))
    with pytest.raises(vf.SceneFileError, match=r"Approximated\(.* is a callable, which a scene file cannot hold"):
        vf.dump_scene(scene, tmp_path / "scene.toml")


def test_a_saved_run_holds_it(tmp_path):
    """The pieces are kept, the callable is not: the run is complete."""
    mass = vf.Mass(1.0, stiffness=1.0, name="m")
    stop = vf.Contact(mass, gap=0.1, stiffness=50.0, side="above", acts_on="penetration", name="s")
    gust = vf.Approximated(lambda t: np.exp(-((t - 1.0) ** 2)), 5.0, 1e-8)
    result = vf.simulate(vf.Scene([mass], [stop, vf.PointLoad(mass, gust)]), 5.0)
    result.save(tmp_path / "run.vtkhdf")
    again = vf.load(tmp_path / "run.vtkhdf")
    t = np.linspace(0.0, 5.0, 77)
    assert np.array_equal(again.displacement(again.scene.bodies[0], t=t), result.displacement(mass, t=t))
