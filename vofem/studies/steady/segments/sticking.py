"""What sliders and contacts hold that rest along an orbit, and where sliders rest that stick all along."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from vofem.arrays import Array
from vofem.integrators.event_driven.along import Path, Status
from vofem.laws.friction import DOWN, UP
from vofem.studies.steady.segments.extremes import LEAST, peak
from vofem.studies.steady.segments.shooting import FREE, Shooting
from vofem.system import CLOSED, PINNED

#: Difference of forces between samples, as a share of the largest one, by which it may lie in another segment.
_BESIDE = 1e-2


class Places(NamedTuple):
    """The k sliders that stick all along, and where they rest."""

    sliders: list[int]
    rows: Array  #: Their places by modal states, shape (k, 2n).
    moves: Array  #: Modal states by places, shape (2n, k).
    back: Array  #: Places by the forces that they cause at rest, shape (k, k).
    stays: Array  #: Changes of places that cause no forces, shape (k, k).


def places_of(problem: Shooting, statuses: Sequence[Status]) -> Places | None:
    """Return what the places of sliders do that stick all along; None where none does."""
    sliders = problem.course.sliders
    if sliders is None:
        return None
    every = np.all(np.array(statuses) == PINNED, axis=0)
    every[: sliders.first] = False
    if not every.any():
        return None
    kept, rows = problem.course.stuck(statuses[0]), problem.space.contacts[every]
    assert kept is not None
    moves = np.linalg.pinv(rows)
    stiffness = kept.reaction[every[statuses[0] == PINNED]] @ moves
    back = np.linalg.pinv(stiffness, rcond=FREE) if problem.centred else np.zeros_like(stiffness)
    return Places(
        np.flatnonzero(every).tolist(), np.concatenate([rows, 0.0 * rows], axis=1),
        np.concatenate([moves, 0.0 * moves]), back, np.eye(len(rows)) - back @ stiffness,
    )  # fmt: skip


def names_of(problem: Shooting, places: Places) -> str:
    """Return the names of sliders that stick all along, for messages."""
    laws = problem.system.contacts
    assert laws is not None
    return " and ".join(repr(laws.names[j]) for j in places.sliders)


def centring(problem: Shooting, path: Path, places: Places, columns: Array, lengthen: Array) -> tuple[Array, Array]:
    """Return how far sliders that stick all along rest from their centres, (k,), and derivatives, (k, columns).

    Such a slider may rest in many places. In its centre its largest and its least force are alike: there end the
    orbits in which it slides to and fro for shorter and shorter times. It stays where its force does not depend on
    the place, and where the problem does not ask for more. `columns`, `lengthen`: as in `Course.along`.
    """
    held = places.stays @ (places.rows @ columns)
    if not places.back.any():
        return np.zeros(len(places.sliders)), held
    cuts = sorted(
        (segment, time, j, way)
        for j, slider in enumerate(places.sliders)
        for segment, time, way in _strongest(problem, path, slider)
    )
    # The segments are divided there, at times that follow their begins.
    whole = [(k, tau, 1.0) for k, tau in enumerate(path.durations.tolist())]
    of, ends, lasts = zip(*sorted([*((k, tau, 0.0) for k, tau, _, _ in cuts), *whole]), strict=True)
    again = [k > 0 and of[k] == of[k - 1] for k in range(len(of))]
    begins = np.array([ends[k - 1] if same else 0.0 for k, same in enumerate(again)])
    given = [path.state(of[k], begins[k]) if same else path.begins[of[k]] for k, same in enumerate(again)]
    split = problem.course.along(
        float(path.times[0]), path.begins[0], [path.statuses[k] for k in of], np.array(ends) - begins, columns,
        lengthen[list(of)] * np.array(lasts)[:, None], every=True, given=np.array(given),
    )  # fmt: skip
    middle, slopes = np.zeros(len(places.sliders)), np.zeros((len(places.sliders), columns.shape[1]))
    for number, (segment, _, j, way) in enumerate(cuts):
        force, slope, _ = released(problem, split, segment + number, places.sliders[j], way)
        middle[j] += 0.5 * force
        slopes[j] += 0.5 * slope
    return places.back @ middle, places.back @ slopes + held


def _strongest(problem: Shooting, path: Path, slider: int) -> list[tuple[int, float, int]]:
    """Return where the force of a slider is the largest, of both ways: the segment, the time in it, and the way."""
    sampled = []
    for segment in np.flatnonzero(path.durations > 0.0).tolist():
        pull = pull_of(problem, path, segment, slider)
        times = np.linspace(0.0, path.durations[segment], LEAST + 1)
        sampled.append((segment, times, pull, pull(times)))
    found = list[tuple[int, float, int]]()
    for way, sign in ((UP, 1.0), (DOWN, -1.0)):
        # Between two segments samples are the same, and the largest force may lie in either of them.
        most, peaks = max(float((sign * forces).max()) for *_, forces in sampled), list[tuple[float, int, float]]()
        for segment, times, pull, forces in sampled:
            k = int(np.argmax(sign * forces))
            if sign * forces[k] >= most - _BESIDE * abs(most):
                time, force = peak(pull, times[max(k - 1, 0)], times[min(k + 1, LEAST)], sign)
                peaks.append((force, segment, time))
        found.append((*max(peaks)[1:], way))
    return found


def pull_of(problem: Shooting, path: Path, segment: int, slider: int) -> Callable[[Array], Array]:
    """Return the force of a slider that sticks, by times in a segment, (n_times,)."""
    status = path.statuses[segment]
    kept, held = problem.course.stuck(status), int(np.sum(status[:slider] == PINNED))
    assert kept is not None
    motion, begin = path.motion(segment), float(kept.reaction[held] @ path.starts[segment, : problem.size // 2])
    return lambda tau: np.asarray(motion.reactions(tau)[held] + begin)


def excess(
    problem: Shooting, status: Status, time: float, state: Array, contact: int, towards: int
) -> tuple[float, float]:
    """Return by how much the force of what rests in a modal state (2n,) exceeds the limit at which it switches, in N.

    `towards`: the status that it takes there.
    The second value is rounding.
    """
    force, rounding = problem.course.reaction(status, time, state, contact)
    over = force - _limit(problem, contact, towards)
    return (over if towards in (UP, CLOSED) else -over), rounding


def _limit(problem: Shooting, contact: int, towards: int) -> float:
    """Return the force in N at which what rests is released towards a status."""
    sliders, laws = problem.course.sliders, problem.system.contacts
    assert laws is not None
    if towards > PINNED:
        assert sliders is not None
        static = float(sliders.static[contact - sliders.first])
        return static if towards == UP else -static
    return float(laws.stiffness[contact] * laws.gap[contact]) if towards == CLOSED else 0.0


def released(problem: Shooting, path: Path, index: int, contact: int, status: int) -> tuple[float, Array, float]:
    """Return the equation of a release: the reaction reaches zero, or the force of the closed contact."""
    laws, n = problem.system.contacts, problem.size // 2
    assert laws is not None
    held = int(np.sum(path.statuses[index][:contact] == PINNED))
    motion, duration = path.motion(index), float(path.durations[index])
    base, limit = motion.regime.base, _limit(problem, contact, status)
    full = abs(limit) if status > PINNED else float(laws.stiffness[contact] * laws.gap[contact])
    force = base.quantities.reactions
    assert force is not None
    value = float(motion.reactions(np.array([duration]))[held, 0])
    columns = path.all_columns[index] if path.all_columns.size else np.empty((2 * n, path.shifts.shape[1]))
    rates = problem.course.loads.at(np.array([float(path.times[index]) + duration]))[0, 1]
    pushed = force.share[held] @ base.forces[0][:, motion.regime.kind.function + 1]
    real, moved, kept = motion.spectrum.real, columns[:n], problem.course.stuck(path.statuses[index])
    if kept is not None:
        value += float(kept.reaction[held] @ path.ends[index, :n])
        moved = moved - kept.carry @ moved
    derived = force.displacement[held] @ real.down(moved) + force.velocity[held] @ real.down(columns[n:])
    if kept is not None:
        derived = derived + kept.reaction[held] @ columns[:n]
    if status <= PINNED and laws.rigid[contact]:
        full = float(np.abs(force.displacement[held]) @ np.abs(real.down(path.ends[index, :n])))
        full += float(np.abs(pushed) @ np.abs(rates)) / problem.loads.omega
    # The columns move with the end of the segment, the load's phase does too.
    return (
        value - limit,
        derived + float(pushed @ rates) * path.shifts[index],
        full,
    )
