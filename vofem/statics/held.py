"""A check whether supports and contacts hold a structure."""

from __future__ import annotations

import numpy as np

from vofem.arrays import Array
from vofem.assembly import Model
from vofem.errors import SingularSystemError
from vofem.linalg.null_space import null_space


def check_held(model: Model, rows: Array | None) -> None:
    """Raise `SingularSystemError` if neither supports nor the given contact rows resist some rigid motion."""
    rigid = model.system.rigid
    if not rigid.shape[1]:
        return
    contacts = np.zeros((0, rigid.shape[0])) if rows is None else rows
    free = null_space(contacts @ rigid, np.abs(contacts) @ np.abs(rigid))
    if not free.shape[1]:
        return
    loose = rigid @ free[:, 0]
    full = np.abs(model.expand(loose[:, None])[:, 0])
    weights = {body: full[start : start + body.size].max() for body, start in model.offsets.items()}
    body = max(weights, key=lambda b: float(weights[b]))
    by = "its supports" if model.system.contacts is None else "its supports and the contacts that carry load"
    raise SingularSystemError(
        f"{body.label} can move freely: {by} do not hold it, so it has no equilibrium. "
        "Add a support or a spring; its motion in time can be simulated"
    )
