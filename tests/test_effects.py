"""Foundations, base motion, nonlinear springs; published cases that need them."""

import math

import numpy as np
import pytest

import vofem as vf
from vofem.assembly.bases import Base


def test_foundation_frequencies():
    """On a uniform foundation omega^2 = (n pi)^4 + k for a simply supported beam."""
    beam = vf.Beam(1.0, 1.0, 1.0, 30, {"left": "pinned", "right": "pinned"})
    wave = np.pi * np.arange(1, 4)
    for stiffness in (500.0, lambda x: np.full_like(x, 500.0)):
        scene = vf.Scene([beam], [vf.Foundation(beam, stiffness=stiffness)])
        assert vf.modes(scene, 3).omega == pytest.approx(np.sqrt(wave**4 + 500.0), rel=1e-5)
    free = vf.Beam(1.0, 1.0, 2.0, 8)
    omega = vf.modes(vf.Scene([free], [vf.Foundation(free, stiffness=50.0)]), 2).omega
    assert omega == pytest.approx([5.0, 5.0], rel=1e-10)


def test_one_sided_foundation_in_motion():
    """A beam dropped on it: contacts at every node, energy in balance, lift-off seen."""
    beam = vf.Beam(1.0, 0.05, 1.0, 8)
    bed = vf.Foundation(beam, stiffness=200.0, one_sided=True, gap=0.01, name="bed")
    result = vf.simulate(vf.Scene([beam], [bed, vf.Gravity(1.0)], {beam: (0.0, lambda x: -0.3 * x)}), 1.0)
    assert len(result.contacts) == 9
    assert result.counters.events > 9
    assert result.energy.balance_error < 1e-11
    assert any(c.openings.size for c in result.contacts.values())
    assert vf.explain(vf.Scene([beam], [bed])).effects[0].startswith("Foundation 'bed' under Beam")


def test_foundations_refuse_what_they_cannot_be():
    beam = vf.Beam(1.0, 1.0, 1.0, 4)
    with pytest.raises(vf.ArgumentError, match="a two-sided foundation has none; set one_sided"):
        vf.Foundation(beam, stiffness=1.0, gap=0.1)
    with pytest.raises(vf.ArgumentError, match="expected a Beam"):
        vf.Foundation(vf.Mass(1.0), stiffness=1.0)
    with pytest.raises(vf.ArgumentError, match=r"stiffness is -1\.0"):
        vf.Foundation(beam, stiffness=-1.0)
    with pytest.raises(vf.ArgumentError, match=r"stiffness is -.* at x = "):
        vf.equilibrium(vf.Scene([beam], [vf.Foundation(beam, stiffness=lambda x: x - 2.0)]))
    with pytest.raises(vf.ArgumentError, match="expected True or False"):
        vf.Foundation(beam, stiffness=1.0, one_sided="yes")


@pytest.mark.parametrize("method", ["event_driven", "central_difference"])
def test_base_motion_of_an_oscillator(method):
    """Relative motion under a constant base acceleration, and under a sine."""
    mass = vf.Mass(2.0, stiffness=8.0)
    step = {"dt": 1e-4} if method == "central_difference" else {}
    t = np.linspace(0.0, 5.0, 51)
    constant = vf.simulate(vf.Scene([mass], [vf.BaseMotion(mass, 3.0)]), 5.0, method=method, times=t, **step)
    assert constant.displacement(mass) == pytest.approx(-3.0 / 4.0 * (1 - np.cos(2 * t)), abs=1e-7)
    wave = vf.simulate(vf.Scene([mass], [vf.BaseMotion(mass, vf.Sine(1.0, 3.0))]), 5.0, method=method, times=t, **step)
    exact = -(np.sin(3 * t) - 1.5 * np.sin(2 * t)) / (4.0 - 9.0)
    assert wave.displacement(mass) == pytest.approx(exact, abs=1e-7)


