"""Damping of the structure without its contacts. It does not change when contacts close."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from vofem.assembly import SystemBuilder
from vofem.effects.kinds import Acting
from vofem.parameters import Real, RealOrArray, declared


@declared()
class RayleighDamping(Acting):
    """Rayleigh damping ``C = alpha M + beta K``. M and K include linear attachments, and no contacts."""

    alpha: Annotated[float, Real("1/s", "Factor of the mass matrix.", least=0)]
    beta: Annotated[float, Real("s", "Factor of the stiffness matrix.", least=0)] = 0.0

    def compile(self, builder: SystemBuilder) -> None:
        """Add to C."""
        builder.add_rayleigh(self.alpha, self.beta)

    def describe(self) -> str:
        """Return alpha and beta."""
        return f"RayleighDamping: alpha = {self.alpha:g} 1/s, beta = {self.beta:g} s"


@declared()
class ModalDamping(Acting):
    """Ratios of critical damping in the vibration modes of the structure with all contacts open.

    Raises
    ------
    ArgumentError
        For a ratio that is negative or not finite, or an empty list.
    """

    ratio: Annotated[
        float | NDArray[np.float64],
        RealOrArray(
            Real(least=0),
            "Damping ratio, not negative; 1 is critical damping. A number holds for every vibration mode. A list gives "
            "one ratio for each mode in ascending order of frequency. Modes beyond the end of the list take its last "
            "ratio. Rigid motions are not counted and stay undamped. Modes of equal frequency should have equal "
            "ratios, because their order is arbitrary.",
        ),
    ]

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
