"""The numerical building blocks, against independent computations."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh, expm

import vofem as vf
from vofem.errors import SingularSystemError
from vofem.linalg.banded import band_order, factor, to_band
from vofem.linalg.eigen import modes_held, modes_of_strains
from vofem.linalg.exponential import exponential_response, oscillator_change, ramp_response


def exact_response(delta, p, b, t):
    matrix = np.array([[0, 1, 0], [-p, -2 * delta, 1], [0, 0, b]], dtype=complex)
    return expm(matrix * t)[0, 2]


def exact_ramp(delta, p, t):
    matrix = np.array([[0, 1, 0, 0], [-p, -2 * delta, 1, 0], [0, 0, 0, 1], [0, 0, 0, 0]], dtype=float)
    return expm(matrix * t)[0, 3]


RESONANT = [
    (0.0, 1.0, 1j), (0.0, 1.0, 1.0000001j), (0.0, 0.0, 0j), (0.0, 0.0, 1e-9j), (0.0, 1e-18, 0j), (1.0, 1.0, 0j),
    (1.0, 1.0, 1j), (0.5, 0.25, -0.5 + 0j), (0.0, 4.0, 1j), (0.1, 3.0, 2j), (3.0, 1.0, 0.1j), (0.0, 1e-6, 1e-3j),
]  # fmt: skip


@pytest.mark.parametrize(("delta", "p", "b"), RESONANT)
@pytest.mark.parametrize("t", [1e-6, 1e-2, 0.9, 3.0, 30.0])
def test_response_of_an_oscillator_at_and_near_resonance(delta, p, b, t):
    expected = exact_response(delta, p, b, t)
    assert abs(exponential_response(delta, p, b, t) - expected) < 1e-12 * abs(expected) + 1e-300
    expected = exact_ramp(delta, p, t)
    assert abs(ramp_response(delta, p, t) - expected) < 2e-12 * abs(expected)


@given(delta=st.floats(0.0, 10.0), p=st.one_of(st.just(0.0), st.floats(1e-12, 1e3)), t=st.floats(1e-6, 20.0))
def test_free_motion_of_any_oscillator(delta, p, t):
    c, s = oscillator_change(delta, p, t)
    c += 1.0
    flow = expm(np.array([[0.0, 1.0], [-p, -2.0 * delta]]) * t)
    got = np.array([[c + delta * s, s], [-p * s, c - delta * s]])
    assert np.max(np.abs(got - flow)) < 1e-9 * max(1.0, np.max(np.abs(flow)))


@given(st.data())
def test_modes_of_a_diagonal_and_a_spring(data):
    n = data.draw(st.integers(1, 8))
    pool = st.sampled_from([0.0, 1e-6, 1.0, 1.0 + 1e-15, 2.0, 1e3, 1e6])
    d = np.sort(np.array(data.draw(st.lists(pool, min_size=n, max_size=n))))
    c = np.array(data.draw(st.lists(st.sampled_from([0.0, 1e-9, 0.1, -1.0, 3.0]), min_size=n, max_size=n)))
    rho = data.draw(st.sampled_from([1e-9, 1.0, 1e4, 1e12]))
    values, vectors = modes_of_strains(d, c[None, :], np.array([rho]))
    matrix = np.diag(d) + rho * np.outer(c, c)
    size = max(np.max(np.abs(matrix)), 1e-300)
    assert np.max(np.abs(vectors.T @ vectors - np.eye(n))) < 1e-13
    assert np.max(np.abs(matrix @ vectors - vectors * values)) < 1e-13 * size
    assert np.all(np.diff(values) >= 0)
    # Interlacing: no value falls below that of the diagonal, none but the last exceeds the next one.
    assert np.all(values >= d * (1.0 - 1e-13))
    assert np.all(values[:-1] <= d[1:] * (1.0 + 1e-13))


def test_low_eigenvalues_keep_their_digits_beside_a_huge_contact():
    """`eigh` of the same matrix loses eight digits; the inverse, by Sherman-Morrison, tells the truth."""
    d = np.arange(1.0, 21.0) ** 4
    c = np.ones(20)
    rho = 1e12
    values, _ = modes_of_strains(d, c[None, :], np.array([rho]))
    inverse = np.diag(1.0 / d) - np.outer(c / d, c / d) / (1.0 / rho + np.sum(c**2 / d))
    expected = 1.0 / eigh(inverse, eigvals_only=True)[-1]
    assert values[0] == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_modes_of_held_rows_are_those_of_stiff_springs(count):
    """In the limit; two rigid motions among the modes, of which rows hold none, one or both."""
    rng = np.random.default_rng(count)
    d, rows = np.append([0.0, 0.0], np.arange(1.0, 19.0) ** 4), rng.normal(size=(count, 20))
    rows[:, 0] = 0.0
    values, modes = modes_held(d, rows)
    assert np.abs(modes.T @ modes - np.eye(20 - count)).max() < 1e-14
    assert np.abs(rows @ modes).max() < 1e-14
    assert values[0] == 0.0
    stiff, _ = modes_of_strains(d, rows, np.full(count, 1e16))
    assert values == pytest.approx(stiff[: 20 - count], rel=1e-9)


def test_band_order_narrows_a_shuffled_chain():
    from scipy.sparse import diags

    n = 200
    chain = diags([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1]).tocsr()
    shuffle = np.random.default_rng(1).permutation(n)
    shuffled = chain[shuffle][:, shuffle]
    assert to_band(shuffled, band_order(shuffled)).shape[0] <= 3


def test_indefinite_matrix_is_named():
    with pytest.raises(SingularSystemError, match="the mass matrix is not positive definite"):
        factor(np.array([[1.0, -1.0]]), "the mass matrix")


def test_a_long_chain_is_assembled_without_large_arrays():
    """20 000 free masses in a row: one rigid motion, found without a dense matrix of all bodies."""
    masses = [vf.Mass(1.0) for _ in range(20_000)]
    springs = [vf.Spring(a, b, stiffness=1.0) for a, b in pairwise(masses)]
    system = vf.Scene(masses, springs, initial={masses[0]: (0.0, 1.0)}).model.system
    assert system.rigid.shape == (20_000, 1)
    assert system.rigid == pytest.approx(np.full((20_000, 1), system.rigid[0, 0]), rel=1e-12)
