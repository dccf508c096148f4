"""The orbit near a guess by shooting: Newton's method in the lengths of segments, checked by an ordinary run.

The signature is that of a run from the guess. Newton's method keeps it, and so it passes grazings without a kink. Where
the run of its solution shows another signature, or where it fails, the state alone takes a step that lowers the change
over an orbit, and the next run decides the signature anew.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from vofem.arrays import Array
from vofem.errors import ConvergenceError
from vofem.integrators.event_driven.flow import Flow
from vofem.studies.steady.newton import Solved, converged, direction, lowered
from vofem.studies.steady.orbit import PeriodicOrbit
from vofem.studies.steady.segments.shooting import Shooting, relative
from vofem.studies.steady.segments.signature import Signature, SignatureEvaluation, States, signature_of
from vofem.studies.steady.segments.sticking import names_of, places_of
from vofem.system import PINNED

#: Steps of the state, halvings of one of them, and steps in the lengths of segments.
_STEPS, _HALVINGS, _POLISHED = 40, 7, 10

#: In how many parts sliders that stick all along are moved at most.
_PARTS = 12

#: Change over an orbit, over the size of the motion, up to which Newton's method in lengths is tried.
_TRIED = 0.5

#: Share of the longest segment that must lie on both sides of an anchor.
_ANCHORED = 0.15


def signature_at(problem: Shooting, unknowns: Array) -> tuple[Signature, Array]:
    """Return signature and coordinates of the orbit from a state at t = 0, anchored away from all switches."""
    whole = problem.run(unknowns)
    chart, y = signature_of(problem, whole)
    lengths = chart.lengths(y)
    longest = chart.longest(lengths)
    moves = PINNED not in chart.start or PINNED in chart.statuses[longest]
    if moves and min(lengths[0], lengths[-1]) >= _ANCHORED * lengths[longest]:
        return chart, y
    # A guess that is far from an orbit does not go on after its end as at its begin.
    time = float(chart.anchor + lengths[:longest].sum() + 0.5 * lengths[longest]) / problem.loads.omega
    z, v = (part[:, 0] for part in whole.solution.modal(np.array([time])))
    status = list(chart.statuses[longest])
    return signature_of(problem, problem.run(problem.to_unknowns(z, v), time * problem.loads.omega, status))


def orbit_near(problem: Shooting, guess: Array | None, steps: int = _STEPS, *, orbit: Any = None) -> Solved:
    """Return the orbit near the unknowns of a guess; None for those of `orbit`.

    `orbit`: the guess where it is an orbit. If its segments are known, no run has to find them.
    Raises `ConvergenceError` if none is found. The message gives the least change over an orbit.
    """

    def run() -> tuple[Signature, Array]:
        return signature_at(problem, problem.from_orbit(orbit) if guess is None else guess)

    known, none = _segments(problem, orbit), ""
    now, change = _evaluated(problem, *(known or run()))
    for _ in range(steps):
        if np.isfinite(change):
            found = polished(now) if change <= _TRIED else None
            if found is not None:
                if found.repeats:
                    return Solved(found.chart.unknowns(problem, found.y, found), found)
                none = f"what was found does not repeat under an ordinary run, by {found.closing:.1e} of the motion"
                # Another signature is nearer to an orbit if it changes less.
                if found.closing < 0.5 * change:
                    now, change = _evaluated(problem, *signature_of(problem, found.chart.flow(problem, found.y)))
                    continue
        if known is not None:
            # The segments of the guess do not lead to an orbit; a run decides them anew.
            known, (now, change) = None, _evaluated(problem, *run())
            continue
        moved = _moved(now, change) if np.isfinite(change) else None
        if moved is None:
            break
        now, change = _evaluated(problem, *signature_of(problem, moved))
    raise ConvergenceError(none or f"Newton's method left a residual of {change:.2e} of the motion")


def in_the_middle(problem: Shooting, found: Solved) -> Solved:
    """Return the orbit near another one in which sliders that stick all along rest in the middle of where they may.

    They are moved there in parts, in equilibrium, since contacts may switch in other ways meanwhile.
    Raises `ConvergenceError` if there is none.
    """
    part, n = 1.0, problem.space.size
    problem.centred = True
    for _ in range(_PARTS):
        chart, y = found.evaluation.chart, found.evaluation.y
        places = places_of(problem, chart.statuses)
        if places is None:
            break
        there = chart.evaluate(problem, y)
        near = polished(there)
        if near is not None and near.repeats:
            return Solved(near.chart.unknowns(problem, near.y, near), near)
        kept = problem.course.stuck(chart.statuses[0])
        assert kept is not None
        off = places.moves[:n] @ (places.rows @ problem.modal(there.residual[: problem.size]))
        z, v = problem.to_modes(found.unknowns)
        problem.centred = False
        try:
            found = orbit_near(problem, problem.to_unknowns(z - part * (kept.carry @ off), v))
        except ConvergenceError:
            part *= 0.5
        problem.centred = True
    else:
        assert places is not None
        raise ConvergenceError(
            f"{problem.what}: {names_of(problem, places)} sticks all along where the branch begins, and no orbit was "
            "found in which it rests in the middle of where it may. Begin where it slides, or give a guess= nearer to "
            "the middle"
        )
    return found


def _segments(problem: Shooting, orbit: Any) -> tuple[Signature, Array, Array] | None:
    """Return signature, coordinates and Jacobian matrix of an orbit of a scene with the same modes and contacts."""
    known = orbit.source.motion() if isinstance(orbit, PeriodicOrbit) and orbit.method == "shooting" else None
    if not isinstance(known, SignatureEvaluation):
        return None
    own, n = known.problem, known.problem.size
    same = own.space.shapes is problem.space.shapes and own.periods == problem.periods
    if not same or len(known.chart.start) != problem.space.contacts.shape[0]:
        return None
    return known.chart, np.concatenate([problem.unmodal(own.modal(known.y[:n])), known.y[n:]]), known.jacobian


def _evaluated(
    problem: Shooting, chart: Signature, y: Array, known: Array | None = None
) -> tuple[SignatureEvaluation, float]:
    """Return the equations along the segments of a run, and its change over an orbit over the size of the motion.

    `known`: the Jacobian matrix of a neighbour, good enough for a first step.
    """
    now = chart.evaluate(problem, y, derivative=known is None or not known.size)
    if known is not None and known.size:
        now = replace(now, jacobian=known)
    return now, relative(now.residual[: problem.size], now.sizes)


def polished(now: SignatureEvaluation) -> SignatureEvaluation | None:
    """Return the solution near an evaluation with the same signature, or None."""
    near: States | None = None

    def step(_: Array, known: SignatureEvaluation) -> Array:
        nonlocal near
        move = direction(known.jacobian, -known.residual)
        near = known.after(move)
        return move

    def evaluate(y: Array) -> SignatureEvaluation:
        return now.chart.evaluate(now.problem, y, near=near)

    try:
        found = converged(evaluate, now.y, _POLISHED, step, now.chart.scales(now.problem, now), known=now)
    except ConvergenceError:
        return None
    evaluation: SignatureEvaluation = found.evaluation.stripped()
    return evaluation


class _Ran(NamedTuple):
    """A run over an orbit, and its change over the size of the motion."""

    flow: Flow
    error: float


def _moved(now: SignatureEvaluation, change: float) -> Flow | None:
    """Return a flow that changes less over an orbit, after a Newton step of the state or part of it."""
    problem, n = now.problem, now.problem.size

    def ran(state: Array) -> _Ran:
        flow = problem.run(state, now.chart.anchor)
        after = problem.to_unknowns(flow.displacement, flow.velocity)
        return _Ran(flow, relative(after - state, now.sizes))

    step = direction(now.jacobian, -now.residual)[:n]
    found, _ = lowered(ran, now.y[:n], step, replace(now, error=change), _HALVINGS)
    return None if found is None else found[1].flow
