"""Derivatives of an impacting mass by several programs beside exact ones: ``python benchmarks/derivatives.py``.

The case is A1 of ``tests/data/derivatives``: a mass hits a stop with a damper; displacements, velocities and their
derivatives by eleven parameters are known from arithmetic in 300 bits. CasADi and diffrax are extras of the benchmark
alone (``pip install -e .[bench]``); what is not installed is left out by name. The force of the stop is written for
them in the usual way: with ``if_else`` and with ``where``.
"""

from __future__ import annotations

import importlib.util
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import vofem as vf

Array = NDArray[np.float64]

DATA: dict[str, Any] = json.loads((Path(__file__).parents[1] / "tests/data/derivatives/A1.json").read_text())
NAMES: list[str] = DATA["parameters"]
POINT: Array = np.array([DATA["point"][name] for name in NAMES])
TIMES: Array = np.array(DATA["times"])

#: Tolerance of the solvers of other programs.
TOLERANCE = 1e-12

#: Relative steps of finite differences.
STEPS = (1e-3, 1e-5, 1e-7)


def exact() -> Array:
    """Return the derivatives of displacements and then velocities at all times, shape (2 n_times, 11)."""
    rows = {name: row for name, row in zip(DATA["names"], DATA["jacobian"], strict=True)}
    found = [next(row for name, row in rows.items() if name.startswith(f"{kind} @") and _time(name) == t)
             for kind in "uv" for t in TIMES]  # fmt: skip
    return np.array(found)


def _time(name: str) -> float:
    return min(TIMES.tolist(), key=lambda t: abs(t - float(name.partition("t=")[2])))


def error(found: Array) -> float:
    """Return the largest error of a row over the largest entry of the row."""
    right = exact()
    return float(np.max(np.max(np.abs(found - right), axis=1) / np.max(np.abs(right), axis=1)))


def scene_of(values: Array) -> tuple[vf.Scene, vf.Mass]:
    """Return the scene with values of the parameters."""
    p = dict(zip(NAMES, values.tolist(), strict=True))
    mass = vf.Mass(p["m"], stiffness=p["k"], damping=p["d"], name="m")
    stop = vf.Contact(mass, gap=p["gap"], stiffness=p["K0"], damping=p["c"], side=DATA["scene"]["side"],
                      acts_on=DATA["scene"]["law"], name="stop")  # fmt: skip
    load = vf.PointLoad(mass, vf.Sine(p["F"], p["om"], phase=p["ph"]), name="load")
    return vf.Scene([mass], [stop, load], initial={mass: (p["u0"], p["v0"])}), mass


FIELDS = {
    "gap": ("stop", "gap"), "K0": ("stop", "stiffness"), "c": ("stop", "damping"), "m": ("m", "mass"),
    "k": ("m", "stiffness"), "d": ("m", "damping"), "F": ("load", "f.amplitude"), "om": ("load", "f.omega"),
    "ph": ("load", "f.phase"), "u0": ("m", "initial.displacement"), "v0": ("m", "initial.velocity"),
}  # fmt: skip


def run(values: Array) -> tuple[vf.Result, vf.Mass]:
    """Return a run, and the mass."""
    scene, mass = scene_of(values)
    return vf.simulate(scene, float(TIMES[-1]), times=TIMES, method="event_driven", progress=False), mass


def motion(values: Array) -> Array:
    """Return displacements and velocities of a run, shape (2 n_times,)."""
    result, mass = run(values)
    return np.concatenate([result.displacement(mass), result.velocity(mass)])


def by_vofem() -> Array:
    """Return the exact derivatives of vofem, the run included."""
    result, mass = run(POINT)
    d = vf.sensitivities(result, [vf.Parameter(*FIELDS[name]) for name in NAMES])
    return np.vstack([d.displacement(mass), d.velocity(mass)])


def by_differences(step: float) -> Array:
    """Return central differences of vofem's runs."""
    columns = []
    for k, value in enumerate(POINT):
        h = np.zeros_like(POINT)
        h[k] = step * (abs(value) or 1.0)
        columns.append((motion(POINT + h) - motion(POINT - h)) / (2.0 * h[k]))
    return np.stack(columns, axis=1)


