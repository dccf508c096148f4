"""A run: the motion of its bodies, and what its contacts, springs, sliders and supports did."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import Named, name_of, unknown
from vofem.arrays import Array
from vofem.effects.two_points import units_of
from vofem.errors import ArgumentError
from vofem.histories.contact import ContactHistory
from vofem.histories.friction import FrictionHistory
from vofem.histories.motion import Motion
from vofem.histories.spring import SpringHistory
from vofem.integrators.base import ProbeSamples, Sampled
from vofem.reactions import residual, support_reaction


@dataclass(frozen=True)
class Energy:
    """Energies in J at `Result.times`, each of shape (n_times,).

    Attributes
    ----------
    kinetic, strain : ndarray
        Kinetic energy of bodies; strain energy of bodies and springs, also of hysteretic springs and springpots.
    contact : ndarray
        Energy stored in closed contacts; ``K0 (u^2 - gap^2)/2`` for ``acts_on="displacement"``.
    dissipated : ndarray
        Energy dissipated by dampers, hysteretic springs and springpots since t = 0.
    work : ndarray
        Work done by all loads since t = 0.
    start : float
        Total energy at t = 0.

    Notes
    -----
    `total` is the sum of the first three. `balance` is the energy that is missing,
    and `balance_error` is its largest magnitude divided by the largest energy.

    Between the steps of a stepping method states are interpolated, and the balance there contains the error of the
    interpolation. To see the balance of the method itself, give `times` that lie on steps, or none. Steps that follow
    ``tol=`` have times of their own.
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
        """The energy that is missing from the balance in J: ``total - start + dissipated - work``."""
        return self.total - self.start + self.dissipated - self.work

    @property
    def balance_error(self) -> float:
        """The largest magnitude of `balance`, divided by the largest energy."""
        parts = (self.total, self.dissipated, self.work)
        scale = max((float(np.max(np.abs(part), initial=0.0)) for part in parts), default=0.0)
        return float(np.max(np.abs(self.balance), initial=0.0)) / scale if scale > 0 else 0.0


@dataclass(frozen=True, eq=False)
class ProbeHistory:
    """The motion of a point at every step of a stepping method, or at the times of the run for other methods.

    Attributes
    ----------
    name : str
    times : ndarray, shape (n_steps + 1,)
        Times of the steps in s.
    displacement, velocity, acceleration : ndarray, shape (n_steps + 1,)
        Motion of the point in m, m/s and m/s^2.
    """

    name: str
    times: Array
    displacement: Array
    velocity: Array
    acceleration: Array

    def __repr__(self) -> str:
        return f"ProbeHistory({self.name!r}, {self.times.size} times to {self.times[-1]:g} s)"


class Reaction(NamedTuple):
    """Force in N, positive upward, and moment in N m of a support or a joint on a body, each (n_times,).

    A positive moment does positive work when the slope grows. A force or moment that the support cannot exert is zero.
    """

    force: Array
    moment: Array


