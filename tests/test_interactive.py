"""The window with a slider, a snapshot without a window, and frames of a run as meshes of pyvista."""

import os
import subprocess
import sys

import matplotlib.image
import numpy as np
import pytest
import pyvista
from scenes import WRONG_SIZES, paper_beam

import vofem as vf
from vofem.io import show, snapshot, vtk
from vofem.io.space import plotter_of

pytestmark = pytest.mark.kernels("plain")


@pytest.fixture(scope="module")
def run():
    beam, scene = paper_beam("penetration", elements=4, gap=0.02, stiffness=2e3, load=vf.Sine(-0.2, 3.0))
    return beam, vf.simulate(scene, 3.0, times=np.linspace(0.0, 3.0, 13))


def test_the_slider_moves_the_mesh(run):
    beam, result = run
    plotter, _ = plotter_of(result, magnification=2.0, off_screen=True)
    try:
        (slider,) = getattr(plotter, "widgets", plotter).slider_widgets
        representation = slider.GetRepresentation()
        assert (representation.GetMinimumValue(), representation.GetMaximumValue()) == (0.0, 3.0)
        assert representation.GetTitleText() == "time [s]"
        bodies = next(actor.mapper.dataset for actor in plotter.actors.values() if hasattr(actor, "mapper")
                      and "kind" in getattr(actor.mapper.dataset, "cell_data", {}))  # fmt: skip
        before = np.array(bodies.points)
        # As a hand does it: the value changes, and the widget says so.
        representation.SetValue(1.5)
        slider.InvokeEvent("InteractionEvent")
        after = np.array(bodies.points)
        tip = int(np.nanargmax(bodies.point_data["x"]))
        expected = 2.0 * result.displacement(beam.at(1.0), [1.5])[0]
        assert after[tip, 1] - before[tip, 1] == pytest.approx(expected, rel=1e-9)
        assert abs(expected) > 0.01
        picture = plotter.screenshot(None, return_img=True)
        assert picture.std() > 5.0
    finally:
        plotter.close()


def test_orbits_and_masses_are_shown_too():
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="mass")
    stop = vf.Contact(mass, gap=0.5, stiffness=8.0, side="above", acts_on="penetration", name="stop")
    orbit = vf.periodic(vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(1.0, 1.0))]))
    plotter, move = plotter_of(orbit, off_screen=True)
    move(0.5 * orbit.period)
    plotter.close()


def test_wrong_arguments_and_no_display_are_named(run, monkeypatch):
    _, result = run
    with pytest.raises(vf.ArgumentError, match="subject is 3"):
        plotter_of(3, off_screen=True)
    with pytest.raises(vf.ArgumentError, match="scalars is 'stress', expected one of"):
        plotter_of(result, scalars="stress", off_screen=True)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(vf.OutputError, match="no display"):
        show(result)


def test_a_snapshot_shows_the_motion_of_its_time(run, tmp_path):
    _, result = run
    path = snapshot(result, 0.0, tmp_path / "rest.png", size=(300, 200), magnification=2.0)
    rest = matplotlib.image.imread(path)[..., :3]
    moved = matplotlib.image.imread(snapshot(result, 1.5, path, size=(300, 200), magnification=2.0))[..., :3]
    assert rest.shape == (200, 300, 3)
    assert rest.std() > 0.02
    assert np.mean(np.any(np.abs(moved - rest) > 0.1, axis=-1)) > 0.01
    for arguments, words in (((3, 0.0), "subject is 3"), ((result, 7.0), "0 to 3 s"), ((result, np.nan), "NaN")):
        with pytest.raises(vf.ArgumentError, match=words):
            snapshot(*arguments, tmp_path / "a.png")
    with pytest.raises(vf.ArgumentError, match="ends in"):
        snapshot(result, 1.0, tmp_path / "a.jpg")
    for size in WRONG_SIZES:
        with pytest.raises(vf.ArgumentError, match="a picture's size is"):
            snapshot(result, 1.0, tmp_path / "a.png", size=size)


def test_without_a_graphics_driver_a_snapshot_is_refused_and_says_what_to_install(tmp_path):
    """VTK itself would end the process with a segmentation fault."""
    code = (
        "import vofem as vf; from vofem.io import snapshot\n"
        "m = vf.Mass(1.0, 10.0); r = vf.simulate(vf.Scene([m], [vf.PointLoad(m, vf.Constant(1.0))]), 1.0)\n"
        f"try: snapshot(r, 0.5, r'{tmp_path / 'm.png'}')\n"
        "except vf.OutputError as error: print(error)"
    )
    environment = {**os.environ, "__EGL_VENDOR_LIBRARY_DIRS": str(tmp_path), "LIBGL_DRIVERS_PATH": str(tmp_path)}
    environment.pop("DISPLAY", None)
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    assert run.returncode == 0, run.stderr
    # Systems other than Linux draw with what they have.
    assert "libegl1" in run.stdout or (tmp_path / "m.png").exists()


def test_a_frame_its_series_and_its_file_are_the_same(run, tmp_path):
    beam, result = run
    frame = result.frame(1.25, magnification=3.0)
    assert (frame.field_data["TimeValue"][0], frame.field_data["magnification"][0]) == (1.25, 3.0)
    moved = frame.warp_by_vector("deflection", factor=3.0)
    tip = int(np.nanargmax(frame.point_data["x"]))
    assert moved.points[tip, 1] == pytest.approx(3.0 * result.displacement(beam.at(1.0), [1.25])[0])
    vtk.write_series(result, tmp_path / "run.pvd", [1.25], magnification=3.0)
    series = pyvista.read(tmp_path / "run-frames" / "frame-000000.vtu")
    result.save(tmp_path / "run.vtkhdf", frames=[1.25], magnification=3.0)
    for other in (series, pyvista.read(tmp_path / "run.vtkhdf"), vf.load(tmp_path / "run.vtkhdf").frame(1.25)):
        for name in frame.point_data:
            np.testing.assert_allclose(other.point_data[name], frame.point_data[name], rtol=1e-12, atol=1e-14)
        for name in frame.cell_data:
            np.testing.assert_array_equal(other.cell_data[name], frame.cell_data[name])


def test_a_magnified_run_meets_its_stop_where_the_contact_closes(run, tmp_path):
    """What ParaView shows: points at rest, moved by deflection times the magnification that the file was saved with."""
    _, result = run
    instant = float(result.contacts["stop"].closings[0])
    result.save(tmp_path / "run.vtkhdf", magnification=3.0, frames=[instant])
    mesh = pyvista.read(tmp_path / "run.vtkhdf").warp_by_vector("deflection", factor=3.0)
    (line,) = np.flatnonzero(mesh.cell_data["kind"] == 2)
    ends = mesh.get_cell(int(line)).points[:, 1]
    assert abs(ends[0] - ends[1]) < 1e-9


def test_frames_outside_of_the_run_are_refused(run, tmp_path):
    for arguments, words in (
        ({"t": 3.5}, "t is 3.5 s, expected a time of the run, 0 to 3 s"),
        ({"t": "now"}, "t is 'now'"),
        ({"t": 1.0, "magnification": 0.0}, "magnification"),
        ({"t": 1.0, "points_per_element": 1}, "expected 2 to 1000"),
    ):
        with pytest.raises(vf.ArgumentError, match=words):
            run[1].frame(**arguments)
    with pytest.raises(vf.ArgumentError, match="magnification"):
        run[1].save(tmp_path / "run.vtkhdf", magnification=0.0)
