"""The scenes that several tests use."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vofem as vf
from vofem.verification.cases.published import entry as quantity
from vofem.verification.cases.published import published

__all__ = ["LAWS", "SHORT", "broken_off", "paper_beam", "published", "quantity", "reference", "two_masses"]

DATA = Path(__file__).parent / "data"
LAWS = ("displacement", "penetration")

#: A scene file of a short run: a mass that hits a stop.
SHORT = """
[run]
t_end = 6.0
[[mass]]
name = "ball"
mass = 1.0
stiffness = 1.0
[[contact]]
name = "stop"
a = "ball"
gap = 0.5
stiffness = 10.0
side = "above"
acts_on = "penetration"
[initial]
ball = { velocity = 1.0 }
"""


def reference(name: str) -> dict[str, np.ndarray]:
    with np.load(DATA / f"{name}.npz") as file:
        return {key: file[key] for key in file.files}


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
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=elements, supports={"left": "clamped"}, name="beam")
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


def broken_off(path: Path, share: float, scene: vf.Scene, t_end: float, **arguments: Any) -> None:
    """Run a scene until a share of its time has passed, and leave its checkpoint."""

    def lose_power(t: float, t_end: float) -> None:
        if t > share * t_end:
            raise PowerLossError

    with pytest.raises(PowerLossError):
        vf.simulate(scene, t_end, checkpoint=path, checkpoint_every=0.0, progress=lose_power, **arguments)
