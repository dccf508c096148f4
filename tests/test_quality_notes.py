"""Notes of runs on their own quality: energy, steps too large, contacts passed over, rounding, coarse meshes."""

import re

import numpy as np
import pytest
from scenes import alone, cantilever, on_stop

import vofem as vf
from vofem.integrators.rounding import static_loss


def told(result, kind):
    return [note for note in result.notes if note.startswith(kind)]


def oscillator(t_end, dt, **options):
    _, scene = alone(vf.Mass(1.0, stiffness=1.0), start=(1.0, 0.0))
    return vf.simulate(scene, t_end, dt=dt, **options)


@pytest.mark.parametrize("method", ["energy_conserving", "generalized_alpha", "central_difference"])
def test_well_resolved_runs_have_nothing_to_tell(method):
    assert oscillator(10.0, 0.05, method=method).notes == []


def test_energy_that_numerical_dissipation_takes():
    result = oscillator(39.0, 0.3, method="generalized_alpha", rho_infinity=0.0)
    (note,) = told(result, "energy:")
    assert f"{result.energy.balance_error:.2g} of the largest energy was lost by the steps" in note
    assert not told(oscillator(40.0, 0.3, method="energy_conserving"), "energy:")


@pytest.mark.parametrize(("dt", "expected"), [(0.4, 0), (0.6, 1), (30.0, 1), (1e6, 1)])
def test_steps_that_do_not_resolve_the_motion(dt, expected):
    """At omega dt beyond a half, however large."""
    assert len(told(oscillator(200.0 * dt, dt, method="energy_conserving"), "step: steps of")) == expected


def test_impacts_that_are_too_short_for_a_method_which_does_not_conserve_energy():
    """A hundredth of the energy of the run is at stake, and all of the motion of the body that rebounds."""
    large, small = vf.Mass(1.0, stiffness=1.0, name="large"), vf.Mass(1.0, name="small")
    stop = vf.Contact(small, gap=0.0101, stiffness=1e7, side="above", acts_on="penetration", name="stop")
    scene = vf.Scene([large, small], [stop], initial={large: (1.0, 0.0), small: (0.0, 0.1)})

    def speed(method, dt):
        result = vf.simulate(scene, 1.0, method=method, dt=dt)
        return -result.velocity(small)[-1], told(result, "step: impacts on contact 'stop'")

    wrong, notes = speed("generalized_alpha", 1e-3)
    assert abs(wrong - 0.1) > 0.02
    assert len(notes) == 1
    advised = float(notes[0].split("dt of ")[1].split()[0])
    for method, dt in (("generalized_alpha", advised), ("central_difference", advised), ("energy_conserving", 1e-3)):
        kept, notes = speed(method, dt)
        assert kept == pytest.approx(0.1, rel=0.02)
        assert notes == []


def beam_at_a_stop():
    """The second mode, which the stop excites, is seven times as quick as the load and loses phase in every period."""
    beam = cantilever(6)
    tip = beam.at(1.0)
    stop = vf.Contact(tip, gap=0.01, stiffness=100.0, side="below", acts_on="penetration", name="stop")
    return vf.Scene([beam], [stop, vf.PointLoad(tip, vf.Sine(0.1, 3.0))]), tip


@pytest.mark.parametrize(("method", "dt", "expected"), [
    ("energy_conserving", 0.01, 1), ("generalized_alpha", 0.01, 1), ("energy_conserving", 0.005, 1),
    ("energy_conserving", 1e-3, 0), ("generalized_alpha", 1e-3, 0), ("central_difference", 5e-4, 0),
])  # fmt: skip
def test_errors_of_steps_that_add_up(method, dt, expected):
    """Steps of 0.01 s lose one of five closings, and energy holds all the same."""
    scene, tip = beam_at_a_stop()
    times = np.linspace(0.0, 7.12, 713)
    right, result = vf.simulate(scene, 7.12, times=times), vf.simulate(scene, 7.12, method=method, dt=dt, times=times)
    size = np.abs(right.displacement(tip)).max()
    error = np.abs(result.displacement(tip) - right.displacement(tip)).max() / size
    notes = told(result, f"step: the errors of steps of {dt:g} s add up to")
    assert (error > 0.1) == bool(expected)
    assert len(notes) == expected
    if expected:
        # What the note says is the size of the error, up to what impacts make of it.
        assert 0.2 * error < float(notes[0].split("add up to ")[1].split()[0]) < 2.0 * error
        assert "contact 'stop'" in notes[0]


