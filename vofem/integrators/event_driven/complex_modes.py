"""Non-classical damping: complex modes, written as independent real blocks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.errors import SingularSystemError

Array = NDArray[np.float64]

#: Condition number of complex eigenvectors beyond which a solution would lose too many digits.
_WORST_CONDITION = 1e6

#: Eigenvectors whose overlap is this close to one are replaced by their common invariant plane.
_PARALLEL = 1e-4


class Blocks(NamedTuple):
    """Independent blocks ``z' = v, v' = -2 delta v - p z`` of a damped system, and the maps to and from it.

    Attributes
    ----------
    delta, p : ndarray, shape (m,)
        Ordered by p.
    out, into : ndarray, shape (2m, 2m)
        ``(displacement, velocity) = out @ (z, v)``, and the inverse.
    """

    delta: Array
    p: Array
    out: Array
    into: Array


def damped_blocks(stiffness: Array, damping: Array) -> Blocks:
    """Split ``x'' + C x' + diag(k) x = f`` into blocks.

    Rigid motions that C does not resist have a defective double root 0; they
    are taken out first and make blocks of their own.

    Parameters
    ----------
    stiffness : ndarray, shape (m,)
        k, not negative.
    damping : ndarray, shape (m, m)
        C, symmetric and positive semi-definite.

    Raises
    ------
    SingularSystemError
        If the complex modes are too nearly dependent.
    """
    m = stiffness.size
    frame, loose = _loose_motions(stiffness, damping)
    rest = frame[:, loose:]
    k = np.where(np.arange(m) < loose, 0.0, np.sum(stiffness[:, None] * frame**2, axis=0))[loose:]
    inner = _complex_blocks(k, rest.T @ damping @ rest)
    n = m - loose
    lift = np.zeros((2 * m, 2 * n))
    lift[:m, :n] = rest
    lift[m:, n:] = rest
    free = np.zeros((2 * m, 2 * loose))
    free[:m, :loose] = frame[:, :loose]
    free[m:, loose:] = frame[:, :loose]
    # Loose motions first: their p is zero.
    order = np.concatenate(
        [np.arange(loose), 2 * loose + np.arange(n), loose + np.arange(loose), 2 * loose + n + np.arange(n)]
    )
    out = np.hstack([free, lift @ inner.out])[:, order]
    into = np.vstack([free.T, inner.into @ lift.T])[order]
    zero = np.zeros(loose)
    return Blocks(np.append(zero, inner.delta), np.append(zero, inner.p), out, into)


def _loose_motions(stiffness: Array, damping: Array) -> tuple[Array, int]:
    """Return an orthogonal frame whose first columns are the rigid motions that C does not resist, and their number.

    Only rigid motions are mixed, so that the frame keeps the stiffness diagonal.
    """
    m = stiffness.size
    frame = np.eye(m)
    rigid = np.flatnonzero(stiffness == 0.0)
    if not rigid.size:
        return frame, 0
    small = damping[np.ix_(rigid, rigid)]
    values, vectors = np.linalg.eigh(small)
    loose = int(np.sum(values <= 1e-12 * max(float(np.abs(damping).max()), np.finfo(float).tiny)))
    frame[np.ix_(rigid, rigid)] = vectors
    others = np.setdiff1d(np.arange(m), rigid[:loose])
    return frame[:, np.concatenate([rigid[:loose], others])], loose


def _complex_blocks(k: Array, c: Array) -> Blocks:
    """Split a system without defective rigid motions, by its complex modes."""
    n = k.size
    if not n:
        return Blocks(np.empty(0), np.empty(0), np.empty((0, 0)), np.empty((0, 0)))
    if n == 1:
        # One oscillator is a block already, critically damped or not.
        return Blocks(0.5 * c[0], k.copy(), np.eye(2), np.eye(2))
    # Velocities divided by a frequency: both halves of the state are of one size.
    omega = np.sqrt(np.where(k > 1e-16 * k.max(), k, k.max() if k.max() > 0 else 1.0))
    state = np.zeros((2 * n, 2 * n))
    state[:n, n:] = np.diag(omega)
    state[n:, :n] = np.diag(-k / omega)
    state[n:, n:] = -c
    roots, right = np.linalg.eig(state)
    right, planes = _separated(state, roots, right)
    condition = np.linalg.cond(right)
    if not condition < _WORST_CONDITION:
        raise SingularSystemError(
            f"the damped modes of a contact status are not independent (condition number {condition:.1e}): three or "
            "more of them nearly coincide. Change a damping coefficient slightly, or use method='central_difference'"
        )
    left = np.linalg.inv(right)
    unscale = np.concatenate([1.0 / omega, np.ones(n)])
    right, left = right * unscale[:, None], left / unscale[None, :]
    delta, p = np.zeros(n), np.zeros(n)
    out, into = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    taken = {index for pair in planes for index in pair}
    groups: list[tuple[int, int | None]] = [*planes, *_pairs(roots, taken)]
    for i, (first, second) in enumerate(groups):
        columns, rows = out[:, [i, n + i]], into[[i, n + i]]
        if second is None:
            delta[i], p[i] = _from_conjugates(roots[first], right[:, first], left[first], columns, rows)
        elif (first, second) in planes:
            both = [first, second]
            plane = planes[first, second]
            delta[i], p[i] = _from_plane(plane, right[:, both].real, left[both].real, columns, rows)
        else:
            real = (right[:, first].real, right[:, second].real, left[first].real, left[second].real)
            delta[i], p[i] = _from_reals(float(roots[first].real), float(roots[second].real), *real, columns, rows)
        out[:, [i, n + i]], into[[i, n + i]] = columns, rows
    order = np.argsort(p, kind="stable")
    twice = np.concatenate([order, n + order])
    return Blocks(delta[order], np.maximum(p[order], 0.0), out[:, twice], into[twice])


def _from_conjugates(
    s: complex, right: NDArray[np.complex128], left: NDArray[np.complex128], columns: Array, rows: Array
) -> tuple[float, float]:
    """Fill the maps of a pair of conjugate roots; return delta and p."""
    d, w = -s.real, s.imag
    columns[:, 0] = right.real + right.imag * (d / w)
    columns[:, 1] = right.imag / w
    rows[0] = 2.0 * left.real
    rows[1] = 2.0 * (s * left).real
    return float(d), float(abs(s) ** 2)


def _from_reals(
    s1: float, s2: float, right1: Array, right2: Array, left1: Array, left2: Array, columns: Array, rows: Array
) -> tuple[float, float]:
    """Fill the maps of two real roots; return delta and p."""
    columns[:, 0] = (s1 * right2 - s2 * right1) / (s1 - s2)
    columns[:, 1] = (right1 - right2) / (s1 - s2)
    rows[0] = left1 + left2
    rows[1] = s1 * left1 + s2 * left2
    return -0.5 * (s1 + s2), s1 * s2


def _from_plane(inner: Array, right: Array, left: Array, columns: Array, rows: Array) -> tuple[float, float]:
    """Fill the maps of an invariant plane on which the motion is ``xi' = inner xi``; return delta and p."""
    best = _companion(inner)
    columns[:] = right @ np.linalg.inv(best)
    rows[:] = best @ left
    return float(-0.5 * np.trace(inner)), float(np.linalg.det(inner))


