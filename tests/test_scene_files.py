"""Scene files: a scene goes to TOML and back bit for bit; a file's problems are reported all at once."""

import contextlib
import os
import pickle
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import cantilever, paper_beam

import vofem as vf
from vofem.files import toml_text
from vofem.io.scene_file import OutputSettings, RunSettings, scene_to_toml
from vofem.io.scenes.schema import BODIES, EFFECTS, json_schema, keys, read_table
from vofem.io.scenes.settings import UniformTimes
from vofem.parameters import Real, declarations
from vofem.parameters.place import Book, Place
from vofem.time_functions import OfTime, Scaled, Sum

MESHES = Path(__file__).parent.parent / "meshes"


def reload(scene, tmp_path, **more):
    """Write and read a scene."""
    return vf.load_scene(vf.dump_scene(scene, tmp_path / "scene.toml", overwrite=True, **more)).scene


def assert_same_system(one, two):
    first, second = one.model.system, two.model.system
    for name in ("mass", "stiffness", "damping"):
        a, b = getattr(first, name), getattr(second, name)
        assert (a is None) == (b is None)
        if a is not None:
            assert np.array_equal(a.toarray(), b.toarray()), name
    for t in (0.0, 0.3, 1.7):
        assert np.array_equal(first.force(t), second.force(t))
    assert (first.contacts is None) == (second.contacts is None)
    if first.contacts is not None:
        assert np.array_equal(first.contacts.rows.toarray(), second.contacts.rows.toarray())
        for name in ("gap", "stiffness", "damping", "jump", "resolution"):
            assert np.array_equal(getattr(first.contacts, name), getattr(second.contacts, name)), name
        assert first.contacts.names == second.contacts.names
    start, again = one.initial_state(), two.initial_state()
    assert np.array_equal(start.q, again.q)
    assert np.array_equal(start.v, again.v)


def assert_round_trip(scene, tmp_path):
    again = reload(scene, tmp_path)
    assert [body.name for body in again.bodies] == [body.name for body in scene.bodies]
    assert [effect.describe() for effect in again.effects] == [effect.describe() for effect in scene.effects]
    assert_same_system(scene, again)
    assert scene_to_toml(again, folder=tmp_path) == scene_to_toml(scene, folder=tmp_path)


# -- round trips ------------------------------------------------------------------------------------


EVERY_FUNCTION = [
    2.5,
    vf.Constant(-0.1),
    vf.Sine(0.1, 1.0),
    vf.Sine(0.1, 1.0, phase=1 / 3),
    vf.Ramp(0.3),
    vf.Ramp(0.3, 0.1, 0.7),
    vf.Pulse(1.0, 0.1, 0.2),
    vf.Tabulated([0.0, 0.1, 1e-300 + 2.0], [0.0, -1e-17, 1.0]),
    vf.Sine(0.1, 1.0) + vf.Ramp(2.0) * 0.1,
    2.0 - (vf.Pulse(1.0, 0.1, 0.2) + 3.0) * -0.7,
]


def every_effect():
    """A scene with every effect that the package has, and points of every kind."""
    deck = vf.Beam(2.0, 3.0, 0.7, 6, {"left": "pinned", 1.0: "pinned"}, tension=0.3, name="deck")
    rod = vf.Beam(1.0, [1.0, 2.0], vf.Polynomial([1.0, 0.1]), [-0.3, 0.1, 0.7], {"right": "guided"}, name="rod @ 2")
    ball = vf.Mass(1.0, 2.0, 0.1, name='ball "1"\n')
    effects = [
        vf.PointLoad(deck.at(0.1), vf.Sine(1.0, 2.0)),
        vf.Contact(deck.at(1.7), ball, gap=-0.1, stiffness=3.0, damping=0.1, acts_on="penetration"),
        vf.PointMoment(rod.at(0.1), 1.0),
        vf.Contact(rod.at("left"), gap=0.1, stiffness=3.0, side="above", acts_on="displacement", name="c ö"),
        vf.Contact(rod.at(0.7), gap=0.1, stiffness=3.0, side="below", acts_on="penetration", switch=vf.Resolved(1e3)),
        vf.Spring(deck.at(0.0), rod.at(0.5), stiffness=1.0),
        vf.Dashpot(ball, damping=0.2),
        vf.Spring(ball, stiffness=0.2),
        vf.RotationalSpring(rod.at("left"), stiffness=2.0),
        vf.PointMass(ball, mass=0.1),
        vf.PointMass(rod.at(0.1), mass=0.1, inertia=0.01),
        vf.DistributedLoad(deck, vf.Polynomial([0.0, 1 / 3]), vf.Ramp(1.0)),
        vf.DistributedLoad(rod, 0.1),
        vf.Gravity(),
        vf.PointLoad(ball, 1),
        vf.Foundation(deck, stiffness=vf.Polynomial([1.0, 0.1]), name="soil"),
        vf.Foundation(rod, stiffness=2.0, one_sided=True, gap=0.1),
        vf.HystereticSpring(ball, deck.at(0.4), stiffness=1.0, linear_limit=5.0, memory="cyclic", name="link"),
        vf.CrushingStop(
            ball, gap=-0.1, side="above", stiffness=2.0, linear_limit=0.1, softening=vf.LinearSoftening(0.3)
        ),
        vf.BilinearSpring(ball, stiffness=1.0, linear_limit=5.0, hardening=0.1),
        vf.IwanSpring(rod.at(0.7), elongation=[1.0, 1 / 3 + 1], force=[1.0, 1.2], name="joint"),
        vf.Springpot(rod.at(0.3), ball, coefficient=0.7, order=1 / 3, name="gel"),
        vf.Springpot(ball, coefficient=2.0, order=vf.fractional.TabulatedOrder([0.0, 1 / 3], [0.2, 0.9])),
        vf.RayleighDamping(0.1, 0.01),
        vf.ModalDamping(0.02),
        *(vf.BaseMotion(body, vf.Sine(1.0, 2.0)) for body in (deck, ball, rod)),
        *(vf.PointLoad(ball, f) for f in EVERY_FUNCTION),
    ]
    initial = {ball: (0.1, -1 / 3), rod: (0.0, vf.Polynomial([0.49, -1.4, 1.0]))}
    return vf.Scene([deck, ball, rod], effects, initial)


