"""The contract between integrators and the rest.

An integrator is a function ``run(system, start, t_end, ...) -> Solution``,
described as a `Method`, see `registry`:

1. It reads the `System` and the initial `State` only, and changes neither.
2. It refuses before its first step what it cannot treat, with an error that
   names a method that can.
3. It evaluates only what the system holds: no contacts, no gap evaluations;
   no damping, no product with C; and counts its work in `Counters`.
4. Times are computed as ``n * dt`` or as sums over few events, never
   accumulated step by step.
5. The solution it returns can be sampled at any time in [0, t_end].
6. What depends on the system alone it looks up in `System.cache`, and counts
   it only where it computes it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.system import Counters, Events

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


@dataclass(frozen=True)
class Samples:
    """Free degrees of freedom at some times: displacement, velocity, acceleration, each (n, n_times)."""

    q: Array
    v: Array
    a: Array

    def along(self, rows: Any, kind: str) -> Array:
        """Return ``rows @ q`` (kind "q", or v, a) for rows (k, n)."""
        return np.asarray(rows @ getattr(self, kind))

    def take(self, dofs: NDArray[np.int64]) -> Samples:
        """Return the samples of some degrees of freedom."""
        return Samples(self.q[dofs], self.v[dofs], self.a[dofs])

    def last(self) -> tuple[Array, Array]:
        """Return q and v at the last time, each (n,)."""
        return self.q[:, -1], self.v[:, -1]


class Sampled(Protocol):
    """What a solution returns for `Samples`: these, or something that computes them when asked for."""

    @property
    def q(self) -> Array:
        """Displacements, shape (n, n_times)."""

    @property
    def v(self) -> Array:
        """Velocities, shape (n, n_times)."""

    @property
    def a(self) -> Array:
        """Accelerations, shape (n, n_times)."""

    def along(self, rows: Any, kind: str) -> Array:
        """Return ``rows @ q`` (kind "q", or v, a) for rows (k, n)."""

    def take(self, dofs: NDArray[np.int64]) -> Sampled:
        """Return the samples of some degrees of freedom."""

    def last(self) -> tuple[Array, Array]:
        """Return q and v at the last time, each (n,)."""


@dataclass(frozen=True)
class ContactSamples:
    """Contacts at some times, each of shape (n_contacts, n_times).

    Attributes
    ----------
    status : ndarray of int
        OPEN, CLOSED or PINNED.
    stiffness : ndarray
        K_eq in N/m (Eq. 12a); of a pinned contact, reaction over gap.
    force : ndarray
        Contact force, N, positive where it pushes the bodies apart.
    """

    status: NDArray[np.int64]
    stiffness: Array
    force: Array


@dataclass(frozen=True)
class Energies:
    """Energies in J at some times, each of shape (n_times,); `dissipated` and `work` count from t = 0."""

    kinetic: Array
    strain: Array
    contact: Array
    dissipated: Array
    work: Array


@dataclass(frozen=True)
class SpringSamples:
    """Hysteretic springs, then springpots, at some times, each of shape (n_springs, n_times).

    Attributes
    ----------
    force : ndarray
        Spring force, N, positive in tension.
    stored : ndarray
        Energy that would be given back, J.
    dissipated : ndarray
        Since t = 0, J.
    past : ndarray
        The state of all springs but springpots at the last of the times.
    """

    force: Array
    stored: Array
    dissipated: Array
    past: Array


@dataclass(frozen=True)
class ProbeRows:
    """Points to be recorded at every step.

    Attributes
    ----------
    names : tuple of str
    rows : csr_matrix, shape (n_points, n)
        Over the free degrees of freedom.
    """

    names: tuple[str, ...]
    rows: csr_matrix


@dataclass(frozen=True)
class ProbeSamples:
    """Displacement, velocity and acceleration of points at times of their own, each (n_points, n_times)."""

    names: tuple[str, ...]
    times: Array
    q: Array
    v: Array
    a: Array


@dataclass(frozen=True)
class Sensitivity:
    """Growth of a generic perturbation, measured by its energy.

    Attributes
    ----------
    times : ndarray, shape (k,)
        Times in s at which the segments begin, and the end of the run.
    growth : ndarray, shape (k,)
        Decimal logarithm of the size of the perturbation, divided by its size at t = 0.
    """

    times: Array
    growth: Array

    def horizon(self, tolerance: float = 1e-3, perturbation: float = 1e-15) -> float:
        """Return the time in s until which a relative perturbation stays below a tolerance, at most the end of the run.

        The default perturbation is rounding. Beyond the time that is returned pointwise values have no meaning, but
        means, rms values and impulses may still be meaningful.
        """
        lost = self.growth + np.log10(perturbation) > np.log10(tolerance)
        return float(self.times[int(np.argmax(lost))] if np.any(lost) else self.times[-1])


@dataclass(frozen=True)
class Truncation:
    """The error of a run in which a few Ritz vectors replace all modes.

    Attributes
    ----------
    vectors, unknowns : int
        Number of Ritz vectors, and number of degrees of freedom that they represent.
    error : float
        Estimated error of displacements at contacts and loads and, in the mean over the mass, everywhere,
        relative to the largest value of each.
    until : float
        Time in s up to which `error` stays within the tolerance.
    rounding : float
        Estimated error of rounding, relative to displacements.
    """

    vectors: int
    unknowns: int
    error: float
    until: float
    rounding: float


class Solution(Protocol):
    """What a run leaves behind.

    Attributes
    ----------
    t_end : float
        End of the run, s.
    times : ndarray, shape (n_times,)
        Times at which states are stored, s.
    counters : Counters
    notes : list of str
    """

    t_end: float
    times: Array
    counters: Counters
    notes: list[str]

    @property
    def continuous(self) -> bool:
        """Whether the motion is known at any time, and not at stored times alone."""

    @property
    def springs(self) -> SpringSamples | None:
        """Hysteretic springs and springpots at `times`; None where there are none."""

    @property
    def probes(self) -> ProbeSamples | None:
        """Points that were recorded at every step; None where the method records none."""

    @property
    def modes(self) -> tuple[Array, Array] | None:
        """Squared frequencies and shapes of the contact-free modes that were used; None without modes."""

    @property
    def sensitivity(self) -> Sensitivity | None:
        """How a perturbation grows along the run; None where the method does not know."""

    @property
    def truncation(self) -> Truncation | None:
        """What Ritz vectors left out; None where all degrees of freedom were kept."""

    @property
    def start_energy(self) -> float:
        """Kinetic, strain and contact energy at t = 0, J."""

    @property
    def events(self) -> Events:
        """Contact events in order of time."""

    def sample(self, times: Array) -> Sampled:
        """Return the motion at any times in [0, t_end]."""

    def contacts(self, times: Array) -> ContactSamples:
        """Return the contacts at any times in [0, t_end]."""

    def energies(self, times: Array) -> Energies:
        """Return the energies at any times in [0, t_end]."""


def status_at(events: Events, times: Array) -> NDArray[np.int64]:
    """Return the contact status at some times, shape (n_contacts, n_times); at an event, the one entered."""
    status = np.empty((events.initial.size, times.size), dtype=np.int64)
    for j, initial in enumerate(events.initial):
        mine = events.contact == j
        history = np.concatenate([[initial], events.status[mine]])
        status[j] = history[np.searchsorted(events.time[mine], times, side="right")]
    return status
