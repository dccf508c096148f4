"""Notes depend on the run alone: they are the same word for word whatever times are wanted."""

import numpy as np
import pytest
from scenes import alone, cantilever, on_stop

import vofem as vf
from vofem.integrators.stepping.checks import check_times

STEPPING = ("energy_conserving", "generalized_alpha", "central_difference")


def oscillator():
    mass = vf.Mass(1.0, stiffness=1.0, name="m")
    return vf.Scene([mass], initial={mass: (1.0, 0.0)})


def stop(mass, **changes):
    given = {"gap": 0.5, "stiffness": 1e4, "side": "above", "acts_on": "penetration", "name": "stop"}
    return vf.Contact(mass, **(given | changes))


def bouncing(stiffness=1e4, gap=0.5, acts_on="penetration"):
    mass = vf.Mass(1.0, stiffness=1.0, name="m")
    above = stop(mass, stiffness=stiffness, gap=gap, acts_on=acts_on)
    return vf.Scene([mass], [above], initial={mass: (0.0, 1.0)})


def driven():
    """Between two stops, chaotic."""
    mass = vf.Mass(1.0, stiffness=1.0, name="m")
    stops = [stop(mass, stiffness=1e3, gap=0.1), stop(mass, stiffness=1e3, gap=0.3, side="below", name="below")]
    return vf.Scene([mass], [*stops, vf.PointLoad(mass, vf.Sine(3.0, 2.7))])


def fine_beam():
    beam = cantilever(4000, name="b")
    return vf.Scene([beam], [vf.PointLoad(beam.at(1.0), 1.0)])


def stiff_tip():
    beam = cantilever(25, name="b")
    return on_stop(beam.at(1.0), gap=0.03, stiffness=1e7, side="below")[1]