def test_every_class_and_their_order(tmp_path):
    scene = every_effect()
    assert_round_trip(scene, tmp_path)
    again = reload(scene, tmp_path)
    assert [type(effect) for effect in again.effects] == [type(effect) for effect in scene.effects]
    assert [type(e.f) for e in again.effects[-len(EVERY_FUNCTION) :]] == [
        type(e.f) for e in scene.effects[-len(EVERY_FUNCTION) :]
    ]
    assert again.bodies[2].EI.tolist() == [1.0, 2.0]
    assert again.bodies[2].elements.tolist() == [-0.3, 0.1, 0.7]


def test_every_effect_of_the_package_is_in_the_schema_or_refused():
    """A new effect must get an entry here, or a reason in this list."""
    without_entry = {
        "Resolved",
        "TimeFunction",
        "Approximated",
        "NonlinearSpring",
        "LinearSoftening",
        "MaterialDamping",
    }
    functions = {"Sine", "Constant", "Ramp", "Pulse", "Tabulated"}
    known = {cls.__name__ for cls in EFFECTS.values()}
    assert set(vf.effects.__all__) - known - without_entry - functions == set()


@pytest.mark.parametrize("name", ["beam25.msh", "beam25.vtu", "beam25.med", "graded.msh", "inclined.msh"])
def test_meshes(name, tmp_path):
    beam = vf.Beam.from_mesh(MESHES / name, 1.0, 2.0, {"root": "clamped", "tip": "pinned"}, name="b")
    assert_round_trip(vf.Scene([beam], [vf.PointLoad(beam.at(beam.nodes[3]), 1.0)]), tmp_path)


def test_subdomains_of_a_mesh_keep_their_names(tmp_path):
    values = {"thick": 2.0, "thin": 1.0}
    beam = vf.Beam.from_mesh(MESHES / "stepped.msh", values, 1.0, {"root": "clamped", "step": "pinned"}, name="b")
    scene = vf.Scene([beam], [vf.PointLoad(beam.at("tip"), 1.0)])
    assert_round_trip(scene, tmp_path)
    table = tomllib.loads(scene_to_toml(scene, folder=tmp_path))["beam"][0]
    assert table["EI"] == values
    assert table["supports"]["step"] == "pinned"
    assert not os.path.isabs(table["mesh"])


def test_mesh_paths_start_at_the_scene_file(tmp_path, monkeypatch):
    (tmp_path / "sub").mkdir()
    (tmp_path / "beam.msh").write_bytes((MESHES / "beam25.msh").read_bytes())
    monkeypatch.chdir(tmp_path)
    beam = vf.Beam.from_mesh("beam.msh", 1.0, 1.0, name="b")
    vf.dump_scene(vf.Scene([beam]), "sub/scene.toml")
    assert 'mesh = "../beam.msh"' in Path("sub/scene.toml").read_text()
    monkeypatch.chdir("/")
    assert vf.load_scene(tmp_path / "sub" / "scene.toml").scene.bodies[0].size == 52


def test_a_point_whose_short_name_means_another_body(tmp_path):
    beam, mass = vf.Beam(1.0, 1.0, 1.0, 2, name="b"), vf.Mass(1.0, name="b@1.0")
    scene = vf.Scene([beam, mass], [vf.PointLoad(beam.at(1.0), 1.0), vf.PointLoad(mass, 2.0)])
    assert_round_trip(scene, tmp_path)
    assert isinstance(reload(scene, tmp_path).effects[0].point.body, vf.Beam)


def test_run_and_output_settings(tmp_path):
    beam, scene = paper_beam("displacement")
    run = RunSettings(2.0, "event_driven", times=UniformTimes(0.0, 2.0, 11), options={"max_events": 70})
    path = vf.dump_scene(scene, tmp_path / "s.toml", run, OutputSettings((beam.at(1.0), beam.at(0.5)), (1.0, 1.5)))
    again = vf.load_scene(path)
    assert (again.run.t_end, again.run.method, again.run.options) == (2.0, "event_driven", {"max_events": 70})
    assert again.output.pictures == (1.0, 1.5)
    assert [point.x for point in again.output.history] == [1.0, 0.5]
    assert np.array_equal(again.simulate().times, np.linspace(0.0, 2.0, 11))
    listed = vf.load_scene(vf.dump_scene(scene, path, RunSettings(2.0, times=[0.0, 1 / 3]), overwrite=True))
    assert listed.simulate(t_end=1.0).times.tolist() == [0.0, 1 / 3]
    with pytest.raises(vf.ArgumentError, match="does not say how long to run"):
        vf.load_scene(vf.dump_scene(scene, path, overwrite=True)).simulate()


