"""Named time functions: values, exact derivatives, pieces and breakpoints."""

import itertools

import numpy as np
import pytest

import vofem as vf

FUNCTIONS = [
    vf.Sine(2.0, 3.0, 0.4),
    vf.Sine(2.0, -3.0, 0.4),
    vf.Sine(2.0, 0.0, 0.4),
    vf.Constant(1.5),
    vf.Ramp(0.5, 0.3),
    vf.Ramp(-0.5, 0.3, 1.1),
    vf.Pulse(2.0, 0.4, 0.5),
    vf.Tabulated([0.0, 0.5, 0.7, 2.0], [0.0, 1.0, -1.0, 0.5]),
    2.0 * vf.Sine(1.0, 2.0) - 3 * vf.Pulse(1.0, 0.2, 0.1) + 1.0,
]


def value(piece, tau):
    return piece.constant + piece.slope * tau + sum((a * np.exp(1j * w * tau)).real for w, a in piece.harmonics)


@pytest.mark.parametrize("f", FUNCTIONS, ids=repr)
def test_pieces_reproduce_the_function(f):
    edges = [0.0, *f.breakpoints(2.0), 2.0]
    for left, right in itertools.pairwise(edges):
        t = left + (right - left) * np.linspace(0.0, 0.999, 7)
        piece = f.piece(left)
        assert np.array([value(piece, x - left) for x in t]) == pytest.approx(f(t), abs=1e-13)


@pytest.mark.parametrize("f", FUNCTIONS, ids=repr)
def test_derivatives_are_exact(f):
    t = np.array([0.05, 0.35, 0.55, 0.75, 1.2, 1.7])
    h = 1e-5
    for order in (1, 2):
        expected = (f.derivative(t + h, order - 1) - f.derivative(t - h, order - 1)) / (2 * h)
        assert f.derivative(t, order) == pytest.approx(expected, abs=1e-6)
    assert f.derivative(t, 0) == pytest.approx(f(t))


def test_values_are_continuous_from_the_right():
    pulse = vf.Pulse(2.0, 0.4, 0.5)
    assert list(pulse([0.4, 0.9])) == [2.0, 0.0]
    assert vf.Ramp(1.0, 1.0).derivative(1.0) == 1.0
    assert vf.Tabulated([0.0, 1.0, 2.0], [0.0, 1.0, 0.0]).derivative(1.0) == -1.0
    assert vf.Tabulated([1.0], [3.0])(0.0) == 3.0


def test_orders_must_be_whole_numbers():
    with pytest.raises(vf.ArgumentError, match="order of a derivative"):
        vf.Sine(1.0, 1.0).derivative(0.0, -1)
    with pytest.raises(vf.ArgumentError, match="closed form"):
        vf.PointLoad(vf.Mass(1.0), np.sin).f.piece(0.0)


def test_a_train_of_very_many_pulses_is_one_sum():
    train = sum((vf.Pulse(1.0, 6.0 * k, 1.0) for k in range(2000)), vf.Constant(0.0))
    assert len(train.terms) == 2001
    assert train(6.0 * 1999 + 0.5) == 1.0
    mass = vf.Mass(1.0, stiffness=1.0, name="mass")
    assert vf.simulate(vf.Scene([mass], [vf.PointLoad(mass, train)]), 1.0).displacement(mass)[-1] == pytest.approx(
        1.0 - np.cos(1.0), rel=1e-12
    )
