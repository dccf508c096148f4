"""An independent integration of small scenes, for comparison: dense matrix exponentials and bisection.

It shares M, C, K, rows, load vectors and laws with the package and nothing
else: no modes, no closed forms of responses, no bounds. Gaps are sampled at a
small fraction of the shortest period, and at ever shorter times after the start,
an event and a corner of a load, where gaps may be near zero with a slope near
zero. Local maxima between samples are looked up, crossings are bisected. It
gives up, and says until when it holds, where contacts graze within rounding,
where events pile up, and where a budget of samples is spent.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky, eigh, eigvalsh, expm, solve_triangular

import vofem as vf
from vofem import time_functions

#: Samples per radian of the quickest motion, samples computed at once, and halvings of a step in bisection and of the
#: first step.
DENSITY, BLOCK, HALVINGS, SOON = 20.0, 32, 44, 20


def value_and_slope(function, t):
    """Return value, slope and harmonics (amplitude, omega, phase) of a named function from t on."""
    match function:
        case vf.Sine():
            return 0.0, 0.0, [(function.amplitude, function.omega, function.phase)]
        case vf.Constant():
            return function.value, 0.0, []
        case vf.Pulse():
            return (function.amplitude if function.start <= t < function.start + function.duration else 0.0), 0.0, []
        case vf.Ramp():
            stop = np.inf if function.stop is None else function.stop
            if t < function.start:
                return 0.0, 0.0, []
            if t >= stop:
                return function.slope * (stop - function.start), 0.0, []
            return function.slope * (t - function.start), function.slope, []
        case vf.Tabulated():
            i = int(np.searchsorted(function.t, t, side="right"))
            if i in (0, function.t.size):
                return function.values[max(i - 1, 0)], 0.0, []
            slope = (function.values[i] - function.values[i - 1]) / (function.t[i] - function.t[i - 1])
            return function.values[i - 1] + slope * (t - function.t[i - 1]), slope, []
        case time_functions.Sum():
            parts = [value_and_slope(term, t) for term in function.terms]
            return sum(p[0] for p in parts), sum(p[1] for p in parts), [h for p in parts for h in p[2]]
        case time_functions.Scaled():
            value, slope, harmonics = value_and_slope(function.function, t)
            a = function.factor
            return a * value, a * slope, [(a * size, omega, phase) for size, omega, phase in harmonics]
    raise TypeError(function)


def corners(function):
    match function:
        case vf.Pulse():
            return [function.start, function.start + function.duration]
        case vf.Ramp():
            return [function.start, *([] if function.stop is None else [function.stop])]
        case vf.Tabulated():
            return list(function.t)
        case time_functions.Sum():
            return [corner for term in function.terms for corner in corners(term)]
        case time_functions.Scaled():
            return corners(function.function)
    return []


def matrices(system):
    """Return dense M, C, K."""
    M, K = system.mass.toarray(), system.stiffness.toarray()
    C = np.zeros_like(M) if system.damping is None else system.damping.toarray()
    if system.rayleigh is not None:
        C = C + system.rayleigh[0] * M + system.rayleigh[1] * K
    if system.modal_damping is not None:
        squares, shapes = eigh(K, M)
        # Rigid motions are counted where all unknowns have a stiffness of one: a soft mode beside stiff ones is none.
        scale = np.sqrt(np.where(np.diag(K) > 0.0, np.diag(K), 1.0))
        rigid = int(np.sum(eigvalsh(K / np.outer(scale, scale)) < 1e-10))
        omega = np.sqrt(np.where(np.arange(squares.size) < rigid, 0.0, np.maximum(squares, 0.0)))
        C = C + M @ shapes @ np.diag(2.0 * system.modal_damping * omega) @ shapes.T @ M
    return M, C, K


class Event(NamedTuple):
    """A contact closes or opens; `rate` is the speed at which its gap function passes zero."""

    time: float
    contact: int
    closed: bool
    rate: float


@dataclass
class Outcome:
    """Events, states at some times, until when all that holds and why no longer, and the quickest rate met."""

    events: list[Event] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    q: list[np.ndarray] = field(default_factory=list)
    v: list[np.ndarray] = field(default_factory=list)
    until: float = 0.0
    why: str = "end"
    quickest: float = 0.0


@dataclass(frozen=True)
class Flow:
    """Exponentials of one contact status: of a step, of its multiples and of its halves."""

    scale: float
    step: float
    multiples: np.ndarray
    halves: np.ndarray


class Reference:
    """One scene, integrated from t = 0.

    A state is (y, y', 1, load values, load slopes, pairs of harmonics) with y = L' q and M = L L'. Within a
    status rates are divided by its quickest rate, for which the norms of its exponentials are about one.
    """

    def __init__(self, scene, t_end):
        system = scene.model.system
        M, C, K = matrices(system)
        self.n, self.t_end = M.shape[0], t_end
        self.L = cholesky(M, lower=True)
        self.K, self.C = self._congruent(K), self._congruent(C)
        self.laws = system.contacts
        rows = np.zeros((0, self.n)) if self.laws is None else self.laws.rows.toarray()
        self.rows = solve_triangular(self.L, rows.T, lower=True).T
        self.gap = np.zeros(0) if self.laws is None else self.laws.gap
        self.functions = [load.function for load in system.loads]
        self.vectors = [solve_triangular(self.L, load.vector, lower=True) for load in system.loads]
        self.waves = [
            (vector * amplitude, omega, phase)
            for vector, function in zip(self.vectors, self.functions, strict=True)
            for amplitude, omega, phase in value_and_slope(function, 0.0)[2]
        ]
        self.corners = sorted({c for f in self.functions for c in corners(f) if 0 < c < t_end} | {t_end})
        start = scene.initial_state()
        self.start = self.L.T @ start.q, self.L.T @ start.v
        self.flows = {}

    def _congruent(self, matrix):
        half = solve_triangular(self.L, matrix, lower=True)
        full = solve_triangular(self.L, half.T, lower=True)
        return 0.5 * (full + full.T)

    def flow(self, closed):
        key = closed.tobytes()
        if key not in self.flows:
            self.flows[key] = self._flow(closed)
        return self.flows[key]

    def _flow(self, closed):
        n, m = self.n, len(self.functions)
        K, C, offset = self.K.copy(), self.C.copy(), np.zeros(n)
        for j in np.flatnonzero(closed):
            row, k = self.rows[j], self.laws.stiffness[j]
            K += k * np.outer(row, row)
            C += self.laws.damping[j] * np.outer(row, row)
            offset += 0.0 if self.laws.jump[j] else k * self.gap[j] * row
        rates = [np.sqrt(max(np.linalg.eigvalsh(K)[-1], 0.0)), np.linalg.eigvalsh(C)[-1], 1.0 / self.t_end]
        s = float(max([*rates, *(abs(omega) for _, omega, _ in self.waves)]))
        size = 2 * n + 1 + 2 * m + 2 * len(self.waves)
        A = np.zeros((size, size))
        A[:n, n : 2 * n] = s * np.eye(n)
        A[n : 2 * n, :n], A[n : 2 * n, n : 2 * n], A[n : 2 * n, 2 * n] = -K / s, -C, offset / s
        for i, vector in enumerate(self.vectors):
            A[n : 2 * n, 2 * n + 1 + i] = vector / s
            A[2 * n + 1 + i, 2 * n + 1 + m + i] = 1.0
        for i, (vector, omega, _) in enumerate(self.waves):
            at = 2 * n + 1 + 2 * m + 2 * i
            A[at, at + 1], A[at + 1, at] = omega, -omega
            A[n : 2 * n, at] = vector / s
        step = 1.0 / (DENSITY * s)
        powers = [expm(A * step)]
        for _ in range(BLOCK - 1):
            powers.append(powers[-1] @ powers[0])
        halves = expm(A * (step * 0.5 ** np.arange(1, HALVINGS + 1))[:, None, None])
        return Flow(s, step, np.stack(powers), halves)

    def loaded(self, state, t):
        """Return the state with the load entries that hold from t on."""
        state, at, m = state.copy(), 2 * self.n + 1, len(self.functions)
        for i, function in enumerate(self.functions):
            state[at + i], state[at + m + i], _ = value_and_slope(function, t)
        for i, (_, omega, phase) in enumerate(self.waves):
            state[at + 2 * m + 2 * i : at + 2 * m + 2 * i + 2] = np.sin(omega * t + phase), np.cos(omega * t + phase)
        return state

    def watched(self, flow, sign, states):
        """Return the gap functions, positive where the status no longer holds, and their rates."""
        n = self.n
        phi = sign * (states[..., :n] @ self.rows.T - self.gap)
        return phi, sign * (states[..., n : 2 * n] @ self.rows.T) * flow.scale

    def run(self, budget=40_000, most_events=200):
        """Integrate until t_end, or until `budget` samples and `most_events` events are spent."""
        n, outcome, t, fresh = self.n, Outcome(), 0.0, True
        rates = np.zeros(2 * n + 1 + 2 * len(self.functions) + 2 * len(self.waves), dtype=bool)
        rates[n : 2 * n] = True
        state = np.zeros(rates.size)
        state[:n], state[rates], state[2 * n] = *self.start, 1.0
        s, speed = self.rows @ self.start[0] - self.gap, self.rows @ self.start[1]
        size = np.abs(self.rows) @ np.abs(self.start[0]) + np.abs(self.gap)
        closed = np.where(np.abs(s) <= 1e-15 * size, speed > 0, s > 0)
        while t < self.t_end and outcome.why == "end":
            flow, sign = self.flow(closed), np.where(closed, -1.0, 1.0)
            outcome.quickest = max(outcome.quickest, flow.scale)
            corner = next(c for c in self.corners if c > t)
            scaled = np.where(rates, self.loaded(state, t) / np.where(rates, flow.scale, 1.0), self.loaded(state, t))
            size = np.maximum(size, np.abs(self.rows) @ np.abs(state[:n]) + np.abs(self.gap))
            tiny = 1e-12 * size + 1e-300
            whole = min(BLOCK, int((corner - t) / flow.step))
            budget -= whole
            states = np.concatenate([scaled[None], flow.multiples[:whole] @ scaled])
            elapsed = whole * flow.step
            crossing = self.soon(flow, sign, tiny, scaled, corner - t) if fresh else None
            if crossing is None:
                crossing = self.first(flow, sign, tiny, states)
            if crossing is None and whole < BLOCK:
                # The rest of a step up to a corner of a load, or to the end.
                rest = max(corner - t - elapsed, 0.0)
                states = np.stack([states[-1], self.advance(flow, states[-1], rest)])
                crossing = self.first(flow, sign, tiny, states, rest / flow.step)
                after = corner
            else:
                after, elapsed = t + elapsed, 0.0
            if crossing == "doubtful":
                outcome.why = "grazing"
                break
            if crossing is None:
                t, scaled = after, states[-1]
            else:
                t, scaled = t + elapsed + crossing[0], crossing[1]
            state = scaled * np.where(rates, flow.scale, 1.0)
            fresh = crossing is not None or t == corner
            if crossing is not None:
                phi, speed = self.watched(flow, sign, scaled)
                struck = (np.abs(phi) <= np.maximum(10.0 * tiny, np.abs(speed) * 1e-12 * flow.step)) & (speed > 0)
                if not np.any(struck):
                    outcome.why = "grazing"
                    break
                for j in np.flatnonzero(struck):
                    mine = [event.time for event in outcome.events if event.contact == j]
                    if self.laws.jump[j] and len(mine) > 1 and t - mine[-2] < 1e-6 * self.t_end:
                        outcome.why = "chatter"
                    outcome.events.append(Event(t, int(j), not closed[j], float(speed[j])))
                closed = closed ^ struck
                if len(outcome.events) > most_events:
                    outcome.why = "events"
            if crossing is not None or t >= self.t_end or t - (outcome.times or [0.0])[-1] >= self.t_end / 64.0:
                outcome.times.append(t)
                outcome.q.append(solve_triangular(self.L.T, state[:n]))
                outcome.v.append(solve_triangular(self.L.T, state[rates]))
            outcome.until = t
            if budget < 0:
                outcome.why = "budget"
        return outcome

    def advance(self, flow, state, duration):
        """Return the state after less than a step."""
        left = duration / flow.step
        for k in range(HALVINGS):
            if left >= 0.5 ** (k + 1):
                state = flow.halves[k] @ state
                left -= 0.5 ** (k + 1)
        return state

    def last(self, flow, state, holds, limit):
        """Return the time (in steps, up to `limit`) and the state until which a condition holds."""
        elapsed = 0.0
        for k in range(HALVINGS):
            if elapsed + 0.5 ** (k + 1) <= limit and holds(ahead := flow.halves[k] @ state):
                state = ahead
                elapsed += 0.5 ** (k + 1)
        return elapsed, state

    def soon(self, flow, sign, tiny, state, limit):
        """Return what `first` does, for times that double up to a step, or up to `limit` in s, where it is certain."""
        begin = 0.0
        for k in [SOON, *range(SOON, 0, -1)]:
            length = 0.5**k
            if (begin + length) * flow.step > limit:
                return None
            ahead = flow.halves[k - 1] @ state
            found = self.first(flow, sign, tiny, np.stack([state, ahead]), length)
            if found is not None and found != "doubtful":
                return begin * flow.step + found[0], found[1]
            begin, state = begin + length, ahead
        return None

    def first(self, flow, sign, tiny, states, limit=1.0):
        """Return time and state of the first crossing among consecutive samples, None, or "doubtful"."""
        phi, rate = self.watched(flow, sign, states)
        turning = (rate[:-1] > 0) & (rate[1:] <= 0) & (phi[:-1] + rate[:-1] * flow.step > 0)
        for i in np.flatnonzero(np.any((phi[1:] > tiny) | turning, axis=1)):
            found = []
            for j in np.flatnonzero((phi[i + 1] > tiny) | turning[i]):
                end = limit
                if phi[i + 1, j] <= tiny[j]:
                    end, top = self.last(
                        flow, states[i], lambda x, j=j: self.watched(flow, sign, x)[1][j] > 0.0, limit
                    )  # fmt: skip
                    height = self.watched(flow, sign, top)[0][j]
                    if height < -tiny[j]:
                        continue
                    if height <= tiny[j]:
                        return "doubtful"
                found.append(
                    self.last(flow, states[i], lambda x, j=j: self.watched(flow, sign, x)[0][j] <= 0.0, end)
                )  # fmt: skip
            if found:
                elapsed, state = min(found, key=lambda pair: pair[0])
                return (i + elapsed) * flow.step, state
        return None
