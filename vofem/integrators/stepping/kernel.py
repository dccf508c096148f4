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
of a step ahead, ``q_1 + h v_1 + h^2 w/2``: explicit steps choose that with w, and implicit ones do not oscillate.

Reactions are found in one of three ways. With such rows, Newton's method runs on all forces. Otherwise, where laws are
few, it runs on their reactions, through the compliance ``G = B A^-1 B'``. Where there are about as many laws as
unknowns, A with the slopes of all laws added is still a narrow band, and it runs on w. The last two minimise the same
convex function where forces do not fall, so both find its only minimum from any start.

The midpoint rule solves for the correction of an extrapolated mean velocity, twice where that is large: errors of the
factored matrix would work in one direction for ever.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.kernels.jit import borrowed, jit, plain_form
from vofem.laws.law import FIRST, FORCE, Laws, Way, ask, commit_laws, damper_over, force_over, slope_over
from vofem.laws.rows import Rows, dot, subtract_row
from vofem.laws.springpot_steps import Springpots, begin_springpots, end_springpots
from vofem.linalg.banded import factor_in_place, solve, subtract_product
from vofem.linalg.vectors import copy, fill, inner

_MOST = 200
_EPS = float(np.finfo(float).eps)

#: Newton steps after which a residual at the rounding level of its own terms is accepted.
_PATIENCE = 30

#: Slope of the convex function at the end of a full Newton step, over that at its start, up to which it is taken.
_FLAT = 1e-12

#: A correction of the mean velocity above this fraction of it is corrected again.
_SMALL = 2.0**-6

#: Response to a reaction within a step, over the coordinate, above which the reaction is corrected from its law.
_TURNED = 4.0


class Numbers(NamedTuple):
    """The numbers of a method for one step size; see the module for the first six.

    `mean` says whether laws act by their mean force over the step; `ahead` is the distance from the middle of the step
    to the time of balance, over the step.
    """

    dt: float
    b: float
    cqa: float
    cqw: float
    cva: float
    cvw: float
    alpha_m: float
    mean: bool
    ahead: float


class Equations(NamedTuple):
    """What steps need of a system, unknowns in band order."""

    #: `mass`, `stiffness`, `damping`: lower bands; no rows of `damping` where undamped.
    mass: Array
    stiffness: Array
    damping: Array
    rows: Rows
    laws: Laws


#: What a row does: its law acts, it holds its coordinate, it pushes with a known force, or it finds nothing.
ACTS, HOLDS, PUSHES, ABSENT = range(4)


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
    push: Array  #: Forces of rows that push, N; over the normal force where another law presses. Shape (steps, m).
    pressing: NDArray[np.int64]  #: Number of the law that presses, -1 for none, shape (m,).
    #: Laws that know the normal force at both ends of a step, as the last two of five numbers, shape (m,).
    springs: NDArray[np.bool_]
    normal: Array  #: These forces where no law presses, N, shape (steps + 1, m).


class Size(NamedTuple):
    """What belongs to a step size."""

    numbers: Numbers
    factored: Array  #: ``A = M + b h cvw C + b h^2 cqw K``, factored.
    compliance: Array | None  #: ``B A^-1 B'`` where reactions are found through it, shape (m, m).
    band: Array | None  #: A with room for ``B'B`` where reactions are found in the band.


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


class Work(NamedTuple):
    """Work space of steps of n unknowns and m laws."""

    #: `right`, `x`, `p`, `some`, `step`: residual, correction of w, mean rate of displacement, scratch, and a step of
    #: Newton's method, shape (n,).
    right: Array
    x: Array
    p: Array
    some: Array
    step: Array
    #: `base`, `rate`: coordinates of the laws, and their rates, at the end of the step for the guess of w, shape (m,).
    base: Array
    rate: Array
    #: ``b_j.x`` without reactions, and reactions that the residual holds already, shape (m,).
    free: Array
    held: Array
    found: Array  #: Reactions, shape (m,).
    #: `y`, `force`, `slope`, `change`, `move`, `solution`: shape (m,).
    y: Array
    force: Array
    slope: Array
    change: Array
    move: Array
    solution: Array
    active: NDArray[np.int64]  #: Numbers of the laws that act, shape (m,).
    matrix: Array  #: Shape (m, m).
    band: Array  #: In the shape of `Size.band`.
    kind: NDArray[np.int64]  #: What the rows do in the step, shape (m,).
    #: `per`, `target`, `best`: rise of coordinates with ``b_j.x``, held coordinates or the forces of rows that push,
    #: and the best forces, shape (m,).
    per: Array
    target: Array
    best: Array
    reach: Array  #: Fall of coordinates by unit forces, where rows are of several kinds, shape (m, m).


