"""Eigensystems of the linear pieces: one per contact status, as a set of independent blocks.

A status becomes blocks

    z' = v + g1,    v' = -2 delta v - p z + g2,

one per pair of roots. First the real orthogonal modes of the structure with its closed and pinned contacts are
computed. Where damping couples these modes, they are split further by complex modes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.cache import Cache
from vofem.errors import SingularSystemError
from vofem.integrators.event_driven.complex_modes import Blocks, damped_blocks, state_scale
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.linalg.eigen import modes_held, modes_of_strains
from vofem.system import CLOSED, PINNED, ContactLaws, Counters

Status = NDArray[np.int64]

#: Ratio of frequencies between two levels of a spectrum.
_LEVEL_RATIO = 6.0

#: Memory that kept eigensystems may take, bytes.
_MOST_MEMORY = 512 * 2**20


@dataclass(frozen=True)
class RealModes:
    """Undamped modes of a contact status, expressed in the modes of the contact-free system.

    ``diag(omega^2) V + sum_closed K0 c c' V = V diag(p) + Q' N``, where N are the forces in the pinned rows Q.
    """

    p: Array  #: Squared frequencies, ascending; m is n less the number of pinned contacts. Shape (m,).
    modes: Array | None  #: Orthonormal columns V; None stands for the identity. Shape (n, m).
    pinned: Array  #: Rows Q of the pinned contacts, shape (k, n).
    force: Array  #: N, shape (k, m).
    #: Modal displacement that puts pinned contacts at their gaps; None where none is pinned. Shape (n,).
    shift: Array | None = None
    #: Force that is needed beside the reactions to keep the shift in equilibrium (only if there are rigid motions),
    #: shape (n,).
    shift_force: Array | None = None
    shift_reaction: Array | None = None  #: Reactions to the shift, shape (k,).
    #: The last three for a gap of 1 of one contact each, shapes (n, k), (n, k) and (k, k).
    lifts: tuple[Array, Array, Array] | None = None

    def down(self, vector: Any) -> Any:
        """Return ``V' vector``."""
        return vector if self.modes is None else self.modes.T @ vector

    def up(self, coordinates: Any) -> Any:
        """Return ``V coordinates``."""
        return coordinates if self.modes is None else self.modes @ coordinates


