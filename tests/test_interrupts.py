"""Ctrl-C: the first press ends a step and keeps what was computed, the second one ends a command; files are whole."""

import ctypes
import gc
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from scenes import FREE, SHORT

import vofem as vf
from vofem import cli
from vofem.integrators.observer import deferred_interrupts
from vofem.kernels.jit import compiling
from vofem.kernels.mode import Outgrown, check_patience, kernels

ROOT = Path(__file__).parent.parent

#: Programs that are started in the background, as these tests may be, ignore Ctrl-C.
HEARS = "import signal, sys\nsignal.signal(signal.SIGINT, signal.default_int_handler)\nfrom vofem import cli\n"

COMMAND = HEARS + "sys.exit(cli.main(sys.argv[1:]))"

#: The same, with Ctrl-C after a second of the run's own work, however busy the machine is.
PRESSED = (
    HEARS
    + """
def said(text, write=sys.stdout.write):
    if "as the scene file says" in text:
        signal.setitimer(signal.ITIMER_VIRTUAL, 1.0)
    return write(text)

sys.stdout.write = said
signal.signal(signal.SIGVTALRM, lambda *_: signal.raise_signal(signal.SIGINT))
sys.exit(cli.main(sys.argv[1:]))"""
)

#: What a run has that takes hours, in place of the end of a short one.
LONG = "t_end = 1e6\ntimes = { start = 0.0, stop = 1e6, count = 1000001 }"


def press():
    os.kill(os.getpid(), signal.SIGINT)


