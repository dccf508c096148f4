"""A run: the motion of its bodies, and what its contacts, springs, sliders and supports did."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import Named, name_of, unknown
from vofem.effects.two_points import units_of
from vofem.histories.contact import ContactHistory
from vofem.histories.energy import Energy
from vofem.histories.friction import FrictionHistory
from vofem.histories.motion import Motion
from vofem.histories.probe import ProbeHistory
from vofem.histories.reaction import Reaction, state_of
from vofem.histories.spring import SpringHistory
from vofem.integrators.base import ProbeSamples
from vofem.reactions import residual, support_reaction


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
        state = state_of(self, f"reaction of {found.label}", t, self._at(t))
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
        times, *rest = state_of(self, f"force of Joint {name!r}", t, self._at(t))
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
