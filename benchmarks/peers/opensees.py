"""OpenSeesPy: elastic beam-columns with consistent mass, a gap material, Newmark's average acceleration.

Tuned: BandSPD with one factorisation and one iteration per step
(``algorithm("Linear")``), which at these steps costs no accuracy and a third of
the time of Newton; steps are taken in blocks, without recorders.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from peers.problem import Array, Problem

NAME = "OpenSeesPy Newmark, BandSPD"
LEVELS: list[dict[str, Any]] = [{"dt": dt} for dt in (0.02, 0.01, 4e-3, 2e-3, 1e-3, 4e-4, 2e-4, 1e-4)]


def missing() -> str | None:
    try:
        import openseespy.opensees  # noqa: F401
    except ModuleNotFoundError:
        return "openseespy is not installed: pip install -e .[bench]"
    except (ImportError, RuntimeError):
        return (
            "openseespy does not load: it needs the system's BLAS and LAPACK, on Debian "
            "apt-get install libblas3 liblapack3"
        )
    return None


def prepare(problem: Problem) -> None:
    return None


def run(problem: Problem, prepared: None, level: dict[str, Any]) -> tuple[float, Array]:
    import openseespy.opensees as ops

    n, dt = problem.elements, level["dt"]
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    for k in range(n + 1):
        ops.node(k + 1, k / n, 0.0)
        # Bending only, as in the other programs.
        ops.fix(k + 1, 1, int(k == 0), int(k == 0))
    ops.geomTransf("Linear", 1)
    for k in range(n):
        ops.element("elasticBeamColumn", k + 1, k + 1, k + 2, 1.0, 1.0, 1.0, 1, "-mass", 1.0, "-cMass")
    ops.node(2 * n, 1.0, 0.0)
    ops.fix(2 * n, 1, 1, 1)
    ops.uniaxialMaterial("ElasticPPGap", 1, problem.stop, -1e10, -problem.gap)
    ops.element("zeroLength", 2 * n, 2 * n, n + 1, "-mat", 1, "-dir", 2)
    ops.timeSeries("Trig", 1, 0.0, 1e9, 2.0 * np.pi, "-factor", problem.amplitude)
    ops.pattern("Plain", 1, 1)
    ops.load(n + 1, 0.0, 1.0, 0.0)
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("BandSPD")
    ops.test("NormDispIncr", 1e-13, 20)
    ops.algorithm("Linear")
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")
    history, block = np.zeros(problem.times.size), round(0.02 / dt)
    start = time.perf_counter()
    for k in range(1, problem.times.size):
        if ops.analyze(block, dt):
            raise RuntimeError(f"OpenSees failed at t = {ops.getTime():g} s")
        history[k] = ops.nodeDisp(n + 1, 2)
    return time.perf_counter() - start, history