def work_space(n: int, m: int, size: Size) -> Work:
    """Return work space for n unknowns and m laws."""
    matrix = np.zeros((0, 0) if size.band is not None else (m, m))
    band = np.zeros((0, 0)) if size.band is None else np.zeros_like(size.band)
    right, x, p, some, step = np.zeros((5, n))
    base, rate, free, held, found, y, force, slope, change, move, solution = np.zeros((11, m))
    active, kind = np.zeros((2, m), dtype=np.int64)
    per, target, best = np.zeros((3, m))
    return Work(
        right, x, p, some, step, base, rate, free, held, found, y, force, slope, change, move, solution, active, matrix,
        band, kind, per, target, best, np.zeros(matrix.shape),
    )  # fmt: skip


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
def _predict(q0: Array, v0: Array, a0: Array, q1: Array, v1: Array, dt: float, bend: float, turn: float) -> None:
    """Let ``q1 = q0 + dt v0 + bend a0`` and ``v1 = v0 + turn a0``."""
    for i in range(q0.size):
        q1[i] = q0[i] + dt * v0[i] + bend * a0[i]
        v1[i] = v0[i] + turn * a0[i]


@plain_form(_predict)
def _plain_predict(q0: Array, v0: Array, a0: Array, q1: Array, v1: Array, dt: float, bend: float, turn: float) -> None:
    q1[:] = q0 + dt * v0 + bend * a0
    v1[:] = v0 + turn * a0


@jit
def _correct(q1: Array, v1: Array, a0: Array, a1: Array, x: Array, bend: float, turn: float, part: float) -> None:
    """Add ``bend x`` to q1 and ``turn x`` to v1, and let ``a1 = (1 - part) a0 + part x``."""
    for i in range(q1.size):
        q1[i] += bend * x[i]
        v1[i] += turn * x[i]
        a1[i] = (1.0 - part) * a0[i] + part * x[i]


