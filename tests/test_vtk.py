"""VTU series read back with VTK's own reader, and what happens when they cannot be written."""

import numpy as np
import pytest
from scenes import paper_beam, two_masses

import vofem as vf
from vofem.integrators.base import ContactSamples
from vofem.io import frames
from vofem.io.vtk import write_series

BEAM, MASS, CONTACT, STOP = range(4)
TIMES = np.linspace(0.0, 6.0, 13)


def frames_of(index):
    """Return times and grids of a series by ParaView's index, read by VTK."""
    import pyvista as pv

    reader = pv.get_reader(str(index))
    grids = []
    for k in range(reader.number_time_points):
        reader.set_active_time_point(k)
        grids.append(reader.read()[0])
    return np.array(reader.time_values), grids


def cells_of(grid, kind):
    return np.flatnonzero(grid.cell_data["kind"] == kind)


def points_of(grid, cell):
    return grid.get_cell(int(cell)).point_ids


def beam_points(grid, body=0):
    """Return the numbers of a beam's points, element by element: shape (n_elements, points_per_element)."""
    mine = np.flatnonzero((grid.cell_data["kind"] == BEAM) & (grid.cell_data["body"] == body))
    lines = np.array([points_of(grid, c) for c in mine])
    elements = grid.cell_data["element"][mine]
    return np.array([np.unique(lines[elements == e]) for e in range(elements.max() + 1)])


@pytest.fixture(scope="module")
def run():
    beam, scene = paper_beam("displacement", elements=6, gap=0.01, load=vf.Constant(-0.1))
    return beam, vf.simulate(scene, 6.0, times=TIMES)


@pytest.fixture(scope="module")
def series(run, tmp_path_factory):
    outcome = write_series(run[1], tmp_path_factory.mktemp("series") / "run.pvd", points_per_element=4)
    return outcome, *frames_of(outcome.path)


def test_index_has_the_times_of_the_run(series, run):
    outcome, times, grids = series
    assert np.array_equal(times, TIMES)
    assert outcome.frames == len(grids) == TIMES.size
    assert outcome.bytes == sum(f.stat().st_size for f in outcome.path.parent.rglob("*") if f.is_file())
    assert [grid.field_data["TimeValue"][0] for grid in grids] == list(TIMES)


@pytest.mark.parametrize("field", ["deflection", "slope", "bending_moment", "shear_force"])
def test_fields_are_those_of_the_result(series, run, field):
    _, times, grids = series
    for t, grid in zip(times, grids, strict=True):
        ids = beam_points(grid)
        assert ids.shape == (6, 4)
        # Without the last point of each element: at a node the result takes the element to the right.
        inner = ids[:, :-1].ravel()
        x = grid.points[inner, 0]
        expected = getattr(run[1], field)(x, [t])[:, 0]
        scale = np.max(np.abs(getattr(run[1], field)(x))) * 1e-12
        got = grid[field][inner]
        if field == "deflection":
            assert np.array_equal(got[:, 1], grid["eta"][inner])
            assert not np.any(got[:, [0, 2]])
            got = got[:, 1]
        np.testing.assert_allclose(got, expected, rtol=1e-12, atol=scale)


def test_velocity_is_that_of_the_result(series, run):
    beam, result = run
    for k, grid in enumerate(series[2]):
        ids = beam_points(grid)
        for e in (0, 3):
            assert grid["velocity"][ids[e, 1]] == pytest.approx(
                result.velocity(beam.at(grid.points[ids[e, 1], 0]))[k], abs=1e-14
            )


def test_moments_and_shear_forces_jump_at_nodes(series, run):
    grid = series[2][5]
    ids = beam_points(grid)
    left, right = ids[:-1, -1], ids[1:, 0]
    np.testing.assert_allclose(grid.points[left], grid.points[right], rtol=0, atol=1e-15)
    for name in ("eta", "slope"):
        np.testing.assert_allclose(grid[name][left], grid[name][right], rtol=1e-10, atol=1e-15)
    for field, name in ((run[1].bending_moment, "bending_moment"), (run[1].shear_force, "shear_force")):
        x = grid.points[right, 0]
        before, after = field(x - 1e-8, [series[1][5]])[:, 0], field(x, [series[1][5]])[:, 0]
        assert np.all(np.abs(after - before) > 1e-4 * np.max(np.abs(after)))
        np.testing.assert_allclose(grid[name][left], before, rtol=1e-5)
        np.testing.assert_allclose(grid[name][right], after, rtol=1e-9)


def test_contact_is_a_line_to_its_stop(series, run):
    contact = run[1].contacts["stop"]
    assert 0 < np.count_nonzero(contact.closed) < TIMES.size
    for k, grid in enumerate(series[2]):
        (line,), (bar,) = cells_of(grid, CONTACT), cells_of(grid, STOP)
        touching, stop = points_of(grid, line)
        np.testing.assert_allclose(grid.points[touching], [1.0, 0.0, 0.0])
        np.testing.assert_allclose(grid.points[stop], [1.0, -0.01, 0.0])
        assert grid["eta"][touching] == pytest.approx(run[1].displacement(run[0].at(1.0))[k], abs=1e-15)
        assert grid["eta"][stop] == 0.0
        for cell in (line, bar):
            assert grid["contact_state"][cell] == int(contact.closed[k])
            assert grid["contact_force"][cell] == pytest.approx(contact.force[k], abs=1e-15)
            assert grid["contact_stiffness"][cell] == contact.stiffness[k]
            assert grid["contact"][cell] == 0
        beams = cells_of(grid, BEAM)
        assert np.all(grid["contact_state"][beams] == -1)
        assert np.all(np.isnan(grid["contact_force"][beams]))


