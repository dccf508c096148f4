"""Derivatives of the energy that dampers take."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from vofem.arrays import Array, Complex
from vofem.errors import MethodError
from vofem.sensitivities.flow import Block, Closed
from vofem.sensitivities.forward import Forward, Meeting
from vofem.system import CLOSED, OPEN

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)

#: Phase in rad over a panel of sixteen Gauss points, for which they are exact to rounding.
_PHASE = 8.0

#: Decay rate times the time after which a mode counts no longer.
_GONE = 32.0

#: Share of the largest amplitude from which on a mode counts; powers of modes far apart average out.
_COUNTS = 1e-9


def no_rigid_stops(what: str, forward: Forward) -> None:
    """Raise where rigid stops take energy and impulses at once, whose derivatives are not known."""
    laws = forward.modal.laws
    if laws is not None and laws.rigid.any():
        stop = laws.labels[int(np.argmax(laws.rigid))]
        raise MethodError(
            f"{what}: {stop} takes energy and momentum at once, of which {what} has no derivative; take those of the "
            "motion and of contacts[...].impacts, or sum_of_squares and of_motion"
        )


def dissipated(forward: Forward, times: Array) -> Array:
    """Return the derivatives of the energy in J dissipated from 0 to some times, shape (n_times, p)."""
    no_rigid_stops("energy.dissipated", forward)
    p = len(forward.changes)
    out = np.zeros((times.size, p))
    if not takes_energy(forward):
        return out
    order = np.argsort(times, kind="stable")
    ahead, total = 0, np.zeros(p)
    starts, durations = forward.starts, forward.segments.durations
    for index in range(starts.size):
        end = starts[index] + durations[index]
        last = index + 1 == starts.size
        inside: list[int] = []
        while ahead < order.size and (times[order[ahead]] < end or last):
            inside.append(int(order[ahead]))
            ahead += 1
        edges = np.array([0.0, *(times[k] - starts[index] for k in inside), durations[index]])
        parts = _integrals(forward, index, np.clip(edges, 0.0, durations[index]))
        for place, k in enumerate(inside):
            out[k] = total + parts[: place + 1].sum(axis=0)
        if ahead == order.size:
            break
        total = total + parts.sum(axis=0)
        if index in forward.meetings:
            for number, power in powers(forward, forward.meetings[index]):
                if power:
                    total = total + power * forward.event_times[number]
    return out


def takes_energy(forward: Forward) -> bool:
    """Return whether there are dampers, or parameters that make some."""
    modal, laws = forward.modal, forward.modal.laws
    damped = np.any(modal.damping) or (laws is not None and np.any(laws.damping))
    moved = (change.damping is not None or np.any(change.change.contact_damping) for change in forward.changes)
    return bool(damped or any(moved))


def _integrals(forward: Forward, index: int, edges: Array) -> Array:
    """Return the integrals of the rate of dissipation's derivatives between some times of a segment, (k, p)."""
    modal = forward.modal
    n, p = modal.size, len(forward.changes)
    piece = forward.closed(index)
    equation = forward.flow(forward.segments.status[index]).equation
    matrices = [-forward.lower(equation, change)[:, n:] for change in forward.changes]
    parts = np.zeros((edges.size - 1, p))
    nodes, weights, owner = [], [], []
    for k, (low, high) in enumerate(pairwise(edges)):
        if high <= low:
            continue
        points, shares = gauss(float(low), float(high), piece, equation.matrix)
        nodes.append(points)
        weights.append(shares)
        owner.append(np.full(points.size, k))
    if not nodes:
        return parts
    tau, weight, of = np.concatenate(nodes), np.concatenate(weights), np.concatenate(owner)
    rows = np.hstack([np.zeros((n, n)), np.eye(n)])
    block = max(1, 2_000_000 // max(1, n * p))
    for first in range(0, tau.size, block):
        part = slice(first, first + block)
        v = piece.states(tau[part])[n:]
        pull = equation.damping @ v
        changes = piece.sample(rows, tau[part])
        rate = 2.0 * np.einsum("nt,ntp->tp", pull, changes)
        for k, matrix in enumerate(matrices):
            if np.any(matrix):
                rate[:, k] += np.einsum("nt,nt->t", v, matrix @ v)
        np.add.at(parts, of[part], weight[part, None] * rate)
    return parts


def gauss(low: float, high: float, piece: Closed | Block, matrix: Array) -> tuple[Array, Array]:
    """Return points and weights of a quadrature of powers between two times of a segment, exact to rounding.

    Panels are as short as the fastest of the modes asks for that have not decayed by then.
    """
    roots, least = _counted(piece, matrix)
    with np.errstate(divide="ignore"):
        gone = np.where(roots.real < 0.0, _GONE / np.abs(roots.real), np.inf)
    order = np.argsort(gone, kind="stable")
    alive = np.maximum.accumulate(np.append(least, np.abs(roots[order][::-1])))[::-1]
    edges = np.clip(np.concatenate([[low], gone[order], [high]]), low, high)
    points, weights = [np.zeros(0)], [np.zeros(0)]
    for k in np.flatnonzero(np.diff(edges) > 0.0).tolist():
        width = edges[k + 1] - edges[k]
        count = max(1, int(np.ceil(width * 2.0 * alive[k] / _PHASE)))
        half = 0.5 * width / count
        middles = edges[k] + half * (2.0 * np.arange(count) + 1.0)
        points.append((middles[:, None] + half * _NODES).ravel())
        weights.append(np.tile(half * _WEIGHTS, count))
    return np.concatenate(points), np.concatenate(weights)


def _counted(piece: Closed | Block, matrix: Array) -> tuple[Complex, float]:
    """Return the roots in 1/s of the modes that count in a segment, and the largest frequency of the loads in rad/s."""
    if isinstance(piece, Block):
        return np.linalg.eigvals(matrix).astype(complex), float(np.max(piece.segment.force.omega, initial=0.0))
    size = np.abs(piece.a)
    counted = size > _COUNTS * max(float(np.max(size)), float(np.max(np.abs(piece.y0), initial=0.0)))
    return piece.basis.values[counted], float(np.max(np.abs(piece.sigma), initial=0.0))


def powers(forward: Forward, meeting: Meeting) -> list[tuple[int, float]]:
    """Return what the motion of events adds to the dissipated energy, W: numbers of events, and powers."""
    laws, modal = forward.modal.laws, forward.modal
    assert laws is not None
    found = []
    for number in meeting.passage.numbers:
        j, entered = int(forward.events.contact[number]), int(forward.events.status[number])
        rate = float(modal.contacts[j] @ meeting.state[modal.size :])
        if {int(meeting.passage.before[j]), entered} == {OPEN, CLOSED}:
            found.append((number, laws.damping[j] * rate**2 * (-1.0 if entered == CLOSED else 1.0)))
    return found
