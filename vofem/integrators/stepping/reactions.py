"""The reactions of the laws in one step: one search for all methods, all kinds of rows, and both ways of coupling them.

Let u_j be what the force of row j depends on: its coordinate at the end of the step, or in explicit steps its rate
there. The structure answers forces R on the rows by ``u = free - G (R - held)``, and a row asks of its force

======== =====================================================================================
ACTS     the force of its law, R = law(u)
HOLDS    whatever brings its coordinate to a place, u = target
PUSHES   a known force, R = target, times the normal force where another law presses
ABSENT   nothing, R = 0
======== =====================================================================================

Newton's method runs on R: where s are the slopes of the laws, a step d solves ``(1 + s G) d = law(u) - R``. Where laws
are few, G is a matrix. Where there are about as many laws as unknowns, ``A + B' s B`` is still a narrow band, and d
follows from its answer. Where forces do not fall, R minimises a convex function along every step, so that a bisection
of its derivative leads to the only minimum from any start. Rows that hold, push or are absent agree with their demands
after the first whole step, and in all parts of later ones.

A rigid slider holds while it sticks, and pushes while it slides. Where one does not agree with its force, it changes,
and the search begins anew from the forces found.

Kernels find these functions by their addresses and what they take by one table of places, so that they are compiled
once, and only where a scene has laws.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.kernels.addresses import address_of, call, floats, integers, place_of, shaped
from vofem.kernels.jit import CompiledFunction, jit, plain_form
from vofem.laws.law import (
    END,
    FIRST,
    FORCE,
    MEAN_TANGENT,
    START,
    Laws,
    Way,
    ask,
    commit_law,
    damper_over,
    force_over,
    slope_over,
)
from vofem.laws.rows import Rows, dot, subtract_row
from vofem.linalg.banded import factor_in_place, solve
from vofem.linalg.vectors import copy, fill

_MOST = 200
_EPS = float(np.finfo(float).eps)

#: Newton steps after which a residual at the rounding level of its own terms is accepted.
_PATIENCE = 30

#: Slope of the convex function at the end of a full Newton step, over that at its start, up to which it is taken.
_FLAT = 1e-12

#: Times that all sliders which do not agree may change at once; later only the first one does, which ends circles.
_AT_ONCE = 8

#: What a row does, see the module.
ACTS, HOLDS, PUSHES, ABSENT = range(4)

#: What is asked of laws: forces where all rows act; what rows ask for, with slopes; the slope of the convex function
#: a part of a step further; and forces of dampers at the end, after which internal variables are those there.
FORCES_AT, SLOPES_AT, ALONG, FINISH = range(4)

#: Rows of the numbers of the laws, (n, m). Given: reactions that the residual holds already, coordinates at the start,
#: those that the state found so far has at the end, and their rates; mean forces of dampers in the step before, and
#: reactions at its end; u without reactions, and its rise with ``b_j.x``; places of rows that hold, or forces of those
#: that push; of sliders the force that pushes, and that up to which they hold (inf: for ever), per normal force.
#: Found: reactions, what they are beyond those held, forces of dampers, and those at which sliders have broken away.
(
    HELD, U0, BASE, RATE, BEFORE, LAST, FREE, PER, TARGET, PUSH, LIMIT, FOUND, MORE, DAMPER, REACHED
) = range(15)  # fmt: skip
#: Then work space: u; the sizes of the terms that it is a sum of; forces that rows ask for, and their slopes, also over
#: the force of the law that presses; a step of R, and how it moves u.
Y, SIZE, FORCES, SLOPE, SHARE, STEP, MOVE, _SOLUTION = range(15, 23)
_NUMBERS_OF_LAWS = 23

#: Rows of whole numbers of the laws: what the row does, the law that presses or -1, whether the law takes the normal
#: forces at both ends of a step, as the last two of five numbers; of sliders, the direction in which they slide, or 0;
#: and work space.
KIND, PRESSING, SPRUNG, STATUS, _ACTIVE = range(5)

#: The numbers: those of `Way`, the rise of u with ``b_j.x``, and the part of a reaction in the balance of a step.
MEAN_FORCES, EXPLICIT, NOW, EARLIER, STEP_SIZE, PER_Y, PART = range(7)

#: Entries of the table: sizes, addresses of `_ask_laws`, `_react` and `_in_band` (or 0), and places of arrays.
(
    _COUNT, _SIZE_OF_BAND, _UNKNOWNS, _ENTRIES, _PARAMETERS_SIZE, _STATE_SIZE, _ASK, _REACT, _BAND, _NUMBERS,
    _OF_LAWS, _WHOLE, _COUPLING, _MATRIX, _TABLE, _PARAMETERS, _STATE, _START, _COLUMN, _WEIGHT, _FACTORED, _SPARE,
    _FACTORED_SIZE,
) = range(23)  # fmt: skip


class Reactions(NamedTuple):
    """How kernels ask laws and reactions, ``call(address, place, numbers, 0, numbers, 0, question, 0.0)``."""

    laws: int  #: Address of `_ask_laws`.
    address: int  #: Of `_react`, or `_slide` where there are rigid sliders.
    place: int  #: Of the table.
    numbers: Array
    of_laws: Array
    whole: NDArray[np.int64]
    #: Coordinates for unit forces on the rows, shape (m, m); where reactions are found in the band, A, and A factored.
    coupling: Array
    factored: Array


def reactions_of(
    laws: Laws, rows: Rows, coupling: Array, factored: Array, banded: bool, slides: bool
) -> tuple[Reactions, list[NDArray[Any]]]:
    """Return how kernels ask laws and reactions in steps whose matrices have these shapes, and arrays to keep."""
    m, n = laws.table.shape[0], factored.shape[1]
    numbers, of_laws, whole = np.zeros(7), np.zeros((_NUMBERS_OF_LAWS, m)), np.zeros((5, m), dtype=np.int64)
    whole[PRESSING] = -1
    coupling, matrix, spare, factored = (np.zeros_like(part) for part in (coupling, coupling, factored[0], factored))
    kept: list[NDArray[Any]] = [numbers, of_laws, whole, coupling, matrix, *laws, *rows, factored, spare]
    kernels = ((_ask_laws, m > 0), (_react, m > 0), (_in_band, banded), (_slide, slides))
    ask_laws, react, band, slide = (address_of(cast(CompiledFunction, it)) if used else 0 for it, used in kernels)
    sizes = [m, coupling.shape[0], n, rows.weight.size, laws.parameters.size, laws.state.size]
    table = np.array([*sizes, ask_laws, react, band, *map(place_of, kept), factored.shape[0]])
    search = slide or react
    return Reactions(ask_laws, search, place_of(table), numbers, of_laws, whole, coupling, factored), [table, *kept]


def begin_reactions(
    reactions: Reactions, way: Way, per_y: float, part: float, coupling: Array, factored: Array, banded: bool
) -> None:
    """Enter what belongs to steps of one size; `coupling` is that of `Size`."""
    reactions.numbers[:] = *way, per_y, part
    reactions.of_laws[PER] = per_y
    if banded:
        reactions.coupling[:], reactions.factored[:] = coupling, factored
    elif coupling.size:
        reactions.coupling[:] = per_y * part * coupling


@jit
def named(reactions: Reactions) -> tuple[Array, ...]:
    """Return the rows of the numbers of laws that a step reads or writes, in their order."""
    w = reactions.of_laws
    return (
        w[HELD], w[U0], w[BASE], w[RATE], w[BEFORE], w[LAST], w[FREE], w[PER], w[Y], w[FOUND], w[MORE], w[DAMPER],
    )  # fmt: skip


@jit
def _ask_laws(place: int, p: Any, z: Any, question: float, part: float) -> float:
    """Answer a question on all rows in a step: into their numbers, and the sum over rows of what was asked.

    The sum is that of the magnitudes of forces, and NaN or infinite where a force is; or the slope along a step.
    """
    at = shaped(integers(place), (23,))
    m, answer = at[_COUNT], 0.0
    laws = Laws(
        shaped(integers(at[_TABLE]), (m, 6)), shaped(floats(at[_PARAMETERS]), (at[_PARAMETERS_SIZE],)),
        shaped(floats(at[_STATE]), (at[_STATE_SIZE],)),
    )  # fmt: skip
    numbers = shaped(floats(at[_NUMBERS]), (7,))
    w, whole = shaped(floats(at[_OF_LAWS]), (_NUMBERS_OF_LAWS, m)), shaped(integers(at[_WHOLE]), (5, m))
    mean, explicit, weight = numbers[MEAN_FORCES] > 0.0, numbers[EXPLICIT] > 0.0, numbers[PART]
    way = Way(mean, explicit, numbers[NOW], numbers[EARLIER], numbers[STEP_SIZE])
    for j in range(m):
        kind, presses, u0, y = whole[KIND, j], whole[PRESSING, j], w[U0, j], w[Y, j]
        if question == FINISH:
            w[DAMPER, j] = damper_over(laws, j, way, u0, y, w[RATE, j]) if kind != ABSENT else 0.0
            if laws.table[j, END] > laws.table[j, START]:
                commit_law(laws, j, y)
            continue
        if question == ALONG:
            # The normal force that a law knows is the one found so far, under which its force does not fall either.
            if kind == ACTS and w[MOVE, j] != 0.0:
                y += part * w[MOVE, j]
                force = force_over(laws, j, way, u0, w[BASE, j] if explicit else y, y, w[BEFORE, j])
                answer += w[MOVE, j] * (force - w[FOUND, j] - part * w[STEP, j])
            continue
        u1 = w[BASE, j] if explicit else y
        if question == FORCES_AT:
            w[FORCES, j] = force_over(laws, j, way, u0, u1, y, w[BEFORE, j])
            answer += abs(w[FORCES, j])
            continue
        force, slope, share = 0.0, 0.0, 0.0
        if kind == ACTS:
            if whole[SPRUNG, j] and presses >= 0:
                # The normal forces at both ends follow from the mean force of the law that presses.
                rise, at_first = 0.0, laws.table[j, FIRST] + 3
                if mean:
                    rise = ask(laws, presses, FORCE, w[Y, presses], w[Y, presses])
                    rise -= ask(laws, presses, FORCE, w[U0, presses], w[U0, presses])
                laws.parameters[at_first] = max(w[FOUND, presses] - 0.5 * rise, 0.0)
                laws.parameters[at_first + 1] = max(w[FOUND, presses] + 0.5 * rise, 0.0)
            force = force_over(laws, j, way, u0, u1, y, w[BEFORE, j])
            # The mean force of a law that knows the normal force is no work over a length.
            own = mean and whole[SPRUNG, j]
            slope = ask(laws, j, MEAN_TANGENT, u0, u1) if own else slope_over(laws, j, way, u0, u1, force)
        elif kind == HOLDS:
            force, slope = w[FOUND, j], 1.0
        elif kind == PUSHES:
            force = w[TARGET, j]
            if presses >= 0:
                normal = _pressed(w, presses, weight)
                share = force * weight if normal > 0.0 else 0.0
                force *= normal
        # A row that holds asks for a coordinate and not for a force.
        off = y - w[TARGET, j] if kind == HOLDS else force - w[FOUND, j]
        w[FORCES, j], w[SLOPE, j], w[SHARE, j], w[STEP, j] = force, slope, share, off
        answer += abs(force)
    return answer


@jit
def _react(place: int, p: Any, z: Any, question: float, unused: float) -> float:
    """Find the reactions of a step; return the number of Newton steps, 0 where no law acts, -1 without a solution."""
    at = shaped(integers(place), (23,))
    m, of_laws, band = at[_COUNT], at[_ASK], at[_BAND]
    w, whole = shaped(floats(at[_OF_LAWS]), (_NUMBERS_OF_LAWS, m)), shaped(integers(at[_WHOLE]), (5, m))
    numbers, square = shaped(floats(at[_NUMBERS]), (7,)), 0 if band else m
    reach, matrix = shaped(floats(at[_COUPLING]), (square, square)), shaped(floats(at[_MATRIX]), (square, square))
    explicit = numbers[EXPLICIT] > 0.0
    acts, alone, sprung = 0.0, True, False
    for j in range(m):
        alone, sprung = alone and whole[KIND, j] == ACTS and not whole[SPRUNG, j], sprung or whole[SPRUNG, j] > 0
        acts += abs(w[HELD, j])
    if acts == 0.0 and alone:
        copy(w[FREE], w[Y])
        if call(of_laws, place, w, 0, w, 0, FORCES_AT, 0.0) == 0.0:
            fill(w[FOUND], 0.0)
            return 0.0
    if explicit and alone:
        fill(w[FOUND], 0.0)
    # What reactions are beyond those held stays apart: large reactions would take its digits.
    for j in range(m):
        w[MORE, j] = w[FOUND, j] - w[HELD, j]
    demand = _EPS
    for step in range(_MOST):
        if band:
            call(band, place, w, 0, w, 0, 0.0, 0.0)
        else:
            _coordinates(w, reach)
        if not np.isfinite(call(of_laws, place, w, 0, w, 0, SLOPES_AT, 0.0)):
            return -1.0
        # Rounding in a steep law can keep the last digits from converging, so the tolerance grows with each step.
        off, size, placed, start = 0.0, 0.0, True, 0.0
        for j in range(m):
            change, terms = abs(w[STEP, j]), abs(w[FORCES, j]) + abs(w[FOUND, j])
            if whole[KIND, j] == HOLDS:
                terms = w[SIZE, j] + abs(w[TARGET, j])
            else:
                off, size = max(off, change), max(size, terms)
            placed = placed and (whole[KIND, j] == ACTS or change <= 4.0 * demand * terms)
        if band:
            if call(band, place, w, 0, w, 0, 1.0, 0.0) < 0.0:
                return -1.0
        else:
            _through_matrix(w, whole, reach, matrix)
        still, rounded = not sprung, True
        for j in range(m):
            change = w[FORCES, j] - w[FOUND, j]
            # In a law much stiffer than the structure, the rounding of u may be the largest error of its force.
            noise = 4.0 * _EPS * (abs(w[FORCES, j]) + abs(w[FOUND, j]) + w[SLOPE, j] * w[SIZE, j])
            if whole[KIND, j] == HOLDS:
                change, noise = w[Y, j] - w[TARGET, j], 4.0 * _EPS * (w[SIZE, j] + abs(w[TARGET, j]))
            still = still and abs(w[MOVE, j]) <= 4.0 * _EPS * w[SIZE, j]
            rounded = rounded and abs(change) <= noise
            if whole[KIND, j] == ACTS:
                start += w[MOVE, j] * change
        settled = still or (explicit and alone) or (placed and off <= demand * size)
        settled = settled or (rounded and step >= _PATIENCE)
        length, low, high = 1.0 if placed or step < _PATIENCE else 0.5, 0.0, 1.0
        if placed and not settled:
            # The convex function along the way is smallest where its derivative is zero.
            for halving in range(52):
                total = call(of_laws, place, w, 0, w, 0, ALONG, length)
                if halving == 0 and total <= _FLAT * abs(start):
                    break
                if total > 0.0:
                    high = length
                else:
                    low = length
                length = 0.5 * (low + high)
                if high - low <= 1e-3 * low:
                    break
        for j in range(m):
            w[MORE, j] += length * w[STEP, j]
            w[FOUND, j] = w[HELD, j] + w[MORE, j]
        if settled:
            for j in range(m):
                acts += abs(w[FOUND, j])
            return step + 1.0 if acts > 0.0 else 0.0
        demand *= 2.0 if step < 22 else 1.0
    return -1.0


@jit
def _slide(place: int, p: Any, z: Any, question: float, unused: float) -> float:
    """Do what `_react` does, and change which sliders stick until all agree with their forces.

    One that sticks breaks away where its force is beyond the limit. If it moves against its force then, it sticks.
    """
    at = shaped(integers(place), (23,))
    m, react = at[_COUNT], at[_REACT]
    w, whole = shaped(floats(at[_OF_LAWS]), (_NUMBERS_OF_LAWS, m)), shaped(integers(at[_WHOLE]), (5, m))
    numbers, reach = shaped(floats(at[_NUMBERS]), (7,)), shaped(floats(at[_COUPLING]), (m, m))
    for again in range(_MOST):
        answer, changed = call(react, place, w, 0, w, 0, question, 0.0), 0
        if answer < 0.0:
            return answer
        for j in range(m):
            if w[LIMIT, j] == np.inf or (changed and again >= _AT_ONCE):
                continue
            force, limit, anchor = w[FOUND, j], w[LIMIT, j], w[U0, j] if numbers[MEAN_FORCES] > 0.0 else 0.0
            if whole[PRESSING, j] >= 0:
                limit *= _pressed(w, whole[PRESSING, j], numbers[PART])
            if whole[KIND, j] == HOLDS:
                # A force whose loss would move nothing is rounding, which decides where nothing else holds.
                noise = (8.0 if limit > 0.0 else 64.0) * _EPS * (abs(w[U0, j]) + abs(w[BASE, j]))
                moves = reach[j, j] * abs(force) > noise
                if moves and abs(force) - limit > 1e-12 * abs(force):
                    whole[KIND, j], whole[STATUS, j], changed = PUSHES, 1 if force > 0.0 else -1, 1
                    w[REACHED, j], w[TARGET, j] = abs(force), whole[STATUS, j] * w[PUSH, j]
            elif w[REACHED, j] > 0.0 and limit > 0.0 and (w[Y, j] - anchor) * whole[STATUS, j] < 0.0:
                whole[KIND, j], whole[STATUS, j], w[TARGET, j], changed = HOLDS, 0, anchor, 1
        if not changed:
            return answer
    return -1.0


@jit
def _pressed(w: Array, presses: int, weight: float) -> float:
    """Return the normal force at the time of balance by the law that presses, N."""
    # Of laws that act at ends of steps, the force at the start takes part in the balance too.
    return max(weight * w[FOUND, presses] + (1.0 - weight) * w[LAST, presses], 0.0)


@jit
def _coordinates(w: Array, reach: Array) -> None:
    """Find the coordinates with the reactions found so far, and the sizes of their terms, by the matrix G."""
    m = reach.shape[0]
    for j in range(m):
        w[Y, j], w[SIZE, j] = w[FREE, j], abs(w[FREE, j])
    for i in range(m):
        more = w[MORE, i]
        if more != 0.0:
            for j in range(m):
                w[Y, j] -= reach[j, i] * more
                w[SIZE, j] += abs(reach[j, i] * more)


@jit
def _through_matrix(w: Array, whole: NDArray[np.int64], reach: Array, matrix: Array) -> None:
    """Turn what rows ask for beyond their reactions, `STEP`, into a step of Newton's method by the matrix G."""
    count = 0
    for j in range(reach.shape[0]):
        if w[FORCES, j] != 0.0 or w[SLOPE, j] != 0.0 or w[FOUND, j] != 0.0:
            whole[_ACTIVE, count] = j
            count += 1
    for e in range(count):
        i = whole[_ACTIVE, e]
        w[_SOLUTION, e] = w[STEP, i]
        for f in range(count):
            j = whole[_ACTIVE, f]
            matrix[e, f] = w[SLOPE, i] * reach[i, j]
            if e == f and whole[KIND, i] != HOLDS:
                matrix[e, f] += 1.0
            if j == whole[PRESSING, i]:
                matrix[e, f] -= w[SHARE, i]
    # numba would compile for the constant 0 too.
    _eliminate(matrix, w[_SOLUTION], int(count))
    for j in range(reach.shape[0]):
        w[MOVE, j] = 0.0
        for e in range(count):
            w[MOVE, j] -= reach[j, whole[_ACTIVE, e]] * w[_SOLUTION, e]
    for e in range(count):
        # A law without slope has an exact row; elimination would add the rounding of other rows to it.
        i = whole[_ACTIVE, e]
        if w[SLOPE, i] != 0.0 or w[SHARE, i] != 0.0:
            w[STEP, i] = w[_SOLUTION, e]


