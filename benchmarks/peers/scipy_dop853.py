"""scipy's DOP853, restarted at every contact event that `solve_ivp` locates."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from peers.problem import Array, Problem
from peers.scipy_radau import prepare as matrices

NAME = "scipy DOP853 with events"
# Its step is held by the beam's highest frequency, so all tolerances cost the same.
LEVELS: list[dict[str, Any]] = [{"rtol": 1e-10}]


def missing() -> str | None:
    return None


def prepare(problem: Problem) -> tuple[Any, ...]:
    return matrices(problem)


def run(problem: Problem, prepared: tuple[Any, ...], level: dict[str, Any]) -> tuple[float, Array]:
    from scipy.integrate import solve_ivp

    jacobian, _, push = prepared
    n, tip, gap, stop = problem.mass.shape[0], problem.tip, problem.gap, problem.stop
    free = np.ascontiguousarray(jacobian[n:, :n])

    def rate_of(closed: bool) -> Any:
        matrix = free.copy()
        constant = 0.0
        if closed:
            matrix[:, tip] -= stop * push
            constant = -stop * gap

        def rate(t: float, y: Array) -> Array:
            out = np.empty(2 * n)
            out[:n] = y[n:]
            np.dot(matrix, y[:n], out=out[n:])
            out[n:] += push * (problem.amplitude * np.sin(t) + constant)
            return out

        return rate

    def crossing(t: float, y: Array) -> float:
        return float(-gap - y[tip])

    crossing.terminal = True  # type: ignore[attr-defined]
    start = time.perf_counter()
    t, y, closed = 0.0, np.zeros(2 * n), False
    history = np.zeros(problem.times.size)
    while t < problem.t_end:
        crossing.direction = -1.0 if closed else 1.0  # type: ignore[attr-defined]
        wanted = np.flatnonzero(problem.times > t)
        found = solve_ivp(
            rate_of(closed), (t, problem.t_end), y, method="DOP853", t_eval=problem.times[wanted], events=crossing,
            rtol=level["rtol"], atol=1e-3 * level["rtol"],
        )  # fmt: skip
        history[wanted[: found.t.size]] = found.y[tip] if found.t.size else 0.0
        if not found.t_events[0].size:
            break
        t, y, closed = float(found.t_events[0][-1]), found.y_events[0][-1], not closed
    return time.perf_counter() - start, history
