"""Steady states: periodic orbits, their stability, and branches of them."""

from vofem.studies.steady.backbones import backbone
from vofem.studies.steady.branch import Branch, BranchCounters
from vofem.studies.steady.branches import continuation
from vofem.studies.steady.exponents import LyapunovExponents, lyapunov
from vofem.studies.steady.linear_response import FrequencyResponse, frequency_response
from vofem.studies.steady.locus import Locus, locus
from vofem.studies.steady.orbit import PeriodicOrbit
from vofem.studies.steady.special import SpecialPoint
from vofem.studies.steady.steady_state import periodic
from vofem.studies.steady.stroboscope import PoincareSection, poincare

__all__ = [
    "Branch",
    "BranchCounters",
    "FrequencyResponse",
    "Locus",
    "LyapunovExponents",
    "PeriodicOrbit",
    "PoincareSection",
    "SpecialPoint",
    "backbone",
    "continuation",
    "frequency_response",
    "locus",
    "lyapunov",
    "periodic",
    "poincare",
]
