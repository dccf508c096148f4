"""Rows of a store are used again only as long as nothing has changed that the function of the sweep reaches."""

import importlib
import sys

import pytest

import vofem as vf

SCENE = """
mass = vf.Mass(1.0, stiffness=1.0, name="mass")
stop = vf.Contact(mass, gap=0.1, stiffness=STIFFNESS, side="above", acts_on="penetration", name="stop")
scene = vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(1.0, OMEGA))], {mass: (START, 0.0)})
"""


def scene(**changes):
    """Return the text that makes a scene."""
    text = SCENE
    for name, value in ({"STIFFNESS": "8.0", "OMEGA": "2.0", "START": "0.1"} | changes).items():
        text = text.replace(name, value)
    return text


#: What the blank is in the first session, and after the change.
VALUES = ("1.0", "5.0")

#: What a module holds, with a blank, and how the function uses it.
KINDS = {
    "a number": ("factor = BLANK", "factor"),
    "an array": ("series = np.array([1.0, BLANK])", "series[1]"),
    "a list in a dict": ("table = dict(rows=[1.0, BLANK])", "table['rows'][1]"),
    "a function": ("def helper(): return BLANK", "helper()"),
    "what a function calls": ("def inner(): return BLANK\ndef helper(): return inner()", "helper()"),
    "a body": ("mass = vf.Mass(BLANK, stiffness=1.0)", "mass.mass"),
    "an effect in a scene": (scene(STIFFNESS="BLANK"), "end(scene)"),
    "a load in a scene": (scene(OMEGA="BLANK"), "end(scene)"),
    "the initial state of a scene": (scene(START="BLANK"), "end(scene)"),
    "a function inside a beam": (
        "def width(x): return BLANK + x\nbeam = vf.Beam(1.0, lambda x: width(x), 1.0, 2)",
        "float(beam.EI(0.0))",
    ),
    "a method of an own class": ("class Own:\n    def value(self): return BLANK\nown = Own()", "own.value()"),
    "an own class that the function calls": (
        "class Base:\n    scale = BLANK\nclass Own(Base):\n    pass",
        "Own().scale",
    ),
    "an instance of an own class": ("class Own:\n    def __init__(self, a): self.a = a\nown = Own(BLANK)", "own.a"),
    "a dataclass": ("@dataclass\nclass Plate:\n    h: float\nplate = Plate(BLANK)", "plate.h"),
    "a namespace": ("settings = SimpleNamespace(h=BLANK)", "settings.h"),
    "a decorated function": ("@twice\ndef helper(): return BLANK", "helper()"),
    "a decorator": (
        "def scaled(f):\n    @functools.wraps(f)\n    def inner(): return BLANK * f()\n    return inner\n"
        "@scaled\ndef helper(): return 1.0",
        "helper()",
    ),
    "a cached function": ("@functools.lru_cache\ndef helper(): return BLANK", "helper()"),
    "a function in a dict": ("def one(): return BLANK\nfunctions = dict(one=one)", "functions['one']()"),
    "the choice of two lambdas of one line": (
        "f, g = lambda: 1.0, lambda: 5.0\nchosen = f if BLANK == 1.0 else g",
        "chosen()",
    ),
    "an object of an installed package": (
        "from scipy.interpolate import CubicSpline\nspline = CubicSpline([0.0, 1.0, 2.0], [BLANK, 0.0, 1.0])",
        "float(spline(0.0))",
    ),
}

#: The same for another module, `parts`, and what the module of the function imports from it.
OTHERS = {
    "a function of another module": ("def helper(): return BLANK", "from parts import helper", "helper()"),
    "another module": ("value = BLANK\ndef helper(): return value", "import parts", "parts.helper()"),
    "a scene of another module": ("import vofem as vf\nmass = vf.Mass(BLANK)", "import parts", "parts.mass.mass"),
    "a module that the function imports": ("def helper(): return BLANK", "", "imported()"),
}

