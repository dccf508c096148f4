"""The problem that all programs solve: the paper's beam on one mesh, as matrices and as numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from cases import paper_beam
from numpy.typing import NDArray

import vofem as vf
from vofem.studies.accuracy.scaled import scaled

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Problem:
    """``M q'' + K q = e (0.1 sin t) + contact``, e the unit vector of the tip's displacement.

    The penetration law: below -gap the stop pushes with stiffness times penetration.
    """

    scene: vf.Scene
    mass: Array
    stiffness: Array
    tip: int
    elements: int
    stop: float
    gap: float
    amplitude: float
    t_end: float
    times: Array

    def reference(self) -> Array:
        """Return the tip's history by event_driven, exact in time on this mesh, shape (n_times,).

        It solves the equations multiplied by 3, so that vofem's own run differs from it by rounding. DOP853, which
        shares nothing with it, comes within 1e-9.
        """
        other = scaled(self.scene)
        assert other is not None
        result = vf.simulate(other, self.t_end, times=self.times)
        return result.displacement(self.scene.contacts[0].a)


def problem(elements: int = 25) -> Problem:
    """Return the paper's beam over 20 s, compared at 1001 times."""
    scene = paper_beam("penetration")(elements)
    system = scene.model.system
    return Problem(
        scene, system.mass.toarray(), system.stiffness.toarray(), system.size - 2, elements, 1.0, 0.03, 0.1, 20.0,
        np.linspace(0.0, 20.0, 1001),
    )  # fmt: skip
