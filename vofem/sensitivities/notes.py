"""What a user should know about derivatives of a run: grazings, events at the times asked for, chaos."""

from __future__ import annotations

from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.sensitivities.forward import Forward

#: Speed of a gap function over the largest one of the contact, below which an event is a grazing.
_SLOW = 1e-4

#: Distance of an event from a time asked for, relative to the run, at which both count as one.
_SAME = 1e-12


def notes_of(result: Any, forward: Forward, times: Array, horizon: float) -> list[str]:
    """Return sentences on where derivatives are large, one-sided or without meaning."""
    notes: list[str] = []
    names = () if forward.modal.laws is None else forward.modal.laws.names
    end = float(result.solution.t_end)
    fastest: dict[int, float] = {}
    for crossing in forward.crossings:
        fastest[crossing.contact] = max(fastest.get(crossing.contact, 0.0), abs(crossing.rate))
    slow = [c for c in forward.crossings if abs(c.rate) <= _SLOW * fastest[c.contact]]
    if slow:
        first = slow[0]
        states = " The states after it jump by as much." if any(c.jump for c in slow) else ""
        notes.append(
            f"grazing: contact {names[first.contact]!r} meets its stop at {abs(first.rate):.3g} m/s at "
            f"t = {first.time:.6g} s ({len(slow)} such event{'s' * (len(slow) > 1)}); derivatives of the times of such "
            f"events grow without limit as the speed goes to zero, and hold for ever smaller changes only.{states}"
        )
    near = [
        c for c in forward.crossings
        if c.jump and (abs(c.time - end) <= _SAME * end or np.any(np.abs(times - c.time) <= _SAME * end))
    ]  # fmt: skip
    if near:
        notes.append(
            f"one-sided: an event of contact {names[near[0].contact]!r} lies at t = {near[0].time:.6g} s, one of the "
            "times of the run; derivatives there are those of one side, before the event or after it"
        )
    if horizon < end:
        notes.append(
            f"chaos: perturbations grow so fast that derivatives at single times have no meaning beyond t = "
            f"{horizon:.4g} s; shorten the run, or look at means"
        )
    if np.any(~np.isfinite(forward.event_times)):
        notes.append(
            "not finite: the times of some events have no derivative, because the gap function touches zero without "
            "crossing it; they are infinite or NaN"
        )
    if result.solution.truncation is not None:
        notes.append(
            "truncation: derivatives are those of the run in its Ritz vectors, which are held fixed; truncation=0 "
            "keeps all modes"
        )
    return notes
