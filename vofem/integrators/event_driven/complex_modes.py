"""Non-classical damping: complex modes, written as independent real blocks.

Where eigenvalues nearly coincide, their eigenvectors are nearly dependent and
would amplify rounding. They are replaced by an orthonormal basis of the space
that they span. Two such modes still form a block; more form a cluster, see
`clusters`.

C. A. Bavely, G. W. Stewart, SIAM J. Numer. Anal. 16 (1979) 359, doi:10.1137/0716028.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.clusters import Cluster
from vofem.integrators.event_driven.invariant import Group, Roots, own_modes, split, well_conditioned
from vofem.linalg.low_rank_damping import CoupledDamping, coupled_modes

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Coupling by damping below this share of the damping itself is rounding.
_ROUNDING = 2.0 * float(np.finfo(float).eps)

#: Least frequency, over the lowest one of the other motions, by which velocities of rigid motions are scaled.
_SLOWEST = 1e-3

#: Number of motions from which on updates of complex modes are cheaper than a full eigenproblem, and the largest
#: deviation of their rows from the inverse of their columns.
_FEW, _LOST = 24, 1e-10

#: Two coordinates form a block if the sine of the angle between a row and its rate is above this value.
_TURNING = 1e-2


class Blocks(NamedTuple):
    """Independent blocks ``z' = v, v' = -2 delta v - p z`` of a damped system, and the maps to and from it.

    Attributes
    ----------
    delta, p : ndarray, shape (m,)
        Ordered by p. For members of a cluster delta is zero and p is the square of the cluster's largest rate.
    out, into : ndarray, shape (2m, 2m)
        ``(displacement, velocity) = out @ (z, v)``, and the inverse.
    clusters : tuple of Cluster
        Blocks that are not independent.
    """

    delta: Array
    p: Array
    out: Array
    into: Array
    clusters: tuple[Cluster, ...] = ()


def damped_blocks(stiffness: Array, damping: Array, terms: CoupledDamping | None = None) -> Blocks:
    """Split ``x'' + C x' + diag(k) x = f`` into blocks.

    Rigid motions that C does not resist have a defective double root 0. They
    are separated first and form their own blocks. Parts that damping does not
    couple are separated too, because rounding would mix their motions.

    Parameters
    ----------
    stiffness : ndarray, shape (m,)
        k, not negative.
    damping : ndarray, shape (m, m)
        C, symmetric and positive semi-definite.
    terms : CoupledDamping, optional
        The same C as a diagonal and a few terms, if only few terms couple motions. The complex modes then take O(m^2),
        and not O(m^3).
    """
    m = stiffness.size
    frame, loose = _loose_motions(stiffness, damping)
    k = stiffness if frame is None else np.where(np.arange(m) < loose, 0.0, np.sum(stiffness[:, None] * frame**2, 0))
    c = damping if frame is None else frame.T @ damping @ frame
    delta, p = np.zeros(m), np.zeros(m)
    out, into = np.zeros((2 * m, 2 * m)), np.zeros((2 * m, 2 * m))
    free = np.concatenate([np.arange(loose), m + np.arange(loose)])
    out[free, free], into[free, free] = 1.0, 1.0
    clusters: list[Cluster] = []
    for part in _parts(c, loose):
        few = terms if frame is None else None
        inner = _part_blocks(k[part], c[np.ix_(part, part)], few and few.part(part))
        both = np.concatenate([part, m + part])
        delta[part], p[part] = inner.delta, inner.p
        out[np.ix_(both, both)], into[np.ix_(both, both)] = inner.out, inner.into
        clusters += [Cluster(part[cluster.member], cluster.generator) for cluster in inner.clusters]
    if frame is not None:
        out = np.concatenate([frame @ out[:m], frame @ out[m:]])
        into = np.concatenate([into[:, :m] @ frame.T, into[:, m:] @ frame.T], axis=1)
    # Rigid motions without damping come first, because their p is zero.
    order = np.concatenate([np.arange(loose), loose + np.argsort(p[loose:], kind="stable")])
    place = np.argsort(order)
    twice = np.concatenate([order, m + order])
    moved = tuple(Cluster(place[cluster.member], cluster.generator) for cluster in clusters)
    return Blocks(delta[order], np.maximum(p[order], 0.0), out[:, twice], into[twice], moved)


def state_scale(stiffness: Array, decay: Array) -> Array:
    """Return the frequency in rad/s by which each velocity is divided to compare it with its displacement, shape (m,).

    For rigid motions this is the decay rate, but at least a share of the lowest
    frequency of the others. Division by a very small decay rate would spread the
    rounding of all velocities into the displacements.
    """
    held = stiffness > 0.0
    least = np.sqrt(stiffness[held].min()) if held.any() else decay.max()
    return np.where(held, np.sqrt(stiffness), np.maximum(decay, _SLOWEST * least))


def _loose_motions(stiffness: Array, damping: Array) -> tuple[Array | None, int]:
    """Return an orthogonal basis whose first columns are the rigid motions that C does not resist, and their number.

    Only rigid motions are combined, so the stiffness stays diagonal. Their own
    damping becomes diagonal too. None stands for the identity.
    """
    rigid = np.flatnonzero(stiffness == 0.0)
    if not rigid.size:
        return None, 0
    frame = np.eye(stiffness.size)
    small = damping[np.ix_(rigid, rigid)]
    values, vectors = np.linalg.eigh(small)
    loose = int(np.sum(values <= 1e-12 * max(float(np.abs(damping).max()), np.finfo(float).tiny)))
    frame[np.ix_(rigid, rigid)] = vectors
    others = np.setdiff1d(np.arange(stiffness.size), rigid[:loose])
    return frame[:, np.concatenate([rigid[:loose], others])], loose


def _parts(damping: Array, loose: int) -> list[IntArray]:
    """Return the sets of motions, without the first `loose`, that damping couples."""
    size = damping.diagonal()
    coupled = np.abs(damping) > _ROUNDING * np.maximum(size[:, None], size[None, :])
    left = np.ones(size.size, dtype=bool)
    left[:loose] = False
    parts = []
    while left.any():
        part = np.zeros(size.size, dtype=bool)
        front = np.zeros(size.size, dtype=bool)
        front[np.argmax(left)] = True
        while front.any():
            part |= front
            front = coupled[front].any(axis=0) & left & ~part
        parts.append(np.flatnonzero(part))
        left &= ~part
    return parts


def _part_blocks(k: Array, c: Array, terms: CoupledDamping | None) -> Blocks:
    """Split a part without loose rigid motions, by its complex modes."""
    n = k.size
    if n == 1:
        # One oscillator is a block already, critically damped or not.
        return Blocks(0.5 * c[0], k.copy(), np.eye(2), np.eye(2))
    # Velocities are divided by a frequency, so that both halves of the state have one unit.
    omega = state_scale(k, c.diagonal())
    roots, groups = _updated(k, omega, terms), list[Group]()
    if roots is None:
        state = np.zeros((2 * n, 2 * n))
        state[:n, n:] = np.diag(omega)
        state[n:, :n] = np.diag(-k / omega)
        state[n:, n:] = -c
        roots, groups = split(state)
    roots = roots.scaled(np.concatenate([1.0 / omega, np.ones(n)]))
    scale = np.concatenate([omega, np.ones(n)])
    groups = [Group(group.right / scale[:, None], group.left * scale, group.motion) for group in groups]
    roots, more = roots.taken(*_turning(roots, groups))
    delta, p = np.zeros(n), np.zeros(n)
    out, into = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    at = _own_blocks(roots, delta, p, out, into)
    clusters: list[Cluster] = []
    for group in _even(groups + more):
        right, left = group.right, group.left
        size = right.shape[1] // 2
        best = _companion(group.motion) if size == 1 else None
        if best is not None:
            inverse = np.array([[best[1, 1], -best[0, 1]], [-best[1, 0], best[0, 0]]]) / _determinant(best)
            right, left = right @ inverse, best @ left
            delta[at], p[at] = -0.5 * np.trace(group.motion), _determinant(group.motion)
        else:
            p[at : at + size] = np.linalg.norm(group.motion, 2) ** 2
            clusters.append(Cluster(np.arange(at, at + size), group.motion))
        places = [*range(at, at + size), *range(n + at, n + at + size)]
        out[:, places], into[places] = right, left
        at += size
    return Blocks(delta, p, out, into, tuple(clusters))


def _updated(k: Array, omega: Array, terms: CoupledDamping | None) -> Roots | None:
    """Return all roots and modes of a part whose damping has few terms that couple; None where they are not certain.

    Rows and columns are computed apart from each other. Whether they are each other's inverse shows whether a root was
    lost, found twice, or is nearly defective.
    """
    n = k.size
    if terms is None or n < _FEW or terms.weights.size**2 > n or not np.all(k > 0.0):
        return None
    found = coupled_modes(k, terms)
    if found is None:
        return None
    s, x = found
    right = np.concatenate([omega[:, None] * x, s * x])
    # The pencil is symmetric, so that the rows hold the same vectors: (s + C) x = -k x / s.
    left = np.concatenate([-(k / omega)[:, None] * x / s, x])
    size = np.linalg.norm(right, axis=0)
    modes = own_modes(s, right / size, (left / (np.sum(left * right, axis=0) / size)).T)
    if not well_conditioned(modes):
        return None
    probe = np.cos(np.arange(2 * n) ** 2)
    lost = max(
        float(np.abs(modes.left @ (modes.right @ probe) - probe).max()),
        float(np.abs(modes.right @ (modes.left @ probe) - probe).max()),
    )
    return modes if lost < _LOST else None


def _turning(roots: Roots, groups: list[Group]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which pairs of roots form blocks of their own, and which real roots form blocks two by two."""
    pairs = roots.pairs.imag > _TURNING * np.abs(roots.pairs)
    real = np.ones(roots.real.size, dtype=bool)
    if sum(group.right.shape[1] % 2 for group in groups) % 2:
        # One group is left with an odd number of coordinates, and takes the slowest.
        real[-1] = False
    half = int(np.sum(real)) // 2
    quick, slow = roots.real[:half], roots.real[half : 2 * half]
    real[: 2 * half] = np.tile(slow - quick > np.sqrt(2.0) * _TURNING * np.hypot(slow, quick), 2)
    return pairs, real


