"""The equations of motion as integrators see them: matrices, load vectors, and scalar laws on rows."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.arrays import Array
from vofem.cache import Cache
from vofem.errors import MethodError
from vofem.laws import CLOSED as CLOSED
from vofem.laws import OPEN as OPEN
from vofem.laws import PINNED as PINNED
from vofem.laws import ContactLaws, FrictionLaws, LawGroup

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix, csr_matrix


class LoadFunction(Protocol):
    """The interface of a load's function of time, as `vofem.time_functions.TimeFunction` offers it."""

    @property
    def closed_form(self) -> bool:
        """Whether pieces and derivatives are known."""

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""

    def __mul__(self, factor: Any) -> LoadFunction:
        """Return the function times a number."""

    def breakpoints(self, t_end: float) -> Array:
        """Return the times at which the closed form changes."""

    @property
    def sample_spacing(self) -> float:
        """Distance in s of the times at which a callable was evaluated; 0 if the shape is known, inf if nothing is."""

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
        What messages call the load.
    """

    vector: Array
    function: LoadFunction
    name: str


@dataclass(frozen=True)
class System:
    """``M q'' + C q' + K q = sum_l F_l f_l(t) - sum_j b_j R_j(b_j.q, b_j.q')`` over the free degrees of freedom.

    Parts that the scene does not declare are None or empty, and never zero matrices.

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
    laws : tuple of LawGroup
        Contacts first.
    scale : ndarray, shape (n,)
        Length that makes a degree of freedom a displacement; balances eigenproblems.
    rotation : ndarray of bool, shape (n,)
        True where a degree of freedom is a rotation, False where it is a displacement.
    """

    mass: csc_matrix
    stiffness: csc_matrix
    damping: csc_matrix | None
    rayleigh: tuple[float, float] | None
    modal_damping: float | Array | None
    loads: tuple[Load, ...]
    laws: tuple[LawGroup, ...]
    scale: Array
    strain: csr_matrix | None
    rigid: Array
    rotation: NDArray[np.bool_]

    @property
    def cache(self) -> Cache:
        """Values that runs have computed for this system and that later runs use; neither copied nor saved with it."""
        # `setdefault` is one operation, so all threads get the same cache.
        known: Cache = self.__dict__.get("_cache") or self.__dict__.setdefault("_cache", Cache())
        return known

    def share(self, other: System) -> None:
        """Use the cache of another system, which must differ from this one in functions of time alone."""
        self.__dict__["_cache"] = other.cache

    def with_laws(self, kind: str, laws: tuple[LawGroup, ...]) -> System:
        """Return the system with other laws. It has a cache of its own; systems that share a cache share this one too.

        `kind` says what the laws are made of.
        """
        other = replace(self, laws=laws)
        other.__dict__["_cache"] = self.cache.get(kind, None, Cache)
        return other

    def has_matrices_of(self, other: System) -> bool:
        """Return whether degrees of freedom and matrices are the same to the last bit as those of another system."""
        matrices = ("mass", "stiffness", "damping", "strain")
        plain = ("rayleigh", "modal_damping", "rigid", "scale", "rotation")
        return all(same_matrix(getattr(self, name), getattr(other, name)) for name in matrices) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in plain
        )

    def has_load_vectors_of(self, other: System) -> bool:
        """Return whether the loads act at the same places as those of another system, whatever their functions."""
        pairs = zip(self.loads, other.loads, strict=False)
        return len(self.loads) == len(other.loads) and all(np.array_equal(a.vector, b.vector) for a, b in pairs)

    def has_contact_rows_of(self, other: System) -> bool:
        """Return whether the contacts act at the same places as those of another system, or both have none."""
        return same_matrix(*(None if one.contacts is None else one.contacts.rows for one in (self, other)))

    def share_what_is_equal(self, other: System) -> bool:
        """Use those parts of another system's cache that depend on nothing in which the two systems differ.

        Modes depend on matrices, rows and load vectors, those with contacts closed on the contacts' stiffness too.
        Returns whether anything is shared.
        """
        if self.cache is other.cache:
            return True
        if not (
            self.has_matrices_of(other)
            and self.has_load_vectors_of(other)
            and [type(group) for group in self.laws] == [type(group) for group in other.laws]
            and all(same_matrix(a.rows, b.rows) for a, b in zip(self.laws, other.laws, strict=True))
        ):
            return False
        mine, theirs = self.contacts, other.contacts
        if all(group is mine for group in self.laws) and (
            mine is None or theirs is None or np.array_equal(mine.numbers(), theirs.numbers())
        ):
            self.share(other)
            return True
        kinds = [
            "modal space",
            "magnitudes of contact rows",
            "sizes of modal contact rows",
            "damping matrix",
            "static loss",
        ]
        if mine is not None and theirs is not None and np.array_equal(mine.stiffness, theirs.stiffness):
            kinds += ["closed modes"]
        self.cache.adopt(kinds, other.cache)
        return True

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_cache"}

    @property
    def size(self) -> int:
        """Number of free degrees of freedom."""
        return int(self.scale.size)

    @property
    def contacts(self) -> ContactLaws | None:
        """The contacts; None where there are none.

        They alone have gaps and events, on which `event_driven`, histories of contacts and pictures of K_eq are built.
        Everything else asks each of `laws`.
        """
        return next((group for group in self.laws if isinstance(group, ContactLaws)), None)

    @property
    def sliders(self) -> FrictionLaws | None:
        """The sliders; None where there are none."""
        return next((group for group in self.laws if isinstance(group, FrictionLaws)), None)

    @property
    def driven(self) -> Any:
        """The law that the applied load drives, which is alone in its system; None where there is none."""
        return next((group.driven for group in self.laws if group.driven is not None), None)

    def first_of(self, group: LawGroup) -> int:
        """Return the number of a group's first law among all."""
        return sum(len(before) for before in self.laws[: self.laws.index(group)])

    @property
    def histories(self) -> int:
        """Number of laws whose forces and energies are recorded along a run."""
        return sum(len(group) for group in self.recorded)

    @property
    def recorded(self) -> tuple[LawGroup, ...]:
        """The groups whose forces and energies are recorded along a run."""
        return tuple(group for group in self.laws if group.recorded)

    @property
    def without_past(self) -> tuple[str, ...]:
        """Names of springpots and of sliders with a spring, with whose past no other run can start."""
        lost = tuple(name for group in self.laws if not group.past_is_kept for name in group.names)
        sliders = () if self.sliders is None else self.sliders.laws
        return lost + tuple(law.name for law in sliders if np.isfinite(law.stiffness))

    @property
    def travelling(self) -> str | None:
        """What messages call the first load or law that travels along a beam; None where all stay in their places."""
        for load in self.loads:
            if getattr(load.function, "travels", False):
                return load.name
        return next((group.travelling for group in self.laws if group.travelling is not None), None)

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


