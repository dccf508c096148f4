"""Damping of the contact-free system. Contact status never changes it; a contact brings its own damper."""

from __future__ import annotations

from vofem._validate import number
from vofem.assembly import SystemBuilder
from vofem.bodies.base import Point


class RayleighDamping:
    """``C = alpha M + beta K`` with the contact-free matrices, all linear attachments included.

    Parameters
    ----------
    alpha : float
        In 1/s, not negative.
    beta : float
        In s, not negative; 0 where not given.
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
    """The same ratio of critical damping in every vibration mode of the contact-free system.

    Parameters
    ----------
    ratio : float
        Not negative; 1 is critical. Rigid-body modes stay undamped.
    """

    def __init__(self, ratio: float) -> None:
        self.ratio = number("ModalDamping: ratio", ratio, minimum=0)

    def points(self) -> tuple[Point, ...]:
        """Return nothing: it acts on the whole system."""
        return ()

    def compile(self, builder: SystemBuilder) -> None:
        """Declare the ratio."""
        builder.add_modal_damping(self.ratio)

    def describe(self) -> str:
        """Return the ratio."""
        return f"ModalDamping: {self.ratio:g} of critical"
