"""Chains of very many bodies: their rigid motions are found without dense matrices."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_matrix

import vofem as vf
from vofem.linalg import null_space as module
from vofem.linalg.null_space import null_space, sparse_null_space


def chain(n, *, held):
    masses = [vf.Mass(1.0) for _ in range(n)]
    springs = [vf.Spring(masses[k], masses[k + 1], stiffness=1.0 + k) for k in range(n - 1)]
    return masses, springs + ([vf.Spring(masses[0], stiffness=1.0)] if held else [])


@pytest.mark.parametrize("held", [True, False])
def test_many_and_few_give_the_same_motions(held, monkeypatch):
    """Two chains, a beam on a spring and a loose mass: what is tied in pairs and what is not."""

    def rigid():
        masses, springs = chain(7, held=held)
        others, more = chain(4, held=False)
        beam = vf.Beam(1.0, 1.0, 1.0, 2)
        joined = vf.Spring(beam.at(0.3), others[0], stiffness=2.0)
        loose = vf.Mass(1.0)
        return vf.Scene([*masses, beam, *others, loose], [*springs, *more, joined]).model.system.rigid

    few = rigid()
    monkeypatch.setattr(module, "_FEW_COLUMNS", 0)
    many = rigid()
    assert many.shape == few.shape == (18, 4 - held)
    # The same space: each is a combination of the other.
    for a, b in ((few, many), (many, few)):
        left = np.linalg.lstsq(a, b, rcond=None)[0]
        np.testing.assert_allclose(a @ left, b, atol=1e-12)


@settings(deadline=None, max_examples=60)
@given(st.data())
def test_null_spaces_agree(data):
    columns = data.draw(st.integers(1, 7))
    entry = st.tuples(st.integers(0, columns - 1), st.sampled_from([-2.0, -1.0, 1.0, 3.0]))
    rows = data.draw(st.lists(st.lists(entry, min_size=1, max_size=3), min_size=1, max_size=9))
    matrix = np.zeros((len(rows), columns))
    for i, row in enumerate(rows):
        for k, x in row:
            matrix[i, k] = x
    sparse = csr_matrix(matrix)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_FEW_COLUMNS", 0)
        found = sparse_null_space(sparse, abs(sparse))
    expected = null_space(matrix, np.abs(matrix))
    assert found.shape == expected.shape
    np.testing.assert_allclose(matrix @ found, 0.0, atol=1e-12)
    assert np.linalg.matrix_rank(np.hstack([found, expected])) == expected.shape[1]
