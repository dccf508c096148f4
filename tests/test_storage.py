"""Saved runs: what is loaded equals what was saved, ParaView reads the fields, xarray the history."""

import dataclasses
import re
import shutil
import tracemalloc
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from kept import CASES, assert_whole, ran, same
from scenes import SHORT, alone

import vofem as vf
from vofem import cli
from vofem.files.hdf5 import reading, writing
from vofem.histories.tables import points_of_interest
from vofem.integrators.base import Samples
from vofem.io.storage.tree import NAMES, class_named, name_of_class, read_tree, write_text, write_tree
from vofem.time_functions import Piece

ROOT = Path(__file__).parent.parent


def saved_and_loaded(result, path, **options):
    assert result.save(path, **options) == path
    return vf.load(path)


@pytest.mark.parametrize("name", [name for name in CASES if "tolerance" not in name])
def test_a_loaded_run_is_whole(name, tmp_path):
    """So is one that is saved again; the scene that it holds, and that of a scene file, run to the same bits."""
    result = ran(name)
    loaded = saved_and_loaded(result, tmp_path / "run.vtkhdf")
    again = saved_and_loaded(loaded, tmp_path / "again.vtkhdf")
    # Before anything is asked for, as answers may count further work.
    for other in (loaded, again):
        assert (repr(other), other.counters) == (repr(result), result.counters)
    for other in (loaded, again):
        assert_whole(other, result)
    assert [str(e.describe()) for e in loaded.scene.effects] == [str(e.describe()) for e in result.scene.effects]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again.vtkhdf", "run.vtkhdf"]
    scene = loaded.scene
    if name != "everything":
        # One run for both ways: the scene of the run's file, written to a scene file.
        written = vf.dump_scene(scene, tmp_path / "scene.toml")
        assert written.read_text() == vf.dump_scene(result.scene, tmp_path / "same.toml").read_text()
        scene = vf.load_scene(written).scene
    _, t_end, options = CASES[name]
    repeated = vf.simulate(scene, t_end, **(options | {"times": result.times}))
    assert same(repeated.samples.q, result.samples.q)
    assert same(repeated.energy.total, result.energy.total)


def test_late_segments_may_be_asked_for_first(tmp_path):
    """Eigensystems are gained from each other: their last bits must not depend on the order of the questions."""
    result = ran("everything")
    assert result.counters.statuses > 5
    loaded = saved_and_loaded(result, tmp_path / "run.vtkhdf")
    for t in ([3.9], [0.3, 2.2]):
        assert same(loaded.deflection([2.0, 2.9], t), result.deflection([2.0, 2.9], t))


def test_a_mesh_file_may_be_gone(tmp_path):
    mesh = ROOT / "meshes" / "beam25.msh"
    shutil.copy(mesh, tmp_path / mesh.name)
    beam = vf.Beam.from_mesh(tmp_path / mesh.name, 1.0, 1.0, {"left": "clamped"}, name="meshed")
    names = list(beam.mesh.points)
    result = vf.simulate(vf.Scene([beam], [vf.PointLoad(beam.at("right"), 1.0)]), 1.0, times=np.linspace(0, 1, 5))
    result.save(tmp_path / "run.vtkhdf")
    (tmp_path / mesh.name).unlink()
    loaded = vf.load(tmp_path / "run.vtkhdf")
    assert_whole(loaded, result)
    (other,) = loaded.scene.bodies
    assert list(other.mesh.points) == names
    assert other.mesh_file == beam.mesh_file
    with h5py.File(tmp_path / "run.vtkhdf") as file:
        assert f'mesh = "{mesh.name}"' in file["vofem/scene.toml"][()].decode()


def test_a_scene_with_another_function_path_or_name_is_not_that_of_the_file(tmp_path):
    beam, mass = vf.Beam(2.0, 1.0, 1.0, 4, {"left": "clamped"}, name="b"), vf.Mass(1.0, stiffness=4.0, name="m")
    sine = vf.Sine(1.0, 2.0)

    def scene(f=sine, speed=0.5, name="slider"):
        slider = vf.Friction(mass, coefficient=0.1, normal=1.0, name=name)
        return vf.Scene([beam, mass], [vf.PointLoad(mass, f), vf.PointLoad(beam.along(vf.Path(speed)), 1.0), slider])

    result = vf.simulate(scene(), 1.0, method="generalized_alpha", dt=0.1)
    path = result.save(tmp_path / "run.vtkhdf")
    for other in ({"f": vf.Sine(0.5, 2.0)}, {"f": 2.0 * sine}, {"speed": 0.9}, {"name": "other"}):
        with pytest.raises(vf.ArgumentError, match=r"another one than that of the file.*time, paths or names"):
            vf.load(path, scene=scene(**other))
    for same_scene in (scene(), scene(name=None), scene(f=lambda t: np.sin(2.0 * t))):
        assert same(vf.load(path, scene=same_scene).displacement(mass), result.displacement(mass))


