"""Nonlinear normal modes and Lyapunov exponents, against closed forms and independent orbits."""

import numpy as np
import pytest
from orbit_scenes import bilinear, nlvib_03
from reference_integration import Reference
from scenes import cantilever, on_stop, reference

import vofem as vf


def two_masses(gap):
    """P6 of the reference data: conservative, a stop on the second mass."""
    a, b = vf.Mass(1.0, stiffness=1.0, name="a"), vf.Mass(1.0, stiffness=1.0, name="b")
    stop = vf.Contact(b, gap=gap, stiffness=5.0, side="above", acts_on="penetration", name="stop")
    return vf.Scene([a, b], [vf.Spring(a, b, stiffness=1.0), stop])


@pytest.mark.parametrize("gap", ["0.5", "0"])
@pytest.mark.parametrize("mode", [1, 2])
def test_backbones_of_two_masses(gap, mode):
    known = reference("orbits/P6")
    name = f"gap{gap}_mode{mode}"
    scene = two_masses(float(gap))
    branch = vf.backbone(scene, mode, known[f"{name}_energy"])
    assert branch.omega == pytest.approx(known[f"{name}_omega"], rel=1e-9)
    assert branch.energy == pytest.approx(known[f"{name}_energy"], rel=1e-12)
    q0 = np.stack([branch.q0(body) for body in scene.bodies], axis=1)
    assert q0 == pytest.approx(known[f"{name}_q0"], abs=1e-9)
    for orbit, theirs in zip(branch.orbits, known[f"{name}_mult"], strict=True):
        assert orbit.residual < 1e-10
        # Two multipliers are 1; the other pair as it is.
        mine = sorted(orbit.multipliers, key=lambda z: abs(z - 1.0))[2:]
        other = sorted(theirs, key=lambda z: abs(z - 1.0))[2:]
        # Rounding of the double multiplier 1 reaches its neighbours where they nearly meet.
        for value in mine:
            assert min(abs(value - z) for z in other) < 1e-6 * max(1.0, abs(value))
        assert np.prod(orbit.multipliers) == pytest.approx(1.0, abs=1e-9)


def bilinear_mass(gap, stop, stiffness=1.0):
    return on_stop(vf.Mass(1.0, stiffness=stiffness), gap=gap, stiffness=stop)[1]


def test_a_bilinear_oscillator_without_gap():
    """2 w1 w2/(w1 + w2), whatever the energy."""
    expected = 2.0 * 1.0 * 3.0 / (1.0 + 3.0)
    assert vf.backbone(bilinear_mass(0.0, 8.0), 1, [0.3, 1.0, 7.0]).omega == pytest.approx(expected, rel=1e-14)


def test_code_aster_sdnd122():
    branch = vf.backbone(bilinear_mass(0.01, 50.0, 10.0), 1, [0.00650108331626])
    assert branch.omega / (2.0 * np.pi) == pytest.approx([0.646631040639837], rel=1e-13)
    step = 1e-6
    pair = vf.backbone(bilinear_mass(0.01, 50.0, 10.0), 1, [0.00650108331626 - step, 0.00650108331626 + step]).omega
    assert np.diff(pair)[0] / (2.0 * np.pi) / (2.0 * step) == pytest.approx(4.825329817803584, rel=1e-6)


def test_levels_by_amplitude_and_in_any_order():
    scene = bilinear_mass(0.01, 50.0, 10.0)
    by_energy = vf.backbone(scene, 1, [1.0, 1e-5, 1e-3])
    assert 2.0 * np.pi / by_energy.omega[[2, 0]] == pytest.approx([1.79568907330273, 1.410822462015287], rel=1e-13)
    # Below the gap it is linear.
    assert by_energy.omega[1] == pytest.approx(np.sqrt(10.0), rel=1e-14)
    amplitudes = -by_energy.q0(scene.bodies[0])
    assert np.all(amplitudes > 0.0)
    assert vf.backbone(scene, 1, amplitudes=amplitudes).omega == pytest.approx(by_energy.omega, rel=1e-12)


