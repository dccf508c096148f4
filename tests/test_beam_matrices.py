"""Element matrices, assembly, supports, points and fields of beams."""

import numpy as np
import pytest
from scipy.linalg import eigh

import vofem as vf
from vofem.bodies.cubics import hermite


def printed_mass(rhoA, h):
    """Eq. 19a, with the slope positive as d(eta)/dx: the printed one is its negative."""
    return (rhoA * h / 420.0) * np.array(
        [
            [156.0, 22 * h, 54.0, -13 * h],
            [22 * h, 4 * h * h, 13 * h, -3 * h * h],
            [54.0, 13 * h, 156.0, -22 * h],
            [-13 * h, -3 * h * h, -22 * h, 4 * h * h],
        ]
    )


def printed_stiffness(EI, h):
    """Eq. 19b, with the slope positive as d(eta)/dx."""
    return (2.0 * EI / h**3) * np.array(
        [
            [6.0, 3 * h, -6.0, 3 * h],
            [3 * h, 2 * h * h, -3 * h, h * h],
            [-6.0, -3 * h, 6.0, -3 * h],
            [3 * h, h * h, -3 * h, 2 * h * h],
        ]
    )


def assembled(element, lengths):
    size = 2 * (len(lengths) + 1)
    total = np.zeros((size, size))
    for i, h in enumerate(lengths):
        total[2 * i : 2 * i + 4, 2 * i : 2 * i + 4] += element(h)
    return total


def relative(got, expected):
    """Largest error, each entry measured by the diagonal of its row and column."""
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    return np.max(np.abs(got - expected) / scale)


@pytest.mark.parametrize("origin", [0.0, 2.0**20])
def test_matrices_equal_equation_19(origin):
    h = 1.0 / 32.0
    beam = vf.Beam(25 * h, 3.0, 2.0, origin + h * np.arange(26))
    matrices = beam.matrices()
    lengths = np.full(25, h)
    assert relative(matrices.mass.toarray(), assembled(lambda h: printed_mass(2.0, h), lengths)) < 1e-13
    assert relative(matrices.stiffness.toarray(), assembled(lambda h: printed_stiffness(3.0, h), lengths)) < 1e-13


def test_graded_mesh():
    nodes = np.cumsum(np.concatenate([[0.0], np.geomspace(1e-3, 1.0, 12)]))
    beam = vf.Beam(nodes[-1], 1.0, 1.0, nodes)
    expected = assembled(lambda h: printed_stiffness(1.0, h), np.diff(nodes))
    assert relative(beam.matrices().stiffness.toarray(), expected) < 1e-13


def test_piecewise_coefficients():
    EI, rhoA = np.array([1.0, 4.0, 2.0]), np.array([3.0, 1.0, 5.0])
    beam = vf.Beam(3.0, EI, rhoA, 3)
    stiffness, mass = np.zeros((8, 8)), np.zeros((8, 8))
    for i in range(3):
        window = slice(2 * i, 2 * i + 4)
        stiffness[window, window] += printed_stiffness(EI[i], 1.0)
        mass[window, window] += printed_mass(rhoA[i], 1.0)
    assert relative(beam.matrices().stiffness.toarray(), stiffness) < 1e-13
    assert relative(beam.matrices().mass.toarray(), mass) < 1e-13


def test_variable_coefficients_are_integrated_exactly():
    """EI = x^2 on one element, the work of two unit shapes from their polynomials."""
    beam = vf.Beam(2.0, lambda x: 1.0 + x**2, lambda x: 1.0 + x**3, 1)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    x, w = 1.0 + nodes, weights
    for i in range(4):
        for j in range(4):
            bend = hermite(i, x / 2, 2.0, 2) * hermite(j, x / 2, 2.0, 2) * (1.0 + x**2)
            carry = hermite(i, x / 2, 2.0) * hermite(j, x / 2, 2.0) * (1.0 + x**3)
            assert beam.matrices().stiffness[i, j] == pytest.approx(w @ bend, rel=1e-12, abs=1e-12)
            assert beam.matrices().mass[i, j] == pytest.approx(w @ carry, rel=1e-12, abs=1e-12)


