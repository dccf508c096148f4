"""How a perturbation grows along an event-driven run.

Between events a small perturbation follows the free motion of the status; at
an event its velocity jumps, because the perturbed run meets the event at
another time (the saltation, or jump, matrix
``I + (f_after - f_before) grad(s)' / (grad(s)' f_before)``). Both are known in
closed form, so the growth is too.

R. I. Leine, H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical
Systems, Springer 2004, doi:10.1007/978-3-540-44398-8.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.clusters import add_clusters, free_flow
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.integrators.event_driven.spectrum import Spectrum
from vofem.linalg.exponential import oscillator
from vofem.linalg.jit import jit
from vofem.system import CLOSED, OPEN, PINNED, ContactLaws

Array = NDArray[np.float64]
Status = NDArray[np.int64]


class Perturbation:
    """A perturbation that travels along a run: free motion, then the jump of every event.

    Parameters
    ----------
    space : ModalSpace
    laws : ContactLaws, optional
    """

    def __init__(self, space: ModalSpace, laws: ContactLaws | None) -> None:
        self._space = space
        self._laws = laws
        self._frequency = np.sqrt(np.where(space.stiffness > 0, space.stiffness, 1.0))
        # Every mode alike, with phases that favour none; the same in every run.
        phase = 2.0 * np.pi * np.modf(np.arange(1, space.size + 1) * 0.6180339887498949)[0]
        amplitude = 1.0 / np.sqrt(space.size)
        self._z = amplitude * np.cos(phase) / self._frequency
        self._v = amplitude * np.sin(phase)
        self.growth = 0.0

    def drift(self, spectrum: Spectrum, duration: float) -> None:
        """Follow the free motion of a status."""
        z, v = spectrum.to_blocks(self._z, self._v, shifted=False)
        if spectrum.plain is None:
            _drift(spectrum.delta, spectrum.p, z, v, duration)
        else:
            assert spectrum.blocks is not None
            dz, dv = np.zeros((z.size, 1)), np.zeros((z.size, 1))
            add_clusters(free_flow(spectrum.blocks.clusters, z, v), np.array([duration]), dz, dv)
            together = spectrum.plain == 0.0
            z_c, v_c = (z + dz[:, 0])[together], (v + dv[:, 0])[together]
            _drift(spectrum.delta, spectrum.p, z, v, duration)
            z[together], v[together] = z_c, v_c
        self._z, self._v = spectrum.to_modes(z, v, shifted=False)
        self._renormalise()

    def jump(self, events: Sequence[tuple[int, int, int]], velocity: Array) -> None:
        """Pass an event.

        Parameters
        ----------
        events : sequence of (contact, status before, status after)
        velocity : ndarray, shape (n,)
            Modal, of the run at the event.
        """
        assert self._laws is not None
        z, v = self._z.copy(), self._v.copy()
        for j, before, after in events:
            row = self._space.contacts[j]
            if after == PINNED:
                z -= row * (row @ z) / (row @ row)
                v -= row * (row @ v) / (row @ row)
                continue
            speed = row @ velocity
            if before == PINNED or speed == 0.0:
                continue  # the reaction leaves its interval continuously: nothing jumps
            step = self._laws.damping[j] * speed
            if self._laws.jump[j]:
                step += self._laws.stiffness[j] * self._laws.gap[j]
            sign = -1.0 if (before, after) == (OPEN, CLOSED) else 1.0
            v += sign * step * (row @ self._z) / speed * row
        self._z, self._v = z, v
        self._renormalise()

    def _renormalise(self) -> None:
        scaled = self._frequency * self._z
        size = math.sqrt(float(self._v @ self._v + scaled @ scaled))
        if size > 0.0:
            self.growth += math.log10(size)
            self._z, self._v = self._z / size, self._v / size


@jit
def _drift(delta: Array, p: Array, z: Array, v: Array, t: float) -> None:
    for k in range(p.size):
        c, s = oscillator(delta[k], p[k], t)
        z[k], v[k] = c * z[k] + s * (v[k] + delta[k] * z[k]), c * v[k] - s * (p[k] * z[k] + delta[k] * v[k])