def test_the_amplitude_is_that_of_the_degree_of_freedom_that_is_largest_in_the_mode():
    """Beyond the gap the other mass, which no stop holds, moves farther."""
    a, b = vf.Mass(1.0, stiffness=1.0, name="a"), vf.Mass(1.02, stiffness=1.0, name="b")
    stop = vf.Contact(b, gap=1.0, stiffness=30.0, side="above", acts_on="penetration")
    branch = vf.backbone(vf.Scene([a, b], [vf.Spring(a, b, stiffness=0.7), stop]), 1, amplitudes=[0.5, 2.0])
    assert branch.q0(b) == pytest.approx([-0.5, -2.0], rel=1e-12)
    assert list(np.abs(branch.q0(a)) > np.abs(branch.q0(b))) == [False, True]


@pytest.mark.parametrize("amplitude", [5e-4, 1e-3, 0.02])
def test_the_amplitude_beside_a_stop_that_presses(amplitude):
    """Energies and frequencies follow from two parabolas; small ones begin on the side of the stop."""
    mass = vf.Mass(1.0, stiffness=10.0, name="m")
    stop = vf.Contact(mass, gap=-0.01, stiffness=50.0, side="above", acts_on="penetration")
    orbit = vf.backbone(vf.Scene([mass], [stop]), 1, amplitudes=[amplitude]).orbits[0]
    (begin,), (speed,) = orbit.state_of("m")
    assert (abs(begin), speed) == (pytest.approx(amplitude, rel=1e-12), pytest.approx(0.0, abs=1e-12))
    energy = 5.0 * begin**2 + 25.0 * max(begin + 0.01, 0.0) ** 2
    low, high = orbit.extremes(mass)
    for end in (low, high):
        assert 5.0 * end**2 + 25.0 * max(end + 0.01, 0.0) ** 2 == pytest.approx(energy, rel=1e-10)


def test_a_level_below_the_equilibrium_is_told():
    mass = vf.Mass(1.0, stiffness=10.0, name="m")
    stop = vf.Contact(mass, gap=-0.01, stiffness=50.0, side="above", acts_on="penetration")
    with pytest.raises(vf.ConvergenceError, match="below that of the equilibrium"):
        vf.backbone(vf.Scene([mass], [stop]), 1, energies=[4e-4])


def test_a_backbone_that_turns_in_energy():
    """The second mode grazes a stop of 50 N/m, and its energy falls before it grows: orbits beyond are free motions."""
    a, b = vf.Mass(1.0, stiffness=1.0, name="a"), vf.Mass(1.0, stiffness=1.0, name="b")
    stop = vf.Contact(b, gap=0.5, stiffness=50.0, side="above", acts_on="penetration", name="stop")
    scene = vf.Scene([a, b], [vf.Spring(a, b, stiffness=0.3), stop])
    branch = vf.backbone(scene, 2, [0.3, 0.6, 2.0])
    assert branch.energy == pytest.approx([0.3, 0.6, 2.0], rel=1e-12)
    # Below the stop the linear mode, beyond it a stiffer one.
    assert branch.omega[0] == pytest.approx(np.sqrt(1.6), rel=1e-12)
    assert branch.omega[0] < branch.omega[1] < branch.omega[2]
    for orbit in branch.orbits:
        start = vf.Scene(scene.bodies, scene.effects, initial=orbit)
        outcome = Reference(start, orbit.period).run()
        assert outcome.q[-1] == pytest.approx(start.initial_state().q, abs=1e-9)
        assert outcome.v[-1] == pytest.approx(0.0, abs=1e-9)


def test_a_level_that_is_not_reached():
    """The error says where the backbone turns, and holds what was found below."""
    a, b = vf.Mass(1.0, stiffness=1.0, name="a"), vf.Mass(1.0, stiffness=1.0, name="b")
    stop = vf.Contact(b, gap=0.5, stiffness=50.0, side="above", acts_on="penetration", name="stop")
    scene = vf.Scene([a, b], [vf.Spring(a, b, stiffness=0.3), stop])
    with pytest.raises(vf.ConvergenceError, match=r"energy followed up to 0\.4.*turns near 0\.4.*rad/s") as raised:
        vf.backbone(scene, 2, [0.6, 0.3, 0.2], max_points=20)
    below = raised.value.branch
    assert below.energy == pytest.approx([0.3, 0.2], rel=1e-12)
    assert below.omega == pytest.approx([np.sqrt(1.6)] * 2, rel=1e-12)
    assert len(below.orbits) == 2