@pytest.mark.parametrize("method", ["energy_conserving", "generalized_alpha", "central_difference"])
def test_errors_of_steps_that_dampers_end(method):
    """Many periods of a damped oscillator at a stop: no error is older than a few."""
    mass, scene = on_stop(vf.Mass(1.0, stiffness=1.0, damping=0.2), gap=0.5, stiffness=30.0, load=vf.Sine(1.0, 0.8))
    times = np.linspace(0.0, 600.0, 6001)
    right = vf.simulate(scene, 600.0, times=times).displacement(mass)
    result = vf.simulate(scene, 600.0, method=method, dt=0.024, times=times)
    assert np.abs(result.displacement(mass) - right).max() < 0.02 * np.abs(right).max()
    assert told(result, "step:") == []


def test_rest_on_a_contact_is_no_motion():
    _, scene = on_stop(vf.Mass(1.0), vf.Gravity(1.0), gap=0.1, stiffness=50.0, side="below")
    result = vf.simulate(scene, 5.0, method="energy_conserving", dt=0.01, initial=vf.equilibrium(scene))
    assert result.notes == []


@pytest.mark.parametrize(("gap", "expected"), [(1.0 - 1e-9, 1), (1.0 + 1e-3, 0)])
def test_contacts_between_two_steps(gap, expected):
    _, scene = on_stop(vf.Mass(1.0, stiffness=1.0), gap=gap, stiffness=1e-9, start=(0.0, 1.0))
    result = vf.simulate(scene, 30.0, method="energy_conserving", dt=0.01)
    assert len(told(result, "contacts: 5 closings shorter than a step, the first of contact 'stop'")) == expected
    assert len(told(result, "contacts:")) == expected


@pytest.mark.parametrize(("load", "expected"), [
    (vf.Sine(1.0, 0.0, 0.5), "a Sine of PointLoad .* has the frequency 0 and is the constant 0.479"),
    (2.0 * (vf.Sine(1.0, frequency=0.0) + vf.Constant(1.0)), "has the frequency 0"),
    (vf.Tabulated([0.0, 0.5], [0.0, 3.0]), "ends at 0.5 s with the value 3, which the load keeps until"),
    (vf.Tabulated([0.0, 0.5, 0.6], [0.0, 3.0, 3.0]), None), (vf.Tabulated([0.0, 0.5], [2.0, 0.0]), None),
    (vf.Tabulated([0.0, 1.0], [0.0, 3.0]), None), (vf.Sine(1.0, 2.0), None), (vf.Constant(1.0), None),
])  # fmt: skip
def test_loads_that_are_hardly_meant(load, expected):
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1)
    result = vf.simulate(vf.Scene([mass], [vf.PointLoad(mass, load)]), 1.0)
    notes = told(result, "scene:")
    assert len(notes) == (expected is not None)
    assert all(re.search(expected, note) for note in notes)


@pytest.mark.parametrize(("ratio", "expected"), [(2.0, 1), ([0.02, 3.0], 1), (0.02, 0), (1.0, 0)])
def test_damping_in_percent(ratio, expected):
    mass = vf.Mass(1.0, stiffness=1.0)
    result = vf.simulate(vf.Scene([mass], [vf.ModalDamping(ratio)], {mass: (1.0, 0.0)}), 1.0)
    assert len(told(result, "scene: ModalDamping of")) == expected


@pytest.mark.parametrize(("damper", "expected"), [
    ({}, 1), ({"damping": 0.1}, 0), ({"stop": 0.1}, 0), ({"modal": 0.02}, 0),
])  # fmt: skip
def test_branches_without_damping(damper, expected):
    def build(omega):
        mass = vf.Mass(1.0, stiffness=1.0, damping=damper.get("damping", 0.0))
        stop = vf.Contact(mass, gap=0.8, stiffness=3.0, damping=damper.get("stop", 0.0), side="above",
                          acts_on="penetration", name="stop")  # fmt: skip
        more = [vf.ModalDamping(damper["modal"])] if "modal" in damper else []
        return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(0.5, omega)), *more])

    branch = vf.continuation(build, 3.0, 2.9)
    assert sum(note.startswith("scene: nothing damps the motion") for note in branch.notes) == expected


@pytest.mark.parametrize("method", ["shooting", "harmonic_balance"])
def test_a_branch_that_begins_at_the_frequency_zero(method):
    def build(omega):
        mass = vf.Mass(1.0, stiffness=1.0, damping=0.1)
        return vf.Scene([mass], [vf.PointLoad(mass, 2.0 * vf.Sine(0.5, omega))])

    with pytest.raises(vf.ArgumentError, match=r"has the frequency 0 here and is constant.* begin at a small positive"):
        vf.continuation(build, 0.0, 0.5, method=method)


