"""A class that declares its parameters once gets checks, docstring, scene file, schema, copies, keys and paths."""

import json
from dataclasses import KW_ONLY
from typing import Annotated

import numpy as np
import pytest

import vofem as vf
from vofem.effects.kinds import AtPoint
from vofem.io.scene_file import load_scene, scene_to_toml
from vofem.io.scenes.schema import EFFECTS, json_schema
from vofem.parameters import (
    CHOSEN,
    Choice,
    Name,
    Real,
    changed,
    content_of,
    declared,
    rule,
    value_at,
)  # fmt: skip
from vofem.studies.remesh import remeshed
from vofem.time_functions import Load, OfTime


@declared()
class PushedSpring:
    """A spring to ground that is pushed, too.

    Raises
    ------
    ArgumentError
        If it is pushed harder than it can bear.
    """

    point: Annotated[vf.bodies.Point, AtPoint("Where it acts.")]
    _: KW_ONLY
    stiffness: Annotated[float, Real("N/m", "Its stiffness.", above=0.0)]
    push: Annotated[Load, OfTime("N", "The push.")] = 0.0
    share: Annotated[float, Real("", "The share of the push.", least=0.0, below=1.0)] = 0.5
    way: Annotated[str, Choice(("up", "down"), "Where it is pushed to.")] = "up"
    name: Annotated[str, Name()] = CHOSEN

    @rule("share", "way")
    def _bears(self) -> None:
        if self.way == "down" and self.share > 0.7:
            raise vf.ArgumentError(f"PushedSpring {self.name!r}: share is {self.share:g}, but down is 0.7 at most")

    def points(self):
        """Return the point."""
        return (self.point,)

    def compile(self, builder):
        """Add stiffness and push."""
        row = builder.row(self.point)
        builder.add_stiffness(row, self.stiffness)
        builder.add_point_load(row, self.push * (self.share if self.way == "up" else -self.share), self.describe())

    def describe(self):
        """Return the name."""
        return f"PushedSpring {self.name!r}"


@pytest.fixture
def known(monkeypatch):
    """Scene files that know the class."""
    monkeypatch.setitem(EFFECTS, "pushed_spring", PushedSpring)


MASS = vf.Mass(1.0, name="m")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"stiffness": -1.0}, "PushedSpring 's': stiffness is -1.0, expected a positive number"),
        ({"stiffness": np.nan}, "stiffness is NaN, expected a positive number; look where the value was computed"),
        ({"share": 1.0}, "share is 1, expected a number from 0 to below 1"),
        ({"way": "dwon"}, "way is 'dwon', expected one of 'up', 'down'; did you mean 'down'?"),
        ({"way": "down", "share": 0.8}, "PushedSpring 's': share is 0.8, but down is 0.7 at most"),
        ({"pus": 1.0}, "PushedSpring: there is no argument 'pus'; did you mean 'push'?"),
        ({"name": ""}, "PushedSpring: name is '', expected a non-empty string"),
    ],
)
def test_its_constructor_refuses(values, message):
    with pytest.raises(vf.ArgumentError) as caught:
        PushedSpring(MASS, **{"stiffness": 1.0, "name": "s", **values})
    assert message in str(caught.value)


def test_its_docstring_has_its_parameters_before_its_errors():
    text = PushedSpring.__doc__
    assert "stiffness : float\n    Its stiffness. In N/m, positive.\n" in text
    assert 'way : {"up", "down"}\n    Where it is pushed to.\n' in text
    assert text.index("A spring") < text.index("Parameters\n---") < text.index("name : str") < text.index("Raises\n---")


def test_names_are_chosen_and_shown():
    one, two = PushedSpring(MASS, stiffness=1.0), PushedSpring(MASS, stiffness=1.0)
    assert one.name != two.name
    assert one != two
    assert repr(one) == f"<PushedSpring {one.name!r}>"


def test_its_table_comes_back(known):
    beam = vf.Beam(1.0, 1.0, 1.0, 2, {"left": "pinned"}, name="b")
    effects = [PushedSpring(beam.at(0.3), stiffness=1 / 3, push=vf.Sine(1.0, 2.0), way="down", name="s")]
    text = scene_to_toml(vf.Scene([beam, MASS], effects))
    assert "share" not in text
    table = text[text.index("[[pushed_spring]]") :]
    assert [line.split(" = ")[0] for line in table.splitlines()[1:]] == ["name", "point", "stiffness", "push", "way"]


def test_its_faults_in_a_file_are_told_together(known, tmp_path):
    path = tmp_path / "s.toml"
    path.write_text(
        "[[mass]]\nname = 'm'\nmass = 1\n[[pushed_spring]]\npoint = 'n'\nstifness = 1\n"
        "push = { sine = { omega = 1 } }\nway = 'down'\nshare = 0.8\n"
    )
    with pytest.raises(vf.SceneFileError) as caught:
        load_scene(path)
    assert dict(caught.value.problems) == {
        "pushed_spring[0].point": (
            "expected a point, such as 'beam@1.0', or the name of a mass, found 'n'; there are 'm'"
        ),
        "pushed_spring[0].stifness": "unknown key; did you mean 'stiffness'?",
        "pushed_spring[0].stiffness": "missing, expected a positive number",
        "pushed_spring[0].push.sine.amplitude": "missing, expected a number",
        "pushed_spring[0].share": "share is 0.8, but down is 0.7 at most",
    }


