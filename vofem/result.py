"""What a run returns: data, counters, events and energies. Plotting lives elsewhere."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import Named, array
from vofem.assembly import Model
from vofem.bodies.base import Body
from vofem.bodies.beam import Beam
from vofem.errors import ArgumentError
from vofem.fractional.orders import exponential_order
from vofem.histories import ProbeHistory
from vofem.integrators.base import ContactSamples, ProbeSamples, Sampled, Solution, SpringSamples
from vofem.lookup import body_named, row_of, the_beam
from vofem.memory import past_of
from vofem.scene import Scene
from vofem.system import CLOSED, PINNED, Counters

if TYPE_CHECKING:
    from vofem.integrators.event_driven.lifted import Truncation
    from vofem.integrators.event_driven.sensitivity import Sensitivity

Array = NDArray[np.float64]


class Reaction(NamedTuple):
    """What a support does to a body: force in N (positive upward) and moment in N m, each (n_times,).

    The moment is positive where it does work on a growing slope. The one that
    the support does not hold is zero.
    """

    force: Array
    moment: Array


@dataclass(frozen=True)
class Energy:
    """Energies in J at `Result.times`, each of shape (n_times,).

    Attributes
    ----------
    kinetic, strain : ndarray
        Of bodies and springs, those with memory and those of springpots included.
    contact : ndarray
        Stored in closed contacts: ``K0 (u^2 - gap^2)/2`` for ``acts_on="displacement"``.
    dissipated : ndarray
        Taken by all dampers, springs with memory and springpots since t = 0.
    work : ndarray
        Done by all loads since t = 0.
    start : float
        Total energy at t = 0.

    Notes
    -----
    `total` is the sum of the first three, `balance` what is missing from
    their balance with dissipation and work, `balance_error` its largest
    magnitude over the largest energy.
    """

    kinetic: Array
    strain: Array
    contact: Array
    dissipated: Array
    work: Array
    start: float

    @property
    def total(self) -> Array:
        """Kinetic, strain and contact energy together."""
        return self.kinetic + self.strain + self.contact

    @property
    def balance(self) -> Array:
        """What is missing from the balance, J: ``total - start + dissipated - work``."""
        return self.total - self.start + self.dissipated - self.work

    @property
    def balance_error(self) -> float:
        """The largest magnitude of `balance` over the largest energy in it."""
        parts = (self.total, self.dissipated, self.work)
        scale = max((float(np.max(np.abs(part), initial=0.0)) for part in parts), default=0.0)
        return float(np.max(np.abs(self.balance), initial=0.0)) / scale if scale > 0 else 0.0


class ContactHistory:
    """One contact along a run.

    Events are `closings`, `openings` and `pinned` intervals, at their own
    times; `closed`, `stiffness`, `force`, `gap_function` and `order` are
    histories at the run's times, each of shape (n_times,).

    Attributes
    ----------
    name : str
    """

    def __init__(self, result: Result, index: int) -> None:
        self._result = result
        self._index = index
        laws = result.model.system.contacts
        assert laws is not None
        self._laws = laws
        self.name = laws.names[index]

    def __repr__(self) -> str:
        return f"ContactHistory({self.name!r}, {self.closings.size} closings, {self.openings.size} openings)"

    def _times(self, closing: bool) -> Array:
        events = self._result.solution.events
        mine = events.contact == self._index
        held = np.concatenate([[events.initial[self._index]], events.status[mine]]) == CLOSED
        times = np.concatenate([[0.0], events.time[mine]])
        before = np.concatenate([[False], held[:-1]])
        return times[held & ~before] if closing else times[~held & before]

    @property
    def closings(self) -> Array:
        """Times at which the contact closes, s; 0.0 first where it starts closed."""
        return self._times(True)

    @property
    def openings(self) -> Array:
        """Times at which the contact ceases to be closed, s."""
        return self._times(False)

    @property
    def pinned(self) -> Array:
        """Intervals in which the contact is pinned at its gap, s, shape (k, 2)."""
        events = self._result.solution.events
        mine = events.contact == self._index
        times = np.concatenate([[0.0], events.time[mine], [self._result.solution.t_end]])
        held = np.flatnonzero(np.append(events.initial[self._index], events.status[mine]) == PINNED)
        return np.stack([times[held], times[held + 1]], axis=1)

    @property
    def _samples(self) -> ContactSamples:
        return self._result.contact_samples

    @property
    def closed(self) -> NDArray[np.bool_]:
        """Whether the contact is closed, shape (n_times,)."""
        return self._samples.status[self._index] == CLOSED

    @property
    def stiffness(self) -> Array:
        """K_eq in N/m, shape (n_times,)."""
        return self._samples.stiffness[self._index]

    @property
    def force(self) -> Array:
        """Contact force in N, shape (n_times,); positive pushes the bodies apart."""
        return self._samples.force[self._index]

    @property
    def gap_function(self) -> Array:
        """The gap function s in m, shape (n_times,); positive is penetration."""
        u = self._result.samples.along(self._laws.rows[[self._index]], "q")[0]
        return u - self._laws.gap[self._index]

    @property
    def order(self) -> Array:
        """The order beta of the operator, shape (n_times,).

        Under the ideal switch 0 while closed and inf while open; NaN while pinned.
        """
        s0 = float(self._laws.resolution[self._index])
        status = self._samples.status[self._index]
        if np.isinf(s0):
            ideal = np.where(status == CLOSED, 0.0, np.inf)
            return np.where(status == PINNED, np.nan, ideal)
        return exponential_order(self.gap_function, s0)


class SpringHistory:
    """One spring with memory, or springpot, along a run; histories at the run's times, each of shape (n_times,).

    Attributes
    ----------
    name : str
    elongation : ndarray
        ``u_a - u_b`` in m; of a crushing stop the approach.
    force : ndarray
        In N, positive in tension; of a crushing stop positive where it pushes back.
    stored : ndarray
        Energy that would be given back, J. Of a springpot, which is a row of
        springs and dashpots in series: that of its springs.
    dissipated : ndarray
        Energy lost since t = 0, J: the area of the loops. Of a springpot whose
        order varies, work absorbed less `stored`: it may fall.
    """

    def __init__(self, result: Result, index: int) -> None:
        self._result, self._index = result, index
        self.name = result.model.system.springs[index].name

    def __repr__(self) -> str:
        return f"SpringHistory({self.name!r}, {self.dissipated[-1]:g} J dissipated)"

    @property
    def _samples(self) -> SpringSamples:
        samples = getattr(self._result.solution, "springs", None)
        assert samples is not None
        return samples

    @property
    def elongation(self) -> Array:
        """Elongation in m, shape (n_times,)."""
        system = self._result.model.system
        # The printed law is that of a system of one degree of freedom.
        parts = [part.rows for part in (system.memory, system.springpots) if part is not None] or [np.ones((1, 1))]
        index = self._index
        while index >= parts[0].shape[0]:
            index -= parts.pop(0).shape[0]
        return self._result.samples.along(parts[0][[index]], "q")[0]

    @property
    def force(self) -> Array:
        """Force in N, shape (n_times,)."""
        return self._samples.force[self._index]

    @property
    def stored(self) -> Array:
        """Stored energy in J, shape (n_times,)."""
        return self._samples.stored[self._index]

    @property
    def dissipated(self) -> Array:
        """Energy lost since t = 0, J, shape (n_times,)."""
        return self._samples.dissipated[self._index]


class Result:
    """The outcome of `vofem.simulate`.

    Quantities are computed when first read. All arrays over time follow
    `times`; methods that take t accept other times too: any with
    ``event_driven``, those between neighbouring steps with a stepping method.

    Attributes
    ----------
    scene : Scene
    method : str
        The integrator that ran.
    times : ndarray, shape (n_times,)
        In s; t = 0 first where they were not asked for.
    counters : Counters
        Work done by the run.
    notes : list of str
        What a user should know.
    recorded : ProbeSamples, optional
        What ``probes=`` of `vofem.simulate` asked for.
    """

    def __init__(self, scene: Scene, method: str, solution: Solution, recorded: ProbeSamples | None = None) -> None:
        self.scene = scene
        self.method = method
        self.solution = solution
        self.recorded = recorded
        self.model: Model = scene.model
        self.times: Array = solution.times

    def __repr__(self) -> str:
        return (
            f"Result(method={self.method!r}, {self.times.size} times to {self.times[-1]:g} s, "
            f"{self.counters.steps} steps, {self.counters.events} contact events)"
        )

    @property
    def counters(self) -> Counters:
        """Work done by the run."""
        return self.solution.counters

    @property
    def notes(self) -> list[str]:
        """What a user should know about the run."""
        return self.solution.notes

    # -- states -----------------------------------------------------------------------------------

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
        """Return a body's degrees of freedom and rates at the last time, each (size,); starts another scene."""
        body = body_named(self.scene.bodies, body_name)
        q, v = self.samples.last()
        return self.model.of_body(body, q), self.model.of_body(body, v)

    def spring_state(self, name: str) -> Array | None:
        """Return the state of a spring with memory at the last time, with which another scene can start, or None."""
        memory, springs = self.model.system.memory, getattr(self.solution, "springs", None)
        if memory is None or springs is None:
            return None
        return past_of(memory.laws, springs.past, name)

    # -- fields -----------------------------------------------------------------------------------

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
            Points on the axis in m.
        t : array_like, optional
            Times in s; `times` where not given.
        body : Beam, optional
            Needed where the scene has several beams.
        """
        return self._field(x, t, body, 0)

    def slope(self, x: ArrayLike, t: ArrayLike | None = None, body: Any = None) -> Array:
        """Return d(eta)/dx, shape (len(x), len(t))."""
        return self._field(x, t, body, 1)

    def bending_moment(self, x: ArrayLike, t: ArrayLike | None = None, body: Any = None) -> Array:
        """Return ``M = EI eta''`` in N m, shape (len(x), len(t)); at a node, that of the element to its right.

        It is the moment of the cubics: within an element of length h under a
        distributed load q (weight and inertia included) it is off by up to
        ``q h^2/12``, which refining the mesh removes quadratically.
        """
        beam = self._beam(body)
        return beam.bending_stiffness(x)[0][:, None] * self._field(x, t, beam, 2)

    def shear_force(self, x: ArrayLike, t: ArrayLike | None = None, body: Any = None) -> Array:
        """Return ``V = (EI eta'')'`` in N, shape (len(x), len(t)); constant within an element where EI is.

        It is the mean over the element of the shear force: under a distributed
        load q it differs by up to ``q h/2`` at the ends of an element of length
        h. At a support `reaction` is exact.
        """
        beam = self._beam(body)
        stiffness, change = beam.bending_stiffness(x)
        shear = stiffness[:, None] * self._field(x, t, beam, 3)
        return shear + change[:, None] * self._field(x, t, beam, 2) if np.any(change) else shear

    # -- contacts, reactions, energies ------------------------------------------------------------

    @cached_property
    def contacts(self) -> Named[ContactHistory]:
        """Contact histories by name."""
        laws = self.model.system.contacts
        names = () if laws is None else laws.names
        return Named({name: ContactHistory(self, j) for j, name in enumerate(names)})

    @cached_property
    def springs(self) -> Named[SpringHistory]:
        """Histories of springs with memory and of springpots by name; empty where the scene has none."""
        names = [law.name for law in self.model.system.springs]
        return Named({name: SpringHistory(self, j) for j, name in enumerate(names)}, "spring with memory")

    @cached_property
    def probes(self) -> Named[ProbeHistory]:
        """Points of ``simulate(..., probes=)`` by name or as points; empty where none were asked for."""
        record = self.recorded
        parts = () if record is None else zip(record.names, record.q, record.v, record.a, strict=True)
        histories = [ProbeHistory(name, record.times, *motion) for name, *motion in parts] if record else []
        return Named({history.name: history for history in histories}, "probe")

    def reaction(self, body: Any, where: Any, t: ArrayLike | None = None) -> Reaction:
        """Return what a support does to a body at `times`, or at times t.

        It is what the equations of motion of the supported degrees of freedom
        leave over, inertia and damping included.

        Parameters
        ----------
        body : Beam
        where : "left", "right" or x
            The place of a support.
        """
        from vofem.reactions import support_reaction

        beam, samples = self._beam(body), self._at(t)
        times = self.times if t is None else np.atleast_1d(np.asarray(t, dtype=float))
        force = None
        if self.model.system.contacts is not None:
            force = self.contact_samples.force if t is None else self.solution.contacts(times).force
        modes = getattr(self.solution, "modes", None) if self.model.system.modal_damping is not None else None
        system = self.model.system
        remembers = system.memory is not None or system.springpots is not None
        pull = self._spring_force(beam, where, t) if remembers else None
        return Reaction(*support_reaction(self.model, beam, where, times, samples, force, modes, pull))

    def _spring_force(self, beam: Beam, where: Any, t: ArrayLike | None) -> Array:
        """Return the forces of springs with memory, which are known at the run's times only."""
        if t is not None and not np.array_equal(np.atleast_1d(t), self.times):
            raise ArgumentError(
                f"reaction of Beam {beam.name!r} at {where!r}: springs with memory know their forces at the run's "
                "times; name the times in times= when simulating"
            )
        springs = getattr(self.solution, "springs", None)
        assert springs is not None
        return np.asarray(springs.force)

    @property
    def sensitivity(self) -> Sensitivity:
        """How a perturbation grows along the run, of event_driven: `times`, `growth`, `horizon(tolerance)`.

        Raises
        ------
        ArgumentError
            For a run of another method.
        """
        found = getattr(self.solution, "sensitivity", None)
        if found is None:
            raise ArgumentError(f"a run of {self.method} does not tell its sensitivity; use method='event_driven'")
        return found

    @property
    def truncation(self) -> Truncation | None:
        """What an event_driven run in Ritz vectors left out: `vectors`, `error`, `rounding`; None for all modes."""
        return getattr(self.solution, "truncation", None)

    def save(
        self, path: str | os.PathLike[str], *, overwrite: bool = False, frames: int | ArrayLike | None = None
    ) -> Path:
        """Write the run to one file, for ParaView, for xarray, and for `vofem.load`, which gives it back whole.

        The file appears whole or not at all: it is written under a hidden name
        in the same folder, forced to disk, and renamed.

        Parameters
        ----------
        path : path
            Ends in .vtkhdf (or .h5, .hdf).
        overwrite : bool
            Whether a file of that name is replaced.
        frames : int or array_like, optional
            How many of the run's times, or which times in s, become frames for
            ParaView; 1000 where there are more. All else is kept at all `times`.

        Returns
        -------
        Path
            `path`.

        Raises
        ------
        ArgumentError
            For another suffix, frames outside the run, or things of other
            packages in the scene that have no form in a file.
        OutputError
            If the file exists and is not to be overwritten, or cannot be
            written. What was there stays as it was.
        """
        from vofem.io.storage.run_file import save

        return save(self, path, overwrite=overwrite, frames=frames)

    @cached_property
    def energy(self) -> Energy:
        """Energies at `times`."""
        parts = self.solution.energies(self.times)
        start = self.solution.start_energy
        return Energy(parts.kinetic, parts.strain, parts.contact, parts.dissipated, parts.work, start)
