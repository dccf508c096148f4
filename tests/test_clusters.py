"""Damped modes that coincide: blocks and clusters against matrix exponentials."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

import vofem as vf
from vofem.integrators.event_driven.complex_modes import damped_blocks
from vofem.linalg.exponential import matrix_change, oscillator_change

pytestmark = pytest.mark.kernels("plain")


def exact(scene, t):
    """Return displacements at t from the state's matrix exponential, loads aside."""
    system = scene.model.system
    M, K = system.mass.toarray(), system.stiffness.toarray()
    C = system.damping.toarray()
    n = M.shape[0]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    start = scene.initial_state()
    y = np.concatenate([start.q, start.v])
    return np.stack([(expm(A * time) @ y)[:n] for time in t], axis=1)


@pytest.mark.parametrize("gap", [0.0, 1e-13, 1e-9, 1e-6, 1e-4, 1e-2])
def test_three_and_four_roots_that_nearly_coincide(gap):
    """k = diag(1, 1 + a) and C with eigenvalues near 2 at every closeness: refused before, exact now."""
    a = vf.Mass(1.0, stiffness=1.0, damping=2.0 + gap, name="a")
    b = vf.Mass(1.0, stiffness=1.0 + 3.0 * gap, damping=2.0 - gap, name="b")
    tie = vf.Dashpot(a, b, damping=max(gap, 1e-15))
    scene = vf.Scene([a, b], [tie], initial={a: (1.0, -0.5), b: (-0.3, 2.0)})
    t = np.linspace(0.0, 8.0, 33)
    result = vf.simulate(scene, 8.0, times=t, method="event_driven")
    assert result.solution.sample(t).q == pytest.approx(exact(scene, t), abs=2e-13)
    assert result.energy.balance_error < 1e-12


def one_root(k):
    """Return stiffness and damping of two masses of 1 kg with the one root -1 of order four: det = (s + 1)^4.

    k1 k2 = 1, c1 k2 + c2 k1 = 4, c1 + c2 = 4 and k1 + k2 + c1 c2 - g^2 = 6 for the off-diagonal damping -g.
    """
    k1, k2 = 1.0 / k, k
    c2 = (4.0 - 4.0 * k2) / (k1 - k2)
    c1 = 4.0 - c2
    g = np.sqrt(k1 + k2 + c1 * c2 - 6.0)
    return np.array([k1, k2]), np.array([[c1, -g], [-g, c2]])


@pytest.mark.parametrize("k", [1.01, 1.2, 2.0, 3.0])
def test_a_fourfold_defective_root(k):
    stiffness, damping = one_root(k)
    state = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.diag(stiffness), -damping]])
    # One Jordan block: the cube of (A + 1) is not zero, its fourth power is.
    nilpotent = np.linalg.matrix_power(state + np.eye(4), 3)
    assert np.max(np.abs(nilpotent)) > 1e-5
    assert np.max(np.abs(nilpotent @ (state + np.eye(4)))) < 1e-14
    (cluster,) = damped_blocks(stiffness, damping).clusters
    assert cluster.member.size == 2
    tie = -damping[0, 1]
    a = vf.Mass(1.0, stiffness=stiffness[0], damping=damping[0, 0] - tie, name="a")
    b = vf.Mass(1.0, stiffness=stiffness[1], damping=damping[1, 1] - tie, name="b")
    effects = [vf.Dashpot(a, b, damping=tie)]
    t = np.linspace(0.0, 8.0, 33)
    free = vf.simulate(vf.Scene([a, b], effects, initial={a: (1.0, -0.5), b: (-0.3, 2.0)}), 8.0, times=t)
    assert free.samples.q == pytest.approx(exact(free.scene, t), abs=1e-13)
    assert free.energy.balance_error < 1e-13
    effects += [
        vf.Contact(b, gap=0.05, stiffness=300.0, side="above", acts_on="displacement", name="stop"),
        vf.PointLoad(a, vf.Sine(3.0, 1.0) + vf.Ramp(-0.05)),
        vf.PointLoad(b, vf.Sine(3.0, 2.5)),
    ]
    driven = vf.simulate(vf.Scene([a, b], effects), 20.0, times=t)
    assert driven.counters.events >= 8
    assert driven.energy.balance_error < 1e-12


