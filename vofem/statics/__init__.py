"""Statics: equilibrium with contact, and load paths with hysteresis."""

from vofem.statics.contact_equilibrium import equilibrium
from vofem.statics.load_path import quasi_static
from vofem.statics.outcome import ContactPath, Equilibrium, QuasiStatic, SpringPath, StaticContact

__all__ = ["ContactPath", "Equilibrium", "QuasiStatic", "SpringPath", "StaticContact", "equilibrium", "quasi_static"]
