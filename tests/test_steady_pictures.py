"""Response curves of scene files and pictures of steady states: they show what is known, and refuse what is not."""

import csv
import shutil
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.figure import Figure
from scenes import on_stop

import vofem as vf
from vofem import cli
from vofem.io import plot
from vofem.io.pictures import axes as picture_axes
from vofem.io.tables import branch_table, write_branch
from vofem.parameters import number_at

EXAMPLE = Path(__file__).parent.parent / "examples" / "two_masses_response.toml"


@pytest.fixture
def figures(monkeypatch):
    """Keep the figures that are saved."""
    kept = []

    def save(figure, *arguments, **options):
        kept.append(figure)
        saved(figure, *arguments, **options)

    saved = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", save)
    return kept


@pytest.fixture(scope="module")
def branch():
    file = vf.load_scene(EXAMPLE)
    masses = file.scene.bodies
    # Without a guess the branch would begin on the orbit that hits the stop, on which a motion from rest settles.
    return vf.continuation(file.at, 0.67, 0.64, guess=vf.periodic(file.at(0.8))), masses


def labels(figure):
    return figure.axes[0].get_legend_handles_labels()[1]


def test_a_response_curve_marks_what_is_special(branch, tmp_path, figures):
    found, masses = branch
    path = plot.response_curve(found, masses[1], tmp_path / "curve.png", parameter="omega [rad/s]")
    assert matplotlib.image.imread(path).shape[0] > 500
    axes = figures[0].axes[0]
    assert {"stable", "unstable", "fold", "grazing"} <= set(labels(figures[0]))
    styles = {line.get_label(): line.get_linestyle() for line in axes.lines}
    assert styles["stable"] == "-"
    assert styles["unstable"] == "--"
    # Every orbit is on a line, and lines of different stability meet at the special point between them.
    lines = [line.get_xdata() for line in axes.lines if line.get_linestyle() in ("-", "--")]
    assert set(found.values) <= set(np.concatenate(lines))
    ends = [float(line[0]) for line in lines[1:]]
    assert ends == [float(line[-1]) for line in lines[:-1]]
    assert set(ends) <= {special.value for special in found.special}
    marks = [line for line in axes.lines if line.get_label() == "grazing"]
    assert marks[0].get_xdata()[0] == pytest.approx(0.6534401404162605, rel=1e-12)
    assert axes.get_xlabel() == "omega [rad/s]"


def test_multipliers_and_phase_portraits(branch, tmp_path, figures):
    found, masses = branch
    plot.multipliers(found, tmp_path / "all.png")
    unstable = next(orbit for orbit in found.orbits if orbit.stable is False)
    plot.multipliers(unstable, tmp_path / "one.png")
    assert "outside: unstable" in labels(figures[1])
    drawn = np.concatenate([line.get_xydata() for line in figures[1].axes[0].lines[1:]])
    known = np.stack([unstable.multipliers.real, unstable.multipliers.imag], axis=1)
    np.testing.assert_allclose(np.sort(drawn, axis=0), np.sort(known, axis=0))
    plot.phase_portrait(unstable, masses[0], tmp_path / "phase.svg")
    assert {"a contact closes", "a contact opens"} <= set(labels(figures[2]))
    closing = next(line for line in figures[2].axes[0].lines if line.get_label() == "a contact closes")
    assert closing.get_xdata()[0] == pytest.approx(1.0, abs=1e-9)


def test_masses_are_drawn_by_their_names(branch):
    found, masses = branch
    run, orbit = vf.simulate(found.orbits[0].scene, 20.0, probes=masses[0].name), found.orbits[0]
    assert list(run.probes) == [masses[0].name]
    draw = [
        lambda point: plot.response_curve(found, point),
        lambda point: plot.phase_portrait(orbit, point),
        lambda point: plot.poincare_section(vf.poincare(run, orbit.period), point),
        lambda point: plot.time_history(run, point),
        lambda point: plot.spectrum(run, point),
    ]
    for one in draw:
        named, given = (np.ravel(one(point))[0].lines[0].get_xydata() for point in (masses[0].name, masses[0]))
        np.testing.assert_array_equal(named, given)
    assert branch_table(found, masses[1].name) == branch_table(found, masses[1])
    assert repr(found.table(masses[1].name)) == repr(found.table(masses[1]))


