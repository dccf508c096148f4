"""The energies along a run and their balance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Energy:
    """Energies in J at `Result.times`, each of shape (n_times,).

    Attributes
    ----------
    kinetic, strain : ndarray
        Of bodies and springs, those with memory and those of springpots included.
    contact : ndarray
        Stored in closed contacts: ``K0 (u^2 - gap^2)/2`` for ``acts_on="displacement"``.
    dissipated : ndarray
        Taken by all dampers, hysteretic springs and springpots since t = 0.
    work : ndarray
        Done by all loads since t = 0.
    start : float
        Total energy at t = 0.

    Notes
    -----
    `total` is the sum of the first three, `balance` what is missing from
    their balance with dissipation and work, `balance_error` its largest
    magnitude over the largest energy.

    At times between the steps of a stepping method states are interpolated,
    and the balance holds as far as they are: name `times` on the steps, or
    none, to see the method's own. Steps that follow ``tol=`` have times of their own.
    """

    kinetic: Array
    strain: Array
    contact: Array
    dissipated: Array
    work: Array
    start: float

    @property
    def total(self) -> Array:
        """Kinetic, strain and contact energy together."""
        return self.kinetic + self.strain + self.contact

    @property
    def balance(self) -> Array:
        """What is missing from the balance, J: ``total - start + dissipated - work``."""
        return self.total - self.start + self.dissipated - self.work

    @property
    def balance_error(self) -> float:
        """The largest magnitude of `balance` over the largest energy in it."""
        parts = (self.total, self.dissipated, self.work)
        scale = max((float(np.max(np.abs(part), initial=0.0)) for part in parts), default=0.0)
        return float(np.max(np.abs(self.balance), initial=0.0)) / scale if scale > 0 else 0.0
