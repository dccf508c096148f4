"""A fractional derivative along a run, step by step: memory and work per step grow like log(t_end/dt).

The history is held by integrals of the rate against decaying exponentials,
each of which follows from itself one step earlier; the last step, where the
kernel is singular, is integrated in closed form.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import array, choice, number
from vofem.arrays import Array
from vofem.errors import ArgumentError
from vofem.fractional.exponentials import exponentials


def last_step(dt: float, order: float) -> tuple[float, float]:
    """Return the weights of the rates at start and end of the last step, over which the rate is linear.

    ``dt^(1-order) (1 - order) / Gamma(3 - order)`` and ``dt^(1-order) / Gamma(3 - order)``.
    """
    end = dt ** (1.0 - order) / math.gamma(3.0 - order)
    return (1.0 - order) * end, end


def step_integrals(rates: Array, dt: float) -> tuple[Array, Array]:
    """Return the integrals of ``exp(-rate x)`` over a step, times ``x/dt`` and times ``1 - x/dt``; shape (k,) each.

    They are the weights of the rates at start and end of a step in the integrals that hold the history.
    """
    z = rates * dt
    small = z < 0.5
    y = np.where(small, 1.0, z)
    start = (-np.expm1(-y) / y - np.exp(-y)) / y
    series = sum((-z) ** k / (math.factorial(k) * (k + 2.0)) for k in range(16))
    start = dt * np.where(small, series, start)
    whole = dt * np.where(z > 0.0, -np.expm1(-z) / np.where(z > 0.0, z, 1.0), 1.0)
    return start, whole - start


class StreamingDerivative:
    """The derivative of order 0 to 1 of a displacement u, given at steps of equal length.

    It is Caputo's derivative, ``1/Gamma(1-a)`` times the integral of ``(t - x)^-a u'(x)`` from 0 to t. It describes a
    body that was at rest before t = 0, in any position. The Riemann-Liouville derivative is larger by ``u(0) t^-a /
    Gamma(1-a)``, and the same where ``u(0) = 0``. An order that varies is frozen at the present.

    Parameters
    ----------
    dt : float
        Step in s.
    t_end : float
        Longest time that will be reached, in s.
    order : float
        The order in [0, 1], which `affine` and `peek` use unless another order is given.
    tolerance : float
        Accepted relative error of the kernel beyond the last step, at least 1e-12.
    given : {"velocity", "displacement"}
        The quantity that is passed to `peek` and `commit`. Velocities are interpolated linearly over a step; the error
        is of second order in the step for all orders a. Displacements are interpolated linearly (the L1 formula); the
        error is of order ``2 - a`` in the step.
    initial : float
        The velocity or displacement at t = 0.

    Attributes
    ----------
    decay, start, end : ndarray, shape (k,)
        Coefficients that advance the history variables y by one step: ``y <- decay y + start v_old + end v_new``.

    Raises
    ------
    ArgumentError
        For values out of range, a state of another shape, or steps beyond t_end.

    Notes
    -----
    A step reads ``slope, rest = affine()``: the derivative at its end is
    ``slope new + rest``, which an implicit method solves with. Neither `affine`
    nor `peek` changes anything; `commit` accepts a step. `state` is one flat
    array, k + 2 numbers: the history, the value last committed and the number
    of steps. For a compiled loop: `decay`, `start`, `end`, `weights`, `last_step`.
    """

    def __init__(
        self,
        dt: float,
        t_end: float,
        order: float,
        *,
        tolerance: float = 1e-10,
        given: Literal["velocity", "displacement"] = "velocity",
        initial: float = 0.0,
    ) -> None:
        self._kernel = exponentials(dt, t_end, tolerance)
        self.given = choice("given", given, ("velocity", "displacement"))
        self.dt, self.t_end, self.order = float(dt), float(t_end), self._checked(order)
        self.decay = np.exp(-self._kernel.rates * self.dt)
        self.start, self.end = step_integrals(self._kernel.rates, self.dt)
        self._state = np.zeros(len(self.decay) + 2)
        self._state[-2] = number("initial", initial)
        self._weighted = self.order, self.weights(self.order)

    @property
    def error(self) -> float:
        """Largest relative error of the kernel beyond the last step, as measured."""
        return self._kernel.error

    @property
    def state(self) -> Array:
        """A copy of the internal variables that describe the past, shape (k + 2,). Assign it to return to this step."""
        return self._state.copy()

    @state.setter
    def state(self, values: ArrayLike) -> None:
        self._state = array("state", values, shape=self._state.shape).copy()

    @property
    def t(self) -> float:
        """Time of the last committed step in s."""
        return float(self._state[-1]) * self.dt

    def weights(self, order: float) -> Array:
        """Return the weights of the history variables at the end of the next step, shape (k,)."""
        return self._kernel.weights(self._checked(order)) * self.decay

    def affine(self, order: float | None = None) -> tuple[float, float]:
        """Return slope and rest: the derivative at the end of the next step is ``slope new + rest``."""
        if order is not None and order != self._weighted[0]:
            self._weighted = self._checked(order), self.weights(order)
        order, weights = self._weighted if order is not None else (self.order, self._own())
        at_start, at_end = last_step(self.dt, order)
        history, last = float(weights @ self._state[:-2]), float(self._state[-2])
        if self.given == "velocity":
            return at_end, history + at_start * last
        slope = (at_start + at_end) / self.dt
        return slope, history - slope * last

    def _own(self) -> Array:
        if self._weighted[0] != self.order:
            self._weighted = self.order, self.weights(self.order)
        return self._weighted[1]

    def peek(self, value: float, order: float | None = None) -> float:
        """Return the derivative at the end of the next step, if the step ends with this value."""
        slope, rest = self.affine(order)
        return slope * number("value", value) + rest

    def commit(self, value: float) -> None:
        """Accept a step that ends with this value."""
        value = number("value", value)
        count = self._state[-1] + 1.0
        if count * self.dt > self.t_end * (1.0 + 1e-9):
            raise ArgumentError(
                f"the step ends at {count * self.dt:g} s, beyond t_end = {self.t_end:g} s for which the history was"
                " made: make it with the t_end of the run"
            )
        last = self._state[-2]
        if self.given == "velocity":
            old, new = last, value
        else:
            old = new = (value - last) / self.dt
        self._state[:-2] = self.decay * self._state[:-2] + self.start * old + self.end * new
        self._state[-2:] = value, count

    @staticmethod
    def _checked(order: float) -> float:
        order = number("order", order, minimum=0.0)
        if order > 1.0:
            raise ArgumentError(f"order is {order:g}, expected a number from 0 to 1")
        return order
