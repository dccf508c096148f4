"""Pictures with matplotlib: histories, spectra, impacts, shapes, maps of the motion, steady states.

Every function writes a file where it is given a path, and returns the path. Without one it draws into the axes given as
``ax=``, or into a figure of ``matplotlib.pyplot``, and returns the axes. Style sheets of matplotlib restyle them all.
"""

from vofem.io.pictures.along import shapes as shapes
from vofem.io.pictures.along import space_time as space_time
from vofem.io.pictures.histories import time_history as time_history
from vofem.io.pictures.impacts import event_raster as event_raster
from vofem.io.pictures.impacts import force_histogram as force_histogram
from vofem.io.pictures.impacts import impact_statistics as impact_statistics
from vofem.io.pictures.spectra import spectrum as spectrum
from vofem.io.pictures.steady import backbone_curve as backbone_curve
from vofem.io.pictures.steady import locus as locus
from vofem.io.pictures.steady import multipliers as multipliers
from vofem.io.pictures.steady import phase_portrait as phase_portrait
from vofem.io.pictures.steady import poincare_section as poincare_section
from vofem.io.pictures.steady import response_curve as response_curve
from vofem.io.pictures.studies import basin_map as basin_map
from vofem.io.pictures.studies import bifurcation as bifurcation
from vofem.io.pictures.studies import fit as fit
from vofem.io.pictures.studies import state_map as state_map
from vofem.io.pictures.studies import sweep_curves as sweep_curves
from vofem.io.pictures.work_precision import work_precision as work_precision

#: All that is imported above.
__all__ = [name for name, made in list(globals().items()) if callable(made)]
