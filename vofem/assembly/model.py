"""A System and the way back to the bodies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vofem.bodies.base import Array, Body, IntArray
from vofem.system import System

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


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
    law_rows : tuple of csr_matrix, shape (n_laws, N)
        One per group of the system's laws.
    """

    system: System
    offsets: dict[Body, int]
    free: IntArray
    mass: csr_matrix
    stiffness: csr_matrix
    damping: csr_matrix | None
    load_vectors: tuple[Array, ...]
    law_rows: tuple[csr_matrix, ...]

    @staticmethod
    def from_earlier(fields: dict[str, Any]) -> dict[str, Any]:
        """Return the fields of a model that an earlier version has saved, whose kinds of laws had rows each."""
        if "law_rows" in fields:
            return fields
        names = ("contact_rows", "nonlinear_rows", "memory_rows", "springpot_rows")
        parts = [fields.pop(name, None) for name in names]
        return fields | {"law_rows": tuple(rows for rows in parts if rows is not None)}

    @property
    def contact_rows(self) -> csr_matrix | None:
        """The rows of the contacts, or None where there are none."""
        return None if self.system.contacts is None else self.law_rows[0]

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
