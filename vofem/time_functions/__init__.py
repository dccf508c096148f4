"""Functions of time for loads: closed forms with exact derivatives.

Between its breakpoints a named function is a sum of harmonics and a polynomial of
degree one. Displacements of bases and loads that travel have polynomials up to
degree three. `TimeFunction.piece` returns this sum, and the event-driven method
integrates it in closed form. A plain callable has no such form. Only methods that
step in time accept it.
"""

from vofem.parameters.declared import table_name
from vofem.time_functions.approximated import Approximated
from vofem.time_functions.base import (
    FUNCTIONS,
    Arbitrary,
    Constant,
    Load,
    OfTime,
    Scaled,
    Sum,
    TimeFunction,
    as_time_function,
)
from vofem.time_functions.displacement import Displacement
from vofem.time_functions.moments import carried
from vofem.time_functions.named import Pulse, Ramp, Sine
from vofem.time_functions.parts import parts_of
from vofem.time_functions.piece import Piece
from vofem.time_functions.shifted import Shifted
from vofem.time_functions.tabulated import Tabulated

__all__ = [
    "Approximated",
    "Arbitrary",
    "Constant",
    "Displacement",
    "Load",
    "OfTime",
    "Piece",
    "Pulse",
    "Ramp",
    "Scaled",
    "Shifted",
    "Sine",
    "Sum",
    "Tabulated",
    "TimeFunction",
    "as_time_function",
    "carried",
    "parts_of",
]

FUNCTIONS |= {table_name(cls): cls for cls in (Sine, Constant, Ramp, Pulse, Tabulated, Sum, Scaled)}
