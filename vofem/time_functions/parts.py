"""The functions of which a function of time is made, and the unit in which their frequencies were given."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from vofem.time_functions.named import Sine


def parts_of(function: Any) -> Iterator[Any]:
    """Yield the functions of which a sum, or a multiple of a function, is made."""
    inner = getattr(function, "terms", None) or [one for one in (getattr(function, "function", None),) if one]
    if not inner:
        yield function
    for part in inner:
        yield from parts_of(part)


def frequency_words(omega: float, functions: Iterable[Any], digits: int = 6) -> str:
    """Return an angular frequency in rad/s as a text, in Hz where a `Sine` of the functions was given in Hz."""
    sines = (part for function in functions for part in parts_of(function) if isinstance(part, Sine))
    if any(sine.frequency is not None for sine in sines):
        return f"{omega / (2.0 * np.pi):.{digits}g} Hz"
    return f"{omega:.{digits}g} rad/s"
