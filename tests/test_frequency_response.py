"""The linear response over frequency, against closed forms and direct solutions; stroboscopic samples of runs."""

import numpy as np
import pytest
from scenes import alone, cantilever
from scipy.sparse import diags

import vofem as vf
from vofem.integrators.damping_matrix import damping_matrix
from vofem.lookup import rows_over
from vofem.system import Counters


def direct(scene, omega, point, closed=(), springpots=()):
    """Return the displacement of a point under the unit load of the scene, by one full solve."""
    model, system = scene.model, scene.model.system
    matrix = (system.stiffness - omega**2 * system.mass).astype(complex)
    damping = damping_matrix(system, Counters())
    if damping is not None:
        matrix = matrix + 1j * omega * damping
    for j in closed:
        laws = system.contacts
        row = laws.rows[[j]]
        matrix = matrix + row.T @ diags([laws.stiffness[j] + 1j * omega * laws.damping[j]]) @ row
    for j, (coefficient, order) in enumerate(springpots):
        row = system.laws[-1].rows[[j]]
        matrix = matrix + row.T @ diags([coefficient * (1j * omega) ** order]) @ row
    q = np.linalg.solve(matrix.toarray(), system.loads[0].vector)
    return (rows_over(model, scene.bodies, [point]) @ q)[0]


def beam_with_everything():
    beam = cantilever(10)
    mass = vf.Mass(0.3, stiffness=2.0, damping=0.05)
    effects = [
        vf.PointLoad(beam.at(0.63), vf.Sine(0.2, omega=1.0)),
        vf.Contact(beam.at(1.0), gap=0.1, stiffness=7.0, damping=0.3, acts_on="displacement", side="below", name="tip"),
        vf.Contact(beam.at(0.5), gap=0.1, stiffness=3.0, acts_on="penetration", side="above", name="middle"),
        vf.Spring(beam.at(1.0), mass, stiffness=1.5),
        vf.Dashpot(beam.at(0.41), damping=0.2),
        vf.Dashpot(beam.at(0.8), damping=0.05, of="rotation"),
        vf.RayleighDamping(alpha=0.02, beta=1e-3),
        vf.Springpot(beam.at(0.7), coefficient=0.4, order=0.37),
        vf.Springpot(beam.at(0.3), coefficient=0.1, order=0.8, of="rotation"),
    ]
    return vf.Scene([beam, mass], effects), beam, mass


@pytest.mark.parametrize("closed", [(), ("tip",), ("middle", "tip")])
def test_response_of_a_scene_with_everything_linear(closed):
    scene, beam, mass = beam_with_everything()
    frequencies = np.array([0.05, 0.4, 0.56, 3.0, 17.0])
    response = vf.frequency_response(scene, frequencies, closed)
    indices = [["tip", "middle"].index(name) for name in closed]
    for point in (beam.at(0.63), beam.at(0.77), mass):
        found = response.displacement(point)
        assert found.shape == (5,)
        expected = [
            direct(scene, 2 * np.pi * f, point, indices, [(0.4, 0.37), (0.1, 0.8)]) for f in frequencies.tolist()
        ]
        # The direct solution loses digits to the condition of K, 1e6 on this mesh.
        np.testing.assert_allclose(found, expected, rtol=3e-9)


def test_modal_damping_and_a_moment():
    beam = vf.Beam(length=2.0, EI=3.0, rhoA=1.5, elements=8, supports={"left": "pinned", "right": "pinned"})
    effects = [vf.PointMoment(beam.at("right"), vf.Sine(1.0, omega=3.0)), vf.ModalDamping([0.02, 0.05])]
    scene = vf.Scene([beam], effects)
    frequencies = np.linspace(0.1, 30.0, 7)
    found = vf.frequency_response(scene, frequencies).displacement(beam.at(0.6))
    expected = [direct(scene, 2 * np.pi * f, beam.at(0.6)) for f in frequencies.tolist()]
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def receptance(omega):
    """Return the tip displacement of a cantilever of unit EI, rhoA and length under a unit load at its tip."""
    x = np.sqrt(omega)
    return (np.cosh(x) * np.sin(x) - np.sinh(x) * np.cos(x)) / (x**3 * (1.0 + np.cosh(x) * np.cos(x)))


@pytest.mark.parametrize(("elements", "tolerance"), [(50, 2e-4), (2000, 1e-10)])
def test_cantilever_in_closed_form(elements, tolerance):
    beam = cantilever(elements)
    scene = vf.Scene([beam], [vf.PointLoad(beam.at(1.0), vf.Sine(0.3, omega=2.0))])
    frequencies = np.array([0.2, 1.0, 5.0, 12.3, 30.0])
    response = vf.frequency_response(scene, frequencies)
    found = response.displacement(beam.at(1.0))
    np.testing.assert_allclose(found, receptance(2 * np.pi * frequencies), rtol=tolerance)
    assert bool(response.notes) == (elements == 2000)
    assert abs(vf.frequency_response(scene, [0.0]).displacement(beam.at(1.0))[0] - 1.0 / 3.0) < 1e-10


