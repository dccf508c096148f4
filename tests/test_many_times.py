"""Samples of an event-driven run at many times at once: many oscillators at a time, and products of matrices."""

from __future__ import annotations

import numpy as np
import pytest

import vofem as vf
from vofem.kernels.mode import kernels
from vofem.linalg.exponential import oscillator_change, oscillator_remainder
from vofem.linalg.oscillators import decays, oscillators, oscillators_at, remainders_at


def test_decays_keep_all_digits():
    """Against extended precision, from tiny exponents to those whose exponential is zero."""
    numbers = np.random.default_rng(3)
    for size in (1e-12, 1e-3, 0.5, 5.0, 100.0, 1e6):
        rate, out, bits = size * numbers.uniform(0.0, 1.0, 400), np.empty(400), np.zeros(400, dtype=np.int64)
        rate[0] = 0.0
        with kernels(compiled=True):
            decays(rate, 0.83, out, bits, bits.view(np.float64))
        exact = np.expm1(-np.asarray(rate * 0.83, dtype=np.longdouble))
        assert np.all(np.abs(out - exact) <= 4e-16 * np.abs(exact))
        assert out[0] == 0.0


@pytest.mark.parametrize("compiled", [True, False])
def test_many_oscillators_at_once_are_those_one_by_one(compiled):
    """Underdamped, overdamped, with equal roots, rigid, and rigid with damping."""
    numbers = np.random.default_rng(5)
    omega = 10.0 ** numbers.uniform(-1.0, 5.0, 60)
    delta, p = omega * numbers.choice([0.0, 0.01, 0.9, 30.0], 60), omega**2
    delta, p = np.append(delta, [0.0, 3.0, 7.0]), np.append(p, [0.0, 0.0, 49.0])
    of, (c, s) = oscillators(delta, p), np.empty((2, p.size))
    with kernels(compiled=compiled):
        for t in (1e-9, 1e-4, 0.03, 2.0):
            oscillators_at(of, t, c, s)
            one = np.array([oscillator_change(d, q, t) for d, q in zip(delta, p, strict=True)]).T
            size = np.maximum(np.abs(one[0]), 1e-3 * np.minimum(1.0, of.frequency * t))
            assert np.all(np.abs(c - one[0]) <= 2e-14 * size)
            assert np.all(np.abs(s - one[1]) <= 2e-14 * np.maximum(np.abs(one[1]), 1e-2 / np.maximum(of.root, 1.0 / t)))
            remainders_at(of, t, c, s)
            one = np.array([oscillator_remainder(d, q, t) for d, q in zip(delta, p, strict=True)]).T
            assert np.all(np.abs(c - one[0]) <= 1e-13 * (np.abs(one[0]) + 1e-300))
            assert np.all(np.abs(s - one[1]) <= 1e-13 * (np.abs(one[1]) + 1e-300))


EFFECTS = {
    "no dampers": [],
    "modal damping": [vf.ModalDamping(0.02)],
    "complex modes": [vf.RayleighDamping(0.1, 1e-3)],
}


@pytest.mark.parametrize("name", EFFECTS)
def test_many_times_are_sampled_as_each_alone(name):
    """The gap function shortly after an event keeps its digits too; loads are a harmonic, a constant and a ramp."""
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=8, supports={"left": "clamped"}, name="beam")
    tip = beam.at(1.0)
    damping = 0.2 if name == "complex modes" else 0.0
    stop = vf.Contact(tip, gap=0.03, stiffness=50.0, side="below", acts_on="penetration", damping=damping, name="stop")
    loads = [vf.PointLoad(tip, vf.Sine(0.3, 5.0)), vf.PointLoad(tip, vf.Ramp(-0.05, 3.0))]
    scene = vf.Scene([beam], [stop, *loads, *EFFECTS[name]])
    times = np.linspace(0.0, 6.0, 4001)
    with kernels(compiled=True):
        solution = vf.simulate(scene, 6.0, method="event_driven", times=times).solution
        events = solution.events.time
        assert events.size >= 6
        times = np.sort(np.concatenate([times, events + 1e-9, events + 1e-6]))
        z, v, gaps = solution._trajectory(times)
        for index, mine, tau in solution.visit(times):
            motion = solution.motion(index)
            displacement, velocity = motion.mode_changes(tau)
            moved = solution.space.contacts @ displacement
            size = np.abs(moved) + 1e-12 * np.max(np.abs(solution.space.contacts)) * tau
            assert np.all(
                np.abs(gaps[:, mine] - solution.gap_functions(index)[:, None] - moved) <= 1e-11 * size + 1e-16
            )
            assert np.max(np.abs(z[:, mine] - motion.displacement[:, None] - displacement)) < 1e-14 * np.max(np.abs(z))
            assert np.max(np.abs(v[:, mine] - motion.velocity[:, None] - velocity)) < 1e-13 * np.max(np.abs(v))


def test_the_samples_of_many_times_outlive_energies_at_one():
    mass = vf.Mass(1.0, stiffness=1.0)
    scene = vf.Scene([mass], initial={mass: (0.5, 0.0)})
    solution = vf.simulate(scene, 1.0, method="event_driven", times=np.linspace(0.0, 1.0, 50)).solution
    many = solution._trajectory(solution.times)
    assert solution.start_energy == pytest.approx(0.125, rel=1e-14)
    assert all(one is other for one, other in zip(solution._trajectory(solution.times), many, strict=True))