#: Scene, end of the run, arguments, and how a note begins that the run must leave.
CASES = {
    "energy lost": (
        oscillator, 39.0, {"method": "generalized_alpha", "dt": 0.3, "rho_infinity": 0.0}, "energy: by t = ",
    ),
    "steps too large": (oscillator, 40.0, {"method": "energy_conserving", "dt": 0.9}, "step: steps of 0.9 s"),
    "too large in contact alone": (
        lambda: bouncing(1e10), 9.7, {"method": "energy_conserving", "dt": 1e-3}, "step: steps of 0.001 s",
    ),
    "too large with dissipation": (
        lambda: bouncing(1e6), 9.7, {"method": "generalized_alpha", "dt": 1e-3}, "step: steps of 0.001 s",
    ),
    "explicit": (lambda: bouncing(1e4), 9.7, {"method": "central_difference", "dt": 0.012}, "step: steps of 0.012 s"),
    "passed over": (
        lambda: bouncing(1e-9, 1.0 - 1e-9), 30.0, {"method": "energy_conserving", "dt": 0.01},
        "contacts: 5 closings shorter than a step",
    ),
    "never closed": (
        lambda: bouncing(gap=30.0), 9.7, {"method": "central_difference", "dt": 0.01},
        "contacts: contact 'stop' never closed: at its nearest it came within 29 m",
    ),
    "never closed, no steps": (
        lambda: bouncing(gap=30.0), 9.7, {"method": "event_driven"},
        "contacts: contact 'stop' never closed: at its nearest it came within 29 m",
    ),
    "one step": (oscillator, 1.0, {"method": "energy_conserving", "dt": 1.0}, "step: the whole run of 1 s is one step"),
    "one step and more": (oscillator, 1.0, {"method": "generalized_alpha", "dt": 3.0}, "step: the whole run of 1 s is"),
    "chatter": (lambda: bouncing(acts_on="displacement"), 3.0, {"method": "energy_conserving", "dt": 0.01}, "chatter:"),
    "chaos": (driven, 400.0, {"method": "event_driven"}, "chaos: "),
    "rounding": (fine_beam, 0.01, {"method": "energy_conserving", "dt": 1e-3}, "rounding: static responses are off"),
    "mesh": (stiff_tip, 0.01, {"method": "generalized_alpha", "dt": 1e-5}, "resolution: contact 'stop'"),
    "following a tolerance": (lambda: bouncing(1e3), 9.7, {"method": "energy_conserving", "tol": 1e-3}, ""),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_notes_are_the_same_whatever_times_are_wanted(case):
    build, t_end, arguments, beginning = CASES[case]
    scene = build()
    notes = vf.simulate(scene, t_end, **arguments).notes
    assert any(note.startswith(beginning) for note in notes) or not beginning
    for times in (np.linspace(0.0, t_end, 401), np.linspace(0.0, t_end, 98), [0.0, t_end], [t_end / np.pi]):
        assert vf.simulate(scene, t_end, times=times, **arguments).notes == notes


def test_one_step_is_far_from_right():
    """0.044 m instead of 0.178: a mass of 1 kg on a spring of 20 N/m, pushed with 2 N for a second."""
    mass, scene = alone(vf.Mass(1.0, stiffness=4.0), load=1.0)
    result = vf.simulate(scene, 3.0, method="energy_conserving", dt=3.0)
    exact = 0.25 * (1.0 - np.cos(6.0))
    assert abs(result.displacement(mass)[-1] - exact) > 0.5 * exact
    assert result.notes[0].startswith("step: the whole run of 3 s is one step of 3 s")
    assert not vf.simulate(scene, 3.0, method="energy_conserving", dt=0.01).notes


@pytest.mark.parametrize(("gap", "told"), [(0.9, False), (9.9, False), (10.1, True)])
@pytest.mark.parametrize("method", ["event_driven", *STEPPING])
def test_contacts_that_never_close(gap, told, method):
    """The mass reaches 1 m; told is of gaps of more than ten times that, and by how much it missed the gap."""
    step = {} if method == "event_driven" else {"dt": 0.01}
    notes = vf.simulate(bouncing(gap=gap), 9.7, method=method, **step).notes
    notes = [note for note in notes if "never closed" in note]
    assert bool(notes) == told
    if told:
        assert f"came within {gap - 1.0:.4g} m of closing, its gap being {gap:.4g} m" in notes[0]


def test_a_representation_counts_notes():
    assert "notes" not in repr(vf.simulate(oscillator(), 1.0, method="energy_conserving", dt=0.01))
    assert ", 2 notes: see .notes)" in repr(vf.simulate(oscillator(), 1.0, method="energy_conserving", dt=1.0))


@pytest.mark.parametrize("method", STEPPING)
def test_results_do_not_depend_on_what_a_run_looks_at(method):
    """Stored states, energies and hysteretic springs belong to the wanted times alone."""
    mass = vf.Mass(1.0, stiffness=4.0, name="m")
    spring = vf.BilinearSpring(mass, stiffness=5.0, linear_limit=0.1, hardening=0.2, name="s")
    scene = vf.Scene([mass], [spring, stop(mass, gap=0.3)], initial={mass: (0.0, 1.0)})
    whole = vf.simulate(scene, 3.0, method=method, dt=0.005)
    part = vf.simulate(scene, 3.0, method=method, dt=0.005, times=[0.5, 1.0, 1.0, 2.0])
    at = np.searchsorted(whole.times, [0.5, 1.0, 1.0, 2.0] - np.array(1e-9))
    assert np.array_equal(part.times, [0.5, 1.0, 1.0, 2.0])
    for kind in ("displacement", "velocity", "acceleration"):
        assert np.array_equal(getattr(part, kind)(mass), getattr(whole, kind)(mass)[at])
    for kind in ("kinetic", "strain", "contact", "dissipated", "work"):
        assert np.allclose(getattr(part.energy, kind), getattr(whole.energy, kind)[at], rtol=1e-12, atol=0.0)
    until = vf.simulate(scene, 2.0, method=method, dt=0.005)
    assert np.array_equal(part.spring_state("s"), until.spring_state("s"))


@pytest.mark.parametrize("size", [1, 50, 3000, 200_000])
@pytest.mark.parametrize("steps", [1, 7, 1000, 123_456])
def test_what_a_run_looks_at_is_bounded(size, steps):
    """All steps of short runs of small systems; few of long runs and large systems, spread over all of the run."""
    dt = 0.3
    times = check_times(steps * dt, dt, size)
    on = times[np.abs(times / dt - np.round(times / dt)) < 1e-9]
    assert np.all(np.diff(times) > 0.0)
    assert times[0] == 0.0
    assert times[-1] == steps * dt
    assert on.size <= 1002
    if steps <= 1000 and size * steps <= 20_000:
        assert on.size == steps + 1
    if size >= 3000:
        assert on.size <= max(steps // 64, 20_000 // size, 16) + 2
    assert np.max(np.diff(on)) <= 3.0 * steps * dt / min(steps, 16)
