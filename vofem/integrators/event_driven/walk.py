"""Follows a motion where events take decisions: rests at rigid stops, and sliders that stop or begin to slide at once.

Impacts that only turn a speed, and sliders that stop or begin to slide alone, are those of the compiled loop.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.errors import ConvergenceError, EventStormError
from vofem.integrators.event_driven.bounces import REST, shares, struck
from vofem.integrators.event_driven.follow import Follower
from vofem.integrators.event_driven.loop import NEAR, SWITCHED, SWITCHED_TO, ZERO
from vofem.integrators.event_driven.sliding import SlidingSolution
from vofem.integrators.event_driven.solution import EventSolution
from vofem.integrators.event_driven.tangent import acceleration
from vofem.laws.friction import DOWN, UP
from vofem.system import CLOSED, OPEN, PINNED

Status = NDArray[np.int64]

#: Most impacts at one time.
_MOST_AT_ONCE = 10_000

#: Events of sliders at one moment, above which they would not end.
_STALLED = 200


#: Distance from its stop of a contact that nothing moves.
_NEVER = -1e100

#: Derivatives of forces that are looked at where bodies at rest begin to be pressed on a stop.
_MOST_DERIVATIVES = 4


class Walker(Follower):
    """A motion with rigid stops or sliders."""

    def __init__(
        self, solution: EventSolution, time: float, status: Status, displacement: Array, velocity: Array,
        pin_fraction: float, most_events: int,
    ) -> None:  # fmt: skip
        super().__init__(solution, time, status.copy(), displacement, velocity, pin_fraction, most_events)
        laws = solution.system.contacts
        assert laws is not None
        self._laws, self._rows = laws, solution.space.contacts
        self._farthest, self._fastest = self._seen
        # Whether the present state is that after a bounce.
        self._bounced = False
        # Events in a row at one moment.
        self._stalled = 0
        if solution.record.segments:
            assert solution.gaps_now is not None
            self._gaps[:] = solution.gaps_now
            self._fresh[1, self._stops :] = (self.status != solution.record.last_status)[self._stops :]
            parts, rows = solution.record.buffers, slice(solution.record.segments)
            self._see(np.abs(parts.displacement[rows]).max(axis=0), np.abs(parts.velocity[rows]).max(axis=0))
            if solution.bounces is not None:
                np.maximum.at(self._largest, solution.bounces.contact, solution.bounces.approach)
        else:
            self._gaps[:] = solution.gaps_at(self.status, displacement, time)
            self._gaps[self._stops :] = 0.0
            touching = self._laws.rigid & (self._gaps == 0.0)
            self._strike(touching)
            if touching.any() and isinstance(solution, SlidingSolution):
                # Sliders were chosen with the speeds from before the impacts.
                self._decide({})

    def advance(self) -> None:
        """Compute one segment or more, and what the event at the end does."""
        solution = self.solution
        edges, now = solution.exosystem.edges, solution.exosystem.interval(np.array([self.time]))[0]
        duration = float(edges[now + 1]) - self.time
        places, rests = self._resting(duration)
        leaving = rests & (self.status != PINNED)
        leaving[self._stops :] = False
        # What leaves its stop without speed, as forces slowly change their signs, is not followed from nothing.
        near = places + self._forces() * (NEAR * duration) ** 2 if leaving.any() else places
        self._fresh[0] = np.where(leaving, near, 0.0)
        for j in np.flatnonzero(self._touching()).tolist():
            if self._stuck(self._rows[j]):
                # Only rounding moves it.
                self._fresh[0, j] = _NEVER
        self._single = bool(self._fresh[0].any())
        before = self.time
        super().advance()
        self._stalled = self._stalled + 1 if self.time == before else 0
        if self._stalled > _STALLED and isinstance(solution, SlidingSolution):
            raise ConvergenceError(
                f"at t = {self.time:.6g} s sliders stop and begin to slide without end, "
                f"{solution.sliders.labels[0]} among them; rounding hides what happens there. Give them a stiffness"
            )

    def _resting(self, duration: float) -> tuple[Array, NDArray[np.bool_]]:
        """Return sizes of the contacts' coordinates within a duration, m, and which rest at their gaps, (n_contacts,).

        They do so but for rounding.
        """
        with np.errstate(divide="ignore"):
            time = np.minimum(1.0 / self._frequencies, duration)
        places = np.abs(self._rows) @ (self._farthest + time * self._fastest)
        return places, (np.abs(self._gaps) <= ZERO * places) & (np.abs(self._rows @ self.velocity) <= self._zero())

    def _enter(self) -> None:
        """Write the state that has been reached; springs of sliders keep their elongations."""
        kept = self._gaps[self._stops :].copy()
        super()._enter()
        self._gaps[self._stops :] = kept

    def _take_over(self, functions: Array | None, *, overload: bool) -> None:
        """Take over what the loop has done, and what rests at stops after the event that it leaves open."""
        self._bounced = False
        super()._take_over(functions, overload=overload)
        if overload:
            self._overload(int(self._run[SWITCHED]), int(self._run[SWITCHED_TO]))
        self.solution.gaps_now = self._gaps.copy()

    def _overload(self, switched: int, lead: int) -> None:
        """Choose the statuses of sliders where some cannot hold what follows the event of a contact or slider."""
        triggered = {}
        if switched >= self._stops:
            self.status = self.solution.record.last_status
            # One that slid before has come to rest first.
            stops = lead in (UP, DOWN) and self.status[switched] in (UP, DOWN)
            triggered = {switched: PINNED if stops else lead}
        self._pass_sliders(triggered)

    def _see(self, displacement: Array, velocity: Array) -> None:
        """Take a modal state among those whose size tells what is rounding."""
        for largest, state in zip(self._seen, (displacement, velocity), strict=True):
            np.maximum(largest, np.abs(state), out=largest)

    def _sizes(self, order: int) -> Array:
        """Return the sizes of derivatives of the modes by time, as large as they may have been in free motion, (n,)."""
        return np.asarray(self._frequencies**order * self._farthest + self._frequencies ** (order - 1) * self._fastest)

    def _record(self) -> int:
        """Begin a segment in the present state; return its number."""
        record, self._bounced = self.solution.record, False
        self._see(self.displacement, self.velocity)
        record.add(self.time, self.status, self.displacement, self.velocity)
        record.buffers.gaps[record.segments - 1] = self._gaps
        record.buffers.durations[record.segments - 1] = 0.0
        return record.segments - 1

    def _decide(self, triggered: dict[int, int]) -> None:
        """Choose the statuses of the sliders."""
        solution, stops = self.solution, self._stops
        assert isinstance(solution, SlidingSolution)
        before = self.status
        # What has come to rest at a stop has lost its speed in an impact, which sliders do not resist.
        held = self._rows[:stops][before[:stops] == PINNED]
        velocity = self.velocity - np.linalg.pinv(held) @ (held @ self.velocity) if len(held) else self.velocity
        self._see(self.displacement, self.velocity)
        after, self._gaps[:] = solution.decide(
            self.time, before, self.displacement, velocity, self._gaps, triggered, self._fastest
        )
        let_go = np.flatnonzero(before[:stops] != after[:stops])
        if np.any(np.abs(self._rows[let_go] @ self.velocity) > self._zero()[let_go]):
            # What the impact at a stop does that is let go at once is between segments of its own.
            self._record()
            self.velocity = velocity
        for j in let_go.tolist():
            self._log(j, OPEN)
        self.status = after
        solution.counters.events += int(np.sum(before[stops:] != after[stops:]))

    def _zero(self) -> Array:
        """Return the speeds at the contacts below which they are rounding, m/s."""
        return np.asarray(ZERO * (np.abs(self._rows) @ self._sizes(1)))

    def _forces(self) -> Array:
        """Return the sizes of the accelerations at the contacts, of which forces may balance each other, m/s^2."""
        solution = self.solution
        push = self._sizes(2)
        for vector, function in zip(solution.load_vectors, solution.load_functions, strict=True):
            push = push + np.abs(vector) * abs(float(function(self.time)))
        return np.asarray(np.abs(self._rows) @ push)

    def _pass_event(self, entered: dict[int, int]) -> None:
        """Change status and velocity at an event, given the contacts that reach a limit and where this leads.

        With none, loads may jump, or begin to press on what touches its stop at rest.
        """
        touching = self._touching()
        if not entered and touching.any():
            self._strike(touching)
        triggered = {j: new for j, new in entered.items() if j >= self._stops}
        entered = {j: new for j, new in entered.items() if j < self._stops}
        if entered:
            # A slider that breaks away at the same time holds nothing any more.
            self.status = self.status.copy()
            for j, new in triggered.items():
                self.status[j] = new if new in (UP, DOWN) else self.status[j]
            self._pass_contacts(entered)
        if isinstance(self.solution, SlidingSolution):
            self._pass_sliders(triggered)

    def _pass_sliders(self, triggered: dict[int, int]) -> None:
        """Choose the statuses of the sliders, and strike the stops off which they no longer hold bodies."""
        before, present = self.solution.record.last_status, self.status
        self._decide(triggered)
        touching = self._touching()
        if np.any(self.status[self._stops :] != present[self._stops :]) and touching.any():
            # Sliders that begin to slide no longer hold bodies off the stops that these touch at rest.
            present = self.status
            self._strike(touching)
            if self.status is not present:
                self._decide({})
        self._fresh[1, self._stops :] = (self.status != before)[self._stops :]

    def _touching(self) -> NDArray[np.bool_]:
        """Return which rigid stops are touched and hold nothing, shape (n_contacts,)."""
        return np.asarray(self._laws.rigid & (self.status == OPEN) & (self._gaps == 0.0))

    def _pass_contacts(self, entered: dict[int, int]) -> None:
        solution, rigid = self.solution, self._laws.rigid
        yielding = {j: new for j, new in entered.items() if not rigid[j]}
        before = self.status
        after = solution.enter(self.time, before, yielding, self.displacement, self.velocity, self._pin_fraction)
        touching = np.zeros(rigid.size, dtype=bool)
        for j in entered:
            if rigid[j] and before[j] == PINNED:
                after[j] = OPEN
                self._log(j, OPEN)
            touching[j] = rigid[j] and before[j] != PINNED
        changed = np.array(sorted(entered))
        self._gaps[changed] = 0.0
        free = changed[after[changed] != PINNED]
        if free.size:
            self.displacement = solution.at_gaps(free, self.displacement, self.time)
        self.status = after
        if touching.any():
            self._strike(touching)

    def _log(self, contact: int, status: int) -> None:
        self.solution.record.add_event(self.time, contact, status)
        self.solution.counters.events += 1

    def _strike(self, touching: NDArray[np.bool_]) -> None:
        """Let bodies bounce off the rigid stops that they touch, one after the other, until none approaches its stop.

        `touching` (shape (n_contacts,)): rigid stops without those at which something rests, which join when an impact
        moves it.
        """
        laws, rows, done = self._laws, self._rows, set[int]()
        self._see(self.displacement, self.velocity)
        for _ in range(_MOST_AT_ONCE):
            at_rest = laws.rigid & (self.status == PINNED)
            speed, zero = rows @ self.velocity, self._zero()
            np.maximum(self._largest, speed, out=self._largest, where=touching | at_rest)
            limit = np.maximum(REST * self._largest, zero)
            for j in np.flatnonzero(at_rest & (speed < -limit)).tolist():
                self._change(j, OPEN)
            settled = touching & (speed >= -zero) & ((speed <= limit) | (laws.restitution == 0.0))
            moving = (touching | at_rest) & ~settled & (speed > limit)
            if moving.any():
                j = int(np.argmax(np.where(moving, speed, -np.inf)))
                self._bounce(j)
                touching[j] = True
            elif not self._settle(settled & (self.status != PINNED), zero, done):
                break
        else:
            raise EventStormError(
                f"more than {_MOST_AT_ONCE} impacts at t = {self.time:.6g} s: bodies are caught between rigid stops "
                f"such as {laws.labels[int(np.argmax(touching))]}"
            )
        # What comes to rest at a rigid stop stops at once, and forces of finite size cannot hold anything else then.
        held = rows[laws.rigid & (self.status == PINNED)]
        speed = rows @ (self.velocity - np.linalg.pinv(held) @ (held @ self.velocity))
        chattering = (self.status == PINNED) & laws.jump & (np.abs(speed) > zero)
        for j in np.flatnonzero(chattering).tolist():
            self._change(j, CLOSED if speed[j] > 0.0 else OPEN)

    def _change(self, j: int, status: int) -> None:
        """Give a contact a status, and record it."""
        self.status = self.status.copy()
        self.status[j] = status
        self._log(j, status)

    def _pushed(self, j: int, velocity: Array) -> float:
        """Return the acceleration towards a stop that is open, m/s^2."""
        solution = self.solution
        load = solution.load(self.time)
        total = acceleration(solution.space, self._laws, self.status, self.displacement, velocity, load)
        if isinstance(solution, SlidingSolution):
            push = np.zeros(len(self._laws))
            sliders, first = solution.sliders, self._stops
            stuck = self.status[first:] == CLOSED
            behind = stuck * (self._gaps[first:] - self._rows[first:] @ self.displacement)
            push[first:] = sliders.signs(self.status) * sliders.limit + self._laws.stiffness[first:] * behind
            total = total - push @ self._rows
        return float(self._rows[j] @ total)

    def _bounce(self, j: int) -> None:
        """Let a body bounce off a stop; the state before is a segment of its own."""
        self._record()
        self.velocity = struck(self._rows[j], float(self._laws.restitution[j]), self.velocity)
        self._log(j, CLOSED)
        self._change(j, OPEN)
        self._bounced = True

    def _settle(self, settled: NDArray[np.bool_], zero: Array, done: set[int]) -> bool:
        """Pin the contacts that no longer move against their stops if forces press them on; else let them go.

        One that would have to pull at another stop, so that this holds what rests there, is let go as well. The return
        value tells whether one has been pinned, which may press others on, or one that is let go has bounced, after
        which others may move. `done` holds the numbers of these; `zero` is the rounding of the speeds.
        """
        solution, before = self.solution, self.status
        space, load = solution.space, solution.load(self.time)
        for j in np.flatnonzero(settled).tolist():
            row = self._rows[j]
            held = self._rows[settled | (self.status == PINNED)]
            velocity = self.velocity - np.linalg.pinv(held) @ (held @ self.velocity)
            force = acceleration(space, None, self.status, self.displacement, velocity, load)
            pushed, size = self._pushed(int(j), velocity), self._forces()[j]
            pulled = self._pulls(settled, zero)
            if self._stuck(row):
                pushed = 0.0
            elif abs(pushed) <= ZERO * size:
                pushed, size = self._begins(row, velocity, force), 0.0
            if pushed > ZERO * size and not (pulled and j not in done):
                if self._bounced:
                    # Others have bounced at the same time: what each impact does is between segments of its own.
                    self._record()
                self._change(j, PINNED)
            elif 0.0 < row @ self.velocity <= zero[j]:
                # Rounding of faster impacts is none.
                self.velocity = struck(row, 0.0, self.velocity)
            elif row @ self.velocity > 0.0 and j not in done:
                self._bounce(j)
                done.add(j)
                return True
        return self.status is not before

    def _stuck(self, row: Array) -> bool:
        """Return whether it takes stuck sliders, which no belt moves, to hold a coordinate; then no stop needs to."""
        at_rest, first = self.status == PINNED, self._stops
        if isinstance(self.solution, SlidingSolution):
            at_rest[first:] &= [anchor.belt is None for anchor in self.solution.sliders.anchors]
        rows, stops = self._rows[at_rest], self._rows[:first][at_rest[:first]]
        return len(rows) > len(stops) and shares(row, rows) is not None and shares(row, stops) is None

    def _begins(self, row: Array, velocity: Array, force: Array) -> float:
        """Return the first derivative of the push along a row that is not zero, of what does not push yet.

        `velocity`, `force`: modal velocities, and accelerations that stops do not change. Bodies at rest keep together;
        a row that they hold already is that of the forces alone, and refused where it is pressed. A derivative of a
        load counts as zero where the others exceed it by far within the time in which the load changes, as the first
        one of a cosine does.
        """
        solution = self.solution
        space, orders = solution.space, np.arange(1, _MOST_DERIVATIVES + 1)
        short = min((function.shortest(solution.t_end) for function in solution.load_functions), default=np.inf)
        powers = min(short, solution.t_end) ** orders
        loads, sizes = np.zeros((2, orders.size, row.size))
        for vector, function in zip(solution.load_vectors, solution.load_functions, strict=True):
            terms = np.array([float(function.derivative(self.time, int(order))) for order in orders])[:, None] * vector
            loads, sizes = loads + terms, sizes + np.abs(terms)
        noise = np.max((sizes @ np.abs(row)) * powers) / powers
        held = self._rows[self.status == PINNED]
        free = np.eye(row.size) - np.linalg.pinv(held) @ held
        if np.linalg.norm(free @ row) <= NEAR * np.linalg.norm(row):
            free = np.eye(row.size)
        before, after = velocity, free @ force
        for order, load, own, least in zip(orders, loads, sizes, noise, strict=True):
            damped = space.damping_force(after)
            before, after = after, free @ (load - space.stiffness * before - damped)
            push, size = float(row @ after), own + np.abs(damped) + self._sizes(int(order) + 2)
            if abs(push) > ZERO * max(float(np.abs(row) @ size), float(least)):
                return push
        return 0.0

    def _pulls(self, settled: NDArray[np.bool_], zero: Array) -> bool:
        """Return whether contacts that came to rest now would have to be pulled at by a stop where others rest."""
        rest = self._laws.rigid & (self.status == PINNED)
        number = np.flatnonzero(settled | rest)
        rows = self._rows[number]
        impulse = np.linalg.lstsq(rows @ rows.T, rows @ self.velocity, rcond=None)[0]
        return bool(np.any(rest[number] & (impulse * np.sum(rows**2, axis=1) < -zero[number])))
