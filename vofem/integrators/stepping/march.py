"""The loop around a compiled kernel: events, energy checks, interruption, and the solution."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vofem.errors import InstabilityError
from vofem.integrators.base import Energies, ProbeRows, Samples, SpringSamples
from vofem.integrators.method import Method
from vofem.integrators.observer import Observer, Snapshot, deferred_interrupts
from vofem.integrators.registry import advice
from vofem.integrators.rounding import static_loss
from vofem.integrators.stepped import SteppedSolution
from vofem.integrators.stepping.checks import check_times
from vofem.integrators.stepping.energies import contact_energy, stored_energy, strain_energy
from vofem.integrators.stepping.hysteresis import hysteretic_energy
from vofem.integrators.stepping.probes import MOST_STEPS, Recorded
from vofem.integrators.stepping.quality import Checked, quality_notes
from vofem.integrators.stepping.record import LastStep, Record, shortened, stored, take_events
from vofem.integrators.stepping.step_loads import StepLoads
from vofem.kernels.mode import compiled
from vofem.laws.callbacks import Callbacks
from vofem.laws.group import StepPast
from vofem.laws.rows import Rows, all_rows
from vofem.laws.table import Laws
from vofem.linalg.banded import band_order, band_width, solve, subtract_product
from vofem.system import Counters, Events, State, System

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Relative loss of static responses to rounding above which rounding is named as the cause of a blow-up.
_SPOILT = 1e-3

#: Entries of states that one call of a kernel advances: some tenths of a second of work.
_CHUNK_WORK = 1_000_000

#: The same in plain Python.
_PLAIN_WORK = 10_000


#: Factored matrices of a method that are kept with a system: those of all step sizes that `tol` tries, and some more.
MOST_FACTORED = 48

#: Number of laws from which on the order of the unknowns takes account of their rows.
_MANY = 16


def chunk(size: int) -> int:
    """Return the number of steps of `size` unknowns in one call of a kernel."""
    work = _CHUNK_WORK if compiled() else _PLAIN_WORK
    return int(np.clip(work // max(size, 1), 1, MOST_STEPS))


class Banded:
    """A system's unknowns in an order that keeps its band narrow, and its loads over steps."""

    def __init__(self, system: System, counters: Counters, *matrices: object) -> None:
        self.system, self.counters = system, counters
        self.order = _order(system, [matrix for matrix in matrices if matrix is not None])
        self.back = np.empty(system.size, dtype=np.int64)
        self.back[self.order] = np.arange(system.size)
        self.loads = np.array([load.vector[self.order] for load in system.loads]).reshape(-1, system.size)
        self.over = StepLoads(system, counters)

    def answers(self, factored: Array, band: Array) -> Array:
        """Return ``S A^-1 F`` of all load vectors F for a factored matrix A and a band S, shape (n_loads, n)."""
        result = np.zeros(self.loads.shape)
        for load, answer in zip(self.loads, result, strict=True):
            moved = load.copy()
            solve(factored, moved)
            subtract_product(band, moved, answer)
        return -result


def _order(system: System, matrices: list[Any]) -> IntArray:
    """Return an order that keeps matrices narrow and, where laws are many, their rows too, if both can be had."""
    order, rows = band_order(*matrices), all_rows(system.laws)
    if rows is None or rows.shape[0] < _MANY:
        return order
    pairs = abs(rows).T @ abs(rows)
    together = band_order(*matrices, pairs)
    return together if band_width(together, *matrices, pairs) <= 2 * band_width(order, *matrices) + 2 else order


def tally(bands: Banded, laws: Laws, callbacks: Callbacks | None, steps: int, evaluations: int) -> None:
    """Set the counters of steps, and of evaluations of laws and dampers."""
    system, counters = bands.system, bands.counters
    counters.steps = steps
    counters.gap_evaluations = (0 if system.contacts is None else len(system.contacts)) * evaluations
    counters.memory_updates = int(np.sum(laws.table["end"] > laws.table["start"])) * evaluations
    if callbacks is not None:
        counters.law_evaluations = callbacks.calls
    if system.damped:
        counters.damping_evaluations = evaluations


