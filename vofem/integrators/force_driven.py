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
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from vofem.arrays import Array
from vofem.errors import ConvergenceError, LimitLoadError, MethodError
from vofem.integrators.applied_force import AppliedForce
from vofem.integrators.base import Energies, Samples, SpringSamples
from vofem.integrators.damping_matrix import damping_matrix
from vofem.integrators.methods import FORCE_DRIVEN
from vofem.integrators.observer import Observer, Snapshot, advanced, interruption
from vofem.integrators.stepped import SteppedSolution, step_count
from vofem.laws import PrintedLaw
from vofem.system import Counters, Events, State, System

#: What is missing from the balance of energy, over the largest energy, that is worth telling.
_ENERGY = 0.01

#: Relative error of a step.
_TOLERANCE = 3e-14


@dataclass(frozen=True)
class _Regime:
    """What holds between two events: direction of the load, whether the linear limit is passed, and gamma in m."""

    rising: bool
    beyond: bool
    residual: float


def refusal(system: System) -> str | None:
    """Return why this method cannot treat the system and what can, or None."""
    if system.driven is not None:
        return None
    return (
        f"{FORCE_DRIVEN.name} follows Eq. 22 of the paper, HystereticSpring(..., memory='printed'), which this scene "
        "does not hold; choose method='auto'"
    )


def run(
    system: System,
    start: State,
    t_end: float,
    times: Array | None,
    dt: float | None = None,
    observer: Observer | None = None,
    resume: Snapshot | None = None,
) -> SteppedSolution:
    """Simulate from the start state at t = 0 to t_end; `Method` describes the arguments.

    The method chooses its steps by their error. `dt` is the interval of storage where `times` is not given.

    Raises `MethodError` for a system without a printed law.
    Raises `LimitLoadError` if the applied force reaches what the spring can carry.
    """
    reason = refusal(system)
    if reason is not None:
        raise MethodError(reason)
    if times is None:
        steps = 1000 if dt is None else step_count(t_end, dt)
        times = np.minimum(np.arange(steps + 1) * (t_end / 1000 if dt is None else dt), t_end)
    return _Run(system, start, times).solve(t_end, observer, resume)


