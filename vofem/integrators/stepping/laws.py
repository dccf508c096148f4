"""Scalar laws on rows in compiled form: forces at a displacement, and mean forces over a step.

Every law is a force over a monotone path of its coordinate from u0 to u1; that
of a spring with memory depends on its state at u0 too. The
mean force over the path, work over length, is the discrete gradient of the
law's potential: a step that uses it conserves energy whatever its size. All
laws of contacts are monotone in u1, so a step has one solution.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.errors import MethodError
from vofem.integrators.stepping.backbone import Memory
from vofem.integrators.stepping.callbacks import Callbacks, call
from vofem.integrators.stepping.memory import build_memory, commit_all, memory_force, memory_mean
from vofem.integrators.stepping.refusal import follows_the_force
from vofem.integrators.stepping.resolved import resolved_force, resolved_integrals
from vofem.linalg.jit import jit
from vofem.system import System

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Kinds of laws, those of contacts first.
PENETRATION, JUMP, RESOLVED, SMOOTH, MEMORY, AFFINE = 0, 1, 2, 3, 4, 5

#: Width, as a fraction of the gap, over which the jump of a contact that acts on the displacement is spread.
_RAMP = 1e-12

_GAUSS = np.sqrt(0.6)

#: For systems without laws that remember.
_NOTHING = build_memory(())[0]


#: Of a law: its kind; gap, offset, stiffness, damping and resolution as in `ContactLaws`, zeros for other laws; the
#: addresses of force and potential of a smooth law. An affine law, that of a springpot over one step, is
#: ``offset + stiffness (u - gap)``. A record costs a compiled loop one pointer where arrays would each be counted.
RECORD = np.dtype(
    [(name, np.int64) for name in ("kind", "force", "potential")]
    + [(name, np.float64) for name in ("gap", "offset", "stiffness", "damping", "resolution")]
)


class Laws(NamedTuple):
    """One law a row: contacts, nonlinear springs, springpots, springs with memory.

    Attributes
    ----------
    table : ndarray of RECORD, shape (n_laws,)
    memory : Memory
        The laws of the last rows.
    state : ndarray
        Of the laws with memory, at the start of a step.
    """

    table: NDArray[np.void]
    memory: Memory
    state: Array


def build_laws(system: System, callbacks: Callbacks | None) -> Laws:
    """Return the laws of a system: those of springs with memory without a past, of springpots without a force.

    Raises
    ------
    MethodError
        For the law that is printed in the paper, which the applied force drives.
    """
    reason = follows_the_force(system)
    if reason is not None:
        raise MethodError(reason)
    contacts = system.contacts
    smooth = 0 if callbacks is None else callbacks.addresses.shape[0]
    count = 0 if contacts is None else len(contacts)
    pasts = () if system.memory is None else system.memory.laws
    memory, state = build_memory(pasts) if pasts else (_NOTHING, np.zeros(0))
    springpots = 0 if system.springpots is None else len(system.springpots.laws)
    size = count + smooth + springpots + len(pasts)
    table = np.zeros(size, dtype=RECORD)
    table["kind"], table["resolution"] = SMOOTH, np.inf
    if contacts is not None:
        part = table[:count]
        part["kind"] = np.where(np.isfinite(contacts.resolution), RESOLVED, np.where(contacts.jump, JUMP, PENETRATION))
        for name in ("gap", "offset", "stiffness", "damping", "resolution"):
            part[name] = getattr(contacts, name)
    if callbacks is not None:
        part = table[count : count + smooth]
        part["force"], part["potential"] = callbacks.addresses.T
    table["kind"][count + smooth : size - len(pasts)] = AFFINE
    table["kind"][size - len(pasts) :] = MEMORY
    return Laws(table, memory, state)


def loaded(laws: Laws, u: Array, past: Array | None) -> Laws:
    """Return laws whose springs with memory come from a past to the elongations u at the start; nothing is lost yet."""
    if laws.state.size:
        if past is not None:
            laws.state[:] = past
        commit_all(laws.memory, laws.state, u)
        laws.state[laws.memory.table["start"]] = 0.0
    return laws


def with_state(laws: Laws, state: Array) -> Laws:
    """Return the same laws with another array as their memory."""
    return laws._replace(state=state) if state.size else laws


@jit
def place_in_memory(laws: Laws, j: int) -> int:
    """Return the number of law j among those with memory."""
    return j - (laws.table.size - laws.memory.table.size)


@jit
def end_force(laws: Laws, j: int, u: float) -> tuple[float, float]:
    """Return force and tangent at u, contact dampers left out."""
    law = laws.table[j]
    if law["kind"] >= SMOOTH:
        if law["kind"] == AFFINE:
            return law["offset"] + law["stiffness"] * (u - law["gap"]), law["stiffness"]
        if law["kind"] == MEMORY:
            return memory_force(laws.memory, laws.state, place_in_memory(laws, j), u)
        width, force = 1e-6 * max(1.0, abs(u)), law["force"]
        return call(force, u), (call(force, u + width) - call(force, u - width)) / (2.0 * width)
    return _contact_force(law, u)


@jit
def _contact_force(law: Any, u: float) -> tuple[float, float]:
    gap, k = law["gap"], law["stiffness"]
    s = u - gap
    if s <= 0.0:
        return 0.0, 0.0
    if law["kind"] == PENETRATION:
        return k * s, k
    if law["kind"] == JUMP:
        ramp = _RAMP * gap
        if s >= ramp:
            return k * u, k
        steep = k * (gap + ramp) / ramp
        return steep * s, steep
    force, tangent = resolved_force(s, law["resolution"], gap - law["offset"])
    return k * force, k * tangent


@jit
def closed_share(laws: Laws, j: int, u0: float, u1: float) -> float:
    """Return the length of the path from u0 to u1 on which a contact's damper acts, with its sign."""
    law = laws.table[j]
    s0, s1 = max(u0 - law["gap"], 0.0), max(u1 - law["gap"], 0.0)
    if law["kind"] != RESOLVED:
        return s1 - s0
    return resolved_integrals(s0, s1, law["resolution"])[0]