@pytest.fixture
def foreground():
    """Let this process hear Ctrl-C, which it ignores where the tests were started in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def started(folder, program, *arguments):
    """Start a program in a folder, with kernels in plain Python."""
    return subprocess.Popen(
        [sys.executable, "-c", program, *arguments], cwd=folder, text=True, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, env={**os.environ, "VOFEM_COMPILED": "0", "PYTHONPATH": str(ROOT)},
    )  # fmt: skip


# -- commands, in processes of their own ----------------------------------------------------------


def test_an_interrupted_run_writes_what_was_computed(tmp_path):
    """Ctrl-C once: exit code 130, tables and histories, no energies, no pictures."""
    (tmp_path / "long.toml").write_text(
        SHORT.replace("t_end = 6.0", LONG + '\nmethod = "energy_conserving"\ndt = 1e-3')
    )
    process = started(tmp_path, PRESSED, "run", "long.toml")
    said, errors = process.communicate(timeout=120.0)
    assert process.returncode == 130, errors
    assert "interrupted: speeds and forces of impacts, energies and pictures are left out" in said
    assert "      closes [s]        opens [s]     lasts [s]\n" in said
    assert "note: interrupted at t = " in said
    assert "Contact 'stop'" in said
    (written,) = (tmp_path / "output" / "long").iterdir()
    times = np.loadtxt(written, delimiter=",", skiprows=1)[:, 0]
    assert times.size > 2
    np.testing.assert_array_equal(times, np.arange(times.size))


@pytest.mark.parametrize("presses", [1, 2])
def test_a_file_is_whole_or_absent(tmp_path, presses):
    """The first press waits for the file that is being written, the second one ends the process."""
    (tmp_path / "free.toml").write_text(FREE.replace("t_end = 6.0", LONG.replace("1000001", "300001")))
    folder = tmp_path / "output" / "free"
    process = started(tmp_path, COMMAND, "run", "free.toml")
    for _ in range(presses):
        while not list(folder.glob(".vofem-*")):
            assert process.poll() is None, process.communicate()
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        time.sleep(0.1)
    _, errors = process.communicate(timeout=60.0)
    assert process.returncode == 130
    if presses == 1:
        (file,) = folder.iterdir()
        assert (errors, file.name) == ("", "histories.csv")
        assert file.read_text().splitlines()[-1].startswith("1000000.0,")
    else:
        assert errors == "vofem: interrupted\n"
        assert list(folder.iterdir()) == []


def test_ctrl_c_in_a_text_that_is_run_ends_a_command_with_its_code(tmp_path):
    """As in imports of scipy, which run texts; Python would end the process by the signal."""
    program = HEARS + "cli.run_command = lambda argv: exec('raise KeyboardInterrupt')\nsys.exit(cli.script())"
    process = started(tmp_path, program)
    _, errors = process.communicate(timeout=60.0)
    assert (process.returncode, errors) == (130, "vofem: interrupted\n")


# -- commands, in this process --------------------------------------------------------------------


def test_an_interrupt_that_became_another_error_is_still_an_interrupt(foreground, monkeypatch, capsys):
    def drawing(argv):
        try:
            press()
            time.sleep(30.0)
        except KeyboardInterrupt:
            raise ValueError("Invalid affine transformation matrix") from None

    monkeypatch.setattr(cli, "run_command", drawing)
    assert cli.main([]) == 130
    assert capsys.readouterr().err == "vofem: interrupted\n"
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def responded(folder, stop):
    """Follow a branch by the command; return the exit code and the names of the files."""
    scene = str(ROOT / "examples" / "two_masses_response.toml")
    code = cli.main(
        ["respond", scene, "--from", "0.5", "--to", stop, "--method", "harmonic_balance", "--output", str(folder)]
    )
    return code, {path.name for path in folder.iterdir()}


def test_an_interrupted_branch_is_written_without_pictures(foreground, monkeypatch, tmp_path):
    def pressed(*arguments, progress, **options):
        return continuation(*arguments, progress=lambda *_: press(), **options)

    continuation = vf.continuation
    monkeypatch.setattr("vofem.studies.steady.continuation", pressed)
    assert responded(tmp_path, "2.0") == (130, {"branch.h5", "branch.csv"})
    branch = vf.load(tmp_path / "branch.h5")
    assert branch.interrupted
    assert branch.values[-1] < 2.0


def test_a_picture_that_is_being_drawn_is_the_last_file(foreground, monkeypatch, tmp_path, capsys):
    def drawing(branch, point, path, **options):
        press()
        path.write_text("a picture")
        return path

    monkeypatch.setattr("vofem.io.plot.response_curve", drawing)
    assert responded(tmp_path, "0.52") == (130, {"branch.h5", "branch.csv", "response.png"})
    assert not vf.load(tmp_path / "branch.h5").interrupted
    said = capsys.readouterr()
    assert "interrupted: what is not listed here is left out\n" in said.out
    assert said.out.endswith("response.png\n")
    assert said.err == ""


# -- the library ----------------------------------------------------------------------------------


def test_a_loop_hears_of_ctrl_c_in_the_loops_within_it(foreground):
    with deferred_interrupts() as outer:
        with deferred_interrupts() as inner:
            press()
            assert outer()
            assert inner()
        # The second press is the second one, although the loop within is another.
        with deferred_interrupts(), pytest.raises(KeyboardInterrupt):
            press()


def test_ctrl_c_at_the_end_of_a_branch_is_noted(foreground):
    body = vf.Mass(1.0, stiffness=1.0, damping=0.1)

    def build(omega):
        return vf.Scene([body], [vf.PointLoad(body, vf.Sine(0.1, omega))])

    values = []

    def progress(value, stop):
        values.append(value)
        if value >= stop:
            press()

    branch = vf.continuation(build, 0.5, 0.6, method="harmonic_balance", harmonics=1, progress=progress)
    assert values[-1] == pytest.approx(0.6)
    assert branch.interrupted
    assert "interrupted at 0.6, the end of the branch" in branch.notes
    assert not vf.continuation(build, 0.5, 0.6, method="harmonic_balance", harmonics=1).interrupted


@pytest.mark.parametrize("method", ["shooting", "harmonic_balance"])
def test_a_branch_is_interrupted_within_a_step(foreground, method):
    """A step may need hundreds of scenes; none is built once Ctrl-C was pressed."""
    body, built = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="m"), []
    stop = vf.Contact(body, gap=0.1, stiffness=5.0, side="above", acts_on="penetration", name="stop")

    def build(omega):
        built.append(omega)
        if len(built) == 40:
            press()
        return vf.Scene([body], [stop, vf.PointLoad(body, vf.Sine(0.1, omega))])

    branch = vf.continuation(build, 0.5, 1.5, method=method)
    assert len(built) <= 42
    assert branch.interrupted
    assert branch.notes[-1].startswith("interrupted at ")
    assert len(branch) > 1


def test_ctrl_c_is_not_forgotten_where_a_run_would_begin_anew_with_compiled_code(foreground):
    """The step in which Ctrl-C is pressed exceeds the time after which a run in plain Python begins anew."""
    with kernels(compiled=False, patience=-1.0), deferred_interrupts() as pressed:
        with pytest.raises(Outgrown):
            check_patience()
        press()
        check_patience()
        assert pressed()


def test_ctrl_c_is_not_dropped_where_the_compiler_calls_python(foreground):
    """LLVM hands over what it has compiled to a callback in Python, which hears of Ctrl-C and cannot raise."""
    callback = ctypes.CFUNCTYPE(None)(press)
    with pytest.raises(KeyboardInterrupt), compiling():
        callback()
    assert gc.isenabled()
