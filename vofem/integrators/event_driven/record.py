"""The record of an event-driven run: arrays with one row for each segment or event, which grow as needed."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.segment import Segments
from vofem.system import Events

Status = NDArray[np.int64]

#: Rows of the arrays of a new record.
_FIRST_ROWS = 32


class Buffers(NamedTuple):
    """The arrays of a record with room for more rows, as compiled code fills them."""

    #: `starts`, `durations`: start times and durations of the segments in s, shape (rows,).
    starts: Array
    durations: Array
    status: Status  #: Number of the contact status in `Record.statuses`, shape (rows,).
    #: `displacement`, `velocity`: modal states at the start of the segments, shape (rows, n).
    displacement: Array
    velocity: Array
    gaps: Array  #: Gap functions at the start, m, shape (rows, n_contacts).
    logged: Status  #: Numbers of the events before the segments, shape (rows,).
    event_time: Array  #: Times of the events in s, shape (event_rows,).
    #: `event_contact`, `event_status`: the contact and the status that it takes, shape (event_rows,).
    event_contact: Status
    event_status: Status


class Record:
    """Segments and events of a run, in order of time.

    `size`, `contacts`: numbers of modes and of contacts.
    `segments`, `events`: how many rows are in use. A segment that is being computed has a row without a duration.
    `statuses` (shape (n_contacts,)): all contact statuses so far, in the order in which they occurred.
    """

    def __init__(self, size: int, contacts: int) -> None:
        self.segments, self.events = 0, 0
        self.statuses: list[Status] = []
        self._numbers: dict[bytes, int] = {}
        rows = _FIRST_ROWS
        self.buffers = Buffers(
            np.empty(rows), np.empty(rows), np.empty(rows, dtype=np.int64), np.empty((rows, size)),
            np.empty((rows, size)), np.empty((rows, contacts)), np.empty(rows, dtype=np.int64), np.empty(rows),
            np.empty(rows, dtype=np.int64), np.empty(rows, dtype=np.int64),
        )  # fmt: skip

    def make_room(self, segments: int, events: int) -> None:
        """Let the arrays have rows for so many further segments and events."""
        parts: list[Any] = list(self.buffers)
        if self.segments + segments <= len(parts[0]) and self.events + events <= len(parts[-1]):
            return
        for k, part in enumerate(parts):
            used, more = (self.segments, segments) if k < _SEGMENT_ARRAYS else (self.events, events)
            if used + more > part.shape[0]:
                larger = np.empty((max(2 * part.shape[0], used + more), *part.shape[1:]), dtype=part.dtype)
                larger[:used] = part[:used]
                parts[k] = larger
        self.buffers = Buffers(*parts)

    def number(self, status: Status) -> int:
        """Return the number of a contact status, a new one where it has none."""
        key = status.tobytes()
        found = self._numbers.get(key)
        if found is None:
            found = self._numbers[key] = len(self.statuses)
            self.statuses.append(np.array(status))
        return found

    def add(self, t: float, status: Status, displacement: Array, velocity: Array) -> None:
        """Begin a segment at time t in s in a modal state."""
        self.make_room(1, 0)
        parts, k = self.buffers, self.segments
        parts.starts[k], parts.durations[k] = t, np.nan
        parts.status[k] = self.number(status)
        parts.displacement[k], parts.velocity[k] = displacement, velocity
        parts.logged[k] = self.events
        self.segments += 1

    def add_event(self, t: float, contact: int, status: int) -> None:
        """Append an event: a contact takes a status at time t in s."""
        self.make_room(0, 1)
        parts, k = self.buffers, self.events
        parts.event_time[k], parts.event_contact[k], parts.event_status[k] = t, contact, status
        self.events += 1

    def status(self, index: int) -> Status:
        """Return the contact status of a segment."""
        return self.statuses[self.buffers.status[index]]

    def events_after(self, index: int) -> range:
        """Return the numbers of the events between a segment and the next one; -1 for those before the first."""
        logged, following = self.buffers.logged, index + 1
        first = int(logged[index]) if index >= 0 else 0
        return range(first, int(logged[following]) if following < self.segments else self.events)

    def status_after(self, index: int) -> Status:
        """Return the contact status after the events at the end of a segment."""
        status, numbers = self.status(index).copy(), self.events_after(index)
        status[self.buffers.event_contact[numbers]] = self.buffers.event_status[numbers]
        return status

    def still(self, index: int) -> bool:
        """Return whether a segment has no duration but for rounding."""
        return bool(self.starts[index] + self.durations[index] == self.starts[index])

    @property
    def last_status(self) -> Status:
        """The contact status of the last segment."""
        return self.status(self.segments - 1)

    def state(self, index: int) -> tuple[Array, Array]:
        """Return modal displacement and velocity at the start of a segment, each of shape (n,)."""
        return self.buffers.displacement[index], self.buffers.velocity[index]

    @property
    def starts(self) -> Array:
        """Times at which the segments begin, s."""
        return self.buffers.starts[: self.segments]

    @property
    def durations(self) -> Array:
        """Durations of the segments, s."""
        return self.buffers.durations[: self.segments]

    @property
    def logged(self) -> Status:
        """Numbers of the events that had been written when the segments began."""
        return self.buffers.logged[: self.segments]

    @property
    def status_numbers(self) -> Status:
        """Numbers of the contact statuses of the segments."""
        return self.buffers.status[: self.segments]

    def as_segments(self) -> Segments:
        """Return the segments, one a row."""
        parts, rows = self.buffers, slice(self.segments)
        contacts = parts.gaps.shape[1]
        table = np.array(self.statuses, dtype=np.int64).reshape(len(self.statuses), contacts)
        return Segments(
            parts.starts[rows], parts.durations[rows], table[parts.status[rows]], parts.displacement[rows],
            parts.velocity[rows], parts.gaps[rows], parts.logged[rows],
        )  # fmt: skip

    def log(self, initial: Status) -> Events:
        """Return the events of a run that began in a contact status."""
        parts, rows = self.buffers, slice(self.events)
        if not self.events:
            return Events(initial=initial)
        times, contacts, status = parts.event_time[rows], parts.event_contact[rows], parts.event_status[rows]
        return Events(times.copy(), contacts.copy(), status.copy(), initial)

    def fill(self, segments: Segments, log: Events) -> None:
        """Take over the segments and events of an earlier run."""
        count, events = segments.starts.size, log.time.size
        self.segments, self.events = 0, 0
        self.make_room(count, events)
        parts = self.buffers
        parts.starts[:count], parts.durations[:count] = segments.starts, segments.durations
        parts.displacement[:count], parts.velocity[:count] = segments.displacement, segments.velocity
        for k, row in enumerate(np.ascontiguousarray(segments.status, dtype=np.int64)):
            parts.status[k] = self.number(row)
        parts.gaps[:count] = segments.gaps
        parts.logged[:count] = segments.logged
        parts.event_time[:events], parts.event_contact[:events] = log.time, log.contact
        parts.event_status[:events] = log.status
        self.segments, self.events = count, events


#: How many of the arrays of `Buffers` have a row for each segment; the others have one for each event.
_SEGMENT_ARRAYS = 7
