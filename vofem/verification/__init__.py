"""The catalogue of hard and published cases: references, how errors are measured, and the result of every method."""

from vofem.verification.case import FAILED, PASSED, REFUSED, REPORTED, STOPPED, Case, How, Quantity, Run
from vofem.verification.catalogue import catalogue
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