def test_names_and_choices_may_be_texts_of_numpy(tmp_path):
    names, (side, law, support) = np.array(["beam", "stop"]), np.array(["below", "penetration", "clamped"])
    beam = vf.Beam(1.0, 1.0, 1.0, 2, {"left": support}, name=names[0])
    stop = vf.Contact(beam.at(1.0), gap=0.1, stiffness=1.0, side=side, acts_on=law, name=names[1])
    loaded = saved_and_loaded(vf.simulate(vf.Scene([beam], [stop, vf.Gravity(1.0)]), 1.0), tmp_path / "run.vtkhdf")
    assert [loaded.scene.bodies[0].name, loaded.scene.effects[0].name] == ["beam", "stop"]
    assert loaded.scene.effects[0].describe() == stop.describe()


def test_what_travels_along_a_beam_is_read_whole(tmp_path):
    """Also along one whose stiffness is a Python function, for which the scene is copied."""
    beam = vf.Beam(2.0, lambda x: 1.0 + x, 1.0, 4, {"left": "pinned", "right": "pinned"}, name="b")
    rider = beam.along(vf.Path(0.5))
    scene = vf.Scene([beam], [vf.PointMass(rider, mass=0.1), vf.PointLoad(rider, 1.0), vf.Gravity(1.0)])
    result = vf.simulate(scene, 1.0, method="generalized_alpha", dt=0.01)
    loaded = saved_and_loaded(result, tmp_path / "run.vtkhdf")
    assert same(loaded.displacement(beam.at(1.0)), result.displacement(beam.at(1.0)))
    assert same(loaded.energy.total, result.energy.total)
    assert [e.describe() for e in loaded.scene.effects] == [e.describe() for e in result.scene.effects]


def test_the_scene_is_inside_as_toml(tmp_path):
    result = ran("beam-displacement")
    loaded = saved_and_loaded(result, tmp_path / "run.vtkhdf")
    with h5py.File(tmp_path / "run.vtkhdf") as file:
        (tmp_path / "scene.toml").write_bytes(file["vofem/scene.toml"][()])
    tip = result.scene.bodies[0].at(1.0)
    again = vf.simulate(vf.load_scene(tmp_path / "scene.toml").scene, 20.0, times=result.times)
    assert same(again.displacement(tip), result.displacement(tip))
    vf.dump_scene(loaded.scene, tmp_path / "dumped.toml")
    assert (tmp_path / "dumped.toml").read_bytes() == (tmp_path / "scene.toml").read_bytes()


# -- callables --------------------------------------------------------------------------------------


def push(t):
    return np.sin(3.0 * t)


def gentle(t):
    return 0.5 + 0.1 * np.sin(t)


class Saw(vf.TimeFunction):
    """A closed form that is not of this package."""

    def __call__(self, t):
        return 0.3 * np.asarray(t, dtype=float)

    def derivative(self, t, order=1):
        return np.full(np.shape(t), 0.3)

    def piece(self, t0):
        return Piece(constant=0.3 * t0, slope=0.3)


def with_callables():
    beam = vf.Beam(1.0, lambda x: 1.0 + 0.5 * np.sin(x), lambda x: 1.0 + x, 10,
                   {"left": "clamped", "right": "pinned"}, name="b")  # fmt: skip
    mass = vf.Mass(1.0, stiffness=2.0, name="m")
    effects = [
        vf.Contact(beam.at(0.55), mass, gap=0.01, stiffness=100.0, acts_on="penetration", name="c"),
        vf.PointLoad(beam.at(0.03), push),
        vf.PointLoad(mass, vf.Sine(1.0, 2.0) + push),
        vf.DistributedLoad(beam, lambda x: x**2, push),
        vf.NonlinearSpring(beam.at(0.02), potential=lambda u: u**4, force=lambda u: 4.0 * u**3, name="hard"),
        vf.Foundation(beam, stiffness=lambda x: 1.0 + x, one_sided=True, gap=0.01, name="bed"),
        vf.BaseMotion(beam, push),
        vf.BaseMotion(mass, push),
        vf.Springpot(mass, coefficient=0.1, order=gentle, name="pot"),
    ]
    scene = vf.Scene([beam, mass], effects, initial={beam: (lambda x: 1e-3 * x**2 * (1.0 - x), 0.0)})
    return vf.simulate(scene, 0.3, method="central_difference", times=np.linspace(0.0, 0.3, 31))


