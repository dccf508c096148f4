"""The computing time that an accuracy takes: `work_precision` measures it, `cheapest` finds the fastest way."""

from vofem.studies.accuracy.cheapest import Cheapest, cheapest
from vofem.studies.accuracy.quantities import Errors
from vofem.studies.accuracy.study import LeftOut, Reference, Run, Setting, Study
from vofem.studies.accuracy.work_precision import work_precision

__all__ = ["Cheapest", "Errors", "LeftOut", "Reference", "Run", "Setting", "Study", "cheapest", "work_precision"]
