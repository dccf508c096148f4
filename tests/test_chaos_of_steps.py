"""Whether runs in time steps are chaotic: a second run from a start nearby tells, and regular runs raise no alarm."""

import re

import numpy as np
import pytest
from scenes import between_stops, on_stop

import vofem as vf
from vofem.integrators.stepping import nearby

STEPS = {"energy_conserving": 0.02, "generalized_alpha": 0.02, "central_difference": 0.02}


def chaotic(omega, load=0.7, damping=0.02):
    """A driven oscillator between two stops: chaotic at 1.1 rad/s, regular at 1.5 and 2 rad/s."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=damping, name="mass")
    start = (0.0, 0.0 if load else 1.0)
    return between_stops(mass, load=vf.Sine(load, omega), start=start, gap=0.3, stiffness=100.0)[1]


def chaos(scene, t_end, method, **more):
    result = vf.simulate(scene, t_end, method=method, times=[0.0, t_end], **{"dt": STEPS[method]} | more)
    return [note for note in result.notes if note.startswith("chaos")]


@pytest.mark.parametrize("method", STEPS)
def test_a_chaotic_run_says_so(method):
    """The rate is that of the perturbation that event_driven carries along."""
    scene = chaotic(1.1)
    (note,) = chaos(scene, 100.0, method, nearby=True)
    tenfold = float(re.search(r"tenfold in some ([\d.e+-]+) s", note)[1])
    growth = vf.simulate(scene, 100.0, method="event_driven", times=[0.0, 100.0]).sensitivity.growth[-1]
    assert growth > 5.0
    assert 0.6 < tenfold * growth / 100.0 < 1.6


@pytest.mark.parametrize("method", STEPS)
@pytest.mark.parametrize("omega", [1.5, 2.0])
def test_a_regular_run_raises_no_alarm(method, omega):
    assert chaos(chaotic(omega), 100.0, method) == []


@pytest.mark.parametrize(
    ("method", "dt"), [("energy_conserving", 0.02), ("generalized_alpha", 0.005), ("central_difference", 0.005)]
)
def test_runs_that_part_in_proportion_to_time_are_regular(method, dt):
    """Without load and damping the frequency depends on the amplitude: nearby runs part, but slowly.

    Longer steps of the last two methods do not resolve the impacts, and depart from each other exponentially.
    """
    assert chaos(chaotic(1.0, load=0.0, damping=0.0), 200.0, method, dt=dt) == []


def test_steps_that_do_not_resolve_impacts_depart_from_each_other():
    (note,) = chaos(chaotic(1.0, load=0.0, damping=0.0), 200.0, "generalized_alpha", dt=0.01, nearby=True)
    assert "Where smaller steps leave this note out" in note


def test_the_second_run_is_made_where_it_is_wanted(monkeypatch):
    """One looks for chaos with the same steps, where there are eight events, and one for errors with larger steps."""
    made = []
    monkeypatch.setattr(nearby, "_second", lambda run, times: made.append(run.dt))
    scene = chaotic(2.0)
    quiet = vf.Scene([vf.Mass(1.0, 1.0)], [])
    chaos(scene, 20.0, "energy_conserving", nearby=False)
    vf.simulate(quiet, 1.0, method="energy_conserving", dt=0.02)
    assert made == []
    chaos(scene, 4.0, "energy_conserving")
    assert made == [0.04]
    chaos(scene, 20.0, "energy_conserving")
    chaos(scene, 0.5, "energy_conserving", nearby=True)
    assert made == [0.04] + 2 * [0.02, 0.04]
    # Steps may be 1.9 times as large up to the critical one; where it leaves no room they are smaller.
    beam = vf.Beam(1.0, 1.0, 1.0, 4, {"left": "clamped"})
    slow = on_stop(beam.at(1.0), load=vf.Sine(0.1, 1.0), gap=0.01, stiffness=5.0)[1]
    (note,) = vf.simulate(slow, 2.0, method="central_difference").notes
    critical = float(note.split("critical step is ")[1].split()[0])
    for part, other in ((0.5, 0.95), (0.9, 0.45)):
        vf.simulate(slow, 2.0, method="central_difference", dt=part * critical)
        assert made.pop() == pytest.approx(other * critical, rel=1e-4)
    monkeypatch.setattr(nearby, "_WORK", 0.0)
    monkeypatch.setattr(nearby, "_WORK_PLAIN", 0.0)
    made.clear()
    chaos(scene, 20.0, "energy_conserving")
    assert made == []


def test_the_run_itself_is_the_same():
    runs = [
        vf.simulate(chaotic(1.1), 20.0, method="energy_conserving", dt=0.02, nearby=wanted) for wanted in (True, False)
    ]
    assert np.array_equal(runs[0].samples.q, runs[1].samples.q)
    assert vars(runs[0].counters) == vars(runs[1].counters)


@pytest.mark.parametrize("method", STEPS)
def test_a_misspelt_wish_is_refused(method):
    with pytest.raises(vf.ArgumentError, match="nearby is 'yes', expected True or False"):
        chaos(chaotic(1.1), 1.0, method, nearby="yes")
