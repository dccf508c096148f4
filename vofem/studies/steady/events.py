"""The contact events of an orbit, and events that are about to appear or disappear."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.flow import Flow
from vofem.studies.steady.charts import EventChart, event_chart, sizes
from vofem.studies.steady.shooting import Shooting
from vofem.system import CLOSED, OPEN

Array = NDArray[np.float64]
Status = NDArray[np.int64]

#: Number of samples of an orbit among which extremes of gap functions are searched.
_SAMPLES = 601

#: Share of a phase without events of a contact in which its events can be ignored.
_MARGIN = 0.4

#: Largest such share of the orbit.
_MOST_MARGIN = 0.25

#: Steps by which an extreme is found between samples.
_REFINED = 4

#: Displacement of a contact between two events, divided by the size of the motion, up to which the events count as
#: simultaneous.
_AT_ONCE = 1e-13


@dataclass(frozen=True)
class Phase:
    """A stretch of an orbit between two events of one contact, the first of which is a switch.

    Attributes
    ----------
    contact : int
    time, stop : float
        Beginning and end in s. The end may lie beyond the end of the orbit.
    rate : float
        The larger of the rates of the gap function at both ends over the largest speed of the contact.
    status : int
        Status of the contact in the phase.
    earlier : float
        Time since the event before `time`, s.
    """

    contact: int
    time: float
    stop: float
    rate: float
    status: int
    earlier: float


@dataclass(frozen=True)
class Extreme:
    """A local extreme of a gap function.

    Attributes
    ----------
    contact : int
    time : float
        Time in s.
    height : float
        Value of the gap function in m: negative at a maximum while open, positive at a minimum while closed.
    status : int
        Status of the contact.
    size : float
        `height` over the size of the motion.
    """

    contact: int
    time: float
    height: float
    status: int
    size: float


def switches(chart: Any, flow: Flow) -> list[tuple[float, int, int, int, float]]:
    """Return time, contact, status before and after, and rate of all switches around an orbit, in order."""
    found = [(e.time, e.contact, e.before, e.after, e.rate) for e in flow.events]
    if isinstance(chart, EventChart) and not chart.grazes:
        for j in reversed(chart.switching):
            rate = float(flow.space.contacts[j] @ flow.start.velocity)
            found.insert(0, (flow.start.time, j, int(chart.before[j]), int(chart.after[j]), rate))
    return found


def signature(chart: Any, evaluation: Any, without: Collection[int] = ()) -> tuple[tuple[int, int], ...] | None:
    """Return how often each contact closes, as pairs (contact, count); None for methods without events.

    Contacts that graze together with that of the chart do not count, nor those `without` which the orbit is taken.
    """
    flow: Flow | None = evaluation.flow
    if flow is None:
        return None
    counts: dict[int, int] = {}
    left_out = {*without, *(contact for contact, _ in chart.also)}
    for _, contact, before, after, _ in switches(chart, flow):
        if before == OPEN and after != OPEN and contact not in left_out:
            counts[contact] = counts.get(contact, 0) + 1
    # A contact that never switches is open or closed throughout.
    still = [j for j in range(flow.space.contacts.shape[0]) if j not in counts and j not in left_out]
    status = flow.solution.segments.status[0]
    return tuple(sorted(counts.items())) + tuple((j, -int(status[j])) for j in still if status[j] != OPEN)


def phases(problem: Shooting, chart: Any, flow: Flow) -> list[Phase]:
    """Return the open and closed phases of all contacts around an orbit."""
    every = switches(chart, flow)
    _, v = sizes(problem, flow)
    found = []
    for j in {entry[1] for entry in every}:
        mine = [entry for entry in every if entry[1] == j]
        speed = v * float(np.linalg.norm(problem.space.contacts[j]))
        for k, (time, _, before, after, rate) in enumerate(mine):
            if before not in (OPEN, CLOSED) or after not in (OPEN, CLOSED) or len(mine) < 2:
                continue
            following = mine[(k + 1) % len(mine)]
            stop = following[0] + (problem.duration if k + 1 == len(mine) else 0.0)
            earlier = time - mine[k - 1][0] + (problem.duration if k == 0 else 0.0)
            found.append(Phase(j, time, stop, max(abs(rate), abs(following[4])) / speed, after, earlier))
    return found


def slowest(problem: Shooting, chart: Any, flow: Flow) -> Phase | None:
    """Return the phase whose events are slowest, and shorter than its neighbour."""
    short = [p for p in phases(problem, chart, flow) if p.stop - p.time < p.earlier]
    return min(short, key=lambda phase: phase.rate, default=None)


def chart_at(problem: Shooting, flow: Flow, chart: Any, phase: Phase) -> tuple[EventChart, Array]:
    """Return the coordinates at the first event of a phase, and their values there."""
    time, before, after, state = _state_at_event(problem, chart, flow, phase)
    margin = min(_MARGIN * phase.earlier / problem.duration, _MOST_MARGIN)
    new = event_chart(problem, phase.contact, before, after, margin)
    return new, new.coordinates(problem, time, state)


def _state_at_event(problem: Shooting, chart: Any, flow: Flow, phase: Phase) -> tuple[float, Status, Status, Array]:
    """Return time, status on both sides and state, in unknowns, at the begin of a phase.

    Contacts that switch at the same time, but for rounding, count as switching with it.
    """
    segments = flow.solution.segments
    starts = segments.starts
    k = low = high = int(np.argmin(np.abs(starts - phase.time)))
    z, v = segments.displacement[k], segments.velocity[k]
    size, _ = sizes(problem, flow)
    speed = float(np.max(np.abs(problem.space.contacts @ v)))

    def at_once(i: int) -> bool:
        return bool(abs(starts[i] - starts[k]) * speed <= _AT_ONCE * size)

    while high + 1 < starts.size and at_once(high + 1):
        high += 1
    while low > 1 and at_once(low - 1):
        low -= 1
    if low:
        before = segments.status[low - 1]
    elif isinstance(chart, EventChart):
        before = chart.before
    else:
        before = flow.status
    return float(starts[k]), before, segments.status[high], problem.to_unknowns(z, v)


def extremes(problem: Shooting, flow: Flow, window: tuple[int, float, float] | None = None) -> list[Extreme]:
    """Return local extremes of gap functions that may touch zero, the nearest to it first.

    Parameters
    ----------
    window : (contact, from, to), optional
        Only extremes of this contact between these times in s. The times may lie beyond the end of the orbit.
    """
    laws = problem.system.contacts
    if laws is None:
        return []
    duration, begin = problem.duration, flow.start.time
    low, high = (begin, begin + duration) if window is None else window[1:]
    times = np.linspace(low, high, _SAMPLES)
    inside = begin + np.mod(times - begin, duration)
    z, v = flow.solution.modal(inside)
    rows = problem.space.contacts
    s, rate = rows @ z - laws.gap[:, None], rows @ v
    size_z, _ = sizes(problem, flow)
    events = [(entry.time, entry.contact) for entry in flow.events]
    found = []
    for j in range(len(laws)):
        if window is not None and window[0] != j:
            continue
        size = size_z * float(np.linalg.norm(rows[j]))
        top = (rate[j, :-1] > 0.0) & (rate[j, 1:] <= 0.0) & (s[j, :-1] <= 0.0) & (s[j, 1:] <= 0.0)
        bottom = (rate[j, :-1] < 0.0) & (rate[j, 1:] >= 0.0) & (s[j, :-1] >= 0.0) & (s[j, 1:] >= 0.0)
        for k in np.flatnonzero(top | bottom).tolist():
            if any(i == j and inside[k] <= t <= inside[k] + times[1] - times[0] for t, i in events):
                continue
            share = rate[j, k] / (rate[j, k] - rate[j, k + 1])
            time = times[k] + share * (times[k + 1] - times[k])
            height = float(np.interp(time, times[k : k + 2], s[j, k : k + 2]))
            # The correction by a parabola between the samples.
            height += 0.5 * share * (times[k + 1] - times[k]) * float(rate[j, k]) * (1.0 - share)
            found.append(Extreme(j, float(time), height, OPEN if top[k] else CLOSED, abs(height) / size))
    return sorted(found, key=lambda extreme: extreme.size)


def height_at(problem: Shooting, flow: Flow, contact: int, time: float) -> float:
    """Return the height of an extreme of a gap function near a time, over the size of the motion."""
    laws, row = problem.system.contacts, problem.space.contacts[contact]
    assert laws is not None
    begin, width = flow.start.time, problem.duration / _SAMPLES
    places = time + np.array([-width, 0.0, width])
    for _ in range(_REFINED):
        z, v = flow.solution.modal(begin + np.mod(places - begin, problem.duration))
        rate = row @ v
        change = rate[2] - rate[0]
        middle = places[1] - (rate[1] * (places[2] - places[0]) / change if change else 0.0)
        width *= 0.1
        places = middle + np.array([-width, 0.0, width])
    z, _ = flow.solution.modal(begin + np.mod(places[1:2] - begin, problem.duration))
    size, _ = sizes(problem, flow)
    return float(row @ z[:, 0] - laws.gap[contact]) / (size * float(np.linalg.norm(row)))