MODULE = """
import functools
from dataclasses import dataclass
from types import SimpleNamespace
import numpy as np
import vofem as vf
{imports}

def twice(f):
    @functools.wraps(f)
    def inner():
        return 2 * f()
    return inner

def end(scene):
    return float(vf.simulate(scene, 1.0, compiled=False).displacement(scene.bodies[0])[-1])

def imported():
    from parts import helper
    return helper()

{text}

def measure(x):
    return {{"y": x * {use}}}
"""


def study(folder, monkeypatch, imports="", text="", use="1.0", parts="def helper(): return 1.0"):
    """Return the function of a new module as another session would import it."""
    folder.mkdir()
    (folder / "study.py").write_text(MODULE.format(imports=imports, text=text, use=use))
    (folder / "parts.py").write_text(parts)
    for name in ("study", "parts"):
        sys.modules.pop(name, None)
    monkeypatch.syspath_prepend(folder)
    importlib.invalidate_caches()
    return importlib.import_module("study").measure


def check(folder, made):
    """Compare sweeps of the function as it was first, once more, and after a change, with one store."""
    tables = []
    for number, which in enumerate((0, 0, 1)):
        function = made(folder / f"session-{number}", which)
        options = {"executor": "serial", "compiled": False}
        tables.append(vf.sweep(function, {"x": [1.0]}, store=folder / "rows.h5", **options))
        fresh = vf.sweep(function, {"x": [1.0]}, **options)
        assert tables[-1]["y"].tolist() == fresh["y"].tolist()
        assert fresh.failed == ()
    assert [table.counters["stored"] for table in tables] == [0, 1, 0]
    assert [table.notes for table in tables[:2]] == [(), ()]
    assert "rows of a changed function" in tables[2].notes[0]
    assert tables[2]["y"] != tables[0]["y"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_change_at_module_level_is_noticed(tmp_path, monkeypatch, kind):
    text, use = KINDS[kind]
    check(tmp_path, lambda folder, k: study(folder, monkeypatch, text=text.replace("BLANK", VALUES[k]), use=use))


@pytest.mark.parametrize("kind", OTHERS)
def test_a_change_in_another_module_of_the_user_is_noticed(tmp_path, monkeypatch, kind):
    text, imports, use = OTHERS[kind]
    check(tmp_path, lambda folder, k: study(folder, monkeypatch, imports, "", use, text.replace("BLANK", VALUES[k])))


def test_what_vofem_has_computed_for_a_scene_is_no_change(tmp_path, monkeypatch):
    """Matrices and modes are kept with a scene, and automatic names count on."""
    function = study(tmp_path / "session", monkeypatch, text=scene(), use="end(scene)")
    options = {"executor": "serial", "compiled": False, "store": tmp_path / "rows.h5"}
    vf.sweep(function, {"x": [1.0]}, **options)
    assert vf.sweep(function, {"x": [1.0]}, **options).counters["stored"] == 1


def test_what_has_no_known_content_is_named(tmp_path, monkeypatch):
    text = "import threading\nlock = threading.Lock()\nlines = (line for line in ['1.0'])"
    function = study(tmp_path / "session", monkeypatch, text=text, use="(lock.locked() + sum(map(float, lines)))")
    options = {"executor": "serial", "compiled": False}
    table = vf.sweep(function, {"x": [1.0]}, store=tmp_path / "rows.h5", **options)
    assert len(table.notes) == 1
    assert "changed since its rows were computed: lines (generator), lock (lock)" in table.notes[0]
    assert vf.sweep(function, {"x": [1.0]}, **options).notes == ()


def test_points_come_back_from_a_store_with_their_types(tmp_path):
    from vofem.studies.sweep.points import digest, node_of, value_of

    values = [
        1, 1.0, True, None, "a", b"a", 1 + 2j, (1, [2.0]), {"$a": 1, 2: (3,)}, {1, 2}, float("inf"), -0.0,
        [1, (2,)], {"a": {"b": []}},
    ]  # fmt: skip
    for value in values:
        back = value_of(node_of(value))
        assert (type(back), repr(back)) == (type(value), repr(value))
    assert len({digest(node_of(value)) for value in values}) == len(values)
    assert digest(node_of({"a": 1, "b": 2})) == digest(node_of({"b": 2, "a": 1}))
