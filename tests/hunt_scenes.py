"""Adversarial scenes for methods that step in time, out of a `random.Random`, and how each is to be run."""

import itertools
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from random_scenes import decades

import vofem as vf

METHODS = ("energy_conserving", "generalized_alpha", "central_difference")


@dataclass
class Case:
    """A scene, and how it is run; `laws` holds the effects by kind in the order of the system's rows.

    `curves` holds the forces of nonlinear springs by name.
    """

    scene: Any
    t_end: float
    method: str
    options: dict[str, Any]
    laws: dict[str, list[Any]]
    words: list[str] = field(default_factory=list)
    curves: dict[str, Any] = field(default_factory=dict)


def load(rng, t_end, words):
    """Return a load of unit size: pulses, spikes, fast sines, tables, callables."""
    kind = rng.choice(["pulse", "spike", "sine", "fast sine", "table", "callable", "sum", "constant"])
    words.append(kind)
    match kind:
        case "pulse":
            return vf.Pulse(1.0, rng.uniform(0.0, 0.8) * t_end, decades(rng, -4, -0.5) * t_end)
        case "spike":
            at, width = rng.uniform(0.1, 0.9) * t_end, decades(rng, -4, -2) * t_end
            return vf.Tabulated([0.0, at - width, at, at + width, t_end], [0.0, 0.0, 1.0, 0.0, 0.0])
        case "sine":
            return vf.Sine(1.0, decades(rng, -0.5, 1.5), rng.uniform(0.0, 6.0))
        case "fast sine":
            return vf.Sine(1.0, decades(rng, 2, 3.5), rng.uniform(0.0, 6.0))
        case "table":
            t = np.unique([rng.uniform(-0.1, 1.1) * t_end for _ in range(8)])
            return vf.Tabulated(t, [rng.uniform(-1.0, 1.0) for _ in t])
        case "callable":
            a, w = rng.uniform(0.1, 0.9) * t_end, decades(rng, -2.5, -0.5) * t_end
            return lambda t: np.exp(-(((np.asarray(t) - a) / w) ** 2))
        case "sum":
            return vf.Sine(0.5, decades(rng, 0, 2)) + vf.Pulse(0.5, 0.3 * t_end, 0.2 * t_end)
    return vf.Constant(1.0)


def bodies(rng, words):
    """Return bodies, points on them, and springs between them."""
    if rng.random() < 0.88:
        count = rng.choice([1, 1, 1, 2, 3, 4])
        parts = [
            vf.Mass(decades(rng, -0.5, 0.5), stiffness=rng.choice([0.0, decades(rng, -1, 2)]), name=f"m{k}",
                    damping=rng.choice([0.0, 0.0, decades(rng, -2, 0)]))
            for k in range(count)
        ]  # fmt: skip
        joints = [vf.Spring(a, b, stiffness=decades(rng, 0, 2)) for a, b in itertools.pairwise(parts)]
        words.append(f"{count} masses")
        return parts, list(parts), joints
    beam = vf.Beam(1.0, decades(rng, -1, 0), 1.0, 2, {"left": "clamped"}, name="beam")
    words.append("beam")
    return [beam], [beam.at(1.0), beam.at(0.5)], []


def curved(stiffness):
    """Return potential and force of a spring that stiffens."""
    return (lambda u: stiffness * (0.5 * u**2 + 0.25 * u**4)), (lambda u: stiffness * (u + u**3))


