"""Points recorded at every step beside few stored states."""

import csv

import h5py
import numpy as np
import pytest
from scenes import alone, cantilever

import vofem as vf
from vofem.io.csv_file import write_probes

STEPPING = ("energy_conserving", "generalized_alpha", "central_difference")
T_END, DT = 0.5, 1e-4


def beam_on_stop():
    beam = cantilever(5, name="beam")
    tip = beam.at(1.0)
    stop = vf.Contact(tip, gap=0.01, stiffness=10.0, side="below", acts_on="penetration", name="stop")
    return vf.Scene([beam], [stop, vf.PointLoad(tip, vf.Sine(-0.5, 6.0))]), beam


# No other test compiles the record of points in all methods.
@pytest.mark.parametrize("method", STEPPING)
def test_every_step_is_recorded_beside_few_states(method):
    scene, beam = beam_on_stop()
    points = {"tip": beam.at(1.0), "root": beam.at(0.0), "inside": beam.at(0.37)}
    every = vf.simulate(scene, T_END, method=method, dt=DT)
    few = vf.simulate(scene, T_END, method=method, dt=DT, times=[0.0, T_END], probes=points)
    assert every.times.size == 5001
    assert few.samples.q.shape[1] == 2
    assert list(few.probes) == list(points)
    for name, point in points.items():
        probe = few.probes[name]
        assert np.array_equal(probe.times, every.times)
        # Sums of four terms, which another order may round differently.
        for found, wanted in (
            (probe.displacement, every.displacement(point)),
            (probe.velocity, every.velocity(point)),
            (probe.acceleration, every.acceleration(point)),
        ):
            np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-14 * np.max(np.abs(wanted)))
    assert np.array_equal(few.probes["root"].displacement, np.zeros(5001))
    assert np.array_equal(few.contacts["stop"].closings, every.contacts["stop"].closings)


def test_more_steps_than_a_tap_holds():
    mass, scene = alone(vf.Mass(1.0, stiffness=4.0, name="m"), start=(1.0, 0.0))
    result = vf.simulate(scene, 50.0, method="energy_conserving", dt=1e-3, times=[50.0], probes=[mass])
    probe = result.probes[mass]
    assert probe.times.size == 50_001
    assert np.all(np.diff(probe.times) > 0.0)
    # The midpoint rule turns by 2 atan(omega dt/2) a step.
    wanted = np.cos(np.arange(50_001) * 2.0 * np.arctan(1e-3))
    assert np.max(np.abs(probe.displacement - wanted)) < 1e-10
    assert np.max(np.abs(probe.velocity**2 + 4.0 * probe.displacement**2 - 4.0)) < 1e-10


def test_steps_that_follow_a_tolerance_are_recorded_at_their_own_times():
    scene, beam = beam_on_stop()
    result = vf.simulate(scene, T_END, method="energy_conserving", tol=1e-3, times=[T_END], probes=beam.at(1.0))
    probe = result.probes[beam.at(1.0)]
    assert probe.times.size == result.counters.steps + 1
    assert probe.times[0] == 0.0
    assert probe.times[-1] == T_END
    assert np.unique(np.diff(probe.times).round(12)).size > 1
    exact = vf.simulate(scene, T_END, times=probe.times).displacement(beam.at(1.0))
    assert np.max(np.abs(probe.displacement - exact)) < 3e-3 * np.max(np.abs(exact))


def test_a_step_beyond_the_end_is_left_out():
    mass, scene = alone(vf.Mass(1.0, name="m"), start=(0.0, 1.0))
    for method in STEPPING:
        result = vf.simulate(scene, 1.0, method=method, dt=0.3, times=[1.0], probes=[mass])
        np.testing.assert_allclose(result.probes["m"].times, [0.0, 0.3, 0.6, 0.9], rtol=1e-15)


def test_methods_without_steps_record_at_the_times_of_the_run():
    scene, beam = beam_on_stop()
    result = vf.simulate(scene, T_END, times=np.linspace(0.0, T_END, 7), probes=[beam.at(0.4)])
    assert result.method == "event_driven"
    probe = result.probes["beam@0.4"]
    assert np.array_equal(probe.times, result.times)
    np.testing.assert_allclose(probe.velocity, result.velocity(beam.at(0.4)), rtol=1e-13, atol=1e-16)


@pytest.mark.parametrize("method", [*STEPPING, "event_driven"])
def test_a_saved_run_keeps_its_probes(method, tmp_path):
    scene, beam = beam_on_stop()
    options = {} if method == "event_driven" else {"dt": 1e-3}
    result = vf.simulate(scene, T_END, method=method, times=[0.0, T_END], probes=[beam.at(1.0)], **options)
    loaded = vf.load(result.save(tmp_path / "run.vtkhdf"))
    assert list(loaded.probes) == ["beam@1.0"]
    for name in ("times", "displacement", "velocity", "acceleration"):
        assert np.array_equal(getattr(loaded.probes["beam@1.0"], name), getattr(result.probes["beam@1.0"], name))
    with h5py.File(tmp_path / "run.vtkhdf") as file:
        recorded = file["history/recorded_displacement"]
        assert [dims[0].name.rsplit("/")[-1] for dims in recorded.dims] == ["recorded_time", "recorded"]
        assert np.array_equal(recorded[:, 0], result.probes["beam@1.0"].displacement)
    assert vf.load(vf.simulate(scene, 0.1).save(tmp_path / "other.vtkhdf")).recorded is None


