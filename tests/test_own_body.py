"""A body class written outside the package: an axial bar of linear elements, run, saved, drawn and asked."""

import meshio
import numpy as np
import pytest
from numpy.testing import assert_allclose

import vofem as vf
from vofem.bodies import Body, BodyMatrices, DegreesOfFreedom, Shape
from vofem.errors import ArgumentError, MissingCallableError


class AxialBar(Body):
    """A bar of linear elements, held at its left end, that moves along its axis."""

    def __init__(self, length, EA, rhoA, elements, name):
        self.name, self.EA, self.rhoA = name, EA, rhoA
        self.x = np.linspace(0.0, length, elements + 1)
        self.size = elements + 1

    @property
    def degrees_of_freedom(self):
        return DegreesOfFreedom(self.x, np.zeros(self.size, dtype=bool))

    @property
    def shape(self):
        return Shape("line", self.x, np.eye(self.size), direction=(1.0, 0.0))

    def matrices(self):
        mass, stiffness, h = np.zeros((self.size, self.size)), np.zeros((self.size, self.size)), self.x[1]
        for k in range(self.size - 1):
            mass[k : k + 2, k : k + 2] += self.rhoA * h / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
            stiffness[k : k + 2, k : k + 2] += self.EA / h * np.array([[1.0, -1.0], [-1.0, 1.0]])
        return BodyMatrices(mass, stiffness, None, np.array([0]), np.ones(self.size))

    def sections(self):
        return {"axial force [N]": self.EA * np.gradient(np.eye(self.size), self.x, axis=0)}


LENGTH, EA, RHO = 2.0, 60.0, 1.5


def bar():
    return AxialBar(LENGTH, EA, RHO, 12, "bar")


def scene(**more):
    made = bar()
    stop = vf.Contact(
        made.at("right"), gap=0.01, stiffness=40.0, side="above", acts_on="penetration", name="stop", **more
    )
    return made, vf.Scene([made], [stop, vf.PointLoad(made.at(LENGTH), vf.Sine(2.0, 3.0))])


@pytest.fixture(scope="module")
def run():
    return vf.simulate(scene()[1], 1.5, times=np.linspace(0.0, 1.5, 31))


def test_it_is_a_body():
    assert isinstance(bar(), Body)
    assert "bar" in str(vf.explain(scene()[1]))


def test_frequencies_are_those_of_linear_elements():
    made = bar()
    found = vf.modes(vf.Scene([made]), 12)
    # Exact for consistent mass: omega^2 = 6 EA/(rhoA h^2) (1 - cos)/(2 + cos) of (k - 1/2) pi/n.
    angle = (np.arange(1, 13) - 0.5) * np.pi / 12.0
    exact = np.sqrt(6.0 * EA / RHO * (1.0 - np.cos(angle)) / (2.0 + np.cos(angle))) / (LENGTH / 12.0)
    assert_allclose(found.omega, exact, rtol=1e-10)
    first = found.shape(0)
    assert_allclose(first / first[-1], np.sin(0.5 * np.pi * made.x / LENGTH), atol=1e-10)


def test_statics_with_a_closed_stop():
    made, _ = scene()
    stop = vf.Contact(made.at("right"), gap=0.01, stiffness=40.0, side="above", acts_on="penetration", name="stop")
    rest = vf.equilibrium(vf.Scene([made], [stop, vf.PointLoad(made.at(LENGTH), 2.0)]))
    tip = (2.0 + 40.0 * 0.01) / (EA / LENGTH + 40.0)
    assert_allclose(rest.displacement(made.at(LENGTH)), tip, rtol=1e-12)
    assert_allclose(rest.displacement(made.at(0.77)), tip * 0.77 / LENGTH, rtol=1e-12)


def test_free_bars_joined_end_to_end_have_one_rigid_motion():
    class FreeBar(AxialBar):
        def matrices(self):
            held = super().matrices()
            return BodyMatrices(held.mass, held.stiffness, None, np.empty(0, dtype=np.int64), held.scale)

    one, two = FreeBar(1.0, EA, RHO, 6, "one"), FreeBar(1.0, EA, RHO, 6, "two")
    omega = vf.modes(vf.Scene([one, two], [vf.Joint(one.at("right"), two.at("left"), kind="hinge")]), 3).omega
    assert omega[0] == 0.0
    angle = np.pi / 12.0
    assert_allclose(omega[1], np.sqrt(6.0 * EA / RHO * (1.0 - np.cos(angle)) / (2.0 + np.cos(angle))) * 6.0, rtol=1e-10)


def test_motion_and_reaction(run):
    made = run.scene.bodies[0]
    assert run.method == "event_driven"
    assert run.contacts["stop"].closings.size >= 1
    assert run.energy.balance_error < 1e-12
    # Balance of momentum of the whole bar.
    force = run.reaction(made, "left").force
    inertia = np.ones(13) @ made.matrices().mass @ np.array([run.acceleration(made.at(x)) for x in made.x])
    assert_allclose(force, inertia - 2.0 * np.sin(3.0 * run.times) + run.contacts["stop"].force, atol=1e-10)
    with pytest.raises(ArgumentError, match=r"AxialBar 'bar' has no support at 1\.0; its supports: x = 0"):
        run.reaction(made, 1.0)
    stepped = vf.simulate(run.scene, 1.5, dt=2e-4, method="energy_conserving", times=run.times)
    assert_allclose(stepped.displacement(made.at(LENGTH)), run.displacement(made.at(LENGTH)), atol=2e-6)


