"""Laws on rotations: the same laws as on displacements, on another row, with their own units."""

import csv

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose

import vofem as vf
from vofem.errors import ArgumentError
from vofem.io.csv_file import write_csv
from vofem.io.scene_file import load_scene, scene_to_toml

EI, RHO, LENGTH = 3.0, 1.5, 1.0
STEPPING = ("energy_conserving", "generalized_alpha", "central_difference")
CURVE = {"elongation": [0.01, 0.03, 0.06], "force": [0.5, 0.9, 1.2]}


def pinned_beam():
    """A beam that turns about its left end: a moment M there and a force P at the tip balance if M = P L."""
    return vf.Beam(LENGTH, EI, RHO, 3, {"left": "pinned"}, name="beam")


def two_beams():
    a = vf.Beam(LENGTH, EI, RHO, 3, {"left": "clamped"}, name="a")
    b = vf.Beam(LENGTH, EI, RHO, 3, name="b")
    return a, b, vf.Joint(a.at("right"), b.at("left"), kind="hinge", name="hinge")


# -- statics against closed forms ------------------------------------------------------------------


def bending(load):
    """The tip's displacement of a cantilever."""
    return load * LENGTH**3 / (3.0 * EI)


def test_a_joint_with_an_iwan_law_in_rotation_is_one_line():
    a, b, hinge = two_beams()
    knee = vf.IwanSpring(b.at("left"), a.at("right"), of="rotation", name="knee", **CURVE)
    scene = vf.Scene([a, b], [hinge, knee, vf.PointLoad(b.at("right"), 1.0)])
    path = vf.quasi_static(scene, [0.3, 1.1, 0.1])
    # The moment at the joint is P L. Loading follows the curve; unloading the curve doubled, from the turning point.
    first = np.interp([0.3, 1.1], [0.0, 0.5, 0.9, 1.2], [0.0, 0.01, 0.03, 0.06])
    back = first[1] - 2.0 * np.interp(0.5, [0.0, 0.5, 0.9, 1.2], [0.0, 0.01, 0.03, 0.06])
    turned = np.array([*first, back])
    assert_allclose(path.springs["knee"].elongation, turned, rtol=1e-9)
    assert_allclose(path.springs["knee"].force, [0.3, 1.1, 0.1], rtol=1e-9)
    # The tip moves by the rigid turn of b, its bending, and the tip of a under force and moment.
    loads = np.array([0.3, 1.1, 0.1])
    of_a = loads * (LENGTH**3 / (3.0 * EI) + LENGTH**3 / (2.0 * EI))
    slope_of_a = loads * (LENGTH**2 / (2.0 * EI) + LENGTH**2 / EI)
    tip = of_a + LENGTH * (slope_of_a + turned) + bending(loads)
    assert_allclose(path.displacement(b.at("right")), tip, rtol=1e-9)


def test_a_stop_against_rotation_at_rest():
    for acts_on, offset in (("penetration", 0.02), ("displacement", 0.0)):
        for side, sign in (("above", 1.0), ("below", -1.0)):
            beam = pinned_beam()
            spring = vf.Spring(beam.at("left"), stiffness=4.0, of="rotation")
            stop = vf.Contact(
                beam.at("left"), gap=0.02, stiffness=50.0, side=side, acts_on=acts_on, of="rotation", name="stop"
            )
            rest = vf.equilibrium(vf.Scene([beam], [spring, stop, vf.PointLoad(beam.at(LENGTH), 2.0 * sign)]))
            turned = (2.0 * LENGTH + 50.0 * offset) / 54.0
            assert rest.contacts["stop"].status == "closed"
            assert_allclose(rest.contacts["stop"].force, 50.0 * (turned - offset), rtol=1e-11)
            assert_allclose(rest.displacement(beam.at(LENGTH)), sign * (turned * LENGTH + bending(2.0)), rtol=1e-11)