def test_warped_tip_meets_the_stop_when_the_contact_closes(run, tmp_path):
    _, result = run
    closing = result.contacts["stop"].closings[:1]
    _, (grid,) = frames_of(write_series(result, tmp_path / "w.pvd", closing, magnification=20.0).path)
    warped = grid.warp_by_vector("deflection", factor=float(grid.field_data["magnification"][0]))
    touching, stop = points_of(grid, cells_of(grid, CONTACT)[0])
    np.testing.assert_allclose(warped.points[touching], warped.points[stop], atol=1e-9)
    assert warped.points[stop, 1] == pytest.approx(-0.2)


def test_pinned_contacts_are_marked(run, tmp_path, monkeypatch):
    """What a solution says of its contacts is written as it is, whatever the integrator."""
    states = [[0, 2, 1]]
    samples = ContactSamples(np.array(states), np.array([[0.0, 7.0, 1.0]]), np.array([[0.0, 0.07, 0.1]]))
    monkeypatch.setattr(run[1].solution, "contacts", lambda times: samples)
    _, grids = frames_of(write_series(run[1], tmp_path / "p.pvd", [0.0, 1.0, 2.0]).path)
    cells = [(grid, cells_of(grid, CONTACT)[0]) for grid in grids]
    assert [grid["contact_state"][cell] for grid, cell in cells] == [0, 2, 1]
    assert [grid["contact_stiffness"][cell] for grid, cell in cells] == [0.0, 7.0, 1.0]
    assert [grid["contact_force"][cell] for grid, cell in cells] == [0.0, 0.07, 0.1]


def test_two_masses_stand_a_gap_apart(tmp_path):
    first, second, scene = two_masses("a", "penetration")
    result = vf.simulate(scene, 20.0, times=np.linspace(0.0, 20.0, 9))
    _, grids = frames_of(write_series(result, tmp_path / "m.pvd").path)
    for k, grid in enumerate(grids):
        masses = [points_of(grid, cell)[0] for cell in cells_of(grid, MASS)]
        assert grid["body"][cells_of(grid, MASS)].tolist() == [0, 1]
        for mass, point in zip((first, second), masses, strict=True):
            assert grid["eta"][point] == pytest.approx(result.displacement(mass)[k], abs=1e-14)
            assert grid["velocity"][point] == pytest.approx(result.velocity(mass)[k], abs=1e-14)
            assert np.isnan(grid["bending_moment"][point])
        assert grid.points[masses[1], 1] - grid.points[masses[0], 1] == 5.0
        (line,) = cells_of(grid, CONTACT)
        a, b = points_of(grid, line)
        np.testing.assert_array_equal(grid.points[[a, b]], grid.points[masses])
        np.testing.assert_array_equal(grid["eta"][[a, b]], grid["eta"][masses])
        assert grid["contact_force"][line] == pytest.approx(result.contacts["contact"].force[k], abs=1e-14)
        assert not cells_of(grid, STOP).size


def test_several_bodies_have_their_own_planes(tmp_path):
    low = vf.Beam(2.0, 1.0, 1.0, 4, {"left": "clamped"})
    high = vf.Beam(1.0, lambda x: 1.0 + x, 1.0, [3.0, 3.2, 4.0], {"right": "clamped"})
    mass = vf.Mass(1.0, stiffness=1.0)
    effects = [
        vf.Contact(low.at(1.7), high.at(3.1), gap=0.1, stiffness=5.0, acts_on="penetration", name="between"),
        vf.Contact(mass, low.at(0.5), gap=0.2, stiffness=5.0, acts_on="penetration", name="mass"),
        vf.PointLoad(low.at(2.0), 0.5),
    ]
    result = vf.simulate(vf.Scene([low, high, mass], effects), 3.0, times=[0.0, 1.0, 3.0])
    _, grids = frames_of(write_series(result, tmp_path / "s.pvd", magnification=2.0).path)
    grid = grids[-1]
    # Points joined by a contact have one x; b stands a gap above a, and every body in its own plane.
    for body, (dx, y, z) in enumerate([(0.0, 0.0, 0.0), (-1.4, 0.2, 0.2)]):
        ids = beam_points(grid, body)
        np.testing.assert_allclose(grid.points[ids][..., 0], grid["x"][ids] + dx, atol=1e-15)
        np.testing.assert_allclose(grid.points[ids][..., 1:], np.broadcast_to([y, z], (*ids.shape, 2)))
        inner = ids[:, :-1]
        for name in ("bending_moment", "shear_force"):
            expected = getattr(result, name)(grid["x"][inner].ravel(), [3.0], body=(low, high)[body])[:, 0]
            np.testing.assert_allclose(grid[name][inner].ravel(), expected, rtol=1e-9, atol=1e-12)
        last = grid["x"][ids[-1, -1]]
        assert grid["bending_moment"][ids[-1, -1]] == pytest.approx(
            result.bending_moment([last], [3.0], body=(low, high)[body])[0, 0], abs=1e-12
        )
    np.testing.assert_allclose(grid.points[points_of(grid, cells_of(grid, MASS)[0])[0]], [0.5, -0.4, 0.4])
    between = points_of(grid, cells_of(grid, CONTACT)[0])
    np.testing.assert_allclose(grid.points[between], [[1.7, 0.0, 0.0], [1.7, 0.2, 0.2]])


