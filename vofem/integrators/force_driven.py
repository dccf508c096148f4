"""Eq. 22 of the paper for a single loaded mass: a stiffness that follows the applied force.

    M x'' + C x' + K_eq (x - gamma) = F(t)

While F rises, gamma is zero and K_eq is K up to the linear limit and
``K (1 - softening(|F|))`` beyond it; while F falls, K_eq is K and gamma the
residual elongation, fixed once at the reversal so that the spring force is
continuous there. (Taken literally, Eq. 22f's running `sup` would let the mass
coast for ever.) Where F is held, its direction stays the last one. Dormand
and Prince's method of order 8 is restarted at reversals, at corners of the
load and where the linear limit is passed; the load alone says when it turns.

E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., 1993, section II.10.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ConvergenceError, LimitLoadError, MethodError
from vofem.integrators.base import Energies, Samples, SpringSamples
from vofem.integrators.damping_matrix import damping_matrix
from vofem.integrators.stepped import SteppedSolution
from vofem.memory import PrintedLaw
from vofem.system import Counters, Events, LoadFunction, State, System

Array = NDArray[np.float64]

#: Relative error of a step.
_TOLERANCE = 3e-14

#: Looks at the direction of the load in a run, and in a period of it.
_LOOKS, _LOOKS_IN_A_PERIOD = 4096, 32


@dataclass(frozen=True)
class _Regime:
    """What holds between two events: direction of the load, whether the linear limit is passed, and gamma in m."""

    rising: bool
    beyond: bool
    residual: float


class _Force:
    """The applied force and its direction."""

    def __init__(self, system: System, counters: Counters) -> None:
        self._parts: list[tuple[float, LoadFunction]] = [
            (float(load.vector[0]), load.function) for load in system.loads
        ]
        self._counters = counters

    def __call__(self, t: float) -> float:
        """Return F in N."""
        self._counters.load_evaluations += len(self._parts)
        return sum(factor * float(function(t)) for factor, function in self._parts)

    def corners(self, t_end: float) -> list[float]:
        """Return the times at which the force or its rate jumps, and both ends."""
        inner = [t for _, function in self._parts for t in function.breakpoints(t_end).tolist()]
        return sorted({0.0, t_end, *inner})

    def _rate(self, left: float, right: float) -> Callable[[float], float]:
        """Return F' in N/s between two corners; of plain callables by differences that stay between them."""
        step = 1e-7 * (right - left)

        def rate(t: float) -> float:
            total = 0.0
            for factor, function in self._parts:
                if function.closed_form:
                    total += factor * float(function.derivative(t))  # type: ignore[attr-defined]
                else:
                    a = min(max(t, left), right - step)
                    total += factor * (float(function(a + step)) - float(function(a))) / step
            return total

        return rate

    def directions(self, t_end: float) -> list[tuple[float, float, bool]]:
        """Return (begin, end, rising) of all spans in which the force keeps its direction and has no corner."""
        from scipy.optimize import brentq

        spans: list[tuple[float, float, bool]] = []
        rising, before = True, 0.0
        corners = self.corners(t_end)
        for left, right in pairwise(corners):
            rate, begin = self._rate(left, right), left
            at_left = self(left)
            if at_left != before and left > 0.0:
                # A jump of the force is a very fast rise or fall.
                rising = at_left > before
            looks = np.linspace(left, right, self._looks(left, right, t_end) + 1)
            # Rates within the span: at its end the one of the next span may be told.
            looks[-1] = right - 1e-9 * (right - left)
            rates = np.array([rate(t) for t in looks.tolist()])
            small = 1e-14 * np.max(np.abs(rates))
            for k, value in enumerate(rates.tolist()):
                if abs(value) <= small or (value > 0.0) == rising:
                    continue
                turn = begin
                if k and rates[k - 1] != 0.0 and (rates[k - 1] > 0.0) != (value > 0.0):
                    turn = float(brentq(rate, looks[k - 1], looks[k], xtol=1e-15 * right, rtol=8.9e-16))
                elif k:
                    turn = float(looks[k - 1])
                if turn > begin:
                    spans.append((begin, turn, rising))
                begin, rising = turn, not rising
            spans.append((begin, right, rising))
            before = self(np.nextafter(right, left))
        return spans

    def _looks(self, left: float, right: float, t_end: float) -> int:
        count = max(8, int(np.ceil(_LOOKS * (right - left) / t_end)))
        for _, function in self._parts:
            if function.closed_form:
                fastest = max((abs(w) for w, _ in function.piece(left).harmonics), default=0.0)  # type: ignore[attr-defined]
                count = max(count, int(np.ceil(_LOOKS_IN_A_PERIOD * fastest * (right - left) / (2.0 * np.pi))))
        return count


