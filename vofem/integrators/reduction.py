"""A large system expressed in few Ritz vectors. The result is again a System that the same method can treat.

With ``q = V z`` the reduced matrices are ``V'MV = I`` and ``V'KV``, rows and
loads are multiplied by V. Stiffness comes from strains, ``(DV)'(DV)``, and
solutions from the orthogonal factor of D, so that no digits are lost to the
cancellation in K.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.errors import SingularSystemError
from vofem.linalg.orthogonal import OrthogonalFactor, elimination_orders
from vofem.linalg.ritz import RitzBasis
from vofem.system import Load, State, System

Solve = Callable[[Array], Array]

#: Dashpots on more degrees of freedom than this are treated in modes.
_MOST_DAMPED = 24


#: Condition of a scaled Gram matrix up to which it serves.
_WORST_GRAM = 1e7


class Reduction:
    """Ritz vectors of a system, in any requested number.

    `more` (shape (n,)): further loads whose static responses belong in the space.
    """

    def __init__(self, system: System, start: State, more: Sequence[Array] = ()) -> None:
        self.system = system
        self.start = start
        self.loads = [*input_rows(system), *more]
        self.states = [x for x in (start.q, start.v) if np.any(x)]
        held = holding(system)
        solve, again = two_solutions(system, held)
        loads = self.loads or ([] if self.states else [system.mass @ np.ones(system.size)])
        self.basis = RitzBasis(system.mass, solve, system.rigid, loads, self.states)
        #: Relative difference of static responses between two orders of elimination.
        self.rounding = self._rounding(loads or [system.mass @ x for x in self.states], solve, again)

    def _rounding(self, loads: list[Array], solve: Solve, again: Solve) -> float:
        mass, rigid = self.system.mass, self.basis.grow(self.basis.rigid)
        worst = 0.0
        for load in loads[:4]:
            balanced = load - mass @ (rigid @ (rigid.T @ load))
            pair = np.stack([solve(balanced), again(balanced)], axis=1)
            pair -= rigid @ (rigid.T @ (mass @ pair))
            change = pair[:, 0] - pair[:, 1]
            size = float(pair[:, 0] @ (mass @ pair[:, 0]))
            if size > 0.0:
                worst = max(worst, float(np.sqrt(max(change @ (mass @ change), 0.0) / size)))
        return worst

    def to(self, count: int) -> tuple[System, State, Array]:
        """Return the system and the start in `count` vectors or all that there are, and the vectors (n, count)."""
        from scipy.sparse import csc_matrix, csr_matrix

        system, vectors = self.system, self.basis.grow(count)
        k, r = vectors.shape[1], self.basis.rigid
        if system.strain is not None:
            strain = np.asarray(system.strain @ vectors)
            strain[:, :r] = 0.0
            root = _triangle(strain)
            stiffness = root.T @ root
        else:
            root = None
            stiffness = vectors.T @ (system.stiffness @ vectors)
            stiffness[:r], stiffness[:, :r] = 0.0, 0.0
            stiffness = 0.5 * (stiffness + stiffness.T)
        damping = None if system.damping is None else vectors.T @ (system.damping @ vectors)
        laws, nothing = system.laws, np.zeros((k, 0))
        if system.contacts is not None:
            rows = system.contacts.rows
            touched = np.unique(rows.indices)
            laws = (replace(system.contacts, rows=csr_matrix(rows[:, touched] @ vectors[touched])),)
        small = replace(
            system,
            mass=csc_matrix(np.eye(k)),
            stiffness=csc_matrix(stiffness),
            damping=None if damping is None else csc_matrix(0.5 * (damping + damping.T)),
            loads=tuple(Load(vectors.T @ load.vector, load.function, load.name) for load in system.loads),
            laws=laws,
            scale=np.ones(k),
            rotation=np.zeros(k, dtype=bool),
            strain=None if root is None else csr_matrix(root),
            rigid=np.eye(k)[:, :r] if r else nothing,
        )
        momentum = system.mass @ np.stack([self.start.q, self.start.v], axis=1)
        q, v = (vectors.T @ momentum).T
        return small, State(q, v), vectors


def _triangle(strain: Array) -> Array:
    """Return R with ``R'R = W'W``, shape (k, k).

    Strains of Ritz vectors, scaled, are far from dependent, so that their Gram
    matrix serves; else they are factored themselves, which takes longer.
    """
    gram = strain.T @ strain
    size = np.sqrt(np.where(gram.diagonal() > 0.0, gram.diagonal(), 1.0))
    gram /= np.outer(size, size)
    loose = np.flatnonzero(gram.diagonal() == 0.0)
    gram[loose, loose] = 1.0
    try:
        root = np.linalg.cholesky(gram).T * size
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.qr(strain, mode="r"))
    if np.linalg.cond(gram) > _WORST_GRAM:
        return np.asarray(np.linalg.qr(strain, mode="r"))
    root[loose, loose] = 0.0
    return np.asarray(root)


def loss_in_all_modes(system: System, squares: Array, shapes: Array) -> float | None:
    """Return the relative error of static responses in all modes, which lose digits on fine meshes.

    None if there is no well-conditioned solution for comparison.

    `squares` has shape (n,).
    `shapes` has shape (n, n).
    """
    loads = input_rows(system)[:4]
    if system.strain is None or not loads:
        return None
    solve, _ = two_solutions(system, holding(system))
    rigid, elastic = shapes[:, squares == 0.0], shapes[:, squares > 0.0]
    worst = 0.0
    for load in loads:
        exact = solve(load - system.mass @ (rigid @ (rigid.T @ load)))
        exact -= rigid @ (rigid.T @ (system.mass @ exact))
        change = exact - elastic @ ((elastic.T @ load) / squares[squares > 0.0])
        size = float(exact @ (system.mass @ exact))
        if size > 0.0:
            worst = max(worst, float(np.sqrt(change @ (system.mass @ change) / size)))
    return worst


def input_rows(system: System) -> list[Array]:
    """Return the rows through which contacts, loads and dashpots act, each of shape (n,)."""
    rows: list[Array] = []
    if system.contacts is not None:
        rows += list(system.contacts.rows.toarray())
    rows += [load.vector for load in system.loads if np.any(load.vector)]
    if system.damping is not None:
        columns = np.flatnonzero(np.diff(system.damping.indptr))
        if columns.size <= _MOST_DAMPED:
            rows += list(system.damping[:, columns].toarray().T)
    return rows


def holding(system: System) -> Any:
    """Return rows of r springs that prevent the rigid motions, as stiff as the structure nearby, shape (r, n)."""
    from scipy.linalg import qr
    from scipy.sparse import csr_matrix

    r = system.rigid.shape[1]
    if not r:
        return None
    pivots = np.asarray(qr((system.rigid * system.scale[:, None]).T, mode="r", pivoting=True)[1])[:r]
    stiffness = system.stiffness.diagonal()
    typical = float(np.max(stiffness, initial=0.0)) or 1.0
    root = np.sqrt(np.where(stiffness[pivots] > 0.0, stiffness[pivots], typical))
    return csr_matrix((root, (np.arange(r), pivots)), shape=(r, system.size))


def two_solutions(system: System, held: Any) -> tuple[Solve, Solve]:
    """Return two functions for ``K^-1 f`` with rigid motions prevented, which eliminate in different orders.

    The difference of their results is the effect of rounding.
    """
    from scipy.sparse import vstack

    if system.strain is not None:
        strain = system.strain if held is None else vstack([system.strain, held], format="csr")
        first, second = elimination_orders(strain, system.rotation)
        return OrthogonalFactor(strain, first).solve, OrthogonalFactor(strain, second).solve
    from scipy.sparse.linalg import splu

    stiffness = system.stiffness if held is None else system.stiffness + held.T @ held
    balance = 1.0 / system.scale
    scaled = stiffness.multiply(balance[:, None]).multiply(balance[None, :]).tocsc()
    try:
        one, two = splu(scaled, permc_spec="COLAMD"), splu(scaled, permc_spec="MMD_AT_PLUS_A")
    except RuntimeError as error:
        raise SingularSystemError(f"the stiffness matrix is singular ({error}); hold the structure better") from None
    return lambda force: balance * one.solve(balance * force), lambda force: balance * two.solve(balance * force)
