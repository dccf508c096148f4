"""Non-classical damping: complex modes, written as independent real blocks.

Where eigenvalues nearly coincide, their eigenvectors are nearly dependent and would amplify rounding. Their motions are
then kept together in one cluster, see `clusters`: alone, where they are far enough from the others that damping couples
with them, and else together with these.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array, Complex, IntArray
from vofem.integrators.event_driven.clusters import Cluster

#: Coupling by damping below this share of the damping itself is rounding.
_ROUNDING = 2.0 * float(np.finfo(float).eps)

#: Least frequency, over the lowest one of the other motions, by which velocities of rigid motions are scaled.
_SLOWEST = 1e-3

#: Least imaginary part of a complex root over the root, and least distance of two real roots over the roots, for which
#: they form a block.
_APART = 1e-2

#: Condition number of complex modes, over the square of their number, up to which they are used. A cluster loses no
#: digits, but an evaluation takes a time of the cube of its size.
_WELL = 10.0

#: Cosine of the angle between two complex modes from which on both belong to a cluster.
_ALIKE = 0.999


class Blocks(NamedTuple):
    """Independent blocks ``z' = v, v' = -2 delta v - p z`` of a damped system, and the maps to and from it."""

    #: `delta`, `p`: ordered by p. For members of a cluster delta is zero and p is the square of the cluster's largest
    #: rate. Shape (m,).
    delta: Array
    p: Array
    #: ``(displacement, velocity) = out @ (z, v)``, and the inverse, shape (2m, 2m).
    out: Array
    into: Array
    clusters: tuple[Cluster, ...] = ()  #: Blocks that are not independent.


def damped_blocks(stiffness: Array, damping: Array) -> Blocks:
    """Split ``x'' + C x' + diag(k) x = f`` into blocks.

    Rigid motions that C does not resist have a defective double root 0. They
    are separated first and form their own blocks. Parts that damping does not
    couple are separated too, because rounding would mix their motions.

    `stiffness` (shape (m,)): k, not negative.
    `damping` (shape (m, m)): C, symmetric and positive semi-definite.
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
        inner = _part_blocks(k[part], c[np.ix_(part, part)])
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
    least = np.sqrt(stiffness[held].min()) if held.any() else decay.max(initial=0.0)
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


def _part_blocks(k: Array, c: Array) -> Blocks:
    """Split a part without loose rigid motions, by its complex modes."""
    n = k.size
    if n == 1:
        # One oscillator is a block already, critically damped or not.
        return Blocks(0.5 * c[0], k.copy(), np.eye(2), np.eye(2))
    # Velocities are divided by a frequency, so that both halves of the state have one unit.
    omega = state_scale(k, c.diagonal())
    state = np.zeros((2 * n, 2 * n))
    state[:n, n:] = np.diag(omega)
    state[n:, :n] = np.diag(-k / omega)
    state[n:, n:] = -c
    # From the stiffest mode to the softest one, `eig` keeps the digits of slow modes beside overdamped ones.
    stiffest = np.argsort(-omega, kind="stable")
    order = np.column_stack([n + stiffest, stiffest]).ravel()
    scale = np.concatenate([omega, np.ones(n)])
    ordered = np.ascontiguousarray(state[np.ix_(order, order)])
    roots, modes = np.linalg.eig(ordered)
    alike = np.sum(np.abs(modes.conj().T @ modes) > _ALIKE, axis=0) > 1
    found = _independent(ordered, roots, modes, np.zeros(2 * n, dtype=bool))
    if found is None and 0 < alike.sum() < 2 * n and alike.sum() % 2 == 0:
        found = _independent(ordered, roots, modes, alike)
    if found is None:
        largest = np.full(n, float(np.linalg.norm(state, 2)) ** 2)
        return Blocks(np.zeros(n), largest, np.diag(1.0 / scale), np.diag(scale), (Cluster(np.arange(n), state),))
    place = np.argsort(order)
    return found._replace(out=found.out[place] / scale[:, None], into=found.into[:, place] * scale)


def _independent(state: Array, roots: Complex, modes: Complex, alike: NDArray[np.bool_]) -> Blocks | None:
    """Split ``x' = state x``, shape (2n, 2n), into n blocks; None where its modes are nearly dependent.

    Those that are `alike`, shape (2n,), form a cluster.
    """
    n, g = state.shape[0] // 2, int(alike.sum()) // 2
    upper, real = np.flatnonzero((roots.imag > 0.0) & ~alike), np.flatnonzero((roots.imag == 0.0) & ~alike)
    real = real[np.argsort(roots[real].real, kind="stable")]
    # Real roots form blocks two by two, a quick one with a slow one.
    quick, slow = roots[real[: real.size // 2]].real, roots[real[real.size // 2 :]].real
    a, b = roots[upper].real, roots[upper].imag
    if np.any(b <= _APART * np.hypot(a, b)) or np.any(slow - quick <= np.sqrt(2.0) * _APART * np.hypot(slow, quick)):
        return None
    basis = np.empty((2 * n, 0))
    if g:
        from scipy.linalg import schur

        # Schur vectors span what nearly equal eigenvectors leave undetermined.
        basis = schur(state, sort=lambda x, y: alike[np.argmin(np.abs(x + 1j * y - roots))])[1][:, : 2 * g]
    # On both columns of a complex root the motion is xi' = [[a, -b], [b, a]] xi.
    columns = np.hstack(
        [np.sqrt(2.0) * modes[:, upper].real, -np.sqrt(2.0) * modes[:, upper].imag, modes[:, real].real, basis]
    )
    if not np.linalg.cond(columns) < _WELL * n**2:
        return None
    rows = np.linalg.inv(columns)
    m, last = upper.size, 2 * (n - g)
    end = m + n - g
    out, into = np.empty((2 * n, 2 * n)), np.empty((2 * n, 2 * n))
    one, two, first, second = columns[:, :m], columns[:, m : 2 * m], rows[:m], rows[m : 2 * m]
    out[:, :m], out[:, n : n + m] = one + two * (a / b), -two / b
    into[:m], into[n : n + m] = first, a[:, None] * first - b[:, None] * second
    one, two, first, second = columns[:, 2 * m : end], columns[:, end:last], rows[2 * m : end], rows[end:last]
    out[:, m : n - g] = (one * slow - two * quick) / (slow - quick)
    out[:, n + m : 2 * n - g] = (two - one) / (slow - quick)
    into[m : n - g], into[n + m : 2 * n - g] = first + second, quick[:, None] * first + slow[:, None] * second
    delta, p = np.append(-a, -0.5 * (quick + slow)), np.append(a**2 + b**2, quick * slow)
    if not g:
        return Blocks(delta, p, out, into)
    member = np.arange(n - g, n)
    both = np.concatenate([member, n + member])
    out[:, both], into[both] = basis, rows[last:]
    generator = basis.T @ state @ basis
    largest = np.full(g, float(np.linalg.norm(generator, 2)) ** 2)
    clusters = (Cluster(member, generator),)
    return Blocks(np.append(delta, np.zeros(g)), np.append(p, largest), out, into, clusters)
