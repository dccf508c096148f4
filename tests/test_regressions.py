"""Faults that were found by comparison with dense matrix exponentials, each by its smallest scene."""

import numpy as np
import pytest
from scenes import alone, on_stop
from scipy.linalg import expm

import vofem as vf


def marched(scene, t):
    """Return displacements of a scene without contacts or loads at time t, by one matrix exponential."""
    system = scene.model.system
    M, K = system.mass.toarray(), system.stiffness.toarray()
    C = np.zeros_like(M) if system.sparse_damping is None else system.sparse_damping.toarray()
    n = M.shape[0]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    start = scene.initial_state()
    return (expm(A * t) @ np.concatenate([start.q, start.v]))[:n]


def test_rounding_of_one_part_is_no_rigid_motion_of_another():
    b, a, c = vf.Mass(2.0), vf.Mass(1.0), vf.Mass(1.0, stiffness=4.8)
    scene = vf.Scene([b, a, c], [vf.Spring(a, c, stiffness=2.7)], initial={a: (1.0, 0.0)})
    assert vf.modes(scene).omega == pytest.approx([0.0, 1.2196, 2.9517], abs=1e-4)
    result = vf.simulate(scene, 5.0, times=[1.0, 5.0])
    assert result.samples.q[:, 1] == pytest.approx(marched(scene, 5.0), abs=1e-13)


@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_free_structures_with_inner_dashpots_run(speed):
    """A dashpot within a free structure leaves its rigid motion alone."""
    a, b, c = vf.Mass(1.0), vf.Mass(3.0), vf.Mass(2.0)
    inner = [vf.Spring(a, b, stiffness=2.0), vf.Dashpot(a, b, damping=0.3), vf.Spring(b, c, stiffness=1.0)]
    scene = vf.Scene([a, b, c], inner, initial={a: (0.0, speed)})
    result = vf.simulate(scene, 7.0, times=[0.0, 7.0])
    assert result.samples.q[:, 1] == pytest.approx(marched(scene, 7.0), abs=1e-12)
    stop = vf.Contact(a, b, gap=0.02, stiffness=50.0, acts_on="penetration")
    hit = vf.simulate(vf.Scene([a, b, c], [*inner, stop], initial={a: (0.0, speed)}), 7.0)
    assert hit.counters.events > 0
    momentum = sum(m.mass * hit.velocity(m) for m in (a, b, c))
    assert momentum == pytest.approx(np.full(momentum.shape, speed), abs=1e-12)
    assert hit.energy.balance_error < 1e-12


def test_springs_within_a_beam_leave_its_rigid_motion_alone():
    beam = vf.Beam(1.0, 1.0, 1.0, 3, {"left": "guided"})
    springs = [
        vf.Spring(beam.at(0.3), beam.at(1.0), stiffness=2.0),
        vf.Spring(beam.at(0.5), beam.at(1.0), stiffness=4.0),
    ]
    omega = vf.modes(vf.Scene([beam], springs), 2).omega
    assert omega[0] == 0.0
    assert omega[1] > 1.0


def test_work_of_a_ramp_beside_rigid_motion_and_dashpots():
    a, b = vf.Mass(1.0), vf.Mass(1.0)
    effects = [vf.Spring(a, b, stiffness=1.0), vf.Dashpot(a, damping=0.3), vf.PointLoad(a, vf.Ramp(1.0))]
    assert vf.simulate(vf.Scene([a, b], effects), 10.0).energy.balance_error < 1e-12


def test_loose_chains_have_no_equilibrium_and_keep_their_rigid_mode():
    """A contact within a free chain holds nothing, also where rounding says otherwise."""
    rng = np.random.default_rng(7)
    for _ in range(40):
        masses = [vf.Mass(1.0) for _ in range(3)]
        springs = [vf.Spring(masses[i], masses[i + 1], stiffness=rng.uniform(0.1, 5.0)) for i in range(2)]
        inner = vf.Contact(
            masses[0], masses[2], gap=-0.2, stiffness=rng.uniform(0.1, 5.0), acts_on="penetration", name="c"
        )
        scene = vf.Scene(masses, [*springs, inner, vf.PointLoad(masses[1], 1.0)])
        with pytest.raises(vf.SingularSystemError, match="can move freely"):
            vf.equilibrium(scene)
        omega = vf.modes(scene, 3, closed=["c"]).omega
        assert omega[0] == 0.0
        assert omega[1] > 0.1


