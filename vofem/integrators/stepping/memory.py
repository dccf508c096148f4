"""Laws with memory in compiled form.

The state of all laws is one flat array that only `commit` changes; forces,
means and losses of a path take it as it is at the path's start. So a step
that is tried and rejected leaves no trace. A path is a monotone change of the
elongation from u0, where the state holds, to u1. Forces grow along rising
paths and fall along falling ones, so mean and end force are monotone in u1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.stepping.backbone import MEMORY_RECORD, Memory, backbone, backbone_mean
from vofem.linalg.jit import jit
from vofem.memory import JENKINS, MemoryLaw

Array = NDArray[np.float64]

#: Where a cyclic law's state holds what.
_LOST, _UP_AT, _UP, _DOWN_AT, _DOWN, _RESIDUAL = 0, 1, 2, 3, 4, 5


def build_memory(laws: tuple[MemoryLaw, ...]) -> tuple[Memory, Array]:
    """Return laws in compiled form and their state before any load."""
    states = [law.virgin() for law in laws]
    parameters = [law.parameters for law in laws]
    table = np.zeros(len(laws), dtype=MEMORY_RECORD)
    for name in ("kind", "one_sided", "stiffness", "limit", "gap"):
        table[name] = [getattr(law, name) for law in laws]
    for name, parts in (("first", parameters), ("start", states)):
        ends = np.cumsum([0, *(part.size for part in parts)])
        table[name], table["last" if name == "first" else "end"] = ends[:-1], ends[1:]
    memory = Memory(table, np.concatenate([np.zeros(0), *parameters]))
    return memory, np.concatenate([np.zeros(0), *states])


@jit
def _edges(memory: Memory, state: Array, i: int) -> tuple[float, float]:
    """Return the elongations at which a cyclic law begins to yield in compression and in tension."""
    law = memory.table[i]
    s, k = law["start"], law["stiffness"]
    low = state[s + _RESIDUAL]
    if not law["one_sided"]:
        low -= state[s + _DOWN] / k
    return low, state[s + _RESIDUAL] + state[s + _UP] / k


@jit
def memory_force(memory: Memory, state: Array, i: int, u: float) -> tuple[float, float]:
    """Return force in N and tangent in N/m where the elongation changes to u on a monotone path."""
    law = memory.table[i]
    u -= law["gap"]
    s, k = law["start"], law["stiffness"]
    if law["kind"] == JENKINS:
        a, count = law["first"], law["end"] - s - 1
        tangent = memory.parameters[a]
        force = tangent * u
        for e in range(count):
            spring, slip = memory.parameters[a + 1 + e], memory.parameters[a + 1 + count + e]
            pull = spring * (u - state[s + 1 + e])
            if abs(pull) < slip:
                tangent += spring
            force += min(max(pull, -slip), slip)
        return force, tangent
    low, high = _edges(memory, state, i)
    if u > high:
        return backbone(memory, i, state[s + _UP_AT] + (u - high))
    if u < low:
        if law["one_sided"]:
            return 0.0, 0.0
        force, tangent = backbone(memory, i, state[s + _DOWN_AT] + (low - u))
        return -force, tangent
    return k * (u - state[s + _RESIDUAL]), k


@jit
def _clipped_mean(k: float, place: float, slip: float, a: float, b: float) -> float:
    """Return the mean over [a, b], a < b, of a spring's force that slips at +-slip."""
    low, high = place - slip / k, place + slip / k
    total = 0.0
    if a < low:
        total -= slip * (min(b, low) - a)
    if b > high:
        total += slip * (b - max(a, high))
    left, right = max(a, low), min(b, high)
    if right > left:
        total += k * (0.5 * (left + right) - place) * (right - left)
    return total / (b - a)


