"""A process that is forked while other threads run vofem computes as well, and does not wait for their locks."""

import os
import signal
import threading
import time

import pytest
from numba.core import event
from scenes import on_stop

import vofem as vf
from vofem.kernels.jit import imported_numba
from vofem.locks import Lock

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")


def histories():
    mass, scene = on_stop(vf.Mass(1.0, stiffness=1.0), gap=0.5, stiffness=30.0, load=vf.Sine(1.0, 0.8))
    result = vf.simulate(scene, 5.0, compiled=False)
    return result.displacement(mass)[-1], result.contacts["stop"].force[-1]


def in_child(work, seconds=30.0):
    """Return the exit code of a forked process that works; the number of a signal, negative, where it hangs."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            code = work()
        finally:
            os._exit(code)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        found, status = os.waitpid(child, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return -signal.SIGKILL


def test_children_of_a_process_with_threads_compute():
    expected = histories()
    over = threading.Event()

    def repeat():
        while not over.is_set():
            histories()

    threads = [threading.Thread(target=repeat) for _ in range(2)]
    for thread in threads:
        thread.start()
    try:
        codes = [in_child(lambda: int(histories() != expected)) for _ in range(8)]
    finally:
        over.set()
        for thread in threads:
            thread.join()
    assert codes == [0] * 8


def test_locks_that_another_thread_holds_are_open_in_a_child():
    lock, held, over = Lock(), threading.Event(), threading.Event()

    def hold():
        with lock:
            held.set()
            over.wait(60.0)

    def enter():
        with lock, lock:
            return 0

    thread = threading.Thread(target=hold)
    thread.start()
    held.wait()
    try:
        assert in_child(enter, 5.0) == 0
    finally:
        over.set()
        thread.join()


def test_a_fork_waits_for_an_import_of_another_thread(tmp_path, monkeypatch):
    """In the child nobody would end the import, and the next one of the same module would wait for good."""
    (tmp_path / "slow_to_import.py").write_text("import time\ntime.sleep(0.5)\nvalue = 0\n")
    monkeypatch.syspath_prepend(tmp_path)

    def begin():
        import slow_to_import  # noqa: F401

    def enter():
        from slow_to_import import value

        return value

    thread = threading.Thread(target=begin)
    thread.start()
    time.sleep(0.1)
    assert in_child(enter, 10.0) == 0
    thread.join()


def test_a_fork_waits_for_a_compilation_of_another_thread():
    """In the child nobody would open the lock of numba, and the next compilation would wait for good."""
    numba, begun, done = imported_numba(), threading.Event(), []

    class Slow(event.Listener):
        def on_start(self, event):
            begun.set()
            time.sleep(0.5)

        def on_end(self, event):
            done.append("compiled")

    def compile_one():
        return numba.njit(lambda x: x + 1)(0)

    def in_a_thread():
        with event.install_listener("numba:compile", Slow()):
            compile_one()

    thread = threading.Thread(target=in_a_thread)
    thread.start()
    begun.wait()
    assert in_child(lambda: int(done[:1] != ["compiled"] or compile_one() != 1), 10.0) == 0
    thread.join()
    assert compile_one() == 1  # the lock is open again in this process
