"""What runs of the generalized-alpha method have in common, whatever their step sizes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.generalized_alpha.parameters import Parameters
from vofem.integrators.generalized_alpha.step import Size, State, advance, scratch
from vofem.integrators.stepping.balance import Structure, structure
from vofem.integrators.stepping.checks import check_contacts
from vofem.integrators.stepping.hysteresis import record_hysteresis
from vofem.integrators.stepping.march import MOST_FACTORED
from vofem.integrators.stepping.record import Motion, Record, store
from vofem.integrators.stepping.setting import Setting
from vofem.laws.evaluate import closed_share, force_at
from vofem.laws.table import Laws
from vofem.linalg.banded import factor, solve, subtract_product, widen
from vofem.system import Counters, System
from vofem.system import State as Start

Array = NDArray[np.float64]


class Alpha(Setting):
    """The state of a run, how it begins, and the matrices of its step sizes."""

    def __init__(self, system: System, start: Start, counters: Counters, t_end: float, chosen: Parameters) -> None:
        super().__init__(system, start, counters, t_end)
        self.parameters = chosen
        order, u = self.bands.order, self.u
        rate = np.zeros(0) if self.every_row is None else np.asarray(self.every_row @ start.v)
        reaction = np.array([force_at(self.laws, j, x) for j, x in enumerate(u.tolist())])
        self.state = State(
            start.q[order].copy(), start.v[order].copy(), np.zeros(system.size), reaction,
            start_dampers(self.laws, u, rate), self.status, self.laws.state,
        )  # fmt: skip
        self.sizes: dict[float, Size] = {}
        self.responses: dict[float, Array] = {}
        self.space = scratch(system.size, self.laws)

    def size_of(self, dt: float) -> Size:
        """Return what belongs to a step size in s."""
        if dt not in self.sizes:
            made = self.bands.system.cache.get(
                "generalized-alpha matrix", (dt, self.parameters), lambda: self._factor(dt), MOST_FACTORED
            )
            # The matrix of a step tends to (1 - am) M as dt does to 0.
            second = (1.0 - self.parameters.alpha_m) * self.bands.answers(made.factored, self.matrices.stiffness)
            loads = np.concatenate([self.bands.loads, second])
            self.sizes[dt] = Size(dt, self.parameters, made, loads)
        return self.sizes[dt]

    def response(self, dt: float) -> Array:
        """Return the accelerations by unit loads that act for a step of a size or less, shape (n_loads, n)."""
        if dt not in self.responses:
            unit = np.ones((1, self.bands.system.size))
            answers = self.bands.answers(self.size_of(dt).structure.factored, unit)
            self.responses[dt] = (1.0 - self.parameters.alpha_m) * answers
        return self.responses[dt]

    def _factor(self, dt: float) -> Structure:
        """Return the structure of a step."""
        (am, af, gamma, beta), (mass, stiffness, c) = self.parameters, self.matrices
        width = max(part.shape[0] for part in self.matrices) - 1
        a = (1.0 - am) * widen(mass, width) + (1.0 - af) * beta * dt**2 * widen(stiffness, width)
        if c.size:
            a += (1.0 - af) * gamma * dt * widen(c, width)
        self.bands.counters.factorizations += 1
        # Coordinates at the end answer to reactions there, or to dampers' forces over the step, weighted 1 - af.
        return structure(a, "the matrix of a step", self.rows, self.laws, beta * dt**2, 1.0 - af)

    def begin(self, dt: float) -> None:
        """Find the acceleration at t = 0, and what loads that are short against a step of a size do there."""
        system, start, order = self.bands.system, self.start, self.bands.order
        self.at_start, beyond = self.bands.over.start(dt)
        # An impulse at t = 0 becomes an initial velocity; by steps it would act late.
        self.kick = 0.5 * dt * (beyond @ self.response(dt))
        force = (self.at_start @ self.bands.loads)[self.bands.back] - system.stiffness @ start.q
        if self.damping is not None:
            force -= self.damping @ start.v
        if self.every_row is not None:
            held = self.state.reaction + self.state.damper
            if self.past is not None:
                held[self.past.row : self.past.row + self.past.count] += self.past.forces()
            force -= self.every_row.T @ held
        self.state.a[:] = force[order]
        solve(factor(self.matrices.mass, "the mass matrix"), self.state.a)
        self.begin_at_start(self.state.a)

    def store_start(self, out: Record, dt: float) -> None:
        """Store the state at t = 0. Then give the structure the impulse of loads there."""
        state = self.state
        check_contacts(out.contact_checks, self.rows, dt, state.q, state.v)
        store(out, 0.0, dt, True, self.last_step, Motion(state.q, state.v, state.a), state.a)
        record_hysteresis(self.laws, self.laws.kinds.hysteretic, self.last_step.internal, self.rows, out)
        if self.past is not None:
            self.past.record(out.times, out.histories, int(out.cursor[0]))
        if np.any(self.kick):
            gain = np.zeros(self.kick.size)
            subtract_product(self.matrices.mass, self.kick, gain)
            # The work of the impulse is what the kinetic energy gains.
            self.last_step.work[:] -= float(gain @ (state.v + 0.5 * self.kick))
            state.v[:] += self.kick

    def steps_of(self, dt: float, first: int, count: int, springpots: Any, out: Record) -> tuple[int, int, bool]:
        """Take steps of a size; return their number, that of contact solves, and whether the next has no solution."""
        values = self.nodal_loads(first, count + 1, dt)
        if first == 0:
            values[: self.at_start.size, 0] = self.at_start
        found: tuple[int, int, bool] = advance(
            self.size_of(dt), self.equations, values, first, self.state, self.last_step, out, self.space, springpots
        )
        return found


def start_dampers(laws: Laws, u: Array, rate: Array) -> Array:
    """Return the contact dampers' forces at t = 0: of a path of a millionth of the rate's own length scale."""
    forces = np.zeros(u.size)
    for j in np.flatnonzero(laws.table["damping"] > 0.0):
        ahead = u[j] + 1e-6 * abs(laws.table[j]["gap"] - u[j]) + 1e-9
        forces[j] = laws.table[j]["damping"] * rate[j] * closed_share(laws, int(j), u[j], ahead) / (ahead - u[j])
    return forces