def test_a_run_with_callables_is_read_whole(tmp_path):
    result = with_callables()
    beam = result.scene.bodies[0]
    loaded = saved_and_loaded(result, tmp_path / "run.vtkhdf")
    for run in (loaded, saved_and_loaded(loaded, tmp_path / "again.vtkhdf")):
        for point in points_of_interest(result.scene):
            for what in ("displacement", "velocity", "acceleration"):
                assert same(getattr(run, what)(point), getattr(result, what)(point))
        for end in ("left", "right"):
            for one, other in zip(run.reaction(beam, end), result.reaction(beam, end), strict=True):
                assert same(one, other)
        assert same(run.contacts["c"].force, result.contacts["c"].force)
        assert same(run.springs["pot"].force, result.springs["pot"].force)
        assert same(run.energy.work, result.energy.work)
        # EI between nodes is known by polynomials, as accurate as rounding allows.
        x = np.linspace(0.0, 1.0, 57)
        for what in ("bending_moment", "shear_force"):
            expected = getattr(result, what)(x)
            assert np.max(np.abs(getattr(run, what)(x) - expected)) <= 1e-13 * np.max(np.abs(expected)) + 1e-14


def test_what_needs_a_callable_names_it(tmp_path):
    loaded = saved_and_loaded(with_callables(), tmp_path / "run.vtkhdf")
    for method in ("auto", "central_difference", "generalized_alpha"):
        with pytest.raises(
            vf.MissingCallableError, match=r"'push'|\(gentle\)|'hard' \(<lambda> in test_storage.py, line \d+"
        ):
            vf.simulate(loaded.scene, 0.3, method=method)
    bodies, effects = loaded.scene.bodies, loaded.scene.effects
    with pytest.raises(vf.MissingCallableError, match=r"'push'.*build the scene in Python"):
        vf.simulate(vf.Scene(bodies, [effects[1]]), 0.3)
    with pytest.raises(vf.MissingCallableError, match=r"needs the callable .*NonlinearSpring 'hard' \(<lambda> in"):
        vf.simulate(vf.Scene(bodies, [effects[4]]), 0.3)
    with pytest.raises(vf.SceneFileError, match="push"):
        vf.dump_scene(loaded.scene, tmp_path / "scene.toml")
    with h5py.File(tmp_path / "run.vtkhdf") as file:
        text = file["vofem/scene.toml"][()].decode()
    assert all(line.startswith("#") for line in text.splitlines())
    assert "NonlinearSpring cannot be written" in text


def test_a_coefficient_that_jumps_inside_an_element_is_not_made_smooth(tmp_path):
    beam = vf.Beam(1.0, lambda x: np.where(x < 0.33, 1.0, 2.0), lambda x: np.where(x < 0.5, 1.0, 2.0), 4,
                   {"left": "clamped"}, name="step")  # fmt: skip
    result = vf.simulate(vf.Scene([beam], [vf.PointLoad(beam.at(1.0), 1.0)]), 0.5, times=np.linspace(0.0, 0.5, 11))
    loaded = saved_and_loaded(result, tmp_path / "run.vtkhdf")
    assert same(loaded.deflection([0.3, 0.77], [0.123]), result.deflection([0.3, 0.77], [0.123]))
    assert same(loaded.reaction(beam, "left").moment, result.reaction(beam, "left").moment)
    (other,) = loaded.scene.bodies
    x = np.array([0.1, 0.5, 0.6])  # rhoA jumps at a node, where it is known on both sides
    assert np.allclose(other.rhoA(x), [1.0, 2.0, 2.0], rtol=1e-14)
    with pytest.raises(vf.MissingCallableError, match=r"needs the callable .EI of Beam 'step' .*<lambda> in"):
        loaded.bending_moment([0.3])
    assert np.allclose(loaded.bending_moment([0.7]), result.bending_moment([0.7]), rtol=1e-13)


