"""Scalar laws with memory as plain data: backbones, Jenkins elements, the law printed in the paper."""

from vofem.memory.laws import HYPERBOLIC, JENKINS, TABULATED, LinearLevel, MemoryLaw, PrintedLaw, past_of

__all__ = ["HYPERBOLIC", "JENKINS", "TABULATED", "LinearLevel", "MemoryLaw", "PrintedLaw", "past_of"]