def test_an_initial_field_and_gravity():
    made = bar()
    start = {made: (lambda x: 0.01 * np.sin(0.5 * np.pi * x / LENGTH), 0.0)}
    moved = vf.simulate(vf.Scene([made], [vf.Gravity(9.81)], start), 1.0, times=[0.0, 1.0])
    omega = vf.modes(vf.Scene([made]), 1).omega[0]
    # Gravity acts upward or downward, across the bar.
    assert_allclose(moved.displacement(made.at(LENGTH)), 0.01 * np.cos(omega * moved.times), atol=1e-14)
    with pytest.raises(ArgumentError, match="does not vanish where a support holds it"):
        vf.simulate(vf.Scene([made], [], {made: (0.1, 0.0)}), 1.0)


def test_saved_and_loaded(run, tmp_path):
    made = run.scene.bodies[0]
    path = run.save(tmp_path / "run.vtkhdf")
    with pytest.raises(MissingCallableError, match=r"AxialBar 'bar'.* vofem.load\(path, scene=scene\)"):
        vf.load(path)
    with pytest.raises(ArgumentError, match="load: the scene is another one"):
        vf.load(path, scene=scene(damping=0.1)[1])
    loaded = vf.load(path, scene=scene()[1])
    for point in (made.at(LENGTH), made.at(0.77)):
        assert np.array_equal(loaded.displacement(point), run.displacement(point))
    again = loaded.scene.bodies[0]
    assert np.array_equal(loaded.displacement(again.at("right")), run.displacement(made.at("right")))
    assert np.array_equal(loaded.reaction("bar", "left").force, run.reaction(made, "left").force)
    repeated = vf.simulate(vf.Scene([again], loaded.scene.effects), 1.5, times=run.times)
    assert_allclose(repeated.displacement(again.at(LENGTH)), run.displacement(made.at(LENGTH)), atol=1e-14)
    whole = vf.load(loaded.save(tmp_path / "again.vtkhdf"), scene=loaded.scene)
    assert np.array_equal(whole.displacement(again.at(0.77), [0.4]), run.displacement(made.at(0.77), [0.4]))


def test_a_scene_file_refuses_it_by_name(run, tmp_path):
    with pytest.raises(vf.SceneFileError, match=r"bodies\[0\]: AxialBar cannot be written to a scene file"):
        vf.dump_scene(run.scene, tmp_path / "scene.toml")


def test_pictures(run, tmp_path):
    from vofem.io.plot import space_time, time_history
    from vofem.io.render import render

    made = run.scene.bodies[0]
    for name, draw in {
        "side": lambda path: render(run, 0.6, path),
        "map": lambda path: space_time(run, path),
        "history": lambda path: time_history(run, made.at("right"), path),
    }.items():
        assert draw(tmp_path / f"{name}.png").stat().st_size > 5000


def test_beside_a_beam_and_a_mass_in_pictures_and_series(tmp_path):
    from vofem.io.render import render
    from vofem.io.vtk import write_series

    made, _ = scene()
    beam, mass = vf.Beam(1.0, 3.0, 1.0, 4, {"left": "clamped"}, name="beam"), vf.Mass(1.0, 5.0, name="mass")
    effects = [vf.Contact(beam.at(1.0), mass, gap=0.01, stiffness=50.0, acts_on="penetration"),
               vf.Spring(made.at(LENGTH), stiffness=2.0), vf.PointLoad(beam.at(1.0), 0.3)]  # fmt: skip
    many = vf.simulate(vf.Scene([made, beam, mass], effects), 0.5, times=[0.0, 0.25, 0.5])
    assert render(many, 0.5, tmp_path / "side.png").stat().st_size > 5000
    assert write_series(many, tmp_path / "many.pvd").frames == 3


def test_a_series_of_vtu_files(run, tmp_path):
    from vofem.io.vtk import write_series

    made = run.scene.bodies[0]
    write_series(run, tmp_path / "series.pvd", times=[1.0])
    mesh = meshio.read(tmp_path / "series-frames" / "frame-000000.vtu")
    u = np.array([run.displacement(made.at(x), [1.0])[0] for x in made.x])
    on_bar = ~np.isnan(mesh.point_data["x"])
    assert_allclose(mesh.points[on_bar][:, 0], np.repeat(made.x, 2)[1:-1], atol=1e-15)
    assert_allclose(mesh.point_data["deflection"][on_bar][:, 0], np.repeat(u, 2)[1:-1], atol=1e-15)
    assert np.all(mesh.point_data["deflection"][:, 1] == 0.0)
    force = made.sections()["axial force [N]"] @ u
    assert_allclose(mesh.point_data["axial_force"][on_bar], np.repeat(force, 2)[1:-1], atol=1e-12)
    assert np.all(np.isnan(mesh.point_data["bending_moment"][on_bar]))
