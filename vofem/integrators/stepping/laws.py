"""Scalar laws on rows in compiled form: forces at a displacement, and mean forces over a step.

Every law is a force over a monotone path of its coordinate from u0 to u1; that
of a spring with memory depends on its state at u0 too. The
mean force over the path, work over length, is the discrete gradient of the
law's potential: a step that uses it conserves energy whatever its size. All
laws of contacts are monotone in u1, so a step has one solution.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.errors import MethodError
from vofem.integrators.stepping.backbone import Memory
from vofem.integrators.stepping.callbacks import Callbacks, call
from vofem.integrators.stepping.memory import build_memory, commit_all, memory_force, memory_mean
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


class Laws(NamedTuple):
    """One law a row: contacts, nonlinear springs, springpots, springs with memory.

    Attributes
    ----------
    kind : ndarray of int
    gap, offset, stiffness, damping, resolution : ndarray
        As in `ContactLaws`; zeros for other laws. An affine law, that of a
        springpot over one step, is ``offset + stiffness (u - gap)``.
    address : ndarray of int, shape (n_laws, 2)
        Of force and potential of a smooth law.
    memory : Memory
        The laws of the last rows.
    state : ndarray
        Of the laws with memory, at the start of a step.
    """

    kind: IntArray
    gap: Array
    offset: Array
    stiffness: Array
    damping: Array
    resolution: Array
    address: IntArray
    memory: Memory
    state: Array


def build_laws(system: System, callbacks: Callbacks | None) -> Laws:
    """Return the laws of a system: those of springs with memory without a past, of springpots without a force.

    Raises
    ------
    MethodError
        For the law that is printed in the paper, which the applied force drives.
    """
    if system.printed is not None:
        raise MethodError(
            f"{system.printed.label} with memory='printed' is Eq. 22, which the applied force drives; "
            "method='force_driven' follows it, and methods that step in time take memory='cyclic'"
        )
    contacts = system.contacts
    smooth = 0 if callbacks is None else callbacks.addresses.shape[0]
    count = 0 if contacts is None else len(contacts)
    pasts = () if system.memory is None else system.memory.laws
    memory, state = build_memory(pasts) if pasts else (_NOTHING, np.zeros(0))
    springpots = 0 if system.springpots is None else len(system.springpots.laws)
    size = count + smooth + springpots + len(pasts)
    laws = Laws(
        kind=np.full(size, SMOOTH, dtype=np.int64),
        gap=np.zeros(size),
        offset=np.zeros(size),
        stiffness=np.zeros(size),
        damping=np.zeros(size),
        resolution=np.full(size, np.inf),
        address=np.zeros((size, 2), dtype=np.int64),
        memory=memory,
        state=state,
    )
    if contacts is not None:
        laws.kind[:count] = np.where(np.isfinite(contacts.resolution), RESOLVED, np.where(contacts.jump, JUMP, 0))
        laws.gap[:count], laws.offset[:count] = contacts.gap, contacts.offset
        laws.stiffness[:count], laws.damping[:count] = contacts.stiffness, contacts.damping
        laws.resolution[:count] = contacts.resolution
    if callbacks is not None:
        laws.address[count : count + smooth] = callbacks.addresses
    laws.kind[count + smooth : size - len(pasts)] = AFFINE
    laws.kind[size - len(pasts) :] = MEMORY
    return laws


def loaded(laws: Laws, u: Array, past: Array | None) -> Laws:
    """Return laws whose springs with memory come from a past to the elongations u at the start; nothing is lost yet."""
    if laws.state.size:
        if past is not None:
            laws.state[:] = past
        commit_all(laws.memory, laws.state, u)
        laws.state[laws.memory.start[:-1]] = 0.0
    return laws


def with_state(laws: Laws, state: Array) -> Laws:
    """Return the same laws with another array as their memory."""
    return laws._replace(state=state) if state.size else laws


@jit
def place_in_memory(laws: Laws, j: int) -> int:
    """Return the number of law j among those with memory."""
    return j - (laws.kind.size - laws.memory.kind.size)


@jit
def end_force(laws: Laws, j: int, u: float) -> tuple[float, float]:
    """Return force and tangent at u, contact dampers left out."""
    kind = laws.kind[j]
    if kind >= SMOOTH:
        if kind == AFFINE:
            return laws.offset[j] + laws.stiffness[j] * (u - laws.gap[j]), laws.stiffness[j]
        if kind == MEMORY:
            return memory_force(laws.memory, laws.state, place_in_memory(laws, j), u)
        width = 1e-6 * max(1.0, abs(u))
        address = laws.address[j, 0]
        return call(address, u), (call(address, u + width) - call(address, u - width)) / (2.0 * width)
    s = u - laws.gap[j]
    if s <= 0.0:
        return 0.0, 0.0
    k = laws.stiffness[j]
    if kind == PENETRATION:
        return k * s, k
    if kind == JUMP:
        ramp = _RAMP * laws.gap[j]
        if s >= ramp:
            return k * u, k
        steep = k * (laws.gap[j] + ramp) / ramp
        return steep * s, steep
    force, tangent = resolved_force(s, laws.resolution[j], laws.gap[j] - laws.offset[j])
    return k * force, k * tangent


@jit
def closed_share(laws: Laws, j: int, u0: float, u1: float) -> float:
    """Return the length of the path from u0 to u1 on which a contact's damper acts, with its sign."""
    s0, s1 = max(u0 - laws.gap[j], 0.0), max(u1 - laws.gap[j], 0.0)
    if laws.kind[j] != RESOLVED:
        return s1 - s0
    return resolved_integrals(s0, s1, laws.resolution[j])[0]


