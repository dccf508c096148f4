"""Notes on loads that are known by their values at some times only."""

from __future__ import annotations

import numpy as np

from vofem.system import System

#: Times in a run, at least, at which a plain callable is evaluated.
FEWEST_SAMPLES = 20_000


def loads_by_values(system: System, t_end: float) -> list[str]:
    """Return a note on every load of which short features may be missed.

    `t_end`: end of the run, s.
    """
    notes = []
    for load in system.loads:
        # An approximated callable was evaluated beforehand, a plain callable is evaluated by the run.
        width = load.function.sample_spacing if np.isfinite(load.function.sample_spacing) else t_end / FEWEST_SAMPLES
        if width > 0.0:
            notes.append(
                f"load: {load.name} is known by its values at times {width:.3g} s apart only, and what is shorter may "
                "be missed; use Pulse, Tabulated or Sine, or Approximated(..., breaks=...) with the times of short "
                "features"
            )
    return notes
