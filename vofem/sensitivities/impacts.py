"""Derivatives of what an impact on a rigid stop does to velocities.

With the inverse mass W, the rows H of what is hit and ``G = H W H'``, the velocity after it is
``v - (1 + e) W H' G^-1 H v``. In modes W is the identity, and its derivatives are those of the mass, with the other
sign.
"""

from __future__ import annotations

import numpy as np

from vofem.arrays import Array
from vofem.sensitivities.modal import ModalChange


class Impact:
    """An impact on one rigid stop, or on everything that is pinned from then on.

    `contacts` are the numbers of what is hit, `rows` its modal rows (k, n), and `velocity` (n,) is that before.
    """

    def __init__(self, contacts: list[int], rows: Array, restitution: float, velocity: Array) -> None:
        self.contacts, self.rows, self.velocity, self._factor = contacts, rows, velocity, 1.0 + restitution
        self._gram = np.linalg.inv(rows @ rows.T)
        self._force = self._gram @ (rows @ velocity)

    def by(self, change: ModalChange) -> tuple[Array, Array]:
        """Return the derivatives of the velocity after it (n,) and of its impulses (k,) at a fixed velocity before."""
        inverse = np.zeros((self.velocity.size,) * 2) if change.mass is None else -change.mass
        moved = np.zeros_like(self.rows) if change.contacts is None else change.contacts[self.contacts]
        gram = moved @ self.rows.T + self.rows @ inverse @ self.rows.T + self.rows @ moved.T
        bounce = float(change.change.restitution[self.contacts[0]])
        impulse = bounce * self._force + self._factor * self._gram @ (moved @ self.velocity - gram @ self._force)
        turned = self._factor * (inverse @ self.rows.T + moved.T) @ self._force
        return -turned - self.rows.T @ impulse, impulse

    def impulses(self, velocities: Array) -> Array:
        """Return the impulses (k, p) that belong to velocities before (n, p)."""
        return np.asarray(self._factor * self._gram @ (self.rows @ velocities))
