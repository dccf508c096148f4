"""The laws of a system in compiled loops: force, mean force over a step, energy, loss, and the commit of a step.

A law gives the force along a monotone path of its coordinate from u0 to u1.
The force of a law with internal variables also depends on their values at u0.
The mean force over the path is the work divided by the length of the path. This
is the discrete gradient of the law's potential, so a step that uses it conserves
energy whatever its size. The forces of contacts are monotone in u1, so a step
has one solution.

This is the only module that asks for the kind of a law. The formulas are in the
module of each law.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.kernels.jit import jit
from vofem.laws.callbacks import COMMIT, FORCE, LOSS, MEAN, STORED, TANGENT, call
from vofem.laws.called import call_law
from vofem.laws.contact import contact_force, contact_kinks, contact_mean, contact_share, damper_path, ideal_mean_slope
from vofem.laws.group import CLOSED, LawGroup
from vofem.laws.hysteretic import (
    DISSIPATED,
    commit_slopes,
    force_slopes,
    hysteretic_commit,
    hysteretic_force,
    hysteretic_kinks,
    hysteretic_loss,
    hysteretic_mean,
    hysteretic_stored,
)
from vofem.laws.kinds import AFFINE, CALLED, CALLED_WITH_PAST, HYPERBOLIC, JUMP, RESOLVED
from vofem.laws.resolved import switch
from vofem.laws.table import Laws, Way

Array = NDArray[np.float64]


@jit
def force_and_tangent(laws: Laws, j: int, u: float) -> tuple[float, float]:
    """Return force and tangent at u, without contact dampers."""
    kinds = laws.kinds
    return _force_and_tangent(laws, kinds.resolved, kinds.affine, kinds.called, kinds.hysteretic, j, u)


@jit
def _force_and_tangent(
    laws: Laws, resolved: bool | None, affine: bool | None, called: bool | None, hysteretic: bool | None, j: int,
    u: float,
) -> tuple[float, float]:  # fmt: skip
    """Return force and tangent at u. The kinds are arguments so that numba leaves out those that are None."""
    law = laws.table[j]
    if called is not None and law["kind"] == CALLED_WITH_PAST:
        return call_law(laws, j, FORCE, u, u), call_law(laws, j, TANGENT, u, u)
    if hysteretic is not None and law["kind"] >= HYPERBOLIC:
        return hysteretic_force(laws, j, u)
    if called is not None and law["kind"] == CALLED:
        return call(law["address"], FORCE, u, u), call(law["address"], TANGENT, u, u)
    if affine is not None and law["kind"] == AFFINE:
        return law["offset"] + law["stiffness"] * (u - law["gap"]), law["stiffness"]
    return contact_force(law, resolved, u)


@jit
def forces_along(laws: Laws, j: int, u: Array, force: Array, tangent: Array) -> None:
    """Enter forces and tangents at some coordinates.

    Each coordinate is reached on a monotone path from the state of the internal variables.
    """
    for i in range(u.size):
        force[i], tangent[i] = force_and_tangent(laws, j, u[i])


@jit
def force_at(laws: Laws, j: int, u: float) -> float:
    """Return the force at u alone."""
    return _force_at(laws, laws.kinds.called, j, u)


@jit
def _force_at(laws: Laws, called: bool | None, j: int, u: float) -> float:
    if called is not None and laws.table[j]["kind"] == CALLED:
        return call(laws.table[j]["address"], FORCE, u, u)
    return force_and_tangent(laws, j, u)[0]


@jit
def mean_force(laws: Laws, j: int, u0: float, u1: float) -> float:
    """Return the mean force over the path from u0 to u1, without contact dampers."""
    kinds = laws.kinds
    return _mean_force(laws, kinds.resolved, kinds.affine, kinds.called, kinds.hysteretic, j, u0, u1)


@jit
def _mean_force(
    laws: Laws, resolved: bool | None, affine: bool | None, called: bool | None, hysteretic: bool | None, j: int,
    u0: float, u1: float,
) -> float:  # fmt: skip
    law = laws.table[j]
    if called is not None and law["kind"] == CALLED_WITH_PAST:
        return call_law(laws, j, MEAN, u0, u1)
    if hysteretic is not None and law["kind"] >= HYPERBOLIC:
        return hysteretic_mean(laws, j, u0, u1)
    if called is not None and law["kind"] == CALLED:
        return call(law["address"], MEAN, u0, u1)
    if affine is not None and law["kind"] == AFFINE:
        # Both ends are measured from the gap: the gap of a springpot is u0, so its mean force loses no digits.
        return law["offset"] + 0.5 * law["stiffness"] * ((u0 - law["gap"]) + (u1 - law["gap"]))
    return contact_mean(law, resolved, u0, u1)


@jit
def mean_and_slope(laws: Laws, j: int, u0: float, u1: float) -> tuple[float, float]:
    """Return the mean force over the path from u0 to u1 and its derivative by u1."""
    law = laws.table[j]
    mean = mean_force(laws, j, u0, u1)
    if law["kind"] <= JUMP:
        return mean, ideal_mean_slope(law, u0, u1, mean)
    kinds = laws.kinds
    return mean, _mean_slope(laws, kinds.resolved, kinds.affine, kinds.called, kinds.hysteretic, j, u0, u1, mean)


@jit
def _mean_slope(
    laws: Laws, resolved: bool | None, affine: bool | None, called: bool | None, hysteretic: bool | None, j: int,
    u0: float, u1: float, mean: float,
) -> float:  # fmt: skip
    """Return the derivative of the mean force of a law that is no contact with an ideal switch."""
    if resolved is None and called is None and hysteretic is None:
        return 0.5 * laws.table[j]["stiffness"]
    if affine is not None and laws.table[j]["kind"] == AFFINE:
        return 0.5 * laws.table[j]["stiffness"]
    force, tangent = force_and_tangent(laws, j, u1)
    if abs(u1 - u0) <= 1e-6 * max(abs(u0), abs(u1)):
        return 0.5 * tangent
    return (force - mean) / (u1 - u0)


@jit
def respond(
    laws: Laws, others: bool | None, j: int, way: Way, u0: float, u1: float, before: float
) -> tuple[float, float]:  # fmt: skip
    """Return the force of law j over a step from u0 to u1, and its slope over u1; not for explicit steps.

    Parameters
    ----------
    laws : Laws
    others : True or None
        None where all laws are contacts with ideal switches and without dampers.
    j : int
    way : Way
    u0, u1 : float
        Coordinates at the start and at the end of the step, m.
    before : float
        Mean force of the law's damper over the step before, N.
    """
    if others is not None:
        force, slope = mean_and_slope(laws, j, u0, u1) if way.mean else force_and_tangent(laws, j, u1)
        if laws.table[j]["damping"] > 0.0 and u1 > laws.table[j]["gap"]:
            slope += way.now * laws.table[j]["damping"] / way.dt
        return force + _damper(laws, j, way, u0, u1, 0.0, before), slope
    law = laws.table[j]
    if way.mean:
        mean = contact_mean(law, None, u0, u1)
        return mean, ideal_mean_slope(law, u0, u1, mean)
    return contact_force(law, None, u1)


@jit
def force_over(
    laws: Laws, others: bool | None, j: int, way: Way, u0: float, u1: float, r1: float, before: float
) -> float:  # fmt: skip
    """Return the force of `respond` alone; in explicit steps that at the end, where the rate is r1, m/s."""
    if others is not None:
        force = mean_force(laws, j, u0, u1) if way.mean else force_at(laws, j, u1)
        return force + _damper(laws, j, way, u0, u1, r1, before)
    return contact_mean(laws.table[j], None, u0, u1) if way.mean else contact_force(laws.table[j], None, u1)[0]


@jit
def _damper(laws: Laws, j: int, way: Way, u0: float, u1: float, r1: float, before: float) -> float:
    """Return the force of the damper of a law in the balance of a step."""
    if laws.table[j]["damping"] <= 0.0:
        return 0.0
    force = damper_over(laws, j, way, u0, u1, r1)
    return force if way.explicit else way.now * force - way.before * before


@jit
def damper_over(laws: Laws, j: int, way: Way, u0: float, u1: float, r1: float) -> float:
    """Return the mean force of the damper of law j over a step in N, or in explicit steps the force at its end."""
    law = laws.table[j]
    if law["damping"] <= 0.0:
        return 0.0
    if not way.explicit:
        return law["damping"] / way.dt * closed_share(laws, j, u0, u1)
    if law["kind"] > RESOLVED:
        return law["damping"] * r1
    s = u1 - law["gap"]
    if law["kind"] == RESOLVED:
        return law["damping"] * switch(law["resolution"] * s) * r1
    return law["damping"] * r1 if s > 0.0 else 0.0


@jit
def tangent_jumps(laws: Laws, j: int) -> bool:
    """Return whether the tangent of a law may jump within a step: contacts, and laws with internal variables."""
    kind = laws.table[j]["kind"]
    return kind <= RESOLVED or kind >= HYPERBOLIC


@jit
def closed_share(laws: Laws, j: int, u0: float, u1: float) -> float:
    """Return the length of the path from u0 to u1 on which a contact's damper acts, with its sign."""
    return damper_path(laws.table[j], laws.kinds.resolved, u0, u1)


