"""A System, and the relation of its unknowns to the degrees of freedom of the bodies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vofem.assembly.unknowns import Unknowns
from vofem.bodies.base import Array, Body, IntArray
from vofem.errors import ArgumentError
from vofem.system import System

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


#: Differences at a joint, relative to the largest value: of one and the same motion, and of displacements and
#: rotations whose fields were projected body by body.
_SAME, _FAR = 1e-12, (1e-2, 5e-2)


@dataclass(frozen=True)
class Model:
    """A System, and the relation of its unknowns to the degrees of freedom of the bodies."""

    system: System  #: Over the free degrees of freedom.
    offsets: dict[Body, int]  #: Where a body's degrees of freedom begin among all.
    #: The unknowns among all degrees of freedom: neither supported nor eliminated by a joint. Shape (n,).
    free: IntArray
    #: `mass`, `stiffness`: over all degrees of freedom, supported ones included; for reactions. Shape (N, N).
    mass: csr_matrix
    stiffness: csr_matrix
    damping: csr_matrix | None  #: The damping matrix of bodies and dashpots.
    load_vectors: tuple[Array, ...]  #: One per load of the system, shape (N,).
    law_rows: tuple[csr_matrix, ...]  #: One per group of the system's laws, shape (n_laws, N).
    #: As of `Unknowns`; None where no joint eliminates a degree of freedom. Shape (N, N).
    transform: csr_matrix | None = None
    #: Names of joints and how many conditions each has: 1 of displacements, 2 with rotations.
    joints: tuple[tuple[str, int], ...] = ()
    #: Rows that give the force of each condition from what the equations of motion leave over, shape (n_conditions, N).
    joint_rows: csr_matrix | None = None

    @property
    def size(self) -> int:
        """Number of all degrees of freedom N."""
        return int(self.mass.shape[0])

    def expand(self, q: Array) -> Array:
        """Return free values (n, ...) as values of all degrees of freedom (N, ...), zero at supports."""
        if self.transform is not None:
            return np.asarray(self.transform[:, self.free] @ q)
        full = np.zeros((self.size, *q.shape[1:]))
        full[self.free] = q
        return full

    @property
    def unknowns(self) -> Unknowns:
        """The unknowns, and how all degrees of freedom follow from them."""
        return Unknowns(self.free, self.transform)

    def reduced(self, full: Array, what: str) -> Array:
        """Return the unknowns, shape (n,), of given values of all degrees of freedom (N,).

        Fields that are projected body by body differ at joints by the error of
        the mesh. They are projected once more, by the mass, on what the joints allow.

        Raises `ArgumentError` if the values contradict a joint; `what` is for the message.
        """
        q = full[self.free]
        if self.transform is None:
            return q
        rotation = np.concatenate([body.degrees_of_freedom.rotation for body in self.offsets])
        # Point masses that travel have unknowns after those of the bodies.
        rotation = np.pad(rotation, (0, full.shape[0] - rotation.size))
        largest = [float(np.max(np.abs(full[kind]), initial=0.0)) for kind in (~rotation, rotation)]
        size = np.where(rotation, largest[1], largest[0])
        gap = np.abs(self.expand(q) - full)
        if np.all(gap <= _SAME * size):
            return q
        far = np.where(rotation, _FAR[1], _FAR[0]) * size
        if np.any(gap > far):
            k = int(np.argmax(gap - far))
            body = next(body for body, start in self.offsets.items() if start <= k < start + body.size)
            raise ArgumentError(
                f"Scene: the {what} of {body.label} differs at a joint from that of the body it is tied to; give "
                "fields that agree there"
            )
        from scipy.sparse.linalg import spsolve

        chosen = self.transform[:, self.free]
        return np.asarray(spsolve(self.system.mass.tocsc(), chosen.T @ (self.mass @ full)))

    def of_body(self, body: Body, q: Array) -> Array:
        """Return the values of one body, shape (body.size, ...), from free values (n, ...)."""
        start = self.offsets[body]
        if self.transform is not None:
            return np.asarray(self.transform[start : start + body.size][:, self.free] @ q)
        inside = (self.free >= start) & (self.free < start + body.size)
        values = np.zeros((body.size, *q.shape[1:]))
        values[self.free[inside] - start] = q[inside]
        return values
