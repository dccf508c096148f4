"""What a support does to a beam along a run."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.bodies.beam import Beam
from vofem.errors import ArgumentError
from vofem.histories.run import Run
from vofem.integrators.base import Sampled
from vofem.reactions import support_reaction

Array = NDArray[np.float64]


class Reaction(NamedTuple):
    """What a support does to a body: force in N (positive upward) and moment in N m, each (n_times,).

    The moment is positive where it does work on a growing slope. The one that
    the support does not hold is zero.
    """

    force: Array
    moment: Array


def reaction_of(run: Run, beam: Beam, where: Any, t: ArrayLike | None, samples: Sampled) -> Reaction:
    """Return the reaction of a support; see `vofem.Result.reaction`.

    Parameters
    ----------
    run : Run
    beam : Beam
    where : "left", "right" or x
    t : array_like, optional
        Times in s; those of the run where not given.
    samples : Sampled
        The motion at these times.
    """
    times = run.times if t is None else np.atleast_1d(np.asarray(t, dtype=float))
    system = run.model.system
    force = None
    if system.contacts is not None:
        force = run.contact_samples.force if t is None else run.solution.contacts(times).force
    modes = getattr(run.solution, "modes", None) if system.modal_damping is not None else None
    remembers = any(group.recorded for group in system.laws)
    pull = _spring_force(run, beam, where, t) if remembers else None
    return Reaction(*support_reaction(run.model, beam, where, times, samples, force, modes, pull))


def _spring_force(run: Run, beam: Beam, where: Any, t: ArrayLike | None) -> Array:
    """Return the forces of springs with memory, which are known at the run's times only."""
    if t is not None and not np.array_equal(np.atleast_1d(t), run.times):
        raise ArgumentError(
            f"reaction of Beam {beam.name!r} at {where!r}: springs with memory know their forces at the run's "
            "times; name the times in times= when simulating"
        )
    springs = getattr(run.solution, "springs", None)
    assert springs is not None
    return np.asarray(springs.force)