def test_a_hysteretic_spring_in_rotation_keeps_a_residual_rotation():
    beam = pinned_beam()
    spring = vf.HystereticSpring(
        beam.at("left"), stiffness=40.0, linear_limit=0.01, memory="cyclic", of="rotation", name="spring",
        softening=vf.LinearSoftening(2.0),
    )  # fmt: skip
    path = vf.quasi_static(vf.Scene([beam], [spring, vf.PointLoad(beam.at(LENGTH), 1.0)]), [1.2, 0.0])
    largest = 1.2 / (40.0 * (1.0 - (1.2 - 0.4) / 2.0))
    assert_allclose(path.springs["spring"].elongation, [largest, largest - 1.2 / 40.0], rtol=1e-9)


# -- motion: laws that are linear are the linear spring --------------------------------------------


def moved(effects_of, method, bodies=pinned_beam, dt=2e-4):
    beam = bodies()
    scene = vf.Scene([beam], [*effects_of(beam.at("left")), vf.PointLoad(beam.at(LENGTH), vf.Sine(0.5, 4.0))])
    options = {} if method in ("event_driven", "central_difference") else {"dt": dt}
    run = vf.simulate(scene, 0.8, method=method, times=np.linspace(0.0, 0.8, 9), **options)
    assert run.energy.balance_error < 1e-3
    return run.displacement(beam.at(LENGTH)), run


LINEAR = {
    "Spring": lambda p: [vf.Spring(p, stiffness=6.0, of="rotation")],
    "NonlinearSpring": lambda p: [
        vf.NonlinearSpring(p, potential=lambda u: 3.0 * u**2, force=lambda u: 6.0 * u, of="rotation")
    ],
    "HystereticSpring": lambda p: [
        vf.HystereticSpring(p, stiffness=6.0, linear_limit=9.0, memory="cyclic", of="rotation")
    ],
    "BilinearSpring": lambda p: [vf.BilinearSpring(p, stiffness=6.0, linear_limit=9.0, of="rotation")],
    "IwanSpring": lambda p: [vf.IwanSpring(p, elongation=[9.0, 10.0], force=[54.0, 55.0], of="rotation")],
}


@pytest.mark.parametrize("method", STEPPING)
@pytest.mark.parametrize("kind", LINEAR)
def test_a_law_in_its_linear_range_is_a_rotational_spring(kind, method):
    """By the same method in the same steps, so that only the law differs."""
    expected, _ = moved(lambda p: [vf.RotationalSpring(p, stiffness=6.0)], method, dt=2e-3)
    found, run = moved(LINEAR[kind], method, dt=2e-3)
    assert_allclose(found, expected, rtol=0.0, atol=1e-9)
    if kind not in ("Spring", "NonlinearSpring"):
        history = next(iter(run.springs.values()))
        assert_allclose(history.force, 6.0 * history.elongation, rtol=1e-9, atol=1e-12)
        assert_allclose(history.elongation, run.slope([0.0])[0], rtol=0.0, atol=1e-12)


def test_a_springpot_of_order_one_in_rotation_is_a_dashpot_in_rotation():
    expected, run = moved(lambda p: [vf.Dashpot(p, damping=0.7, of="rotation")], "event_driven")
    found, _ = moved(lambda p: [vf.Springpot(p, coefficient=0.7, order=1.0, of="rotation")], "energy_conserving")
    assert_allclose(found, expected, rtol=0.0, atol=2e-6)
    assert run.energy.dissipated[-1] > 1e-3


