"""Springpots: a force proportional to a fractional derivative of the elongation.

The kernel of a springpot is a sum of exponentials with positive weights. A
springpot is therefore a set of parallel Maxwell elements, each a spring and a
dashpot in series. Element k carries the force ``weight y_k``, where
``y_k' = u' - rate_k y_k``. Elements that are faster than any step enter through
two sums. The rate of elongation p is taken to be constant over a step, which is
the only approximation. The mean force over the step is then ``slope p + rest``,
and its work ``mean p dt`` is what the elements store and dissipate. No step
creates energy. A springpot is thus an affine law over one step; only `carry_on`
changes its past.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ArgumentError, VofemError
from vofem.laws.group import LawGroup, ListedLaws
from vofem.laws.kinds import AFFINE
from vofem.laws.table import Laws
from vofem.linalg.jit import jit

if TYPE_CHECKING:
    pass

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ShiftedOrder:
    """The varying order of a springpot for a run that begins at the time `start`, in s."""

    order: Callable[[Array], Any]
    start: float

    def __call__(self, t: Array) -> Any:
        """Return the orders at times t, shape (n,)."""
        return self.order(self.start + np.asarray(t, dtype=float))


@dataclass(frozen=True, eq=False)
class SpringpotLaw:
    """``R = coefficient D^order u`` on a row; the force on the structure is ``-b R``.

    D is Caputo's derivative from t = 0: the system is taken to have been at rest
    before, in its initial place. An order that varies is applied to the whole
    past with its value at the present time.

    Attributes
    ----------
    label : str
        Class and name, for messages.
    name : str
    coefficient : float
        In N s^order/m.
    order : float or callable
        In [0, 1]; a callable takes times in s, shape (n,), and returns orders.
    """

    label: str
    name: str
    coefficient: float
    order: float | Callable[[Array], Any]

    @property
    def group(self) -> type[LawGroup]:
        """The group that gathers laws of this kind."""
        return SpringpotLaws

    @property
    def varies(self) -> bool:
        """Whether the order is a function of time."""
        return callable(self.order)

    def orders(self, t: Array) -> Array:
        """Return the orders at times in s, shape (n,).

        Raises
        ------
        ArgumentError
            If a callable raises, or returns anything but numbers from 0 to 1.
        """
        from vofem.fractional.laws import orders_at

        try:
            return orders_at(self.order, t, highest=1.0)
        except ArgumentError as error:
            raise ArgumentError(f"{self.label}: {error}") from None
        except VofemError:
            raise
        except Exception as error:
            raise ArgumentError(
                f"{self.label}: order raised {type(error).__name__}: {error} at times from {t[0]:g} to {t[-1]:g} s; it "
                "must take an array of times in s and return as many numbers from 0 to 1"
            ) from error


@dataclass(frozen=True)
class SpringpotLaws(ListedLaws):
    """Springpots, one per row.

    Attributes
    ----------
    rows : csr_matrix, shape (n_laws, n)
    laws : tuple of SpringpotLaw
    """

    place: ClassVar[int] = 3
    kind: ClassVar[str] = "springpots"
    recorded: ClassVar[bool] = True
    static: ClassVar[bool] = False

    laws: tuple[SpringpotLaw, ...]

    def nonlinearity(self, method: str) -> str:
        """Return why the force does not follow from the present displacement."""
        return (
            f"{self.labels[0]} has a force that its whole past decides, and {method} needs systems whose future "
            "follows from their present displacements and velocities"
        )

    def steepest(self, u: Array) -> Array:
        """Return zeros: springpots enter every step implicitly and do not change the critical step."""
        return np.zeros(len(self))

    def shifted(self, start: float) -> SpringpotLaws:
        """Return the springpots for a run that begins at a time in s; orders that vary are shifted."""
        laws = tuple(
            replace(law, order=ShiftedOrder(law.order, start)) if callable(law.order) else law for law in self.laws
        )
        return SpringpotLaws(self.rows, laws)

    def numbers(self) -> Array:
        """Return the coefficients."""
        return np.array([law.coefficient for law in self.laws])

    def fill(self, table: NDArray[np.void]) -> None:
        """Enter the kind; `impose` enters the numbers of a step."""
        table["kind"] = AFFINE


class Pace(NamedTuple):
    """Coefficients by which a step of size dt advances the numbers y of a past; arrays of shape (k,).

    ``decay y + gain p`` is y at the end of the step, and ``old y + new p`` is its mean over the step.
    """

    dt: float
    decay: Array
    gain: Array
    old: Array
    new: Array


class Springpots(NamedTuple):
    """The numbers of all springpots at some steps.

    Attributes
    ----------
    row : int
        Number of the first one among all laws.
    weight : ndarray, shape (n, n_steps, k)
        Factors from y to forces, at the orders of the steps. There is one step if no order varies.
    """

    row: int
    weight: Array


class History(NamedTuple):
    """The past of all springpots.

    Attributes
    ----------
    y : ndarray, shape (n, k)
        Past of each springpot; the last number is the rate of elongation over the last step in m/s.
    told : ndarray, shape (n, 7)
        Mean force over the last step in N; force in N, stored energy and absorbed work in J at the last time; the
        same three at the time before it.
    """

    y: Array
    told: Array


MEAN, FORCE, HELD, WORK, BEFORE = 0, 1, 2, 3, 3

#: For systems without springpots.
NO_PACE = Pace(1.0, np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0))
NO_SPRINGPOTS = Springpots(0, np.zeros((0, 1, 0)))
NO_HISTORY = History(np.zeros((0, 0)), np.zeros((0, 7)))


@jit
def affine(springpots: Springpots, pace: Pace, history: History, i: int, s: int) -> tuple[float, float]:
    """Return slope (N s/m) and rest (N) of the mean force of springpot i over step s."""
    s = min(s, springpots.weight.shape[1] - 1)
    slope, rest = 0.0, 0.0
    for k in range(pace.new.size):
        weight = springpots.weight[i, s, k]
        slope += weight * pace.new[k]
        rest += weight * pace.old[k] * history.y[i, k]
    return slope, rest


@jit
def impose(
    springpots: Springpots, pace: Pace, history: History, s: int, laws: Laws, u: Array, ahead: float, share: float
) -> None:
    """Make forces over step s those of the laws, affine in the elongation at its end, for a step that starts at u.

    They are extrapolated from the middles of this step and of the one before, by `ahead` of their distance, and
    divided by the share with which the step weighs forces at its end.
    """
    for i in range(springpots.weight.shape[0]):
        j = springpots.row + i
        slope, rest = affine(springpots, pace, history, i, s)
        laws.table[j]["stiffness"] = (1.0 + ahead) * slope / (share * pace.dt)
        laws.table[j]["gap"] = u[j]
        laws.table[j]["offset"] = ((1.0 + ahead) * rest - ahead * history.told[i, MEAN]) / share


@jit
def carry_on(springpots: Springpots, pace: Pace, history: History, i: int, s: int, rate: float, mean: float) -> None:
    """Advance the past of springpot i by step s, given the rate of elongation and the mean force of the step."""
    s = min(s, springpots.weight.shape[1] - 1)
    held = 0.0
    for k in range(pace.decay.size):
        y = pace.decay[k] * history.y[i, k] + pace.gain[k] * rate
        history.y[i, k] = y
        held += 0.5 * springpots.weight[i, s, k] * y * y
    history.told[i, MEAN] = mean
    history.told[i, HELD] = held