def test_sections_and_backbones(branch, tmp_path, figures):
    found, masses = branch
    run = vf.simulate(found.orbits[0].scene, 100.0)
    section = vf.poincare(run, found.orbits[0].period)
    plot.poincare_section(section, masses[0], tmp_path / "section.png")
    assert figures[0].axes[0].lines[0].get_xdata().size == len(section)

    _, scene = on_stop(vf.Mass(1.0, stiffness=10.0), gap=0.01, stiffness=50.0)
    mode = vf.backbone(scene, 1, np.geomspace(1e-3, 1e-1, 5))
    plot.backbone_curve(mode, tmp_path / "backbone.png")
    np.testing.assert_allclose(figures[1].axes[0].lines[0].get_xdata(), mode.omega / (2.0 * np.pi))
    np.testing.assert_allclose(figures[1].axes[0].lines[0].get_ydata(), np.geomspace(1e-3, 1e-1, 5))


def test_pictures_refuse_what_they_cannot_show(branch, tmp_path):
    found, masses = branch
    path = tmp_path / "no.png"
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1)
    memory = vf.Springpot(mass, coefficient=0.3, order=0.5)
    orbit = vf.periodic(vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(1.0, 2.0)), memory]))
    plot.multipliers([orbit, *found.orbits[:2]], tmp_path / "known.png")
    for draw in (
        lambda: plot.response_curve([], masses[0], path),
        lambda: plot.response_curve(found, "no mass", path),
        lambda: plot.phase_portrait([], masses[0], path),
        lambda: plot.multipliers(orbit, path),
        lambda: plot.phase_portrait(found, masses[0], path),
        lambda: plot.poincare_section(found, masses[0], path),
        lambda: plot.backbone_curve(found, path),
    ):
        with pytest.raises(vf.ArgumentError):
            draw()
    with pytest.raises(vf.ArgumentError, match="expected a name that ends in"):
        plot.response_curve(found, masses[0], tmp_path / "curve.txt")
    with pytest.raises(vf.OutputError):
        plot.response_curve(found, masses[0], tmp_path / "no" / "such" / "folder" / "curve.png")
    assert not path.exists()
    assert picture_axes.INK


def test_a_branch_as_a_table(branch, tmp_path):
    found, masses = branch
    with write_branch(found, masses[1], tmp_path / "branch.csv", "omega").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(found) + len(found.special)
    plain = [row for row in rows if not row["special"]]
    np.testing.assert_array_equal([float(row["omega"]) for row in plain], found.values)
    for unit, factor in (("angular frequency [rad/s]", 1.0), ("frequency [Hz]", 2.0 * np.pi)):
        np.testing.assert_allclose([factor * float(row[unit]) for row in plain], found.omega, rtol=1e-14)
    np.testing.assert_allclose([float(row["b amplitude [m]"]) for row in plain], found.amplitude(masses[1]), rtol=1e-14)
    assert [row["stable"] for row in plain] == [{True: "1", False: "0", None: ""}[s] for s in found.stable]
    assert [row["special"] for row in rows if row["special"]] == [special.kind for special in found.special]
    assert "grazing (stop)" in branch_table(found, masses[1])
    frame = found.to_dataframe(masses[1])
    assert frame["stable"].tolist() == [{"1": True, "0": False, "": None}[row["stable"]] for row in rows]
    assert frame["b largest"].tolist() == [float(row["b largest [m]"]) for row in rows]
    assert frame.attrs["units"]["b least"] == "m"
    for name in ("frequency", "frequency [Hz]", "stable"):
        with pytest.raises(vf.ArgumentError, match="two columns are named"):
            write_branch(found, masses[1], tmp_path / "other.csv", name)


# -- the command --------------------------------------------------------------------------------------


