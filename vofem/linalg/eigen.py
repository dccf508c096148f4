"""Eigensystems of symmetric pencils (K, M) that keep the low modes accurate."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.errors import SingularSystemError
from vofem.linalg.null_space import null_space

#: Deviation of modes from M-orthonormality above which it is corrected.
_ORTHOGONAL = 1e-9

#: Entry of a row over its norm up to which the row does not touch a coordinate.
_UNTOUCHED = 1e-18

#: Deviation from orthonormality above which refined modes of strains are corrected.
_EXACT = 1e-14

#: Of `_refined`: largest number of steps, change of the modes below which its square is rounding, change above which
#: they are too far off, relative distance of squared frequencies below which these count as close, and coupling of
#: such modes below which it is rounding.
_STEPS, _SETTLED, _FAR, _CLOSE, _ROUNDING = 5, 1e-8, 0.1, 1e-2, 1e-14

#: Ratio of the extreme squared frequencies up to which all modes are taken from the direct problem.
_SPREAD = 1e3


def modal_basis(mass: Any, stiffness: Any, scale: Array, rigid: Array, strain: Any = None) -> tuple[Array, Array]:
    """Return all eigenpairs of ``K phi = omega^2 M phi``, M-orthonormal, in ascending order.

    `eigh(K, M)` loses ``eps (omega_max/omega_1)^2`` in the lowest modes, which carry the motion. Modes below the
    geometric mean of the lowest and the highest frequency are therefore taken from the inverse problem `eigh(M, K)`
    and the others from the direct one, with slopes scaled by the element length. Parts that are not coupled are solved
    apart. The cancellation in K, which grows like the fourth power of the number of elements, remains in both. Where K
    is given as a sum of squares too, the modes are refined by means of their strains, and frequencies are Rayleigh
    quotients of strains. Static responses in all modes are then right to 1e-13 on a beam of 500 elements.

    `mass`, `stiffness` (shape (n, n)): M positive definite; K positive definite but for the rigid motions.
    `scale` (shape (n,)): length that makes a degree of freedom a displacement.
    `rigid` (shape (n, r)): a basis of the null space of K.
    `strain` (shape (n_strains, n)): D with ``K = D'D``.
    Returns `omega_squared` (shape (n,)): exactly 0 for rigid motions.
    Returns `shapes` (shape (n, n)): columns.
    Raises `SingularSystemError` if K is indefinite.
    """
    from scipy.sparse.csgraph import connected_components

    n = scale.size
    values = np.empty(n)
    shapes = np.zeros((n, n))
    count, label = connected_components(abs(mass) + abs(stiffness), directed=False)
    if count == 1:
        parts = [np.arange(n)]
    else:
        parts = np.split(np.argsort(label, kind="stable"), np.cumsum(np.bincount(label))[:-1])
    singles = np.array([part[0] for part in parts if part.size == 1], dtype=int)
    if singles.size:
        m, k = mass.diagonal()[singles], stiffness.diagonal()[singles]
        if np.any(k < 0):
            raise indefinite(strain is not None)
        values[singles] = k / m
        shapes[singles, singles] = 1.0 / np.sqrt(m)
    # The rigid motions of other parts appear in a part as rounding, which is compared with the whole motion.
    largest = float(np.abs(rigid * scale[:, None]).max(initial=0.0))
    for part in parts:
        if part.size > 1:
            window = np.ix_(part, part)
            dense_m = mass[part][:, part].toarray() if count > 1 else mass.toarray()
            dense_k = stiffness[part][:, part].toarray() if count > 1 else stiffness.toarray()
            values[part], shapes[window] = _coupled(
                dense_m, dense_k, scale[part], rigid[part], largest, strain is not None
            )
    if strain is not None:
        shapes = _refined(mass, strain, shapes, values == 0.0)
        energy = np.sum((strain @ shapes) ** 2, axis=0)
        values = np.where(values > 0.0, energy / np.sum(shapes * (mass @ shapes), axis=0), 0.0)
    order = np.argsort(values, kind="stable")
    return values[order], _orthogonal(shapes[:, order], mass)


def modes_of_strains(squares: Array, rows: Array, springs: Array) -> tuple[Array, Array]:
    """Return all eigenpairs of ``diag(squares) + rows' diag(springs) rows``.

    The digits of low modes are in the strains ``sqrt(squares) x`` and ``sqrt(springs) rows x``. The sum of both
    matrices has lost them beside stiff springs.

    `squares` (shape (n,)): not negative; 0 for rigid motions, of which those that no row touches stay rigid.
    `rows` has shape (k, n).
    `springs` (shape (k,)): positive.
    Returns `values` (shape (n,)): ascending.
    Returns `vectors` (shape (n, n)): orthonormal columns.
    """

    def solve(part: NDArray[np.int64], mine: NDArray[np.int64]) -> tuple[Array, Array]:
        own = rows[np.ix_(mine, part)]
        strain = np.vstack([np.diag(np.sqrt(squares[part])), np.sqrt(springs[mine])[:, None] * own])
        return _of_strains(strain, _rigid(squares[part], own))

    return _by_parts(squares, rows, solve)


def modes_held(squares: Array, rows: Array) -> tuple[Array, Array]:
    """Return all eigenpairs (m,), (n, m) of ``diag(squares)`` restricted to ``rows x = 0``, values ascending.

    `squares` has shape (n,).
    `rows` (shape (n - m, n)): independent.
    """

    def solve(part: NDArray[np.int64], mine: NDArray[np.int64]) -> tuple[Array, Array]:
        own = rows[np.ix_(mine, part)]
        free = np.linalg.qr(own.T, mode="complete")[0][:, mine.size :]
        values, modes = _of_strains(np.sqrt(squares[part])[:, None] * free, free.T @ _rigid(squares[part], own))
        return values, free @ modes

    return _by_parts(squares, rows, solve)


def _by_parts(
    squares: Array, rows: Array, solve: Callable[[NDArray[np.int64], NDArray[np.int64]], tuple[Array, Array]]
) -> tuple[Array, Array]:
    """Return all eigenpairs, of coordinates that rows do not couple apart from each other, so that they stay so.

    `solve` returns those of a part, given the numbers of its coordinates and of the rows that couple them.
    """
    touched = np.abs(rows) > _UNTOUCHED * np.linalg.norm(rows, axis=1, keepdims=True)
    parts: list[NDArray[np.bool_]] = []
    for mask in touched:
        met = [part for part in parts if np.any(part & mask)]
        parts = [part for part in parts if not np.any(part & mask)] + [np.any([mask, *met], axis=0)]
    alone = np.flatnonzero(~np.any(touched, axis=0))
    values, columns = [squares[alone]], [np.eye(squares.size)[:, alone]]
    for part in parts:
        found, modes = solve(np.flatnonzero(part), np.flatnonzero(np.any(touched & part, axis=1)))
        whole = np.zeros((squares.size, found.size))
        whole[part] = modes
        values.append(found)
        columns.append(whole)
    order = np.argsort(np.concatenate(values), kind="stable")
    return np.concatenate(values)[order], np.ascontiguousarray(np.hstack(columns)[:, order])


def _rigid(squares: Array, rows: Array) -> Array:
    """Return an orthonormal basis (n, r) of the motions without frequency that no row touches."""
    loose = np.flatnonzero(squares == 0.0)
    basis = np.zeros((squares.size, 0))
    if loose.size:
        left = null_space(rows[:, loose], np.repeat(np.linalg.norm(rows, axis=1)[:, None], loose.size, axis=1))
        basis = np.zeros((squares.size, left.shape[1]))
        basis[loose] = left
    return basis


def _of_strains(strain: Array, rigid: Array) -> tuple[Array, Array]:
    """Return all eigenpairs of ``D'D`` for strains D (k, n), given an orthonormal basis (n, r) of its null space."""
    r, n = rigid.shape[1], strain.shape[1]
    if not n:
        return np.zeros(0), np.zeros((0, 0))

    def refined(guess: Array) -> Array | None:
        if r:
            rest = guess[:, r:] - rigid @ (rigid.T @ guess[:, r:])
            guess = np.hstack([rigid, np.linalg.qr(rest)[0]])
        better = _refined(None, strain, guess, np.arange(n) < r)
        return None if better is guess else better

    modes = refined(np.linalg.eigh(strain.T @ strain)[1])
    if modes is None:
        # Frequencies that differ by more than 1e7. A singular value decomposition takes longer and knows more digits.
        guess = np.linalg.svd(strain, full_matrices=False)[2][::-1].T
        modes = refined(guess)
        modes = guess if modes is None else modes
    squares = np.sum((strain @ modes) ** 2, axis=0) / np.sum(modes**2, axis=0)
    squares[:r] = 0.0
    order = np.argsort(squares, kind="stable")
    modes = modes[:, order]
    if np.abs(modes.T @ modes - np.eye(n)).max() > _EXACT:
        # Refinement ends early where frequencies differ by ten decades. Soft modes are changed least.
        modes, triangle = np.linalg.qr(modes)
        modes = modes * np.sign(triangle.diagonal())
    return squares[order], np.ascontiguousarray(modes)


