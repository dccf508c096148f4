"""The steps of all methods that step in time: one loop, whose numbers make it the one method or the other.

A step of size h from (q_0, v_0, a_0) solves for the weighted acceleration ``w = (1 - alpha_m) a_1 + alpha_m a_0``:

    M w + C v_b + K q_b + sum_j b_j R_j = f,    x_b = (1 - b) x_0 + b x_1,    b = 1 - alpha_f,
    q_1 = q_0 + h v_0 + h^2 (cqa a_0 + cqw w),    v_1 = v_0 + h (cva a_0 + cvw w).

R is the mean force of a law over the step, or its force at the end with the weight b. The midpoint rule is
``alpha_m = alpha_f = 1/2`` with mean forces; central differences in velocity form are ``beta = 0``. For the row b_j
of a law let ``y = b_j.w``. Then the coordinate of the law at the end is ``u_p + h^2 cqw y`` and its rate
``r_p + h cvw y``, so springs and dampers are one scalar problem each, also at ``beta = 0``.

Some rows are no laws at fixed places, see `Rules`: rows that travel change from step to step, some hold their
coordinate whatever force that takes, and some push with a known force. The reaction of such a row acts between its
places at both ends of the step, at the time of balance. Where laws do not act by mean forces a held coordinate is that
of a step ahead, ``q_1 + h v_1 + h^2 w/2``: explicit steps choose that with w, and implicit ones do not oscillate. A
mass that comes onto a beam, or leaves it, jumps to its place and velocity; no force leads it there (`Rules.settling`).
The module `reactions` finds the forces of all rows.

The midpoint rule solves for the correction of an extrapolated mean velocity, twice where that is large: errors of the
factored matrix would work in one direction for ever.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.stepping.reactions import (
    ABSENT,
    ACTS,
    FINISH,
    KIND,
    LIMIT,
    PER,
    PRESSING,
    PUSH,
    PUSHES,
    REACHED,
    SPRUNG,
    STATUS,
    TARGET,
    U0,
    Reactions,
    named,
    reactions_of,
)
from vofem.kernels.addresses import call
from vofem.kernels.jit import borrowed, jit, plain_form
from vofem.laws.law import FIRST, FORCE, Laws, Way, ask
from vofem.laws.rows import Rows, dot, subtract_row
from vofem.laws.springpot_steps import Springpots, begin_springpots, end_springpots
from vofem.linalg.banded import solve, subtract_product
from vofem.linalg.vectors import copy, fill

#: A correction of the mean velocity above this fraction of it is corrected again.
_SMALL = 2.0**-6

#: `drift` of `advance` where laws' coordinates are ``b.q``.
NO_DRIFT = np.empty((2, 0, 0))


class Numbers(NamedTuple):
    """The numbers of a method for one step size; see the module for the first five."""

    b: float
    cqa: float
    cqw: float
    cva: float
    cvw: float
    alpha_m: float
    lag: float  #: Time from that of accelerations to the end of the step, over the step.
    way: Way  #: How laws act.
    per_y: float  #: Rise of what a law depends on with ``b_j.w``, its coordinate or in explicit steps its rate.
    part: float  #: Weight of a law's force in the balance of the step.


class Equations(NamedTuple):
    """What steps need of a system, unknowns in band order."""

    #: `mass`, `stiffness`, `damping`: lower bands; no rows of `damping` where undamped.
    mass: Array
    stiffness: Array
    damping: Array
    rows: Rows
    laws: Laws


class Rules(NamedTuple):
    """What rows do over some steps beside laws at fixed places; the steps' rows begin one step of `stride` apart."""

    #: Rows in `Equations.rows` from one end of a step to the next, up to a step ahead; 0 where no row travels.
    stride: int
    rates: Rows  #: Rates of the rows.
    kind: NDArray[np.int64]  #: Shape (steps, m).
    present: NDArray[np.bool_]  #: Whether rows find anything at the ends of steps, shape (steps + 1, m).
    away: Array  #: Coordinates of laws that find nothing, shape (m,).
    #: Whether a row that holds keeps the place where it is, and not its coordinate at zero, shape (m,).
    anchored: NDArray[np.bool_]
    #: Of sliders the force that pushes while they slide, and that up to which they hold, inf for ever, N; over the
    #: normal force where another law presses. Shape (2, steps, m).
    push: Array
    status: NDArray[np.int64]  #: Direction in which a slider slides at the start, 0 where it sticks, shape (m,).
    stops: bool  #: Whether to stop before a step within which a slider turns.
    pressing: NDArray[np.int64]  #: Number of the law that presses, -1 for none, shape (m,).
    #: Laws that know the normal force at both ends of a step, as the last two of five numbers, shape (m,).
    springs: NDArray[np.bool_]
    normal: Array  #: These forces where no law presses, N, shape (steps + 1, m).
    #: Unknowns, with a weight of -1 in the row, that jump within the step to the velocity of the row's place, -1 for
    #: none; one step ahead too. Shape (steps + 1, m).
    settling: NDArray[np.int64]