def test_respond_writes_curve_branch_and_table(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shutil.copy(EXAMPLE, "two.toml")
    command = ["respond", "two.toml", "--from", "0.68", "--to", "0.6535", "--output", "out"]
    assert cli.main(command) == 0
    said = capsys.readouterr().out
    assert sorted(path.name for path in Path("out").iterdir()) == [
        "branch.csv", "branch.h5", "multipliers.png", "response.png",
    ]  # fmt: skip
    assert "orbits: " in said
    assert "response.png" in said
    assert vf.load("out/branch.h5").values[0] == 0.68
    assert cli.main(command) == 1
    assert "--overwrite" in capsys.readouterr().err
    harmonic = ["--method", "harmonic_balance", "--harmonics", "5", "--point", "a", "--no-pictures", "--overwrite"]
    assert cli.main([*command, *harmonic]) == 0
    assert "a amplitude [m]" in Path("out/branch.csv").read_text().splitlines()[0]


@pytest.mark.parametrize(
    ("old", "new", "pattern"),
    [
        (
            "point_load[0].f.sine.omega",
            "point_load[1].f.sine.omega",
            "point_load has no entry '1'; give a number from 0 to 0",
        ),
        ("point_load[0].f.sine.omega", "point_load[0].f.sine.omeg", "did you mean 'omega'"),
        ("point_load[0].f.sine.omega", "point_load.f", "point_load has no entry 'f'"),
        ("point_load[0].f.sine.omega", "point_load[0].f.sine", "expected a number"),
        ("point_load[0].f.sine.omega", "point_load[0", "is no path of a key"),
        ('point = "b"\n\n[[mass]]', 'pont = "b"\n\n[[mass]]', "did you mean 'point'"),
    ],
)
def test_wrong_parameters_are_named(old, new, pattern, tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(EXAMPLE.read_text().replace(old, new, 1))
    with pytest.raises(vf.SceneFileError, match="respond") as caught:
        vf.load_scene(path)
    assert pattern in str(caught.value)


def test_a_file_without_parameter_says_so(tmp_path, capsys):
    path = tmp_path / "two.toml"
    path.write_text(EXAMPLE.read_text().replace('[respond]\nparameter = "point_load[0].f.sine.omega"\npoint = "b"', ""))
    assert cli.main(["respond", str(path), "--from", "0.6", "--to", "0.7"]) == 1
    assert "add a table [respond]" in capsys.readouterr().err


def test_numbers_at_paths():
    content = {"a": [{"b": 1.0}, {"b": {"c": 2}}], "d": True}
    assert number_at(content, "a[1].b.c") == 2.0
    with pytest.raises(vf.ArgumentError, match="expected a number"):
        number_at(content, "a[1].b")
    file = vf.load_scene(EXAMPLE)
    load = next(effect for effect in file.at(0.6).effects if isinstance(effect, vf.PointLoad))
    assert load.f.omega == 0.6


def test_pictures_show_the_curve_and_what_was_computed(branch, tmp_path, figures):
    """Marks stand behind the curve, the parameter has no offset, orbits of one frequency do not repeat it."""
    found, masses = branch
    plot.response_curve(found, masses[1], tmp_path / "curve.png")
    axes = figures[0].axes[0]
    curves = [line for line in axes.lines if line.get_linestyle() in ("-", "--")]
    marks = [line for line in axes.lines if line not in curves]
    assert marks
    assert max(mark.get_zorder() for mark in marks) < min(curve.get_zorder() for curve in curves)
    assert not axes.xaxis.get_major_formatter().get_useOffset()
    plot.phase_portrait([found.orbits[0]] * 2, masses[1], tmp_path / "portrait.png")
    assert not any("rad/s" in label for label in labels(figures[1]))
    assert figures[1].axes[0].get_title().endswith("rad/s")


def test_a_spectrum_and_a_map_end_where_the_numbers_end(tmp_path, figures):
    mass, scene = on_stop(vf.Mass(1.0, stiffness=1.0, damping=0.1), gap=0.5, stiffness=3.0, load=vf.Sine(0.5, 0.9))
    result = vf.simulate(scene, 100.0, method="energy_conserving", dt=0.1)
    plot.spectrum(result, mass, tmp_path / "spectrum.png", limit=50.0)
    axes = figures[0].axes[0]
    assert axes.get_xlim()[1] == pytest.approx(5.0, rel=0.02)
    (line,) = axes.lines
    assert axes.get_ylim()[0] > 0.3 * line.get_ydata().min() * 0.99
    table = vf.sweep(lambda gap, omega: {"y": gap + omega}, {"gap": [3.0, 1.0], "omega": [1, 2, 5]}, executor="serial")
    plot.sweep_curves(table, tmp_path / "map.png")
    axes = figures[1].axes[0]
    assert (axes.get_xlabel(), axes.get_xlim()) == ("gap", (1.0, 3.0))
    assert (axes.get_ylabel(), axes.get_ylim()) == ("omega", (1.0, 5.0))
    assert plot.impact_statistics(result, tmp_path / "impacts.png") == tmp_path / "impacts.png"