class _Run:
    def __init__(self, system: System, start: State, times: Array) -> None:
        self.system, self.times = system, times
        self.law: PrintedLaw = system.driven
        self.counters = Counters()
        damping = damping_matrix(system, self.counters)
        self.mass, self.damping = float(system.mass[0, 0]), 0.0 if damping is None else float(damping[0, 0])
        self.force = AppliedForce(system, self.counters)
        # Displacement and velocity; work of the load, of the damper and of the spring.
        self.y = np.array([start.q[0], start.v[0], 0.0, 0.0, 0.0])
        self.first_kinetic = 0.5 * self.mass * float(start.v[0]) ** 2
        self.out = np.empty((5, times.size))
        self.acceleration, self.pull = np.empty((2, times.size))
        self.cursor, self.longest = 0, 0.0
        # Largest amount missing from the balance of energy at the end of a span, over the largest energy, and when.
        self.missing = 0.0, 0.0

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

    def solve(self, t_end: float, observer: Observer | None, resume: Snapshot | None) -> SteppedSolution:
        """Return the whole motion."""
        regime = _Regime(True, abs(self.y[0]) > self.law.linear_limit, 0.0)
        # The spring has no past: what it holds at the start it was given before.
        held = self._pull(regime, self.force(0.0), float(self.y[0])) ** 2 / (2.0 * self.law.stiffness)
        spans, notes = self.force.directions(t_end), []
        self.spans, self.regime, reached = 0, regime, 0.0
        if resume is not None:
            self._restore(resume)

        def advance() -> None:
            nonlocal reached
            begin, reached, rising = spans[self.spans]
            self.regime = self._span(self._turned(self.regime, begin, rising), begin, reached)
            self.spans += 1

        if not advanced(advance, lambda: self.spans >= len(spans), lambda: reached, self._snapshot, observer):
            if not self.cursor:
                raise KeyboardInterrupt
            notes.append(interruption(reached, t_end))
            t_end = self._cut()
        self._store(lambda t: np.repeat(self.y[:, None], t.size, axis=1), self.regime, np.inf)
        return self._solution(t_end, held, notes)

    def _turned(self, regime: _Regime, begin: float, rising: bool) -> _Regime:
        """Return the regime of a span that begins."""
        x = float(self.y[0])
        if regime.rising and not rising:
            # The force just before: it may jump.
            at = np.nextafter(begin, -1.0) if begin > 0.0 else begin
            return _Regime(False, False, x - self._pull(regime, self.force(at), x) / self.law.stiffness)
        if rising and not regime.rising:
            return _Regime(True, abs(x) > self.law.linear_limit, 0.0)
        return regime

    def _snapshot(self) -> Snapshot:
        """Return what a run goes on from, as plain data."""
        return {
            "regime": astuple(self.regime),
            "spans": self.spans,
            "y": self.y,
            "output": np.vstack([self.out, self.acceleration, self.pull])[:, : self.cursor],
            "longest": self.longest,
            "missing": list(self.missing),
            "counters": self.counters,
        }

    def _restore(self, saved: Snapshot) -> None:
        """Put the run where a snapshot stands."""
        output = saved["output"]
        self.y, self.cursor, self.longest = saved["y"], output.shape[1], saved["longest"]
        self.out[:, : self.cursor] = output[:5]
        self.missing = tuple(saved["missing"])
        self.acceleration[: self.cursor], self.pull[: self.cursor] = output[5], output[6]
        for name, value in vars(saved["counters"]).items():
            setattr(self.counters, name, value)
        self.regime, self.spans = _Regime(*saved["regime"]), saved["spans"]

    def _cut(self) -> float:
        """Forget the times that were not reached; return the last one that was, s."""
        n = self.cursor
        self.times, self.out = self.times[:n], self.out[:, :n]
        self.acceleration, self.pull = self.acceleration[:n], self.pull[:n]
        return float(self.times[-1])

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
                raise ConvergenceError(
                    f"{FORCE_DRIVEN.name} found no way on from t = {found.t[-1]:g} s: {found.message}"
                )
            self.counters.steps += found.t.size - 1
            self.longest = max(self.longest, float(np.max(np.diff(found.t))))
            self.y, begin = found.y[:, -1], float(found.t[-1])
            self._store(found.sol, regime, begin)
            self._balance(begin)
            if found.status == 1:
                if regime.beyond and found.t_events[1].size:
                    raise self._limit(begin)
                regime = _Regime(True, not regime.beyond, 0.0)
        return regime

    def _balance(self, t: float) -> None:
        """Look at the balance of energy at time t: kinetic energy against the work of load, damper and spring."""
        _, v, work, damped, spring = self.y.tolist()
        kinetic = 0.5 * self.mass * v**2
        scale = max(kinetic, self.first_kinetic, abs(work), abs(damped), abs(spring))
        missing = (kinetic - self.first_kinetic + damped + spring - work) / scale if scale > 0.0 else 0.0
        if abs(missing) > abs(self.missing[0]):
            self.missing = missing, t

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

    def _solution(self, t_end: float, held: float, notes: list[str]) -> SteppedSolution:
        x, v, work, damped, spring = self.out
        kinetic = 0.5 * self.mass * v**2
        stored = self.law.stored(self.pull)
        lost = spring + held - stored
        if self.damping:
            self.counters.damping_evaluations = self.counters.steps
        self.counters.memory_updates = self.counters.steps
        missing, t = self.missing
        if abs(missing) > _ENERGY:
            notes.append(
                f"energy: by t = {t:.4g} s {abs(missing):.2g} of the largest energy was "
                f"{'lost by the steps' if missing < 0.0 else 'made out of nothing'}; choose method='auto' and a spring "
                "without memory='printed' to compare with"
            )
        springs = SpringSamples(self.pull[None, :], stored[None, :], lost[None, :], np.zeros(0))
        energies = Energies(kinetic, stored, np.zeros(x.size), damped + lost, work)
        start = self.first_kinetic + held
        samples = Samples(x[None, :], v[None, :], self.acceleration[None, :])
        return SteppedSolution(
            self.system, t_end, self.times, samples, energies, start, self.longest, Events(), self.counters, notes,
            springs,
        )  # fmt: skip
