"""Steady states: periodic orbits, their stability, and branches of them."""

from vofem.studies.steady.branch import Branch, BranchCounters
from vofem.studies.steady.orbit import PeriodicOrbit
from vofem.studies.steady.special import SpecialPoint

__all__ = ["Branch", "BranchCounters", "PeriodicOrbit", "SpecialPoint"]
