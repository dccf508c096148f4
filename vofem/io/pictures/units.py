"""Numbers with a unit prefix, for labels and axes."""

from __future__ import annotations

import math

_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))

#: Steps of rounded limits: such that half of each is a short number too.
_LIMITS = (1.0, 1.2, 1.6, 2.0, 2.4, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


def prefixed(size: float, unit: str) -> tuple[float, str]:
    """Return a factor and a unit with a prefix that suits a number of magnitude `size`.

    >>> prefixed(1300.0, "N")
    (1000.0, 'kN')
    """
    size = abs(size)
    if size == 0.0 or not math.isfinite(size):
        return 1.0, unit
    for factor, prefix in _PREFIXES:
        # 0.1 N stays 0.1 N: a thousandth is used only where it saves leading zeros.
        if size >= factor * (0.1 if factor == 1.0 else 1.0) * (1.0 - 1e-9):
            return factor, prefix + unit
    factor, prefix = _PREFIXES[-1]
    return factor, prefix + unit


def length(size: float) -> tuple[float, str]:
    """Return factor and unit for a displacement: mm from a tenth of a millimetre to a metre."""
    if 1e-4 <= abs(size) < 1.0:
        return 1e-3, "mm"
    return prefixed(size, "m")


def spell(value: float, unit: str) -> str:
    """Return a number of three digits with its unit, such as ``'1.33 kN'``."""
    factor, name = length(value) if unit == "m" else prefixed(value, unit)
    return f"{three_digits(value / factor)} {name}"


def three_digits(value: float) -> str:
    """Return a number to three digits, without exponent where it has less than four before the point."""
    if value == 0.0:
        return "0"
    digits = 2 - math.floor(math.log10(abs(value)))
    return f"{value:.{min(digits, 3)}f}" if 0 <= digits <= 5 else f"{value:.3g}"


def nice_below(value: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that is not above `value`."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(step * power for step in (0.5, 1.0, 2.0, 5.0) if step * power <= value * (1.0 + 1e-9))


def nice_above(value: float) -> float:
    """Return a short number, not below `value`, for the limit of a scale."""
    if value == 0.0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return min(step * power for step in _LIMITS if step * power >= value * (1.0 - 1e-9))
