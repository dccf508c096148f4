"""The list of the contact switches of an orbit, and the lengths of the segments between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.studies.steady.segments.settling import bounces
from vofem.system import OPEN, PINNED

#: Length in rad by which two switches may be in the wrong order: those of several contacts at one time.
AT_ONCE = 1e-9

#: Difference of phases over the orbit that is rounding.
_ALIKE = 1e-6

#: Share of a segment in which something rests by which another one is longer, and has the anchor.
_AT_REST = 0.1


class Switch(NamedTuple):
    """A contact and the status that it takes, that which it has at an impact on a rigid stop.

    `at_once`: whether what rests is released by the jump of a force at the switch before, at the same time.
    """

    contact: int
    status: int
    at_once: bool = False


#: Numbers of switches that are left out, and switches that are added; see `Switches.edited`.
Edit = tuple[list[int], list[tuple[int, float, Switch]]]


@dataclass(frozen=True)
class Switches:
    """The contact switches of orbits. The last coordinates are the lengths of the segments before them, in rad."""

    start: tuple[int, ...]  #: Status of all contacts at the anchor.
    switches: tuple[Switch, ...]  #: In the order of time from the anchor on.
    anchor: float  #: Phase of the loads in rad at which the state is an unknown.
    periods: int  #: Periods of the loads after which orbits repeat.

    @property
    def turn(self) -> float:
        """Length of the orbit in rad."""
        return 2.0 * np.pi * self.periods

    @cached_property
    def statuses(self) -> list[NDArray[np.int64]]:
        """Status of the contacts in each segment, each of shape (n_contacts,)."""
        found = [np.array(self.start, dtype=np.int64)]
        for contact, status, _ in self.switches:
            found.append(found[-1].copy())
            found[-1][contact] = status
        return found

    @cached_property
    def partners(self) -> list[int | None]:
        """For every switch the one before of the same contact, if there is one after the anchor."""
        found: list[int | None] = []
        latest: dict[int, int] = {}
        for k, (contact, status, _) in enumerate(self.switches):
            found.append(latest.pop(contact, None))
            if status == self.statuses[k][contact] or max(status, self.statuses[k][contact]) > PINNED:
                # The coordinate between two impacts is no short touch, and that of a slider is free.
                found[-1] = None
            else:
                latest[contact] = k
        return found

    @cached_property
    def struck(self) -> list[int]:
        """For every switch the rigid stop that is hit, or -1."""
        pairs = zip(self.statuses, self.switches, strict=False)
        return [s.contact if now[s.contact] == s.status else -1 for now, s in pairs]

    @cached_property
    def causes(self) -> list[int]:
        """For every switch the one by whose jump of a force it happens, itself if it does not happen at once."""
        found = list[int]()
        for k, switch in enumerate(self.switches):
            found.append(found[-1] if switch.at_once else k)
        return found

    def together(self, k: int) -> range:
        """Return the numbers of a switch, which does not happen at once, and of all that do by it."""
        last = k + 1
        while last < len(self.switches) and self.switches[last].at_once:
            last += 1
        return range(k, last)

    def lengths(self, y: Array) -> Array:
        """Return the lengths of all segments in rad, shape (n_switches + 1,)."""
        known = y[y.size - len(self.switches) :]
        return np.append(known, self.turn - known.sum())

    def rates(self, direction: Array) -> Array:
        """Return the changes of all lengths in a direction of the coordinates and the parameter, (n_switches + 1,)."""
        known = direction[direction.size - 1 - len(self.switches) : -1]
        return np.append(known, -known.sum())

    def longest(self, lengths: Array) -> int:
        """Return the longest of segments, (n_switches + 1,); one in which nothing rests may be much shorter."""
        moves = np.array([PINNED not in status for status in self.statuses])
        return int(np.argmax(np.where(moves, lengths, _AT_REST * lengths)))

    def phases(self, y: Array) -> Array:
        """Return the phases of the switches in rad, shape (n_switches,)."""
        return np.asarray(self.anchor + np.cumsum(y[y.size - len(self.switches) :]))

    def alike(self, one: float, other: float) -> bool:
        """Return whether two phases in rad are one place in the orbit, within rounding."""
        return abs((one - other + 0.5 * self.turn) % self.turn - 0.5 * self.turn) <= _ALIKE * self.turn

    @cached_property
    def successive(self) -> list[tuple[int, int]]:
        """Pairs of switches of one contact with none of it in between, but for those over the anchor."""
        found, latest = [], dict[int, int]()
        for k, (contact, *_) in enumerate(self.switches):
            if contact in latest:
                found.append((latest[contact], k))
            latest[contact] = k
        return found

    @cached_property
    def settling(self) -> set[int]:
        """The impacts with which bodies bounce until they rest, by their numbers."""
        statuses = (int(status[s.contact]) for status, s in zip(self.statuses, self.switches, strict=False))
        return bounces([(s.contact, before, s.status) for s, before in zip(self.switches, statuses, strict=True)])

    @cached_property
    def leaves(self) -> list[tuple[int, int]]:
        """Pairs of switches between which something that rested at a contact leaves it, and comes back."""
        s = self.switches
        return [(p, k) for p, k in self.successive if self.statuses[p][s[p].contact] == PINNED and s[p].status == OPEN]

    @property
    def impacts(self) -> set[tuple[int, int]]:
        """Rigid stops and the numbers of their impacts, but for those with which bodies bounce until they rest."""
        mine = [j for k, j in enumerate(self.struck) if j >= 0 and k not in self.settling]
        return {(j, mine.count(j)) for j in mine}

    @cached_property
    def spells(self) -> list[tuple[int, int]]:
        """Pairs of switches between which a slider sticks, or slides until it sticks, but for those over the anchor."""
        found = []
        began: dict[int, int] = {}
        for k, (contact, status, _) in enumerate(self.switches):
            if PINNED in (status, self.statuses[k][contact]) and contact in began:
                found.append((began[contact], k))
            if max(status, self.statuses[k][contact]) > PINNED:
                began[contact] = k
        return [(p, k) for p, k in found if PINNED in (self.switches[p].status, self.switches[k].status)]

    @cached_property
    def touches(self) -> list[tuple[int, int]]:
        """Pairs of switches of one contact of which the second undoes the first."""
        found = []
        for k, partner in enumerate(self.partners):
            if partner is not None:
                pinned = PINNED in (self.switches[partner].status, self.switches[k].status)
                if not pinned and self.statuses[partner][self.switches[k].contact] != PINNED:
                    found.append((partner, k))
        return found

    def hit_between(self, p: int, k: int) -> bool:
        """Return whether between two switches nothing happens but an impact on a rigid stop."""
        return k == p + 2 and self.struck[p + 1] >= 0

    def edited(
        self, y: Array, gone: Sequence[int] = (), added: Sequence[tuple[int, float, Switch]] = ()
    ) -> tuple[Self, Array, list[int]]:
        """Return the signature without some switches and with others, its coordinates, and the numbers of the others.

        Each of `added` comes with the number of the switch before which it is placed, and with its phase in rad.
        """
        lengths, kept = self.lengths(y), [k for k in range(len(self.switches)) if k not in gone]
        begins = np.append(self.anchor, self.phases(y))
        # Number, phase in its segment, and switch; lengths that stay are exact, because short touches need all digits.
        every = [(k, float(phase - begins[k]), switch) for k, phase, switch in added]
        every += [(k, float(lengths[k]), self.switches[k]) for k in kept]
        order = sorted(range(len(every)), key=lambda index: every[index][0])
        changed, at, past = [], 0, 0.0
        for index in order:
            k, end, _ = every[index]
            changed.append(float(lengths[at:k].sum()) - past + end)
            at, past = (k, end) if index < len(added) else (k + 1, 0.0)
        new = replace(self, switches=tuple(every[index][2] for index in order))
        numbers = [order.index(index) for index in range(len(added))]
        return new, np.append(y[: y.size - len(self.switches)], changed), numbers

    def doubled(self, y: Array) -> tuple[Self, Array]:
        """Return the signature of the orbits over twice as many periods, and the coordinates of an orbit in it."""
        k = len(self.switches)
        lengths = self.lengths(y)
        n = y.size - k
        double = replace(self, switches=self.switches * 2, periods=2 * self.periods)
        if not k:
            return double, y.copy()
        joined = lengths[-1] + lengths[0]
        return double, np.concatenate([y[:n], lengths[:k], [joined], lengths[1:k]])

    def halved(self, y: Array) -> tuple[Self, Array] | None:
        """Return the signature of the orbits over half as many periods, if the switches repeat after half the orbit."""
        k = len(self.switches)
        if self.periods % 2 or k % 2 or self.switches[: k // 2] != self.switches[k // 2 :]:
            return None
        n = y.size - k
        half = replace(self, switches=self.switches[: k // 2], periods=self.periods // 2)
        return half, np.concatenate([y[:n], y[n : n + k // 2]])
