"""Pictures with matplotlib: histories, spectra, impacts, shapes, maps of the motion, steady states.

Every function writes a file where it is given a path, and returns the path. Without one it draws into the axes given as
``ax=``, or into a figure of ``matplotlib.pyplot``, and returns the axes. Style sheets of matplotlib restyle them all.
"""

from __future__ import annotations

from vofem.io.pictures.along import shapes, space_time
from vofem.io.pictures.histories import time_history
from vofem.io.pictures.impacts import event_raster, force_histogram, impact_statistics
from vofem.io.pictures.spectra import spectrum
from vofem.io.pictures.steady import (
    backbone_curve,
    locus,
    multipliers,
    phase_portrait,
    poincare_section,
    response_curve,
)
from vofem.io.pictures.studies import basin_map, bifurcation, fit, state_map, sweep_curves
from vofem.io.pictures.work_precision import work_precision

__all__ = [
    "backbone_curve",
    "basin_map",
    "bifurcation",
    "event_raster",
    "fit",
    "force_histogram",
    "impact_statistics",
    "locus",
    "multipliers",
    "phase_portrait",
    "poincare_section",
    "response_curve",
    "shapes",
    "space_time",
    "spectrum",
    "state_map",
    "sweep_curves",
    "time_history",
    "work_precision",
]
