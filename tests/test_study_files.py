"""Study files and `vofem sweep`."""

import csv
import subprocess
import sys

import numpy as np
import pytest

import vofem as vf
from vofem.cli import main
from vofem.io.pictures.studies import basin_map, state_map, sweep_curves
from vofem.io.study_file import load_study
from vofem.parameters import changed

SCENE = """
[run]
t_end = 20.0
times = { start = 0.0, stop = 20.0, count = 401 }

[[mass]]
name = "m"
mass = 1.0
stiffness = 1.0

[[contact]]
name = "stop"
a = "m"
gap = 0.2
stiffness = 8.0
side = "above"
acts_on = "penetration"

[[point_load]]
point = "m"
f = { sine = { amplitude = 1.0, omega = 0.5 } }
"""

SWEEP = """
[sweep]
after = 5.0

[sweep.values]
"contact.stop.gap" = [0.1, 0.2]
"point_load.0.f.sine.omega" = { start = 0.4, stop = 0.6, count = 3 }

[sweep.measure]
size = { amplitude = "m" }
most = { largest = "m" }
hits = { closings = "stop" }
force = { peak_force = "stop" }
share = { closed_share = "stop" }
balance = { balance_error = "run" }
"""


@pytest.fixture
def study(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(SWEEP + SCENE)
    return path


def test_a_study_gives_the_quantities_of_its_runs(study):
    file = load_study(study)
    assert file.values == {"contact.stop.gap": [0.1, 0.2], "point_load.0.f.sine.omega": [0.4, 0.5, 0.6]}
    table = vf.sweep(file.function(), file.values, executor="serial")
    assert table["size"].shape == (2, 3)
    result = vf.load_scene(study).simulate()
    late = result.times >= 5.0
    exact = result.contacts["stop"].statistics(window=(5.0, 20.0))
    u = result.displacement(result.scene.bodies[0])[late]
    contact = result.contacts["stop"]
    assert table["size"][1, 1] == pytest.approx(0.5 * (u.max() - u.min()), rel=1e-12)
    assert table["most"][1, 1] == pytest.approx(abs(u).max(), rel=1e-12)
    assert table["hits"][1, 1] == (contact.closings >= 5.0).sum() > 0
    assert table["force"][1, 1] == exact.peak_force > contact.force[late].max()
    assert table["share"][1, 1] == exact.closed_share
    assert table["balance"].max() < 1e-10


def test_the_command_writes_a_table_and_a_picture_and_goes_on_where_it_stopped(study, tmp_path, capsys):
    folder = tmp_path / "out"
    command = ["sweep", str(study), "--output", str(folder), "--workers", "1"]
    assert main(command) == 0
    assert "6 points; 0 failed" in capsys.readouterr().out
    assert sorted(path.name for path in folder.iterdir()) == ["sweep.csv", "sweep.h5", "sweep.png"]
    with open(folder / "sweep.csv", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    assert rows[0][:3] == ["contact.stop.gap", "point_load.0.f.sine.omega", "size"]
    assert len(rows) == 7
    study.write_text(study.read_text().replace("[0.1, 0.2]", "[0.1, 0.2, 0.3]"))
    assert main([*command, "--no-pictures"]) == 0
    assert "9 points, 6 of them kept from before; 0 failed" in capsys.readouterr().out


def test_python_m_vofem_starts_the_processes_of_a_sweep(study, tmp_path):
    command = [sys.executable, "-m", "vofem", "sweep", str(study), "--output", str(tmp_path / "out"), "--no-pictures"]
    done = subprocess.run([*command, "--workers", "2"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "6 points; 0 failed" in done.stdout


def test_points_that_fail_are_told(study, tmp_path, capsys):
    study.write_text(study.read_text().replace("t_end = 20.0", 't_end = 20.0\nmethod = "central_difference"\ndt = 0.1'))
    text = study.read_text().replace('"contact.stop.gap" = [0.1, 0.2]', '"run.dt" = [0.05, 100.0]')
    study.write_text(text)
    folder = tmp_path / "out"
    assert main(["sweep", str(study), "--output", str(folder), "--workers", "1", "--no-pictures"]) == 0
    output = capsys.readouterr().out
    assert "6 points; 3 failed" in output
    assert "failed: point 3 (run.dt=100.0, point_load.0.f.sine.omega=0.4): StepSizeError" in output


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("after = 5.0", "afterr = 5.0", "sweep.afterr: unknown key; did you mean 'after'?"),
        ("after = 5.0", "after = 50.0", "sweep.after: expected a time in s, not negative and before t_end = 20.0 s"),
        ("contact.stop.gap", "contact.stopp.gap", "contact has no entry 'stopp'; give a number from 0 to 0, or one"),
        ("contact.stop.gap", "contact.stop.gapp", "with the value 0.1: contact[0].gapp: unknown key; did you mean"),
        ("contact.stop.gap", "gap", "'gap' is no path of a key, expected table and key with a dot between"),
        ("contact.stop.gap", "contacts.stop.gap", "there is no 'contacts' in the file"),
        ("[0.1, 0.2]", "[0.1, 'x']", "with the value 'x'"),
        ("[0.1, 0.2]", "0.1", "expected an array of values, or { start"),
        ("count = 3", "count = 0", "expected numbers start and stop and a whole number count"),
        ("count = 3", "count = 1000000000000", "a whole number count from 1 to 10000000"),
        ('amplitude = "m"', 'amplitud = "m"', "sweep.measure.size.amplitud: unknown key; did you mean 'amplitude'?"),
        ('amplitude = "m"', 'amplitude = "n"', "sweep.measure.size.amplitude: expected a point"),
        ('closings = "stop"', 'closings = "stopp"', "expected the name of a contact, one of ['stop']"),
        ("t_end = 20.0\n", "", "t_end: missing"),
        ("[sweep.measure]", "[sweep.measures]", "expected a table such as { tip"),
    ],
)
def test_mistakes_are_named_before_anything_runs(study, old, new, message, capsys):
    text = study.read_text()
    assert old in text
    study.write_text(text.replace(old, new))
    assert main(["sweep", str(study)]) == 1
    assert message in capsys.readouterr().err
    assert not (study.parent / "output").exists()


def test_a_scene_file_without_the_table_is_no_study(study, capsys):
    study.write_text(SCENE)
    assert main(["sweep", str(study)]) == 1
    assert "sweep: missing, expected a table [sweep]" in capsys.readouterr().err


def test_other_commands_take_a_study_for_its_scene(study, capsys):
    assert main(["explain", str(study)]) == 0


def test_changes_leave_the_tables_as_they_are():
    content = {"contact": [{"name": "a", "gap": 1.0}, {"name": "b", "gap": 2.0}], "x": {"y": [1, 2]}}
    result = changed(content, {"contact.b.gap": 3.0, "contact.0.gap": 4.0, "x.y.1": 5})
    assert result == {"contact": [{"name": "a", "gap": 4.0}, {"name": "b", "gap": 3.0}], "x": {"y": [1, 5]}}
    assert content["contact"][1]["gap"] == 2.0
    with pytest.raises(vf.ArgumentError, match=r"'x\.y\.z\.w': x\.y has no entry 'z'; give a number from 0 to 1"):
        changed(content, {"x.y.z.w": 1})


def test_pictures_need_one_or_two_parameters_that_are_numbers(tmp_path):
    table = vf.sweep(lambda kind: {"y": 1.0}, {"kind": ["a"]}, executor="serial")
    with pytest.raises(vf.ArgumentError, match="no grid of one or two parameters that are numbers"):
        sweep_curves(table, tmp_path / "picture.png")
    line = vf.sweep(lambda x: {"y": x, "z": "text"}, {"x": [1.0, 2.0]}, executor="serial")
    assert sweep_curves(line, tmp_path / "picture.png").stat().st_size > 5000


def cells_of(axes):
    """Return what a map shows: the centres of its cells along both axes, and the values over (x, y)."""
    mesh = axes.collections[0]
    x, y = mesh.get_coordinates()[0, :, 0], mesh.get_coordinates()[:, 0, 1]
    assert np.all(np.diff(x) > 0.0)
    assert np.all(np.diff(y) > 0.0)
    return 0.5 * (x[1:] + x[:-1]), 0.5 * (y[1:] + y[:-1]), np.asarray(mesh.get_array()).T


def test_maps_take_values_in_any_order_and_single_ones():
    """Cells lie about their values, so that a single value has a cell too."""
    table = vf.sweep(lambda k, g: {"y": k * g}, {"k": [2e-6], "g": [3.0, 1.0, 2.0]}, executor="serial")
    x, y, values = cells_of(sweep_curves(table))
    assert (x.tolist(), y.tolist()) == (pytest.approx([2e-6]), pytest.approx([1.0, 2.0, 3.0]))
    assert values[0] == pytest.approx([2e-6, 4e-6, 6e-6])
    line = sweep_curves(vf.sweep(lambda k: {"y": k * k}, {"k": [3.0, 1.0, 2.0]}, executor="serial")).lines[0]
    assert line.get_xydata().tolist() == [[1.0, 1.0], [2.0, 4.0], [3.0, 9.0]]

    mass = vf.Mass(1.0, stiffness=1.0, damping=0.5, name="m")

    def build(omega, force=1.0):
        return vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(force, omega))])

    with pytest.raises(vf.ArgumentError, match=r"looked at; give point=$"):
        vf.stability_map(build, [2.0], [1.0], executor="serial")
    states = vf.stability_map(build, [2.0, 0.5, 3.0], [1.0], point=mass, executor="serial")
    x, _, values = cells_of(state_map(states))
    assert values[:, 0] == pytest.approx(
        1.0 / np.abs(1.0 - np.array([0.5, 2.0, 3.0]) ** 2 + 0.5j * np.array([0.5, 2.0, 3.0]))
    )
    found = vf.basins(
        build(2.0), {"displacement": [1.0, 0.0, 2.0], "velocity": [1.0]}, skip=30, points=mass, executor="serial"
    )
    x, y, _ = cells_of(basin_map(found))
    assert x.tolist() == pytest.approx([0.0, 1.0, 2.0])
    assert y.tolist() == pytest.approx([1.0])
