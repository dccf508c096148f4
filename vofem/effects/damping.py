"""Damping of the structure without its contacts. It does not change when contacts close."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import array, number
from vofem.assembly import SystemBuilder
from vofem.bodies.base import Point
from vofem.errors import ArgumentError


class RayleighDamping:
    """Rayleigh damping ``C = alpha M + beta K``. M and K include linear attachments, and no contacts.

    Parameters
    ----------
    alpha : float
        Factor of the mass matrix, 1/s, not negative.
    beta : float
        Factor of the stiffness matrix, s, not negative; 0 where not given.
    """

    def __init__(self, alpha: float, beta: float = 0.0) -> None:
        self.alpha = number("RayleighDamping: alpha", alpha, minimum=0)
        self.beta = number("RayleighDamping: beta", beta, minimum=0)

    def points(self) -> tuple[Point, ...]:
        """Return nothing: it acts on the whole system."""
        return ()

    def compile(self, builder: SystemBuilder) -> None:
        """Add to C."""
        builder.add_rayleigh(self.alpha, self.beta)

    def describe(self) -> str:
        """Return alpha and beta."""
        return f"RayleighDamping: alpha = {self.alpha:g} 1/s, beta = {self.beta:g} s"


class ModalDamping:
    """Ratios of critical damping in the vibration modes of the structure with all contacts open.

    Parameters
    ----------
    ratio : float or array_like, shape (k,)
        Damping ratio, not negative; 1 is critical damping. A number holds for every vibration mode.
        A list gives one ratio for each mode in ascending order of frequency.
        Modes beyond the end of the list take its last ratio. Rigid motions are
        not counted and stay undamped. Modes of equal frequency should have equal
        ratios, because their order is arbitrary.

    Raises
    ------
    ArgumentError
        For a ratio that is negative or not finite, or an empty list.
    """

    def __init__(self, ratio: float | ArrayLike) -> None:
        self.ratio: float | NDArray[np.float64] = _ratios(ratio)

    def points(self) -> tuple[Point, ...]:
        """Return nothing: it acts on the whole system."""
        return ()

    def compile(self, builder: SystemBuilder) -> None:
        """Declare the ratio."""
        builder.add_modal_damping(self.ratio)

    def describe(self) -> str:
        """Return the ratio or ratios."""
        if np.ndim(self.ratio) == 0:
            return f"ModalDamping: {self.ratio:g} of critical"
        ratios = np.atleast_1d(self.ratio)
        first = ", ".join(f"{ratio:g}" for ratio in ratios[:5])
        rest = f" and {ratios.size - 5} more" if ratios.size > 5 else ""
        return f"ModalDamping: {first}{rest} of critical in modes 1 to {ratios.size}, {ratios[-1]:g} above"


def _ratios(ratio: float | ArrayLike) -> float | NDArray[np.float64]:
    """Return one ratio as a number, several as an array, checked."""
    if np.ndim(ratio) == 0:
        return number("ModalDamping: ratio", ratio, minimum=0)
    ratios = array("ModalDamping: ratio", ratio)
    if ratios.ndim != 1 or not ratios.size:
        raise ArgumentError(f"ModalDamping: ratio has shape {ratios.shape}, expected a number or a list of numbers")
    if np.any(ratios < 0.0):
        k = int(np.argmax(ratios < 0.0))
        raise ArgumentError(f"ModalDamping: ratio[{k}] is {ratios[k]:g}, expected a number that is not negative")
    return ratios
