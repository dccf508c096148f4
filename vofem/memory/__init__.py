"""Scalar laws with memory as plain data: backbones, Jenkins elements, the law printed in the paper, springpots."""

from vofem.memory.laws import HYPERBOLIC, JENKINS, TABULATED, LinearLevel, MemoryLaw, PrintedLaw, past_of
from vofem.memory.springpot import SpringpotLaw

__all__ = ["HYPERBOLIC", "JENKINS", "TABULATED", "LinearLevel", "MemoryLaw", "PrintedLaw", "SpringpotLaw", "past_of"]
