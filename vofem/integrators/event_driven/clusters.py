"""Clusters: parts of a damped system whose complex frequencies nearly coincide.

Modes of nearly equal frequencies are almost linearly dependent, so a motion
cannot be written in them without a loss of digits. Such modes are kept
together in one cluster.

A cluster has ``2m`` coordinates with ``x' = T x + g(t)``. They are stored in the
places (z, v) of m blocks. The motion is computed by a matrix exponential in which
the inputs are further coordinates, so repeated roots, resonance and rigid motion
need no special treatment. The coordinates are orthonormal, or nearly so, in the
energy of the system. Damped motion does not grow in this norm, which gives the
bounds that the search needs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.kernels.jit import jit
from vofem.linalg.exponential import matrix_change

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Cluster(NamedTuple):
    """A set of coupled coordinates.

    Attributes
    ----------
    member : ndarray of int, shape (m,)
        Numbers of the blocks in whose places the coordinates are stored: all z first, then all v.
    generator : ndarray, shape (2m, 2m)
        T.
    """

    member: IntArray
    generator: Array


class ClusterFlow(NamedTuple):
    """The motion of all clusters in flat arrays for compiled code. With its inputs a cluster has n coordinates.

    Attributes
    ----------
    member, members : ndarray of int
        Blocks of all clusters one after the other, and the places where each cluster begins, shape (k + 1,).
    matrix, matrices : ndarray
        Generators with inputs, shape (n, n) each, and the places where they begin, shape (k + 1,).
    state, states : ndarray
        Coordinates and inputs at tau = 0, and the places where they begin, shape (k + 1,).
    rate, growth : ndarray, shape (k,)
        Norm of T, and the largest rate at which the motion may grow, 1/s.
    push, jerk : ndarray, shape (k,)
        Bounds on the norms of g and of its rate.
    quickness : ndarray, shape (k,)
        Largest frequency of g, rad/s, by which every further derivative grows at most.
    """

    member: IntArray
    members: IntArray
    matrix: Array
    matrices: IntArray
    state: Array
    states: IntArray
    rate: Array
    growth: Array
    push: Array
    jerk: Array
    quickness: Array


_INTEGERS, _NUMBERS, _ORIGIN = np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(1, dtype=np.int64)

#: The flow without clusters. It is the usual case, so one object serves all segments.
NO_CLUSTERS = ClusterFlow(
    _INTEGERS, _ORIGIN, _NUMBERS, _ORIGIN, _NUMBERS, _ORIGIN, _NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS
)


def cluster_flow(
    clusters: tuple[Cluster, ...],
    z: Array,
    v: Array,
    omega: Array,
    waves: list[tuple[NDArray[np.complex128], NDArray[np.complex128]]],
    constant: tuple[Array, Array],
    slope: tuple[Array, Array],
    horizon: float,
) -> ClusterFlow:
    """Return the motion of clusters.

    Parameters
    ----------
    clusters : tuple of Cluster
    z, v : ndarray, shape (m,)
        Block states at tau = 0.
    omega : ndarray, shape (n_h,)
        Angular frequencies of the inputs in rad/s.
    waves : list of (g1, g2)
        Inputs to the blocks ``Re(g exp(i w tau))`` for each of these.
    constant, slope : (g1, g2)
        Constant inputs and those that grow like tau.
    horizon : float
        Longest time in s for which the motion is computed.
    """
    if not clusters:
        return NO_CLUSTERS
    matrices, states, bounds = [], [], []
    for cluster in clusters:
        k = cluster.member
        n = 2 * k.size
        inputs = [(w, np.concatenate([g1[k], g2[k]])) for w, (g1, g2) in zip(omega, waves, strict=True)]
        inputs = [(w, g) for w, g in inputs if np.any(g)]
        still, rising = (np.concatenate([g1[k], g2[k]]) for g1, g2 in (constant, slope))
        size = n + 2 * len(inputs) + (2 if np.any(still) or np.any(rising) else 0)
        full, start = np.zeros((size, size)), np.zeros(size)
        full[:n, :n] = cluster.generator
        start[:n] = np.concatenate([z[k], v[k]])
        largest, quickest = 0.0, 0.0
        for i, (w, g) in enumerate(inputs):
            # exp(i w tau) as a pair (cos, sin), its size in the state, so that all of it scales with the motion.
            at, amplitude = n + 2 * i, float(np.abs(g).max())
            full[:n, at], full[:n, at + 1] = g.real / amplitude, -g.imag / amplitude
            full[at, at + 1], full[at + 1, at] = -w, w
            start[at] = amplitude
            norm = float(np.linalg.norm(np.abs(g)))
            largest, quickest = largest + norm, quickest + w * norm
        if size > n + 2 * len(inputs):
            amplitude = float(max(np.abs(still).max(), np.abs(rising).max() * horizon))
            full[:n, -2], full[:n, -1] = still / amplitude, rising * (horizon / amplitude)
            # The last input is tau / horizon.
            full[-1, -2], start[-2] = 1.0 / horizon, amplitude
            steep = float(np.linalg.norm(rising))
            largest, quickest = largest + float(np.linalg.norm(still)) + steep * horizon, quickest + steep
        matrices.append(full)
        states.append(start)
        rate = np.linalg.norm(cluster.generator, 2)
        growth = max(np.linalg.eigvalsh(0.5 * (cluster.generator + cluster.generator.T))[-1], 0.0)
        bounds.append([rate, growth, largest, quickest, max([w for w, _ in inputs], default=0.0)])
    return ClusterFlow(
        np.concatenate([cluster.member for cluster in clusters]),
        _places([cluster.member for cluster in clusters]),
        np.concatenate([matrix.ravel() for matrix in matrices]),
        _places(matrices),
        np.concatenate(states),
        _places(states),
        *np.array(bounds, dtype=float).T.copy(),
    )


def _places(parts: list[Array] | list[IntArray]) -> IntArray:
    return np.concatenate([[0], np.cumsum([part.size for part in parts])]).astype(np.int64)


def free_flow(clusters: tuple[Cluster, ...], z: Array, v: Array) -> ClusterFlow:
    """Return the motion of clusters without inputs."""
    nothing = np.zeros_like(z), np.zeros_like(z)
    return cluster_flow(clusters, z, v, np.zeros(0), [], nothing, nothing, 1.0)


@jit
def cluster_change(flow: ClusterFlow, c: int, tau: float) -> Array:
    """Return by how much the coordinates and inputs of one cluster have changed at tau, shape (n,)."""
    start = flow.state[flow.states[c] : flow.states[c + 1]]
    n = start.size
    matrix = flow.matrix[flow.matrices[c] : flow.matrices[c + 1]].reshape(n, n)
    return matrix_change(matrix, tau) @ start


@jit
def add_clusters(flow: ClusterFlow, tau: Array, dz: Array, dv: Array) -> None:
    """Fill the rows of the clusters' blocks with their changes since tau = 0, shape (n_blocks, n_times)."""
    for c in range(flow.rate.size):
        first, count = flow.members[c], flow.members[c + 1] - flow.members[c]
        for i in range(tau.size):
            change = cluster_change(flow, c, tau[i])
            for j in range(count):
                k = flow.member[first + j]
                dz[k, i] = change[j]
                dv[k, i] = change[count + j]
