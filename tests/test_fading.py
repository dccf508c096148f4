"""Coordinates of free motion that come to rest, and dense samples and energies without those that have."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from scipy.linalg import expm

import vofem as vf
from vofem.integrators.event_driven import energy_forms, fading, sampling
from vofem.integrators.event_driven.fading import Fading, free_rows, second_order_rows

#: Undamped, lightly damped, nearly critical, critical and overdamped blocks, and one that moves freely.
DELTA = np.array([0.0, 0.1, 2.0, 9.99, 10.0, 30.0, 400.0, 0.5, 3.0])
P = np.array([4.0, 4.0, 9.0, 100.0, 100.0, 400.0, 900.0, 0.0, 7.0])


def free_flow(delta, p, t):
    n = p.size
    flow = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(p), -2.0 * np.diag(delta)]])
    return expm(flow * t)


def example():
    out = np.random.default_rng(1).normal(size=(2 * P.size, 2 * P.size))
    return Fading(DELTA, P, out, np.maximum(P, 1.0)), out


def test_coordinates_describe_the_same_motion():
    found, out = example()
    rng, n = np.random.default_rng(2), P.size
    blocks, form = rng.normal(size=(2 * n, 5)), out.T @ out
    states = found.states(blocks)
    # Overdamped blocks are described by exponentials, others by their states.
    assert np.flatnonzero(np.any(states != blocks, axis=1)).tolist() == [5, 6, 8, n + 5, n + 6, n + 8]
    assert found.functionals(out) @ states == pytest.approx(out @ blocks, rel=1e-13)
    squares = np.einsum("ik,ij,jk->k", states, found.form(form), states)
    assert squares == pytest.approx(np.einsum("ik,ij,jk->k", blocks, form, blocks), rel=1e-12)


@pytest.mark.parametrize("number", [0, 3])
def test_changes_are_those_of_the_matrix_exponential(number):
    found, _ = example()
    rng = np.random.default_rng(3)
    blocks = rng.normal(size=(2 * P.size, 2))
    moving, tau, segment = found.moving(number), np.array([1e-3, 0.1, 1.5]), np.array([0, 1, 1])
    assert (moving.rest.size > 0) is (number > 0)
    begin = np.ascontiguousarray(found.states(blocks)[moving.which].T)
    change = np.empty((3, moving.which.size))
    free_rows(moving.pairs, moving.rate, begin, segment, tau, change)
    for row, k, t in zip(change, segment, tau, strict=True):
        exact = found.states(free_flow(DELTA, P, t) @ blocks - blocks)[moving.which, k]
        assert row == pytest.approx(exact, rel=1e-11, abs=1e-12)


def test_the_part_of_second_order_is_accurate_at_short_times():
    """Against the series of the motion, of which three terms suffice."""
    found, _ = example()
    blocks = np.random.default_rng(4).normal(size=(2 * P.size, 1))
    moving, tau = found.moving(0), np.array([1e-9])
    begin = np.ascontiguousarray(found.states(blocks)[moving.which].T)
    change, rest = np.empty((2, 1, moving.which.size))
    second_order_rows(moving.pairs, moving.rate, begin, np.zeros(1, dtype=np.int64), tau, change, rest)
    n, t = P.size, tau[0]
    flow = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(P), -2.0 * np.diag(DELTA)]])
    second = flow @ flow @ blocks * t**2 / 2.0
    exact = found.states(second + flow @ second * t / 3.0)[moving.which, 0]
    assert rest[0] == pytest.approx(exact, rel=1e-11)


def test_what_is_left_out_is_below_rounding_and_late_times_are_cheap():
    """For the energy of the state at all times; two motions, one of which has its energy in what decays soon."""
    found, _ = example()
    n, out = P.size, np.diag(np.sqrt(2.0) * np.ones(2 * P.size))
    found = Fading(DELTA, P, out, np.ones(n))
    blocks = np.random.default_rng(5).normal(size=(2 * n, 2))
    blocks[[6, n + 6], 1] *= 1e9
    tau = np.tile(np.linspace(0.0, 30.0, 4000), 2)
    segment = np.repeat([0, 1], 4000)
    states = found.states(blocks)
    chosen = found.choose(states, segment, tau, np.full(2, 30.0), np.zeros(0, dtype=np.int64))
    numbers = np.array([found.moving(c).which.size for c in range(chosen.max() + 1)])
    # Blocks 0 and 7 never come to rest; at first everything moves.
    assert chosen[0] == chosen[4000] == 0
    assert 4 <= numbers[chosen[-1]] < n
    left_out, columns = 0, found.functionals(np.eye(2 * n))
    for i in range(0, tau.size, 80):
        k, t, rest = segment[i], tau[i], found.moving(chosen[i]).rest
        now = free_flow(DELTA, P, t) @ blocks[:, k]
        # Each exponential by itself, because in the states the faster one is rounding of the slower one.
        for at, roots in zip((found._split, n + found._split), found._roots, strict=True):
            now[at] = states[at, k] * np.exp(roots * t)
        assert np.linalg.norm(columns[:, rest] @ now[rest]) <= 2.0**-53 * np.linalg.norm(columns @ now)
        left_out += rest.size
    assert left_out > 0.3 * 2 * n * tau.size / 80


def test_undamped_motion_never_comes_to_rest():
    found = Fading(np.zeros(3), np.array([1.0, 4.0, 9.0]), None, np.array([1.0, 4.0, 9.0]))
    chosen = found.choose(np.ones((6, 1)), np.zeros(900, dtype=np.int64), np.linspace(0, 1e9, 900), np.full(1, 1e9),
                          np.zeros(0, dtype=np.int64))  # fmt: skip
    assert not np.any(chosen)
    assert found.moving(0).which.size == 6


def tube(load, *more, damping=0.5, law="penetration"):
    beam = vf.Beam(1.0, 1.0, 1.0, 8, {"left": "clamped"})
    stops = [
        vf.Contact(beam.at(x), gap=0.01, stiffness=300.0, damping=damping, side=side, acts_on=law, name=f"{side} {x}")
        for x in (0.5, 1.0)
        for side in ("above", "below")
    ]
    return vf.Scene(
        [beam],
        [*stops, vf.RayleighDamping(0.1, 2e-3), vf.PointLoad(beam.at(0.75), load), *(make(beam) for make in more)],
    )


RECORD = vf.Tabulated(np.linspace(0.0, 3.0, 16), np.cos(3.0 * np.linspace(0.0, 3.0, 16)))
SCENES = {
    "two sines": lambda: tube(vf.Sine(1.0, 5.0) + vf.Sine(0.3, 17.0)),
    "record": lambda: tube(RECORD),
    "ramp": lambda: tube(vf.Sine(1.0, 5.0) + vf.Ramp(0.3, 0.0, 2.0)),
    # The first frequency without contacts is 3.516 rad/s.
    "resonant": lambda: tube(vf.Sine(0.5, 3.516)),
    "dashpot": lambda: tube(vf.Sine(1.0, 5.0), lambda beam: vf.Dashpot(beam.at(0.25), damping=0.4), damping=0.0),
    "spring to ground": lambda: tube(vf.Sine(1.0, 5.0), lambda beam: vf.Spring(beam.at(0.25), stiffness=9.0)),
    "undamped stops": lambda: tube(vf.Sine(1.0, 5.0), damping=0.0),
    "displacement law": lambda: tube(vf.Sine(1.0, 5.0), law="displacement"),
}


@pytest.mark.parametrize("kind", SCENES)
def test_dense_results_agree_with_all_coordinates(kind, monkeypatch):
    """Energies, motions and contact forces of one run, without and with what has come to rest."""
    times = np.linspace(0.0, 3.0, 12_001)
    result = vf.simulate(SCENES[kind](), 3.0, times=times, method="event_driven", compiled=True)
    assert result.counters.events >= 2
    evaluated = []
    plain = fading.free_rows

    def counting(of, rate, starts, segment, tau, change):
        evaluated.append(change.size)
        return plain(of, rate, starts, segment, tau, change)

    monkeypatch.setattr(energy_forms, "free_rows", counting)
    solution = result.solution
    found = solution.energies(times), solution.modal(times), solution.contacts(times).force, solution.sample(times).a
    few = sum(evaluated)
    evaluated.clear()
    monkeypatch.setattr(energy_forms, "DENSE", 10**9)
    monkeypatch.setattr(sampling, "DENSE", 10**9)
    solution._sampled = None
    whole = solution.energies(times), solution.modal(times), solution.contacts(times).force, solution.sample(times).a
    assert few < 0.9 * sum(evaluated)
    # Some blocks are nearly critically damped. They cost digits, with all coordinates too.
    size = max(np.max(np.abs(part)) for part in vars(whole[0]).values())
    for part, exact in zip(vars(found[0]).values(), vars(whole[0]).values(), strict=True):
        assert np.max(np.abs(part - exact)) < 2e-13 * size
    for part, exact in zip((*found[1], found[2]), (*whole[1], whole[2]), strict=True):
        assert np.max(np.abs(part - exact)) < 2e-14 * np.max(np.abs(exact))
    # Accelerations weight modes by the squares of their frequencies.
    assert np.max(np.abs(found[3] - whole[3])) < 1e-11 * np.max(np.abs(whole[3]))
    gaps = [part.kinetic + part.strain + part.contact + part.dissipated - part.work for part in (found[0], whole[0])]
    errors = [np.max(np.abs(gap - gap[0])) / size for gap in gaps]
    assert errors[0] < 1.2 * errors[1] + 1e-14
    assert errors[1] < 2e-12


def test_samples_are_shared_while_a_result_holds_them(monkeypatch):
    """Also where they take too much memory to be kept by the solution; a copy of a solution has none."""
    from vofem.integrators.event_driven import solution as module

    monkeypatch.setattr(module, "_MOST_KEPT", 0)
    times = np.linspace(0.0, 1.0, 400)
    result = vf.simulate(tube(vf.Sine(1.0, 5.0)), 1.0, times=times, method="event_driven")
    calls, plain = [], module.EventSolution._sampled_at
    monkeypatch.setattr(module.EventSolution, "_sampled_at", lambda *given: calls.append(1) or plain(*given))
    tip = result.scene.bodies[0].at(1.0)
    result.displacement(tip)
    force = result.contacts["above 1.0"].force
    assert result.energy.balance_error < 1e-12
    # The second sampling is that of the energy at the start.
    assert len(calls) == 2
    again = copy.copy(result.solution)
    assert np.array_equal(again.contacts(times).force[2], force)
    assert len(calls) == 3


def test_many_samples_of_few_degrees_of_freedom(monkeypatch):
    """They are computed for themselves, and agree with the whole to rounding."""
    from vofem.integrators.event_driven import modal_samples

    times = np.linspace(0.0, 1.0, 400)
    result = vf.simulate(tube(vf.Sine(1.0, 5.0)), 1.0, times=times, method="event_driven")
    tip = result.scene.bodies[0].at(1.0)
    before = [result.displacement(tip), result.velocity(tip), result.acceleration(tip)]
    monkeypatch.setattr(modal_samples, "_MANY", 0)
    del result.__dict__["samples"]
    after = [result.displacement(tip), result.velocity(tip), result.acceleration(tip)]
    assert not {"q", "v"} & set(result.samples.__dict__)
    for part, exact in zip(after, before, strict=True):
        assert part == pytest.approx(exact, abs=1e-13 * np.max(np.abs(exact)))
