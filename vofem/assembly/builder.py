"""Collects the contributions of bodies and effects, and builds the System."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vofem.assembly.bases import Base, offsets
from vofem.assembly.laws import ContactEntry, law_groups
from vofem.assembly.model import Model
from vofem.assembly.strains import attached_strains, rigid_motions, strain_rows
from vofem.assembly.triplets import Triplets, entries
from vofem.assembly.unknowns import Constraint, Unknowns, unknowns
from vofem.bodies.base import Array, Body, BodyMatrices, IntArray, Point, Row
from vofem.bodies.path import TravellingPoint
from vofem.errors import ArgumentError
from vofem.laws import LawGroup
from vofem.laws.moving import Rider
from vofem.system import Load, LoadFunction, System

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


class SystemBuilder:
    """Collects the contributions of bodies and effects.

    Parameters
    ----------
    bodies : sequence of Body
        The bodies, in the order in which their degrees of freedom are numbered.
    bases : sequence of Base
        The motions of their bases, whose displacements move what stays in space beside the bodies.
    """

    def __init__(self, bodies: Sequence[Body], bases: Sequence[Base] = ()) -> None:
        self.offsets: dict[Body, int] = {}
        self._mass, self._stiffness, self._damping = Triplets(), Triplets(), Triplets()
        self._attached = Triplets()
        self._springs: list[tuple[Row, float]] = []
        self._strains: list[tuple[int, csr_matrix]] = []
        self._laws: list[tuple[Row, Any]] = []
        self._rayleigh: tuple[float, float] | None = None
        self._modal: float | Array | None = None
        self._loads: list[Load] = []
        self._joints: list[tuple[str, list[Row]]] = []
        self._bases = bases
        self._tied: list[Body] = []
        self._travelling: dict[Body, list[tuple[TravellingPoint, Any, str]]] = {}
        supported: list[IntArray] = []
        scales: list[Array] = []
        rotations: list[NDArray[np.bool_]] = []
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
            rotations.append(body.degrees_of_freedom.rotation)
            self.size += body.size
        self._supported = np.concatenate(supported)
        self._scale = np.concatenate(scales)
        self._rotation = np.concatenate(rotations)
        self._accelerations: list[tuple[float, LoadFunction, str, Body | None]] = []

    @staticmethod
    def _check(body: Body, matrices: BodyMatrices) -> BodyMatrices:
        for kind, matrix in (("mass", matrices.mass), ("stiffness", matrices.stiffness)):
            if not np.all(np.isfinite(entries(matrix)[2])):
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

    def add_modal_damping(self, ratio: float | Array) -> None:
        """Damp the modes of (K, M) by one ratio of critical damping, or by one each, of which the last is repeated."""
        if self._modal is not None and (np.ndim(ratio) or np.ndim(self._modal)):
            parts = [np.atleast_1d(np.asarray(part, dtype=float)) for part in (self._modal, ratio)]
            longest = max(part.size for part in parts)
            self._modal = sum((np.pad(part, (0, longest - part.size), "edge") for part in parts), np.zeros(longest))
        else:
            self._modal = ratio if self._modal is None else self._modal + ratio

    def add_point_load(self, row: Row, function: LoadFunction, name: str) -> None:
        """Add the load ``b * function(t)``."""
        vector = np.zeros(self.size)
        np.add.at(vector, row.indices, row.weights)
        self._loads.append(Load(vector, function, name))

    def add_travelling_load(self, point: TravellingPoint, function: LoadFunction, name: str) -> None:
        """Add a force at a point that travels; all that travel along a beam are loads on its degrees of freedom."""
        self._travelling.setdefault(point.body, []).append((point, function, name))

    def add_body_load(self, body: Body, values: Array, function: LoadFunction, name: str) -> None:
        """Add a load vector over one body's degrees of freedom, times a function."""
        vector = np.zeros(self.size)
        start = self.offsets[body]
        vector[start : start + body.size] = values
        self._loads.append(Load(vector, function, name))

    def add_acceleration(self, value: float, function: LoadFunction, name: str, body: Body | None = None) -> None:
        """Add the load ``value M r function(t)``, r being a unit translation of one body, or of all."""
        self._accelerations.append((value, function, name, body))

    def add_tied_mass(self, point: TravellingPoint, mass: float, label: str, name: str) -> None:
        """Add a mass that travels with a point: an unknown of its own, tied to the beam."""
        from vofem.laws.travelling import TravellingLaw

        self._mass.add_matrix(np.array([[mass]]), self.size, self.size)
        self._tied.append(point.body)
        row = Row(np.array([self.size]), np.array([-1.0]))
        self.size += 1
        self._scale, self._rotation = np.append(self._scale, 1.0), np.append(self._rotation, False)
        self.add_law(row, TravellingLaw(label, name, tied=True, track=(point, 1.0)))

    def add_travelling_law(
        self, row: Row, point: TravellingPoint, label: str, name: str, stiffness: float, damping: float
    ) -> None:
        """Add a spring and a dashpot on the displacement at a point that travels, and on a row at rest."""
        from vofem.laws.travelling import TravellingLaw

        self.add_law(row, TravellingLaw(label, name, stiffness, damping, track=(point, 1.0)))

    def add_law(self, row: Row, law: Any) -> None:
        """Add a scalar law on a row: a `Law`, or one that names the class of its group by `group`."""
        self._laws.append((row, law))

    def add_contact(self, entry: ContactEntry) -> None:
        """Add a contact."""
        self.add_law(entry.row, entry)

    def add_joint(self, name: str, rows: Sequence[Row]) -> None:
        """Add the conditions ``b.q = 0`` of a joint, which hold exactly: of displacements, and then of rotations."""
        self._joints.append((name, list(rows)))

    # -- result -----------------------------------------------------------------------------------

    def build(self) -> Model:
        """Return the model: global matrices, and the System over the free degrees of freedom."""
        mass, stiffness = self._mass.build(self.size), self._stiffness.build(self.size)
        assert mass is not None
        assert stiffness is not None
        damping = self._damping.build(self.size)
        attached = self._attached.build(self.size)
        strains = attached_strains(self._springs, self._strains, self.size)
        if attached is not None:
            stiffness = stiffness + attached
        unknown, conditions, joint_rows = unknowns(self._constraints(), self._supported, self._scale)
        if not unknown.free.size:
            raise ArgumentError("the supports hold every degree of freedom, so nothing can move; remove some")

        self._loads += self._travelling_loads()
        for value, function, name, only in self._accelerations:
            translation = np.concatenate([body.translation() * (only is None or body is only) for body in self.offsets])
            riding = [float(only is None or body is only) for body in self._tied]
            translation = np.append(translation, riding) if riding else translation
            self._loads.append(Load(value * (mass @ translation), function, name))
        loads = self._loads
        if self._tied:
            # Masses that travel, which may have been added after a load, are unknowns too.
            loads = [replace(load, vector=np.pad(load.vector, (0, self.size - load.vector.size))) for load in loads]
        rows, laws = law_groups(self._moved(unknown), self.size, unknown)
        self._check_driven(laws, stiffness)
        system = System(
            mass=unknown.square(mass),
            stiffness=unknown.square(stiffness),
            damping=None if damping is None else unknown.square(damping),
            rayleigh=self._rayleigh,
            modal_damping=self._modal,
            loads=tuple(Load(unknown.vector(load.vector), load.function, load.name) for load in loads),
            laws=laws,
            scale=unknown.scale(self._scale),
            strain=strain_rows(self.offsets, strains, self.size, unknown),
            rigid=rigid_motions(self.offsets, strains, conditions, self._supported, self.size)[unknown.free],
            rotation=self._rotation[unknown.free],
        )
        vectors = tuple(load.vector for load in loads)
        return Model(
            system,
            self.offsets,
            unknown.free,
            mass,
            stiffness,
            damping,
            vectors,
            rows,
            transform=unknown.transform,
            joints=tuple((name, len(rows)) for name, rows in self._joints),
            joint_rows=joint_rows,
        )

    def _travelling_loads(self) -> list[Load]:
        """Return the loads that travel, one for each degree of freedom of their beams."""
        loads = []
        for body, riders in self._travelling.items():
            from vofem.bodies.path import TravellingLoad

            name = riders[0][2] if len(riders) == 1 else f"{len(riders)} loads that travel along {body.label}"
            for dof in range(body.size):
                vector = np.zeros(self.size)
                vector[self.offsets[body] + dof] = 1.0
                loads.append(Load(vector, TravellingLoad(dof, [rider[:2] for rider in riders]), name))
        return loads

    def _moved(self, unknown: Unknowns) -> list[tuple[Row, Any]]:
        """Return all laws with their rows; those that bases or paths move with what moves them."""
        if not self._bases and not any(getattr(law, "track", None) for _, law in self._laws):
            return self._laws
        return [(row, self._moved_law(law, unknown)) for row, law in self._laws]

    def _moved_law(self, law: Any, unknown: Unknowns) -> Any:
        """Return a law with what moves it."""
        changes: dict[str, Any] = {}
        if getattr(law, "bases", ()) and self._bases:
            changes["moving"] = offsets(f"Contact {law.name!r}", law.bases, self._bases)
        if getattr(law, "track", None):
            from scipy.sparse import csr_matrix

            point, sign = law.track
            own = np.arange(point.body.size)
            ones = np.ones(own.size)
            body = csr_matrix((ones, (own, self.offsets[point.body] + own)), shape=(own.size, self.size))
            changes["rider"] = Rider(point, sign, unknown.rows(body))
        return replace(law, **changes) if changes else law

    def _constraints(self) -> list[Constraint]:
        """Return the conditions of all joints, whose names must differ."""
        names = [name for name, _ in self._joints]
        twice = [name for k, name in enumerate(names) if name in names[:k]]
        if twice:
            raise ArgumentError(f"joints named {twice[0]!r} occur more than once; give each its own name")
        return [
            Constraint(row, f"Joint {name!r}: {kind}")
            for name, rows in self._joints
            for row, kind in zip(rows, ("the displacement", "the rotation"), strict=False)
        ]

    def _check_driven(self, groups: Sequence[LawGroup], stiffness: Any) -> None:
        """Raise where the applied load drives a law beside anything else that bears load."""
        driven = next((group.driven for group in groups if group.driven is not None), None)
        if driven is None:
            return
        others = [group for group in groups if group.driven is None or len(group) > 1]
        what = ""
        if any(group.recorded for group in others):
            what = "another hysteretic spring"
        elif self.size > 1:
            what = f"{self.size} degrees of freedom"
        elif any(group.place == 0 for group in others):
            what = others[0].labels[0]
        elif others or np.any(stiffness.data != 0.0):
            what = "another spring"
        if what:
            raise ArgumentError(
                f"{driven.label} with memory='printed' is Eq. 22, which the applied force drives, so it holds for "
                f"a spring that alone carries a single loaded mass; this scene has {what}. Use memory='cyclic'"
            )
