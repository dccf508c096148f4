"""Contact statuses of event-driven runs: what they cost, how exact they stay, and touches that are rounding."""

import itertools

import numpy as np
import pytest

import vofem as vf
from vofem.cache import Cache
from vofem.integrators.event_driven.modal_space import modal_space
from vofem.integrators.event_driven.spectrum import Spectra
from vofem.system import Counters

METHODS = ("event_driven", "energy_conserving", "generalized_alpha", "central_difference")


def beam_on_stops(count, stiffness):
    beam = vf.Beam(10.0, 1.0, 1.0, count, {"left": "clamped", "right": "clamped"}, name="beam")
    stops = [
        vf.Contact(
            beam.at(10.0 * (k + 0.5) / count), gap=1e-3 * (1.0 + 0.5 * np.sin(k)), side="below", stiffness=stiffness,
            acts_on="penetration", name=f"c{k}",
        )
        for k in range(count)
    ]  # fmt: skip
    return vf.Scene([beam], stops, initial={beam: (0.0, lambda x: -(np.sin(np.pi * x / 10.0) ** 2))})


@pytest.mark.parametrize("stiffness", [1e4, 1e7])
def test_a_status_is_computed_once(stiffness):
    result = vf.simulate(beam_on_stops(24, stiffness), 0.03, method="event_driven")
    assert result.counters.statuses > 30
    assert result.counters.rank_one_updates <= result.counters.statuses
    assert result.energy.balance_error < 1e-12


@pytest.mark.parametrize("stiffness", [1e2, 1e5, 1e8])
def test_statuses_stay_exact_after_many_closings_and_openings(stiffness):
    system = beam_on_stops(20, stiffness).model.system
    space = modal_space(system, Counters())
    counters = Counters()
    spectra = Spectra(space, system.contacts, counters, Cache())
    rng, status = np.random.default_rng(1), np.zeros(20, dtype=np.int64)
    for _ in range(120):
        status = status.copy()
        status[rng.integers(20)] ^= 1
        real = spectra[status].real
    rows = space.contacts[status == 1]
    # Term by term: the sum of both matrices would have lost the slow modes beside stiff contacts.
    touched = rows @ real.modes
    left = real.modes.T @ (space.stiffness[:, None] * real.modes) + stiffness * touched.T @ touched - np.diag(real.p)
    assert np.max(np.abs(real.modes.T @ real.modes - np.eye(space.size))) < 1e-13
    assert np.max(np.abs(left) / np.sqrt(np.outer(real.p, real.p))) < 1e-11
    assert counters.rank_one_updates <= counters.statuses


# -- touches below the rounding of the scene -----------------------------------------------------


def row_of_masses(count, speed, damped=""):
    masses = [
        vf.Mass(1.0 + 0.1 * k, stiffness=1.0, damping=0.05 * (1 + k % 3) if damped == "masses" else 0.0, name=f"m{k}")
        for k in range(count)
    ]
    contacts = [
        vf.Contact(a, b, gap=0.0, stiffness=1e3, damping=float(damped == "contacts"), acts_on="penetration")
        for a, b in itertools.pairwise(masses)
    ]
    springs = [vf.Spring(a, b, stiffness=3.3) for a, b in itertools.pairwise(masses)]
    more = [vf.RayleighDamping(0.1, 1e-4)] if damped == "structure" else []
    return vf.Scene(masses, contacts + springs + more, initial={masses[0]: (0.0, speed)})


@pytest.mark.parametrize("method", METHODS)
def test_a_wave_through_touching_masses_closes_each_contact_once(method):
    # Ahead of the wave masses are at rest up to rounding; all methods find the same closings.
    result = vf.simulate(row_of_masses(20, 1.0), 0.5, method=method)
    closings = [contact.closings.size for contact in result.contacts.values()]
    assert closings == sorted(closings, reverse=True)
    assert (max(closings), sum(closings), result.counters.events) == (1, 19, 27)


@pytest.mark.parametrize("damped", ["masses", "contacts", "structure"])
@pytest.mark.parametrize("method", METHODS[:2])
def test_a_damped_wave_closes_each_contact_once(method, damped):
    """In complex modes too, rounding that stands at zero takes no part in the events of others."""
    result = vf.simulate(row_of_masses(20, 1.0, damped), 0.5, method=method)
    closings = [contact.closings.size for contact in result.contacts.values()]
    assert (min(closings), max(closings), result.counters.events) == (1, 1, 27)


@pytest.mark.parametrize("method", METHODS)
def test_masses_that_fall_together_do_not_touch(method):
    masses = [vf.Mass(m, stiffness=3.7 * m, name=f"m{k}") for k, m in enumerate((0.1, 0.3, 0.7, 1.7))]
    contacts = [vf.Contact(a, b, gap=0.0, stiffness=1e3, acts_on="penetration") for a, b in itertools.pairwise(masses)]
    result = vf.simulate(vf.Scene(masses, [*contacts, vf.Gravity(9.81)]), 2.5, method=method)
    assert result.counters.events == 0


def test_contacts_on_both_sides_of_bodies_at_rest_close_on_one():
    a, b = vf.Mass(1.0, stiffness=5.0, name="a"), vf.Mass(1.0, stiffness=7.0, name="b")
    both = [vf.Contact(a, b, gap=0.0, stiffness=1e4, acts_on="penetration", name="up"),
            vf.Contact(b, a, gap=0.0, stiffness=1e4, acts_on="penetration", name="down")]  # fmt: skip
    result = vf.simulate(vf.Scene([a, b], [*both, vf.PointLoad(a, vf.Sine(1.0, 7.0))]), 0.05, method="event_driven")
    assert (result.contacts["up"].closings.size, result.contacts["down"].closings.size) == (1, 0)
