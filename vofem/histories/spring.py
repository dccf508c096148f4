"""The history of a hysteretic spring or a springpot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.histories.run import Run
from vofem.integrators.base import SpringSamples

Array = NDArray[np.float64]


class SpringHistory:
    """The history of a hysteretic spring or a springpot at the times of the run, each array of shape (n_times,).

    Attributes
    ----------
    name : str
    elongation : ndarray
        Elongation ``u_a - u_b`` in m, or in rad for a spring that acts on rotations; for a crushing stop the approach.
    force : ndarray
        Force in N (N m for rotations), positive in tension; for a crushing stop positive when it pushes back.
    stored : ndarray
        Recoverable energy in J. A springpot consists of springs and dashpots in
        series; the energy is that of the springs.
    dissipated : ndarray
        Energy dissipated since t = 0 in J, which is the area of the loops. For a
        springpot whose order varies it is the absorbed work minus `stored`, which
        may fall.
    """

    def __init__(self, run: Run, index: int) -> None:
        self._run, self._index = run, index
        self.name = [name for group in run.model.system.recorded for name in group.names][index]

    def __repr__(self) -> str:
        return f"SpringHistory({self.name!r}, {self.dissipated[-1]:g} J dissipated)"

    @property
    def _samples(self) -> SpringSamples:
        samples = self._run.solution.springs
        assert samples is not None
        return samples

    @property
    def elongation(self) -> Array:
        """Elongation in m, shape (n_times,)."""
        groups, index = list(self._run.model.system.recorded), self._index
        while index >= len(groups[0]):
            index -= len(groups.pop(0))
        return self._run.samples.along(groups[0].rows[[index]], "q")[0]

    @property
    def force(self) -> Array:
        """Force in N, shape (n_times,)."""
        return self._samples.force[self._index]

    @property
    def stored(self) -> Array:
        """Stored energy in J, shape (n_times,)."""
        return self._samples.stored[self._index]

    @property
    def dissipated(self) -> Array:
        """Energy dissipated since t = 0 in J, shape (n_times,)."""
        return self._samples.dissipated[self._index]
