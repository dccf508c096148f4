"""Stroboscopic samples of a run, one in each period: Poincare sections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vofem._validate import number, whole
from vofem.arrays import Array
from vofem.blas import one_thread
from vofem.errors import ArgumentError
from vofem.result import Result

#: Fraction of a period by which the end of a run may miss the last sample.
_SLACK = 1e-9


@dataclass(eq=False, repr=False)
class PoincareSection:
    """Stroboscopic samples of a run: its states at one phase of every period.

    Attributes
    ----------
    result : Result
    period : float
        Time between two samples in s.
    phase : float
        Phase of the samples in rad.
    times : ndarray, shape (n_samples,)
        Times of the samples in s, as times of the run.
    """

    result: Result
    period: float
    phase: float
    times: Array

    def __len__(self) -> int:
        return int(self.times.size)

    def __repr__(self) -> str:
        return f"PoincareSection({len(self)} samples, one every {self.period:.9g} s)"

    @one_thread
    def displacement(self, point: Any) -> Array:
        """Return the displacements of a point in m, shape (n_samples,)."""
        return self.result.displacement(point, self.times)

    @one_thread
    def velocity(self, point: Any) -> Array:
        """Return the velocities of a point in m/s, shape (n_samples,)."""
        return self.result.velocity(point, self.times)


@one_thread
def poincare(result: Result, period: float, *, phase: float = 0.0, skip: int = 0) -> PoincareSection:
    """Return stroboscopic samples of a run: its states at one phase of every period.

    Runs of event_driven are evaluated exactly at these times. Runs of methods that step in time are interpolated
    between neighbouring steps. This needs every step, so do not give ``times=`` to `vofem.simulate`.

    Parameters
    ----------
    result : Result
    period : float
        Time between two samples in s, usually the period of the loads.
    phase : float
        Phase in rad. Samples are taken where ``2 pi t/period`` equals this phase up to a multiple of 2 pi. Here t is
        the time of the loads, which is the time of the run plus its `t_start`.
    skip : int
        Number of samples at the beginning that are left out, while the motion settles.

    Returns
    -------
    PoincareSection

    Raises
    ------
    ArgumentError
        For arguments out of range, or a run that is shorter than a period or has no sample.

    Examples
    --------
    >>> import numpy as np
    >>> import vofem as vf
    >>> mass = vf.Mass(1.0, stiffness=1.0, damping=0.1)
    >>> run = vf.simulate(vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(1.0, omega=2.0))]), 100.0)
    >>> len(vf.poincare(run, period=np.pi, skip=20))
    11
    """
    if not isinstance(result, Result):
        raise ArgumentError(f"poincare: result is {result!r}, expected what vofem.simulate returns")
    period = number("poincare: period", period, positive=True)
    phase = number("poincare: phase", phase)
    skip = whole("poincare: skip", skip, least=0)
    end = float(result.solution.t_end)
    if period > end * (1.0 + _SLACK):
        raise ArgumentError(
            f"poincare: period is {period:g} s, but the run lasts {end:g} s, so no motion is sampled twice; give the "
            "period in s, not a frequency, or simulate longer"
        )
    offset = phase / (2.0 * np.pi)
    first = int(np.ceil(result.t_start / period - offset - _SLACK))
    last = int(np.floor((result.t_start + end) / period - offset + _SLACK))
    times = np.clip((np.arange(first, last + 1) + offset) * period - result.t_start, 0.0, end)[skip:]
    if not times.size:
        raise ArgumentError(
            f"poincare: the run of {end:g} s has {max(last + 1 - first, 0)} samples a period of {period:g} s apart, of "
            f"which skip = {skip} are left out, so none is left; simulate longer or skip less"
        )
    return PoincareSection(result, period, phase, times)
