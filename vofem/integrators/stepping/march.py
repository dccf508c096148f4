"""A run in time steps from its start to its end: checks on the way, and the solution."""

from __future__ import annotations

import numpy as np

from vofem.arrays import Array, IntArray
from vofem.integrators.base import Energies, ProbeRows, Samples, SpringSamples
from vofem.integrators.observer import Observer, Snapshot, advanced, interruption
from vofem.integrators.stepped import SteppedSolution
from vofem.integrators.stepping.energies import contact_energy, stored_energy, strain_energy
from vofem.integrators.stepping.quality import Checked, quality_notes
from vofem.integrators.stepping.record import Record
from vofem.integrators.stepping.run import Run
from vofem.system import Events


def march(
    run: Run, out: Record, notes: list[str], dt: float, *, first_energy: float, blow_up: float,
    observer: Observer | None, resume: Snapshot | None, probes: ProbeRows | None,
) -> SteppedSolution:  # fmt: skip
    """Run to the end, or until interrupted, and return the solution.

    `dt`: size of a step, s.
    `first_energy`: at t = 0, in the method's own form and without hysteretic springs, J.
    `blow_up`: energy that no load has supplied, over the largest energy, that ends a run.
    `resume`: a snapshot of the same run, from which to go on.
    `probes`: points that are recorded at every step.
    Raises `InstabilityError` if energy grows beyond what the loads can have done, or a state is no longer finite.
    """
    system, counters, start, t_end = run.system, run.counters, run.start, run.t_end
    in_springs = run.in_springs(out)[0]
    energy = stored_energy(system, start.q, start.v) + in_springs
    log, missing, wanted_end = list[Array](), (0.0, 0.0), t_end
    if resume is not None:
        run.restore(resume["run"])
        out.restore(resume["record"])
        vars(counters).update(vars(resume["counters"]))
        notes[:], log, missing = resume["notes"], [resume["log"]], tuple(resume["missing"])

    def snapshot() -> Snapshot:
        return {
            "run": run.saved(), "record": out.saved(), "counters": counters, "notes": list(notes),
            "log": np.concatenate([np.empty((0, 3)), *log]), "missing": list(missing),
        }  # fmt: skip

    def advance() -> None:
        nonlocal missing
        run.advance(out)
        log.extend(run.switches.log)
        run.switches.log = []
        excess = _check(run, out, energy, dt, blow_up)
        if run.method.conserves and abs(excess) > abs(missing[0]):
            missing = excess, run.reached()

    if not advanced(advance, lambda: run.finished, run.reached, snapshot, observer):
        kept = np.flatnonzero(out.wanted[: out.cursor])
        if not kept.size:
            raise KeyboardInterrupt
        notes.append(interruption(run.reached(), t_end))
        t_end = float(out.times[kept[-1]])
    whole = np.concatenate([np.empty((0, 3)), *log])
    of_contacts = whole[:, 1] >= 0.0
    time, which, entered = whole[of_contacts].T
    events = Events(time.copy(), which.astype(np.int64), entered.astype(np.int64), run.initial)
    counters.events = events.time.size
    first_energy += in_springs
    done = np.arange(out.cursor)
    times, samples, parts, _ = _outcome(run, out, done[out.checked[done]])
    found = Checked(times, samples, parts, out.contact_checks, missing)
    notes += quality_notes(system, run.method, found, events, first_energy, run.dt, wanted_end)
    points = None if probes is None else out.probe_samples(wanted_end * (1.0 + 1e-12))
    times, samples, parts, springs = _outcome(run, out, done[out.wanted[done]])
    return SteppedSolution(
        system, t_end, times, samples, parts, first_energy, dt, events, counters, notes, springs, points,
        None if run.sliders is None else run.sliders.history(t_end), whole[~of_contacts, 0],
    )  # fmt: skip


def _outcome(run: Run, out: Record, rows: IntArray) -> tuple[Array, Samples, Energies, SpringSamples | None]:
    """Return times, states, energies and hysteretic springs at some of the stored times."""
    system = run.system
    samples = Samples(*(np.ascontiguousarray(part[rows].T[run.back]) for part in (out.q, out.v, out.a)))
    strain, dissipated, springs = strain_energy(system, samples.q, out.times[rows]), out.dissipated[rows], None
    if system.recorded:
        force, energy, loss = out.histories[:, :, rows]
        springs = SpringSamples(force, energy, loss, out.past)
        strain = strain + springs.stored.sum(axis=0)
        dissipated = dissipated + springs.dissipated.sum(axis=0)
    if run.sliders is not None:
        strain = strain + run.sliders.history(0.0).stored(out.times[rows])
    contact = contact_energy(system.contacts, samples.q, out.times[rows])
    return (
        out.times[rows],
        samples,
        Energies(run.kinetic(samples), strain, contact, dissipated, out.work[rows]),
        springs,
    )


def _check(run: Run, out: Record, first: float, dt: float, blow_up: float) -> float:
    """Return the error in J of the balance of energy at the time reached; raise if it shows that the run blew up."""
    (in_springs, loss), chunk = run.in_springs(out), run.path.chunk
    now = stored_energy(run.system, chunk.q[0][run.back], chunk.v[0][run.back], run.reached()) + in_springs
    work, dissipated = float(out.total[0]), float(out.total[1]) + loss
    scale = abs(first) + out.most + abs(loss) + run.uncounted()
    excess = now - first - work + dissipated
    if not excess <= blow_up * scale + 1e-300:
        raise run.blown_up(f"{now:.3g} J, from {first:.3g} J at the start and {work:.3g} J of work", dt)
    return excess