class Size(NamedTuple):
    """What belongs to a step size."""

    numbers: Numbers
    factored: Array  #: ``A = M + b h cvw C + b h^2 cqw K``, factored.
    #: ``B A^-1 B'``, (m, m), empty where rows travel; or where reactions are found in the band A with room for ``B'B``.
    coupling: Array
    banded: bool


class Chunk(NamedTuple):
    """States before and after some steps, one a row; the first row is given, and `advance` fills the others."""

    #: `a` is the mean acceleration over the step before where laws act by mean forces, shape (steps + 1, n).
    q: Array
    v: Array
    a: Array
    #: `u`, `reaction`, `damper`: coordinates of the laws; their forces, N, where laws act at ends of steps without
    #: dampers that act by means; forces of contact dampers, mean or at the end. Shape (steps + 1, m).
    u: Array
    reaction: Array
    damper: Array
    past: Array  #: Internal variables of laws, shape (steps + 1, s).
    #: Mean force of springpots over the step, N, and energy stored at its end, J, shape (steps + 1, n_pots, 2).
    pots: Array
    ends: Array  #: Accelerations at the ends of steps where `a` lags behind, shape (steps + 1, n); else (steps + 1, 0).


class Work(NamedTuple):
    """Work space of steps of n unknowns and m laws."""

    #: Residual, correction of w, mean rate of displacement, and scratch, shape (4, n).
    vectors: Array
    reactions: Reactions


def work_space(equations: Equations, size: Size, slides: bool) -> tuple[Work, Any]:
    """Return work space for steps of sizes like one, and what must be kept as long as it is used.

    `slides`: whether there are rigid sliders.
    """
    n, m = size.factored.shape[1], equations.laws.table.shape[0]
    coupling = size.coupling if size.coupling.size else np.zeros((m, m))
    reactions, kept = reactions_of(equations.laws, equations.rows, coupling, size.factored, size.banded, slides)
    return Work(np.zeros((4, n)), reactions), kept


# -- vectors ------------------------------------------------------------------------------------------------


@jit
def _sum(into: Array, x: Array, factor: float, y: Array) -> None:
    """Let ``into = x + factor y``."""
    for i in range(into.size):
        into[i] = x[i] + factor * y[i]


@plain_form(_sum)
def _plain_sum(into: Array, x: Array, factor: float, y: Array) -> None:
    into[:] = x + factor * y


@jit
def _between(into: Array, x: Array, part: float, y: Array) -> None:
    """Let ``into = (1 - part) x + part y``."""
    for i in range(into.size):
        into[i] = (1.0 - part) * x[i] + part * y[i]


@plain_form(_between)
def _plain_between(into: Array, x: Array, part: float, y: Array) -> None:
    into[:] = (1.0 - part) * x + part * y


@jit
def _ahead(q0: Array, v0: Array, a0: Array, dt: float, cq: float, cv: float, q1: Array, v1: Array) -> None:
    """Let ``q1 = q0 + dt v0 + cq a0`` and ``v1 = v0 + cv a0``."""
    for i in range(q0.size):
        q1[i] = q0[i] + dt * v0[i] + cq * a0[i]
        v1[i] = v0[i] + cv * a0[i]


@plain_form(_ahead)
def _plain_ahead(q0: Array, v0: Array, a0: Array, dt: float, cq: float, cv: float, q1: Array, v1: Array) -> None:
    q1[:], v1[:] = q0 + dt * v0 + cq * a0, v0 + cv * a0


@jit
def _difference(into: Array, factor: float, x: Array, y: Array) -> None:
    """Let ``into = factor (x - y)``."""
    for i in range(into.size):
        into[i] = factor * (x[i] - y[i])


@plain_form(_difference)
def _plain_difference(into: Array, factor: float, x: Array, y: Array) -> None:
    into[:] = factor * (x - y)


@jit
def _largest(x: Array) -> float:
    """Return the largest magnitude in a vector."""
    most = 0.0
    for i in range(x.size):
        most = max(most, abs(x[i]))
    return most


