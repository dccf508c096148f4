"""The forces of supports and joints on bodies along a run."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import unknown
from vofem.arrays import Array
from vofem.bodies.base import Body
from vofem.errors import ArgumentError
from vofem.histories.run import Run
from vofem.integrators.base import Sampled
from vofem.reactions import residual, support_reaction


class Reaction(NamedTuple):
    """Force in N, positive upward, and moment in N m of a support or a joint on a body, each (n_times,).

    A positive moment does positive work when the slope grows. A force or moment
    that the support cannot exert is zero.
    """

    force: Array
    moment: Array


def reaction_of(run: Run, body: Body, where: Any, t: ArrayLike | None, samples: Sampled) -> Reaction:
    """Return the reaction of a support; see `vofem.Result.reaction`.

    `t`: times in s. The default is those of the run.
    `samples`: the motion at these times.
    """
    return Reaction(*support_reaction(run.model, body, where, *_state(run, f"reaction of {body.label}", t, samples)))


def joint_force_of(run: Run, name: str, t: ArrayLike | None, samples: Sampled) -> Reaction:
    """Return the force and the moment of a joint on its body a; see `vofem.Result.joint_force`.

    Raises `ArgumentError` if there is no joint of that name.
    """
    model = run.model
    names = [known for known, _ in model.joints]
    if name not in names:
        raise unknown("joint", name, names)
    first = sum(count for known, count in model.joints[: names.index(name)])
    times, *rest = _state(run, f"force of Joint {name!r}", t, samples)
    parts = np.zeros((2, times.size))
    for k in range(dict(model.joints)[name]):
        assert model.joint_rows is not None
        parts[k] = residual(model, model.joint_rows[[first + k]], times, *rest)
    return Reaction(parts[0], parts[1])


def _state(
    run: Run, label: str, t: ArrayLike | None, samples: Sampled
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


def _spring_force(run: Run, label: str, t: ArrayLike | None) -> Array:
    """Return the forces of hysteretic springs, which are known at the run's times only."""
    if t is not None and not np.array_equal(np.atleast_1d(t), run.times):
        raise ArgumentError(
            f"{label}: hysteretic springs know their forces at the run's times; name the times in times= when "
            "simulating"
        )
    springs = run.solution.springs
    assert springs is not None
    return np.asarray(springs.force)
