"""Objectives: one number of a run, for `vofem.gradient`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import array, name_of, whole
from vofem.arrays import Array
from vofem.bodies.base import as_point
from vofem.errors import ArgumentError
from vofem.lookup import rows_over
from vofem.result import Result
from vofem.sensitivities.adjoint import Linear
from vofem.sensitivities.contacts import Law, edges_of, integral_of, peak_of, within
from vofem.sensitivities.energy import gauss, no_rigid_stops, powers, takes_energy
from vofem.sensitivities.flow import Closed
from vofem.sensitivities.forward import Forward


class Objective:
    """One number of a run, and how it depends on the motion.

    Attributes
    ----------
    describe : str
    """

    def __init__(self, describe: str, linear: Callable[[Result, Forward], Linear]) -> None:
        self.describe = describe
        self._linear = linear

    def __repr__(self) -> str:
        return f"<objective: {self.describe}>"

    def linear(self, result: Result, forward: Forward) -> Linear:
        """Return value and derivative along a run."""
        return self._linear(result, forward)


def peak_force(contact: Any, impact: int = 1) -> Objective:
    """Return the force of largest magnitude in an impact, N; impacts count from 1."""
    name, number = name_of(contact), whole("peak_force: impact", impact)

    def linear(result: Result, forward: Forward) -> Linear:
        no_rigid_stops("peak_force", forward)
        j, found = _impact(result, name, number)
        out = _blank(forward)
        out.value = float(found.peak_force[number - 1])
        time, begin, end = (float(values[number - 1]) for values in (found.peak_time, found.closing, found.opening))
        peak = peak_of(forward, j, time, begin, end)
        out.add(peak.index, peak.tau, peak.law.row)
        out.explicit += peak.law.explicit(peak.state, peak.tau)
        if peak.event is not None:
            out.events[peak.event] += peak.slope
        return out

    return Objective(f"peak force of impact {number} of {name!r}", linear)


def impulse(contact: Any, impact: int = 1) -> Objective:
    """Return the integral of the force over an impact, N s; impacts count from 1."""
    name, number = name_of(contact), whole("impulse: impact", impact)

    def linear(result: Result, forward: Forward) -> Linear:
        no_rigid_stops("impulse", forward)
        j, found = _impact(result, name, number)
        out = _blank(forward)
        out.value = float(found.impulse[number - 1])
        for index in within(forward, j, float(found.closing[number - 1]), float(found.opening[number - 1])):
            law = Law(forward, index, j)
            _add_integral(out, forward, index, law)
            for event, force in edges_of(forward, index, j, law):
                out.events[event] += force
        return out

    return Objective(f"impulse of impact {number} of {name!r}", linear)


def dissipated() -> Objective:
    """Return the energy that dampers take until the end of the run, J."""

    def linear(result: Result, forward: Forward) -> Linear:
        no_rigid_stops("dissipated", forward)
        modal, out = forward.modal, _blank(forward)
        n = modal.size
        for index in range(forward.starts.size if takes_energy(forward) else 0):
            piece = forward.closed(index)
            equation = forward.flow(forward.segments.status[index]).equation
            matrices = [-forward.lower(equation, change)[:, n:] for change in forward.changes]
            tau, weight = gauss(0.0, float(forward.segments.durations[index]), piece, equation.matrix)
            v = piece.states(tau)[n:]
            pull = equation.damping @ v
            out.value += float(weight @ np.sum(v * pull, axis=0))
            for k, (t, share) in enumerate(zip(tau.tolist(), weight.tolist(), strict=True)):
                out.add(index, t, 2.0 * share * np.concatenate([np.zeros(n), pull[:, k]]))
            for k, matrix in enumerate(matrices):
                if np.any(matrix):
                    out.explicit[k] += float(weight @ np.sum(v * (matrix @ v), axis=0))
        for meeting in forward.meetings.values():
            for number, power in powers(forward, meeting):
                out.events[number] += power
        return out

    return Objective("dissipated energy", linear)


def sum_of_squares(point: Any, times: ArrayLike, data: ArrayLike) -> Objective:
    """Return the sum of the squared differences of a point's displacement and data at some times, m^2."""
    place = as_point("sum_of_squares: point", point)
    when = np.atleast_1d(array("sum_of_squares: times", times))
    values = array("sum_of_squares: data", data, shape=when.shape)

    def squares(u: Array) -> tuple[float, Array]:
        return float(np.sum((u[0] - values) ** 2)), 2.0 * (u - values)

    return of_motion([place], when, squares)


