"""Compiled code on disk: what is known of it, who shares it, where it cannot be kept."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from orbit_scenes import bilinear
from scenes import paper_beam

import vofem as vf
from vofem.cli import FAULT, main
from vofem.integrators.methods import BUILT_IN
from vofem.io import doctor
from vofem.kernels import cache as jit_cache
from vofem.kernels.mode import kernels
from vofem.progress import RunProgress
from vofem.simulate import ahead
from vofem.simulate.plan import kind_of_run

ROOT = Path(__file__).parent.parent


def environment(tmp_path, **more):
    """Return the environment of a process with compiled code of its own, which finds this package and its tests."""
    paths = [str(ROOT), str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": os.pathsep.join(paths), **more}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder for compiled code of its own."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    jit_cache._key.cache_clear()
    yield tmp_path
    jit_cache._key.cache_clear()


def test_kinds_are_kept_and_belong_to_sources_versions_and_processor(folder, monkeypatch):
    assert jit_cache.kinds_on_disk() == frozenset()
    jit_cache.keep_kind("events")
    jit_cache.keep_kind("steps, laws")
    jit_cache.keep_kind("events")
    assert jit_cache.kinds_on_disk() == {"events", "steps, laws"}
    for name, other in (("_source_stamp", (0.0, 1)), ("_processor", "another"), ("_numba", "0.1")):
        with monkeypatch.context() as patch:
            patch.setattr(jit_cache, name, lambda other=other: other)
            jit_cache._key.cache_clear()
            assert jit_cache.kinds_on_disk() == frozenset()
            jit_cache.keep_kind("other")
        jit_cache._key.cache_clear()
        assert jit_cache.kinds_on_disk() == {"events", "steps, laws"}


def test_code_of_old_sources_goes(folder):
    old = [folder / f"vofem-{k}" for k in range(6)]
    for k, one in enumerate(old):
        (one / "linalg").mkdir(parents=True)
        os.utime(one, (k, k))
    (folder / "other").mkdir()
    jit_cache.keep_kind("events")
    assert {one.name for one in folder.glob("*/")} == {
        "other", *(one.name for one in old[3:]), jit_cache.code_folder().name,
    }  # fmt: skip


def test_a_package_that_cannot_be_written_uses_the_users_folder(tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    beside = Path(jit_cache.__file__).parent
    assert jit_cache.cache_folder() == beside / "__pycache__"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    monkeypatch.setattr(os, "access", lambda path, mode: not Path(path).is_relative_to(beside))
    assert jit_cache.cache_folder() == tmp_path / "caches" / "numba"
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert jit_cache.cache_folder() is None
    assert jit_cache.kinds_on_disk() == frozenset()
    jit_cache.keep_kind("events")
    assert "cannot be kept" in doctor.compiled_code()
    assert main(["compile"]) == FAULT


def test_a_folder_that_is_named_in_vain_is_told(tmp_path, monkeypatch):
    """numba takes the next one then, and so does the index."""
    file = tmp_path / "file"
    file.write_text("no folder")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(file / "caches"))
    beside = Path(jit_cache.__file__).parent / "__pycache__"
    assert jit_cache.cache_folder() == beside
    told = doctor.compiled_code()
    assert f"NUMBA_CACHE_DIR names {file / 'caches'}, which cannot be written\n" in told
    assert f"Compiled code is kept in {beside}" in told
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "new" / "caches"))
    assert jit_cache.cache_folder() == tmp_path / "new" / "caches"
    assert "cannot be written" not in doctor.compiled_code()


def test_doctor_tells_what_is_there(folder):
    assert "It is there for" not in doctor.compiled_code()
    jit_cache.keep_kind("event_driven")
    told = doctor.compiled_code()
    assert str(folder) in told
    assert f"It is there for 1 of {len(ahead.KINDS)} kinds of work:\n  event_driven\n" in told
    assert "`vofem compile`, or in the first run that is long enough:\n  event_driven, damped\n  steps, laws\n" in told
    assert max(map(len, told.splitlines())) < 120 + len(str(folder))


KERNEL = """
import sys, time
from pathlib import Path
from vofem.kernels.jit import jit

