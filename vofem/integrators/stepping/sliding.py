"""Sliders in time steps: which of them stick, and steps that end where sliding ends.

Let D be the slip of a slider over a step, N the normal force and R the friction force at the time of balance. A rigid
slider either sticks, with ``|R| <= static N``, or slides, with ``R = sign(D) coefficient N``. A slider behind a spring
is a law with a memory. Where a contact presses, N is the positive part of its force in the same step.

Equal steps are cut where sliding of a rigid slider ends: there the slip speed is made zero, and the rest of the step
begins with a slider that sticks. They are cut too where sticking ends with a jump of the force. Steps therefore keep
order 2. Steps under a tolerance are not cut but made small there. What the structure gives to a slider is ``R D``, so
energies balance without an error where laws act by their mean forces.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.slider_history import SliderHistory
from vofem.integrators.stepping.kernel import Equations
from vofem.integrators.stepping.reactions import ACTS, HOLDS, PUSHES
from vofem.integrators.stepping.record import Path
from vofem.integrators.stepping.scheme import Forcing, Scheme
from vofem.laws import FrictionLaws
from vofem.laws.friction import FrictionLaw
from vofem.laws.law import START, LawSet
from vofem.linalg.banded import factor, solve
from vofem.system import System

Integers = NDArray[np.int64]

_MOST, _EPS = 100, float(np.finfo(float).eps)

#: Cuts of one step at most, and the part of a step below which nothing is cut off.
_CUTS, _SHORT = 20, 1e-6


class Run(Protocol):
    """What sliders ask of a run, see `run.Run`."""

    scheme: Scheme
    equations: Equations

    @property
    def dt(self) -> float | None:
        """Size of all steps, s."""

    def advanced(
        self, path: Path, dt: float, t: Array, forcing: Forcing, pots: Any, status: Integers | None = None
    ) -> int:  # fmt: skip
        """Take some steps of one size on from the last row of a path."""

    def enter(self, path: Path, dt: float, t: Array, forcing: Forcing) -> None:
        """Enter steps that were taken."""

    def restart(self, path: Path, t: float, dt: float, forcing: Forcing) -> None:
        """Find forces and acceleration anew."""


class Held(NamedTuple):
    """What sliders have beside the state of the structure; each array of shape (k,), k the number of sliders."""

    status: Integers  #: 1 or -1 for the direction in which a rigid slider slides, 0 while it sticks, and for others.
    share: Array  #: Force over the largest while the slider sticks, in the last step.
    released: NDArray[np.bool_]  #: Whether the slider breaks away now.
    jumps: Array  #: What sliders have taken between two steps, where their sliding ended, J.
    work: float = 0.0  #: Work of belts between two steps, J.
    balance: float = 0.0  #: Time of balance of the last step, s, to which its forces belong.


class Sliders:
    """The sliders of a run, and what was recorded of them.

    `rows`: their places among the rows of all laws, which they end.
    `rigid` has shape (k,).
    `pressing` (shape (k,)): numbers of the contacts that press, -1 for none.
    `varying` (shape (k,)): whether the normal force is not constant.
    `chosen`, `belts`: whether statuses have to be found, as for rigid sliders, and whether there are belts.
    `log` (shape (6, k)): after every step: the quantities of `SliderSamples`.
    `times`: ends of these steps, s.
    `turns`: time, slider, and 0 where sliding ends, 1 where sticking ends.
    """

    def __init__(self, system: System, laws: LawSet, rows: Any, v: Array) -> None:
        group = system.sliders
        assert group is not None
        self.laws, count = group.laws, len(group)
        self.rows = slice(len(laws) - count, len(laws))
        self.matrix = rows[self.rows].toarray()
        self._sizes = np.abs(self.matrix)
        names = () if system.contacts is None else system.contacts.names
        self.limit = np.array([law.limit / law.normal for law in self.laws])
        self.static = np.array([law.static / law.normal for law in self.laws])
        self.spring = np.array([law.stiffness for law in self.laws])
        self.rigid = np.isinf(self.spring)
        self.stiffness = np.where(self.rigid, 0.0, self.spring)
        self._stretch = laws.records.table[self.rows, START] + 2
        self.pressing = np.array([-1 if law.contact is None else names.index(law.contact) for law in self.laws])
        self.varying = np.array([law.contact is not None or law.varies is not None for law in self.laws])
        self.chosen, self.belts = bool(self.rigid.any()), any(law.belt is not None for law in self.laws)
        self._still = np.zeros(count)
        slip, none, self.fastest = self.slip(v, 0.0), np.full(count, np.inf), np.zeros(count)
        status = np.where(self.rigid & ~self.small(slip, v, 0.0), np.sign(slip), 0).astype(np.int64)
        zero = np.zeros(count)
        self.now = Held(status, none, np.zeros(count, dtype=bool), zero)
        self.reached, self.share, self.lost, self._answers = zero, none, False, np.empty((0, 0))
        self.log = [np.array([zero, np.where(self.rigid, slip, 0.0), status, zero, zero, zero])]
        self.times, self.turns = [0.0], list[tuple[float, int, int]]()

    def saved(self) -> dict[str, Any]:
        """Return what a run needs to go on."""
        return {"now": list(self.now), "fastest": self.fastest} | {
            name: list(getattr(self, name)) for name in ("log", "times", "turns")
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Go on where another run was."""
        for name, value in saved.items():
            setattr(self, name, list(value) if isinstance(value, list) else value)
        self.now = Held(*saved["now"])

    def back_to(self, now: Held, turns: int) -> None:
        """Forget what happened since a time at which `now` and the number of turns were these."""
        self.now = now
        del self.turns[turns:]

    # -- what acts on sliders ---------------------------------------------------------------------------

    def speeds(self, t: float) -> Array:
        """Return the speeds of the belts at a time in s, m/s."""
        if not self.belts:
            return self._still
        return np.array([0.0 if law.belt is None else float(law.belt(t)) for law in self.laws])

    def ways(self, times: Array) -> Array:
        """Return by how much the belts move between times, m, shape (n_times - 1, k)."""
        first, last, still = times[:-1], times[1:], np.zeros(times.size - 1)
        means = [still if law.belt is None else law.belt.moments(first, last)[0] for law in self.laws]
        return np.array(means).T * np.diff(times)[:, None]

    def normals(self, times: Array, part: float | None) -> Array:
        """Return normal forces that no contact makes at times, shape (n_times, k), 1 where one does.

        With a part they are those at this part of the way from one time to the next, shape (n_times - 1, k); the middle
        stands for the mean.
        """

        def found(law: FrictionLaw) -> Array:
            if law.varies is None:
                return np.full(times.size - (part is not None), law.normal)
            if part == 0.5:
                return np.maximum(law.varies.moments(times[:-1], times[1:])[0], 0.0)
            here = np.maximum(law.varies(times), 0.0)
            return here if part is None else here[:-1] + part * np.diff(here)

        return np.array([found(law) for law in self.laws]).T

    def pressed(self, path: Path, last: int, normal: Array, implicit: bool) -> Array:
        """Return normal forces, (steps, k), with those that contacts make in the steps that end at a row of a path."""
        rows, found = slice(last - normal.shape[0] + 1, last + 1), normal.copy()
        for k in np.flatnonzero(self.pressing >= 0).tolist():
            force = path.chunk.reaction[rows, self.pressing[k]]
            found[:, k] = np.maximum(force + path.chunk.damper[rows, self.pressing[k]] if implicit else force, 0.0)
        return found

    def slip(self, v: Array, t: float) -> Array:
        """Return the slip speeds, m/s."""
        return np.asarray(self.matrix @ v - self.speeds(t))

    def small(self, slip: Array, v: Array, t: float) -> NDArray[np.bool_]:
        """Return which slip speeds are zero but for rounding."""
        # At a stop all speeds of a small system are zero, so they are compared with the largest of the run.
        self.fastest = np.maximum(self.fastest, self._sizes @ np.abs(v) + np.abs(self.speeds(t)))
        return np.abs(slip) <= 64.0 * _EPS * self.fastest

    def kinds(self, status: Integers, normal: Array) -> tuple[Integers, Array]:
        """Return kinds of rows and forces that push, (steps, k), for a status and normal forces, (steps, k)."""
        kind = np.where(self.rigid, np.where(status == 0, HOLDS, PUSHES), ACTS)
        return np.tile(kind, (normal.shape[0], 1)), status * self.limit * normal

    # -- records ----------------------------------------------------------------------------------------

    def stretches(self, past: Array) -> Array:
        """Return the stretches of springs for internal variables of all laws, shape (n_times, size), m."""
        found = np.zeros((past.shape[0], self.rigid.size))
        found[:, ~self.rigid] = past[:, self._stretch[~self.rigid]]
        return found

    def stored(self, past: Array) -> Array:
        """Return the energies in the springs of sliders, J, shape (n_times, k)."""
        return np.asarray(0.5 * self.stiffness * self.stretches(past) ** 2)

    def enter(self, path: Path, first: int, count: int, mean: bool) -> tuple[Array, float]:
        """Record steps that were taken after a row of a path; return losses over them, (count,), and work of jumps, J.

        Jumps between steps count with the first step.
        """
        rows, chunk = slice(first + 1, first + count + 1), path.chunk
        force, slip = chunk.reaction[rows, self.rows], np.diff(chunk.u[first : rows.stop, self.rows], axis=0)
        if not mean:
            force = np.where(self.rigid, force, 0.5 * (force + chunk.reaction[first : rows.stop - 1, self.rows]))
        stretch = self.stretches(chunk.past[first : rows.stop])
        stored = self.stored(chunk.past[first : rows.stop])
        taken, slid = force * slip - np.diff(stored, axis=0), slip - np.diff(stretch, axis=0)
        taken[0] += self.now.jumps
        tiny = 64.0 * _EPS * (np.abs(slip) + np.abs(stretch[1:]))
        slides = np.where(np.abs(slid) > tiny, np.sign(slid), 0.0)
        normal = self.pressed(path, first + count, self.normals(path.t[rows], None), not mean)
        total = self.log[-1][3]
        for k, row in enumerate(range(first + 1, first + count + 1)):
            t, begin = float(path.t[row]), float(path.t[row - 1])
            status, total = np.where(self.rigid, path.status[row], slides[k]), total + taken[k]
            speed = np.where(self.rigid, self.slip(chunk.v[row], t), slid[k] / path.dt[row])
            before = self.log[-1][2]
            for j in np.flatnonzero(~self.rigid & (status != before)).tolist():
                self.turns += [(begin, j, kind) for kind, turns in ((0, before[j]), (1, status[j])) if turns]
            self.times.append(t)
            self.log.append(np.array([chunk.reaction[row, self.rows], speed, status, total, normal[k], stored[k + 1]]))
        work = self.now.work
        self.now = self.now._replace(jumps=np.zeros(self.rigid.size), work=0.0)
        return taken.sum(axis=1), work

    def sticks(self) -> bool:
        """Return whether a slider sticks; one behind a spring by its last step."""
        return bool(np.any(np.where(self.rigid, self.now.status, self.log[-1][2]) == 0))

    def late(self, run: Run, path: Path, h: float) -> float:
        """Return the displacement in m by which sliders break away too late, or too early, in two steps.

        The steps end after the last row of a path. The force goes on along the line between those of both. Where
        sticking ends with a jump of the force, it does so at the start of a step.
        """
        row = path.filled
        force, status = path.chunk.reaction[row : row + 3, self.rows], path.status[row + 1 : row + 3]
        ahead = force[2] + 0.5 * (force[2] - force[1])
        normal = self.normals(path.t[row : row + 1] + 2.0 * h, None)
        bound = self.static * self.pressed(path, row + 2, normal, not run.scheme.mean)[0]
        excess = np.where(self.rigid & np.all(status == 0, axis=0), np.abs(ahead) - bound, 0.0)
        jump = self.rigid & (path.status[row] == 0) & np.any(status != 0, axis=0)
        excess = np.where(jump, bound * (1.0 - self.limit / self.static), excess)
        return float(np.max(excess.clip(0.0) * self._weights(run) * h**2, initial=0.0))

    def history(self, until: float) -> SliderHistory:
        """Return what was recorded so far, and what sliders did up to a time in s."""
        turns = sorted(turn for turn in self.turns if turn[0] <= until)
        return SliderHistory(np.array(self.times), np.array(self.log), np.array(turns).reshape(-1, 3))

    def _moved(self, run: Run) -> Array:
        """Return the changes of velocities by unit impulses on sliders, shape (k, n)."""
        if not self._answers.size:
            mass, self._answers = factor(run.equations.mass, "the mass matrix"), self.matrix.copy()
            for answer in self._answers:
                solve(mass, answer)
        return self._answers

    def _weights(self, run: Run) -> Array:
        """Return the change of every slider's speed by a unit impulse on it, 1/kg, shape (k,)."""
        return np.asarray(np.einsum("kn,kn->k", self.matrix, self._moved(run)))

    def _arrest(self, run: Run, which: NDArray[np.bool_], v: Array, t: float) -> None:
        """Take the slip speeds that some sliders have at a time in s from the velocities v, by impulses on them."""
        rows, belt, answers, now = self.matrix[which], self.speeds(t)[which], self._moved(run)[which], self.now
        impulse = np.linalg.solve(rows @ answers.T, rows @ v - belt)
        change, jumps = impulse @ answers, now.jumps.copy()
        jumps[which] += impulse * (rows @ (v - 0.5 * change) - belt)
        v -= change
        self.now = now._replace(jumps=jumps, work=now.work - float(impulse @ belt))

    # -- one step of rigid sliders ------------------------------------------------------------------------

    def take(self, run: Run, path: Path, h: float, end: float, forcing: Forcing, fixed: Integers | None = None) -> bool:
        """Fill the next row of a path by a step in which statuses agree with forces; return whether there is one.

        `h`, `end`: size of the step and its end, s.
        `fixed` (shape (k,)): the statuses, if they are known.
        """
        row, chunk, now, mean = path.filled, path.chunk, self.now, run.scheme.mean
        slip = self.slip(chunk.v[row], end - h)
        turned = self.rigid & (now.status != 0) & ~self.small(slip, chunk.v[row], end - h) & ~now.released
        status = np.where(turned, np.sign(slip), now.status).astype(np.int64) if fixed is None else fixed
        seen, self.reached = set[bytes](), np.zeros(status.size)
        place, give = self._sizes @ np.abs(chunk.q[row]), 0.5 * h**2 * self._weights(run)
        normal = self.normals(np.array([end - h, end]), run.scheme.part)
        for _ in range(_MOST):
            if run.advanced(path, h, np.array([end]), forcing, None, status) < 0:
                return False
            force = chunk.reaction[row + 1, self.rows]
            bound = self.static * self.pressed(path, row + 1, normal, not mean)[0]
            self.share = np.abs(force) / np.maximum(bound, 1e-300)
            moved = chunk.u[row + 1, self.rows] - chunk.u[row, self.rows]
            if not mean:
                moved = self.slip(chunk.v[row + 1], end)
                moved[self.small(moved, chunk.v[row + 1], end)] = 0.0
            # A force whose loss would move nothing is rounding.
            over = self.rigid & (status == 0) & (np.abs(force) - bound > 1e-12 * np.abs(force))
            over &= np.abs(force) * give > 64.0 * _EPS * place
            back = self.rigid & (status != 0) & (moved * status < 0.0) & (now.status == 0) & (bound > 0.0)
            change = over | back
            if fixed is not None or not np.any(change):
                path.status[row + 1] = status
                return True
            self.reached = np.where(over, self.share, self.reached)
            if status.tobytes() in seen:
                # One at a time, where all at once goes round in a circle.
                worst = np.argmax(np.where(over, 1.0 - 1.0 / self.share.clip(1.0), 0.0))
                change = np.arange(change.size) == (worst if np.any(over) else np.argmax(back))
            seen.add(status.tobytes())
            status = np.where(change & over, np.sign(force), np.where(change & back, 0, status)).astype(np.int64)
        return False

    def turn_within(self, run: Run, path: Path, h: float, end: float) -> tuple[int, float, bool]:
        """Return the slider whose status changes first in a step that was taken, after which part, and if it breaks.

        The slider is -1 where none changes. Where sticking ends without a jump of the force, the whole step slides.
        """
        row, v, now = path.filled, path.chunk.v, self.now
        status = path.status[row + 1]
        before, after = self.slip(v[row], end - h), self.slip(v[row + 1], end)
        ends = self.rigid & (now.status != 0) & (status != 0) & (path.chunk.reaction[row + 1, self.rows] != 0.0)
        ends &= (after * status < 0.0) & ~self.small(after, v[row + 1], end)
        which, share, breaks = -1, 1.0, False
        if np.any(ends):
            before = np.where(before * status > 0.0, before, 0.0)
            shares = np.where(ends, before / np.where(ends, before - after, 1.0), np.inf)
            which, share = int(np.argmin(shares)), float(np.min(shares))
        held = np.where(status == 0, self.share, self.reached)
        for j in np.flatnonzero(self.rigid & (now.status == 0) & (self.static > self.limit)).tolist():
            rise = held[j] - now.share[j]
            if rise > 0.0 and np.isfinite(rise):
                balance = end - (1.0 - run.scheme.part) * h
                part = (balance + (1.0 - held[j]) / rise * (balance - now.balance) - end + h) / h
                if part < share:
                    which, share, breaks = j, max(part, 0.0), True
        return which, share, breaks

    def accept(self, run: Run, path: Path, h: float, end: float) -> None:
        """Go on from a step that was taken; note what breaks away in it."""
        status, now, begin = path.status[path.filled + 1].copy(), self.now, end - h
        balance = end - (1.0 - run.scheme.part) * h
        for j in np.flatnonzero((now.status == 0) & (status != 0)).tolist():
            share, reached, time = now.share[j], self.reached[j], begin
            if share < 1.0 < reached < 1e100:
                # By the line between two forces.
                time = float(now.balance + (1.0 - share) / (reached - share) * (balance - now.balance))
            reverses = abs(next((t for t, i, _ in self.turns[::-1] if i == j), -1.0) - begin) <= _SHORT * h
            if time > 0.0 and not reverses:
                self.turns.append((time, j, 1))
        # Rounding of a slider at rest would grow from step to step.
        v, none = path.chunk.v[path.filled + 1], np.zeros(status.size, dtype=bool)
        slip = self.slip(v, end)
        noise = 64.0 * _EPS * (self.fastest + self._sizes @ np.abs(path.chunk.q[path.filled]) / h)
        rest = self.rigid & (status == 0) & (slip != 0.0) & (np.abs(slip) <= noise)
        if np.any(rest):
            self._arrest(run, rest, v, end)
        self.now = self.now._replace(status=status, share=self.share, released=none, balance=balance)

    def release(self, path: Path, t: float, which: int) -> None:
        """Let a slider break away at the end of the last step of a path, at a time in s."""
        status, released = self.now.status.copy(), self.now.released.copy()
        status[which], released[which] = int(np.sign(path.chunk.reaction[path.filled, self.rows][which])), True
        self.now = self.now._replace(status=status, released=released)
        self.turns.append((t, which, 1))

    def halt(self, run: Run, v: Array, t: float, which: int, slid: bool = True) -> None:
        """Let a slider stick at a time in s; what its slip speed differs from zero is taken from the velocities v.

        Where it has not slid in a step before, it stops only if it moves.
        """
        stuck, status, share = self.rigid & (self.now.status == 0), self.now.status.copy(), self.now.share.copy()
        stuck[which], status[which], share[which] = True, 0, np.inf
        self.turns += [(t, which, 0)] if slid or not self.small(self.slip(v, t), v, t)[which] else []
        self._arrest(run, stuck, v, t)
        self.now = self.now._replace(status=status, share=share)

    def steps(self, run: Run, path: Path, t: Array, forcing: Forcing) -> int:
        """Take and enter steps that end at times in s, as far as a path has room; return their number.

        Afterwards `lost` says whether the next one has no solution.
        """
        assert run.dt is not None
        taken, self.lost = 0, False
        while taken < t.size and path.filled + _CUTS + 1 < path.t.size and not self.lost:
            self.lost = not self.step(run, path, run.dt, float(t[taken]), forcing.at(taken), cut=True)
            taken += not self.lost
        return taken

    def step(self, run: Run, path: Path, h: float, end: float, forcing: Forcing, cut: bool) -> bool:
        """Take a step; return whether there is one.

        It is cut where sliding ends, and entered. Or it is neither, and a slider whose sliding ends within it sticks
        all the time.
        """
        left = h
        for cuts in range(_CUTS + 1):
            if not self.take(run, path, left, end, forcing):
                return False
            which, share, breaks = self.turn_within(run, path, left, end) if cuts < _CUTS else (-1, 1.0, False)
            turns, ends, row = which >= 0 and (cut or not breaks), which >= 0 and not breaks, path.filled
            at_once = turns and share <= _SHORT
            h = left if not (turns and cut) or share >= 1.0 - _SHORT else share * left
            stop = end - left if at_once else end - left + h
            if not at_once:
                row += 1
                if h < left or (ends and not cut):
                    status = path.status[row].copy()
                    status[which] = 0 if breaks or not cut else status[which]
                    if not self.take(run, path, h, stop, forcing, status):
                        return False
                self.accept(run, path, h, stop)
            if ends:
                self.halt(run, path.chunk.v[row], stop, which, not at_once)
            if not cut:
                if not at_once:
                    return True
                continue
            if not at_once:
                run.enter(path, h, np.array([stop]), forcing)
                left -= h
            if breaks:
                self.release(path, stop, which)
            if turns:
                run.restart(path, stop, left or h, forcing)
            if left <= 0.0:
                return True
        return False


def refusal(group: FrictionLaws, system: System) -> str | None:
    """Return why steps cannot treat the sliders of a system, or None."""
    rigid = np.array([np.isinf(law.stiffness) for law in group.laws])
    for other in system.laws:
        reason = ""
        if other is system.contacts and bool(np.any(system.contacts.jump)):
            reason = "acts on the displacement"
        elif rigid.any() and other is not group and not other.past_is_kept:
            reason = "has a memory of all earlier steps"
        if reason:
            return f"{group.labels[0]} acts beside {other.labels[0]}, which {reason}; steps do not treat them together"
    rows = group.rows.toarray()[rigid]
    if rows.shape[0] and np.linalg.matrix_rank(rows / np.linalg.norm(rows, axis=1)[:, None]) < rows.shape[0]:
        return (
            f"{' and '.join(law.label for law in group.laws if np.isinf(law.stiffness))} act on coordinates "
            "that depend on each other, so that their forces are not unique; join them, or give each a stiffness"
        )
    return None