@plain_form(_correct)
def _plain_correct(q1: Array, v1: Array, a0: Array, a1: Array, x: Array, bend: float, turn: float, part: float) -> None:
    q1 += bend * x
    v1 += turn * x
    a1[:] = (1.0 - part) * a0 + part * x


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
    equations: Equations, numbers: Numbers, factored: Array, compliance: Array | None, band: Array | None,
    dampers: bool, pots: Springpots | None, drift: Array | None, rules: Rules | None, force: Array, shift: Array,
    earlier: Array, chunk: Chunk, work: Work,
) -> tuple[int, int]:  # fmt: skip
    """Take the steps that a chunk has rows for.

    Arguments that may be None come separately, because numba leaves out code for arguments that are None.

    `numbers`, `factored`, `compliance`, `band`: the fields of `Size`.
    `dampers`: whether a law has a damper.
    `drift` (shape (2, steps + 2, m)): what is added to the laws' coordinates ``b.q`` at the ends of steps, and one step
    ahead, m, and its rates.
    `rules`: what rows do that are no laws at fixed places; not without `drift`.
    `force` (shape (steps, n)): loads in the balance of every step; no rows where there are none.
    `shift` (shape (steps, n)): mean velocity less the mean rate of displacement, m/s; no rows where it is zero.
    `earlier` (shape (n,)): mean acceleration over the step before that before the first one.
    Returns `taken, solves`: number of steps, fewer than asked for where the next one has no solution; and of those in
    which a law acted.
    """
    mass, stiffness, damping, rows, laws = borrowed(equations)
    chunk, work, factored = borrowed(chunk), borrowed(work), borrowed(factored)
    force, shift, earlier = borrowed(force), borrowed(shift), borrowed(earlier)
    dt, b, mean, ahead, half = numbers.dt, numbers.b, numbers.mean, numbers.ahead, numbers.b * numbers.dt * numbers.cvw
    right, x, p, some, found, kind = work.right, work.x, work.p, work.some, work.found, work.kind
    m, solves, stride = work.y.size, 0, 0
    if rules is not None:
        stride = rules.stride
    # An explicit step knows the coordinates of the laws, and solves for their rates.
    explicit, weight = numbers.cqw == 0.0, 1.0 if mean else b
    way = Way(mean, explicit, (1.0 + ahead) / weight, ahead / weight, dt)
    per_y = dt * numbers.cvw if explicit else dt * dt * numbers.cqw
    damped, shifted = damping.shape[0] > 0, shift.shape[0] > 0
    past = laws.state.size > 0
    if past:
        copy(chunk.past[0], laws.state)
    for k in range(chunk.q.shape[0] - 1):
        q0, v0, a0, q1, v1, a1 = chunk.q[k], chunk.v[k], chunk.a[k], chunk.q[k + 1], chunk.v[k + 1], chunk.a[k + 1]
        u0, before, last = chunk.u[k], chunk.damper[k], chunk.reaction[k]
        here, there, ahead_of = k * stride, (k + 1) * stride, (k + 2) * stride
        # For mean forces p is guessed, the mean rate of displacement; otherwise q1 and v1 are those without w.
        # Motion that the step does not resolve changes its velocity from step to step. It drops out of the mean
        # velocities of the two steps before, which are extrapolated here.
        if mean:
            _sum(p, v0, half, earlier if k == 0 else chunk.a[k - 1])
        else:
            _predict(q0, v0, a0, q1, v1, dt, dt * dt * numbers.cqa, dt * numbers.cva)
            for j in range(m):
                work.base[j] = dot(rows, there + j, q1)
                # Only dampers ask for it, and springpots, which count as such.
                work.rate[j] = dot(rows, there + j, v1) if dampers else 0.0
                if drift is not None:
                    work.base[j] += drift[0, k + 1, j]
                    work.rate[j] += drift[1, k + 1, j]
                if rules is not None:  # noqa: SIM102 (numba leaves out the branch only so)
                    if stride > 0:
                        work.rate[j] += dot(rules.rates, there + j, q1)
        if rules is not None:
            assert compliance is not None
            _prepare(rows, rules, k, numbers, factored, compliance, per_y, weight, u0, laws, work)
        if pots is not None:
            begin_springpots(pots, k, laws, way, chunk.pots, u0, work.base, work.rate)
        for j in range(m):
            found[j], work.held[j] = last[j], 0.0
        solved, turned = 0, False
        for again in range(4):
            if force.shape[0] > 0:
                copy(force[k], right)
            else:
                fill(right, 0.0)
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
                    work.base[j] = u0[j] + dt * dot(rows, j, p) if stride == 0 else dot(rows, there + j, q1)
                    if drift is not None:
                        work.base[j] += drift[0, k + 1, j] - (drift[0, k, j] if stride == 0 else 0.0)
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
            if solved:
                for j in range(m):
                    if turned:
                        found[j] = force_over(laws, j, way, u0[j], work.base[j], 0.0, before[j])
                    work.held[j] = found[j]
                    _pull(rows, here, there, j, kind[j], mean, b, weight * found[j], right)
            if explicit and not dampers and rules is None:
                # Forces are known before the acceleration.
                for j in range(m):
                    found[j] = force_over(laws, j, way, u0[j], work.base[j], 0.0, 0.0)
                    if found[j] != 0.0:
                        if not np.isfinite(found[j]):
                            return k, solves
                        subtract_row(rows, j, found[j], right)
                copy(right, x)
                solve(factored, x)
                break
            copy(right, x)
            solve(factored, x)
            if m > 0 and (solved or again == 0):
                answer = 0
                if rules is not None:
                    for j in range(m):
                        out, origin = there, work.rate[j] if explicit else work.base[j]
                        if kind[j] == HOLDS:
                            assert drift is not None
                            origin = work.base[j]
                            if not mean:
                                out = ahead_of
                                origin = dt * dot(rows, out + j, v1) + drift[0, k + 2, j]
                                origin += -drift[0, k + 1, j] if rules.anchored[j] else dot(rows, out + j, q1)
                        work.free[j] = origin + work.per[j] * dot(rows, out + j, x)
                    answer = _react_by_kinds(laws, rules, way, u0, before, last, b, work)
                    if answer < 0:
                        return k, solves
                    if answer > 0:
                        solved = 1
                        copy(right, x)
                        for j in range(m):
                            more = (found[j] - work.held[j]) * (weight if kind[j] == ACTS else 1.0)
                            _pull(rows, here, there, j, kind[j], mean, b, more, x)
                        solve(factored, x)
                for j in range(m):
                    work.free[j] = dot(rows, there + j, x)
                if compliance is not None and rules is None:
                    if turned:
                        answer = _correct_reactions(compliance, laws, way, u0, work, per_y, weight)
                    else:
                        answer = _react(compliance, laws, way, u0, before, work, per_y, weight)
                    if answer > 0:
                        copy(right, x)
                        for j in range(m):
                            more = work.change[j] if turned else found[j] - work.held[j]
                            if more != 0.0:
                                subtract_row(rows, j, weight * more, x)
                        solve(factored, x)
                    if mean and not turned:
                        turned = _turned(compliance, u0, work, per_y * weight)
                if band is not None:
                    answer = _react_in_band(band, laws, rows, way, u0, before, work, per_y, weight)
                if answer < 0:
                    return k, solves
                if answer > 0:
                    solved = 1
            if not mean:
                break
            _sum(p, p, half, x)
            # Errors of the factored matrix in large corrections would work in one direction for ever.
            if not turned and (again == 1 or half * _largest(x) <= _SMALL * _largest(p)):
                break
        solves += 0 if explicit else solved
        if mean:
            _sum(q1, q0, dt, p)
            if shifted:
                _sum(p, p, 1.0, shift[k])
            _between(v1, v0, 2.0, p)
            _difference(a1, 1.0 / dt, v1, v0)
        else:
            _correct(q1, v1, a0, a1, x, dt * dt * numbers.cqw, dt * numbers.cvw, 1.0 / (1.0 - numbers.alpha_m))
        for j in range(m):
            chunk.u[k + 1, j] = work.base[j] if explicit else dot(rows, there + j, q1)
            if drift is not None and not explicit:
                chunk.u[k + 1, j] += drift[0, k + 1, j]
            if rules is not None:  # noqa: SIM102
                if not rules.present[k + 1, j]:
                    chunk.u[k + 1, j] = rules.away[j]
            chunk.reaction[k + 1, j] = found[j]
            if dampers and kind[j] != ABSENT:
                rate = dot(rows, there + j, v1)
                if drift is not None:
                    rate += drift[1, k + 1, j]
                if rules is not None:  # noqa: SIM102 (numba leaves out the branch only so)
                    if stride > 0:
                        rate += dot(rules.rates, there + j, q1)
                damper = damper_over(laws, j, way, u0[j], chunk.u[k + 1, j], rate)
                chunk.damper[k + 1, j] = damper
                # A damper that acts by its mean has no force at the end.
                if not (mean or explicit):
                    chunk.reaction[k + 1, j] -= way.now * damper - way.before * before[j]
        if pots is not None:
            end_springpots(pots, k, way, chunk.pots, u0, chunk.u[k + 1], chunk.reaction[k + 1])
        if past:
            commit_laws(laws, chunk.u[k + 1])
            copy(laws.state, chunk.past[k + 1])
    return chunk.q.shape[0] - 1, solves


