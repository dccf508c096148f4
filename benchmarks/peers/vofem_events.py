"""vofem, event_driven: no step to choose, so one run."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import vofem as vf
from peers.problem import Array, Problem

NAME = "vofem event_driven"
LEVELS: list[dict[str, Any]] = [{}]


def missing() -> str | None:
    return None


def prepare(problem: Problem) -> None:
    # Kernels are compiled, or loaded, by the first run.
    vf.simulate(problem.scene, 1.0, times=np.linspace(0.0, 1.0, 11)).displacement(problem.scene.contacts[0].a)


def run(problem: Problem, prepared: None, level: dict[str, Any]) -> tuple[float, Array]:
    start = time.perf_counter()
    result = vf.simulate(problem.scene, problem.t_end, times=problem.times)
    history = result.displacement(problem.scene.contacts[0].a)
    return time.perf_counter() - start, history
