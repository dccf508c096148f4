"""Newmark's average acceleration as one writes it with numpy: both inverses cached, status iterated."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from peers.problem import Array, Problem

NAME = "numpy Newmark loop, cached inverses"
LEVELS: list[dict[str, Any]] = [{"dt": dt} for dt in (0.02, 0.01, 4e-3, 2e-3, 1e-3, 4e-4, 2e-4, 1e-4)]


def missing() -> str | None:
    return None


def prepare(problem: Problem) -> None:
    return None


def run(problem: Problem, prepared: None, level: dict[str, Any]) -> tuple[float, Array]:
    dt, tip = level["dt"], problem.tip
    every = round(0.02 / dt)
    start = time.perf_counter()
    n = problem.mass.shape[0]
    contact = np.zeros((n, n))
    contact[tip, tip] = problem.stop
    # Solved for the new displacement; the stop pulls towards -gap while closed.
    effective = problem.stiffness + 4.0 / dt**2 * problem.mass
    inverses = np.linalg.inv(effective), np.linalg.inv(effective + contact)
    columns = [np.ascontiguousarray(inverse[:, tip]) for inverse in inverses]
    heavy = [inverse @ problem.mass for inverse in inverses]
    q, v, a = np.zeros(n), np.zeros(n), np.zeros(n)
    history = np.zeros(problem.times.size)
    closed, level_of = 0, (0.0, -problem.stop * problem.gap)
    load = problem.amplitude * np.sin(dt * np.arange(1, every * (problem.times.size - 1) + 1))
    step = 0
    for k in range(1, problem.times.size):
        for _ in range(every):
            rest = 4.0 / dt**2 * q + 4.0 / dt * v + a
            while True:
                new = heavy[closed] @ rest + columns[closed] * (load[step] + level_of[closed])
                status = 1 if new[tip] < -problem.gap else 0
                if status == closed:
                    break
                closed = status
            acceleration = 4.0 / dt**2 * (new - q) - 4.0 / dt * v - a
            v = v + 0.5 * dt * (a + acceleration)
            q, a = new, acceleration
            step += 1
        history[k] = q[tip]
    return time.perf_counter() - start, history
