"""Static equilibrium with contact."""

from __future__ import annotations

import numpy as np

from vofem._validate import number
from vofem.errors import ArgumentError, ConvergenceError
from vofem.kernels.choice import by_need
from vofem.scene import Scene, as_scene
from vofem.statics.outcome import Equilibrium, StaticContact
from vofem.statics.solver import EquilibriumSolver, check_held, solver_of
from vofem.system import CLOSED, OPEN, PINNED, refuse_travelling


def equilibrium(scene: Scene, t: float = 0.0) -> Equilibrium:
    """Return the static equilibrium of a scene under its loads at time t.

    Under ``acts_on="displacement"`` there are loads for which the contact is in
    equilibrium neither open nor closed. It then rests exactly at its gap: its
    status is "pinned", and its reaction is returned. Dampers and springpots carry
    no constant force and are left out.

    Parameters
    ----------
    scene : Scene
        The scene.
    t : float
        Time in s at which the loads are taken.

    Raises
    ------
    SingularSystemError
        If the structure, held by its supports and by the contacts that carry
        load, can still move freely.
    """
    t = number("equilibrium: t", t)
    return _equilibrium(as_scene("equilibrium", scene), t)


@by_need("statics")
def _equilibrium(scene: Scene, t: float) -> Equilibrium:
    model = scene.model
    system = model.system
    refuse_travelling("equilibrium", system)
    for group in system.laws:
        reason = group.statics_refusal(path=False)
        if reason is not None:
            raise ArgumentError(reason)
    force = system.force(t)
    if not any(group.static for group in system.laws):
        check_held(model, None)
        return Equilibrium(model, solver_of(system)(force), {}, 0, scene.effects, t)
    solver = EquilibriumSolver(system, force)
    check_held(model, solver.rows.toarray())
    start = np.full(solver.u.size, CLOSED if system.rigid.shape[1] else OPEN)
    status, reaction, found = solver.solve(1.0, start)
    check_held(model, solver.bearing(status))
    laws = system.contacts
    if not found:
        labels = [label for group in solver.groups for label in group.labels]
        raise ConvergenceError(
            f"the equilibrium was not found in {solver.iterations} steps; {', '.join(labels)} with stiffness "
            f"{solver.stiffness.tolist()} N/m may differ too much in magnitude"
        )
    q = solver.displacement(1.0, reaction)
    names = {OPEN: "open", CLOSED: "closed", PINNED: "pinned"}
    contacts = {}
    if laws is not None:
        reaction = solver.borne(reaction)
        for j, name in enumerate(laws.names):
            contacts[name] = StaticContact(float(reaction[j]), names[int(status[j])], float(solver.u[j] - laws.gap[j]))
    return Equilibrium(model, q, contacts, solver.iterations, scene.effects, t)
