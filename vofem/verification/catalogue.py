"""All cases in order: hard cases by number, then published ones."""

from __future__ import annotations

from functools import cache

from vofem.verification.case import Case


@cache
def catalogue() -> tuple[Case, ...]:
    """Return all cases; the hard ones by number, then the published ones."""
    from vofem.verification.cases import (
        accumulation,
        bars,
        beams,
        faults,
        loads,
        meshes,
        oscillators,
        published_modes,
        published_runs,
        rebounds,
        springpots,
        statics,
        steady,
        two_masses,
        units,
    )

    parts = (
        accumulation, bars, beams, faults, loads, meshes, oscillators, rebounds, statics, units, two_masses,
        published_modes, published_runs, springpots, steady,
    )  # fmt: skip
    cases = [case for part in parts for case in part.cases()]
    return tuple(sorted(cases, key=lambda case: 1000 if case.number is None else case.number))
