"""Steps of the generalized-alpha method in compiled form."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.generalized_alpha.parameters import Parameters
from vofem.integrators.stepping.balance import Guess, Known, Structure, balance
from vofem.integrators.stepping.checks import check_contacts
from vofem.integrators.stepping.contact_solve import Acting, Dampers
from vofem.integrators.stepping.hysteresis import commit_and_record
from vofem.integrators.stepping.record import LastStep, Motion, Record, leave, log_event, rounding, store, switched
from vofem.integrators.stepping.setting import Equations
from vofem.kernels.jit import jit
from vofem.laws.evaluate import closed_share
from vofem.laws.rows import dot, subtract_row
from vofem.laws.springpot_steps import FORCE, MEAN, WORK, Springpots, carry_on, record_springpots, set_laws
from vofem.laws.table import Laws
from vofem.linalg.banded import solve, subtract_product
from vofem.linalg.vectors import copy, fill, inner

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Size(NamedTuple):
    """What belongs to a step size: the matrix of a step and its load vectors."""

    dt: float
    parameters: Parameters
    structure: Structure
    loads: Array


class State(NamedTuple):
    """State: q, v, a, reactions without dampers, mean forces of dampers, status, internal variables."""

    q: Array
    v: Array
    a: Array
    reaction: Array
    damper: Array
    status: IntArray
    internal: Array


class Scratch(NamedTuple):
    """Work space: of n unknowns at the end of a step, and of the m laws; `none` is zero and not changed."""

    end: Motion
    right: Array
    load: Array
    output: Array
    u0: Array
    base: Array
    none: Array
    guess: Guess
    dampers: Dampers | None


def scratch(n: int, laws: Laws) -> Scratch:
    """Return work space for n unknowns and some laws."""
    m = laws.table.size
    end = Motion(np.empty(n), np.empty(n), np.empty(n))
    guess = Guess(np.empty(m), np.empty(m), end.a, np.empty(m))
    dampers = None if laws.kinds.dampers is None else Dampers(0.0, np.zeros(m))
    return Scratch(
        end, np.empty(n), np.zeros(n), np.empty(n), np.empty(m), np.empty(m), np.zeros(m), guess, dampers
    )  # fmt: skip


@jit
def advance(
    size: Size, equations: Equations, values: Array, first: int, state: State, before: LastStep, out: Record,
    space: Scratch, springpots: Springpots | None,
) -> tuple[int, int, bool]:  # fmt: skip
    """Take the steps between the times that `values` has columns for, as long as there is room for their events.

    Returns
    -------
    taken, solves : int
        Number of steps, and of those in which a law acted.
    failed : bool
        Whether the step after them has no solution.
    """
    matrices, rows, laws = equations
    dt, (am, af, gamma, beta) = size.dt, size.parameters
    q, v, a = state.q, state.v, state.a
    q1, v1, a1 = space.end
    n, m, contacts, count, solves = q.size, space.u0.size, state.status.size, values.shape[1] - 1, 0
    damped, loads = matrices.damping.shape[0] > 0, size.loads.shape[0]
    # Dampers act by their mean over the step, which is extrapolated from its middle to the time of balance.
    ahead = 1.0 + (0.5 - af)
    for j in range(m):
        space.u0[j] = dot(rows, j, q)
    for k in range(count):
        if out.happened[0] + contacts > out.events.shape[0]:
            return k, solves, False
        t = (first + k + 1) * dt
        for i in range(n):
            q1[i] = q[i] + dt * (v[i] + dt * (0.5 - beta) * a[i])
            v1[i] = v[i] + dt * (1.0 - gamma) * a[i]
        _fill_right(size, equations, values, k, state, space)
        solved = _balance(size, equations, state, space, springpots, k, ahead)
        if solved < 0:
            return k, solves, True
        solves += solved
        for i in range(n):
            q1[i] += beta * dt * dt * a1[i]
            v1[i] += gamma * dt * a1[i]
        taken = 0.0
        if damped:
            taken += 0.5 * dt * (_dissipation(matrices.damping, v, space) + _dissipation(matrices.damping, v1, space))
        for e in range(loads):
            mean, gain = 0.5 * (values[e, k + 1] + values[e, k]), 0.0
            # Slow loads have no second moments.
            if mean != 0.0:
                for i in range(n):
                    gain += size.loads[e, i] * (q1[i] - q[i])
                before.work[0] += mean * gain
        taken += _accept_laws(size, equations, t, state, before, out, space)
        _accept_springpots(springpots, k, ahead - 1.0, 1.0 - af, state.reaction, laws, space.u0)
        before.dissipated[0] += taken
        copy(q1, q)
        copy(v1, v)
        for i in range(n):
            space.output[i] = a1[i] + (af - am) * (a1[i] - a[i])
        copy(a1, a)
        store(out, t, dt, False, before, Motion(q, v, space.output), space.output)
        commit_and_record(laws, laws.kinds.hysteretic, space.u0, before.internal, rows, out)
        _record_springpots(springpots, t, dt, out)
        check_contacts(out.contact_checks, rows, dt, q, v)
        leave(before, q, v, space.output)
    return count, solves, False


@jit
def _fill_right(size: Size, equations: Equations, values: Array, k: int, state: State, space: Scratch) -> None:
    """Fill `space.right` with the right-hand side of step k, without the reactions at its end."""
    matrices, rows = equations.matrices, equations.rows
    am, af = size.parameters.alpha_m, size.parameters.alpha_f
    right, load, work, q1, v1 = space.right, space.load, space.output, space.end.q, space.end.v
    n = right.size
    fill(load, 0.0)
    for e in range(size.loads.shape[0]):
        f = (1.0 - af) * values[e, k + 1] + af * values[e, k]
        if f != 0.0:
            for i in range(n):
                load[i] += size.loads[e, i] * f
    for i in range(n):
        right[i] = load[i]
        work[i] = am * state.a[i]
    subtract_product(matrices.mass, work, right)
    for i in range(n):
        work[i] = (1.0 - af) * q1[i] + af * state.q[i]
    subtract_product(matrices.stiffness, work, right)
    if matrices.damping.shape[0] > 0:
        for i in range(n):
            work[i] = (1.0 - af) * v1[i] + af * state.v[i]
        subtract_product(matrices.damping, work, right)
    for j in range(state.reaction.size):
        if state.reaction[j] != 0.0:
            subtract_row(rows, j, af * state.reaction[j], right)


@jit
def _balance(
    size: Size, equations: Equations, state: State, space: Scratch, springpots: Springpots | None, k: int,
    ahead: float,
) -> int:  # fmt: skip
    """Find the accelerations and reactions at the end of step k; return 0 without, 1 with reactions, or less."""
    rows, laws, guess, af = equations.rows, equations.laws, space.guess, size.parameters.alpha_f
    if space.u0.size == 0:
        copy(space.right, guess.x)
        solve(size.structure.factored, guess.x)
        return 0
    _set_springpots(springpots, k, laws, space.u0, ahead - 1.0, 1.0 - af)
    for j in range(space.u0.size):
        space.base[j] = dot(rows, j, space.end.q)
        guess.reaction[j] = state.reaction[j]
    dampers = _dampers(space.dampers, state.damper, ahead / (size.dt * (1.0 - af)), (ahead - 1.0) / (1.0 - af))
    acting = Acting(laws, space.u0, None, dampers)
    return min(balance(acting, size.structure, rows, Known(space.right, space.none, space.base), guess), 1)


@jit
def _dampers(dampers: Dampers | None, mean: Array, rate: float, share: float) -> Dampers | None:
    """Return how dampers act over a step; a share of the last step's means is taken from the extrapolation."""
    if dampers is None:
        return None
    for j in range(mean.size):
        dampers.offset[j] = share * mean[j]
    return Dampers(rate, dampers.offset)


