"""Where bodies and effects are gathered into one System.

Effects call the ``add_*`` methods; what none of them calls is never built.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from vofem.bodies.base import Array, Body, BodyMatrices, IntArray, Point, Row
from vofem.errors import ArgumentError
from vofem.linalg.null_space import null_space, tied
from vofem.system import ContactLaws, Load, LoadFunction, NonlinearLaw, NonlinearLaws, System

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

#: Above so many rigid motions of the bodies, ties between them are followed one by one.
_MANY_MOTIONS = 500


class Effect(Protocol):
    """Something that acts on bodies. Effects compare and hash by identity."""

    def compile(self, builder: SystemBuilder) -> None:
        """Add to the system what the effect is, by the builder's ``add_*`` methods."""

    def points(self) -> tuple[Point, ...]:
        """Return the points that the effect touches; their bodies must be in the scene."""

    def describe(self) -> str:
        """Return one line for `vofem.explain`."""


@dataclass(frozen=True)
class ContactEntry:
    """One contact as `SystemBuilder.add_contact` takes it; the fields are those of `ContactLaws`."""

    name: str
    row: Row
    gap: float
    stiffness: float
    damping: float
    jump: bool
    resolution: float


@dataclass(frozen=True)
class Model:
    """A System and the way back to the bodies.

    Attributes
    ----------
    system : System
        Over the free degrees of freedom.
    offsets : dict of Body to int
        Where a body's degrees of freedom begin among all.
    free : ndarray of int, shape (n,)
        The free degrees of freedom among all.
    mass, stiffness : csr_matrix, shape (N, N)
        Over all degrees of freedom, supported ones included; for reactions.
    damping : csr_matrix, optional
        Of bodies and dashpots.
    load_vectors : tuple of ndarray, shape (N,)
        One per load of the system.
    contact_rows : csr_matrix, shape (n_contacts, N), optional
    nonlinear_rows : csr_matrix, shape (n_laws, N), optional
    """

    system: System
    offsets: dict[Body, int]
    free: IntArray
    mass: csr_matrix
    stiffness: csr_matrix
    damping: csr_matrix | None
    load_vectors: tuple[Array, ...]
    contact_rows: csr_matrix | None
    nonlinear_rows: csr_matrix | None

    @property
    def size(self) -> int:
        """Number of all degrees of freedom N."""
        return int(self.mass.shape[0])

    def expand(self, q: Array) -> Array:
        """Return free values (n, ...) as values of all degrees of freedom (N, ...), zero at supports."""
        full = np.zeros((self.size, *q.shape[1:]))
        full[self.free] = q
        return full

    def of_body(self, body: Body, q: Array) -> Array:
        """Return one body's values, shape (body.size, ...), out of free values (n, ...)."""
        start = self.offsets[body]
        inside = (self.free >= start) & (self.free < start + body.size)
        values = np.zeros((body.size, *q.shape[1:]))
        values[self.free[inside] - start] = q[inside]
        return values


class _Triplets:
    """Coordinate entries of one symmetric matrix over all degrees of freedom."""

    def __init__(self) -> None:
        self.rows: list[IntArray] = []
        self.columns: list[IntArray] = []
        self.values: list[Array] = []

    def add_matrix(self, matrix: Any, offset: int) -> None:
        coo = matrix.tocoo()
        self.rows.append(coo.row.astype(np.int64) + offset)
        self.columns.append(coo.col.astype(np.int64) + offset)
        self.values.append(coo.data)

    def add_rank_one(self, row: Row, factor: float) -> None:
        k = row.indices.size
        self.rows.append(np.repeat(row.indices, k))
        self.columns.append(np.tile(row.indices, k))
        self.values.append(factor * np.outer(row.weights, row.weights).ravel())

    def build(self, size: int) -> csr_matrix | None:
        from scipy.sparse import coo_matrix

        if not self.rows:
            return None
        entries = (np.concatenate(self.rows), np.concatenate(self.columns))
        return coo_matrix((np.concatenate(self.values), entries), shape=(size, size)).tocsr()


