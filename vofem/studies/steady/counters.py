"""Work done to find orbits."""

from __future__ import annotations

from dataclasses import dataclass, field

from vofem.system import Counters


@dataclass
class Work:
    """Work done to find orbits.

    Attributes
    ----------
    flows : int
        Evaluations of the equations; of shooting, flows over one orbit, with or without monodromy.
    runs : Counters
        What these took.
    """

    flows: int = 0
    runs: Counters = field(default_factory=Counters)
