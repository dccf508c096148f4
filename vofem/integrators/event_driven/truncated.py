"""Runs of large systems in as few Ritz vectors as a tolerance allows.

The number of vectors is doubled until the run no longer changes.

The error is estimated by running again with half of the vectors: it covers
static and dynamic responses, impacts and the shift of all later events alike.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vofem.arrays import Array
from vofem.errors import MethodError
from vofem.integrators.base import Truncation
from vofem.integrators.event_driven.solution import EventSolution
from vofem.integrators.reduction import Reduction, input_rows
from vofem.integrators.registry import advice
from vofem.system import State, System

#: Above this many unknowns a run is truncated to `TOLERANCE` by default.
FULL_UNKNOWNS = 1000
TOLERANCE = 1e-6

#: Most Ritz vectors, and most bytes that they may take.
MOST_VECTORS = 512
_MOST_MEMORY = 2 * 2**30

#: First number of Ritz vectors for every contact, load and rigid motion, and the least number in total.
_EACH, _LEAST = 4, 16

#: Loss of digits above which a run is refused.
_WORST_ROUNDING = 1e-3

#: Times at which runs are compared.
_SAMPLES = 401


def too_many_inputs(system: System) -> str | None:
    """Return why a system has too many inputs for `MOST_VECTORS`, or None."""
    contacts = 0 if system.contacts is None else len(system.contacts)
    inputs = contacts + len(system.loads) + system.rigid.shape[1]
    if _EACH * inputs <= MOST_VECTORS:
        return None
    return f"{inputs} contacts, loads and rigid motions need more than {MOST_VECTORS} Ritz vectors"


def run_truncated(
    system: System,
    start: State,
    t_end: float,
    tolerance: float,
    follow: Callable[[System, State], EventSolution],
) -> EventSolution | None:
    """Return the run with as many Ritz vectors as the tolerance asks for; None where that is no reduction.

    `tolerance`: accepted relative error of displacements.
    `follow`: runs a reduced system.
    """
    reduction = Reduction(system, start)
    if reduction.rounding > _WORST_ROUNDING:
        cause = "a compressive axial force (tension < 0)" if system.strain is None else "stiffnesses that differ much"
        raise MethodError(
            f"rounding spoils {reduction.rounding:.1e} of the static response of {system.size} degrees of freedom: "
            f"{cause} on a fine mesh. Use fewer elements, or choose {advice(conserves=True)}"
        )
    inputs = len(reduction.loads) + len(reduction.states)
    count = max(_LEAST, _EACH // 2 * (inputs + reduction.basis.rigid))
    most = min(MOST_VECTORS, _MOST_MEMORY // (8 * system.size))
    if 2 * count >= system.size:
        return None
    probe = np.linspace(0.0, t_end, _SAMPLES)
    rows = input_rows(system)
    small, begin, vectors = reduction.to(count)
    solution = follow(small, begin)
    before = _compared(solution, vectors, rows, probe)
    eigensolves = solution.counters.eigensolves
    errors: list[float] = []
    while True:
        complete = vectors.shape[1] < count
        count = min(2 * count, most)
        small, begin, vectors = reduction.to(count)
        solution = follow(small, begin)
        eigensolves += solution.counters.eigensolves
        after = _compared(solution, vectors, rows, probe)
        history = _difference(before, after)
        errors.append(float(history.max()))
        error = _extrapolated(errors)
        stalled = len(errors) > 2 and errors[-1] > 0.5 * errors[-2] > 0.25 * errors[-3]
        if complete or error <= tolerance or 2 * count > most or stalled or 2 * count >= system.size:
            break
        before = after
    beyond = np.flatnonzero(history * (error / errors[-1] if errors[-1] > 0.0 else 1.0) > tolerance)
    until = float(probe[max(beyond[0] - 1, 0)]) if beyond.size else t_end
    solution.counters.eigensolves = eigensolves
    solution.counters.factorizations += 2
    kept = Truncation(vectors.shape[1], system.size, error, until, reduction.rounding)
    return lifted(solution, vectors, kept, tolerance, bool(np.any(system.rotation)))


def lifted(solution: EventSolution, vectors: Array, kept: Truncation, tolerance: float, beams: bool) -> EventSolution:
    """Return a run in Ritz vectors (n, count), given in the degrees of freedom that these stand for.

    `tolerance`: relative error of displacements that the user accepts.
    `beams`: whether there are slopes among the degrees of freedom.
    """
    solution.vectors, solution.truncation = vectors, kept
    solution.notes[:0] = _notes(kept, tolerance, solution.t_end, beams)
    return solution


def _notes(kept: Truncation, tolerance: float, t_end: float, beams: bool) -> list[str]:
    beyond = "" if kept.until >= t_end else f"; it stays within {tolerance:g} until t = {kept.until:.4g} s"
    fine = 4.0 * np.finfo(float).eps * kept.unknowns**2
    differences = ""
    if beams:
        differences = (
            "; bending moments and shear forces, second and third differences of them, lose up to about "
            f"{fine:.0e} and {fine * kept.unknowns:.0e} (support reactions do not)"
        )
    return [
        f"truncation: {kept.vectors} Ritz vectors, static responses to contacts and loads among them, stand for "
        f"{kept.unknowns} degrees of freedom; by comparison with half as many, displacements at contacts and loads "
        f"are off by about {kept.error:.1e} of their largest value{beyond}; accelerations are off by more, most of all "
        "at a start, at kinks and steps of loads, and in the first moments after impacts",
        f"rounding: two orders of elimination differ by {kept.rounding:.1e} of the displacements{differences}",
    ]


def _extrapolated(errors: list[float]) -> float:
    """Return the error of the last run: the sum of all further changes by doubling, which shrink at the last rate."""
    rate = errors[-1] / errors[-2] if len(errors) > 1 and errors[-2] > 0.0 else 0.25
    rate = min(max(rate, 1.0 / 16.0), 0.5)
    return errors[-1] * rate / (1.0 - rate)


def _compared(solution: EventSolution, vectors: Array, rows: list[Array], times: Array) -> tuple[Array, Array]:
    """Return displacements along the rows, (k, n_times), and coordinates in the vectors, (count, n_times)."""
    z, _ = solution.modal(times)
    coordinates = solution.space.shapes @ z
    along = np.stack(rows) @ vectors if rows else np.zeros((0, vectors.shape[1]))
    return along @ coordinates, coordinates


def _difference(before: tuple[Array, Array], after: tuple[Array, Array]) -> Array:
    """Return the largest relative difference of two runs at every time; the first has fewer vectors."""
    longer = np.zeros_like(after[1])
    longer[: before[1].shape[0]] = before[1]
    change = np.linalg.norm(after[1] - longer, axis=0)
    size = np.linalg.norm(after[1], axis=0).max()
    worst = change / size if size > 0.0 else change
    for one, two in zip(*(pair[0] for pair in (before, after)), strict=True):
        largest = np.abs(two).max()
        if largest > 0.0:
            worst = np.maximum(worst, np.abs(one - two) / largest)
    return np.asarray(worst)
