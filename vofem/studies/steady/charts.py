"""Coordinates of orbits along a branch.

The coordinates are the state at t = 0 if all contacts switch fast. Where a contact switches slowly, near a grazing, the
flow from t = 0 depends on the state like a square root. In this case orbits are described by the phase of the slow
event, and by the state at this event, where the gap function is zero. The rate of the gap function is one of these
coordinates. The orbit is a smooth function of them down to rate zero, which is the grazing itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.flow import Flow, IgnoredEvents, Start
from vofem.integrators.event_driven.tangent import acceleration
from vofem.linalg.eigen import eigenvalues
from vofem.studies.steady.orbit import DECIDED, PeriodicOrbit
from vofem.studies.steady.problem import Evaluation
from vofem.studies.steady.shooting import Shooting, relative

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Status = NDArray[np.int64]


@dataclass(frozen=True)
class OriginChart:
    """The unknowns of the problem as coordinates. For shooting they are the state at t = 0 of the loads.

    Attributes
    ----------
    ignored : tuple of (contact, from, to)
        Phases ``omega t`` of the loads between which the events of a contact are ignored, for shooting only.
    """

    ignored: tuple[tuple[int, float, float], ...] = ()
    also: ClassVar[tuple[tuple[int, float], ...]] = ()

    def evaluate(self, problem: Any, y: Array, *, derivative: bool = True) -> Evaluation:
        """Return the equations."""
        more = {"ignored": self.ignored} if self.ignored else {}
        evaluation: Evaluation = problem.evaluate(y, derivative=derivative, **more)
        return evaluation

    def scales(self, problem: Any, evaluation: Any) -> Array:
        """Return sizes of the unknowns: those of the motion, separately for displacements and velocities."""
        if isinstance(problem, Shooting):
            n = problem.size // 2
            z, v = sizes(problem, evaluation.flow)
            return np.concatenate([np.full(n, z), np.full(n, v)])
        return np.asarray(problem.scales * max(evaluation.size, np.finfo(float).tiny))

    def unknowns(self, problem: Any, y: Array, evaluation: Any) -> Array:
        """Return the unknowns."""
        return y

    def orbit(self, problem: Any, y: Array, evaluation: Any) -> PeriodicOrbit:
        """Return the orbit."""
        orbit: PeriodicOrbit = problem.orbit(y, evaluation)
        return orbit


ORIGIN = OriginChart()


def sizes(problem: Shooting, flow: Flow) -> tuple[float, float]:
    """Return positive sizes of displacements and velocities along a flow."""
    z, v = flow.sizes
    v = max(v, problem.loads.omega * z)
    z = max(z, v / max(float(np.sqrt(np.max(problem.space.stiffness, initial=0.0))), problem.loads.omega))
    return (z, v) if v > 0.0 else (1.0, problem.loads.omega)


@dataclass(frozen=True)
class EventEvaluation:
    """The flow over one orbit from an event.

    Attributes
    ----------
    flow : Flow
    residual : ndarray, shape (2n,)
    jacobian : ndarray, shape (2n, 2n)
    starts : ndarray, shape (2n, 2n), optional
        States before the event at which the columns of `ends` begin; None for unit states.
    ends : ndarray, shape (2n, 2n)
        States at the end of the orbit.
    """

    flow: Flow
    residual: Array
    jacobian: Array
    starts: Array | None
    ends: Array

    @cached_property
    def error(self) -> float:
        """The difference of both ends over the size of the motion."""
        return relative(self.residual, self.flow.sizes)

    @cached_property
    def multipliers(self) -> Complex:
        """Eigenvalues of the monodromy matrix; infinite ones where a contact that acts on the displacement grazes."""
        from scipy.linalg import eigvals

        if self.starts is None and np.all(np.isfinite(self.ends)):
            return eigenvalues(self.ends)
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.asarray(eigvals(self.ends, self.starts), dtype=complex)
        return np.where(np.isfinite(found), found, np.inf)


@dataclass(frozen=True)
class EventChart:
    """The state at an event of one contact.

    Coordinates are the phase ``omega t`` of the event, and components of the state along `basis`, of which the first
    is along the rate of the gap function.

    Attributes
    ----------
    contact : int
    before, after : ndarray of int, shape (n_contacts,)
        Contact status on both sides of the event.
    row : ndarray, shape (n,)
        Row of the contact in the unknowns for which the chart was made.
    basis : ndarray, shape (2n, 2n - 1)
        Orthonormal basis of states without displacement along `row`.
    margin : float
        Share of the orbit before its end in which events of the contact are ignored.
    grazes : bool
        Whether the contact keeps its status `before` near the event, as if it did not exist. This describes the orbit
        at and just beyond a grazing, from the side where it does not touch.
    also : tuple of (contact, phase)
        Other contacts that graze in the same orbit, with the phases ``omega t`` at which they do. Near the grazing they
        touch as lightly as `contact`. If such a touch appears or disappears, this is not a separate grazing.
    """

    contact: int
    before: Status
    after: Status
    row: Array
    basis: Array
    margin: float
    grazes: bool = False
    also: tuple[tuple[int, float], ...] = ()

    def point(self, problem: Shooting, y: Array) -> tuple[float, Array]:
        """Return time and state, in unknowns, of coordinates."""
        state = self.basis @ y[1:]
        row, gap = surface(problem, self.contact)
        n = row.size
        state[:n] += self.row * ((gap - row @ state[:n]) / (row @ self.row))
        return float(y[0]) / problem.loads.omega, state

    def directions(self, problem: Shooting) -> Array:
        """Return the derivative of the state with respect to the coordinates except the phase, shape (2n, 2n - 1)."""
        row, _ = surface(problem, self.contact)
        n = row.size
        moved = self.basis.copy()
        moved[:n] -= np.outer(self.row, (row @ self.basis[:n]) / (row @ self.row))
        return moved

    def coordinates(self, problem: Shooting, time: float, state: Array) -> Array:
        """Return the coordinates, shape (2n,), of a time in s and a state in unknowns, put on the surface."""
        return np.concatenate([[problem.loads.omega * time], self.basis.T @ state])

    def rate(self, problem: Shooting, y: Array) -> float:
        """Return the rate of the gap function in m/s, positive if its direction is that of the event."""
        row, _ = surface(problem, self.contact)
        return float(row @ (self.basis[row.size :] @ y[1:])) * self.sign

    @property
    def switching(self) -> list[int]:
        """The contacts that switch in the event: `contact`, and others that switch at the same time."""
        others = np.flatnonzero(self.before != self.after).tolist()
        return [self.contact, *(j for j in others if j != self.contact)]

    @property
    def sign(self) -> float:
        """1 for a closing, -1 for an opening."""
        return 1.0 if self.after[self.contact] > self.before[self.contact] else -1.0

    def evaluate(self, problem: Shooting, y: Array, *, derivative: bool = True) -> EventEvaluation:
        """Return the flow over one orbit from the event."""
        time, state = self.point(problem, y)
        stop = time + problem.duration
        windows = [IgnoredEvents(j, stop - self.margin * problem.duration, stop) for j in self.switching]
        status = self.after
        if self.grazes:
            status = self.before
            windows.append(IgnoredEvents(self.contact, time, time + self.margin * problem.duration))
            for entry in around(self.also, self.margin, problem.periods):
                windows += problem.windows(*entry, time)
        z, v = problem.to_modes(state)
        start = Start(time, z, v, status, self.contact)
        moved = self.directions(problem)
        regular = self.grazes or not self._jumps(problem)
        begin = None
        if derivative:
            begin = self._switched(problem) if regular else self._along(problem, moved, time, z, v)
        one = problem.run(start, stop, derivative=begin, ignored=windows)
        residual = problem.to_unknowns(one.displacement, one.velocity) - state
        if begin is None:
            nothing = np.empty((0, 0))
            return EventEvaluation(one, residual, nothing, None, nothing)
        assert one.monodromy is not None
        ends = unknown(problem, one.monodromy)
        last = unknown(problem, self._rates(problem, self.before, stop, one.displacement, one.velocity)[:, None])
        if regular:
            first = unknown(problem, self._rates(problem, self.before, time, z, v)[:, None])
            whole = ends if problem.frame is None else ends @ modal(problem, np.eye(problem.size))
            turn, rest = last - whole @ first, whole @ moved - moved
            starts: Array | None = None
        else:
            whole, starts = ends, np.concatenate([moved, last], axis=1)
            turn, rest = last - ends[:, -1:], ends[:, :-1] - moved
        jacobian = np.concatenate([turn / problem.loads.omega, rest], axis=1)
        return EventEvaluation(one, residual, jacobian, starts, whole)

    def _jumps(self, problem: Shooting) -> bool:
        laws = problem.system.contacts
        assert laws is not None
        return bool(laws.jump[self.contact] and laws.gap[self.contact] > 0.0)

    def _switched(self, problem: Shooting) -> Array:
        """Return modal states after the event of unit states before it, of a force that does not jump."""
        n = problem.size // 2
        begin = np.eye(2 * n)
        laws = problem.system.contacts
        assert laws is not None
        for j in [] if self.grazes else self.switching:
            row, sign = problem.space.contacts[j], np.sign(self.after[j] - self.before[j])
            if laws.damping[j] > 0.0:
                begin[n:, :n] -= sign * laws.damping[j] * np.outer(row, row)
        return begin

    def _along(self, problem: Shooting, moved: Array, time: float, z: Array, v: Array) -> Array:
        """Return modal states after the event: those on the surface, which do not jump, and the rates.

        In this form nothing is divided by the rate of the gap function, so the event may be very slow.
        """
        rate = self._rates(problem, self.after, time, z, v)
        return np.concatenate([modal(problem, moved), rate[:, None]], axis=1)

    def _rates(self, problem: Shooting, status: Status, time: float, z: Array, v: Array) -> Array:
        """Return the rates of a modal state, shape (2n,)."""
        load = np.zeros(z.size)
        for vector, one in zip(problem.space.loads, problem.system.loads, strict=True):
            load += vector * float(one.function(time))
        return np.concatenate([v, acceleration(problem.space, problem.system.contacts, status, z, v, load)])

    def scales(self, problem: Shooting, evaluation: EventEvaluation) -> Array:
        """Return sizes of the coordinates: 1 rad of the phase, those of the motion."""
        z, v = sizes(problem, evaluation.flow)
        n = problem.size // 2
        share = np.sum(self.basis[:n] ** 2, axis=0)
        return np.concatenate([[1.0], np.where(share > 0.5, z, v)])

    def unknowns(self, problem: Shooting, y: Array, evaluation: EventEvaluation) -> Array:
        """Return the state at t = 0 of the loads."""
        return at_phase(problem, evaluation.flow, 0.0)

    def orbit(self, problem: Shooting, y: Array, evaluation: EventEvaluation) -> PeriodicOrbit:
        """Return the orbit."""
        return problem.orbit_of(self.unknowns(problem, y, evaluation), evaluation, lambda: DECIDED)


def around(touches: tuple[tuple[int, float], ...], margin: float, periods: int) -> tuple[tuple[int, float, float], ...]:
    """Return contacts and phases around their touches, between which their events are ignored."""
    width = 2.0 * np.pi * periods * margin
    return tuple((contact, phase - width, phase + width) for contact, phase in touches)


def surface(problem: Shooting, contact: int) -> tuple[Array, float]:
    """Return the row of a contact in the unknowns, shape (n,), and its gap in m."""
    laws = problem.system.contacts
    assert laws is not None
    row = problem.space.contacts[contact]
    return (row if problem.frame is None else row @ problem.frame), float(laws.gap[contact])


def modal(problem: Shooting, columns: Array) -> Array:
    """Return states in unknowns, shape (2n, k), in modes."""
    if problem.frame is None:
        return columns
    n = problem.size // 2
    return np.concatenate([problem.frame @ columns[:n], problem.frame @ columns[n:]])


def unknown(problem: Shooting, columns: Array) -> Array:
    """Return modal states, shape (2n, k), in unknowns."""
    if problem.frame is None:
        return columns
    n = problem.size // 2
    return np.concatenate([np.linalg.solve(problem.frame, part) for part in (columns[:n], columns[n:])])


def at_phase(problem: Shooting, flow: Flow, time: float) -> Array:
    """Return the state in unknowns at a time of the orbit, shape (2n,)."""
    start, duration = flow.start.time, problem.duration
    if time == start or (time == 0.0 and start == 0.0):
        return problem.to_unknowns(flow.start.displacement, flow.start.velocity)
    inside = time + np.ceil((start - time) / duration) * duration
    z, v = flow.solution.modal(np.array([min(max(inside, start), flow.stop)]))
    return problem.to_unknowns(z[:, 0], v[:, 0])


def event_chart(
    problem: Shooting, contact: int, before: Status, after: Status, margin: float, *, grazes: bool = False
) -> EventChart:
    """Return the coordinates at an event of a contact."""
    row, _ = surface(problem, contact)
    n = row.size
    unit = row / np.linalg.norm(row)
    # The complement of the row in displacements; all velocities, that along the row first.
    rest = np.linalg.svd(unit[None, :])[2][1:].T
    basis = np.zeros((2 * n, 2 * n - 1))
    basis[n:, 0] = unit
    basis[n:, 1:n] = rest
    basis[:n, n:] = rest
    return EventChart(contact, before.copy(), after.copy(), row.copy(), basis, margin, grazes)
