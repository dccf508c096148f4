"""Newton's method on the equations of an orbit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from vofem.arrays import Array
from vofem.errors import ConvergenceError

#: Steps of Newton's method, halvings of one step, and the share by which the residual falls at least in a whole one.
_STEPS, _HALVINGS, _FALLS = 40, 7, 0.1

#: Factor by which a step of a walk that fails becomes shorter.
_SHRINK = 0.3

#: Error of an evaluation at which equations count as solved.
TOLERANCE = 1e-13

#: A residual that no longer shrinks counts as rounding below this, where equations do not tell more.
ROUNDING = 1e-9

#: Largest length of a whole step, in terms of the one before it, where Newton's method converges.
_SHORTER = 0.5

#: A residual between these may be raised by rounding of the unknowns, and the next steps may end that.
_ROUNDED, _CLOSE = 1e-12, 1e-6

#: Length of a whole step, over the sizes of the unknowns, after which only rounding is left.
_LAST = 1e-9


class Evaluation:
    """Equations at some unknowns: `residual` (n,), `jacobian` (n, n), and `error`, the size of the residual."""

    @property
    def solved(self) -> float:
        """An error that may be rounding."""
        return ROUNDING

    @property
    def solved_by_steps(self) -> float:
        """An error that is rounding where the last step of Newton's method was."""
        return 0.0

    def stripped(self) -> Self:
        """Return the evaluation without what only Newton's method needs and takes memory."""
        return self


@dataclass(frozen=True)
class Solved:
    """A solution of the equations of an orbit."""

    unknowns: Array  #: Shape (n,).
    evaluation: Any  #: The evaluation at these unknowns, with its Jacobian matrix.


def solved(
    evaluate: Callable[[Array], Any],
    guess: Array,
    steps: int = _STEPS,
    *,
    tolerance: float = TOLERANCE,
    known: Any = None,
    step: Callable[[Array, Any], Array] | None = None,
) -> Solved:
    """Return the orbit near a guess by Newton's method; the best one where rounding keeps it from its tolerance.

    Steps are halved until the residual falls.

    `evaluate`: returns the equations at some unknowns, an `Evaluation`, or raises `ConvergenceError`.
    `tolerance`: error of an evaluation that is small enough.
    `known`: the evaluation at the guess.
    `step`: returns the next step from unknowns and their evaluation; by default that of Newton's method.
    Raises `ConvergenceError` if the residual does not vanish. The message gives the least residual.
    """
    x, why = np.array(guess, dtype=float), ""
    now = evaluate(x) if known is None else known
    for _ in range(steps):
        if now.error <= tolerance or not np.isfinite(now.error):
            break
        move = direction(now.jacobian, -now.residual) if step is None else step(x, now)
        # A part of a step that lowers rounding does so by chance.
        after, why = lowered(evaluate, x, move, now, _HALVINGS if now.error > ROUNDING else 0)
        if after is None:
            break
        x, now = after
    return _accepted(x, now, why)


def converged(
    evaluate: Callable[[Array], Any],
    guess: Array,
    steps: int,
    step: Callable[[Array, Any], Array],
    scales: Array,
    tolerance: float = TOLERANCE,
    known: Any = None,
) -> Solved:
    """Return the orbit near a guess by whole steps of Newton's method; see `solved`.

    A residual depends on how equations are scaled, and where one follows from another through many segments it may rise
    for a step. Then the next step, which must be shorter, tells that the method converges. It has where a step was so
    short that the next one would be rounding.

    `scales` (shape (n,)): sizes of the unknowns.
    P. Deuflhard, Newton Methods for Nonlinear Problems, Springer 2004 (natural monotonicity).
    """
    x, why, fell, length = np.array(guess, dtype=float), "", True, np.inf
    now = evaluate(x) if known is None else known
    best = x, now
    for _ in range(steps):
        done = now.error <= tolerance or (length <= _LAST and now.error <= _ROUNDED)
        if done or not np.isfinite(now.error):
            break
        move = step(x, now)
        before, length = length, float(np.linalg.norm(move / scales))
        if not fell and not length <= _SHORTER * before:
            why = "its steps do not become shorter"
            break
        try:
            after = evaluate(x + move)
        except ConvergenceError as failed:
            why = str(failed)
            break
        # Rounding may raise the residual of a solution that is close.
        lower = (1.0 - _FALLS) * now.error
        fell = after.error <= (lower if now.error <= _ROUNDED else max(lower, _CLOSE))
        x, now = x + move, after
        best = min(best, (x, now), key=lambda one: one[1].error)
    return _accepted(*best, why, length)


def _accepted(x: Array, now: Any, why: str, last: float = np.inf) -> Solved:
    """Return a solution, or raise `ConvergenceError` if its residual is more than rounding.

    `last`: length of the last step, over the sizes of the unknowns.
    """
    if now.error <= (max(now.solved, now.solved_by_steps) if last <= _LAST else now.solved):
        return Solved(x, now)
    raise ConvergenceError(f"Newton's method left a residual of {now.error:.2e} of the motion{why and f': {why}'}")


def lowered(
    evaluate: Callable[[Array], Any], x: Array, move: Array, now: Any, halvings: int
) -> tuple[tuple[Array, Any] | None, str]:
    """Return unknowns after a step from `now`, or a part of it, that lowers the error, and what is evaluated there.

    None where no part does; the text says what happened then.
    """
    factor, why = 1.0, ""
    for _ in range(1 + halvings):
        try:
            after = evaluate(x + factor * move)
            if after.error <= (1.0 - _FALLS * factor) * now.error:
                return (x + factor * move, after), ""
        except ConvergenceError as failed:
            why = str(failed)
        factor *= 0.5
    return None, why


def raised(
    solve: Callable[[float, Array, Array], Array], track: list[tuple[float, Array]], goal: float, step: float,
    *, least: float, largest: float = np.inf, grow: float = 2.0,
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
            step *= _SHRINK
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
