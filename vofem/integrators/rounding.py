"""What rounding does to a system's static responses when they are computed with K itself."""

from __future__ import annotations

from typing import Any

import numpy as np

from vofem.errors import SingularSystemError
from vofem.system import System

#: Fewer unknowns than this on a mesh that is not graded lose nothing worth telling.
_FEW = 300

#: Ratio of the largest to the smallest stiffness of a degree of freedom that makes a mesh graded.
_GRADED = 1e4


def graded(system: System) -> bool:
    """Return whether the stiffnesses of a beam's degrees of freedom are so different that K loses digits."""
    return system.cache.get("graded mesh", None, lambda: _graded(system))


def _graded(system: System) -> bool:
    if system.strain is None or not np.any(system.rotation):
        return False
    stiffness = system.stiffness.diagonal() / system.scale**2
    stiffness = stiffness[stiffness > 0.0]
    return bool(stiffness.size) and float(stiffness.max()) > _GRADED * float(stiffness.min())


def static_loss(system: System) -> float:
    """Return the relative error of static responses that rounding in products with K causes, 0 for what is harmless.

    Responses to the mass under gravity and to some loads and contacts are
    solved for through the strains, which is accurate; what K leaves over of
    the load then is rounding, and its response is the error.
    """
    if system.strain is None or not np.any(system.rotation):
        return 0.0
    if system.size <= _FEW and not graded(system):
        return 0.0
    return system.cache.get("static loss", None, lambda: _static_loss(system))


def _static_loss(system: System) -> float:
    from vofem.integrators.reduction import holding, input_rows, two_solutions

    try:
        solve, _ = two_solutions(system, holding(system))
    except SingularSystemError:
        return 0.0
    mass = system.mass
    rigid: Any = system.rigid
    if rigid.shape[1]:
        root = np.linalg.cholesky(rigid.T @ (mass @ rigid))
        rigid = np.linalg.solve(root, rigid.T).T
    worst = 0.0
    for load in [mass @ np.where(system.rotation, 0.0, 1.0), *input_rows(system)[:3]]:
        balanced = load - mass @ (rigid @ (rigid.T @ load))
        if np.linalg.norm(balanced) <= 1e-9 * np.linalg.norm(load):
            continue
        response = solve(balanced)
        change = solve(balanced - system.stiffness @ response)
        pair = np.stack([response, change], axis=1)
        pair -= rigid @ (rigid.T @ (mass @ pair))
        size, error = (float(max(x @ (mass @ x), 0.0)) for x in pair.T)
        if size > 0.0:
            worst = max(worst, float(np.sqrt(error / size)))
    return worst
