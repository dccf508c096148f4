"""The same equations with other rounding errors: all are multiplied by 3, which is not a power of two.

Displacements, velocities and event times are the same numbers in exact
arithmetic. The difference of two such runs is therefore an estimate of rounding,
for any method.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from vofem.scene import Scene

_FACTOR = 3.0

#: Attributes that are multiplied, and those that are not. A system with any further attribute cannot be scaled.
_KNOWN = (
    "mass", "stiffness", "damping", "rayleigh", "modal_damping", "loads", "laws", "scale", "strain", "rigid",
    "rotation",
)  # fmt: skip


def scaled(scene: Scene) -> Scene | None:
    """Return the scene with all of its equations multiplied by one number; None where something cannot be scaled.

    Only its system differs: energies, forces and reactions of its results have no meaning.
    """
    system = scene.model.system
    if any(_is_there(getattr(system, field.name)) for field in fields(system) if field.name not in _KNOWN):
        return None
    laws: list[Any] = [group.scaled(_FACTOR) for group in system.laws]
    if any(group is None for group in laws):
        return None
    found = replace(
        system,
        mass=_FACTOR * system.mass,
        stiffness=_FACTOR * system.stiffness,
        damping=None if system.damping is None else _FACTOR * system.damping,
        strain=None if system.strain is None else np.sqrt(_FACTOR) * system.strain,
        loads=tuple(replace(load, vector=_FACTOR * load.vector) for load in system.loads),
        laws=tuple(laws),
    )
    return scene.compiled_as(replace(scene.model, system=found))


def _is_there(value: Any) -> bool:
    return value is not None and not (hasattr(value, "__len__") and len(value) == 0)
