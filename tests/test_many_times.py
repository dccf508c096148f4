"""Samples of an event-driven run at many times at once: many oscillators at a time, and products of matrices."""

import copy
import gc
import weakref

import numpy as np
import pytest
from scenes import alone, cantilever

import vofem as vf
from vofem.kernels.mode import kernels
from vofem.linalg.exponential import oscillator_change
from vofem.linalg.oscillators import FREQUENCY, ROOT, decays, oscillators, oscillators_at


def test_decays_keep_all_digits():
    """Against extended precision, from tiny exponents to those whose exponential is zero."""
    numbers = np.random.default_rng(3)
    for size in (1e-12, 1e-3, 0.5, 5.0, 100.0, 1e6):
        rate, out, work = size * numbers.uniform(0.0, 1.0, 400), np.empty(400), np.empty(400)
        rate[0] = 0.0
        with kernels(compiled=True):
            decays(rate, 0.83, out, work)
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
    of, out, work = oscillators(delta, p), np.empty((2, p.size)), np.empty((5, p.size))
    c, s = out
    with kernels(compiled=compiled):
        for t in (1e-9, 1e-4, 0.03, 2.0):
            oscillators_at(of, t, out, work)
            one = np.array([oscillator_change(d, q, t) for d, q in zip(delta, p, strict=True)]).T
            size = np.maximum(np.abs(one[0]), 1e-3 * np.minimum(1.0, of[FREQUENCY] * t))
            assert np.all(np.abs(c - one[0]) <= 2e-14 * size)
            assert np.all(
                np.abs(s - one[1]) <= 2e-14 * np.maximum(np.abs(one[1]), 1e-2 / np.maximum(of[ROOT], 1.0 / t))
            )


EFFECTS = {"no dampers": [], "modal damping": [vf.ModalDamping(0.02)], "complex modes": [vf.RayleighDamping(0.1, 1e-3)]}


@pytest.mark.parametrize("name", EFFECTS)
def test_many_times_are_sampled_as_each_alone(name):
    """The gap function shortly after an event keeps its digits too; loads are a harmonic, a constant and a ramp."""
    beam = cantilever(8, name="beam")
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
        (z, v), (gaps, _, _) = solution.modal(times), solution.pressed(times)
        starts = solution.segment_starts
        within, segments = np.searchsorted(starts, times, side="right") - 1, solution.segments
        for index in np.unique(within).tolist():
            mine = np.flatnonzero(within == index)
            own, tau = np.array([index]), times[mine] - starts[index]
            regime, _ = next(solution.regimes(own))
            changes = regime.changes(solution.begins(regime, own), 0 * mine, tau)
            displacement, velocity = (part.T for part in regime.to_modes(changes))
            first, rate = (part[index][:, None] for part in (segments.displacement, segments.velocity))
            moved = solution.space.contacts @ displacement
            size = np.abs(moved) + 1e-12 * np.max(np.abs(solution.space.contacts)) * tau
            assert np.all(np.abs(gaps[:, mine] - segments.gaps[index][:, None] - moved) <= 1e-11 * size + 1e-16)
            assert np.max(np.abs(z[:, mine] - first - displacement)) < 1e-14 * np.max(np.abs(z))
            assert np.max(np.abs(v[:, mine] - rate - velocity)) < 1e-13 * np.max(np.abs(v))


def test_the_samples_of_many_times_outlive_energies_at_one():
    _, scene = alone(vf.Mass(1.0, stiffness=1.0), start=(0.5, 0.0))
    solution = vf.simulate(scene, 1.0, method="event_driven", times=np.linspace(0.0, 1.0, 50)).solution
    many = solution.modal(solution.times)
    assert solution.start_energy == pytest.approx(0.125, rel=1e-14)
    assert all(one is other for one, other in zip(solution.modal(solution.times), many, strict=True))


def tube(load, *more, damping=0.5, law="penetration"):
    beam = cantilever(8)
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
def test_energies_at_many_times_balance(kind):
    """Of motions in complex modes, some of which are nearly critically damped; a few times alone give the same."""
    times = np.linspace(0.0, 3.0, 12_001)
    result = vf.simulate(SCENES[kind](), 3.0, times=times, method="event_driven", compiled=True)
    assert result.counters.events >= 2
    assert result.energy.balance_error < 2e-13
    few = result.solution.energies(times[::1500])
    for part, whole in ((few.work, result.energy.work), (few.dissipated, result.energy.dissipated)):
        assert np.max(np.abs(part - whole[::1500])) < 1e-13 * np.max(np.abs(whole))


def test_samples_are_shared_while_a_result_holds_them(monkeypatch):
    """Also where they take too much memory to be kept by the solution; a copy of a solution has none."""
    from vofem.integrators.event_driven import solution as module

    monkeypatch.setattr(module, "_MOST_KEPT", 0)
    times = np.linspace(0.0, 1.0, 400)
    result = vf.simulate(tube(vf.Sine(1.0, 5.0)), 1.0, times=times, method="event_driven")
    calls, plain = [], module.EventSolution.moved
    monkeypatch.setattr(module.EventSolution, "moved", lambda *given: calls.append(given[1].size) or plain(*given))
    tip = result.scene.bodies[0].at(1.0)
    result.displacement(tip)
    force = result.contacts["above 1.0"].force
    assert result.energy.balance_error < 1e-12
    # The others are those of the energy at the start.
    assert sorted(calls) == [1, 1, 400]
    again = copy.copy(result.solution)
    assert np.array_equal(again.contacts(times).force[2], force)
    assert len(calls) == 4
    solution = result.solution
    held = [weakref.ref(part) for part in (*solution.modal(times), *solution.pressed(times))]
    assert len(calls) == 4
    del result, force
    gc.collect()
    assert all(part() is None for part in held)


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
