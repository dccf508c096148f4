"""Samples of a run in modes: displacements, velocities and accelerations are computed when they are first needed."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Numbers of modal samples above which only what is asked for is computed.
_MANY = 2_000_000


class ModalSamples:
    """The motion at some times, each kind computed when it is first needed.

    Displacements and velocities at few times are computed as a whole, so that parts of them have the same bits. At many
    times only those of the degrees of freedom that are asked for are computed.

    Parameters
    ----------
    shapes : ndarray, shape (n, n_modes)
    z, v : ndarray, shape (n_modes, n_times)
        Modal displacements and velocities.
    acceleration : callable
        Returns the modal accelerations, shape (n_modes, n_times).

    Attributes
    ----------
    q, v, a : ndarray, shape (n, n_times)
    """

    def __init__(self, shapes: Array, z: Array, v: Array, acceleration: Callable[[], Array]) -> None:
        self._shapes, self._z, self._v = shapes, z, v
        self._acceleration = acceleration

    @cached_property
    def q(self) -> Array:
        """Displacements."""
        return self._shapes @ self._z

    @cached_property
    def v(self) -> Array:
        """Velocities."""
        return self._shapes @ self._v

    @cached_property
    def a(self) -> Array:
        """Accelerations, those of the equation of motion."""
        return self._shapes @ self._acceleration()

    def along(self, rows: Any, kind: str) -> Array:
        """Return ``rows @ q`` (kind "q", or v, a) for rows (k, n)."""
        return np.asarray(rows @ getattr(self, kind))

    def take(self, dofs: IntArray) -> _Some:
        """Return the samples of some degrees of freedom."""
        return _Some(self, dofs)

    def last(self) -> tuple[Array, Array]:
        """Return q and v at the last time, each (n,)."""
        return self.q[:, -1], self.v[:, -1]


class _Some(ModalSamples):
    """Some degrees of freedom of samples."""

    def __init__(self, whole: ModalSamples, dofs: IntArray) -> None:
        self._whole, self._dofs = whole, dofs

    def _of(self, kind: str, modal: Array) -> Array:
        whole = self._whole
        if modal.size <= _MANY or 2 * self._dofs.size > modal.shape[0] or kind in whole.__dict__:
            return np.asarray(getattr(whole, kind)[self._dofs])
        return np.asarray(whole._shapes[self._dofs] @ modal)

    @cached_property
    def q(self) -> Array:
        return self._of("q", self._whole._z)

    @cached_property
    def v(self) -> Array:
        return self._of("v", self._whole._v)

    @cached_property
    def a(self) -> Array:
        return self._whole.a[self._dofs]