def test_one_element_object_serves_many_meshes():
    """The stock element of scikit-fem would return the first mesh's basis."""
    lengths = [vf.Beam(length, 1.0, 1.0, 3).matrices().stiffness[0, 0] for length in (3.0, 6.0)]
    assert lengths == pytest.approx([12.0, 1.5], rel=1e-14)


def test_frequencies_of_the_paper_s_cantilever():
    beam = vf.Beam(1.0, 1.0, 1.0, 25, {"left": "clamped"})
    omega = vf.modes(vf.Scene([beam]), 50).omega
    assert omega[0] == pytest.approx(3.51601534572, rel=1e-10)
    assert omega[1] == pytest.approx(22.034511, rel=1e-7)
    assert omega[-1] == pytest.approx(37424.0, rel=2e-5)


def test_eigenvalues_converge_with_order_four():
    exact = 1.8751040687119611**4
    errors = []
    for elements in (4, 8, 16, 32):
        beam = vf.Beam(1.0, 1.0, 1.0, elements, {"left": "clamped"})
        errors.append(vf.modes(vf.Scene([beam]), 1).omega[0] ** 2 / exact - 1.0)
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(np.array(errors) > 0.0)
    assert errors[-1] < 3e-8
    assert np.all(np.abs(orders - 4.0) < 0.1)


def test_low_modes_stay_accurate_on_fine_meshes():
    """`eigh(K, M)` is off by 1e-5 here, `eigh(M, K)` by 1e-8; energies of strains lose nothing."""
    beam = vf.Beam(1.0, 1.0, 1.0, 400, {"left": "clamped"})
    assert vf.modes(vf.Scene([beam]), 1).omega[0] == pytest.approx(1.8751040687119611**2, rel=2e-12)


def test_modes_of_a_large_beam_come_from_lanczos():
    beam = vf.Beam(1.0, 1.0, 1.0, 1000, {"left": "pinned", "right": "pinned"})
    expected = (np.pi * np.arange(1, 5)) ** 2
    assert vf.modes(vf.Scene([beam]), 4).omega == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    ("supports", "roots"),
    [
        ({"left": "clamped", "right": "clamped"}, 4.730040744862704),
        ({"left": "clamped", "right": "pinned"}, 3.926602312047919),
        ({"left": "pinned", "right": "pinned"}, np.pi),
        ({"left": "guided", "right": "pinned"}, np.pi / 2),
        ({"left": "clamped", "right": "guided"}, 2.365020372431352),
    ],
)
def test_supports(supports, roots):
    beam = vf.Beam(1.0, 1.0, 1.0, 30, supports)
    assert np.sqrt(vf.modes(vf.Scene([beam]), 1).omega[0]) == pytest.approx(roots, rel=3e-7)


def test_a_support_inside_the_span():
    """Two equal spans vibrate like one simply supported span."""
    beam = vf.Beam(2.0, 1.0, 1.0, 40, {"left": "pinned", 1.0: "pinned", "right": "pinned"})
    omega = vf.modes(vf.Scene([beam]), 2).omega
    assert omega[0] == pytest.approx(np.pi**2, rel=1e-6)
    assert omega[1] == pytest.approx(3.926602312047919**2, rel=1e-5)


def test_rigid_modes_come_first_and_are_exactly_zero():
    free = vf.Beam(1.0, 1.0, 1.0, 20)
    omega = vf.modes(vf.Scene([free]), 4).omega
    assert list(omega[:2]) == [0.0, 0.0]
    assert omega[2] == pytest.approx(22.3732854, rel=1e-5)
    pinned = vf.Beam(1.0, 1.0, 1.0, 20, {"left": "pinned"})
    assert list(vf.modes(vf.Scene([pinned]), 2).omega[:1]) == [0.0]


@pytest.mark.parametrize("tension", [50.0, -5.0])
def test_axial_force(tension):
    """A simply supported beam under tension T: omega^2 = (n pi)^4 + T (n pi)^2."""
    beam = vf.Beam(1.0, 1.0, 1.0, 30, {"left": "pinned", "right": "pinned"}, tension=tension)
    wave = np.pi * np.arange(1, 4)
    assert vf.modes(vf.Scene([beam]), 3).omega == pytest.approx(np.sqrt(wave**4 + tension * wave**2), rel=1e-5)


