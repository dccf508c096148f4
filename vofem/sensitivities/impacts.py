"""Derivatives of what an impact on a rigid stop does to velocities.

With the inverse mass W, the rows H of what is hit and ``G = H W H'``, the velocity after it is
``v - (1 + e) W H' G^-1 H v``. In modes W is the identity, and its derivatives are those of the mass, with the other
sign.
"""

from __future__ import annotations

import numpy as np

from vofem.arrays import Array
from vofem.integrators.event_driven.tangent import Passage
from vofem.sensitivities.modal import ModalChange
from vofem.system import PINNED


class Impact:
    """What events do to the velocity (n,) before them: an impact on one rigid stop, or on all that is pinned then."""

    def __init__(self, passage: Passage, velocity: Array) -> None:
        self.contacts, self.rows, self.velocity = passage.restrained, passage.held, velocity
        self._factor, self._bounces = passage.factor, bool(np.any(passage.after[self.contacts] != PINNED))
        self._gram = np.linalg.inv(self.rows @ self.rows.T)
        self._force = self._gram @ (self.rows @ velocity)

    def by(self, change: ModalChange) -> tuple[Array, Array]:
        """Return the derivatives of the velocity after it (n,) and of its impulses (k,) at a fixed velocity before."""
        inverse = np.zeros((self.velocity.size,) * 2) if change.mass is None else -change.mass
        moved = np.zeros_like(self.rows) if change.contacts is None else change.contacts[self.contacts]
        gram = moved @ self.rows.T + self.rows @ inverse @ self.rows.T + self.rows @ moved.T
        # What rests after ever smaller bounces has no derivative by a restitution of zero.
        bounce = float(change.change.restitution[self.contacts[0]]) if self._bounces else 0.0
        impulse = bounce * self._force + self._factor * self._gram @ (moved @ self.velocity - gram @ self._force)
        turned = self._factor * (inverse @ self.rows.T + moved.T) @ self._force
        return -turned - self.rows.T @ impulse, impulse

    def impulses(self, velocities: Array) -> Array:
        """Return the impulses (k, p) that belong to velocities before (n, p)."""
        return np.asarray(self._factor * self._gram @ (self.rows @ velocities))
