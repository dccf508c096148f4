"""What a stepping run leaves behind, found from chunks of steps: states, events, energies, probes and checks.

Kernels only step. All else is found here once for all methods, from the states before and after some steps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array, IntArray
from vofem.integrators.base import ProbeRows, ProbeSamples
from vofem.integrators.stepped import interpolated
from vofem.integrators.stepping.checks import check_contacts
from vofem.integrators.stepping.kernel import Chunk
from vofem.integrators.stepping.structure import Structure
from vofem.kernels.jit import jit
from vofem.laws.law import END, FORCE, HISTORY, LOSS, START, STORED, Laws, ask, commit_laws
from vofem.system import CLOSED, OPEN

#: Gap functions are known to this many units of rounding of the displacements and gaps of the scene.
_ROUNDING = 64.0 * float(np.finfo(float).eps)

#: Ratio of the sizes of two steps above which the motion between them is not taken for smooth.
_UNEVEN = 4.0


class Path:
    """States of a run from step to step, one a row, as far as they are still needed.

    Attributes
    ----------
    chunk : Chunk
    t, dt : ndarray, shape (n_rows,)
        Times, and sizes of the steps that end at them, s.
    work, dissipated : ndarray, shape (n_rows,)
        Work of the loads, and what dampers take, over these steps, J.
    absorbed, pull : ndarray, shape (n_rows, n_pots)
        Work that springpots absorb over these steps, J, and their forces at the times, N.
    turns : ndarray of bool, shape (n_rows,)
        Whether a contact that acts closes or opens in these steps.
    status : ndarray of int, shape (n_rows, n_sliders)
        Of rigid sliders in these steps.
    out : ndarray, shape (n_rows, n)
        Accelerations at the times, where laws do not act by means.
    filled : int
        The last row that is known.
    """

    def __init__(self, rows: int, n: int, laws: Laws, pots: int, lags: bool, sliders: int = 0) -> None:
        m = laws.table.shape[0]
        # Steps fill all rows but the first.
        q, v, a = np.empty((3, rows, n))
        a[0] = 0.0
        u, reaction, damper = np.zeros((3, rows, m))
        self.chunk = Chunk(
            q, v, a, u, reaction, damper, np.zeros((rows, laws.state.size)), np.zeros((rows, pots, 2)),
            np.zeros((rows, n if lags else 0)),
        )  # fmt: skip
        self.t, self.dt, self.work, self.dissipated = np.zeros((4, rows))
        self.absorbed, self.pull = np.zeros((2, rows, pots))
        self.turns = np.zeros(rows, dtype=bool)
        self.status = np.zeros((rows, sliders), dtype=np.int64)
        self.out = self.chunk.ends if lags else a
        self.filled = 0

    @property
    def _parts(self) -> tuple[NDArray[Any], ...]:
        more = (self.t, self.dt, self.work, self.dissipated, self.absorbed, self.pull, self.turns, self.status)
        return (*self.chunk, *more)

    def steps(self, count: int) -> Chunk:
        """Return the last row that is known, and rows for some steps from there."""
        return Chunk(*(part[self.filled : self.filled + count + 1] for part in self.chunk))

    def keep(self, first: int) -> None:
        """Forget the rows before one."""
        count = self.filled + 1 - first
        for part in self._parts:
            part[:count] = part[first : first + count].copy()
        self.filled = count - 1

    def saved(self) -> list[NDArray[Any]]:
        """Return copies of all rows that are known."""
        return [part[: self.filled + 1].copy() for part in self._parts]

    def restore(self, saved: list[NDArray[Any]]) -> None:
        """Set the rows to those of `saved`."""
        for part, other in zip(self._parts, saved, strict=True):
            part[: other.shape[0]] = other
        self.filled = saved[0].shape[0] - 1


class Switches:
    """The status of contacts from step to step.

    `status` (shape (n_contacts,)): after the last step.
    `size`: largest sum of displacements and gap of any contact so far, m. Displacements are known to the rounding of
    it, and so are gap functions.
    `log` (shape (n_events, 3)): time, contact and status entered of the events. Contact -1 stands for any other law
    that begins or ceases to act, such as a crushing stop.
    """

    def __init__(self, structure: Structure, status: IntArray) -> None:
        self.laws, self._columns, self._movement = structure.system.contacts, structure.columns, structure.movement
        self._sizes = None if self.laws is None else abs(structure.contacts)
        self.status, self.size = status.copy(), 0.0
        self.log: list[Array] = []

    def step_on(self, path: Path, count: int, t_end: float) -> None:
        """Take notice of the last steps of a path; set `Path.turns`."""
        laws, m = self.laws, self.status.size
        if not count:
            return
        first = path.filled - count
        acts = path.chunk.reaction[first : path.filled + 1, m:] != 0.0
        # Methods of mean forces have none before the first step.
        acts[0] = acts[0 if path.dt[first] else 1]
        row = first + 1 + np.flatnonzero((acts[1:] != acts[:-1]).any(axis=1))
        if row.size:
            self._enter(path.t[row] - 0.5 * path.dt[row], -1, OPEN, t_end)
        if laws is None:
            return
        s = path.chunk.u[first : path.filled + 1, :m] - laws.gap
        q = path.chunk.q[first + 1 : path.filled + 1, self._columns]
        sizes = (self._sizes @ np.abs(q).T).T + np.abs(laws.gap)
        largest, closed = self.size, np.empty((count + 1, m), dtype=bool)
        self.size = max(largest, float(sizes.max()))
        closed[0] = self.status == CLOSED
        np.greater(s[1:], 0.0, out=closed[1:])
        rows = slice(first + 1, path.filled + 1)
        path.turns[rows] = False
        if np.abs(s[1:]).min() <= _ROUNDING * self.size:
            # A gap function within its rounding leaves the status as it was.
            noise = _ROUNDING * np.maximum.accumulate(np.append(largest, sizes))[1:].reshape(-1, m)
            known = np.vstack([np.ones((1, m), dtype=bool), np.abs(s[1:]) > noise])
            last = np.maximum.accumulate(np.where(known, np.arange(count + 1)[:, None], 0), axis=0)
            closed = np.take_along_axis(closed, last, axis=0)
        turned = np.where(closed[:-1], s[1:] < 0.0, s[1:] > 0.0)
        step, contact = np.nonzero(turned)
        acts = (path.chunk.reaction[rows][step, contact] != 0.0) | closed[step, contact]
        path.turns[first + 1 + step[acts]] = True
        step, contact = np.nonzero(closed[1:] != closed[:-1])
        self.status = np.where(closed[-1], CLOSED, OPEN)
        if not step.size:
            return
        before, after = s[step, contact], s[step + 1, contact]
        # The crossing is placed on the chord of the gap function.
        part = np.divide(before, before - after, out=np.ones(step.size), where=before != after)
        row = first + 1 + step
        t = path.t[row] - path.dt[row] * (1.0 - np.clip(part, 0.0, 1.0))
        if self._movement is not None:
            t = self._movement.passages(contact, path.t[row] - path.dt[row], path.t[row], t)
        self._enter(t, contact, np.where(closed[step + 1, contact], CLOSED, OPEN), t_end)

    def _enter(self, t: Array, contact: IntArray | int, status: IntArray | int, t_end: float) -> None:
        """Enter events at times in s up to the end of the run, shape (n_events,), into the log."""
        self.log.append(np.column_stack(np.broadcast_arrays(t, contact, status))[t <= t_end * (1.0 + 1e-12)])


class Record:
    """What is recorded of a run: states at wanted times, points at every step, and the checks of the run.

    `times` (shape (n_times,)): times at which states are stored, s.
    `wanted`, `checked` (shape (n_times,)): whether results are wanted at the times, and whether the checks of the run
    look at them.
    `q`, `v`, `a` (shape (n_times, n)): in band order.
    `work`, `dissipated` (shape (n_times,)): totals, J.
    `histories` (shape (3, n_laws, n_times)): force, stored energy and loss of the hysteretic laws and, last, of the
    springpots.
    `past` (shape (size,)): internal variables of the laws at the last `wanted` time.
    `cursor`: number of times that are stored.
    `contact_checks` (shape (n_contacts, 11)): what the checks of the run know of every contact, see `checks`.
    `total` (shape (2 + n_pots,)): work of the loads, what dampers took, and the work of each springpot at the last
    state that is complete, J.
    `most`: largest sum of the first two so far, J.
    `points`: time, q, v and a of points, in pieces.
    """

    def __init__(
        self, times: Array, further: Array, structure: Structure, laws: Laws, pots: int, table: Array,
        probes: ProbeRows | None,
    ) -> None:  # fmt: skip
        n, histories = structure.system.size, structure.system.histories
        self.times = np.sort(np.concatenate([times, further[~np.isin(further, times)]]))
        self.wanted, self.checked = np.isin(self.times, times), np.isin(self.times, further)
        self.q, self.v, self.a = np.empty((3, self.times.size, n))
        self.work, self.dissipated = np.zeros((2, self.times.size))
        self.histories, self.past = np.zeros((3, histories, self.times.size)), laws.state.copy()
        self.cursor, self.contact_checks, self.total, self.most = 0, table, np.zeros(2 + pots), 0.0
        self.points: list[Array] = []
        self._begun, self._laws, self._structure = False, laws, structure
        self._names = () if probes is None else probes.names
        self._points = None if probes is None else probes.rows[:, structure.order]

    #: What a checkpoint holds beside stored times and points.
    _STATE = ("past", "contact_checks", "total", "most", "cursor", "_begun")
    _STORED = ("q", "v", "a", "work", "dissipated")

    def saved(self) -> dict[str, Any]:
        """Return what a run needs to go on with the record."""
        stored = {name: getattr(self, name)[: self.cursor] for name in self._STORED}
        stored["histories"] = self.histories[..., : self.cursor]
        if len(self.points) > 1:
            self.points = [np.concatenate(self.points, axis=1)]
        state = {name: getattr(self, name) for name in self._STATE}
        return {"stored": stored, "state": state, "points": list(self.points)}

    def restore(self, saved: dict[str, Any]) -> None:
        """Go on where another record was."""
        for name, value in saved["state"].items():
            setattr(self, name, value.copy() if isinstance(value, np.ndarray) else value)
        for name in self._STORED:
            getattr(self, name)[: self.cursor] = saved["stored"][name]
        self.histories[..., : self.cursor] = saved["stored"]["histories"]
        self.points = list(saved["points"])

    def probe_samples(self, until: float) -> ProbeSamples:
        """Return the motion of the points up to a time in s."""
        whole = np.concatenate(self.points, axis=1)
        times = whole[0]
        q, v, a = whole[1:, : np.searchsorted(times, until, side="right")].reshape(3, len(self._names), -1)
        return ProbeSamples(self._names, times[: q.shape[1]].copy(), q, v, a)

    def take(self, path: Path, means: bool, explicit: bool, pots_row: int) -> None:
        """Store what the states of a path tell, as far as they are complete, and forget the rows before the last one.

        Where laws act by means a state is complete, for its acceleration, when the step after it is done.

        `means`, `explicit`: of the method.
        `pots_row`: number of the first springpot among all laws.
        """
        last = path.filled - (1 if means else 0)
        if last < (1 if self._begun else 0) or (not self._begun and path.filled == 0):
            return
        chunk, begun = path.chunk, self._begun
        first = 1 if begun else 0
        _pull(path, last, means, explicit, pots_row)
        if self._points is not None:
            now = _accelerations(path, np.arange(first, last + 1))[0] if means else path.out[first : last + 1]
            states = (chunk.q[first : last + 1], chunk.v[first : last + 1], now)
            self.points.append(np.vstack([path.t[None, first : last + 1], *(self._points @ x.T for x in states)]))
        check_contacts(self.contact_checks, chunk.u, self._rates(chunk, path.t, last), path.dt, first, last)
        rows = slice(last + 1)
        totals = np.vstack([path.work[rows], path.dissipated[rows], path.absorbed[rows].T])
        if begun:
            totals[:, 0] = self.total
        np.cumsum(totals, axis=1, out=totals)
        if not begun:
            self._store_start(path, _accelerations(path, np.zeros(1, dtype=np.int64))[0][0] if means else path.out[0])
        self._store(path, last, totals, means)
        self.total, self._begun = totals[:, -1].copy(), True
        self.most = max(self.most, float(np.abs(totals[:2]).sum(axis=0).max()))
        path.keep(last)

    def _rates(self, chunk: Chunk, t: Array, last: int) -> Array:
        """Return the rates of the contacts in the first rows of a path, shape (last + 1, n_contacts)."""
        structure, rows = self._structure, slice(last + 1)
        if not len(self.contact_checks):
            return np.empty((last + 1, 0))
        rates = np.asarray((structure.contacts @ chunk.v[rows, structure.columns].T).T)
        if structure.movement is None or structure.movement.of_contacts is None:
            return rates
        return rates + structure.movement.of_contacts.added_rates(chunk.q[rows].T, chunk.v[rows].T, t[rows]).T

    def _store_start(self, path: Path, a: Array) -> None:
        """Store the state at t = 0 at all times that are not later."""
        end = int(np.searchsorted(self.times, 1e-9 * path.dt[1] if path.filled else 0.0, side="right"))
        self.q[:end], self.v[:end], self.a[:end] = path.chunk.q[0], path.chunk.v[0], a
        self._histories(path, 0, end, np.ones(end, dtype=np.int64), np.zeros(end), np.zeros((1, path.pull.shape[1])))
        self.cursor = end

    def _store(self, path: Path, last: int, totals: Array, means: bool) -> None:
        """Store all wanted times up to a row of a path."""
        begin = self.cursor
        ends = path.t[1 : last + 1] + 1e-9 * path.dt[1 : last + 1]
        end = int(np.searchsorted(self.times, ends[-1], side="right")) if last else begin
        if end <= begin:
            return
        chunk, times = path.chunk, self.times[begin:end]
        row = np.searchsorted(ends, times, side="left") + 1
        x = 1.0 - (path.t[row] - times) / path.dt[row]
        x[x >= 1.0 - 1e-9] = 1.0
        now, arriving, leaving = _accelerations(path, row) if means else (path.out[row],) * 3
        self.q[begin:end], self.v[begin:end], self.a[begin:end] = chunk.q[row], chunk.v[row], now
        inside = np.flatnonzero(x < 1.0)
        if inside.size:
            here = row[inside]
            if means:
                arriving, leaving = arriving[inside], _accelerations(path, here - 1)[2]
            else:
                arriving, leaving = path.out[here], path.out[here - 1]
            h = path.dt[here]
            q, v, a = interpolated(
                x[inside, None], h[:, None], (chunk.q[here - 1], chunk.v[here - 1], leaving),
                (chunk.q[here], chunk.v[here], arriving),
            )  # fmt: skip
            self.q[begin + inside], self.v[begin + inside], self.a[begin + inside] = q, v, a
        for k, name in enumerate(("work", "dissipated")):
            getattr(self, name)[begin:end] = x * totals[k, row] + (1.0 - x) * totals[k, row - 1]
        self._histories(path, begin, end, row, x, totals[2:].T)
        self.cursor = end

    def _histories(self, path: Path, begin: int, end: int, row: IntArray, x: Array, work: Array) -> None:
        """Store hysteretic laws and springpots at some times, which lie at fractions x of the steps to rows."""
        laws, pots = self._laws, path.pull.shape[1]
        if not self.histories.shape[1]:
            return
        if laws.state.size:
            assert self._structure.rows is not None
            u = np.asarray(self._structure.rows @ self.q[begin:end].T)
            _along(laws, path.chunk.past[row - 1], u, self.histories[:, :, begin:end])
            last = np.flatnonzero(self.wanted[begin:end])
            if last.size:
                self.past = path.chunk.past[row[last[-1]] - 1].copy()
                commit_laws(laws._replace(state=self.past), np.ascontiguousarray(u[:, last[-1]]))
        if pots:
            left = np.maximum(row - 1, 0)
            row = np.where(x > 0.0, row, 0)
            part = lambda values: ((1.0 - x)[:, None] * values[left] + x[:, None] * values[row]).T  # noqa: E731
            energy, spent = part(path.chunk.pots[:, :, 1]), part(work)
            self.histories[0, -pots:, begin:end] = part(path.pull)
            self.histories[1, -pots:, begin:end], self.histories[2, -pots:, begin:end] = energy, spent - energy


def _accelerations(path: Path, rows: IntArray) -> tuple[Array, Array, Array]:
    """Return accelerations at rows of a path of mean accelerations: at the time, arriving there, and leaving.

    An acceleration is the change of the mean velocity between the steps on both sides. Where a contact closes or opens
    in one of these steps, the acceleration of the other step is used. Where one step is much longer, the
    interpolation within it does not use the short one.
    """
    held, rate, last, dt = path.chunk.a[rows], path.chunk.a[rows + 1], path.dt[rows], path.dt[rows + 1]
    turned, turns, start = path.turns[rows], path.turns[rows + 1], last == 0.0
    between = rate - held
    between *= (last / (dt + last))[:, None]
    between += held
    now, arriving, leaving = between, between, between
    special = np.flatnonzero(turned | turns | start | (last > _UNEVEN * dt) | (dt > _UNEVEN * last))
    if special.size:
        now, arriving, leaving = between.copy(), between.copy(), between.copy()
        for k in special.tolist():
            either = turned[k] or turns[k]
            if start[k] or (turned[k] and not turns[k]):
                now[k] = rate[k]
            elif turns[k] and not turned[k]:
                now[k] = held[k]
            if either or last[k] > _UNEVEN * dt[k]:
                arriving[k] = held[k]
            if either or dt[k] > _UNEVEN * last[k]:
                leaving[k] = rate[k]
    return now, arriving, leaving


def _pull(path: Path, last: int, means: bool, explicit: bool, first: int) -> None:
    """Find the forces of springpots at the rows of a path up to one, from their means over steps."""
    count = path.pull.shape[1]
    if not count or last < 1:
        return
    mean = path.chunk.pots[:, :, 0]
    if explicit:
        path.pull[1 : last + 1] = path.chunk.reaction[1 : last + 1, first : first + count]
    elif means:
        before, after = path.dt[1 : last + 1, None], path.dt[2 : last + 2, None]
        path.pull[1 : last + 1] = (after * mean[1 : last + 1] + before * mean[2 : last + 2]) / (before + after)
    else:
        path.pull[1 : last + 1] = 1.5 * mean[1 : last + 1] - 0.5 * mean[:last]


@jit
def _along(laws: Laws, states: Array, u: Array, histories: Array) -> None:
    """Enter force, stored energy and loss of every law with internal variables at coordinates u, shape (n_laws, k).

    Each state, shape (k, size), holds the internal variables at the start of the path to the coordinates.
    """
    for k in range(u.shape[1]):
        for i in range(laws.state.size):
            laws.state[i] = states[k, i]
        for j in range(laws.table.shape[0]):
            i = laws.table[j, HISTORY]
            if i >= 0 and laws.table[j, END] > laws.table[j, START]:
                histories[0, i, k] = ask(laws, j, FORCE, u[j, k], u[j, k])
                histories[1, i, k] = ask(laws, j, STORED, u[j, k], u[j, k])
                histories[2, i, k] = laws.state[laws.table[j, START]] + ask(laws, j, LOSS, u[j, k], u[j, k])


def hysteretic_energy(laws: Laws, state: Array, u: Array) -> tuple[float, float]:
    """Return the energies in J that all laws with internal variables store at u, and that they have dissipated."""
    found = np.zeros((3, int(laws.table[:, HISTORY].max()) + 1, 1))
    _along(laws, state[None, :], u[:, None], found)
    return float(found[1].sum()), float(found[2].sum())
