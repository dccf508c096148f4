"""Rows that are no laws at fixed places: what bases, paths and sliders make of them in steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vofem.arrays import Array, IntArray
from vofem.integrators.stepping.kernel import NO_DRIFT, Equations, Rules
from vofem.integrators.stepping.reactions import ABSENT, ACTS, HOLDS, PUSHES
from vofem.integrators.stepping.record import Path
from vofem.integrators.stepping.structure import Structure
from vofem.laws.law import STORED, LawSet, ask
from vofem.linalg.banded import solve

if TYPE_CHECKING:
    from vofem.integrators.stepping.sliding import Sliders


class Guides:
    """What bases, paths and sliders of a run make of the rows of laws."""

    def __init__(self, structure: Structure, laws: LawSet, sliders: Sliders | None) -> None:
        self.structure, self.laws, self.movement, self.sliders = structure, laws, structure.movement, sliders
        #: Whether coordinates have more than ``b.q``, or rows do more than laws at fixed places.
        self.act = structure.special or self.movement is not None or (sliders is not None and sliders.belts)

    def over(
        self, path: Path, times: Array, equations: Equations, status: IntArray | None, fixed: bool
    ) -> tuple[Equations, Array, Rules | None]:
        """Return equations, `drift` and `rules` for steps on from the last row of a path, see `kernel.advance`.

        `times`: of all ends of the steps, and one step ahead, s.
        `status` (shape (k,)): of sliders at the start, where it is given.
        `fixed`: whether they keep it.
        """
        if not self.act:
            return equations, NO_DRIFT, None
        drift = self.drift(path, path.filled, times)
        rules = self.rules(times, status, fixed) if self.structure.special else None
        if rules is not None and self.structure.travels:
            assert self.movement is not None
            rows, rates = self.movement.rows(times)
            equations, rules = equations._replace(rows=rows), rules._replace(rates=rates)
        return equations, drift, rules

    def drift(self, path: Path, row: int, times: Array) -> Array:
        """Return offsets of the laws' coordinates at times, m, and their rates, (2, n_times, m), on from a row."""
        drift = np.zeros((2, times.size, len(self.laws)))
        if self.movement is not None:
            drift = self.movement.offsets(times)
        if self.sliders is not None and self.sliders.belts:
            mine, sliders = self.sliders.rows, self.sliders
            drift[0, :, mine] = path.chunk.u[row, mine] - sliders.matrix @ path.chunk.q[row]
            drift[0, 1:, mine] -= np.cumsum(sliders.ways(times), axis=0)
            drift[1, :, mine] = -sliders.speeds(times)
        return drift

    def rules(self, times: Array, status: IntArray | None, fixed: bool = False) -> Rules:
        """Return what rows do in steps between all times but the last one, which is a step ahead, see `over`."""
        m, steps = len(self.laws), times.size - 2
        kind, push, slides = np.full((steps, m), ACTS), np.zeros((2, steps, m)), np.zeros(m, dtype=np.int64)
        push[1] = np.inf
        present, away = np.ones((steps + 1, m), dtype=bool), np.zeros(m)
        anchored, springs = np.zeros((2, m), dtype=bool)
        pressing, normal, settling = np.full(m, -1), np.zeros((steps + 1, m)), np.full((steps + 1, m), -1)
        if self.movement is not None:
            present, away = self.movement.present(times[:-1]), self.movement.away
            kind[:, self.movement.tied] = HOLDS
            kind[~self.movement.through(times[:-1])] = ABSENT
            settling = self.movement.settling(times)
        if self.sliders is not None:
            mine, sliders, part = self.sliders.rows, self.sliders, self.structure.scheme.part
            status = sliders.now.status if status is None else status
            kind[:, mine] = np.where(sliders.rigid, np.where(status == 0, HOLDS, PUSHES), ACTS)
            slides[mine], balanced = status, sliders.normals(times[:-1], part)
            push[0, :, mine] = sliders.limit * balanced
            if not fixed:
                push[1, :, mine] = np.where(sliders.rigid, sliders.static * balanced, np.inf)
            anchored[mine], pressing[mine], normal[:, mine] = True, sliders.pressing, sliders.normals(times[:-1], None)
            springs[mine] = ~sliders.rigid & sliders.varying
        stride = m if self.structure.travels else 0
        return Rules(
            stride, self.structure.compressed, kind, present, away, anchored, push, slides, steps > 1, pressing,
            springs, normal, settling,
        )  # fmt: skip

    def acceleration(self, path: Path, row: int, times: Array, mass: Array, right: Array, reaction: Array) -> Array:
        """Return the acceleration at a row of a path that brings rows that hold to their places at the second time.

        Sliders whose force would be beyond the limit slide instead. Forces of rows that hold, or push, are entered.

        `mass`: the factored mass matrix.
        `right`, `reaction`: forces on the structure but for those of the rows, shape (n,), and of all laws, (m,).
        """
        assert self.structure.rows is not None
        chunk, dt = path.chunk, float(times[1] - times[0])
        now = later = self.structure.rows.toarray()
        if self.movement is not None:
            now, later = self.movement.matrix(times[:2]).toarray().reshape(2, *now.shape)
            jumps = self.movement.settling(times[:2])[0] >= 0
            later[jumps] = (now + dt * self.movement.matrix(times[:1], rate=True).toarray())[jumps]
        status = np.empty(0, dtype=np.int64) if self.sliders is None else self.sliders.now.status.copy()
        drift, answers = self.drift(path, row, times), now.copy()
        for answer in answers:
            solve(mass, answer)
        while True:
            rules = self.rules(times, status)
            kind, push = rules.kind[0], rules.status * rules.push[0, 0]
            pressed = np.where(rules.pressing >= 0, np.maximum(reaction[np.maximum(rules.pressing, 0)], 0.0), 1.0)
            reaction[kind == PUSHES] = (push * pressed)[kind == PUSHES]
            held = np.flatnonzero(kind == HOLDS)
            reaction[held] = reaction[kind == ABSENT] = 0.0
            a = right - reaction @ now
            solve(mass, a)
            anchored = rules.anchored[held]
            place = later @ (dt * chunk.v[row] + 0.5 * dt**2 * a) + drift[0, 1]
            place = place[held] + np.where(anchored, -drift[0, 0, held], later[held] @ chunk.q[row])
            if held.size:
                forces = np.linalg.solve(0.5 * dt**2 * (later[held] @ answers[held].T), place)
                a -= forces @ answers[held]
                reaction[held] = forces
            if self.sliders is None:
                return a
            bound = self.sliders.static * self.sliders.normals(times[:1], None)[0] * pressed[self.sliders.rows]
            force = reaction[self.sliders.rows]
            over = self.sliders.rigid & (status == 0) & (np.abs(force) > bound * (1.0 + 1e-9))
            if not np.any(over):
                return a
            status = np.where(over, np.sign(force), status).astype(np.int64)

    def work(self, path: Path, dt: float, t: Array) -> Array:
        """Return the work in J over steps of what moves stops, points and belts, by their ends in s."""
        steps, times = path.steps(t.size), np.append(t[0] - dt, t)
        u, reaction, scheme = steps.u, steps.reaction, self.structure.scheme
        mine = slice(None)
        if self.sliders is None and not self.structure.special:
            mine = slice(self.structure.contacts.shape[0])
        mean = reaction[1:] if scheme.mean else 0.5 * (reaction[1:] + reaction[:-1])
        if not scheme.mean and not scheme.explicit:
            mean = mean + steps.damper[1:]
        moved = np.diff(self.drift(path, path.filled, times)[0], axis=0)
        if self.structure.special and not scheme.mean:
            # Rows that hold or push act at the time of balance.
            beside = self.rules(np.append(times, t[-1] + dt), None).kind[0] != ACTS
            mean = np.where(beside, reaction[1:], mean)
        if not self.structure.travels:
            return np.einsum("kj,kj->k", mean[:, mine], moved[:, mine])
        assert self.movement is not None
        present, through = self.movement.present(times), self.movement.through(times)
        way = np.diff(steps.q, axis=0)
        along = 0.5 * (self.movement.along(way, times[:-1]) + self.movement.along(way, times[1:]))
        work = np.einsum("kj,kj->k", mean, np.where(through, np.diff(u, axis=0) - along, 0.0))
        for k, j in np.argwhere(~through & (present[1:] | present[:-1])).tolist():
            # What a law stores when its point leaves the beam is lost to it.
            before, after = (ask(self.laws.records, j, STORED, x, x) for x in u[k : k + 2, j].tolist())
            work[k] += after - before
        settling = self.movement.settling(times)
        comes, law = np.nonzero(settling >= 0)
        own = settling[comes, law]
        old, new = steps.v[comes, own] + dt * steps.a[comes + 1, own], steps.v[comes + 1, own]
        np.add.at(work, comes, 0.5 * self.structure.mass[0, own] * (new**2 - old**2))
        return np.asarray(work)
