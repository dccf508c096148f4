"""vofem, energy_conserving and generalized_alpha: the same kind of steps as the peers take."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import vofem as vf
from peers.problem import Array, Problem

NAME = "vofem generalized_alpha"
LEVELS: list[dict[str, Any]] = [{"dt": dt} for dt in (0.02, 0.01, 4e-3, 2e-3, 1e-3, 4e-4, 2e-4, 1e-4, 4e-5)]


def missing() -> str | None:
    return None


def prepare(problem: Problem) -> None:
    run(problem, None, {"dt": 0.1})


def run(problem: Problem, prepared: None, level: dict[str, Any]) -> tuple[float, Array]:
    start = time.perf_counter()
    result = vf.simulate(
        problem.scene, problem.t_end, method="generalized_alpha", rho_infinity=1.0, times=problem.times, **level
    )
    history = result.displacement(problem.scene.contacts[0].a)
    return time.perf_counter() - start, np.asarray(history)
