"""Movies: as many different frames as asked for, the first and the last as expected, loops, and no half files."""

import sys

import numpy as np
import pytest
from orbit_scenes import bilinear
from PIL import Image
from scenes import WRONG_SIZES, paper_beam

import vofem as vf
from vofem import cli
from vofem.io import animate
from vofem.io.movies import VIEWS, side_frames, true_rate
from vofem.io.pictures.drawing import CLOSED
from vofem.io.pictures.sketch import sketch
from vofem.io.pictures.snapshot import snapshots

pytestmark = pytest.mark.kernels("plain")

SMALL = {"size": (320, 200)}
GLOW = np.array([0xFF, 0xEC, 0x9E])


@pytest.fixture(scope="module")
def run():
    beam, scene = paper_beam("penetration", elements=4, gap=0.02, stiffness=20.0, load=vf.Sine(-0.2, 3.0))
    return beam, vf.simulate(scene, 3.0)


def frames_of(path):
    with Image.open(path) as image:
        found = []
        for k in range(image.n_frames):
            image.seek(k)
            found.append(np.asarray(image.convert("RGB")).astype(int))
        return found, image.info.get("duration"), image.info.get("loop")


def glowing(frame):
    return int(np.sum(np.all(np.abs(frame - GLOW) < 8, axis=-1)))


@pytest.mark.parametrize(
    ("view", "suffix"), [("side", "gif"), ("side", "webp"), ("history", "gif"), ("phase", "webp"), ("space", "webp")]
)
def test_a_movie_has_as_many_different_frames_as_asked_for(run, view, suffix, tmp_path):
    _, result = run
    outcome = animate(result, tmp_path / f"m.{suffix}", view, frames=9, fps=20.0, **SMALL)
    found, duration, loop = frames_of(outcome.path)
    assert len({frame.tobytes() for frame in found}) == len(found) == outcome.frames == 9
    assert found[0].shape == (200, 320, 3)
    assert (duration, loop) == (50, 0)
    assert (outcome.fps, outcome.seconds) == (20.0, 9 / 20.0)
    assert outcome.speed == pytest.approx(3.0 / outcome.seconds)


def test_the_first_and_the_last_frame_are_the_first_and_the_last_time(run, tmp_path):
    """A frame of a file is, but for its palette, the picture of that time."""
    _, result = run
    outcome = animate(result, tmp_path / "m.gif", frames=5, size=(640, 360), magnification=2.0)
    found, _, _ = frames_of(outcome.path)
    for frame, view in zip((found[0], found[-1]), snapshots(result, np.array([0.0, 3.0])), strict=True):
        expected = sketch(view, (640, 360), 2.0, forces=True).pixels().astype(int)
        assert np.mean(np.abs(frame - expected)) < 1.0
    assert np.mean(np.abs(found[0] - found[-1])) > 1.0


def test_contacts_light_up_while_closed_and_arrows_grow_with_the_force(run):
    _, result = run
    impacts = result.contacts["stop"].impacts
    middle = result.times[np.argmax(result.contacts["stop"].force)]
    times = np.array([0.5 * impacts.closing[0], impacts.closing[0] + 1e-3, middle])
    before, early, _ = (frame.astype(int) for frame in side_frames(snapshots(result, times), (640, 360), 1.0))
    assert glowing(before) == 0
    assert glowing(early) > 200
    sizes = []
    for state in snapshots(result, times):
        found = [part for part in sketch(state, (640, 360), 1.0, forces=True).lines if part.color == CLOSED]
        sizes.append(max((float(np.ptp(part.points[:, 1])) for part in found if not part.behind), default=0.0))
    assert sizes[0] == sizes[1] == 0.0
    assert sizes[2] > 20.0


def test_speed_and_window_say_how_many_frames_there_are(run, tmp_path):
    _, result = run
    path = tmp_path / "m.gif"
    outcome = animate(result, path, window=(1.0, 2.0), speed=0.5, fps=10.0, **SMALL)
    assert (outcome.frames, outcome.speed) == (20, 0.5)
    # GIF counts hundredths of a second.
    assert true_rate(".gif", 30.0) == pytest.approx(100.0 / 3.0)
    assert true_rate(".webp", 30.0) == 30.0


def test_a_periodic_orbit_is_a_loop_over_one_period(tmp_path):
    orbit = vf.periodic(bilinear(1.0))
    outcome = animate(orbit, tmp_path / "orbit.gif", frames=8, **SMALL)
    found, _, _ = frames_of(outcome.path)
    assert len(found) == 8
    # The last frame is a step before the first one, which comes next: no time is shown twice.
    steps = [np.mean(np.abs(found[k] - found[k - 1])) for k in range(8)]
    assert min(steps) > 0.0
    assert steps[0] < 3.0 * np.median(steps)
    assert outcome.speed * outcome.seconds == pytest.approx(orbit.period)