def _own_blocks(roots: Roots, delta: Array, p: Array, out: Array, into: Array) -> int:
    """Enter the blocks of pairs of roots, and of real roots two by two; return their number."""
    m, n, half = roots.pairs.size, delta.size, roots.real.size // 2
    a, b = roots.pairs.real, roots.pairs.imag
    one, two = roots.right[:, :m], roots.right[:, m : 2 * m]
    out[:, :m], out[:, n : n + m] = one + two * (a / b), -two / b
    first, second = roots.left[:m], roots.left[m : 2 * m]
    into[:m], into[n : n + m] = first, a[:, None] * first - b[:, None] * second
    delta[:m], p[:m] = -a, a**2 + b**2
    quick, slow = roots.real[:half], roots.real[half:]
    one, two = roots.right[:, 2 * m : 2 * m + half], roots.right[:, 2 * m + half :]
    end = m + half
    out[:, m:end] = (one * slow - two * quick) / (slow - quick)
    out[:, n + m : n + end] = (two - one) / (slow - quick)
    first, second = roots.left[2 * m : 2 * m + half], roots.left[2 * m + half :]
    into[m:end] = first + second
    into[n + m : n + end] = quick[:, None] * first + slow[:, None] * second
    delta[m:end], p[m:end] = -0.5 * (quick + slow), quick * slow
    return end