def test_stiffness_that_jumps_at_a_node_is_that_of_each_side(tmp_path):
    beam = vf.Beam(1.0, lambda x: np.where(x < 0.5, 1.0, 3.0), 1.0, 2, {"left": "clamped"})
    result = vf.simulate(vf.Scene([beam], [vf.PointLoad(beam.at(1.0), 1.0)]), 1.0, times=[0.0, 1.0])
    grid = frames_of(write_series(result, tmp_path / "j.pvd").path)[1][-1]
    ids = beam_points(grid)
    curvature = np.asarray(beam.field_matrix([0.5 - 1e-7], 2) @ result.model.of_body(beam, result.samples.q[:, -1]))
    assert grid["bending_moment"][ids[0, -1]] == pytest.approx(curvature[0], rel=1e-5)
    assert grid["bending_moment"][ids[1, 0]] == pytest.approx(result.bending_moment([0.5], [1.0])[0, 0], rel=1e-12)


def test_every_node_of_a_one_sided_foundation_is_a_contact(tmp_path):
    beam = vf.Beam(1.0, 1.0, 1.0, 4, {"left": "pinned"})
    ground = vf.Foundation(beam, stiffness=50.0, one_sided=True, gap=0.002, name="ground")
    result = vf.simulate(vf.Scene([beam], [ground, vf.Gravity()]), 0.3, times=[0.0, 0.3])
    grid = frames_of(write_series(result, tmp_path / "f.pvd").path)[1][-1]
    lines = cells_of(grid, CONTACT)
    starts = [grid.points[points_of(grid, line)[0], 0] for line in lines]
    np.testing.assert_allclose(starts, [0.25, 0.5, 0.75, 1.0])
    np.testing.assert_allclose([grid.points[points_of(grid, line)[1], 1] for line in lines], -0.002)
    expected = [result.contacts[f"ground[{k}]"].force[-1] for k in (1, 2, 3, 4)]
    assert max(expected) > 0
    np.testing.assert_allclose(grid["contact_force"][lines], expected)


def test_other_times_any_method_and_small_blocks(tmp_path, monkeypatch):
    _, scene = paper_beam("penetration", elements=3)
    result = vf.simulate(scene, 1.0, method="central_difference", dt=1e-3)
    times = [0.0003, 0.5, 0.70001, 1.0]
    whole = write_series(result, tmp_path / "whole.pvd", times)
    monkeypatch.setattr(frames, "_BLOCK_BYTES", 1)
    split = write_series(result, tmp_path / "split.pvd", times)
    found, grids = frames_of(split.path)
    assert found.tolist() == times
    for grid, same in zip(grids, frames_of(whole.path)[1], strict=True):
        for name in grid.array_names:
            np.testing.assert_allclose(grid[name], same[name], rtol=1e-12, atol=1e-14)
        ids = beam_points(grid)
        t = grid.field_data["TimeValue"]
        np.testing.assert_allclose(grid["eta"][ids[1]], result.deflection(grid["x"][ids[1]], t)[:, 0], atol=1e-15)


def test_a_new_series_replaces_the_old_one(run, tmp_path, capfd):
    for times in ([0.0, 1.0, 2.0], [0.0, 3.0], [1.0]):
        outcome = write_series(run[1], tmp_path / "a & b.pvd", times)
        found, grids = frames_of(outcome.path)
        assert found.tolist() == times
        assert len(grids) == len(times)
        assert len(list(tmp_path.iterdir())) == 2
        assert outcome.bytes == sum(f.stat().st_size for f in tmp_path.rglob("*") if f.is_file())
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        ({"times": [0.0, 7.0]}, "expected 0 to 6 s"),
        ({"times": [1.0, 1.0]}, "increase"),
        ({"times": []}, "one or more"),
        ({"times": [np.nan]}, "finite"),
        ({"points_per_element": 1}, "points_per_element is 1"),
        ({"points_per_element": 2.5}, "points_per_element is 2.5"),
        ({"magnification": 0.0}, "magnification"),
        ({"path": "run.vtu"}, "ends in '.pvd'"),
        ({"path": 3}, "path is 3"),
    ],
)
def test_wrong_arguments(run, tmp_path, monkeypatch, arguments, found):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(vf.ArgumentError, match=found):
        write_series(**{"result": run[1], "path": "run.pvd", **arguments})
    assert list(tmp_path.iterdir()) == []