@jit
def memory_mean(memory: Memory, state: Array, i: int, u0: float, u1: float) -> float:
    """Return work over length of the path from u0, where the state holds, to u1: a mean force in N."""
    law = memory.table[i]
    a, b = min(u0, u1) - law["gap"], max(u0, u1) - law["gap"]
    if a == b:
        return memory_force(memory, state, i, u1)[0]
    s, k = law["start"], law["stiffness"]
    if law["kind"] == JENKINS:
        first, count = law["first"], law["end"] - s - 1
        mean = memory.parameters[first] * 0.5 * (a + b)
        for e in range(count):
            slip = memory.parameters[first + 1 + count + e]
            mean += _clipped_mean(memory.parameters[first + 1 + e], state[s + 1 + e], slip, a, b)
        return mean
    low, high = _edges(memory, state, i)
    if a >= low and b <= high:
        return k * (0.5 * (a + b) - state[s + _RESIDUAL])
    total, length = 0.0, 0.0
    if a < low:
        part = min(b, low) - a
        length += part
        if not law["one_sided"]:
            at = state[s + _DOWN_AT] + (low - a)
            total -= part * backbone_mean(memory, i, at - part, at)
    left, right = max(a, low), min(b, high)
    if right > left:
        total += k * (0.5 * (left + right) - state[s + _RESIDUAL]) * (right - left)
        length += right - left
    if b > high:
        part = b - max(a, high)
        length += part
        at = state[s + _UP_AT] + (b - high)
        total += part * backbone_mean(memory, i, at - part, at)
    return total / length


@jit
def memory_loss(memory: Memory, state: Array, i: int, u: float) -> float:
    """Return the energy in J that the way to u dissipates."""
    law = memory.table[i]
    u -= law["gap"]
    s, k = law["start"], law["stiffness"]
    lost = 0.0
    if law["kind"] == JENKINS:
        a, count = law["first"], law["end"] - s - 1
        for e in range(count):
            spring, slip = memory.parameters[a + 1 + e], memory.parameters[a + 1 + count + e]
            lost += slip * max(abs(u - state[s + 1 + e]) - slip / spring, 0.0)
        return lost
    low, high = _edges(memory, state, i)
    if u > high:
        at, before, way = state[s + _UP_AT], state[s + _UP], u - high
    elif u < low and not law["one_sided"]:
        at, before, way = state[s + _DOWN_AT], state[s + _DOWN], low - u
    else:
        return 0.0
    after = backbone(memory, i, at + way)[0]
    stored = (after - before) * (0.5 * (after + before) / k)
    return max(way * backbone_mean(memory, i, at, at + way) - stored, 0.0)


@jit
def memory_stored(memory: Memory, state: Array, i: int, u: float) -> float:
    """Return the energy in J that the law holds at u and would give back."""
    law = memory.table[i]
    force = memory_force(memory, state, i, u)[0]
    s, k = law["start"], law["stiffness"]
    if law["kind"] != JENKINS:
        return 0.5 * force * force / k
    u -= law["gap"]
    a, count = law["first"], law["end"] - s - 1
    stored = 0.5 * memory.parameters[a] * u * u
    for e in range(count):
        spring, slip = memory.parameters[a + 1 + e], memory.parameters[a + 1 + count + e]
        pull = min(abs(spring * (u - state[s + 1 + e])), slip)
        stored += 0.5 * pull * pull / spring
    return stored


@jit
def commit(memory: Memory, state: Array, i: int, u: float) -> None:
    """Make the way to u part of the past."""
    law = memory.table[i]
    state[law["start"] + _LOST] += memory_loss(memory, state, i, u)
    s, k = law["start"], law["stiffness"]
    if law["kind"] == JENKINS:
        u -= law["gap"]
        a, count = law["first"], law["end"] - s - 1
        for e in range(count):
            reach = memory.parameters[a + 1 + count + e] / memory.parameters[a + 1 + e]
            state[s + 1 + e] = min(max(state[s + 1 + e], u - reach), u + reach)
        return
    low, high = _edges(memory, state, i)
    u -= law["gap"]
    if u > high:
        state[s + _UP_AT] += u - high
        force = backbone(memory, i, state[s + _UP_AT])[0]
        state[s + _UP] = force
        state[s + _RESIDUAL] = u - force / k
    elif u < low and not law["one_sided"]:
        state[s + _DOWN_AT] += low - u
        force = backbone(memory, i, state[s + _DOWN_AT])[0]
        state[s + _DOWN] = force
        state[s + _RESIDUAL] = u + force / k


@jit
def commit_all(memory: Memory, state: Array, u: Array) -> None:
    """Make the ways to all u, of laws that end with those of the memory, part of the past."""
    n = memory.table.size
    for i in range(n):
        commit(memory, state, i, u[u.size - n + i])
