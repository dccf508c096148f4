"""Runs of the generalized-alpha method whose steps follow a tolerance, see `stepping.doubling`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.generalized_alpha.setting import Alpha
from vofem.integrators.methods import GENERALIZED_ALPHA
from vofem.integrators.stepping.doubling import Attempt, Path, StepDoubling, impact
from vofem.integrators.stepping.record import Record
from vofem.integrators.stepping.step_loads import of_halves
from vofem.integrators.stepping.step_size import HALVINGS
from vofem.linalg.banded import solve, subtract_product

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

Array = NDArray[np.float64]


class AdaptiveSteps(StepDoubling, Alpha):
    """A run of steps chosen by their error.

    The acceleration of the method is that at ``(alpha_f - alpha_m) dt`` before the end of a step, so it is moved where
    the size of steps changes (M. Arnold, O. Brüls, Multibody Syst. Dyn. 18 (2007) 185-202,
    https://doi.org/10.1007/s11044-007-9084-0).
    """

    place = (*StepDoubling.place, "last", "gain")
    lag = 0
    method = GENERALIZED_ALPHA

    def plan(self, t_end: float, tolerance: float, fineness: float = 1.0) -> None:
        """Set the end in s, the tolerance, and how finely impacts are resolved, over what is done by default."""
        super().plan(t_end, tolerance, fineness)
        #: Size of the last step in s, 0 before the first one, and what the acceleration gained in it.
        self.last, self.gain = 0.0, np.zeros(self.state.q.size)
        self.aside = self.record(np.zeros(0), None)
        self.begin(self.length(self.level + 1))

    @property
    def displacement(self) -> Array:
        """Displacements where the run stands."""
        return self.state.q

    def _parts(self, out: Record) -> tuple[NDArray[Any], ...]:
        """Return all arrays that a step changes, but those of states that are stored."""
        past = () if self.past is None else tuple(self.past.state)
        probes = () if out.probes is None else (out.probes.filled,)
        return *self.state, *self.last_step, *past, *probes, out.contact_checks, out.past, out.cursor, out.happened

    def _one_step(self, dt: float, number: int, out: Record) -> int:
        """Take the step of a number and a size; return contact solves, or -1 where there is no solution."""
        am, af, before = self.parameters.alpha_m, self.parameters.alpha_f, self.state.a.copy()
        if self.last > 0.0:
            self.state.a[:] += (af - am) * (1.0 - dt / self.last) * self.gain
            before[:] = self.state.a
        springpots = self.over(dt, np.array([(number + 0.5) * dt]))
        _, solves, failed = self.steps_of(dt, number, 1, springpots, out)
        self.last, self.gain = dt, self.state.a - before
        return -1 if failed else solves

    def attempt(self, out: Record) -> Attempt:
        """Take the next step whole, and again in halves, which stay."""
        half = self.length(self.level + 1)
        number = self.ticks // 2 ** (HALVINGS - self.level)
        if self.ticks == 0:
            self.begin(half)
        self.before = [part.copy() for part in self._parts(out)], self.last, self.gain
        if self.ticks == 0:
            self.store_start(out, half)
        begun = [part.copy() for part in self._parts(out)]
        self.aside.happened[0] = 0
        solves, (q, v) = self._one_step(2.0 * half, number, self.aside), self.state[:2]
        whole = q.copy(), v.copy()
        _put(self._parts(out), begun)
        self.last, self.gain = self.before[1:]
        path = [(q.copy(), v.copy(), self.state.reaction.copy())]
        for k in range(2):
            more = self._one_step(half, 2 * number + k, out)
            if more < 0 or solves < 0:
                return Attempt(-1)
            solves += more
            path.append((q.copy(), v.copy(), self.state.reaction.copy()))
        acts, unresolved = self._impact(half, path)
        error = (whole[0] - q) / 3.0
        rough = float(np.max(self.weight * np.abs(error), initial=0.0))
        if acts:
            # Where a stop is stiff, steps of any size end at it: their displacements agree, their velocities do not.
            rough = max(rough, float(np.max(self.weight * np.abs(whole[1] - v))) * 2.0 * half / 3.0)
        smooth = float(np.max(self.weight * np.abs(self._smooth(error)), initial=0.0))
        return Attempt(solves, rough, smooth, unresolved, self._between(half))

    def _between(self, half: float) -> float:
        """Return the part of the loads in the motion between the ends of both halves, over the tolerance."""
        parts = self.bands.over.parts(self.time, self.time + 2.0 * half)
        if not parts.shape[1]:
            return 0.0
        return self.between_ends(of_halves(parts)[1], half**2 * self.response(half))

    def _smooth(self, error: Array) -> Array:
        """Return ``((1 - am) A^-1 M)^2`` of an error, A of steps eight times as long: what the step resolves well."""
        factored = self.size_of(self.length(max(self.level - 3, 0))).structure.factored
        for _ in range(2):
            moved = np.zeros(error.size)
            subtract_product(self.matrices.mass, error, moved)
            solve(factored, moved)
            error = -(1.0 - self.parameters.alpha_m) * moved
        return error

    def _impact(self, dt: float, path: list[tuple[Array, Array, Array]]) -> tuple[bool, float]:
        """Return what `stepping.doubling.impact` finds along two halves of a step."""
        if self.every_row is None:
            return False, 0.0
        u, rates = (np.array([self._along @ part[k] for part in path]) for k in (0, 1))
        reactions = np.array([part[2] for part in path[1:]])
        found: tuple[bool, float] = impact(self.laws, self.status.size, dt, Path(u, rates, reactions), self.fineness)
        return found

    @cached_property
    def _along(self) -> csr_matrix:
        """Rows of the laws in band order."""
        assert self.every_row is not None
        return self.every_row[:, self.bands.order]

    def take(self, out: Record) -> None:
        """Keep the halves, which are taken already."""

    def withdraw(self, out: Record) -> None:
        """Return to where the step began."""
        parts, self.last, self.gain = self.before
        _put(self._parts(out), parts)


def _put(target: Sequence[NDArray[Any]], saved: Sequence[NDArray[Any]]) -> None:
    """Copy arrays into others."""
    for mine, other in zip(target, saved, strict=True):
        mine[...] = other