def test_loads_as_the_scene_has_them():
    """The amplitude in m and the phase are those of a long run, in which the transient has died out."""
    a, b = vf.Mass(1.0, stiffness=2.0, damping=0.8), vf.Mass(2.0, stiffness=1.0, damping=1.2)
    effects = [vf.Spring(a, b, stiffness=1.0), vf.PointLoad(a, vf.Sine(0.3, frequency=0.2, phase=0.7)),
               vf.PointLoad(b, vf.Sine(-2.0, frequency=0.2, phase=0.1))]  # fmt: skip
    scene = vf.Scene([a, b], effects)
    response = vf.frequency_response(scene, [0.2], loads="scene").displacement(a)[0]
    times = np.linspace(200.0, 220.0, 101)
    run = vf.simulate(scene, 220.0, times=times).displacement(a)
    np.testing.assert_allclose(run, np.imag(response * np.exp(1j * 0.4 * np.pi * times)), atol=1e-9)
    unit = vf.frequency_response(scene, [0.2]).displacement(a)[0]
    assert response == pytest.approx(unit * 0.3 * np.exp(0.7j), rel=1e-13)
    with pytest.raises(vf.ArgumentError, match="loads is 'all', expected"):
        vf.frequency_response(scene, [0.2], loads="all")


def test_loads_act_together_in_the_ratio_of_their_amplitudes():
    a, b = vf.Mass(1.0, stiffness=2.0), vf.Mass(2.0, stiffness=1.0)
    loads = [
        vf.PointLoad(a, vf.Sine(0.5, omega=9.0)),
        vf.PointLoad(b, 3.0 * vf.Sine(0.5, omega=4.0, phase=np.pi / 2) + 1.0),
    ]
    response = vf.frequency_response(vf.Scene([a, b], loads), [0.1])
    omega = 2 * np.pi * 0.1
    np.testing.assert_allclose(response.displacement(a), 1.0 / (2.0 - omega**2), rtol=1e-14)
    np.testing.assert_allclose(response.displacement(b), 3.0j / (1.0 - 2.0 * omega**2), rtol=1e-14)


def test_a_load_of_negative_frequency_is_what_its_formula_says():
    """``sin(1 - omega t)`` is ``sin(omega t + pi - 1)``."""
    mass = vf.Mass(2.0, stiffness=3.0, damping=0.2, name="m")
    scene = vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(0.7, 2.0, 0.4)), vf.PointLoad(mass, vf.Sine(0.3, -2.0, 1.0))])
    force = 0.7 * np.exp(0.4j) + 0.3 * np.exp(1j * (np.pi - 1.0))
    response = vf.frequency_response(scene, [1.0 / np.pi], loads="scene").displacement(mass)
    np.testing.assert_allclose(response, force / (3.0 - 8.0 + 0.4j), rtol=1e-14)
    assert abs(response[0]) == pytest.approx(vf.periodic(scene).amplitude(mass), rel=1e-12)


