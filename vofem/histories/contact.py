"""The history of a contact: when it closed and opened, and its force."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import number, whole
from vofem.arrays import Array
from vofem.effects.two_points import UNITS, Units
from vofem.fractional.orders import exponential_order
from vofem.histories.impacts import ContactStatistics, ImpactRecord, Impacts
from vofem.histories.motion import Motion
from vofem.histories.touches import RESOLVED
from vofem.integrators.base import ContactSamples
from vofem.system import CLOSED, PINNED, ContactLaws


class ContactHistory:
    """One contact along a run.

    `closings`, `openings` and `pinned` hold the times of events. `closed`, `stiffness`, `force`, `gap_function` and
    `order` are histories at the times of the run, each of shape (n_times,). For a contact that acts on rotations read
    rad for m, and N m for N.

    Attributes
    ----------
    name : str
    units : Units
        Units of force, stiffness and impulse.
    """

    def __init__(self, run: Motion, laws: ContactLaws, index: int, units: Units = UNITS["displacement"]) -> None:
        self._run = run
        self._laws = laws
        self._index = index
        self.name = laws.names[index]
        self.units = units

    def __repr__(self) -> str:
        return f"ContactHistory({self.name!r}, {self.closings.size} closings, {self.openings.size} openings)"

    @property
    def closings(self) -> Array:
        """Times in s at which the contact closes. The first is 0.0 if it starts closed."""
        return self._run.solution.events.times(self._index, CLOSED)[0]

    @property
    def openings(self) -> Array:
        """Times in s at which the contact opens."""
        return self._run.solution.events.times(self._index, CLOSED)[1]

    @property
    def pinned(self) -> Array:
        """Intervals in s in which the contact is pinned, that is, rests exactly at its gap, shape (k, 2)."""
        begin, end = self._run.solution.events.times(self._index, PINNED)
        return np.stack([begin, np.append(end, self._run.solution.t_end)[: begin.size]], axis=1)

    @cached_property
    def _record(self) -> ImpactRecord:
        return ImpactRecord(self._run, self._laws, self._index, self.units)

    @cached_property
    def impacts(self) -> Impacts:
        """The impacts one by one: time, approach speed, duration, peak force, impulse and work.

        In a run of ``event_driven`` the numbers are exact up to rounding and do not depend on `times`: they are
        integrals and extremes of the motion between events. In a run of a stepping method they belong to the motion
        that is interpolated between its steps. They are therefore as exact as the steps. If the `times` of such a run
        are more than two steps apart, forces and work are NaN, and `Impacts.why` says so.
        """
        return self._record.impacts()

    def first_impacts(self, count: int, tolerance: float = RESOLVED) -> Impacts:
        """Return the first impacts alone, to a tolerance, which may take much less time than `impacts`.

        Parameters
        ----------
        count : int
            Number of impacts.
        tolerance : float
            Accepted error of the forces between events, divided by the largest force.
        """
        count = whole("first_impacts: count", count)
        tolerance = number("first_impacts: tolerance", tolerance, minimum=0.0)
        return ImpactRecord(self._run, self._laws, self._index, self.units, count, tolerance).impacts()

    def statistics(self, window: ArrayLike | None = None) -> ContactStatistics:
        """Return count, rate, forces, impulse, work and speeds over a window of time.

        The numbers are as exact as those of `impacts`.

        Parameters
        ----------
        window : (float, float), optional
            Begin and end of the window in s. The default is the whole run. To obtain means of the steady motion, choose
            a window after the transient that spans whole periods of the loads.

        Returns
        -------
        ContactStatistics

        Raises
        ------
        ArgumentError
            If the window does not lie within the run.
        """
        return self._record.statistics(window)

    @property
    def _samples(self) -> ContactSamples:
        return self._run.contact_samples

    @property
    def closed(self) -> NDArray[np.bool_]:
        """Whether the contact is closed, shape (n_times,)."""
        return self._samples.status[self._index] == CLOSED

    @property
    def stiffness(self) -> Array:
        """The contact stiffness K_eq in N/m, shape (n_times,)."""
        return self._samples.stiffness[self._index]

    @property
    def force(self) -> Array:
        """Contact force in N, shape (n_times,); positive pushes the bodies apart."""
        return self._samples.force[self._index]

    @property
    def gap_function(self) -> Array:
        """The gap function s in m, shape (n_times,); positive is penetration."""
        run, laws, index = self._run, self._laws, self._index
        return laws.gap_function(run.samples, index, run.times)

    @property
    def order(self) -> Array:
        """The order beta of the operator, shape (n_times,).

        Under the ideal switch it is 0 while the contact is closed and inf while it is open. It is NaN while the contact
        is pinned.
        """
        s0 = float(self._laws.resolution[self._index])
        status = self._samples.status[self._index]
        if np.isinf(s0):
            ideal = np.where(status == CLOSED, 0.0, np.inf)
            return np.where(status == PINNED, np.nan, ideal)
        return exponential_order(self.gap_function, s0)
