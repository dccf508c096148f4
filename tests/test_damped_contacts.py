"""Complex modes of structures and contacts with dampers: roots, static responses, energies of runs."""

import numpy as np
import pytest
from scenes import cantilever
from scipy.linalg import eigh

import vofem as vf
from vofem.integrators.event_driven.complex_modes import damped_blocks


def all_roots(p, damping):
    omega = np.sqrt(p)
    state = np.block([[np.zeros((p.size, p.size)), np.diag(omega)], [-np.diag(omega), -damping]])
    return np.linalg.eigvals(state)


def block_roots(blocks):
    """Return the roots of all blocks that are not members of clusters."""
    roots = -blocks.delta + np.array([[1.0], [-1.0]]) * np.sqrt((blocks.delta**2 - blocks.p).astype(complex))
    members = [k for cluster in blocks.clusters for k in cluster.member]
    return np.delete(roots, members, axis=1).ravel()


@pytest.mark.parametrize("a1", [1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("stiffness", [3.0, 300.0])
def test_slow_modes_keep_their_digits_beside_overdamped_ones(a1, stiffness):
    """Many roots lie within 1e-9 of -1/a1, and the largest one is 1e10."""
    n, a0 = 120, 0.1
    row = 2.0 * (-1.0) ** np.arange(n)
    p = ((np.arange(n) + 0.6) * np.pi) ** 4
    p, closed = eigh(np.diag(p) + stiffness * np.outer(row, row))
    row = row @ closed
    blocks = damped_blocks(p, np.diag(a0 + a1 * p) - a1 * stiffness * np.outer(row, row))
    assert not blocks.clusters
    assert np.abs(blocks.into @ blocks.out - np.eye(2 * n)).max() < 1e-9
    # The static response, which an eigenproblem in ascending order gets wrong by 1e-11 to 3e-10.
    steady = blocks.into @ np.concatenate([np.zeros(n), row])
    rest = blocks.out @ np.concatenate([(steady[n:] + 2.0 * blocks.delta * steady[:n]) / blocks.p, -steady[:n]])
    assert np.abs(rest[:n] - row / p).max() < 1e-12 * np.abs(row / p).max()


def strongly_damped(seed, n=40, terms=3):
    """Return squared frequencies over four decades and a damping whose terms couple them more than they are apart."""
    rng = np.random.default_rng(seed)
    p, rows = np.sort(10.0 ** rng.uniform(2.0, 10.0, n)), rng.normal(size=(terms, n))
    rows[:, rng.integers(0, n, 2)] *= 1e-9
    return p, np.diag(0.2 + 2e-5 * p) + (rows.T * 1e5 * rng.uniform(0.5, 2.0, terms)) @ rows


# Repeated roots are known to the square root of rounding.
@pytest.mark.parametrize(
    ("p", "damping", "known"),
    [
        *((*strongly_damped(seed), 1e-12) for seed in range(4)),
        (np.full(30, 4.0), 0.1 * np.eye(30) + 0.3, 1e-12),
        (np.arange(1.0, 31.0) ** 2, 2.0 * np.diag(np.arange(1.0, 31.0)), 1e-7),
    ],
)
def test_strong_dampers_equal_frequencies_and_repeated_roots(p, damping, known):
    blocks, n = damped_blocks(p, damping), p.size
    assert np.abs(blocks.into @ blocks.out - np.eye(2 * n)).max() < 1e-8
    own, full = block_roots(blocks), all_roots(p, damping)
    assert own.size + sum(cluster.generator.shape[0] for cluster in blocks.clusters) == 2 * n
    if own.size:
        assert np.max(np.min(np.abs(own[:, None] - full), axis=1)) < known * np.abs(full).max()


def rattling_tube(elements=16):
    """Return a clamped tube with stops above and below, all with dampers, as loosely supported heat exchanger tubes."""
    beam = vf.Beam(length=2.436, EI=500.0, rhoA=0.42, elements=elements, supports={"left": "clamped"}, name="tube")
    effects = [vf.RayleighDamping(0.15, 1.8e-5)]
    for x in (1.218, 2.436):
        for side in ("above", "below"):
            stop = {"gap": 4e-4, "stiffness": 1e5, "damping": 0.3, "side": side, "acts_on": "penetration"}
            effects.append(vf.Contact(beam.at(x), **stop, name=f"{side} at {x}"))
    effects.append(vf.PointLoad(beam.at(0.609), vf.Sine(40.0, 251.2)))
    return vf.Scene([beam], effects), beam


def test_a_tube_between_damped_stops_balances_its_energy():
    scene, _ = rattling_tube()
    result = vf.simulate(scene, 0.05, times=np.linspace(0.0, 0.05, 26), method="event_driven", compiled=False)
    assert result.counters.statuses >= 4
    assert result.counters.events > 10
    assert result.energy.balance_error < 1e-13


def test_energy_taken_where_a_block_is_resonant_or_critically_damped():
    """Integration by parts against fine panels; the load is close to a mode, and one mode is nearly critical."""
    beam = cantilever(8, name="beam")
    omega = np.sqrt(vf.modes(vf.Scene([beam]), 6).frequencies * 2.0 * np.pi) ** 2
    # Rayleigh damping 2 omega = a1 omega^2 is critical at 2 / a1.
    effects = [
        vf.RayleighDamping(0.0, 2.0 / omega[4] * 1.001),
        vf.Dashpot(beam.at(0.5), damping=0.05),
        vf.PointLoad(beam.at(1.0), vf.Sine(0.3, 1.01 * omega[0]) + vf.Constant(0.2)),
    ]
    scene = vf.Scene([beam], effects, initial={beam: (vf.Polynomial([0.0, 0.0, 0.1]), 0.0)})
    times = np.concatenate([[0.0], np.geomspace(1e-6, 6.0, 60)])
    result = vf.simulate(scene, 6.0, times=times, method="event_driven", compiled=False)
    assert result.energy.balance_error < 1e-11
    # Gauss's rule on panels that grow: the quickest motion decays within 1e-5 s.
    edges = np.append(0.0, np.geomspace(1e-7, 0.5, 300))
    nodes, weights = np.polynomial.legendre.leggauss(8)
    width = np.diff(edges)[:, None]
    motion = result.solution.sample((edges[:-1, None] + 0.5 * width * (nodes + 1.0)).ravel())
    damping = scene.model.system.damping + 2.0 / omega[4] * 1.001 * scene.model.system.stiffness
    power = np.sum(motion.v * (damping @ motion.v), axis=0).reshape(-1, 8)
    taken = result.solution.energies(np.array([0.5])).dissipated
    assert taken == pytest.approx([np.sum(0.5 * width * power * weights)], rel=1e-9)


@pytest.mark.parametrize("method", ["central_difference", "energy_conserving", "generalized_alpha"])
def test_steps_are_of_second_order_where_a_damper_begins_to_act(method):
    """The damper's force jumps at closings. Where it acts for whole steps, the order is one."""
    mass = vf.Mass(1.0, stiffness=4.0, name="mass")
    stop = vf.Contact(mass, gap=0.1, stiffness=400.0, damping=6.0, side="above", acts_on="penetration", name="stop")
    scene, times = vf.Scene([mass], [stop], {mass: (0.0, 1.0)}), np.linspace(0.0, 6.0, 61)
    right = vf.simulate(scene, 6.0, times=times)
    assert right.contacts["stop"].closings.size == 3
    counts = np.array([[400, 437, 471, 513, 547], [1600, 1671, 1713, 1747, 1801]])
    errors = np.empty(counts.shape)
    for place, count in np.ndenumerate(counts):
        run = vf.simulate(scene, 6.0, method=method, dt=6.0 / count, times=times)
        errors[place] = np.abs(run.displacement(mass) - right.displacement(mass)).max()
    # Errors depend on where in a step a contact closes, so some steps of about one size are taken together.
    order = -np.diff(np.mean(np.log(errors), axis=1)) / np.diff(np.mean(np.log(counts), axis=1))
    assert 1.4 < float(order[0]) < 2.4
    assert errors[1].max() < 1e-3


def test_the_damper_of_a_resolved_switch_starts_with_the_same_force_in_other_units() -> None:
    """Its force at t = 0 was that 1e-9 m ahead: motions of a stop of micrometres were off by 2e-3."""
    found = []
    for length in (1.0, 2.0**-20):
        mass = vf.Mass(1.0, stiffness=1.0, name="m")
        stop = vf.Contact(
            mass, gap=0.05 * length, stiffness=30.0, damping=0.8, side="above", acts_on="penetration",
            switch=vf.Resolved(40.0 / length), name="stop",
        )  # fmt: skip
        scene = vf.Scene([mass], [stop], initial={mass: (0.07 * length, -0.5 * length)})
        found.append(vf.simulate(scene, 0.5, method="generalized_alpha", dt=2.0**-6).displacement(mass) / length)
    np.testing.assert_allclose(found[1], found[0], rtol=1e-12)
