"""What a newcomer waits for: `python benchmarks/start_up.py [imports] [command] [first] [pictures]` prints tables.

Every time is that of a process of its own, from its start to its end, best of some. `imports` compares with
``import numpy``, `command` and `pictures` with ``import skfem, scipy.sparse.linalg``. `first` runs the paper's beam by
each method in a process without compiled code (cold), in one that finds it on disk (warm), and in plain Python: the
times of both runs, the processor's time of the whole process, and the number of functions that were compiled, once for
every kind of arguments.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent.parent

REPEATS = 5

_REFERENCE = "import skfem, scipy.sparse.linalg"

_BEAM = """
import sys, time
begin = time.perf_counter()
import vofem as vf
beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=25, supports={"left": "clamped"})
stop = vf.Contact(beam.at(1.0), gap=0.03, stiffness=1.0, side="below", acts_on="displacement")
scene = vf.Scene([beam], [stop, vf.PointLoad(beam.at(1.0), vf.Sine(0.1, 1.0))])
step = {"event_driven": {}, "central_difference": {"dt": 5e-5}}.get(sys.argv[1], {"dt": 1e-2})
t_end = 0.5 if sys.argv[1] == "central_difference" else 20.0
vf.simulate(scene, t_end, method=sys.argv[1], **step)
first = time.perf_counter()
vf.simulate(scene, t_end, method=sys.argv[1], **step)
second = time.perf_counter()
count = 0
if "numba" in sys.modules:
    import gc
    from vofem.kernels.jit import CompiledFunction
    count = sum(f.compilations for f in gc.get_objects() if isinstance(f, CompiledFunction))
print(first - begin, second - first, time.process_time(), count)
"""

METHODS = ("event_driven", "energy_conserving", "generalized_alpha", "central_difference")


#: Of the processes that are measured: they keep Python's bytecode, as it is after any installation.
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def seconds(*command: str) -> float:
    """Return the seconds that a process takes, best of some."""
    best = float("inf")
    for _ in range(REPEATS):
        begin = time.perf_counter()
        subprocess.run(command, cwd=HERE, env=ENVIRONMENT, stdout=subprocess.DEVNULL, check=True)
        best = min(best, time.perf_counter() - begin)
    return best


def python(code: str) -> float:
    """Return the seconds that a program takes."""
    return seconds(sys.executable, "-c", code)


def vofem(*arguments: str) -> float:
    """Return the seconds that a command takes."""
    return seconds(sys.executable, "-m", "vofem", *arguments)


def imports() -> None:
    """Print what importing takes."""
    numpy, own = python("import numpy"), python("import vofem")
    every = python("import vofem\nfor name in vofem.__all__: getattr(vofem, name)")
    print(f"import numpy            {numpy:.3f} s")
    print(f"import vofem            {own:.3f} s, {own / numpy:.1f} times")
    print(f"all public names        {every:.3f} s, {every / numpy:.1f} times")


def command() -> None:
    """Print what the command line takes without pictures."""
    reference = python(_REFERENCE)
    print(f"{_REFERENCE:<36} {reference:.3f} s")
    with tempfile.TemporaryDirectory() as folder:
        runs = {
            "vofem explain": vofem("explain", "examples/cantilever.toml"),
            "vofem run --no-pictures": vofem("run", "examples/cantilever.toml", "--no-pictures", "--output", folder),
        }
    for name, taken in runs.items():
        print(f"{name:<36} {taken:.3f} s, {taken / reference:.1f} times")


def pictures() -> None:
    """Print what a run with its three files takes."""
    reference = python(_REFERENCE)
    with tempfile.TemporaryDirectory() as folder:
        taken = vofem("run", "examples/cantilever.toml", "--output", folder)
    print(f"{'vofem run with three files':<36} {taken:.3f} s, {taken / reference:.1f} times")


def first() -> None:
    """Print what first and second runs of each method take: cold, warm, and as plain Python; and functions compiled."""
    print(f"{'':<20} {'way':<8} {'first run':>10} {'second':>8} {'processor':>10} {'functions compiled':>20}")
    for method in METHODS:
        with tempfile.TemporaryDirectory() as folder:
            compiled = ENVIRONMENT | {"NUMBA_CACHE_DIR": folder, "VOFEM_COMPILED": "1"}
            ways = {"cold": compiled, "warm": compiled, "plain": ENVIRONMENT | {"VOFEM_COMPILED": "0"}}
            for way, environment in ways.items():
                done = subprocess.run(
                    [sys.executable, "-c", _BEAM, method], cwd=HERE, env=environment, capture_output=True, text=True,
                    check=True,
                )  # fmt: skip
                begin, again, processor, count = done.stdout.split()
                print(
                    f"{method:<20} {way:<8} {float(begin):8.2f} s {float(again):6.3f} s {float(processor):8.2f} s "
                    f"{int(count):>18}",
                    flush=True,
                )


if __name__ == "__main__":
    TABLES = {"imports": imports, "command": command, "pictures": pictures, "first": first}
    for name in sys.argv[1:] or TABLES:
        TABLES[name]()
        print()