# -- reactions ----------------------------------------------------------------------------------------------


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
    rows: Rows, rules: Rules, k: int, numbers: Numbers, factored: Array, compliance: Array, per_y: float,
    weight: float, u0: Array, laws: Laws, work: Work,
) -> None:  # fmt: skip
    """Find what rows do in step k, and how far they give way: into `kind`, `per`, `target` and `reach` of `work`."""
    dt, mean, m, stride = numbers.dt, numbers.mean, u0.size, rules.stride
    ahead = dt * dt * (numbers.cvw + 0.5)
    for j in range(m):
        kind = rules.kind[k, j]
        work.kind[j], work.per[j], work.target[j] = kind, per_y, 0.0
        if kind == HOLDS:
            if mean and rules.anchored[j]:
                work.target[j] = u0[j]
            if not mean:
                work.per[j] = ahead if rules.anchored[j] else ahead + dt * dt * numbers.cqw
        elif kind == PUSHES:
            work.target[j] = rules.push[k, j]
        if rules.springs[j] and rules.pressing[j] < 0:
            at = laws.table[j, FIRST] + 3
            laws.parameters[at], laws.parameters[at + 1] = rules.normal[k, j], rules.normal[k + 1, j]
    for j in range(m):
        share = weight if work.kind[j] == ACTS else 1.0
        if stride > 0:
            fill(work.step, 0.0)
            _pull(rows, k * stride, (k + 1) * stride, j, work.kind[j], mean, numbers.b, -1.0, work.step)
            solve(factored, work.step)
        for i in range(m):
            out = (k + 2 if work.kind[i] == HOLDS and not mean else k + 1) * stride + i
            answer = dot(rows, out, work.step) if stride > 0 else compliance[i, j]
            work.reach[i, j] = work.per[i] * share * answer