def refuse_travelling(what: str, system: System) -> None:
    """Raise `MethodError` where something travels along a beam, which only runs in time take into account."""
    if system.travelling is not None:
        raise MethodError(
            f"{what}: {system.travelling}: {what} takes no account of what travels along a beam; simulate the scene, "
            "or give beam.at(x) for a place of interest"
        )


def same_matrix(one: Any, two: Any) -> bool:
    """Return whether two sparse matrices, each of which may be missing, are the same to the last bit."""
    if one is None or two is None:
        return one is two
    if one.shape != two.shape:
        return False
    if one.format == two.format and np.array_equal(one.indptr, two.indptr) and np.array_equal(one.indices, two.indices):
        return bool(np.array_equal(one.data, two.data))
    return (one != two).nnz == 0


@dataclass(frozen=True)
class State:
    """Displacements and velocities at one time, each (n,), and the internal variables of laws that have a past."""

    q: Array
    v: Array
    internal: Array | None = None


@dataclass
class Counters:
    """Counts of the work done by a run. Counts of effects that the scene does not contain are exactly zero.

    Work that is done once for a scene, such as eigenvalue problems and
    factorisations, is counted in the run that did it. Later runs of the same
    scene reuse it and count zero.

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
        Eigensystems of the structure with some contacts closed or pinned, a rank-one term for each of these.
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
        Number of hysteretic springs times the number of steps that updated their internal variables.
    history_terms : int
        Count of the numbers that describe the past of all springpots. It grows like the logarithm of the steps.
    history_updates : int
        Number of springpots times the number of steps that updated their past.
    rejected : int
        Steps that were tried and rejected.
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
        Times of the events, s.
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

    def stays(self, contact: int, *statuses: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the numbers of the events at which a contact enters some statuses (-1: the start), and leaves them."""
        mine = np.flatnonzero(self.contact == contact)
        held = np.isin(np.append(self.initial[contact], self.status[mine]), statuses)
        turned, numbers = np.diff(held, prepend=False), np.append(-1, mine)
        return numbers[turned & held], numbers[turned & ~held]

    def times(self, contact: int, *statuses: int) -> tuple[Array, Array]:
        """Return the times in s at which a contact enters some statuses (0: the start), and leaves them."""
        entered, left = self.stays(contact, *statuses)
        return np.append(self.time, 0.0)[entered], self.time[left]