@plain_form(_largest)
def _plain_largest(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))


# -- steps --------------------------------------------------------------------------------------------------


@jit
def advance(
    equations: Equations, numbers: Numbers, factored: Array, coupling: Array, dampers: bool, pots: Springpots | None,
    drift: Array, rules: Rules | None, values: Array, loads: Array, shift: Array, earlier: Array,
    chunk: Chunk, work: Work,
) -> tuple[int, int]:  # fmt: skip
    """Take the steps that a chunk has rows for.

    Arguments that may be None come separately, because numba leaves out code for arguments that are None. It compiles
    once for each combination of them, so few may be.

    `numbers`, `factored`, `coupling`: of `Size`.
    `dampers`: whether a law has a damper.
    `drift` (shape (2, steps + 2, m)): what is added to the laws' coordinates ``b.q`` at the ends of steps, and one step
    ahead, m, and its rates; empty where nothing is.
    `rules`: what rows do that are no laws at fixed places; not without `drift`.
    `values` (shape (steps, k)), `loads` (shape (k, n)): in the balance of every step, as sums of values times loads.
    `shift` (shape (steps, n)): mean velocity less the mean rate of displacement, m/s; no rows where it is zero.
    `earlier` (shape (n,)): mean acceleration over the step before that before the first one, where laws act by mean
    forces.
    Returns `taken, solves`: number of steps, fewer than asked for where the next one has no solution, or where
    `rules.stops` before it; and of those in which a law acted.
    """
    mass, stiffness, damping, rows, laws = borrowed(equations)
    chunk, work, factored, coupling = borrowed(chunk), borrowed(work), borrowed(factored), borrowed(coupling)
    values, loads, shift = borrowed(values), borrowed(loads), borrowed(shift)
    reactions, place, kind = work.reactions, work.reactions.place, work.reactions.whole[KIND]
    status = work.reactions.whole[STATUS]
    right, x, p, some = work.vectors[0], work.vectors[1], work.vectors[2], work.vectors[3]
    held, u_before, base, rate, before, last, free, per, y, found, more, damper = named(reactions)
    dt, b, mean, half = numbers.way.dt, numbers.b, numbers.way.mean, numbers.b * numbers.way.dt * numbers.cvw
    m, solves, stride, drifts = found.size, 0, 0, drift.size > 0
    if rules is not None:
        stride = rules.stride
    way, explicit, weight = numbers.way, numbers.way.explicit, numbers.part
    damped, shifted, past = damping.shape[0] > 0, shift.shape[0] > 0, laws.state.size > 0
    # Without laws the solution replaces the residual, in its place where accelerations do not lag.
    direct = m == 0 and not mean and numbers.alpha_m == 0.0
    if m == 0:
        x = right
    # Whether forces are known before the acceleration, so that nothing is searched.
    known = explicit and not dampers and rules is None
    if past:
        copy(chunk.past[0], laws.state)
    for k in range(chunk.q.shape[0] - 1):
        q0, v0, a0, q1, v1, a1 = chunk.q[k], chunk.v[k], chunk.a[k], chunk.q[k + 1], chunk.v[k + 1], chunk.a[k + 1]
        here, there = k * stride, (k + 1) * stride
        if direct:
            right, x = a1, a1
        # For mean forces p is guessed, the mean rate of displacement; otherwise q1 and v1 are those without w.
        # Motion that the step does not resolve changes its velocity from step to step. It drops out of the mean
        # velocities of the two steps before, which are extrapolated here.
        if mean:
            _sum(p, v0, half, earlier if k == 0 else chunk.a[k - 1])
        else:
            _ahead(q0, v0, a0, dt, dt * dt * numbers.cqa, dt * numbers.cva, q1, v1)
            if rules is not None:
                for j in range(m):
                    own = rules.settling[k, j]
                    if own >= 0:
                        q1[own] += dot(rows, there + j, q1)
                        v1[own] += _rate(rows, rules, drift, k, there + j, q1, v1, True)
        for j in range(m):
            if not known:
                u_before[j], before[j], last[j] = chunk.u[k, j], chunk.damper[k, j], chunk.reaction[k, j]
                found[j], held[j] = last[j], 0.0
            if not mean:
                base[j] = dot(rows, there + j, q1)
                if drifts:
                    base[j] += drift[0, k + 1, j]
                # Only dampers ask for it, and springpots, which count as such.
                rate[j] = _rate(rows, rules, drift, k, there + j, q1, v1, dampers)
        if rules is not None:
            _prepare(rows, rules, k, numbers, factored, coupling, laws, reactions, some)
        if pots is not None:
            begin_springpots(pots, k, laws, way, chunk.pots, u_before, base, rate)
        solved = 0
        for again in range(2):
            fill(right, 0.0)
            for e in range(loads.shape[0]):
                _sum(right, right, values[k, e], loads[e])
            if mean:
                # Forces first: on fine meshes they cancel, and what inertia adds must not be rounded to their size.
                _sum(some, q0, b * dt, p)
                subtract_product(stiffness, some, right)
                if damped:
                    subtract_product(damping, p, right)
                _difference(some, 1.0 / half, p, v0)
                if shifted:
                    _sum(some, some, 1.0 / half, shift[k])
                subtract_product(mass, some, right)
                if stride > 0:
                    _sum(q1, q0, dt, p)
                for j in range(m):
                    base[j] = u_before[j] + dt * dot(rows, j, p) if stride == 0 else dot(rows, there + j, q1)
                    if drifts:
                        base[j] += drift[0, k + 1, j] - (drift[0, k, j] if stride == 0 else 0.0)
            else:
                if b < 1.0:
                    _between(some, q0, b, q1)
                    subtract_product(stiffness, some, right)
                else:
                    subtract_product(stiffness, q1, right)
                if damped:
                    _between(some, v0, b, v1)
                    subtract_product(damping, some, right)
                for j in range(m):
                    if b < 1.0 and last[j] != 0.0 and kind[j] == ACTS:
                        subtract_row(rows, here + j, (1.0 - b) * last[j], right)
            if known:
                for j in range(m):
                    found[j] = ask(laws, j, FORCE, base[j], base[j])
                    if not np.isfinite(found[j]):
                        return k, solves
                    if found[j] != 0.0:
                        subtract_row(rows, j, found[j], right)
            elif solved:
                for j in range(m):
                    held[j] = found[j]
                    _pull(rows, here, there, j, kind[j], mean, b, weight * found[j], right)
            if m > 0:
                copy(right, x)
            solve(factored, x)
            if m > 0 and not known and (solved or again == 0):
                for j in range(m):
                    free[j], row = rate[j] if explicit else base[j], there + j
                    if rules is not None:  # noqa: SIM102
                        if kind[j] != ACTS:
                            free[j] = base[j]
                            if not mean:
                                free[j] = drift[0, k + 2, j]
                                if rules.settling[k + 1, j] >= 0:
                                    # What jumps after this step is not led there before.
                                    free[j] += dt * dot(rules.rates, row, q1)
                                else:
                                    row += stride
                                free[j] += dt * dot(rows, row, v1)
                                free[j] += -drift[0, k + 1, j] if rules.anchored[j] else dot(rows, row, q1)
                    free[j] += per[j] * dot(rows, row, x)
                answer = call(reactions.address, place, y, 0, y, 0, 0.0, 0.0)
                if answer < 0.0:
                    return k, solves
                if answer > 0.0:
                    solved = 1
                    copy(right, x)
                    for j in range(m):
                        part = weight if kind[j] == ACTS else 1.0
                        _pull(rows, here, there, j, kind[j], mean, b, part * more[j], x)
                    solve(factored, x)
            if not mean:
                break
            _sum(p, p, half, x)
            # Errors of the factored matrix in large corrections would work in one direction for ever.
            if half * _largest(x) <= _SMALL * _largest(p):
                break
        solves += 0 if explicit else solved
        if mean:
            _sum(q1, q0, dt, p)
            if shifted:
                _sum(p, p, 1.0, shift[k])
            _between(v1, v0, 2.0, p)
            _difference(a1, 1.0 / dt, v1, v0)
        else:
            if not explicit:
                _sum(q1, q1, dt * dt * numbers.cqw, x)
            _sum(v1, v1, dt * numbers.cvw, x)
            if not direct:
                _between(a1, a0, 1.0 / (1.0 - numbers.alpha_m), x)
            if numbers.lag != 0.0:
                _difference(chunk.ends[k + 1], numbers.lag, a1, a0)
                _sum(chunk.ends[k + 1], chunk.ends[k + 1], 1.0, a1)
        for j in range(m):
            y[j] = base[j] if explicit else dot(rows, there + j, q1)
            if drifts and not explicit:
                y[j] += drift[0, k + 1, j]
            if rules is not None:  # noqa: SIM102
                if not rules.present[k + 1, j]:
                    y[j] = rules.away[j]
            if dampers or rules is not None:
                rate[j] = _rate(rows, rules, drift, k, there + j, q1, v1, True)
            if rules is not None:
                if mean and rules.settling[k, j] >= 0:
                    v1[rules.settling[k, j]] += rate[j]
                if rules.stops and (status[j] != rules.status[j] or rate[j] * status[j] < 0.0):
                    return k, solves
            chunk.u[k + 1, j], chunk.reaction[k + 1, j] = y[j], found[j]
        if dampers or past:
            call(reactions.laws, place, y, 0, y, 0, FINISH, 0.0)
        if dampers:
            for j in range(m):
                chunk.damper[k + 1, j] = damper[j]
                # A damper that acts by its mean has no force at the end.
                if not (mean or explicit or kind[j] == ABSENT):
                    chunk.reaction[k + 1, j] -= way.now * damper[j] - way.before * before[j]
        if pots is not None:
            end_springpots(pots, k, way, chunk.pots, u_before, chunk.u[k + 1], chunk.reaction[k + 1])
        if past:
            copy(laws.state, chunk.past[k + 1])
    return chunk.q.shape[0] - 1, solves


