"""The operator on constants, the order law and the scaling factor."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import vofem as vf
from vofem import fractional
from vofem.laws import resolved as resolved_law

DATA = Path(__file__).parent / "data"


def test_the_ideal_law_is_equation_8():
    assert list(fractional.ideal(2.0, [-1.0, 0.0, 1e-300, 3.0])) == [0.0, 0.0, 2.0, 2.0]
    # Superposition, Eq. 14.
    s = np.array([-1.0, 0.5])
    assert np.array_equal(fractional.ideal(2.0 + 3.0, s), fractional.ideal(2.0, s) + fractional.ideal(3.0, s))


def test_the_resolved_law_reaches_its_levels():
    """10, 50 and 90 % of C0 at s0 s = 0.100, 0.585 and 1.907."""
    levels = fractional.resolved(1.0, np.array([0.100, 0.585, 1.907]) / 50.0, 50.0)
    assert levels == pytest.approx([0.1, 0.5, 0.9], abs=1e-2)
    # 1 - beta by expm1: slope s0 s at closing, where the naive difference loses 8e-4.
    assert fractional.resolved(1.0, 1e-14, 1.0) == pytest.approx(1e-14, rel=1e-12)


@given(s0=st.floats(1e-3, 1e9), s=st.floats(-1e3, 1e3), k=st.floats(1e-3, 1e9))
def test_the_resolved_law_is_bounded_and_compiled_alike(s0, s, k):
    value = float(fractional.resolved(k, s, s0))
    assert 0.0 <= value <= k * (1 + 1e-14)
    if s <= 0:
        assert value == 0.0
    assert k * resolved_law.switch(s0 * s) == pytest.approx(value, rel=1e-12, abs=0.0)


def test_the_resolved_law_is_monotone_and_tends_to_the_ideal_one():
    s = np.linspace(-0.01, 0.1, 1001)
    assert np.all(np.diff(fractional.resolved(1.0, s, 100.0)) >= 0)
    assert np.array_equal(fractional.resolved(3.0, s, 1e9), fractional.ideal(3.0, s))


def test_the_literal_formula_leaves_all_bounds():
    """-452 C0 at s = -2 mm and 4e256 C0 at -5 mm, for s0 = 1e3 at t = 1 s."""
    sign, log = fractional.literal(1.0, np.array([-2e-3, -5e-3]), 1e3, 1.0)
    assert sign[0] * np.exp(log[0]) == pytest.approx(-452.0, rel=2e-3)
    assert log[1] / np.log(10.0) == pytest.approx(256.6, abs=0.1)
    sign, log = fractional.literal(2.0, np.array([0.5, 0.0]), 10.0, 1.0)
    assert sign[0] * np.exp(log[0]) == pytest.approx(float(fractional.resolved(2.0, 0.5, 10.0)), rel=1e-12)
    assert sign[1] == 0.0
    assert log[1] == -np.inf
    # Where the sign is beyond double precision the logarithm is that of the envelope.
    sign, log = fractional.literal(1.0, np.array([-0.04, -1.0]), 1e3, 1.0)
    assert list(sign) == [0.0, 0.0]
    assert log[0] == pytest.approx(np.exp(40.0) * 39.0, rel=1e-12)
    assert log[1] == np.inf


def test_the_literal_formula_agrees_with_multiple_precision():
    for x, t, sign, log in json.loads((DATA / "fractional.json").read_text())["literal"]:
        found_sign, found = fractional.literal(1.0, x, 1.0, t)
        assert found_sign == sign
        # The order is as uncertain as the rounding of its exponent, and counts that much more the larger it is.
        order = np.exp(-x)
        assert found == pytest.approx(log, rel=1e-13, abs=1e-15 * (1.0 + 40.0 * order))


ANYTHING = st.one_of(st.floats(allow_nan=False), st.sampled_from([0.0, -0.0, 5e-324, -5e-324, 1.8e308, -1.8e308]))


@given(s=ANYTHING, s0=st.floats(1e-60, 1e60), t=st.floats(1e-60, 1e60), C0=st.floats(-1e60, 1e60))
def test_all_laws_take_all_numbers(s, s0, t, C0):
    """No overflow, no NaN; where the printed formula is in range, both finite laws that follow it agree with it."""
    assert fractional.ideal(C0, s) == (C0 if s > 0 else 0.0)
    value = float(fractional.resolved(C0, s, s0))
    assert abs(value) <= abs(C0) * (1.0 + 1e-14)
    sign, log = (float(x) for x in fractional.literal(C0, s, s0, t))
    assert sign in (-1.0, 0.0, 1.0)
    assert not np.isnan(log)
    if C0 == 0.0 or s == 0.0:
        assert (sign, log) == (0.0, -np.inf)
    at_one = fractional.literal(C0, s, s0, 1.0)
    if s > 0 and abs(value) > 1e-300:
        assert float(at_one[0]) == np.sign(C0)
        assert float(at_one[1]) == pytest.approx(np.log(abs(value)), abs=1e-13 * (1.0 + abs(at_one[1])))


def test_laws_take_arrays_that_broadcast():
    s, t = np.linspace(-1e-3, 1e-2, 5), np.array([[0.5], [1.0], [2.0]])
    sign, log = fractional.literal([1.0], s, 1e3, t)
    assert sign.shape == log.shape == (3, 5)
    for k in range(3):
        assert log[k] == pytest.approx(fractional.literal(1.0, s, 1e3, t[k, 0])[1], rel=1e-15)
    assert fractional.resolved([[1.0], [2.0]], s, 1e3).shape == (2, 5)


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: fractional.ideal([1.0, np.nan], 1.0), "C0 holds nan"),
        (lambda: fractional.resolved(np.inf, 1.0, 1.0), "C0 holds inf"),
        (lambda: fractional.literal(1.0, 1.0, 1.0, [1.0, 0.0]), "t holds 0"),
        (lambda: fractional.literal(1.0, np.nan, 1.0, 1.0), "gap function s is NaN"),
        (lambda: fractional.ideal(1.0, "closed"), "gap function s is 'closed'"),
        (lambda: fractional.ConstantOrder(-0.1), "ConstantOrder: value is -0.1"),
        (lambda: fractional.ExponentialOrder(0.0), "s0 is 0"),
        (lambda: fractional.ExponentialOrder(1.0, gap=3.0), "gap is 3.0"),
        (lambda: fractional.TabulatedOrder([0.0, 1.0], [0.5]), "one length"),
        (lambda: fractional.TabulatedOrder([0.0, 0.0], [0.5, 0.5]), "is 0 and then 0"),
        (lambda: fractional.TabulatedOrder([0.0, 1.0], [0.5, -0.5]), "none below 0"),
    ],
)
def test_bad_laws_are_named(call, match):
    with pytest.raises(vf.ArgumentError, match=match):
        call()


def test_order_laws():
    x = np.array([-1.0, 0.0, 0.5, 2.0])
    assert list(fractional.ConstantOrder(0.3)(x)) == [0.3] * 4
    assert fractional.ExponentialOrder(3.0)(x) == pytest.approx(np.exp(-3.0 * x))
    assert fractional.ExponentialOrder(3.0, gap=lambda t: t - 1.0)(x) == pytest.approx(np.exp(-3.0 * (x - 1.0)))
    assert fractional.ExponentialOrder(1e5)(-1.0) == np.inf
    assert list(fractional.TabulatedOrder([0.0, 1.0], [0.2, 0.8])(x)) == pytest.approx([0.2, 0.2, 0.5, 0.8])


def test_scaling_factors_of_the_paper():
    assert fractional.scaling_factor(5.0) == pytest.approx(138.2, abs=0.1)
    assert fractional.scaling_factor(0.03) == pytest.approx(2.30e4, rel=2e-3)
    with pytest.raises(vf.ArgumentError, match="between 0 and 1"):
        fractional.scaling_factor(1.0, delta=1.0)


@pytest.mark.parametrize("jump", [False, True])
def test_bound_of_the_contact_slope(jump):
    """The stability limit of explicit steps needs the steepest tangent of R/K0."""
    gap, s0 = 0.03, 1e3
    s = np.linspace(1e-9, 0.05, 200_001)
    force = fractional.resolved(1.0, s, s0) * (s + (gap if jump else 0.0))
    steepness = np.max(np.diff(force) / np.diff(s))
    assert steepness <= resolved_law.steepest(gap, jump, s0) <= 1.1 * steepness


@pytest.mark.kernels("plain")
def test_the_resolved_trajectory_tends_to_the_ideal_one():
    """Like 1/s0^2 where the force acts on the penetration."""
    errors = []
    for switch in (vf.Resolved(10.0), vf.Resolved(100.0)):
        tips = []
        for kind in (switch, "ideal"):
            first, second = vf.Mass(1.0, 1.0, 0.1), vf.Mass(1.0, 1.0, 0.4)
            contact = vf.Contact(first, second, gap=5.0, stiffness=2.0, acts_on="penetration", switch=kind)
            loads = [vf.PointLoad(first, vf.Sine(5.0, 0.8)), vf.PointLoad(second, vf.Sine(-5.0, 0.8))]
            scene = vf.Scene([first, second], [contact, *loads], initial={first: (0.0, -1.0)})
            result = vf.simulate(scene, 20.0, method="central_difference", dt=2e-3, times=np.linspace(0.0, 20.0, 201))
            tips.append(result.displacement(first))
            assert np.max(result.energy.balance_error) < 1e-4
        errors.append(np.max(np.abs(tips[0] - tips[1])))
    assert 1.7 < np.log10(errors[0] / errors[1]) < 2.3
    assert errors[1] < 1e-4