def test_memory_grows_with_the_points_only():
    beam = cantilever(50, name="beam")
    scene = vf.Scene([beam], [vf.PointLoad(beam.at(1.0), 1.0)])
    result = vf.simulate(scene, 2.0, method="generalized_alpha", dt=1e-3, times=[0.0, 1.0, 2.0], probes=[beam.at(1.0)])
    record = result.recorded
    assert record.times.size == 2_001
    assert sum(part.nbytes for part in (record.times, record.q, record.v, record.a)) == 4 * 8 * 2_001
    assert result.samples.q.size == 3 * 100


def test_a_run_without_probes_has_no_record():
    scene, _ = beam_on_stop()
    result = vf.simulate(scene, 0.1, method="energy_conserving", dt=1e-3)
    assert result.recorded is None
    assert len(result.probes) == 0
    assert result.solution.probes is None
    with pytest.raises(vf.ArgumentError, match="no probe is named 'tip'"):
        result.probes["tip"]


def test_what_is_no_point_is_refused():
    scene, beam = beam_on_stop()
    with pytest.raises(vf.ArgumentError, match=r"probes: a point.*take a point of it with \.at"):
        vf.simulate(scene, 0.1, probes=[beam])
    with pytest.raises(vf.ArgumentError, match=r"probes: tip is 1.0"):
        vf.simulate(scene, 0.1, probes={"tip": 1.0})
    stranger = vf.Mass(1.0, name="stranger")
    with pytest.raises(vf.ArgumentError, match="no body is named 'stranger'"):
        vf.simulate(scene, 0.1, probes=[stranger])
    with pytest.raises(vf.ArgumentError, match="expected points"):
        vf.simulate(scene, 0.1, probes=3)


def test_probes_of_a_scene_file_become_a_csv(tmp_path, capsys):
    from vofem.cli import main

    (tmp_path / "scene.toml").write_text(
        """
[run]
t_end = 0.1
method = "energy_conserving"
dt = 1e-3
times = [0.0, 0.1]
probes = ["m"]

[[mass]]
name = "m"
mass = 1.0
stiffness = 1.0

[initial]
m = { displacement = 1.0, velocity = 0.0 }
"""
    )
    assert main(["run", str(tmp_path / "scene.toml"), "--output", str(tmp_path / "out"), "--no-pictures"]) == 0
    assert "probes.csv" in capsys.readouterr().out
    with (tmp_path / "out" / "probes.csv").open() as file:
        header, *rows = csv.reader(file)
    assert header == ["t [s]", "m displacement [m]", "m velocity [m/s]", "m acceleration [m/s^2]"]
    assert len(rows) == 101
    assert float(rows[-1][1]) == pytest.approx(np.cos(0.1), abs=1e-7)


def test_a_run_without_record_has_no_csv_of_it(tmp_path):
    scene, _ = beam_on_stop()
    with pytest.raises(vf.ArgumentError, match="recorded no points"):
        write_probes(vf.simulate(scene, 0.1), tmp_path / "probes.csv")


@pytest.mark.parametrize("method", STEPPING)
def test_between_steps_all_is_of_second_order(method):
    mass, scene = alone(vf.Mass(1.0, stiffness=4.0, name="m"), load=vf.Sine(1.0, 3.0))
    t = np.sqrt(np.linspace(0.1, 3.9, 57))
    exact = vf.simulate(scene, 2.0, times=t)
    errors = []
    for dt in (0.02, 0.01, 0.005):
        run = vf.simulate(scene, 2.0, method=method, dt=dt, times=t)
        errors.append(
            [
                np.sqrt(np.mean(np.square(getattr(run, kind)(mass) - getattr(exact, kind)(mass))))
                for kind in ("displacement", "velocity", "acceleration")
            ]
        )
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    assert np.all((orders > 1.8) & (orders < 2.25)), orders


@pytest.mark.parametrize("arguments", [{"dt": 0.013}, {"dt": 0.01}, {"tol": 1e-3}])
@pytest.mark.parametrize("method", STEPPING)
def test_no_load_is_asked_for_its_value_beyond_the_end(method, arguments):
    if "tol" in arguments and method != "energy_conserving":
        arguments = {"dt": 0.3}
    asked = []

    def measured(t):
        asked.append(t)
        return np.sin(3.0 * t)

    mass = vf.Mass(1.0, stiffness=4.0, name="m")
    run = vf.simulate(vf.Scene([mass], [vf.PointLoad(mass, measured)]), 2.0, method=method, times=[2.0], **arguments)
    assert max(asked) <= 2.0
    exact = vf.simulate(vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(1.0, 3.0))]), 2.0, times=[2.0])
    coarse = 0.3 if arguments == {"dt": 0.3} else 0.02
    assert abs(run.displacement(mass)[-1] - exact.displacement(mass)[-1]) < coarse**2
    assert abs(run.acceleration(mass)[-1] - exact.acceleration(mass)[-1]) < 20.0 * coarse**2
