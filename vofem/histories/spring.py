"""A hysteretic spring, or a springpot: its force, its loops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.histories.run import Run
from vofem.integrators.base import SpringSamples

Array = NDArray[np.float64]


class SpringHistory:
    """One hysteretic spring, or springpot, along a run; histories at the run's times, each of shape (n_times,).

    Attributes
    ----------
    name : str
    elongation : ndarray
        ``u_a - u_b`` in m, in rad of a spring in rotation; of a crushing stop the approach.
    force : ndarray
        In N (N m in rotation), positive in tension; of a crushing stop positive where it pushes back.
    stored : ndarray
        Energy that would be given back, J. Of a springpot, which is a row of
        springs and dashpots in series: that of its springs.
    dissipated : ndarray
        Energy lost since t = 0, J: the area of the loops. Of a springpot whose
        order varies, work absorbed less `stored`: it may fall.
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
        """Energy lost since t = 0, J, shape (n_times,)."""
        return self._samples.dissipated[self._index]
