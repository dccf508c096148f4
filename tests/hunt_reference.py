"""An independent integration for scenes that stepping methods take: DOP853, restarted where a law changes its branch.

It shares M, C, K, rows and load vectors with the package; laws, loads and time stepping are written out here.
"""

import math

import numpy as np
from reference_integration import corners, matrices, value_and_slope
from scipy.integrate import DOP853
from scipy.optimize import brentq

import vofem as vf
from vofem.laws import HystereticLaws, SmoothLaws, SpringpotLaws


def value(function, t):
    """Return the value of a load at a time at which it has no jump."""
    try:
        constant, _, waves = value_and_slope(function, t)
    except (AttributeError, TypeError, ValueError):
        return float(function(t))
    return constant + sum(a * math.sin(w * t + phase) for a, w, phase in waves)


class Stop:
    """A contact: closed in branch 1."""

    def __init__(self, effect):
        self.effect, self.start = effect, []

    def begin(self, u):
        return self.start

    def initial(self, u, v):
        s = u - self.effect.gap
        return int(s > 0.0 or (s == 0.0 and v > 0.0))

    def force(self, u, v, z, branch):
        effect, s = self.effect, u - self.effect.gap
        if not branch:
            return 0.0
        if effect.switch != "ideal":
            return effect.stiffness / math.gamma(max(-math.expm1(-effect.switch.s0 * s), 1e-300)) * s if s > 0 else 0.0
        return effect.stiffness * (s if effect.acts_on == "penetration" else u) + effect.damping * v

    def rate(self, u, v, z, branch):
        return []

    def guards(self, u, v, z, branch):
        s = u - self.effect.gap
        return [(-s if branch else s, 1 - branch)]


class Smooth:
    """A nonlinear spring."""

    def __init__(self, effect):
        self.effect, self.start = effect, []

    def begin(self, u):
        """Return the internal variables of a start within the linear limit."""
        return self.start

    def initial(self, u, v):
        return 0

    def force(self, u, v, z, branch):
        return self.effect(u)

    def rate(self, u, v, z, branch):
        return []

    def guards(self, u, v, z, branch):
        return []


class Jenkins(Smooth):
    """One slider with its spring: z is the elastic elongation; branches are stick and slip in either direction."""

    def __init__(self, stiffness, limit):
        self.stiffness, self.limit, self.start = stiffness, limit, [0.0]

    def begin(self, u):
        return [u]

    def force(self, u, v, z, branch):
        return self.stiffness * z[0]

    def rate(self, u, v, z, branch):
        return [0.0 if branch else v]

    def guards(self, u, v, z, branch):
        if branch:
            return [(-v * branch, 0)]
        return [(z[0] - self.limit, 1), (-z[0] - self.limit, -1)]


class Plain(Smooth):
    """A linear spring."""

    def __init__(self, stiffness):
        self.stiffness, self.start = stiffness, []

    def force(self, u, v, z, branch):
        return self.stiffness * u


def backbone_force(stiffness, limit, u):
    """Return F of ``F = K (1 - (F - K d0)/4) u`` beyond the linear limit, in tension."""
    if u <= limit:
        return stiffness * u
    return stiffness * u * (1.0 + 0.25 * stiffness * limit) / (1.0 + 0.25 * stiffness * u)


class Cyclic(Smooth):
    """A softening spring; z holds its force and the largest one in both directions, branches are its loadings."""

    def __init__(self, effect):
        self.stiffness, self.limit = effect.stiffness, effect.linear_limit
        self.start = [0.0, self.stiffness * self.limit, self.stiffness * self.limit]

    def begin(self, u):
        return [self.stiffness * u, *self.start[1:]]

    def force(self, u, v, z, branch):
        return z[0]

    def rate(self, u, v, z, branch):
        k = self.stiffness
        if branch == 0:
            return [k * v, 0.0, 0.0]
        left = 1.0 - 0.25 * (abs(z[0]) - k * self.limit)
        growth = k * left**2 / (1.0 + 0.25 * k * self.limit) * v
        return [growth, growth if branch > 0 else 0.0, -growth if branch < 0 else 0.0]

    def guards(self, u, v, z, branch):
        if branch:
            return [(-v * branch, 0)]
        return [(z[0] - z[1], 1), (-z[0] - z[2], -1)]


