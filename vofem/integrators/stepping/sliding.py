"""Sliders in time steps: which of them stick, and steps that end where sliding ends.

Let D be the slip of a slider over a step, N the normal force and R the friction force at the time of balance. A rigid
slider either sticks, with ``|R| <= static N``, or slides, with ``R = sign(D) coefficient N``. A slider behind a spring
is a law with a memory. Where a contact presses, N is the positive part of its force in the same step.

The step of all laws finds which sliders stick (`reactions`), and kernels stop before a step within which one turns.
Only such a step is taken apart here. An equal step is cut where sliding of a rigid slider ends: there the slip speed is
made zero, and the rest of the step begins with a slider that sticks. It is cut too where sticking ends with a jump of
the force. Steps therefore keep order 2. Steps under a tolerance are not cut but made small there. What the structure
gives to a slider is ``R D``, so energies balance without an error where laws act by their mean forces.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.slider_history import SliderHistory
from vofem.integrators.stepping.reactions import REACHED, STATUS, Reactions
from vofem.integrators.stepping.record import Path
from vofem.integrators.stepping.scheme import Forcing, Scheme
from vofem.laws import FrictionLaws
from vofem.laws.friction import FrictionLaw
from vofem.laws.law import START, LawSet
from vofem.linalg.banded import factor, solve
from vofem.system import System

Integers = NDArray[np.int64]

_EPS = float(np.finfo(float).eps)

#: Steps that are tried at once after a slider has turned; later twice as many each time.
_SOME = 32

#: Cuts of one step at most, and the part of a step below which nothing is cut off.
_CUTS, _SHORT = 20, 1e-6


class Run(Protocol):
    """What sliders ask of a run, see `run.Run`."""

    scheme: Scheme
    taken: int

    @property
    def reactions(self) -> Reactions:
        """How kernels found the forces of the last step."""

    def advanced(
        self, path: Path, dt: float, t: Array, forcing: Forcing, pots: Any, status: Integers | None = None,
        fixed: bool = False,
    ) -> int:  # fmt: skip
        """Take some steps of one size on from the last row of a path, see `run.Run`."""

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

    `rows`: their places among the rows of all laws.
    `rigid` has shape (k,).
    `hard` (shape (k,)): whether a slider is rigid, and its force jumps where sticking ends.
    `pressing` (shape (k,)): numbers of the contacts that press, -1 for none.
    `varying` (shape (k,)): whether the normal force is not constant.
    `chosen`, `belts`: whether statuses have to be found, as for rigid sliders, and whether there are belts.
    `log` (shapes (steps, 6, k)): after every step: the quantities of `SliderSamples`; no slip speeds of rigid sliders.
    `times` (shapes (steps,)): ends of these steps, s.
    `turns`: time, slider, and 0 where sliding ends, 1 where sticking ends.
    """

    def __init__(self, system: System, mass: Array, laws: LawSet, rows: Any, v: Array) -> None:
        group = system.sliders
        assert group is not None
        self.laws, count = group.laws, len(group)
        first = system.first_of(group)
        self.rows = slice(first, first + count)
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
        self.hard = self.rigid & (self.static > self.limit)
        self.varying = np.array([law.contact is not None or law.varies is not None for law in self.laws])
        self.chosen, self.belts = bool(self.rigid.any()), any(law.belt is not None for law in self.laws)
        self._still = np.zeros(count)
        #: Changes of velocities by unit impulses on sliders, (k, n), and of their own speeds, (k,), in 1/kg.
        self._moved, factored = self.matrix.copy(), factor(mass, "the mass matrix")
        for answer in self._moved:
            solve(factored, answer)
        self._weights = np.einsum("kn,kn->k", self.matrix, self._moved)
        slip, none, self.fastest = self.slip(v, 0.0), np.full(count, np.inf), np.zeros(count)
        status = np.where(self.rigid & ~self.small(slip, v, 0.0), np.sign(slip), 0).astype(np.int64)
        zero = np.zeros(count)
        self.now = Held(status, none, np.zeros(count, dtype=bool), zero)
        self.reached, self.share, self.lost = zero, none, False
        self.log = [np.array([[zero, zero, status, zero, zero, zero]])]
        self.times, self.turns = [np.zeros(1)], list[tuple[float, int, int]]()

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

    def speeds(self, t: float | Array) -> Array:
        """Return the speeds of the belts at times in s, m/s, shape (k,) or (n_times, k)."""
        if not self.belts and isinstance(t, float):
            return self._still
        return np.array([np.zeros(np.shape(t)) if law.belt is None else law.belt(t) for law in self.laws]).T

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

    def pressed(self, path: Path, last: int, normal: Array, scheme: Scheme) -> Array:
        """Return normal forces, (steps, k), with those that contacts make in the steps that end at a row of a path."""
        rows, found = slice(last - normal.shape[0] + 1, last + 1), normal.copy()
        for k in np.flatnonzero(self.pressing >= 0).tolist():
            force = path.chunk.reaction[rows, self.pressing[k]]
            if not (scheme.mean or scheme.explicit):
                force = force + path.chunk.damper[rows, self.pressing[k]]
            found[:, k] = np.maximum(force, 0.0)
        return found

    def slip(self, v: Array, t: float) -> Array:
        """Return the slip speeds, m/s."""
        return np.asarray(self.matrix @ v - self.speeds(t))

    def small(self, slip: Array, v: Array, t: float) -> NDArray[np.bool_]:
        """Return which slip speeds are zero but for rounding."""
        # At a stop all speeds of a small system are zero, so they are compared with the largest of the run.
        self.fastest = np.maximum(self.fastest, self._sizes @ np.abs(v) + np.abs(self.speeds(t)))
        return np.abs(slip) <= 64.0 * _EPS * self.fastest

    # -- records ----------------------------------------------------------------------------------------

    def stretches(self, past: Array) -> Array:
        """Return the stretches of springs for internal variables of all laws, shape (n_times, size), m."""
        found = np.zeros((past.shape[0], self.rigid.size))
        found[:, ~self.rigid] = past[:, self._stretch[~self.rigid]]
        return found

    def stored(self, past: Array) -> Array:
        """Return the energies in the springs of sliders, J, shape (n_times, k)."""
        return np.asarray(0.5 * self.stiffness * self.stretches(past) ** 2)

    def enter(self, path: Path, first: int, count: int, scheme: Scheme) -> tuple[Array, float]:
        """Record steps that were taken after a row of a path; return losses over them, (count,), and work of jumps, J.

        Jumps between steps count with the first step.
        """
        rows, chunk = slice(first + 1, first + count + 1), path.chunk
        force, slip = chunk.reaction[rows, self.rows], np.diff(chunk.u[first : rows.stop, self.rows], axis=0)
        if not scheme.mean:
            force = np.where(self.rigid, force, 0.5 * (force + chunk.reaction[first : rows.stop - 1, self.rows]))
        stretch = self.stretches(chunk.past[first : rows.stop])
        stored = self.stored(chunk.past[first : rows.stop])
        taken, slid = force * slip - np.diff(stored, axis=0), slip - np.diff(stretch, axis=0)
        taken[0] += self.now.jumps
        tiny = 64.0 * _EPS * (np.abs(slip) + np.abs(stretch[1:]))
        slides = np.where(np.abs(slid) > tiny, np.sign(slid), 0.0)
        normal = self.pressed(path, first + count, self.normals(path.t[rows], None), scheme)
        status = np.vstack([self.log[-1][-1, 2], np.where(self.rigid, path.status[rows], slides)])
        total, speed = self.log[-1][-1, 3] + np.cumsum(taken, axis=0), slid / path.dt[rows, None]
        for k, j in np.argwhere(~self.rigid & (np.diff(status, axis=0) != 0)).tolist():
            begin, before, after = float(path.t[first + k]), status[k, j], status[k + 1, j]
            self.turns += [(begin, j, kind) for kind, turns in ((0, before), (1, after)) if turns]
        self.times.append(path.t[rows].copy())
        self.log.append(np.stack([chunk.reaction[rows, self.rows], speed, status[1:], total, normal, stored[1:]], 1))
        work = self.now.work
        self.now = self.now._replace(jumps=np.zeros(self.rigid.size), work=0.0)
        return taken.sum(axis=1), work

    def sticks(self) -> bool:
        """Return whether a slider sticks; one behind a spring by its last step."""
        return bool(np.any(np.where(self.rigid, self.now.status, self.log[-1][-1, 2]) == 0))

    def late(self, run: Run, path: Path, h: float) -> float:
        """Return the displacement in m by which sliders break away too late, or too early, in two steps.

        The steps end after the last row of a path. The force goes on along the line between those of both. Where
        sticking ends with a jump of the force, it does so at the start of a step.
        """
        row = path.filled
        force, status = path.chunk.reaction[row : row + 3, self.rows], path.status[row + 1 : row + 3]
        ahead = force[2] + 0.5 * (force[2] - force[1])
        normal = self.normals(path.t[row : row + 1] + 2.0 * h, None)
        bound = self.static * self.pressed(path, row + 2, normal, run.scheme)[0]
        excess = np.where(self.rigid & np.all(status == 0, axis=0), np.abs(ahead) - bound, 0.0)
        jump = self.rigid & (path.status[row] == 0) & np.any(status != 0, axis=0)
        excess = np.where(jump, bound * (1.0 - self.limit / self.static), excess)
        moved = excess.clip(0.0) * self._weights * h**2
        # In very short steps a force is taken for rounding, see `_slide`. In longer ones the slider breaks away.
        rounding = 256.0 * _EPS * np.max(np.abs(path.chunk.u[row : row + 3, self.rows]), axis=0)
        return float(np.max(moved[moved > rounding], initial=0.0))

    def history(self, until: float) -> SliderHistory:
        """Return what was recorded so far, and what sliders did up to a time in s."""
        turns = sorted(turn for turn in self.turns if turn[0] <= until)
        return SliderHistory(np.concatenate(self.times), np.concatenate(self.log), np.array(turns).reshape(-1, 3))

    # -- steps of rigid sliders ---------------------------------------------------------------------------

    def _begun(self, v: Array, t: float) -> Integers:
        """Return the statuses with which a step from a time in s begins, by the velocities there."""
        slip = self.slip(v, t)
        turned = self.rigid & (self.now.status != 0) & ~self.small(slip, v, t) & ~self.now.released
        return np.where(turned, np.sign(slip), self.now.status).astype(np.int64)

    def take(self, run: Run, path: Path, h: float, end: float, forcing: Forcing, fixed: Integers | None = None) -> bool:
        """Fill the next row of a path by a step in which statuses agree with forces; return whether there is one.

        `h`, `end`: size of the step and its end, s.
        `fixed` (shape (k,)): the statuses, if they are known.
        """
        row, times = path.filled + 1, np.array([end - h, end])
        status = self._begun(path.chunk.v[row - 1], end - h) if fixed is None else fixed
        if run.advanced(path, h, times[1:], forcing, None, status, fixed is not None) < 0:
            return False
        reactions = run.reactions
        path.status[row] = np.where(self.rigid, reactions.whole[STATUS, self.rows], status)
        forces = np.stack([path.chunk.reaction[row, self.rows], reactions.of_laws[REACHED, self.rows]])
        self.share, self.reached = self._shares(run, path, times, forces)
        return True

    def _shares(self, run: Run, path: Path, times: Array, forces: Array) -> Array:
        """Return forces, (..., k), over the largest at which sliders stick in the last of some steps between times."""
        normal = self.normals(times[-2:], run.scheme.part)
        bound = self.static * self.pressed(path, path.filled + times.size - 1, normal, run.scheme)[0]
        return np.asarray(np.abs(forces) / np.maximum(bound, 1e-300))

    def _quiet(self, run: Run, path: Path, h: float, t: Array, forcing: Forcing) -> int:
        """Take steps that end at times in s up to one within which a slider turns; return their number."""
        first, begin = path.filled, float(t[0]) - h
        status = self._begun(path.chunk.v[first], begin)
        run.advanced(path, h, t, forcing, None, status)
        # Where the force jumps, a slider may break away after the time of balance of the step before.
        count = max(run.taken - bool(self.hard.any()), 0)
        if count:
            path.status[first + 1 : first + count + 1] = status
            times = np.append(begin, t[:count])
            self.share = self._shares(run, path, times, path.chunk.reaction[first + count, self.rows])
            self.accept(run, path, h, float(t[count - 1]), count)
        return count

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
        for j in np.flatnonzero(self.hard & (now.status == 0)).tolist():
            rise = held[j] - now.share[j]
            if rise > 0.0 and np.isfinite(rise):
                balance = end - (1.0 - run.scheme.part) * h
                part = (balance + (1.0 - held[j]) / rise * (balance - now.balance) - end + h) / h
                if part < share:
                    which, share, breaks = j, max(part, 0.0), True
        return which, share, breaks

    def accept(self, run: Run, path: Path, h: float, end: float, count: int = 1) -> None:
        """Go on from some steps that were taken; note what breaks away in a single one."""
        last = path.filled + count
        status, now, begin = path.status[last].copy(), self.now, end - h
        balance = end - (1.0 - run.scheme.part) * h
        for j in np.flatnonzero((now.status == 0) & (status != 0)).tolist():
            share, reached, time = now.share[j], self.reached[j], begin
            if share < 1.0 < reached < 1e100:
                # By the line between two forces.
                time = float(now.balance + (1.0 - share) / (reached - share) * (balance - now.balance))
            reverses = abs(next((t for t, i, _ in self.turns[::-1] if i == j), -1.0) - begin) <= _SHORT * h
            if time > 0.0 and not reverses:
                self.turns.append((time, j, 1))
        none = np.zeros(status.size, dtype=bool)
        self.now = self.now._replace(status=status, share=self.share, released=none, balance=balance)

    def release(self, path: Path, t: float, which: int) -> None:
        """Let a slider break away at the end of the last step of a path, at a time in s."""
        status, released = self.now.status.copy(), self.now.released.copy()
        status[which], released[which] = int(np.sign(path.chunk.reaction[path.filled, self.rows][which])), True
        self.now = self.now._replace(status=status, released=released)
        self.turns.append((t, which, 1))

    def halt(self, v: Array, t: float, which: int, slid: bool = True) -> None:
        """Let a slider stick at a time in s; what its slip speed differs from zero is taken from the velocities v.

        Where it has not slid in a step before, it stops only if it moves.
        """
        stuck, status, share = self.rigid & (self.now.status == 0), self.now.status.copy(), self.now.share.copy()
        stuck[which], status[which], share[which] = True, 0, np.inf
        self.turns += [(t, which, 0)] if slid or not self.small(self.slip(v, t), v, t)[which] else []
        rows, belt, answers = self.matrix[stuck], self.speeds(t)[stuck], self._moved[stuck]
        impulse, jumps = np.linalg.solve(rows @ answers.T, rows @ v - belt), self.now.jumps.copy()
        change = impulse @ answers
        jumps[stuck] += impulse * (rows @ (v - 0.5 * change) - belt)
        v -= change
        work = self.now.work - float(impulse @ belt)
        self.now = self.now._replace(status=status, share=share, jumps=jumps, work=work)

    def steps(self, run: Run, path: Path, h: float, t: Array, forcing: Forcing, cut: bool) -> int:
        """Take steps of size h that end at times in s, as far as a path has room; return their number.

        They are entered if they may be cut, see `step`; otherwise the path is filled by them.
        Afterwards `lost` says whether the next one has no solution.
        """
        taken, some, self.lost = 0, _SOME, False
        while taken < t.size and not self.lost:
            room = path.t.size - 1 - path.filled - cut * _CUTS
            if room < 1:
                break
            after = min(taken + min(some, room), t.size)
            count = self._quiet(run, path, h, t[taken:after], forcing.part(taken, after)) if after > taken + 1 else 0
            if count and cut:
                run.enter(path, h, t[taken : taken + count], forcing.part(taken, taken + count))
            path.filled += 0 if cut else count
            taken, some = taken + count, 2 * some if count else _SOME
            if taken < after:
                # A slider may turn within this step.
                self.lost = not self.step(run, path, h, float(t[taken]), forcing.part(taken, taken + 1), cut)
                path.filled += not (cut or self.lost)
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
                self.halt(path.chunk.v[row], stop, which, not at_once)
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
    contacts = system.contacts
    if contacts is not None and np.any(contacts.jump):
        return (
            f"{group.labels[0]} acts beside {contacts.labels[int(np.argmax(contacts.jump))]}, which acts on the "
            "displacement; steps do not treat them together: use acts_on='penetration'"
        )
    past = next((other for other in system.laws if other is not group and not other.past_is_kept), None)
    if rigid.any() and past is not None:
        return (
            f"{group.labels[int(np.argmax(rigid))]} is rigid and acts beside {past.labels[0]}, which has a memory of "
            "all earlier steps; steps do not treat them together: give the slider a stiffness"
        )
    rows = group.rows.toarray()[rigid]
    if rows.shape[0] and np.linalg.matrix_rank(rows / np.linalg.norm(rows, axis=1)[:, None]) < rows.shape[0]:
        return (
            f"{' and '.join(law.label for law in group.laws if np.isinf(law.stiffness))} act on coordinates "
            "that depend on each other, so that their forces are not unique; join them, or give each a stiffness"
        )
    return None
