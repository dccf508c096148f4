"""The numbers of a method that steps in time, and what loads do in its steps."""

from __future__ import annotations

from typing import NamedTuple

from vofem.arrays import Array
from vofem.integrators.stepping.kernel import Numbers, Size
from vofem.laws.law import Way


class Scheme(NamedTuple):
    """The numbers that make the steps of `kernel` those of a method."""

    alpha_m: float
    alpha_f: float
    gamma: float
    beta: float
    mean: bool = False  #: Whether laws act by their mean forces over a step, and not by those at its end.

    @property
    def explicit(self) -> bool:
        """Whether the displacement at the end of a step does not depend on forces there."""
        return self.beta == 0.0

    @property
    def part(self) -> float:
        """Return after which part of a step it is balanced."""
        return 0.5 if self.mean else 1.0 - self.alpha_f

    @property
    def lags(self) -> bool:
        """Whether the accelerations of the method belong to times before the ends of steps."""
        return not self.mean and self.alpha_m != self.alpha_f

    def numbers(self, dt: float) -> Numbers:
        """Return the numbers of a step size in s."""
        am, af, gamma, beta, mean = self
        # An explicit step knows the coordinates of the laws, and solves for their rates.
        share, explicit, ahead = am / (1.0 - am), self.explicit, 0.0 if mean else 0.5 - af
        cqw, cvw, part = beta / (1.0 - am), gamma / (1.0 - am), 1.0 if mean else 1.0 - af
        way = Way(mean, explicit, (1.0 + ahead) / part, ahead / part, dt)
        per_y = dt * cvw if explicit else dt * dt * cqw
        return Numbers(
            1.0 - af, 0.5 - beta - beta * share, cqw, 1.0 - gamma - gamma * share, cvw, am,
            af - am if self.lags else 0.0, way, per_y, part
        )  # fmt: skip


class Forcing(NamedTuple):
    """Loads over some steps: combinations of the vectors in `Loaded`."""

    #: `values`, `means`: of the loads and of what they move within steps: in the balance of a step, and over it. Shape
    #: (steps, 2 n_loads).
    values: Array
    means: Array
    first: Array  #: First moments over the steps, used where laws act by means, shape (steps, n_loads).

    def part(self, first: int, last: int) -> Forcing:
        """Return the loads of the steps from one number up to another."""
        return Forcing(*(values[first:last] for values in self))


class Loaded(NamedTuple):
    """What loads do in steps of one size: a step's matrix and its answers to load vectors F."""

    size: Size
    loads: Array  #: F and ``K A^-1 F``, shape (2 n_loads, n).
    #: ``dt A^-1 F`` and M times it, shape (n_loads, n).
    shift: Array
    inertia: Array