def test_respond_settings(tmp_path):
    """All that a file says is written again; a path that no longer leads to a number is told."""
    source = Path(__file__).parent.parent / "examples" / "two_masses_response.toml"
    text = source.read_text().replace('point = "b"\n\n', 'point = "b"\nperiods = 2\nharmonics = 9\n\n', 1)
    (tmp_path / "first.toml").write_text(text)
    file = vf.load_scene(tmp_path / "first.toml")
    path = vf.dump_scene(file.scene, tmp_path / "second.toml", file.run, file.output, file.respond)
    again = vf.load_scene(path)
    assert again.respond.parameter == file.respond.parameter == ("point_load[0].f.sine.omega",)
    assert (again.respond.periods, again.respond.harmonics, again.respond.method) == (2, 9, "auto")
    assert again.respond.point is again.scene.bodies[1]
    assert again.at(0.7).effects[-1].f.omega == 0.7
    without = vf.Scene(file.scene.bodies, file.scene.effects[:-1])
    with pytest.raises(vf.SceneFileError, match="point_load"):
        vf.dump_scene(without, tmp_path / "third.toml", respond=file.respond)
    assert not (tmp_path / "third.toml").exists()


def test_a_scene_file_that_exists_is_kept(tmp_path):
    """It may be one that a user wrote, with comments."""
    path = tmp_path / "scene.toml"
    path.write_text("# mine\n")
    scene = vf.Scene([vf.Mass(1.0, name="m")])
    with pytest.raises(vf.OutputError, match=r"exists already and was left as it is; .* overwrite=True"):
        vf.dump_scene(scene, path)
    assert path.read_text() == "# mine\n"
    vf.dump_scene(scene, path, overwrite=True)
    assert vf.load_scene(path).scene.bodies[0].name == "m"


numbers = st.floats(-1e50, 1e50)
positive = st.floats(1e-30, 1e30)


def has_slopes(t):
    """Whether a table of these values at these times, sorted, stays within the range of double precision."""
    with np.errstate(over="ignore"):
        return bool(np.all(np.isfinite(np.diff(t) / np.diff(sorted(t)))))


names = st.text(min_size=1, max_size=8).filter(lambda text: text.isprintable() or "\n" in text)
time_functions = st.recursive(
    st.one_of(
        numbers,
        st.builds(vf.Sine, numbers, numbers, numbers),
        st.builds(lambda a, b, c: vf.Ramp(a, min(b, c), max(b, c) + 1e40), numbers, numbers, numbers),
        st.builds(vf.Pulse, numbers, numbers, positive),
        st.lists(numbers, min_size=1, unique=True).filter(has_slopes).map(lambda t: vf.Tabulated(sorted(t), t)),
    ),
    lambda inner: st.builds(lambda a, b, c: (vf.Constant(0.0) + a) * 0.5 + b * 1.0 * c, inner, inner, st.just(1.0)),
    max_leaves=3,
)


@given(st.data())
@settings(max_examples=60)
def test_random_scenes(tmp_path_factory, data):
    draw = data.draw
    labels = draw(st.lists(names, min_size=2, max_size=4, unique=True))
    bodies = [vf.Mass(draw(positive), draw(positive), draw(positive), name=name) for name in labels[1:]]
    length = draw(st.floats(1e-3, 1e3))
    beam = vf.Beam(length, draw(positive), draw(positive), draw(st.integers(1, 5)), {"left": "pinned"}, name=labels[0])
    points = [*bodies, beam.at(draw(st.floats(0.0, 1.0)) * length)]
    pick = st.sampled_from(points)
    kinds = [
        lambda: vf.PointLoad(draw(pick), draw(time_functions)),
        lambda: vf.Spring(draw(pick), stiffness=draw(positive)),
        lambda: vf.Contact(
            draw(pick), gap=draw(numbers), stiffness=draw(positive), side="above", acts_on="penetration"
        ),
        lambda: vf.PointMass(draw(pick), mass=draw(positive)),
    ]
    effects = [draw(st.sampled_from(kinds))() for _ in range(draw(st.integers(0, 5)))]
    initial = {body: (draw(numbers), draw(numbers)) for body in bodies[:1]}
    scene = vf.Scene([*bodies, beam], effects, initial)
    folder = tmp_path_factory.mktemp("random")
    again = reload(scene, folder)
    text = scene_to_toml(scene, folder=folder)
    assert scene_to_toml(again, folder=folder) == text
    for one, two in zip(scene.effects, again.effects, strict=True):
        assert type(one) is type(two)
        for key in keys(type(one)):
            a, b = getattr(one, key), getattr(two, key)
            if isinstance(a, vf.TimeFunction):
                t = np.linspace(0.0, 3.0, 7)
                assert np.array_equal(a(t), b(t))
            elif isinstance(a, float):
                assert a == b
    assert again.bodies[0].mass == bodies[0].mass
    assert again.initial[again.bodies[0]] == initial[bodies[0]]


