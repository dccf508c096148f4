"""Branches of symmetric scenes, whose contacts are grazed and switch together."""

from collections import Counter

import numpy as np
import pytest
from orbit_scenes import nlvib_03
from reference_integration import Reference
from scenes import between_stops

import vofem as vf


def between_two_stops(omega, acts_on="penetration", damping=0.0, load=0.2):
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="mass")
    law = {"gap": 0.5, "stiffness": 20.0, "damping": damping, "acts_on": acts_on}
    return between_stops(mass, load=vf.Sine(load, omega), **law)[1]


def twins(omega, count=2, damping=0.0):
    """Equal masses on equal stops under equal loads, with a spring between them; or one alone."""
    masses = [vf.Mass(1.0, stiffness=1.0, damping=0.1, name=name) for name in "ab"[:count]]
    effects = []
    for mass in masses:
        stop = {"gap": 0.5, "stiffness": 20.0, "damping": damping, "side": "above", "acts_on": "penetration"}
        effects += [vf.Contact(mass, name=f"stop {mass.name}", **stop), vf.PointLoad(mass, vf.Sine(0.8, omega))]
    if count > 1:
        effects += [vf.Spring(*masses, stiffness=0.3), vf.Dashpot(*masses, damping=0.1)]
    return vf.Scene(masses, effects)


def closes(scene, orbit):
    """Return how far an orbit is from closing in an integration of its own, m and m/s."""
    outcome = Reference(vf.Scene(scene.bodies, scene.effects, initial=orbit), orbit.period).run()
    assert outcome.why == "end"
    start = scene.model
    q, v = (np.concatenate([orbit.state_of(body.name)[k] for body in scene.bodies]) for k in range(2))
    assert start.system.size == q.size
    return max(np.abs(outcome.q[-1] - q).max(), np.abs(outcome.v[-1] - v).max())


@pytest.mark.parametrize("ends", [(0.7, 1.3), (0.95, 0.7)])
@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_both_stops_are_grazed_at_once(ends, damping):
    """The linear response reaches both stops at one frequency, in closed form; the branch goes on, symmetric."""
    branch = vf.continuation(lambda omega: between_two_stops(omega, damping=damping), *ends)
    assert branch.values[-1] == ends[1]
    grazings = [s for s in branch.special if s.kind == "grazing"]
    assert sorted(s.contact for s in grazings) == ["above", "below"]
    for point in grazings:
        w = point.value
        assert 0.2 / abs(1.0 - w**2 + 0.1j * w) == pytest.approx(0.5, abs=1e-12)
    scene = between_two_stops(0.7797, damping=damping)
    (orbit,) = branch.at(0.7797)
    assert [contact.closings.size for contact in orbit.result.contacts.values()] == [1, 1]
    least, largest = orbit.extremes(scene.bodies[0])
    assert largest == pytest.approx(-least, rel=1e-10)
    assert closes(scene, orbit) < 1e-10


def loaded(omega):
    return between_two_stops(omega, load=0.5)


def test_branch_points_and_steps_keep_their_digits_in_wide_intervals():
    """The places are those at which the map over half a period is singular, by exponentials of matrices and Brent."""
    branch = vf.continuation(loaded, 0.2, 4.5, max_points=40)
    points = [s.value for s in branch.special if s.kind == "branch_point"]
    assert points == pytest.approx([0.20741551135299474, 0.22284470799569073], rel=1e-13, abs=0.0)
    assert vf.continuation(loaded, 0.8, 1e6, max_points=40).values[-1] > 3.0


def test_a_closed_branch_does_not_list_its_own_begin_again():
    """What leaves at both branch points is one branch. From either it lists the other one alone."""
    branch = vf.continuation(loaded, 0.23, 0.2, max_points=100)
    points = [s for s in branch.special if s.kind == "branch_point"]
    for point, other in (points, points[::-1]):
        leaving = branch.switch(point)
        assert any("closed" in note for note in leaving.notes)
        listed = [s.value for s in leaving.special if s.kind == "branch_point"]
        assert listed == pytest.approx([other.value], rel=1e-13, abs=0.0)


