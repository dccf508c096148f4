"""Runs of the generalized-alpha method at one step size."""

from __future__ import annotations

from vofem.errors import ConvergenceError
from vofem.integrators.generalized_alpha.setting import Alpha
from vofem.integrators.methods import GENERALIZED_ALPHA
from vofem.integrators.stepping.record import Record
from vofem.integrators.stepping.setting import EqualSteps


class FixedSteps(EqualSteps, Alpha):
    """A run of equal steps."""

    lag = 0

    def plan(self, dt: float, steps: int) -> None:
        """Set the step size in s and the number of steps."""
        super().plan(dt, steps)
        self.begin(dt)

    def advance(self, out: Record) -> None:
        """Take some steps."""
        first, count, springpots = self.next_chunk()
        if first == 0:
            self.store_start(out, self.dt)
        taken, solves, failed = self.steps_of(self.dt, first, count, springpots, out)
        self.complain(self.dt)
        if failed:
            raise ConvergenceError(
                f"{GENERALIZED_ALPHA.name} found no solution of the step from t = {(first + taken) * self.dt:g} s at "
                f"dt = {self.dt:g} s; a nonlinear spring that softens may leave none, or the state has blown up: "
                "reduce dt"
            )
        self.done += taken
        self.count(self.done, self.done, solves)
