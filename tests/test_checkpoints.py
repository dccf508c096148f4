"""Stopping and going on: checkpoints, interruption, progress."""

import io
import os
import signal
import sys

import numpy as np
import pytest
from kept import CASES, assert_whole, probed, ran
from scenes import PowerLossError, broken_off, lose_power, paper_beam, two_masses

import vofem as vf
from vofem.io.storage import checkpoint as module

RUNS = {
    "event_driven": {"method": "event_driven"},
    "energy_conserving": {"method": "energy_conserving", "dt": 1e-3},
    "tolerance": {"method": "energy_conserving", "tol": 1e-3},
    "generalized_alpha": {"method": "generalized_alpha", "dt": 1e-3},
    "central_difference": {"method": "central_difference", "dt": 5e-4},
}


def scene_of(law="displacement"):
    """The paper's beam with damping, a contact damper, and a spring that remembers nothing."""
    beam, scene = paper_beam(law, elements=6, extra=(vf.RayleighDamping(0.1, 1e-5),))
    return beam, scene


def small_steps(monkeypatch, size):
    """Return from kernels every few steps, compiled or not."""
    monkeypatch.setattr("vofem.integrators.stepping.equal._CHUNK_WORK", size)
    monkeypatch.setattr("vofem.integrators.stepping.equal._PLAIN_WORK", size)
    monkeypatch.setattr("vofem.integrators.stepping.tolerance._CHUNK", 12)
    monkeypatch.setattr("vofem.integrators.event_driven.follow.MOST", 1)


# Two of the runs are too short to be broken off.
@pytest.mark.parametrize("name", [name for name in CASES if name not in ("rigid", "truncated")])
def test_resumed_runs_are_bitwise_the_same(name, tmp_path, monkeypatch):
    """A run that loses its machine twice ends as one that does not."""
    small_steps(monkeypatch, 400)
    build, t_end, options = CASES[name]
    whole, scene, path = ran(name), build(), tmp_path / "run.checkpoint"
    arguments = {"times": whole.times} | options | probed(scene, options)
    broken_off(path, 0.3, scene, t_end, **arguments)
    with pytest.raises(PowerLossError):
        vf.resume(path, checkpoint_every=0.0, progress=lose_power(0.7))
    assert_whole(vf.resume(path), whole)


def test_a_load_that_is_a_callable_must_be_given_again(tmp_path, monkeypatch):
    small_steps(monkeypatch, 6000)
    path = tmp_path / "run.checkpoint"

    def push(t):
        return 0.1 * np.sin(t)

    def build(load=push, gap=0.03):
        return paper_beam("penetration", elements=4, load=load, gap=gap)

    _, scene = build()
    options = {"method": "energy_conserving", "dt": 1e-2}
    broken_off(path, 0.2, scene, 8.0, **options)
    with pytest.raises(vf.VofemError, match="push"):
        vf.resume(path)
    with pytest.raises(vf.ArgumentError, match="another one than that of the checkpoint"):
        vf.resume(path, scene=build(gap=0.04)[1])
    assert_whole(vf.resume(path, scene=build()[1]), vf.simulate(scene, 8.0, **options))


def test_a_scene_with_other_equations_is_refused(tmp_path, monkeypatch):
    """Damping, and where loads act, count too; only functions of time may be given again."""
    small_steps(monkeypatch, 100)
    path = tmp_path / "run.checkpoint"

    def build(effects=(), at=0, damping=0.1):
        masses = [vf.Mass(1.0, stiffness=4.0, damping=damping, name=name) for name in "ab"]
        return vf.Scene(masses, [vf.PointLoad(masses[at], vf.Sine(1.0, 2.0)), *effects])

    scene, options = build(), {"method": "energy_conserving", "dt": 0.01}
    broken_off(path, 0.2, scene, 8.0, **options)
    others = (
        build(damping=0.2),
        build(damping=0.0),
        build([vf.RayleighDamping(0.1)]),
        build([vf.ModalDamping(0.1)]),
        build(at=1),
    )
    for other in others:
        with pytest.raises(
            vf.ArgumentError, match="another one than that of the checkpoint: masses, stiffnesses, damp"
        ):
            vf.resume(path, scene=other)
    again = vf.resume(path, scene=build())
    assert np.array_equal(again.samples.q, vf.simulate(scene, 8.0, **options).samples.q)