@jit
def _rate(
    rows: Rows, rules: Rules | None, drift: Array, k: int, row: int, q1: Array, v1: Array, dampers: bool
) -> float:  # fmt: skip
    """Return the rate of a row's coordinate at the end of step k; without dampers only what moves the row."""
    rate = dot(rows, row, v1) if dampers else 0.0
    if drift.size > 0:
        rate += drift[1, k + 1, row % drift.shape[2]]
    if rules is not None:  # noqa: SIM102 (numba leaves out the branch only so)
        if rules.stride > 0:
            rate += dot(rules.rates, row, q1)
    return rate


@jit
def _pull(
    rows: Rows, here: int, there: int, j: int, kind: int, mean: bool, b: float, amount: float, y: Array
) -> None:  # fmt: skip
    """Subtract a multiple of row j from y: of that within the step, or of that at its end for a law that acts there."""
    part = b if mean or kind != ACTS else 1.0
    if here == there or part == 1.0:
        if amount != 0.0:
            subtract_row(rows, there + j, amount, y)
    else:
        subtract_row(rows, here + j, (1.0 - part) * amount, y)
        subtract_row(rows, there + j, part * amount, y)


@jit
def _prepare(
    rows: Rows, rules: Rules, k: int, numbers: Numbers, factored: Array, compliance: Array, laws: Laws,
    reactions: Reactions, answer: Array,
) -> None:  # fmt: skip
    """Enter into `reactions` what rows do in step k, and how far they give way."""
    mean, dt, stride, whole, reach = numbers.way.mean, numbers.way.dt, rules.stride, reactions.whole, reactions.coupling
    u0, per, target = reactions.of_laws[U0], reactions.of_laws[PER], reactions.of_laws[TARGET]
    ahead = dt * dt * (numbers.cvw + 0.5)
    push, limit, reached = reactions.of_laws[PUSH], reactions.of_laws[LIMIT], reactions.of_laws[REACHED]
    for j in range(per.size):
        kind, status = rules.kind[k, j], rules.status[j]
        whole[KIND, j], whole[PRESSING, j], whole[SPRUNG, j] = kind, rules.pressing[j], rules.springs[j]
        whole[STATUS, j], push[j], limit[j], reached[j] = status, rules.push[0, k, j], rules.push[1, k, j], 0.0
        per[j], target[j] = numbers.per_y, 0.0
        if kind != ACTS and not mean:
            per[j] = ahead if rules.anchored[j] else ahead + dt * dt * numbers.cqw
        if kind == PUSHES:
            target[j] = status * push[j]
        elif mean and rules.anchored[j]:
            target[j] = u0[j]
        if rules.springs[j] and rules.pressing[j] < 0:
            at = laws.table[j, FIRST] + 3
            laws.parameters[at], laws.parameters[at + 1] = rules.normal[k, j], rules.normal[k + 1, j]
    for j in range(per.size):
        share = numbers.part if whole[KIND, j] == ACTS else 1.0
        if stride > 0:
            fill(answer, 0.0)
            _pull(rows, k * stride, (k + 1) * stride, j, whole[KIND, j], mean, numbers.b, -1.0, answer)
            solve(factored, answer)
        for i in range(per.size):
            ahead_of = whole[KIND, i] != ACTS and not mean and rules.settling[k + 1, i] < 0
            row = (k + 2 if ahead_of else k + 1) * stride + i
            reach[i, j] = per[i] * share * (dot(rows, row, answer) if stride > 0 else compliance[i, j])