@jit
def mean_force(laws: Laws, j: int, u0: float, u1: float) -> float:
    """Return the mean force over the path from u0 to u1, contact dampers left out."""
    law = laws.table[j]
    if law["kind"] >= SMOOTH:
        if law["kind"] == AFFINE:
            return law["offset"] + law["stiffness"] * (u1 - law["gap"])
        if law["kind"] == MEMORY:
            return memory_mean(laws.memory, laws.state, place_in_memory(laws, j), u0, u1)
        return _smooth_mean(law["force"], law["potential"], u0, u1)
    return _contact_mean(law, u0, u1)


@jit
def _contact_mean(law: Any, u0: float, u1: float) -> float:
    gap, k = law["gap"], law["stiffness"]
    s0, s1 = u0 - gap, u1 - gap
    if s0 <= 0.0 and s1 <= 0.0:
        return 0.0
    lever = gap - law["offset"]
    if law["kind"] == RESOLVED:
        if s0 == s1:
            return k * resolved_force(s0, law["resolution"], lever)[0]
        plain, weighted = resolved_integrals(max(s0, 0.0), max(s1, 0.0), law["resolution"])
        return k * (weighted + lever * plain) / (s1 - s0)
    ramp = _RAMP * gap if law["kind"] == JUMP else 0.0
    if s0 >= ramp and s1 >= ramp:
        return k * (0.5 * (s0 + s1) + lever)
    if s0 == s1:
        return _contact_force(law, u0)[0]
    return k * (_height(s1, ramp, lever) - _height(s0, ramp, lever)) / (s1 - s0)


@jit
def _height(s: float, ramp: float, lever: float) -> float:
    """Return the potential of an ideal switch over its stiffness, m^2."""
    if s <= 0.0:
        return 0.0
    if s < ramp:
        return 0.5 * s * s * (lever + ramp) / ramp
    return s * (0.5 * s + lever) - 0.5 * lever * ramp


@jit
def _smooth_mean(force: int, potential: int, u0: float, u1: float) -> float:
    """Return the mean of a smooth force: by its potential over long paths, else by quadrature, which keeps digits."""
    if abs(u1 - u0) > 1e-3 * max(abs(u0), abs(u1)):
        return (call(potential, u1) - call(potential, u0)) / (u1 - u0)
    middle, reach = 0.5 * (u0 + u1), 0.5 * (u1 - u0) * _GAUSS
    return (5.0 * call(force, middle - reach) + 8.0 * call(force, middle) + 5.0 * call(force, middle + reach)) / 18.0


@jit
def mean_and_slope(laws: Laws, j: int, u0: float, u1: float) -> tuple[float, float]:
    """Return the mean force over the path from u0 to u1 and its derivative by u1."""
    law = laws.table[j]
    kind = law["kind"]
    mean = mean_force(laws, j, u0, u1)
    if kind in (PENETRATION, JUMP):
        s0, s1 = u0 - law["gap"], u1 - law["gap"]
        ramp = _RAMP * law["gap"] if kind == JUMP else 0.0
        if s0 >= ramp and s1 >= ramp:
            return mean, 0.5 * law["stiffness"]
        if s0 <= 0.0 and s1 <= 0.0:
            return mean, 0.0
        force, tangent = _contact_force(law, u1)
        return mean, (force - mean) / (u1 - u0) if u1 != u0 else 0.5 * tangent
    if kind == AFFINE:
        return mean, law["stiffness"]
    force, tangent = end_force(laws, j, u1)
    if abs(u1 - u0) <= 1e-6 * max(abs(u0), abs(u1)):
        return mean, 0.5 * tangent
    return mean, (force - mean) / (u1 - u0)
