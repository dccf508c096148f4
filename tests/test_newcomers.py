"""What a first-time user meets: misspelt arguments, representations, names of the package, messages."""

import inspect
import subprocess
import sys

import numpy as np
import pytest

import vofem as vf
from vofem._validate import public
from vofem.io.scene_file import load_scene


@pytest.fixture
def mass():
    return vf.Mass(1.0, stiffness=4.0, name="m")


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda m: vf.Mass(1.0, stifness=4.0), "Mass: there is no argument 'stifness'; did you mean 'stiffness'?"),
        (
            lambda m: vf.Contact(m, stiffness=1.0),
            "Contact: missing a required argument: 'gap'; Contact takes a, b, gap",
        ),
        (lambda m: vf.Gravity(1.0, 2.0), "Gravity: too many positional arguments; Gravity takes g"),
    ],
)
def test_wrong_arguments_name_the_nearest(mass, build, message):
    with pytest.raises(vf.ArgumentError) as caught:
        build(mass)
    assert message in str(caught.value)


def test_type_errors_within_a_constructor_stay_what_they_are():
    class Faulty:
        def __init__(self, value):
            self.value = value + 1

    public(Faulty)
    assert Faulty(1).value == 2
    with pytest.raises(TypeError, match=r"concatenate|unsupported"):
        Faulty("a")
    with pytest.raises(vf.ArgumentError, match=r"Faulty: there is no argument 'vale'; did you mean 'value'"):
        Faulty(vale=1)


def test_representations_show_no_addresses(mass):
    contact = vf.Contact(mass, gap=0.1, stiffness=1.0, side="above", acts_on="penetration", name="stop")
    scene = vf.Scene([mass], [contact, vf.PointLoad(mass, 2.0), vf.Gravity()])
    shown = [repr(thing) for thing in (scene, *scene.effects, vf.modes(scene))]
    assert not any(" at 0x" in text for text in shown)
    assert shown[0] == "Scene(1 Mass, 1 Contact, 1 PointLoad, 1 Gravity)"
    assert "Contact 'stop' above" in shown[1]
    assert shown[-1] == f"Modes(1 modes of {2.0 / (2.0 * np.pi):.6g} to {2.0 / (2.0 * np.pi):.6g} Hz)"


@pytest.mark.parametrize(("g", "direction"), [(9.81, "downward"), (-9.81, "upward")])
def test_gravity_says_its_direction(mass, g, direction):
    scene = vf.Scene([mass], [vf.Gravity(g)])
    assert f"Gravity: 9.81 m/s^2 {direction}" in str(vf.explain(scene))
    assert vf.equilibrium(scene).displacement(mass) == pytest.approx(-g / 4.0)


def test_names_of_the_package():
    names = dir(vf)
    assert {"simulate", "Beam", "io", "load", "__version__"} <= set(names)
    assert not {"Any", "TYPE_CHECKING", "lookup", "import_module"} & set(names)
    code = "import vofem; print(vofem.io.__name__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "vofem.io\n"


def test_a_step_for_a_method_that_nobody_chose(mass):
    with pytest.raises(
        vf.ArgumentError, match=r"method='auto' takes event_driven .* or use method='energy_conserving', "
    ):
        vf.simulate(vf.Scene([mass]), 1.0, dt=0.1)
    with pytest.raises(vf.ArgumentError, match=r"event_driven has no step; leave it out"):
        vf.simulate(vf.Scene([mass]), 1.0, dt=0.1, method="event_driven")


def test_two_points_of_a_stop_are_two(mass):
    given = {"gap": 0.1, "stiffness": 1.0, "linear_limit": 0.1}
    with pytest.raises(vf.ArgumentError, match=r"CrushingStop .*: a and b are the same point"):
        vf.CrushingStop(mass, mass, **given)


def test_a_mass_may_be_named_where_a_point_is_meant():
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="m")
    scene = vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(1.0, 2.0))])
    result, orbit = vf.simulate(scene, 1.0), vf.periodic(scene)
    assert np.array_equal(result.displacement("m"), result.displacement(mass))
    assert orbit.amplitude("m") == orbit.amplitude(mass)
    with pytest.raises(vf.ArgumentError, match="'m'"):
        result.displacement("n")


def test_rayleigh_damping_in_proportion_to_mass_alone():
    assert vf.RayleighDamping(0.1).beta == 0.0


def test_faults_in_a_table_of_a_misspelt_name(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(
        "[[mass]]\nname = 'm'\nmass = 1\n[[contacts]]\na = 'm'\ngap = 'wide'\nstifness = 1\nside = 'above'\n"
        "acts_on = 'penetration'\n"
    )
    with pytest.raises(vf.SceneFileError) as caught:
        load_scene(file)
    text = str(caught.value)
    assert "contacts: unknown key; did you mean 'contact'?" in text
    assert "contacts[0].gap" in text or "contacts[1].gap" in text
    assert "stifness: unknown key; did you mean 'stiffness'?" in text


#: What runs return, and the base of all functions of time: users do not construct these.
OUTCOMES = (
    vf.Branch, vf.Equilibrium, vf.Fit, vf.Locus, vf.Modes, vf.PeriodicOrbit, vf.QuasiStatic, vf.Result,
    vf.SpecialPoint, vf.TimeFunction,
)  # fmt: skip

CONSTRUCTED = [
    kind
    for kind in (getattr(vf, name) for name in vf.__all__)
    if isinstance(kind, type) and not issubclass(kind, Exception) and kind not in OUTCOMES
]


@pytest.mark.parametrize("kind", CONSTRUCTED, ids=lambda kind: kind.__name__)
def test_every_class_names_what_it_takes(kind):
    with pytest.raises(vf.ArgumentError, match=rf"{kind.__name__}: there is no argument 'misspelt'"):
        kind(misspelt=1.0)


@pytest.mark.parametrize("kind", CONSTRUCTED, ids=lambda kind: kind.__name__)
def test_points_and_loads_have_types(kind):
    """A type checker finds ``Contact("tip")``: only what is checked as a whole, such as an order, is of any type."""
    found = inspect.signature(kind.__init__).parameters
    for name in {"a", "b", "point", "other", "f", "acceleration", "EI", "rhoA", "body"} & found.keys():
        assert "Any" not in str(found[name].annotation).replace("Callable[[Any], Any]", ""), name