def case(rng):
    """Return a case."""
    words: list[str] = []
    curves: dict[str, Any] = {}
    parts, points, effects = bodies(rng, words)
    t_end = decades(rng, 0, 1.3)
    laws: dict[str, list[Any]] = {"contact": [], "smooth": [], "memory": [], "springpot": []}

    def add(kind, effect):
        laws[kind].append(effect)
        effects.append(effect)

    point = points[0]
    smooth_past = rng.random() < 0.12
    for k in range(rng.choice([0, 1, 1, 1, 2, 2])):
        gap = rng.choice([0.0, 0.0, *(decades(rng, -3, -0.5) for _ in range(6)), 1e3])
        law = rng.choice(["penetration", "penetration", "displacement"])
        switch = vf.Resolved(decades(rng, 1, 5)) if rng.random() < 0.15 and law == "penetration" else "ideal"
        stiffness = decades(rng, 2, 4 if smooth_past or switch != "ideal" else rng.choice([5, 8, 12]))
        damping = rng.choice([0.0, 0.0, decades(rng, -1, 1)]) if switch == "ideal" else 0.0
        at = rng.choice(points)
        add("contact", vf.Contact(at, gap=gap, side=rng.choice(["above", "below"]), stiffness=stiffness,
                                  damping=damping, acts_on=law, switch=switch, name=f"c{k}"))  # fmt: skip
        words.append(f"{law} {stiffness:.0e} gap {gap:.1e}" + (" resolved" if switch != "ideal" else ""))
    if smooth_past:
        order = rng.choice([0.3, 0.5, 0.8, lambda t: 0.4 + 0.3 * np.tanh(np.asarray(t) - 1.0)])
        add("springpot", vf.Springpot(point, coefficient=decades(rng, -1, 1), order=order))
        words.append("springpot" + (" of variable order" if callable(order) else ""))
    else:
        kind = rng.choice(["", "", "", "bilinear", "iwan", "cyclic", "crushing", "nonlinear"])
        k, limit = decades(rng, 0, 2), decades(rng, -2, 0)
        if kind == "bilinear":
            add("memory", vf.BilinearSpring(point, stiffness=k, linear_limit=limit, hardening=rng.choice([0.0, 0.1])))
        elif kind == "iwan":
            elongation = limit * np.array([1.0, 2.0, 4.0])
            add("memory", vf.IwanSpring(point, elongation=elongation, force=k * limit * np.array([1.0, 1.5, 1.8])))
        elif kind == "cyclic":
            add("memory", vf.HystereticSpring(point, stiffness=k, linear_limit=limit, memory="cyclic"))
        elif kind == "crushing":
            add("memory", vf.CrushingStop(point, gap=decades(rng, -2, 0), side="above", stiffness=100.0 * k,
                                          linear_limit=0.1 * limit))  # fmt: skip
        elif kind == "nonlinear":
            potential, force = curved(k)
            add("smooth", vf.NonlinearSpring(point, potential=potential, force=force, name="curved"))
            curves["curved"] = force
        if kind:
            words.append(kind)
    for _ in range(rng.choice([0, 1, 1, 1, 2] if isinstance(parts[0], vf.Mass) else [1, 1, 2])):
        f, size = load(rng, t_end, words), decades(rng, 0, 1.5)
        if rng.random() < 0.2:
            effects.append(vf.BaseMotion(parts[0], _times(f, size)) if len(parts) == 1 else vf.PointLoad(point, f))
        else:
            effects.append(vf.PointLoad(point, _times(f, size)))
    initial = {}
    if isinstance(parts[0], vf.Mass):
        initial[parts[0]] = (0.0, rng.choice([-1.0, 1.0]) * decades(rng, -1, 0.5))
    scene = vf.Scene(parts, effects, initial)
    method, options = rng.choice(METHODS), {}
    pace = rng.choice(["default", "default", "dt", "dt", "tol"])
    if pace == "dt":
        options["dt"] = decades(rng, -4, 0) * t_end
    if pace == "tol" and not smooth_past:
        method, options["tol"] = "energy_conserving", 10.0 ** rng.randint(-5, -2)
    if rng.random() < 0.5:
        options["times"] = np.linspace(0.0, t_end, rng.choice([2, 7, 98, 401]))
    words += [method, *(f"{name}={value:.2e}" for name, value in options.items() if name != "times")]
    return Case(scene, t_end, method, options, laws, words, curves)


def _times(f, size):
    return size * f if isinstance(f, vf.TimeFunction) else (lambda t: size * f(t))
