"""One step of the midpoint rule in compiled form, and what happens when it is accepted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.stepping.balance import Structure, balance
from vofem.integrators.stepping.checks import look
from vofem.integrators.stepping.recall import remember, tell_histories
from vofem.integrators.stepping.record import Output, Trail, leave, log_event, rounding, store, switched
from vofem.integrators.stepping.setting import Matrices
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
from vofem.system import CLOSED

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Ratio of the sizes of two steps above which the motion between them is not taken for smooth.
_UNEVEN = 4.0

#: A correction of p above this fraction of it is corrected again.
_SMALL = 2.0**-6


class Factored(NamedTuple):
    """Factored matrices of one step size dt: the structure with ``A = M + dt C/2 + dt^2 K/4``, and responses to loads.

    Attributes
    ----------
    dt : float
    structure : Structure
    loads : ndarray, shape (2 n_loads, n)
        Vectors F of the loads, and ``dt^2 K A^-1 F/2``.
    shift, inertia : ndarray, shape (n_loads, n)
        ``dt A^-1 F`` and M times it.
    """

    dt: float
    structure: Structure
    loads: Array
    shift: Array
    inertia: Array


class Forcing(NamedTuple):
    """All loads over a step, each of shape (n,).

    Attributes
    ----------
    load : ndarray
        Their mean, less the stiffness force on the motion that they cause within the step.
    push : ndarray
        The load in the equation of the mean rate of displacement: `load` less ``2 inertia/dt``.
    shift, inertia : ndarray
        Mean velocity less the mean rate of displacement, m/s, and M times it.
    """

    load: Array
    push: Array
    shift: Array
    inertia: Array


class State(NamedTuple):
    """The current state of a run.

    Attributes
    ----------
    q, v : ndarray, shape (n,)
    acceleration, mean : ndarray, shape (n,)
        Mean acceleration and mean velocity of the last step.
    expected : ndarray, shape (n,)
        Extrapolated mean velocity of the next step.
    u, reaction : ndarray, shape (n_laws,)
        Coordinates of the laws, and their forces over the last step.
    status : ndarray of int, shape (n_contacts,)
    width : ndarray, shape (2,)
        Size of the last step in s, 0 at the start; and whether a contact closed or opened in it.
    memory : ndarray
        Internal variables of the hysteretic laws.
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
    matrices: Matrices, factored: Factored, rows: Rows, laws: Laws, push: Array, q: Array, v: Array, u: Array, p: Array,
    reaction: Array, space: Scratch,
) -> int:  # fmt: skip
    """Find the rate p of the displacement and the reactions of a step from (q, v), from guesses of both.

    Returns
    -------
    found : int
        0 without, 1 with reactions; negative where there is no solution.
    """
    n, m, dt = q.size, u.size, factored.dt
    change, right = space.change, space.right
    found, none = 0, space.none
    _residual(matrices, dt, push, q, v, p, space.work, right)
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
    _residual(matrices, dt, push, q, v, p, space.work, right)
    if found:
        # Reactions are corrected too: first the coordinates that the step would reach without reactions.
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
    """Fill `base` with the laws' coordinates at the end of a step of mean velocity p."""
    for j in range(u.size):
        base[j] = u[j] + dt * dot(rows, j, p)


@jit
def _switches(rows: Rows, laws: Laws, dt: float, p: Array, state: State) -> bool:
    """Return whether a contact that acts in a step of mean velocity p closes or opens in it."""
    for j in range(state.status.size):
        if state.reaction[j] != 0.0 or state.status[j] == CLOSED:
            s = state.u[j] + dt * dot(rows, j, p) - laws.table[j]["gap"]
            if switched(s, state.status[j]):
                return True
    return False