class SystemBuilder:
    """Collects what bodies and effects contribute.

    Parameters
    ----------
    bodies : sequence of Body
        In the order in which their degrees of freedom are numbered.
    """

    def __init__(self, bodies: Sequence[Body]) -> None:
        self.offsets: dict[Body, int] = {}
        self._mass, self._stiffness, self._damping = _Triplets(), _Triplets(), _Triplets()
        self._attached = _Triplets()
        self._springs: list[tuple[Row, float]] = []
        self._strains: list[tuple[int, csr_matrix]] = []
        self._nonlinear: list[tuple[Row, NonlinearLaw]] = []
        self._rayleigh: tuple[float, float] | None = None
        self._modal: float | None = None
        self._loads: list[Load] = []
        self._contacts: list[ContactEntry] = []
        supported: list[IntArray] = []
        scales: list[Array] = []
        self.size = 0
        for body in bodies:
            matrices = self._check(body, body.matrices())
            self.offsets[body] = self.size
            self._mass.add_matrix(matrices.mass, self.size)
            self._stiffness.add_matrix(matrices.stiffness, self.size)
            if matrices.damping is not None:
                self._damping.add_matrix(matrices.damping, self.size)
            supported.append(matrices.supported + self.size)
            scales.append(matrices.scale)
            self.size += body.size
        self._supported = np.concatenate(supported)
        self._scale = np.concatenate(scales)
        self._accelerations: list[tuple[float, LoadFunction, str, Body | None]] = []

    @staticmethod
    def _check(body: Body, matrices: BodyMatrices) -> BodyMatrices:
        for kind, matrix in (("mass", matrices.mass), ("stiffness", matrices.stiffness)):
            if not np.all(np.isfinite(matrix.data)):
                raise ArgumentError(
                    f"{body.label}: the {kind} matrix overflows; check the units of length, EI and rhoA"
                )
        return matrices

    # -- rows -------------------------------------------------------------------------------------

    def row(self, point: Point, *, slope: bool = False) -> Row:
        """Return a point's row over all degrees of freedom."""
        local = point.slope_row() if slope else point.row()
        return Row(local.indices + self.offsets[point.body], local.weights)

    def difference(self, a: Point, b: Point | None, *, slope: bool = False) -> Row:
        """Return the row of ``u_a - u_b``, or of ``u_a`` where b is None."""
        first = self.row(a, slope=slope)
        if b is None:
            return first
        second = self.row(b, slope=slope)
        return Row(np.concatenate([first.indices, second.indices]), np.concatenate([first.weights, -second.weights]))

    # -- contributions ----------------------------------------------------------------------------

    def add_stiffness(self, row: Row, stiffness: float) -> None:
        """Add ``stiffness * b b'`` to K."""
        self._attached.add_rank_one(row, stiffness)
        self._springs.append((row, stiffness))

    def add_strains(self, body: Body, strains: csr_matrix) -> None:
        """Add ``D'D`` to K, D being strain rows over one body's degrees of freedom, shape (k, body.size)."""
        self._attached.add_matrix(strains.T @ strains, self.offsets[body])
        self._strains.append((self.offsets[body], strains))

    def add_damping(self, row: Row, damping: float) -> None:
        """Add ``damping * b b'`` to C."""
        self._damping.add_rank_one(row, damping)

    def add_mass(self, row: Row, mass: float) -> None:
        """Add ``mass * b b'`` to M."""
        self._mass.add_rank_one(row, mass)

    def add_rayleigh(self, alpha: float, beta: float) -> None:
        """Add ``alpha M + beta K`` to C, M and K being the contact-free matrices with all attachments."""
        before = self._rayleigh or (0.0, 0.0)
        self._rayleigh = (before[0] + alpha, before[1] + beta)

    def add_modal_damping(self, ratio: float) -> None:
        """Damp every mode of (K, M) by a ratio of its critical damping."""
        self._modal = (self._modal or 0.0) + ratio

    def add_point_load(self, row: Row, function: LoadFunction, name: str) -> None:
        """Add the load ``b * function(t)``."""
        vector = np.zeros(self.size)
        np.add.at(vector, row.indices, row.weights)
        self._loads.append(Load(vector, function, name))

    def add_body_load(self, body: Body, values: Array, function: LoadFunction, name: str) -> None:
        """Add a load vector over one body's degrees of freedom, times a function."""
        vector = np.zeros(self.size)
        start = self.offsets[body]
        vector[start : start + body.size] = values
        self._loads.append(Load(vector, function, name))

    def add_acceleration(self, value: float, function: LoadFunction, name: str, body: Body | None = None) -> None:
        """Add the load ``value M r function(t)``, r being a unit translation of one body, or of all."""
        self._accelerations.append((value, function, name, body))

    def add_nonlinear(self, row: Row, law: NonlinearLaw) -> None:
        """Add a smooth scalar law on a row."""
        self._nonlinear.append((row, law))

    def add_contact(self, entry: ContactEntry) -> None:
        """Add a contact."""
        self._contacts.append(entry)

    # -- result -----------------------------------------------------------------------------------

    def build(self) -> Model:
        """Return the model: global matrices, and the System over the free degrees of freedom."""
        mass, stiffness = self._mass.build(self.size), self._stiffness.build(self.size)
        assert mass is not None
        assert stiffness is not None
        damping = self._damping.build(self.size)
        attached = self._attached.build(self.size)
        strains = self._attached_strains()
        if attached is not None:
            stiffness = stiffness + attached
        held = np.zeros(self.size, dtype=bool)
        held[self._supported] = True
        free = np.flatnonzero(~held)
        if not free.size:
            raise ArgumentError("the supports hold every degree of freedom, so nothing can move; remove some")

        place = np.full(self.size, -1)
        place[free] = np.arange(free.size)

        def restrict(matrix: csr_matrix) -> Any:
            if free.size == self.size:
                return matrix.tocsc()
            from scipy.sparse import csc_matrix

            coo = matrix.tocoo()
            row, column = place[coo.row], place[coo.col]
            kept = (row >= 0) & (column >= 0)
            return csc_matrix((coo.data[kept], (row[kept], column[kept])), shape=(free.size, free.size))

        for value, function, name, only in self._accelerations:
            translation = np.concatenate([body.translation() * (only is None or body is only) for body in self.offsets])
            self._loads.append(Load(value * (mass @ translation), function, name))
        contact_rows, contacts = self._build_contacts(free)
        nonlinear_rows = self._rows([row for row, _ in self._nonlinear]) if self._nonlinear else None
        system = System(
            mass=restrict(mass),
            stiffness=restrict(stiffness),
            damping=None if damping is None else restrict(damping),
            rayleigh=self._rayleigh,
            modal_damping=self._modal,
            loads=tuple(Load(load.vector[free], load.function, load.name) for load in self._loads),
            contacts=contacts,
            nonlinear=self._nonlinear_laws(nonlinear_rows, free),
            scale=self._scale[free],
            strain=self._strain_rows(strains, free),
            rigid=self._rigid_motions(strains)[free],
        )
        vectors = tuple(load.vector for load in self._loads)
        return Model(system, self.offsets, free, mass, stiffness, damping, vectors, contact_rows, nonlinear_rows)

    def _rows(self, rows: Sequence[Row]) -> csr_matrix:
        """Return rows as one matrix over all degrees of freedom, shape (len(rows), N)."""
        from scipy.sparse import csr_matrix

        indices = np.concatenate([row.indices for row in rows])
        weights = np.concatenate([row.weights for row in rows])
        ends = np.cumsum([0, *(row.indices.size for row in rows)])
        return csr_matrix((weights, indices, ends), shape=(len(rows), self.size))

    def _nonlinear_laws(self, rows: csr_matrix | None, free: IntArray) -> NonlinearLaws | None:
        if rows is None:
            return None
        return NonlinearLaws(rows[:, free].tocsr(), tuple(law for _, law in self._nonlinear))

    def _attached_strains(self) -> csr_matrix | None:
        """Return the strain rows of springs and foundations over all degrees of freedom, or None."""
        from scipy.sparse import csr_matrix, vstack

        parts = []
        if self._springs:
            parts.append(self._rows([Row(row.indices, np.sqrt(k) * row.weights) for row, k in self._springs]))
        for start, strains in self._strains:
            shifted = (strains.data, strains.indices + start, strains.indptr)
            parts.append(csr_matrix(shifted, shape=(strains.shape[0], self.size)))
        return vstack(parts, format="csr") if parts else None

    def _strain_rows(self, attached: csr_matrix | None, free: IntArray) -> csr_matrix | None:
        """Return D with ``K = D'D`` over the free degrees of freedom, or None."""
        from scipy.sparse import block_diag, vstack

        rows = [row for body in self.offsets if (row := body.strain_rows()) is not None]
        if len(rows) < len(self.offsets):
            return None
        whole = rows[0] if len(rows) == 1 else block_diag(rows, format="csr")
        if attached is not None:
            whole = vstack([whole, attached], format="csr")
        return whole[:, free] if free.size < self.size else whole

    def _rigid_motions(self, attached: csr_matrix | None) -> Array:
        """Return a basis, shape (N, r), of the motions that strain nothing and violate no support.

        They are sought among the rigid motions of the bodies, a problem of a
        few unknowns: the large matrices cannot tell a soft body from a free one.
        """
        blocks: list[tuple[int, Array]] = []
        for body, start in self.offsets.items():
            motions = body.rigid_motions()
            held = self._supported[(self._supported >= start) & (self._supported < start + body.size)] - start
            motions = motions @ null_space(motions[held], np.ones_like(motions[held]))
            blocks.extend((start, motions[:, [k]]) for k in range(motions.shape[1]))
        if attached is not None and len(blocks) > _MANY_MOTIONS:
            return self._rigid_motions_of_many(attached, blocks)
        basis = np.zeros((self.size, len(blocks)))
        for k, (start, motion) in enumerate(blocks):
            basis[start : start + motion.shape[0], k] = motion[:, 0]
        if attached is None or not blocks:
            return basis
        return basis @ null_space(np.asarray(attached @ basis), np.asarray(abs(attached) @ np.abs(basis)))

    def _rigid_motions_of_many(self, attached: csr_matrix, blocks: list[tuple[int, Array]]) -> Array:
        """Do the same where the bodies are so many that a dense matrix of their motions would not fit: a chain."""
        from scipy.sparse import csc_matrix

        sizes = np.array([motion.shape[0] for _, motion in blocks])
        dofs = np.concatenate([np.arange(start, start + motion.shape[0]) for start, motion in blocks])
        values = np.concatenate([motion[:, 0] for _, motion in blocks])
        sparse = csc_matrix((values, dofs, np.cumsum([0, *sizes])), shape=(self.size, len(blocks)))
        strains, magnitude = (attached @ sparse).tocsr(), (abs(attached) @ abs(sparse)).tocsr()
        few = tied(strains, magnitude)
        basis = np.asarray(sparse @ few)
        if not few.shape[1]:
            return basis
        return basis @ null_space(np.asarray(strains @ few), np.asarray(magnitude @ np.abs(few)))

    def _build_contacts(self, free: IntArray) -> tuple[Any, ContactLaws | None]:
        entries = self._contacts
        if not entries:
            return None, None
        names = [e.name for e in entries]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise ArgumentError(f"contacts named {twice!r} occur more than once; give each its own name")
        rows = self._rows([e.row for e in entries])
        laws = ContactLaws(
            names=tuple(e.name for e in entries),
            rows=rows[:, free].tocsr(),
            gap=np.array([e.gap for e in entries]),
            stiffness=np.array([e.stiffness for e in entries]),
            damping=np.array([e.damping for e in entries]),
            jump=np.array([e.jump for e in entries]),
            resolution=np.array([e.resolution for e in entries]),
        )
        for name, row in zip(laws.names, laws.rows, strict=True):
            if not np.any(row.data):
                raise ArgumentError(f"Contact {name!r} can never move: its points lie on supports")
        return rows, laws
