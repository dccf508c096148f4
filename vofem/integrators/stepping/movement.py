"""What moves the coordinates of laws from step to step: bases, and points that travel along beams."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array, IntArray
from vofem.errors import MethodError
from vofem.laws import LawGroup
from vofem.laws.moving import Rider
from vofem.laws.rows import Rows, compressed

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


class Movement:
    """The rows and offsets of laws by time, ``u = b(t).q + g(t)``, unknowns in band order.

    `rest` (shape (m, n)): the part of the rows that does not travel.
    `travels`: whether any row travels.
    `tied` has shape (m,).
    `away` (shape (m,)): coordinates of laws that find nothing.
    `of_contacts`: what moves contacts.
    """

    def __init__(self, groups: tuple[LawGroup, ...], rest: csr_matrix, order: NDArray[np.int64]) -> None:
        self.rest, self.of_contacts, first = rest, groups[0].moving if groups[0].place == 0 else None, 0
        if self.of_contacts is not None:
            self.of_contacts = self.of_contacts.ordered(order)
        self._parts, self._riders = [], dict[int, Rider]()
        for group in groups:
            if group.moving is not None:
                moving = group.moving.ordered(order)
                self._parts.append((slice(first, first + len(group)), moving))
                self._riders.update({first + law: rider for law, rider in moving.riders.items()})
            first += len(group)
        self.travels = bool(self._riders)
        self.tied, self.away = (
            np.concatenate(part) for part in zip(*((g.tied, g.away) for g in groups), strict=True)
        )  # fmt: skip

    def offsets(self, times: Array) -> Array:
        """Return the offsets of coordinates at times, m, and their rates, shape (2, n_times, m)."""
        found = np.zeros((2, times.size, self.away.size))
        for laws, moving in self._parts:
            found[0, :, laws], found[1, :, laws] = moving.at(times).T, moving.rate(times).T
        for law, rider in self._riders.items():
            there = rider.present(times)
            found[0, :, law] += np.where(there, rider.road(times), 0.0)
            found[1, :, law] += np.where(there, rider.road_rate(times), 0.0)
        return found

    def present(self, times: Array) -> NDArray[np.bool_]:
        """Return whether laws find anything at times, (n_times, m); a tie goes on at the level of the supports."""
        found = np.ones((times.size, self.away.size), dtype=bool)
        for law, rider in self._riders.items():
            found[:, law] = self.tied[law] | rider.present(times)
        return found

    def through(self, times: Array) -> NDArray[np.bool_]:
        """Return whether laws find the same things all through the steps between times, (n_times - 1, m).

        An end of a beam that no support holds is a step of a rigid road, of infinite rate.
        """
        there = self.present(times)
        found, middle, dt = there[1:] & there[:-1], 0.5 * (times[1:] + times[:-1]), np.diff(times)
        for law, rider in self._riders.items():
            if not self.tied[law] and (jumps := rider.jumps(float(times[-1] + dt[-1]))).size:
                near = np.any(np.abs(jumps[:, None] - middle) <= dt, axis=0)
                found[:, law] &= ~(near & np.diff(rider.inside(times)))
        return found

    def passages(self, laws: IntArray, begin: Array, end: Array, times: Array) -> Array:
        """Return times of events of laws within steps: where a point comes onto its beam or leaves it, that moment.

        There the coordinate jumps, which no chord tells.
        """
        found = times.copy()
        for k, law in enumerate(laws.tolist()):
            there = self.present(np.array([begin[k], end[k]]))[:, law]
            low, high = float(begin[k]), float(end[k])
            while there[0] != there[1] and low < (middle := 0.5 * (low + high)) < high:
                same = self.present(np.array([middle]))[0, law] == there[0]
                low, high = (middle, high) if same else (low, middle)
                found[k] = high
        return found

    def settling(self, times: Array) -> NDArray[np.int64]:
        """Return the unknowns of masses that come onto beams, or leave them, in the steps between times; -1 for none.

        Shape (n_times - 1, m). Such a mass takes at once the velocity with which the beam guides it.
        """
        found = np.full((times.size - 1, self.away.size), -1)
        for law in np.flatnonzero(self.tied).tolist():
            comes = np.diff(self._riders[law].inside(times))
            found[comes, law] = self.rest.indices[self.rest.indptr[law]]
        return found

    def matrix(self, times: Array, rate: bool = False) -> csr_matrix:
        """Return the rows at times, or their rates, those of one time after those of the other."""
        from scipy.sparse import csr_matrix, vstack

        (m, n), at_rest, parts = self.rest.shape, np.zeros(times.size, dtype=np.int64), []
        for law in range(m):
            part = csr_matrix((times.size, n)) if rate else self.rest[law][at_rest]
            if law in self._riders:
                part = part + (self._riders[law].rates(times) if rate else self._riders[law].rows(times))
            parts.append(part)
        return vstack(parts, format="csr")[np.arange(m * times.size).reshape(m, -1).T.ravel()]

    def rows(self, times: Array) -> tuple[Rows, Rows]:
        """Return the same as kernels take it, and the rates."""
        order = np.arange(self.rest.shape[1])
        return compressed(self.matrix(times), order), compressed(self.matrix(times, rate=True), order)

    def along(self, x: Array, times: Array) -> Array:
        """Return the products of the rows at times with one vector each, shape (n_times, m), for x of (n_times, n)."""
        found = np.asarray((self.rest @ x.T).T)
        for law, rider in self._riders.items():
            found[:, law] += np.asarray(rider.rows(times).multiply(x).sum(axis=1)).ravel()
        return found

    def rates(self, q: Array, v: Array, times: Array) -> Array:
        """Return the rates of coordinates at times, shape (n_times, m), for states of shape (n_times, n)."""
        found = self.along(v, times) + self.offsets(times)[1]
        for law, rider in self._riders.items():
            found[:, law] += np.asarray(rider.rates(times).multiply(q).sum(axis=1)).ravel()
        return found

    def begin_ties(self, q: Array, v: Array, end: float) -> None:
        """Put masses that travel on the beam, and let them move with it, at t = 0; q and v are changed.

        Raises `MethodError` where one of them steps onto the beam, or off it, before the end of the steps in s: its
        tie would move it from the level of the supports to the beam, or back, within one step.
        """
        now = np.zeros(1)
        for law in np.flatnonzero(self.tied).tolist():
            own, rider = self.rest.indices[self.rest.indptr[law]], self._riders[law]
            if (jumps := rider.jumps(end)).size:
                raise MethodError(
                    f"the mass that is tied to {rider.track.describe()} steps onto the beam, or off it, at "
                    f"t = {jumps[0]:g} s, where no support holds the beam; a tie cannot do this. Let it begin on the "
                    "beam at t = 0, end the run before that time, or let a Mass roll on a Contact that travels"
                )
            row, rate = rider.rows(now), rider.rates(now)
            q[own] = float((row @ q)[0])
            v[own] = float((row @ v)[0] + (rate @ q)[0])