class Crushing(Smooth):
    """A stop that yields: z is the deepest approach behind the gap; branches: free, elastic, yielding."""

    def __init__(self, effect):
        self.effect, self.start = effect, [effect.linear_limit]

    def _dent(self, z):
        k = self.effect.stiffness
        return z[0] - backbone_force(k, self.effect.linear_limit, z[0]) / k

    def force(self, u, v, z, branch):
        s, k = u - self.effect.gap, self.effect.stiffness
        if branch == 0:
            return 0.0
        return k * (s - self._dent(z)) if branch == 1 else backbone_force(k, self.effect.linear_limit, s)

    def rate(self, u, v, z, branch):
        return [v if branch == 2 else 0.0]

    def guards(self, u, v, z, branch):
        s = u - self.effect.gap
        if branch == 0:
            return [(s - self._dent(z), 1)]
        return [(self._dent(z) - s, 0), (s - z[0], 2)] if branch == 1 else [(-v, 1)]


def parts_of(effect):
    """Return the elements of a hysteretic spring."""
    match effect:
        case vf.BilinearSpring():
            h, k = effect.hardening, effect.stiffness
            return [Plain(h * k), Jenkins((1.0 - h) * k, effect.linear_limit)]
        case vf.IwanSpring():
            bends = np.asarray(effect.elongation)
            slopes = np.diff([0.0, *effect.force]) / np.diff([0.0, *bends])
            # Beyond the last point the curve goes on with the last slope.
            return [Plain(slopes[-1]), *(Jenkins(a - b, e) for a, b, e in zip(slopes, slopes[1:], bends, strict=False))]
        case vf.CrushingStop():
            return [Crushing(effect)]
    return [Cyclic(effect)]


def group_of(system, kind):
    """Return the group of laws of a kind, or None."""
    return next((group for group in system.laws if isinstance(group, kind)), None)


