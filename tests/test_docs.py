"""The pages say what works: their Python runs, their links lead somewhere."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

import vofem as vf
from vofem.io.scenes import schema

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = [*(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "examples/README.md")), *sorted(DOCS.rglob("*.md"))]


def python_of(page):
    return re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def run_page(page):
    """Run the blocks of a page one after the other, and return the names that they define."""
    names = {"__name__": page.stem}
    for block in python_of(page):
        exec(compile(block, page.name, "exec"), names)
    return names


@pytest.mark.parametrize(
    ("page", "files"),
    [
        (ROOT / "README.md", ["run.vtkhdf", "tip.png"]),
        (
            DOCS / "pictures.md",
            ["history.gif", "history.png", "map.png", "mode.gif", "paper.pdf", "shapes.png", "side.gif", "side.png"],
        ),
        (
            DOCS / "steady-states.md",
            [
                "backbone.png",
                "cantilever.png",
                "loci.png",
                "lowest.png",
                "multipliers.png",
                "orbits.png",
                "section.png",
                "two-masses.png",
            ],
        ),
    ],
    ids=lambda value: value.name if isinstance(value, Path) else "",
)
def test_python_of_a_page_runs(page, files, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = run_page(page)
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_file()) == files
    # That of the steady state, whose damped modes reach 1e4 rad/s, is 1.4e-12.
    assert names["result"].energy.balance_error < (1e-11 if page.stem == "steady-states" else 1e-12)


def test_python_of_the_page_on_sweeps_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = run_page(DOCS / "sweeps.md")
    assert names["table"]["tip"].shape == (3, 2)
    assert names["table"].failed == ()
    assert names["diagram"].failed == ()
    assert names["shared"]["eigensolves"].tolist() == [1, 0, 0]
    assert sum(one.share for one in names["found"].attractors) == pytest.approx(1.0)


def test_a_first_scene(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = run_page(DOCS / "first-scene.md")
    assert names["contact"].closings[0] == pytest.approx(3.8131224981, abs=1e-9)
    assert names["result"].notes == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["side.png", "tip.png"]


def test_a_strip_on_a_stop(capsys):
    """The numbers in its comments are those that it prints."""
    names = run_page(DOCS / "strip-on-a-stop.md")
    assert names["modes"].frequencies[0] == pytest.approx(names["formula"], rel=1e-6)
    printed = capsys.readouterr().out
    for text in ("20 hits per second", "peak force 0.57 N", "penetration 0.11 mm", "closed 7 %", "clamp 20 MPa"):
        assert text in printed
    assert names["change"] < 1e-7
    assert names["result"].notes == []


def test_a_tube_in_supports(capsys):
    """Two methods agree on means, though not on histories; the energy that comes in goes out."""
    names = run_page(DOCS / "tube-in-supports.md")
    result, stepped = names["result"], names["stepped"]
    assert result.notes[0].startswith("chaos: ")
    assert names["mean_force"](stepped) == pytest.approx(names["mean_force"](result), rel=0.25)
    assert names["hits"](stepped) == pytest.approx(names["hits"](result), rel=0.25)
    assert names["energy"].dissipated[-1] == pytest.approx(names["energy"].work[-1], rel=0.1)
    assert 9.0 < names["free"] < 9.1
    assert 45.0 < names["held"] < 47.0


def test_a_chain_of_wagons(capsys):
    names = run_page(DOCS / "chain.md")
    assert names["first"].closings[0] == pytest.approx(0.1 / 1.5, rel=1e-12)
    assert names["result"].energy.balance_error < 1e-13
    assert "14.3 of 22.5 kJ" in capsys.readouterr().out


def test_friction_and_rigid_impacts(capsys):
    names = run_page(DOCS / "friction-and-impacts.md")
    assert names["impacts"].closing[-1] == pytest.approx(2.873479, rel=1e-6)
    assert np.diff(names["late"].closing[-5:]) == pytest.approx(np.pi, rel=1e-6)
    assert names["slider"].breaks[0] == pytest.approx(0.4, rel=1e-12)
    assert names["belt"].energy.balance_error < 1e-13
    assert names["lost"](10.0) > max(names["lost"](1.0), names["lost"](100.0))
    assert "accumulate" in capsys.readouterr().out


@pytest.mark.kernels("plain")
def test_a_train_on_a_bridge(capsys):
    names = run_page(DOCS / "train-on-a-bridge.md")
    assert names["result"].energy.balance_error < 1e-12
    assert names["rolled"].energy.balance_error < 1e-11
    assert names["contact"].openings.size >= 1
    printed = capsys.readouterr().out
    for text in ("57.7 m/s: 65.0 mm", "f1 = 3.206 Hz, speed 57.7 m/s", "True"):
        assert text in printed


def test_fitting(tmp_path, monkeypatch, capsys):
    """The fit finds the parameters from which the measurement was made, within a few deviations, and says how well."""
    monkeypatch.chdir(tmp_path)
    names = run_page(DOCS / "fitting.md")
    found = names["found"]
    assert np.all(np.abs(found.values - [0.008, 3000.0]) < 3.0 * found.deviation)
    assert 0.7 < names["misfit"] < 1.3
    assert names["early"].not_identifiable == ["stop.gap", "stop.stiffness"]
    assert names["again"].report() == found.report()
    printed = capsys.readouterr().out
    for text in ("gap 8.00 mm, stiffness 3000 N/m", "noise: 0.89", "+- 0.006 mm", "+- 0.06 %"):
        assert text in printed


#: Pages whose Python is run, and where nothing more is asserted than what it writes.
OTHERS = {
    "recipes.md": ["run.gif", "run.vtkhdf", "tip.csv"],
    "storage.md": ["run.vtkhdf"],
    "hysteresis.md": [],
    "fractional.md": [],
    "performance.md": [],
}
#: Pages whose Python has a test of its own.
OWN = {
    *("README.md", "pictures.md", "steady-states.md", "sweeps.md"),
    *("first-scene.md", "strip-on-a-stop.md", "tube-in-supports.md", "chain.md", "train-on-a-bridge.md"),
    *("fitting.md", "derivatives.md", "friction-and-impacts.md"),
}


@pytest.mark.parametrize("name", OTHERS)
def test_python_of_other_pages_runs(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run_page(DOCS / name)
    # On a slow machine the page's long run has been saved on its way.
    written = {path.name for path in tmp_path.iterdir() if path.is_file()} - {"long.checkpoint"}
    assert sorted(written) == OTHERS[name]


def test_no_page_with_python_is_left_out():
    assert {page.name for page in PAGES if python_of(page)} == OWN | set(OTHERS)


def test_scene_files_of_the_pages_are_read(tmp_path):
    shown = [
        block
        for page in PAGES
        for block in re.findall(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
        if "[[beam]]" in block
    ]
    assert len(shown) >= 2
    for k, block in enumerate(shown):
        path = tmp_path / f"{k}.toml"
        path.write_text(block.replace('"../meshes/', f'"{(ROOT / "meshes").as_posix()}/'), encoding="utf-8")
        assert vf.load_scene(path).simulate(t_end=0.1, times=[0.1]).counters.steps


def test_the_page_of_tables_shows_every_table_and_key():
    """`make docs` writes it into the site from what the classes declare."""
    spec = importlib.util.spec_from_file_location("scene_reference", ROOT / "tools" / "scene_reference.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    page = module.page()
    for name, made in (schema.BODIES | schema.EFFECTS).items():
        section = page.split(f"### `[[{name}]]`\n")[1].split("\n###")[0]
        shown = [line.split("`")[1] for line in section.splitlines() if line.startswith("| `")]
        assert shown == list(schema.keys(made))
    assert "| `gap` | a number | must be given | The gap. A negative gap is a preload; it needs" in page
    assert "| `max_events` | a number |" in page


def test_every_public_name_is_in_the_reference():
    """In that of the site, whose pages name what they document after three colons."""
    text = "".join(page.read_text(encoding="utf-8") for page in (DOCS / "api").glob("*.md"))
    named = set(re.findall(r"^::: vofem\.(\w+)$", text, re.MULTILINE))
    # Five of them are modules, or named like one: their pages name what they hold.
    assert named == set(vf.__all__) - {"__version__", "accuracy", "fractional", "io", "objectives", "simulate"}
    assert "::: vofem.simulate.simulation.simulate" in text


def test_every_page_is_in_the_navigation():
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    listed = set(re.findall(r"([\w/-]+\.md)$", text, re.MULTILINE))
    written = {"gallery.md", "scene-reference.md"}  # by `make docs`
    assert listed == {page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md")} | written


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if "://" in target:
            continue
        name, _, anchor = target.partition("#")
        if name in ("gallery.md", "scene-reference.md", "scene-file.schema.json"):
            continue  # `make docs` writes these
        goal = page.parent / name if name else page
        assert goal.exists(), f"{page.name} links to {target}"
        if anchor:
            heads = re.findall(r"^#+ (.*)$", goal.read_text(encoding="utf-8"), re.MULTILINE)
            slugs = {re.sub(r"[^a-z0-9 _-]", "", head.lower()).replace(" ", "-") for head in heads}
            assert anchor in slugs, f"{page.name} links to {target}"


def test_files_that_the_pages_for_developers_name_exist():
    known = {
        path.as_posix()
        for folder in ("vofem", "tests", "benchmarks", "tools")
        for path in ROOT.glob(folder + "/**/*.py")
    }
    for page in (DOCS / "how-it-works.md", DOCS / "development.md", *(DOCS / "methods").glob("*.md")):
        for name in re.findall(r"[\w/-]+\.py\b", page.read_text(encoding="utf-8")):
            assert any(path.endswith("/" + name) for path in known), f"{page.name} names {name}"


def test_the_page_on_derivatives_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = run_page(DOCS / "derivatives.md")
    assert names["d"].names == ["stop.gap", "beam.EI[3]", "PointLoad(beam@1).f.omega"]
    d = names["d"]
    assert d.notes == []
    assert d.displacement(names["tip"]).shape == (1001, 3)
    # A larger gap delays the first impact.
    assert d.contacts["stop"].closings[0, 0] > 0.0
