"""Steps of central differences in compiled form."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.stepping.checks import check_contacts
from vofem.integrators.stepping.hysteresis import record_hysteresis
from vofem.integrators.stepping.record import LastStep, Motion, Record, leave, log_event, rounding, store, switched
from vofem.integrators.stepping.setting import Equations
from vofem.kernels.jit import jit
from vofem.laws.evaluate import commit, force_at
from vofem.laws.resolved import equivalent_stiffness
from vofem.laws.rows import Rows, dot, subtract_row
from vofem.laws.springpot_steps import FORCE, MEAN, WORK, Springpots, affine, carry_on, record_springpots
from vofem.laws.table import Laws
from vofem.linalg.banded import solve, subtract_product
from vofem.linalg.vectors import copy, fill, inner
from vofem.system import CLOSED

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Size(NamedTuple):
    """What belongs to the step size: the factored ``M + dt C/2`` and load vectors."""

    dt: float
    factored: Array
    loads: Array


class State(NamedTuple):
    """Current state: q at a step, v half a step before, status of the contacts, and internal variables."""

    q: Array
    half: Array
    status: IntArray
    internal: Array


class Implicit(NamedTuple):
    """Laws whose forces follow from rates, implicit through their compliance: contact dampers and springpots.

    Attributes
    ----------
    shape : ndarray, shape (n, n_laws)
        ``A^-1 B'``.
    compliance : ndarray, shape (n_laws, n_laws)
        ``B A^-1 B'``.
    coefficient : ndarray, shape (n_laws,)
        Force over rate in the present step, N s/m; zero of laws that do not act.
    """

    shape: Array
    compliance: Array
    coefficient: Array


class Scratch(NamedTuple):
    """Work space: of n unknowns, and slope, rest and force of the springpots over a step."""

    a: Array
    v: Array
    load: Array
    loss: Array
    slope: Array
    rest: Array
    pull: Array
    implicit: Implicit | None


def scratch(n: int, implicit: tuple[Array, Array] | None, springpots: int) -> Scratch:
    """Return work space for n unknowns, laws that are implicit, and some springpots."""
    laws = None if implicit is None else Implicit(*implicit, np.zeros(implicit[1].shape[0]))
    a, v, load, loss = np.zeros((4, n))
    slope, rest, pull = np.zeros((3, springpots))
    return Scratch(a, v, load, loss, slope, rest, pull, laws)


@jit
def advance(
    size: Size, equations: Equations, values: Array, first: int, state: State, before: LastStep, out: Record,
    space: Scratch, springpots: Springpots | None,
) -> int:  # fmt: skip
    """Take the steps that `values` has columns for, as long as there is room for their events; return their number."""
    matrices, rows, laws = equations
    dt, loads, contacts = size.dt, size.loads, state.status.size
    q, half, a, v, load, loss = state.q, state.half, space.a, space.v, space.load, space.loss
    n, damped = q.size, matrices.damping.shape[0] > 0
    for k in range(values.shape[1]):
        if out.happened[0] + contacts > out.events.shape[0]:
            return k
        step = first + k
        t = step * dt
        fill(load, 0.0)
        for e in range(loads.shape[0]):
            f = values[e, k]
            # Slow loads have no second moments.
            if f != 0.0:
                for i in range(n):
                    load[i] += loads[e, i] * f
        copy(load, a)
        kinds = laws.kinds
        _other_laws(laws, kinds.affine, kinds.called, kinds.hysteretic, springpots, rows, contacts, q, a)
        subtract_product(matrices.stiffness, q, a)
        _begin_springpots(springpots, space, space.implicit, rows, half, k, step)
        _subtract_springpots(springpots, space, rows, a)
        any_damper = False
        for j in range(contacts):
            u, gap = dot(rows, j, q), laws.table[j]["gap"]
            s = u - gap
            stiffness = equivalent_stiffness(laws.table[j], laws.kinds.resolved, s)
            if step == 0:
                if state.status[j] == CLOSED and laws.table[j]["resolution"] == np.inf:
                    stiffness = laws.table[j]["stiffness"]
            elif switched(s, state.status[j], rounding(rows, j, gap, q, before)):
                state.status[j] = log_event(out, j, t, dt, dot(rows, j, before.q) - gap, s)
            reaction = stiffness * (u - laws.table[j]["offset"])
            c = _damper(space.implicit, laws, laws.kinds.dampers, j, stiffness)
            if c > 0.0:
                any_damper = True
                reaction += c * dot(rows, j, half)
            if reaction != 0.0:
                subtract_row(rows, j, reaction, a)
        if damped:
            subtract_product(matrices.damping, half, a)
        solve(size.factored, a)
        _correct(space.implicit, springpots, any_damper, step, rows, 0.5 * dt, a)
        for i in range(n):
            v[i] = half[i] + 0.5 * dt * a[i]
        lossy = damped or any_damper
        if lossy:
            # Minus the damping force.
            fill(loss, 0.0)
            if damped:
                subtract_product(matrices.damping, v, loss)
            _subtract_dampers(space.implicit, laws.kinds.dampers, rows, contacts, v, loss)
        _middle_of_springpots(springpots, space, rows, half, a, step, dt)
        # Work and dissipation by the trapezoidal rule: this time ends one step and begins the next.
        if step > 0:
            _add_work(before, dt, half, load, loss, loads.shape[0] > 0, lossy)
        store(out, t, dt, step == 0, before, Motion(q, v, a), a)
        record_hysteresis(laws, laws.kinds.hysteretic, before.internal, rows, out)
        _record_springpots(springpots, t, dt, out)
        check_contacts(out.contact_checks, rows, dt, q, v)
        leave(before, q, v, a)
        for i in range(n):
            half[i] += dt * a[i]
            q[i] += dt * half[i]
        _add_work(before, dt, half, load, loss, loads.shape[0] > 0, lossy)
        _end_springpots(springpots, space, rows, half, k)
    return values.shape[1]


@jit
def _add_work(before: LastStep, dt: float, half: Array, load: Array, loss: Array, loaded: bool, lossy: bool) -> None:
    """Add what loads and dampers do in half a step."""
    if loaded:
        before.work[0] += 0.5 * dt * inner(half, load)
    if lossy:
        before.dissipated[0] -= 0.5 * dt * inner(half, loss)


@jit
def _other_laws(
    laws: Laws, linear: bool | None, called: bool | None, hysteretic: bool | None, springpots: Springpots | None,
    rows: Rows, contacts: int, q: Array, a: Array,
) -> None:  # fmt: skip
    """Commit laws with internal variables, and subtract the reactions of all laws but contacts and springpots.

    The kinds are arguments so that numba leaves out what those that are None would need.
    """
    if linear is None and called is None and hysteretic is None:
        return
    for j in range(contacts, laws.table.size):
        if not _is_springpot(springpots, j):
            u = dot(rows, j, q)
            _commit(laws, hysteretic, j, u)
            subtract_row(rows, j, force_at(laws, j, u), a)


@jit
def _is_springpot(springpots: Springpots | None, j: int) -> bool:
    if springpots is None:
        return False
    return springpots.row <= j < springpots.row + springpots.y.shape[0]


@jit
def _commit(laws: Laws, hysteretic: bool | None, j: int, u: float) -> None:
    if hysteretic is not None and laws.table[j]["end"] > laws.table[j]["start"]:
        commit(laws, j, u)


@jit
def _damper(implicit: Implicit | None, laws: Laws, dampers: bool | None, j: int, stiffness: float) -> float:
    """Return the coefficient of the damper of contact j, as far as the contact is closed, N s/m."""
    if implicit is None or dampers is None:
        return 0.0
    c = laws.table[j]["damping"] * (stiffness / laws.table[j]["stiffness"])
    implicit.coefficient[j] = c
    return c


@jit
def _subtract_dampers(
    implicit: Implicit | None, dampers: bool | None, rows: Rows, contacts: int, v: Array, loss: Array
) -> None:
    """Subtract the forces of contact dampers at velocities v."""
    if implicit is not None and dampers is not None:
        for j in range(contacts):
            if implicit.coefficient[j] > 0.0:
                subtract_row(rows, j, implicit.coefficient[j] * dot(rows, j, v), loss)


@jit
def _correct(
    implicit: Implicit | None, springpots: Springpots | None, any_damper: bool, step: int, rows: Rows,
    half_step: float, a: Array,
) -> None:  # fmt: skip
    """Correct the acceleration for laws that act on the mean of both half-step velocities."""
    if implicit is not None:
        acts = any_damper
        if springpots is not None:
            acts = acts or step > 0
        if acts:
            _implicit_forces(implicit, rows, half_step, a)


@jit
def _implicit_forces(implicit: Implicit, rows: Rows, half_step: float, a: Array) -> None:
    c = implicit.coefficient
    m = c.size
    system, right = np.eye(m), np.zeros(m)
    for j in range(m):
        right[j] = dot(rows, j, a)
        for i in range(m):
            system[j, i] += implicit.compliance[j, i] * c[i] * half_step
    mean = np.linalg.solve(system, right)
    for j in range(m):
        if c[j] > 0.0:
            force = c[j] * half_step * mean[j]
            for i in range(a.size):
                a[i] -= implicit.shape[i, j] * force


# -- springpots: their force at a time is the mean of those over the steps on both sides ------------------


@jit
def _begin_springpots(
    springpots: Springpots | None, space: Scratch, implicit: Implicit | None, rows: Rows, half: Array, k: int,
    step: int,
) -> None:  # fmt: skip
    """Find slopes and rests over step k, and the forces that the velocity half a step before causes."""
    if springpots is not None and implicit is not None:
        for i in range(springpots.y.shape[0]):
            j, mean = springpots.row + i, springpots.totals[i, MEAN]
            space.slope[i], space.rest[i] = affine(springpots, i, k)
            space.pull[i] = mean
            if step > 0:
                space.pull[i] = 0.5 * (mean + space.rest[i] + space.slope[i] * dot(rows, j, half))
                implicit.coefficient[j] = space.slope[i]


@jit
def _subtract_springpots(springpots: Springpots | None, space: Scratch, rows: Rows, a: Array) -> None:
    if springpots is not None:
        for i in range(springpots.y.shape[0]):
            subtract_row(rows, springpots.row + i, space.pull[i], a)


@jit
def _middle_of_springpots(
    springpots: Springpots | None, space: Scratch, rows: Rows, half: Array, a: Array, step: int, dt: float
) -> None:
    """Find the forces at the time of the step, and the work up to it."""
    if springpots is not None and step > 0:
        for i in range(springpots.y.shape[0]):
            j = springpots.row + i
            space.pull[i] += 0.5 * dt * space.slope[i] * dot(rows, j, a)
            springpots.totals[i, FORCE] = space.pull[i]
            springpots.totals[i, WORK] += 0.5 * dt * space.pull[i] * dot(rows, j, half)


@jit
def _record_springpots(springpots: Springpots | None, t: float, dt: float, out: Record) -> None:
    if springpots is not None:
        record_springpots(springpots, out.times, out.histories, out.cursor[1], out.cursor[0], t, dt)


@jit
def _end_springpots(springpots: Springpots | None, space: Scratch, rows: Rows, half: Array, k: int) -> None:
    """Update the springpots over step k."""
    if springpots is not None:
        for i in range(springpots.y.shape[0]):
            rate = dot(rows, springpots.row + i, half)
            springpots.totals[i, WORK] += 0.5 * springpots.update.dt * space.pull[i] * rate
            carry_on(springpots, i, k, rate, space.slope[i] * rate + space.rest[i])
