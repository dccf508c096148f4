"""Derivatives of periodic orbits, and of where they change in kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from vofem.arrays import Array, Complex
from vofem.blas import one_thread
from vofem.errors import ArgumentError, MethodError
from vofem.integrators.event_driven.tangent import switch_factors
from vofem.scene import Scene
from vofem.sensitivities.modal import ModalChange
from vofem.sensitivities.of_runs import MotionSensitivities, without_state
from vofem.sensitivities.of_statics import OfParameters
from vofem.sensitivities.parameter import Parameter, parameters_of
from vofem.sensitivities.system_change import system_changes, unchanged
from vofem.studies.steady import PeriodicOrbit, SpecialPoint
from vofem.system import CLOSED, OPEN, PINNED
from vofem.time_functions import Sine, as_time_function

#: Relative distance of multipliers that count as one, and have no derivatives of their own.
_SAME = 1e-7

#: Residual of periodicity over its derivative by a parameter, from which on orbits that are many end with it.
_ENDS = 1e-6

#: Distance of an extreme from an event, over the period, up to which it is at the event, and of a time just after it.
_AT_EVENT, _AFTER = 1e-9, 1e-14


class OrbitSensitivities(MotionSensitivities):
    """Derivatives of a periodic orbit by parameters; the last axis is the parameter.

    The orbit stays periodic while a parameter changes: its state at t = 0 of the loads moves along, and so does its
    period, if the frequency of the loads is a parameter.

    Attributes
    ----------
    orbit : PeriodicOrbit
    parameters : tuple of Parameter
    period : ndarray, shape (p,)
        Of the period, s.
    work : Work
    """

    def __init__(self, orbit: PeriodicOrbit, parameters: Any) -> None:
        scene, result = orbit.scene, orbit.result
        chosen = parameters_of("sensitivities", parameters, scene)
        if orbit.method != "shooting":
            raise MethodError(
                f"sensitivities: the orbit was found by {orbit.method}, which approximates it; find it by "
                "vofem.periodic(..., method='shooting')"
            )
        if orbit.autonomous:
            raise ArgumentError("sensitivities: no load determines the period of this orbit; add a load")
        if result.solution.truncation is not None:
            raise MethodError(
                "sensitivities: the orbit was found in a few vectors; use fewer elements, so that it is found in all "
                "modes"
            )
        self.orbit = orbit
        sliders = scene.model.system.sliders
        if sliders is not None:
            raise MethodError(sliders.refusal("sensitivities"))
        changes = without_state(system_changes(scene, chosen), chosen, "an orbit does not depend on an initial state")
        super().__init__(scene, result, chosen, changes)
        n = self._modal.size
        self.period = np.array([-orbit.period * self._faster(parameter) for parameter in self.parameters])
        p = len(self.parameters)
        # Of the residual of periodicity by parameters, the period moving along, and by the start.
        self._by_parameters = self._forward.final[:, :p] + np.outer(self._last_rate(), self.period)
        self.monodromy = self._forward.final[:, p:]
        self._start = self._of_start(np.eye(2 * n) - self.monodromy)

    def _of_start(self, change: Array) -> Array:
        """Return the derivatives of the start, shape (2n, p), from the change of the state over a period, (2n, 2n).

        Where a motion is free, such as that of a mass which nothing holds, orbits differ by it and are one of a family.
        The derivative is then that of the orbit which stays where it is in the family.
        """
        start, _, rank, _ = np.linalg.lstsq(change, self._by_parameters)
        if rank == change.shape[0]:
            return np.asarray(np.linalg.solve(change, self._by_parameters), dtype=float)
        off = np.linalg.norm(change @ start - self._by_parameters, axis=0)
        size = np.linalg.norm(self._by_parameters, axis=0)
        bad = np.flatnonzero(off > _ENDS * size)
        if bad.size:
            raise ArgumentError(
                f"Parameter {self.parameters[int(bad[0])].name}: a motion that nothing holds makes this orbit one of "
                "many, which end with the parameter, so that the orbit has no derivative; hold the motion by a spring"
            )
        return np.asarray(start, dtype=float)

    def _columns(self) -> list[ModalChange]:
        modal, same = self._modal, unchanged(self._scene)
        n, columns = modal.size, super()._columns()
        for k in range(2 * n):
            unit = np.zeros((2, n))
            unit[k // n, k % n] = 1.0 / modal.scale[k] if k < n else 1.0
            columns.append(ModalChange(None, None, None, None, None, unit[0], unit[1], same))
        return columns

    def _faster(self, parameter: Parameter) -> float:
        """Return the derivative of the logarithm of the frequency of the loads by a parameter."""
        if not parameter.field.endswith("omega"):
            return 0.0
        value = parameter.value(self._scene)
        waves = [_frequencies(scene) for scene in (self._scene, parameter.changed(self._scene, value))]
        growth = np.unique((waves[1] - waves[0]) / waves[0]) if waves[0].size else np.zeros(1)
        if np.ptp(growth) > 1e-12:
            raise ArgumentError(
                f"Parameter {parameter.name}: with it the loads no longer have a common period; link all of their "
                "frequencies by a list of objects"
            )
        return float(growth[0]) / value

    def _last_rate(self) -> Array:
        """Return the rate of the scaled state at the end of the orbit, shape (2n,)."""
        forward = self._forward
        _, v, a = forward.motion(np.array([forward.solution.t_end]))
        return np.concatenate([self._modal.scale * v[:, 0], a[:, 0]])

    def _total(self, found: Array) -> Array:
        """Return derivatives by parameters from those at a fixed start, whose last axis holds the start as well."""
        p = len(self.parameters)
        return found[..., :p] + found[..., p:] @ self._start

    # -- motion -----------------------------------------------------------------------------------

    @one_thread
    def extremes(self, point: Any) -> Array:
        """Return the derivatives of the least and of the largest displacement of a point, shape (2, p)."""
        result, period = self.orbit.result, self.orbit.period
        events = result.solution.events.time
        turns = self._turns(lambda s: np.asarray(result.velocity(point, s)))
        places = np.concatenate([turns, events, [0.0]])
        u = result.displacement(point, places)
        found = []
        for place in (int(np.argmin(u)), int(np.argmax(u))):
            t, moved = float(places[place]), np.zeros(())
            event = int(np.argmin(np.abs(events - t))) if events.size else -1
            if event >= 0 and abs(events[event] - t) <= _AT_EVENT * period:
                # An extreme at an impact moves with it.
                t = min(float(events[event]) + _AFTER * period, period)
                moved = result.velocity(point, [t])[0] * self.event_times[event]
            found.append(self.displacement(point, [t])[0] + moved)
        return np.array(found)

    def amplitude(self, point: Any) -> Array:
        """Return the derivatives of half the difference of the largest and the least displacement, shape (p,)."""
        least, largest = self.extremes(point)
        return np.asarray(0.5 * (largest - least))

    @property
    def event_times(self) -> Array:
        """Of the times of all contact events of the orbit, in their order, s, shape (n_events, p)."""
        return self._total(self._forward.event_times)

    # -- stability --------------------------------------------------------------------------------

    @cached_property
    @one_thread
    def multipliers(self) -> Complex:
        """Of the Floquet multipliers, in the order of `PeriodicOrbit.multipliers`, shape (m, p); NaN for equal ones.

        A contact that stays pinned makes two multipliers zero, whose derivatives are zero.

        Raises
        ------
        MethodError
            If a contact is pinned for a part of the orbit only.
        """
        changes = self._monodromy_changes()
        values, right = np.linalg.eig(self.monodromy)
        left = np.linalg.inv(right)
        moved = np.stack([np.einsum("ij,jk,ki->i", left, change, right) for change in changes], axis=1)
        known = self.orbit.multipliers
        assert known is not None
        order = [int(np.argmin(np.abs(values - value))) for value in known]
        size = float(np.max(np.abs(values), initial=0.0))
        for k in range(values.size):
            if np.any(np.abs(np.delete(values, k) - values[k]) <= _SAME * size):
                moved[k] = np.nan
        # A pinned contact forgets its displacement and its rate.
        lost = 2 * int(np.count_nonzero(self._forward.segments.status[0] == PINNED))
        moved[np.argsort(np.abs(values))[:lost]] = 0.0
        return np.asarray(moved[order])

    def _monodromy_changes(self) -> list[Array]:
        """Return the derivatives of the monodromy matrix along the orbits, each (2n, 2n): the product rule."""
        forward, p = self._forward, len(self.parameters)
        times, pinned = self._total(forward.event_times), forward.segments.status == PINNED
        if forward.solution.bounces is not None:
            raise MethodError(
                "sensitivities: impacts on rigid stops have no second derivatives here, which multipliers need; take "
                "differences of PeriodicOrbit.multipliers"
            )
        if np.any(pinned != pinned[0]):
            raise MethodError(
                "sensitivities: a contact is pinned for a part of this orbit only; impacts that accumulate have no "
                "second derivatives, which multipliers need; take differences of PeriodicOrbit.multipliers"
            )
        product, changes = self._tangent()
        began = np.zeros(p)
        last = forward.starts.size - 1
        for index in range(forward.starts.size):
            matrix = forward.flow(forward.segments.status[index]).equation.matrix
            whole, parts = forward.closed(index).transitions()
            meeting = forward.meetings.get(index)
            ended = self.period if index == last else np.zeros(p)
            if meeting is not None:
                ended = times[meeting.passage.numbers[0]]
            for k in range(p):
                own = parts.get(k, 0.0) + (matrix @ whole) * (ended[k] - began[k])
                changes[k] = own @ product + whole @ changes[k]
            product = whole @ product
            if meeting is None:
                began = np.zeros(p)
                continue
            jump, jumps = self._jumps(index, times)
            for k in range(p):
                changes[k] = jumps[k] @ product + jump @ changes[k]
            product = jump @ product
            began = ended
        return changes

    def _tangent(self) -> tuple[Array, list[Array]]:
        """Return the projection onto states that keep pinned contacts at their gaps, and its derivatives (2n, 2n)."""
        forward, scale, n = self._forward, self._modal.scale, self._modal.size
        equation = forward.flow(forward.segments.status[0]).equation

        def of_states(part: Array | None) -> Array:
            found = np.zeros((2 * n, 2 * n))
            if part is not None:
                found[:n, :n], found[n:, n:] = scale[:, None] * part / scale, part
            return found

        if equation.project is None:
            return np.eye(2 * n), [of_states(None) for _ in self.parameters]
        # Only the rows of contacts turn the space of these states; masses do not.
        moved = [replace(change, mass=None) for change in forward.changes[: len(self.parameters)]]
        return of_states(equation.project), [of_states(equation.inverse_change(change)) for change in moved]

    def _jumps(self, index: int, times: Array) -> tuple[Array, list[Array]]:
        """Return the saltation matrix after a segment and its derivatives, each (2n, 2n)."""
        forward, modal = self._forward, self._modal
        laws, n, p = modal.laws, modal.size, len(self.parameters)
        assert laws is not None
        meeting = forward.meetings[index]
        velocity = meeting.state[n:]
        ends = self._total(meeting.ends)
        equation = forward.flow(meeting.passage.before).equation
        tau = float(forward.segments.durations[index])
        acceleration = equation.matrix[n:] @ meeting.state + forward.forces(index)[1].at(tau)
        whole, parts = np.eye(2 * n), [np.zeros((2 * n, 2 * n)) for _ in range(p)]
        for number in meeting.passage.numbers:
            j = int(forward.events.contact[number])
            sign = 1.0 if meeting.passage.before[j] == OPEN and forward.events.status[number] == CLOSED else -1.0
            row = modal.contacts[j]
            rate = float(row @ velocity)
            lever = laws.stiffness[j] * (laws.gap[j] - laws.offset[j])
            gain = float(switch_factors(laws, j, False, rate))
            push = row if equation.project is None else equation.project @ row
            whole[n:, :n] -= sign * gain * np.outer(push, row / modal.scale)
            for k in range(p):
                change = forward.changes[k]
                gain_p = change.change.contact_damping[j]
                moved = np.zeros(n) if change.contacts is None else change.contacts[j]
                if laws.jump[j]:
                    lever_p = (
                        change.change.contact_stiffness[j] * laws.gap[j] + laws.stiffness[j] * change.change.gap[j]
                    )
                    rate_p = float(row @ (ends[n:, k] + acceleration * times[number, k]) + moved @ velocity)
                    gain_p += lever_p / rate - lever * rate_p / rate**2
                push_p = moved if equation.project is None else equation.project @ moved
                if (inverse := equation.inverse_change(change)) is not None:
                    push_p = push_p + inverse @ row
                part = gain_p * np.outer(push, row) + gain * (np.outer(push_p, row) + np.outer(push, moved))
                parts[k][n:, :n] -= sign * part / modal.scale
        return whole, parts

    # -- special points ---------------------------------------------------------------------------

    def residuals(self) -> tuple[Array, Array]:
        """Return the left null vector of ``monodromy - 1`` (2n,), and the residual's derivatives (2n, p)."""
        u, _, _ = np.linalg.svd(self.monodromy - np.eye(self.monodromy.shape[0]))
        return u[:, -1], self._by_parameters

    def _turns(self, rates: Callable[[Array], Array]) -> Array:
        """Return the times at which a rate is zero between samples of the orbit, s."""
        result = self.orbit.result
        events = result.solution.events.time
        times = np.unique(np.concatenate([result.times, events]))
        # At impacts rates jump: what moves between two samples ends with the rate before.
        ends = np.where(np.isin(times, events), np.maximum(times - _AFTER * self.orbit.period, 0.0), times)[1:]
        first, last = rates(times[:-1]), rates(ends)
        turns = np.flatnonzero((first != 0.0) & (first * last <= 0.0) & (times[:-1] < ends))

        def rate(s: float) -> float:
            return float(rates(np.array([s]))[0])

        return np.array([_root(rate, float(times[k]), float(ends[k])) for k in turns])

    def nearest_extreme(self, contact: str) -> Array:
        """Return the derivatives of that local extreme of a gap function that is nearest to zero, shape (p,).

        A contact that is closed is grazed at a minimum.
        """
        laws = self._modal.laws
        assert laws is not None
        j = laws.names.index(contact)
        row = self._modal.contacts[j]

        def gap(s: float) -> float:
            return float(row @ self._forward.motion(np.array([s]))[0][:, 0] - laws.gap[j])

        turns = self._turns(lambda s: row @ self._forward.motion(s)[1])
        t = min(turns.tolist(), key=lambda s: abs(gap(s)))
        state = np.concatenate([row, np.zeros_like(row)])[None]
        moved = self._total(self._forward.sample(state, np.array([t]))[0])[0]
        displacement = self._forward.motion(np.array([t]))[0][:, 0]
        return np.asarray(moved + self._forward.gap_changes(j, displacement)[: len(self.parameters)])


