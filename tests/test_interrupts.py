"""Ctrl-C at moments other than a run's: while commands are imported, and while kernels are compiled."""

import io
import os
import signal
import subprocess
import sys
import time
import types
from pathlib import Path

import pytest

import vofem as vf
from vofem import cli
from vofem.cli import working
from vofem.integrators.observer import deferred_interrupts
from vofem.kernels import jit
from vofem.kernels.mode import kernels

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
    process = subprocess.Popen(
        [sys.executable, "-c", program], cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout.readline() == "at work\n"
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30.0)
    assert process.returncode == 130
    assert said == f"vofem: interrupted {where}\n"


@pytest.mark.parametrize("first", [True, False])
def test_kernels_for_evaluations_are_not_compiled_after_ctrl_c(first):
    mass = vf.Mass(1.0, stiffness=1.0)
    result = vf.simulate(vf.Scene([mass], initial={mass: (1.0, 0.0)}), 2.0, method="event_driven", compiled=False)
    result.solution.compiled = True
    with kernels(compiled=True, first=first):
        result.solution.cut(1.0)
    assert result.solution.compiled is not first


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