@jit
def stored(laws: Laws, j: int, u: float) -> float:
    """Return the recoverable energy in J that a law with internal variables stores at u."""
    return _stored(laws, laws.kinds.called, j, u)


@jit
def _stored(laws: Laws, called: bool | None, j: int, u: float) -> float:
    if called is not None and laws.table[j]["kind"] == CALLED:
        return call(laws.table[j]["address"], STORED, u, u)
    if called is not None and laws.table[j]["kind"] == CALLED_WITH_PAST:
        return call_law(laws, j, STORED, u, u)
    return hysteretic_stored(laws, j, u)


@jit
def dissipated(laws: Laws, j: int, u: float) -> float:
    """Return the energy in J that a law with internal variables has dissipated when its path has reached u."""
    return laws.state[laws.table[j]["start"] + DISSIPATED] + _loss(laws, laws.kinds.called, j, u)


@jit
def _loss(laws: Laws, called: bool | None, j: int, u: float) -> float:
    """Return the energy in J that is dissipated on the path to u."""
    if called is not None and laws.table[j]["kind"] == CALLED_WITH_PAST:
        return call_law(laws, j, LOSS, u, u)
    return hysteretic_loss(laws, j, u)


@jit
def commit(laws: Laws, j: int, u: float) -> None:
    """Update the internal variables of law j to the end u of its path."""
    _commit(laws, laws.kinds.called, j, u)


