"""The motion of a scene: points of bodies and fields of beams over time."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import array, wrong
from vofem.arrays import Array
from vofem.assembly import Model
from vofem.bodies.base import Body
from vofem.bodies.beam import Beam
from vofem.effects.line_loads import balanced_sections
from vofem.errors import ArgumentError
from vofem.integrators.base import ContactSamples, Sampled, Solution
from vofem.lookup import body_named, row_of, the_beam
from vofem.scene import Scene


class Motion:
    """The motion of the bodies of a scene.

    Attributes
    ----------
    scene : Scene
    solution : Solution
        The solution of the equations of motion.
    model : Model
        The assembled scene, with loads that count time from the beginning of the run.
    t_start : float
        Time of the loads of the scene in s at which the run began.
    times : ndarray, shape (n_times,)
        Times in s at which results are stored.
    """

    def __init__(self, scene: Scene, solution: Solution, model: Model | None = None, t_start: float = 0.0) -> None:
        self.scene = scene
        self.solution = solution
        self.t_start = t_start
        self.model: Model = scene.model if model is None else model
        self.times: Array = solution.times

    # -- points -----------------------------------------------------------------------------------

    @cached_property
    def samples(self) -> Sampled:
        """Free degrees of freedom at `times`: q, v, a of shape (n, n_times)."""
        return self.solution.sample(self.times)

    @cached_property
    def contact_samples(self) -> ContactSamples:
        """Contacts at `times`."""
        return self.solution.contacts(self.times)

    def _at(self, t: ArrayLike | None) -> Sampled:
        if t is None:
            return self.samples
        times = np.atleast_1d(array("t", t))
        if times.ndim != 1:
            raise wrong("t", f"an array of shape {times.shape}", "a time, or times of shape (n,)")
        end = self.solution.t_end
        if np.any(times < 0.0) or np.any(times > end * (1.0 + 1e-12)):
            bad = times[(times < 0.0) | (times > end)][0]
            raise ArgumentError(f"t is {bad:g} s, expected a time of the run, 0 to {end:g} s")
        return self.solution.sample(np.minimum(times, end))

    def _along(self, point: Any, t: ArrayLike | None, kind: str) -> Array:
        body, row = row_of(self.scene.bodies, point)
        return row.weights @ self._some(body, row.indices, t, kind)

    def _some(self, body: Body, indices: NDArray[np.int64], t: ArrayLike | None, kind: str) -> Array:
        """Return some of a body's degrees of freedom (kind "q", "v" or "a"), shape (len(indices), n_times)."""
        dofs, free = indices + self.model.offsets[body], self.model.free
        if self.model.transform is not None:
            rows = self.model.transform[dofs][:, free]
            needed = np.unique(rows.indices).astype(np.int64)
            return np.asarray(rows[:, needed] @ getattr(self._at(t).take(needed), kind))
        place = np.minimum(np.searchsorted(free, dofs), free.size - 1)
        moving = free[place] == dofs
        values: Array = getattr(self._at(t).take(place), kind)
        return np.where(moving[:, None], values, 0.0)

    def displacement(self, point: Any, t: ArrayLike | None = None) -> Array:
        """Return the displacement of a point in m, shape (n_times,) or (len(t),)."""
        return self._along(point, t, "q")

    def velocity(self, point: Any, t: ArrayLike | None = None) -> Array:
        """Return the velocity of a point in m/s, shape (n_times,) or (len(t),)."""
        return self._along(point, t, "v")

    def acceleration(self, point: Any, t: ArrayLike | None = None) -> Array:
        """Return the acceleration of a point in m/s^2, shape (n_times,) or (len(t),)."""
        return self._along(point, t, "a")

    def state_of(self, body_name: str) -> tuple[Array, Array]:
        """Return the degrees of freedom of a body and their rates at the last time, each (size,)."""
        body = body_named(self.scene.bodies, body_name)
        q, v = self._last
        return self.model.of_body(body, q), self.model.of_body(body, v)

    @cached_property
    def _last(self) -> tuple[Array, Array]:
        """Free degrees of freedom and rates at the last time, each (n,)."""
        samples = self.__dict__.get("samples")
        return (self.solution.sample(self.times[-1:]) if samples is None else samples).last()

    def along_shape(self, body: Any, t: ArrayLike | None = None) -> Array:
        """Return the displacement of the places of a body's shape in m, shape (len(x), n_times)."""
        found = body_named(self.scene.bodies, body)
        rows = found.shape.rows
        return np.asarray(rows @ self._some(found, np.arange(found.size), t, "q"))

    # -- fields -----------------------------------------------------------------------------------

    def _body(self, body: Any) -> Body:
        """Return the body of that name; where none is given the only beam."""
        return self._beam(None) if body is None else body_named(self.scene.bodies, body)

    def _beam(self, body: Any) -> Beam:
        return the_beam(self.scene.bodies, body)

    def _field(self, x: ArrayLike, t: ArrayLike | None, body: Any, derivative: int) -> Array:
        beam = self._beam(body)
        matrix = beam.field_matrix(x, derivative)
        touched = np.unique(matrix.indices).astype(np.int64)
        return np.asarray(matrix[:, touched] @ self._some(beam, touched, t, "q"))

    def deflection(self, x: ArrayLike, t: ArrayLike | None = None, body: Any = None) -> Array:
        """Return eta in m by the Hermite cubics, shape (len(x), len(t)).

        Parameters
        ----------
        x : array_like
            Places along the axis in m.
        t : array_like, optional
            Times in s. The default is `times`.
        body : Beam, optional
            The beam. It must be given if the scene has several.
        """
        return self._field(x, t, body, 0)

    def slope(self, x: ArrayLike, t: ArrayLike | None = None, body: Any = None) -> Array:
        """Return d(eta)/dx, shape (len(x), len(t))."""
        return self._field(x, t, body, 1)

    def bending_moment(
        self, x: ArrayLike, t: ArrayLike | None = None, body: Any = None, *, recovered: bool = False
    ) -> Array:
        """Return ``M = EI eta''`` in N m, shape (len(x), len(t)); at a node, that of the element to its right.

        Parameters
        ----------
        x, t, body
            As for `deflection`.
        recovered : bool
            With False, the default, the moment is that of the cubics. In an element of length h under a distributed
            load q, weight and inertia included, its error is up to ``q h^2/12``. With True the moment is computed from
            the forces at the ends of each element, such that it balances distributed loads, weight, inertia,
            foundations and tension. It converges with the fourth power of h if the motion is smooth. It contains
            accelerations, which jump at starts and impacts. Damping forces inside elements are left out.
        """
        beam = self._beam(body)
        if recovered:
            return self._sections(beam, x, t)[0]
        return beam.bending_stiffness(x)[0][:, None] * self._field(x, t, beam, 2)

    def shear_force(
        self, x: ArrayLike, t: ArrayLike | None = None, body: Any = None, *, recovered: bool = False
    ) -> Array:
        """Return ``V = (EI eta'')'`` in N, shape (len(x), len(t)); constant within an element where EI is.

        It is the mean of the shear force over the element. Under a distributed load q its error is up to ``q h/2`` at
        the ends of an element of length h. With ``recovered=True`` it balances the load, as in `bending_moment`. At a
        support, `reaction` is exact.
        """
        beam = self._beam(body)
        if recovered:
            return self._sections(beam, x, t)[1]
        stiffness, change = beam.bending_stiffness(x)
        shear = stiffness[:, None] * self._field(x, t, beam, 3)
        return shear + change[:, None] * self._field(x, t, beam, 2) if np.any(change) else shear

    def _sections(self, beam: Beam, x: ArrayLike, t: ArrayLike | None) -> tuple[Array, Array]:
        """Return bending moment and shear force that balance loads and inertia, each (len(x), len(t))."""
        times = self.times if t is None else np.atleast_1d(np.asarray(t, dtype=float))
        every = np.arange(beam.size)
        q, a = (self._some(beam, every, t, kind) for kind in ("q", "a"))
        return balanced_sections(self.scene.effects, beam, x, self.t_start + times, q, a)