@jit
def _react_by_kinds(
    laws: Laws, rules: Rules, way: Way, u0: Array, before: Array, last: Array, b: float, work: Work
) -> int:
    """Find the reactions of a step whose rows are of several kinds by Newton's method; return what `_react` does.

    On entry ``work.free`` holds the coordinates, or in explicit steps the rates, that depend on reactions, with the
    reactions in ``work.held`` only. A step that does not lessen what is out of balance is halved.
    """
    free, found, held, y, force, solution, best = (
        work.free, work.found, work.held, work.y, work.force, work.solution, work.best,
    )  # fmt: skip
    m, smallest, weight = u0.size, np.inf, 1.0 if way.mean else b
    for i in range(m):
        best[i], solution[i], work.slope[i] = found[i], 0.0, 0.0
        for j in range(m):
            free[i] += work.reach[i, j] * held[j]
    for step in range(_MOST):
        size = 0.0
        for i in range(m):
            y[i], work.move[i] = free[i], abs(free[i])
            for j in range(m):
                y[i] -= work.reach[i, j] * found[j]
                work.move[i] += abs(work.reach[i, j] * found[j])
        for i in range(m):
            kind, presses, share = work.kind[i], rules.pressing[i], 1.0
            own, slope, scale = 1.0, 0.0, abs(found[i])
            if presses >= 0:
                # Of laws that act at ends of steps, the force at the start takes part in the balance too.
                total = found[presses] if way.mean else weight * found[presses] + (1.0 - weight) * last[presses]
                if rules.springs[i]:
                    _press(laws, i, presses, way, u0[presses], y[presses], found[presses])
            if kind == ACTS:
                u1 = work.base[i] if way.explicit else y[i]
                force[i] = force_over(laws, i, way, u0[i], u1, y[i], before[i])
                slope = slope_over(laws, i, way, u0[i], u1)
                scale += abs(force[i]) + abs(slope) * work.move[i]
            elif kind == HOLDS:
                force[i] = found[i] + y[i] - work.target[i]
                own, slope, scale = 0.0, 1.0, work.move[i] + abs(work.target[i])
            elif kind == PUSHES:
                force[i], share = work.target[i], 0.0
                if presses >= 0:
                    share = force[i] * weight if total > 0.0 else 0.0
                    force[i] *= max(total, 0.0)
                scale += abs(force[i])
            else:
                force[i] = 0.0
            for j in range(m):
                work.matrix[i, j] = slope * work.reach[i, j] + (own if i == j else 0.0)
                if kind == PUSHES and j == presses:
                    work.matrix[i, j] -= share
            work.change[i] = force[i] - found[i]
            if not np.isfinite(force[i]):
                return -1
            # What large forces leave behind when they vanish is rounding.
            work.slope[i] = max(work.slope[i], scale)
            if work.change[i] != 0.0:
                size = max(size, abs(work.change[i]) / work.slope[i] if work.slope[i] > 0.0 else np.inf)
        if size <= 4.0 * _EPS * 2.0 ** min(step, 12):
            acts = 0
            for i in range(m):
                if found[i] != 0.0 or held[i] != 0.0:
                    acts = 1
            return acts
        if size >= smallest and step % 8 > 0:
            for i in range(m):
                solution[i] *= 0.5
        else:
            smallest = min(size, smallest)
            copy(found, best)
            copy(work.change, solution)
            _eliminate(work.matrix, solution, m)
        for i in range(m):
            found[i] = best[i] + solution[i]
    return -1


