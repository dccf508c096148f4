"""Equilibria with contact: one, and a path of them under a load that changes slowly."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import number, series
from vofem.arrays import Array
from vofem.assembly import Model
from vofem.errors import ArgumentError, ConvergenceError, LimitLoadError, VofemError
from vofem.integrators.stepping.energies import contact_energy, strain_energy
from vofem.kernels.choice import by_need
from vofem.scene import Scene, as_scene
from vofem.statics.outcome import ContactPath, Equilibrium, QuasiStatic, SpringPath, StaticContact
from vofem.statics.solver import EquilibriumSolver, check_held, solver_of
from vofem.system import CLOSED, OPEN, PINNED, System, refuse_travelling


def equilibrium(scene: Scene, t: float = 0.0) -> Equilibrium:
    """Return the static equilibrium of a scene under its loads at time t.

    Under ``acts_on="displacement"`` there are loads for which the contact is in equilibrium neither open nor closed. It
    then rests exactly at its gap: its status is "pinned", and its reaction is returned. Dampers and springpots carry no
    constant force and are left out.

    Parameters
    ----------
    scene : Scene
        The scene.
    t : float
        Time in s at which the loads are taken.

    Raises
    ------
    SingularSystemError
        If the structure, held by its supports and by the contacts that carry load, can still move freely.
    """
    t = number("equilibrium: t", t)
    return _equilibrium(as_scene("equilibrium", scene), t)


@by_need("statics")
def _equilibrium(scene: Scene, t: float) -> Equilibrium:
    model = scene.model
    system = model.system
    _refuse("equilibrium", system, path=False)
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


def _refuse(what: str, system: System, path: bool) -> None:
    """Raise where statics cannot treat a system, alone or along a load path."""
    refuse_travelling(what, system)
    for group in system.laws:
        reason = group.statics_refusal(path)
        if reason is not None:
            raise ArgumentError(reason)


#: A spring that bears more than this fraction of its limit load has reached it.
_AT_LIMIT = 1.0 - 1e-12


def quasi_static(scene: Scene, load_factors: ArrayLike) -> QuasiStatic:
    """Return the equilibria of a scene along a path of loads, hysteretic springs and contacts together.

    The path begins in the equilibrium without load, with springs that were never loaded before. From one factor to the
    next all elongations are taken to change monotonically. So give every turning point of the load, and factors between
    them where springs and contacts interact. The load changes infinitely slowly: dampers and springpots carry no force
    and are left out. The work of the loads is compared with the energy that bodies, springs and contacts store and
    dissipate; `notes` of the outcome says where they differ, and where factors between those that are given would
    change the forces of springs.

    Parameters
    ----------
    scene : Scene
        The scene.
    load_factors : array_like, shape (n_factors,)
        Factors that multiply the values of all loads at t = 0.

    Returns
    -------
    QuasiStatic
        Displacements, contacts and springs at each factor.

    Raises
    ------
    ArgumentError
        For factors that are not numbers, loads that are zero at t = 0, nonlinear springs, resolved switches.
    LimitLoadError
        If the load reaches the limit load of a softening spring.
    SingularSystemError
        If the structure can move freely.
    """
    factors = series("quasi_static: load_factors", load_factors)
    model = as_scene("quasi_static", scene).model
    system = model.system
    _refuse("quasi_static", system, path=True)
    force = system.force(0.0)
    if not np.any(force):
        what = f"the loads, {system.loads[0].name} first, are zero" if system.loads else "the scene has no loads"
        raise ArgumentError(
            f"quasi_static: {what} at t = 0, whose values the load factors multiply; use a constant load such as "
            "PointLoad(point, 1.0)"
        )
    if system.driven is not None:
        return _driven(model, float(force[0]) * factors, factors)
    if not any(group.static for group in system.laws):
        return _linear(model, force, factors)
    outcome = _path(model, force, factors)
    outcome.notes += _turning_notes(outcome, model, force)
    return outcome


@by_need("statics")
def _linear(model: Model, force: Array, factors: Array) -> QuasiStatic:
    check_held(model, None)
    q = solver_of(model.system)(force)
    states = q[:, None] * factors
    notes = work_notes(factors, force @ states, taken(model.system, states, np.zeros((2, 0, factors.size))))
    return QuasiStatic(model, factors, states, {}, {}, 0, np.zeros(0), notes)


def _driven(model: Model, forces: Array, factors: Array) -> QuasiStatic:
    """Return the path of a law that the applied forces drive; energies are those of the chords between its points."""
    law = model.system.driven
    xi, stored = law.path(forces, factors), law.stored(forces)
    way, pull = np.diff(xi, prepend=0.0), np.concatenate([[0.0], forces])
    work = np.cumsum(0.5 * (pull[1:] + pull[:-1]) * way)
    springs = {law.name: SpringPath(xi, forces, stored, work - stored)}
    notes = printed_notes(law.name, factors, work - stored)
    return QuasiStatic(model, factors, xi[None, :], {}, springs, 0, np.zeros(0), notes)


@by_need("statics")
def _path(model: Model, force: Array, factors: Array) -> QuasiStatic:
    system = model.system
    solver = EquilibriumSolver(system, force)
    check_held(model, solver.rows.toarray())
    # Without load preloaded stops push what is held out of the undeformed state; what is loose has no place there.
    preloaded = solver.pushes()
    steps = np.concatenate([[0.0], factors]) if preloaded and not system.rigid.shape[1] else factors
    n, m = steps.size, solver.u.size
    q, u, reactions = np.empty((system.size, n)), np.empty((m, n)), np.empty((m, n))
    status = np.empty((m, n), dtype=np.int64)
    energies = np.zeros((2, m, n))
    for k, factor in enumerate(steps.tolist()):
        status[:, k], reactions[:, k], found = solver.solve(factor)
        _check_limit(model, solver, reactions[:, k], factor, force, found)
        if not found:
            raise ConvergenceError(
                f"quasi_static: no equilibrium was found at load factor {factor:g} after {solver.iterations} steps; "
                f"stiffnesses of {solver.stiffness.min():g} to {solver.stiffness.max():g} N/m may differ too much"
            )
        check_held(model, solver.bearing(status[:, k]))
        u[:, k], q[:, k] = solver.u, solver.displacement(factor, reactions[:, k])
        reactions[:, k] = solver.borne(reactions[:, k])
        energies[:, :, k] = solver.accept()
    way, energy = force @ q, taken(system, q, energies)
    begin = (way[0], energy[0]) if preloaded else (0.0, 0.0)
    path = slice(n - factors.size, n)
    q, u, reactions, status, energies = q[:, path], u[:, path], reactions[:, path], status[:, path], energies[..., path]
    contacts, springs = {}, {}
    for group in solver.groups:
        first = solver.part(group).start
        for j, name in enumerate(group.names, first):
            if group is system.contacts:
                contacts[name] = ContactPath(
                    reactions[j], status[j] == CLOSED, status[j] == PINNED, u[j] - system.contacts.gap[j - first]
                )
            elif group.recorded:
                springs[name] = SpringPath(u[j], reactions[j], energies[0, j], energies[1, j])
    notes = work_notes(factors, way[path], energy[path], begin)
    return QuasiStatic(model, factors, q, contacts, springs, solver.iterations, solver.laws.state, notes)


def _check_limit(model: Model, solver: Any, pulls: Array, factor: float, force: Array, found: bool) -> None:
    """Raise where a law has reached its limit load and nothing else holds the structure."""
    over = np.abs(pulls) >= _AT_LIMIT * solver.limits
    if not np.any(over):
        return
    if found and not model.system.rigid.shape[1]:
        return
    j = int(np.argmax(over))
    label = [label for group in solver.groups for label in group.labels][j]
    unit = [unit for group in solver.groups for unit in group.units()][j]
    limit, load = float(solver.limits[j]), factor * float(force[np.argmax(np.abs(force))])
    raise LimitLoadError(
        f"{label}: the load reaches {load:.6g} N at load factor {factor:g}, where the spring bears its limit "
        f"load of {limit:.6g} {unit}, and no equilibrium exists beyond it. Load it less, or change its softening",
        load, factor, limit,
    )  # fmt: skip


#: Missing energy, over the largest energy, above which there is a note.
_WORTH = 1e-6

#: Change of a spring's force by further load factors, over its largest force, above which there is a note.
_TURNED = 1e-3


def taken(system: System, q: Array, energies: Array) -> Array:
    """Return the energy in J stored and dissipated by bodies, springs and contacts at each factor, (n_factors,).

    `q` has shape (n, n_factors).
    `energies` (shape (2, m, n_factors)): energy stored and energy dissipated by laws with internal variables, J.
    """
    times = np.zeros(q.shape[1])
    whole = strain_energy(system, q, times) + contact_energy(system.contacts, q, times) + energies.sum(axis=(0, 1))
    return np.asarray(whole)


def work_notes(factors: Array, way: Array, energy: Array, begin: tuple[float, float] = (0.0, 0.0)) -> list[str]:
    """Return a note if the work is not balanced along a path from the equilibrium without load.

    The force of every law rises along rising elongations and falls along falling ones. The same holds for the load over
    the displacement on which it does work. The work of a step therefore lies between the products of this displacement
    with the load at the two ends of the step. A wrong equilibrium lies outside these bounds.

    `factors` has shape (n_factors,).
    `way` (shape (n_factors,)): product of the load vector at factor 1 with the displacements, J.
    `energy` (shape (n_factors,)): energy stored and dissipated, J.
    `begin`: both without load, J.
    """
    starts = zip((0.0, *begin), (factors, way, energy), strict=True)
    load, far, held = (np.concatenate([[start], part]) for start, part in starts)
    ends = np.diff(far) * np.stack([load[:-1], load[1:]])
    gained = np.diff(held)
    off = np.maximum(ends.min(axis=0) - gained, gained - ends.max(axis=0))
    scale = float(max(np.max(np.abs(held)), np.max(np.abs(load * far))))
    worst = int(np.argmax(off))
    if not off[worst] > _WORTH * scale:
        return []
    return [
        f"energy: from load factor {load[worst]:g} to {load[worst + 1]:g} bodies, springs and contacts take "
        f"{gained[worst]:.4g} J, while the loads' work lies between {ends[:, worst].min():.4g} and "
        f"{ends[:, worst].max():.4g} J: rounding has spoilt an equilibrium there, or a law's force falls while its "
        "elongation rises; make stiff parts less stiff, or check the laws"
    ]


def _turning_notes(outcome: QuasiStatic, model: Model, force: Array) -> list[str]:
    """Return a note if elongations turn between two load factors: the same path with twice as many factors tells it."""
    if not outcome.springs or len(outcome.springs) + len(outcome.contacts) < 2:
        return []  # The elongation of one law follows the load.
    factors = outcome.load_factors
    halfway = 0.5 * (np.concatenate([[0.0], factors[:-1]]) + factors)
    try:
        finer = _path(model, force, np.stack([halfway, factors], axis=1).ravel())
    except VofemError:
        return []
    off, worst, name = 0.0, 0, ""
    for spring, path in outcome.springs.items():
        forces = finer.springs[spring].force
        largest, apart = float(np.max(np.abs(forces))), np.abs(forces[1::2] - path.force)
        if np.max(apart) > off * largest:
            off, worst, name = float(np.max(apart)) / largest, int(np.argmax(apart)), spring
    if not off > _TURNED:
        return []
    return [
        f"path: with a load factor more in every step the force of spring {name!r} at load factor "
        f"{factors[worst]:g} differs by {off:.2g} of its largest force: an elongation turns between two factors, such "
        "as where a contact closes or another spring yields; give more factors"
    ]


def printed_notes(name: str, factors: Array, lost: Array) -> list[str]:
    """Return a note if the law of Eq. 22 returns energy that it had dissipated; energies in J, shape (n_factors,)."""
    steps = np.diff(lost, prepend=0.0)
    worst = int(np.argmin(steps))
    if not steps[worst] < -_WORTH * float(np.max(np.abs(lost))):
        return []
    before = factors[worst - 1] if worst else 0.0
    return [
        f"energy: from load factor {before:g} to {factors[worst]:g} HystereticSpring {name!r} gives back "
        f"{-steps[worst]:.4g} J that it had dissipated, as Eqs. 22-25 forget the residual elongation when the load "
        "rises again; memory='cyclic' remembers it"
    ]