def run(
    system: System,
    start: State,
    t_end: float,
    times: Array | None,
    dt: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> SteppedSolution:
    """Simulate from the start state at t = 0 to t_end.

    Parameters
    ----------
    system : System
    start : State
    t_end : float
        In s.
    times : ndarray, optional
        Where to store; every dt where not given.
    dt : float, optional
        In s; a thousandth of t_end where not given. Steps are chosen by their error, whatever dt.
    progress : callable, optional
        Told the time reached.

    Raises
    ------
    MethodError
        For a system without a printed law.
    LimitLoadError
        If the applied force reaches what the spring can carry.
    """
    if system.printed is None:
        raise MethodError(
            "force_driven follows Eq. 22 of the paper, HystereticSpring(..., memory='printed'), which this scene does "
            "not hold; choose method='auto'"
        )
    if times is None:
        steps = 1000 if dt is None else max(1, int(np.ceil(t_end / dt - 1e-9)))
        times = np.minimum(np.arange(steps + 1) * (t_end / 1000 if dt is None else dt), t_end)
    return _Run(system, system.printed, start, times).solve(t_end, progress)


class _Run:
    def __init__(self, system: System, law: PrintedLaw, start: State, times: Array) -> None:
        self.system, self.law, self.times = system, law, times
        self.counters = Counters()
        damping = damping_matrix(system, self.counters)
        self.mass, self.damping = float(system.mass[0, 0]), 0.0 if damping is None else float(damping[0, 0])
        self.force = _Force(system, self.counters)
        # Displacement and velocity; work of the load, of the damper and of the spring.
        self.y = np.array([start.q[0], start.v[0], 0.0, 0.0, 0.0])
        self.first_kinetic = 0.5 * self.mass * float(start.v[0]) ** 2
        self.out = np.empty((5, times.size))
        self.acceleration, self.pull = np.empty((2, times.size))
        self.cursor, self.longest = 0, 0.0

    def _pull(self, regime: _Regime, force: float, x: float) -> float:
        """Return the spring force in N."""
        if not regime.rising:
            return self.law.stiffness * (x - regime.residual)
        softened = self.law.level(abs(force)) if regime.beyond else 0.0
        return self.law.stiffness * (1.0 - softened) * x

    def _rates(self, regime: _Regime) -> Callable[[float, Array], list[float]]:
        def rates(t: float, y: Array) -> list[float]:
            force, x, v = self.force(t), float(y[0]), float(y[1])
            pull = self._pull(regime, force, x)
            return [v, (force - self.damping * v - pull) / self.mass, force * v, self.damping * v * v, pull * v]

        return rates

    def solve(self, t_end: float, progress: Callable[[float], None] | None) -> SteppedSolution:
        """Return the whole motion."""
        regime = _Regime(True, abs(self.y[0]) > self.law.linear_limit, 0.0)
        # The spring has no past: what it holds at the start it was given before.
        held = self._pull(regime, self.force(0.0), float(self.y[0])) ** 2 / (2.0 * self.law.stiffness)
        for begin, end, rising in self.force.directions(t_end):
            x = float(self.y[0])
            if regime.rising and not rising:
                at = np.nextafter(begin, -1.0) if begin > 0.0 else begin
                residual = x - self._pull(regime, self.force(at), x) / self.law.stiffness
                regime = _Regime(False, False, residual)
            elif rising and not regime.rising:
                regime = _Regime(True, abs(x) > self.law.linear_limit, 0.0)
            regime = self._span(regime, begin, end)
            if progress is not None:
                progress(end)
        self._store(lambda t: np.repeat(self.y[:, None], t.size, axis=1), regime, np.inf)
        return self._solution(t_end, held)

    def _span(self, regime: _Regime, begin: float, end: float) -> _Regime:
        """Go through one span; return the regime at its end."""
        from scipy.integrate import solve_ivp

        while begin < end:
            if regime.rising and regime.beyond and abs(self.force(begin)) >= self.law.limit:
                raise self._limit(begin)
            found = solve_ivp(
                self._rates(regime), (begin, end), self.y, method="DOP853", rtol=_TOLERANCE,
                atol=1e-14 * max(self.law.linear_limit, float(np.max(np.abs(self.y[:1])))), dense_output=True,
                events=self._events(regime),
            )  # fmt: skip
            if found.status < 0:
                raise ConvergenceError(f"force_driven found no way on from t = {found.t[-1]:g} s: {found.message}")
            self.counters.steps += found.t.size - 1
            self.longest = max(self.longest, float(np.max(np.diff(found.t))))
            self.y, begin = found.y[:, -1], float(found.t[-1])
            self._store(found.sol, regime, begin)
            if found.status == 1:
                if regime.beyond and found.t_events[1].size:
                    raise self._limit(begin)
                regime = _Regime(True, not regime.beyond, 0.0)
        return regime

    def _events(self, regime: _Regime) -> list[Any]:
        """Return what ends a step: the linear limit is passed, or the limit load is reached."""
        if not regime.rising:
            return []

        def passed(t: float, y: Array) -> float:
            return abs(float(y[0])) - self.law.linear_limit

        def reached(t: float, y: Array) -> float:
            return abs(self.force(t)) - self.law.limit if np.isfinite(self.law.limit) else -1.0

        passed.terminal, passed.direction = True, -1.0 if regime.beyond else 1.0  # type: ignore[attr-defined]
        reached.terminal, reached.direction = True, 1.0  # type: ignore[attr-defined]
        return [passed, reached] if regime.beyond else [passed]

    def _limit(self, t: float) -> LimitLoadError:
        load, limit = self.force(t), self.law.limit
        return LimitLoadError(
            f"{self.law.label}: the load reaches {load:.6g} N at t = {t:.6g} s, and the spring carries less than "
            f"{limit:.6g} N: there its secant stiffness falls to zero. Load it less, or change its softening",
            load, t, limit,
        )  # fmt: skip

    def _store(self, states: Callable[[Array], Array], regime: _Regime, before: float) -> None:
        """Store all wanted times before one; the regime that begins at an event holds there already."""
        last = int(np.searchsorted(self.times, before, side="left"))
        part = slice(self.cursor, last)
        if last > self.cursor:
            t = self.times[part]
            y = states(t)
            rates = self._rates(regime)
            self.out[:, part] = y
            for k, time in enumerate(t.tolist(), self.cursor):
                state = self.out[:, k]
                self.acceleration[k] = rates(time, state)[1]
                self.pull[k] = self._pull(regime, self.force(time), float(state[0]))
        self.cursor = max(self.cursor, last)

    def _solution(self, t_end: float, held: float) -> SteppedSolution:
        x, v, work, damped, spring = self.out
        kinetic = 0.5 * self.mass * v**2
        stored = 0.5 * self.pull**2 / self.law.stiffness
        lost = spring + held - stored
        if self.damping:
            self.counters.damping_evaluations = self.counters.steps
        self.counters.memory_updates = self.counters.steps
        springs = SpringSamples(self.pull[None, :], stored[None, :], lost[None, :], np.zeros(0))
        energies = Energies(kinetic, stored, np.zeros(x.size), damped + lost, work)
        start = self.first_kinetic + held
        samples = Samples(x[None, :], v[None, :], self.acceleration[None, :])
        return SteppedSolution(
            self.system, t_end, self.times, samples, energies, start, self.longest, Events(), self.counters, [], springs
        )  # fmt: skip