def _close_pairs(roots: NDArray[np.complex128], right: NDArray[np.complex128]) -> list[tuple[int, int]]:
    """Return pairs of eigenvectors that nearly coincide, each vector in one pair at most.

    Only two real roots, or a root and its conjugate, span a real plane.
    """
    overlap = np.triu(np.abs(right.conj().T @ right), 1)
    pairs: list[tuple[int, int]] = []
    taken: set[int] = set()
    candidates = np.argwhere(overlap > 1.0 - _PARALLEL)
    for a, b in sorted(candidates.tolist(), key=lambda pair: -overlap[pair[0], pair[1]]):
        real = roots[a].imag == 0.0 and roots[b].imag == 0.0
        if (real or roots[a] == roots[b].conjugate()) and a not in taken and b not in taken:
            pairs.append((a, b))
            taken |= {a, b}
    return pairs


def _separated(
    state: Array, roots: NDArray[np.complex128], right: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], dict[tuple[int, int], Array]]:
    """Replace eigenvectors that nearly coincide by their invariant planes, where that makes the columns independent.

    Two such eigenvectors do not span their plane accurately; the first columns
    of an ordered real Schur form do. Returns the columns, and by pair of
    indices the motion ``xi' = inner xi`` on each plane.
    """
    close = _close_pairs(roots, right)
    if not close:
        return right, {}
    from scipy.linalg import schur
    from scipy.linalg.lapack import dtrsen

    triangle, vectors = schur(state, output="real")
    along = _roots_of(triangle)
    columns, planes = right.copy(), {}
    used = np.zeros(along.size, dtype=bool)
    for a, b in close:
        select = np.zeros(along.size, dtype=np.int32)
        for root in (roots[a], roots[b]):
            place = int(np.argmin(np.where(used, np.inf, np.abs(along - root))))
            select[place], used[place] = 1, True
        # Job "N": order only, no condition numbers.
        ordered = dtrsen(select, triangle, vectors, job=b"N")
        columns[:, [a, b]] = ordered[1][:, :2]
        planes[a, b] = np.ascontiguousarray(ordered[0][:2, :2])
    independent = np.linalg.cond(columns) < min(np.linalg.cond(right), _WORST_CONDITION)
    turning = all(_independence(_companion(inner)) > 1e-9 for inner in planes.values())
    return (columns, planes) if independent and turning else (right, {})


def _companion(inner: Array) -> Array:
    """Return rows (w, w inner) that take a plane's coordinates to (z, v), w such that they are most independent."""
    rows = [np.stack([w, w @ inner]) for w in np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])]
    return max(rows, key=_independence)


def _independence(rows: Array) -> float:
    """Return the sine of the angle between two rows; 0 where one of them vanishes."""
    size = float(np.prod(np.linalg.norm(rows, axis=1)))
    return abs(float(np.linalg.det(rows))) / size if size > 0.0 else 0.0


def _roots_of(triangle: Array) -> NDArray[np.complex128]:
    """Return the eigenvalues along the diagonal of a real Schur form."""
    roots = triangle.diagonal().astype(complex)
    for k in np.flatnonzero(triangle.diagonal(-1)):
        roots[k : k + 2] = np.linalg.eigvals(triangle[k : k + 2, k : k + 2])
    return roots


def _pairs(roots: NDArray[np.complex128], taken: set[int]) -> list[tuple[int, int | None]]:
    """Return conjugate pairs as (index, None) and pairs of real roots as (index, index), without those taken.

    Real roots are paired far from each other, so that equal ones never meet in a block.
    """
    free = np.array([k not in taken for k in range(roots.size)])
    pairs: list[tuple[int, int | None]] = [(int(i), None) for i in np.flatnonzero((roots.imag > 0) & free)]
    real = np.flatnonzero((roots.imag == 0) & free)
    real = real[np.argsort(roots[real].real)]
    half = real.size // 2
    pairs.extend((int(real[i + half]), int(real[i])) for i in range(half))
    return pairs