class HuntReference:
    """One case, integrated from t = 0 until `until`, where its budget of steps ends."""

    def __init__(self, case):
        scene, system = case.scene, case.scene.model.system
        mass, self.C, self.K = matrices(system)
        self.inverse, self.n, self.t_end = np.linalg.inv(mass), mass.shape[0], case.t_end
        self.laws, rows = [], []
        for kind, held in (
            ("contact", system.contacts),
            ("smooth", group_of(system, SmoothLaws)),
            ("memory", group_of(system, HystereticLaws)),
        ):
            for effect, row in zip(case.laws[kind], [] if held is None else held.rows.toarray(), strict=True):
                made = {
                    "contact": lambda e: [Stop(e)],
                    "smooth": lambda e: [Smooth(case.curves[e.name])],
                    "memory": parts_of,
                }
                for law in made[kind](effect):
                    self.laws.append(law)
                    rows.append(row)
        self.rows = np.array(rows).reshape(-1, self.n)
        self.loads = [(load.vector, load.function) for load in system.loads]
        self.corners = sorted({c for _, f in self.loads for c in corners(f) if 0.0 < c < self.t_end} | {self.t_end})
        start = scene.initial_state()
        self.start = start.q.copy(), start.v.copy()
        self.slices, at = [], 2 * self.n
        for law in self.laws:
            self.slices.append(slice(at, at + len(law.start)))
            at += len(law.start)
        self.narrow = min((w for _, f in self.loads for w in [_narrowest(f, self.t_end)]), default=self.t_end)

    def _rhs(self, t, y):
        n, q, v = self.n, y[: self.n], y[self.n : 2 * self.n]
        out, force = np.zeros(y.size), -self.K @ q - self.C @ v
        for vector, function in self.loads:
            # Within a span the value at its ends is that of the inside.
            force = force + vector * value(function, min(max(t, self.inside[0]), self.inside[1]))
        u, rate = self.rows @ q, self.rows @ v
        for j, law in enumerate(self.laws):
            z = y[self.slices[j]]
            force = force - self.rows[j] * law.force(u[j], rate[j], z, self.branch[j])
            out[self.slices[j]] = law.rate(u[j], rate[j], z, self.branch[j])
        out[:n], out[n : 2 * n] = v, self.inverse @ force
        return out

    def _guards(self, y):
        u, rate = self.rows @ y[: self.n], self.rows @ y[self.n : 2 * self.n]
        return [
            (g, j, to)
            for j, law in enumerate(self.laws)
            for g, to in law.guards(u[j], rate[j], y[self.slices[j]], self.branch[j])
        ]

    def run(self, times, budget, shift=0.0):
        """Return displacements at the times up to `until`, shape (n, count); the start is moved by `shift`."""
        q, v = self.start
        u, rate = self.rows @ q, self.rows @ (v + shift)
        y = np.concatenate([q, v + shift, *(law.begin(a) for law, a in zip(self.laws, u, strict=True))])
        self.branch = [law.initial(a, b) for law, a, b in zip(self.laws, u, rate, strict=True)]
        t, cursor, found, self.until, self.quickest, self.fastest, switches = 0.0, 0, [], 0.0, 0.0, 0.0, 0
        self.largest = float(np.max(np.abs(q)))
        while t < self.t_end:
            corner = next(c for c in self.corners if c > t)
            self.inside = t + 1e-12 * (corner - t), corner - 1e-9 * (corner - t)
            solver = DOP853(
                self._rhs, t, y, corner, rtol=1e-9, atol=1e-11 * (1e-3 + np.max(np.abs(y))), max_step=self.narrow
            )
            restart = False
            while solver.status == "running" and not restart:
                budget -= 1
                if budget < 0 or switches > 400:
                    return np.array(found).T.reshape(self.n, -1)
                solver.step()
                dense, left, right = solver.dense_output(), solver.t_old, solver.t
                rate = self._rhs(right, solver.y)
                self.quickest = max(self.quickest, float(np.max(np.abs(rate[self.n : 2 * self.n]))))
                self.largest = max(self.largest, float(np.max(np.abs(solver.y[: self.n]))))
                self.fastest = max(self.fastest, float(np.max(np.abs(solver.y[self.n : 2 * self.n]))))
                hit = self._first(dense, left, right)
                if hit is not None:
                    right, law, to = hit
                    restart = True
                while cursor < times.size and times[cursor] <= right:
                    found.append(dense(times[cursor])[: self.n])
                    cursor += 1
                t, y = right, dense(right)
                if restart:
                    self.branch[law], switches = to, switches + 1
                self.until = t
        return np.array(found).T.reshape(self.n, -1)

    def _first(self, dense, left, right):
        """Return time, law and branch of the first guard that becomes positive within a step, or None."""
        last = left
        for x in np.linspace(0.0, 1.0, 9)[1:]:
            now = left + x * (right - left)
            hits = []
            for k, (g, j, to) in enumerate(self._guards(dense(now))):
                if g > 1e-15 + 1e-13 * abs(float(np.max(np.abs(dense(now)[: self.n])))):
                    before = self._guards(dense(last))[k][0]
                    root = (
                        now
                        if before >= 0.0
                        else brentq(lambda s, k=k: self._guards(dense(s))[k][0], last, now, xtol=1e-15)
                    )
                    hits.append((root, j, to))
            if hits:
                return min(hits)
            last = now
        return None


def _narrowest(function, t_end):
    """Return a step below which no feature of a load is missed."""
    waves = []
    try:
        waves = value_and_slope(function, 0.0)[2]
    except (AttributeError, TypeError, ValueError):
        return t_end / 2000.0
    return min([t_end / 50.0, *(1.0 / w for _, w, _ in waves if w > 0.0)])


