"""Sliders in event-driven runs: what each status of a slider adds to a linear piece, and where it ends.

Sliders are further rows behind those of the contacts. A slider that slides is a constant force, one that sticks behind
a spring is a closed contact, and one that sticks rigidly is a pinned one. What a stuck slider holds on to is its
anchor: a place that moves as the belt does. The anchor is a function of time whose value at the beginning of each
segment follows from the state there. With S for the displacements that put rigidly stuck sliders at their anchors d,

    x = S d + V z.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.unloaded import Exits
from vofem.laws import ContactLaws, FrictionLaws
from vofem.laws.friction import DOWN, UP
from vofem.system import CLOSED, PINNED, System
from vofem.time_functions import TimeFunction
from vofem.time_functions.piece import Piece

if TYPE_CHECKING:
    from vofem.integrators.event_driven.modal_space import ModalSpace
    from vofem.integrators.event_driven.spectrum import Spectrum

Integers = NDArray[np.int64]


def with_sliders(system: System) -> System:
    """Return a system whose contacts are followed by its sliders, and which has no other laws."""
    from scipy.sparse import vstack

    contacts, group = system.contacts, system.sliders
    assert group is not None
    k = len(group)
    stiffness = np.array([law.stiffness for law in group.laws])
    numbers: dict[str, Any] = {
        "gap": np.zeros(k), "stiffness": np.where(np.isinf(stiffness), 0.0, stiffness), "damping": np.zeros(k),
        "jump": np.zeros(k, dtype=bool), "resolution": np.full(k, np.inf), "restitution": np.full(k, np.nan),
    }  # fmt: skip
    own = group.numbers()
    both = ContactLaws(group.names, group.rows, **numbers, sliders=own)
    if contacts is not None:
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(contacts, name), part]) for name, part in numbers.items()
        }
        rows = vstack([contacts.rows, group.rows], format="csr")
        both = ContactLaws((*contacts.names, *group.names), rows, **joined, sliders=own)
    return system.with_laws("with sliders", (both,))


@dataclass(frozen=True)
class Anchor(TimeFunction):
    """The place that a stuck slider holds on to, from any beginning: the displacement of its belt."""

    slider: int
    belt: TimeFunction | None

    def __call__(self, t: ArrayLike) -> Array:
        """Return zero: an anchor pushes nothing."""
        return np.zeros(np.shape(t))

    @property
    def closed_form(self) -> bool:  # type: ignore[override]
        """Whether the belt's speed has a closed form."""
        return self.belt is None or self.belt.closed_form

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return zero."""
        return np.zeros(np.shape(t))

    def breakpoints(self, t_end: float) -> Array:
        """Return the breakpoints of the belt's speed."""
        return np.zeros(0) if self.belt is None else self.belt.breakpoints(t_end)

    def polynomials(self, t0: Array) -> Array | None:
        """Return a place that does not move, without a belt."""
        return np.eye(4)[:, [0] * t0.size] if self.belt is None else None

    def piece(self, t0: float) -> Piece:
        """Return the integral of the belt's speed; its constant has no meaning."""
        assert self.belt is not None
        speed = self.belt.piece(t0)
        waves = tuple((w, a / (1j * w)) for w, a in speed.harmonics)
        return Piece(waves, 1.0, speed.constant, speed.slope, speed.curvature)


class Pushes(NamedTuple):
    """What sliders add to a linear piece, by its loads: e loads, n modes, k sliders."""

    #: `sources`, `rates`: modal forces of the loads' values and rates, shape (n, e).
    sources: Array
    rates: Array
    carried: Array  #: Modal displacements that follow the loads: S. Shape (n, e).
    reaction: Array  #: Reactions of everything pinned to the loads' values, shape (held, e).
    anchors: Array  #: 1 for the loads that an anchor is the sum of, shape (k, e).


