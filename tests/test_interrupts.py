"""Ctrl-C at moments other than a run's: while commands are imported, kernels compiled, files written and drawn."""

import io
import os
import signal
import subprocess
import sys
import threading
import time
import types
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import vofem as vf
from vofem import cli
from vofem.cli import working
from vofem.integrators.event_driven import spectrum
from vofem.integrators.event_driven.run import run
from vofem.integrators.event_driven.solution import EventSolution
from vofem.integrators.observer import deferred_interrupts
from vofem.io import branch_tables, csv_file
from vofem.kernels import jit
from vofem.kernels.mode import decided, kernels
from vofem.linalg import aside

#: The module, whose name in the package is that of its function.
RUN = import_module("vofem.integrators.event_driven.run")

ROOT = Path(__file__).parent.parent


def press():
    os.kill(os.getpid(), signal.SIGINT)


def test_a_command_that_is_interrupted_while_it_is_imported_says_so(monkeypatch, capsys):
    def interrupted(argv):
        raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "vofem.cli.program", types.SimpleNamespace(main=interrupted))
    monkeypatch.setattr(cli, "program", sys.modules["vofem.cli.program"], raising=False)
    assert cli.main(["run"]) == 130
    assert capsys.readouterr().err == "vofem: interrupted\n"


def test_a_step_ends_before_an_interrupt_but_compiling_does_not(monkeypatch):
    before = signal.getsignal(signal.SIGINT)
    with deferred_interrupts() as pressed:
        press()
        assert pressed()
    monkeypatch.setattr(jit, "_under_way", ["a kernel"])
    with pytest.raises(KeyboardInterrupt), deferred_interrupts():
        press()
    assert signal.getsignal(signal.SIGINT) is before
    assert jit.waiting_interrupts == []


def test_a_run_that_has_computed_something_is_not_given_up_for_the_compiler(monkeypatch):
    with deferred_interrupts() as pressed:
        assert not pressed()
        monkeypatch.setattr(jit, "_under_way", ["a kernel"])
        press()
        assert not jit.compiling()
        assert pressed()
    assert jit.compiling()
    assert jit.runs_with_results == []


def test_nothing_is_compiled_after_ctrl_c():
    names = {"__name__": "nowhere"}
    # A function without a file, whose code is not kept on disk.
    exec("def twice(x):\n    return 2.0 * x", names)
    kernel = jit.CompiledFunction(names["twice"])
    with kernels(compiled=True):
        with deferred_interrupts():
            press()
            with pytest.raises(KeyboardInterrupt):
                kernel(1.5)
        assert not jit.compiling()
        assert kernel(1.5) == 3.0
    assert not jit.compiling()


def pressed_at_work(program):
    """Run a program, press Ctrl-C once it is at work, and return its exit code and what it said."""
    process = subprocess.Popen(
        [sys.executable, "-c", program], cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout.readline() == "at work\n"
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30.0)
    return process.returncode, said


@pytest.mark.parametrize(
    ("begin", "where"),
    [
        ("jit._under_way.append('a kernel')", "while compiling"),
        ("jit.waiting_interrupts.append(bool)", "before the first result"),
    ],
)
def test_work_that_does_not_come_back_ends_with_the_process(begin, where):
    """Minutes of work in C, between which Python calls no handler, stand for the compiler or an eigenproblem."""
    program = (
        "import hashlib, signal\nfrom vofem.cli.prompt_end import prompt_end\nfrom vofem.kernels import jit\n"
        # Programs that are started in the background, as these tests may be, ignore Ctrl-C.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"{begin}\n"
        "with prompt_end():\n    print('at work', flush=True)\n    hashlib.pbkdf2_hmac('sha256', b'', b'', 10**9)"
    )
    code, said = pressed_at_work(program)
    assert code == 130
    assert said == f"vofem: interrupted {where}\n"


@pytest.mark.parametrize("first", [True, False])
def test_kernels_for_histories_are_compiled_in_runs_that_last(monkeypatch, first):
    early, modal = [], EventSolution.modal

    def noted(solution, times):
        early.append(not jit.runs_with_results)
        return modal(solution, times)

    monkeypatch.setattr(EventSolution, "modal", noted)
    scene = struck()
    for most, expected in ((100.0, []), (-1.0, [True] * first)):
        # A run that ends sooner than this many seconds does without them.
        monkeypatch.setattr(RUN, "_SHORT", most)
        with kernels(compiled=False, first=first):
            run(scene.model.system, scene.initial_state(), 2.0, np.linspace(0.0, 2.0, 5))
        assert early == expected