@jit
def accept(
    matrices: Matrices, rows: Rows, laws: Laws, forcing: Forcing, loaded: bool, t: float, dt: float, p: Array,
    state: State, before: Trail, out: Output, cursor: int, events: Array, happened: int, space: Scratch,
) -> tuple[int, Array, int]:  # fmt: skip
    """Take the step of size dt from t with the displacement's rate p; return cursor, events and their number.

    The state at t is stored only now, because its acceleration is the change of
    mean velocity between the steps on both sides. Where a contact closes or opens
    in one of these steps, the acceleration of the other step is used. Where one
    step is much longer, the interpolation within it does not use the short one.
    """
    n, q, v, last = state.q.size, state.q, state.v, state.width[0]
    now, arriving, leaving = space.right, space.change, space.work
    turned, turns = state.width[1] != 0.0, _switches(rows, laws, dt, p, state)
    for i in range(n):
        rate, held = 2.0 * (p[i] + forcing.shift[i] - v[i]) / dt, state.acceleration[i]
        between = rate if last == 0.0 else (dt * held + last * rate) / (dt + last)
        now[i] = between if turned == turns else (rate if turned else held)
        if last == 0.0:
            now[i] = rate
        arriving[i] = held if turned or turns or last > _UNEVEN * dt else between
        leaving[i] = rate if turned or turns or dt > _UNEVEN * last else between
        state.acceleration[i] = rate
    wanted = cursor
    if out.every_step or (cursor < out.times.size and out.times[cursor] <= t + 1e-9 * dt):
        cursor = store(out, cursor, t, last if last > 0.0 else dt, last == 0.0, before, q, v, now, arriving)
    if state.memory.size > 0:
        remember(laws, before.memory, rows, out, wanted, cursor)
        before.memory[:] = state.memory
    look(out.watch, rows, last, q, v)
    leave(before, q, v, leaving)
    taken = 0.0
    if matrices.damping.shape[0] > 0:
        space.work[:] = 0.0
        subtract_product(matrices.damping, p, space.work)
        taken -= dt * np.dot(space.work, p)
    if loaded:
        before.work[0] += dt * (np.dot(forcing.load, p) + np.dot(forcing.inertia, state.acceleration))
    for i in range(n):
        q[i] += dt * p[i]
        v[i] = 2.0 * (p[i] + forcing.shift[i]) - v[i]
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
            if switched(s, state.status[j], rounding(rows, j, laws.table[j]["gap"], q, before)):
                events = log_event(events, happened, j, t + dt, dt, state.u[j] - laws.table[j]["gap"], s)
                state.status[j] = int(events[happened, 2])
                happened += 1
        state.u[j] = u1
    if state.memory.size > 0:
        commit_all(laws, state.u)
    before.dissipated[0] += taken
    state.width[0], state.width[1] = dt, 1.0 if turns else 0.0
    return cursor, events, happened


@jit
def accept_history(
    springpots: Springpots, pace: Pace, history: History, rows: Rows, reaction: Array, s: int, t: float, last: float,
    p: Array, out: Output, first: int, cursor: int,
) -> None:  # fmt: skip
    """Update springpots over step s from t, after one of size `last`; record them at the stored times up to t.

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


def forcing(n: int) -> Forcing:
    """Return the loads of n unknowns before the first step."""
    return Forcing(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n))


@jit
def combine(factored: Factored, values: Array, total: Forcing) -> None:
    """Fill the loads of a step from their moments: all m0, then all -m2, then all m1."""
    loads = factored.shift.shape[0]
    if loads == 0:
        return
    _add(factored.loads, values[: 2 * loads], total.load)
    _add(factored.shift, values[2 * loads :], total.shift)
    _add(factored.inertia, values[2 * loads :], total.inertia)
    for i in range(total.push.size):
        total.push[i] = total.load[i] - 2.0 * total.inertia[i] / factored.dt


@jit
def _add(vectors: Array, values: Array, total: Array) -> None:
    """Fill `total` with the sum of vectors times values."""
    total[:] = 0.0
    for k in range(values.size):
        if values[k] != 0.0:
            for i in range(total.size):
                total[i] += vectors[k, i] * values[k]


@jit
def _residual(
    matrices: Matrices, dt: float, push: Array, q: Array, v: Array, p: Array, work: Array, right: Array
) -> None:
    """Fill `right` with the residual of the equation of a step at a rate p of the displacement, without reactions."""
    n = q.size
    for i in range(n):
        right[i] = push[i]
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
