"""The operator on functions: closed forms, observed orders, both readings of a varying order, history, bad input."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import gamma, rgamma

import vofem as vf
from vofem.fractional import ExponentialOrder, rl_derivative, rl_integral

DATA = Path(__file__).parent / "data"
COUNTS = (100, 200, 400, 800)


def of_power(k, order, t):
    """The derivative (integral where negative) of t^k."""
    return gamma(k + 1) * rgamma(k + 1 - order) * t ** (k - order)


def g(t):
    return 1.5 - 2.0 * t + t**2 + 0.5 * t**4


def of_g(order, t):
    return sum(c * of_power(k, order, t) for c, k in ((1.5, 0), (-2.0, 1), (1.0, 2), (0.5, 4)))


def study(solve, exact, counts=COUNTS, since=0.0):
    """Largest error at ``t >= since`` for the finest grid, and the lowest and highest observed order."""
    errors = []
    for count in counts:
        t = np.linspace(0.0, 2.0, count + 1)
        late = (t >= since) & (t > 0.0)
        errors.append(np.max(np.abs(solve(t) - exact(np.where(late, t, 1.0)))[late]))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    return errors[-1], np.min(orders), np.max(orders)


@pytest.mark.parametrize(
    ("method", "order", "since", "low", "high", "error"),
    [
        ("cq", 0.3, 0.2, 1.95, 2.05, 3e-5),
        ("cq", 0.7, 0.2, 1.95, 2.05, 6e-5),
        ("cq", 1.0, 0.2, 1.95, 2.05, 8e-5),
        ("cq", 1.3, 0.0, 1.95, 2.05, 9e-5),
        ("cq", 1.8, 0.0, 1.95, 2.05, 9e-5),
        ("cq", 2.0, 0.0, 1.95, 2.05, 2e-4),
        # The first few steps: order 2 - order.
        ("cq", 0.7, 0.0, 1.25, 1.35, 4e-4),
        ("gl", 0.3, 0.2, 0.95, 1.05, 1e-2),
        ("gl", 1.5, 0.2, 0.95, 1.05, 9e-2),
        ("gl", 2.0, 0.2, 0.95, 1.05, 0.1),
        ("l1", 0.3, 0.0, 1.6, 1.75, 2e-4),
        ("l1", 0.7, 0.0, 1.25, 1.35, 5e-3),
        ("l1", 1.0, 0.0, 0.95, 1.05, 5e-2),
    ],
)
def test_derivatives_converge_at_their_orders(method, order, since, low, high, error):
    worst, lowest, highest = study(lambda t: rl_derivative(g, t, order, method), lambda t: of_g(order, t), since=since)
    assert low < lowest <= highest < high
    assert error / 4 < worst < error


@pytest.mark.parametrize(
    ("method", "order", "low", "high", "error"),
    [
        ("cq", 0.4, 1.95, 2.05, 3e-5),
        ("cq", 1.0, 1.95, 2.05, 6e-5),
        ("cq", 1.6, 1.95, 2.05, 8e-5),
        ("cq", 2.0, 1.95, 2.05, 8e-5),
        ("gl", 1.0, 0.95, 1.05, 2e-2),
        ("l1", 0.4, 1.9, 2.05, 3e-5),
        ("l1", 1.0, 1.95, 2.05, 2e-5),
        ("l1", 2.0, 1.95, 2.05, 1e-5),
    ],
)
def test_integrals_converge_at_their_orders(method, order, low, high, error):
    worst, lowest, highest = study(lambda t: rl_integral(g, t, order, method), lambda t: of_g(-order, t))
    assert low < lowest <= highest < high
    assert error / 4 < worst < error


@pytest.mark.parametrize("order", [0.0, 0.3, 0.5, 0.99, 1.0, 1.4, 2.0])
def test_powers_are_exact(order):
    """Starting weights make "cq" exact for what a function begins with, L1 is exact for what is linear."""
    t = np.linspace(3.0, 5.0, 201)
    x = t[1:] - 3.0
    for k in (0, 1, 2):
        tolerance = 1e-11 * (200.0**order)
        assert rl_derivative((t - 3.0) ** k, t, order, start=(0, 1, 2))[1:] == pytest.approx(
            of_power(k, order, x), abs=tolerance
        )
        if k < 2:
            assert rl_integral((t - 3.0) ** k, t, order)[1:] == pytest.approx(of_power(k, -order, x), abs=1e-12)
            if order <= 1.0:
                found = rl_derivative((t - 3.0) ** k, t, order, "l1")
                assert found[1:] == pytest.approx(of_power(k, order, x), rel=1e-12, abs=1e-12)
    rough = rl_derivative(np.sqrt(t - 3.0), t, order, start=(0.0, 0.5, 1.0))
    assert rough[1:] == pytest.approx(of_power(0.5, order, x), abs=1e-11 * 200.0**order)


@pytest.mark.parametrize(
    ("start", "low", "high"), [(None, 1.9, 2.05), ((0.0, 0.5, 1.0), 1.95, 2.05), ((0.0, 1.0, 2.0), 0.45, 0.6)]
)
def test_what_begins_like_a_root_and_the_exponents_for_it(start, low, high):
    def rough(t):
        return np.sqrt(t) * np.exp(t)

    def exact(t):
        return sum(of_power(k + 0.5, 0.5, t) / gamma(k + 1) for k in range(40))

    _, lowest, highest = study(lambda t: rl_derivative(rough, t, 0.5, start=start), exact, since=0.5)
    assert low < lowest <= highest < high


def rows_of_pycaputo():
    return sorted(json.loads((DATA / "fractional.json").read_text())["pycaputo"].items())


@pytest.mark.parametrize(("name", "values"), rows_of_pycaputo())
def test_the_same_schemes_elsewhere_give_the_same(name, values):
    method, operator, *graded, order = name.split()
    t = 2.0 * np.linspace(0.0, 1.0, 21) ** 1.5 if graded else np.linspace(0.0, 2.0, 21)
    samples = (0.0 if method == "gl" else 1.0) + t * np.cos(3.0 * t)
    apply = rl_derivative if operator == "derivative" else rl_integral
    if method == "bdf2":  # one sample late there, and without starting weights
        n = np.flatnonzero(t)[:-1]
        assert apply(samples, t, float(order), "cq", start=())[n] == pytest.approx(values[1:], rel=1e-12, abs=1e-13)
    else:
        mine = {"gl": "gl", "l1": "l1", "trapezoidal": "l1"}[method]
        assert apply(samples, t, float(order), mine)[1:] == pytest.approx(values, rel=1e-12, abs=1e-13)


def slow(t):
    return 0.6 + 0.35 * np.sin(2.0 * t)


def wide(t):
    return 1.0 + 0.9 * np.sin(2.0 * t)


@pytest.mark.parametrize(("method", "order", "low", "high"), [("cq", wide, 1.9, 2.1), ("gl", wide, 0.95, 1.05)])
def test_a_varying_order_is_frozen_at_each_time(method, order, low, high):
    def exact(t):
        return of_g(order(t), t)

    _, lowest, highest = study(lambda t: rl_derivative(g, t, order, method), exact, since=0.3)
    assert low < lowest <= highest < high
    t = np.linspace(0.0, 2.0, 401)
    assert rl_integral(g, t, order)[1:] == pytest.approx(of_g(-order(t[1:]), t[1:]), abs=1e-3)
    # Eq. 4: of a constant the operator is in closed form, as the laws on constants have it.
    law = ExponentialOrder(2.0, gap=lambda t: 0.1 + t)
    frozen = rl_derivative(3.0, t, law)[1:]
    closed = [3.0 * float(rgamma(1.0 - b)) * x**-b for b, x in zip(law(t[1:]), t[1:], strict=True)]
    assert frozen == pytest.approx(closed, rel=1e-10)


@settings(max_examples=25)
@given(
    method=st.sampled_from(["cq", "gl", "l1"]),
    seed=st.integers(0, 2**31),
    count=st.integers(70, 400),
    kind=st.sampled_from(["constant", "few", "smooth", "random"]),
)
def test_fast_sums_are_the_direct_ones(method, seed, count, kind):
    """To rounding: that of a difference of order b of samples at a step h is eps h^-b."""
    random = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, count)
    top = 1.0 if method == "l1" else 2.0
    order = {
        "constant": top * random.random(),
        "few": top * random.choice([0.0, 0.2, 0.5, 1.0], count),
        "smooth": top * (0.5 + 0.5 * np.sin(random.normal() + 9.0 * t)),
        "random": top * random.random(count),
    }[kind]
    samples = random.normal(size=count)
    for apply in (rl_derivative, rl_integral):
        fast = apply(samples, t, order, method)[1:]
        direct = apply(samples, t, order, method, fast=False)[1:]
        noise = 2e-13 * count ** np.broadcast_to(order, t.shape)[1:] if apply is rl_derivative else 2e-13
        # Starting weights carry rounding of n^2 times the curvature of the first samples.
        assert np.all(np.abs(fast - direct) < noise * (0.2 * count**2 if method == "cq" else 1.0))


def test_long_series_take_few_rows_of_memory():
    """Direct sums would take 10^10 operations."""
    import tracemalloc

    n = 2**17
    t = np.linspace(0.0, 2.0, n + 1)
    tracemalloc.start()
    found = rl_derivative(g, t, slow)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    late = slice(n // 10, None)
    assert found[late] == pytest.approx(of_g(slow(t), np.maximum(t, 1e-9))[late], abs=1e-6)
    assert peak < 60 * t.nbytes


def outside(k, order, m, t):
    """Definition 1 for t^k: the m-th derivative of its bracket, by differences of high order of the closed form."""
    h = 2e-3

    def bracket(x):
        return of_power(k, order(x) - m, x)

    a, b, c, d, e = (bracket(t + j * h) for j in (-2, -1, 0, 1, 2))
    return (8.0 * (d - b) - (e - a)) / (12.0 * h) if m == 1 else (16.0 * (d + b) - (a + e) - 30.0 * c) / (12.0 * h**2)


@pytest.mark.parametrize(
    ("method", "m", "low", "high", "error"),
    [("cq", 1, 1.85, 2.1, 1e-5), ("l1", 1, 1.1, 1.4, 3e-3), ("gl", 1, 0.9, 1.1, 2e-2), ("cq", 2, 1.7, 2.2, 2e-5)],
)
def test_the_derivative_outside_acts_on_the_order(method, m, low, high, error):
    def order(t):
        return m - 0.5 + 0.3 * np.sin(t)

    for k in (0.0, 1.0, 2.5):

        def solve(t, k=k):
            samples = np.ones_like(t) if k == 0 else t**k
            return rl_derivative(samples, t, order, method, reading="outside")

        worst, lowest, highest = study(solve, lambda t, k=k: outside(k, order, m, t), (200, 400, 800), since=0.3)
        assert worst < error
        if (method, k) not in (("l1", 0.0), ("l1", 1.0)) and worst > 1e-6:  # L1 is exact there but for the order
            assert low < lowest <= highest < high
        # The readings differ by far more than that.
        t = np.linspace(0.0, 2.0, 201)
        frozen = of_power(k, order(t[1:]), t[1:])
        assert np.max(np.abs(outside(k, order, m, t[100:]) - frozen[99:])) > 0.05


def test_readings_agree_where_the_order_is_constant():
    t = np.linspace(0.0, 2.0, 101)
    assert np.array_equal(rl_derivative(g, t, 0.4), rl_derivative(g, t, 0.4, reading="outside"))


def test_a_jump_of_the_order_is_an_impulse_outside():
    """Order 1 while open, 0 once closed at t_k: an impulse ``C0 (t_k - 1)``, and nothing else differs."""
    t = np.linspace(0.0, 4.0, 4001)
    for closing, C0 in ((3.0, 2.0), (0.5, -1.0)):
        order = np.where(t < closing - 1e-9, 1.0, 0.0)
        extra = rl_derivative(C0, t, order, reading="outside") - rl_derivative(C0, t, order)
        assert np.sum(extra[1:]) * 1e-3 == pytest.approx(C0 * (closing - 1.0), abs=2e-3 * abs(C0))
        assert np.flatnonzero(np.abs(extra[1:]) > 1e-9).size == 2


def test_uneven_grids():
    """L1 on a graded grid, with both readings; a root is resolved as well as a smooth function is."""
    errors = []
    for count in (100, 200, 400):
        t = 2.0 * np.linspace(0.0, 1.0, count + 1) ** 4
        found = rl_derivative(np.sqrt(t), t, 0.5, "l1")
        errors.append(np.max(np.abs(found - gamma(1.5))[t > 0.1]))
        assert rl_integral(np.sqrt(t), t, 0.5, "l1")[1:] == pytest.approx(of_power(0.5, -0.5, t[1:]), abs=1e-3)
        both = rl_derivative(2.0 * t, t, lambda t: 0.3 + 0.2 * t, "l1", reading="outside")
        exact = 2.0 * outside(1.0, lambda t: 0.3 + 0.2 * t, 1, t[count // 2 :])
        assert both[count // 2 :] == pytest.approx(exact, abs=100.0 / count**2)
    assert np.all(np.log2(np.divide(errors[:-1], errors[1:])) > 1.4)
    assert np.all(np.log2(np.divide(errors[:-1], errors[1:])) < 1.9)
    even = np.linspace(0.0, 2.0, 301)
    nudged = np.append(even[:-1], 2.0 + 1e-6)  # uneven, so treated by the other formula
    for apply, order in ((rl_derivative, 0.6), (rl_derivative, slow), (rl_integral, 1.7)):
        assert apply(g(even), nudged, order, "l1")[1:-1] == pytest.approx(apply(g, even, order, "l1")[1:-1], rel=1e-11)


@pytest.mark.parametrize(
    ("order", "method"), [(0.4, "cq"), (0.8, "l1"), (0.5, "gl"), (1.5, "cq"), (2.0, "cq"), (-0.6, "cq")]
)
def test_a_history_moves_the_lower_limit(order, method):
    """g = 1 + t^2 from a0 = 0, samples from a = 1: the operator from 0, at all times from a on."""
    errors = []
    for count in (100, 200, 400):
        t, past = np.linspace(1.0, 3.0, count + 1), np.linspace(0.0, 1.0, 2 * count + 1)
        options = {"method": method, "history": (past, lambda t: 1.0 + t**2)}
        apply = rl_derivative if order >= 0 else rl_integral
        found = apply(lambda t: 1.0 + t**2, t, abs(order), **options)
        exact = of_power(0, order, t) + of_power(2, order, t)
        errors.append(np.abs(found - exact)[[0, count // 2, count]])
    assert np.all(errors[-1] < (1e-8 if order == 2.0 else 2e-3 if method == "cq" else 1e-2))
    observed = np.log2(errors[0] / errors[1])[1:]
    low, high = {"l1": (1.1, 1.3), "gl": (0.9, 1.1), "cq": (1.8, 2.2)}[method]
    if order != 2.0:
        assert np.all((low < observed) & (observed < high))


@pytest.mark.parametrize("order", [-0.7, 0.0, 0.4, 1.0, 1.5])
def test_the_term_of_a_constant_history(order):
    """psi = C ((t - a0)^q - (t - a)^q)/Gamma(q + 1), Eq. 2; its derivative where nothing follows the history."""
    t, q = np.linspace(1.0, 4.0, 301), -order
    apply = rl_derivative if order >= 0 else rl_integral
    found = apply(np.zeros(301), t, abs(order), history=(np.linspace(-1.0, 1.0, 21), 2.0))
    x, y = t[1:] + 1.0, t[1:] - 1.0
    assert found[1:] == pytest.approx(2.0 * (x**q - y**q) * rgamma(q + 1.0), rel=1e-11, abs=1e-12)
    assert found[0] == (-np.inf if order in (0.4, 1.0) else np.inf if order == 1.5 else pytest.approx(found[0]))
    # Parts add up: history and samples of one constant are the constant from a0.
    whole = apply(np.full(301, 2.0), t, abs(order), history=(np.linspace(-1.0, 1.0, 21), 2.0))
    assert whole[1:] == pytest.approx(2.0 * x**q * rgamma(q + 1.0), rel=1e-10, abs=1e-9)


def test_values_at_the_lower_limit():
    t = np.linspace(0.0, 1.0, 101)

    def first(samples, order, method="cq"):
        return rl_derivative(samples, t, order, method)[0]

    assert first(np.cos, 0.0) == 1.0
    assert first(np.sin, 1.0) == pytest.approx(1.0, abs=1e-4)
    assert first(np.sin, 1.0, "l1") == pytest.approx(1.0, abs=1e-4)
    assert first(np.cos, 2.0) == pytest.approx(-1.0, abs=1e-3)
    assert (first(np.cos, 0.5), first(np.cos, 1.5)) == (np.inf, -np.inf)
    assert first(np.sin, 0.5) == 0.0
    assert np.isnan(first(np.sin, 1.5))
    assert rl_integral(np.cos, t, 0.5)[0] == 0.0
    assert rl_integral(np.cos, t, 0.0)[0] == 1.0
    assert np.isnan(rl_derivative([0.0, 1.0], [0.0, 1.0], 2.0, "gl")[0])


T = np.linspace(0.0, 1.0, 11)


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: rl_derivative(np.where(T < 0.5, T, np.nan), T, 0.5), r"samples holds nan at index \[5\]"),
        (lambda: rl_derivative(T, T[:-1], 0.5), r"samples has shape \(11,\), expected one per time of t, \(10,\)"),
        (lambda: rl_derivative(np.ones((11, 2)), T, 0.5), "expected one per time"),
        (lambda: rl_derivative([1.0], [0.0], 0.5), "at least 2 times"),
        (lambda: rl_derivative([0.0, 1.0], [0.0, 1.0], 0.5), 'needs at least 3: give more.*"gl"'),
        (lambda: rl_derivative(T, T[::-1], 0.5), "expected increasing times"),
        (lambda: rl_derivative(T, T, 2.5), "order is 2.5, expected a number from 0 to 2"),
        (lambda: rl_derivative(T, T, -0.5), "order is -0.5"),
        (lambda: rl_derivative(T, T, np.nan), "order is nan"),
        (lambda: rl_derivative(T, T, "half"), "order is 'half'"),
        (lambda: rl_derivative(T, T, T[:3]), r"order has shape \(3,\)"),
        (lambda: rl_derivative(T, T, ExponentialOrder(1e5, gap=lambda t: 0.5 - t)), "at t = 0.6.*limit the order"),
        (lambda: rl_derivative(T, T, 1.5, "l1"), "from 0 to 1"),
        (lambda: rl_derivative(T, T**2, 0.5), 'needs equal ones: use method="l1".*np.interp'),
        (lambda: rl_derivative(T, T, 0.5, "bdf"), "method is 'bdf'"),
        (lambda: rl_derivative(T, T, 0.5, reading="inside"), "reading is 'inside'"),
        (lambda: rl_derivative(T, T, 0.5, start=(0.0, 0.0)), "different exponents"),
        (lambda: rl_derivative(T, T, 0.5, fast="no"), "fast is 'no', expected True or False"),
        (lambda: rl_derivative(T, T, 0.5, history=3.0), "expected a pair"),
        (lambda: rl_derivative(T, T, 0.5, history=(T - 2.0, T)), "the history ends at -1 s"),
        (lambda: rl_derivative(T, T, 0.5, history=(T - 1.0, T * np.inf)), "history samples holds"),
        (lambda: rl_derivative(T, T, 0.5, history=(-(T[::-1] ** 2), T)), "times of the history samples"),
    ],
)
def test_bad_input_is_named(call, match):
    with np.errstate(invalid="ignore"), pytest.raises(vf.ArgumentError, match=match):
        call()