def test_it_is_part_of_a_run_and_its_numbers_change(known, tmp_path):
    path = tmp_path / "s.toml"
    path.write_text(
        "[[mass]]\nname = 'm'\nmass = 1\n[[pushed_spring]]\npoint = 'm'\nstiffness = 4.0\npush = 6.0\nname = 's'\n"
    )
    scene = load_scene(path).scene
    at = lambda s: vf.equilibrium(s).displacement(s.bodies[0])  # noqa: E731
    assert at(scene) == pytest.approx(0.75)
    assert at(scene.replace("s", stiffness=8.0)) == pytest.approx(0.375)
    with pytest.raises(vf.ArgumentError, match="there is no argument 'stifness'"):
        scene.replace("s", stifness=8.0)
    other = scene.replace("s", **{"push.value": 3.0}, stiffness=2.0)
    assert at(other) == pytest.approx(0.75)
    with pytest.raises(vf.ArgumentError, match=r"has no parameter 'pull', in 'pull\.value'"):
        scene.replace("s", **{"pull.value": 3.0})


def test_paths_lead_to_numbers():
    spring = PushedSpring(MASS, stiffness=1.0, push=vf.Sine(2.0, 3.0), name="s")
    assert value_at(spring, "push.amplitude") == 2.0
    other = changed(spring, **{"push.amplitude": 5.0})
    assert (other.push.amplitude, other.push.omega, other.stiffness, spring.push.amplitude) == (5.0, 3.0, 1.0, 2.0)
    assert changed(spring, **{"stiffness": 7.0}).stiffness == 7.0
    in_hertz = PushedSpring(MASS, stiffness=1.0, push=vf.Sine(2.0, frequency=3.0))
    assert changed(in_hertz, **{"push.frequency": 4.0}).push == vf.Sine(2.0, frequency=4.0)
    assert changed(in_hertz, **{"push.amplitude": 1.0}).push.frequency == 3.0
    assert changed(in_hertz, **{"push.omega": 4.0}).push == vf.Sine(2.0, 4.0)
    assert changed(spring, **{"push.frequency": 4.0}).push == vf.Sine(2.0, frequency=4.0)
    for path in ("push.amplitud", "stifness", "push.omega.x"):
        with pytest.raises(vf.ArgumentError, match=r"has no parameter .*(did you mean|it has none)"):
            value_at(spring, path)


def test_a_new_field_of_a_beam_is_copied_remeshed_and_counts_in_keys():
    """The next field of a class is in all places at once."""

    @declared()
    class Painted(vf.Beam):
        """A beam with a colour."""

        colour: Annotated[float, Real("nm", "The wavelength of its colour.", above=0.0)] = 500.0

    blue, red = (Painted(1.0, 2.0, 3.0, 4, {0.25: "pinned"}, name="b", colour=c) for c in (450.0, 700.0))
    assert content_of(blue) != content_of(red)
    assert content_of(blue) == content_of(changed(blue, name="other"))
    assert changed(blue, tension=1.0).colour == 450.0
    fine = remeshed(vf.Scene([red], [vf.PointLoad(red.at(0.5), 1.0)]), 8).bodies[0]
    assert (type(fine), fine.colour, fine.element_lengths.size) == (Painted, 700.0, 8)
    assert fine.supports == {2: "pinned"}
    with pytest.raises(vf.ArgumentError, match=r"Painted 'b': colour is 0\.0, expected a positive number"):
        changed(blue, colour=0.0)


def test_content_is_that_of_numbers_and_not_of_names():
    one, two = vf.Mass(1.0, name="a"), vf.Mass(1.0, name="b")
    assert content_of(one) == content_of(two) != content_of(vf.Mass(2.0))
    with pytest.raises(TypeError, match="no content that is known"):
        content_of(vf.Beam(1.0, lambda x: 1.0 + x, 1.0, 2))


def test_the_schema_says_what_files_may_hold(known):
    tables = json_schema()["properties"]
    table = {name: found["anyOf"][1] for name, found in tables.items()}["pushed_spring"]
    assert table["required"] == ["point", "stiffness"]
    assert table["properties"]["stiffness"] == {
        "type": "number", "exclusiveMinimum": 0.0, "description": "Its stiffness. In N/m, positive."
    }  # fmt: skip
    assert table["properties"]["way"]["enum"] == ["up", "down"]
    assert not table["additionalProperties"]
    beam = tables["beam"]["anyOf"][1]
    assert set(beam["required"]) == {"name", "EI", "rhoA"}
    assert "mesh" in beam["properties"]
    json.dumps(json_schema())
