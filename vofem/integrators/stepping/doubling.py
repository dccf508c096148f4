"""Steps that follow a tolerance, for any implicit method.

Every step is taken once as a whole and once as two halves. The difference of
the two results estimates the error, that of a closing or opening within the
step included. Where a contact acts, velocities are compared too, and the step
must resolve the impact. Displacements alone are not enough there: against a very
stiff stop every step ends at the stop, whatever its size.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError
from vofem.integrators.method import Method
from vofem.integrators.stepping.record import Record
from vofem.integrators.stepping.setting import Setting
from vofem.integrators.stepping.step_size import HALVINGS, StepSizeControl
from vofem.kernels.jit import jit
from vofem.laws.evaluate import force_and_tangent, tangent_jumps
from vofem.laws.table import Laws

Array = NDArray[np.float64]

#: Number of steps of one call of `advance`.
_CHUNK = 256

#: Change of velocity in one half of a step, over that of the impact, up to which a step resolves a contact.
_RESOLVED = 0.25

#: Tangent of a law over that of the rest of its step, up to which a step resolves a jump of it: the same measure.
_SOFT = 0.5 * _RESOLVED**2

#: An unresolved change of velocity is accepted if it moves the contact by at most this many tolerances until t_end.
_HARMLESS = 0.1


class Attempt(NamedTuple):
    """Result of a step that was taken as a whole and in halves.

    Attributes
    ----------
    solves : int
        Contact solves; negative where a step has no solution.
    rough, smooth : float
        Error of displacements in m, and that of motion which the step resolves well.
    unresolved : float
        Largest change of a law's velocity that the step does not resolve, m/s.
    between : float
        Error of the motion between the ends of the step over the tolerance.
    """

    solves: int
    rough: float = 0.0
    smooth: float = 0.0
    unresolved: float = 0.0
    between: float = 0.0


class StepDoubling(StepSizeControl, Setting):
    """A run of steps chosen by their error; a method adds `attempt`, `take` and `withdraw`.

    Attributes
    ----------
    lag : int
        See `EqualSteps`.
    method : Method
        The method that messages name.
    """

    place: tuple[str, ...] = (
        *StepSizeControl.place, "tolerance", "steps", "coarsest", "beyond", "farthest", "coarser", "fineness",
    )  # fmt: skip
    lag = 1
    method: Method

    def plan(self, t_end: float, tolerance: float, fineness: float = 1.0) -> None:
        """Set the end in s, the tolerance, and how finely impacts are resolved, over what is done by default."""
        self.set_range(t_end, tolerance)
        self.weight = self.bands.system.scale[self.bands.order]
        self.period = self.bands.over.period(t_end)
        self.steps, self.coarsest, self.beyond, self.fineness = 0, 0.0, False, fineness
        self.farthest = 0.0
        # What a run of a coarser tolerance found at the times of `check_times`, in band order.
        self.coarser = np.empty((0, 0))
        self.keep_past(self.tick, t_end + 2.0 * self.largest)

    def measure(self, displacement: Array) -> None:
        """Set the displacement to which errors are related, from a rough run, shape (n, n_times)."""
        # A scene that starts from rest has no displacement to compare with at first.
        self.size = self.largest_of(displacement)

    def largest_of(self, displacement: Array) -> float:
        """Return the largest of displacements in band order, shape (n, n_times), in m; rotations by their arms."""
        return float(np.max(np.abs(self.weight[:, None] * displacement), initial=0.0))

    @property
    def finished(self) -> bool:
        """Whether all states are stored."""
        return self.beyond

    def reached(self) -> float:
        """Return the time of the state in `last_step`, s."""
        return min(self.time, self.t_end)

    @abstractmethod
    def attempt(self, out: Record) -> Attempt:
        """Take the next step whole and in halves."""

    @abstractmethod
    def take(self, out: Record) -> None:
        """Accept the two half steps of the last attempt."""

    def between_ends(self, fluctuations: Array, response: Array) -> float:
        """Return the motion by loads that no interpolation between the ends of steps shows, over the tolerance.

        The motion between the ends of a step is interpolated by a polynomial. A short load causes motion that this
        polynomial does not contain. That is no error of the steps and does not accumulate, but states between steps
        have it.

        Parameters
        ----------
        fluctuations : ndarray, shape (2, n_loads)
            The result of `step_loads.of_halves`.
        response : ndarray, shape (n_loads, n)
            Displacement in half a step by a unit of them.
        """
        moved = fluctuations @ np.abs(response)
        return float(np.max(self.weight * moved, initial=0.0)) / self.whole

    def withdraw(self, out: Record) -> None:
        """Undo the last attempt."""

    @property
    @abstractmethod
    def displacement(self) -> Array:
        """Displacements at the time that the run has reached, in band order."""

    def advance(self, out: Record) -> None:
        """Take some steps; where a state is completed by the step after it, the last one goes beyond the end."""
        room = out.events.shape[0] - 2 * self.status.size
        for _ in range(_CHUNK):
            if self.beyond or out.happened[0] > room:
                break
            self._one(out)

    def _one(self, out: Record) -> None:
        while True:
            t, dt = self.time, self.length(self.level)
            tried = self.attempt(out)
            self.complain(dt)
            if tried.solves < 0 and self.at_smallest:
                raise ConvergenceError(
                    f"{self.method.name} found no solution of the step from t = {t:g} s, however small; "
                    "a nonlinear spring that softens may leave none"
                )
            ratio = max(self.ratio(tried.rough, tried.smooth), tried.between) if tried.solves >= 0 else np.inf
            # An impact that the step does not resolve may change velocities for the whole rest of the run.
            if tried.unresolved * self.t_end > _HARMLESS * self.whole:
                ratio = max(ratio, 2.0)
            if self.accepts(ratio):
                break
            self.bands.counters.rejected += 1
            self.withdraw(out)
        self.take(out)
        after = self.ticks + 2 ** (HALVINGS - self.level)
        self.beyond = (self.ticks if self.lag else after) >= self.last_tick
        self.farthest = max(self.farthest, float(np.max(self.weight * np.abs(self.displacement))))
        self.step_on(ratio)
        self.coarsest = max(self.coarsest, 0.5 * dt)
        self.steps += 0 if self.beyond and self.lag else 2
        self.count(self.steps, self.steps, tried.solves)


class Impact(NamedTuple):
    """Scales of the errors of a step.

    Attributes
    ----------
    weight : ndarray, shape (n,)
        From unknowns to metres.
    fineness : float
        How finely impacts are resolved, over what is done by default.
    """

    weight: Array
    fineness: float


class Path(NamedTuple):
    """Laws along two halves of a step.

    Attributes
    ----------
    u, rates : ndarray, shape (3, n_laws)
        Coordinates and their rates at the beginning and at the ends of both halves.
    reactions : ndarray, shape (2, n_laws)
        Reactions over both halves, N.
    """

    u: Array
    rates: Array
    reactions: Array


@jit
def impact(laws: Laws, contacts: int, dt: float, path: Path, fineness: float) -> tuple[bool, float]:
    """Return whether a law's tangent jumps in two halves of a step, and the largest change of rate not resolved, m/s.

    For a stiffness k, a mass m, a penetration s and its rate r, the velocity of the impact
    is ``sqrt(r^2 + k s^2/m)``. The mass need not be known, because ``k s/m`` is the change of rate
    per time. A contact that a static load keeps closed has a large velocity of impact by this
    formula, so its small vibrations count as resolved.
    Of any other law the tangents k at the ends of the halves are compared; ``k dt^2/2m`` follows from
    the change of rate ``R dt/m`` that its reaction R causes.

    Parameters
    ----------
    laws : Laws
    contacts : int
        How many of them are contacts, which come first.
    dt : float
        Size of a half in s.
    path : Path
    fineness : float
        How finely impacts are resolved, over what is done by default.
    """
    acts, unresolved = False, 0.0
    u, rates = path.u, path.rates
    for j in range(u.shape[1]):
        r0, r1, r2 = rates[0, j], rates[1, j], rates[2, j]
        change = max(abs(r1 - r0), abs(r2 - r1))
        if j >= contacts:
            jumps, more = _jump(laws, laws.kinds.hysteretic, j, dt, path, fineness)
            acts = acts or jumps
            unresolved = max(unresolved, more)
            continue
        deepest = max(u[0, j], u[1, j], u[2, j]) - laws.table[j]["gap"]
        if deepest <= 0.0:
            continue
        acts = True
        speed = max(r0 * r0, r1 * r1, r2 * r2) + deepest * change / dt
        if change * change > (_RESOLVED / fineness) ** 2 * speed:
            unresolved = max(unresolved, change)
    return acts, unresolved


@jit
def _jump(laws: Laws, hysteretic: bool | None, j: int, dt: float, path: Path, fineness: float) -> tuple[bool, float]:
    """Return the same as `impact` for one law that is no contact."""
    if hysteretic is None:
        return False, 0.0
    if not tangent_jumps(laws, j):
        return False, 0.0
    k0 = force_and_tangent(laws, j, path.u[0, j])[1]
    k1 = force_and_tangent(laws, j, path.u[1, j])[1]
    k2 = force_and_tangent(laws, j, path.u[2, j])[1]
    stiff = max(abs(k0), abs(k1), abs(k2))
    if max(abs(k1 - k0), abs(k2 - k1)) <= 0.5 * stiff:
        return False, 0.0
    reaction = max(abs(path.reactions[0, j]), abs(path.reactions[1, j]))
    change = max(abs(path.rates[1, j] - path.rates[0, j]), abs(path.rates[2, j] - path.rates[1, j]))
    if 0.5 * stiff * change * dt > _SOFT / fineness**2 * reaction:
        return True, change
    return True, 0.0
