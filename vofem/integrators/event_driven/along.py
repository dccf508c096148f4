"""Motion along segments of known contact statuses and durations, and its derivatives; no event is searched.

A column is the derivative of the motion with respect to one unknown. The unknown may change the state at the beginning
and the durations of segments. At a fixed time a column W of a segment follows the linear part of the motion. At the end
of the segment, whose time changes by T, the state changes by ``W + f T`` with the rates f of the state there. The next
segment begins with the column ``W + f T - f_next T``. Nothing is divided by the rate of a gap function, so this holds
at grazings too. At an impact on a rigid stop the state and ``W + f T`` pass the same linear map.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.integrators.event_driven.blocks import at_steps, response
from vofem.integrators.event_driven.clusters import Group
from vofem.integrators.event_driven.exosystem import exosystem, gathered, pushes
from vofem.integrators.event_driven.flow import modes_of, sizes_of
from vofem.integrators.event_driven.pieces import (
    Maps,
    Pieces,
    Still,
    Structure,
    maps,
    pass_segments,
    pieces,
    still,
    structure,
)
from vofem.integrators.event_driven.regime import Integers, Motion, Regime, Regimes, flat, start_motion
from vofem.kernels.mode import kernels
from vofem.system import PINNED, Counters, System

if TYPE_CHECKING:
    from vofem.integrators.event_driven.sliders import Sliders
    from vofem.laws import FrictionLaws

Status = NDArray[np.int64]

#: Largest growth of a motion over a segment of negative duration, as the logarithm of a factor.
_GROWTH = 20.0

#: Times at which motions are computed together.
_TOGETHER = 4096

#: Rounding of a product of vectors, as a share of the product of their norms.
_EPS = 4.0 * float(np.finfo(float).eps)

#: Sets of statuses whose maps a system keeps.
_MOST_SETS = 4


@dataclass(frozen=True)
class Path:
    """A motion through m segments with k columns, over n modes and c contacts.

    Attributes
    ----------
    course : Course
    statuses : list of ndarray of int, each (c,)
    times, durations : ndarray, shape (m,)
        In s; durations may be slightly negative.
    begins, starts, ends : ndarray, shape (m, 2n)
        Modal states, at the begin before and after pinned contacts are put at their gaps.
    means : ndarray, shape (m, c)
        Mean rates of the contacts' coordinates; those at the start if the duration is zero.
    shifts : ndarray, shape (m, k)
        Derivatives of the times of the ends.
    end_rows, mean_rows : ndarray, shape (m, c, k)
        Derivatives of the contacts' coordinates at the ends, whose times move with `shifts`, and of `means`.
    columns : ndarray, shape (2n, k)
        Derivatives of the last state.
    all_columns : ndarray, shape (m, 2n, k)
        Derivatives of the states at all ends; empty where they were not asked for.
    sizes, missed : (float, float)
        Largest norms of displacement and velocity, and of what segments miss of the states given for the next ones.
    """

    course: Course
    statuses: Sequence[Status]
    times: Array
    durations: Array
    begins: Array
    starts: Array
    ends: Array
    means: Array
    shifts: Array
    end_rows: Array
    mean_rows: Array
    columns: Array
    all_columns: Array
    sizes: tuple[float, float]
    missed: tuple[float, float]

    def stripped(self) -> Path:
        """Return the path without its columns, which take memory."""
        nothing = np.empty((0, 0, 0))
        return replace(
            self,
            shifts=np.empty((0, 0)),
            end_rows=nothing,
            mean_rows=nothing,
            columns=np.empty((0, 0)),
            all_columns=nothing,
        )

    def motion(self, *segments: int) -> Motion:
        """Return the motions of some segments of one status."""
        of = list(segments)
        return self.course.motion(self.statuses[of[0]], self.times[of], self.starts[of])

    def state(self, segment: int, tau: float) -> Array:
        """Return the modal state at a time after the begin of a segment, shape (2n,)."""
        return np.concatenate(self.motion(segment).modes(np.zeros(1, dtype=np.int64), np.array([tau])))[:, 0]

    def motions(self, segments: Integers) -> Iterator[tuple[Motion, Integers, Integers]]:
        """Yield motions of one status in the segments of times (n_times,), the times, and their motions, each (m,)."""
        number = np.empty(len(self.statuses), dtype=np.int64)
        for group, motion in self._groups():
            number[:], number[group] = -1, np.arange(group.size)
            own = number[segments]
            mine = np.flatnonzero(own >= 0)
            for begin in range(0, mine.size, _TOGETHER):
                part = mine[begin : begin + _TOGETHER]
                yield motion, part, own[part]

    def _groups(self) -> Iterator[tuple[Integers, Motion]]:
        """Yield the segments of each status, shape (k,), and their motions; these are not kept, as they are large."""
        groups: dict[bytes, list[int]] = {}
        for segment, status in enumerate(self.statuses):
            groups.setdefault(status.tobytes(), []).append(segment)
        for group in groups.values():
            yield np.array(group), self.motion(*group)

    def sampled(self, rows: Array, segments: Integers, counts: Integers) -> tuple[Integers, Array, Array, Array]:
        """Return samples after equal steps in segments in their order, of which each has a number of steps.

        They are given by segments, times in these, and displacements and velocities of modal rows (k, n), (k, n_times).
        """
        steps, every = self.durations[segments] / counts, counts + 1
        places = np.cumsum(every) - every
        number = np.arange(every.sum()) - np.repeat(places, every)
        found = np.empty((2 * len(rows), number.size))
        for group, motion in self._groups():
            own, mine = np.nonzero(segments[:, None] == group)
            begin = np.concatenate([rows @ motion.displacement[mine].T, rows @ motion.velocity[mine].T])
            over, starts = motion.regime.over_blocks(rows), motion.starts[mine]
            at_steps(motion.regime.blocks, starts, steps[own], counts[own], over, begin, places[own], found)
        return np.repeat(segments, every), np.repeat(steps, every) * number, found[: len(rows)], found[len(rows) :]

    def rows(self, rows: Array, segments: Integers) -> Callable[[Array], tuple[Array, Array]]:
        """Return displacements and velocities of modal rows (k, n), (k, n_times), by times in segments (n_times,)."""
        parts = []
        for motion, mine, own in self.motions(segments):
            begin = np.concatenate([rows @ motion.displacement.T, rows @ motion.velocity.T])
            parts.append((motion, mine, own, motion.regime.over_blocks(rows), begin))

        def at(tau: Array) -> tuple[Array, Array]:
            found = np.empty((2 * len(rows), tau.size))
            for motion, mine, own, over, begin in parts:
                changes = motion.regime.changes(motion.starts, own, tau[mine])
                found[:, mine] = over @ flat(changes).T + begin[:, own]
            return found[: len(rows)], found[len(rows) :]

        return at


class _Table(NamedTuple):
    """The statuses that a course has met: their numbers, and arrays for compiled code."""

    numbers: dict[bytes, int]
    statuses: dict[bytes, Status]
    maps: Maps
    pieces: Pieces
    groups: list[Group | None]


class Stuck(NamedTuple):
    """What rigid sliders that stick hold: their places stay where they are, and all else moves about them."""

    #: The displacement that the places of the sliders ask for, in equilibrium under reactions alone, shape (n, n).
    carry: Array
    reaction: Array  #: Reactions of everything pinned to that displacement, shape (k, n).


def _stuck(regime: Regime, contacts: Array, status: Status, first: int) -> Stuck | None:
    """Return what the sliders of a status hold; None where none sticks. Their rows are the last of the contacts."""
    held = np.flatnonzero(status == PINNED)
    mine = np.flatnonzero(held >= first)
    if not mine.size:
        return None
    real, force = regime.spectrum.real, regime.base.quantities.reactions
    assert real.lifts is not None
    assert force is not None
    lift, push, react = (part[:, mine] for part in real.lifts)
    # Where the structure has rigid motions, these modes balance what reactions leave.
    bent = real.down(push) / np.where(real.p > 0.0, real.p, np.inf)[:, None]
    rows = contacts[held]
    share = np.linalg.solve(rows @ rows.T, rows)
    reaction = force.displacement @ bent + share @ push - react
    return Stuck((lift + real.up(bent)) @ rows[mine], reaction @ rows[mine])


class Course:
    """Follows a system along given segments.

    `system`: a system that `event_driven` can treat.
    `horizon`: longest duration of a segment in s.
    `group`: rigid sliders without belts, whose rows are the last ones of the contacts.
    """

    def __init__(self, system: System, horizon: float, counters: Counters, group: FrictionLaws | None = None) -> None:
        self.system, self.horizon, self._counters = system, horizon, counters
        self.space = modes_of(system, counters)
        functions, self._vectors = gathered(system.loads, self.space.loads)
        self.sliders: Sliders | None = None
        if group is not None:
            from vofem.integrators.event_driven.sliders import Sliders

            assert system.contacts is not None
            self.sliders = Sliders(group, len(system.contacts) - len(group), len(functions))
        # The loads have no breakpoints.
        edges = np.array([0.0, horizon])
        self.loads = exosystem(functions, edges, constant=group is not None or pushes(system.contacts))
        self._stuck: dict[bytes, Stuck | None] = {}
        self._table: _Table | None = None

    @cached_property
    def _linear(self) -> Regimes:
        return Regimes(self.system, self.space, self._vectors, self._counters, self.sliders)

    def regime(self, status: Status) -> Regime:
        """Return the linear piece of a contact status."""
        return self._linear.of(status, self.loads, 0)

    def motion(self, status: Status, times: Array, states: Array) -> Motion:
        """Return the motions from modal states, shape (k, 2n), at times in s, shape (k,)."""
        n, w, held = self.space.size, self.loads.at(times), self.stuck(status)
        if held is None:
            return start_motion(self.regime(status), states[:, :n], states[:, n:], w)
        kept = states[:, :n] @ held.carry.T
        found = start_motion(self.regime(status), states[:, :n] - kept, states[:, n:], w)
        return replace(found, displacement=found.displacement + kept)

    def stuck(self, status: Status) -> Stuck | None:
        """Return what sliders that stick hold; None where none does."""
        key = status.tobytes()
        if self.sliders is not None and key not in self._stuck:
            self._stuck[key] = _stuck(self.regime(status), self.space.contacts, status, self.sliders.first)
        return self._stuck.get(key)

    def reaction(self, status: Status, time: float, state: Array, contact: int) -> tuple[float, float]:
        """Return the reaction of a slider or contact that rests in a modal state (2n,) at a time, and its rounding, N.

        Reactions of a stiff structure change much within the rounding of its state.
        """
        held, motion = int(np.sum(status[:contact] == PINNED)), self.motion(status, np.array([time]), state[None])
        kept, loads = self.stuck(status), motion.regime.loads
        row, values = motion.regime.reactions[held].reshape(2, -1), motion.starts[0]
        # Displacements, velocities and each load have units of their own.
        parts = [(row[k, loads:], values[k, loads:]) for k in (0, 1)]
        parts += [(row[k, j : j + 1], values[k, j : j + 1]) for k in (0, 1) for j in range(loads)]
        if kept is not None:
            parts.append((kept.reaction[held], state[: self.space.size]))
        rounding = _EPS * sum(float(np.linalg.norm(row) * np.linalg.norm(values)) for row, values in parts)
        return sum(float(row @ values) for row, values in parts), rounding

    @property
    def kick(self) -> Array:
        """What impacts on rigid stops take, shape (c,); see `Structure`."""
        return self._structure.kick

    @cached_property
    def _structure(self) -> Structure:
        def made() -> Structure:
            return structure(self.space, self.system.contacts, self._vectors, self.loads)

        key = self._vectors.tobytes(), self.loads.function.tobytes()
        return self.system.cache.get("structure of motions", key, made)

    def _known(self, statuses: Sequence[Status]) -> _Table:
        """Return the arrays of all statuses so far, some new ones among them."""
        now = self._table
        every = {} if now is None else dict(now.statuses)
        every.update((status.tobytes(), status) for status in statuses)
        if now is not None and len(every) == len(now.statuses):
            return now
        keys, cache = sorted(every), self.system.cache
        known = [every[key] for key in keys]

        def made() -> Still:
            regimes, held = [self.regime(status) for status in known], [self.stuck(status) for status in known]
            spectra, carries = [one.spectrum for one in regimes], [None if one is None else one.carry for one in held]
            return still(regimes, maps(self.space, self.system.contacts, known, spectra, carries))

        key = b"".join(keys), self._vectors.tobytes(), self.loads.horizon, self.loads.kinds[0].layout
        kept = cache.get("statuses at all frequencies", key, made, _MOST_SETS)
        loads, groups = pieces(kept, self.loads)
        self._table = _Table({key: k for k, key in enumerate(keys)}, every, kept.maps, loads, groups)
        return self._table

    def along(
        self, time: float, state: Array, statuses: Sequence[Status], durations: Array,
        columns: Array | None = None, lengthen: Array | None = None, *,
        struck: Sequence[int] = (), every: bool = False, given: Array | None = None,
    ) -> Path:  # fmt: skip
        """Return the motion from a modal state at a time in s through segments.

        `state` has shape (2n,).
        `durations` (shape (m,)): in s.
        `columns` (shape (2n, k)): derivatives of the state at the beginning, whose time is fixed.
        `lengthen` (shape (m, k)): derivatives of the durations.
        `struck`: the rigid stop that is hit at the end of each of the first segments, -1 for none.
        `every`: whether the columns are kept at the ends of all segments.
        `given` (shape (m, 2n)): modal states in which segments begin, but for the first; by default those in which the
        segments before end. What these miss of them enters the last column.
        Raises `ConvergenceError` if a motion that is followed backwards in time grows too much.
        """
        table, size = self._known(statuses), 2 * self.space.size
        numbers = np.array([table.numbers[status.tobytes()] for status in statuses], dtype=np.int64)
        backwards = durations < 0.0
        if backwards.any() and np.any(-durations * table.maps.delta.max(axis=1, initial=0.0)[numbers] > _GROWTH):
            raise ConvergenceError("a segment became so short that its motion cannot be followed backwards")
        if columns is None or lengthen is None:
            columns, lengthen = np.empty((size, 0)), np.empty((durations.size, 0))
        hit = np.full(durations.size, -1)
        hit[: len(struck)] = struck
        k = columns.shape[1]
        kept = np.empty((durations.size if every else 0, size, k))
        grouped = any(group is not None for group in table.groups)
        with kernels(compiled=False) if grouped else nullcontext():
            moved = table.pieces._replace(response=response(bool(table.pieces.pairs.any())))
            begins, starts, ends, means, shifts, end_rows, mean_rows, last, sizes = pass_segments(
                self._structure, table.maps, moved, table.groups if grouped else None, time,
                np.ascontiguousarray(state), numbers, durations, hit,
                np.empty((0, size)) if given is None else np.ascontiguousarray(given), np.array(columns, order="C"),
                np.ascontiguousarray(lengthen), kept, self.horizon,
            )  # fmt: skip
        z, v, *missed = sizes.tolist()
        times = time + np.append(0.0, np.cumsum(durations[:-1]))
        return Path(
            self, statuses, times, durations, begins, starts, ends, means, shifts, end_rows, mean_rows, last, kept,
            sizes_of(self.space, z, v, self.horizon), (missed[0], missed[1]),
        )  # fmt: skip
