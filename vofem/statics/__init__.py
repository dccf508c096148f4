"""Statics: equilibrium with contact."""

from vofem.statics.contact_equilibrium import equilibrium
from vofem.statics.outcome import Equilibrium, StaticContact

__all__ = ["Equilibrium", "StaticContact", "equilibrium"]