class Sliders:
    """The sliders of a run.

    `contacts`, `functions`: numbers of contacts, and of functions of time without those of the anchors.
    `limit`, `static`, `stiffness` (shape (k,)): see `FrictionLaw`.
    `rigid` has shape (k,).
    """

    def __init__(self, group: FrictionLaws, contacts: int, functions: int) -> None:
        self.first, self.functions = contacts, functions
        self.limit = np.array([law.limit for law in group.laws])
        self.static = np.array([law.static for law in group.laws])
        self.normal = np.array([law.normal for law in group.laws])
        self.stiffness = np.array([law.stiffness for law in group.laws])
        self.rigid = np.isinf(self.stiffness)
        self.anchors = [Anchor(j, law.belt) for j, law in enumerate(group.laws)]
        self.labels = group.labels

    def __len__(self) -> int:
        return self.limit.size

    @property
    def breaks(self) -> Array:
        """Where stuck ones break away: their force in N, or the elongation of their springs in m, shape (k,)."""
        return np.where(self.rigid, self.static, self.static / self.stiffness)

    @property
    def stretch(self) -> Array:
        """The elongation of their springs while they slide, m, shape (k,); zero for rigid ones."""
        return np.where(self.rigid, 0.0, self.limit / self.stiffness)

    def lines(self, function: Integers, omega: Array) -> Integers:
        """Return the loads whose constants put the anchors in their places, shape (k,); those of all kinds are one."""
        return np.argmax((self.place(function) > 0.0) & (omega == 0.0), axis=1)

    def belt(self, t: ArrayLike, order: int = 0) -> Array:
        """Return the speeds of the belts at times in m/s, or their derivatives, shape (k, *t.shape)."""
        t = np.asarray(t, dtype=float)
        found = np.zeros((len(self), *t.shape))
        for j, anchor in enumerate(self.anchors):
            if anchor.belt is not None:
                found[j] = anchor.belt.derivative(t, order) if order else anchor.belt(t)
        return found

    def signs(self, status: Integers) -> Array:
        """Return 1 and -1 for sliders that slide up and down, 0 for stuck ones, shape (k, ...)."""
        own = status[self.first :]
        return np.asarray((own == UP).astype(float) - (own == DOWN))

    def place(self, function: Integers) -> Array:
        """Return 1 for the loads that each anchor is the sum of, shape (k, e)."""
        number = function - self.functions
        return np.asarray((number[None, :] == np.arange(len(self))[:, None]).astype(float))

    def anchored(self, w: Array, function: Integers, omega: Array, place: Array) -> Array:
        """Return states of the loads (m, 2, e) in which the anchors are at some places, m, shape (m, k)."""
        w, of = w.copy(), self.place(function)
        for j, line in enumerate(self.lines(function, omega).tolist()):
            others = of[j].copy()
            others[line] = 0.0
            w[:, 0, line] = place[:, j] - w[:, 0] @ others
        return w

    def pushes(
        self, space: ModalSpace, laws: ContactLaws, status: Integers, spectrum: Spectrum, function: Integers,
        omega: Array, bend: Integers,
    ) -> Pushes:  # fmt: skip
        """Return what the sliders of a status add."""
        n, e, first = space.size, omega.size, self.first
        rows, anchors, own = space.contacts[first:], self.place(function), status[first:]
        sources, rates, carried = np.zeros((3, n, e))
        sources[:, 0] = -rows.T @ (self.signs(status) * self.limit)
        springs = np.where(own == CLOSED, np.where(self.rigid, 0.0, self.stiffness), 0.0)
        sources += rows.T @ (springs[:, None] * anchors)
        held = np.flatnonzero(status == PINNED)
        reaction = np.zeros((held.size, e))
        closed = space.contacts[status == CLOSED]
        dampers = laws.damping[status == CLOSED]
        for at, j in enumerate((held - first).tolist()):
            if j < 0:
                continue
            assert spectrum.real.lifts is not None
            lift, push, react = (part[:, at] for part in spectrum.real.lifts)
            for load in np.flatnonzero(anchors[j]).tolist():
                carried[:, load] = lift
                sources[:, load] += push + omega[load] ** 2 * lift
                reaction[:, load] -= react
                rates[:, load] -= space.damping_force(lift) + closed.T @ (dampers * (closed @ lift))
                if bend[load] >= 0:
                    sources[:, bend[load]] -= lift
        return Pushes(sources, rates, carried, reaction, anchors)

    def exits(
        self, status: Integers, coordinates: Array, velocities: tuple[Array, Array],
        reaction: tuple[Array, Array] | None, sizes: Array,
    ) -> Exits:  # fmt: skip
        """Return the functions that reach zero where a slider changes its status.

        `coordinates`, `sizes` (shape (c, 2, M)): rows of all contacts and sliders, and bounds on their terms.
        `velocities`: rows of the slip speeds and such bounds, shape (k, 2, M).
        `reaction`: rows of the reactions of everything pinned, and such bounds.
        """
        first, own, signs, breaks = self.first, status[self.first :], self.signs(status), self.breaks
        held = np.flatnonzero(status == PINNED).tolist()
        found: list[tuple[Any, ...]] = []
        for j in range(len(self)):
            if signs[j]:
                stops = PINNED if self.rigid[j] else CLOSED
                found.append((-signs[j] * velocities[0][j], velocities[1][j], 0.0, 0.0, first + j, stops))
                continue
            if own[j] == PINNED:
                assert reaction is not None
                at = held.index(first + j)
                row, bound = reaction[0][at], reaction[1][at]
            else:
                row, bound = coordinates[first + j], sizes[first + j]
            for sign, lead in ((1.0, UP), (-1.0, DOWN)):
                above = sign * row
                above[0, 0] -= breaks[j]
                found.append((above, bound, 0.0, breaks[j], first + j, lead))
        return Exits(*map(np.array, zip(*found, strict=True)))


class SlidingPiece(NamedTuple):
    """What a linear piece with sliders is asked beside its motion."""

    sliders: Sliders
    status: Integers
    pushes: Pushes
    forces: Array  #: Friction forces as rows over the states of all blocks, shape (k, 2M).
    speeds: Array  #: Slip speeds, shape (k, 2M).
    space: Any
    dampers: Array  #: Those of closed contacts, N s/m, shape (c,).

    @property
    def moves(self) -> bool:
        """Whether belts move stuck sliders, so that powers have terms beside those of the blocks."""
        return any(anchor.belt is not None for anchor in self.sliders.anchors)