def _refined(mass: Any, strain: Any, shapes: Array, rigid: NDArray[np.bool_]) -> Array:
    """Return modes improved until they are M-orthonormal and their strains orthogonal, to rounding.

    Each step squares the error. Products of strains hold the digits that K has lost: rounding of two modes changes the
    product of their strains only by as much as it changes the modes, times their squared frequencies. Modes that are
    too far off, such as those of parts whose stiffnesses differ by 1e14, are returned as they are. A mass of None is
    the identity.

    T. Ogita, K. Aishima, Japan J. Indust. Appl. Math. 35 (2018) 1007, doi:10.1007/s13160-018-0310-3; for frequencies
    that nearly coincide: 36 (2019) 435, doi:10.1007/s13160-019-00348-4.
    """
    better, separated = shapes, False
    for _ in range(_STEPS):
        strains = np.asarray(strain @ better)
        strains[:, rigid] = 0.0
        whole, gram = strains.T @ strains, better.T @ (better if mass is None else mass @ better)
        values = whole.diagonal() / gram.diagonal()
        # Rounding that is not symmetric would be amplified where frequencies are close.
        lack = np.eye(values.size) - 0.5 * (gram + gram.T)
        apart = values[None, :] - values[:, None]
        push = whole + values[None, :] * lack
        np.fill_diagonal(push, 0.0)
        size = np.maximum(values[None, :], values[:, None])
        # Where only rounding couples close neighbours, any combination of their vectors is right.
        free = (np.abs(apart) <= _CLOSE * size) & (np.abs(push) <= _ROUNDING * size)
        near = (np.abs(apart) <= _CLOSE * size) & (np.abs(push) >= _FAR**2 * np.abs(apart)) & ~free
        if not separated and np.any(near):
            better, separated = _separated(better, whole, gram, near), True
            continue
        free |= near
        change = np.where(free, 0.5 * lack, push / np.where(free, 1.0, apart))
        largest = float(np.abs(change).max())
        if not largest < _FAR:
            break
        better = better + better @ change
        if largest <= _SETTLED:
            return better
    return shapes


