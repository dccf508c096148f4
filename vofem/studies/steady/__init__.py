"""Steady states: periodic orbits, their stability, and branches of them."""

from vofem.studies.steady.backbones import backbone
from vofem.studies.steady.branch import Branch, BranchCounters
from vofem.studies.steady.branches import continuation
from vofem.studies.steady.exponents import LyapunovExponents, lyapunov
from vofem.studies.steady.orbit import PeriodicOrbit
from vofem.studies.steady.special import SpecialPoint
from vofem.studies.steady.steady_state import periodic

__all__ = [
    "Branch",
    "BranchCounters",
    "LyapunovExponents",
    "PeriodicOrbit",
    "SpecialPoint",
    "backbone",
    "continuation",
    "lyapunov",
    "periodic",
]
