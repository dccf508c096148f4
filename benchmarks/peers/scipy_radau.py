"""scipy's Radau on the first-order form, with the Jacobian of each status, events left to the error control."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from peers.problem import Array, Problem

NAME = "scipy Radau with Jacobian"
LEVELS: list[dict[str, Any]] = [{"rtol": rtol} for rtol in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)]


def missing() -> str | None:
    return None


def prepare(problem: Problem) -> tuple[Any, ...]:
    from scipy.linalg import solve

    n, tip = problem.mass.shape[0], problem.tip
    unit = np.zeros(n)
    unit[tip] = 1.0
    push = solve(problem.mass, unit, assume_a="pos")
    jacobian = np.zeros((2 * n, 2 * n))
    jacobian[:n, n:] = np.eye(n)
    jacobian[n:, :n] = -solve(problem.mass, problem.stiffness, assume_a="pos")
    closed = jacobian.copy()
    closed[n:, tip] -= problem.stop * push
    return jacobian, closed, push


def run(problem: Problem, prepared: tuple[Any, ...], level: dict[str, Any]) -> tuple[float, Array]:
    from scipy.integrate import solve_ivp

    jacobian, closed, push = prepared
    n, tip, gap, stop = problem.mass.shape[0], problem.tip, problem.gap, problem.stop
    free = np.ascontiguousarray(jacobian[n:, :n])

    def rate(t: float, y: Array) -> Array:
        s = -gap - y[tip]
        force = problem.amplitude * np.sin(t) + (stop * s if s > 0.0 else 0.0)
        out = np.empty(2 * n)
        out[:n] = y[n:]
        out[n:] = free @ y[:n] + push * force
        return out

    def tangent(t: float, y: Array) -> Array:
        return closed if y[tip] < -gap else jacobian

    start = time.perf_counter()
    found = solve_ivp(
        rate, (0.0, problem.t_end), np.zeros(2 * n), method="Radau", t_eval=problem.times, jac=tangent,
        rtol=level["rtol"], atol=1e-3 * level["rtol"],
    )  # fmt: skip
    return time.perf_counter() - start, found.y[tip]