@jit
def _dissipation(damping: Array, v: Array, space: Scratch) -> float:
    """Return the power in W that the damping matrix takes at velocities v."""
    fill(space.right, 0.0)
    subtract_product(damping, v, space.right)
    return -inner(space.right, v)


@jit
def _accept_laws(
    size: Size, equations: Equations, t: float, state: State, before: LastStep, out: Record, space: Scratch
) -> float:
    """Update coordinates, reactions and status at the end of the step to t; return what dampers of contacts took, J."""
    rows, laws, u0, q1 = equations.rows, equations.laws, space.u0, space.end.q
    taken = 0.0
    for j in range(u0.size):
        u1 = dot(rows, j, q1)
        # The damper's part is not a force at the end: what is left is.
        force, mean = _damper(laws, laws.kinds.dampers, j, u0[j], u1, size, state)
        state.reaction[j] = space.guess.reaction[j] - force
        state.damper[j] = mean
        taken += mean * (u1 - u0[j])
        if j < state.status.size:
            s, gap = u1 - laws.table[j]["gap"], laws.table[j]["gap"]
            if switched(s, state.status[j], rounding(rows, j, gap, q1, before)):
                state.status[j] = log_event(out, j, t, size.dt, u0[j] - gap, s)
        u0[j] = u1
    return taken


@jit
def _damper(
    laws: Laws, dampers: bool | None, j: int, u0: float, u1: float, size: Size, state: State
) -> tuple[float, float]:
    """Return the part of a damper in the reaction of law j, and its mean over the step, N."""
    if dampers is None:
        return 0.0, 0.0
    one = laws.table[j]
    if one["damping"] <= 0.0:
        return 0.0, 0.0
    af, path = size.parameters.alpha_f, closed_share(laws, j, u0, u1)
    ahead = 1.0 + (0.5 - af)
    # As in the balance of the step, to the last digit.
    offset = (ahead - 1.0) / (1.0 - af) * state.damper[j]
    force = one["damping"] * (ahead / (size.dt * (1.0 - af))) * path - offset
    return force, one["damping"] * path / size.dt


@jit
def _set_springpots(springpots: Springpots | None, k: int, laws: Laws, u: Array, ahead: float, share: float) -> None:
    if springpots is not None:
        set_laws(springpots, k, laws, u, ahead, share)


@jit
def _accept_springpots(
    springpots: Springpots | None, k: int, ahead: float, share: float, reaction: Array, laws: Laws, u: Array
) -> None:
    """Update springpots over step k, which ends at u. Forces at its end are extrapolated from means of two steps."""
    if springpots is not None:
        totals = springpots.totals
        for i in range(totals.shape[0]):
            j = springpots.row + i
            # The law of the step counts from where the step began.
            rate = (u[j] - laws.table[j]["gap"]) / springpots.update.dt
            mean = (share * reaction[j] + ahead * totals[i, MEAN]) / (1.0 + ahead)
            totals[i, WORK] += springpots.update.dt * mean * rate
            totals[i, FORCE] = 1.5 * mean - 0.5 * totals[i, MEAN]
            carry_on(springpots, i, k, rate, mean)
            # In the next step the law acts by its mean alone.
            reaction[j] = 0.0


@jit
def _record_springpots(springpots: Springpots | None, t: float, dt: float, out: Record) -> None:
    if springpots is not None:
        record_springpots(springpots, out.times, out.histories, out.cursor[1], out.cursor[0], t, dt)
