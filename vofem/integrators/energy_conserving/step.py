"""One step of the midpoint rule in compiled form, and what happens when it is accepted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.stepping.balance import Guess, Known, Structure, balance
from vofem.integrators.stepping.checks import check_contacts
from vofem.integrators.stepping.contact_solve import Acting, Dampers
from vofem.integrators.stepping.hysteresis import record_hysteresis
from vofem.integrators.stepping.record import LastStep, Motion, Record, leave, log_event, rounding, store, switched
from vofem.integrators.stepping.setting import Equations, Matrices
from vofem.kernels.jit import jit
from vofem.laws.evaluate import closed_share, commit_all
from vofem.laws.rows import Rows, dot, subtract_row
from vofem.laws.springpot_steps import Springpots, carry_all, mean_of_both, record_springpots
from vofem.laws.table import Laws
from vofem.linalg.banded import solve, subtract_product
from vofem.linalg.vectors import copy, fill, inner
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
    loaded : bool
        Whether there are loads; where there are none, all arrays are zero.
    """

    load: Array
    push: Array
    shift: Array
    inertia: Array
    loaded: bool


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
    internal : ndarray
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
    internal: Array


class Start(NamedTuple):
    """Where a step starts: displacements and velocities (n,), and coordinates of the laws (m,)."""

    q: Array
    v: Array
    u: Array


class Found(NamedTuple):
    """What a step finds, and a guess of it before: rate p of the displacement (n,), reactions of the laws (m,)."""

    p: Array
    reaction: Array


class Scratch(NamedTuple):
    """Work space of a step: of n unknowns, and of m laws; `none` and `dampers` are zero and not changed."""

    change: Array
    right: Array
    work: Array
    base: Array
    ahead: Array
    none: Array
    held: Array
    free: Array
    rate: Array
    dampers: Dampers | None


def scratch(n: int, laws: Laws) -> Scratch:
    """Return work space for n unknowns and some laws."""
    m = laws.table.size
    dampers = None if laws.kinds.dampers is None else Dampers(0.0, np.zeros(m))
    change, right, work, rate = np.empty((4, n))
    base, ahead, held, free = np.empty((4, m))
    return Scratch(change, right, work, base, ahead, np.zeros(m), held, free, rate, dampers)


@jit
def step(equations: Equations, factored: Factored, push: Array, start: Start, found: Found, space: Scratch) -> int:
    """Find the rate of the displacement and the reactions of a step, from guesses of both.

    Returns
    -------
    solved : int
        0 without, 1 with reactions; negative where there is no solution.
    """
    matrices, rows, p = equations.matrices, equations.rows, found.p
    n, dt = p.size, factored.dt
    change, right = space.change, space.right
    solved = 0
    _residual(matrices, dt, push, start, p, space.work, right)
    if rows.start.size > 1:
        _coordinates(rows, start.u, p, dt, space.base)
        solved = _balance(equations, factored, start, found, space, space.none)
        if solved < 0:
            return solved
        solved = min(solved, 1)
    else:
        copy(right, change)
        solve(factored.structure.factored, change)
    moved, size = 0.0, 0.0
    for i in range(n):
        p[i] += change[i]
        moved, size = max(moved, abs(change[i])), max(size, abs(p[i]))
    if moved <= _SMALL * size:
        return solved
    _residual(matrices, dt, push, start, p, space.work, right)
    if solved:
        # Reactions are corrected too: first the coordinates that the step would reach without reactions.
        _react(rows, found.reaction, 0.5 * dt, right)
        _coordinates(rows, start.u, p, dt, space.base)
        copy(found.reaction, space.held)
        if _balance(equations, factored, start, found, space, space.held) < 0:
            return -1
    else:
        copy(right, change)
        solve(factored.structure.factored, change)
    for i in range(n):
        p[i] += change[i]
    return solved


@jit
def _balance(equations: Equations, factored: Factored, start: Start, found: Found, space: Scratch, held: Array) -> int:
    """Find the reactions and the change of p that balance `space.right`, which holds some reactions already."""
    acting = Acting(equations.laws, start.u, True, _dampers(space.dampers, 1.0 / factored.dt))
    known, guess = Known(space.right, held, space.base), Guess(found.reaction, space.ahead, space.change, space.free)
    return balance(acting, factored.structure, equations.rows, known, guess)


@jit
def _dampers(dampers: Dampers | None, rate: float) -> Dampers | None:
    """Return how dampers act over a step: by the path over its size."""
    if dampers is None:
        return None
    return Dampers(rate, dampers.offset)


@jit
def _coordinates(rows: Rows, u: Array, p: Array, dt: float, base: Array) -> None:
    """Fill `base` with the laws' coordinates at the end of a step of mean velocity p."""
    for j in range(u.size):
        base[j] = u[j] + dt * dot(rows, j, p)


@jit
def _switches(equations: Equations, dt: float, p: Array, state: State) -> bool:
    """Return whether a contact that acts in a step of mean velocity p closes or opens in it."""
    for j in range(state.status.size):
        if state.reaction[j] != 0.0 or state.status[j] == CLOSED:
            s = state.u[j] + dt * dot(equations.rows, j, p) - equations.laws.table[j]["gap"]
            if switched(s, state.status[j], 0.0):
                return True
    return False


