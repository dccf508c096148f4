"""Numbers of a scene from measurements, by least squares with exact derivatives."""

from vofem.fitting.fit import Fit, fit
from vofem.fitting.measured import Measured, MeasuredCurve, MeasuredEvents, MeasuredFrequencies, MeasuredStatics

__all__ = ["Fit", "Measured", "MeasuredCurve", "MeasuredEvents", "MeasuredFrequencies", "MeasuredStatics", "fit"]
