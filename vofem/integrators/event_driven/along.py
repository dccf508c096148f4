"""Motion along segments of known contact statuses and durations, and its derivatives; no event is searched.

A column is the derivative of the motion with respect to one unknown. The unknown may change the state at the beginning
and the durations of segments. At a fixed time a column W of a segment follows the linear part of the motion. At the end
of the segment, whose time changes by T, the state changes by ``W + f T`` with the rates f of the state there. The next
segment begins with the column ``W + f T - f_next T``. Nothing is divided by the rate of a gap function, so this holds
at grazings too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError
from vofem.integrators.event_driven.flow import modes_of
from vofem.integrators.event_driven.regime import Motion, Regime, start_motion
from vofem.integrators.event_driven.solution import EventSolution
from vofem.integrators.event_driven.tangent import acceleration, oscillators
from vofem.linalg.exponential import matrix_change, oscillator_changes
from vofem.system import Counters, System

Array = NDArray[np.float64]
Status = NDArray[np.int64]

#: Largest growth of a motion over a segment of negative duration, as the logarithm of a factor.
_GROWTH = 20.0

#: Duration, over the time in which the fastest motion of the loads turns by 1 rad, below which the difference of mean
#: and last velocity is computed from accelerations.
_SHORT = 1e-5

#: A column that has shrunk to this share of its first size is zero.
_NOTHING = 1e-33


@dataclass(frozen=True)
class Stretch:
    """A segment of a motion.

    Attributes
    ----------
    time, duration : float
        In s; the duration may be slightly negative.
    status : ndarray of int, shape (n_contacts,)
    motion : Motion
    displacement, velocity : ndarray, shape (n,)
        Modal state at the end.
    mean : ndarray, shape (n,)
        Mean velocity; that at the start if the duration is zero.
    first, last : ndarray, shape (2n,)
        Rates of the state at both ends, under the status of the segment.
    columns : ndarray, shape (2n, k)
        Derivatives of the state at the end, whose time moves with `shift`; empty without columns.
    shift : ndarray, shape (k,)
        Derivatives of the time of the end.
    mean_columns : ndarray, shape (n_contacts, k)
        Derivatives of the mean rates of the contacts' coordinates.
    """

    time: float
    duration: float
    status: Status
    motion: Motion
    displacement: Array
    velocity: Array
    mean: Array
    first: Array
    last: Array
    columns: Array
    shift: Array
    mean_columns: Array


class Course:
    """Follows a system along given segments.

    Parameters
    ----------
    system : System
        A system that `event_driven` can treat.
    horizon : float
        Longest duration of a segment in s.
    counters : Counters
    """

    def __init__(self, system: System, horizon: float, counters: Counters) -> None:
        self.system, self.horizon = system, horizon
        self.space = modes_of(system, counters)
        self._solution = EventSolution(system, self.space, horizon, np.zeros(1), counters)
        # The loads have no breakpoints.
        self.loads = self._solution.exosystem = self._solution.loads_between(np.array([0.0, horizon]))

    def regime(self, status: Status) -> Regime:
        """Return the linear piece of a contact status."""
        return self._solution.regime(status, 0)

    def load(self, time: float) -> Array:
        """Return the modal load at a time in s, shape (n,)."""
        used = self.loads.function[0] >= 0
        values = self.loads.at(np.array([time]))[0, 0, used]
        return np.asarray(values @ self._solution.load_vectors[self.loads.function[0, used]])

    def rates(self, status: Status, time: float, displacement: Array, velocity: Array) -> Array:
        """Return the rates of a modal state, shape (2n,)."""
        a = acceleration(self.space, self.system.contacts, status, displacement, velocity, self.load(time))
        return np.concatenate([velocity, a])

    def along(
        self, time: float, displacement: Array, velocity: Array, statuses: Sequence[Status], durations: Array,
        columns: Array | None = None, lengthen: Array | None = None, nodes: Array | None = None,
    ) -> list[Stretch]:  # fmt: skip
        """Return the motion from a modal state at a time in s through segments.

        Parameters
        ----------
        statuses : sequence of ndarray of int, each (n_contacts,)
        durations : ndarray, shape (m,)
            In s.
        columns : ndarray, shape (2n, k), optional
            Derivatives of the state at the beginning, whose time is fixed.
        lengthen : ndarray, shape (m, k), optional
            Derivatives of the durations.
        nodes : ndarray, shape (m - 1, 2n), optional
            States at which the segments after the first begin, in place of the ends of the segments before. The last
            column then contains the differences, as they grow along the motion.

        Raises
        ------
        ConvergenceError
            If a motion that is followed backwards in time grows too much.
        """
        found: list[Stretch] = []
        k = 0 if columns is None else columns.shape[1]
        shift = np.zeros(k)
        first_size = None if columns is None else np.abs(columns).max(axis=0, initial=0.0)
        for index, (status, duration) in enumerate(zip(statuses, durations.tolist(), strict=True)):
            regime = self.regime(status)
            spectrum = regime.spectrum
            if duration < 0.0 and -duration * float(np.max(spectrum.delta, initial=0.0)) > _GROWTH:
                raise ConvergenceError("a segment became so short that its motion cannot be followed backwards")
            motion = start_motion(regime, displacement, velocity, self.loads.at(np.array([time]))[0])
            displacement, velocity = motion.displacement, motion.velocity
            first = self.rates(status, time, displacement, velocity)
            z, v = motion.mode_changes(np.array([duration]))
            mean = z[:, 0] / duration if duration else velocity
            displacement, velocity = displacement + z[:, 0], velocity + v[:, 0]
            last = self.rates(status, time + duration, displacement, velocity)
            mean_columns = np.zeros((self.space.contacts.shape[0], k))
            if columns is not None and lengthen is not None:
                fixed = columns - np.outer(first, shift)
                fixed, rows = self._followed(regime, duration, fixed)
                more = self._later(duration, mean, velocity, first, last)
                slope = v[:, 0] / duration if duration else first[mean.size :]
                contacts = self.space.contacts
                mean_columns = rows + np.outer(contacts @ slope, shift) + np.outer(contacts @ more, lengthen[index])
                shift = shift + lengthen[index]
                assert first_size is not None
                fixed[:, np.abs(fixed).max(axis=0, initial=0.0) < _NOTHING * first_size] = 0.0
                columns = fixed + np.outer(last, shift)
            found.append(
                Stretch(
                    time, duration, status, motion, displacement, velocity, mean, first, last,
                    np.empty((2 * mean.size, 0)) if columns is None else columns, shift, mean_columns,
                )
            )  # fmt: skip
            time += duration
            if nodes is not None and index < len(nodes):
                if columns is not None:
                    columns = columns.copy()
                    columns[:, -1] += np.concatenate([displacement, velocity]) - nodes[index]
                displacement, velocity = nodes[index, : mean.size], nodes[index, mean.size :]
        return found

    def _later(self, duration: float, mean: Array, velocity: Array, first: Array, last: Array) -> Array:
        """Return the derivative of the mean velocity with respect to the duration, shape (n,)."""
        n = mean.size
        fastest = float(np.max(self.loads.omega, initial=1.0 / self.horizon))
        if abs(duration) * fastest > _SHORT:
            return (velocity - mean) / duration
        return first[n:] / 6.0 + last[n:] / 3.0

    def _followed(self, regime: Regime, duration: float, columns: Array) -> tuple[Array, Array]:
        """Return columns at a fixed time after a duration, and the mean rates of the contacts in them."""
        n, spectrum = self.space.size, regime.spectrum
        z, v = spectrum.to_blocks(columns[:n], columns[n:], shifted=False)
        delta, p = spectrum.delta[:, None], spectrum.p[:, None]
        turn, sine = oscillator_changes(spectrum.delta, spectrum.p, np.array([duration]))
        push, pull = p * z + delta * v, v + delta * z
        mean_turn, mean_sine = (turn / duration, sine / duration) if duration else (-delta, np.ones_like(delta))
        mean_z, mean_v = mean_turn * z + mean_sine * pull, mean_turn * v - mean_sine * push
        # One added to a change would spoil what has decayed.
        cosine, sine = (part[:, None] for part in oscillators(spectrum.delta, spectrum.p, duration))
        after_z, after_v = cosine * z + sine * pull, cosine * v - sine * push
        if spectrum.plain is not None:
            assert spectrum.blocks is not None
            for cluster in spectrum.blocks.clusters:
                k = cluster.member
                both = np.concatenate([z[k], v[k]])
                generator = np.ascontiguousarray(cluster.generator)
                change = matrix_change(generator, duration) @ both
                mean = change / duration if duration else generator @ both
                after_z[k], after_v[k] = z[k] + change[: k.size], v[k] + change[k.size :]
                mean_z[k], mean_v[k] = mean[: k.size], mean[k.size :]
        rows = np.stack(np.split(regime.coordinates, 2, axis=1), axis=1)[:, :, regime.loads :]
        return np.concatenate(spectrum.to_modes(after_z, after_v, shifted=False)), rows[:, 0] @ mean_z + rows[
            :, 1
        ] @ mean_v
