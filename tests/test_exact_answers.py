"""Closed-form answers: bilinear oscillators, impacts, chains, statics, contact as a spring."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scenes import published, quantity, two_masses
from scipy.optimize import brentq

import vofem as vf


def test_release_on_a_stop():
    """Half a period of the closed system, its peak force and impulse; published as code_aster SDND101."""
    mass = vf.Mass(100.0, stiffness=1e4)
    stop = vf.Contact(mass, gap=0.0, stiffness=1e6, side="above", acts_on="penetration", name="stop")
    scene = vf.Scene([mass], [stop], initial={mass: (0.0, 1.0)})
    result = vf.simulate(scene, 0.5)
    contact = result.contacts["stop"]
    assert contact.closings[0] == 0.0
    duration = contact.openings[0]
    assert duration == pytest.approx(np.pi / np.sqrt(1.01e6 / 100.0), rel=1e-12)
    assert duration == pytest.approx(0.0312600153, abs=1e-10)
    peak = 1e6 * result.displacement(mass, t=0.5 * duration)[0]
    assert peak == pytest.approx(9950.3719, abs=1e-4)
    nodes, weights = np.polynomial.legendre.leggauss(30)
    t = 0.5 * duration * (1.0 + nodes)
    impulse = 0.5 * duration * weights @ (1e6 * result.displacement(mass, t=t))
    assert impulse == pytest.approx(198.019802, abs=1e-6)

    case = published("ca_sdnd101_release_stop")
    second = 0.5 * (contact.closings[1] + contact.openings[1])
    for impact, time in (("impact 1", 0.5 * duration), ("impact 2", second)):
        q = quantity(case, "time_of_force_peak", impact)
        assert time == pytest.approx(q["value"], abs=q["tolerance"])
        q = quantity(case, "max_stop_force", impact)
        assert 1e6 * result.displacement(mass, t=time)[0] == pytest.approx(q["value"], abs=q["tolerance"])
    # The time and velocity of the second contact.
    q = quantity(case, "impact_duration")
    assert contact.openings[1] - contact.closings[1] == pytest.approx(q["value"], abs=q["tolerance"])
    leaving = result.velocity(mass, t=contact.openings[1])[0]
    q = quantity(case, "impact_velocity")
    assert leaving == pytest.approx(q["value"], abs=q["tolerance"])


def bilinear(energy, gap, k=10.0, k_stop=50.0, m=1.0):
    """Return the exact period of the oscillator with a one-sided stop at `gap`."""
    w1, w2 = np.sqrt(k / m), np.sqrt((k + k_stop) / m)
    if gap == 0.0:
        return np.pi * (1.0 / w1 + 1.0 / w2)
    amplitude = np.sqrt(2.0 * energy / k)
    rest = k * gap / (k + k_stop)
    speed = np.sqrt((2.0 * energy - k * gap**2) / m)
    return (2.0 / w1) * (0.5 * np.pi + np.arcsin(gap / amplitude)) + (2.0 / w2) * (
        0.5 * np.pi - np.arctan(rest * w2 / speed)
    )


@pytest.mark.parametrize(
    ("energy", "gap", "period"), [(1e-3, 0.01, 1.7956890733), (1.0, 0.01, 1.4108224620), (1.0, 0.0, None)]
)
def test_period_of_the_bilinear_oscillator(energy, gap, period):
    mass = vf.Mass(1.0, stiffness=10.0)
    stop = vf.Contact(mass, gap=gap, stiffness=50.0, side="above", acts_on="penetration", name="stop")
    start = -np.sqrt(2.0 * energy / 10.0)
    result = vf.simulate(vf.Scene([mass], [stop], initial={mass: (start, 0.0)}), 30.0)
    closings = result.contacts["stop"].closings
    measured = np.diff(closings)
    assert measured == pytest.approx(np.full(measured.shape, bilinear(energy, gap)), rel=1e-12)
    if period is not None:
        assert measured[0] == pytest.approx(period, abs=1e-10)


def test_frequency_at_a_given_energy_as_published():
    case = published("ca_sdnd122_bilinear_nnm")
    q = quantity(case, "frequency")
    energy = 0.00650108331626
    mass = vf.Mass(1.0, stiffness=10.0)
    stop = vf.Contact(mass, gap=0.01, stiffness=50.0, side="above", acts_on="penetration", name="stop")
    scene = vf.Scene([mass], [stop], initial={mass: (-np.sqrt(2.0 * energy / 10.0), 0.0)})
    closings = vf.simulate(scene, 20.0).contacts["stop"].closings
    frequency = 1.0 / np.diff(closings)[0]
    assert frequency == pytest.approx(q["value"], abs=q["tolerance"])
    assert frequency == pytest.approx(q["our_value"], rel=1e-9)


@pytest.mark.parametrize("zeta", [0.01, 0.1, 0.5])
def test_restitution_of_a_damped_stop(zeta):
    """A free mass on a Kelvin-Voigt stop that may pull leaves with exp(-pi zeta / sqrt(1 - zeta^2))."""
    stiffness = 1e4
    mass = vf.Mass(1.0)
    stop = vf.Contact(
        mass, gap=0.1, stiffness=stiffness, damping=2.0 * zeta * np.sqrt(stiffness), side="below",
        acts_on="penetration", name="stop",
    )  # fmt: skip
    result = vf.simulate(vf.Scene([mass], [stop], initial={mass: (0.0, -1.0)}), 0.5)
    restitution = np.exp(-np.pi * zeta / np.sqrt(1.0 - zeta**2))
    assert result.velocity(mass)[-1] == pytest.approx(restitution, rel=1e-10)
    if zeta == 0.1:
        assert restitution == pytest.approx(0.729248, abs=1e-6)
    assert result.energy.dissipated[-1] == pytest.approx(0.5 * (1.0 - restitution**2), rel=1e-10)
    assert result.contacts["stop"].closings == pytest.approx([0.1], rel=1e-14)
    # It pulls before it opens, as Eq. 12 has it.
    assert result.contacts["stop"].openings.size == 1


@pytest.mark.parametrize(
    ("case", "acts_on", "closing", "opening"),
    [
        ("b", "penetration", 12.328983786650, 14.115411317495),
        ("c", "penetration", 1.878224203370, 3.456593873995),
        ("c", "displacement", 1.878224203370, 2.610164648343),
    ],
)
def test_first_contact_of_two_masses(case, acts_on, closing, opening):
    _, _, scene = two_masses(case, acts_on)
    contact = vf.simulate(scene, 20.0).contacts["contact"]
    assert contact.closings[0] == pytest.approx(closing, abs=1e-11)
    assert contact.openings[0] == pytest.approx(opening, abs=1e-11)


def test_newtons_cradle():
    """Five masses: each impact is half a period of a pair, and overlaps with none."""
    count, gap, stiffness, speed = 5, 0.01, 1e6, 1.0
    masses = [vf.Mass(1.0) for _ in range(count)]
    contacts = [
        vf.Contact(a, b, gap=gap, stiffness=stiffness, acts_on="penetration", name=f"c{i}")
        for i, (a, b) in enumerate(pairwise(masses))
    ]
    result = vf.simulate(vf.Scene(masses, contacts, initial={masses[0]: (0.0, speed)}), 0.1)
    w = np.sqrt(2.0 * stiffness)
    # Each contact lasts pi/w, during which the struck mass already covers v pi/(2 w) of the next gap.
    leaves = gap / speed + np.pi / w + (count - 2) * (gap / speed + 0.5 * np.pi / w)
    assert result.contacts[f"c{count - 2}"].openings[0] == pytest.approx(leaves, rel=1e-10)
    speeds = [result.velocity(m)[-1] for m in masses]
    assert speeds == pytest.approx([0.0] * (count - 1) + [speed], abs=1e-10)


def test_bouncing_ball_as_published():
    case = published("ansys_vm65_ball")
    m, k, g, h = (case["parameters"][key] for key in ("m", "k", "g", "h"))
    ball = vf.Mass(m)
    stop = vf.Contact(ball, gap=h, stiffness=k, side="below", acts_on="penetration", name="stop")
    result = vf.simulate(vf.Scene([ball], [stop, vf.Gravity(g)]), 0.2)
    impact = result.contacts["stop"].closings[0]
    q = quantity(case, "impact_time")
    assert impact == pytest.approx(q["value"], abs=q["tolerance"])
    assert impact == pytest.approx(np.sqrt(2.0 * h / g), rel=1e-12)
    velocity = result.velocity(ball, t=impact)[0]
    q = quantity(case, "impact_velocity")
    assert velocity == pytest.approx(q["value"], abs=q["tolerance"])
    q = quantity(case, "kinetic_energy")
    assert 0.5 * m * velocity**2 == pytest.approx(q["value"], abs=q["tolerance"])


def test_rectangular_pulse_on_two_masses_as_published():
    case = published("ansys_vm182_pulse_2dof")
    p = case["parameters"]
    upper, lower = vf.Mass(p["m1"]), vf.Mass(p["m2"], stiffness=p["k2"])
    effects = [vf.Spring(upper, lower, stiffness=p["k1"]), vf.PointLoad(upper, vf.Pulse(50.0, 0.0, 1.8))]
    result = vf.simulate(vf.Scene([upper, lower], effects), 3.0, times=[0.0, 1.3, 2.4])
    for name, mass, index in (("Y1", upper, 1), ("Y2", lower, 1), ("Y1", upper, 2)):
        q = quantity(case, name, f"t={(1.3, 2.4)[index - 1]}")
        assert result.displacement(mass)[index] == pytest.approx(q["value"], abs=q["tolerance"])
        assert result.displacement(mass)[index] == pytest.approx(q["our_value"], abs=5e-6)


@pytest.mark.parametrize("zeta", [0.0, 0.7])
def test_impulse_response_as_published(zeta):
    case = published("ansys_vm74_impulse")
    m, k = case["parameters"]["m"], case["parameters"]["k"]
    mass = vf.Mass(m, stiffness=k, damping=2.0 * zeta * np.sqrt(k * m))
    result = vf.simulate(vf.Scene([mass], initial={mass: (0.0, 10.0 / m)}), 0.1, times=[0.0, 0.1])
    q = quantity(case, "y", f"t=0.1 zeta={0 if zeta == 0.0 else zeta}")
    assert result.displacement(mass)[-1] == pytest.approx(q["value"], abs=q["tolerance"])


def test_cantilever_that_hits_a_stop_as_published():
    """Kinetic energy 0.16 s after a step load, against a converged beam; the other numbers are scheme specific."""
    case = published("ca_sdnl104_cantilever_stop")
    p = case["parameters"]
    inertia, area = np.pi * p["R"] ** 4 / 4.0, np.pi * p["R"] ** 2
    beam = vf.Beam(p["L"], p["E"] * inertia, p["rho"] * area, 20, {"left": "clamped"})
    stop = vf.Contact(
        beam.at("right"), gap=p["gap"], stiffness=p["k_stop"], side="below", acts_on="penetration", name="stop"
    )
    result = vf.simulate(vf.Scene([beam], [stop, vf.PointLoad(beam.at("right"), -1000.0)]), 0.16)
    q = quantity(case, "kinetic_energy", "t=0.16 converged model")
    assert result.energy.kinetic[-1] == pytest.approx(q["value"], abs=q["tolerance"])
    assert result.contacts["stop"].closings[0] == pytest.approx(0.03614, abs=1e-5)
    assert result.contacts["stop"].openings[0] == pytest.approx(0.09256, abs=1e-5)


@pytest.mark.parametrize(("kappa", "root"), [(1.0, 2.0100033224), (1e3, 3.8978008052)])
def test_beam_with_a_closed_contact_at_its_tip(kappa, root):
    def characteristic(b):
        return b**3 * (1.0 + np.cos(b) * np.cosh(b)) + kappa * (np.sin(b) * np.cosh(b) - np.cos(b) * np.sinh(b))

    assert brentq(characteristic, root - 0.1, root + 0.1, xtol=1e-14) == pytest.approx(root, abs=1e-10)
    beam = vf.Beam(1.0, 1.0, 1.0, 25, {"left": "clamped"})
    stop = vf.Contact(beam.at(1.0), gap=0.03, stiffness=kappa, side="below", acts_on="displacement", name="stop")
    scene = vf.Scene([beam], [stop])
    assert np.sqrt(vf.modes(scene, 1, closed=["stop"]).omega[0]) == pytest.approx(root, rel=4e-7)
    assert np.sqrt(vf.modes(scene, 1).omega[0]) == pytest.approx(1.875104068712, rel=1e-7)


def test_a_preloaded_pair_at_zero_gap():
    first, second = vf.Mass(1.0, stiffness=1.0), vf.Mass(1.0, stiffness=1.0)
    contact = vf.Contact(first, second, gap=0.0, stiffness=2.0, acts_on="penetration")
    outcome = vf.equilibrium(vf.Scene([first, second], [contact, vf.PointLoad(first, 3.0)]))
    assert outcome.displacement(first) == pytest.approx(1.8, rel=1e-15)
    assert outcome.displacement(second) == pytest.approx(1.2, rel=1e-15)
