"""Newton's method on the equations of an orbit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.studies.steady.problem import Equations, Evaluation

#: Steps of Newton's method, and halvings of one step.
_STEPS, _HALVINGS = 40, 8

#: A residual that no longer shrinks counts as rounding below this.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Solved:
    """A solution of the equations of an orbit."""

    unknowns: Array  #: Shape (n,).
    evaluation: Evaluation  #: The evaluation at these unknowns, with its Jacobian matrix.


def solved(problem: Equations, guess: Array, steps: int = _STEPS) -> Solved:
    """Return the orbit near a guess by Newton's method, steps halved while the residual grows.

    Raises `ConvergenceError` if the residual does not vanish. The message gives the least residual.
    """
    x = np.array(guess, dtype=float)
    now = problem.evaluate(x)
    best = now.error
    for _ in range(steps):
        if now.error <= problem.tolerance:
            return Solved(x, now)
        step = direction(now.jacobian, now.residual)
        moved = _shorter(problem, x, step, now)
        if moved is None:
            if now.error <= ROUNDING:
                return Solved(x, now)
            break
        x, now = moved
        best = min(best, now.error)
    if now.error <= ROUNDING:
        return Solved(x, now)
    raise ConvergenceError(f"Newton's method left a residual of {best:.2e} of the motion")


def _shorter(problem: Equations, x: Array, step: Array, now: Evaluation) -> tuple[Array, Evaluation] | None:
    """Return the longest of a step and its halves that lowers the residual; None where rounding or a kink stops it."""
    factor = 1.0
    for _ in range(_HALVINGS):
        try:
            after = problem.evaluate(x - factor * step)
        except ConvergenceError:
            after = None
        if after is not None and after.error <= (1.0 - 0.1 * factor) * now.error:
            return x - factor * step, after
        factor *= 0.5
    return None


def raised(
    solve: Callable[[float, Array, Array], Array], track: list[tuple[float, Array]], goal: float, step: float,
    *, least: float, largest: float = np.inf, shrink: float = 0.3, grow: float = 2.0,
) -> list[tuple[float, Array]]:  # fmt: skip
    """Return solutions along a number that is raised to a goal in steps, which become shorter where one fails.

    `solve`: returns the solution at a value from a guess and the solution before it, or raises `ConvergenceError`.
    `track`: values and solutions to begin from; the last two give a guess.
    `least`: step below which the walk ends before its goal.
    """
    while track[-1][0] < goal and step >= least:
        here, now = track[-1]
        ahead = min(here + step, goal)
        guess = now
        if len(track) > 1:
            guess = now + (now - track[-2][1]) * (ahead - here) / (here - track[-2][0])
        try:
            track = [*track, (ahead, solve(ahead, guess, now))]
            step = min(grow * step, largest)
        except ConvergenceError:
            step *= shrink
    return track


def direction(matrix: Array, right: Array) -> Array:
    """Return the solution of linear equations; if they are singular, the shortest solution."""
    try:
        step = np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        step = np.full(right.shape, np.nan)
    if not np.all(np.isfinite(step)):
        if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(right))):
            raise ConvergenceError("the derivative is not finite: an orbit grazes a contact")
        step = np.linalg.lstsq(matrix, right, rcond=1e-14)[0]
    return np.asarray(step)
