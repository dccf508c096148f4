"""Runs of implicit methods, with equal steps or under a tolerance: their set-up, and the notes at their end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ArgumentError, ConvergenceError
from vofem.integrators.base import ProbeRows
from vofem.integrators.method import Method
from vofem.integrators.observer import Observer, Snapshot
from vofem.integrators.registry import advice
from vofem.integrators.stepped import SteppedSolution, step_count, storage_times
from vofem.integrators.stepping.checks import check_times
from vofem.integrators.stepping.doubling import StepDoubling
from vofem.integrators.stepping.energies import stored_energy
from vofem.integrators.stepping.march import Kernel, march, note_chatter
from vofem.integrators.stepping.nearby import check_nearby, note_growth
from vofem.integrators.stepping.record import Record, take_events
from vofem.integrators.stepping.step_loads import followed, note_loads
from vofem.laws.evaluate import may_jump
from vofem.system import CLOSED, Counters, State, System

Array = NDArray[np.float64]

#: Tolerance of the coarser run with which a run is compared, over that of the run.
_COARSER = 4.0

#: Difference between both, over the tolerance, above which a note reports it.
_APART = 5.0

#: Largest displacement, over the one that errors were related to, below which the latter was too large.
_OVERSIZED = 0.5

#: Steps of a rough run, and by default of a run of equal steps.
_STEPS = 1000


@dataclass(frozen=True)
class Doubled:
    """How a method makes its runs.

    Attributes
    ----------
    equal : callable
        Takes counters, a start, the size of steps in s and their number; returns a kernel of equal steps.
    doubling : callable
        Takes counters; returns a kernel whose steps follow a tolerance, without a plan.
    """

    equal: Callable[[Counters, State, float, int], Kernel]
    doubling: Callable[[Counters], StepDoubling]


@dataclass(frozen=True)
class Asked:
    """The arguments of a run; the fields are the arguments of `Method.run`."""

    system: System
    start: State
    t_end: float
    times: Array | None
    dt: float | None = None
    tol: float | None = None
    observer: Observer | None = None
    resume: Snapshot | None = None
    probes: ProbeRows | None = None
    nearby: bool | None = None


def implicit_run(method: Method, made: Doubled, asked: Asked, blow_up: float, advised: str = "") -> SteppedSolution:
    """Run a method that is stable at any step.

    Parameters
    ----------
    method : Method
    made : Doubled
    asked : Asked
    blow_up : float
        Energy that no load has supplied, over the largest energy, that ends a run.
    advised : str
        What the note on a step that was chosen says further.

    Raises
    ------
    ArgumentError
        If a step size and a tolerance were given.
    ConvergenceError
        If a nonlinear spring that softens leaves a step without a solution.
    InstabilityError
        If energy grows beyond what the loads can have done.
    """
    system, start, t_end = asked.system, asked.start, asked.t_end
    check_nearby(asked.nearby)
    counters, notes, step = Counters(), list[str](), asked.dt
    kernel: Kernel
    if asked.tol is None:
        if step is None:
            step, why = followed(system, t_end / _STEPS, t_end)
            notes.append(f"step: dt = {step:.6g} s was chosen{why or ', a thousandth of the run'}{advised}")
        steps = step_count(t_end, step)
        stored = storage_times(asked.times, t_end, step, steps, system.size, notes)
        kernel = made.equal(counters, start, step, steps)
    else:
        kernel = _doubling(made, asked, asked.tol, counters)
        stored = np.linspace(0.0, t_end, 1001) if asked.times is None else asked.times
    note_chatter(system, notes)
    note_loads(system, step, t_end, notes)
    out = kernel.record(stored, asked.probes, t_end)
    solution = march(
        kernel, method, start, kernel.state.status.copy(), t_end, t_end if step is None else step, out, notes,
        first_energy=stored_energy(system, start.q, start.v), blow_up=blow_up, observer=asked.observer,
        resume=asked.resume, probes=asked.probes,
    )  # fmt: skip
    if isinstance(kernel, StepDoubling):
        solution.dt = kernel.coarsest
        _note_tolerance(kernel, out, notes)
    elif step is not None:
        size, count = step, step_count(t_end, step)
        again = lambda beside: made.equal(Counters(), beside, size, count)  # noqa: E731
        notes += note_growth(asked.nearby, system, start, kernel, out, again)
    return solution


def _doubling(made: Doubled, asked: Asked, tol: float, counters: Counters) -> StepDoubling:
    """Return a run whose steps follow a tolerance, ready to begin."""
    if asked.dt is not None:
        raise ArgumentError("simulate: dt and tol were both given; tol chooses the steps, leave out dt")
    kernel = made.doubling(counters)
    kernel.plan(asked.t_end, tol)
    # A run that is resumed has this displacement already.
    if asked.resume is None:
        kernel.measure(_rough(made, asked, counters))
        _compare(made, kernel)
    else:
        kernel.measure(asked.start.q[:, None])
    return kernel


def _note_tolerance(kernel: StepDoubling, out: Record, notes: list[str]) -> None:
    """Add notes where the tolerance may not be kept."""
    tol = kernel.tolerance
    if kernel.forced:
        notes.append(
            f"tol: {kernel.forced} steps of the smallest size, {kernel.tick:.3g} s, exceeded their share of the "
            "tolerance and were taken all the same: a force jumps there"
        )
    if kernel.coarser.size:
        checks = check_times(kernel.t_end, None, kernel.bands.system.size)
        # The first column of each, as a time may occur twice.
        columns = np.searchsorted(out.times, checks)
        off = kernel.largest_of(np.nan_to_num(out.q[:, columns] - kernel.coarser))
        if off > _APART * tol * kernel.size:
            notes.append(
                f"tol: displacements may be wrong by {off:.2g} m, {off / (tol * kernel.size):.2g} times what tol = "
                f"{tol:g} allows: by so much the run differs from one whose tolerance is {_COARSER:g} times as large; "
                f"impacts magnify errors. Choose a smaller tol, or {advice(exact=True)} where it applies"
            )
    if kernel.farthest < _OVERSIZED * kernel.size:
        notes.append(
            f"tol: errors are held below tol = {tol:g} of {kernel.size:.3g} m, which a rough run of {_STEPS} steps "
            f"found, but nothing moves farther than {kernel.farthest:.3g} m; choose a tol smaller by their ratio"
        )


def _compare(made: Doubled, kernel: StepDoubling) -> None:
    """Run a scene with impacts at a coarser tolerance first, and keep its displacements for `_note_tolerance`.

    The errors of steps bound that of the run where it is smooth. What an impact does depends on velocities, and on
    fast motion that displacements do not show, so two runs are compared. The coarser one takes about half the steps.
    """
    if not may_jump(kernel.laws):
        return
    trial = made.doubling(Counters())
    trial.plan(kernel.t_end, _COARSER * kernel.tolerance, 0.5)
    trial.size = kernel.size
    hit = trial.status.size < trial.laws.table.size or bool(np.any(trial.status == CLOSED))
    found, events = _trial(trial, check_times(kernel.t_end, None, kernel.bands.system.size))
    if hit or events:
        # This run gives the largest displacement more accurately than the rough one.
        kernel.size = min(kernel.size, trial.largest_of(found))
        kernel.coarser = found


def _rough(made: Doubled, asked: Asked, counters: Counters) -> Array:
    """Return the displacements of a rough run of equal steps, of which the largest is used."""
    kernel = made.equal(counters, asked.start, asked.t_end / _STEPS, _STEPS)
    return _trial(kernel, np.linspace(0.0, asked.t_end, _STEPS + 1))[0]


def _trial(kernel: Kernel, times: Array) -> tuple[Array, bool]:
    """Run to the end; return the displacements at some times, and whether a law switched."""
    out = kernel.record(times, None)
    out.q[:] = 0.0
    hit = False
    try:
        while not kernel.finished:
            kernel.advance(out)
            hit = take_events(out).size > 0 or hit
    except ConvergenceError:
        # At large steps a stiff law may leave no solution in double precision. The displacements before that are used;
        # the run itself takes other steps, or raises the error.
        hit = True
    return out.q, hit
