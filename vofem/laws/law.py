# mypy: disable-error-code="no-any-return"
"""A scalar law: one function and its numbers. Everything else is derived here, once for all laws.

The function is ``function(what, p, z, u0, u1) -> float``, decorated with `vofem.kernels.jit.jit`. It takes its
parameters p and its internal variables z by indices only. The path from u0 to u1 is monotone, and z belongs to u0. A
law answers these questions:

============ ==============================================================================================
FORCE        force at u1, N; u0 is u1, as it is for all questions but the means
TANGENT      its derivative by u1, N/m
DAMPING      force over rate, N s/m: the mean over the path, or at u1 where u0 is u1; 0 of laws without damper
MEAN         mean force over the path without the damper, N: its work over its length
STORED       recoverable energy at u1, J
LOSS         energy dissipated on the path to u1, J; 0 of laws without internal variables
COMMIT       anything; changes z to the internal variables at u1. No other question changes z
KINK         place number u1, from 0, at which force or tangent jumps, m; NaN beyond the last one
JUMP         jump of the force at the first kink, N
MEAN_TANGENT derivative of MEAN by u1, N/m; asked only of laws to which the normal force over a step is told
============ ==============================================================================================

The mean force is the discrete gradient of the law's potential, so a step that uses it conserves energy whatever its
size. Loops call a law through its address: they contain no formulas of laws, and are compiled once for all laws.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.kernels.addresses import address_of, call
from vofem.kernels.jit import CompiledFunction, jit
from vofem.kernels.mode import compiled

FORCE, TANGENT, DAMPING, MEAN, STORED, LOSS, COMMIT, KINK, JUMP, MEAN_TANGENT = range(10)

Function = Callable[[int, Any, Any, float, float], float]

#: Status of a law in all methods: it does not act, it acts, it rests at the place where its force jumps.
OPEN, CLOSED, PINNED = 0, 1, 2

#: Number of laws from which on a step may be solved on the unknowns in place of the laws.
FEWEST_IN_BAND = 16

#: Columns of `Laws.table`.
ADDRESS, FIRST, START, DAMPED, HISTORY, END = range(6)

#: Change of a coordinate over which the damping of a law is differentiated, over the distance of its first two kinks.
_WIDTH = 1e-6


@dataclass(frozen=True, eq=False)
class Law:
    """A scalar law; the force on the structure is ``-b R`` for its row b.

    Attributes
    ----------
    label, name : str
        Class and name of its effect for messages, and the name.
    function : callable
        See the module.
    parameters, past : ndarray
        The numbers p, and the internal variables z before any load.
    stiffness : float, optional
        Bound of the tangents, N/m; None where there is none.
    limit : float
        Limit load in N, which the force never reaches; inf where there is none.
    unit : str
        Unit of the force, for messages. It is "N m" for a law on a rotation, whose numbers are in rad, N m, N m/rad.
    damped : bool
        Whether the law may have a damper.
    rising : bool
        Whether the force never jumps or falls as the coordinate rises.
    slopes : callable, optional
        Takes p, z and u. Returns the derivative of the force at u by z at the start of the path, (k,), and those of z
        after COMMIT by z before, (k, k), and by u, (k,). Harmonic balance needs it of laws with internal variables.
    """

    label: str
    name: str
    function: Function
    parameters: Array = field(default_factory=lambda: np.zeros(0))
    past: Array = field(default_factory=lambda: np.zeros(0))
    stiffness: float | None = None
    limit: float = float("inf")
    unit: str = "N"
    damped: bool = False
    rising: bool = True
    slopes: Callable[[Array, Array, float], tuple[Array, Array, Array]] | None = None

    @property
    def remembers(self) -> bool:
        """Whether the law has internal variables."""
        return self.past.size > 0

    @property
    def in_python(self) -> bool:
        """Whether the function is one of Python, which loops call back."""
        return not isinstance(self.function, CompiledFunction)

    def virgin(self) -> Array:
        """Return what a run keeps of the law before any load: energy dissipated (J) and z; nothing without past."""
        return np.append(0.0, self.past) if self.past.size else self.past


class Laws(NamedTuple):
    """Laws in loops, in the order of the groups of a system.

    Attributes
    ----------
    table : ndarray of int, shape (n_laws, 6)
        Address of the function; first of the law's numbers in `parameters`; first and last of those in `state`;
        whether it has a damper; number of its history, -1 for none.
    parameters : ndarray
        Numbers of all laws.
    state : ndarray
        Energy dissipated (J) and internal variables of all laws that have some, at the start of a step.
    """

    table: NDArray[np.int64]
    parameters: Array
    state: Array


class Way(NamedTuple):
    """How laws act over a step.

    Attributes
    ----------
    mean : bool
        Whether by their mean force over the step, and not by the force at its end.
    explicit : bool
        Whether the coordinate at the end is known, and the rate there is solved for.
    now, before : float
        Weights of a damper's mean force over this step, and of that over the step before which is subtracted: they
        extrapolate it to the time of balance.
    dt : float
        In s.
    """

    mean: bool
    explicit: bool
    now: float
    before: float
    dt: float


# -- laws in loops ------------------------------------------------------------------------------------------


@jit
def ask(laws: Laws, j: int, what: int, u0: float, u1: float) -> float:
    """Return what law j answers to a question."""
    return call(
        laws.table[j, ADDRESS], what, laws.parameters, laws.table[j, FIRST], laws.state, laws.table[j, START] + 1, u0,
        u1,
    )  # fmt: skip


@jit
def damper_over(laws: Laws, j: int, way: Way, u0: float, u1: float, r1: float) -> float:
    """Return the mean force of the damper of law j over a step in N, or in explicit steps the force at its end.

    In explicit steps it acts from the middle of the step to that of the next one, so a contact that closes within this
    time is damped for a part of it only. Otherwise errors would be of first order.
    """
    if laws.table[j, DAMPED] == 0:
        return 0.0
    if way.explicit:
        return ask(laws, j, DAMPING, 0.5 * (u0 + u1), 1.5 * u1 - 0.5 * u0) * r1
    return ask(laws, j, DAMPING, u0, u1) * ((u1 - u0) / way.dt)


@jit
def force_over(laws: Laws, j: int, way: Way, u0: float, u1: float, r1: float, before: float) -> float:
    """Return the force of law j over a step from u0 to u1, in N.

    Parameters
    ----------
    laws : Laws
    j : int
    way : Way
    u0, u1 : float
        Coordinates at the start and at the end of the step, m.
    r1 : float
        Rate at the end, m/s; only in explicit steps.
    before : float
        Mean force of the law's damper over the step before, N.
    """
    force = ask(laws, j, MEAN, u0, u1) if way.mean else ask(laws, j, FORCE, u1, u1)
    if laws.table[j, DAMPED]:
        damper = damper_over(laws, j, way, u0, u1, r1)
        force += damper if way.explicit else way.now * damper - way.before * before
    return force


@jit
def slope_over(laws: Laws, j: int, way: Way, u0: float, u1: float, force: float) -> float:
    """Return the slope of `force_over`, whose answer is given, over u1; in explicit steps over the rate.

    Only dampers depend on the rate.
    """
    if way.explicit:
        return damper_over(laws, j, way, u0, u1, 1.0)
    slope = ask(laws, j, TANGENT, u1, u1)
    if way.mean:
        slope *= 0.5
        if u1 != u0:
            mean = ask(laws, j, MEAN, u0, u1) if laws.table[j, DAMPED] else force
            end = ask(laws, j, FORCE, u1, u1)
            chord = (end - mean) / (u1 - u0)
            # On a straight piece this is half of the tangent, but for the rounding of a short path.
            if abs(chord - slope) > 1e-6 * slope + 1e-14 * (abs(end) + abs(mean)) / abs(u1 - u0):
                slope = chord
    if laws.table[j, DAMPED]:
        slope += way.now * ask(laws, j, DAMPING, u1, u1) / way.dt
    return slope


@jit
def commit_law(laws: Laws, j: int, u: float) -> None:
    """Update the internal variables of law j, which has some, to the end u of its path."""
    laws.state[laws.table[j, START]] += ask(laws, j, LOSS, u, u)
    ask(laws, j, COMMIT, u, u)


@jit
def commit_laws(laws: Laws, u: Array) -> None:
    """Update the internal variables of all laws to the ends u of their paths."""
    for j in range(u.size):
        if laws.table[j, END] > laws.table[j, START]:
            commit_law(laws, j, u[j])


@jit
def _along(laws: Laws, j: int, what: int, u: Array, answers: Array) -> None:
    for i in range(u.size):
        answers[i] = ask(laws, j, what, u[i], u[i])


@jit
def _everywhere(laws: Laws, what: int, u: Array, answers: Array) -> None:
    for j in range(u.shape[0]):
        for i in range(u.shape[1]):
            answers[j, i] = ask(laws, j, what, u[j, i], u[j, i])


# -- laws for all other code --------------------------------------------------------------------------------


class Gathered(Protocol):
    """A group of laws of one kind, as far as their functions need it."""

    @property
    def forms(self) -> tuple[Law, ...]:
        """The laws as functions with numbers."""

    @property
    def recorded(self) -> bool:
        """Whether they have histories."""


class Written(Protocol):
    """The functions of laws that are written in Python, in their order."""

    def addresses(self, compiled: bool) -> list[int]:
        """Return where compiled loops, or loops in plain Python, find them."""


class LawSet:
    """The laws of some groups, as all methods but event_driven ask them.

    Coordinates are reached on monotone paths from the internal variables in `state`, which only `commit` changes.

    Attributes
    ----------
    laws : tuple of Law
    parameters, state : ndarray
        See `Laws`.
    """

    def __init__(self, groups: Sequence[Gathered], callbacks: Written | None = None) -> None:
        self.laws: tuple[Law, ...] = tuple(law for group in groups for law in group.forms)
        self._recorded = [group.recorded for group in groups for _ in group.forms]
        self._callbacks = callbacks
        self.parameters = np.concatenate([np.zeros(0), *(law.parameters for law in self.laws)])
        self.state = np.concatenate([np.zeros(0), *(law.virgin() for law in self.laws)])
        self._tables: dict[bool, NDArray[np.int64]] = {}

    def __len__(self) -> int:
        return len(self.laws)

    def __getstate__(self) -> dict[str, Any]:
        # Addresses hold in this process only.
        return vars(self) | {"_tables": {}}

    def fresh(self) -> LawSet:
        """Return the same laws with internal variables of their own."""
        other = object.__new__(LawSet)
        vars(other).update(vars(self), state=self.state.copy())
        return other

    @property
    def records(self) -> Laws:
        """The laws in loops, for the way in which kernels run at present."""
        way = compiled()
        if way not in self._tables:
            self._tables[way] = self._table(way)
        return Laws(self._tables[way], self.parameters, self.state)

    def _table(self, way: bool) -> NDArray[np.int64]:
        table = np.zeros((len(self.laws), 6), dtype=np.int64)
        written = iter(() if self._callbacks is None else self._callbacks.addresses(way))
        first, start, history = 0, 0, 0
        for row, law, recorded in zip(table, self.laws, self._recorded, strict=True):
            address = address_of(law.function) if isinstance(law.function, CompiledFunction) else next(written, 0)
            end = start + law.virgin().size
            row[:] = address, first, start, law.damped, history if recorded else -1, end
            first, start, history = first + law.parameters.size, end, history + recorded
        return table

    def of(self, j: int) -> Array:
        """Return the internal variables of law j, with the energy dissipated first; a view."""
        start = sum(law.virgin().size for law in self.laws[:j])
        return self.state[start : start + self.laws[j].virgin().size]

    def along(self, j: int, what: int, u: Array) -> Array:
        """Return what law j answers to a question at coordinates u, of the same shape."""
        law, u = self.laws[j], np.asarray(u, dtype=float)
        if law.in_python:
            ask_it, past = law.function, self.of(j)[1:]
            return np.array([ask_it(what, law.parameters, past, x, x) for x in u.ravel().tolist()]).reshape(u.shape)
        answers = np.empty(u.size)
        _along(self.records, j, what, np.ascontiguousarray(u.ravel()), answers)
        return answers.reshape(u.shape)

    def everywhere(self, what: int, u: Array) -> Array:
        """Return what every law answers at coordinates u, shape (n_laws, n), of the same shape."""
        u = np.ascontiguousarray(u, dtype=float)
        if not any(law.in_python for law in self.laws):
            answers = np.empty(u.shape)
            _everywhere(self.records, what, u, answers)
            return answers
        return np.stack([self.along(j, what, row) for j, row in enumerate(u)])

    def force(self, j: int, u: Array) -> Array:
        """Return forces of law j at coordinates u, N."""
        return self.along(j, FORCE, u)

    def tangent(self, j: int, u: Array) -> Array:
        """Return tangents of law j at coordinates u, N/m."""
        return self.along(j, TANGENT, u)

    def damping(self, j: int, u: Array) -> tuple[Array, Array]:
        """Return force over rate (N s/m) of law j at coordinates u above its first kink, and its derivative by u."""
        kinks, value = self.kinks(j), self.along(j, DAMPING, u)
        if len(kinks) < 2:
            return value, np.zeros(u.shape)
        width = _WIDTH * (kinks[1] - kinks[0])
        return value, (self.along(j, DAMPING, u + width) - self.along(j, DAMPING, u - width)) / (2.0 * width)

    def kinks(self, j: int) -> list[float]:
        """Return the coordinates at which force or tangent of law j jumps on paths from the internal variables.

        A law that has kinks and no internal variables exerts no force below the first one.
        """
        found: list[float] = []
        while True:
            place = float(self.along(j, KINK, np.array([float(len(found))]))[0])
            if place != place:
                return found
            found.append(place)

    def jumps(self, j: int) -> tuple[float, float]:
        """Return the jumps of the force (N) and of the damper (N s/m) of law j at its first kink, as u rises."""
        kink = np.array(self.kinks(j)[:1])
        beyond = np.nextafter(kink, np.inf)
        damper = float(self.along(j, DAMPING, beyond)[0]) if len(self.kinks(j)) == 1 else 0.0
        return float(self.along(j, JUMP, kink)[0]), damper

    def stored(self, j: int, u: float) -> float:
        """Return the recoverable energy of law j at u, J."""
        return float(self.along(j, STORED, np.array([u]))[0])

    def dissipated(self, j: int, u: float) -> float:
        """Return the energy that law j has dissipated when its path has reached u, J."""
        return float(self.of(j)[0] + self.along(j, LOSS, np.array([u]))[0])

    def commit(self, j: int, u: float) -> None:
        """Update the internal variables of law j, which has some, to the end u of its path."""
        commit_law(self.records, j, float(u))

    def commit_all(self, u: Array) -> None:
        """Update all internal variables to the ends u of the paths."""
        if self.state.size:
            commit_laws(self.records, u)

    def load(self, u: Array, past: Array | None) -> None:
        """Begin a run: take internal variables where they are given, go to coordinates u, with nothing dissipated."""
        if past is not None and self.state.size:
            self.state[: past.size] = past
        self.commit_all(u)
        for j, law in enumerate(self.laws):
            if law.remembers:
                self.of(j)[0] = 0.0

    def past_slopes(self, j: int, u: float) -> tuple[Array, Array, Array]:
        """Return how force and internal variables at u depend on the internal variables at the start of the path.

        Returns
        -------
        force : ndarray, shape (k,)
            Derivative of the force by the k internal variables, energy first.
        past, end : ndarray, shape (k, k) and (k,)
            Derivatives of the internal variables after a commit by those before, and by u. The dissipated energy is
            left out, because no force depends on it.
        """
        law, state = self.laws[j], self.of(j)
        assert law.slopes is not None
        force, past, end = np.zeros(state.size), np.eye(state.size), np.zeros(state.size)
        force[1:], past[1:, 1:], end[1:] = law.slopes(law.parameters, state[1:], u)
        return force, past, end

    def turns(self, j: int) -> bool:
        """Return whether the tangent of law j may jump within a step: it has kinks, or internal variables."""
        return self.laws[j].remembers or bool(self.kinks(j))


# -- the affine law, which a springpot is over one step --------------------------------------------------


@jit
def affine(what: int, p: Any, z: Any, u0: float, u1: float) -> float:
    """Answer for ``R = p_0 + p_1 (u - p_2) + p_3 u'``."""
    x = u1 - p[2]
    if what == FORCE:
        return p[0] + p[1] * x
    if what == TANGENT:
        return p[1]
    if what == DAMPING:
        return p[3]
    if what == MEAN:
        # Both ends are measured from p_2, which for a springpot is u0, so its mean force loses no digits.
        return p[0] + 0.5 * p[1] * ((u0 - p[2]) + x)
    if what == STORED:
        return (p[0] + 0.5 * p[1] * x) * x
    return np.nan if what == KINK else 0.0
