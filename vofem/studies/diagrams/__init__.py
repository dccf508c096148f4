"""Diagrams over many scenes: stroboscopic points, basins of attraction, maps of stability."""

from vofem.studies.diagrams.attractors import Basins, basins
from vofem.studies.diagrams.bifurcation import BifurcationDiagram, bifurcation_diagram
from vofem.studies.diagrams.stability import StabilityMap, stability_map

__all__ = [
    "Basins",
    "BifurcationDiagram",
    "StabilityMap",
    "basins",
    "bifurcation_diagram",
    "stability_map",
]