def test_what_has_no_response_is_refused():
    mass = vf.Mass(1.0, stiffness=4.0, name="m")
    load = vf.PointLoad(mass, vf.Sine(1.0, omega=1.0))

    def refused(error, pattern, effects, frequencies=(1.0,), closed=(), body=mass):
        with pytest.raises(error, match=pattern):
            vf.frequency_response(vf.Scene([body], effects), frequencies, closed).displacement(body)

    refused(vf.ArgumentError, "no harmonic load", [])
    refused(vf.ArgumentError, "neither harmonic nor constant", [vf.PointLoad(mass, vf.Ramp(1.0))])
    refused(vf.ArgumentError, "neither harmonic nor constant", [vf.PointLoad(mass, np.sin)])
    refused(vf.ArgumentError, "several harmonics", [vf.PointLoad(mass, vf.Sine(1.0, 1.0) + vf.Sine(1.0, 2.0))])
    refused(vf.ArgumentError, "not negative", [load], frequencies=[-1.0])
    refused(vf.ArgumentError, "frequencies", [load], frequencies=[np.nan])
    refused(vf.ArgumentError, "no contact is named", [load], closed=["stop"])
    cubic = vf.NonlinearSpring(mass, potential=lambda u: u**4, force=lambda u: 4 * u**3)
    refused(vf.MethodError, "not linear", [load, cubic])
    # A stop in space pushes by the displacement of the base too: the answer without it was 4 times too small.
    shaken = vf.BaseMotion(mass, vf.Sine(1.0, 3.0), displacement=0.0, velocity=-1.0 / 3.0)
    stop = vf.Contact(mass, gap=0.1, stiffness=50.0, side="below", acts_on="penetration", frame="space", name="space")
    refused(vf.MethodError, "'space' sees the displacement of a base", [shaken, stop], closed=["space"])
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=2, supports={"left": "clamped"})
    refused(vf.ArgumentError, "travels", [vf.Spring(beam.along(vf.Path(1.0)), stiffness=1.0)], body=beam)
    varies = vf.Springpot(mass, coefficient=1.0, order=lambda t: 0.5 + 0.0 * t)
    refused(vf.ArgumentError, "varies in time", [load, varies])
    refused(vf.SingularSystemError, "natural frequency without damping", [load], frequencies=[1.0 / np.pi])
    free = vf.Mass(1.0)
    refused(
        vf.SingularSystemError, "rigid motion", [vf.PointLoad(free, vf.Sine(1.0, 1.0))], frequencies=[0.0], body=free
    )
    with pytest.raises(vf.ArgumentError, match="scene"):
        vf.frequency_response(3, [1.0])


def test_contacts_that_are_no_springs_are_not_held_closed():
    """A rigid stop and a contact that travels were taken for open where they were said to be closed."""
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=4, supports={"left": "clamped"}, name="beam")
    rigid = vf.RigidStop(beam.at(1.0), gap=0.1, restitution=0.5, side="below", name="rigid")
    path = beam.along(vf.Path(1.0))
    rides = vf.Contact(path, gap=0.1, stiffness=9.0, side="below", acts_on="penetration", name="rides")
    load = vf.PointLoad(beam.at(1.0), vf.Sine(1.0, 2.0))
    for effects, name, why in (([rigid, load], "rigid", "is rigid"), ([rides], "rides", "travels along a beam")):
        with pytest.raises(vf.ArgumentError, match=rf"modes: closed names .* '{name}', which {why}"):
            vf.modes(vf.Scene([beam], effects), closed=[name])
    with pytest.raises(vf.ArgumentError, match="frequency_response: closed names RigidStop 'rigid', which is rigid"):
        vf.frequency_response(vf.Scene([beam], [rigid, load]), [0.1], closed=["rigid"])


def test_stroboscopic_samples_are_those_of_the_motion():
    mass, scene = alone(vf.Mass(1.0, stiffness=1.0, damping=0.4), load=vf.Sine(1.0, omega=2.0))
    run = vf.simulate(scene, 200.0, times=[0.0, 200.0])
    section = vf.poincare(run, np.pi, phase=1.0, skip=50)
    response = vf.frequency_response(scene, [1.0 / np.pi]).displacement(mass)[0]
    assert len(section) == 14
    # Phase 1 of the period is phase 1 of the load sin(2 t).
    np.testing.assert_allclose(section.displacement(mass), (response * np.exp(1j)).imag, atol=1e-12)
    np.testing.assert_allclose(section.velocity(mass), 2.0 * (response * np.exp(1j)).real, atol=1e-12)


def test_samples_count_the_time_of_the_loads():
    _, scene = alone(vf.Mass(1.0, stiffness=1.0), load=vf.Sine(1.0, omega=2.0))
    run = vf.simulate(scene, 10.0, t_start=1.0)
    np.testing.assert_allclose(vf.poincare(run, 4.0).times + 1.0, [4.0, 8.0])
    np.testing.assert_allclose(vf.poincare(run, 4.0, phase=-np.pi).times + 1.0, [2.0, 6.0, 10.0])


def test_sections_that_cannot_be_are_refused():
    mass = vf.Mass(1.0, stiffness=1.0)
    run = vf.simulate(vf.Scene([mass], initial={mass: (1.0, 0.0)}), 10.0)
    for arguments in ({"period": 0.0}, {"period": 1.0, "skip": -1}, {"period": 1.0, "phase": np.nan}):
        with pytest.raises(vf.ArgumentError, match="poincare"):
            vf.poincare(run, **arguments)
    with pytest.raises(vf.ArgumentError, match="period is 12 s, but the run lasts 10 s"):
        vf.poincare(run, 12.0)
    assert len(vf.poincare(run, 10.0)) == 2
    with pytest.raises(vf.ArgumentError, match="none is left"):
        vf.poincare(run, 3.0, skip=4)
    with pytest.raises(vf.ArgumentError, match="expected what"):
        vf.poincare(3.0, 1.0)
