"""Springpots whose order varies, in random scenes: right within what is stated, or a note or an error says why not.

The reference integrates the velocity's past exactly under the kernel, for a velocity that is linear between steps, and
the motion by the trapezoidal rule. The package takes sums of exponentials and mean rates.
`python tests/test_hunt_springpots.py FIRST LAST` runs the scenes of many seeds and prints what it finds.
"""

import itertools
import random

import numpy as np
import pytest
from campaigns import campaign
from hunt_reference import SpringpotReference
from hunt_scenes import decades
from test_hunt_stepping import INFORMS

import vofem as vf

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
    """Return a load."""
    size, kind = decades(rng, 0, 1), rng.choice(["sine", "constant", "ramp", "swell"])
    omega, at = rng.uniform(1.0, 20.0) / t_end * 2.0, rng.uniform(0.2, 0.8) * t_end
    return {
        "sine": vf.Sine(size, omega),
        "constant": vf.Constant(size),
        "ramp": lambda t: size * np.asarray(t) / t_end,
        "swell": lambda t: size * np.exp(-(((np.asarray(t) - at) / (0.1 * t_end)) ** 2)),
    }[kind]


class Motion:
    """A row of masses with springs, springpots, a stop and a load, and how it is run."""

    def __init__(self, seed):
        rng = random.Random(seed)
        self.t_end, self.words = decades(rng, -0.5, 1.0), []
        n = rng.choice([1, 1, 2, 3])
        masses = [decades(rng, -0.5, 0.5) for _ in range(n)]
        ground = [rng.choice([0.0, decades(rng, -1, 2)]) for _ in range(n)]
        between = [decades(rng, 0, 2) for _ in range(n - 1)]
        start = [rng.choice([-1.0, 1.0]) * decades(rng, -1, 0.5) for _ in range(n)]
        parts = [vf.Mass(m, stiffness=k, name=f"m{i}") for i, (m, k) in enumerate(zip(masses, ground, strict=True))]
        pairs = zip(itertools.pairwise(parts), between, strict=True)
        effects = [vf.Spring(a, b, stiffness=k) for (a, b), k in pairs]
        for _ in range(rng.choice([1, 1, 2])):
            order, word = order_of(rng, self.t_end)
            i, coefficient = rng.randrange(n), decades(rng, -1, 1.3)
            j = rng.choice([None, *(k for k in range(n) if k != i)])
            effects.append(
                vf.Springpot(parts[i], None if j is None else parts[j], coefficient=coefficient, order=order)
            )
            self.words.append(f"springpot {coefficient:.2g}, {word}")
        if rng.random() < 0.4:
            gap, stiffness = decades(rng, -2, 0), decades(rng, 1, 3)
            effects.append(vf.Contact(parts[0], gap=gap, stiffness=stiffness, side="above", acts_on="penetration"))
            self.words.append(f"stop {gap:.2g} m, {stiffness:.2g} N/m")
        effects.append(vf.PointLoad(parts[-1], load_of(rng, self.t_end)))
        self.scene = vf.Scene(parts, effects, {p: (0.0, v) for p, v in zip(parts, start, strict=True)})
        self.options = {"method": rng.choice(["energy_conserving", "generalized_alpha", "central_difference"])}
        way = rng.choice(["default", "dt", "tol"])
        if way == "dt":
            self.options["dt"] = decades(rng, -4, -1.5) * self.t_end
        if way == "tol" and self.options["method"] != "central_difference":
            self.options["tol"] = 10.0 ** rng.randint(-4, -2)
        self.words += [f"{n} masses, {self.t_end:.2g} s", *(f"{k}={v}" for k, v in self.options.items())]


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
    reference = SpringpotReference(case.scene, case.t_end)
    (_, coarse), (fine_t, fine) = reference.run(steps), reference.run(2 * steps)
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


if __name__ == "__main__":
    campaign(fault)
