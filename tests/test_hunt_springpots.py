"""Springpots whose order varies, in random scenes: right within what is stated, or a note or an error says why not.

The reference is written out here: the velocity's past is integrated exactly under the kernel, for a velocity that is
linear between steps, and the motion by the trapezoidal rule. The package takes sums of exponentials and mean rates.
`python tests/test_hunt_springpots.py FIRST LAST` runs the scenes of many seeds and prints what it finds.
"""

from __future__ import annotations

import itertools
import math
import random
import sys
import traceback

import numpy as np
import pytest
from hunt_scenes import decades
from test_hunt_stepping import INFORMS

import vofem as vf

pytestmark = pytest.mark.kernels("plain")

#: Of the largest displacement.
ACCURATE = 0.02


def order_of(rng, t_end):
    """Return an order that varies with time within [0, 1], and a word for it."""
    low, high = sorted((rng.choice([0.0, rng.random()]), rng.choice([1.0, rng.random()])))
    at, width = rng.uniform(0.2, 0.8) * t_end, rng.uniform(0.02, 0.5) * t_end
    kind = rng.choice(["sine", "ramp", "rise", "table", "bump"])
    times, values = np.linspace(0.0, t_end, 7), np.array([rng.uniform(low, high) for _ in range(7)])
    turns = rng.uniform(0.5, 8.0) * 2.0 * np.pi / t_end
    found = {
        "sine": lambda t: low + (high - low) * 0.5 * (1.0 + np.sin(turns * np.asarray(t))),
        "ramp": lambda t: low + (high - low) * np.clip(np.asarray(t) / t_end, 0.0, 1.0),
        "rise": lambda t: low + (high - low) * 0.5 * (1.0 + np.tanh((np.asarray(t) - at) / width)),
        "table": lambda t: np.interp(t, times, values),
        "bump": lambda t: low + (high - low) * np.exp(-(((np.asarray(t) - at) / width) ** 2)),
    }[kind]
    return found, f"{kind} from {low:.2f} to {high:.2f}"


def load_of(rng, t_end):
    """Return a load as a function of one time, and as the package takes it."""
    size, kind = decades(rng, 0, 1), rng.choice(["sine", "constant", "ramp", "swell"])
    omega, at = rng.uniform(1.0, 20.0) / t_end * 2.0, rng.uniform(0.2, 0.8) * t_end
    match kind:
        case "sine":
            return (lambda t: size * math.sin(omega * t)), vf.Sine(size, omega)
        case "constant":
            return (lambda t: size), vf.Constant(size)
        case "ramp":
            return (lambda t: size * t / t_end), (lambda t: size * np.asarray(t) / t_end)
    return (
        (lambda t: size * math.exp(-(((t - at) / (0.1 * t_end)) ** 2))),
        (lambda t: size * np.exp(-(((np.asarray(t) - at) / (0.1 * t_end)) ** 2))),
    )