class SpecialSensitivities(OfParameters):
    """How a special point of a branch moves with parameters.

    Attributes
    ----------
    special : SpecialPoint
    parameters : tuple of Parameter
    value : ndarray, shape (p,)
        Derivatives of `SpecialPoint.value`, the parameter of the branch.
    """

    def __init__(self, special: SpecialPoint, parameters: Any, along: Parameter | None) -> None:
        scene = special.orbit.scene
        super().__init__(scene, parameters_of("sensitivities", parameters, scene))
        self.special = special
        factor, own = _of_branch(special, scene) if along is None else (1.0, along)
        orbit = OrbitSensitivities.__new__(OrbitSensitivities)
        try:
            with np.errstate(all="ignore"):
                orbit.__init__(special.orbit, [*self.parameters, own])  # type: ignore[misc]
        except np.linalg.LinAlgError:
            orbit._start = np.full_like(orbit._by_parameters, np.nan)
        if special.kind == "fold":
            left, residual = orbit.residuals()
            slopes = left @ residual
        elif special.kind in ("period_doubling", "neimark_sacker"):
            known = special.orbit.multipliers
            assert known is not None
            which = int(
                np.argmin(np.abs(known + 1.0) if special.kind == "period_doubling" else np.abs(np.abs(known) - 1.0))
            )
            slopes = (known[which].conjugate() * orbit.multipliers[which]).real
        elif special.kind == "grazing":
            slopes = orbit.nearest_extreme(special.contact)
        else:
            raise ArgumentError(
                f"sensitivities: a {special.kind} does not persist when a parameter changes, so it has no derivative"
            )
        self.value = -slopes[:-1] / slopes[-1] / factor