@jit
def mean_force(laws: Laws, j: int, u0: float, u1: float) -> float:
    """Return the mean force over the path from u0 to u1, contact dampers left out."""
    kind = laws.kind[j]
    if kind >= SMOOTH:
        if kind == AFFINE:
            return laws.offset[j] + laws.stiffness[j] * (u1 - laws.gap[j])
        if kind == MEMORY:
            return memory_mean(laws.memory, laws.state, place_in_memory(laws, j), u0, u1)
        return _smooth_mean(laws.address[j], u0, u1)
    gap, k = laws.gap[j], laws.stiffness[j]
    s0, s1 = u0 - gap, u1 - gap
    if s0 <= 0.0 and s1 <= 0.0:
        return 0.0
    if kind == RESOLVED:
        if s0 == s1:
            return k * resolved_force(s0, laws.resolution[j], gap - laws.offset[j])[0]
        plain, lever = resolved_integrals(max(s0, 0.0), max(s1, 0.0), laws.resolution[j])
        return k * (lever + (gap - laws.offset[j]) * plain) / (s1 - s0)
    ramp = _RAMP * gap if kind == JUMP else 0.0
    if s0 >= ramp and s1 >= ramp:
        return k * (0.5 * (s0 + s1) + (gap - laws.offset[j]))
    if s0 == s1:
        return end_force(laws, j, u0)[0]
    return k * (_height(s1, ramp, gap - laws.offset[j]) - _height(s0, ramp, gap - laws.offset[j])) / (s1 - s0)


@jit
def _height(s: float, ramp: float, lever: float) -> float:
    """Return the potential of an ideal switch over its stiffness, m^2."""
    if s <= 0.0:
        return 0.0
    if s < ramp:
        return 0.5 * s * s * (lever + ramp) / ramp
    return s * (0.5 * s + lever) - 0.5 * lever * ramp


@jit
def _smooth_mean(address: IntArray, u0: float, u1: float) -> float:
    """Return the mean of a smooth force: by its potential over long paths, else by quadrature, which keeps digits."""
    if abs(u1 - u0) > 1e-3 * max(abs(u0), abs(u1)):
        return (call(address[1], u1) - call(address[1], u0)) / (u1 - u0)
    middle, reach = 0.5 * (u0 + u1), 0.5 * (u1 - u0) * _GAUSS
    return (
        5.0 * call(address[0], middle - reach) + 8.0 * call(address[0], middle) + 5.0 * call(address[0], middle + reach)
    ) / 18.0


@jit
def mean_and_slope(laws: Laws, j: int, u0: float, u1: float) -> tuple[float, float]:
    """Return the mean force over the path from u0 to u1 and its derivative by u1."""
    mean, kind = mean_force(laws, j, u0, u1), laws.kind[j]
    if kind in (PENETRATION, JUMP):
        s0, s1 = u0 - laws.gap[j], u1 - laws.gap[j]
        ramp = _RAMP * laws.gap[j] if kind == JUMP else 0.0
        if s0 >= ramp and s1 >= ramp:
            return mean, 0.5 * laws.stiffness[j]
        if s0 <= 0.0 and s1 <= 0.0:
            return mean, 0.0
        force, tangent = end_force(laws, j, u1)
        return mean, (force - mean) / (u1 - u0) if u1 != u0 else 0.5 * tangent
    if kind == AFFINE:
        return mean, laws.stiffness[j]
    force, tangent = end_force(laws, j, u1)
    if abs(u1 - u0) <= 1e-6 * max(abs(u0), abs(u1)):
        return mean, 0.5 * tangent
    return mean, (force - mean) / (u1 - u0)
