"""What all runs of a system by one method share: matrices in bands, rows of laws, and what belongs to a step size."""

from __future__ import annotations

from typing import Any

import numpy as np

from vofem.arrays import Array, IntArray
from vofem.integrators.damping_matrix import damping_matrix
from vofem.integrators.method import Method
from vofem.integrators.stepping.kernel import Size
from vofem.integrators.stepping.movement import Movement
from vofem.integrators.stepping.scheme import Loaded, Scheme
from vofem.laws.law import FEWEST_IN_BAND, Law
from vofem.laws.rows import Rows, all_rows, compressed
from vofem.linalg.banded import band_order, band_width, factor, solve, subtract_product, to_band, widen
from vofem.system import Counters, System

#: Factored matrices of a method that are kept with a system: those of all step sizes that `tol` tries, and some more.
_MOST_FACTORED = 48


class Structure:
    """A system with its unknowns in band order, as the steps of one method see it.

    Attributes
    ----------
    system : System
    method : Method
    scheme : Scheme
    order, back : ndarray of int, shape (n,)
        The unknowns in the order of the bands, and the place of each.
    mass, stiffness, damping : ndarray
        Lower bands; no rows of `damping` where undamped.
    lossy : csr_matrix, optional
        C, shape (n, n); None where undamped.
    vectors : ndarray, shape (n_loads, n)
        Load vectors.
    rows : csr_matrix, optional
        Of all laws, shape (m, n); None where there are none.
    compressed : Rows
        The same for kernels.
    columns : ndarray of int, shape (k,)
        The unknowns that contacts see.
    contacts : csr_matrix
        The rows of contacts over these, shape (n_contacts, k).
    movement : Movement, optional
        What moves rows; None where all stay in their places.
    travels : bool
        Whether rows travel along beams.
    special : bool
        Whether rows do what no law at a fixed place does, see `kernel.Rules`.
    """

    def __init__(self, system: System, method: Method, scheme: Scheme, counters: Counters) -> None:
        self.system, self.method, self.scheme = system, method, scheme
        damping = damping_matrix(system, counters)
        matrices = [m for m in (system.mass, system.stiffness, damping) if m is not None]
        rows = all_rows(system.laws)
        self.order = order = _order(matrices, rows)
        self.back = np.empty(system.size, dtype=np.int64)
        self.back[order] = np.arange(system.size)
        self.mass, self.stiffness = to_band(system.mass, order), to_band(system.stiffness, order)
        self.damping = np.empty((0, system.size)) if damping is None else to_band(damping, order)
        self.lossy: Any = None if damping is None else damping[order][:, order].tocsr()
        self.vectors = np.array([load.vector[order] for load in system.loads]).reshape(-1, system.size)
        self.compressed = compressed(rows, order)
        self.rows = None if rows is None else rows[:, order].tocsr()
        self.columns = np.zeros(0, dtype=np.int64)
        self.contacts: Any = None
        if system.contacts is not None and self.rows is not None:
            own = self.rows[: len(system.contacts)]
            self.columns = np.unique(own.indices)
            self.contacts = own[:, self.columns]
        self.movement: Movement | None = None
        if any(group.moving is not None for group in system.laws):
            assert self.rows is not None
            self.movement = Movement(system.laws, self.rows, order)
        self.travels = self.movement is not None and self.movement.travels
        #: Whether velocities may jump between steps: where sliding ends, and where masses come onto beams.
        self.jumps = system.sliders is not None or (self.movement is not None and bool(self.movement.tied.any()))
        self.special = self.travels or (system.sliders is not None and system.sliders.special)
        self._laws: list[Law] = [law for group in system.laws for law in group.forms]
        self._sizes: dict[float, Loaded] = {}

    def size(self, dt: float, counters: Counters) -> Loaded:
        """Return the matrix of a step size in s, and its answers to loads."""
        if dt not in self._sizes:
            if len(self._sizes) > _MOST_FACTORED:
                # Steps that are cut have many sizes.
                del self._sizes[next(iter(self._sizes))]
            size = self.system.cache.get(
                "matrix of a step", (dt, self.scheme), lambda: self._size(dt, counters), _MOST_FACTORED
            )  # fmt: skip
            moved = self.vectors.copy()
            for answer in moved:
                solve(size.factored, answer)
            loads = np.concatenate([self.vectors, products(self.stiffness, moved)])
            self._sizes[dt] = Loaded(size, loads, dt * moved, dt * products(self.mass, moved))
        return self._sizes[dt]

    def _size(self, dt: float, counters: Counters) -> Size:
        """Return the factored matrix of a step size, and the way in which reactions are found."""
        numbers, m = self.scheme.numbers(dt), len(self._laws)
        b = numbers.b
        bands = [(self.mass, 1.0), (self.damping, b * dt * numbers.cvw), (self.stiffness, b * dt**2 * numbers.cqw)]
        bands = [(band, weight) for band, weight in bands if band.size and weight]
        width = max(band.shape[0] for band, _ in bands) - 1
        a = np.sum([weight * widen(band, width) for band, weight in bands], axis=0)
        counters.factorizations += 1
        factored = factor(a, "the mass matrix" if self.scheme.explicit else "the matrix of a step")
        width = max(width, *(_spread(self.compressed, j) for j in range(m))) if m else width
        if m == 0 or self.travels:
            return Size(numbers, factored, np.zeros((0, 0)), False)
        if not self.special and _band_pays(self._laws, self.system.size, width):
            return Size(numbers, factored, widen(a, width), True)
        assert self.rows is not None
        dense = self.rows.toarray()
        answers = dense.copy()
        for answer in answers:
            solve(factored, answer)
        compliance = dense @ answers.T
        return Size(numbers, factored, 0.5 * (compliance + compliance.T), False)


def products(band: Array, vectors: Array) -> Array:
    """Return the products of a band with vectors, shape (k, n)."""
    result = np.zeros(vectors.shape)
    for vector, product in zip(vectors, result, strict=True):
        subtract_product(band, vector, product)
    return -result


def _order(matrices: list[Any], rows: Any) -> IntArray:
    """Return an order that keeps matrices narrow and, where laws are many, their rows too, if both can be had."""
    order = band_order(*matrices)
    if rows is None or rows.shape[0] < FEWEST_IN_BAND:
        return order
    pairs = abs(rows).T @ abs(rows)
    together = band_order(*matrices, pairs)
    return together if band_width(together, *matrices, pairs) <= 2 * band_width(order, *matrices) + 2 else order


def _band_pays(laws: list[Law], n: int, width: int) -> bool:
    """Return whether a Newton step costs less in the band than through the compliance, half of the laws acting.

    The compliance is always used where a spring softens, because the band may then not be positive definite, and where
    a force jumps, because Newton's method on all unknowns then stalls.
    """
    m = len(laws)
    costly = m >= FEWEST_IN_BAND and m**3 / 24.0 + 1.5 * m**2 > 8.0 * n * (width + 1.0) ** 2
    return costly and all(law.rising for law in laws)


def _spread(rows: Rows, j: int) -> int:
    """Return the largest distance of two columns of row j."""
    columns = rows.column[rows.start[j] : rows.start[j + 1]]
    return int(columns.max() - columns.min()) if columns.size else 0