@jit
def _in_band(place: int, p: Any, z: Any, step: float, unused: float) -> float:
    """Do what `_coordinates` does, or where a step is asked for what `_through_matrix` does, by bands of A.

    Returns -1 where the slopes leave A without a solution.
    """
    at = shaped(integers(place), (23,))
    m, n, width, entries, numbers = at[_COUNT], at[_UNKNOWNS], at[_SIZE_OF_BAND], at[_ENTRIES], at[_NUMBERS]
    w, x = shaped(floats(at[_OF_LAWS]), (_NUMBERS_OF_LAWS, m)), shaped(floats(at[_SPARE]), (n,))
    rows = Rows(
        shaped(integers(at[_START]), (m + 1,)), shaped(integers(at[_COLUMN]), (entries,)),
        shaped(floats(at[_WEIGHT]), (entries,)),
    )  # fmt: skip
    per_y, part = shaped(floats(numbers), (7,))[PER_Y], shaped(floats(numbers), (7,))[PART]
    matrix, band = shaped(floats(at[_COUPLING]), (width, n)), shaped(floats(at[_MATRIX]), (width, n))
    factored = shaped(floats(at[_FACTORED]), (at[_FACTORED_SIZE], n))
    if step == 0.0:
        # What reactions did if none of them cancelled others: u is the sum of terms so large.
        fill(x, 0.0)
        for j in range(m):
            for e in range(rows.start[j], rows.start[j + 1]):
                x[rows.column[e]] += abs(part * w[MORE, j] * rows.weight[e])
        solve(factored, x)
        for j in range(m):
            w[SIZE, j] = abs(w[FREE, j])
            for e in range(rows.start[j], rows.start[j + 1]):
                w[SIZE, j] += abs(per_y * rows.weight[e] * x[rows.column[e]])
    fill(x, 0.0)
    for j in range(m):
        force = w[STEP, j] if step > 0.0 else w[MORE, j]
        if force != 0.0:
            subtract_row(rows, j, part * force, x)
    if step == 0.0:
        solve(factored, x)
        for j in range(m):
            w[Y, j] = w[FREE, j] + per_y * dot(rows, j, x)
        return 0.0
    for a in range(width):
        copy(matrix[a], band[a])
    for j in range(m):
        if w[SLOPE, j] != 0.0:
            for e in range(rows.start[j], rows.start[j + 1]):
                for f in range(rows.start[j], rows.start[j + 1]):
                    below = rows.column[e] - rows.column[f]
                    if below >= 0:
                        band[below, rows.column[f]] += part * per_y * w[SLOPE, j] * rows.weight[e] * rows.weight[f]
    if factor_in_place(band) >= 0:
        return -1.0
    solve(band, x)
    for j in range(m):
        w[MOVE, j] = per_y * dot(rows, j, x)
        w[STEP, j] += w[SLOPE, j] * w[MOVE, j]
    return 0.0


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
