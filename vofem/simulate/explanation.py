"""What will be simulated, by which method and why, and what the scene does not have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vofem._validate import number
from vofem.cards import Shown
from vofem.laws import KINDS
from vofem.scene import Scene, as_scene
from vofem.simulate.methods import choose
from vofem.system import System


@dataclass(frozen=True, repr=False)
class Explanation(Shown):
    """What will be simulated, by which method and why, and what the scene does not have. Print it to read it.

    Attributes
    ----------
    bodies, effects, start : tuple of str
        A line for each body, for each effect, and for each body that does not start at rest in its place.
    unknowns : int
        Number of free degrees of freedom.
    method, why : str
        The method that ``method="auto"`` takes, and the reason.
    absent : tuple of str
        Kinds of effects that the scene does not contain. Nothing is built or evaluated for them.
    """

    bodies: tuple[str, ...]
    effects: tuple[str, ...]
    start: tuple[str, ...]
    unknowns: int
    method: str
    why: str
    absent: tuple[str, ...]

    def __str__(self) -> str:
        lines = ["Bodies", *(f"  {line}" for line in self.bodies)]
        lines += ["Effects", *(f"  {line}" for line in self.effects or ("none",))]
        lines += ["Start", *(f"  {line}" for line in self.start or ("at rest",))]
        lines += [f"Unknowns: {self.unknowns}", f"Method: {self.method}, because {self.why}"]
        lines.append(f"Not in the scene: {', '.join(self.absent) or 'nothing'}")
        return "\n".join(lines)

    # Notebooks and prompts show an object by its repr.
    __repr__ = __str__


def _absent(system: System) -> tuple[str, ...]:
    """Return the kinds of effects that a system does not have."""
    found = {kind: any(group.kind == kind for group in system.laws) for kind in KINDS}
    dampers = system.contacts is not None and bool(np.any(system.contacts.damping > 0))
    first = {KINDS[0]: found.pop(KINDS[0]), "contact dampers": dampers, "damping": system.damped}
    return tuple(kind for kind, there in (first | found | {"loads": bool(system.loads)}).items() if not there)


def _start_of(scene: Scene) -> tuple[str, ...]:
    """Return what a scene says of its start, a line for each body."""
    given = scene.initial
    if not isinstance(given, Mapping):
        return () if given is None else (f"all bodies: {given.source}",)

    def shown(value: Any, unit: str) -> str:
        return f"{value!r}, a function of x" if callable(value) else f"{value:g} {unit}"

    return tuple(
        f"{body.label}: {state.source}"
        if hasattr(state, "state_of")
        else f"{body.label}: displacement {shown(state[0], 'm')}, velocity {shown(state[1], 'm/s')}"
        for body, state in given.items()
    )


def explain(scene: Scene, t_end: float | None = None, tol: float | None = None) -> Explanation:
    """Return what will be simulated, by which method and why, and what the scene does not have.

    Parameters
    ----------
    scene : Scene
        The scene; it is assembled but not run.
    t_end, tol : float, optional
        As in `vofem.simulate`. With a tolerance ``method="auto"`` compares the cost of methods.
    """
    system = as_scene("explain", scene).model.system
    if t_end is not None:
        t_end = number("explain: t_end", t_end, positive=True)
    if tol is not None:
        tol = number("explain: tol", tol, positive=True)
    choice = choose(system, t_end, tol)
    return Explanation(
        bodies=tuple(body.summary() for body in scene.bodies),
        effects=tuple(effect.describe() for effect in scene.effects),
        start=_start_of(scene),
        unknowns=system.size,
        method=choice.method,
        why=choice.why,
        absent=_absent(system),
    )