def test_base_motion_of_a_beam_and_its_support():
    """In the rigid limit the support carries the inertia of the whole beam."""
    beam = vf.Beam(1.0, 1e6, 2.0, 4, {"left": "clamped"})
    scene = vf.Scene(
        [beam], [vf.BaseMotion(beam, vf.Ramp(0.1)), vf.PointMass(beam.at(1.0), mass=0.5), vf.ModalDamping(0.5)]
    )
    reaction = vf.simulate(scene, 10.0, times=[10.0]).reaction(beam, "left")
    assert reaction.force[0] == pytest.approx(2.5 * 1.0, rel=1e-4)
    assert reaction.moment[0] == pytest.approx(2.0 * 0.5 + 0.5, rel=1e-4)


def test_bodies_on_different_bases_cannot_be_joined_by_springs():
    a, b = vf.Mass(1.0, stiffness=1.0), vf.Mass(1.0, stiffness=1.0)
    spring = vf.Spring(a, b, stiffness=1.0)
    shake = vf.Sine(1.0, 1.0)
    with pytest.raises(vf.ArgumentError, match="only one has this BaseMotion"):
        vf.Scene([a, b], [spring, vf.BaseMotion(a, shake)])
    together = vf.Scene([a, b], [spring, vf.BaseMotion(a, shake), vf.BaseMotion(b, shake)])
    result = vf.simulate(together, 3.0)
    assert np.array_equal(result.displacement(a), result.displacement(b))
    with pytest.raises(vf.ArgumentError, match="expected a Beam or a Mass"):
        vf.BaseMotion(3.0, shake)


def test_supports_follow_one_motion():
    """Two motions of one base contradict each other; their sum is one motion."""
    body, other = vf.Mass(1.0, stiffness=4.0, name="body"), vf.Mass(1.0, stiffness=1.0, name="other")
    f, g = vf.Sine(1.0, 3.0), vf.Constant(0.5)
    with pytest.raises(vf.ArgumentError, match=r"BaseMotion of Mass 'body'.*cannot follow two motions.*f \+ g"):
        vf.Scene([body, other], [vf.BaseMotion(other, f), vf.BaseMotion(body, f), vf.BaseMotion(body, g)])
    scene = vf.Scene([body, other], [vf.BaseMotion(other, f), vf.BaseMotion(body, f + g)])
    t = np.linspace(0.0, 5.0, 11)
    expected = -0.125 * (1.0 - np.cos(2.0 * t)) - (np.sin(3.0 * t) - 1.5 * np.sin(2.0 * t)) / (4.0 - 9.0)
    np.testing.assert_allclose(vf.simulate(scene, 5.0, times=t).displacement(body), expected, atol=1e-14)


class Shaker:
    """The motion of a base, as an effect written outside."""

    def __init__(self, body, f):
        self.base = Base(body, f, 0.0, 0.0, "Shaker")

    def points(self):
        return ()

    def compile(self, builder):
        builder.add_acceleration(-1.0, self.base.acceleration, "Shaker", self.base.body)

    def describe(self):
        return "Shaker"


def test_bases_of_effects_written_outside_are_those_of_base_motions():
    mass, other, f = vf.Mass(1.0, 4.0, name="mass"), vf.Mass(1.0, 4.0, name="other"), vf.Sine(1.0, 2.0)
    with pytest.raises(vf.ArgumentError, match=r"Shaker: supports cannot follow two motions"):
        vf.Scene([mass], [vf.BaseMotion(mass, f), Shaker(mass, f)])
    with pytest.raises(vf.ArgumentError, match="joins bodies of which only one has this"):
        vf.Scene([mass, other], [Shaker(mass, f), vf.Spring(mass, other, stiffness=1.0)])
    with pytest.raises(vf.ArgumentError, match=r"Shaker: its body is not in the scene, which holds Mass 'mass'"):
        vf.Scene([mass], [Shaker(other, f)])
    stop = vf.Contact(mass, gap=0.1, stiffness=50.0, side="above", acts_on="penetration", frame="space", name="stop")
    built_in = vf.BaseMotion(mass, f, displacement=0.0, velocity=0.0)
    own, same = (vf.simulate(vf.Scene([mass], [one, stop]), 3.0) for one in (Shaker(mass, f), built_in))
    assert own.contacts["stop"].closings.size
    assert np.array_equal(own.displacement(mass), same.displacement(mass))


