"""Complex modes of contacts with dampers by updates: roots, vectors, and runs against full eigensystems."""

from __future__ import annotations

import numpy as np
import pytest

import vofem as vf
from vofem.integrators.event_driven import complex_modes
from vofem.linalg.low_rank_damping import CoupledDamping, coupled_modes
from vofem.linalg.secular import rank_one


def oscillators(seed, strength, n=40, terms=2):
    """Return squared frequencies over four decades and a damping of which a few terms couple them."""
    rng = np.random.default_rng(seed)
    p = np.sort(10.0 ** rng.uniform(2.0, 10.0, n))
    rows = rng.normal(size=(terms, n))
    rows[:, rng.integers(0, n, 2)] *= 1e-9
    return p, CoupledDamping(0.2 + 2e-5 * p, rows, strength * rng.uniform(0.5, 2.0, terms))


def all_roots(p, damping):
    omega = np.sqrt(p)
    state = np.block([[np.zeros((p.size, p.size)), np.diag(omega)], [-np.diag(omega), -damping.matrix()]])
    return np.linalg.eigvals(state)


@pytest.mark.parametrize("strength", [1e-6, 1e-2, 1.0, -1.0])
def test_every_root_is_found_and_every_vector_solves_the_pencil(strength):
    for seed in range(8):
        p, damping = oscillators(seed, strength)
        found = coupled_modes(p, damping)
        assert found is not None
        s, x = found
        assert 2 * np.sum(s.imag > 0.0) + np.sum(s.imag == 0.0) == 2 * p.size
        both = np.concatenate([s, s[s.imag > 0.0].conj()])
        full = all_roots(p, damping)
        apart = np.abs(both[:, None] - full)
        # The full eigenproblem knows its roots to rounding of the largest one.
        assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-13 * np.abs(full).max()
        terms = s**2 * x, s * (damping.matrix() @ x), p[:, None] * x
        size = np.max([np.abs(term).max(axis=0) for term in terms], axis=0)
        assert np.max(np.abs(sum(terms)) / size) < 1e-13


@pytest.mark.parametrize("a1", [1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("stiffness", [3.0, 300.0])
def test_slow_roots_of_overdamped_modes_are_apart(a1, stiffness):
    """They lie within 1e-9 of -1/a1; a full eigenproblem, whose largest root is 1e10, mixes their modes."""
    n, a0 = 120, 0.1
    row = 2.0 * (-1.0) ** np.arange(n)
    p, closed = rank_one(((np.arange(n) + 0.6) * np.pi) ** 4, row, stiffness)
    rows = (row @ closed)[None, :]
    damping = CoupledDamping(a0 + a1 * p, rows, np.array([-a1 * stiffness]), (a0, a1))
    found = coupled_modes(p, damping)
    assert found is not None
    s, x = found
    assert 2 * np.sum(s.imag > 0.0) + np.sum(s.imag == 0.0) == 2 * n
    terms = (
        s**2 * x,
        s * (damping.own[:, None] * x + np.outer(rows[0], damping.weights[0] * (rows[0] @ x))),
        (p[:, None] * x),
    )
    size = np.max([np.abs(term).max(axis=0) for term in terms], axis=0)
    assert np.max(np.abs(sum(terms)) / size) < 1e-13
    blocks = complex_modes.damped_blocks(p, damping.matrix(), damping)
    assert not blocks.clusters
    assert np.abs(blocks.into @ blocks.out - np.eye(2 * n)).max() < 1e-9
    # The static response, which a full eigenproblem gets wrong by 1e-11 to 3e-10.
    load = rows[0]
    steady = blocks.into @ np.concatenate([np.zeros(n), load])
    rest = blocks.out @ np.concatenate([(steady[n:] + 2.0 * blocks.delta * steady[:n]) / blocks.p, -steady[:n]])
    assert np.abs(rest[:n] - load / p).max() < 1e-14 * np.abs(load / p).max()


def test_roots_that_are_not_found_are_left_to_a_full_eigenproblem():
    """Dampers far stronger than what frequencies are apart, equal frequencies, repeated roots: right anyway."""
    strong = [oscillators(seed, 1e5, terms=3) for seed in range(4)]
    p = np.full(30, 4.0)
    equal = p, CoupledDamping(np.full(30, 0.1), np.ones((1, 30)), np.array([0.3]))
    critical = np.arange(1.0, 31.0) ** 2, CoupledDamping(2.0 * np.arange(1.0, 31.0), np.zeros((1, 30)), np.ones(1))
    # Repeated roots are known to the square root of rounding.
    for (p, damping), known in [*((case, 1e-12) for case in strong), (equal, 1e-12), (critical, 1e-7)]:
        blocks = complex_modes.damped_blocks(p, damping.matrix(), damping)
        n = p.size
        assert np.abs(blocks.into @ blocks.out - np.eye(2 * n)).max() < 1e-8
        roots = -blocks.delta + np.array([[1.0], [-1.0]]) * np.sqrt((blocks.delta**2 - blocks.p).astype(complex))
        members = [k for cluster in blocks.clusters for k in cluster.member]
        own = np.delete(roots, members, axis=1).ravel()
        full = all_roots(p, damping)
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


def test_a_tube_between_damped_stops_needs_no_full_eigensystem(monkeypatch):
    scene, beam = rattling_tube()
    times = np.linspace(0.0, 0.05, 26)
    with monkeypatch.context() as patch:
        patch.setattr(complex_modes, "_updated", lambda *arguments: None)
        full = vf.simulate(scene, 0.05, times=times, method="event_driven", compiled=False)
    # Another scene, which has no eigensystems yet.
    scene, beam = rattling_tube()
    full_splits = []
    split = complex_modes.split
    monkeypatch.setattr(complex_modes, "split", lambda state: full_splits.append(state) or split(state))
    updated = vf.simulate(scene, 0.05, times=times, method="event_driven", compiled=False)
    assert updated.counters.statuses >= 4
    assert updated.counters.events > 10
    assert not full_splits
    assert updated.counters.events == full.counters.events
    assert updated.energy.balance_error < 1e-13
    size = np.abs(full.displacement(beam.at(2.436))).max()
    assert updated.displacement(beam.at(2.436)) == pytest.approx(full.samples.q[-2], abs=1e-8 * size)


def test_energy_taken_where_a_block_is_resonant_or_critically_damped():
    """Integration by parts against fine panels; the load is close to a mode, and one mode is nearly critical."""
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=8, supports={"left": "clamped"}, name="beam")
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