@given(st.dictionaries(st.text(), st.one_of(st.text(), st.booleans(), st.integers(-(2**62), 2**62), st.floats())))
def test_text_is_toml(content):
    """Whatever the characters of keys and strings."""
    try:
        str(content).encode()
        "".join(content).encode()
        "".join(v for v in content.values() if isinstance(v, str)).encode()
    except UnicodeEncodeError:
        return
    again = tomllib.loads(toml_text.table("", {"inside": content, "list": list(content.values())}))
    assert repr(again["inside"]) == repr(content)
    assert repr(again["list"]) == repr(list(content.values()))


def test_long_arrays_are_wrapped():
    text = toml_text.table("[x]", {"a": [1 / 3] * 100})
    assert max(map(len, text.splitlines())) <= 130
    assert tomllib.loads(text)["x"]["a"] == [1 / 3] * 100


# -- what cannot be written -------------------------------------------------------------------------


def test_what_has_no_form_in_toml_is_listed(tmp_path):
    beam = vf.Beam(1.0, lambda x: 1.0 + x, 1.0, 2, {"left": "clamped"}, name="b")
    mass = vf.Mass(1.0, name="m")
    loads = [vf.PointLoad(mass, np.sin), vf.PointLoad(mass, vf.Sine(1.0, 1.0) + np.cos)]
    scene = vf.Scene([beam, mass], [*loads, vf.DistributedLoad(beam, np.sin)], {beam: (lambda x: x**2, 0.0)})
    with pytest.raises(vf.SceneFileError) as caught:
        vf.dump_scene(scene, tmp_path / "s.toml")
    found = dict(caught.value.problems)
    assert set(found) == {
        "beam[0].EI",
        "point_load[0].f",
        "point_load[1].f",
        "distributed_load[0].p",
        "initial.b.displacement",
    }
    assert "is a callable, which a scene file cannot hold; use one of sine, constant" in found["point_load[0].f"]
    assert "vofem.Polynomial" in found["beam[0].EI"]
    assert not (tmp_path / "s.toml").exists()


def test_foreign_effects_and_outcomes_cannot_be_written(tmp_path):
    class Mine(vf.Gravity):
        pass

    mass = vf.Mass(1.0, 1.0, name="m")
    cubic = vf.NonlinearSpring(mass, potential=lambda u: u**4 / 4, force=lambda u: u**3)
    scene = vf.Scene([mass], [Mine(), cubic], vf.equilibrium(vf.Scene([mass])))
    with pytest.raises(vf.SceneFileError, match="NonlinearSpring cannot be written to a scene file") as caught:
        scene_to_toml(scene)
    assert [path for path, _ in caught.value.problems] == ["effects[0]", "effects[1]", "initial"]
    springs = [vf.Spring(mass, stiffness=1.0, name="s"), vf.Spring(mass, stiffness=2.0, name="s")]
    with pytest.raises(vf.SceneFileError, match=r"spring\[1\]\.name: 's' is already the name of spring\[0\]"):
        vf.dump_scene(vf.Scene([mass], springs), tmp_path / "scene.toml")
    with pytest.raises(vf.ArgumentError, match=r"expected a vofem\.Scene"):
        vf.dump_scene(mass, "x.toml")
    with pytest.raises(vf.OutputError):
        vf.dump_scene(vf.Scene([mass]), "/no/such/folder/x.toml")


# -- what is wrong in a file ------------------------------------------------------------------------

GOOD = """
[run]
t_end = 2.0
[[beam]]
name = "deck"
length = 1.0
elements = 4
EI = 1.0
rhoA = 1.0
supports = { left = "clamped" }
[[mass]]
name = "ball"
mass = 1.0
[[contact]]
name = "stop"
a = "deck@1.0"
gap = 0.1
stiffness = 1.0
side = "below"
acts_on = "displacement"
[[point_load]]
point = "ball"
f = 1.0
[initial]
ball = { velocity = 1.0 }
"""