class SpringpotReference:
    """Scenes with springpots, stops and loads by the trapezoidal rule, at steps of one size.

    The past of the velocity is integrated exactly under the kernel, for a velocity that is linear between steps.

    Parameters
    ----------
    scene : Scene
    t_end : float
    """

    def __init__(self, scene, t_end):
        self.scene, self.t_end, self.system = scene, t_end, scene.model.system
        self.matrices = matrices(self.system)
        self.stops = [Stop(effect) for effect in scene.contacts]
        self.pots = [effect for effect in scene.effects if isinstance(effect, vf.Springpot)]
        self.rows = group_of(self.system, SpringpotLaws).rows.toarray()
        held = self.system.contacts
        self.at_stops = np.zeros((0, self.rows.shape[1])) if held is None else held.rows.toarray()

    def run(self, steps):
        """Return times and displacements, shapes (steps + 1,) and (n, steps + 1)."""
        (M, C, K), h, start = self.matrices, self.t_end / steps, self.scene.initial_state()
        t = h * np.arange(steps + 1)
        q, rates = np.zeros((M.shape[0], steps + 1)), np.zeros((len(self.pots), steps + 1))
        q[:, 0], v, rates[:, 0] = start.q, start.v.copy(), self.rows @ start.v
        a = self._load(0, h) - K @ q[:, 0] - C @ v - self._pushed(q[:, 0], v, h)[0]
        for row, pot, rate in zip(self.rows, self.pots, rates[:, 0], strict=True):
            # At order 1 a springpot is a dashpot, which acts at once.
            if order_at(pot, 0.0) == 1.0:
                a -= row * pot.coefficient * rate
        a = np.linalg.solve(M, a)
        for i in range(1, steps + 1):
            held, lever, load = np.zeros(M.shape[0]), np.zeros_like(M), self._load(i, h)
            for row, pot, rate in zip(self.rows, self.pots, rates, strict=True):
                newer, older = kernel(i, h, order_at(pot, t[i]))
                # Of the last step the newer end is unknown.
                held += pot.coefficient * (older @ rate[i - 1 :: -1] + newer[1:] @ rate[i - 1 : 0 : -1]) * row
                lever += pot.coefficient * newer[0] * np.outer(row, row)
            x = q[:, i - 1] + h * v
            for _ in range(40):
                w = 2.0 / h * (x - q[:, i - 1]) - v
                acc = 2.0 / h * (w - v) - a
                force, slope = self._pushed(x, w, h)
                left = M @ acc + (C + lever) @ w + K @ x + force + held - load
                move = np.linalg.solve(4.0 / h**2 * M + 2.0 / h * (C + lever) + K + slope, left)
                x = x - move
                if np.max(np.abs(move)) <= 1e-14 * (1e-6 + np.max(np.abs(x))):
                    break
            w = 2.0 / h * (x - q[:, i - 1]) - v
            q[:, i], v, a = x, w, 2.0 / h * (w - v) - a
            rates[:, i] = self.rows @ v
        return t, q

    def _load(self, i, h):
        """Return the loads at a step; at both ends of the run those within it."""
        at = min(max(i * h, 1e-9 * h), self.t_end - 1e-9 * h)
        return sum((load.vector * value(load.function, at) for load in self.system.loads), np.zeros(self.rows.shape[1]))

    def _pushed(self, x, w, h):
        """Return the force of the stops, and its slope by the displacements at the end of a step."""
        force, slope = np.zeros(x.size), np.zeros((x.size, x.size))
        for row, stop in zip(self.at_stops, self.stops, strict=True):
            if row @ x > stop.effect.gap:
                force += row * stop.force(row @ x, row @ w, None, 1)
                slope += np.outer(row, row) * (stop.effect.stiffness + 2.0 / h * stop.effect.damping)
        return force, slope


def order_at(pot, t):
    """Return the order of a springpot at a time."""
    return float(pot.order(t)) if callable(pot.order) else float(pot.order)


def kernel(count, h, order):
    """Return the weights of velocities at the newer and the older ends of the last steps, each (count,), newest first.

    They integrate ``t^-order/Gamma(1 - order)`` times a velocity that is linear within each step.
    """
    x = h * np.arange(count + 1)
    power = np.zeros(count + 1)
    # The integral from 0: at order 1 the kernel is an impulse at 0.
    power[1:] = x[1:] ** (1.0 - order)
    zeroth = np.diff(power) / math.gamma(2.0 - order)
    first = (1.0 - order) / math.gamma(3.0 - order) * np.diff(x * power)
    older = (first - x[:-1] * zeroth) / h
    return zeroth - older, older
