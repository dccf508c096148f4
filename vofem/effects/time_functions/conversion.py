"""Functions of time made of numbers and callables."""

from __future__ import annotations

from typing import Any

import numpy as np

from vofem._validate import number
from vofem.effects.time_functions.arbitrary import Arbitrary
from vofem.effects.time_functions.base import TimeFunction
from vofem.effects.time_functions.named import Constant
from vofem.errors import ArgumentError


def as_time_function(value: Any) -> TimeFunction:
    """Return `value` as a `TimeFunction`: one already, a number, or any callable of t."""
    if isinstance(value, TimeFunction):
        return value
    if callable(value):
        return Arbitrary(value)
    if isinstance(value, str) or not np.isscalar(value):
        raise ArgumentError(
            f"a load's time function is {value!r}, expected a number, a callable of t, Sine, Ramp, Tabulated, ..."
        )
    return Constant(number("a load's time function", value))