def test_ctrl_c_while_kernels_for_histories_are_compiled_keeps_results(monkeypatch):
    def pressed(solution, times):
        assert not jit.runs_with_results
        signal.raise_signal(signal.SIGINT)
        raise KeyboardInterrupt

    monkeypatch.setattr(EventSolution, "modal", pressed)
    monkeypatch.setattr(RUN, "_SHORT", -1.0)
    scene = struck()
    with kernels(compiled=False, first=True):
        solution = run(scene.model.system, scene.initial_state(), 2.0, np.linspace(0.0, 2.0, 5))
    assert solution.was_cut
    assert 0.0 < solution.t_end < 2.0


def struck():
    """Return a scene of a mass that hits a stop with a damper, so that the closed status needs an eigenproblem."""
    mass = vf.Mass(1.0, stiffness=1.0)
    stop = vf.Contact(mass, gap=0.5, stiffness=9.0, damping=0.1, side="above", acts_on="penetration", name="stop")
    return vf.Scene([mass], [stop], initial={mass: (0.0, 1.0)})


def test_work_aside_returns_raises_and_sees_what_it_would_in_its_place():
    here = threading.get_ident()
    with kernels(compiled=False):
        assert aside.aside(lambda: (decided(), threading.get_ident() == here), aside.LARGE) == (False, False)
        assert aside.aside(threading.get_ident, aside.LARGE - 1) == here
    with pytest.raises(ZeroDivisionError):
        aside.aside(lambda: 1 // 0, aside.LARGE)
    assert not aside.waiting()
    assert not aside.left_behind()


def test_modes_have_the_same_bits_beside_the_main_thread(monkeypatch):
    beam = vf.Beam(1.0, 1.0, 1.0, 8, {"left": "clamped"})
    before = vf.modes(vf.Scene([beam])).shape(3, [0.3, 1.0])
    monkeypatch.setattr(aside, "LARGE", 0)
    monkeypatch.setattr(threading.Thread, "start", counted := Counted(threading.Thread.start))
    np.testing.assert_array_equal(vf.modes(vf.Scene([beam])).shape(3, [0.3, 1.0]), before)
    assert counted.calls > 0


class Counted:
    """A method that counts its calls."""

    def __init__(self, method):
        self.method, self.calls = method, 0

    def __get__(self, owner, kind):
        self.calls += 1
        return self.method.__get__(owner, kind)


@pytest.mark.parametrize("keeps", [True, False])
def test_a_large_eigenproblem_is_given_up_where_nothing_is_lost(keeps):
    released = threading.Event()

    def work():
        press()
        return released.wait(0.5)

    try:
        # Before there are results.
        with pytest.raises(KeyboardInterrupt), deferred_interrupts():
            aside.aside(lambda: press() or released.wait(30.0), aside.LARGE)
        assert aside.left_behind()
        with deferred_interrupts(keeps) as pressed:
            assert not pressed()
            if keeps:
                with pytest.raises(KeyboardInterrupt):
                    aside.aside(work, aside.LARGE)
                # The next one is not even begun.
                with pytest.raises(KeyboardInterrupt):
                    aside.aside(lambda: pytest.fail("begun"), aside.LARGE)
            else:
                assert aside.aside(work, aside.LARGE) is False
            assert pressed()
    finally:
        released.set()
    while aside.left_behind():
        time.sleep(0.001)
    assert aside.giving_up == []


def test_a_run_keeps_what_it_has_when_a_new_eigenproblem_is_given_up(monkeypatch):
    whole = vf.simulate(struck(), 2.0, times=np.linspace(0.0, 2.0, 41), method="event_driven")
    hit = whole.contacts["stop"].closings[0]
    released, blocks = threading.Event(), spectrum.damped_blocks

    def endless(*arguments):
        press()
        released.wait(30.0)
        return blocks(*arguments)

    monkeypatch.setattr(aside, "LARGE", 0)
    monkeypatch.setattr(spectrum, "damped_blocks", endless)
    try:
        part = vf.simulate(struck(), 2.0, times=np.linspace(0.0, 2.0, 41), method="event_driven")
    finally:
        released.set()
    assert part.interrupted
    assert part.solution.t_end == hit
    kept = part.times.size
    assert part.times[-1] <= hit < whole.times[kept]
    np.testing.assert_array_equal(part.samples.q, whole.samples.q[:, :kept])
    assert part.counters.eigensolves == whole.counters.eigensolves - 1


def test_the_command_does_not_wait_for_what_ctrl_c_has_left_behind():
    program = (
        "import hashlib, signal, sys, types\nfrom vofem import cli\nfrom vofem.linalg.aside import aside\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def main(argv):\n    print('at work', flush=True)\n"
        "    aside(lambda: hashlib.pbkdf2_hmac('sha256', b'', b'', 10**9), 10**4)\n"
        "sys.modules['vofem.cli.program'] = cli.program = types.SimpleNamespace(main=main)\n"
        "sys.exit(cli.main([]))"
    )
    code, said = pressed_at_work(program)
    assert code == 130
    assert said == "vofem: interrupted\n"


@pytest.mark.parametrize(("method", "step"), [("event_driven", {}), ("energy_conserving", {"dt": 2.5e-3})])
@pytest.mark.parametrize(("seconds", "expected"), [(100.0, 1), (1.0, 8), (0.1, 64)])
def test_histories_of_an_interrupted_run_take_no_longer_than_they_may(
    monkeypatch, tmp_path, method, step, seconds, expected
):
    scene = struck()
    result = vf.simulate(scene, 10.0, times=np.linspace(0.0, 10.0, 4001), method=method, **step)
    clock, write = [0.0], csv_file.write_columns

    def slow(columns, goal):
        # A millisecond for each row.
        clock[0] += 1e-3 * len(columns["t [s]"])
        return write(columns, goal)

    monkeypatch.setattr(csv_file, "write_columns", slow)
    monkeypatch.setattr(csv_file, "time", types.SimpleNamespace(monotonic=lambda: clock[0]))
    path = tmp_path / "histories.csv"
    assert csv_file.write_csv_within(seconds, result, scene.bodies, path) == expected
    assert clock[0] <= seconds
    found = np.loadtxt(path, delimiter=",", skiprows=1)
    csv_file.write_csv(result, scene.bodies, path)
    every = np.loadtxt(path, delimiter=",", skiprows=1)
    np.testing.assert_allclose(found, every[::expected], rtol=0.0, atol=1e-14)
    if expected == 1:
        np.testing.assert_array_equal(found, every)


def test_an_interrupted_branch_is_written_without_pictures(monkeypatch, tmp_path, capsys):
    def pressed(*arguments, progress, **options):
        return continuation(*arguments, progress=lambda *_: press(), **options)

    continuation = vf.continuation
    monkeypatch.setattr("vofem.studies.steady.continuation", pressed)
    scene = str(ROOT / "examples" / "two_masses_response.toml")
    arguments = ["--from", "0.5", "--to", "2.0", "--method", "harmonic_balance", "--output", str(tmp_path)]
    assert cli.main(["respond", scene, *arguments]) == 130
    assert {path.name for path in tmp_path.iterdir()} == {"branch.h5", "branch.csv"}
    assert "interrupted: pictures are left out" in capsys.readouterr().out


@pytest.fixture
def foreground():
    """Let this process hear Ctrl-C, which it ignores where the tests were started in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_a_picture_that_is_being_drawn_is_left_out(foreground, monkeypatch, tmp_path, capsys):
    released, threads, ended = threading.Event(), [], []

    def drawing(*arguments, **options):
        threads.append(threading.current_thread())
        press()
        return released.wait(30.0)

    monkeypatch.setattr("vofem.io.plot.response_curve", drawing)
    monkeypatch.setattr(cli, "end_now", ended.append)
    scene = str(ROOT / "examples" / "two_masses_response.toml")
    arguments = ["--from", "0.5", "--to", "0.52", "--method", "harmonic_balance", "--output", str(tmp_path)]
    try:
        assert cli.main(["respond", scene, *arguments]) == 130
        # The process does not wait for the thread.
        assert ended == [130]
    finally:
        released.set()
    assert threads != [threading.main_thread()]
    for thread in threads:
        thread.join()
    assert {path.name for path in tmp_path.iterdir()} == {"branch.h5", "branch.csv"}
    said = capsys.readouterr()
    assert "interrupted: what is not listed here is left out\n" in said.out
    assert said.out.endswith("branch.csv\n")
    assert said.err == ""
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("kind", [ValueError, vf.VofemError])
def test_an_interrupt_that_became_another_error_is_still_an_interrupt(foreground, monkeypatch, capsys, kind):
    def command(arguments):
        try:
            press()
            time.sleep(30.0)
        except KeyboardInterrupt:
            raise kind("Invalid affine transformation matrix") from None

    parser = types.SimpleNamespace(parse_args=lambda argv: types.SimpleNamespace(command=command))
    monkeypatch.setattr("vofem.cli.program._parser", lambda: parser)
    assert cli.main([]) == 130
    assert capsys.readouterr().err == "vofem: interrupted\n"


def test_a_second_ctrl_c_ends_the_process_and_leaves_no_part_of_a_file(tmp_path):
    program = (
        "import signal, sys, time, types\nfrom pathlib import Path\nfrom vofem import cli\n"
        "from vofem.files.whole import replacing\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def main(argv):\n"
        "    with replacing(Path(sys.argv[1])) as temporary:\n"
        "        temporary.write_text('half')\n"
        "        while True:\n"
        # The interrupt is lost, as it may be in code in C.
        "            try:\n                print('writing', flush=True)\n                time.sleep(30.0)\n"
        "            except KeyboardInterrupt:\n                pass\n"
        "sys.modules['vofem.cli.program'] = cli.program = types.SimpleNamespace(main=main)\n"
        "sys.exit(cli.script())"
    )
    goal = tmp_path / "histories.csv"
    goal.write_text("whole")
    process = subprocess.Popen(
        [sys.executable, "-c", program, str(goal)],
        cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    for _ in range(2):
        assert process.stdout.readline() == "writing\n"
        assert len(list(tmp_path.iterdir())) == 2
        process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30.0)
    assert process.returncode == 130
    assert said == "vofem: interrupted\n"
    assert [path.name for path in tmp_path.iterdir()] == [goal.name]
    assert goal.read_text() == "whole"


def test_a_run_in_another_thread_leaves_nothing_behind():
    scene = struck()
    with kernels(compiled=False), ThreadPoolExecutor(1) as pool:
        pool.submit(run, scene.model.system, scene.initial_state(), 0.5, np.linspace(0.0, 0.5, 3)).result()
    assert not jit.runs_with_results


def test_ctrl_c_at_the_end_of_a_branch_is_noted():
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
    assert "interrupted at 0.6, the end of the branch" in branch.notes


@pytest.mark.parametrize(("seconds", "expected"), [(-1.0, 0), (4.0, 4), (float("inf"), None)])
def test_displacements_of_an_interrupted_branch_take_no_longer_than_they_may(monkeypatch, tmp_path, seconds, expected):
    body = vf.Mass(1.0, stiffness=1.0, damping=0.1)

    def build(omega):
        return vf.Scene([body], [vf.PointLoad(body, vf.Sine(0.1, omega))])

    with kernels(compiled=False):
        branch = vf.continuation(build, 0.5, 0.6, method="harmonic_balance", harmonics=1)
        whole = branch_tables.write_branch(branch, body, tmp_path / "whole.csv")
        # A second passes between two looks at the clock.
        clock = iter(range(10**6))
        monkeypatch.setattr(branch_tables, "time", types.SimpleNamespace(monotonic=lambda: float(next(clock))))
        part = tmp_path / "part.csv"
        missing = branch_tables.write_branch_within(seconds, branch, body, part)
    found, every = (np.genfromtxt(path, delimiter=",", skip_header=1) for path in (part, whole))
    known = np.flatnonzero(~np.isnan(found[:, 2]))
    assert known.size == (len(branch) if expected is None else expected) == len(branch) - missing
    np.testing.assert_array_equal(found[known], every[known])
    np.testing.assert_array_equal(found[:, :2], every[:, :2])
    # The orbits are evenly spread: the stride is a power of two.
    if expected:
        assert set(np.diff(known)) == {known[1]}


def test_a_line_says_what_still_runs(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    terminal = Terminal()
    monkeypatch.setattr(working, "_PATIENCE", 0.0)
    monkeypatch.setattr(sys, "stderr", terminal)
    with working.working("writing"):
        while "writing: 0." not in terminal.getvalue():
            time.sleep(0.01)
    assert terminal.getvalue().endswith("\r\x1b[K")
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with working.working("writing"):
        pass
    assert sys.stderr.getvalue() == ""
