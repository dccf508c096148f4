"""What an integrator sees: matrices, load vectors and scalar laws on rows. It knows of nothing else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.cache import Cache
from vofem.memory import MemoryLaw, PrintedLaw, SpringpotLaw

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix, csr_matrix

Array = NDArray[np.float64]

#: Contact status.
OPEN, CLOSED, PINNED = 0, 1, 2


class LoadFunction(Protocol):
    """What a load needs of a function of time; `effects.time_functions.TimeFunction` offers it."""

    @property
    def closed_form(self) -> bool:
        """Whether pieces and derivatives are known."""

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""

    def breakpoints(self, t_end: float) -> Array:
        """Return the times at which the closed form changes."""

    @property
    def looked(self) -> float:
        """Distance in s of the times at which a callable was looked at; 0 where the shape is known, inf where not."""

    def shortest(self, t_end: float) -> float:
        """Return the shortest time in s over which the function changes its course."""

    def moments(self, left: ArrayLike, right: ArrayLike, width: float) -> Array:
        """Return the means over intervals of f, x f and (x^2 - 1/12) f, x their fraction about the middle."""


@dataclass(frozen=True)
class Load:
    """A load ``vector * function(t)``.

    Attributes
    ----------
    vector : ndarray, shape (n,)
    function : LoadFunction
    name : str
        For messages.
    """

    vector: Array
    function: LoadFunction
    name: str


@dataclass(frozen=True)
class ContactLaws:
    """Contacts, one per row: closed exactly while ``s = b.q - gap > 0`` (Eq. 8 of the paper).

    While closed, the force ``R`` acts on the structure as ``-b R``:

    - ``R = K0 (b.q) + C0 (b.q')`` where `jump` is true (Eqs. 9b, 13, 18c), and
    - ``R = K0 (b.q - gap) + C0 (b.q')`` elsewhere.

    Attributes
    ----------
    names : tuple of str
    rows : csr_matrix, shape (n_contacts, n)
    gap, stiffness, damping : ndarray, shape (n_contacts,)
        In m, N/m, N s/m.
    jump : ndarray of bool, shape (n_contacts,)
        Whether the force acts on the whole displacement.
    resolution : ndarray, shape (n_contacts,)
        s0 in 1/m of the resolved switch; inf for the ideal one.
    """

    names: tuple[str, ...]
    rows: csr_matrix
    gap: Array
    stiffness: Array
    damping: Array
    jump: NDArray[np.bool_]
    resolution: Array

    def __len__(self) -> int:
        return len(self.names)

    @property
    def offset(self) -> Array:
        """The displacement that the spring force is counted from: 0 for the jump law, else the gap."""
        return np.where(self.jump, 0.0, self.gap)

    @property
    def ideal(self) -> bool:
        """Whether all switches are ideal."""
        return bool(np.all(np.isinf(self.resolution)))


@dataclass(frozen=True)
class NonlinearLaw:
    """A smooth scalar law ``R = dV/du`` on a row; the force on the structure is ``-b R``.

    Attributes
    ----------
    name : str
    potential, force : callable
        V in J and R in N of the elongation u in m.
    """

    name: str
    potential: Callable[[float], float]
    force: Callable[[float], float]

    def reaction(self, u: float) -> float:
        """Return R(u) in N; infinite where Python's floats overflow."""
        try:
            return float(self.force(u))
        except OverflowError:
            return float("inf")

    def energy(self, u: float) -> float:
        """Return V(u) in J; infinite where Python's floats overflow."""
        try:
            return float(self.potential(u))
        except OverflowError:
            return float("inf")

    def tangent(self, u: float, step: float = 1e-6) -> float:
        """Return dR/du in N/m by a central difference."""
        width = step * max(1.0, abs(u))
        return (self.reaction(u + width) - self.reaction(u - width)) / (2.0 * width)


@dataclass(frozen=True)
class NonlinearLaws:
    """Smooth scalar laws, one per row.

    Attributes
    ----------
    rows : csr_matrix, shape (n_laws, n)
    laws : tuple of NonlinearLaw
    """

    rows: csr_matrix
    laws: tuple[NonlinearLaw, ...]


@dataclass(frozen=True)
class MemoryLaws:
    """Laws with memory, one per row.

    Attributes
    ----------
    rows : csr_matrix, shape (n_laws, n)
    laws : tuple of MemoryLaw
    """

    rows: csr_matrix
    laws: tuple[MemoryLaw, ...]


@dataclass(frozen=True)
class SpringpotLaws:
    """Springpots, one per row.

    Attributes
    ----------
    rows : csr_matrix, shape (n_laws, n)
    laws : tuple of SpringpotLaw
    """

    rows: csr_matrix
    laws: tuple[SpringpotLaw, ...]


@dataclass(frozen=True)
class System:
    """``M q'' + C q' + K q = sum_l F_l f_l(t) - sum_j b_j R_j(b_j.q, b_j.q')`` over the free degrees of freedom.

    What a scene does not declare is None or empty here, never a zero matrix.

    Attributes
    ----------
    mass, stiffness : csc_matrix, shape (n, n)
        Symmetric, without contacts.
    damping : csc_matrix, shape (n, n), optional
        Of bodies and dashpots. Together with the next two it makes C, which is
        built once without contacts: contact status never changes it.
    rayleigh : (float, float), optional
        Adds ``alpha M + beta K`` to C. Kept apart because modal coordinates
        make it diagonal, which rounding in a product of matrices would spoil.
    modal_damping : float or ndarray, optional
        Ratios of critical damping that are added to the modes of (K, M): one for
        all of them, or one for each vibration mode in ascending order of
        frequency, rigid motions not counted. Modes beyond the array take its last ratio.
    strain : csr_matrix, shape (n_strains, n), optional
        D with ``K = D'D``, so that energies keep digits that products with K
        lose; None where K is no sum of squares.
    rigid : ndarray, shape (n, r)
        A basis of the motions without strain energy, known from kinematics; r is mostly 0.
    loads : tuple of Load
    contacts : ContactLaws, optional
    nonlinear : NonlinearLaws, optional
    memory : MemoryLaws, optional
    printed : PrintedLaw, optional
        Eq. 22 as it stands, on a system of one degree of freedom.
    scale : ndarray, shape (n,)
        Length that makes a degree of freedom a displacement; balances eigenproblems.
    springpots : SpringpotLaws, optional
    rotation : ndarray of bool, shape (n,), optional
        True where a degree of freedom is a rotation, False where it is a
        displacement; None in runs that were saved before it was known. See `rotational`.
    """

    mass: csc_matrix
    stiffness: csc_matrix
    damping: csc_matrix | None
    rayleigh: tuple[float, float] | None
    modal_damping: float | Array | None
    loads: tuple[Load, ...]
    contacts: ContactLaws | None
    nonlinear: NonlinearLaws | None
    memory: MemoryLaws | None
    printed: PrintedLaw | None
    scale: Array
    strain: csr_matrix | None
    rigid: Array
    springpots: SpringpotLaws | None = None
    rotation: NDArray[np.bool_] | None = None

    @property
    def cache(self) -> Cache:
        """What runs have computed of this system for all runs that follow; neither copied nor saved with it."""
        # One step, so that threads find the same one.
        known: Cache = self.__dict__.get("_cache") or self.__dict__.setdefault("_cache", Cache())
        return known

    def share(self, other: System) -> None:
        """Use the cache of another system, which must differ from this one in functions of time alone."""
        self.__dict__["_cache"] = other.cache

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_cache"}

    @property
    def rotational(self) -> NDArray[np.bool_]:
        """Whether each degree of freedom is a rotation, shape (n,).

        Where `rotation` is None, those whose `scale` is not 1 count as rotations: it is the element length for slopes.
        """
        return self.scale != 1.0 if self.rotation is None else self.rotation

    @property
    def size(self) -> int:
        """Number of free degrees of freedom."""
        return int(self.scale.size)

    @property
    def path_dependent(self) -> tuple[MemoryLaw | PrintedLaw, ...]:
        """The springs whose force at rest depends on the path to there."""
        if self.printed is not None:
            return (self.printed,)
        return () if self.memory is None else self.memory.laws

    @property
    def springs(self) -> tuple[MemoryLaw | PrintedLaw | SpringpotLaw, ...]:
        """All springs with memory, springpots last."""
        return self.path_dependent + (() if self.springpots is None else self.springpots.laws)

    @property
    def damped(self) -> bool:
        """Whether there is any damping outside the contacts."""
        return not (self.damping is None and self.rayleigh is None and self.modal_damping is None)

    def modal_rates(self, squares: Array) -> Array:
        """Return ``2 zeta omega`` in 1/s of the modal damping.

        Parameters
        ----------
        squares : ndarray, shape (k,)
            Squared frequencies of the lowest modes in ascending order, 0 for rigid motions.

        Returns
        -------
        ndarray, shape (k,)
            0 for rigid motions, and everywhere without modal damping.
        """
        ratios = np.atleast_1d(np.asarray(self.modal_damping if self.modal_damping is not None else 0.0, dtype=float))
        number = np.cumsum(squares > 0.0) - 1
        return np.asarray(2.0 * ratios[np.clip(number, 0, ratios.size - 1)] * np.sqrt(squares))

    @property
    def sparse_damping(self) -> csc_matrix | None:
        """Dashpots and Rayleigh damping as one matrix; modal damping, which is dense, is not in it."""
        if self.rayleigh is None:
            return self.damping
        proportional = self.rayleigh[0] * self.mass + self.rayleigh[1] * self.stiffness
        return proportional if self.damping is None else self.damping + proportional

    def force(self, t: float) -> Array:
        """Return the load vector at time t, shape (n,)."""
        total = np.zeros(self.size)
        for load in self.loads:
            total += load.vector * float(load.function(t))
        return total


@dataclass(frozen=True)
class State:
    """Displacements and velocities at one time, each (n,), and the state of springs with memory that have a past."""

    q: Array
    v: Array
    memory: Array | None = None


@dataclass
class Counters:
    """Work done by a run. What a scene does not call for stays exactly zero.

    Work that is done once for a scene, such as eigenvalue problems and
    factorisations, is counted in the run that did it: runs that follow on the
    same scene find it done, and count none.

    Attributes
    ----------
    steps : int
        Time steps, or segments between events.
    events : int
        Closings and openings of contacts.
    gap_evaluations : int
        Evaluations of a contact's gap function.
    factorizations : int
        Matrix factorisations.
    eigensolves : int
        Full eigenvalue problems.
    rank_one_updates : int
        Eigensystems gained from another one by closing one contact.
    statuses : int
        Distinct sets of closed contacts that were visited.
    load_evaluations : int
        Evaluations of load functions.
    damping_evaluations : int
        Products with a damping matrix, or damped eigensystems.
    contact_solves : int
        Solutions of equations in the contact coordinates.
    law_evaluations : int
        Evaluations of nonlinear springs.
    memory_updates : int
        Springs with memory, times the steps over which their past was carried on.
    history_terms : int
        Numbers in which all springpots keep their past; they grow like the logarithm of the number of steps.
    history_updates : int
        Springpots, times the steps over which their past was carried on.
    rejected : int
        Steps that were tried and taken back.
    """

    steps: int = 0
    events: int = 0
    gap_evaluations: int = 0
    factorizations: int = 0
    eigensolves: int = 0
    rank_one_updates: int = 0
    statuses: int = 0
    load_evaluations: int = 0
    damping_evaluations: int = 0
    contact_solves: int = 0
    law_evaluations: int = 0
    memory_updates: int = 0
    history_terms: int = 0
    history_updates: int = 0
    rejected: int = 0


@dataclass(frozen=True)
class Events:
    """Contact events in order of time.

    Attributes
    ----------
    time : ndarray, shape (k,)
        In s.
    contact : ndarray of int, shape (k,)
        Index into the system's contacts.
    status : ndarray of int, shape (k,)
        The status entered: OPEN, CLOSED or PINNED.
    initial : ndarray of int, shape (n_contacts,)
        The status at t = 0.
    """

    time: Array = field(default_factory=lambda: np.empty(0))
    contact: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    status: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    initial: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
