"""A run of equal steps, taken in chunks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from vofem.arrays import Array
from vofem.integrators.stepping.record import Path, Record
from vofem.integrators.stepping.run import Run
from vofem.integrators.stepping.scheme import Forcing
from vofem.integrators.stepping.structure import Structure, products
from vofem.kernels.mode import compiled
from vofem.system import Counters, State

#: Entries of states that one call of a kernel advances: some ten milliseconds of work.
_CHUNK_WORK = 800_000

#: The same in plain Python.
_PLAIN_WORK = 10_000

#: Steps of one call at most.
_MOST_STEPS = 16384

#: Rows of a path for steps that are cut.
_ROOM = 40


class EqualSteps(Run):
    """A run of equal steps, taken in chunks.

    `done`: steps that were taken. Where laws act by means there is one beyond the end.
    `nodes`: what stands for the loads' values at the end of the last step.
    """

    place = (*Run.place, "done", "nodes")
    dt: float

    def __init__(
        self, structure: Structure, start: State, counters: Counters, t_end: float, dt: float, steps: int
    ) -> None:  # fmt: skip
        system, scheme = structure.system, structure.scheme
        work = _CHUNK_WORK if compiled() else _PLAIN_WORK
        self._most = int(np.clip(work // max(system.size, 1), 1, _MOST_STEPS))
        self.dt, self.steps_in_all, self.done = dt, steps + scheme.mean, 0
        self.nodes: Array | None = None
        room = min(self._most, self.steps_in_all) + (_ROOM if system.sliders is not None else 0)
        longest = (self.steps_in_all + scheme.explicit) * dt
        super().__init__(structure, start, counters, t_end, room, dt, longest)
        self.begin(dt)

    @property
    def finished(self) -> bool:
        """Whether all states are stored."""
        return self.done >= self.steps_in_all

    def advance(self, out: Record) -> None:
        """Take some steps.

        Raises `ConvergenceError` where a step has no solution.
        """
        dt, first, scheme, path = self.dt, self.done, self.scheme, self.path
        count = min(self._most, self.steps_in_all - first)
        pots = None
        if self.past is not None:
            count = self.past.most_steps(count)
            # An explicit step needs the orders of the step after it too.
            pots = self.past.over(dt, (np.arange(first, first + count + scheme.explicit, dtype=float) + 0.5) * dt)
        t = np.arange(first + 1, first + count + 1, dtype=float) * dt
        if scheme.mean:
            forcing = self.moments(self.over.steps(first, count, dt), dt)
        else:
            nodes = self._nodal(first, count)
            before, after, b = nodes[:, :-1], nodes[:, 1:], 1.0 - scheme.alpha_f
            values, means = after if b == 1.0 else b * after + (1.0 - b) * before, 0.5 * (after + before)
            forcing = Forcing(values.T, means.T, np.empty((0, self.vectors.shape[0])))
            self.nodes = nodes[:, -1].copy()
        with self.kicked(path):
            if self.sliders is not None and self.sliders.chosen:
                solves = self.taken = self.sliders.steps(self, path, dt, t, forcing, cut=True)
                solves = -1 if self.sliders.lost else solves
            else:
                solves = self.steps(path, dt, t, forcing, pots)
                if self.taken:
                    self.enter(path, dt, t[: self.taken], forcing.part(0, self.taken))
        if self.taken and scheme.explicit:
            self.load = nodes[:, self.taken] @ self.size(dt).loads
        self.done += self.taken
        self.take(out)
        self.solves += max(solves, 0)
        done = min(self.done, self.steps_in_all - scheme.mean)
        self.count(done, done + (scheme.explicit and self.finished))
        if solves < 0:
            raise self.lost((first + self.taken) * dt)

    def _nodal(self, first: int, count: int) -> Array:
        """Return what stands for the loads' values at the ends of steps, shape (2 n_loads, count + 1)."""
        begin = 0 if self.nodes is None else 1
        values = self.over.nodal(first + begin, count + 1 - begin, self.dt)
        values[1] *= -0.5 * self.dt**2
        values = values.reshape(2 * self.vectors.shape[0], values.shape[2])
        if self.nodes is not None:
            values = np.column_stack([self.nodes, values])
        if first == 0 and not self.scheme.explicit:
            values[: self.at_start.size, 0] = self.at_start
        return values

    @contextmanager
    def kicked(self, path: Path) -> Iterator[None]:
        """Give the structure within this block the impulse that loads have at t = 0, where the run stands there."""
        if self.path.t[0] > 0.0 or self.path.filled > 0 or not np.any(self.kick):
            yield
            return
        v = path.chunk.v[0].copy()
        path.chunk.v[0] += self.kick
        try:
            yield
        finally:
            path.chunk.v[0] = v
            # The work of the impulse is what the kinetic energy gains.
            gain = products(self.equations.mass, self.kick[None, :])[0]
            path.work[0] = float(gain @ (v + 0.5 * self.kick))