def _of_branch(special: SpecialPoint, scene: Scene) -> tuple[float, Parameter]:
    """Return the parameter of a branch where it is the frequency of the loads, and rad/s over its unit."""
    for factor in (1.0, 2.0 * np.pi):
        if abs(factor * special.value - special.orbit.omega) <= 1e-9 * special.orbit.omega:
            loads = [one for one in scene.effects if isinstance(getattr(one, "f", None), Sine)]
            if loads and all(one.f.omega == loads[0].f.omega for one in loads):  # type: ignore[attr-defined]
                return factor, Parameter(loads, "f.omega")
    raise ArgumentError(
        "sensitivities: the parameter of the branch is not the frequency of its loads; name it by "
        "along=vofem.Parameter(...)"
    )


def _frequencies(scene: Scene) -> Array:
    """Return the frequencies of all loads of a scene in rad/s."""
    functions = [as_time_function(load.function) for load in scene.model.system.loads]
    return np.array([w for function in functions for w, _ in function.piece(0.0).harmonics])


def _root(rate: Callable[[float], float], low: float, high: float) -> float:
    from scipy.optimize import brentq

    if rate(low) * rate(high) > 0.0:
        return low if abs(rate(low)) < abs(rate(high)) else high
    return float(brentq(rate, low, high, xtol=1e-16 * high, rtol=1e-15))