def _separated(shapes: Array, whole: Array, gram: Array, near: NDArray[np.bool_]) -> Array:
    """Return modes of which those that are `near` each other are separated by a small eigenproblem of their own."""
    from scipy.linalg import eigh
    from scipy.sparse.csgraph import connected_components

    shapes = shapes.copy()
    _, label = connected_components(near, directed=False)
    for group in np.flatnonzero(np.bincount(label) > 1):
        mine = np.flatnonzero(label == group)
        window = np.ix_(mine, mine)
        shapes[:, mine] = shapes[:, mine] @ eigh(whole[window], gram[window])[1]
    return shapes


def _orthogonal(shapes: Array, mass: Any) -> Array:
    """Return modes that are made M-orthonormal again if rounding has spoilt this; low modes are changed least.

    If other frequencies are 1e7 times as high, a computed nearly rigid motion contains a share of the other modes. A
    state would then not be the sum of its modes.
    """
    gram = shapes.T @ (mass @ shapes)
    if np.abs(gram - np.eye(gram.shape[0])).max(initial=0.0) <= _ORTHOGONAL:
        return shapes
    from scipy.linalg import LinAlgError, cholesky, solve_triangular

    try:
        factor = cholesky(gram)
    except LinAlgError:
        raise SingularSystemError(
            "the vibration modes cannot be distinguished in double precision: stiffnesses or masses differ too much; "
            "make soft and stiff parts differ less, or step in time"
        ) from None
    return np.asarray(solve_triangular(factor, shapes.T, trans="T").T)


