"""What each effect costs when it is added to the same scene: ``python benchmarks/effects.py``.

To measure another effect, add a line to `ADDED`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from cases import many_contacts, paper_beam

import vofem as vf
from vofem.kernels.mode import kernels as running
from vofem.system import Counters

ELEMENTS, T_END, TIMES = 25, 20.0, 201

#: Those for any scene: force_driven is for one printed law alone.
METHODS = ("event_driven", "energy_conserving", "generalized_alpha", "central_difference")

#: Name, and a function that returns the scene: the bare cantilever under its load with one thing added.
ADDED: tuple[tuple[str, Callable[[], vf.Scene]], ...] = (
    ("nothing: the bare beam", lambda: paper_beam("penetration", contact=False)(ELEMENTS)),
    ("Rayleigh damping", lambda: _bare_with(lambda beam: [vf.RayleighDamping(0.2, 1e-4)])),
    ("modal damping", lambda: _bare_with(lambda beam: [vf.ModalDamping(0.02)])),
    ("a dashpot at the tip", lambda: _bare_with(lambda beam: [vf.Dashpot(beam.at(1.0), damping=0.1)])),
    ("a two-sided foundation", lambda: _bare_with(lambda beam: [vf.Foundation(beam, stiffness=1.0)])),
    ("one contact, penetration law", lambda: many_contacts(ELEMENTS, 1)),
    ("one contact, displacement law", lambda: paper_beam("displacement")(ELEMENTS)),
    ("one contact with a resolved switch", lambda: paper_beam("penetration", switch=vf.Resolved(1e4))(ELEMENTS)),
    ("ten contacts", lambda: many_contacts(ELEMENTS, 10)),
    ("a hysteretic spring", lambda: _bare_with(_remembers)),
    ("a springpot at the tip", lambda: _bare_with(_springpot(0.5))),
    ("a springpot whose order varies", lambda: _bare_with(_springpot(lambda t: 0.5 + 0.4 * np.sin(t)))),
    ("a one-sided foundation, 25 contacts", lambda: _bare_with(_lift_off)),
    ("dry friction at the tip, rigid", lambda: _bare_with(_slides(None))),
    ("dry friction at the tip, behind a spring", lambda: _bare_with(_slides(100.0))),
    ("a rigid stop at the tip", lambda: _bare_with(_bounces)),
    ("a mass that travels", lambda: _bare_with(lambda beam: [vf.PointMass(beam.along(vf.Path(0.05)), mass=0.1)])),
)


def _bare_with(extra: Callable[[vf.Beam], list[Any]]) -> vf.Scene:
    return paper_beam("penetration", extra=extra, contact=False)(ELEMENTS)


def _remembers(beam: vf.Beam) -> list[Any]:
    return [vf.HystereticSpring(beam.at(1.0), stiffness=1.0, linear_limit=0.01, memory="cyclic")]


def _springpot(order: Any) -> Callable[[vf.Beam], list[Any]]:
    return lambda beam: [vf.Springpot(beam.at(1.0), coefficient=0.1, order=order)]


def _lift_off(beam: vf.Beam) -> list[Any]:
    return [vf.Foundation(beam, stiffness=1.0, one_sided=True, gap=0.03)]


def _slides(stiffness: float | None) -> Callable[[vf.Beam], list[Any]]:
    return lambda beam: [vf.Friction(beam.at(1.0), coefficient=0.5, normal=0.1, stiffness=stiffness)]


def _bounces(beam: vf.Beam) -> list[Any]:
    return [vf.RigidStop(beam.at(1.0), gap=0.05, side="above", restitution=0.7)]


@dataclass(frozen=True)
class Row:
    """One effect: milliseconds per simulated second by method, and counters of event_driven or of the first method."""

    name: str
    cost: dict[str, float]
    counters: dict[str, int]
    counted: str


def measure(report: Any = None) -> list[Row]:
    """Return a row per effect. Steps are of 1 ms, those of central differences half of the critical one."""
    rows = []
    for name, build in ADDED:
        if report is not None:
            report(f"effects: {name}")
        scene = build()
        cost, counters, counted = {}, {}, ""
        for method in METHODS:
            try:
                seconds, result = _best(scene, method)
            except vf.MethodError:
                continue
            cost[method] = 1e3 * seconds / T_END
            if not counters:
                found = vars(result.counters)
                counters, counted = {f.name: found[f.name] for f in fields(Counters) if found[f.name]}, method
        rows.append(Row(name, cost, counters, counted))
    return rows


def _best(scene: vf.Scene, method: str) -> tuple[float, vf.Result]:
    dt = 1e-3 if method in ("energy_conserving", "generalized_alpha") else None
    times = np.linspace(0.0, T_END, TIMES)
    vf.simulate(scene, 0.01, method=method, times=[0.0, 0.01])
    best = np.inf
    for _ in range(2 if method == "central_difference" else 4):
        start = time.perf_counter()
        result = vf.simulate(scene, T_END, method=method, dt=dt, times=times, progress=False)
        best = min(best, time.perf_counter() - start)
    return best, result


def table(rows: list[Row]) -> str:
    """Return Markdown: milliseconds per simulated second, and what was counted."""
    head = ["added", *(method.replace("_", " ") for method in METHODS), "counted"]
    lines = ["| " + " | ".join(head) + " |", "| --- |" + " ---: |" * len(METHODS) + " --- |"]
    for row in rows:
        cells = [f"{row.cost[m]:.3g}" if m in row.cost else "refused" for m in METHODS]
        counted = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in row.counters.items())
        where = "" if row.counted == "event_driven" else f" ({row.counted})"
        lines.append("| " + " | ".join([row.name, *cells, counted + where]) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    with running(compiled=True):
        print(table(measure(lambda text: print(text, file=sys.stderr))))