def test_a_triple_root_under_load_with_events():
    """A critically damped pair whose dashpot makes modes nearly dependent strikes a stop under a ramp and a sine."""
    a = vf.Mass(1.0, stiffness=1.0, damping=2.0, name="a")
    b = vf.Mass(1.0, stiffness=1.0 + 1e-7, damping=2.0 + 1e-7, name="b")
    effects = [
        vf.Dashpot(a, b, damping=1e-7),
        vf.Contact(a, gap=0.2, stiffness=1e4, side="above", acts_on="penetration", name="stop"),
        vf.PointLoad(a, vf.Sine(2.0, 3.0) + vf.Ramp(0.1)),
        vf.PointLoad(b, vf.Constant(0.4)),
    ]
    scene = vf.Scene([a, b], effects, initial={b: (0.0, 1.0)})
    result = vf.simulate(scene, 8.0, method="event_driven")
    assert result.counters.events > 4
    assert result.energy.balance_error < 1e-11


@pytest.mark.parametrize("t", [1e-9, 1e-3, 0.3, 2.0])
@pytest.mark.parametrize(("delta", "p"), [(0.0, 1.0), (0.0, 0.0), (0.3, 4.0), (2.0, 4.0), (5.0, 1.0), (0.7, 0.0)])
def test_changes_keep_their_digits(delta, p, t):
    # The series in whole fractions: s'' = -2 delta s' - p s.
    t, delta, p = (Fraction(value) for value in (t, delta, p))
    terms = [Fraction(0), Fraction(1)]
    for k in range(100):
        terms.append(-(2 * delta * (k + 1) * terms[-1] + p * terms[-2]) / ((k + 1) * (k + 2)))
    s = sum(term * t**k for k, term in enumerate(terms))
    rate = sum(k * term * t ** (k - 1) for k, term in enumerate(terms) if k)
    c = rate + delta * s
    for got, want in zip(oscillator_change(float(delta), float(p), float(t)), (c - 1, s), strict=True):
        assert got == pytest.approx(float(want), rel=2e-14, abs=1e-300)


def test_change_of_a_matrix():
    A = np.array([[-1e-6, 3.0, 0.0], [0.0, -400.0, 1.0], [0.0, 0.0, -400.0]])
    change = matrix_change(A, 0.7)
    assert change == pytest.approx(expm(0.7 * A) - np.eye(3), abs=1e-14)
    assert change[0, 0] == pytest.approx(np.expm1(-0.7e-6), rel=1e-13)


def test_one_critically_damped_mode_beside_fast_ones():
    """Damping couples a critically damped mass to a beam by 1e-7: only the mass is a cluster, or its search crawls."""
    beam = vf.Beam(1.0, EI=0.1, rhoA=1.0, elements=2, supports={"left": "clamped", "right": "guided"}, tension=1.0)
    mass = vf.Mass(1.0, stiffness=1.0, damping=2.0)
    effects = [vf.Spring(beam.at(0.75), mass, stiffness=1e-6), vf.PointLoad(mass, vf.Ramp(0.5, 1.0, 1.25))]
    stop = vf.Contact(beam.at(0.75), gap=0.0, stiffness=100.0, damping=0.1, side="below", acts_on="penetration")
    result = vf.simulate(vf.Scene([beam, mass], [*effects, stop]), 1.001, method="event_driven")
    assert result.counters.gap_evaluations < 1000  # 47159 where the modes of the beam belong to the cluster too
    t = np.linspace(0.0, 8.0, 33)
    scene = vf.Scene([beam, mass], effects[:1], initial={mass: (1.0, -0.5)})
    assert vf.simulate(scene, 8.0, times=t, method="event_driven").samples.q == pytest.approx(
        exact(scene, t), abs=1e-13
    )
    frequency = np.array([1.0, 3.0, 11.0, 39.0])
    damping = np.diag([2.0, 0.0, 22.0, 0.0]) + 1e-7
    (cluster,) = damped_blocks(frequency**2, damping).clusters
    assert cluster.member.size == 2
