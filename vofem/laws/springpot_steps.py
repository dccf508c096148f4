"""Springpots in compiled steps: internal variables, forces over a step, and their update.

See `springpot` for the elements that a springpot is made of, and `springpot_past` for what a run sets up.
"""

from __future__ import annotations

from typing import NamedTuple

from vofem.arrays import Array
from vofem.kernels.jit import jit
from vofem.laws.law import FIRST, Laws, Way


class Update(NamedTuple):
    """The update of the internal variables y over a step of size dt; arrays of shape (k,).

    ``decay y + gain p`` is y at its end, ``old y + new p`` its mean, with the rate of elongation p.
    """

    dt: float
    decay: Array
    gain: Array
    old: Array
    new: Array


class Springpots(NamedTuple):
    """Springpots over some steps of one size."""

    row: int  #: Number of the first one among all laws.
    #: Weights with which y gives the forces, at the orders of the steps. If no order varies, there is one entry for all
    #: steps. Shape (n, n_steps, k).
    weight: Array
    update: Update
    y: Array  #: Internal variables. The last one is the rate of elongation over the last step, m/s. Shape (n, k).


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
def begin_springpots(
    pots: Springpots, s: int, laws: Laws, way: Way, known: Array, u0: Array, u1: Array, r1: Array
) -> None:  # fmt: skip
    """Enter the numbers of springpots over step s, which starts at u0, into the laws.

    In explicit steps the force at the end is the mean of those over the steps on both sides. Such a step is at its end
    already: its coordinates are u1, and its rates r1 without the acceleration that is to be found. Other steps that do
    not act by means extrapolate the force to the time of balance, like that of dampers.

    `known` (shape (n_steps + 1, n, 2)): mean forces over steps, N, and energies stored at their ends, J; those of step
    s are in row ``s + 1``.
    """
    for i in range(pots.y.shape[0]):
        j = pots.row + i
        slope, rest = affine(pots, i, s)
        numbers = laws.parameters[laws.table[j, FIRST] : laws.table[j, FIRST] + 4]
        numbers[2] = u0[j]
        if way.explicit:
            rate = (u1[j] - u0[j]) / way.dt
            mean = slope * rate + rest
            known[s + 1, i, 0], known[s + 1, i, 1] = mean, _carry_on(pots, i, s, rate)
            slope, rest = affine(pots, i, s + 1)
            numbers[1], numbers[3] = 0.0, slope
            numbers[0] = 0.5 * (mean + rest - slope * r1[j])
        else:
            # The mean elongation over the step is half of that at its end.
            numbers[1] = (2.0 if way.mean else 1.0) * way.now * slope / way.dt
            numbers[0] = way.now * rest - way.before * known[s, i, 0]


@jit
def end_springpots(
    pots: Springpots, s: int, way: Way, known: Array, u0: Array, u1: Array, reaction: Array
) -> None:  # fmt: skip
    """Update springpots over step s from u0 to u1 with the reactions of laws; see `begin_springpots`."""
    if way.explicit:
        return
    for i in range(pots.y.shape[0]):
        j = pots.row + i
        known[s + 1, i, 0] = (reaction[j] + way.before * known[s, i, 0]) / way.now
        known[s + 1, i, 1] = _carry_on(pots, i, s, (u1[j] - u0[j]) / way.dt)
        if not way.mean:
            # In the next step the law acts by its mean alone.
            reaction[j] = 0.0


@jit
def _carry_on(pots: Springpots, i: int, s: int, rate: float) -> float:
    """Update the internal variables of springpot i over step s of a rate of elongation; return the energy stored, J."""
    s = min(s, pots.weight.shape[1] - 1)
    stored = 0.0
    for k in range(pots.update.decay.size):
        y = pots.update.decay[k] * pots.y[i, k] + pots.update.gain[k] * rate
        pots.y[i, k] = y
        stored += 0.5 * pots.weight[i, s, k] * y * y
    return stored