def _companion(motion: Array) -> Array | None:
    """Return rows (w, w T) that take a plane's coordinates to (z, v), as independent as they can be, or None.

    None where T is nearly a multiple of the identity, so that the rows are nearly dependent.
    """
    rows = [np.stack([w, w @ motion]) for w in np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])]
    best = max(rows, key=_independence)
    return best if _independence(best) > _TURNING else None


def _independence(rows: Array) -> float:
    """Return the sine of the angle between two rows; 0 where one of them vanishes."""
    size = float(np.prod(np.linalg.norm(rows, axis=1)))
    return abs(_determinant(rows)) / size if size > 0.0 else 0.0


def _determinant(square: Array) -> float:
    """Return the determinant of a 2 by 2 matrix by its formula, which does not depend on the unit of time."""
    return float(square[0, 0] * square[1, 1] - square[0, 1] * square[1, 0])


def _even(groups: list[Group]) -> list[Group]:
    """Return groups of even size: odd ones are joined in pairs, single real roots far apart."""
    odd = [group for group in groups if group.right.shape[1] % 2]
    even = [group for group in groups if not group.right.shape[1] % 2]
    # Larger ones first, so that at most one of them takes a single root.
    large = [group for group in odd if group.right.shape[1] > 1]
    single = sorted((group for group in odd if group.right.shape[1] == 1), key=lambda group: group.motion[0, 0])
    if len(large) % 2:
        large.append(single.pop())
    half = len(single) // 2
    joined = [*zip(large[::2], large[1::2], strict=True), *zip(single[half:], single[:half], strict=True)]
    return even + [first.joined(second) for first, second in joined]