@jit
def _commit(laws: Laws, called: bool | None, j: int, u: float) -> None:
    if called is not None and laws.table[j]["kind"] == CALLED_WITH_PAST:
        laws.state[laws.table[j]["start"] + DISSIPATED] += call_law(laws, j, LOSS, u, u)
        call_law(laws, j, COMMIT, u, u)
    else:
        hysteretic_commit(laws, j, u)


@jit
def commit_all(laws: Laws, u: Array) -> None:
    """Update the internal variables of all laws to the ends u of their paths."""
    _commit_all(laws, laws.kinds.hysteretic, u)


@jit
def _commit_all(laws: Laws, hysteretic: bool | None, u: Array) -> None:
    if hysteretic is not None:
        for j in range(u.size):
            if laws.table[j]["kind"] >= HYPERBOLIC:
                commit(laws, j, u[j])


def response(group: LawGroup, laws: Laws, first: int, u: Array, width: float) -> tuple[Array, Array, NDArray[np.int64]]:
    """Return reaction (N), tangent (N/m) and status of the laws of a group at u, each (n_laws,).

    The laws of the group are those from `first` on. Jumps are spread over a width, a fraction of their gap.
    """
    known = group.respond(u, width)
    if known is not None:
        return known
    found = [force_and_tangent(laws, first + i, x) for i, x in enumerate(u.tolist())]
    reaction, tangent = np.array(found).reshape(-1, 2).T
    return reaction, tangent, np.full(u.size, CLOSED, dtype=np.int64)


