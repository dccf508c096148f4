"""The fractional derivative along a run: kernel, orders, oscillators in closed form, state."""

from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import gamma

import vofem as vf
from vofem.fractional import StreamingDerivative, rl_derivative
from vofem.fractional.exponentials import exponentials


@pytest.mark.parametrize(("ratio", "tolerance", "terms"), [(10.0, 1e-4, 20), (1e3, 1e-8, 40), (1e6, 1e-12, 80)])
def test_the_kernel_is_within_its_tolerance(ratio, tolerance, terms):
    """Times and orders between those at which it was measured; terms grow like log(t_end/dt) log(1/tolerance)."""
    kernel = exponentials(0.01, 0.01 * ratio, tolerance)
    t = np.geomspace(0.01, 0.01 * ratio, 317)
    for order in (1e-6, 0.01, 0.13, 0.5, 0.77, 0.99):
        found = np.exp(-t[:, None] * kernel.rates) @ kernel.weights(order)
        assert found == pytest.approx(t**-order / gamma(1.0 - order), rel=1.2 * tolerance)
    assert kernel.error <= tolerance
    assert len(kernel.rates) <= terms
    # At the ends the operator is the displacement since t = 0, or the velocity of the last step alone.
    assert np.exp(-t[:, None] * kernel.rates) @ kernel.weights(0.0) == pytest.approx(np.ones(317), rel=1.2 * tolerance)
    assert kernel.weights(1.0) == pytest.approx(np.zeros(len(kernel.rates)), abs=1e-10 / 0.01)


def test_no_weight_is_negative():
    """So the sum is a chain of springs and dashpots, with those faster than its rates as two sums."""
    order = np.concatenate(
        [[0.0], np.geomspace(1e-12, 0.1, 40), np.linspace(0.1, 1.0, 91), 1.0 - 10.0 ** -np.arange(3, 15)]
    )
    for tolerance in np.geomspace(1e-12, 1e-2, 31):
        kernel = exponentials(0.01, 1.0, tolerance)
        # Before it is cut off at zero.
        with mock.patch.object(np, "maximum", lambda x, _: x):
            raw = kernel.weights(order)
        assert np.all(raw >= -1e-15 * np.sum(raw, axis=1, keepdims=True))
        assert kernel.weights(order) == pytest.approx(np.array([kernel.weights(a) for a in order]), rel=1e-13)
        # The force of a velocity that sets in, in the mean over a step: dt^(1 - a)/Gamma(3 - a).
        z = np.maximum(kernel.rates * 0.01, 1e-30)
        mean = 0.01 * np.where(z < 1e-4, 0.5 - z / 6.0, (z + np.expm1(-z)) / z**2)
        first, second = kernel.faster(order).T
        found = kernel.weights(order) @ mean + first - second / 0.01
        assert found == pytest.approx(0.01 ** (1.0 - order) / gamma(3.0 - order), rel=tolerance)


