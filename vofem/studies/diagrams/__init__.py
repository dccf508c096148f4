"""Diagrams over many scenes: stroboscopic points, basins of attraction, maps of stability."""

from vofem.studies.diagrams.attractors import Basins as Basins
from vofem.studies.diagrams.attractors import basins as basins
from vofem.studies.diagrams.bifurcation import BifurcationDiagram as BifurcationDiagram
from vofem.studies.diagrams.bifurcation import bifurcation_diagram as bifurcation_diagram
from vofem.studies.diagrams.stability import StabilityMap as StabilityMap
from vofem.studies.diagrams.stability import stability_map as stability_map
