"""Static equilibrium with contact."""

from __future__ import annotations

import numpy as np

from vofem._validate import number
from vofem.errors import ArgumentError, ConvergenceError
from vofem.scene import Scene, as_scene
from vofem.statics.held import check_held
from vofem.statics.outcome import Equilibrium, StaticContact
from vofem.statics.solver import ContactSolver, solver_of
from vofem.system import CLOSED, OPEN, PINNED


def equilibrium(scene: Scene, t: float = 0.0) -> Equilibrium:
    """Return the static equilibrium of a scene under its loads at time t.

    Under ``acts_on="displacement"`` a load between the open and the closed
    equilibrium pins the contact; it is returned so, with its reaction. Dampers and
    springpots yield to every lasting force, and are left out.

    Parameters
    ----------
    scene : Scene
    t : float
        In s.

    Raises
    ------
    SingularSystemError
        If the structure, held by its supports and by the contacts that carry
        load, can still move freely.
    """
    t = number("equilibrium: t", t)
    model = as_scene("equilibrium", scene).model
    system = model.system
    if system.path_dependent:
        raise ArgumentError(
            f"equilibrium: {system.path_dependent[0].label} has equilibria that depend on the path to them; "
            "use vofem.quasi_static(scene, load_factors)"
        )
    if system.nonlinear is not None:
        raise ArgumentError(
            f"equilibrium: NonlinearSpring {system.nonlinear.laws[0].name!r} may have several equilibria or none; "
            "let a damped simulation settle instead"
        )
    force = system.force(t)
    laws = system.contacts
    if laws is None:
        check_held(model, None)
        return Equilibrium(model, solver_of(system, np.zeros(0))(force), {}, 0, scene.effects, t)
    if not laws.ideal:
        k = int(np.argmax(np.isfinite(laws.resolution)))
        raise ArgumentError(f"equilibrium needs ideal switches; Contact {laws.names[k]!r} has a resolved one")
    check_held(model, laws.rows.toarray())
    solver = ContactSolver(system, laws, force)
    status, iterations, found = solver.solve(np.full(len(laws), CLOSED if system.rigid.shape[1] else OPEN))
    active = status != OPEN
    check_held(model, laws.rows[active].toarray() if np.any(active) else None)
    if not found:
        raise ConvergenceError(
            f"the contact equilibrium was not found in {iterations} steps; contacts {laws.names} with stiffness "
            f"{laws.stiffness.tolist()} N/m may differ too much in magnitude"
        )
    u, reaction = solver.exact(status)
    q = solver.displacement(u, reaction)
    names = {OPEN: "open", CLOSED: "closed", PINNED: "pinned"}
    contacts = {
        name: StaticContact(float(reaction[j]), names[int(status[j])], float(u[j] - laws.gap[j]))
        for j, name in enumerate(laws.names)
    }
    return Equilibrium(model, q, contacts, iterations, scene.effects, t)