def test_the_multipliers_beside_two_grazings():
    """Coordinates at an event of one contact give those of the state at t = 0, with dampers that switch too."""
    branch = vf.continuation(lambda omega: between_two_stops(omega, damping=0.5), 0.775, 0.785)
    for known in branch.orbits[4::3]:
        again = vf.periodic(known.scene, guess=known)
        assert known.multipliers == pytest.approx(again.multipliers, abs=1e-9)


def test_a_switched_branch_has_no_folds_of_rounding_beside_a_branch_point():
    """The branch of orbits that are not symmetric comes to its other end from both sides with the same list."""

    def build(omega):
        return nlvib_03(omega, 0.3, phase=0.0, sides=("above", "below"))

    branch = vf.continuation(build, 0.5, 0.57)
    first, last = (one for one in branch.special if one.kind == "branch_point")
    found = [branch.switch(one).special for one in (first, last)]
    for special in found:
        kinds = Counter(one.kind for one in special)
        assert kinds == {"period_doubling": 4, "grazing": 4, "branch_point": 1}
    (other,) = [one.value for one in found[0] if one.kind == "branch_point"]
    assert other == pytest.approx(last.value, rel=1e-10)


def test_two_masses_that_hit_at_the_same_times():
    """Grazings of both at once, and the folds of one mass alone."""
    alone = vf.continuation(lambda omega: twins(omega, 1), 0.72, 0.66)
    both = vf.continuation(twins, 0.72, 0.66)
    assert both.values[-1] == alone.values[-1] == 0.66
    grazings = {name: [s.value for s in both.special if s.contact == f"stop {name}"] for name in "ab"}
    known = [s.value for s in alone.special if s.kind == "grazing"]
    assert len(known) == 1
    for name in "ab":
        assert grazings[name] == pytest.approx(known, abs=1e-10)
    folds = [[s.value for s in branch.special if s.kind == "fold"] for branch in (alone, both)]
    assert len(folds[0]) == 2
    assert folds[1] == pytest.approx(folds[0], abs=1e-10)
    scene = twins(0.7)
    for orbit, single in zip(both.at(0.7), alone.at(0.7), strict=True):
        assert orbit.amplitude(scene.bodies[0]) == pytest.approx(orbit.amplitude(scene.bodies[1]), rel=1e-10)
        assert orbit.amplitude(scene.bodies[0]) == pytest.approx(single.amplitude(single.scene.bodies[0]), rel=1e-10)


def test_two_damped_contacts_that_switch_at_once():
    """Both dampers count in coordinates at the event of one: multipliers are those of the state at t = 0."""
    branch = vf.continuation(lambda omega: twins(omega, damping=0.6), 1.62, 1.6, max_points=32)
    assert [s.kind for s in branch.special][:2] == ["grazing", "grazing"]
    compared = [orbit for orbit in branch.orbits if orbit.result.contacts["stop a"].closings.size][2:20:4]
    assert len(compared) >= 3
    for known in compared:
        again = vf.periodic(known.scene, guess=known)
        assert known.multipliers == pytest.approx(again.multipliers, abs=1e-8)


def test_forces_that_jump_at_both_stops():
    """The linear response reaches both stops in closed form; the branch goes on with orbits that touch both."""
    branch = vf.continuation(lambda omega: between_two_stops(omega, "displacement"), 0.5, 1.3)
    assert branch.values[-1] == 1.3
    grazings = [s for s in branch.special if s.kind == "grazing"]
    assert sorted(s.contact for s in grazings) == ["above", "below"]
    for point in grazings:
        assert 0.2 / abs(1.0 - point.value**2 + 0.1j * point.value) == pytest.approx(0.5, abs=1e-12)
    later = [orbit for orbit in branch.orbits if orbit.omega > 0.79]
    for orbit in later[:: len(later) // 3]:
        assert [contact.closings.size for contact in orbit.result.contacts.values()] == [1, 1]
        assert closes(orbit.scene, orbit) < 1e-10
    # Orbits that are no mirror images of themselves branch off farther on.
    (point,) = (s for s in branch.special if s.kind == "branch_point")
    critical = point.orbit.multipliers[np.argmin(np.abs(point.orbit.multipliers - 1.0))]
    assert critical == pytest.approx(1.0, abs=1e-7)
