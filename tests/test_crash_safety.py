"""Writing fails at every place, processes die at any moment: the file is the old one or the new one, whole."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from scenes import alone, on_stop

import vofem as vf
from vofem.files import whole as files
from vofem.files.whole import replacing
from vofem.io.csv_file import write_csv
from vofem.io.plot import time_history
from vofem.io.vtk import write_series

pytestmark = pytest.mark.kernels("plain")


def small(end=1.0):
    _, scene = on_stop(vf.Mass(1.0, stiffness=1.0, name="ball"), gap=0.1, stiffness=10.0, start=(0.0, 1.0))
    return vf.simulate(scene, end, times=np.linspace(0.0, end, 5))


@pytest.fixture(scope="module")
def results():
    return small(1.0), small(2.0)


@pytest.fixture
def old(results, tmp_path):
    """A folder with a saved run, and its bytes."""
    path = tmp_path / "run.vtkhdf"
    results[0].save(path)
    return path, path.read_bytes()


def only(path):
    return [other.name for other in path.parent.iterdir()] == [path.name]


def replace_text(path, text, **options):
    with replacing(path, **options) as temporary:
        temporary.write_text(text)


def no_links(*_arguments):
    raise OSError(errno.EPERM, os.strerror(errno.EPERM))


@pytest.fixture(scope="module")
def branch():
    _, driven = alone(vf.Mass(1.0, stiffness=1.0, damping=0.1, name="m"), load=vf.Sine(1.0, 1.0))
    return vf.continuation(lambda omega: driven.replace(driven.effects[0], f=vf.Sine(1.0, omega)), 0.5, 0.6)


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("there", [True, False])
@pytest.mark.parametrize("name", ["fsync", "replace", "open", "mkdir", "write_bytes"])
def test_every_writer_leaves_all_or_nothing(name, there, results, branch, tmp_path, monkeypatch):
    """Whichever call of the system fails, what was there stays, and nothing else remains."""
    (ball,) = results[0].scene.bodies
    writers = {
        "run": lambda run: run.save(tmp_path / "run.vtkhdf", overwrite=True),
        "branch": lambda _: branch.save(tmp_path / "branch.h5", overwrite=True),
        "scene": lambda run: vf.dump_scene(run.scene, tmp_path / "scene.toml", overwrite=True),
        "table": lambda run: write_csv(run, [ball], tmp_path / "run.csv"),
        "series": lambda run: write_series(run, tmp_path / "run.pvd"),
        "picture": lambda run: time_history(run, ball, tmp_path / "run.png"),
    }
    if not there:
        writers |= {
            "checkpoint": lambda run: vf.simulate(
                run.scene, 1.0, checkpoint=tmp_path / "run.checkpoint", checkpoint_every=0.0
            ),
            "sweep": lambda _: vf.sweep(
                lambda x: {"y": x}, {"x": [1.0]}, executor="serial", store=tmp_path / "rows.h5"
            ),
        }
    if name in ("mkdir", "write_bytes"):
        writers = {"series": writers["series"]}
    for write in writers.values() if there else ():
        write(results[0])
    before = contents(tmp_path)

    def full(*_arguments, **_options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path if name in ("mkdir", "write_bytes") else files.os, name, full)
    for what, write in writers.items():
        with pytest.raises(vf.OutputError, match="No space left on device"):
            write(results[1])
        assert contents(tmp_path) == before, what


def test_a_file_that_exists_is_kept(results, old):
    path, before = old
    with pytest.raises(vf.OutputError, match=r"exists already and was left as it is; .* overwrite=True"):
        results[1].save(path)
    assert path.read_bytes() == before
    assert only(path)
    results[1].save(path, overwrite=True)
    assert path.read_bytes() != before
    assert only(path)


@pytest.mark.parametrize("links", [True, False])
def test_a_file_that_appears_meanwhile_is_kept(links, tmp_path, monkeypatch):
    """Also where the file system knows no hard links."""
    if not links:
        monkeypatch.setattr(files.os, "link", no_links)
    replace_text(tmp_path / "file", "new", overwrite=False)
    assert (tmp_path / "file").read_text() == "new"
    (tmp_path / "file").unlink()
    with pytest.raises(vf.OutputError, match="exists already"), replacing(tmp_path / "file", overwrite=False):
        (tmp_path / "file").write_text("of another process")
    assert (tmp_path / "file").read_text() == "of another process"
    assert only(tmp_path / "file")


def test_a_folder_that_cannot_be_forced_to_disk_is_no_error(tmp_path, monkeypatch):
    sync = os.fsync

    def only_files(descriptor):
        if os.path.isdir(f"/proc/self/fd/{descriptor}"):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        sync(descriptor)

    monkeypatch.setattr(files.os, "fsync", only_files)
    replace_text(tmp_path / "file", "new")
    assert (tmp_path / "file").read_text() == "new"


def test_places_that_cannot_be_written(results, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    for folder in ("folder.vtkhdf", "folder.pvd"):
        (tmp_path / folder).mkdir()
    for name, message in (
        ("file/run.vtkhdf", "is a file, not a folder"),
        ("none/run.vtkhdf", "does not exist; create it first"),
        ("folder.vtkhdf", "it is a folder"),
    ):
        for overwrite in (False, True):
            with pytest.raises(vf.OutputError, match=message):
                results[0].save(tmp_path / name, overwrite=overwrite)
        with pytest.raises(vf.OutputError, match=message):
            write_series(results[0], (tmp_path / name).with_suffix(".pvd"))
    for name in ("run.png", "run", 3):
        with pytest.raises(vf.ArgumentError, match="path is"):
            results[0].save(name)

    def read_only(*_arguments):
        raise PermissionError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(files.os, "open", read_only)
    with pytest.raises(vf.OutputError, match=r"Read-only file system; check the permissions"):
        results[0].save(tmp_path / "run.vtkhdf")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder.pvd", "folder.vtkhdf"]


# -- processes --------------------------------------------------------------------------------------

PRELUDE = """
import os, random, resource, signal, sys, time
from pathlib import Path
import numpy as np
sys.path.insert(0, {tests!r})
from test_crash_safety import small
import vofem as vf
path = Path({path!r})
results = small(1.0), small(2.0)
results[0].save(path)
ends = {{1.0: results[0], 2.0: results[1]}}

