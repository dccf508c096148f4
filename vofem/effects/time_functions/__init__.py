"""Functions of time for loads: closed forms with exact derivatives.

A named function is, between its breakpoints, a sum of harmonics and a
polynomial of degree one. `TimeFunction.piece` returns exactly that, and the
event-driven method integrates it in closed form. A plain callable has no
pieces: only the stepping methods take it.
"""

from vofem.effects.time_functions.arbitrary import Arbitrary
from vofem.effects.time_functions.base import Scaled, Sum, TimeFunction
from vofem.effects.time_functions.conversion import as_time_function
from vofem.effects.time_functions.moments import carried
from vofem.effects.time_functions.named import Constant, Pulse, Ramp, Sine
from vofem.effects.time_functions.piece import Piece
from vofem.effects.time_functions.shifted import Shifted
from vofem.effects.time_functions.tabulated import Tabulated

__all__ = [
    "Arbitrary",
    "Constant",
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
]
