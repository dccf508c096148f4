"""The forces of supports and joints on bodies along a run."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vofem.arrays import Array
from vofem.errors import ArgumentError
from vofem.histories.motion import Motion
from vofem.integrators.base import Sampled


class Reaction(NamedTuple):
    """Force in N, positive upward, and moment in N m of a support or a joint on a body, each (n_times,).

    A positive moment does positive work when the slope grows. A force or moment that the support cannot exert is zero.
    """

    force: Array
    moment: Array


def state_of(
    run: Motion, label: str, t: ArrayLike | None, samples: Sampled
) -> tuple[Array, Sampled, list[Array | None], Any]:
    """Return times, the motion, forces of each group of laws (None where they are not known), and modes."""
    times = run.times if t is None else np.atleast_1d(np.asarray(t, dtype=float))
    system, solution = run.model.system, run.solution
    forces: list[Array | None] = []
    recorded = 0
    for group in system.laws:
        if group is system.contacts:
            forces.append(run.contact_samples.force if t is None else solution.contacts(times).force)
        elif group is system.sliders:
            sliding: Any = solution
            forces.append(sliding.friction(times).force)
        elif group.recorded:
            forces.append(_spring_force(run, label, t)[recorded : recorded + len(group)])
            recorded += len(group)
        else:
            known = group.travelling is None
            forces.append(group.reactions(samples.along(group.rows, "q")) if known else None)
    return times, samples, forces, solution.modes if system.modal_damping is not None else None


def _spring_force(run: Motion, label: str, t: ArrayLike | None) -> Array:
    """Return the forces of hysteretic springs, which are known at the run's times only."""
    if t is not None and not np.array_equal(np.atleast_1d(t), run.times):
        raise ArgumentError(
            f"{label}: hysteretic springs know their forces at the run's times; name the times in times= when "
            "simulating"
        )
    springs = run.solution.springs
    assert springs is not None
    return np.asarray(springs.force)
