"""One step of the midpoint rule in compiled form, and what happens when it is accepted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.stepping.balance import Structure, balance
from vofem.integrators.stepping.recall import remember, tell_histories
from vofem.integrators.stepping.record import Output, Trail, leave, log_event, store, switched
from vofem.laws.evaluate import closed_share, commit_all
from vofem.laws.rows import Rows, dot, subtract_row
from vofem.laws.springpot import (
    FORCE,
    MEAN,
    WORK,
    History,
    Pace,
    Springpots,
    carry_on,
)
from vofem.laws.table import Laws
from vofem.linalg.banded import solve, subtract_product
from vofem.linalg.jit import jit

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: A correction of p above this fraction of it is corrected again.
_SMALL = 2.0**-6


class Matrices(NamedTuple):
    """Bands of M, K and C (no rows where undamped)."""

    mass: Array
    stiffness: Array
    damping: Array


class Factored(NamedTuple):
    """Of a step size dt: the structure of ``A = M + dt C/2 + dt^2 K/4``."""

    dt: float
    structure: Structure


class State(NamedTuple):
    """Where a run stands.

    Attributes
    ----------
    q, v : ndarray, shape (n,)
    acceleration, mean : ndarray, shape (n,)
        Mean acceleration and mean velocity of the last step.
    expected : ndarray, shape (n,)
        Mean velocity expected of the next step.
    u, reaction : ndarray, shape (n_laws,)
        Coordinates of the laws, and their forces over the last step.
    status : ndarray of int, shape (n_contacts,)
    width : ndarray, shape (1,)
        Size of the last step in s; 0 at the start.
    memory : ndarray
        State of the laws with memory.
    """

    q: Array
    v: Array
    acceleration: Array
    mean: Array
    expected: Array
    u: Array
    reaction: Array
    status: IntArray
    width: Array
    memory: Array


class Scratch(NamedTuple):
    """Work space: of n unknowns, and of m laws."""

    change: Array
    right: Array
    work: Array
    base: Array
    ahead: Array
    none: Array
    held: Array


def scratch(n: int, m: int) -> Scratch:
    """Return work space for n unknowns and m laws."""
    return Scratch(np.empty(n), np.empty(n), np.empty(n), np.empty(m), np.empty(m), np.zeros(m), np.empty(m))


@jit
def step(
    matrices: Matrices, factored: Factored, rows: Rows, laws: Laws, load: Array, q: Array, v: Array, u: Array, p: Array,
    reaction: Array, space: Scratch,
) -> int:  # fmt: skip
    """Find the mean velocity p and the reactions of a step from (q, v), from guesses of both.

    Returns
    -------
    found : int
        0 without, 1 with reactions; negative where there is no solution.
    """
    n, m, dt = q.size, u.size, factored.dt
    change, right = space.change, space.right
    found, none = 0, space.none
    _residual(matrices, dt, load, q, v, p, space.work, right)
    if m > 0:
        _coordinates(rows, u, p, dt, space.base)
        found = balance(
            laws, factored.structure, rows, right, none, space.base, u, True, 1.0 / dt, none, reaction, space.ahead,
            change,
        )  # fmt: skip
        if found < 0:
            return found
        found = min(found, 1)
    else:
        change[:] = right
        solve(factored.structure.factored, change)
    moved, size = 0.0, 0.0
    for i in range(n):
        p[i] += change[i]
        moved, size = max(moved, abs(change[i])), max(size, abs(p[i]))
    if moved <= _SMALL * size:
        return found
    _residual(matrices, dt, load, q, v, p, space.work, right)
    if found:
        # Reactions too: where the step would go without any, told from where it stands.
        _react(rows, reaction, 0.5 * dt, right)
        _coordinates(rows, u, p, dt, space.base)
        space.held[:] = reaction
        if balance(
            laws, factored.structure, rows, right, space.held, space.base, u, True, 1.0 / dt, none, reaction,
            space.ahead, change,
        ) < 0:  # fmt: skip
            return -1
    else:
        change[:] = right
        solve(factored.structure.factored, change)
    for i in range(n):
        p[i] += change[i]
    return found


@jit
def _coordinates(rows: Rows, u: Array, p: Array, dt: float, base: Array) -> None:
    """Fill `base` with where a mean velocity p takes the laws' coordinates."""
    for j in range(u.size):
        base[j] = u[j] + dt * dot(rows, j, p)