def test_mode_shapes_swing_about_rest(run, tmp_path):
    _, result = run
    shapes = vf.modes(result.scene, 3)
    outcome = animate(shapes, tmp_path / "mode.gif", mode=1, scene=result.scene, frames=4, size=(640, 360))
    found, _, _ = frames_of(outcome.path)
    # After a quarter and three quarters of the period it is at rest; Pillow joins equal neighbours only.
    assert np.mean(np.abs(found[1] - found[3])) < 0.05
    assert np.mean(np.abs(found[0] - found[2])) > 1.0
    with pytest.raises(vf.ArgumentError, match="mode is 3, expected 0 to 2"):
        animate(shapes, tmp_path / "x.gif", mode=3)
    other = vf.Scene([vf.Mass(1.0, 1.0, name="other")])
    with pytest.raises(vf.ArgumentError, match="give the scene of which vofem"):
        animate(shapes, tmp_path / "x.gif", scene=other)
    with pytest.raises(vf.ArgumentError, match="no 'phase' view"):
        animate(shapes, tmp_path / "x.gif", "phase")


def test_several_runs_share_time_and_magnification(run, tmp_path):
    _, result = run
    other = vf.simulate(result.scene.replace(result.scene.contacts[0], stiffness=200.0), 2.0)
    outcome = animate({"soft": result, "stiff": other}, tmp_path / "two.gif", frames=3, **SMALL)
    found, _, _ = frames_of(outcome.path)
    assert found[0].shape == (400, 320, 3)
    assert outcome.speed * outcome.seconds == pytest.approx(2.0)
    beside = animate({"soft": result, "stiff": other}, tmp_path / "two.webp", "phase", frames=3, **SMALL)
    assert frames_of(beside.path)[0][0].shape == (200, 640, 3)


def test_a_stepping_run_shows_the_times_that_it_has_stored(run, tmp_path):
    _, result = run
    few = vf.simulate(result.scene, 3.0, method="generalized_alpha", dt=1e-2, times=np.linspace(0.0, 3.0, 7))
    assert animate(few, tmp_path / "m.gif", frames=7, **SMALL).frames == 7
    with pytest.raises(vf.ArgumentError, match="stored 7 times, which do not give 8 different frames"):
        animate(few, tmp_path / "m.gif", frames=8, **SMALL)


def test_ctrl_c_leaves_the_earlier_file(run, tmp_path):
    _, result = run
    path = tmp_path / "m.gif"
    path.write_bytes(b"earlier")

    def stop(done, total):
        assert total == 6
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        animate(result, path, frames=6, progress=stop, **SMALL)
    assert path.read_bytes() == b"earlier"
    assert [one.name for one in tmp_path.iterdir()] == ["m.gif"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"view": "top"}, "view is 'top'"),
        ({"speed": 1.0, "frames": 3}, "not both"),
        ({"frames": 1}, "whole number, 2 or more"),
        ({"speed": 1e-6}, "at most 3000"),
        ({"window": (2.0, 9.0)}, "window"),
        ({"progress": "yes"}, "animate: progress"),
        *(({"size": size, "view": view}, "a picture's size is") for size in WRONG_SIZES for view in VIEWS),
    ],
)
def test_wrong_arguments_are_refused(run, arguments, words, tmp_path):
    with pytest.raises(vf.ArgumentError, match=words):
        animate(run[1], tmp_path / "m.gif", **arguments)
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_is_named(run, tmp_path, monkeypatch):
    with pytest.raises(vf.ArgumentError, match=r"\.webp"):
        animate(run[1], tmp_path / "m.avi")
    with pytest.raises(vf.ArgumentError, match="subject is 3"):
        animate(3, tmp_path / "m.gif")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(vf.MissingPackageError, match=r"pip install 'vofem\[movie\]'"):
        animate(run[1], tmp_path / "m.mp4")


def test_the_command_line_writes_a_movie(run, tmp_path, capsys):
    _, result = run
    saved = result.save(tmp_path / "run.vtkhdf")
    goal = tmp_path / "m.gif"
    arguments = ["render", str(saved), "--movie", str(goal), "--view", "history", "--frames", "3"]
    assert cli.main([*arguments, "--point", "beam@0.5"]) == 0
    assert "3 frames" in capsys.readouterr().out
    assert len(frames_of(goal)[0]) == 3
    for words in (["--snapshot"], ["--output", str(tmp_path)], ["--times", "1.0"]):
        assert cli.main([*arguments, *words]) == 1
        assert capsys.readouterr().err.startswith(f"vofem: {words[0]} is for pictures")
    for words in (["--view", "side"], ["--speed", "1"], ["--frames", "0"], ["--point", "beam@0.5"]):
        assert cli.main(["render", str(saved), "--output", str(tmp_path / "pictures"), *words]) == 1
        assert capsys.readouterr().err.startswith(f"vofem: {words[0]} is for movies")
    assert not (tmp_path / "pictures").exists()
