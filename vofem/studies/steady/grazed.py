"""Which contact an orbit grazes: with a force that jumps there, its multipliers are those of one side only."""

from __future__ import annotations

import numpy as np

from vofem.result import Result
from vofem.system import PINNED

#: Distance of a local extremum of a gap function from zero, over displacements and gap, that rounding may bridge.
_ROUNDING = 1e-12

#: Halvings of the time between samples that find an extremum.
_HALVINGS = 60


def grazed(result: Result) -> str:
    """Return the name of a contact whose force jumps and that a run of an orbit grazes within rounding, or ""."""
    solution, laws = result.solution, result.model.system.contacts
    if laws is None:
        return ""
    times = np.unique(np.concatenate([result.times, np.asarray(solution.events.time, dtype=float)]))
    for j in np.flatnonzero(laws.jump & (laws.gap != 0.0)).tolist():
        row = laws.rows[[j]]
        u = np.asarray(solution.sample(times).along(row, "q"))[0]
        rate = np.asarray(solution.sample(times).along(row, "v"))[0]
        s, size = u - laws.gap[j], float(np.max(np.abs(u))) + abs(float(laws.gap[j]))
        turning = np.flatnonzero(rate[:-1] * rate[1:] < 0.0)
        low, high, rising = times[turning], times[turning + 1], rate[turning] > 0.0
        reach = np.maximum(np.abs(rate[turning]), np.abs(rate[turning + 1])) * (high - low)
        near = np.minimum(np.abs(s[turning]), np.abs(s[turning + 1])) <= reach + _ROUNDING * size
        low, high, rising = low[near], high[near], rising[near]
        if not low.size:
            continue
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            before = (np.asarray(solution.sample(middle).along(row, "v"))[0] > 0.0) == rising
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        extremum = np.asarray(solution.sample(low).along(row, "q"))[0] - laws.gap[j]
        resting = solution.contacts(low).status[j] == PINNED
        if np.any((np.abs(extremum) <= _ROUNDING * size) & ~resting):
            return laws.names[j]
    return ""
