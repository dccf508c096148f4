"""The command line: what it prints, what it writes, and its exit codes."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import SHORT, cantilever, reference

import vofem as vf
from vofem import cli
from vofem.io import doctor, tables
from vofem.io.csv_file import write_csv

ROOT = Path(__file__).parent.parent
EXAMPLES = ROOT / "examples"


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "ball.toml"
    path.write_text(SHORT)
    return path


def columns(path):
    with open(path, newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    return dict(zip(header, np.array(rows, dtype=float).T, strict=True))


def test_run_writes_what_it_names(scene, capsys):
    assert cli.main(["run", str(scene)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("Bodies\n  Mass 'ball'")
    assert "Contact 'stop'\n" in out
    assert "energy balance holds to" in out
    named = [Path(line.removeprefix("wrote").strip()) for line in out.split("\nwrote ")[1].splitlines()]
    assert named == [Path("output/ball") / name for name in ("histories.csv", "history.png", "scene.png")]
    assert all(path.stat().st_size > 1000 for path in named)
    assert sorted(path.name for path in Path("output/ball").iterdir()) == sorted(path.name for path in named)


def test_histories_are_those_of_the_run(scene, tmp_path):
    assert cli.main(["run", str(scene), "--output", str(tmp_path / "a" / "b"), "--no-pictures"]) == 0
    table = columns(tmp_path / "a" / "b" / "histories.csv")
    file = vf.load_scene(scene)
    result = file.simulate()
    (ball,) = file.scene.bodies
    assert np.array_equal(table["t [s]"], result.times)
    assert np.array_equal(table["ball displacement [m]"], result.displacement(ball))
    assert np.array_equal(table["ball velocity [m/s]"], result.velocity(ball))
    assert np.array_equal(table["stop force [N]"], result.contacts["stop"].force)
    assert np.array_equal(table["stop stiffness [N/m]"], result.contacts["stop"].stiffness)
    assert not list((tmp_path / "a" / "b").glob("*.png"))


def test_the_command_line_goes_before_the_file(scene, tmp_path, capsys):
    scene.write_text(SHORT.replace("t_end = 6.0", "t_end = 6.0\ntimes = [0.0, 6.0]"))
    words = ["--method", "central_difference", "--t-end", "2", "--dt", "0.125", "--output", str(tmp_path)]
    assert cli.main(["run", str(scene), "--no-pictures", *words]) == 0
    assert "This run: central_difference, as the command line says\n" in capsys.readouterr().out
    assert np.array_equal(columns(tmp_path / "histories.csv")["t [s]"], np.arange(17) / 8)


@pytest.mark.parametrize(
    ("times", "t_end", "said"),
    [
        (
            "[0.0, 3.0, 6.0]",
            "8",
            "the times of the file end at 6 s, so no states are stored between there and --t-end at 8 s",
        ),
        ("[0.0, 3.0, 6.0]", "5", "2 of the 3 times of the file lie within --t-end; these are kept"),
        ("[0.0, 3.0]", "5", None),
        ("[0.0, 3.0, 6.0]", "6", None),
    ],
)
def test_times_of_the_file_and_another_end(scene, tmp_path, capsys, times, t_end, said):
    scene.write_text(SHORT.replace("t_end = 6.0", f"t_end = 6.0\ntimes = {times}"))
    assert cli.main(["run", str(scene), "--no-pictures", "--t-end", t_end, "--output", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert (said in printed) if said else ("of the file" not in printed)
    expected = [t for t in (0.0, 3.0, 6.0) if t <= float(t_end) and f"{t}" in times]
    assert columns(tmp_path / "histories.csv")["t [s]"].tolist() == expected


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--t-end", "-1"], "--t-end is -1.0, expected a positive number"),
        (["--t-end", "nan"], "--t-end is NaN"),
        (["--method", "evnt_driven"], "did you mean 'event_driven'?"),
        (["--method", "central_difference", "--dt", "9"], "critical"),
    ],
)
def test_faults_have_exit_code_1_and_no_traceback(scene, words, message, capsys):
    assert cli.main(["run", str(scene), *words]) == 1
    err = capsys.readouterr().err
    assert err.startswith("vofem: ")
    assert message in err
    assert "Traceback" not in err


@pytest.mark.parametrize(
    "words", [["--t-end", "-1"], ["--t-end", "nan"], ["--t-start", "-1"], ["--method", "evnt_driven"]]
)
def test_wrong_options_are_named_before_anything_is_printed_or_made(scene, words, capsys):
    scene.write_text(SHORT.replace("t_end = 6.0", "t_end = 6.0\ntimes = [0.0, 3.0, 6.0]"))
    assert cli.main(["run", str(scene), *words]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith(f"vofem: {words[0]} is ")
    assert not Path("output").exists()


def test_a_wrong_error_is_named_before_anything_is_measured(scene, tmp_path, capsys):
    assert cli.main(["accuracy", str(scene), "--error", "-1", "--output", str(tmp_path)]) == 1
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "vofem: --error is -1.0, expected a positive number\n")


def test_all_problems_of_a_file_are_shown(scene, capsys):
    scene.write_text(SHORT.replace("mass = 1.0", "mass = -1.0").replace("gap = 0.5", "gab = 0.5"))
    for command in ("run", "explain"):
        assert cli.main([command, str(scene)]) == 1
        err = capsys.readouterr().err
        assert "3 problems" in err
        assert "mass[0].mass: expected a positive number, found -1.0" in err
        assert "contact[0].gab: unknown key; did you mean 'gap'?" in err
        assert "contact[0].gap: missing, expected a number" in err


def test_a_file_without_run_needs_t_end(scene, capsys, tmp_path):
    scene.write_text(SHORT.replace("[run]\nt_end = 6.0", ""))
    assert cli.main(["run", str(scene), "--no-pictures"]) == 1
    assert "does not say how long to run; add t_end to a table [run]" in capsys.readouterr().err
    assert cli.main(["run", str(scene), "--no-pictures", "--t-end", "1"]) == 0


def test_output_that_cannot_be_written(scene, capsys, tmp_path):
    (tmp_path / "taken").write_text("")
    for words, reason in (
        (["--output", "taken"], "the folder taken cannot be made: it is a file; choose another place"),
        (["--save", "run.txt"], "path is 'run.txt', expected a name that ends in"),
        (["--save", "none/run.vtkhdf"], "the folder none does not exist"),
    ):
        assert cli.main(["run", str(scene), *words]) == 1
        said = capsys.readouterr()
        assert said.out == ""
        assert reason in said.err


@pytest.mark.parametrize("words", [[], ["fly"], ["run"], ["run", "a.toml", "--t-end", "x"], ["explain", "a", "b"]])
def test_wrong_usage_has_exit_code_2(words, capsys):
    with pytest.raises(SystemExit) as caught:
        cli.main(words)
    assert caught.value.code == 2
    assert "usage: vofem" in capsys.readouterr().err


def test_explain(scene, capsys):
    assert cli.main(["explain", str(scene)]) == 0
    assert capsys.readouterr().out == f"{vf.explain(vf.load_scene(scene).scene)}\n"


def test_explain_says_what_masses_and_tables_are():
    one, two = vf.Mass(2.0, stiffness=3.0, damping=0.5, name="one"), vf.Mass(1.0, name="two")
    table = vf.Tabulated(np.linspace(0.0, 4.0, 500), np.zeros(500))
    said = str(vf.explain(vf.Scene([one, two], [vf.PointLoad(one, table)])))
    assert "Mass 'one': 2 kg, 3 N/m and 0.5 N s/m to ground\n  Mass 'two': 1 kg, free\n" in said
    assert "PointLoad on Mass 'one': Tabulated(500 values, 0 to 4 s) N\n" in said


def test_a_file_that_is_not_there(scene, capsys):
    assert cli.main(["explain", "bal.toml"]) == 1
    assert capsys.readouterr().err.endswith(f"; relative paths start at '{Path.cwd()}'; did you mean 'ball.toml'?\n")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--case", "nothing of the kind"], "no case matches"),
        (["--method", "nonsense"], "method is 'nonsense', expected one of 'event_driven'"),
        (["--case", "1", "--method", "harmonic_balance"], "no run is left"),
    ],
)
def test_verify_names_what_is_wrong_before_anything_else(words, message, capsys):
    assert cli.main(["verify", *words]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert message in said.err


def test_explain_says_which_method_the_file_wants(scene, capsys):
    scene.write_text(SHORT.replace("t_end = 6.0", "t_end = 6.0\nmethod = 'central_difference'"))
    assert cli.main(["explain", str(scene)]) == 0
    assert capsys.readouterr().out.endswith("This run: central_difference, as the scene file says\n")


def test_pictures_where_the_file_says(scene, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("vofem.io.space.graphics_fault", lambda: "no driver")
    output = "\n[output]\npictures = [0.5, 1.5, 5.5]\n"
    scene.write_text(SHORT + output)
    assert cli.main(["run", str(scene), "--t-end", "2", "--snapshot"]) == 0
    names = sorted(path.name for path in Path("output/ball").glob("*.png"))
    assert names == ["history.png", "scene-1.png", "scene-2.png"]
    assert "left out: snapshot: no driver" in capsys.readouterr().out
    scene.write_text(SHORT + output.replace("5.5", "6.5"))
    assert cli.main(["explain", str(scene)]) == 1
    assert "output.pictures: expected times up to t_end = 6 s, found 6.5" in capsys.readouterr().err


def test_a_scene_without_contacts_has_pictures(tmp_path, capsys):
    (tmp_path / "s.toml").write_text(
        "[run]\nt_end = 3\n[[beam]]\nname = 'b'\nlength = 1\nelements = 2\nEI = 1\nrhoA = 1\n"
        "supports = { left = 'clamped' }\n[[gravity]]\n"
    )
    assert cli.main(["run", str(tmp_path / "s.toml"), "--output", str(tmp_path / "o")]) == 0
    assert "b@1.0 displacement [m]" in columns(tmp_path / "o" / "histories.csv")


# -- doctor -----------------------------------------------------------------------------------------


def test_doctor(capsys):
    code = cli.main(["doctor"])
    out = capsys.readouterr().out
    assert code == 0
    assert f"vofem {vf.__version__}" in out
    assert f"numpy        {np.__version__}" in out
    assert "ictures" in out.splitlines()[-1]


def test_doctor_names_the_packages(monkeypatch, capsys):
    monkeypatch.setattr(doctor, "graphics_fault", lambda: "no driver; install one")
    monkeypatch.setattr(doctor, "REQUIRED", ("numpy", "no-such-package"))
    assert cli.main(["doctor"]) == 1
    out = capsys.readouterr().out
    assert "vofem.io.snapshot does not work, all other pictures do: no driver; install one" in out
    assert "-m pip install no-such-package" in out


# -- as a process -----------------------------------------------------------------------------------


def process(*words, **options):
    command = [sys.executable, "-m", "vofem", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT, **options)


def test_processes():
    good = process("explain", str(EXAMPLES / "two_masses.toml"))
    assert (good.returncode, good.stderr) == (0, "")
    assert "Method: event_driven" in good.stdout
    bad = process("run", "no.toml")
    assert (bad.returncode, bad.stdout) == (1, "")
    assert bad.stderr.startswith("vofem: no.toml: the file does not exist")
    assert process("run").returncode == 2
    assert process("--version").stdout == f"vofem {vf.__version__}\n"


def test_a_reader_that_leaves_early():
    script = f"{sys.executable} -m vofem explain examples/two_masses.toml | true; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False, cwd=ROOT)
    assert (done.returncode, done.stderr) == (0, "")


# -- examples ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["cantilever", "cantilever_from_mesh"])
def test_the_papers_cantilever(name):
    file = vf.load_scene(EXAMPLES / f"{name}.toml")
    result = file.simulate()
    (tip,) = file.output.history
    data = reference("beam_tip_displacement")
    times = [key for key in data if "close" in key or "closing" in key]
    assert result.contacts["stop"].closings[0] == pytest.approx(3.813122498, abs=2e-9)
    assert result.contacts["stop"].closings.size == 6
    assert times or result.displacement(tip).shape == (2001,)


def test_the_two_masses():
    result = vf.load_scene(EXAMPLES / "two_masses.toml").simulate()
    assert result.contacts["contact"].closings.size == 7
    assert result.energy.balance_error < 1e-12


# -- tables -----------------------------------------------------------------------------------------


def ball(t_end, **more):
    mass = vf.Mass(1.0, stiffness=1.0, name="ball")
    options = {"gap": 0.5, "stiffness": 10.0, "side": "above", "acts_on": "penetration", "name": "stop", **more}
    return vf.simulate(vf.Scene([mass], [vf.Contact(mass, **options)], initial={mass: (0.0, 1.0)}), t_end)


def test_contact_table():
    """A mass on a spring meets a stop with penetration: within contact it is a harmonic of frequency sqrt(11)."""
    result = ball(40.0)
    lines = tables.contact_table(result, "stop", most=2).splitlines()
    assert lines[0] == "Contact 'stop'"
    number, closing, opening, lasts, speed, peak, impulse = lines[2].split()
    assert float(speed) == pytest.approx(np.sqrt(0.75), rel=1e-5)
    assert (number, float(closing)) == ("1", pytest.approx(np.pi / 6, abs=1e-9))
    assert float(lasts) == pytest.approx(float(opening) - float(closing), abs=1e-6)
    # In contact u = 5/11 + A cos(sqrt(11) t + phi), with u = 0.5 and u' = sqrt(3)/2 at closing.
    top = 5 / 11 + np.hypot(0.5 - 5 / 11, np.sqrt(0.75 / 11))
    assert float(peak) == pytest.approx(10.0 * (top - 0.5), rel=1e-5)
    assert float(impulse) == pytest.approx(2 * np.sqrt(0.75) - float(lasts) * 0.5, rel=0.2)
    assert lines[-1].strip().startswith("...   and ")


def test_contact_table_of_other_runs():
    assert tables.contact_table(ball(1.0, gap=2.0), "stop") == "Contact 'stop' does not close"
    lines = tables.contact_table(ball(0.7), "stop").splitlines()
    assert "0.700000000+" in lines[2]
    assert "still closed at the end" in lines[-1]


def test_tables_of_many_contacts():
    beam = vf.Beam(1.0, 1.0, 1.0, 12, name="b")
    scene = vf.Scene([beam], [vf.Foundation(beam, stiffness=10.0, one_sided=True, name="soil"), vf.Gravity(1.0)])
    text = tables.contact_tables(vf.simulate(scene, 1.0), most=2)
    assert text.count("closes [s]") == 2
    assert "and 11 more contacts that close" in text
    assert tables.contact_tables(vf.simulate(vf.Scene([vf.Mass(1.0)]), 1.0)) == "There are no contacts"
    assert tables.contact_tables(ball(1.0, gap=2.0)) == "1 of 1 contacts do not close"


def test_energy_table():
    result = ball(10.0)
    lines = tables.energy_table(result).splitlines()
    assert len(lines) == 1 + 6 + 1
    assert [float(line.split()[0]) for line in lines[1:7]] == [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]
    for line in lines[1:7]:
        assert sum(map(float, line.split()[1:4])) == pytest.approx(0.5, rel=1e-3)


def test_csv_names(tmp_path):
    beam = cantilever(2, name="b")
    assert beam.at(0.3).name == "b@0.3"
    result = vf.simulate(vf.Scene([beam], [vf.PointLoad(beam.at(1.0), 1.0)]), 1.0)
    path = write_csv(result, {"tip": beam.at(1.0)}, tmp_path / "x.csv")
    assert np.array_equal(columns(path)["tip displacement [m]"], result.displacement(beam.at(1.0)))
    with pytest.raises(vf.ArgumentError, match="ends in"):
        write_csv(result, [], tmp_path / "x.txt")
    with pytest.raises(vf.OutputError):
        write_csv(result, [beam.at(1.0)], tmp_path / "no" / "x.csv")


def test_impulses_are_exact_and_never_guessed(tmp_path):
    """The impulse over a contact is the momentum that it takes; a run with few stored times shows none."""
    mass = vf.Mass(2.0, name="ball")
    stop = vf.Contact(mass, gap=0.1, stiffness=50.0, side="below", acts_on="penetration", name="floor")
    scene = vf.Scene([mass], [stop], {mass: (0.0, -1.5)})
    table = tables.contact_table(vf.simulate(scene, 2.0), "floor").splitlines()
    assert float(table[2].split()[-1]) == pytest.approx(2 * 2.0 * 1.5, rel=1e-5)
    assert float(table[2].split()[-2]) == pytest.approx(1.5 * np.sqrt(2.0 * 50.0), rel=1e-5)
    few = vf.simulate(scene, 2.0, method="central_difference", dt=1e-3, times=[0.0, 1.0, 2.0])
    table = tables.contact_table(few, "floor").splitlines()
    assert table[2].split()[-3:] == ["-", "-", "-"]
    assert "not known: the run stored its states at times that are too far apart" in table[-1]


def test_an_interrupt_after_the_run_leaves_its_histories(scene, monkeypatch, capsys):
    def pressed(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(tables, "energy_table", pressed)
    assert cli.main(["run", str(scene)]) == 130
    out = capsys.readouterr().out
    assert "interrupted: what is not printed yet and pictures are left out" in out
    folder = scene.parent / "output" / "ball"
    assert [path.name for path in folder.iterdir()] == ["histories.csv"]
    assert columns(folder / "histories.csv")["t [s]"][-1] == pytest.approx(6.0)