@jit
def accept(
    equations: Equations, factored: Factored, forcing: Forcing, t: float, p: Array, state: State, before: LastStep,
    out: Record, space: Scratch,
) -> None:  # fmt: skip
    """Take the step from t with the displacement's rate p.

    The state at t is stored only now, because its acceleration is the change of
    mean velocity between the steps on both sides. Where a contact closes or opens
    in one of these steps, the acceleration of the other step is used. Where one
    step is much longer, the interpolation within it does not use the short one.
    """
    matrices, rows, laws = equations
    q, v, last, dt = state.q, state.v, state.width[0], factored.dt
    n = q.size
    now, arriving, leaving = space.right, space.change, space.work
    turned, turns = state.width[1] != 0.0, _switches(equations, dt, p, state)
    for i in range(n):
        rate, held = 2.0 * (p[i] + forcing.shift[i] - v[i]) / dt, state.acceleration[i]
        between = rate if last == 0.0 else (dt * held + last * rate) / (dt + last)
        now[i] = between if turned == turns else (rate if turned else held)
        if last == 0.0:
            now[i] = rate
        arriving[i] = held if turned or turns or last > _UNEVEN * dt else between
        leaving[i] = rate if turned or turns or dt > _UNEVEN * last else between
        state.acceleration[i] = rate
    store(out, t, last if last > 0.0 else dt, last == 0.0, before, Motion(q, v, now), arriving)
    record_hysteresis(laws, laws.kinds.hysteretic, before.internal, rows, out)
    check_contacts(out.contact_checks, rows, last, q, v)
    leave(before, q, v, leaving)
    taken = 0.0
    if matrices.damping.shape[0] > 0:
        fill(space.work, 0.0)
        subtract_product(matrices.damping, p, space.work)
        taken -= dt * inner(space.work, p)
    if forcing.loaded:
        before.work[0] += dt * (inner(forcing.load, p) + inner(forcing.inertia, state.acceleration))
    for i in range(n):
        q[i] += dt * p[i]
        v[i] = 2.0 * (p[i] + forcing.shift[i]) - v[i]
    for i in range(n):
        gain = p[i] - state.mean[i] if last == dt else (0.0 if last == 0.0 else (p[i] - state.mean[i]) * dt / last)
        state.mean[i] = p[i]
        state.expected[i] = p[i] + gain
    for j in range(state.u.size):
        u1 = dot(rows, j, q)
        taken += _taken_by_damper(laws, laws.kinds.dampers, j, state.u[j], u1, dt)
        if j < state.status.size:
            s = u1 - laws.table[j]["gap"]
            if switched(s, state.status[j], rounding(rows, j, laws.table[j]["gap"], q, before)):
                state.status[j] = log_event(out, j, t + dt, dt, state.u[j] - laws.table[j]["gap"], s)
        state.u[j] = u1
    commit_all(laws, state.u)
    before.dissipated[0] += taken
    state.width[0], state.width[1] = dt, 1.0 if turns else 0.0


@jit
def _taken_by_damper(laws: Laws, dampers: bool | None, j: int, u0: float, u1: float, dt: float) -> float:
    """Return the energy in J that the damper of law j takes in a step."""
    if dampers is None:
        return 0.0
    if laws.table[j]["damping"] <= 0.0:
        return 0.0
    return laws.table[j]["damping"] / dt * closed_share(laws, j, u0, u1) * (u1 - u0)


@jit
def accept_springpots(
    springpots: Springpots | None, s: int, t: float, last: float, found: Found, rows: Rows, out: Record
) -> None:
    """Update springpots over step s from t, after one of size `last`; record them at the times stored last, up to t.

    The force at t is the mean of those of the steps on both sides, as the acceleration is.
    """
    if springpots is not None:
        mean_of_both(springpots, found.reaction, last)
        record_springpots(
            springpots, out.times, out.histories, out.cursor[1], out.cursor[0], t,
            last if last > 0.0 else springpots.update.dt,
        )  # fmt: skip
        carry_all(springpots, s, rows, found.reaction, found.p)


def forcing(n: int, loaded: bool) -> Forcing:
    """Return the loads of n unknowns before the first step."""
    return Forcing(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), loaded)


@jit
def combine(factored: Factored, values: Array, s: int, total: Forcing) -> None:
    """Fill the loads of step s from their moments, shape (3 n_loads, n_steps): all m0, then all -m2, then all m1."""
    if not total.loaded:
        return
    last = factored.loads.shape[0]
    # 0, but not as a literal, for which `_add` would be compiled once more.
    first = last - last
    _add(factored.loads, values, first, s, total.load)
    _add(factored.shift, values, last, s, total.shift)
    _add(factored.inertia, values, last, s, total.inertia)
    for i in range(total.push.size):
        total.push[i] = total.load[i] - 2.0 * total.inertia[i] / factored.dt


@jit
def _add(vectors: Array, values: Array, first: int, s: int, total: Array) -> None:
    """Fill `total` with the sum of vectors times values of step s, from row `first` on."""
    fill(total, 0.0)
    for k in range(vectors.shape[0]):
        value = values[first + k, s]
        if value != 0.0:
            for i in range(total.size):
                total[i] += vectors[k, i] * value


@jit
def _residual(matrices: Matrices, dt: float, push: Array, start: Start, p: Array, work: Array, right: Array) -> None:
    """Fill `right` with the residual of the equation of a step at a rate p of the displacement, without reactions."""
    q, v = start.q, start.v
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