def problems(text, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(vf.SceneFileError) as caught:
        vf.load_scene(path)
    assert isinstance(caught.value, (vf.VofemError, ValueError))
    assert str(path) in str(caught.value)
    for where, message in caught.value.problems:
        assert where in str(caught.value)
        assert message in str(caught.value)
    return list(caught.value.problems)


ONE = [
    ("t_end = 2.0", "t_end = -2.0", "run.t_end", "expected a positive number, found -2.0"),
    ("t_end = 2.0", "", "run.t_end", "missing, expected a positive number"),
    ("t_end = 2.0", "t_end = 2\nmethd = 'auto'", "run.methd", "unknown key; did you mean 'method'?"),
    ("t_end = 2.0", "t_end = 2\nmethod = 'evnt_driven'", "run.method", "did you mean 'event_driven'?"),
    ("t_end = 2.0", "t_end = 2\nmethod='event_driven'\ndt = 1", "run.dt", "has no meaning for event_driven"),
    ("t_end = 2.0", "t_end = 2\nmethod='central_difference'\nmax_events = 9", "run.max_events", "is no option of"),
    ("t_end = 2.0", "t_end = 2\nmax_events = 'x'", "run.max_events", "expected a number, found 'x'"),
    ("t_end = 2.0", "t_end = 2\ntimes = [0, 1, 0.5]", "run.times", "found 1.0 followed by 0.5"),
    ("t_end = 2.0", "t_end = 2\ntimes = [0, 3]", "run.times", "times reaches to 3 s, beyond t_end = 2 s"),
    ("t_end = 2.0", "t_end = 2\ntimes = 3", "run.times", "expected a table { start = ..., stop"),
    ("t_end = 2.0", "t_end = 2\ntimes = {start=0,stop=2,count=2.5}", "run.times.count", "expected a whole number"),
    ("t_end = 2.0", "t_end = 2\ntimes = {start=0,stop=2,count=1000000000000}", "run.times.count", "from 1 to 10000000"),
    ("t_end = 2.0", "t_end = 2\ntimes = {start=2,stop=1,count=5}", "run.times.stop", "not before start = 2 s"),
    ("[run]\nt_end = 2.0", "run = 3", "run", "expected one table, headed [run], found 3"),
    ("[run]", "[runn]", "runn", "unknown key; did you mean 'run'?"),
    ("[run]", "[output]\nhistory = ['deck@2', 'ball']\n[run]", "output.history[0]", "from 0 to 1 m"),
    ("[run]", "[output]\npictures = -1\n[run]", "output.pictures", "expected a number that is not negative"),
    ('name = "deck"', 'name = ""', "beam[0].name", "expected a name, a string that is not empty, found ''"),
    ('name = "deck"', 'name = "ball"', "mass[0].name", "'ball' is already the name of beam[0]"),
    ("length = 1.0", "length = inf", "beam[0].length", "expected a finite number (magnitude at most 1e+60), found inf"),
    ("length = 1.0", f"length = 1{'0' * 200}", "beam[0].length", "found a whole number of 201 digits"),
    ("length = 1.0", "", "beam[0].length", "missing, expected a positive number (or mesh"),
    ("length = 1.0", "length = 1.0\nmesh = 'x.msh'", "beam[0].length", "length is given by the mesh file; remove it"),
    ("length = 1.0\nelements = 4", "mesh = 'no.msh'", "beam[0].mesh", "does not exist"),
    ("length = 1.0\nelements = 4", "mesh = 3", "beam[0].mesh", "expected the path of a mesh file"),
    ("elements = 4", "elements = 4.0", "beam[0].elements", "expected a whole number or an array of the x of all nodes"),
    ("elements = 4", "elements = [0, 'x', 1]", "beam[0].elements[1]", "expected a number, found 'x'"),
    ("elements = 4", "elements = [0, 0.6, 0.5, 1]", "beam[0].elements", "node x must increase"),
    ("EI = 1.0", "EI = [1.0, 2.0]", "beam[0].EI", "has shape (2,), expected (4,)"),
    ("EI = 1.0", "EI = [1.0, 2.0, 0.0, 1.0]", "beam[0].EI[2]", "expected a positive number, found 0.0"),
    ("EI = 1.0", "EI = { thick = 1.0 }", "beam[0].EI", "only a beam from a mesh has named subdomains"),
    ("EI = 1.0", "EI = { polynomal = [1.0] }", "beam[0].EI.polynomal", "unknown key; did you mean 'polynomial'?"),
    ("EI = 1.0", "EI = { polynomial = [1.0, -3.0] }", "beam[0].EI", "expected a positive number"),
    ("EI = 1.0", "EI = { polynomial = [] }", "beam[0].EI.polynomial", "expected an array of numbers, found an empty"),
    ("EI = 1.0", "EI = '1'", "beam[0].EI", "expected a positive number, an array of one per element"),
    ('{ left = "clamped" }', '{ left = "clampd" }', "beam[0].supports.left", "did you mean 'clamped'?"),
    ('{ left = "clamped" }', '{ lift = "clamped" }', "beam[0].supports", "did you mean 'left'?"),
    ('{ left = "clamped" }', '{ "0.3" = "clamped" }', "beam[0].supports", "not a node; the nearest are 0.25 and 0.5"),
    ('{ left = "clamped" }', '{ 0.5 = "clamped" }', "beam[0].supports.0", "an x needs quotes, such as '0.5' ="),
    ('{ left = "clamped" }', '"left"', "beam[0].supports", "expected a table such as { left = 'clamped'"),
    ("mass = 1.0", "mass = 2020-01-01", "mass[0].mass", "found a date or time, 2020-01-01"),
    ("[[mass]]\n", "[[mas]]\n", "mas", "unknown key; did you mean 'mass'?"),
    ('a = "deck@1.0"', 'a = "dek@1.0"', "contact[0].a", "found 'dek'; did you mean 'deck'?"),
    ('a = "deck@1.0"', 'a = "deck"', "contact[0].a", "expected a point of a beam, found 'deck'"),
    ('a = "deck@1.0"', 'a = "deck@nan"', "contact[0].a", "NaN"),
    ('a = "deck@1.0"', 'a = "deck@rigth"', "contact[0].a", "did you mean 'right'?"),
    ('a = "deck@1.0"', 'a = "deck@1.5"', "contact[0].a", "from 0 to 1 m"),
    ('a = "deck@1.0"', 'a = "ball@1.5"', "contact[0].a", "Mass 'ball' has no axis; write 'ball' alone"),
    ('a = "deck@1.0"', "a = 1.0", "contact[0].a", "expected a point, such as 'beam@1.0', or the name of a mass"),
    ('a = "deck@1.0"', "a = { body = 'deck' }", "contact[0].a.at", "missing, expected an x"),
    ('a = "deck@1.0"', "a = { body = 'dck', at = 1 }", "contact[0].a.body", "did you mean 'deck'?"),
    ('a = "deck@1.0"', "a = { body = 'deck', at = nan }", "contact[0].a.at", "found nan"),
    ('a = "deck@1.0"', "", "contact[0].a", "missing, expected a point"),
    ("gap = 0.1", "gap = -0.1", "contact[0].gap", "a preloaded contact needs acts_on='penetration'"),
    ('side = "below"', 'side = "belw"', "contact[0].side", "did you mean 'below'?"),
    ('side = "below"', "", "contact[0].side", "missing, expected one of 'below', 'above' for a stop"),
    ('side = "below"', 'side = "below"\nb = "ball"', "contact[0].side", "a contact between two points has none"),
    ('acts_on = "displacement"', "", "contact[0].acts_on", "missing, expected one of 'displacement', 'penetration'"),
    ('side = "below"', 'side = "below"\nswitch = "idel"', "contact[0].switch", "expected 'ideal' or { resolved"),
    ("f = 1.0", "f = 'sin'", "point_load[0].f", "expected a number or a function of time such as { sine"),
    ("f = 1.0", "f = { sine = 3 }", "point_load[0].f.sine", "a table with amplitude, omega, phase, frequency, found 3"),
    ("f = 1.0", "f = { sine = {amplitude=1, omega=2}, ramp = {slope=1} }", "point_load[0].f", "with sine, ramp"),
    ("f = 1.0", "f = { ramp = {slope=1, start=2, stop=1} }", "point_load[0].f.ramp.stop", "a time after start = 2"),
    ("f = 1.0", "f = { sum = [] }", "point_load[0].f.sum", "expected an array of functions of time"),
    ("f = 1.0", "f = { sum = [1, {constant='x'}] }", "point_load[0].f.sum[1].constant", "expected a number, found 'x'"),
    ("f = 1.0", "f = { tabulated = {t=[0,0], values=[1,2]} }", "point_load[0].f.tabulated.t", "must increase strictly"),
    ("f = 1.0", "f = 1.0\n[[rotational_spring]]\npoint='ball'\nstiffness=1", "rotational_spring[0].point", "no slope"),
    ("f = 1.0", "f = 1.0\n[[distributed_load]]\nbeam='ball'\np=1", "distributed_load[0].beam", "which is a mass"),
    ("f = 1.0", "f = 1.0\n[[contact]]\nname='stop'\na='ball'\ngap=1\nstiffness=1\nside='above'\nacts_on='penetration'",
     "contact[1].name", "'stop' is already the name of contact[0]"),
    ("ball = { velocity", "bal = { velocity", "initial.bal", "did you mean 'ball'?"),
    ("velocity = 1.0", "velocity = {polynomial = [1]}", "initial.ball.velocity", "expected a number, found a table"),
    ("ball = { velocity = 1.0 }", "ball = 3", "initial.ball", "a table with displacement and velocity, found 3"),
    ("ball = { velocity = 1.0 }", "deck = { displacement = 1 }", "initial.deck.displacement", "beam is clamped"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "path", "message"), ONE, ids=lambda v: str(v)[:40])
def test_one_problem(old, new, path, message, tmp_path):
    assert GOOD.count(old) >= 1
    found = problems(GOOD.replace(old, new, 1), tmp_path)
    assert [where for where, _ in found if where == path] == [path], found
    assert message in dict(found)[path]
    # What is misnamed is missing as well, for the key's table and for those who refer to it.
    most = 4 if "already" in message else 3 if path == "mas" or "mesh" in new else 2 if "unknown" in message else 1
    assert len(found) <= (2 if new == 'name = ""' else most), found


def test_the_good_file_is_good(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text("\ufeff" + GOOD, encoding="utf-8")
    assert [body.name for body in vf.load_scene(path).scene.bodies] == ["deck", "ball"]


def test_all_problems_together(tmp_path):
    text = GOOD
    wanted = {}
    for old, new, path, message in (
        ("t_end = 2.0", "t_end = true", "run.t_end", "found true"),
        ("elements = 4", "elements = 4\nsuports = {}", "beam[0].suports", "did you mean 'supports'?"),
        ("mass = 1.0", "mass = nan", "mass[0].mass", "found nan"),
        ('a = "deck@1.0"', 'a = "dck@1.0"', "contact[0].a", "did you mean 'deck'?"),
        ("gap = 0.1", "gap = -0.1", "contact[0].gap", "a preloaded contact"),
        ('side = "below"', "", "contact[0].side", "missing"),
        ("\nstiffness = 1.0", "\nstiffness = -1.0", "contact[0].stiffness", "found -1.0"),
        ("f = 1.0", "f = { sine = { amplitud = 1.0 } }", "point_load[0].f.sine.amplitud", "unknown key"),
        ("velocity = 1.0", "velocity = inf", "initial.ball.velocity", "found inf"),
    ):
        text = text.replace(old, new, 1)
        wanted[path] = message
    found = problems(text, tmp_path)
    for path, message in wanted.items():
        assert message in dict(found)[path]
    assert {path for path, _ in found} - set(wanted) == {"point_load[0].f.sine.amplitude", "point_load[0].f.sine.omega"}


toml_values = st.recursive(
    st.one_of(
        st.booleans(),
        st.integers(),
        st.floats(),
        st.sampled_from(["", "deck", "ball", "deck@1.0", "@", "deck@", "@1", "deck@@left", "ideal", "left", "x\0y"]),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.dictionaries(st.sampled_from(["sine", "sum", "polynomial", "body", "at", "x", "1.0"]), inner, max_size=3),
    ),
    max_leaves=5,
)


def places(table):
    """Return (container, key) of every value in nested tables and arrays."""
    found = []
    for key, value in list(table.items()) if isinstance(table, dict) else list(enumerate(table)):
        found.append((table, key))
        if isinstance(value, (dict, list)):
            found += places(value)
    return found


@given(st.data())
@settings(max_examples=75)
def test_whatever_is_in_a_file_it_loads_or_has_a_typed_error(tmp_path_factory, data):
    whole = tomllib.loads(scene_to_toml(every_effect()))
    whole |= {"run": {"t_end": 1.0, "times": {"start": 0.0, "stop": 1.0, "count": 3}}, "output": {"history": "deck@1"}}
    for _ in range(data.draw(st.integers(1, 3))):
        container, key = data.draw(st.sampled_from(places(whole)))
        if data.draw(st.booleans()) or isinstance(container, list):
            container[key] = data.draw(toml_values)
        else:
            container[data.draw(st.sampled_from(["nmae", "mesh", "name", "f"]))] = container.pop(key)
    path = tmp_path_factory.getbasetemp() / "mutant.toml"
    path.write_text(toml_text.table("", whole), encoding="utf-8")
    with contextlib.suppress(vf.SceneFileError):
        vf.load_scene(path)


def test_a_broken_body_is_reported_once(tmp_path):
    """What refers to it is not another problem."""
    assert [path for path, _ in problems(GOOD.replace("EI = 1.0", "EI = -1.0"), tmp_path)] == ["beam[0].EI"]


def test_the_error_keeps_its_problems(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text("")
    with pytest.raises(ValueError, match="there are no bodies") as caught:
        vf.load_scene(path)
    again = pickle.loads(pickle.dumps(caught.value))
    assert again.problems == caught.value.problems
    assert str(again) == str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[run\nt_end = 1", "line 1, column 5: "),
        ("[run]\nt_end = ", "line 2, column 9: "),
        ("[run]\nt_end = 1\nt_end = 2\n", "line 3, column "),
        ("x = '''", "line 1, column 8: "),
        ("x = " + "[" * 5000, "nested too deeply"),
        (f"x = 1{'0' * 5000}", "integer"),
        (b"[run]\nname = '\xe4'\n", "line 2 is not UTF-8 (byte 0xe4)"),
        (b"\x00", "line 1, column 1"),
    ],
)
def test_files_that_are_no_toml(content, message, tmp_path):
    found = problems(content, tmp_path)
    assert len(found) == 1
    assert message in found[0][1]


def test_the_first_scene_of_the_docs_comes_back(tmp_path):
    text = (Path(__file__).parent.parent / "docs" / "first-scene.md").read_text(encoding="utf-8")
    (tmp_path / "s.toml").write_text(text.split("```toml\n")[1].split("```")[0])
    file = vf.load_scene(tmp_path / "s.toml")
    assert file.simulate(t_end=1.0).counters.steps
    assert_round_trip(file.scene, tmp_path)


def test_files_that_are_not_there(tmp_path):
    (tmp_path / "cantilever.toml").write_text("")
    with pytest.raises(vf.SceneFileError, match=r"does not exist; .*; did you mean 'cantilever\.toml'\?"):
        vf.load_scene(tmp_path / "cantilver.toml")
    with pytest.raises(vf.SceneFileError, match="this is a directory"):
        vf.load_scene(tmp_path)
    with pytest.raises(vf.ArgumentError, match="expected the name of a scene file"):
        vf.load_scene(3)


def test_headers_tell_the_order_where_they_can(tmp_path):
    """Tables given inline are not under headers; then bodies of a kind stay together."""
    path = tmp_path / "s.toml"
    path.write_text("[[mass]]\nname='a'\nmass=1\n[[beam]]\nname='b'\nlength=1\nelements=1\nEI=1\nrhoA=1\n"
                    "[[ mass ]] # [[mass]]\nname='c'\nmass=1\n[gravity]\n")  # fmt: skip
    file = vf.load_scene(path)
    assert [body.name for body in file.scene.bodies] == ["a", "b", "c"]
    assert file.scene.effects[0].g == 9.81
    path.write_text("mass = [{name='a', mass=1}, {name='b', mass=2}]\nspring = [{a='b', stiffness=1}]\n")
    assert [body.name for body in vf.load_scene(path).scene.bodies] == ["a", "b"]


def test_contacts_without_a_name_are_numbered(tmp_path):
    path = tmp_path / "s.toml"
    contact = "[[contact]]\na='m'\ngap=1\nstiffness=1\nside='above'\nacts_on='penetration'\n"
    path.write_text(f"[[mass]]\nname='m'\nmass=1\n{contact}{contact}name='contact-1'\n{contact}")
    for _ in range(2):
        names = [contact.name for contact in vf.load_scene(path).scene.contacts]
        assert names == ["contact-2", "contact-1", "contact-3"]


NUMERIC = [
    (cls, key)
    for cls in (*BODIES.values(), *EFFECTS.values())
    for key, one in declarations(cls).items()
    if isinstance(one.kind, Real)
]


@pytest.mark.parametrize(("cls", "key"), NUMERIC, ids=lambda v: getattr(v, "__name__", v))
@pytest.mark.parametrize("value", [-1.0, 0.0, 2.0, np.nan, np.inf, True, "1"])
def test_files_and_constructors_refuse_the_same_numbers(cls, key, value):
    beam = vf.Beam(1.0, 1.0, 1.0, 2, name="b")
    samples = {"name": "x", "gap": 3.0, "a": beam.at(1.0), "side": "above", "acts_on": "penetration", "beam": beam,
               "point": beam.at(1.0), "f": 1.0, "EI": 1.0, "rhoA": 1.0, "elements": 2, "body": beam,
               "one_sided": True, "memory": "cyclic", "elongation": [1.0, 2.0], "force": [2.0, 3.0]}  # fmt: skip
    written = {**samples, "a": "b@1.0", "point": "b@1.0", "beam": "b", "body": "b"}
    known = declarations(cls)
    needed = [name for name, one in known.items() if one.needed or name in ("side", "one_sided", "normal")]
    book = Book(Path(), {"b": beam})
    read_table(cls, {**{name: written.get(name, 0.5) for name in needed}, key: value}, Place(book, "table"))
    try:
        cls(**{**{name: samples.get(name, 0.5) for name in needed}, key: value})
    except vf.VofemError:
        assert [path for path, _ in book.problems] == [f"table.{key}"]
    else:
        assert not book.problems


def test_sums_keep_their_nesting():
    f = (vf.Sine(1.0, 2.0) + vf.Constant(1.0)) * 0.5 + 2.0
    book = Book(Path())
    again = OfTime().read(OfTime().write(f, book), Place(book))
    assert again == f
    assert isinstance(again, Sum)
    assert isinstance(again.terms[0], Scaled)


def test_polynomial():
    cubic = vf.Polynomial([1.0, -2.0, 0.0, 0.5])
    x = np.array([[0.0, 1.0], [2.0, -1.0]])
    assert np.array_equal(cubic(x), 1.0 - 2.0 * x + 0.5 * x**3)
    assert cubic == vf.Polynomial((1, -2, 0, 0.5))
    for bad in ([], 3.0, [np.nan], ["x"], [[1.0]]):
        with pytest.raises(vf.ArgumentError, match="Polynomial: coefficients"):
            vf.Polynomial(bad)


def test_starts_from_outcomes_are_refused_by_name():
    beam = cantilever(4, name="deck")
    rest = vf.equilibrium(vf.Scene([beam], [vf.Gravity()]))
    with pytest.raises(vf.SceneFileError, match=r"initial\.deck: Equilibrium cannot be written to a scene file"):
        scene_to_toml(vf.Scene([beam], initial={beam: rest}))


# -- the schema -------------------------------------------------------------------------------------


KINDS = {
    "number": (int, float),
    "integer": (int,),
    "string": (str,),
    "array": (list,),
    "object": (dict,),
    "boolean": (bool,),
}


def fits(value, schema, named):
    """Return whether a value of a TOML file fits to a part of the schema, as far as the words go that it uses."""
    if "$ref" in schema:
        return fits(value, named[schema["$ref"].removeprefix("#/$defs/")], named)
    if "anyOf" in schema:
        return any(fits(value, part, named) for part in schema["anyOf"])
    wanted = schema.get("type", list(KINDS))
    if not any(isinstance(value, KINDS[one]) for one in ([wanted] if isinstance(wanted, str) else wanted)):
        return False
    if isinstance(value, list):
        return all(fits(part, schema.get("items", {}), named) for part in value)
    if not isinstance(value, dict):
        return value in schema.get("enum", (value,))
    own, others = schema.get("properties", {}), schema.get("additionalProperties", {})
    return set(schema.get("required", ())) <= set(value) and all(
        fits(part, own[key], named) if key in own else others is not False and fits(part, others, named)
        for key, part in value.items()
    )


def test_the_schema_takes_files_that_are_written_and_refuses_faults():
    beam = vf.Beam(2.0, 50.0, 1.0, 4, {"left": "pinned", "right": "pinned"}, name="bridge")
    wheel = vf.Mass(1.0, name="wheel")
    path = vf.Path(1.5, acceleration=0.1, profile=vf.Polynomial((0.0, 0.01)), ends="rigid")
    whole = json_schema()

    def taken(content):
        return fits(content, whole, whole["$defs"])

    effects = [
        vf.PointLoad(beam.along(vf.Path(2.0)), vf.Sine(1.0, 3.0)),
        vf.Contact(beam.along(path), wheel, gap=0.0, stiffness=1e4, acts_on="penetration", name="tyre"),
        vf.PointMoment(beam.at(1.0), 0.1),
    ]
    written = tomllib.loads(scene_to_toml(vf.Scene([beam, wheel], effects)))
    assert "path" in written["contact"][0]["a"]
    assert taken(written)
    for name in ("cantilever", "cantilever_from_mesh", "two_masses", "two_masses_response"):
        assert taken(tomllib.loads((MESHES.parent / "examples" / f"{name}.toml").read_text())), name
    for table, changed in (
        ("contact", {"a": {"body": "bridge", "path": {"sped": 1.0}}}),
        ("contact", {"a": {"body": "bridge", "path": {"speed": 1.0}, "at": 1.0}}),
        ("point_moment", {"point": {"body": "bridge", "path": {"speed": 1.0}}}),
        ("point_load", {"f": "one"}),
    ):
        assert not taken(written | {table: [written[table][0] | changed]}), changed
