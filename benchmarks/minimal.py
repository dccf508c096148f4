"""What a bare scene pays for all that vofem could do: ``python benchmarks/minimal.py``.

A cantilever under a load at its tip, without contact and damping, by each stepping
method and by the shortest loop that does the same arithmetic with the same banded
kernels: no stored states but the last, no energies, no events, no checks. Pairs of runs are
interleaved; set-up is taken out as in `kernels`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any
from unittest import mock

import numpy as np
from cases import chain, many_contacts
from numpy.typing import NDArray

from vofem.kernels.jit import jit
from vofem.kernels.mode import kernels as running
from vofem.linalg.banded import band_order, factor, solve, subtract_product, to_band, widen
from vofem.system import State, System

Array = NDArray[np.float64]

PAIRS = 41


@jit
def central_difference(mass: Array, stiffness: Array, load: Array, values: Array, dt: float, q: Array) -> None:
    """Advance q by the velocity form, from rest."""
    n = q.size
    a, half = np.empty(n), np.zeros(n)
    for step in range(values.size):
        for i in range(n):
            a[i] = load[i] * values[step]
        subtract_product(stiffness, q, a)
        solve(mass, a)
        for i in range(n):
            half[i] += dt * a[i] if step > 0 else 0.5 * dt * a[i]
            q[i] += dt * half[i]


@jit
def generalized_alpha(
    mass: Array, stiffness: Array, factored: Array, load: Array, values: Array, dt: float, q: Array
) -> None:
    """Advance q by Chung and Hulbert's method with rho_infinity = 0.8, from rest."""
    n, rho = q.size, 0.8
    am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    gamma = 0.5 - am + af
    beta = 0.25 * (1.0 - am + af) ** 2
    v, a, new, right, trial = np.zeros(n), np.zeros(n), np.empty(n), np.empty(n), np.empty(n)
    for step in range(values.size - 1):
        force = (1.0 - af) * values[step + 1] + af * values[step]
        for i in range(n):
            trial[i] = q[i] + (1.0 - af) * dt * (v[i] + dt * (0.5 - beta) * a[i])
            right[i] = load[i] * force
            new[i] = am * a[i]
        subtract_product(stiffness, trial, right)
        subtract_product(mass, new, right)
        solve(factored, right)
        for i in range(n):
            q[i] += dt * (v[i] + dt * ((0.5 - beta) * a[i] + beta * right[i]))
            v[i] += dt * ((1.0 - gamma) * a[i] + gamma * right[i])
            a[i] = right[i]


@jit
def midpoint(mass: Array, stiffness: Array, factored: Array, load: Array, values: Array, dt: float, q: Array) -> None:
    """Advance q by the midpoint rule, from rest, with one solve for the mean velocity p."""
    n = q.size
    v, p = np.zeros(n), np.empty(n)
    for step in range(values.size):
        for i in range(n):
            p[i] = load[i] * values[step]
        subtract_product(stiffness, q, p)
        for i in range(n):
            p[i] *= 0.5 * dt
            v[i] = -v[i]
        subtract_product(mass, v, p)
        solve(factored, p)
        for i in range(n):
            q[i] += dt * p[i]
            v[i] += 2.0 * p[i]


class _Loop:
    """The matrices that a minimal loop takes."""

    def __init__(self, system: System, method: str, dt: float) -> None:
        order = band_order(system.mass, system.stiffness)
        mass, stiffness = to_band(system.mass, order), to_band(system.stiffness, order)
        (load,) = system.loads
        self.function, self.vector, self.dt = load.function, load.vector[order], dt
        width = max(mass.shape[0], stiffness.shape[0]) - 1
        wide = widen(mass, width), widen(stiffness, width)
        self.matrices: tuple[Array, ...]
        self.loop: Callable[..., None]
        if method == "central_difference":
            self.loop, self.matrices, self.shift = central_difference, (factor(mass, "M"), stiffness), 0.0
        elif method == "generalized_alpha":
            rho = 0.8
            am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
            a = (1.0 - am) * wide[0] + (1.0 - af) * 0.25 * (1.0 - am + af) ** 2 * dt**2 * wide[1]
            self.loop, self.matrices, self.shift = generalized_alpha, (mass, stiffness, factor(a, "A")), 0.0
        else:
            a = wide[0] + 0.25 * dt**2 * wide[1]
            self.loop, self.matrices, self.shift = midpoint, (mass, stiffness, factor(a, "A")), 0.5 * dt

    def run(self, steps: int) -> Array:
        """Return q after some steps."""
        q = np.zeros(self.vector.size)
        # Generalized alpha uses the load at both ends of a step.
        count = steps + (self.loop is generalized_alpha)
        values = self.function(np.arange(count) * self.dt + self.shift)
        self.loop(*self.matrices, self.vector, values, self.dt, q)
        return q


