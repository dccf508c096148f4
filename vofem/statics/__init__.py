"""Statics: equilibrium with contact, and load paths with hysteresis."""

from vofem.statics.equilibria import equilibrium, quasi_static
from vofem.statics.outcome import ContactPath, Equilibrium, QuasiStatic, SpringPath, StaticContact

__all__ = ["ContactPath", "Equilibrium", "QuasiStatic", "SpringPath", "StaticContact", "equilibrium", "quasi_static"]