class Motion:
    """A row of masses with springs, springpots, a stop and a load, and how it is run."""

    def __init__(self, seed):
        rng = random.Random(seed)
        self.t_end, self.words = decades(rng, -0.5, 1.0), []
        n = rng.choice([1, 1, 2, 3])
        self.mass = np.array([decades(rng, -0.5, 0.5) for _ in range(n)])
        ground = [rng.choice([0.0, decades(rng, -1, 2)]) for _ in range(n)]
        between = [decades(rng, 0, 2) for _ in range(n - 1)]
        self.stiffness = np.diag(ground)
        for k, stiff in enumerate(between):
            self.stiffness[k : k + 2, k : k + 2] += stiff * np.array([[1.0, -1.0], [-1.0, 1.0]])
        self.start = np.array([rng.choice([-1.0, 1.0]) * decades(rng, -1, 0.5) for _ in range(n)])
        parts = [vf.Mass(m, stiffness=k, name=f"m{i}") for i, (m, k) in enumerate(zip(self.mass, ground, strict=True))]
        pairs = zip(itertools.pairwise(parts), between, strict=True)
        effects = [vf.Spring(a, b, stiffness=k) for (a, b), k in pairs]
        self.pots = []
        for _ in range(rng.choice([1, 1, 2])):
            order, word = order_of(rng, self.t_end)
            i, coefficient = rng.randrange(n), decades(rng, -1, 1.3)
            j = rng.choice([None, *(k for k in range(n) if k != i)])
            row = np.eye(n)[i] - (0.0 if j is None else np.eye(n)[j])
            self.pots.append((row, coefficient, order))
            effects.append(
                vf.Springpot(parts[i], None if j is None else parts[j], coefficient=coefficient, order=order)
            )
            self.words.append(f"springpot {coefficient:.2g}, {word}")
        self.stop = None
        if rng.random() < 0.4:
            self.stop = decades(rng, -2, 0), decades(rng, 1, 3)
            effects.append(
                vf.Contact(parts[0], gap=self.stop[0], stiffness=self.stop[1], side="above", acts_on="penetration")
            )
            self.words.append("stop {:.2g} m, {:.2g} N/m".format(*self.stop))
        self.load, taken = load_of(rng, self.t_end)
        effects.append(vf.PointLoad(parts[-1], taken))
        self.scene = vf.Scene(parts, effects, {p: (0.0, v) for p, v in zip(parts, self.start.tolist(), strict=True)})
        self.options = {"method": rng.choice(["energy_conserving", "generalized_alpha", "central_difference"])}
        way = rng.choice(["default", "dt", "tol"])
        if way == "dt":
            self.options["dt"] = decades(rng, -4, -1.5) * self.t_end
        if way == "tol" and self.options["method"] != "central_difference":
            self.options["tol"] = 10.0 ** rng.randint(-4, -2)
        self.words += [f"{n} masses, {self.t_end:.2g} s", *(f"{k}={v}" for k, v in self.options.items())]

    def reference(self, steps):
        """Return times and displacements of `steps` equal steps, shapes (steps + 1,) and (n, steps + 1)."""
        h, n = self.t_end / steps, self.mass.size
        t = h * np.arange(steps + 1)
        q, v = np.zeros((n, steps + 1)), np.zeros((n, steps + 1))
        v[:, 0] = self.start
        rates = np.zeros((len(self.pots), steps + 1))
        for k, (row, _, _) in enumerate(self.pots):
            rates[k, 0] = row @ self.start
        load = np.zeros((n, steps + 1))
        load[-1] = [self.load(x) for x in t.tolist()]
        a = (load[:, 0] - self._pulled(q[:, 0])[0]) / self.mass
        for k, (row, coefficient, order) in enumerate(self.pots):
            # At order 1 a springpot is a dashpot, which acts at once.
            if float(order(0.0)) == 1.0:
                a -= row * coefficient * rates[k, 0] / self.mass
        for i in range(1, steps + 1):
            held, lever = np.zeros(n), np.zeros((n, n))
            for k, (row, coefficient, order) in enumerate(self.pots):
                newer, older = kernel(i, h, float(order(t[i])))
                # Of the last step the newer end is unknown.
                known = older @ rates[k, i - 1 :: -1] + newer[1:] @ rates[k, i - 1 : 0 : -1]
                held += coefficient * known * row
                lever += coefficient * newer[0] * np.outer(row, row)
            x = q[:, i - 1] + h * v[:, i - 1]
            for _ in range(40):
                w = 2.0 / h * (x - q[:, i - 1]) - v[:, i - 1]
                acc = 2.0 / h * (w - v[:, i - 1]) - a
                force, slope = self._pulled(x)
                left = self.mass * acc + force + held + lever @ w - load[:, i]
                move = np.linalg.solve(np.diag(4.0 / h**2 * self.mass) + slope + 2.0 / h * lever, left)
                x = x - move
                if np.max(np.abs(move)) <= 1e-14 * (1e-6 + np.max(np.abs(x))):
                    break
            q[:, i] = x
            v[:, i] = 2.0 / h * (x - q[:, i - 1]) - v[:, i - 1]
            a = 2.0 / h * (v[:, i] - v[:, i - 1]) - a
            for k, (row, _, _) in enumerate(self.pots):
                rates[k, i] = row @ v[:, i]
        return t, q

    def _pulled(self, x):
        """Return force and stiffness of springs and stop."""
        force, slope = self.stiffness @ x, self.stiffness.copy()
        if self.stop is not None and x[0] > self.stop[0]:
            force[0] += self.stop[1] * (x[0] - self.stop[0])
            slope[0, 0] += self.stop[1]
        return force, slope


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


def fault(seed, steps=1200):
    """Return what is wrong with the run of a seed, or None."""
    case = Motion(seed)
    try:
        result = vf.simulate(case.scene, case.t_end, **case.options)
    except vf.VofemError:
        return None
    told = [note for note in result.notes if not INFORMS.match(note)]
    if told:
        return None
    (_, coarse), (fine_t, fine) = case.reference(steps), case.reference(2 * steps)
    size = float(np.max(np.abs(fine)))
    doubt = float(np.max(np.abs(coarse - fine[:, ::2]))) / size
    exact = np.array([np.interp(result.times, fine_t, row) for row in fine])
    error = float(np.max(np.abs(result.samples.q - exact))) / size
    step = fine_t[1]
    rounded = float(np.max(np.abs(np.diff(fine, 2)))) / 8.0 / size
    if "tol" in case.options:
        allowed = 10.0 * case.options["tol"] + 2.0 * doubt + rounded
    else:
        # A method of second order falls behind in phase.
        fastest = float(np.max(np.abs(np.diff(fine)))) / step
        omega = float(np.max(np.abs(np.diff(fine, 2)))) / step**2 / max(fastest, 1e-300)
        dt = result.solution.dt
        allowed = ACCURATE + omega * case.t_end * (omega * dt) ** 2 / 6.0 * fastest / max(omega, 1e-300) / size
        allowed += 2.0 * doubt + rounded
    if error <= allowed:
        return None
    return f"error {error:.2e} of {size:.2e} m, allowed {allowed:.1e}, doubt {doubt:.1e}: " + " | ".join(case.words)


@pytest.mark.parametrize("seed", range(12))
def test_right_or_told(seed):
    assert fault(seed, 500) is None


def campaign(first, last):
    for seed in range(first, last):
        try:
            found = fault(seed)
        except Exception:
            found = traceback.format_exc(limit=-3)
        if found:
            print(seed, found, flush=True)


if __name__ == "__main__":
    campaign(int(sys.argv[1]), int(sys.argv[2]))
