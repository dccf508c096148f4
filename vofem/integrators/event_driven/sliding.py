"""Event-driven runs with sliders: the solution, and the choice of statuses at events.

At an event the sliders whose slip speed is zero are undecided. Each may stick or slide in either direction. A choice is
admissible if all reactions of stuck ones are within their limits and all others begin to move in the direction in which
they slide, with the accelerations that follow from the choice. With equal coefficients at rest and in motion the forces
are unique (the problem is convex); else the choice that keeps most statuses is taken.
"""

from __future__ import annotations

from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.errors import ConvergenceError, MethodError
from vofem.integrators.base import Energies
from vofem.integrators.event_driven.bounces import shares
from vofem.integrators.event_driven.energy import work_and_dissipation
from vofem.integrators.event_driven.loop import OVER, STILL
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.integrators.event_driven.regime import Regime, Regimes, flat
from vofem.integrators.event_driven.sliders import Sliders, with_sliders
from vofem.integrators.event_driven.solution import EventSolution
from vofem.laws.friction import DOWN, UP
from vofem.system import CLOSED, OPEN, PINNED, Counters, Events, State, System

Integers = NDArray[np.int64]

#: Most sliders that may be undecided at one time.
_MOST_UNDECIDED = 8

#: Shares of its limit by which a stuck slider may exceed it: the second one where rounding hides that it slides.
_OVER = OVER, 1e-9


class FrictionSamples(NamedTuple):
    """Sliders at some times, each of shape (n_sliders, n_times)."""

    force: Array  #: Force with the sign of the slip speed, N; a feels the opposite.
    slip_speed: Array  #: m/s.
    status: Integers  #: 1 and -1 while it slides up and down, 0 while it sticks.
    dissipated: Array  #: Since t = 0, J.