@jit
def _press(laws: Laws, j: int, presses: int, way: Way, u0: float, u1: float, mean: float) -> None:
    """Tell law j the normal forces at both ends of a step, found from the force of the law that presses."""
    rise = 0.0
    if way.mean:
        rise = ask(laws, presses, FORCE, u1, u1) - ask(laws, presses, FORCE, u0, u0)
    at = laws.table[j, FIRST] + 3
    laws.parameters[at], laws.parameters[at + 1] = max(mean - 0.5 * rise, 0.0), max(mean + 0.5 * rise, 0.0)


@jit
def _react(
    compliance: Array, laws: Laws, way: Way, u0: Array, before: Array, work: Work, per_y: float, weight: float
) -> int:  # fmt: skip
    """Find the reactions of a step through the compliance; return the Newton steps, 0 where no law acts, or -1.

    On entry ``work.found`` holds a guess of the reactions, and ``work.free`` what ``b_j.x`` is without those that are
    not in ``work.held``. Coordinates of the laws, or their rates in explicit steps, are affine in ``b_j.x``; from here
    on `free` and `y` hold these.
    """
    compliance, laws, u0, before, work = borrowed((compliance, laws, u0, before, work))
    y, free, found, force, slope, change, move = (
        work.y, work.free, work.found, work.force, work.slope, work.change, work.move,
    )  # fmt: skip
    m, reach, acts = y.size, per_y * weight, False
    for i in range(m):
        free[i] = (work.rate[i] if way.explicit else work.base[i]) + per_y * free[i]
    for j in range(m):
        if work.held[j] != 0.0:
            for i in range(m):
                free[i] += reach * compliance[j, i] * work.held[j]
    for j in range(m):
        force[j] = force_over(laws, j, way, u0[j], work.base[j] if way.explicit else free[j], free[j], before[j])
        acts = acts or force[j] != 0.0
    if not acts or way.explicit:
        fill(found, 0.0)
    if not acts:
        return 0
    for step in range(_MOST):
        off, size, size_of = 0.0, 0, 0.0
        for j in range(m):
            y[j], change[j] = free[j], 0.0
        for i in range(m):
            if found[i] != 0.0:
                for j in range(m):
                    y[j] -= reach * compliance[i, j] * found[i]
        for j in range(m):
            if way.explicit:
                # Forces are known but for dampers, which are linear in the rate.
                slope[j] = slope_over(laws, j, way, u0[j], work.base[j])
            else:
                force[j] = force_over(laws, j, way, u0[j], y[j], 0.0, before[j])
                slope[j] = slope_over(laws, j, way, u0[j], y[j])
            if not np.isfinite(force[j]):
                return -1
            off, size_of = max(off, abs(force[j] - found[j])), max(size_of, abs(force[j]) + abs(found[j]))
            if force[j] != 0.0 or slope[j] != 0.0 or found[j] != 0.0:
                work.active[size] = j
                size += 1
        for e in range(size):
            i = work.active[e]
            change[i] = force[i] - found[i]
            work.solution[e] = change[i]
            for f in range(size):
                coupling = slope[i] * (reach * compliance[i, work.active[f]])
                work.matrix[e, f] = coupling + (1.0 if e == f else 0.0)
        # numba would compile for the constant 0 too.
        _eliminate(work.matrix, work.solution, int(size))
        # Rounding in a steep law can keep the last digits from converging, so the tolerance grows with each step.
        still, rounded = True, True
        for j in range(m):
            move[j], scale = 0.0, abs(free[j])
            for e in range(size):
                i = work.active[e]
                move[j] -= reach * compliance[j, i] * work.solution[e]
                scale += abs(reach * compliance[j, i] * found[i])
            still = still and abs(move[j]) <= 4.0 * _EPS * scale
            # In a law much stiffer than the structure, the rounding of u may be the largest error of its force.
            noise = 4.0 * _EPS * (abs(force[j]) + abs(found[j]) + slope[j] * scale)
            rounded = rounded and abs(force[j] - found[j]) <= noise
        for e in range(size):
            # A law without slope has an exact row; elimination would add the rounding of other rows to it.
            if slope[work.active[e]] != 0.0:
                change[work.active[e]] = work.solution[e]
        settled = way.explicit or still or off <= _EPS * 2.0 ** min(step, 22) * size_of
        settled = settled or (rounded and step >= _PATIENCE)
        length, low, high = 1.0, 0.0, 1.0
        if not settled:
            # The convex function along the way is smallest where its derivative is zero.
            for halving in range(52):
                total = 0.0
                for e in range(m):
                    if move[e] != 0.0:
                        there = force_over(laws, e, way, u0[e], y[e] + length * move[e], 0.0, before[e])
                        total += move[e] * (there - found[e] - length * change[e])
                if halving == 0 and total <= 0.0:
                    break
                if total > 0.0:
                    high = length
                else:
                    low = length
                length = 0.5 * (low + high)
                if high - low <= 1e-3 * low:
                    break
        for e in range(size):
            found[work.active[e]] += length * change[work.active[e]]
        if settled:
            return step + 1
    return -1