@dataclass(frozen=True)
class Spectrum:
    """The blocks of one contact status, ordered by p, and the maps between modes and blocks."""

    #: `delta`, `p`: decay rate in 1/s and squared frequency in 1/s^2 of each block; see `Blocks` for those of clusters.
    #: Shape (m,).
    delta: Array
    p: Array
    real: RealModes
    blocks: Blocks | None = None  #: The blocks, if damping couples the real modes.
    damping: Array | None = None  #: Damping matrix of the real modes, if damping couples them, shape (m, m).

    @cached_property
    def frequency(self) -> Array:
        """Undamped frequency of each block in rad/s, ascending, shape (m,)."""
        return np.sqrt(self.p)

    @cached_property
    def levels(self) -> NDArray[np.int64]:
        """Block counts at which the frequency has grown by another factor; the last is all blocks."""
        positive = self.frequency[self.frequency > 0]
        if positive.size < 2:
            return np.array([self.p.size], dtype=np.int64)
        count = int(np.ceil(np.log(positive[-1] / positive[0]) / np.log(_LEVEL_RATIO)))
        edges = positive[0] * _LEVEL_RATIO ** np.arange(1, min(count, 40))
        return np.unique(np.append(np.searchsorted(self.frequency, edges), self.p.size)).astype(np.int64)

    @cached_property
    def plain(self) -> Array | None:
        """One for every block of its own, zero for the members of clusters, shape (m,); None where there are none."""
        if self.blocks is None or not self.blocks.clusters:
            return None
        plain = np.ones(self.p.size)
        for cluster in self.blocks.clusters:
            plain[cluster.member] = 0.0
        return plain

    @cached_property
    def unloaded(self) -> dict[bytes, Any]:
        """What has this eigensystem of its own, by all on which that depends; see `Unloaded`."""
        return {}

    def to_blocks(self, displacement: Array, velocity: Array, *, shifted: bool = True) -> tuple[Array, Array]:
        """Return block states (z, v), (m,) or (m, k), of modal states, (n,) or (n, k), or of differences of states."""
        if self.real.shift is not None and shifted:
            shift = self.real.shift if displacement.ndim == 1 else self.real.shift[:, None]
            displacement = displacement - shift
        x, rate = self.real.down(displacement), self.real.down(velocity)
        if self.blocks is None:
            # Copied where the modes are the identity, because callers may change the result in place.
            return (x, rate) if self.real.modes is not None else (x.copy(), rate.copy())
        both = self.blocks.into @ np.concatenate([x, rate])
        return both[: self.p.size], both[self.p.size :]

    def to_real(self, z: Array, v: Array) -> tuple[Array, Array]:
        """Return coordinates and rates of the real modes, shape (m, ...), of block states (m, ...)."""
        if self.blocks is None:
            return z, v
        both = self.blocks.out @ np.concatenate([z, v])
        return both[: self.p.size], both[self.p.size :]

    def to_modes(self, z: Array, v: Array, *, shifted: bool = True) -> tuple[Array, Array]:
        """Return modal displacement and velocity, (n,) or (n, n_times), of block states (m, ...), or of differences."""
        x, rate = self.to_real(z, v)
        displacement, velocity = self.real.up(x), self.real.up(rate)
        if self.real.shift is not None and shifted:
            shift = self.real.shift if displacement.ndim == 1 else self.real.shift[:, None]
            displacement = displacement + shift
        return displacement, velocity

    def real_inputs(self, force: Array) -> Array:
        """Return block inputs (g1 above g2), shape (2m, k), of forces on the real modes, shape (m, k)."""
        return np.concatenate([np.zeros_like(force), force]) if self.blocks is None else self._into @ force

    def functions(self, displacement: Array, velocity: Array | None = None) -> tuple[Array, Array]:
        """Return (W, U) with ``A x + B x' = W z + U v`` for rows A, B over the real modes x, each (k, m).

        U has no columns where it would be zero.
        """
        m = self.p.size
        if self.blocks is None:
            u = np.zeros((displacement.shape[0], 0)) if velocity is None else np.ascontiguousarray(velocity)
            return np.ascontiguousarray(displacement), u
        both = displacement @ self.blocks.out[:m]
        if velocity is not None:
            both = both + velocity @ self.blocks.out[m:]
        return np.ascontiguousarray(both[:, :m]), np.ascontiguousarray(both[:, m:])

    def sizes(self, displacement: Array, velocity: Array | None = None) -> tuple[Array, Array]:
        """Return bounds on the terms of the sums in `functions`, from such bounds over the real modes, (k, m)."""
        m = self.p.size
        if self.blocks is None:
            return self.functions(displacement, velocity)
        out = self._out_sizes
        both = displacement @ out[:m]
        if velocity is not None:
            both = both + velocity @ out[m:]
        return np.ascontiguousarray(both[:, :m]), np.ascontiguousarray(both[:, m:])

    @cached_property
    def _into(self) -> Array:
        """Block states for unit rates of the real modes, shape (2m, m)."""
        assert self.blocks is not None
        return np.ascontiguousarray(self.blocks.into[:, self.p.size :])

    @cached_property
    def _out_sizes(self) -> Array:
        """Bounds on the terms of the map from blocks, shape (2m, 2m).

        The error of a complex mode is rounding of its energy, so the share of a
        slow motion in a fast mode may be nothing but rounding.
        """
        assert self.blocks is not None
        assert self.damping is not None
        omega = state_scale(self.real.p, self.damping.diagonal())
        omega = np.where(omega > 0.0, omega, 1.0)
        scale = np.concatenate([omega, np.ones(omega.size)])
        out = np.abs(self.blocks.out)
        energy = np.sqrt(np.sum((scale[:, None] * out) ** 2, axis=0))
        floor = np.outer(1.0 / scale, energy)
        # Parts that are not coupled have no common terms.
        return np.where(out > 0.0, np.maximum(out, floor), 0.0)

    def rows(self, rows: Array, sizes: Array) -> tuple[Array, Array, Array, Array]:
        """Return (W, U) with ``rows @ displacement = W z + U v`` for modal rows (k, n), the shift aside.

        Bounds on the terms of each entry, from which its rounding follows, are returned too; they come from the rows'.
        """
        modes = self.real.modes
        if modes is None:
            return *self.functions(rows), *self.sizes(sizes)
        return *self.functions(rows @ modes), *self.sizes(sizes @ np.abs(modes))


