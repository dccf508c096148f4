"""Bending moment and shear force under loads along the beam, against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import vofem as vf

EI, RHO, L, Q = 3.0, 1.5, 2.0, -0.7
X = np.array([0.0, 0.13, 0.5, 0.99, 1.0, 1.3, 1.77, 2.0])
PINNED = {"left": "pinned", "right": "pinned"}


def rest_of(beam, *effects):
    return vf.equilibrium(vf.Scene([beam], effects))


@pytest.mark.parametrize("stiffness", [EI, lambda x: EI * (1.0 + 0.5 * x), np.array([3.0, 5.0, 1.0])])
def test_a_cantilever_under_uniform_load_whatever_its_stiffness(stiffness):
    beam = vf.Beam(L, stiffness, RHO, 3, {"left": "clamped"})
    rest = rest_of(beam, vf.DistributedLoad(beam, Q), vf.PointLoad(beam.at(L), 0.4))
    assert_allclose(rest.bending_moment(X), 0.5 * Q * (L - X) ** 2 + 0.4 * (L - X), rtol=0.0, atol=1e-12)
    assert_allclose(rest.shear_force(X), -Q * (L - X) - 0.4, rtol=0.0, atol=1e-12)
    assert rest.bending_moment(X.reshape(2, 4)).shape == (2, 4)


def test_one_element_clamped_at_both_ends_has_the_fixed_end_moments():
    beam = vf.Beam(L, EI, RHO, [0.0, 1.1, L], {"left": "clamped", "right": "clamped"})
    rest = rest_of(beam, vf.DistributedLoad(beam, Q))
    assert_allclose(rest.bending_moment([0.0, 1.0, L]), Q * L**2 * np.array([1 / 12, -1 / 24, 1 / 12]), rtol=1e-12)
    assert_allclose(rest.shear_force([0.0, L]), Q * L * np.array([-0.5, 0.5]), rtol=1e-12)


def test_a_load_that_varies_between_the_nodes():
    beam = vf.Beam(L, EI, RHO, 2, PINNED)
    k = np.pi / L
    rest = rest_of(beam, vf.DistributedLoad(beam, lambda x: np.sin(k * x)))
    assert_allclose(rest.bending_moment(X), -np.sin(k * X) / k**2, rtol=0.0, atol=1e-9)
    assert_allclose(rest.shear_force(X), -np.cos(k * X) / k, rtol=0.0, atol=1e-9)


def test_weight_and_a_base_that_accelerates():
    beam = vf.Beam(L, EI, lambda x: 1.0 + x, 2, {"left": "clamped"})
    g = 9.81
    moment = -g * ((L**2 / 2.0 + L**3 / 3.0) - X * (L + L**2 / 2.0) + X**2 / 2.0 + X**3 / 6.0)
    assert_allclose(rest_of(beam, vf.Gravity(g)).bending_moment(X), moment, rtol=0.0, atol=1e-11)
    shaken = rest_of(beam, vf.BaseMotion(beam, 2.0))
    assert_allclose(shaken.bending_moment(X), moment * 2.0 / g, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("kind", ["foundation", "tension"])
def test_bedding_and_tension_are_part_of_the_load(kind):
    """Of a sine load every response is a sine; the moment converges with the fourth power of the element length."""
    k = np.pi / L
    bed, tension = (20.0, 0.0) if kind == "foundation" else (0.0, 15.0)
    exact = -EI * k**2 * np.sin(k * X) / (EI * k**4 + bed + tension * k**2)
    errors = []
    for elements in (4, 8, 16):
        beam = vf.Beam(L, EI, RHO, elements, PINNED, tension=tension)
        effects = [vf.DistributedLoad(beam, lambda x: np.sin(k * x))]
        effects += [vf.Foundation(beam, stiffness=bed)] if bed else []
        errors.append(np.max(np.abs(rest_of(beam, *effects).bending_moment(X) - exact)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((orders > 3.5) & (orders < 5.0)), orders
    assert errors[-1] < 2e-5 * np.max(np.abs(exact))


def test_a_beam_in_motion():
    """A pinned beam that a load in phase moves as cos(2 t) sin(k x), from its deflection under a load at rest."""
    k, times = np.pi / L, np.array([0.0, 0.4, 1.1])
    moment = -EI * k**2 * np.outer(np.sin(k * X), np.cos(2.0 * times))
    shear = -EI * k**3 * np.outer(np.cos(k * X), np.cos(2.0 * times))
    errors = []
    for elements in (4, 8, 16):
        beam = vf.Beam(L, EI, RHO, elements, PINNED, name="beam")

        def load(f, beam=beam):
            return vf.DistributedLoad(beam, lambda x: np.sin(k * x), f)

        moved = load(vf.Sine(EI * k**4 - 4.0 * RHO, 2.0, 0.5 * np.pi))
        run = vf.simulate(vf.Scene([beam], [moved], rest_of(beam, load(EI * k**4))), 1.1, times=times)
        errors.append(
            [
                np.max(np.abs(run.bending_moment(X) - moment)),
                np.max(np.abs(run.bending_moment(X, recovered=True) - moment)),
                np.max(np.abs(run.shear_force(X, recovered=True) - shear)),
            ]
        )
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all((orders[:, 0] > 1.8) & (orders[:, 0] < 2.2))
    assert np.all((orders[:, 1:] > 3.5) & (orders[:, 1:] < 4.5))
    assert max(errors[-1][1:]) < 1e-5


def test_a_run_that_begins_later_balances_the_loads_of_its_time():
    beam = vf.Beam(L, EI, RHO, 4, {"left": "clamped"}, name="beam")
    slow = vf.Scene([beam], [vf.DistributedLoad(beam, Q, vf.Sine(1.0, 3.0)), vf.BaseMotion(beam, vf.Sine(2.0, 1.0))])
    whole = vf.simulate(slow, 1.0, times=[0.0, 0.7, 1.0])
    first = vf.simulate(slow, 0.7, times=[0.0, 0.7])
    second = vf.simulate(slow, 0.3, initial=first, t_start=0.7, times=[0.0, 0.3])
    for name in ("bending_moment", "shear_force"):
        expected, found = (getattr(run, name)(X, recovered=True) for run in (whole, second))
        assert_allclose(found, expected[:, 1:], rtol=0.0, atol=1e-11)


def test_a_loaded_run_knows_recovered_moments(tmp_path):
    beam = vf.Beam(L, EI, lambda x: 1.0 + x, 4, {"left": "clamped"}, name="beam")
    effects = [vf.DistributedLoad(beam, lambda x: x**2, vf.Sine(1.0, 3.0)), vf.Gravity(2.0)]
    run = vf.simulate(vf.Scene([beam], effects), 0.5, times=[0.0, 0.25, 0.5])
    loaded = vf.load(run.save(tmp_path / "run.vtkhdf"))
    assert_allclose(
        loaded.bending_moment(X, recovered=True), run.bending_moment(X, recovered=True), rtol=1e-9, atol=1e-11
    )


def test_moments_of_joined_beams():
    a = vf.Beam(1.0, EI, RHO, 2, {"left": "clamped"}, name="a")
    b = vf.Beam(1.0, EI, RHO, 2, name="b")
    joint = vf.Joint(a.at(1.0), b.at(0.0), kind="rigid")
    rest = vf.equilibrium(vf.Scene([a, b], [joint, vf.DistributedLoad(a, Q), vf.DistributedLoad(b, Q)]))
    x = np.array([0.0, 0.3, 1.0])
    assert_allclose(rest.bending_moment(x, a), 0.5 * Q * (L - x) ** 2, rtol=0.0, atol=1e-12)
    assert_allclose(rest.bending_moment(x, b), 0.5 * Q * (1.0 - x) ** 2, rtol=0.0, atol=1e-12)
