"""Loads whose shape is known by some of their values only."""

from __future__ import annotations

import numpy as np

from vofem.system import System

#: Times in a run, at least, at which a plain callable is evaluated.
LOOKS = 20_000


def loads_by_values(system: System, t_end: float) -> list[str]:
    """Return a note on every load of which short features may be missed.

    Parameters
    ----------
    system : System
    t_end : float
        In s.
    """
    notes = []
    for load in system.loads:
        # What is approximated was looked at beforehand, a plain callable is looked at by the run.
        width = load.function.looked if np.isfinite(load.function.looked) else t_end / LOOKS
        if width > 0.0:
            notes.append(
                f"load: {load.name} is known by its values at times {width:.3g} s apart only, and what is shorter may "
                "be missed; use Pulse, Tabulated or Sine, or Approximated(..., breaks=...) with the times of short "
                "features"
            )
    return notes