def of_motion(points: Any, times: ArrayLike, function: Callable[[Array], tuple[float, Any]]) -> Objective:
    """Return an objective of one's own: a function of the displacements of points at some times.

    Parameters
    ----------
    points : point or list of points
    times : array_like, shape (n_times,)
    function : callable
        Takes the displacements, shape (n_points, n_times), and returns the objective and its derivatives by all of
        them, in the same shape.
    """
    several = points if isinstance(points, (list, tuple)) else [points]
    places = [as_point("of_motion: points", point) for point in several]
    when = np.atleast_1d(array("of_motion: times", times))

    def linear(result: Result, forward: Forward) -> Linear:
        if np.any(when < 0.0) or np.any(when > result.solution.t_end):
            raise ArgumentError(f"gradient: times lie outside of the run, expected 0 to {result.solution.t_end:g} s")
        modal = forward.modal
        rows = np.asarray(rows_over(result.model, result.scene.bodies, places) @ modal.shapes)
        motion = forward.motion(when)[0]
        try:
            value, slopes = function(rows @ motion)
        except (TypeError, ValueError, ArithmeticError, LookupError) as error:
            raise ArgumentError(
                f"of_motion: function failed ({type(error).__name__}: {error}); expected a function of displacements, "
                f"shape {(rows.shape[0], when.size)}, that returns a number and its derivatives by all of them"
            ) from error
        slopes = array("of_motion: derivatives", slopes, shape=(rows.shape[0], when.size))
        out = _blank(forward)
        out.value = float(value)
        scaled = np.hstack([rows / modal.scale, np.zeros_like(rows)])
        for index, mine, tau in forward.visit(when):
            for k, t in zip(mine.tolist(), tau.tolist(), strict=True):
                out.add(index, t, slopes[:, k] @ scaled)
        for k, change in enumerate(forward.changes):
            if (moved := change.change.points(places)) is not None:
                out.explicit[k] += float(np.sum(slopes * (np.asarray(moved @ modal.shapes) @ motion)))
        return out

    return Objective(f"function of {len(places)} points at {when.size} times", linear)


def _impact(result: Result, name: str, number: int) -> tuple[int, Any]:
    found = result.contacts[name].impacts
    if number > len(found):
        raise ArgumentError(f"gradient: impact {number} of {name!r} was asked for; the run has {len(found)}")
    return list(result.contacts).index(name), found


def _add_integral(out: Linear, forward: Forward, index: int, law: Law) -> None:
    """Add the integral of a contact's force over a segment: of ``u' = A u + f`` it is one of u at both ends."""
    piece, flow = forward.closed(index), forward.flow(forward.segments.status[index])
    matrix, duration = flow.equation.matrix, float(forward.segments.durations[index])
    found = piece.integrals() if isinstance(piece, Closed) else None
    if found is None:
        tau, weight = gauss(0.0, duration, piece, matrix)
        out.explicit += weight @ law.explicit(piece.states(tau), tau)
        for t, share in zip(tau.tolist(), weight.tolist(), strict=True):
            out.add(index, t, share * law.row)
        return
    state, left = found[0], np.asarray(np.linalg.solve(matrix.T, law.row), dtype=float)
    out.add(index, duration, left)
    out.add(index, 0.0, -left)
    out.explicit += law.rows @ state + law.constants * duration
    for k, (change, force) in enumerate(zip(flow.matrices, forward.force_changes(index), strict=True)):
        if change is not None:
            out.explicit[k] -= left @ (change @ state)
        if force is not None:
            out.explicit[k] -= left[forward.modal.size :] @ integral_of(force, duration)


def _blank(forward: Forward) -> Linear:
    return Linear(np.zeros(forward.events.time.size), np.zeros(len(forward.changes)))
