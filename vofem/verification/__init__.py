"""The catalogue of hard and published cases: what is right, how it is measured, and what every method makes of it."""

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
