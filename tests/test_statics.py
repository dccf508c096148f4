"""Equilibrium with contact."""

import pytest

import vofem as vf


def cantilever(load, acts_on="displacement", gap=0.03, stiffness=1.0):
    beam = vf.Beam(1.0, 1.0, 1.0, 10, {"left": "clamped"})
    stop = vf.Contact(beam.at(1.0), gap=gap, stiffness=stiffness, side="below", acts_on=acts_on, name="stop")
    return beam, vf.Scene([beam], [stop, vf.PointLoad(beam.at(1.0), -load)])


@pytest.mark.parametrize(
    ("load", "status", "tip", "force"),
    [
        (0.08, "open", -0.08 / 3.0, 0.0),
        (0.10, "pinned", -0.03, 0.10 - 0.09),
        (0.12 - 1e-9, "pinned", -0.03, 0.03 - 1e-9),
        (0.15, "closed", -0.15 / 4.0, 0.15 / 4.0),
    ],
)
def test_jump_law_pins_between_its_two_equilibria(load, status, tip, force):
    """Tip loads between 0.09 and 0.12 N have neither an open nor a closed equilibrium."""
    beam, scene = cantilever(load)
    outcome = vf.equilibrium(scene)
    stop = outcome.contacts["stop"]
    assert stop.status == status
    assert stop.pinned == (status == "pinned")
    assert bool(outcome.notes) == stop.pinned
    assert outcome.displacement(beam.at(1.0)) == pytest.approx(tip, rel=1e-10)
    assert stop.force == pytest.approx(force, abs=1e-11)


def test_penetration_law_always_has_one():
    beam, scene = cantilever(0.10, "penetration")
    outcome = vf.equilibrium(scene)
    # (K + K0) u = F + K0 gap
    assert outcome.displacement(beam.at(1.0)) == pytest.approx(-0.13 / 4.0, rel=1e-10)
    assert outcome.contacts["stop"].force == pytest.approx(0.1 - 3 * 0.13 / 4, rel=1e-9)
    assert outcome.deflection([0.5])[0] == pytest.approx(-(0.0975 * 0.25 * 2.5) / 6.0, rel=1e-9)
    assert outcome.shear_force([0.5])[0] == pytest.approx(3 * 0.13 / 4, rel=1e-8)
    assert outcome.bending_moment([0.5])[0] == pytest.approx(-0.5 * 3 * 0.13 / 4, rel=1e-8)


def test_loads_are_taken_at_the_time_asked_for():
    beam = vf.Beam(1.0, 1.0, 1.0, 4, {"left": "clamped"})
    scene = vf.Scene([beam], [vf.PointLoad(beam.at(1.0), vf.Ramp(3.0))])
    assert vf.equilibrium(scene, t=2.0).displacement(beam.at(1.0)) == pytest.approx(2.0, rel=1e-10)
    assert vf.equilibrium(scene).displacement(beam.at(1.0)) == 0.0


def test_uniform_load_on_a_simply_supported_beam():
    beam = vf.Beam(2.0, 5.0, 3.0, 12, {"left": "pinned", "right": "pinned"})
    outcome = vf.equilibrium(vf.Scene([beam], [vf.Gravity(10.0)]))
    assert outcome.deflection([1.0])[0] == pytest.approx(-5 * 30.0 * 2.0**4 / (384 * 5.0), rel=1e-10)
    point = vf.equilibrium(vf.Scene([beam], [vf.PointMoment(beam.at(2.0), 4.0)]))
    assert point.slope([2.0])[0] == pytest.approx(4.0 * 2.0 / (3 * 5.0), rel=1e-10)


def test_gravity_acts_on_point_masses_too():
    beam = vf.Beam(1.0, 1.0, 1e-9, 4, {"left": "clamped"})
    scene = vf.Scene([beam], [vf.Gravity(10.0), vf.PointMass(beam.at(1.0), mass=0.3)])
    assert vf.equilibrium(scene).displacement(beam.at(1.0)) == pytest.approx(-1.0, rel=1e-6)


def test_points_are_resolved_by_name_and_x():
    """A point of another beam of the same name, with another mesh, means the same place."""
    beam = vf.Beam(1.0, 1.0, 1.0, 4, {"left": "clamped"}, name="deck")
    finer = vf.Beam(1.0, 1.0, 1.0, 9, {"left": "clamped"}, name="deck")
    outcome = vf.equilibrium(vf.Scene([beam], [vf.PointLoad(beam.at(1.0), 3.0)]))
    assert outcome.displacement(finer.at(1.0)) == outcome.displacement(beam.at(1.0)) == pytest.approx(1.0)
    with pytest.raises(vf.ArgumentError, match=r"expected beam\.at"):
        outcome.displacement(0.5)


def test_an_equilibrium_says_what_it_is():
    mass = vf.Mass(1.0, stiffness=1.0)
    stop = vf.Contact(mass, gap=1.0, stiffness=1.0, side="above", acts_on="displacement")
    words = {0.5: "0 of 1 contacts closed", 1.5: "0 of 1 contacts closed, 1 pinned", 9.0: "1 of 1 contacts closed"}
    for load, said in words.items():
        assert repr(vf.equilibrium(vf.Scene([mass], [stop, vf.PointLoad(mass, load)]))) == f"Equilibrium({said})"
    assert repr(vf.equilibrium(vf.Scene([mass], [vf.PointLoad(mass, 1.0)]))) == "Equilibrium(no contacts)"


@pytest.mark.parametrize("contact", [False, True])
def test_a_buckled_beam_has_no_equilibrium_to_be_returned(contact):
    """Beyond the critical force, pi^2 EI/L^2, what the equations give is a maximum of the energy, against the load."""
    found = []
    for tension in (-9.8, -9.88):
        beam = vf.Beam(
            1.0, EI=1.0, rhoA=1.0, elements=10, supports=dict.fromkeys(("left", "right"), "pinned"), tension=tension
        )
        stop = vf.Contact(beam.at(0.5), gap=9.0, stiffness=1e3, side="above", acts_on="penetration")
        scene = vf.Scene([beam], [vf.PointLoad(beam.at(0.5), 0.3), *[stop] * contact])
        if tension > -9.8696:
            found.append(vf.equilibrium(scene).displacement(beam.at(0.5)))
            continue
        for answer in (lambda of=scene: vf.equilibrium(of), lambda of=scene: vf.quasi_static(of, [0.0, 1.0])):
            with pytest.raises(vf.SingularSystemError, match="has buckled"):
                answer()
    assert found[0] > 0.0
