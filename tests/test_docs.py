"""The pages say what works: their Python runs, their links lead somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "examples" / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def python_of(page):
    return re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize(
    ("page", "files"),
    [
        (
            ROOT / "README.md",
            ["run.pvd", "run.vtkhdf", "scene.toml", "side.png", "tip.csv", "tip.png"],
        ),
        (
            ROOT / "docs" / "pictures.md",
            [
                "history.gif",
                "history.png",
                "map.png",
                "mode.gif",
                "paper.pdf",
                "shapes.png",
                "side.gif",
                "side.png",
            ],
        ),
        (
            ROOT / "docs" / "steady-states.md",
            [
                "cantilever.png",
                "multipliers.png",
                "orbits.png",
                "section.png",
                "snapshot.png",
                "two-masses.png",
            ],
        ),
    ],
    ids=lambda value: value.name if isinstance(value, Path) else "",
)
def test_python_of_a_page_runs(page, files, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = {"__name__": page.stem}
    for block in python_of(page):
        exec(compile(block, page.name, "exec"), names)
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_file()) == files
    # That of the steady state, whose damped modes reach 1e4 rad/s, is 1.4e-12.
    assert names["result"].energy.balance_error < (1e-11 if page.stem == "steady-states" else 1e-12)


def test_python_of_the_page_on_sweeps_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "sweeps"}
    for block in python_of(ROOT / "docs" / "sweeps.md"):
        exec(compile(block, "sweeps.md", "exec"), names)
    assert names["table"]["tip"].shape == (3, 2)
    assert names["table"].failed == ()
    assert names["diagram"].failed == ()
    assert names["shared"]["eigensolves"].tolist() == [1, 0, 0]
    assert sum(one.share for one in names["found"].attractors) == pytest.approx(1.0)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if "://" in target:
            continue
        name, _, anchor = target.partition("#")
        goal = page.parent / name if name else page
        assert goal.exists(), f"{page.name} links to {target}"
        if anchor:
            heads = re.findall(r"^#+ (.*)$", goal.read_text(encoding="utf-8"), re.MULTILINE)
            slugs = {re.sub(r"[^a-z0-9 _-]", "", head.lower()).replace(" ", "-") for head in heads}
            assert anchor in slugs, f"{page.name} links to {target}"