class Kernel(Protocol):
    """A method with its matrices and its state, unknowns in band order.

    Attributes
    ----------
    bands : Banded
    last_step : LastStep
    past : StepPast or None
        Internal variables of laws whose force over a step depends on earlier steps.
    place : tuple of str
        Names of the attributes that, beside `state` and `last_step`, make up the state of the run.
    """

    bands: Banded
    last_step: LastStep
    rows: Rows
    laws: Laws
    past: StepPast | None
    place: tuple[str, ...]

    @property
    def dt(self) -> float | None:
        """Size of all steps in s; None where they follow a tolerance."""

    @property
    def state(self) -> Any:
        """A named tuple of arrays, changed in place by `advance`."""

    @property
    def finished(self) -> bool:
        """Whether the run is done."""

    def record(self, times: Array, probes: ProbeRows | None, t_end: float | None = None) -> Record:
        """Return an empty record of the run at some times; see `setting.Setting`."""

    def advance(self, out: Record) -> None:
        """Take some steps, at least one, as long as the record has room for their events."""

    def reached(self) -> float:
        """Return the time of the state in `last_step`, s."""

    def kinetic(self, samples: Samples) -> Array:
        """Return the kinetic energy of the method's own balance at the stored times, J."""

    def uncounted(self) -> float:
        """Return a bound on the energy that loads have given until `last_step`, beyond the work counted there, J."""


def march(
    kernel: Kernel,
    method: Method,
    start: State,
    initial: IntArray,
    t_end: float,
    dt: float,
    out: Record,
    notes: list[str],
    *,
    first_energy: float,
    blow_up: float,
    observer: Observer | None,
    resume: Snapshot | None,
    probes: ProbeRows | None,
) -> SteppedSolution:
    """Run a kernel to its end, or until it is interrupted, and return the solution.

    Parameters
    ----------
    kernel : Kernel
    method : Method
    start : State
    initial : ndarray of int, shape (n_contacts,)
        Status of the contacts at t = 0.
    t_end, dt : float
        End of the run and size of a step, s.
    out : Record
    notes : list of str
    first_energy : float
        At t = 0, in the method's own form and without hysteretic springs, J.
    blow_up : float
        Energy that no load has supplied, over the largest energy, that ends a run.
    observer : callable, optional
    resume : dict, optional
        A snapshot of the same run, from which to go on.
    probes : ProbeRows, optional
        What the output's tap records.

    Raises
    ------
    InstabilityError
        If energy grows beyond what the loads can have done, or a state is no longer finite.
    """
    system, counters = kernel.bands.system, kernel.bands.counters
    in_springs = _spring_energies(kernel)[0]
    kernel.bands.over.until = t_end
    energy = stored_energy(system, start.q, start.v) + in_springs
    log: list[Array] = []
    wanted_end = t_end
    recorded, missing = Recorded(), (0.0, 0.0)
    if resume is not None:
        log, recorded = _restore(kernel, out, resume, notes)
        missing = tuple(resume["missing"])

    def snapshot() -> Snapshot:
        checked = {"missing": list(missing), "contact_checks": out.contact_checks}
        return _snapshot(kernel, out, log, recorded, notes) | checked

    with deferred_interrupts() as interrupted:
        while not kernel.finished:
            kernel.advance(out)
            recorded.drain(out.probes)
            if out.happened[0]:
                log.append(take_events(out))
            excess = _check(kernel, method, energy, dt, blow_up)
            if method.conserves and abs(excess) > abs(missing[0]):
                missing = excess, kernel.reached()
            stop = interrupted() and not kernel.finished
            if observer is not None:
                observer(kernel.reached(), snapshot, stop)
            if stop:
                done = shortened(out)
                if not np.any(done.wanted):
                    raise KeyboardInterrupt
                notes.append(
                    f"interrupted at t = {kernel.reached():g} s of {t_end:g} s: what was computed until then is here"
                )
                out, t_end = done, float(done.times[done.wanted][-1])
                break
    events = Events(initial=initial)
    if log:
        time, which, entered = np.concatenate(log).T
        events = Events(time.copy(), which.astype(np.int64), entered.astype(np.int64), initial)
    counters.events = events.time.size
    first_energy += in_springs
    checked = np.flatnonzero(np.isin(out.times, check_times(wanted_end, kernel.dt, system.size)))
    times, samples, parts, _ = _outcome(kernel, out, checked)
    found = Checked(times, samples, parts, out.contact_checks, missing)
    notes += quality_notes(system, method, found, events, first_energy, kernel.dt, wanted_end)
    points = None if probes is None else recorded.samples(probes.names, wanted_end * (1.0 + 1e-12))
    times, samples, parts, springs = _outcome(kernel, out, np.flatnonzero(out.wanted))
    return SteppedSolution(
        system, t_end, times, samples, parts, first_energy, dt, events, counters, notes, springs, points
    )  # fmt: skip