def indefinite(squares: bool) -> SingularSystemError:
    """Return the error of a stiffness matrix that is not positive; `squares` says whether it is a sum of squares."""
    if squares:
        return SingularSystemError(
            "rounding has made the stiffness matrix indefinite: elements or springs differ too much in stiffness, as "
            "on a mesh whose longest and shortest element differ by 1e5 or more. Make the mesh less graded; statics, "
            "vf.equilibrium, keep their digits on it"
        )
    return SingularSystemError(
        "the stiffness matrix is indefinite: the structure without contacts has buckled. "
        "The usual cause is a compressive axial force (tension < 0) beyond the critical one; "
        "reduce it, or step in time"
    )


def _coupled(
    mass: Array, stiffness: Array, scale: Array, rigid: Array, reference: float, squares: bool
) -> tuple[Array, Array]:
    """Solve one coupled part with dense matrices; `squares` says that the stiffness is a sum of squares."""
    from scipy.linalg import LinAlgError, eigh

    balance = 1.0 / scale
    m = mass * balance[:, None] * balance
    k = stiffness * balance[:, None] * balance
    n = scale.size
    null = _orthonormal(rigid * scale[:, None], m, reference)
    r = null.shape[1]
    try:
        if r:
            # Rigid motions are lifted above the spectrum, so that both problems are regular.
            top = eigh(k, m, eigvals_only=True, driver="gvd")[-1]
            lift = m @ null
            k = k + 4.0 * top * (lift @ lift.T)
        direct, high = eigh(k, m, driver="gvd")
        inverse, low = eigh(m, k, driver="gvd")
    except LinAlgError:
        raise indefinite(squares) from None
    half = _border(1.0 / inverse[-1], direct[: n - r])
    values = np.empty(n)
    vectors = np.empty((n, n))
    values[:r], vectors[:, :r] = 0.0, null
    values[r : r + half] = 1.0 / inverse[::-1][:half]
    vectors[:, r : r + half] = low[:, ::-1][:, :half] * np.sqrt(values[r : r + half])
    values[r + half :], vectors[:, r + half :] = direct[half : n - r], high[:, half : n - r]
    if np.any(values[r:] <= 0):
        raise indefinite(squares)
    return values, vectors * balance[:, None]


def _border(lowest: float, squares: Array) -> int:
    """Return how many modes are taken from the inverse problem: those below a wide gap near the mean frequency.

    The border must not separate modes of one frequency, because each problem returns its own combinations of them.
    """
    if not 0.0 < lowest * _SPREAD < squares[-1]:
        return 0
    low, high = np.searchsorted(squares, lowest * (squares[-1] / lowest) ** np.array([0.4, 0.6]))
    places = np.arange(max(low, 1), high + 1)
    return int(places[np.argmax(squares[places] / squares[places - 1])])


def _orthonormal(basis: Array, mass: Array, reference: float) -> Array:
    """Return a mass-orthonormal basis of the span of the columns, as far as they are no rounding of `reference`."""
    if not basis.shape[1] or not np.any(basis):
        return np.empty((basis.shape[0], 0))
    left, values, _ = np.linalg.svd(basis, full_matrices=False)
    left = left[:, values > 1e-10 * reference]
    if not left.shape[1]:
        return left
    gram = np.linalg.cholesky(left.T @ mass @ left)
    return np.linalg.solve(gram, left.T).T


def eigenvalues(matrix: Array) -> NDArray[np.complex128]:
    """Return the eigenvalues of a matrix, shape (n,); columns of zeros, whose eigenvalues are zero, cost nothing."""
    left = np.flatnonzero(np.any(matrix != 0.0, axis=0))
    values = np.zeros(matrix.shape[0], dtype=complex)
    values[: left.size] = np.linalg.eigvals(matrix[np.ix_(left, left)])
    return values