@dataclass(frozen=True)
class Row:
    """Microseconds of a step of the minimal loop by method, and the median of vofem's over it."""

    system: str
    loop: dict[str, float]
    ratio: dict[str, float]


def _systems() -> list[tuple[str, System, float, int]]:
    """Return title, system, a step within the stability limit, and the steps of a run."""
    beam = many_contacts(25, 0).model.system
    large = many_contacts(1000, 0).model.system
    return [
        ("2 masses", chain(2, 0), 0.4, 200_000),
        ("beam, 25 elements", beam, 1.6 / (59.9 * 25**2), 20_000),
        ("beam, 1 000 elements", large, 1.6 / (59.9 * 1000**2), 1000),
    ]


METHODS = ("central_difference", "generalized_alpha", "energy_conserving")


def pairs(system: System, method: str, dt: float, steps: int) -> tuple[float, float]:
    """Return the microseconds of the loop's step, and the median ratio of vofem's step to it."""
    stepping: Any = getattr(import_module("vofem.integrators.stepping.methods"), method)
    loop = _Loop(system, method, dt)
    start, short = State(np.zeros(system.size), np.zeros(system.size)), 20

    def ours(count: int) -> tuple[float, Array]:
        begin = time.perf_counter()
        # A second run beside this one, which measures chaos, would be counted too.
        solution = stepping(system, start, count * dt, np.array([count * dt]), dt, nearby=False)
        return time.perf_counter() - begin, solution.sample(solution.times).q[:, -1]

    def theirs(count: int) -> tuple[float, Array]:
        begin = time.perf_counter()
        q = loop.run(count)
        return time.perf_counter() - begin, q

    with mock.patch("vofem.integrators.stepping.methods.critical_step", return_value=1.1 * dt):
        # The same motion, or the loop is no measure. The loop takes the values of the load, vofem its moments over
        # steps: from rest after 20 steps they differ by up to some percent.
        (_, mine), (_, other) = ours(short), theirs(short)
        order = band_order(system.mass, system.stiffness)
        assert np.allclose(mine[order], other, rtol=0.0, atol=0.05 * np.max(np.abs(other))), method
        base = min(ours(short)[0] for _ in range(5)), min(theirs(short)[0] for _ in range(5))
        found = [(ours(steps)[0] - base[0], theirs(steps)[0] - base[1]) for _ in range(PAIRS)]
    mine_of, theirs_of = np.array(found).T
    return 1e6 * float(np.median(theirs_of)) / (steps - short), float(np.median(mine_of / theirs_of))


def measure(report: Any = None) -> list[Row]:
    """Return a row per system."""
    rows = []
    for title, system, dt, steps in _systems():
        if report is not None:
            report(f"minimal loops: {title}")
        found = {method: pairs(system, method, dt, steps) for method in METHODS}
        rows.append(
            Row(title, {name: pair[0] for name, pair in found.items()}, {name: pair[1] for name, pair in found.items()})
        )
    return rows


def table(rows: list[Row]) -> str:
    """Return Markdown: microseconds of the loop, and vofem's over it."""
    head = ["system", *(method.replace("_", " ") for method in METHODS)]
    lines = ["| " + " | ".join(head) + " |", "| --- |" + " ---: |" * len(METHODS)]
    for row in rows:
        cells = [f"{row.loop[method]:.3g} us, {row.ratio[method]:.2f}" for method in METHODS]
        lines.append("| " + " | ".join([row.system, *cells]) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    with running(compiled=True):
        print(table(measure(lambda text: print(text, file=sys.stderr))))
