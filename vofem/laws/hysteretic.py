"""Laws with internal variables: cyclic laws on a backbone, and springs of Jenkins elements.

A cyclic law is elastic between the largest forces that tension and compression
have reached, and follows its backbone beyond either of them. Its internal
variables are six numbers, which are listed at `HystereticLaw.virgin`. A law of
Jenkins elements is a linear spring in parallel with elements, each of which is a
spring in series with a slider. Its internal variables are the positions of the
sliders. Both laws are rate independent: the force follows from the internal
variables and the elongation.

The internal variables of all laws are one flat array. Only `commit` changes it.
Forces, mean forces and losses along a path are computed from the values at the
start of the path, so a rejected step changes nothing. A path is a monotone
change of the elongation from u0 to u1, where u0 belongs to the present internal
variables. Forces grow along rising paths and fall along falling ones. Mean force
and end force are therefore monotone functions of u1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from vofem.kernels.jit import jit
from vofem.laws.backbone import backbone, backbone_mean
from vofem.laws.group import LawGroup, ListedLaws
from vofem.laws.kinds import CALLED_WITH_PAST, JENKINS
from vofem.laws.paper import no_modes, path_needed
from vofem.laws.table import Laws

if TYPE_CHECKING:
    pass

Array = NDArray[np.float64]

#: Positions of the internal variables of a cyclic law. The first one is common to all laws.
DISSIPATED = 0
_UP_AT, _UP, _DOWN_AT, _DOWN, _RESIDUAL = 1, 2, 3, 4, 5


@dataclass(frozen=True)
class HystereticLaw:
    """A rate-independent law with internal variables on a row; the force on the structure is ``-b R``.

    Attributes
    ----------
    label : str
        Class and name of its spring, for messages.
    name : str
    kind : int
        HYPERBOLIC, TABULATED or JENKINS.
    stiffness : float
        Stiffness before any load in N/m, which is the largest that the law ever has.
    onset : float
        Force in N at which the law first yields.
    limit : float
        Limit load in N, which the force never reaches; inf where there is none.
    one_sided : bool
        Whether the force cannot pull, as in a stop.
    gap : float
        Elongation in m at which the force begins.
    parameters : ndarray
        For HYPERBOLIC: the range of forces in N over which the secant stiffness
        falls to zero. For TABULATED: elongation, force, slope and work at the
        knots of the backbone, one array after the other. For JENKINS: the
        stiffness of the parallel spring, those of the elements, and their slip forces.
    unit : str
        Unit of the force, for messages. It is "N m" for a law that acts on a
        rotation; the numbers above are then in rad, N m and N m/rad.
    """

    label: str
    name: str
    kind: int
    stiffness: float
    onset: float
    limit: float
    one_sided: bool
    gap: float
    parameters: Array
    unit: str = "N"

    @property
    def group(self) -> type[LawGroup]:
        """The group that gathers laws of this kind."""
        return HystereticLaws

    def virgin(self) -> Array:
        """Return the internal variables before any load: energy dissipated (J), then those of the kind.

        For a cyclic law these are: the elongation on the backbone and the force at
        which tension yields again, the same two for compression, and the residual
        elongation. For a law of Jenkins elements: the positions of the sliders.
        """
        if self.kind == JENKINS:
            return np.zeros(1 + (self.parameters.size - 1) // 2)
        linear_limit = self.onset / self.stiffness
        return np.array([0.0, linear_limit, self.onset, linear_limit, self.onset, 0.0])


@dataclass(frozen=True)
class HystereticLaws(ListedLaws):
    """Laws with internal variables, one per row.

    Attributes
    ----------
    rows : csr_matrix, shape (n_laws, n)
    laws : tuple of HystereticLaw and of `called.CalledLaw`
    """

    place: ClassVar[int] = 2
    kind: ClassVar[str] = "hysteretic springs"
    recorded: ClassVar[bool] = True

    laws: tuple[HystereticLaw, ...]

    def nonlinearity(self, method: str) -> str:
        """Return why the force is not piecewise linear in the displacement."""
        return (
            f"{self.labels[0]} remembers its past, and {method} needs laws that are piecewise linear in the "
            "displacement"
        )

    def statics_refusal(self, path: bool) -> str | None:
        """Return why there is no equilibrium without a path."""
        return None if path else path_needed(self.labels[0])

    def modes_refusal(self) -> str:
        """Return why there are no modes."""
        return no_modes(self.labels[0])

    def harmonic_refusal(self) -> str | None:
        """Return why there is no derivative by the internal variables: only of laws that are called."""
        label = next((law.label for law in self.laws if law.kind == CALLED_WITH_PAST), None)
        reason = "does not say how its force depends on its internal variables; let a damped simulation settle instead"
        return None if label is None else f"{label} {reason}"

    def limits(self) -> Array:
        """Return the limit loads in N."""
        return np.array([law.limit for law in self.laws])

    def units(self) -> tuple[str, ...]:
        """Return the units of the forces, for messages."""
        return tuple(law.unit for law in self.laws)

    def steepest(self, u: Array) -> Array:
        """Return the stiffness before any load, which is the largest."""
        return np.array([law.stiffness for law in self.laws])

    def fill(self, table: NDArray[np.void]) -> None:
        """Enter kind and numbers."""
        for name in ("kind", "one_sided", "stiffness", "limit", "gap"):
            table[name] = [getattr(law, name) for law in self.laws]
        table["address"] = [getattr(law, "address", 0) for law in self.laws]

    def numbers(self) -> Array:
        """Return stiffnesses, onsets, gaps and parameters."""
        parts = [np.append(law.parameters, [law.kind, law.stiffness, law.onset, law.gap]) for law in self.laws]
        return np.concatenate(parts)

    def parameters(self) -> list[Array]:
        """Return the parameters of every law."""
        return [law.parameters for law in self.laws]

    def virgin(self) -> list[Array]:
        """Return the internal variables of every law before any load."""
        return [law.virgin() for law in self.laws]


# -- compiled: law j of all, its internal variables as they are at the start of a path ----------------------


@jit
def _edges(laws: Laws, j: int) -> tuple[float, float]:
    """Return the elongations at which a cyclic law begins to yield in compression and in tension."""
    law = laws.table[j]
    s, k = law["start"], law["stiffness"]
    low = laws.state[s + _RESIDUAL]
    if not law["one_sided"]:
        low -= laws.state[s + _DOWN] / k
    return low, laws.state[s + _RESIDUAL] + laws.state[s + _UP] / k


@jit
def hysteretic_force(laws: Laws, j: int, u: float) -> tuple[float, float]:
    """Return force in N and tangent in N/m after the elongation has changed to u on a monotone path."""
    law = laws.table[j]
    u -= law["gap"]
    s, k = law["start"], law["stiffness"]
    if law["kind"] == JENKINS:
        a, count = law["first"], law["end"] - s - 1
        tangent = laws.parameters[a]
        force = tangent * u
        for e in range(count):
            spring, slip = laws.parameters[a + 1 + e], laws.parameters[a + 1 + count + e]
            pull = spring * (u - laws.state[s + 1 + e])
            if abs(pull) < slip:
                tangent += spring
            force += min(max(pull, -slip), slip)
        return force, tangent
    low, high = _edges(laws, j)
    if u > high:
        return backbone(laws, j, laws.state[s + _UP_AT] + (u - high))
    if u < low:
        if law["one_sided"]:
            return 0.0, 0.0
        force, tangent = backbone(laws, j, laws.state[s + _DOWN_AT] + (low - u))
        return -force, tangent
    return k * (u - laws.state[s + _RESIDUAL]), k


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
def hysteretic_mean(laws: Laws, j: int, u0: float, u1: float) -> float:
    """Return the mean force in N over the path from u0 to u1, where u0 belongs to the internal variables."""
    law = laws.table[j]
    a, b = min(u0, u1) - law["gap"], max(u0, u1) - law["gap"]
    if a == b:
        return hysteretic_force(laws, j, u1)[0]
    s, k = law["start"], law["stiffness"]
    if law["kind"] == JENKINS:
        first, count = law["first"], law["end"] - s - 1
        mean = laws.parameters[first] * 0.5 * (a + b)
        for e in range(count):
            slip = laws.parameters[first + 1 + count + e]
            mean += _clipped_mean(laws.parameters[first + 1 + e], laws.state[s + 1 + e], slip, a, b)
        return mean
    low, high = _edges(laws, j)
    if a >= low and b <= high:
        return k * (0.5 * (a + b) - laws.state[s + _RESIDUAL])
    total, length = 0.0, 0.0
    if a < low:
        part = min(b, low) - a
        length += part
        if not law["one_sided"]:
            at = laws.state[s + _DOWN_AT] + (low - a)
            total -= part * backbone_mean(laws, j, at - part, at)
    left, right = max(a, low), min(b, high)
    if right > left:
        total += k * (0.5 * (left + right) - laws.state[s + _RESIDUAL]) * (right - left)
        length += right - left
    if b > high:
        part = b - max(a, high)
        length += part
        at = laws.state[s + _UP_AT] + (b - high)
        total += part * backbone_mean(laws, j, at - part, at)
    return total / length


@jit
def hysteretic_loss(laws: Laws, j: int, u: float) -> float:
    """Return the energy in J that is dissipated on the path to u."""
    law = laws.table[j]
    u -= law["gap"]
    s, k = law["start"], law["stiffness"]
    lost = 0.0
    if law["kind"] == JENKINS:
        a, count = law["first"], law["end"] - s - 1
        for e in range(count):
            spring, slip = laws.parameters[a + 1 + e], laws.parameters[a + 1 + count + e]
            lost += slip * max(abs(u - laws.state[s + 1 + e]) - slip / spring, 0.0)
        return lost
    low, high = _edges(laws, j)
    if u > high:
        at, before, way = laws.state[s + _UP_AT], laws.state[s + _UP], u - high
    elif u < low and not law["one_sided"]:
        at, before, way = laws.state[s + _DOWN_AT], laws.state[s + _DOWN], low - u
    else:
        return 0.0
    after = backbone(laws, j, at + way)[0]
    stored = (after - before) * (0.5 * (after + before) / k)
    return max(way * backbone_mean(laws, j, at, at + way) - stored, 0.0)


@jit
def hysteretic_stored(laws: Laws, j: int, u: float) -> float:
    """Return the recoverable energy in J that the law stores at u."""
    law = laws.table[j]
    force = hysteretic_force(laws, j, u)[0]
    s, k = law["start"], law["stiffness"]
    if law["kind"] != JENKINS:
        return 0.5 * force * force / k
    u -= law["gap"]
    a, count = law["first"], law["end"] - s - 1
    stored = 0.5 * laws.parameters[a] * u * u
    for e in range(count):
        spring, slip = laws.parameters[a + 1 + e], laws.parameters[a + 1 + count + e]
        pull = min(abs(spring * (u - laws.state[s + 1 + e])), slip)
        stored += 0.5 * pull * pull / spring
    return stored


@jit
def hysteretic_commit(laws: Laws, j: int, u: float) -> None:
    """Update the internal variables to the end u of the path."""
    law = laws.table[j]
    laws.state[law["start"] + DISSIPATED] += hysteretic_loss(laws, j, u)
    s, k = law["start"], law["stiffness"]
    if law["kind"] == JENKINS:
        u -= law["gap"]
        a, count = law["first"], law["end"] - s - 1
        for e in range(count):
            slip_limit = laws.parameters[a + 1 + count + e] / laws.parameters[a + 1 + e]
            laws.state[s + 1 + e] = min(max(laws.state[s + 1 + e], u - slip_limit), u + slip_limit)
        return
    low, high = _edges(laws, j)
    u -= law["gap"]
    if u > high:
        laws.state[s + _UP_AT] += u - high
        force = backbone(laws, j, laws.state[s + _UP_AT])[0]
        laws.state[s + _UP] = force
        laws.state[s + _RESIDUAL] = u - force / k
    elif u < low and not law["one_sided"]:
        laws.state[s + _DOWN_AT] += low - u
        force = backbone(laws, j, laws.state[s + _DOWN_AT])[0]
        laws.state[s + _DOWN] = force
        laws.state[s + _RESIDUAL] = u + force / k


# -- how a path depends on its past, for iterations over whole orbits ---------------------------------------


def hysteretic_kinks(laws: Laws, j: int) -> list[float]:
    """Return the coordinates at which the tangent of law j jumps on a path from its present internal variables."""
    law = laws.table[j]
    if law["kind"] == JENKINS:
        place, slip = _sliders(laws, j)
        return np.sort(np.concatenate([place - slip, place + slip]) + law["gap"]).tolist()
    low, high = _edges(laws, j)
    return [float(low + law["gap"]), float(high + law["gap"])]


def _sliders(laws: Laws, j: int) -> tuple[Array, Array]:
    """Return places of the sliders of a Jenkins law, and the elongations of their springs at which they slip."""
    law = laws.table[j]
    start, count, first = law["start"], law["end"] - law["start"] - 1, law["first"] + 1
    spring, slip = laws.parameters[first : first + count], laws.parameters[first + count : first + 2 * count]
    return laws.state[start + 1 : start + 1 + count], slip / spring


def force_slopes(laws: Laws, j: int, u: float) -> Array:
    """Return the derivative of the force at u by the internal variables at the start of the path, shape (k,)."""
    law = laws.table[j]
    slopes = np.zeros(law["end"] - law["start"])
    if law["kind"] == JENKINS:
        place, slip = _sliders(laws, j)
        first = law["first"] + 1
        slopes[1:] = np.where(np.abs(u - law["gap"] - place) < slip, -laws.parameters[first : first + place.size], 0.0)
        return slopes
    low, high = _edges(laws, j)
    k, tangent = law["stiffness"], hysteretic_force(laws, j, u)[1]
    if u - law["gap"] > high:
        slopes[[_UP_AT, _RESIDUAL, _UP]] = tangent, -tangent, -tangent / k
    elif u - law["gap"] >= low:
        slopes[_RESIDUAL] = -k
    elif not law["one_sided"]:
        slopes[[_DOWN_AT, _RESIDUAL, _DOWN]] = -tangent, -tangent, tangent / k
    return slopes


def commit_slopes(laws: Laws, j: int, u: float) -> tuple[Array, Array]:
    """Return the derivatives of the internal variables after `commit` by those before, (k, k), and by u, (k,).

    The dissipated energy is left out, because no force depends on it.
    """
    law = laws.table[j]
    size = law["end"] - law["start"]
    past, end = np.eye(size), np.zeros(size)
    if law["kind"] == JENKINS:
        place, slip = _sliders(laws, j)
        slips = np.append(False, np.abs(u - law["gap"] - place) > slip)
        past[slips] = 0.0
        end[slips] = 1.0
        return past, end
    low, high = _edges(laws, j)
    k = law["stiffness"]
    tension = u - law["gap"] > high
    if not tension and (law["one_sided"] or u - law["gap"] >= low):
        return past, end
    # Along the backbone: its elongation grows by the path beyond the edge, and force and residual elongation follow
    # from it.
    at, force, sign = (_UP_AT, _UP, 1.0) if tension else (_DOWN_AT, _DOWN, -1.0)
    tangent = hysteretic_force(laws, j, u)[1]
    past[at, _RESIDUAL], past[at, force], end[at] = -sign, -1.0 / k, sign
    past[force], end[force] = tangent * past[at], tangent * end[at]
    past[_RESIDUAL] = -sign * past[force] / k
    end[_RESIDUAL] = 1.0 - sign * end[force] / k
    return past, end
