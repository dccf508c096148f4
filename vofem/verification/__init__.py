"""The catalogue of hard and published cases: references, how errors are measured, and the result of every method."""

from functools import cache

from vofem.verification.case import FAILED, PASSED, REFUSED, REPORTED, STOPPED, Case, How, Quantity, Run
from vofem.verification.runner import Outcome, select, verify

__all__ = [
    "FAILED",
    "PASSED",
    "REFUSED",
    "REPORTED",
    "STOPPED",
    "Case",
    "How",
    "Outcome",
    "Quantity",
    "Run",
    "catalogue",
    "select",
    "verify",
]


@cache
def catalogue() -> tuple[Case, ...]:
    """Return all cases; the hard ones by number, then the published ones."""
    from vofem.verification.cases import beams, chains, limits, masses, published, steady

    parts = (published, masses, limits, beams, chains, steady)
    cases = [case for part in parts for case in part.cases()]
    return tuple(sorted(cases, key=lambda case: 1000 if case.number is None else case.number))