@pytest.mark.parametrize("method", ["event_driven", *STEPPING])
def test_a_stop_against_rotation_in_motion(method):
    """A beam that is all but rigid turns about its end into a rotational stop: half a sine of known length."""
    beam = vf.Beam(LENGTH, 1e3, RHO, 1, {"left": "pinned"}, name="beam")
    inertia = RHO * LENGTH**3 / 3.0
    stop = vf.Contact(beam.at("left"), gap=0.1, stiffness=3.0, side="above", acts_on="penetration", of="rotation",
                      name="stop")  # fmt: skip
    scene = vf.Scene([beam], [stop], {beam: (0.0, lambda x: 0.2 * x)})
    options = {"dt": 1e-3} if method in ("energy_conserving", "generalized_alpha") else {}
    run = vf.simulate(scene, 4.0, method=method, times=np.linspace(0.0, 4.0, 9), **options)
    history = run.contacts["stop"]
    tolerance = 1e-3 if method == "event_driven" else 4e-3
    assert_allclose(history.closings, [0.5], atol=tolerance)
    assert_allclose(history.openings - history.closings, [np.pi * np.sqrt(inertia / 3.0)], rtol=2e-3)
    assert_allclose(history.gap_function, run.slope([0.0])[0] - 0.1, rtol=0.0, atol=1e-12)
    if method == "event_driven":
        assert run.energy.balance_error < 1e-12


def test_a_contact_between_two_rotations_closes_when_the_first_has_turned_further():
    a, b, hinge = two_beams()
    stop = vf.Contact(b.at("left"), a.at("right"), gap=0.01, stiffness=80.0, acts_on="penetration", of="rotation",
                      name="stop")  # fmt: skip
    spring = vf.Spring(b.at("left"), a.at("right"), stiffness=5.0, of="rotation")
    rest = vf.equilibrium(vf.Scene([a, b], [hinge, stop, spring, vf.PointLoad(b.at("right"), 1.0)]))
    assert_allclose(rest.slope([0.0], b) - rest.slope([1.0], a), (1.0 + 0.8) / 85.0, rtol=1e-10)
    down = vf.equilibrium(vf.Scene([a, b], [hinge, stop, spring, vf.PointLoad(b.at("right"), -1.0)]))
    assert_allclose(down.slope([0.0], b) - down.slope([1.0], a), -1.0 / 5.0, rtol=1e-10)


# -- words, files, pictures -------------------------------------------------------------------------


def every_effect():
    a, b, hinge = two_beams()
    ends = b.at("left"), a.at("right")
    return vf.Scene([a, b], [
        hinge,
        vf.Spring(*ends, stiffness=2.0, of="rotation"),
        vf.Dashpot(*ends, damping=0.1, of="rotation"),
        vf.Contact(*ends, gap=0.001, stiffness=80.0, damping=0.01, acts_on="penetration", of="rotation", name="stop"),
        vf.HystereticSpring(*ends, stiffness=6.0, linear_limit=0.01, memory="cyclic", of="rotation", name="h"),
        vf.CrushingStop(*ends, gap=0.02, stiffness=6.0, linear_limit=0.01, of="rotation", name="c"),
        vf.BilinearSpring(*ends, stiffness=6.0, linear_limit=0.01, of="rotation", name="b"),
        vf.IwanSpring(*ends, **CURVE, of="rotation", name="i"),
        vf.Springpot(*ends, coefficient=0.2, order=0.5, of="rotation", name="s"),
        vf.PointLoad(b.at("right"), vf.Sine(1.0, 3.0)),
    ])  # fmt: skip


def test_every_effect_names_the_units_of_rotations():
    lines = vf.explain(every_effect()).effects
    for line in lines[1:-1]:
        assert "in rotation" in line
        assert "N m" in line
        assert " N/m" not in line
        assert " N," not in line
    assert "gap 0.001 rad, K0 = 80 N m/rad, C0 = 0.01 N m s/rad" in lines[3]


def test_scene_files_say_what_an_effect_acts_on(tmp_path):
    scene = every_effect()
    text = scene_to_toml(scene)
    assert text.count('of = "rotation"') == 8
    (tmp_path / "scene.toml").write_text(text + "\n[run]\nt_end = 1.0\n")
    again = load_scene(tmp_path / "scene.toml").scene
    assert scene_to_toml(again) == text
    for one, other in zip(scene.model.system.recorded, again.model.system.recorded, strict=True):
        assert one.names == other.names
    assert_allclose(again.model.system.contacts.rows.toarray(), scene.model.system.contacts.rows.toarray(), rtol=0.0)
    plain = scene_to_toml(vf.Scene([m := vf.Mass(1.0, name="m")], [vf.Spring(m, stiffness=1.0)]))
    assert "of =" not in plain
    (tmp_path / "bad.toml").write_text(text.replace('of = "rotation"', 'of = "slope"', 1))
    with pytest.raises(
        vf.SceneFileError, match=r"spring\[0\].of: expected one of 'displacement', 'rotation', found 'slope'"
    ):
        load_scene(tmp_path / "bad.toml")