def _force(p: dict[str, Any], t: Any, u: Any, v: Any, sine: Any, choose: Any) -> Any:
    """Return the acceleration; `choose` picks the force of the stop where it is closed."""
    above = DATA["scene"]["side"] == "above"
    depth, speed = (u - p["gap"], v) if above else (-u - p["gap"], -v)
    stop = choose(depth > 0.0, p["K0"] * depth + p["c"] * speed, 0.0)
    push = p["F"] * sine(p["om"] * t + p["ph"])
    return (push - p["k"] * u - p["d"] * v - (stop if above else -stop)) / p["m"]


def by_casadi() -> Callable[[], Array]:
    """Return what computes the derivatives by CVODES and the forward mode of CasADi."""
    import casadi

    x, p, t = casadi.SX.sym("x", 2), casadi.SX.sym("p", len(NAMES)), casadi.SX.sym("t")
    named = {name: p[k] for k, name in enumerate(NAMES)}
    rate = casadi.vertcat(x[1], _force(named, t, x[0], x[1], casadi.sin, casadi.if_else))
    options = {"abstol": TOLERANCE, "reltol": TOLERANCE, "max_num_steps": 1_000_000}
    flow = casadi.integrator("flow", "cvodes", {"x": x, "p": p, "t": t, "ode": rate}, 0.0, TIMES.tolist(), options)
    q = casadi.MX.sym("q", len(NAMES))
    start = casadi.vertcat(q[NAMES.index("u0")], q[NAMES.index("v0")])
    ends = casadi.vec(flow(x0=start, p=q)["xf"].T)
    jacobian = casadi.Function("jacobian", [q], [casadi.jacobian(ends, q)])
    return lambda: np.array(jacobian(POINT))


def by_diffrax() -> Callable[[], Array]:
    """Return what computes the derivatives by Dopri8 and the forward mode of JAX, already compiled."""
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)

    def rate(t: Any, y: Any, p: Any) -> Any:
        named = dict(zip(NAMES, p, strict=True))
        return jnp.stack([y[1], _force(named, t, y[0], y[1], jnp.sin, jnp.where)])

    def ends(p: Any) -> Any:
        start = jnp.stack([p[NAMES.index("u0")], p[NAMES.index("v0")]])
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(rate), diffrax.Dopri8(), 0.0, float(TIMES[-1]), 1e-3, start, p,
            saveat=diffrax.SaveAt(ts=TIMES), max_steps=100_000, adjoint=diffrax.ForwardMode(),
            stepsize_controller=diffrax.PIDController(rtol=TOLERANCE, atol=TOLERANCE),
        )  # fmt: skip
        return found.ys.T.ravel()

    jacobian = jax.jit(jax.jacfwd(ends))
    jacobian(POINT)
    return lambda: np.array(jacobian(POINT))


def best(compute: Callable[[], Any], count: int = 3) -> tuple[Any, float]:
    """Return what a function returns and the least of some times in s, after a first call."""
    found, seconds = compute(), []
    for _ in range(count):
        start = time.perf_counter()
        compute()
        seconds.append(time.perf_counter() - start)
    return found, min(seconds)


def main() -> list[tuple[str, float, float]]:
    """Print and return programs, their errors and their times in s."""
    rows = [("vofem: the run alone", float("nan"), best(lambda: run(POINT))[1])]
    programs: list[tuple[str, Callable[[], Callable[[], Array]]]] = [
        ("vofem.sensitivities, run included", lambda: by_vofem)
    ]
    for step in STEPS:
        programs.append(
            (f"central differences of vofem's runs, step {step:g}", lambda h=step: lambda: by_differences(h))
        )
    for name, module, make in (
        ("CasADi, if_else and CVODES", "casadi", by_casadi), ("diffrax, where and Dopri8", "diffrax", by_diffrax)
    ):  # fmt: skip
        if importlib.util.find_spec(module) is None:
            print(f"{module} is not installed and is left out")
        else:
            programs.append((name, make))
    for name, make in programs:
        found, seconds = best(make())
        rows.append((name, error(found), seconds))
    for name, off, seconds in rows:
        print(f"{name:55s} {'' if np.isnan(off) else f'{off:.1e}':>10s} {1e3 * seconds:10.1f} ms")
    return rows


if __name__ == "__main__":
    main()