def test_a_backbone_that_turns_into_itself_is_not_followed_back():
    """It came back to a motion of 1e-9 of its size, or the error advised more points; it ends in the second mode."""
    a, b = vf.Mass(1.0, stiffness=0.8, name="a"), vf.Mass(1.0, stiffness=2.9, name="b")
    stop = vf.Contact(b, gap=0.2, stiffness=240.0, side="above", acts_on="penetration", name="stop")
    scene = vf.Scene([a, b], [vf.Spring(a, b, stiffness=1.2), stop])
    with pytest.raises(vf.ConvergenceError, match=r"at 0\.73.* both instants of rest have become one") as raised:
        vf.backbone(scene, 1, [10.0])
    assert "max_points" not in str(raised.value)
    # The second mode has twice the frequency there.
    assert vf.backbone(scene, 2, [0.7366]).omega[0] == pytest.approx(2.0 * 1.4574651, rel=1e-4)


def test_an_oscillation_of_a_beam_conserves_and_returns():
    beam = cantilever(4, name="beam")
    tip = beam.at(1.0)
    scene = vf.Scene([beam], [vf.Contact(tip, gap=0.01, stiffness=5.0, side="below", acts_on="penetration")])
    branch = vf.backbone(scene, 1, [2e-4, 1e-3])
    assert np.all(branch.q0(tip) > 0.0)
    for orbit in branch.orbits:
        run = vf.simulate(scene, orbit.period, initial=orbit)
        assert run.displacement(tip)[-1] == pytest.approx(run.displacement(tip)[0], rel=1e-9)
        assert run.velocity(tip)[-1] == pytest.approx(0.0, abs=1e-8)
        assert run.energy.strain[0] == pytest.approx(branch.energy[list(branch.orbits).index(orbit)], rel=1e-10)


def test_scenes_that_are_not_conservative():
    with pytest.raises(vf.MethodError, match="PointLoad"):
        vf.backbone(bilinear(1.0), 1, [1.0])
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1)
    with pytest.raises(vf.MethodError, match="damping"):
        vf.backbone(vf.Scene([mass]), 1, [1.0])
    with pytest.raises(vf.ArgumentError, match="mode"):
        vf.backbone(bilinear_mass(0.0, 1.0), 2, [1.0])
    with pytest.raises(vf.ArgumentError, match="positive"):
        vf.backbone(bilinear_mass(0.0, 1.0), 1, [-1.0])
    with pytest.raises(vf.ArgumentError, match="either"):
        vf.backbone(bilinear_mass(0.0, 1.0), 1)
    with pytest.raises(vf.ArgumentError, match="forced"):
        _ = vf.continuation(bilinear, 1.5, 1.51).energy


# -- Lyapunov exponents -------------------------------------------------------------------------------


def test_exponents_on_a_stable_orbit_are_those_of_its_multipliers():
    scene = nlvib_03(0.635)
    orbit = vf.periodic(scene)
    start = vf.Scene(scene.bodies, scene.effects, initial=orbit)
    found = vf.lyapunov(start, 200.0 * orbit.period, count=4)
    expected = np.log(np.abs(orbit.multipliers)) / orbit.period
    assert found.exponents == pytest.approx(expected, abs=1e-3)
    assert np.all(np.abs(found.exponents - expected) <= 4.0 * found.error + 1e-4)
    # All dissipation: the sum is the trace.
    assert found.exponents.sum() == pytest.approx(-(0.03 + 0.03 + 0.03), abs=1e-10)


@pytest.mark.kernels("compiled")
def test_a_chaotic_oscillator_has_a_positive_exponent():
    """A hard stop between windows of periodic motion: two stretches of one motion agree, and nearby runs part."""
    mass, scene = on_stop(vf.Mass(1.0, stiffness=1.0, damping=0.1), gap=0.0, stiffness=100.0, load=vf.Sine(1.0, 2.8))
    found = vf.lyapunov(scene, 1500.0, skip=300.0)
    assert found.exponents[0] - 4.0 * found.error[0] > 0.0
    other = vf.lyapunov(scene, 2700.0, skip=1500.0)
    assert found.exponents[0] == pytest.approx(other.exponents[0], abs=4.0 * np.hypot(found.error[0], other.error[0]))
    # Runs that differ by 1e-10, over 60 s from many starts along the motion.
    starts = vf.simulate(scene, 400.0, times=np.linspace(100.0, 400.0, 31))
    period = 2.0 * np.pi / 2.8
    logs = []
    for t in starts.times:
        phase = t % period
        q, v = float(starts.displacement(mass, t)[0]), float(starts.velocity(mass, t)[0])
        runs = [
            vf.simulate(scene, 60.0, initial={mass: (q + shift, v)}, t_start=phase, times=[60.0])
            for shift in (0.0, 1e-10)
        ]
        away = [abs(runs[0].displacement(mass)[0] - runs[1].displacement(mass)[0]),
                abs(runs[0].velocity(mass)[0] - runs[1].velocity(mass)[0])]  # fmt: skip
        logs.append(np.log(np.hypot(*away) / 1e-10) / 60.0)
    assert np.mean(logs) == pytest.approx(found.exponents[0], abs=0.05)


