"""Gradients by one pass backward equal the forward derivatives."""

from typing import Any

import numpy as np
import pytest

import vofem as vf
from vofem import Parameter

pytestmark = pytest.mark.kernels("plain")


def beam_case() -> tuple[vf.Scene, list[Parameter], Any]:
    beam = vf.Beam(0.8, EI=[60.0] * 5, rhoA=[0.9] * 5, elements=5, supports={"left": "clamped"}, name="beam")
    tip = beam.at(0.8)
    one = vf.Contact(tip, gap=0.008, stiffness=2e4, damping=3.0, side="below", acts_on="penetration", name="one")
    two = vf.Contact(beam.at(0.5), gap=0.0045, stiffness=3e3, damping=5.0, side="above", acts_on="displacement",
                     name="two")  # fmt: skip
    load = vf.PointLoad(tip, vf.Sine(14.0, 38.0, phase=0.2) + vf.Ramp(20.0, 0.02, 0.15), name="load")
    scene = vf.Scene([beam], [one, two, load, vf.RayleighDamping(2.0, 4e-5, name="rayleigh"), vf.Gravity(name="g")])
    fields = [("one", "gap"), ("one", "stiffness"), ("one", "damping"), ("two", "gap"), ("two", "stiffness"),
              ("two", "x"), ("beam", "length"), ("load", "f.terms.0.amplitude"), ("load", "f.terms.0.omega"),
              ("load", "f.terms.0.phase"), ("load", "f.terms.1.slope"), ("rayleigh", "alpha"), ("rayleigh", "beta"),
              ("g", "g")]  # fmt: skip
    parameters = [Parameter(*pair) for pair in fields]
    parameters += [Parameter("beam", name, element=k) for name in ("EI", "rhoA") for k in range(5)]
    return scene, parameters, tip


def ball_case() -> tuple[vf.Scene, list[Parameter], Any]:
    ball = vf.Mass(1.0, name="ball")
    floor = vf.Contact(ball, gap=0.5, stiffness=5000.0, damping=3.0, side="below", acts_on="penetration", name="one")
    scene = vf.Scene([ball], [floor, vf.Gravity(name="g")], initial={ball: (0.1, 0.2)})
    fields = [("ball", "mass"), ("one", "gap"), ("g", "g"), ("ball", "initial.velocity"), ("one", "stiffness")]
    return scene, [Parameter(*pair) for pair in fields], ball


@pytest.mark.parametrize("case", [beam_case, ball_case])
def test_the_pass_backward_gives_the_forward_derivatives(case: Any) -> None:
    scene, parameters, point = case()
    t_end = 0.2 if case is beam_case else 1.2
    run = vf.simulate(scene, t_end, times=[0.5 * t_end, t_end], method="event_driven")
    d = vf.sensitivities(run, parameters)
    impacts = d.contacts["one"].impacts
    times = np.linspace(0.05, t_end, 9)
    data = np.zeros(9)
    u, moved = run.displacement(point, times), d.displacement(point, times)
    pairs = {
        "squares": (vf.objectives.sum_of_squares(point, times, data), 2.0 * u @ moved),
        "peak": (vf.objectives.peak_force("one", 1), impacts.peak_force[0]),
        "last peak": (vf.objectives.peak_force("one", len(impacts)), impacts.peak_force[-1]),
        "impulse": (vf.objectives.impulse("one", 2), impacts.impulse[1]),
        "dissipated": (vf.objectives.dissipated(), d.energy.dissipated[-1]),
        "own": (
            vf.objectives.of_motion([point], times[-1:], lambda x: (float(np.sum(x**3)), 3.0 * x**2)),
            3.0 * u[-1] ** 2 * moved[-1],
        ),
    }
    for name, (objective, right) in pairs.items():
        found = vf.gradient(run, objective, parameters)
        # Relative to the largest entry, and with each parameter counted by its own size.
        size = np.abs([parameter.value(scene) for parameter in parameters])
        for unit in (np.ones_like(size), np.where(size > 0.0, size, 1.0)):
            assert np.max(np.abs(found - right) * unit) < 1e-12 * np.max(np.abs(right) * unit), name


