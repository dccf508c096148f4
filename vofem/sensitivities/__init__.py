"""Exact derivatives of outcomes by the numbers that a scene is made of."""

from vofem.sensitivities import objectives
from vofem.sensitivities.entry import gradient, sensitivities
from vofem.sensitivities.of_orbits import OrbitSensitivities, SpecialSensitivities
from vofem.sensitivities.of_runs import RunSensitivities
from vofem.sensitivities.of_statics import EquilibriumSensitivities, ModesSensitivities
from vofem.sensitivities.parameter import Parameter

__all__ = [
    "EquilibriumSensitivities",
    "ModesSensitivities",
    "OrbitSensitivities",
    "Parameter",
    "RunSensitivities",
    "SpecialSensitivities",
    "gradient",
    "objectives",
    "sensitivities",
]