def test_closed_forms_of_other_packages_are_known_at_the_times(tmp_path):
    mass = vf.Mass(1.0, stiffness=1.0, name="m")
    result = vf.simulate(vf.Scene([mass], [vf.PointLoad(mass, Saw())]), 1.0, times=np.linspace(0.0, 1.0, 5))
    assert result.method == "event_driven"
    loaded = saved_and_loaded(result, tmp_path / "run.vtkhdf")
    assert same(loaded.acceleration(mass), result.acceleration(mass))
    assert same(loaded.energy.work, result.energy.work)
    with pytest.raises(vf.MissingCallableError, match="Saw"):
        loaded.displacement(mass, [0.3])


# -- ParaView and xarray ----------------------------------------------------------------------------


def vtk_steps(path):
    """Yield time and grid of every step, as VTK's own reader gives them."""
    import pyvista
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    for t in reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS()):
        reader.UpdateTimeStep(t)
        yield t, pyvista.wrap(reader.GetOutputDataObject(0)).copy()


@pytest.mark.parametrize("name", ["masses", "everything"])
def test_vtk_reads_the_fields_of_the_series(name, tmp_path):
    import pyvista

    from vofem.io.vtk import write_series

    result = ran(name)
    result.save(tmp_path / "run.vtkhdf", frames=result.times[::10])
    write_series(result, tmp_path / "series.pvd", result.times[::10])
    series = pyvista.get_reader(tmp_path / "series.pvd")
    steps = list(vtk_steps(tmp_path / "run.vtkhdf"))
    assert [t for t, _ in steps] == series.time_values == result.times[::10].tolist()
    for k in (0, 10, 3, 7):
        series.set_active_time_point(k)
        expected, found = series.read()[0], steps[k][1]
        assert np.array_equal(found.points, expected.points)
        assert np.array_equal(found.cells, expected.cells)
        assert np.array_equal(found.celltypes, expected.celltypes)
        for mine, other in ((found.point_data, expected.point_data), (found.cell_data, expected.cell_data)):
            assert set(mine.keys()) == set(other.keys())
            for field in set(mine.keys()):
                assert same(mine[field], other[field]), (field, k)


def test_frames(tmp_path):
    result = ran("masses-steps")
    assert result.times.size > 1000
    for frames, count in ((None, 1000), (7, 7), ([0.1, 0.5, 0.2], 3)):
        result.save(tmp_path / "run.vtkhdf", overwrite=True, frames=frames)
        with h5py.File(tmp_path / "run.vtkhdf") as file:
            values = file["VTKHDF/Steps/Values"][()]
            assert file["VTKHDF/Steps"].attrs["NSteps"] == values.size == count
            assert file["history/time"].size == result.times.size
    assert values.tolist() == [0.1, 0.2, 0.5]
    for bad in (0, [-1.0], [11.0], "all", [np.nan], []):
        with pytest.raises(vf.ArgumentError, match="frames"):
            result.save(tmp_path / "other.vtkhdf", frames=bad)


@pytest.mark.parametrize("name", ["beam-displacement", "everything", "masses-steps", "remembering-conserving"])
def test_the_history_in_a_file_is_that_of_to_xarray(name, tmp_path):
    import xarray

    result = ran(name)
    path = result.save(tmp_path / "run.vtkhdf", frames=1)
    with xarray.open_dataset(path, group="history", engine="h5netcdf") as stored:
        data = result.to_xarray()
        xarray.testing.assert_allclose(stored.drop_dims("dof"), data, rtol=1e-12, atol=1e-15)
        assert {key: part.attrs for key, part in stored.drop_dims("dof").items()} == {
            key: part.attrs for key, part in data.items()
        }
        assert stored.displacement.dims == ("time", "point")
        assert (stored.time.units, stored.velocity.units) == ("s", "m/s")
        for point in points_of_interest(result.scene):
            moved = stored.displacement.sel(point=point.name)
            assert np.allclose(moved, result.displacement(point), rtol=1e-12, atol=1e-16)
        for contact, history in result.contacts.items():
            for what in ("stiffness", "force", "closed"):
                assert np.array_equal(stored[f"contact_{what}"].sel(contact=contact), getattr(history, what))
        for spring, history in result.springs.items():
            assert np.array_equal(stored.spring_force.sel(spring=spring), history.force)
        assert np.array_equal(stored.event_time, result.solution.events.time)
        assert np.array_equal(stored.work_energy, result.energy.work)
        if name == "beam-displacement":
            beam = result.scene.bodies[0]
            held = stored.sel(support="beam@0.0")
            assert np.array_equal(held.reaction_moment, result.reaction(beam, "left").moment)
            last = np.flatnonzero((stored.dof_x == 1.0) & (stored.dof_kind == 0))[0]
            assert stored.dof_body[last] == "beam"
            assert np.array_equal(stored.q[:, last], result.displacement(beam.at(1.0)))