def test_buckled_beam_is_refused_by_name():
    beam = vf.Beam(1.0, 1.0, 1.0, 10, {"left": "pinned", "right": "pinned"}, tension=-20.0)
    with pytest.raises(vf.SingularSystemError, match="buckled"):
        vf.modes(vf.Scene([beam]))


def test_any_point_of_the_axis():
    beam = vf.Beam(2.0, 1.0, 1.0, [0.0, 0.3, 1.1, 2.0])
    coefficients = beam.interpolate(lambda x: 1.0 + x - 2.0 * x**2 + 0.5 * x**3, "a cubic")
    for x in (0.0, 0.17, 0.3, 0.7, 1.1, 1.99, 2.0):
        row = beam.at(x).row()
        assert row.weights @ coefficients[row.indices] == pytest.approx(1 + x - 2 * x**2 + 0.5 * x**3, abs=1e-12)
        slope = beam.at(x).slope_row()
        assert slope.weights @ coefficients[slope.indices] == pytest.approx(1 - 4 * x + 1.5 * x**2, abs=1e-11)
    assert beam.at(0.3).row().indices.size == 1
    assert beam.at(0.1 + 0.2).row().indices.size == 1
    assert beam.at("right").x == 2.0


def test_fields_of_a_cubic_are_exact():
    beam = vf.Beam(1.0, lambda x: 2.0 + x, 1.0, 7, {"left": "clamped"})
    scene = vf.Scene([beam], initial={beam: (lambda x: x**2 * (3.0 - x), 0.0)})
    result = vf.simulate(scene, 1e-3, times=[0.0])
    x = np.linspace(0.0, 0.999, 9)
    assert result.deflection(x)[:, 0] == pytest.approx(x**2 * (3 - x), abs=1e-12)
    assert result.slope(x)[:, 0] == pytest.approx(6 * x - 3 * x**2, abs=1e-11)
    assert result.bending_moment(x)[:, 0] == pytest.approx((2 + x) * (6 - 6 * x), abs=1e-9)
    assert result.shear_force(x)[:, 0] == pytest.approx((6 - 6 * x) - 6 * (2 + x), abs=1e-8)


def test_initial_field_must_satisfy_the_supports():
    beam = vf.Beam(1.0, 1.0, 1.0, 5, {"left": "clamped"})
    with pytest.raises(vf.ArgumentError, match=r"clamped; expected 0"):
        vf.Scene([beam], initial={beam: (lambda x: 1.0 + x, 0.0)}).initial_state()
    with pytest.raises(vf.ArgumentError, match=r"slope .* clamped"):
        vf.Scene([beam], initial={beam: (0.0, lambda x: np.sin(x))}).initial_state()


def test_beam_on_end_springs_against_dense_algebra():
    beam = vf.Beam(1.0, 1.0, 1.0, 4, {"left": "pinned"})
    effects = [
        vf.Spring(beam.at(0.6), stiffness=30.0),
        vf.RotationalSpring(beam.at("left"), stiffness=2.0),
        vf.PointMass(beam.at(0.9), mass=0.7, inertia=0.01),
    ]
    matrices = beam.matrices()
    K, M = matrices.stiffness.toarray(), matrices.mass.toarray()
    for point, factor, slope, target in (
        (beam.at(0.6), 30.0, False, K),
        (beam.at(0.0), 2.0, True, K),
        (beam.at(0.9), 0.7, False, M),
        (beam.at(0.9), 0.01, True, M),
    ):
        row = point.slope_row() if slope else point.row()
        b = np.zeros(10)
        b[row.indices] = row.weights
        target += factor * np.outer(b, b)
    omega = np.sqrt(eigh(K[1:, 1:], M[1:, 1:], eigvals_only=True))
    assert vf.modes(vf.Scene([beam], effects), 9).omega == pytest.approx(omega, rel=1e-9)


@pytest.mark.parametrize("length", [2.0**-40, 2.0**40])
def test_modes_of_a_cantilever_do_not_depend_on_the_unit_of_length(length: float) -> None:
    """Its support holds a rotation of 1 rad, and one whose number is that of 1/length."""
    found = []
    for m in (1.0, length):
        beam = vf.Beam(m, EI=2.0 * m**3, rhoA=1.0 / m, elements=4, supports={"left": "clamped"})
        found.append(vf.modes(vf.Scene([beam])).frequencies)
    np.testing.assert_allclose(found[1], found[0], rtol=1e-12)