def test_stored_data_and_tables_have_the_units_of_rotations(tmp_path):
    from vofem.io.plot import time_history
    from vofem.io.render import render
    from vofem.io.tables import contact_table
    from vofem.io.vtk import write_series

    scene = every_effect()
    run = vf.simulate(scene, 0.5, dt=1e-3, times=np.linspace(0.0, 0.5, 11))
    path = run.save(tmp_path / "run.vtkhdf")
    with h5py.File(path) as file:
        group = file["history"]
        assert group["spring_elongation"].attrs["units"] == "rad"
        assert group["spring_force"].attrs["units"] == "N m"
        assert group["contact_stiffness"].attrs["units"] == "N m/rad"
        assert group["contact_gap_function"].attrs["units"] == "rad"
    loaded = vf.load(path)
    assert np.array_equal(loaded.contacts["stop"].gap_function, run.contacts["stop"].gap_function)
    assert loaded.scene.effects[4].of == "rotation"
    assert run.contacts["stop"].closings.size
    assert "peak force [N m]" in contact_table(run, "stop")
    b = scene.bodies[1]
    with write_csv(run, [b.at("right")], tmp_path / "run.csv").open() as file:
        header = next(csv.reader(file))
    assert header[-2:] == ["stop force [N m]", "stop stiffness [N m/rad]"]
    assert render(run, 0.25, tmp_path / "side.png").stat().st_size > 5000
    assert time_history(run, b.at("left"), tmp_path / "history.png").stat().st_size > 5000
    assert write_series(run, tmp_path / "series.pvd").frames == 11


def test_what_has_no_rotation_is_refused():
    mass, beam = vf.Mass(1.0, name="m"), pinned_beam()
    with pytest.raises(ArgumentError, match="Mass 'm' has no slope"):
        vf.Spring(beam.at(0.0), mass, stiffness=1.0, of="rotation")
    with pytest.raises(ArgumentError, match="'angle'"):
        vf.BilinearSpring(beam.at(0.0), stiffness=1.0, linear_limit=1.0, of="angle")
    with pytest.raises(ArgumentError, match=r"gap is -0\.1 rad"):
        vf.Contact(beam.at(0.0), gap=-0.1, stiffness=1.0, side="above", acts_on="displacement", of="rotation")


def test_effects_of_one_name_keep_their_units_and_their_columns():
    tip, mass = pinned_beam().at("right"), vf.Mass(1.0, stiffness=1.0, name="m")
    scene = vf.Scene([tip.body, mass], [
        vf.Contact(mass, gap=0.1, stiffness=100.0, side="above", acts_on="penetration", name="x"),
        vf.BilinearSpring(tip, stiffness=1.0, linear_limit=0.1, of="rotation", name="x"),
        vf.Friction(mass, coefficient=0.1, normal=1.0, name="x"),
        vf.PointLoad(mass, 0.5),
    ])  # fmt: skip
    run = vf.simulate(scene, 2.0, dt=0.01, times=np.linspace(0.0, 2.0, 5))
    frame = run.to_dataframe([mass])
    assert np.array_equal(frame["x force [N]"], run.contacts["x"].force)
    assert np.array_equal(frame["friction x force [N]"], run.frictions["x"].force)
    assert np.array_equal(frame["friction x slip speed [m/s]"], run.frictions["x"].slip_speed)
    assert run.to_xarray().spring_unit.values.tolist() == ["N m"]