def test_a_nonlinear_spring_is_left_to_a_stepping_method():
    mass = vf.Mass(1.0)
    spring = vf.NonlinearSpring(mass, potential=lambda u: u**4 / 4, force=lambda u: u**3)
    assert vf.explain(vf.Scene([mass], [spring])).method == "energy_conserving"


def test_bistable_spring_conserves_energy():
    """A double well: V = (u^2 - 1)^2/4, two equilibria, snap-through above the barrier."""
    mass = vf.Mass(1.0)
    law = {"potential": lambda u: 0.25 * (u**2 - 1) ** 2, "force": lambda u: u**3 - u}
    stop = vf.Contact(mass, gap=1.2, stiffness=50.0, side="above", acts_on="penetration", name="stop")
    well = vf.NonlinearSpring(mass, **law, name="well")
    balances = []
    for dt in (4e-3, 2e-3):
        scene = vf.Scene([mass], [well], {mass: (-1.0, 0.9)})
        result = vf.simulate(scene, 20.0, method="central_difference", dt=dt)
        assert result.displacement(mass).max() > 1.0 > -1.0 > result.displacement(mass).min()
        balances.append(result.energy.balance_error)
        assert result.counters.law_evaluations >= 20.0 / dt
    assert balances[0] < 4e-5
    assert 3.5 < balances[0] / balances[1] < 4.5
    result = vf.simulate(vf.Scene([mass], [well, stop], {mass: (-1.0, 0.9)}), 20.0, dt=2e-3)
    assert result.contacts["stop"].closings.size >= 2
    assert result.energy.balance_error < 1e-4


def test_nonlinear_springs_are_refused_where_they_do_not_fit():
    mass = vf.Mass(1.0)
    cubic = {"potential": lambda u: u**4 / 4, "force": lambda u: u**3}
    scene = vf.Scene([mass], [vf.NonlinearSpring(mass, **cubic, name="hardening")])
    with pytest.raises(vf.MethodError, match=r"'hardening' is not piecewise linear.*energy_conserving"):
        vf.simulate(scene, 1.0, method="event_driven")
    with pytest.raises(vf.ArgumentError, match="'hardening' may have several equilibria"):
        vf.equilibrium(scene)
    with pytest.raises(vf.ArgumentError, match="'hardening' has no modes"):
        vf.modes(scene)
    with pytest.raises(vf.ArgumentError, match=r"expected force = dV/du"):
        vf.NonlinearSpring(mass, potential=lambda u: u**2, force=lambda u: -2 * u)
    with pytest.raises(vf.ArgumentError, match="expected a callable"):
        vf.NonlinearSpring(mass, potential=1.0, force=lambda u: u)


@pytest.mark.parametrize("size", [1.0, 1e-3, 1e-6, 1e-9])
def test_laws_of_any_length_are_taken(size):
    """Force and potential are compared at lengths of which these laws have many periods, or are not defined."""
    mass = vf.Mass(1.0)
    vf.NonlinearSpring(mass, potential=lambda u: -size * math.cos(u / size), force=lambda u: math.sin(u / size))
    vf.NonlinearSpring(mass, potential=lambda u: -size * math.log(size - u), force=lambda u: size / (size - u))


def test_a_stiffening_spring_that_blows_up_is_an_error():
    mass = vf.Mass(1.0)
    spring = vf.NonlinearSpring(mass, potential=lambda u: 1e6 * u**4 / 4, force=lambda u: 1e6 * u**3, name="hard")
    with pytest.raises(vf.InstabilityError, match=r"reduce dt"), np.errstate(all="ignore"):
        vf.simulate(vf.Scene([mass], [spring], {mass: (0.0, 100.0)}), 10.0, method="central_difference", dt=0.05)
