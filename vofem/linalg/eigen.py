"""Eigensystems of symmetric pencils (K, M) that keep the low modes accurate."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.errors import SingularSystemError
from vofem.linalg.aside import aside

Array = NDArray[np.float64]

#: Deviation of modes from M-orthonormality above which it is corrected.
_ORTHOGONAL = 1e-9


def modal_basis(mass: Any, stiffness: Any, scale: Array, rigid: Array, strain: Any = None) -> tuple[Array, Array]:
    """Return all eigenpairs of ``K phi = omega^2 M phi``, M-orthonormal, in ascending order.

    `eigh(K, M)` loses ``eps (omega_max/omega_1)^2`` in the lowest modes, which carry the motion. The lower half is
    therefore taken from the inverse problem `eigh(M, K)` and the upper half from the direct one, with slopes scaled by
    the element length. Parts that are not coupled are solved apart. Where K is given as a sum of squares too,
    frequencies are Rayleigh quotients of strains: they contain the square of the error of a mode, and not the
    cancellation in K, which grows like the fourth power of the number of elements.

    Parameters
    ----------
    mass, stiffness : sparse matrix, shape (n, n)
        M positive definite; K positive definite but for the rigid motions.
    scale : ndarray, shape (n,)
        Length that makes a degree of freedom a displacement.
    rigid : ndarray, shape (n, r)
        A basis of the null space of K.
    strain : sparse matrix, shape (n_strains, n), optional
        D with ``K = D'D``.

    Returns
    -------
    omega_squared : ndarray, shape (n,)
        Exactly 0 for rigid motions.
    shapes : ndarray, shape (n, n)
        Columns.

    Raises
    ------
    SingularSystemError
        If K is indefinite.
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
            raise _indefinite(strain is not None)
        values[singles] = k / m
        shapes[singles, singles] = 1.0 / np.sqrt(m)
    # The rigid motions of other parts appear in a part as rounding, which is compared with the whole motion.
    largest = float(np.abs(rigid * scale[:, None]).max(initial=0.0))
    for part in parts:
        if part.size > 1:
            window = np.ix_(part, part)
            dense_m = mass[part][:, part].toarray() if count > 1 else mass.toarray()
            dense_k = stiffness[part][:, part].toarray() if count > 1 else stiffness.toarray()
            solve = partial(_coupled, dense_m, dense_k, scale[part], rigid[part], largest, strain is not None)
            values[part], shapes[window] = aside(solve, part.size)
    if strain is not None:
        energy = np.sum((strain @ shapes) ** 2, axis=0)
        values = np.where(values > 0.0, energy / np.sum(shapes * (mass @ shapes), axis=0), 0.0)
    order = np.argsort(values, kind="stable")
    return values[order], _orthogonal(shapes[:, order], mass)


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


def _indefinite(squares: bool) -> SingularSystemError:
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
        raise _indefinite(squares) from None
    half = (n - r) // 2
    values = np.empty(n)
    vectors = np.empty((n, n))
    values[:r], vectors[:, :r] = 0.0, null
    values[r : r + half] = 1.0 / inverse[::-1][:half]
    vectors[:, r : r + half] = low[:, ::-1][:, :half] * np.sqrt(values[r : r + half])
    values[r + half :], vectors[:, r + half :] = direct[half : n - r], high[:, half : n - r]
    if np.any(values[r:] <= 0):
        raise _indefinite(squares)
    return values, vectors * balance[:, None]


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