class Spectra:
    """Eigensystems of the statuses that a run visits, computed when first visited, within a bound on memory.

    `cache`: of the system; holds the eigensystems of earlier runs.
    `capacity`: largest number of eigensystems that are kept; the oldest is dropped first.
    """

    def __init__(self, space: ModalSpace, laws: ContactLaws | None, counters: Counters, cache: Cache) -> None:
        self._space = space
        self._laws = laws
        self._counters = counters
        self._cache = cache
        self._known: dict[bytes, Spectrum] = {}
        self._visited: set[bytes] = set()
        undamped = space.coupling is None and not np.any(space.damping) and (laws is None or not np.any(laws.damping))
        matrices = 1 if undamped else 4
        self.capacity = max(8, _MOST_MEMORY // (8 * matrices * max(space.size, 1) ** 2))

    def __getitem__(self, status: Status) -> Spectrum:
        """Return the eigensystem of a status, shape (n_contacts,)."""
        key = status.tobytes()
        if key not in self._known:
            if key not in self._visited:
                self._visited.add(key)
                self._counters.statuses += 1
            while len(self._known) >= self.capacity:
                del self._known[next(iter(self._known))]
            self._known[key] = self._cache.get("eigensystem", key, lambda: self._compute(status), self.capacity)
        return self._known[key]

    def _compute(self, status: Status) -> Spectrum:
        space, laws = self._space, self._laws
        real = self._real_modes(status)
        dampers = np.zeros(0) if laws is None else laws.damping * (status == CLOSED)
        uniform = space.damping.size == 0 or bool(np.all(space.damping == space.damping[0]))
        mixed = real.modes is not None and not uniform
        if space.coupling is None and not np.any(dampers > 0) and not mixed:
            return Spectrum(delta=0.5 * space.damping[: real.p.size], p=real.p, real=real)
        self._counters.eigensolves += 1
        self._counters.damping_evaluations += 1
        modes = np.eye(space.size) if real.modes is None else real.modes
        damping = (modes.T * space.damping) @ modes
        if space.coupling is not None:
            damping = damping + modes.T @ space.coupling @ modes
        rows = space.contacts @ modes
        damping = damping + (rows.T * dampers) @ rows
        damping = 0.5 * (damping + damping.T)
        blocks = damped_blocks(real.p, damping)
        return Spectrum(blocks.delta, blocks.p, real, blocks, damping)

    def _real_modes(self, status: Status) -> RealModes:
        """Return the undamped modes of a status."""
        space, laws, none = self._space, self._laws, np.zeros((0, self._space.size))
        closed, held = status == CLOSED, status == PINNED
        real = RealModes(space.stiffness, None, none, none)
        if laws is not None and np.any(closed):
            work = partial(modes_of_strains, space.stiffness, space.contacts[closed], laws.stiffness[closed])
            found = self._cache.get("closed modes", closed.tobytes(), lambda: self._counted(work), self.capacity)
            real = RealModes(*found, none, none)
        if laws is None or not np.any(held):
            return real
        try:
            return self._pinned(real, space.contacts[held], laws.gap[held])
        except np.linalg.LinAlgError:
            raise SingularSystemError(
                f"{' and '.join(laws.labels[j] for j in np.flatnonzero(held))} hold bodies at rest at once, but their "
                "coordinates depend on each other, so the reactions are not unique; give one of them a stiffness"
            ) from None

    def _pinned(self, closed: RealModes, pinned: Array, gap: Array) -> RealModes:
        """Return the modes with some contacts held at their gaps.

        Forces and shift solve their equations with the inverse stiffness as weight, because soft motions carry them.
        Where the structure has no rigid motion, the reactions alone balance the shift.
        """
        p, rows = closed.p, pinned if closed.modes is None else pinned @ closed.modes
        squares, modes = self._counted(partial(modes_held, p, rows))
        loose = p == 0.0
        weight = 1.0 / np.where(loose, float(np.median(p[~loose])) if not loose.all() else 1.0, p)
        gram = (rows * weight) @ rows.T
        force = -np.linalg.solve(gram, rows @ (loose[:, None] * modes + weight[:, None] * modes * squares))
        reaction = np.asarray(np.linalg.solve(gram, gap), dtype=float)
        push = rows.T @ reaction
        one = np.asarray(np.linalg.inv(gram), dtype=float)
        each = rows.T @ one
        lifts = closed.up(weight[:, None] * each), closed.up(np.where(loose[:, None], each, 0.0)), one
        return RealModes(
            squares, closed.up(modes), pinned, force, closed.up(weight * push), closed.up(np.where(loose, push, 0.0)),
            reaction, lifts,
        )  # fmt: skip

    def _counted(self, work: Callable[[], tuple[Array, Array]]) -> tuple[Array, Array]:
        """Return what an eigenproblem of contacts returns, and count it."""
        self._counters.rank_one_updates += 1
        return work()