def whole():
    loaded = vf.load(path)
    expected = ends[float(loaded.times[-1])]
    assert np.array_equal(loaded.samples.q, expected.samples.q)
    assert np.array_equal(loaded.contacts["stop"].force, expected.contacts["stop"].force)
    return float(loaded.times[-1])
"""


def run_script(body, tmp_path):
    script = PRELUDE.format(tests=str(Path(__file__).parent), path=str(tmp_path / "run.vtkhdf")) + body
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_kill_9_at_any_moment(tmp_path):
    """A child saves over the file again and again and is killed: the parent finds one run or the other, whole."""
    body = """
random.seed(1)
began = time.perf_counter()
results[0].save(path, overwrite=True)
duration = time.perf_counter() - began
seen, leftovers = set(), 0
for turn in range(7):
    inlet, outlet = os.pipe()
    child = os.fork()
    if child == 0:
        k = turn
        while True:
            k += 1
            results[k % 2].save(path, overwrite=True)
            os.write(outlet, b".")
    # After none, one or two saves, and some way into the next.
    for _ in range(turn % 3):
        os.read(inlet, 1)
    time.sleep(random.uniform(0.0, duration))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    os.close(inlet)
    os.close(outlet)
    seen.add(whole())
    for other in path.parent.iterdir():
        if other != path:
            assert other.name.startswith(".vofem-"), other
            leftovers += 1
            other.unlink()
print(sorted(seen), leftovers)
"""
    out = run_script(body, tmp_path)
    assert out.startswith("[1.0, 2.0] ")
    # The kills did hit writers at work.
    assert int(out.split()[-1]) >= 3


def test_a_limit_on_the_size_of_files(tmp_path):
    """The system itself refuses to write beyond a size, as a full disk does; no fault is simulated."""
    body = """