def test_a_free_oscillation_is_not_taken_for_chaos():
    """Its frequency depends on its energy, so perturbations grow like t."""
    mass, scene = on_stop(vf.Mass(1.0, stiffness=10.0), gap=0.01, stiffness=50.0)
    free = vf.Scene([mass], scene.contacts, initial={mass: (-0.05, 0.0)})
    for skip in (0.0, 100.0):
        (exponent,) = vf.lyapunov(free, 1000.0, skip=skip).exponents
        assert 0.0 < exponent < np.log(np.sqrt(10.0) * (1000.0 - skip)) / (1000.0 - skip)


@pytest.mark.parametrize("stiffness", [0.5, 20.0])
def test_the_error_of_an_exponent_holds_what_growth_like_t_leaves_of_a_zero(stiffness):
    mass, scene = on_stop(vf.Mass(1.0, stiffness=1.0), gap=0.6, stiffness=stiffness)
    free = vf.Scene([mass], scene.contacts, initial={mass: (0.0, 1.0)})
    found = vf.lyapunov(free, 3000.0, skip=900.0)
    assert found.exponents[0] == pytest.approx(np.log(3000.0 / 900.0) / 2100.0, rel=0.3)
    assert found.exponents[0] < 1.3 * found.error[0]
    assert found.error[0] < 2.0 * np.log(3000.0 / 900.0) / 2100.0


def test_exponents_without_loads():
    mass = vf.Mass(1.0, stiffness=4.0, damping=0.4)
    found = vf.lyapunov(vf.Scene([mass], initial={mass: (1.0, 0.0)}), 100.0, count=2)
    assert found.exponents == pytest.approx([-0.2, -0.2], abs=0.02)
    assert found.exponents.sum() == pytest.approx(-0.4, abs=1e-12)


def test_bad_arguments():
    scene = bilinear(1.0)
    for level in (0.0, 1e-200):
        with pytest.raises(vf.ArgumentError, match="positive numbers of at least 1e-60"):
            vf.backbone(bilinear_mass(0.01, 50.0), 1, amplitudes=[level])
    with pytest.raises(vf.ArgumentError, match="count"):
        vf.lyapunov(scene, 10.0, count=3)
    with pytest.raises(vf.ArgumentError, match="skip"):
        vf.lyapunov(scene, 10.0, skip=10.0)
    with pytest.raises(vf.ArgumentError, match="t_end"):
        vf.lyapunov(scene, -1.0)


def test_a_backbone_on_which_the_motion_vanishes_ends_in_the_same_way_in_other_units(monkeypatch):
    """The size of the motion was that of displacements and half the period, in m and in s."""
    monkeypatch.setattr("vofem.studies.steady.following.follow._VANISHED", 0.9)
    told = []
    for length, time, mass in ((1.0, 1.0, 1.0), (2.0**10, 2.0**-10, 2.0**30)):
        stiffness = mass / time**2
        a = vf.Mass(0.6 * mass, stiffness=1.15 * stiffness, name="a")
        b = vf.Mass(mass, stiffness=0.52 * stiffness, name="b")
        stop = vf.Contact(
            a, gap=0.165 * length, stiffness=14.5 * stiffness, side="above", acts_on="penetration", name="stop"
        )
        scene = vf.Scene([a, b], [vf.Spring(a, b, stiffness=0.614 * stiffness), stop])
        with pytest.raises(vf.ConvergenceError) as caught:
            vf.backbone(scene, 1, energies=np.array([0.1, 0.6]) * stiffness * length**2)
        told.append(caught.value.branch.orbits)
        assert "the motion vanishes" in str(caught.value)
    assert len(told[0]) == len(told[1])
