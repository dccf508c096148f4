"""All cases in order: hard cases by number, then published ones."""

from __future__ import annotations

from functools import cache

from vofem.verification.case import Case


@cache
def catalogue() -> tuple[Case, ...]:
    """Return all cases; the hard ones by number, then the published ones."""
    from vofem.verification.cases import beams, chains, limits, masses, published, steady

    parts = (published, masses, limits, beams, chains, steady)
    cases = [case for part in parts for case in part.cases()]
    return tuple(sorted(cases, key=lambda case: 1000 if case.number is None else case.number))
