"""Gradients of one number of a run by any number of parameters: one pass backward through the run.

The pass carries the derivatives of the objective by the state, backward through segments and events, with the same
eigenbases and divided differences as the forward derivatives. For every status it leaves one matrix, which is in the
end contracted with the derivatives of the equation of motion.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vofem.arrays import Array, Complex
from vofem.sensitivities.flow import Block, Closed, divided, divided_far, ramped
from vofem.sensitivities.forcing import Forcing, derivative_waves
from vofem.sensitivities.forward import Forward, Meeting
from vofem.sensitivities.modal import ModalChange

#: As for forward derivatives.
_NEAR = 1.0


@dataclass
class Linear:
    """The derivative of an objective as a linear form of the derivatives of the run."""

    events: Array  #: What the derivatives of the times of events count for, shape (n_events,).
    explicit: Array  #: Derivatives by the parameters at a fixed motion, shape (p,).
    value: float = 0.0
    #: For segments: times after the start, and what the derivative of the scaled state there counts for, (2n,).
    weights: dict[int, list[tuple[float, Array]]] = field(default_factory=dict)

    def add(self, index: int, tau: float, weight: Array) -> None:
        """Count the state at a time after the start of a segment."""
        self.weights.setdefault(index, []).append((tau, weight))


class _Sums:
    """What the pass leaves for a status, in its eigenbasis: it is contracted with derivatives of the equation."""

    def __init__(self, n: int, status: Any) -> None:
        self.status = status
        self.pairs = np.zeros((2 * n, 2 * n), dtype=complex)
        self.forces = np.zeros((n, n))
        self.push = np.zeros(n)


class Backward:
    """One pass backward through a run.

    `forward`: the run, without derivatives.
    """

    def __init__(self, forward: Forward, linear: Linear) -> None:
        self._forward, self._linear = forward, linear
        modal = forward.modal
        self._gradient = linear.explicit.copy()
        self._sums: dict[bytes, _Sums] = {}
        self._loads = np.zeros_like(modal.loads)

    def gradient(self) -> Array:
        """Return the gradient, shape (p,)."""
        forward, n = self._forward, self._forward.modal.size
        segments = forward.segments
        weight = np.zeros(2 * n)
        for index in range(segments.starts.size - 1, -1, -1):
            if index in forward.meetings:
                weight = self._event(index, forward.meetings[index], weight)
            weight = self._segment(index, weight)
        if forward.begin is not None:
            weight = self._event(-1, forward.begin, weight)
        self._contract()
        scale = forward.modal.scale
        for k, change in enumerate(forward.changes):
            self._gradient[k] += (weight[:n] * scale) @ change.displacement + weight[n:] @ change.velocity
        return self._gradient

    # -- events -----------------------------------------------------------------------------------

    def _event(self, index: int, meeting: Meeting, weight: Array) -> Array:
        """Return the weight of the state before the events at the end of a segment, or of that at the start."""
        forward, n, scale, passage = self._forward, self._forward.modal.size, self._forward.modal.scale, meeting.passage
        explicit, by_v = forward.explicit(meeting), weight[n:]
        z, v, off, meets = passage.back(weight[:n] * scale, by_v)
        before = np.concatenate([z / scale, v])
        self._gradient += off @ explicit.off + meets @ explicit.meets + by_v @ explicit.velocity
        for number in passage.numbers:
            if counted := float(self._linear.events[number]):
                row, rate, fixed = forward.timing(index, meeting, int(forward.events.contact[number]), explicit)
                before -= counted / rate * row
                self._gradient -= counted / rate * fixed
        return before

    # -- segments ---------------------------------------------------------------------------------

    def _segment(self, index: int, weight: Array) -> Array:
        """Return the weight of the state at the begin of a segment."""
        forward = self._forward
        counted = [(float(forward.segments.durations[index]), weight), *self._linear.weights.get(index, [])]
        counted = [(tau, one) for tau, one in counted if np.any(one)]
        if not counted:
            return np.zeros_like(weight)
        times = np.array([tau for tau, _ in counted])
        weights = np.stack([one for _, one in counted])
        piece = forward.closed(index)
        if isinstance(piece, Closed):
            return self._closed(index, piece, times, weights)
        return self._block(index, piece, times, weights)

    def _closed(self, index: int, piece: Closed, times: Array, weights: Array) -> Array:
        basis = piece.basis
        values = basis.values
        left = weights @ basis.vectors
        e = np.exp(values * times[:, None])
        sums = self._of(index)
        away = values[:, None] - values[None, :]
        near = np.abs(away) * piece.segment.duration < _NEAR
        both = left.T @ e
        kernel = (np.sum(left * e, axis=0)[:, None] - both) / np.where(near, np.inf, away)
        i, j = np.nonzero(near)
        for t, one in zip(times.tolist(), left, strict=True):
            kernel[i, j] += one[i] * divided(values[i], values[j], t)
        pairs = kernel * piece.a
        into = basis.inverse[:, values.size // 2 :]
        for sigma, y0, y1 in zip(piece.sigma, piece.y0, piece.y1, strict=True):
            exponent = np.full((1, values.size), sigma)
            level = np.sum(left * divided_far(values[None], exponent, times[:, None]), axis=0)
            growth = np.sum(left * ramped(values[None], exponent, times[:, None]), axis=0)
            pairs += np.outer(level, y0) + np.outer(growth, y1)
            self._forces(index, float(sigma.imag), level @ into, growth @ into)
        sums.pairs += pairs
        return np.asarray((np.sum(left * e, axis=0) @ basis.inverse).real)

    def _forces(self, index: int, omega: float, level: Complex, growth: Complex) -> None:
        """Count the derivatives of the forces at one frequency, with sign, in a segment.

        A derivative that grows with time, as that by a frequency, is counted together with the level: both weights are
        those of the waves exp(i omega tau) and tau exp(i omega tau).
        """
        forward, sums = self._forward, self._of(index)
        flow = forward.flow(forward.segments.status[index])
        project = flow.equation.project
        through = level if project is None else level @ project
        through_growth = growth if project is None else growth @ project
        if any(inverse is not None for inverse in flow.inverses):
            sums.forces += _counted(forward.forces(index)[0], omega, level, growth)
        if omega == 0.0:
            sums.push += through.real
        loads, t = forward.modal.system.loads, float(forward.segments.starts[index])
        for number, wave in enumerate(forward.waves(index)):
            self._loads[number] += _counted(wave, omega, through, through_growth)
        for k, change in enumerate(forward.changes):
            for number, path in change.change.functions.items():
                wave = derivative_waves(loads[number].function, path, t)
                self._gradient[k] += forward.modal.loads[number] @ _counted(wave, omega, through, through_growth)

    def _block(self, index: int, piece: Block, times: Array, weights: Array) -> Array:
        """Do what `_closed` does with block exponentials, one parameter after the other."""
        from scipy.linalg import expm

        forward = self._forward
        segment, p = piece.segment, len(forward.changes)
        flow = forward.flow(forward.segments.status[index])
        own = Block(
            flow.equation.matrix, flow.matrices,
            segment._replace(starts=np.zeros((segment.start.size, p)), forces=forward.force_changes(index)),
        )  # fmt: skip
        rest = own.sample(np.eye(segment.start.size), times)
        self._gradient += np.einsum("tn,ntp->p", weights, rest)
        return np.asarray(sum(one @ expm(own.matrix * t) for t, one in zip(times.tolist(), weights, strict=True)))

    def _of(self, index: int) -> _Sums:
        status = self._forward.segments.status[index]
        key = status.tobytes()
        if key not in self._sums:
            self._sums[key] = _Sums(self._forward.modal.size, status)
        return self._sums[key]

    def _contract(self) -> None:
        """Contract what the pass has left with the derivatives of equations and loads."""
        for sums in self._sums.values():
            flow = self._forward.flow(sums.status)
            pairs = np.zeros_like(flow.equation.matrix)
            if flow.basis is not None:
                pairs = (flow.basis.inverse.T @ sums.pairs @ flow.basis.vectors.T).real
            parts = zip(flow.matrices, flow.inverses, flow.pushes, strict=True)
            for k, (matrix, inverse, push) in enumerate(parts):
                if matrix is not None:
                    self._gradient[k] += float(np.sum(matrix * pairs))
                if inverse is not None:
                    self._gradient[k] += float(np.sum(inverse * sums.forces))
                self._gradient[k] += float(push @ sums.push)
        change: ModalChange
        for k, change in enumerate(self._forward.changes):
            if change.loads is not None:
                self._gradient[k] += float(np.sum(change.loads * self._loads))


def _counted(wave: Forcing, omega: float, level: Complex, growth: Complex) -> Array:
    """Return what a number (n,) or a vector (n, n) that varies in time counts for, from the weights of a frequency."""
    out = np.zeros((level.size, *wave.level.shape[1:]))
    for k in np.flatnonzero(wave.omega == abs(omega)):
        one, two = (wave.level[k], wave.growth[k]) if omega >= 0.0 else (wave.level[k].conj(), wave.growth[k].conj())
        half = 1.0 if omega == 0.0 else 0.5
        out += half * (np.multiply.outer(level, one) + np.multiply.outer(growth, two)).real
    return out
