"""Cards of notebooks: numbers, a figure, notes; and the notebook among the examples, cell by cell."""

import base64
import io
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
import pytest
from orbit_scenes import bilinear
from PIL import Image

import vofem as vf
from vofem.io.cards import card_of as card

pytestmark = pytest.mark.kernels("plain")

EXAMPLES = Path(__file__).parent.parent / "examples"


class Checker(HTMLParser):
    """Every tag that is opened is closed, in order."""

    def __init__(self):
        super().__init__()
        self.open, self.words = [], []

    def handle_starttag(self, tag, attrs):
        if tag != "img":
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def checked(html):
    """Return the text of a card and its figure."""
    checker = Checker()
    checker.feed(html)
    assert checker.open == []
    found = re.search(r"base64,([^\"]+)", html)
    picture = None if found is None else np.asarray(Image.open(io.BytesIO(base64.b64decode(found[1]))).convert("L"))
    return " ".join(checker.words), picture


@pytest.fixture(scope="module")
def scene():
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=4, supports={"left": "clamped"}, name="a<b & c")
    stop = vf.Contact(beam.at(1.0), gap=0.03, stiffness=1.0, side="below", acts_on="displacement", name="stop")
    return vf.Scene([beam], [stop, vf.PointLoad(beam.at(1.0), vf.Sine(0.1, 1.0))])


def test_the_card_of_a_run(scene):
    result = vf.simulate(scene, 12.0)
    result.notes.append("a note with <b>")
    html = result._repr_html_()
    text, picture = checked(html)
    assert "event_driven" in text
    assert f"{len(result.contacts['stop'].impacts)} impacts" in text
    assert "a note with <b>" in text
    assert "<b>" not in html
    assert picture.std() > 10.0
    assert len(html) < 60_000


def test_the_card_of_a_scene_and_of_what_will_be_done(scene):
    text, picture = checked(scene._repr_html_())
    assert scene.effects[0].describe() in text
    assert scene.bodies[0].summary() in text
    assert picture.shape == (240, 520)
    text, picture = checked(vf.explain(scene)._repr_html_())
    assert "event_driven, because" in text
    assert picture is None


@pytest.mark.kernels("compiled")
def test_the_cards_of_orbits_and_branches():
    orbit = vf.periodic(bilinear(1.0))
    text, picture = checked(orbit._repr_html_())
    assert "stable" in text
    assert f"{orbit.amplitude(orbit.scene.bodies[0]):.5g} m" in text
    assert picture.std() > 10.0
    branch = vf.continuation(bilinear, 1.0, 1.02, guess=orbit)
    text, picture = checked(branch._repr_html_())
    assert f"{len(branch)}, of which" in text
    assert picture.std() > 5.0


def test_the_card_of_a_table(scene):
    table = vf.simulate(scene, 12.0).impacts()
    text, _ = checked(table._repr_html_())
    assert "peak_force [N]" in text
    assert f"{table['impulse'][0]:.6g}" in text


def test_a_card_does_not_fail_for_its_figure(scene):
    few = vf.simulate(scene, 1.0, method="generalized_alpha", dt=1e-2, times=[1.0])
    text, picture = checked(few._repr_html_())
    assert picture is not None or "no figure" in text
    assert "3" in card(3)


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda path: path.name)
def test_a_notebook_runs_from_its_first_cell_to_its_last(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    notebook = json.loads(path.read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    names = {"__name__": path.stem}
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            continue
        assert cell["outputs"] == [], "outputs are not kept in the repository"
        assert cell["execution_count"] is None
        lines = "".join(cell["source"]).splitlines()
        *before, last = _statements("\n".join(lines))
        exec(compile("\n".join(before), path.name, "exec"), names)
        exec(compile(f"shown = (\n{last}\n)" if _is_expression(last) else last, path.name, "exec"), names)
        if hasattr(names.get("shown"), "_repr_html_"):
            checked(names["shown"]._repr_html_())
    # The play is 1 mm: the tip goes through it, and the stops give way a little.
    assert 1.0e-3 < np.max(np.abs(names["result"].displacement(names["beam"].at(0.5)))) < 2.0e-3
    assert names["movie"].frames == 50


def _statements(source):
    import ast

    return [ast.get_source_segment(source, node) for node in ast.parse(source).body]


def _is_expression(source):
    import ast

    return isinstance(ast.parse(source).body[0], ast.Expr)
