"""Groups: parts of a damped system whose complex frequencies nearly coincide.

Modes of nearly equal frequencies are almost linearly dependent, so a motion cannot be written in them without a loss of
digits. Such modes are kept together: ``x' = T x + G w`` for the states x of the group and the states w of the loads.
The motion is computed by an exponential of one matrix over both, so repeated roots, resonance and rigid motion need no
special treatment. The coordinates of a group are orthonormal, or nearly so, in the energy of the system. Damped motion
does not grow in this norm, which gives the bounds that the search needs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vofem.arrays import Array, IntArray
from vofem.kernels.jit import jit
from vofem.linalg.exponential import matrix_change


class Cluster(NamedTuple):
    """A set of coupled coordinates."""

    #: Numbers of the blocks in whose places the coordinates are stored: all z first, then all v. Shape (g,).
    member: IntArray
    generator: Array  #: T, shape (2g, 2g).


class Group(NamedTuple):
    """All clusters of a contact status together."""

    member: IntArray  #: Numbers of the blocks, those of the loads counted, shape (g,).
    #: Derivative of (x, w), with w scaled so that no entry is much larger than the others, shape (2g + 2e, 2g + 2e).
    matrix: Array
    scale: Array  #: What w is multiplied by for that, shape (2e,).
    #: Norm of T, and the largest rate at which motion may grow, 1/s; norms of the columns of G. Shape (2 + 2e,).
    bounds: Array


def group_of(
    clusters: tuple[Cluster, ...], drive: Array, omega: Array, bend: IntArray, horizon: float
) -> Group | None:  # fmt: skip
    """Return the group of some clusters.

    `drive` (shape (2m, 2e)): G, rows of all blocks.
    `omega` (shape (e,)): frequencies of the loads in rad/s, 0 for lines.
    `bend` (shape (e,)): see `Exosystem`.
    `horizon`: longest time in s for which a motion is computed.
    """
    if not clusters:
        return None
    m, e = drive.shape[0] // 2, omega.size
    member = np.concatenate([cluster.member for cluster in clusters])
    g = member.size
    size = 2 * (g + e)
    matrix, first = np.zeros((size, size)), 0
    for cluster in clusters:
        k = np.arange(first, first + cluster.member.size)
        both = np.concatenate([k, g + k])
        matrix[np.ix_(both, both)] = cluster.generator
        first += k.size
    own, loads = slice(2 * g), np.arange(2 * g, size)
    own_drive = drive[np.concatenate([member, m + member])]
    # A load f and its rate, both in units of f.
    quick = np.where(omega > 0.0, omega, 1.0 / horizon)
    largest = np.abs(own_drive).max(axis=0, initial=0.0)
    amplitude = np.maximum(largest[:e], largest[e:] * quick)
    bent = np.flatnonzero(bend >= 0)
    amplitude[bend[bent]] = np.maximum(amplitude[bend[bent]], amplitude[bent] / quick[bent] ** 2)
    amplitude = np.where(amplitude > 0.0, amplitude, 1.0)
    scale = np.concatenate([amplitude, amplitude / quick])
    matrix[own, loads] = own_drive / scale
    matrix[loads[:e], loads[e:]], matrix[loads[e:], loads[:e]] = quick, -(omega**2) / quick
    matrix[loads[e + bent], loads[bend[bent]]] = scale[e + bent] / scale[bend[bent]]
    generator = matrix[own, own]
    growth = max(float(np.linalg.eigvalsh(0.5 * (generator + generator.T))[-1]), 0.0)
    bounds = np.concatenate([[np.linalg.norm(generator, 2), growth], np.linalg.norm(own_drive, axis=0)])
    return Group(e + member, matrix, scale, bounds)


@jit
def group_state(group: Group, state: Array, out: Array) -> None:
    """Write (x, w) of a group from the states of all blocks, shape (2, m)."""
    g, e = group.member.size, group.scale.size // 2
    for i in range(g):
        out[i], out[g + i] = state[0, group.member[i]], state[1, group.member[i]]
    for j in range(e):
        out[2 * g + j], out[2 * g + e + j] = group.scale[j] * state[0, j], group.scale[e + j] * state[1, j]


@jit
def group_change(group: Group | None, start: Array, tau: float, out: Array) -> None:
    """Write by how much the states of the blocks of a group have changed, among those of all blocks, shape (2, m)."""
    if group is None:
        return
    x = np.empty(group.matrix.shape[0])
    group_state(group, start, x)
    moved, g = matrix_change(group.matrix, tau) @ x, group.member.size
    for i in range(g):
        out[0, group.member[i]], out[1, group.member[i]] = moved[i], moved[g + i]


@jit
def group_rate(group: Group | None, state: Array, out: Array) -> None:
    """Write the rates of the states of the blocks of a group, among those of all blocks, shape (2, m)."""
    if group is None:
        return
    x = np.empty(group.matrix.shape[0])
    group_state(group, state, x)
    rate, g = group.matrix @ x, group.member.size
    for i in range(g):
        out[0, group.member[i]], out[1, group.member[i]] = rate[i], rate[g + i]
