"""An orbit from rest: the transient until stroboscopic points settle, then Newton's method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.integrators.event_driven.flow import Start
from vofem.studies.steady.near import orbit_near
from vofem.studies.steady.newton import Solved
from vofem.studies.steady.shooting import Shooting, relative

#: Largest number of periods of the loads in a transient.
MOST_PERIODS = 200

#: Relative change over an orbit below which Newton's method is tried, and the factor by which it must fall before the
#: next trial.
_TRY, _AGAIN = 1e-2, 0.1

#: Steps of Newton's method in a trial, and the largest distance to its solution, in changes over an orbit.
_STEPS, _FAR = 2, 200.0


@dataclass(frozen=True)
class Settled:
    """An orbit that was found from rest."""

    solved: Solved
    notes: tuple[str, ...] = ()


def from_rest(what: str, problem: Shooting) -> Settled:
    """Return the orbit that a motion from rest settles on, or one near the linear response where it does not settle.

    `what` is the name of the function whose argument the problem is, for messages.

    Raises `ConvergenceError` if no orbit is found in either way.
    """
    x = problem.outside(np.zeros(problem.size))
    level, change = _TRY, np.inf
    for _ in range(max(1, MOST_PERIODS // problem.periods)):
        z, v = problem.to_modes(x)
        one = problem.run(Start(0.0, z, v), problem.duration)
        after = problem.to_unknowns(one.displacement, one.velocity)
        before, change = change, relative(after - x, one.sizes)
        if not np.isfinite(change):
            break
        if change <= level and change <= before:
            found = _tried(problem, after, change, one.sizes)
            if found is not None:
                return Settled(found)
            level = _AGAIN * change
        x = after
    seen = f"after {MOST_PERIODS} periods from rest the motion still changes by {change:.2g} of itself over an orbit"
    try:
        found = orbit_near(problem, problem.linear_response())
    except ConvergenceError as error:
        regular = (
            "another start, at which the motion is regular, such as one where no contact is touched"
            if what == "continuation"
            else "follow a branch from where the motion is regular with vofem.continuation"
        )
        raise ConvergenceError(
            f"{what}: no orbit was found. {seen}: a subharmonic or chaotic motion, or little damping; and from the "
            f"linear response {error}. Try more periods (periods=2, 3, ...), a guess= such as a run with more damping, "
            f"or {regular}"
        ) from error
    note = f"{seen}, so this orbit was found from the linear response; motions need not settle on it"
    return Settled(found, (note,))


def _tried(problem: Shooting, x: Array, change: float, sizes: tuple[float, float]) -> Solved | None:
    """Return the orbit that the transient approaches, or None where Newton's method does not find it from here."""
    try:
        found = orbit_near(problem, x, _STEPS)
    except ConvergenceError:
        return None
    multipliers = found.evaluation.multipliers
    assert multipliers is not None
    size = np.abs(multipliers)
    leading = float(size.max()) if size.size else 0.0
    if leading > 1.0 + 1e-9:
        return None
    # The slowest multiplier determines how many times the change over an orbit remains.
    reach = _FAR * change / max(1.0 - leading, 1e-2)
    return found if relative(found.unknowns - x, sizes) <= reach else None