def test_files_that_are_no_checkpoints(tmp_path):
    _, scene = paper_beam("penetration", elements=2)
    result = vf.simulate(scene, 0.1)
    saved = result.save(tmp_path / "run.vtkhdf")
    with pytest.raises(vf.StorageError, match=r"vofem\.load"):
        vf.resume(tmp_path / "run.vtkhdf")
    with pytest.raises(vf.StorageError, match=r"missing|no such|does not exist"):
        vf.resume(tmp_path / "nowhere.checkpoint")
    with pytest.raises(vf.ArgumentError, match="checkpoint"):
        vf.simulate(scene, 0.1, checkpoint=tmp_path / "run.txt")
    there = tmp_path / "old.checkpoint"
    there.write_text("mine")
    with pytest.raises(vf.OutputError, match=r"exists already; go on from it with vofem\.resume"):
        vf.simulate(scene, 0.1, checkpoint=there)
    assert there.read_text() == "mine"
    with pytest.raises(vf.OutputError, match="cannot be written"):
        vf.simulate(scene, 0.1, checkpoint=tmp_path / f"{300 * 'a'}.checkpoint")
    assert saved.exists()


def test_a_newer_format_is_refused(tmp_path, monkeypatch):
    _, scene = paper_beam("penetration", elements=2)
    path = tmp_path / "run.checkpoint"
    monkeypatch.setattr(module, "FORMAT", 99)
    vf.simulate(scene, 5.0, checkpoint=path, checkpoint_every=0.0)
    monkeypatch.undo()
    with pytest.raises(vf.StorageError, match="format 99"):
        vf.resume(path)


@pytest.mark.parametrize("kind", RUNS)
def test_interruption_returns_what_was_computed(kind, monkeypatch):
    small_steps(monkeypatch, 6000)
    beam, scene = scene_of()
    times = np.linspace(0.0, 12.0, 97)

    def press(t, t_end):
        if 5.0 < t < 5.7:
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    # A second signal would interrupt at once: one only.
    pressed = []
    result = vf.simulate(
        scene, 12.0, times=times, progress=lambda t, e: (pressed or press(t, e), t > 5.0 and pressed.append(1)),
        **RUNS[kind],
    )  # fmt: skip
    assert signal.getsignal(signal.SIGINT) is before
    assert 4.0 < result.times[-1] < 11.0
    assert any(note.startswith("interrupted at t = ") for note in result.notes)
    whole = vf.simulate(scene, 12.0, times=times, **RUNS[kind])
    count = result.times.size
    assert result.displacement(beam.at(1.0)) == pytest.approx(whole.displacement(beam.at(1.0))[:count], abs=1e-9)
    assert result.energy.total == pytest.approx(whole.energy.total[:count], rel=1e-6, abs=1e-12)


def test_progress(monkeypatch):
    """A function is told; a bar appears on a terminal and for long runs only."""
    _, _, scene = two_masses("b", "penetration")
    told = []
    vf.simulate(scene, 100.0, progress=lambda t, t_end: told.append((t, t_end)))
    times = [t for t, _ in told]
    assert times == sorted(times)
    assert told[-1] == (100.0, 100.0)

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr("vofem.progress._PATIENCE", 0.0)
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    vf.simulate(scene, 100.0, method="energy_conserving", dt=1e-2)
    assert "100 s" in screen.getvalue()
    # Steps under a tolerance may take long: the bar says what does not.
    vf.simulate(scene, 2.0, method="energy_conserving", tol=0.1)
    assert "event_driven needs no steps here" in screen.getvalue()
    quiet = io.StringIO()
    monkeypatch.setattr(sys, "stderr", quiet)
    vf.simulate(scene, 100.0, method="energy_conserving", dt=1e-2)
    assert quiet.getvalue() == ""
    with pytest.raises(vf.ArgumentError, match="progress is 'yes'"):
        vf.simulate(scene, 1.0, progress="yes")
