"""The history of a hysteretic spring or a springpot."""

from __future__ import annotations

import itertools

import numpy as np

from vofem.arrays import Array
from vofem.histories.motion import Motion
from vofem.histories.table import Table
from vofem.integrators.base import SpringSamples


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
        Energy dissipated since t = 0 in J, which is the area of the loops. For a springpot whose order varies it is the
        absorbed work minus `stored`, which may fall.
    """

    def __init__(self, run: Motion, index: int) -> None:
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

    def cycles(self) -> Table:
        """Return what every cycle loses, and the linear spring and damper that would lose as much.

        A cycle lasts from one passage of the elongation upward through its mean to the next one, as the stored times
        show them. Choose times that resolve it. Of an oscillator that rests on the spring alone, ``damping_ratio`` is
        the ratio of critical damping that takes the same energy in a cycle of the same amplitude:
        ``loss/(2 pi k amplitude^2)`` with the secant stiffness ``k``.

        Returns
        -------
        Table
            Columns ``time`` (end of the cycle, s), ``amplitude`` (half of the range of the elongation, m), ``loss``
            (J), ``stiffness`` (range of the force over that of the elongation, N/m) and ``damping_ratio``.
        """
        u, force, lost = self.elongation, self.force, self.dissipated
        passages = np.flatnonzero((u[:-1] < u.mean()) & (u[1:] >= u.mean()))
        rows = []
        for first, last in itertools.pairwise(passages.tolist()):
            part = slice(first, last + 1)
            amplitude, loss = 0.5 * float(np.ptp(u[part])), float(lost[last] - lost[first])
            stiffness = 0.5 * float(np.ptp(force[part])) / amplitude
            ratio = loss / (2.0 * np.pi * stiffness * amplitude**2) if stiffness > 0.0 else np.nan
            rows.append((self._run.times[last], amplitude, loss, stiffness, ratio))
        columns = np.array(rows, dtype=float).reshape(-1, 5).T
        units = {"time": "s", "amplitude": "m", "loss": "J", "stiffness": "N/m", "damping_ratio": ""}
        return Table(
            {name: (column, unit) for (name, unit), column in zip(units.items(), columns, strict=True)},
            f"Cycles of {self.name!r}",
        )

    @property
    def stored(self) -> Array:
        """Stored energy in J, shape (n_times,)."""
        return self._samples.stored[self._index]

    @property
    def dissipated(self) -> Array:
        """Energy dissipated since t = 0 in J, shape (n_times,)."""
        return self._samples.dissipated[self._index]