@jit
def _turned(compliance: Array, u0: Array, work: Work, reach: float) -> bool:
    """Return whether reactions move a coordinate so much within the step that rounding of them leaves it no digits."""
    for j in range(u0.size):
        if reach * compliance[j, j] * abs(work.found[j]) > _TURNED * (abs(u0[j]) + abs(work.base[j])):
            return True
    return False


@jit
def _correct_reactions(
    compliance: Array, laws: Laws, way: Way, u0: Array, work: Work, per_y: float, weight: float
) -> int:  # fmt: skip
    """Correct reactions by one step of Newton's method, from the laws' forces at the coordinates found so far.

    On entry ``work.held`` holds these forces and ``work.free`` what ``b_j.x`` is with them. The corrections stay apart,
    in ``work.change``: as a part of large reactions they would lose their digits.
    """
    compliance, laws, u0, work = borrowed((compliance, laws, u0, work))
    m = u0.size
    for i in range(m):
        slope = slope_over(laws, i, way, u0[i], work.base[i])
        work.solution[i] = slope * per_y * work.free[i]
        for j in range(m):
            work.matrix[i, j] = slope * (per_y * weight * compliance[i, j]) + (1.0 if i == j else 0.0)
    _eliminate(work.matrix, work.solution, m)
    for j in range(m):
        work.change[j] = work.solution[j]
        work.found[j] = work.held[j] + work.solution[j]
    return 1