size = path.stat().st_size
before = path.read_bytes()
failed = 0
for limit in [*range(0, size, max(1, size // 25)), 10 * size]:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    try:
        results[1].save(path, overwrite=True)
    except vf.OutputError as error:
        assert "File too large" in str(error), error
        failed += 1
        assert path.read_bytes() == before
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    assert [other.name for other in path.parent.iterdir()] == [path.name]
print(whole(), failed)
"""
    out = run_script(body, tmp_path).split()
    assert float(out[0]) == 2.0
    assert int(out[1]) >= 24


# -- files that are no saved runs -------------------------------------------------------------------


def test_missing_and_foreign_files(tmp_path):
    (tmp_path / "text.vtkhdf").write_text("hello")
    (tmp_path / "empty.vtkhdf").write_bytes(b"")
    (tmp_path / "folder").mkdir()
    with h5py.File(tmp_path / "other.vtkhdf", "w") as file:
        file.create_group("VTKHDF")
    for name, message in (
        ("none.vtkhdf", "does not exist"),
        ("folder", "is a folder"),
        ("text.vtkhdf", r"is no HDF5 file, expected a file that Result\.save, Branch\.save, Locus\.save, Fit\.save or"),
        ("empty.vtkhdf", "is no HDF5 file"),
        ("other.vtkhdf", r"is an HDF5 file of another program, expected a file that Result\.save, Branch\.save"),
    ):
        with pytest.raises(vf.StorageError, match=message):
            vf.load(tmp_path / name)
    with pytest.raises(vf.ArgumentError, match="expected the name of a file"):
        vf.load(3)


@pytest.mark.parametrize("read", [vf.load, vf.resume, vf.load_scene])
def test_a_path_that_the_system_refuses_is_a_typed_error(read, tmp_path):
    """A folder may be closed, or a name too long; every user may enter a folder that the superuser has made."""
    folder = tmp_path / "closed"
    folder.mkdir(mode=0)
    closed = not os.access(folder, os.X_OK)
    place, message = (folder / "run.h5", "Permission denied") if closed else (tmp_path / (300 * "x"), "too long")
    with pytest.raises(vf.VofemError, match=message):
        read(place)


def test_files_of_other_kinds_are_named_with_the_function_that_reads_them(tmp_path):
    mass = vf.Mass(1.0, 1.0, name="mass")
    scene = vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(1.0, 0.5))])
    checkpoint, run, branch, store = (tmp_path / name for name in ("a.checkpoint", "r.h5", "b.h5", "s.h5"))
    vf.simulate(scene, 1.0, method="energy_conserving", dt=0.1, checkpoint=checkpoint, checkpoint_every=0.0).save(run)
    vf.continuation(lambda w: scene.replace(scene.effects[0], f=vf.Sine(1.0, w)), 0.5, 0.51).save(branch)
    vf.sweep(lambda x: {"y": x}, {"x": [1.0]}, executor="serial", store=store)
    with pytest.raises(vf.StorageError, match=r"is a checkpoint, from which vofem\.resume goes on; expected a run"):
        vf.load(checkpoint)
    for path, what in ((run, "a saved run"), (branch, "a branch of steady states"), (store, "the store of a sweep")):
        with pytest.raises(vf.StorageError, match=rf"is {what}, which vofem\.load reads; expected a checkpoint"):
            vf.resume(path)
    for path in (branch, store):
        with pytest.raises(vf.ArgumentError, match="leave out scene="):
            vf.load(path, scene=scene)


@pytest.mark.parametrize("number", [1, 99])
def test_another_format_is_refused_by_its_number(old, number):
    path, _ = old
    with h5py.File(path, "r+") as file:
        file["vofem"].attrs["format"] = number
        file["vofem"].attrs["written_by"] = "7.0"
    with pytest.raises(vf.StorageError, match=rf"written by vofem 7.0 in format {number}, but this is .* wrote it"):
        vf.load(path)


def test_a_file_that_is_cut_off(old):
    path, before = old
    for share in (0.001, 0.01, 0.3, 0.9, 0.999):
        path.write_bytes(before[: int(share * len(before))])
        with pytest.raises(vf.StorageError, match=r"is cut off|is no HDF5 file|is damaged"):
            vf.load(path)


def flipped(path, before, count):
    """Write a file `count` times, with one byte changed each time; its first and last ones are among them."""
    places = np.random.default_rng(3).integers(0, len(before), count)
    for place in [0, 8, 36, len(before) - 16, len(before) - 5, len(before) - 1, *places.tolist()]:
        path.write_bytes(before[:place] + bytes([before[place] ^ 0x5A]) + before[place + 1 :])
        yield


def test_flipped_bytes_are_found(old):
    """No byte can change without being noticed, and HDF5, which a damaged file may crash, does not see the file."""
    path, before = old
    for _ in flipped(path, before, 40):
        with pytest.raises(vf.StorageError, match=r"run.vtkhdf is damaged: its checksum .* undamaged copy"):
            vf.load(path)
    # A checkpoint carries a checksum too.
    ball = vf.Mass(1.0, stiffness=1.0, name="ball")
    path = path.with_suffix(".checkpoint")
    vf.simulate(vf.Scene([ball], initial={ball: (0.0, 1.0)}), 1.0, checkpoint=path, checkpoint_every=0.0)
    for _ in flipped(path, path.read_bytes(), 10):
        with pytest.raises(vf.StorageError, match=r"run.checkpoint is damaged: its checksum .* undamaged copy"):
            vf.resume(path)


def test_a_file_that_another_program_has_changed_is_read(results, old):
    """HDF5 removes the checksum of vofem from a file that it changes."""
    path, before = old
    with h5py.File(path, "r+") as file:
        file.attrs["remark"] = "a title"
    assert b"vofem crc32:" in before[-16:]
    assert b"vofem crc32:" not in path.read_bytes()
    for content in (path.read_bytes(), before[:-16]):
        path.write_bytes(content)
        assert np.array_equal(vf.load(path).samples.q, results[0].samples.q)


def test_missing_parts_are_named(old):
    path, before = old
    for part in ("history", "vofem/run", "history/q", "vofem/segments/status", "vofem/run/solution.space.shapes"):
        path.write_bytes(before)
        with h5py.File(path, "r+") as file:
            del file[part]
        with pytest.raises(
            vf.StorageError, match=r"run.vtkhdf is damaged \((KeyError|TypeError: .* missing 1 required|AttributeError)"
        ):
            vf.load(path)


def test_two_runs_with_one_checkpoint(tmp_path):
    """The second one to write stops, and leaves the file of the first as it is."""
    ball = vf.Mass(1.0, stiffness=1.0, name="ball")
    scene = vf.Scene([ball], [vf.Dashpot(ball, damping=0.1)], initial={ball: (0.0, 1.0)})
    path = tmp_path / "run.checkpoint"
    begun = []

    def another_run_begins(t, t_end):
        if not begun:
            begun.append(t)
            (tmp_path / "copy").write_bytes(path.read_bytes() if path.exists() else b"of another run")
            os.replace(tmp_path / "copy", path)

    arguments = {"method": "energy_conserving", "dt": 1e-5, "times": [1.0]}
    with pytest.raises(vf.OutputError, match="written by another run meanwhile and was left as it is"):
        vf.simulate(scene, 1.0, checkpoint=path, checkpoint_every=0.0, progress=another_run_begins, **arguments)
    assert path.exists()


def test_pictures_for_which_there_is_no_room(tmp_path):
    """In a process of its own, whose files may take a kilobyte."""
    program = """
import resource, signal, sys
sys.dont_write_bytecode = True
import vofem as vf
from vofem.io.plot import time_history
from vofem.io.render import render
ball = vf.Mass(1.0, stiffness=1.0, name="ball")
result = vf.simulate(vf.Scene([ball], initial={ball: (0.0, 1.0)}), 1.0)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, resource.RLIM_INFINITY))
for ending in ("png", "pdf", "svg"):
    history, shape = f"a.{ending}", f"b.{ending}"
    draws = {history: lambda: time_history(result, ball, history), shape: lambda: render(result, 1.0, shape)}
    for name, draw in draws.items():
        try:
            draw()
        except vf.OutputError as error:
            print(name, error)
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    told = [line for line in done.stdout.splitlines() if "cannot be written: File too large; make room in" in line]
    assert [line.split()[0] for line in told] == [f"{name}.{end}" for end in ("png", "pdf", "svg") for name in "ab"]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a\0b", "a\ud800b"])
def test_names_that_no_file_can_have(name, results, tmp_path):
    result = results[0]
    folder, (ball,) = str(tmp_path), result.scene.bodies
    for write in (
        lambda path: result.save(path + ".vtkhdf"),
        lambda path: vf.simulate(result.scene, 1.0, checkpoint=path + ".checkpoint"),
        lambda path: vf.dump_scene(result.scene, path + ".toml"),
        lambda path: write_csv(result, [ball], path + ".csv"),
        lambda path: write_series(result, path + ".pvd"),
    ):
        with pytest.raises(vf.ArgumentError, match="which holds"):
            write(f"{folder}/{name}")
    for read in (vf.load, vf.resume, vf.load_scene, lambda path: vf.Beam.from_mesh(path, 1.0, 1.0)):
        with pytest.raises(vf.ArgumentError, match="which holds"):
            read(f"{folder}/{name}.h5")
    assert not list(tmp_path.iterdir())


def test_a_link_is_followed(results, tmp_path):
    """What it points to is replaced, also where that is not there yet, and the link stays."""
    (tmp_path / "other").mkdir()
    for name in ("run", "new"):
        link, file = tmp_path / f"{name}.vtkhdf", tmp_path / "other" / f"{name}.vtkhdf"
        link.symlink_to(file)
        if name == "run":
            results[0].save(file)
        with pytest.raises(vf.OutputError, match="exists already"):
            results[1].save(link)
        results[1].save(link, overwrite=True)
        assert link.is_symlink()
        assert vf.load(file).times[-1] == vf.load(link).times[-1] == 2.0
    assert sorted(path.name for path in (tmp_path / "other").iterdir()) == ["new.vtkhdf", "run.vtkhdf"]


def test_what_is_no_regular_file_is_refused(results, tmp_path):
    pipe, device, loop = (tmp_path / f"{name}.vtkhdf" for name in ("pipe", "device", "loop"))
    os.mkfifo(pipe)
    device.symlink_to(os.devnull)
    loop.symlink_to(loop)
    for path, reason in ((pipe, "no regular file"), (device, "no regular file"), (loop, "leads back to itself")):
        with pytest.raises(vf.OutputError, match=reason):
            results[0].save(path, overwrite=True)
    with pytest.raises(vf.OutputError, match="the folder of devices"):
        results[0].save("/dev/run.vtkhdf")
    with pytest.raises(vf.StorageError, match="is no regular file"):
        vf.load(pipe)
    with pytest.raises(vf.SceneFileError, match="this is a device"):
        vf.load_scene("/dev/zero")