def test_overdamped_modes_cost_no_points_once_they_have_decayed() -> None:
    """The fastest mode decays at 3e5/s: points for it all along would take hours."""
    beam = vf.Beam(1.0, EI=1.0, rhoA=1.0, elements=10, supports={"left": "clamped"}, name="beam")
    stop = vf.Contact(beam.at(1.0), gap=0.03, stiffness=10.0, side="below", acts_on="penetration", name="stop")
    damping = vf.RayleighDamping(0.1, 0.01, name="rayleigh")
    scene = vf.Scene([beam], [stop, damping, vf.PointLoad(beam.at(1.0), vf.Sine(0.05, 4.5), name="load")])
    result = vf.simulate(scene, 3.0, method="event_driven", times=[0.0, 3.0], progress=False)
    parameters = [Parameter("stop", "gap"), Parameter("rayleigh", "beta"), Parameter("load", "f.omega")]
    forward = vf.sensitivities(result, parameters)
    impulse = vf.gradient(result, vf.objectives.impulse("stop", 1), parameters)
    assert impulse == pytest.approx(forward.contacts["stop"].impacts.impulse[0], rel=1e-9)
    energy = vf.gradient(result, vf.objectives.dissipated(), parameters)
    assert energy == pytest.approx(forward.energy.dissipated[-1], rel=1e-9)
    # A difference of runs, for the points themselves.
    moved = [
        vf.simulate(parameters[1].changed(scene, step), 3.0, method="event_driven", times=[3.0], progress=False)
        for step in (-1e-6, 1e-6)
    ]
    slope = (moved[1].energy.dissipated[-1] - moved[0].energy.dissipated[-1]) / 2e-6
    assert energy[1] == pytest.approx(slope, rel=1e-6)


def test_an_impulse_that_ends_when_a_resting_contact_is_released() -> None:
    mass = vf.Mass(1.0, stiffness=10.0, damping=2.0, name="mass")
    stop = vf.Contact(mass, gap=0.1, stiffness=200.0, side="above", acts_on="displacement", name="stop")
    load = vf.PointLoad(mass, vf.Constant(6.0) + vf.Sine(7.0, 0.15), name="load")
    scene = vf.Scene([mass], [stop, load])
    run = vf.simulate(scene, 30.0, times=[30.0], method="event_driven", pin_fraction=1e-3)
    contact = run.contacts["stop"]
    # The contact rests at its gap until the load is no larger than the force of the mass's own spring there.
    released = float(contact.pinned[0, 1])
    assert 6.0 + 7.0 * np.sin(0.15 * released) == pytest.approx(10.0 * 0.1, abs=1e-9)
    last = len(contact.impacts)
    assert contact.impacts.opening[last - 1] == released
    parameters = [Parameter("stop", "gap"), Parameter("mass", "mass"), Parameter("mass", "stiffness"),
                  Parameter("load", "f.terms.1.amplitude"), Parameter("load", "f.terms.1.omega")]  # fmt: skip
    d = vf.sensitivities(run, parameters).contacts["stop"].impacts
    # 7 cos(0.15 t) 0.15 dt = 10 dgap
    rate = 7.0 * 0.15 * np.cos(0.15 * released)
    assert np.allclose(d.opening[-1, :3], [10.0 / rate, 0.0, 0.1 / rate], atol=1e-10)
    for objective, right in ((vf.objectives.impulse("stop", last), d.impulse[-1]),
                             (vf.objectives.peak_force("stop", last), d.peak_force[-1])):  # fmt: skip
        found = vf.gradient(run, objective, parameters)
        assert np.max(np.abs(found - right)) < 1e-12 * np.max(np.abs(right))


def test_wrong_objectives_are_refused() -> None:
    scene, parameters, point = ball_case()
    run = vf.simulate(scene, 0.6, method="event_driven")
    with pytest.raises(vf.ArgumentError, match=r"expected one of vofem\.objectives"):
        vf.gradient(run, "peak", parameters)  # type: ignore[arg-type]
    with pytest.raises(vf.ArgumentError, match="the run has 1"):
        vf.gradient(run, vf.objectives.peak_force("one", 2), parameters)
    with pytest.raises(vf.ArgumentError, match="outside of the run"):
        vf.gradient(run, vf.objectives.sum_of_squares(point, [2.0], [0.0]), parameters)
    stepped = vf.simulate(scene, 0.1, method="energy_conserving", dt=0.01)
    with pytest.raises(vf.MethodError, match="event_driven"):
        vf.gradient(stepped, vf.objectives.dissipated(), parameters)
