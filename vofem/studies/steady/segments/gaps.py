"""Extremes of gap functions and of sliders along an orbit, at which contacts and sliders might switch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from vofem.arrays import Array
from vofem.integrators.event_driven.along import Path
from vofem.integrators.event_driven.regime import Integers, flat
from vofem.laws.friction import UP
from vofem.studies.steady.segments.extremes import LEAST, Extreme, least_rate, peak, turning_points
from vofem.studies.steady.segments.shooting import Shooting
from vofem.studies.steady.segments.sticking import pull_of
from vofem.studies.steady.segments.switches import AT_ONCE, Switches
from vofem.system import CLOSED, PINNED

#: Height of an extreme on the wrong side, over the size of the motion, that is rounding.
ROUNDING = 1e-13

#: Steps of an orbit among which extremes of gap functions are searched, and those of forces of sliders.
_SEARCHED, _PULLS = 20000, 2000

#: Height of an extreme, over the size of the motion, below which it is not computed exactly.
_LOW = -0.05

#: Share of the last step of a segment at which a sample tells whether a slider has an extreme in it.
_INSIDE = 1.0 / 16.0

#: Height of an extreme above which others may lie close to it.
_AT_GAP = -1e-6


class Stop(NamedTuple):
    """Switches at which a slider comes to rest and goes on, one if it turns at once, and contacts at its points."""

    first: int
    last: int
    held: list[int]


@dataclass(frozen=True)
class Gaps:
    """The gap functions of contacts, and what tells where sliders stop or break away, along an orbit."""

    problem: Shooting
    path: Path  #: The motion through the segments.
    chart: Switches
    sizes: tuple[float, float]  #: Sizes of modal displacements and velocities.

    def steps(self, segments: Integers, whole: int, least: int) -> Integers:
        """Return the numbers of equal steps in segments, of so many in the whole orbit and at least in each."""
        share = self.path.durations[segments] / self.problem.duration
        return np.maximum(least, (whole * share).astype(np.int64))

    def size_of(self, contacts: Sequence[int] | int) -> Array:
        """Return the sizes by which heights of extremes of contacts are divided."""
        laws = self.problem.system.contacts
        assert laws is not None
        norms = np.linalg.norm(self.problem.space.contacts[contacts], axis=-1)
        return np.maximum(norms * self.sizes[0], np.abs(laws.gap[contacts]))

    @cached_property
    def extremes(self) -> list[Extreme]:
        """The extremes of all gap functions inside segments at which the contact might switch.

        Those far from their gaps are not exact.
        """
        if self.problem.system.contacts is None:
            return []
        moves = (np.array(self.chart.statuses) != PINNED).any(axis=1)
        segments = np.flatnonzero(moves & (self.path.durations > 0.0))
        rows = self.problem.space.contacts
        of, tau, u, rates = self.path.sampled(rows, segments, self.steps(segments, _SEARCHED, LEAST))
        slips = self._slips(of, tau, rates)
        # What a slider holds turns where it does, so that rounding has no say.
        for stop in stops_of(self.problem, self.chart):
            begun = int(np.searchsorted(of, stop.first, side="right"))
            rates[stop.held, max(begun - 1, 0) : begun + 1] = 0.0
        return sorted([*self.among(of, tau, u, rates), *slips, *self._corners()])

    def _corners(self) -> list[Extreme]:
        """Return the extremes of gap functions at impacts on rigid stops, which turn them at once."""
        hits, found = [k for k, stop in enumerate(self.chart.struck) if stop >= 0], list[Extreme]()
        if not hits:
            return found
        problem, path = self.problem, self.path
        laws, rows, n = problem.system.contacts, problem.space.contacts, problem.space.size
        assert laws is not None
        sizes = self.size_of(range(len(laws)))
        for k in hits:
            status = self.chart.statuses[k]
            signs = np.where(status == CLOSED, -1.0, 1.0)
            heights = signs * (rows @ path.ends[k, :n] - laws.gap) / sizes
            before, after = (signs * (rows @ states[n:]) for states in (path.ends[k], path.begins[k + 1]))
            turns = (before > 0.0) & (after < 0.0) & (status < PINNED) & ~laws.rigid
            phase = float(path.times[k] + path.durations[k]) * problem.loads.omega
            found += [Extreme(j, k, phase, float(heights[j]), True) for j in np.flatnonzero(turns).tolist()]
        return found

    def _slips(self, of: Integers, tau: Array, rates: Array) -> list[Extreme]:
        """Return the extremes of sliders.

        `of`, `tau` (shape (n_times,)), `rates` (n_contacts, n_times): samples of segments in which some contact moves.
        """
        sliders, path, found = self.problem.course.sliders, self.path, list[Extreme]()
        if sliders is None:
            return found
        # In a shorter segment forces change by their rounding.
        for segment in np.flatnonzero(path.durations * self.problem.loads.omega > AT_ONCE).tolist():
            came = self.chart.switches[self.chart.causes[segment - 1] : segment] if segment else ()
            mine = slice(*np.searchsorted(of, [segment, segment + 1]))
            for slider in range(sliders.first, len(self.chart.start)):
                slip, status = self._slip(segment, slider), self.chart.statuses[segment][slider]
                if status == PINNED:
                    count = int(self.steps(np.array([segment]), _PULLS, LEAST)[0])
                    times = np.linspace(0.0, path.durations[segment], count + 1)
                    heights = slip(times)
                else:
                    times, heights = tau[mine], rates[slider, mine] * self._back(slider, status)
                places = (np.flatnonzero((heights[1:-1] > heights[:-2]) & (heights[1:-1] >= heights[2:])) + 1).tolist()
                peaks = [
                    peak(slip, times[k - 1], times[k + 1]) if heights[k] > _LOW else (times[k], heights[k])
                    for k in places
                ]
                for edge, beside in ((0, 1), (-1, -2)):
                    if edge == 0 and any(s.contact == slider and s.status == PINNED for s in came):
                        peaks.append((0.0, heights[0]))
                    elif heights[edge] > max(heights[beside], _LOW):
                        peaks += self._at_edge(segment, slider, slip, times[[edge, beside]], heights[edge])
                for time, height in peaks:
                    phase = float(path.times[segment] + time) * self.problem.loads.omega
                    found.append(Extreme(slider, segment, phase, float(height)))
        return found

    def _at_edge(
        self, segment: int, slider: int, slip: Callable[[Array], Array], times: Array, height: float
    ) -> list[tuple[float, float]]:
        """Return the time and the height of the extreme of a slider at an edge of a segment, if there is one.

        `slip`: its heights by times.
        `times`: of the edge, and of the sample beside it, which is lower.
        `height`: that at the edge.
        """
        chart, path, omega = self.chart, self.path, self.problem.loads.omega
        edge, inside = map(float, times)
        ends = edge > inside
        if (segment == len(chart.switches)) if ends else (segment == 0):
            return []
        before, after = (segment, chart.together(segment).stop) if ends else (chart.causes[segment - 1], segment)
        if not self._goes_on(slider, before, after):
            return []
        if slip(np.array([edge + _INSIDE * (inside - edge)]))[0] > height + ROUNDING:
            return [peak(slip, min(edge, inside), max(edge, inside))]
        sticks, jumped = chart.statuses[segment][slider] == PINNED, jumps(self.problem, chart, before)
        if not ends:
            # Its force has jumped to this height.
            there, turns = np.array([path.durations[before]]), sticks and jumped and path.durations[before] > 0.0
            turns = turns and self._slip(before, slider)(there)[0] < height - ROUNDING
        else:
            # It has a corner.
            step = _INSIDE * min(edge - inside, float(path.durations[after]))
            turns = (sticks or jumped) and step * omega > AT_ONCE
            if turns:
                then = self._slip(after, slider)(np.array([0.0, step]))
                turns = then[0] <= height + ROUNDING and then[-1] < height - ROUNDING
        return [(edge, height)] if turns else []

    def _goes_on(self, slider: int, before: int, after: int) -> bool:
        """Return whether a slider does not switch between two segments."""
        return all(switch.contact != slider for switch in self.chart.switches[before:after])

    def _back(self, slider: int, status: int) -> float:
        """Return the factor by which the speed of a slider that slides becomes a height, s/m."""
        size = float(np.linalg.norm(self.problem.space.contacts[slider]) * self.sizes[1])
        return (-1.0 if status == UP else 1.0) / size

    def _slip(self, segment: int, slider: int) -> Callable[[Array], Array]:
        """Return by how much a slider that slides has turned back, or one that sticks exceeds its limit, by times."""
        sliders, status = self.problem.course.sliders, self.chart.statuses[segment]
        if status[slider] == PINNED:
            assert sliders is not None
            pull, limit = pull_of(self.problem, self.path, segment, slider), sliders.static
            return lambda tau: np.abs(pull(tau)) / limit[slider - sliders.first] - 1.0
        row, motion = self.problem.space.contacts[slider][None], self.path.motion(segment)
        over, begin = motion.regime.over_blocks(row)[1], float(row[0] @ motion.velocity[0])
        back = self._back(slider, int(status[slider]))

        def slip(tau: Array) -> Array:
            changes = motion.regime.changes(motion.starts, np.zeros(tau.size, dtype=np.int64), tau)
            return np.asarray(back * (flat(changes) @ over + begin))

        return slip

    def among(
        self, segments: Integers, tau: Array, u: Array, rates: Array, contact: int | None = None
    ) -> list[Extreme]:
        """Return the extremes between samples, of one contact or, by default, of those open or closed.

        `segments`, `tau` have shape (n_times,), `u` and `rates` of all contacts (n_contacts, n_times).
        """
        problem, path, laws = self.problem, self.path, self.problem.system.contacts
        assert laws is not None
        rows, gaps, sizes = problem.space.contacts, laws.gap, self.size_of(range(len(laws)))
        statuses = np.array(self.chart.statuses)[segments].T
        signs = np.where(statuses == CLOSED, -1.0, 1.0)
        # A slider that sticks all along has no size.
        values, rates = signs * (u - gaps[:, None]) / np.where(sizes > 0.0, sizes, np.inf)[:, None], signs * rates
        mine = statuses[:, :-1] < PINNED if contact is None else np.arange(len(laws))[:, None] == contact
        inside = mine & (segments[:-1] == segments[1:])
        turns = (rates[:, :-1] > 0.0) & (rates[:, 1:] <= 0.0) & inside
        j, i = np.nonzero(turns)
        low, high = tau[i], tau[i + 1]
        places = low + (high - low) * rates[j, i] / (rates[j, i] - rates[j, i + 1])
        heights = np.maximum(values[j, i], values[j, i + 1]) + 0.25 * (high - low) * rates[j, i] / sizes[j]
        # At a gap two turns between samples are told apart where the rate between them has its extreme.
        of, at = np.nonzero((values[:, :-1] > _AT_GAP) & inside & ~turns)
        ways, steps = sizes[of] * (values[of, at + 1] - values[of, at]), tau[at + 1] - tau[at]
        share = least_rate(rates[of, at], rates[of, at + 1], ways, steps)
        known = np.isfinite(share)
        if known.any():
            of, at, cut = of[known], at[known], (tau[at] + share * steps)[known]
            there = signs[of, at] * path.rows(rows, segments[at])(cut)[1][of, np.arange(of.size)]
            twice = there * rates[of, at] < 0.0
            of, at, cut = of[twice], at[twice], cut[twice]
            rises = rates[of, at] > 0.0
            j, i, heights = np.append(j, of), np.append(i, at), np.append(heights, 0.0 * cut)
            low, high = (
                np.append(low, np.where(rises, tau[at], cut)),
                np.append(high, np.where(rises, cut, tau[at + 1])),
            )
            places = np.append(places, cut)
        near = heights > _LOW
        of, where = j[near], i[near]
        places[near], there = turning_points(path.rows(rows, segments[where]), of, low[near], high[near])
        heights[near] = signs[of, where] * (there - gaps[of]) / sizes[of]
        phases = (path.times[segments[i]] + places) * problem.loads.omega
        found = j.tolist(), segments[i].tolist(), phases.tolist(), heights.tolist()
        return sorted(map(Extreme, *found))


def law_of(problem: Any, contact: int) -> str:
    """Return what a touch of a contact is: "stick" of a slider, "impact", or "jump" or "smooth" by its force."""
    sliders, laws = problem.course.sliders, problem.system.contacts
    if sliders is not None and contact >= sliders.first:
        return "stick"
    if laws.rigid[contact]:
        return "impact"
    return "jump" if laws.jump[contact] and laws.gap[contact] > 0.0 else "smooth"


def jumps(problem: Any, chart: Switches, k: int) -> bool:
    """Return whether forces or velocities jump at a switch. Those of a release do not."""
    contact, laws = chart.switches[k].contact, problem.system.contacts
    moves = chart.statuses[k][contact] != PINNED
    return bool(moves and (law_of(problem, contact) != "smooth" or laws.damping[contact] > 0.0))


def stops_of(problem: Any, chart: Switches) -> list[Stop]:
    """Return where sliders stop that hold points of contacts; none of those that rest at the anchor."""
    sliders, found = problem.course.sliders, list[Stop]()
    if sliders is None:
        return found
    rows = problem.space.contacts / np.linalg.norm(problem.space.contacts, axis=1, keepdims=True)
    parallel = np.abs(rows @ rows[: sliders.first].T) >= 1.0 - ROUNDING
    for k, (slider, status, _) in enumerate(chart.switches):
        held = np.flatnonzero(parallel[slider]).tolist()
        if chart.statuses[k][slider] <= PINNED or not held:
            continue
        later = (j for j in range(k + 1, len(chart.switches)) if chart.switches[j].contact == slider)
        last = next(later, None) if status == PINNED else k
        if last is not None:
            found.append(Stop(k, last, held))
    return found
