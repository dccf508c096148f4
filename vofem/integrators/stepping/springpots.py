"""Springpots in compiled form: forces affine in the motion of a step, with a past that is a few decaying numbers.

The kernel of a springpot is a sum of exponentials with positive weights, so a
springpot is a row of Maxwell elements, springs and dashpots in series, of which
number k holds the force ``weight y_k``, ``y_k' = u' - rate_k y_k``. Elements
that are faster than any step act through two sums. Over a step the rate of
elongation is taken to be constant, p; the mean force over the step is then
``slope p + rest``, without error but for that, and the work ``mean p dt`` is
what the elements take: some of it they hold, the rest they lose, and no step
makes any. Nothing but `carry_on` changes the past.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.stepping.laws import Laws
from vofem.integrators.stepping.record import Output
from vofem.linalg.jit import jit

Array = NDArray[np.float64]


class Pace(NamedTuple):
    """What a step of size dt does to the numbers y that keep a past; arrays of shape (k,).

    ``decay y + gain p`` is y at its end, ``old y + new p`` its mean.
    """

    dt: float
    decay: Array
    gain: Array
    old: Array
    new: Array


class Springpots(NamedTuple):
    """Springpots at some steps.

    Attributes
    ----------
    row : int
        Number of the first one among all laws.
    weight : ndarray, shape (n, n_steps, k)
        From y to forces, at the orders of the steps; one step stands for all where no order varies.
    """

    row: int
    weight: Array


class History(NamedTuple):
    """What springpots know of their past.

    Attributes
    ----------
    y : ndarray, shape (n, k)
        The last one is the rate of elongation over the last step, m/s.
    told : ndarray, shape (n, 7)
        Mean force over the last step; force (N), energy held and work absorbed (J) at the last time; the same at the
        time before, up to which results are stored.
    """

    y: Array
    told: Array


MEAN, FORCE, HELD, WORK, BEFORE = 0, 1, 2, 3, 3

#: For systems without springpots.
NO_PACE = Pace(1.0, np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0))
NO_SPRINGPOTS = Springpots(0, np.zeros((0, 1, 0)))
NO_HISTORY = History(np.zeros((0, 0)), np.zeros((0, 7)))


@jit
def count_of(springpots: Springpots) -> int:
    """Return the number of springpots."""
    return springpots.weight.shape[0]


@jit
def affine(springpots: Springpots, pace: Pace, history: History, i: int, s: int) -> tuple[float, float]:
    """Return slope (N s/m) and rest (N) of the mean force of springpot i over step s."""
    s = min(s, springpots.weight.shape[1] - 1)
    slope, rest = 0.0, 0.0
    for k in range(pace.new.size):
        weight = springpots.weight[i, s, k]
        slope += weight * pace.new[k]
        rest += weight * pace.old[k] * history.y[i, k]
    return slope, rest


@jit
def impose(
    springpots: Springpots, pace: Pace, history: History, s: int, laws: Laws, u: Array, ahead: float, share: float
) -> None:
    """Make forces over step s those of the laws, affine in the elongation at its end, for a step that starts at u.

    They are extrapolated from the middles of this step and of the one before, by `ahead` of their distance, and
    divided by the share with which the step weighs forces at its end.
    """
    for i in range(springpots.weight.shape[0]):
        j = springpots.row + i
        slope, rest = affine(springpots, pace, history, i, s)
        laws.table[j]["stiffness"] = (1.0 + ahead) * slope / (share * pace.dt)
        laws.table[j]["gap"] = u[j]
        laws.table[j]["offset"] = ((1.0 + ahead) * rest - ahead * history.told[i, MEAN]) / share


@jit
def carry_on(springpots: Springpots, pace: Pace, history: History, i: int, s: int, rate: float, mean: float) -> None:
    """Make step s, of a rate of elongation and a mean force, part of the past of springpot i."""
    s = min(s, springpots.weight.shape[1] - 1)
    held = 0.0
    for k in range(pace.decay.size):
        y = pace.decay[k] * history.y[i, k] + pace.gain[k] * rate
        history.y[i, k] = y
        held += 0.5 * springpots.weight[i, s, k] * y * y
    history.told[i, MEAN] = mean
    history.told[i, HELD] = held


@jit
def tell_histories(history: History, out: Output, first: int, cursor: int, t: float, dt: float) -> None:
    """Store what springpots did at the wanted times `first` to `cursor`, up to t, which ends a step of size dt.

    They are the last laws in `out.memory`. Values between both ends of the step are interpolated.
    """
    n, told = history.told.shape[0], history.told
    row = out.memory.shape[1] - n
    for c in range(first, cursor):
        x = min(max(1.0 - (t - out.times[c]) / dt, 0.0), 1.0)
        for i in range(n):
            force = (1.0 - x) * told[i, BEFORE + FORCE] + x * told[i, FORCE]
            held = (1.0 - x) * told[i, BEFORE + HELD] + x * told[i, HELD]
            work = (1.0 - x) * told[i, BEFORE + WORK] + x * told[i, WORK]
            out.memory[0, row + i, c] = force
            out.memory[1, row + i, c] = held
            out.memory[2, row + i, c] = work - held
    for i in range(n):
        for what in (FORCE, HELD, WORK):
            told[i, BEFORE + what] = told[i, what]


def absorbed(history: History) -> float:
    """Return the work in J that all springpots have absorbed up to the time to which results are stored."""
    return float(np.sum(history.told[:, BEFORE + WORK]))