@jit
def double(x):
    total = x
    for _ in range(3):
        total = total + x
    return 0.5 * total

def meet(where, longest):
    Path(f"{sys.argv[1]}.{where}").touch()
    end = time.monotonic() + longest
    while time.monotonic() < end and len(list(Path().glob(f"*.{where}"))) < 3:
        time.sleep(0.001)

def opened(event, arguments):
    # Each process has read the index, and is about to write it with its own entry.
    if event == "open" and ".nbi.tmp" in str(arguments[0]):
        meet("writes", 0.7)

sys.addaudithook(opened)
meet("ready", 60.0)
for kind in sys.argv[1:]:
    argument = {"int": 3, "float": 2.5, "complex": 1j}[kind]
    assert double(argument) == 2.0 * argument, double(argument)
print(sum(double.dispatcher.stats.cache_hits.values()))
"""


def test_processes_that_compile_at_once_do_no_harm(tmp_path):
    """Each compiles for other arguments; none takes the code of another for its own, and nothing is lost."""
    script = tmp_path / "kernel.py"
    script.write_text(KERNEL)

    def begin(*kinds):
        return subprocess.Popen(
            [sys.executable, str(script), *kinds], env=environment(tmp_path), cwd=tmp_path, stdout=subprocess.PIPE,
            text=True,
        )  # fmt: skip

    kinds = ("int", "float", "complex")
    children = [begin(kind) for kind in kinds]
    found = [child.communicate()[0] for child in children]
    assert [child.returncode for child in children] == [0, 0, 0]
    assert found == ["0\n"] * 3
    assert begin(*kinds).communicate()[0] == "3\n"


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_the_bar_of_a_branch_says_that_it_compiles(monkeypatch):
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    with kernels(compiled=True):
        vf.continuation(bilinear, 1.0, 1.01)
        assert "once on this machine" not in screen.getvalue()
    with kernels(compiled=True, first=True):
        vf.continuation(bilinear, 1.0, 1.01)
    assert "compiling steady states, once on this machine" in screen.getvalue()


def test_the_bar_says_that_it_compiles(monkeypatch):
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    with RunProgress(10.0, None, None, 60.0, "compiling event_driven, once on this machine") as watcher:
        assert "once on this machine" in screen.getvalue()
        screen.truncate(0)
        watcher(5.0, dict)
        assert "once on this machine" not in screen.getvalue()
        assert "50 %" in screen.getvalue()


# Steps under a tolerance need a rough run of a thousand steps first, which takes half a minute in plain Python.
@pytest.mark.parametrize(("kind", "work"), [one for one in ahead._WORK if "many" not in one[0]])
def test_what_is_compiled_ahead_can_be_run(kind, work):
    """The scenes are sound; in plain Python, as compiling takes minutes."""
    with kernels(compiled=False):
        work()


def test_all_kinds_of_runs_are_compiled_ahead():
    """What a run enters into the index is what `vofem compile` makes."""
    system = paper_beam("displacement")[1].model.system
    damped = paper_beam("displacement", extra=(vf.RayleighDamping(0.1),))[1].model.system
    exact = {kind_of_run(method, one) for method in BUILT_IN if method.exact for one in (system, damped)}
    stepped = {
        kind_of_run(method, build().model.system)
        for method in BUILT_IN
        if method.steps and not method.special
        for build in ahead.STEPPED.values()
    }
    assert exact | stepped | {"steady states", "statics"} == set(ahead.KINDS)
    assert {kind_of_run(m, system) for m in BUILT_IN if m.steps and not m.special} == {"steps, laws"}


ONE_CONTACT = """
import gc, json, sys
import vofem as vf
from vofem.kernels.jit import CompiledFunction
mass = vf.Mass(1.0, 1.0)
stop = vf.Contact(mass, gap=0.1, stiffness=5.0, side="above", acts_on="penetration")
scene = vf.Scene([mass], [stop], {mass: (0.0, 1.0)})
vf.simulate(scene, 1.0, method=sys.argv[1], dt=0.1, compiled=True)
known = [f for f in gc.get_objects() if isinstance(f, CompiledFunction)]
# What is called through its address has a form for numba, which no other function calls.
made = [f for f in known if f.compilations or vars(f).keys() & {"prepared", "callee"} == {"prepared"}]
from numba.core.runtime import rtsys
counts = rtsys.get_allocation_stats()
print(counts.mi_alloc - counts.mi_free)
print(json.dumps([f"{f.__module__}.{f.__name__}" for f in made]))
for method in sys.argv[2:]:
    vf.simulate(scene, 1.0, method=method, dt=0.1, compiled=True)
