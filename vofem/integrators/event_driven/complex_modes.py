"""Non-classical damping: complex modes, written as independent real blocks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.errors import SingularSystemError

Array = NDArray[np.float64]

#: Condition number of complex eigenvectors beyond which a solution would lose too many digits.
_WORST_CONDITION = 1e9


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
    condition = np.linalg.cond(right)
    if not condition < _WORST_CONDITION:
        raise SingularSystemError(
            f"the damped modes of a contact status are not independent (condition number {condition:.1e}): two of "
            "them are critically damped together. Change a damping coefficient slightly, or use "
            "method='central_difference'"
        )
    left = np.linalg.inv(right)
    unscale = np.concatenate([1.0 / omega, np.ones(n)])
    right, left = right * unscale[:, None], left / unscale[None, :]
    delta, p = np.zeros(n), np.zeros(n)
    out, into = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    for i, (a, b) in enumerate(_pairs(roots)):
        s = roots[a]
        if b is None:
            d, w = -s.real, s.imag
            delta[i], p[i] = d, abs(s) ** 2
            out[:, i] = right[:, a].real + right[:, a].imag * (d / w)
            out[:, n + i] = right[:, a].imag / w
            into[i] = 2.0 * left[a].real
            into[n + i] = 2.0 * (s * left[a]).real
        else:
            s1, s2 = roots[a].real, roots[b].real
            delta[i], p[i] = -0.5 * (s1 + s2), s1 * s2
            out[:, i] = ((s1 * right[:, b] - s2 * right[:, a]) / (s1 - s2)).real
            out[:, n + i] = ((right[:, a] - right[:, b]) / (s1 - s2)).real
            into[i] = (left[a] + left[b]).real
            into[n + i] = (s1 * left[a] + s2 * left[b]).real
    order = np.argsort(p, kind="stable")
    both = np.concatenate([order, n + order])
    return Blocks(delta[order], np.maximum(p[order], 0.0), out[:, both], into[both])


def _pairs(roots: NDArray[np.complex128]) -> list[tuple[int, int | None]]:
    """Return conjugate pairs as (index, None) and pairs of real roots as (index, index).

    Real roots are paired far from each other, so that equal ones never meet in a block.
    """
    pairs: list[tuple[int, int | None]] = [(int(i), None) for i in np.flatnonzero(roots.imag > 0)]
    real = np.flatnonzero(roots.imag == 0)
    real = real[np.argsort(roots[real].real)]
    half = real.size // 2
    pairs.extend((int(real[i + half]), int(real[i])) for i in range(half))
    return pairs