@pytest.mark.parametrize(("elements", "expected"), [(100, 0), (4000, 1)])
@pytest.mark.parametrize("supports", [{"left": "clamped"}, {}])
def test_rounding_of_fine_meshes(elements, expected, supports):
    beam = vf.Beam(1.0, 1.0, 1.0, elements, supports)
    scene = vf.Scene([beam], [vf.PointLoad(beam.at(1.0), 1.0)])
    for method in ("energy_conserving", "generalized_alpha"):
        result = vf.simulate(scene, 0.01, method=method, dt=1e-3)
        assert len(told(result, "rounding: static responses are off by")) == expected


@pytest.mark.parametrize(("stiffness", "expected"), [(1e3, 0), (1e7, 1)])
@pytest.mark.parametrize("method", ["event_driven", "energy_conserving"])
def test_contacts_stiffer_than_the_mesh(stiffness, expected, method):
    beam = cantilever(25)
    stop = vf.Contact(beam.at(1.0), gap=0.03, stiffness=stiffness, side="below", acts_on="penetration", name="stop")
    result = vf.simulate(vf.Scene([beam], [stop]), 0.01, method=method)
    assert len(told(result, "resolution: contact 'stop' is 53 times stiffer than the mesh")) == expected
    assert len(told(result, "resolution:")) == expected


def test_a_blow_up_through_rounding_says_so():
    nodes = np.append(0.0, np.cumsum(np.geomspace(1.0, 1e-6, 13)))
    beam = vf.Beam(nodes[-1], 1.0, 1.0, nodes, {"left": "clamped"})
    scene = vf.Scene([beam], [vf.PointLoad(beam.at("right"), 1.0)])
    with pytest.raises(vf.InstabilityError, match=r"rounding spoils .* of static responses on this mesh"):
        vf.simulate(scene, 1.0, method="energy_conserving", dt=1e-3)
    with pytest.raises(vf.SingularSystemError, match="rounding has made the stiffness matrix indefinite"):
        vf.simulate(scene, 1.0, method="event_driven")


def test_one_step_under_a_load_that_begins_is_no_blow_up():
    """The velocity after the step holds half a step of the load, whose work is counted with the next half step."""
    beam = cantilever(25)
    scene = vf.Scene([beam], [vf.PointLoad(beam.at("right"), vf.Sine(0.1, 1.0))])
    result = vf.simulate(scene, 4.27e-5, method="central_difference", dt=4.27e-5)
    assert 0.0 < result.velocity(beam.at("right"))[-1] < 1e-6
    assert told(result, "step: the whole run")
    assert not told(result, "energy:")


@pytest.mark.kernels("plain")
@pytest.mark.parametrize("load", [1e3, vf.Sine(1e3, 20.0)])
def test_a_blow_up_under_a_load_is_still_found(load):
    mass = vf.Mass(1.0)
    spring = vf.NonlinearSpring(mass, potential=lambda u: 1e6 * u**4 / 4, force=lambda u: 1e6 * u**3, name="hard")
    scene = vf.Scene([mass], [spring, vf.PointLoad(mass, load)])
    with pytest.raises(vf.InstabilityError, match=r"blew up"):
        vf.simulate(scene, 0.3, method="central_difference", dt=0.1)


@pytest.mark.parametrize("size", [1e-50, 1e-170, 1e-300])
def test_events_of_tiny_motions(size):
    """Scaled by powers of two, motions of any size have the same events."""
    found = []
    for factor in (1.0, 2.0 ** int(np.log2(size))):
        mass = vf.Mass(1.0, stiffness=10.0)
        stop = vf.Contact(mass, gap=0.1 * factor, stiffness=50.0, side="above", acts_on="penetration", name="stop")
        load = vf.PointLoad(mass, vf.Sine(0.3 * factor, 2.0))
        scene = vf.Scene([mass], [stop, load], initial={mass: (-factor, 0.0)})
        found.append(vf.simulate(scene, 10.0).contacts["stop"].closings)
    assert found[0].size > 5
    assert found[1] == pytest.approx(found[0], rel=1e-14)


@pytest.mark.parametrize("h", [1.0, 1.001])
def test_elements_of_one_metre_tell_of_rounding(h):
    """Slopes are known by their kind, not by their length: that of an element of 1 m scales nothing."""
    beam = vf.Beam(10_000 * h, 1.0, 1.0, 10_000, {"left": "clamped"})
    system = vf.Scene([beam], [vf.PointLoad(beam.at("right"), 1.0)]).model.system
    assert np.array_equal(system.rotation[:4], [False, True] * 2)
    assert 0.5 * np.count_nonzero(system.rotation) == 5000
    assert 1e-3 < static_loss(system) < 1.0


def test_every_degree_of_freedom_is_a_displacement_or_a_rotation():
    beam, mass = vf.Beam(3.0, 1.0, 1.0, 2, {"left": "clamped"}), vf.Mass(1.0)
    system = vf.Scene([beam, mass]).model.system
    assert np.array_equal(system.rotation, [False, True, False, True, False])