# -- nested data ------------------------------------------------------------------------------------

NUMBERS = st.sampled_from([np.float64, np.int64, np.bool_, np.complex128, np.uint8, np.float32])
ARRAYS = NUMBERS.flatmap(lambda kind: npst.arrays(kind, npst.array_shapes(min_dims=0, max_dims=3, min_side=0)))
LEAVES = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(), st.complex_numbers(), ARRAYS,
    ARRAYS.map(np.asfortranarray), st.floats().map(np.float64),
)  # fmt: skip
NESTS = st.recursive(
    LEAVES,
    lambda part: st.one_of(
        st.lists(part, max_size=3),
        st.tuples(part, part),
        st.dictionaries(st.text(), part, max_size=3),
        st.builds(Samples, part, part, part),
    ),
    max_leaves=8,
)


def bits(value):
    """Return something that is equal exactly for the same bits, types and orders in memory."""
    if isinstance(value, (np.ndarray, np.generic)):
        flags = value.flags
        return type(value), value.dtype, value.shape, flags.c_contiguous, flags.f_contiguous, value.tobytes()
    if dataclasses.is_dataclass(value):
        return type(value), [bits(getattr(value, field.name)) for field in dataclasses.fields(value)]
    if isinstance(value, (list, tuple)):
        return type(value), [bits(part) for part in value]
    if isinstance(value, dict):
        return [(key, bits(part)) for key, part in value.items()]
    return type(value), repr(value)


@settings(deadline=None, max_examples=30)
@given(NESTS)
def test_nested_data_come_back_bit_for_bit(tmp_path_factory, value):
    path = tmp_path_factory.getbasetemp() / "nest.h5"
    with writing(path, overwrite=True) as blocks:
        write_tree(blocks.file.create_group("nest"), value)
    with reading(path) as file:
        assert bits(read_tree(file["nest"])) == bits(value)


def test_one_object_stays_one(tmp_path):
    shared = Samples(np.zeros(2), np.ones(2), np.ones(0))
    with writing(tmp_path / "nest.h5") as blocks:
        write_tree(blocks.file, {"a": shared, "b": [shared, 1.0]})
    with reading(tmp_path / "nest.h5") as file:
        found = read_tree(file)
    assert found["a"] is found["b"][0]


@pytest.mark.parametrize("value", [object(), {1, 2}, np.array(["a"]), np.array([None]), print, {"a": [Path("x")]}])
def test_what_has_no_form_is_refused_by_name(value, tmp_path):
    with (
        pytest.raises(vf.ArgumentError, match=r"cannot hold|expected one of numbers"),
        writing(tmp_path / "a.h5") as blocks,
    ):
        write_tree(blocks.file, {"part": value})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "fields", "message"),
    [
        ("os:system", "{}", "no kind of data that this version"),
        ("vofem.system:System", "{}", "no kind of data that this version"),
        ("samples", '{"q": 1.0}', "with the fields q, expected q, v, a"),
        ("samples", '{"q": 2.0, "v": 1.0, "a": 1.0, "curvature": 3.0}', "the version that wrote it"),
    ],
)
def test_a_file_can_name_no_other_class_and_no_other_fields(name, fields, message, tmp_path):
    with writing(tmp_path / "a.h5") as blocks:
        write_text(blocks.file, "tree", f'{{"data": "{name}", "number": 0, "fields": {fields}}}')
    with pytest.raises(vf.StorageError, match=message), reading(tmp_path / "a.h5") as file:
        read_tree(file)


def test_every_name_in_files_stands_for_a_class():
    assert [name_of_class(class_named(name)) for name in NAMES] == list(NAMES)


def words_of(path):
    """Return all names and texts in an HDF5 file, but for the scene file in it."""
    found = []

    def look(name, item):
        found.append(name)
        found.extend(f"{key} {value}" for key, value in item.attrs.items() if key != "DIMENSION_LIST")
        if isinstance(item, h5py.Dataset) and h5py.check_string_dtype(item.dtype) and name != "vofem/scene.toml":
            found.extend(text.decode() for text in np.ravel(item[()]))

    with h5py.File(path) as file:
        file.visititems(look)
    return "\n".join(found)