print(json.dumps({f.__name__: f.compilations for f in known if f.__module__.endswith("stepping.kernel")}))
"""


def test_what_a_scene_does_not_hold_is_not_compiled(tmp_path):
    """No springpots, hysteresis, resolved switches, laws written in Python, dampers, probes, and no second law.

    Nor is the loop over the steps compiled again for another method. LLVM's optimisation changes nothing of this.
    """
    run = subprocess.run(
        [sys.executable, "-c", ONE_CONTACT, "energy_conserving", "generalized_alpha", "central_difference"],
        env=environment(tmp_path, NUMBA_NRT_STATS="1", NUMBA_OPT="0"), capture_output=True, text=True, check=True,
    )  # fmt: skip
    left, listed, counted = run.stdout.splitlines()[-3:]
    assert json.loads(counted)["advance"] == 1
    assert left == "0", "arrays of kernels that nothing frees"
    made = json.loads(listed)
    absent = ("laws.springpot", "laws.hysteretic", "laws.resolved", "stepping.probes")
    assert not [name for name in made if any(room in name for room in absent)]
    for name in ("_in_band", "begin_springpots"):
        assert not [made_ for made_ in made if made_.endswith(f".{name}")], name
    assert any(name.endswith("._react") for name in made)
    assert len(made) < 33


BORROWING = """
import sys
from typing import NamedTuple
import numpy as np
from numba.core.runtime import rtsys
from vofem.kernels.jit import borrowed, jit

class Pair(NamedTuple):
    one: np.ndarray
    two: np.ndarray

class Both(NamedTuple):
    pair: Pair
    factor: float
    none: None

@jit
def total(pair):
    found = 0.0
    for i in range(pair.one.size):
        found += pair.one[i] * pair.two[i]
    return found

@jit
def borrows(both):
    pair, factor, none = borrowed(both)
    swapped = Pair(pair.two, pair.one[1:])
    pair.one[0] += 1.0
    made = np.ones(3)
    return factor * (total(pair) + total(Pair(swapped.two, swapped.one[1:]))) + made[2]

x, y = np.arange(4.0), np.arange(4.0) + 1.0
counts = [sys.getrefcount(x), sys.getrefcount(y)]
for k in range(50):
    x[0] = 0.0
    assert borrows(Both(Pair(x, y), 2.0, None)) == 2.0 * (1.0 + 2.0 + 6.0 + 12.0 + 2.0 + 6.0 + 12.0 + 1.0 - 1.0) + 1.0
assert counts == [sys.getrefcount(x), sys.getrefcount(y)]
stats = rtsys.get_allocation_stats()
assert stats.mi_alloc >= 50 and stats.mi_alloc == stats.mi_free, stats
"""


def test_arrays_that_are_borrowed_are_those_of_the_caller(tmp_path):
    """What is allocated is freed once, and the caller's arrays have as many owners as before."""
    (tmp_path / "borrowing.py").write_text(BORROWING)
    run = subprocess.run(
        [sys.executable, "-c", "import borrowing"], env=environment(tmp_path, NUMBA_NRT_STATS="1"),
        capture_output=True, text=True,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
