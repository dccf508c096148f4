"""Damping of every kind, energies and their balance, reactions."""

import warnings

import numpy as np
import pytest
from scenes import cantilever, paper_beam, two_masses
from scipy.linalg import eigh, expm

import vofem as vf

DAMPINGS = {
    "mass proportional": lambda beam: [vf.RayleighDamping(0.2, 0.0)],
    "rayleigh": lambda beam: [vf.RayleighDamping(0.2, 1e-4)],
    "modal": lambda beam: [vf.ModalDamping(0.02)],
    "dashpot": lambda beam: [vf.Dashpot(beam.at(0.5), damping=0.1)],
    "all": lambda beam: [
        vf.RayleighDamping(0.1, 1e-5), vf.ModalDamping(0.01), vf.Dashpot(beam.at(0.37), damping=0.2),
    ],
}  # fmt: skip


def damped_beam(kind, contact_damping=0.0, elements=6):
    beam = cantilever(elements)
    tip = beam.at(1.0)
    stop = vf.Contact(
        tip, gap=0.03, stiffness=5.0, damping=contact_damping, side="below", acts_on="penetration", name="stop"
    )
    loads = [vf.PointLoad(tip, vf.Sine(0.2, 2.0)), vf.DistributedLoad(beam, lambda x: -0.1 * x, vf.Ramp(0.1, 0.0, 2.0))]
    return beam, vf.Scene([beam], [stop, *loads, *DAMPINGS[kind](beam)])


@pytest.mark.parametrize("contact_damping", [0.0, 0.5])
@pytest.mark.parametrize("kind", DAMPINGS)
def test_event_driven_against_central_differences(kind, contact_damping):
    """Two methods that share nothing but the System."""
    times = np.linspace(0.0, 6.0, 61)
    beam, scene = damped_beam(kind, contact_damping, elements=3)
    exact = vf.simulate(scene, 6.0, times=times, method="event_driven")
    assert exact.counters.events >= 2
    assert exact.energy.balance_error < 1e-11
    assert np.all(np.diff(exact.energy.dissipated) >= -1e-15)
    errors = []
    for dt in (2e-3, 1.25e-4):
        stepped = vf.simulate(scene, 6.0, times=times, method="central_difference", dt=dt)
        errors.append(np.max(np.abs(stepped.displacement(beam.at(1.0)) - exact.displacement(beam.at(1.0)))))
        assert stepped.energy.balance_error < 5e-3
        assert stepped.energy.dissipated[-1] == pytest.approx(exact.energy.dissipated[-1], rel=2e-2)
    # The force of a contact damper jumps at closing: first order then.
    order = np.log(errors[0] / errors[1]) / np.log(16.0)
    assert (0.7 if contact_damping else 1.5) < order < 2.6
    assert errors[1] < 2e-5


@pytest.mark.parametrize("kind", DAMPINGS)
def test_damped_motion_against_the_matrix_exponential(kind):
    """With the contact open the whole state is known from one matrix."""
    beam, _ = damped_beam(kind)
    start = (lambda x: 0.02 * x**2 * (3 - x), lambda x: 0.1 * x**2)
    scene = vf.Scene([beam], DAMPINGS[kind](beam), initial={beam: start})
    result = vf.simulate(scene, 3.0, times=[0.0, 0.7, 3.0])
    system = scene.model.system
    M, K = system.mass.toarray(), system.stiffness.toarray()
    C = np.zeros_like(M) if system.sparse_damping is None else system.sparse_damping.toarray()
    if system.modal_damping is not None:
        squares, shapes = eigh(K, M)
        C = C + M @ shapes @ np.diag(2.0 * system.modal_damping * np.sqrt(squares)) @ shapes.T @ M
    n = M.shape[0]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    initial = scene.initial_state()
    for i, t in enumerate(result.times):
        state = expm(A * t) @ np.concatenate([initial.q, initial.v])
        assert result.samples.q[:, i] == pytest.approx(state[:n], abs=1e-9)
        assert result.samples.v[:, i] == pytest.approx(state[n:], abs=1e-8)


@pytest.mark.parametrize(
    "mass",
    [vf.Mass(1.0, 4.0, 4.0), vf.Mass(1.0, 4.0, 10.0), vf.Mass(1.0, 0.0, 0.5), vf.Mass(1.0), vf.Mass(1.0, 4.0)],
    ids=["critical", "overdamped", "dragged", "free", "resonant"],
)
def test_energy_balance_where_formulas_divide_by_zero(mass):
    """Critical damping, rigid motion and exact resonance with contacts in play."""
    contacts = [
        vf.Contact(mass, gap=0.05, stiffness=30.0, side=side, acts_on="penetration", name=side)
        for side in ("above", "below")
    ]
    loads = [vf.PointLoad(mass, vf.Sine(1.0, 2.0) + vf.Ramp(0.3, 0.5, 1.5)), vf.Gravity(0.1)]
    result = vf.simulate(vf.Scene([mass], [*contacts, *loads], initial={mass: (0.0, 0.3)}), 20.0)
    assert result.counters.events > 4
    assert result.energy.balance_error < 1e-13