def _outcome(kernel: Kernel, out: Record, columns: IntArray) -> tuple[Array, Samples, Energies, SpringSamples | None]:
    """Return times, states, energies and hysteretic springs at some of the stored times."""
    system, back = kernel.bands.system, kernel.bands.back
    # Whole rows are copied far quicker than single numbers.
    place = back if columns.size == out.times.size else np.ix_(back, columns)
    samples = Samples(out.q[place], out.v[place], out.a[place])
    strain, dissipated, springs = strain_energy(system, samples.q), out.dissipated[columns], None
    if system.recorded:
        force, energy, loss = out.histories[:, :, columns]
        springs = SpringSamples(force, energy, loss, out.past[:, 0])
        strain = strain + springs.stored.sum(axis=0)
        dissipated = dissipated + springs.dissipated.sum(axis=0)
    contact = contact_energy(system.contacts, samples.q)
    parts = Energies(kernel.kinetic(samples), strain, contact, dissipated, out.work[columns])
    return out.times[columns], samples, parts, springs


def _spring_energies(kernel: Kernel) -> tuple[float, float]:
    """Return the energies in J that hysteretic springs store, and have dissipated, at the state in `last_step`.

    The work that springpots have absorbed counts as dissipated here.
    """
    last_step, absorbed = kernel.last_step, 0.0 if kernel.past is None else kernel.past.absorbed()
    if not kernel.laws.state.size:
        return 0.0, absorbed
    energy, loss = hysteretic_energy(kernel.laws, last_step.internal, kernel.rows, last_step.q)
    return float(energy), float(loss) + absorbed


def _snapshot(kernel: Kernel, out: Record, log: list[Array], recorded: Recorded, notes: list[str]) -> Snapshot:
    """Return the state of a run as plain data, from which the run can be resumed."""
    return {
        "state": kernel.state,
        "last_step": kernel.last_step,
        "place": {name: getattr(kernel, name) for name in kernel.place},
        "output": stored(out),
        "recorded": recorded.whole(),
        "log": np.concatenate(log) if log else np.empty((0, 3)),
        "counters": kernel.bands.counters,
        "notes": list(notes),
    }


def _restore(kernel: Kernel, out: Record, saved: Snapshot, notes: list[str]) -> tuple[list[Array], Recorded]:
    """Set a kernel and its record to a snapshot; return the events so far, and the points recorded at every step."""
    _fill(kernel.state, saved["state"])
    _fill(kernel.last_step, saved["last_step"])
    for name, value in saved["place"].items():
        setattr(kernel, name, value)
    cursor = int(saved["output"]["times"].size)
    for name, part in saved["output"].items():
        if name == "past":
            out.past[:] = part
        else:
            getattr(out, name)[..., :cursor] = part
    for name, value in vars(saved["counters"]).items():
        setattr(kernel.bands.counters, name, value)
    notes[:] = saved["notes"]
    out.contact_checks[:] = saved["contact_checks"]
    out.cursor[:] = cursor
    return [saved["log"]] if saved["log"].size else [], Recorded(saved["recorded"])


def _fill(target: Any, saved: Any) -> None:
    """Copy arrays into those of a nest of tuples."""
    for mine, other in zip(target, saved, strict=True):
        if isinstance(mine, tuple):
            _fill(mine, other)
        else:
            mine[...] = other


def note_chatter(system: System, notes: list[str]) -> None:
    """Add a note where contacts that should rest at their gap chatter from step to step."""
    if system.contacts is not None and bool(np.any(system.contacts.jump & (system.contacts.gap > 0))):
        notes.append(
            "chatter: under acts_on='displacement' a contact that should rest at its gap chatters with the amplitude "
            f"of a step; {advice(exact=True)} pins it"
        )


def _check(kernel: Kernel, method: Method, first: float, dt: float, blow_up: float) -> float:
    """Return the error in J of the balance of energy at the time reached; raise if it shows that the run blew up."""
    last_step, back = kernel.last_step, kernel.bands.back
    in_springs, loss = _spring_energies(kernel)
    now = stored_energy(kernel.bands.system, last_step.q[back], last_step.v[back]) + in_springs
    work, dissipated = float(last_step.work[1]), float(last_step.dissipated[1]) + loss
    scale = abs(first) + abs(work) + abs(dissipated) + kernel.uncounted()
    excess = now - first - work + dissipated
    if not excess <= blow_up * scale + 1e-300:
        loss = static_loss(kernel.bands.system)
        smaller = f"reduce dt = {dt:g} s" if kernel.dt is not None else "reduce tol"
        if loss > _SPOILT:
            cure = (
                f"rounding spoils {min(loss, 1.0):.0%} of static responses on this mesh: use fewer elements or a mesh "
                f"less graded, or choose {advice(exact=True)}"
            )
        elif method.conserves:
            cure = f"{smaller}, or choose {advice(exact=True)} where it applies"
        else:
            cure = f"{smaller}, or choose {advice(exact=True)}, or {advice(conserves=True)} where that does not apply"
        raise InstabilityError(
            f"{method.name} blew up before t = {kernel.reached():g} s: energy {now:.3g} J, from {first:.3g} J at the "
            f"start and {work:.3g} J of work; {cure}"
        )
    return excess