def test_start_inside_a_stop_is_no_blow_up():
    mass, scene = on_stop(vf.Mass(1.0), gap=-1.0, stiffness=100.0)
    result = vf.simulate(scene, 1.0, method="central_difference", dt=1e-3)
    assert result.velocity(mass)[-1] == pytest.approx(-10.0, rel=1e-4)
    assert result.energy.balance_error < 1e-4


@pytest.mark.parametrize("method", ["event_driven", "central_difference"])
def test_energy_balance_counts_from_the_start_of_the_run(method):
    _, scene = alone(vf.Mass(1.0, stiffness=4.0, damping=0.3), load=vf.Sine(1.0, 1.0), start=(0.5, 0.0))
    step = {"dt": 1e-3} if method == "central_difference" else {}
    result = vf.simulate(scene, 5.0, method=method, times=[1.0, 2.0, 5.0], **step)
    assert result.energy.balance_error < 1e-10


@pytest.mark.parametrize("damping", [20.0, 20.0 * (1 + 1e-12), 20.0 * (1 + 1e-8), 19.999])
def test_critically_damped_contact_of_a_coupled_mass(damping):
    """Roots that coincide are taken as one plane: no digit is lost where eigenvectors would lose half of them."""
    a, b = vf.Mass(1.0), vf.Mass(1e3, stiffness=1e-3)
    stop = vf.Contact(a, gap=0.0, stiffness=100.0, damping=damping, side="above", acts_on="penetration")
    scene = vf.Scene([a, b], [stop, vf.Spring(a, b, stiffness=1e-3)], initial={a: (0.3, 0.2)})
    result = vf.simulate(scene, 0.2, times=np.linspace(0.0, 0.2, 5))
    K = scene.model.system.stiffness.toarray() + np.diag([100.0, 0.0])
    minv = np.diag([1.0, 1e-3])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-minv @ K, -minv @ np.diag([damping, 0.0])]])
    exact = [(expm(A * t) @ [0.3, 0.0, 0.2, 0.0])[0] for t in result.times]
    assert result.displacement(a) == pytest.approx(exact, abs=1e-13)
    assert result.energy.balance_error < 1e-9


@pytest.mark.parametrize("damping", [1e-8, 1e-9, 1e-12])
def test_rigid_motion_with_hardly_any_damping(damping):
    a, b = vf.Mass(1.0), vf.Mass(2.0)
    effects = [vf.Dashpot(a, b, damping=1.0), vf.Dashpot(a, damping=damping)]
    scene = vf.Scene([a, b], effects, initial={a: (0.3, 0.2)})
    result = vf.simulate(scene, 5.0, times=[0.0, 5.0])
    assert result.samples.q[:, 1] == pytest.approx(marched(scene, 5.0), abs=1e-11)


def test_a_nearly_rigid_motion_beside_fast_ones():
    """A free beam with a soft spring between two points close together: omega^2 of 2e-7 beside 3e9.

    The mode came out with a share of all others, and the start was not the sum of its modes.
    """
    beam = vf.Beam(1.0, 1e3, 0.1, 3)
    spring = vf.Spring(beam.at(0.0523), beam.at(0.0527), stiffness=1e-2)
    result = vf.simulate(vf.Scene([beam], [spring], {beam: (0.0, lambda x: 1.0 + 0.5 * x)}), 1.0)
    ends = np.array([result.velocity(beam.at(x)) for x in (0.0, 1.0)])
    assert ends[:, 0] == pytest.approx([1.0, 1.5], abs=1e-14)
    # The spring slows the rotation by omega^2 of 1.92e-7 over a second; the middle moves on as it did.
    assert ends.mean(axis=0) == pytest.approx(np.full(result.times.size, 1.25), abs=1e-12)
    rotation = ends[1] - ends[0]
    assert rotation == pytest.approx(0.5 * np.cos(np.sqrt(1.92e-7) * result.times), abs=1e-12)
