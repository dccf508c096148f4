"""Samples of a run in modes: displacements, velocities and accelerations are computed when they are first needed."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from vofem.arrays import Array, IntArray

#: Numbers of modal samples above which only what is asked for is computed.
_MANY = 2_000_000


class ModalSamples:
    """The motion at some times, each kind computed when it is first needed.

    Displacements and velocities at few times are computed as a whole, so that parts of them have the same bits. At many
    times, or where there are fewer modes than degrees of freedom, only what is asked for is computed.

    `shapes` has shape (n, n_modes).
    `z`, `v` (shape (n_modes, n_times)): modal displacements and velocities.
    `acceleration`: returns the modal accelerations, shape (n_modes, n_times).
    `q`, `v`, `a` have shape (n, n_times).
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
        return self._shapes @ self._rates

    def along(self, rows: Any, kind: str) -> Array:
        """Return ``rows @ q`` (kind "q", or v, a) for rows (k, n)."""
        if not self._fewer:
            return np.asarray(rows @ getattr(self, kind))
        return np.asarray(rows @ self._shapes) @ self._modal(kind)

    @property
    def _fewer(self) -> bool:
        """Whether there are fewer modes than degrees of freedom."""
        return self._shapes.shape[1] < self._shapes.shape[0]

    @cached_property
    def _rates(self) -> Array:
        return self._acceleration()

    def _modal(self, kind: str) -> Array:
        """Return modal samples, shape (n_modes, n_times)."""
        return {"q": self._z, "v": self._v}[kind] if kind != "a" else self._rates

    def take(self, dofs: IntArray) -> _Some:
        """Return the samples of some degrees of freedom."""
        return _Some(self, dofs)

    def last(self) -> tuple[Array, Array]:
        """Return q and v at the last time, each (n,)."""
        if not self._fewer:
            return self.q[:, -1], self.v[:, -1]
        return self._shapes @ self._z[:, -1], self._shapes @ self._v[:, -1]


class _Some(ModalSamples):
    """Some degrees of freedom of samples."""

    def __init__(self, whole: ModalSamples, dofs: IntArray) -> None:
        self._whole, self._dofs = whole, dofs

    def _of(self, kind: str) -> Array:
        whole, modal = self._whole, self._whole._modal(kind)
        few = modal.size <= _MANY or 2 * self._dofs.size > len(whole._shapes) or kind == "a"
        # Of fewer modes parts are always computed apart, so that their bits do not depend on what was asked before.
        if (few or kind in whole.__dict__) and not whole._fewer:
            return np.asarray(getattr(whole, kind)[self._dofs])
        return np.asarray(whole._shapes[self._dofs] @ modal)

    @cached_property
    def q(self) -> Array:
        return self._of("q")

    @cached_property
    def v(self) -> Array:
        return self._of("v")

    @cached_property
    def a(self) -> Array:
        return self._of("a")
