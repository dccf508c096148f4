"""Springpots: a force proportional to a fractional derivative of the elongation.

The kernel of a springpot is a sum of exponentials with positive weights. A
springpot is therefore a set of parallel Maxwell elements, each a spring and a
dashpot in series. Element k carries the force ``weight y_k``, where
``y_k' = u' - rate_k y_k``. Elements that are faster than any step enter through
two sums. The rate of elongation p is taken to be constant over a step, which is
the only approximation. The mean force over the step is then ``slope p + rest``,
and its work ``mean p dt`` is what the elements store and dissipate. No step
creates energy. A springpot is thus an affine law over one step; what methods that
step in time need of it is in `springpot_steps`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from vofem.arrays import Array, Complex
from vofem.errors import ArgumentError, MissingCallableError, VofemError
from vofem.laws.group import LawGroup, ListedLaws, StepPast
from vofem.laws.law import Law, affine


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
    """

    label: str  #: Class and name, for messages.
    name: str
    coefficient: float  #: Coefficient of the law, N s^order/m.
    #: Order in [0, 1]. A callable takes times in s, shape (n,), and returns orders.
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

        Raises `ArgumentError` if a callable raises, or returns anything but numbers from 0 to 1.
        """
        from vofem.fractional.laws import orders_at

        try:
            return orders_at(self.order, t, highest=1.0)
        except ArgumentError as error:
            raise ArgumentError(f"{self.label}: {error}") from None
        except MissingCallableError as error:
            raise MissingCallableError(f"{self.label}, order: {error}") from None
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

    `rows` has shape (n_laws, n).
    """

    place: ClassVar[int] = 3
    kind: ClassVar[str] = "springpots"
    recorded: ClassVar[bool] = True
    named: ClassVar[str] = "springs"
    static: ClassVar[bool] = False
    linear: ClassVar[bool] = True
    past_is_kept: ClassVar[bool] = False

    laws: tuple[SpringpotLaw, ...]

    def nonlinearity(self, method: str) -> str:
        """Return why the force does not follow from the present displacement."""
        return (
            f"{self.labels[0]} has a force that its whole past decides, and {method} needs systems whose future "
            "follows from their present displacements and velocities"
        )

    def harmonic_refusal(self) -> str | None:
        """Return why there is no response to one frequency: only under an order that varies."""
        label = next((law.label for law in self.laws if law.varies), None)
        if label is None:
            return None
        return (
            f"{label} has an order that varies in time, so it has no response to one frequency; give it a constant "
            "order, or simulate"
        )

    @property
    def _orders(self) -> Array:
        return np.array([float(law.order) for law in self.laws])  # type: ignore[arg-type]

    def harmonic_stiffness(self, omega: float) -> Complex:
        """Return ``c (i omega)^alpha`` on the principal branch."""
        orders, coefficients = self._orders, np.array([law.coefficient for law in self.laws])
        turn = np.exp(0.5j * np.pi * orders)
        return np.asarray(coefficients * np.where(orders == 0.0, 1.0, float(omega) ** orders) * turn)

    def stored_by_pairs(self, p: Complex) -> Complex:
        """Return the energy of the springs of the kernel, ``sin(pi alpha)/pi int xi^(alpha - 1) y^2/2 d xi``.

        There ``y = p/(p + xi)`` for each motion ``exp(p t)``; products of two motions integrate in closed form.
        """
        return np.stack(
            [law.coefficient * _stored_pairs(p, order) for law, order in zip(self.laws, self._orders, strict=True)]
        )

    @cached_property
    def forms(self) -> tuple[Law, ...]:
        """The affine laws that springpots are over one step; `springpot_steps` enters their numbers.

        They enter every step implicitly and do not change the critical step.
        """
        return tuple(Law(law.label, law.name, affine, np.zeros(4), stiffness=0.0, damped=True) for law in self.laws)

    def shifted(self, start: float) -> SpringpotLaws:
        """Return the springpots for a run that begins at a time in s; orders that vary are shifted."""
        laws = tuple(
            replace(law, order=ShiftedOrder(law.order, start)) if callable(law.order) else law for law in self.laws
        )
        return SpringpotLaws(self.rows, laws)

    def past_in_steps(self, row: int, shortest: float, t_end: float) -> StepPast:
        """Return the internal variables that these laws have in a run in time steps."""
        from vofem.laws.springpot_past import SpringpotPast

        return SpringpotPast(self.laws, self.rows, row, shortest, t_end)

    def numbers(self) -> Array:
        """Return the coefficients."""
        return np.array([law.coefficient for law in self.laws])


def _stored_pairs(p: Complex, order: float) -> Complex:
    """Return ``sin(pi alpha)/pi int_0^inf xi^(alpha - 1) p r/((xi + p)(xi + r)) d xi`` for all pairs of harmonics."""
    size = np.abs(p)
    powers = np.where(size > 0.0, np.where(size > 0.0, size, 1.0) ** (order - 1.0), 0.0)
    powers = powers * np.exp(0.5j * np.pi * (order - 1.0) * np.sign(p.imag))
    first, second = p[:, None], p[None, :]
    apart = second - first
    close = apart == 0.0
    pairs = (powers[:, None] - powers[None, :]) / np.where(close, 1.0, apart)
    same = np.where(size > 0.0, (1.0 - order) * powers / np.where(size > 0.0, p, 1.0), 0.0)
    pairs = np.where(close, same[:, None], pairs)
    found = first * second * pairs
    still = size == 0.0
    # The force of a constant elongation relaxes to zero, except for a spring (order 0).
    found[still] = found[:, still] = 1.0 if order == 0.0 else 0.0
    return np.asarray(found)
