"""The scenes that several tests use."""

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vofem as vf
from vofem.verification.cases.published import entry as quantity
from vofem.verification.cases.published import published

__all__ = [
    "FREE", "LAWS", "SHORT", "WRONG_SIZES", "PowerLossError", "alone", "between_stops", "broken_off", "cantilever",
    "in_a_row", "ledger_error", "lose_power", "on_stop", "paper_beam", "published", "quantity", "reference",
    "reference_case", "two_masses",
]  # fmt: skip

DATA = Path(__file__).parent / "data"
LAWS = ("displacement", "penetration")

#: Sizes that no picture and no movie can have.
WRONG_SIZES = ((10, 10), (0, 0), (-400, 300), (1e9, 1e9), (float("inf"), 300), ("a", "b"), (300,), 300, "large")

#: Scene files of a short run: a mass that swings, and one that hits a stop.
FREE = """
[run]
t_end = 6.0
[[mass]]
name = "ball"
mass = 1.0
stiffness = 1.0
[initial]
ball = { velocity = 1.0 }
"""
SHORT = (
    FREE
    + """
[[contact]]
name = "stop"
a = "ball"
gap = 0.5
stiffness = 10.0
side = "above"
acts_on = "penetration"
"""
)


def reference(name: str) -> dict[str, np.ndarray]:
    with np.load(DATA / f"{name}.npz") as file:
        return {key: file[key] for key in file.files}


def reference_case(name: str) -> tuple[dict[str, Any], dict[str, Any], dict[str, np.ndarray]]:
    """Scene, values and histories of a reference case, "folder/name"; see tests/data/README.md."""
    case = json.loads((DATA / f"{name}.json").read_text())
    return case["scene"], case["values"], reference(name)


def ledger_error(result: vf.Result) -> float:
    """Largest error of the balance of energy over the largest work."""
    e = result.energy
    total = e.kinetic + e.strain + e.contact + e.dissipated - e.work
    return float(np.max(np.abs(total - total[0])) / np.max(np.abs(e.work)))


def alone(mass: vf.Mass, *effects: Any, load: Any = None, start: Any = None) -> tuple[vf.Mass, vf.Scene]:
    """A mass and its scene: under a load, from a displacement and a velocity at the start."""
    loads = [] if load is None else [vf.PointLoad(mass, load)]
    return mass, vf.Scene([mass], [*effects, *loads], initial=None if start is None else {mass: start})


def on_stop(
    point: Any, *effects: Any, load: Any = None, start: Any = None, side: str = "above",
    acts_on: str = "penetration", name: str = "stop", **law: Any,
) -> tuple[Any, vf.Scene]:  # fmt: skip
    """A mass, or a point of a beam, before a stop, and its scene; as `alone` otherwise."""
    stop = vf.Contact(point, side=side, acts_on=acts_on, name=name, **law)
    loads = [] if load is None else [vf.PointLoad(point, load)]
    scene = vf.Scene([point.body], [stop, *effects, *loads], initial=None if start is None else {point.body: start})
    return point, scene


def between_stops(
    point: Any, *effects: Any, load: Any = None, start: Any = None, acts_on: str = "penetration", **law: Any
) -> tuple[Any, vf.Scene]:
    """A mass, or a point of a beam, between the stops "above" and "below", and its scene."""
    below = vf.Contact(point, side="below", acts_on=acts_on, name="below", **law)
    return on_stop(point, below, *effects, load=load, start=start, acts_on=acts_on, name="above", **law)


def in_a_row(bodies: Any, **law: Any) -> list[vf.Contact]:
    """Contacts between neighbours under the penetration law, unless another one is given."""
    return [vf.Contact(a, b, **({"acts_on": "penetration"} | law)) for a, b in pairwise(bodies)]


def cantilever(elements: Any = 4, **more: Any) -> vf.Beam:
    """A beam of length, bending stiffness and mass per length one, clamped on the left."""
    return vf.Beam(1.0, 1.0, 1.0, elements, {"left": "clamped"}, **more)


def paper_beam(
    acts_on: str,
    *,
    elements: Any = 25,
    gap: float = 0.03,
    stiffness: float = 1.0,
    load: Any = None,
    extra: tuple[Any, ...] = (),
    contact: bool = True,
) -> tuple[vf.Beam, vf.Scene]:
    """The paper's cantilever (section 4.2) with its stop below the tip."""
    beam = cantilever(elements, name="beam")
    tip = beam.at(1.0)
    effects: list[Any] = [vf.PointLoad(tip, vf.Sine(0.1, 1.0) if load is None else load), *extra]
    if contact:
        effects.insert(0, vf.Contact(tip, gap=gap, stiffness=stiffness, side="below", acts_on=acts_on, name="stop"))
    return beam, vf.Scene([beam], effects)


FORCES = {
    "a": (vf.Sine(-3.0, 0.3), None),
    "b": (vf.Sine(-10.0, 0.3), None),
    "c": (vf.Sine(5.0, 0.8), vf.Sine(-5.0, 0.8)),
}


def two_masses(case: str, acts_on: str, *, damping: float = 0.0) -> tuple[vf.Mass, vf.Mass, vf.Scene]:
    """The paper's two masses (section 4.1)."""
    first = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="first")
    second = vf.Mass(1.0, stiffness=1.0, damping=0.4, name="second")
    contact = vf.Contact(first, second, gap=5.0, stiffness=2.0, damping=damping, acts_on=acts_on, name="contact")
    loads = [vf.PointLoad(m, f) for m, f in zip((first, second), FORCES[case], strict=True) if f is not None]
    return first, second, vf.Scene([first, second], [contact, *loads], initial={first: (0.0, -1.0)})


class PowerLossError(Exception):
    """Ends a run in its middle, as a lost machine would."""


def lose_power(share: float) -> Callable[[float, float], None]:
    """Progress that ends a run once a share of its time has passed."""

    def told(t: float, t_end: float) -> None:
        if t > share * t_end:
            raise PowerLossError

    return told


def broken_off(path: Path, share: float, scene: vf.Scene, t_end: float, **arguments: Any) -> None:
    """Run a scene until a share of its time has passed, and leave its checkpoint."""
    with pytest.raises(PowerLossError):
        vf.simulate(scene, t_end, checkpoint=path, checkpoint_every=0.0, progress=lose_power(share), **arguments)
