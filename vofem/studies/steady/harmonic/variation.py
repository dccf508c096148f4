"""Multipliers of periodic motions that are given by harmonics: the motion of small perturbations over one period.

A small perturbation of a motion obeys linear equations whose coefficients repeat with the motion: the structure without
its laws, and the tangents ``k(t), c(t)`` of the laws along the motion, which act on the laws' coordinates alone,

    z'' + D z' + W^2 z = -sum_j b_j (k_j(t) b_j.z + c_j(t) b_j.z').

Between the times at which tangents jump, the right-hand side is a polynomial through Gauss nodes (collocation), and the
modes respond to it exactly, however fast they are. Where a force jumps, the velocity of a perturbation jumps too.

Hill's method takes the same multipliers from a matrix of all harmonics, where they have to be sorted out; see
J. Peletan, S. Baguet, M. Torkhani, G. Jacquet-Richardet, Nonlinear Dyn. 72 (2013) 671, doi:10.1007/s11071-012-0744-0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from vofem.arrays import Array
from vofem.studies.steady.harmonic.law_path import LawMotion
from vofem.studies.steady.harmonic.linear_rest import LinearRest
from vofem.studies.steady.harmonic.trigonometric import basis

#: Gauss nodes in a panel, and the phase that a panel may cover, rad.
_NODES, _PHASE = 6, 1.5

#: Samples of tangents between two jumps, from which the length of panels is taken.
_LOOKS = 16

_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class _Panel:
    """How modes move over a panel, m modes and J laws in s nodes."""

    free: Array  #: Displacement and velocity at the end by those at the start, shape (2, 2, m).
    seen: Array  #: Coordinates and rates of the laws at nodes by the state at the start, shape (2, s*J, 2m).
    among: Array  #: The same by forces at nodes, shape (2, s*J, s*J).
    pushed: Array  #: State at the end by forces at nodes, shape (2m, s*J).


def monodromy(rest: LinearRest, rows: Array, tangents: Sequence[LawMotion], omega: float, harmonics: int) -> Array:
    """Return the change of small perturbations over a period, in modal displacements and velocities, shape (2m, 2m).

    `rows` are those of the laws in modes, shape (J, m), `omega` the angular frequency of the motion in rad/s, and
    `harmonics` the number of its harmonics.
    """
    columns, rates = rest.dashpots
    m, laws = rest.squares.size, len(tangents)
    rows = np.concatenate([rows.reshape(laws, m), columns.T])
    weights = np.einsum("jm,jm->j", rows, rows)
    cuts = np.concatenate([np.zeros(1), *(one.cuts for one in tangents), np.full(1, _TURN)])
    now = np.eye(2 * m)
    for low, high in pairwise(np.unique(cuts).tolist()):
        for j, one in enumerate(tangents):
            for angle, speed, spring, damper in one.jumps.tolist():
                if angle == low:
                    # The time of the jump moves by -b.z over the rate, on closing as on opening.
                    now[m:] -= (spring + damper * speed) / abs(speed) * np.outer(rows[j], rows[j] @ now[:m])
        looks = _tangents(tangents, rates, np.linspace(low, high, _LOOKS + 2)[1:-1])
        fastest = np.sqrt(np.max(weights @ np.abs(looks[0]))) + np.max(weights @ np.abs(looks[1]))
        duration = (high - low) / omega
        count = 1
        if np.any(looks):
            count += int(max(harmonics * (high - low), fastest * duration) / _PHASE)
        panel = _panel(rest, rows, duration / count)
        edges = np.linspace(low, high, count + 1)
        nodes = edges[:-1, None] + np.diff(edges)[:, None] * _gauss()[0]
        along = _tangents(tangents, rates, nodes.ravel()).reshape(2, -1, count, _NODES)
        for k_nodes, c_nodes in np.moveaxis(along, 1, 3).reshape(2, count, -1, 1).swapaxes(0, 1):
            matrix = np.eye(k_nodes.size) + k_nodes * panel.among[0] + c_nodes * panel.among[1]
            force = np.linalg.solve(matrix, k_nodes * (panel.seen[0] @ now) + c_nodes * (panel.seen[1] @ now))
            z, v = now[:m], now[m:]
            free = panel.free[..., None]
            now = np.concatenate([free[0, 0] * z + free[0, 1] * v, free[1, 0] * z + free[1, 1] * v])
            now -= panel.pushed @ force
    return now


def _tangents(tangents: Sequence[LawMotion], rates: Array, angles: Array) -> Array:
    """Return stiffness and damping of laws and dashpots at angles, shape (2, J, n)."""
    found = np.zeros((2, len(tangents) + rates.size, angles.size))
    for j, one in enumerate(tangents):
        found[:, j] = one.at(basis(angles, one.harmonics))[1:]
    found[1, len(tangents) :] = rates[:, None]
    return found


@cache
def _gauss() -> tuple[Array, Array]:
    """Return Gauss nodes in (0, 1), and the coefficients of ``x^k/k!`` in the polynomials that are 1 at one of them."""
    nodes = 0.5 * (1.0 + np.polynomial.legendre.leggauss(_NODES)[0])
    powers = np.cumprod(np.concatenate([np.ones((1, _NODES)), nodes / np.arange(1, _NODES)[:, None]]), axis=0)
    return nodes, np.linalg.inv(powers.T)


def _panel(rest: LinearRest, rows: Array, h: float) -> _Panel:
    """Return how modes move over a panel of h seconds."""
    from scipy.linalg import expm

    nodes, coefficients = _gauss()
    count, m = nodes.size, rest.squares.size
    # The state is (a z, h v) and the time t/h, so that matrices have the size of the phase. Further components are the
    # derivatives of the force at the start.
    squares = rest.squares * h * h
    a = np.maximum(np.sqrt(squares), 1.0)
    matrix = np.zeros((m, 2 + count, 2 + count))
    matrix[:, 0, 1] = a
    matrix[:, 1, 0], matrix[:, 1, 1], matrix[:, 1, 2] = -squares / a, -rest.damping * h, 1.0
    matrix[:, np.arange(2, 1 + count), np.arange(3, 2 + count)] = 1.0
    moved = expm(np.append(nodes, 1.0)[:, None, None, None] * matrix)[:, :, :2]
    # From (a z, h v), and the force times h^2, to (z, v) and the force.
    free, forced = moved[..., :2].copy(), (moved[..., 2:] @ coefficients) * h * h
    free[:, :, 0, 1] *= h / a
    free[:, :, 1, 0] *= a / h
    forced[:, :, 0] /= a[:, None]
    forced[:, :, 1] /= h
    laws = rows.shape[0]
    seen = np.einsum("jm,lmxy->xljym", rows, free[:-1]).reshape(2, count * laws, 2 * m)
    among = np.einsum("jm,lmxi,km->xljik", rows, forced[:-1], rows).reshape(2, count * laws, count * laws)
    pushed = np.einsum("mxi,km->xmik", forced[-1], rows).reshape(2 * m, count * laws)
    return _Panel(np.moveaxis(free[-1], 0, -1), seen, among, pushed)