@pytest.mark.parametrize("given", ["velocity", "displacement"])
@pytest.mark.parametrize("order", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_orders_in_the_step(given, order):
    """t^3: second order from velocities, 2 - a from displacements."""
    errors = []
    for count in (100, 200, 400):
        stream = StreamingDerivative(2.0 / count, 2.0, order, given=given, tolerance=1e-11)
        found = []
        for t in 2.0 * np.arange(1, count + 1) / count:
            value = 3.0 * t**2 if given == "velocity" else t**3
            found.append(stream.peek(value))
            stream.commit(value)
        errors.append(abs(found[-1] - gamma(4.0) / gamma(4.0 - order) * 2.0 ** (3.0 - order)))
    observed = np.log2(np.divide(errors[:-1], errors[1:])) if errors[-1] > 1e-9 else np.array([])
    expected = 2.0 if given == "velocity" else 2.0 - order
    assert np.all(np.abs(observed - expected) < 0.12)
    assert errors[-1] < (2e-4 if given == "velocity" else 0.05)


def test_the_stream_of_displacements_is_the_sum_over_all_samples():
    """L1 over the whole history, with the order frozen at each time; it is Caputo's, the closed term apart."""
    t = np.linspace(0.0, 3.0, 301)
    order = 0.5 + 0.45 * np.sin(3.0 * t)
    u = 1.0 + np.sin(5.0 * t) * t
    stream = StreamingDerivative(0.01, 3.0, 0.5, given="displacement", initial=u[0], tolerance=1e-12)
    found = []
    for value, a in zip(u[1:], order[1:], strict=True):
        found.append(stream.peek(value, a))
        slope, rest = stream.affine(a)
        assert slope * value + rest == pytest.approx(found[-1], rel=1e-12, abs=1e-12)
        stream.commit(value)
    start = u[0] * t[1:] ** -order[1:] / gamma(1.0 - order[1:])
    assert np.array(found) + start == pytest.approx(rl_derivative(u, t, order, "l1")[1:], rel=1e-10, abs=1e-10)
    assert len(stream.state) < 60


@settings(max_examples=25)
@given(
    order=st.floats(0.0, 1.0),
    kind=st.sampled_from(["velocity", "displacement"]),
    values=st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=20),
    tried=st.floats(-1e6, 1e6),
)
def test_rejected_steps_leave_no_trace_and_states_resume(order, kind, values, tried):
    plain = StreamingDerivative(0.1, 10.0, order, given=kind, tolerance=1e-6)
    other = StreamingDerivative(0.1, 10.0, order, given=kind, tolerance=1e-6)
    for value in values:
        before = other.state
        other.peek(tried, 0.3)
        other.affine(0.7)
        assert np.array_equal(other.state, before)
        assert other.peek(value) == plain.peek(value)
        plain.commit(value)
        other.commit(tried)
        other.state = before
        other.commit(value)
    assert np.array_equal(plain.state, other.state)
    assert plain.t == pytest.approx(0.1 * len(values))
    resumed = StreamingDerivative(0.1, 10.0, order, given=kind, tolerance=1e-6)
    resumed.state = plain.state
    assert resumed.affine() == plain.affine()


def test_a_hundred_thousand_steps_with_fifty_numbers():
    """D^a of sin tends to ``sin(t + a pi/2)``: the start fades like t^(-1-a)."""
    dt, count, order = 0.01, 100_000, 0.5
    stream = StreamingDerivative(dt, dt * count, order, tolerance=1e-9, initial=1.0)
    state, weights = stream.state, stream.weights(order)
    assert len(state) < 70
    y = state[:-2]
    rates = np.cos(dt * np.arange(count))
    # The same step as in commit, as a compiled loop would take it.
    for k in range(1, count):
        y = stream.decay * y + stream.start * rates[k - 1] + stream.end * rates[k]
    stream.state = np.concatenate([y, [rates[-1], count - 1.0]])
    t = dt * count
    assert stream.peek(np.cos(t)) == pytest.approx(np.sin(t + 0.25 * np.pi), abs=1e-4)
    assert weights.shape == y.shape
    stream.commit(np.cos(t))
    with pytest.raises(vf.ArgumentError, match="beyond t_end = 1000 s"):
        stream.commit(0.0)


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: StreamingDerivative(0.0, 1.0, 0.5), "dt is 0"),
        (lambda: StreamingDerivative(0.1, 0.01, 0.5), "t_end not below dt"),
        (lambda: StreamingDerivative(0.1, 1.0, 1.5), "order is 1.5"),
        (lambda: StreamingDerivative(0.1, 1.0, -0.5), "order is -0.5"),
        (lambda: StreamingDerivative(0.1, 1.0, 0.5, tolerance=1e-15), "tolerance is 1e-15"),
        (lambda: StreamingDerivative(0.1, 1.0, 0.5, given="speed"), "given is 'speed'"),
        (lambda: StreamingDerivative(0.1, 1.0, 0.5).commit(np.nan), "value is NaN"),
        (lambda: StreamingDerivative(0.1, 1.0, 0.5).peek(0.0, 2.0), "order is 2"),
        (lambda: setattr(StreamingDerivative(0.1, 1.0, 0.5), "state", [1.0]), "state has shape"),
    ],
)
def test_bad_input_is_named(call, match):
    with pytest.raises(vf.ArgumentError, match=match):
        call()
