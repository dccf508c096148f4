"""Springpots in compiled steps: internal variables, forces over a step, and their update.

See `springpot` for the elements that a springpot is made of, and `springpot_past` for what a run sets up.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.kernels.jit import jit
from vofem.laws.rows import Rows, dot
from vofem.laws.table import Laws

Array = NDArray[np.float64]


class Update(NamedTuple):
    """The update of the internal variables y over a step of size dt; arrays of shape (k,).

    ``decay y + gain p`` is y at its end, ``old y + new p`` its mean, with the rate of elongation p.
    """

    dt: float
    decay: Array
    gain: Array
    old: Array
    new: Array


class SpringpotState(NamedTuple):
    """Internal variables of springpots.

    Attributes
    ----------
    y : ndarray, shape (n, k)
        Internal variables. The last one is the rate of elongation over the last step, m/s.
    totals : ndarray, shape (n, 7)
        Mean force over the last step; force (N), energy stored and work absorbed (J) at the last time; the same at the
        time before, up to which results are stored.
    """

    y: Array
    totals: Array


MEAN, FORCE, STORED, WORK, BEFORE = 0, 1, 2, 3, 3


class Springpots(NamedTuple):
    """Springpots over some steps of one size.

    Attributes
    ----------
    row : int
        Number of the first one among all laws.
    weight : ndarray, shape (n, n_steps, k)
        Weights with which y gives the forces, at the orders of the steps. If no order varies, there is one entry for
        all steps.
    update : Update
    y, totals : ndarray
        The internal variables, see `SpringpotState`.
    """

    row: int
    weight: Array
    update: Update
    y: Array
    totals: Array


# -- compiled: springpot i over step s --------------------------------------------------------------------


@jit
def affine(pots: Springpots, i: int, s: int) -> tuple[float, float]:
    """Return slope (N s/m) and rest (N) of the mean force of springpot i over step s."""
    s = min(s, pots.weight.shape[1] - 1)
    slope, rest = 0.0, 0.0
    for k in range(pots.update.new.size):
        weight = pots.weight[i, s, k]
        slope += weight * pots.update.new[k]
        rest += weight * pots.update.old[k] * pots.y[i, k]
    return slope, rest


@jit
def set_means(pots: Springpots, s: int, laws: Laws, u: Array) -> None:
    """Let the mean forces of the laws over step s, which starts at u, be those of the springpots."""
    for i in range(pots.weight.shape[0]):
        j = pots.row + i
        slope, rest = affine(pots, i, s)
        # The mean elongation over the step is half of that at its end.
        laws.table[j]["stiffness"] = 2.0 * slope / pots.update.dt
        laws.table[j]["gap"] = u[j]
        laws.table[j]["offset"] = rest


@jit
def set_laws(pots: Springpots, s: int, laws: Laws, u: Array, ahead: float, share: float) -> None:
    """Make forces over step s those of the laws, affine in the elongation at its end, for a step that starts at u.

    They are extrapolated from the middles of this step and of the one before, by `ahead` of their distance, and
    divided by the share with which the step weighs forces at its end.
    """
    for i in range(pots.weight.shape[0]):
        j = pots.row + i
        slope, rest = affine(pots, i, s)
        laws.table[j]["stiffness"] = (1.0 + ahead) * slope / (share * pots.update.dt)
        laws.table[j]["gap"] = u[j]
        laws.table[j]["offset"] = ((1.0 + ahead) * rest - ahead * pots.totals[i, MEAN]) / share


@jit
def carry_on(pots: Springpots, i: int, s: int, rate: float, mean: float) -> None:
    """Update the internal variables of springpot i over step s, of a rate of elongation and a mean force."""
    s = min(s, pots.weight.shape[1] - 1)
    stored = 0.0
    for k in range(pots.update.decay.size):
        y = pots.update.decay[k] * pots.y[i, k] + pots.update.gain[k] * rate
        pots.y[i, k] = y
        stored += 0.5 * pots.weight[i, s, k] * y * y
    pots.totals[i, MEAN] = mean
    pots.totals[i, STORED] = stored


@jit
def carry_all(pots: Springpots, s: int, rows: Rows, reaction: Array, p: Array) -> None:
    """Update all springpots over step s with the reactions and the rate p, whose product is their power."""
    for i in range(pots.y.shape[0]):
        mean, rate = reaction[pots.row + i], dot(rows, pots.row + i, p)
        pots.totals[i, WORK] += pots.update.dt * mean * rate
        carry_on(pots, i, s, rate, mean)


@jit
def mean_of_both(pots: Springpots, reaction: Array, last: float) -> None:
    """Let the force between two steps, the first of a size `last`, be the mean of those over both."""
    for i in range(pots.y.shape[0]):
        if last > 0.0:
            mean, dt = reaction[pots.row + i], pots.update.dt
            pots.totals[i, FORCE] = (dt * pots.totals[i, MEAN] + last * mean) / (dt + last)


@jit
def record_springpots(
    pots: Springpots, times: Array, histories: Array, first: int, cursor: int, t: float, dt: float
) -> None:
    """Record the springpots at the times `first` to `cursor`, to t, the end of a step of size dt.

    They are the last laws in `histories`, shape (3, n_laws, n_times). Values between both ends of the step are
    interpolated.
    """
    n, totals = pots.totals.shape[0], pots.totals
    row = histories.shape[1] - n
    for c in range(first, cursor):
        x = min(max(1.0 - (t - times[c]) / dt, 0.0), 1.0)
        for i in range(n):
            force = (1.0 - x) * totals[i, BEFORE + FORCE] + x * totals[i, FORCE]
            stored = (1.0 - x) * totals[i, BEFORE + STORED] + x * totals[i, STORED]
            work = (1.0 - x) * totals[i, BEFORE + WORK] + x * totals[i, WORK]
            histories[0, row + i, c] = force
            histories[1, row + i, c] = stored
            histories[2, row + i, c] = work - stored
    for i in range(n):
        for what in (FORCE, STORED, WORK):
            totals[i, BEFORE + what] = totals[i, what]