class Run(Motion):
    """The motion of a scene with the histories of its parts; each is computed when it is first asked for."""

    recorded: ProbeSamples | None = None  #: Motion of the points that were recorded at every step.

    @cached_property
    def contacts(self) -> Named[ContactHistory]:
        """Contact histories by name."""
        laws = self.model.system.contacts
        if laws is None:
            return Named({})
        units = [units_of(self.scene.effects, label) for label in laws.labels]
        histories = [ContactHistory(self, laws, j, found) for j, found in enumerate(units)]
        return Named({history.name: history for history in histories})

    @cached_property
    def frictions(self) -> Named[FrictionHistory]:
        """Histories of sliders by name; empty if the scene has none."""
        sliders, effects = self.model.system.sliders, self.scene.effects
        laws = () if sliders is None else sliders.laws
        return Named(
            {law.name: FrictionHistory(self, law, j, units_of(effects, law.label)) for j, law in enumerate(laws)},
            "slider",
        )

    @cached_property
    def springs(self) -> Named[SpringHistory]:
        """Histories of hysteretic springs and springpots by name; empty if the scene has none."""
        names = [name for group in self.model.system.recorded for name in group.names]
        return Named({name: SpringHistory(self, j) for j, name in enumerate(names)}, "hysteretic spring")

    @cached_property
    def probes(self) -> Named[ProbeHistory]:
        """Histories of the points of ``simulate(..., probes=)``, by name or by point; empty if none were asked for."""
        record = self.recorded
        parts = () if record is None else zip(record.names, record.q, record.v, record.a, strict=True)
        histories = [ProbeHistory(name, record.times, *motion) for name, *motion in parts] if record else []
        return Named({history.name: history for history in histories}, "probe")

    def reaction(self, body: Any, where: Any, t: ArrayLike | None = None) -> Reaction:
        """Return the force and the moment of a support on a body at `times`, or at times t.

        They are computed from the equations of motion of the supported degrees of freedom, and include inertia and
        damping. They are NaN while a spring, dashpot or mass that travels passes the element beside the support.

        Parameters
        ----------
        body : Body or str
            The body, or its name.
        where : "left", "right" or x
            The place of a support.
        """
        found = self._body(body)
        state = _state_of(self, f"reaction of {found.label}", t, self._at(t))
        return Reaction(*support_reaction(self.model, found, where, *state))

    def joint_force(self, joint: Any, t: ArrayLike | None = None) -> Reaction:
        """Return the force and the moment of a joint on the body of its point a, at `times` or at times t.

        The opposite force and moment act on the body of b.

        Parameters
        ----------
        joint : Joint or str
            The joint, or its name.
        t : array_like, optional
            Times in s.

        Returns
        -------
        Reaction
            Force in N, positive upward, and moment in N m, which is zero in a hinge; each (n_times,).

        Raises
        ------
        ArgumentError
            If there is no joint of that name.
        """
        name, model = name_of(joint), self.model
        counts = dict(model.joints)
        if name not in counts:
            raise unknown("joint", name, counts)
        first = sum(count for known, count in model.joints[: list(counts).index(name)])
        times, *rest = _state_of(self, f"force of Joint {name!r}", t, self._at(t))
        parts = np.zeros((2, times.size))
        for k in range(counts[name]):
            assert model.joint_rows is not None
            parts[k] = residual(model, model.joint_rows[[first + k]], times, *rest)
        return Reaction(*parts)

    @cached_property
    def energy(self) -> Energy:
        """Energies at `times`."""
        parts = self.solution.energies(self.times)
        start = self.solution.start_energy
        return Energy(parts.kinetic, parts.strain, parts.contact, parts.dissipated, parts.work, start)


def _state_of(
    run: Motion, label: str, t: ArrayLike | None, samples: Sampled
) -> tuple[Array, Sampled, list[Array | None], Any]:
    """Return times, the motion, forces of each group of laws (None where they are not known), and modes."""
    times = run.times if t is None else np.atleast_1d(np.asarray(t, dtype=float))
    system, solution = run.model.system, run.solution
    forces: list[Array | None] = []
    recorded = 0
    for group in system.laws:
        if group is system.contacts:
            forces.append(run.contact_samples.force if t is None else solution.contacts(times).force)
        elif group is system.sliders:
            sliding: Any = solution
            forces.append(sliding.friction(times).force)
        elif group.recorded:
            forces.append(_spring_force(run, label, t)[recorded : recorded + len(group)])
            recorded += len(group)
        else:
            known = group.travelling is None
            forces.append(group.reactions(samples.along(group.rows, "q")) if known else None)
    return times, samples, forces, solution.modes if system.modal_damping is not None else None


def _spring_force(run: Motion, label: str, t: ArrayLike | None) -> Array:
    """Return the forces of hysteretic springs, which are known at the run's times only."""
    if t is not None and not np.array_equal(np.atleast_1d(t), run.times):
        raise ArgumentError(
            f"{label}: hysteretic springs know their forces at the run's times; name the times in times= when "
            "simulating"
        )
    springs = run.solution.springs
    assert springs is not None
    return np.asarray(springs.force)
