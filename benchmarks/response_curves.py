"""Response curves: error of the peak and of the folds against time, by shooting, harmonic balance and sweeps.

    OPENBLAS_NUM_THREADS=1 python benchmarks/response_curves.py

NLvib's example 03, and a cantilever of 25 elements before a stop. A sweep runs the scene at one frequency after the
other, each time from the end of the run before. Times are processor times of a curve with its amplitudes. With
``PYHARM=PYTHON`` in the environment, the Python of an environment with pyHarm-os follows the first curve too; see
`peers/pyharm_nlvib_03.py`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

import vofem as vf
from vofem.errors import VofemError

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from orbit_scenes import nlvib_03

HARMONICS = (5, 10, 25, 50, 100, 150)

#: Frequencies of a sweep, and periods at each of them.
SWEEPS = ((31, 30), (121, 100), (241, 100))

#: Periods at the end of a run in which the amplitude is taken, and samples of one.
_LAST, _SAMPLES = 4, 200

#: Largest steps of pyHarm-os, in its own measure, and the exact peak of the measure that it reports (NLvib's), m.
PYHARM_STEPS, PYHARM_PEAK = (0.05,), 0.97951

#: Processor time after which the next number of harmonics is left out, s.
CAP = 120.0


@dataclass
class Case:
    """A response curve.

    Attributes
    ----------
    name : str
    build : callable
        Returns the scene at an angular frequency, rad/s.
    start, stop : float
    point : callable
        Returns the point of a scene whose amplitude is drawn.
    """

    name: str
    build: Callable[[float], vf.Scene]
    start: float
    stop: float
    point: Callable[[vf.Scene], Any]


@dataclass
class Found:
    """What a method found of a curve.

    Attributes
    ----------
    method, setting : str
    seconds : float
    peak : float
        Largest amplitude, m.
    upper, lower : float
        Angular frequencies of the folds, rad/s; NaN if they were not found.
    special : int
        Number of special points.
    curve : tuple of ndarray
        Frequencies and amplitudes.
    missed : str
    """

    method: str
    setting: str
    seconds: float
    peak: float = np.nan
    upper: float = np.nan
    lower: float = np.nan
    special: int = 0
    curve: tuple[Any, Any] = field(default_factory=tuple)
    missed: str = ""


BEAM = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=25, supports={"left": "clamped"}, name="beam")


def cantilever(omega: float) -> vf.Scene:
    """Return the second scene of the page on steady states."""
    tip = BEAM.at(1.0)
    stop = vf.Contact(tip, gap=0.005, stiffness=5.0, side="below", acts_on="penetration", name="stop")
    return vf.Scene([BEAM], [stop, vf.ModalDamping(0.03), vf.PointLoad(tip, vf.Sine(0.003, omega))])


CASES = (
    Case("NLvib's example 03", nlvib_03, 0.8, 0.5, lambda scene: scene.bodies[1]),
    Case("cantilever, 25 elements", cantilever, 2.5, 5.5, lambda scene: BEAM.at(1.0)),
)


def by_branch(case: Case, method: str, setting: str, folds: tuple[float, float] | None, **options: Any) -> Found:
    """Follow a branch; the peak is searched between its orbits, the folds are the ones nearest to given ones."""
    begun = time.process_time()
    branch = vf.continuation(case.build, case.start, case.stop, **options)
    amplitudes = np.array([orbit.amplitude(case.point(orbit.scene)) for orbit in branch.orbits])
    highest = int(np.argmax(amplitudes))
    same = {key: value for key, value in options.items() if key == "harmonics"}

    def lower(omega: float) -> float:
        scene = case.build(float(omega))
        try:
            return -vf.periodic(scene, guess=branch.orbits[highest], **same).amplitude(case.point(scene))
        except VofemError:
            return 0.0

    around = np.sort(branch.values[[max(highest - 1, 0), min(highest + 1, len(branch) - 1)]])
    best = minimize_scalar(lower, bounds=tuple(around), method="bounded", options={"xatol": 1e-7 * around[1]})
    found = Found(method, setting, time.process_time() - begun, max(float(amplitudes[highest]), -float(best.fun)))
    turns = np.array([point.value for point in branch.special if point.kind == "fold"])
    if turns.size:
        found.upper, found.lower = (
            (float(turns.max()), float(turns.min()))
            if folds is None
            else tuple(float(turns[np.argmin(np.abs(turns - fold))]) for fold in folds)
        )
    found.special, found.curve = len(branch.special), (branch.values, amplitudes)
    complete = branch.values[-1] == case.stop
    found.missed = "" if complete else f"ends at {branch.values[-1]:.4g} rad/s"
    return found


def by_sweep(case: Case, upwards: bool, count: int, periods: int) -> Found:
    """Run the scene at one frequency after the other; a fold is where the amplitude changes most between two."""
    low, high = sorted((case.start, case.stop))
    values = np.linspace(low, high, count) if upwards else np.linspace(high, low, count)
    begun, state, amplitudes = time.process_time(), None, []
    for omega in values.tolist():
        scene, period = case.build(omega), 2.0 * np.pi / omega
        times = np.concatenate([[0.0], period * np.linspace(periods - _LAST, periods, _LAST * _SAMPLES + 1)])
        run = vf.simulate(scene, float(times[-1]), times=times, initial=state, method="event_driven", progress=False)
        amplitudes.append(0.5 * float(np.ptp(run.displacement(case.point(scene))[1:])))
        state = run
    seconds = time.process_time() - begun
    k = int(np.argmax(np.abs(np.diff(amplitudes))))
    jump = 0.5 * float(values[k] + values[k + 1])
    found = Found("sweep " + ("up" if upwards else "down"), f"{count} x {periods} periods", seconds, max(amplitudes))
    found.upper, found.lower = (jump, np.nan) if upwards else (np.nan, jump)
    found.curve = values, np.array(amplitudes)
    return found


def reference(case: Case) -> Found:
    """Return the curve by shooting with short steps, to which all others are compared."""
    return by_branch(case, "shooting", "max_step 0.02", None, max_step=0.02)


def by_pyharm(python: str) -> list[Found]:
    """Return what pyHarm-os finds of NLvib's example 03; its peak is that of half the mean square of a displacement."""
    script = Path(__file__).resolve().parent / "peers" / "pyharm_nlvib_03.py"
    found = []
    for step in PYHARM_STEPS:
        # It leaves files where it runs.
        with tempfile.TemporaryDirectory() as folder:
            command = [str(Path(python).absolute()), str(script), str(step)]
            done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=folder, check=True)
        told = json.loads(done.stdout)
        one = Found("pyHarm-os", f"{told['harmonics']} harmonics, steps to {step:g}", told["processor_seconds"])
        one.peak, one.missed = told["peak"] / PYHARM_PEAK, f"{told['turns']} turns"
        one.lower, one.upper = told["folds"] or (np.nan, np.nan)
        found.append(one)
    return found