def test_resonance_grows_linearly():
    mass = vf.Mass(1.0, stiffness=4.0)
    t = np.linspace(0.0, 200.0, 101)
    for omega in (2.0, 2.0 * (1 + 1e-12), 2.0 * (1 + 1e-9)):
        result = vf.simulate(vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(1.0, omega))]), 200.0, times=t)
        exact = (np.sin(2 * t) - 2 * t * np.cos(2 * t)) / 8.0
        assert np.max(np.abs(result.displacement(mass) - exact)) < 1e-11 + 1e4 * abs(omega - 2.0)


def test_frequencies_far_apart():
    """A slow and a fast mass, nine decades apart, in one scene."""
    slow, fast = vf.Mass(1.0, stiffness=1e-8), vf.Mass(1.0, stiffness=1e10)
    loads = [vf.PointLoad(slow, 1e-8), vf.PointLoad(fast, 1e10)]
    result = vf.simulate(vf.Scene([slow, fast], loads), 10.0)
    t = result.times
    assert result.displacement(slow) == pytest.approx(2.0 * np.sin(0.5e-4 * t) ** 2, rel=1e-12)
    assert result.displacement(fast) == pytest.approx(2.0 * np.sin(0.5e5 * t) ** 2, abs=1e-9)


def test_energies_of_the_jump_law():
    """With K0 (u^2 - gap^2)/2 the balance closes; the naive K_eq u^2/2 would miss by K0 gap^2/2."""
    _, scene = paper_beam("displacement")
    result = vf.simulate(scene, 20.0)
    assert result.energy.balance_error < 1e-13
    naive = 0.5 * result.contacts["stop"].stiffness * result.displacement(scene.bodies[0].at(1.0)) ** 2
    missing = np.max(np.abs(naive - result.energy.contact))
    assert missing == pytest.approx(0.5 * 0.03**2, rel=1e-9)


def test_reaction_of_a_cantilever_in_equilibrium():
    """A slow ramp: the support carries the load and its moment."""
    beam = vf.Beam(2.0, 3.0, 1e-6, 10, {"left": "clamped"})
    scene = vf.Scene(
        [beam], [vf.PointLoad(beam.at(2.0), -5.0)], initial={beam: (lambda x: -5.0 * x**2 * (6 - x) / 18, 0.0)}
    )
    reaction = vf.simulate(scene, 1.0).reaction(beam, "left")
    assert reaction.force == pytest.approx(np.full(1001, 5.0), rel=1e-8)
    # Positive where it works on a growing slope: the tip load turns the beam clockwise, the wall holds against it.
    assert reaction.moment == pytest.approx(np.full(1001, 10.0), rel=1e-8)


def test_reactions_balance_inertia_loads_and_contacts():
    """Newton's second law for the whole beam."""
    beam, scene = damped_beam("dashpot", 0.3)
    result = vf.simulate(scene, 6.0, times=np.linspace(0.05, 6.0, 40))
    translation = beam.translation()
    momentum_rate = translation @ (beam.matrices().mass @ scene.model.of_body(beam, result.samples.a))
    external = np.zeros(40)
    for load, vector in zip(scene.model.system.loads, scene.model.load_vectors, strict=True):
        external += (translation @ vector) * load.function(result.times)
    external += result.contacts["stop"].force - 0.1 * result.velocity(beam.at(0.5))
    assert result.reaction(beam, "left").force + external == pytest.approx(momentum_rate, abs=1e-9)


def test_contact_forces_are_equal_and_opposite():
    first, second, scene = two_masses("c", "penetration")
    result = vf.simulate(scene, 30.0)
    force = result.contacts["contact"].force
    closed = result.contacts["contact"].closed
    assert np.all(force[~closed] == 0.0)
    assert np.all(force[closed] >= 0.0)
    inner = (
        result.acceleration(first) + 0.1 * result.velocity(first) + result.displacement(first)
        - vf.Sine(5.0, 0.8)(result.times)
    )  # fmt: skip
    outer = (
        result.acceleration(second) + 0.4 * result.velocity(second) + result.displacement(second)
        - vf.Sine(-5.0, 0.8)(result.times)
    )  # fmt: skip
    assert inner == pytest.approx(-force, abs=1e-12)
    assert outer == pytest.approx(force, abs=1e-12)


def test_histories_of_order_and_stiffness():
    _, scene = paper_beam("displacement")
    stop = vf.simulate(scene, 6.0).contacts["stop"]
    assert set(stop.stiffness) == {0.0, 1.0}
    assert np.array_equal(stop.order == 0.0, stop.closed)
    assert np.array_equal(np.isinf(stop.order), ~stop.closed)
    assert np.array_equal(stop.gap_function > 0.0, stop.closed)


@pytest.mark.parametrize("t_end", [1e3, 1e5])
def test_energies_of_long_runs_overflow_nowhere(t_end):
    mass, free = vf.Mass(1.0, stiffness=1.0, damping=0.2), vf.Mass(1.0)
    scene = vf.Scene([mass, free], [vf.PointLoad(mass, vf.Sine(1.0, 0.8)), vf.PointLoad(free, 1.0)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = vf.simulate(scene, t_end, times=np.linspace(0.0, t_end, 11))
        assert result.energy.balance_error < 1e-9