def loaded(laws: Laws, u: Array, past: Array | None) -> Laws:
    """Return the laws at the start of a run: internal variables as given, coordinates u, nothing dissipated yet."""
    if laws.state.size:
        if past is not None:
            laws.state[:] = past
        commit_all(laws, u)
        laws.state[laws.table["start"][laws.table["kind"] >= HYPERBOLIC]] = 0.0
    return laws


def curve(group: LawGroup, laws: Laws, j: int, index: int, u: Array, tangents: bool = True) -> tuple[Array, Array]:
    """Return forces (N) and tangents (N/m) at coordinates u of law j among all, which has an index in its group."""
    known = group.curve(index, u, tangents)
    if known is not None:
        return known
    force, tangent = np.empty(u.size), np.empty(u.size)
    forces_along(laws, j, u, force, tangent)
    return force, tangent


def kinks(laws: Laws, j: int) -> list[float]:
    """Return the coordinates at which force or tangent jumps on paths from the state of the internal variables.

    A law that has kinks and no internal variables exerts no force below the first one.
    """
    law = laws.table[j]
    if law["kind"] <= RESOLVED:
        return contact_kinks(law)
    return hysteretic_kinks(laws, j) if law["kind"] >= HYPERBOLIC else []


def jumps(laws: Laws, j: int) -> tuple[float, float]:
    """Return the jumps of the spring force (N) and of the damper (N s/m) of law j at its first kink, as u rises."""
    law = laws.table[j]
    if law["kind"] == RESOLVED:
        return 0.0, 0.0
    return float(law["stiffness"] * law["gap"]) if law["kind"] == JUMP else 0.0, float(law["damping"])


def switched_on(laws: Laws, j: int, u: Array) -> tuple[Array, Array]:
    """Return how far the damper of law j is switched on at u beyond its first kink, and the derivative of that by u."""
    law = laws.table[j]
    if law["kind"] != RESOLVED:
        return np.ones(u.size), np.zeros(u.size)
    return contact_share(law, u)


def past_slopes(laws: Laws, j: int, u: float) -> tuple[Array, Array, Array]:
    """Return how force and internal variables at u depend on the internal variables at the start of the path, and on u.

    Returns
    -------
    force : ndarray, shape (k,)
        Derivative of the force by the k internal variables, energy first.
    past, end : ndarray, shape (k, k) and (k,)
        Derivatives of the internal variables after `commit` by those before, and by u.
    """
    return (force_slopes(laws, j, u), *commit_slopes(laws, j, u))


def may_jump(laws: Laws) -> bool:
    """Return whether the tangent of any law may jump."""
    return any(tangent_jumps(laws, j) for j in range(laws.table.size))


def rising(laws: Laws) -> bool:
    """Return whether no force jumps or falls as its coordinate rises. For laws written in Python this is not known."""
    kind = laws.table["kind"]
    return not np.any((kind == CALLED) | ((kind == JUMP) & (laws.table["gap"] > 0.0)))


def ideal_contacts(laws: Laws) -> bool:
    """Return whether all laws are contacts with ideal switches and without dampers."""
    return bool(np.all((laws.table["kind"] <= JUMP) & (laws.table["damping"] <= 0.0)))
