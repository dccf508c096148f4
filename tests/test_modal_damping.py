"""Ratios of critical damping by mode, against the exact decay of single modes."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scenes import cantilever
from scipy.linalg import eigh

import vofem as vf
from vofem.errors import ArgumentError

#: Four equal masses between fixed walls: ``omega_k = 2 sqrt(k/m) sin(k pi/10)``, shapes ``sin(i k pi/5)``.
COUNT, STIFFNESS, MASS = 4, 50.0, 2.0


def omega_of(mode):
    return 2.0 * np.sqrt(STIFFNESS / MASS) * np.sin(0.5 * mode * np.pi / (COUNT + 1))


def chain(damping, mode):
    masses = [vf.Mass(MASS, STIFFNESS if i in (0, COUNT - 1) else 0.0, name=f"m{i}") for i in range(COUNT)]
    springs = [vf.Spring(a, b, stiffness=STIFFNESS) for a, b in itertools.pairwise(masses)]
    shape = np.sin(np.arange(1, COUNT + 1) * mode * np.pi / (COUNT + 1))
    return vf.Scene(masses, [*springs, *damping], {m: (s, 0.0) for m, s in zip(masses, shape, strict=True)}), shape


def decay(ratio, omega, t):
    damped = omega * np.sqrt(1.0 - ratio**2)
    return np.exp(-ratio * omega * t) * (np.cos(damped * t) + ratio * omega / damped * np.sin(damped * t))


@pytest.mark.parametrize(
    ("method", "options", "tolerance"),
    [
        ("event_driven", {}, 1e-11),
        ("central_difference", {"dt": 2e-4}, 2e-5),
        ("energy_conserving", {"dt": 2e-4}, 2e-5),
        ("generalized_alpha", {"dt": 2e-4}, 2e-5),
    ],
)
@pytest.mark.parametrize(("mode", "ratio"), [(1, 0.01), (2, 0.3), (3, 0.07), (4, 0.07)])
def test_every_mode_decays_by_its_own_ratio_and_those_beyond_the_list_by_the_last(
    method, options, tolerance, mode, ratio
):
    scene, shape = chain([vf.ModalDamping([0.01, 0.3, 0.07])], mode)
    times = np.linspace(0.0, 2.0, 9)
    result = vf.simulate(scene, 2.0, method=method, times=times, **options)
    found = np.array([result.displacement(body) for body in scene.bodies])
    exact = np.outer(shape, decay(ratio, omega_of(mode), times))
    assert_allclose(found, exact, rtol=0.0, atol=tolerance)


def test_rigid_motions_are_not_counted_and_not_damped():
    a, b = vf.Mass(1.0, name="a"), vf.Mass(1.0, name="b")
    effects = [vf.Spring(a, b, stiffness=8.0), vf.ModalDamping([0.2, 0.9])]
    result = vf.simulate(vf.Scene([a, b], effects, {a: (0.5, 1.0), b: (-0.5, 1.0)}), 3.0, times=[0.0, 1.0, 3.0])
    mean, apart = (
        0.5 * (result.displacement(a) + result.displacement(b)),
        result.displacement(a) - result.displacement(b),
    )
    assert_allclose(mean, [0.0, 1.0, 3.0], rtol=0.0, atol=1e-12)
    assert_allclose(apart, decay(0.2, 4.0, result.times), rtol=0.0, atol=1e-12)


def test_several_modal_dampings_add_up_mode_by_mode():
    for parts in ([0.01, 0.3, 0.07], [0.02]), ([0.01], [0.02, 0.31, 0.08]), (0.01, [0.02, 0.31, 0.08]):
        system = chain([vf.ModalDamping(part) for part in parts], 1)[0].model.system
        assert_allclose(system.modal_damping, [0.03, 0.32, 0.09], rtol=1e-14)
    assert chain([vf.ModalDamping(0.01), vf.ModalDamping(0.02)], 1)[0].model.system.modal_damping == pytest.approx(0.03)


def test_the_reaction_of_a_support_holds_the_damping_of_each_mode():
    beam = cantilever(4, name="beam")
    scene = vf.Scene([beam], [vf.ModalDamping([0.05, 0.2]), vf.PointLoad(beam.at(1.0), vf.Sine(1.0, 3.0))])
    result = vf.simulate(scene, 1.0, times=np.linspace(0.0, 1.0, 5))
    system, samples = scene.model.system, result.samples
    squares, shapes = eigh(system.stiffness.toarray(), system.mass.toarray())
    # Balance of momentum: what the support exerts is the rate of momentum less the load.
    assert beam.translation().size == scene.model.size
    full = scene.model.mass[:, scene.model.free]
    ratios = np.array([0.05, 0.2, 0.2, 0.2, 0.2, 0.2, 0.2, 0.2])
    drag = full @ shapes @ ((2.0 * ratios * np.sqrt(squares))[:, None] * (shapes.T @ (system.mass @ samples.v)))
    momentum = beam.translation() @ (full @ samples.a + drag)
    assert_allclose(result.reaction(beam, "left").force, momentum - np.sin(3.0 * result.times), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("ratio", [[], [0.1, -0.1], [[0.1]], [0.1, float("nan")], "low"])
def test_ratios_that_are_none_are_refused(ratio):
    with pytest.raises(ArgumentError, match="ratio"):
        vf.ModalDamping(ratio)
