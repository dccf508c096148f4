"""The catalogue of hard and published cases: references, how errors are measured, and the result of every method."""

from functools import cache

from vofem.verification.case import FAILED as FAILED
from vofem.verification.case import PASSED as PASSED
from vofem.verification.case import REFUSED as REFUSED
from vofem.verification.case import REPORTED as REPORTED
from vofem.verification.case import STOPPED as STOPPED
from vofem.verification.case import Case as Case
from vofem.verification.case import How as How
from vofem.verification.case import Outcome as Outcome
from vofem.verification.case import Quantity as Quantity
from vofem.verification.case import Run as Run
from vofem.verification.case import select as select
from vofem.verification.case import verify as verify


@cache
def catalogue() -> tuple[Case, ...]:
    """Return all cases; the hard ones by number, then the published ones."""
    from vofem.verification.cases import beams, chains, limits, masses, published, steady

    parts = (published, masses, limits, beams, chains, steady)
    cases = [case for part in parts for case in part.cases()]
    return tuple(sorted(cases, key=lambda case: 1000 if case.number is None else case.number))
