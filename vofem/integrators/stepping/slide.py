"""Steps of the midpoint rule where sliders act: dry friction as a complementarity in the slip over a step.

Let ``D = b.(q_1 - q_0) - h (belt_0 + belt_1)/2`` be the slip of a slider over a step of size h, N the normal force and
R the friction force, both means over the step. A rigid slider either sticks, ``D = 0`` with ``|R| <= static N``, or
slides, ``R = sign(D) coefficient N``. A slider behind a spring has the mean force of an elastic, perfectly plastic
spring on its path, for a constant N. Where a contact presses a rigid slider, N is the positive part of the mean force
of that contact in the same step. One Newton iteration in the coordinates of laws and sliders finds all forces.

A step is cut where sliding of a rigid slider ends: there the slip speed is made zero, and the rest of the step begins
with a slider that sticks. It is cut too where sticking ends with a jump of the force. Steps therefore keep order 2.
What the structure gives to a slider is ``R D``, so energies balance without an error.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.slider_history import SliderHistory
from vofem.integrators.stepping.kernel import Chunk
from vofem.integrators.stepping.travel import Midpoint, balanced, law_force
from vofem.laws import FrictionLaws
from vofem.laws.law import DAMPED, DAMPING, Laws, ask
from vofem.system import System

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_MOST, _EPS = 100, float(np.finfo(float).eps)

#: Cuts of one step, and the part of a step below which nothing is cut off.
_CUTS, _SHORT = 20, 1e-6


class Sliders:
    """The sliders of a run, and what was recorded of them.

    Attributes
    ----------
    rows : ndarray, shape (k, n)
        In band order.
    limit, static : ndarray, shape (k,)
        Coefficients.
    stretch : ndarray, shape (k,)
        Of the springs of sliders, m.
    status : ndarray of int, shape (k,)
        1 or -1 for the direction in which a slider slides, 0 while it sticks.
    taken : ndarray, shape (k,)
        Energy that friction took, J.
    loaded : ndarray, shape (2, k)
        The middle of the last step, s, and the force there over the largest while it sticks.
    log : list of ndarray, shape (6, k)
        After every step: the quantities of `SliderSamples`.
    times : list of float
        Ends of these steps, s.
    turns : list of (float, int, int)
        Time, slider, and 0 where sliding ends, 1 where sticking ends.
    """

    #: What a checkpoint holds.
    _STATE = ("stretch", "status", "taken", "loaded", "log", "times", "turns")

    def __init__(self, system: System, rows: Array, order: Integers, q: Array, v: Array) -> None:
        group = system.sliders
        assert group is not None
        self.laws = group.laws
        names = () if system.contacts is None else system.contacts.names
        self.rows = group.rows.toarray()[:, order]
        self.limit = np.array([law.limit / law.normal for law in self.laws])
        self.static = np.array([law.static / law.normal for law in self.laws])
        self.spring = np.array([law.stiffness for law in self.laws])
        self.rigid = np.isinf(self.spring)
        self.normal = np.array([np.nan if law.contact is not None else law.normal for law in self.laws])
        self.pressing = np.array([-1 if law.contact is None else names.index(law.contact) for law in self.laws])
        self.ordinary = rows
        self.all_rows = np.vstack([rows, self.rows])
        count = len(self.laws)
        self.stretch, self.taken = np.zeros((2, count))
        self.loaded, self._inertia = np.full((2, count), np.inf), np.empty((0, 0))
        slip = self.slip(v, 0.0)
        self.status = np.where(self.rigid & ~self.small(slip, v, 0.0), np.sign(slip), 0).astype(np.int64)
        zero = np.zeros(count)
        self.log = [np.array([zero, np.where(self.rigid, slip, 0.0), self.status, zero, zero, zero])]
        self.times, self.turns = [0.0], list[tuple[float, int, int]]()

    def saved(self) -> dict[str, Any]:
        """Return what a run needs to go on."""
        return {name: getattr(self, name).copy() for name in self._STATE}

    def restore(self, saved: dict[str, Any]) -> None:
        """Go on where another run was."""
        for name, value in saved.items():
            setattr(self, name, value.copy())

    def inertia(self, matrices: Midpoint) -> Array:
        """Return the answers of the mass matrix to the rows of the sliders, shape (k, n)."""
        if not self._inertia.size:
            from scipy.sparse.linalg import splu

            self._inertia = splu(matrices.mass.tocsc()).solve(self.rows.T).T
        return self._inertia

    def belts(self, t: float) -> Array:
        """Return the speeds of the belts at a time in s, m/s."""
        return np.array([0.0 if law.belt is None else float(law.belt(t)) for law in self.laws])

    def slip(self, v: Array, t: float) -> Array:
        """Return the slip speeds, m/s."""
        return np.asarray(self.rows @ v - self.belts(t))

    def small(self, slip: Array, v: Array, t: float) -> NDArray[np.bool_]:
        """Return which slip speeds are zero but for rounding."""
        return np.abs(slip) <= 64.0 * _EPS * (np.abs(self.rows) @ np.abs(v) + np.abs(self.belts(t)))

    def bounds(self, forces: Array) -> tuple[Array, Array]:
        """Return normal forces, and what they depend on: 1 where a contact presses; for forces of all laws."""
        pressed = self.pressing >= 0
        own = np.where(pressed, forces[np.maximum(self.pressing, 0)] if forces.size else 0.0, self.normal)
        return np.where(pressed, np.maximum(own, 0.0), self.normal), (pressed & (own > 0.0)).astype(float)

    def history(self, until: float) -> SliderHistory:
        """Return what was recorded so far, and what sliders did up to a time in s."""
        turns = [turn for turn in self.turns if turn[0] <= until]
        return SliderHistory(np.array(self.times), np.array(self.log), np.array(turns).reshape(-1, 3))


def refusal(group: FrictionLaws, system: System) -> str | None:
    """Return why steps cannot treat the sliders of a system, or None."""
    for law in group.laws:
        if np.isfinite(law.stiffness) and law.contact is not None:
            return (
                f"{law.label} has a spring and is pressed by the contact {law.contact!r}, which no method treats "
                "together; leave out stiffness, or give a constant normal force"
            )
        if np.isfinite(law.stiffness) and law.static > law.limit:
            return (
                f"{law.label} has a spring and a static coefficient above the sliding one, which steps do not treat; "
                "leave out static, or use method='event_driven' with a constant normal force"
            )
    for other in system.laws:
        reason = ""
        if other.moving is not None:
            reason = "moves with a base or along a beam"
        elif other is system.contacts and bool(np.any(system.contacts.jump)):
            reason = "acts on the displacement"
        elif other is not group and (other.recorded or not other.past_is_kept):
            reason = "has a memory"
        if reason:
            return f"{group.labels[0]} acts beside {other.labels[0]}, which {reason}; steps do not treat them together"
    rigid = np.array([np.isinf(law.stiffness) for law in group.laws])
    rows = group.rows.toarray()[rigid]
    if rows.shape[0] and np.linalg.matrix_rank(rows / np.linalg.norm(rows, axis=1)[:, None]) < rows.shape[0]:
        return (
            f"{' and '.join(law.label for law in group.laws if np.isinf(law.stiffness))} act on coordinates "
            "that depend on each other, so that their forces are not unique; join them, or give each a stiffness"
        )
    return None


def advance_sliding(
    sliders: Sliders, matrices: Midpoint, laws: Laws, times: Array, force: Array, chunk: Chunk
) -> tuple[int, int, Array, Array]:
    """Take the steps that a chunk has rows for.

    Parameters
    ----------
    sliders : Sliders
        Is changed.
    matrices : Midpoint
    laws : Laws
    times : ndarray, shape (steps + 1,)
        Ends of the steps, s.
    force, chunk
        See `kernel.advance`.

    Returns
    -------
    taken, solves : int
        See `kernel.advance`.
    work, dissipated : ndarray, shape (steps,)
        Of loads and belts, and what dampers and friction take, over the steps, J.
    """
    steps = times.size - 1
    work, dissipated = np.zeros((2, steps))
    whole = _reach(sliders, matrices, matrices.dt)
    for k in range(steps):
        load = force[k] if force.shape[0] else np.zeros(chunk.q.shape[1])
        step = _Step(sliders, laws, load, chunk.q[k], chunk.v[k], float(times[k]))
        if not _take(step, sliders, whole, float(times[k + 1])):
            return k, k, work, dissipated
        chunk.q[k + 1], chunk.v[k + 1] = step.q, step.v
        chunk.a[k + 1] = (step.v - chunk.v[k]) / matrices.dt
        chunk.u[k + 1] = sliders.ordinary @ step.q
        chunk.reaction[k + 1] = step.impulse[: laws.table.shape[0]] / matrices.dt
        work[k], dissipated[k] = step.work, step.lost
        step.end(matrices.dt)
    return steps, steps, work, dissipated


def _take(step: _Step, sliders: Sliders, whole: _Reach, end: float) -> bool:
    """Go on to a time in s, cutting the step where sliding ends; return whether there is a solution."""
    left, reach = whole.matrices.dt, whole
    for cuts in range(_CUTS + 1):
        found = step.solve(reach, end)
        if found is None:
            return False
        which, share, breaks = step.turn_within(found, end) if cuts < _CUTS else (-1, 1.0, False)
        if which < 0 or share > _SHORT:
            h = left
            if which >= 0 and share < 1.0 - _SHORT:
                if breaks:
                    found.status[which] = 0
                h = share * left
                found = step.solve(_reach(sliders, whole.matrices, h), end - left + h, found.status)
                if found is None:
                    return False
            step.accept(found, whole.matrices, h, end - left + h)
            left -= h
        if breaks:
            step.release(which, found)
        elif which >= 0:
            step.halt(whole.matrices, which)
        if left <= 0.0:
            return True
        if left < reach.matrices.dt:
            reach = _reach(sliders, whole.matrices, left)
    return False


class _Reach(NamedTuple):
    """Matrices for a step of a size, answers to the rows (m, n), and the fall of coordinates by unit forces (m, m)."""

    matrices: Midpoint
    answers: Array
    reach: Array


def _reach(sliders: Sliders, matrices: Midpoint, h: float) -> _Reach:
    """Return the matrices of a step of a size in s."""
    if h != matrices.dt:
        from scipy.sparse.linalg import splu

        total = matrices.mass + (0.25 * h**2) * matrices.stiffness
        if matrices.damping is not None:
            total = total + (0.5 * h) * matrices.damping
        matrices = matrices._replace(dt=h, solve=splu(total.tocsc()).solve)
    answers = matrices.solve(sliders.all_rows.T).T
    return _Reach(matrices, answers, 0.5 * h**2 * (sliders.all_rows @ answers.T))


class _Found(NamedTuple):
    """A solution of a step: mean velocity (n,), forces (m,), status, slip, stretch and normal forces of sliders."""

    p: Array
    force: Array
    status: Integers
    slip: Array
    stretch: Array
    normal: Array


class _Step:
    """One step under way: the state that is reached, and what happened since its start.

    Attributes
    ----------
    q, v : ndarray, shape (n,)
    t : float
    impulse : ndarray, shape (m,)
        Of all laws and sliders, N s.
    pressed, slid : ndarray, shape (k,)
        Integrals of the normal forces, N s, and ways that sliders slid, m.
    work, lost : float
        J.
    """

    def __init__(self, sliders: Sliders, laws: Laws, load: Array, q: Array, v: Array, t: float) -> None:
        self.sliders, self.laws, self.load, self.t = sliders, laws, load, t
        self.q, self.v, self.work, self.lost = q.copy(), v.copy(), 0.0, 0.0
        count = len(sliders.laws)
        self.impulse, self.pressed = np.zeros(sliders.all_rows.shape[0]), np.zeros(count)
        self.slid, self.first = np.zeros(count), sliders.ordinary.shape[0]
        self._held, self._released = np.zeros(count), np.zeros(count, dtype=bool)

    def solve(self, reach: _Reach, end: float, status: Integers | None = None) -> _Found | None:
        """Return the solution of a step that ends at a time in s, with the status of the sliders if it is given."""
        sliders, q0, v0 = self.sliders, self.q, self.v
        (h, mass, stiffness, damping, inverse), half, rows = reach.matrices, 0.5 * reach.matrices.dt, sliders.all_rows
        u0, p, held = rows @ q0, v0, np.zeros(rows.shape[0])
        u0 = u0.copy()
        u0[self.first :] += half * (sliders.belts(self.t) + sliders.belts(end))
        known = status
        if known is None:
            slip = sliders.slip(v0, self.t)
            turned = sliders.rigid & (sliders.status != 0) & ~sliders.small(slip, v0, self.t) & ~self._released
            status = np.where(turned, np.sign(slip), sliders.status).astype(np.int64)
        assert status is not None
        # The second time corrects errors of the factored matrix.
        for _ in range(2):
            right = self.load - stiffness @ (q0 + half * p) - mass @ ((p - v0) / half) - held @ rows
            if damping is not None:
                right -= damping @ p
            right = inverse(right)
            free = rows @ (q0 + h * (p + half * right))
            answer = self._forces(h, reach.reach, u0, free, held, status, known is not None)
            if answer is None:
                return None
            found, status = answer
            p = p + half * (right - (found - held) @ reach.answers)
            held, known = found, status
        slip = (rows @ (q0 + h * p) - u0)[self.first :]
        normal, _ = sliders.bounds(held[: self.first])
        stretch = sliders.stretch.copy()
        for j in np.flatnonzero(~sliders.rigid).tolist():
            bound = sliders.limit[j] * normal[j]
            stretch[j] = _behind(sliders.stretch[j], sliders.spring[j], bound, float(slip[j]))[2]
        return _Found(p, held, status, slip, stretch, normal)

    def _forces(
        self, h: float, reach: Array, u0: Array, free: Array, held: Array, status: Integers, known: bool
    ) -> tuple[Array, Integers] | None:
        """Return forces and status of the sliders that belong together; None where there is no solution."""
        sliders, seen = self.sliders, set[bytes]()
        for _ in range(_MOST):
            found = self._newton(h, reach, u0, free, held, status)
            if found is None or known:
                return None if found is None else (found, status)
            normal, _ = sliders.bounds(found[: self.first])
            force, slip = found[self.first :], (free - reach @ (found - held) - u0)[self.first :]
            excess = np.abs(force) - sliders.static * normal
            over = sliders.rigid & (status == 0) & (excess > 1e-12 * np.abs(force))
            back = sliders.rigid & (status != 0) & (slip * status < 0.0) & (sliders.status == 0) & (normal > 0.0)
            self._held = np.where(over, np.abs(force) / np.maximum(sliders.static * normal, 1e-300), self._held)
            change = over | back
            if not np.any(change):
                return found, status
            if status.tobytes() in seen:
                # One at a time, where all at once goes round in a circle.
                worst = np.argmax(np.where(over, excess / np.maximum(np.abs(force), 1e-300), 0.0))
                change = np.arange(change.size) == (worst if np.any(over) else np.argmax(back))
            seen.add(status.tobytes())
            status = np.where(change & over, np.sign(force), np.where(change & back, 0, status)).astype(np.int64)
        return None

    def _newton(self, h: float, reach: Array, u0: Array, free: Array, held: Array, status: Integers) -> Array | None:
        """Return the forces for a given status of the rigid sliders; None where there is no solution."""
        sliders, first, m = self.sliders, self.first, free.size

        def unbalance(trial: Array) -> tuple[Array, Array, Array]:
            u = free - reach @ (trial - held)
            off, scale, matrix = np.zeros(m), np.zeros(m), np.eye(m)
            for j in range(first):
                force, slope = law_force(self.laws, j, h, float(u0[j]), float(u[j]))
                off[j], scale[j] = force - trial[j], abs(force) + abs(trial[j]) + abs(slope * u[j])
                matrix[j] += slope * reach[j]
            normal, presses = sliders.bounds(trial[:first])
            for j in range(m - first):
                i, contact = first + j, int(sliders.pressing[j])
                bound, share = sliders.limit[j] * normal[j], sliders.limit[j] * presses[j]
                way = float(u[i] - u0[i])
                if sliders.rigid[j] and status[j] == 0:
                    off[i], matrix[i] = way, reach[i]
                    scale[i] = abs(free[i]) + abs(u0[i]) + np.abs(reach[i]) @ np.abs(trial)
                    continue
                slope, force = 0.0, float(status[j]) * bound
                if not sliders.rigid[j]:
                    force, slope, _ = _behind(sliders.stretch[j], sliders.spring[j], bound, way)
                    matrix[i] += slope * reach[i]
                off[i], scale[i] = force - trial[i], abs(force) + abs(trial[i]) + abs(slope) * (abs(u[i]) + abs(u0[i]))
                if share:
                    matrix[i, contact] -= float(status[j]) * share
            return off, scale, matrix

        return balanced(unbalance, held)

    def stop_within(self, found: _Found, end: float) -> tuple[int, float]:
        """Return the slider whose sliding ends first within a step, and after which part of it; -1 for none."""
        sliders = self.sliders
        v1 = 2.0 * found.p - self.v
        before, after = sliders.slip(self.v, self.t), sliders.slip(v1, end)
        ends = sliders.rigid & (sliders.status != 0) & (found.status != 0) & (found.normal * sliders.limit > 0.0)
        ends &= (after * found.status < 0.0) & ~sliders.small(after, v1, end)
        if not np.any(ends):
            return -1, 1.0
        before = np.where(before * found.status > 0.0, before, 0.0)
        shares = np.where(ends, before / np.where(ends, before - after, 1.0), np.inf)
        return int(np.argmin(shares)), float(np.min(shares))

    def turn_within(self, found: _Found, end: float) -> tuple[int, float, bool]:
        """Return the slider whose status changes first within a step, after which part, and whether it breaks away.

        Where the force jumps when sticking ends, the step is cut there. Other steps slide as a whole.
        """
        sliders = self.sliders
        which, share = self.stop_within(found, end)
        h, breaks = end - self.t, False
        bound = np.maximum(sliders.static * found.normal, 1e-300)
        held = np.where(found.status == 0, np.abs(found.force[self.first :]) / bound, self._held)
        for j in np.flatnonzero(sliders.rigid & (sliders.status == 0) & (sliders.static > sliders.limit)).tolist():
            before, force = sliders.loaded[:, j]
            middle = self.t + 0.5 * h
            if held[j] > force and np.isfinite(held[j] - force):
                part = (middle + (1.0 - held[j]) / (held[j] - force) * (middle - before) - self.t) / h
                if part < share:
                    which, share, breaks = j, max(part, 0.0), True
        return which, share, breaks

    def release(self, which: int, found: _Found) -> None:
        """Let a slider break away now."""
        sliders = self.sliders
        sliders.status = sliders.status.copy()
        sliders.status[which] = int(np.sign(found.force[self.first + which]))
        sliders.turns.append((self.t, which, 1))
        self._released[which] = True

    def accept(self, found: _Found, matrices: Midpoint, h: float, end: float) -> None:
        """Go to the end of a part of the step of a size in s."""
        sliders, first, p = self.sliders, self.first, found.p
        force, belt = found.force[first:], 0.5 * h * (sliders.belts(self.t) + sliders.belts(end))
        springs = np.where(sliders.rigid, 0.0, sliders.spring)
        stored = 0.5 * springs * (found.stretch**2 - sliders.stretch**2)
        taken = force * found.slip - stored
        self.work += h * float(p @ self.load) - float(force @ belt)
        self.lost += float(np.sum(taken))
        if matrices.damping is not None:
            self.lost += h * float(p @ (matrices.damping @ p))
        u0, u1 = sliders.ordinary @ self.q, sliders.ordinary @ (self.q + h * p)
        for j in np.flatnonzero(self.laws.table[:, DAMPED]).tolist():
            self.lost += ask(self.laws, j, DAMPING, float(u0[j]), float(u1[j])) * float(u1[j] - u0[j]) ** 2 / h
        slid = found.slip - np.where(sliders.rigid, 0.0, found.stretch - sliders.stretch)
        tiny = 64.0 * _EPS * (np.abs(found.slip) + np.abs(found.stretch))
        status = np.where(sliders.rigid, found.status, np.where(np.abs(slid) > tiny, np.sign(slid), 0))
        for j in np.flatnonzero((sliders.status == 0) & (status != 0)).tolist():
            time = self.t if not sliders.rigid[j] else self._break(j, h)
            reverses = sliders.rigid[j] and next((t for t, i, _ in sliders.turns[::-1] if i == j), -1.0) == self.t
            if time > 0.0 and not reverses:
                sliders.turns.append((time, j, 1))
        for j in np.flatnonzero(~sliders.rigid & (sliders.status != 0) & (status != sliders.status)).tolist():
            sliders.turns.append((self.t, j, 0))
        bound = np.maximum(sliders.static * found.normal, 1e-300)
        sliders.loaded = np.stack([np.full(force.size, self.t + 0.5 * h), np.abs(force) / bound])
        self.impulse += h * found.force
        self.pressed += h * found.normal
        self.slid += slid
        sliders.status, sliders.stretch = np.asarray(status, dtype=np.int64), found.stretch
        sliders.taken = sliders.taken + taken
        self.q, self.v, self.t = self.q + h * p, 2.0 * p - self.v, end
        self._released[:] = False

    def _break(self, j: int, h: float) -> float:
        """Return the time in s at which a slider breaks away in this step, by the line between two mean forces."""
        (before, force), now = self.sliders.loaded[:, j], self.t + 0.5 * h
        if not force < 1.0 < self._held[j] or not np.isfinite(self._held[j]) or self._held[j] > 1e100:
            return self.t
        return float(before + (1.0 - force) / (self._held[j] - force) * (now - before))

    def halt(self, matrices: Midpoint, which: int) -> None:
        """Let a slider stick; what its slip speed differs from zero is taken from the motion at once."""
        sliders = self.sliders
        stuck = sliders.rigid & (sliders.status == 0)
        stuck[which] = True
        rows, belt = sliders.rows[stuck], sliders.belts(self.t)[stuck]
        answers = sliders.inertia(matrices)[stuck]
        impulse = np.linalg.solve(rows @ answers.T, rows @ self.v - belt)
        v = self.v - impulse @ answers
        taken = impulse * (rows @ (0.5 * (v + self.v)) - belt)
        self.work -= float(impulse @ belt)
        self.lost += float(np.sum(taken))
        self.impulse[self.first :][stuck] += impulse
        sliders.taken = sliders.taken.copy()
        sliders.taken[stuck] += taken
        sliders.status = sliders.status.copy()
        sliders.status[which] = 0
        sliders.turns.append((self.t, which, 0))
        sliders.loaded = sliders.loaded.copy()
        sliders.loaded[:, which] = np.inf
        self.v = v

    def end(self, dt: float) -> None:
        """Record the end of the step, of a size in s."""
        sliders = self.sliders
        slip = np.where(sliders.rigid, sliders.slip(self.v, self.t), self.slid / dt)
        springs = np.where(sliders.rigid, 0.0, sliders.spring)
        sliders.times.append(self.t)
        sliders.log.append(np.array([
            self.impulse[self.first :] / dt, slip, sliders.status, sliders.taken, self.pressed / dt,
            0.5 * springs * sliders.stretch**2,
        ]))  # fmt: skip


def _behind(z: float, k: float, bound: float, way: float) -> tuple[float, float, float]:
    """Return the mean force of a slider behind a spring, its derivative by the way, and the stretch at the end.

    Parameters
    ----------
    z : float
        Stretch at the start, m.
    k, bound : float
        Stiffness, N/m, and the force at which it slides, N.
    way : float
        m.
    """
    most = bound / k
    end = min(max(z + way, -most), most)
    if end == z + way:
        return k * (z + 0.5 * way), 0.5 * k, end
    force = (0.5 * k * (end**2 - z**2) + k * end * (z + way - end)) / way
    return force, (k * end - force) / way, end