def measure(say: Callable[[str], None]) -> dict[str, tuple[Found, list[Found]]]:
    """Return reference and findings of all cases."""
    results = {}
    for case in CASES:
        say(f"response curves, {case.name}")
        vf.continuation(case.build, case.start, case.start + 0.01 * (case.stop - case.start))
        exact = reference(case)
        folds = exact.upper, exact.lower
        found = [by_branch(case, "shooting", "", folds)]
        for harmonics in HARMONICS:
            say(f"response curves, {case.name}, {harmonics} harmonics")
            try:
                found.append(by_branch(case, "harmonic balance", f"{harmonics} harmonics", folds, harmonics=harmonics))
            except VofemError as error:
                found.append(Found("harmonic balance", f"{harmonics} harmonics", np.nan, missed=type(error).__name__))
            if found[-1].seconds > CAP:
                break
        for upwards in (True, False):
            for count, periods in SWEEPS:
                say(f"response curves, {case.name}, sweep of {count}")
                found.append(by_sweep(case, upwards, count, periods))
        if case is CASES[0] and "PYHARM" in os.environ:
            say("response curves, pyHarm-os")
            for one in by_pyharm(os.environ["PYHARM"]):
                one.peak *= exact.peak
                found.append(one)
        results[case.name] = exact, found
    return results


def errors(exact: Found, one: Found) -> dict[str, float]:
    """Return relative errors of the peak and of both folds."""
    return {name: abs(getattr(one, name) / getattr(exact, name) - 1.0) for name in ("peak", "upper", "lower")}


def table(results: dict[str, tuple[Found, list[Found]]]) -> str:
    """Return the findings as a table."""
    lines = [
        "| curve | method | | time | error of the peak | of the upper fold | of the lower fold | special points |",
        "| --- | --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for name, (exact, found) in results.items():
        for one in found:
            cells = [f"{value:.0e}" if np.isfinite(value) else "-" for value in errors(exact, one).values()]
            special = str(one.special) if one.method in ("shooting", "harmonic balance") else "-"
            setting = ", ".join(part for part in (one.setting, one.missed) if part)
            lines.append(
                f"| {name} | {one.method} | {setting} | {one.seconds:.3g} s | {' | '.join(cells)} | {special} |"
            )
    return "\n".join(lines)


def main() -> None:
    print(table(measure(lambda text: print(text, file=sys.stderr, flush=True))))


if __name__ == "__main__":
    main()
