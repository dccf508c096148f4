"""The paper's beam by vofem and by other programs, on one machine in one run: ``python benchmarks/side_by_side.py``.

Peers are extras of the benchmark alone: ``pip install -e .[bench]``. OpenSeesPy
needs the system's BLAS and LAPACK besides (Debian: libblas3, liblapack3); one
that is missing is left out by name.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from curves import Curve, Panel, log_curves

HERE = Path(__file__).parent
PEERS = (
    "vofem_events", "vofem_steps", "numpy_newmark", "exudyn_ode2", "opensees", "scipy_radau", "scipy_dop853",
)  # fmt: skip

#: Relative errors of the tip at which times are compared.
GOALS = (1e-3, 1e-6, 1e-9)

#: Seconds after which a peer is given up.
_LIMIT = 600.0


@dataclass
class Measured:
    """What one program did: error over largest displacement, and seconds, from rough to fine."""

    name: str
    ours: bool
    levels: list[dict[str, Any]] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    missing: str = ""

    def time_to(self, goal: float) -> tuple[float, bool]:
        """Return the seconds that an error takes, and whether they are extrapolated; NaN where it is out of reach.

        Between two runs they are interpolated in logarithms. Beyond the finest
        they follow the slope of the last four.
        """
        if not self.errors:
            return float("nan"), False
        errors, seconds = np.log(np.maximum(self.errors, 1e-16)), np.log(self.seconds)
        reached = np.flatnonzero(errors <= np.log(goal))
        if reached.size:
            k = int(reached[0])
            if k == 0:
                return float(np.min(self.seconds)), False
            share = (np.log(goal) - errors[k - 1]) / (errors[k] - errors[k - 1])
            return float(np.exp(seconds[k - 1] + share * (seconds[k] - seconds[k - 1]))), False
        if len(errors) < 2 or not errors[-1] < errors[-2]:
            return float("nan"), False
        slope = float(np.polyfit(errors[-4:], seconds[-4:], 1)[0])
        return float(np.exp(seconds[-1] + slope * (np.log(goal) - errors[-1]))), True


def measure(report: Any = None) -> list[Measured]:
    """Run all programs one after another, each in a process of its own."""
    environment = dict(os.environ, OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", VOFEM_COMPILED="1")
    path = os.pathsep.join([str(HERE), str(HERE.parent), environment.get("PYTHONPATH", "")])
    environment["PYTHONPATH"] = path.strip(os.pathsep)
    found = []
    for peer in PEERS:
        if report is not None:
            report(f"side by side: {peer}")
        one = Measured(peer, peer.startswith("vofem"))
        command = [sys.executable, "-m", "peers", peer]
        try:
            outcome = subprocess.run(
                command, cwd=HERE, env=environment, capture_output=True, text=True, timeout=_LIMIT, check=False
            )
            lines, fault = outcome.stdout, outcome.stderr.strip().splitlines()[-1:] if outcome.returncode else []
        except subprocess.TimeoutExpired as error:
            lines = error.stdout.decode() if isinstance(error.stdout, bytes) else error.stdout or ""
            fault = [f"given up after {_LIMIT:g} s"]
        for line in lines.splitlines():
            record = json.loads(line)
            one.name, one.missing = record["name"], record.get("missing", "")
            if "seconds" in record:
                one.levels.append(record["level"])
                one.seconds.append(record["seconds"])
                one.errors.append(record["error"])
        if fault and not one.errors:
            one.missing = one.missing or fault[0]
        found.append(one)
    return found


def best_of_ours(found: list[Measured], goal: float) -> float:
    """Return the seconds that vofem takes to an error, by whichever of its methods is the fastest."""
    return float(np.nanmin([one.time_to(goal)[0] for one in found if one.ours]))


def ratio_table(found: list[Measured]) -> str:
    """Return Markdown: seconds to each error, and over vofem's."""
    lines = [
        "| program | " + " | ".join(f"{goal:.0e}" for goal in GOALS) + " |",
        "| --- |" + " ---: |" * len(GOALS),
        "| **vofem**, fastest method | " + " | ".join(_seconds(best_of_ours(found, goal)) for goal in GOALS) + " |",
    ]
    for one in found:
        if one.missing or not one.errors:
            continue
        cells = []
        for goal in GOALS:
            seconds, beyond = one.time_to(goal)
            ratio = seconds / best_of_ours(found, goal)
            mark = "~" if beyond else ""
            times = f"{mark}{ratio:.0f}" if ratio >= 9.5 else f"{mark}{ratio:.1f}"
            cells.append("not reached" if np.isnan(seconds) else f"{mark}{_seconds(seconds)} ({times} times)")
        lines.append(f"| {one.name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def missing_lines(found: list[Measured]) -> str:
    """Return a line for every program that was left out."""
    return "\n".join(f"- left out: {one.name}: {one.missing}" for one in found if one.missing)


def _seconds(value: float) -> str:
    return f"{1e3 * value:.3g} ms" if value < 1.0 else f"{value:.3g} s" if value < 7200 else f"{value / 3600:.3g} h"


def draw(found: list[Measured], path: Path) -> Path:
    """Draw error against time of all programs."""
    curves = [
        Curve(one.name, one.seconds, np.maximum(one.errors, 1e-14), strong=one.name == "vofem event_driven")
        for one in found
        if one.errors
    ]
    panel = Panel(curves, "wall time [s]", "largest tip error / largest tip displacement", "25 elements, 20 s")
    return log_curves([panel], path)


if __name__ == "__main__":
    results = measure(lambda text: print(text, file=sys.stderr))
    print(ratio_table(results))
    print(missing_lines(results))
    for one in results:
        for level, seconds, error in zip(one.levels, one.seconds, one.errors, strict=True):
            print(f"{one.name:40s} {level!s:18s} {seconds:9.4f} s  {error:.2e}")
