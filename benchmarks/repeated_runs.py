"""First and further runs of one scene: `python benchmarks/repeated_runs.py [OTHER]` prints a table.

The first run of a scene assembles it, solves its eigenproblem or factors its matrices; runs that follow, from another
state, find that done. OTHER is the folder of another copy of this repository, such as an earlier commit: its further
runs are measured in turn with those of this one, in processes of their own, and compared.

Times are the best of many, because the machine may have more to do.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent.parent

CASES = {
    "paper's beam, displacement": {"method": "event_driven"},
    "paper's beam, penetration": {"method": "event_driven"},
    "paper's beam, damped": {"method": "event_driven"},
    "paper's beam, steps of 1e-2 s": {"method": "energy_conserving", "dt": 1e-2},
}
ROUNDS, REPEATS = 12, 10


def build(name: str) -> Any:
    """Return the scene of a case."""
    import vofem as vf

    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=25, supports={"left": "clamped"})
    tip = beam.at(1.0)
    acts_on = "displacement" if "displacement" in name else "penetration"
    stop = vf.Contact(tip, gap=0.03, stiffness=1.0, side="below", acts_on=acts_on)
    damping = [vf.RayleighDamping(0.1, 1e-3)] if "damped" in name else []
    return vf.Scene([beam], [stop, vf.PointLoad(tip, vf.Sine(0.1, 1.0)), *damping])


def run(scene: Any, name: str) -> float:
    """Return the seconds that a run takes."""
    import vofem as vf

    begin = time.perf_counter()
    vf.simulate(scene, 20.0, progress=False, **CASES[name])
    return time.perf_counter() - begin


def work(name: str) -> None:
    """Print the best times of first and of further runs; then more of the latter, whenever a line is read."""
    # The first one compiles.
    run(build(name), name)
    print(min(run(build(name), name) for _ in range(REPEATS)), flush=True)
    scene = build(name)
    run(scene, name)
    for _ in sys.stdin:
        print(min(run(scene, name) for _ in range(REPEATS)), flush=True)


def start(folder: Path, name: str) -> subprocess.Popen[str]:
    """Return a process that works with the copy in a folder."""
    environment = os.environ | {"PYTHONPATH": str(folder), "VOFEM_COMPILED": "1"}
    command = [sys.executable, str(Path(__file__).resolve()), "--work", name]
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=folder, env=environment
    )


def answer(process: subprocess.Popen[str]) -> float:
    """Return the number that a process prints next."""
    assert process.stdout is not None
    return float(process.stdout.readline())


def main(folders: list[Path]) -> None:
    """Print the table."""
    heads = ["first run [ms]", "further runs [ms]", *(["of the other [ms]", "ratio"] if len(folders) > 1 else [])]
    print(f"{'case':32s}" + "".join(f"{head:>19s}" for head in heads))
    for name in CASES:
        processes = [start(folder, name) for folder in folders]
        first = [answer(process) for process in processes]
        best = [float("inf")] * len(processes)
        for _ in range(ROUNDS):
            for k, process in enumerate(processes):
                assert process.stdin is not None
                process.stdin.write("\n")
                process.stdin.flush()
                best[k] = min(best[k], answer(process))
        for process in processes:
            process.communicate()
        columns = [1e3 * first[0], *(1e3 * value for value in best), *([best[0] / best[1]] if best[1:] else [])]
        print(f"{name:32s}" + "".join(f"{value:19.3g}" for value in columns))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--work"]:
        work(sys.argv[2])
    else:
        main([HERE, *(Path(folder).resolve() for folder in sys.argv[1:2])])
