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
from vofem.linalg.null_space import null_space, sparse_null_space
from vofem.memory import MemoryLaw, PrintedLaw, SpringpotLaw
from vofem.system import (
    ContactLaws,
    Load,
    LoadFunction,
    MemoryLaws,
    NonlinearLaw,
    NonlinearLaws,
    SpringpotLaws,
    System,
)

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


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
    memory_rows : csr_matrix, shape (n_springs, N), optional
    springpot_rows : csr_matrix, shape (n_springpots, N), optional
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
    memory_rows: csr_matrix | None
    springpot_rows: csr_matrix | None = None

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


def _entries(matrix: Any) -> tuple[IntArray, IntArray, Array]:
    """Return rows, columns and values of a matrix, in csr form or small and dense."""
    if isinstance(matrix, np.ndarray):
        rows, columns = np.indices(matrix.shape).reshape(2, -1)
        return rows, columns, matrix.ravel()
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    return rows, matrix.indices.astype(np.int64), matrix.data


class _Triplets:
    """Coordinate entries of one symmetric matrix over all degrees of freedom."""

    def __init__(self) -> None:
        self.rows: list[IntArray] = []
        self.columns: list[IntArray] = []
        self.values: list[Array] = []

    def add_matrix(self, matrix: Any, row: int, column: int) -> None:
        rows, columns, values = _entries(matrix)
        self.rows.append(rows + row)
        self.columns.append(columns + column)
        self.values.append(values)

    def add_rank_one(self, row: Row, factor: float) -> None:
        k = row.indices.size
        self.rows.append(np.repeat(row.indices, k))
        self.columns.append(np.tile(row.indices, k))
        self.values.append(factor * np.outer(row.weights, row.weights).ravel())

    def build(self, size: int, columns: int | None = None) -> csr_matrix | None:
        from scipy.sparse import coo_matrix

        if not self.rows:
            return None
        entries = (np.concatenate(self.rows), np.concatenate(self.columns))
        return coo_matrix((np.concatenate(self.values), entries), shape=(size, columns or size)).tocsr()


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
        self._memory: list[tuple[Row, MemoryLaw]] = []
        self._printed: list[PrintedLaw] = []
        self._springpots: list[tuple[Row, SpringpotLaw]] = []
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
            self._mass.add_matrix(matrices.mass, self.size, self.size)
            self._stiffness.add_matrix(matrices.stiffness, self.size, self.size)
            if matrices.damping is not None:
                self._damping.add_matrix(matrices.damping, self.size, self.size)
            supported.append(matrices.supported + self.size)
            scales.append(matrices.scale)
            self.size += body.size
        self._supported = np.concatenate(supported)
        self._scale = np.concatenate(scales)
        self._accelerations: list[tuple[float, LoadFunction, str, Body | None]] = []

    @staticmethod
    def _check(body: Body, matrices: BodyMatrices) -> BodyMatrices:
        for kind, matrix in (("mass", matrices.mass), ("stiffness", matrices.stiffness)):
            if not np.all(np.isfinite(_entries(matrix)[2])):
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
        self._attached.add_matrix((strains.T @ strains).tocsr(), self.offsets[body], self.offsets[body])
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

    def add_memory(self, row: Row, law: MemoryLaw) -> None:
        """Add a law with memory on a row."""
        self._memory.append((row, law))

    def add_printed(self, law: PrintedLaw) -> None:
        """Add Eq. 22 as it stands; the scene must hold nothing but one loaded mass on this spring, and dampers."""
        self._printed.append(law)

    def add_springpot(self, row: Row, law: SpringpotLaw) -> None:
        """Add a springpot on a row."""
        self._springpots.append((row, law))

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
        memory_rows, memory = self._build_memory(free)
        springpot_rows, springpots = self._build_springpots(free)
        if self._printed:
            self._check_printed(stiffness)
        system = System(
            mass=restrict(mass),
            stiffness=restrict(stiffness),
            damping=None if damping is None else restrict(damping),
            rayleigh=self._rayleigh,
            modal_damping=self._modal,
            loads=tuple(Load(load.vector[free], load.function, load.name) for load in self._loads),
            contacts=contacts,
            nonlinear=self._nonlinear_laws(nonlinear_rows, free),
            memory=memory,
            printed=self._printed[0] if self._printed else None,
            scale=self._scale[free],
            strain=self._strain_rows(strains, free),
            rigid=self._rigid_motions(strains)[free],
            springpots=springpots,
        )
        vectors = tuple(load.vector for load in self._loads)
        return Model(
            system,
            self.offsets,
            free,
            mass,
            stiffness,
            damping,
            vectors,
            contact_rows,
            nonlinear_rows,
            memory_rows,
            springpot_rows,
        )

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

    def _build_memory(self, free: IntArray) -> tuple[Any, MemoryLaws | None]:
        if not self._memory:
            return None, None
        rows = self._rows([row for row, _ in self._memory])
        laws = MemoryLaws(rows[:, free].tocsr(), tuple(law for _, law in self._memory))
        self._check_springs(laws)
        return rows, laws

    def _build_springpots(self, free: IntArray) -> tuple[Any, SpringpotLaws | None]:
        if not self._springpots:
            return None, None
        rows = self._rows([row for row, _ in self._springpots])
        laws = SpringpotLaws(rows[:, free].tocsr(), tuple(law for _, law in self._springpots))
        self._check_springs(laws)
        return rows, laws

    def _check_springs(self, laws: MemoryLaws | SpringpotLaws) -> None:
        """Raise where a name, by which histories are told, occurs twice, or a row is empty."""
        names = [law.name for _, law in self._memory] + [law.name for _, law in self._springpots]
        known: tuple[MemoryLaw | SpringpotLaw, ...] = laws.laws
        for law, row in zip(known, laws.rows, strict=True):
            if names.count(law.name) > 1:
                raise ArgumentError(f"springs named {law.name!r} occur more than once; give each its own name")
            if not np.any(row.data):
                raise ArgumentError(f"{law.label} can never move: its points lie on supports")

    def _check_printed(self, stiffness: Any) -> None:
        """Raise where a spring follows the printed law beside anything else that bears load."""
        label = self._printed[0].label
        what = ""
        if len(self._printed) > 1 or self._memory or self._springpots:
            what = "another spring with memory"
        elif self.size > 1:
            what = f"{self.size} degrees of freedom"
        elif self._contacts:
            what = f"Contact {self._contacts[0].name!r}"
        elif self._nonlinear or np.any(stiffness.data != 0.0):
            what = "another spring"
        if what:
            raise ArgumentError(
                f"{label} with memory='printed' is Eq. 22, which the applied force drives, so it holds for a spring "
                f"that alone carries a single loaded mass; this scene has {what}. Use memory='cyclic'"
            )

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
        from scipy.sparse import vstack

        parts, count = _Triplets(), 0
        for body, start in self.offsets.items():
            rows = body.strain_rows()
            if rows is None:
                return None
            parts.add_matrix(rows, count, start)
            count += rows.shape[0]
        whole: Any = parts.build(count, self.size)
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
        from scipy.sparse import csr_matrix

        if not blocks:
            return np.zeros((self.size, 0))
        rows = np.concatenate([start + np.arange(motion.shape[0]) for start, motion in blocks])
        columns = np.repeat(np.arange(len(blocks)), [motion.shape[0] for _, motion in blocks])
        entries = np.concatenate([motion[:, 0] for _, motion in blocks])
        basis = csr_matrix((entries, (rows, columns)), shape=(self.size, len(blocks)))
        if attached is None:
            return np.asarray(basis.toarray())
        return np.asarray(basis @ sparse_null_space(attached @ basis, abs(attached) @ abs(basis)))

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