@jit
def _react_in_band(
    matrix: Array, laws: Laws, rows: Rows, way: Way, u0: Array, before: Array, work: Work, per_y: float, weight: float
) -> int:  # fmt: skip
    """Find the reactions of a step and x by Newton's method on x; return what `_react` does.

    Reactions are extrapolated along the laws' tangents. They balance the structure to the last digit, also where a law
    is so steep that the rounding of u changes its force.
    """
    matrix, laws, rows, u0, before, work = borrowed((matrix, laws, rows, u0, before, work))
    x, y, free, found, held, force, slope, turn = (
        work.x, work.y, work.free, work.found, work.held, work.force, work.slope, work.move,
    )  # fmt: skip
    m, per_u, per_r = y.size, 0.0 if way.explicit else per_y, per_y if way.explicit else 0.0
    origin, band, move, product = work.rate if way.explicit else work.base, work.band, work.step, work.some
    acts = False
    for j in range(m):
        u, r = work.base[j] + per_u * free[j], work.rate[j] + per_r * free[j]
        acts = acts or held[j] != 0.0 or force_over(laws, j, way, u0[j], u, r, before[j]) != 0.0
    if not acts:
        fill(found, 0.0)
        return 0
    fill(x, 0.0)
    whole_step = False
    for step in range(_MOST):
        off, size = 0.0, 0.0
        for j in range(m):
            y[j] = dot(rows, j, x)
            if way.explicit:
                force[j] = force_over(laws, j, way, u0[j], work.base[j], work.rate[j] + per_r * y[j], before[j])
                slope[j] = slope_over(laws, j, way, u0[j], work.base[j])
            else:
                u = work.base[j] + per_u * y[j]
                force[j] = force_over(laws, j, way, u0[j], u, 0.0, before[j])
                slope[j] = slope_over(laws, j, way, u0[j], u)
            if not np.isfinite(force[j]):
                return -1
            off, size = max(off, abs(force[j] - found[j])), max(size, abs(force[j]) + abs(found[j]))
        # Rounding in a steep law can keep the last digits from converging, so the tolerance grows with each step.
        demand = _EPS * 2.0 ** min(step, 22)
        if whole_step and off <= demand * size:
            return step
        for a in range(band.shape[0]):
            copy(matrix[a], band[a])
        copy(work.right, move)
        subtract_product(matrix, x, move)
        for j in range(m):
            if force[j] != held[j]:
                subtract_row(rows, j, weight * (force[j] - held[j]), move)
            if slope[j] != 0.0:
                for e in range(rows.start[j], rows.start[j + 1]):
                    for f in range(rows.start[j], rows.start[j + 1]):
                        below = rows.column[e] - rows.column[f]
                        if below >= 0:
                            more = weight * per_y * slope[j] * rows.weight[e] * rows.weight[f]
                            band[below, rows.column[f]] += more
        copy(move, product)
        if factor_in_place(band) >= 0:
            return -1
        solve(band, move)
        downhill, stiff, still = inner(move, product), 0.0, True
        for j in range(m):
            turn[j] = dot(rows, j, move)
            still = still and abs(per_y * turn[j]) <= demand * (abs(origin[j]) + abs(per_y * y[j]))
        length, low, high = 1.0, 0.0, 1.0
        if not still:
            fill(product, 0.0)
            subtract_product(matrix, move, product)
            stiff = -inner(move, product)
            # The convex function along the way is smallest where its derivative is zero.
            for halving in range(52):
                total = length * stiff - downhill
                for j in range(m):
                    if turn[j] != 0.0:
                        z = y[j] + length * turn[j]
                        u, r = work.base[j] + per_u * z, work.rate[j] + per_r * z
                        there = force_over(laws, j, way, u0[j], u, r, before[j])
                        total += weight * turn[j] * (there - force[j])
                if halving == 0 and total <= _FLAT * downhill:
                    break
                if total > 0.0:
                    high = length
                else:
                    low = length
                length = 0.5 * (low + high)
                if high - low <= 1e-3 * low:
                    break
        _sum(x, x, length, move)
        for j in range(m):
            found[j] = force[j] + slope[j] * (per_y * length * turn[j])
        whole_step = length == 1.0
        if still:
            return step + 1
    return -1


@jit
def _eliminate(matrix: Array, x: Array, size: int) -> None:
    """Solve the first equations of a matrix, which is overwritten, for x in place."""
    for i in range(size):
        best = i
        for r in range(i + 1, size):
            if abs(matrix[r, i]) > abs(matrix[best, i]):
                best = r
        if best != i:
            for c in range(i, size):
                matrix[i, c], matrix[best, c] = matrix[best, c], matrix[i, c]
            x[i], x[best] = x[best], x[i]
        if matrix[i, i] != 0.0:
            for r in range(i + 1, size):
                if matrix[r, i] != 0.0:
                    factor = matrix[r, i] / matrix[i, i]
                    for c in range(i + 1, size):
                        matrix[r, c] -= factor * matrix[i, c]
                    x[r] -= factor * x[i]
    for i in range(size - 1, -1, -1):
        for c in range(i + 1, size):
            x[i] -= matrix[i, c] * x[c]
        x[i] = x[i] / matrix[i, i] if matrix[i, i] != 0.0 else np.nan


@plain_form(_eliminate)
def _plain_eliminate(matrix: Array, x: Array, size: int) -> None:
    if size == 1:
        x[0] /= matrix[0, 0]
    else:
        x[:size] = np.linalg.solve(matrix[:size, :size], x[:size])