class SlidingSolution(EventSolution):
    """The run of a scene with sliders, which are further rows behind those of the contacts."""

    sliders: Sliders

    def __init__(self, system: System, space: ModalSpace, t_end: float, times: Array, counters: Counters) -> None:
        whole = with_sliders(system)
        super().__init__(whole, space, t_end, times, counters)
        self.given = system
        group = system.sliders
        assert group is not None
        self.contact_count = 0 if system.contacts is None else len(system.contacts)
        self.sliders = Sliders(group, self.contact_count, len(self.load_functions))
        self.load_functions = [*self.load_functions, *self.sliders.anchors]
        self.load_vectors = np.concatenate([self.load_vectors, np.zeros((len(group), space.size))])
        rows = space.contacts[self.contact_count :][self.sliders.rigid]
        if len(rows) and np.linalg.matrix_rank(rows, tol=1e-9 * np.linalg.norm(rows, axis=1).max()) < len(rows):
            names = [group.labels[j] for j in np.flatnonzero(self.sliders.rigid)]
            raise MethodError(
                f"{' and '.join(names)} act on coordinates that depend on each other, so the forces of stuck sliders "
                "are not unique; give one of them a stiffness, or join them into one"
            )

    # -- statuses -------------------------------------------------------------------------------------

    def begin(self, start: State, displacement: Array, velocity: Array, fraction: float, t: float = 0.0) -> Integers:
        """Determine the statuses at the start: contacts by their gaps, sliders by their speeds or forces."""
        status = super().begin(start, displacement, velocity, fraction, t)
        status[self.contact_count :] = np.where(self.sliders.rigid, PINNED, CLOSED)
        gaps = self._gaps(status, displacement, None, None, t)
        gaps[self.contact_count :] = 0.0
        status, _ = self.decide(t, status, displacement, velocity, gaps, {}, np.abs(velocity))
        self._initial = status
        return status

    def decide(
        self, t: float, status: Integers, displacement: Array, velocity: Array, gaps: Array, triggered: dict[int, int],
        fastest: Array,
    ) -> tuple[Integers, Array]:  # fmt: skip
        """Return statuses and gaps (elongations of sliders' springs) after an event.

        `triggered`: sliders whose event functions reached zero, as numbers of rows, and where this leads.
        `fastest` (shape (n,)): the largest modal velocities so far.
        """
        sliders, first = self.sliders, self.contact_count
        status, gaps = status.copy(), gaps.copy()
        rows = self.space.contacts[first:]
        belt = sliders.belt(t)
        slip = rows @ velocity - belt
        still = np.abs(slip) <= STILL * float(np.max(np.abs(rows) @ fastest + np.abs(belt)))
        undecided = []
        for j in range(len(sliders)):
            at = first + j
            sign = UP if slip[j] > 0.0 else DOWN
            if not sliders.rigid[j]:
                status[at] = triggered.get(at, status[at])
                if status[at] in (UP, DOWN) and status[at] != sign and not still[j]:
                    # An impact has turned the speed.
                    status[at] = CLOSED
                if status[at] in (UP, DOWN):
                    gaps[at] = sliders.stretch[j] if status[at] == UP else -sliders.stretch[j]
                continue
            gaps[at] = 0.0
            if at in triggered or still[j]:
                undecided.append(j)
            else:
                status[at] = sign
        if undecided:
            self._choose(t, status, displacement, velocity, gaps, triggered, undecided)
        return status, gaps

    def _against(self, status: Integers, row: Array) -> float:
        """Return the sign of the friction of a slider whose coordinate contacts that rest at their stops hold, else 0.

        How it shares the load with the stops is not determined. It takes what it can.
        """
        stops = self.space.contacts[: self.contact_count][status[: self.contact_count] == PINNED]
        share = shares(row, stops)
        if share is None:
            return 0.0
        return 1.0 if share.sum() >= 0.0 else -1.0

    def _choose(
        self, t: float, status: Integers, displacement: Array, velocity: Array, gaps: Array, triggered: dict[int, int],
        undecided: list[int],
    ) -> None:  # fmt: skip
        """Give the undecided rigid sliders their statuses."""
        first = self.contact_count
        for j in undecided:
            sign = self._against(status, self.space.contacts[first + j])
            if sign:
                status[first + j] = UP if sign > 0.0 else DOWN
        undecided = [j for j in undecided if not self._against(status, self.space.contacts[first + j])]
        orders: list[tuple[int, ...]] = []
        for j in undecided:
            lead = triggered.get(first + j, PINNED)
            before = status[first + j]
            if lead == PINNED and before in (UP, DOWN):
                back = DOWN if before == UP else UP
                # What has not come to rest by an event has just begun to slide, and goes on if it can.
                orders.append((PINNED, back, before) if first + j in triggered else (before, PINNED, back))
            else:
                orders.append((lead, *(one for one in (PINNED, UP, DOWN) if one != lead)))
        if len(undecided) > _MOST_UNDECIDED:
            raise ConvergenceError(
                f"at t = {t:.6g} s {len(undecided)} sliders are at rest at once, {self.sliders.labels[undecided[0]]} "
                f"among them; event_driven decides on up to {_MOST_UNDECIDED}. Give some of them a stiffness"
            )
        choices = sorted(product(range(3), repeat=len(undecided)), key=sum)
        places = [first + j for j in undecided]
        for over, choice in product(_OVER, choices):
            trial = status.copy()
            trial[places] = [order[k] for order, k in zip(orders, choice, strict=True)]
            self._let_go(trial)
            if self._admissible(t, trial, displacement, velocity, gaps, triggered, undecided, status, over):
                status[:] = trial
                return
        raise ConvergenceError(
            f"at t = {t:.6g} s no status of {self.sliders.labels[undecided[0]]} agrees with its forces; rounding hides "
            "what happens there. Give the slider a stiffness"
        )

    def _let_go(self, status: Integers) -> None:
        """Open the stops whose bodies stuck sliders hold without them, together with other stops."""
        rows = self.space.contacts
        for j in np.flatnonzero(status[: self.contact_count] == PINNED).tolist():
            others = status == PINNED
            others[j] = False
            if np.any(others[self.contact_count :]) and shares(rows[j], rows[others]) is not None:
                status[j] = OPEN

    def _admissible(
        self, t: float, status: Integers, displacement: Array, velocity: Array, gaps: Array, triggered: dict[int, int],
        undecided: list[int], before: Integers, over: float,
    ) -> bool:  # fmt: skip
        sliders, first = self.sliders, self.contact_count
        rate, reaction, size = self.accelerations(t, status, displacement, velocity, gaps)
        held = np.flatnonzero(status == PINNED).tolist()
        for j in undecided:
            at = first + j
            if status[at] == PINNED:
                # One that breaks away is at its limit; that it may stick there is tried last.
                if abs(reaction[held.index(at)]) > sliders.static[j] * (1.0 + over):
                    return False
            else:
                sign = 1.0 if status[at] == UP else -1.0
                # One that has just begun to slide may go on as slowly as it began.
                begins = at not in triggered and status[at] != before[at]
                if sign * rate[j] < -STILL * size[j] or (begins and sign * rate[j] <= STILL * size[j]):
                    return False
        return True

    def accelerations(
        self, t: float, status: Integers, displacement: Array, velocity: Array, gaps: Array
    ) -> tuple[Array, Array, Array]:
        """Return accelerations of the slip (k,), reactions of what is pinned, and sizes of the former's terms (k,)."""
        space, laws, sliders, first = self.space, self.system.contacts, self.sliders, self.contact_count
        assert laws is not None
        load = self.load(t)
        force = load - space.stiffness * displacement - space.damping_force(velocity)
        push = laws.force(gaps, space.contacts @ velocity, status)
        push[first:] += sliders.signs(status) * sliders.limit
        force = force - push @ space.contacts
        rows, change = space.contacts[first:], sliders.belt(t, 1)
        size = np.abs(rows) @ (
            np.abs(load) + space.stiffness * np.abs(displacement) + np.abs(push) @ np.abs(space.contacts)
        )
        held = np.flatnonzero(status == PINNED)
        reaction = np.zeros(0)
        if held.size:
            target = np.concatenate([np.zeros(first), change])[held]
            pinned = space.contacts[held]
            reaction = np.linalg.solve(pinned @ pinned.T, pinned @ force - target)
            force = force - reaction @ pinned
        return rows @ force - change, reaction, size

    # -- linear pieces --------------------------------------------------------------------------------

    @cached_property
    def linear(self) -> Regimes:
        """The linear pieces of all statuses."""
        return Regimes(self.system, self.space, self.load_vectors, self._counted, self.sliders)

    def drift(self) -> Array:
        """Return the factors with which loads enter the sliders' coordinates: these are seen from their anchors."""
        loads = self.exosystem
        factors = np.zeros((len(loads.omega), len(self.space.contacts), loads.size))
        factors[:, self.contact_count :] = [-self.sliders.place(part) for part in loads.function]
        return factors

    def loads_at(self, regime: Regime, times: Array, displacement: Array, gaps: Array) -> Array:
        """Return states of the loads (m, 2, e) at beginnings of segments of one kind; anchors follow from the state."""
        loads, first = self.exosystem, self.contact_count
        place = displacement @ self.space.contacts[first:].T - gaps[:, first:]
        return self.sliders.anchored(
            loads.at(times), regime.kind.function, regime.blocks.of[1, : regime.loads] ** 0.5, place
        )

    # -- samples --------------------------------------------------------------------------------------

    @property
    def events(self) -> Events:
        """The contact events in order of time; those of sliders are no part of it."""
        return self.record.log(self._initial[: self.contact_count])

    def status_at(self, times: Array) -> Integers:
        """Return the status of all contacts and sliders at some times, shape (c, n_times)."""
        segments = np.clip(np.searchsorted(self.record.starts, times, side="right") - 1, 0, None)
        return np.array(self.record.statuses)[self.record.status_numbers[segments]].T

    def friction(self, times: Array) -> FrictionSamples:
        """Return the sliders at any times."""
        record, sliders, first = self.record, self.sliders, self.contact_count
        k = len(sliders)
        every = np.arange(record.segments)
        at = np.append(np.clip(np.searchsorted(record.starts, times, side="right") - 1, 0, None), every)
        t = np.append(times, record.starts + record.durations)
        force, slip, lost = np.zeros((3, k, t.size))
        status = np.zeros((k, t.size), dtype=np.int64)
        for regime, mine, _, own, begins, moved in self.moved(t, at):
            assert regime.sliding is not None
            states = flat(begins[own] + moved)
            signs = sliders.signs(record.status(int(at[mine[0]])))
            force[:, mine] = regime.sliding.forces @ states.T
            slip[:, mine] = regime.sliding.speeds @ states.T
            status[:, mine] = signs[:, None].astype(np.int64)
            path = flat(moved) @ regime.coordinates[first:].T
            lost[:, mine] = (signs * sliders.limit)[:, None] * path.T
        ends = lost[:, times.size :] + self._broken()
        before = np.cumsum(ends, axis=1) - ends + self._broken()
        count = times.size
        return FrictionSamples(
            force[:, :count], slip[:, :count], status[:, :count], lost[:, :count] + before[:, at[:count]]
        )

    def _broken(self) -> Array:
        """Return the energy that springs lose as sliders break away, at the beginnings of segments, (k, segments)."""
        record, sliders, first = self.record, self.sliders, self.contact_count
        lost = np.zeros((len(sliders), record.segments))
        higher = (sliders.static > sliders.limit) & ~sliders.rigid
        if not higher.any():
            return lost
        status = np.array([record.status(k) for k in range(record.segments)])[:, first:]
        broken = (status[1:] >= UP) & (status[:-1] == CLOSED)
        energy = np.where(higher, 0.5 * (sliders.static**2 - sliders.limit**2) / sliders.stiffness, 0.0)
        lost[:, 1:] = (broken * energy).T
        return lost

    def transitions(self, slider: int) -> tuple[Array, Array]:
        """Return the times at which sliding ends, reversals included, and those at which sticking ends, s."""
        record = self.record
        lasting = np.append(record.durations[:-1] > 0.0, True)
        status = np.array([record.status(int(k))[self.contact_count + slider] for k in np.flatnonzero(lasting)])
        starts = record.starts[lasting]
        slides = status >= UP
        changed = status[1:] != status[:-1]
        return starts[1:][slides[:-1] & changed], starts[1:][~slides[:-1] & slides[1:]]

    # -- energies -------------------------------------------------------------------------------------

    def energies(self, times: Array) -> Energies:
        """Return energies, dissipation and work at any times; springs of sliders count as strain."""
        (z, v), (s, force, status) = self.modal(times), self.pressed(times)
        first, laws = self.contact_count, self.system.contacts
        assert laws is not None
        contact = np.sum(np.where(status == CLOSED, laws.closed_energies(s), 0.0)[:first], axis=0)
        springs = np.where(self.sliders.rigid, np.inf, self.sliders.stiffness)[:, None]
        stored = np.sum(0.5 * force[first:] ** 2 / springs, axis=0)
        work, dissipated = work_and_dissipation(self.record, self.regimes, self.begins, times, self._lost_in_impacts())
        dissipated = dissipated + self.friction(times).dissipated.sum(axis=0)
        kinetic = 0.5 * np.sum(v**2, axis=0)
        strain = 0.5 * np.sum(self.space.stiffness[:, None] * z**2, axis=0) + stored
        return Energies(kinetic, strain, contact, dissipated, work)

    @property
    def sensitivity(self) -> Any:
        """Not known."""
        return None

    def conclude(self) -> None:
        """Write the notes."""
