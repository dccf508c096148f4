"""Work done to find orbits."""

from __future__ import annotations

from dataclasses import dataclass, field

from vofem.system import Counters


@dataclass
class Work:
    """Work done to find orbits."""

    #: Evaluations of the equations. For shooting these are flows over one orbit, with or without monodromy matrix.
    flows: int = 0
    checks: int = 0  #: Flows over orbits that are known, with which these are checked.
    runs: Counters = field(default_factory=Counters)  #: Work of these evaluations.
