"""The energies along a run and their balance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vofem.arrays import Array


@dataclass(frozen=True)
class Energy:
    """Energies in J at `Result.times`, each of shape (n_times,).

    Attributes
    ----------
    kinetic, strain : ndarray
        Kinetic energy of bodies; strain energy of bodies and springs, also of hysteretic springs and springpots.
    contact : ndarray
        Energy stored in closed contacts; ``K0 (u^2 - gap^2)/2`` for ``acts_on="displacement"``.
    dissipated : ndarray
        Energy dissipated by dampers, hysteretic springs and springpots since t = 0.
    work : ndarray
        Work done by all loads since t = 0.
    start : float
        Total energy at t = 0.

    Notes
    -----
    `total` is the sum of the first three. `balance` is the energy that is missing,
    and `balance_error` is its largest magnitude divided by the largest energy.

    Between the steps of a stepping method states are interpolated, and the balance there contains the error of the
    interpolation. To see the balance of the method itself, give `times` that lie on steps, or none. Steps that follow
    ``tol=`` have times of their own.
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
        """The energy that is missing from the balance in J: ``total - start + dissipated - work``."""
        return self.total - self.start + self.dissipated - self.work

    @property
    def balance_error(self) -> float:
        """The largest magnitude of `balance`, divided by the largest energy."""
        parts = (self.total, self.dissipated, self.work)
        scale = max((float(np.max(np.abs(part), initial=0.0)) for part in parts), default=0.0)
        return float(np.max(np.abs(self.balance), initial=0.0)) / scale if scale > 0 else 0.0