def test_files_name_no_module_and_no_class(tmp_path):
    """Classes may be moved and renamed without a change of the format."""
    result = ran("everything")
    scene = vf.Scene(result.scene.bodies, result.scene.effects)
    result.save(tmp_path / "run.vtkhdf", frames=1)
    ran("beam-steps").save(tmp_path / "steps.vtkhdf", frames=1)
    for method, more in (("event_driven", {}), ("energy_conserving", {"dt": 0.01})):
        path = tmp_path / f"{method}.checkpoint"
        vf.simulate(scene, 0.5, method=method, checkpoint=path, checkpoint_every=0.0, **more)
    _, driven = alone(vf.Mass(1.0, stiffness=1.0, damping=0.1, name="m"), load=vf.Sine(1.0, 1.0))
    vf.continuation(lambda omega: driven.replace(driven.effects[0], f=vf.Sine(1.0, omega)), 0.5, 0.6).save(
        tmp_path / "branch.h5"
    )
    # Descriptions of loads show sums and multiples.
    private = {place.partition(":")[2] for place in NAMES.values()} - {*vf.__all__, "Sum", "Scaled"}
    private |= {"Point", "LastStep", "Segments", "ContactSamples", "SpringpotState"}
    for path in tmp_path.iterdir():
        text = words_of(path)
        assert not re.findall(r"vofem\.\w+", text), path.name
        assert not re.findall(rf"\b({'|'.join(private)})\b", text), path.name


# -- memory and command line ------------------------------------------------------------------------


def test_saving_takes_memory_in_blocks(tmp_path):
    """A run of 200 000 times: beyond what the result holds, saving takes less than a third of it again."""
    bodies = [vf.Mass(1.0, stiffness=1.0 + k, name=f"m{k}") for k in range(20)]
    loads = [vf.PointLoad(bodies[0], vf.Sine(1.0, 1.0))]
    short, result = (
        vf.simulate(vf.Scene(bodies, loads), t_end, dt=0.01, method="central_difference") for t_end in (1.0, 2000.0)
    )
    held = 3 * result.samples.q.nbytes
    assert result.times.size == 200_001
    short.save(tmp_path / "warm.vtkhdf", frames=2)
    tracemalloc.start()
    try:
        result.save(tmp_path / "run.vtkhdf", frames=2)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert held > 90e6
    assert peak < held / 3
    loaded = vf.load(tmp_path / "run.vtkhdf")
    assert same(loaded.samples.q, result.samples.q)


def test_command_line_saves_and_renders(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("ball.toml").write_text(SHORT)
    assert cli.main(["run", "ball.toml", "--save", "ball.vtkhdf", "--no-pictures"]) == 0
    assert "wrote ball.vtkhdf\n" in capsys.readouterr().out
    direct = vf.load_scene("ball.toml").simulate()
    loaded = vf.load("ball.vtkhdf")
    assert same(loaded.displacement(direct.scene.bodies[0]), direct.displacement(direct.scene.bodies[0]))
    before = Path("ball.vtkhdf").read_bytes()
    # An existing file is found before the run, not after it.
    assert cli.main(["run", "ball.toml", "--save", "ball.vtkhdf", "--no-pictures"]) == 1
    captured = capsys.readouterr()
    assert "exists already and was left as it is; add --overwrite, or choose another name" in captured.err
    assert "energy balance" not in captured.out
    assert Path("ball.vtkhdf").read_bytes() == before
    assert cli.main(["run", "ball.toml", "--save", "ball.vtkhdf", "--overwrite", "--no-pictures"]) == 0
    assert cli.main(["run", "ball.toml", "--save", "no/such/run.vtkhdf", "--no-pictures"]) == 1
    assert cli.main(["run", "ball.toml", "--save", "run.png", "--no-pictures"]) == 1
    assert cli.main(["run", "ball.toml", "--no-pictures", "--save"]) == 0
    assert Path("output/ball/run.vtkhdf").stat().st_size == len(before)
    capsys.readouterr()
    assert cli.main(["render", "ball.vtkhdf", "--output", "pictures", "--times", "1.0", "2.0"]) == 0
    named = capsys.readouterr().out.split("wrote ")[1].split()
    assert [Path(name).name for name in named] == ["history.png", "scene-1.png", "scene-2.png"]
    assert all(Path(name).stat().st_size > 1000 for name in named)
    assert cli.main(["render", "ball.vtkhdf", "--times", "7.0"]) == 1
    assert cli.main(["render", "ball.toml"]) == 1
    assert "is no HDF5 file" in capsys.readouterr().err