@jit
def accept(
    matrices: Matrices, rows: Rows, laws: Laws, load: Array, loaded: bool, t: float, dt: float, p: Array,
    state: State, before: Trail, out: Output, cursor: int, events: Array, happened: int, space: Scratch,
) -> tuple[int, Array, int]:  # fmt: skip
    """Take the step of size dt from t with mean velocity p; return cursor, events and their number.

    The state at t is stored only now: its acceleration is that between the
    middles of the steps on both sides.
    """
    n, q, v, now, last = state.q.size, state.q, state.v, space.right, state.width[0]
    for i in range(n):
        rate = 2.0 * (p[i] - v[i]) / dt
        now[i] = rate if last == 0.0 else (dt * state.acceleration[i] + last * rate) / (dt + last)
        state.acceleration[i] = rate
    wanted = cursor
    if out.every_step or (cursor < out.times.size and out.times[cursor] <= t + 1e-9 * dt):
        cursor = store(out, cursor, t, last if last > 0.0 else dt, last == 0.0, before, q, v, now)
    if state.memory.size > 0:
        remember(laws, before.memory, rows, out, wanted, cursor)
        before.memory[:] = state.memory
    leave(before, q, v, now)
    taken = 0.0
    if matrices.damping.shape[0] > 0:
        space.work[:] = 0.0
        subtract_product(matrices.damping, p, space.work)
        taken -= dt * np.dot(space.work, p)
    if loaded:
        before.work[0] += dt * np.dot(load, p)
    for i in range(n):
        q[i] += dt * p[i]
        v[i] = 2.0 * p[i] - v[i]
    for i in range(n):
        gain = p[i] - state.mean[i] if last == dt else (0.0 if last == 0.0 else (p[i] - state.mean[i]) * dt / last)
        state.mean[i] = p[i]
        state.expected[i] = p[i] + gain
    for j in range(state.u.size):
        u1 = dot(rows, j, q)
        if laws.table[j]["damping"] > 0.0:
            taken += laws.table[j]["damping"] / dt * closed_share(laws, j, state.u[j], u1) * (u1 - state.u[j])
        if j < state.status.size:
            s = u1 - laws.table[j]["gap"]
            if switched(s, state.status[j]):
                events = log_event(events, happened, j, t + dt, dt, state.u[j] - laws.table[j]["gap"], s)
                state.status[j] = int(events[happened, 2])
                happened += 1
        state.u[j] = u1
    if state.memory.size > 0:
        commit_all(laws, state.u)
    before.dissipated[0] += taken
    state.width[0] = dt
    return cursor, events, happened


@jit
def accept_history(
    springpots: Springpots, pace: Pace, history: History, rows: Rows, reaction: Array, s: int, t: float, last: float,
    p: Array, out: Output, first: int, cursor: int,
) -> None:  # fmt: skip
    """Take step s from t, after one of size `last`, as `accept` did; tell of the times up to t that it has stored.

    The force at t is the mean of those of the steps on both sides, as the acceleration is.
    """
    told = history.told
    for i in range(told.shape[0]):
        if last > 0.0:
            mean = reaction[springpots.row + i]
            told[i, FORCE] = (pace.dt * told[i, MEAN] + last * mean) / (pace.dt + last)
    tell_histories(history, out, first, cursor, t, last if last > 0.0 else pace.dt)
    for i in range(told.shape[0]):
        mean, rate = reaction[springpots.row + i], dot(rows, springpots.row + i, p)
        told[i, WORK] += pace.dt * mean * rate
        carry_on(springpots, pace, history, i, s, rate, mean)


@jit
def combine(loads: Array, values: Array, load: Array) -> None:
    """Fill the load vector from the values of the loads' functions."""
    for k in range(loads.shape[0]):
        for i in range(load.size):
            load[i] = loads[k, i] * values[k] if k == 0 else load[i] + loads[k, i] * values[k]


@jit
def _residual(
    matrices: Matrices, dt: float, load: Array, q: Array, v: Array, p: Array, work: Array, right: Array
) -> None:
    """Fill `right` with what the equation of a step leaves at a mean velocity p, reactions left out."""
    n = q.size
    for i in range(n):
        right[i] = load[i]
        work[i] = q[i] + 0.5 * dt * p[i]
    subtract_product(matrices.stiffness, work, right)
    if matrices.damping.shape[0] > 0:
        subtract_product(matrices.damping, p, right)
    for i in range(n):
        right[i] *= 0.5 * dt
        work[i] = p[i] - v[i]
    subtract_product(matrices.mass, work, right)


@jit
def _react(rows: Rows, reaction: Array, factor: float, y: Array) -> None:
    for j in range(reaction.size):
        if reaction[j] != 0.0:
            subtract_row(rows, j, factor * reaction[j], y)
