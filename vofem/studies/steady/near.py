"""The orbit near a guess by shooting: Newton's method in the lengths of segments, checked by an ordinary run.

The signature is that of a run from the guess. Newton's method keeps it, and so it passes grazings without a kink. Where
the run of its solution shows another signature, or where it fails, the state alone takes a step that lowers the change
over an orbit, and the next run decides the signature anew.
"""

from __future__ import annotations

import numpy as np

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.integrators.event_driven.flow import Flow, Start
from vofem.studies.steady.newton import ROUNDING, Solved, direction
from vofem.studies.steady.shooting import Shooting, relative
from vofem.studies.steady.signature import Signature, SignatureEvaluation, signature_of

#: Steps of the state, halvings of one of them, and steps in the lengths of segments.
_STEPS, _HALVINGS, _POLISHED = 40, 8, 10

#: Change over an orbit, over the size of the motion, up to which Newton's method in lengths is tried.
_TRIED = 0.5

#: Share of the longest segment that must lie on both sides of an anchor.
_ANCHORED = 0.15


def signature_at(problem: Shooting, unknowns: Array) -> tuple[Signature, Array, Flow]:
    """Return signature, coordinates and flow of the orbit from a state at t = 0, anchored away from all switches."""
    z, v = problem.to_modes(unknowns)
    whole = problem.run(Start(0.0, z, v), problem.duration)
    times = np.array([0.0, *(event.time for event in whole.events), problem.duration])
    lengths = np.diff(times)
    longest = int(np.argmax(lengths))
    if min(lengths[0], lengths[-1]) >= _ANCHORED * lengths[longest]:
        return *signature_of(problem, whole), whole
    anchor = float(0.5 * (times[longest] + times[longest + 1]))
    z, v = (part[:, 0] for part in whole.solution.modal(np.array([anchor])))
    segments = whole.solution.segments
    status = segments.status[max(int(np.searchsorted(segments.starts, anchor, side="right")) - 1, 0)]
    moved = problem.run(Start(anchor, z, v, status.copy()), anchor + problem.duration)
    return *signature_of(problem, moved), moved


def orbit_near(problem: Shooting, guess: Array, steps: int = _STEPS) -> Solved:
    """Return the orbit near the unknowns of a guess.

    Raises `ConvergenceError` if none is found. The message gives the least change over an orbit.
    """
    chart, y, flow = signature_at(problem, guess)
    change = _change(problem, flow)
    for _ in range(steps):
        if not np.isfinite(change):
            break
        now = chart.evaluate(problem, y)
        found = _polished(now) if change <= _TRIED else None
        if found is not None:
            found, ran = found.stripped(), chart.flow(problem, found.y)
            if found.repeats(ran):
                return Solved(chart.unknowns(problem, found.y, found), found)
            # Another signature is nearer to an orbit if it changes less.
            if _change(problem, ran) < 0.5 * change:
                (chart, y), change = signature_of(problem, ran), _change(problem, ran)
                continue
        moved = _moved(now, change)
        if moved is None:
            break
        flow, change = moved
        chart, y = signature_of(problem, flow)
    raise ConvergenceError(f"Newton's method left a residual of {change:.2e} of the motion")


def _change(problem: Shooting, flow: Flow) -> float:
    """Return the change of the state over an orbit, over the size of the motion."""
    ends = problem.to_unknowns(flow.displacement, flow.velocity)
    return relative(ends - problem.to_unknowns(flow.start.displacement, flow.start.velocity), flow.sizes)


def _polished(now: SignatureEvaluation) -> SignatureEvaluation | None:
    """Return the solution near an evaluation with the same signature, or None."""
    problem, chart, before = now.problem, now.chart, None
    for _ in range(_POLISHED):
        if before is not None and not now.error <= before.error:
            break
        if now.error <= problem.tolerance:
            return now
        before = now
        try:
            now = chart.evaluate(problem, now.y - direction(now.jacobian, now.residual))
        except ConvergenceError:
            break
    best = now if before is None or now.error < before.error else before
    return best if best.error <= ROUNDING else None


def _moved(now: SignatureEvaluation, change: float) -> tuple[Flow, float] | None:
    """Return a flow that changes less over an orbit and its change, after a Newton step of the state or part of it."""
    problem, n, time = now.problem, now.problem.size, now.chart.anchor / now.problem.loads.omega
    step = direction(now.jacobian, now.residual)[:n]
    factor = 1.0
    for _ in range(_HALVINGS):
        z, v = problem.to_modes(now.y[:n] - factor * step)
        try:
            flow = problem.run(Start(time, z, v), time + problem.duration)
            after = _change(problem, flow)
            if after <= (1.0 - 0.1 * factor) * change:
                return flow, after
        except ConvergenceError:
            pass
        factor *= 0.5
    return None
