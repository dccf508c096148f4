"""What exact runs and runs under a tolerance cost in compiled code, by which ``method="auto"`` chooses between them.

Measured with beams of 1 to 1000 elements; a figure that is wrong by a factor of two costs somebody some seconds.
"""

from __future__ import annotations

import numpy as np

from vofem.system import System

#: Seconds of compiled code: a segment between events or breakpoints, more for a mode, and a step, more for an unknown.
_SEGMENT, _SEGMENT_MODE, _STEP, _STEP_UNKNOWN = 3e-6, 2e-7, 4e-6, 2e-7

#: Steps that one under a tolerance costs: it is taken whole and in halves, and smoothed.
_TRIED = 5.0


def seconds_between_breakpoints(system: System, t_end: float) -> float:
    """Return the seconds that event_driven takes for the breakpoints of the loads, such as those of a record."""
    found = [load.function.breakpoints(t_end) for load in system.loads if load.function.closed_form]
    count = np.unique(np.concatenate(found)).size if found else 0
    return float(count * (_SEGMENT + _SEGMENT_MODE * system.size))


def seconds_under_tolerance(system: System, t_end: float, tol: float) -> float:
    """Return the seconds that steps of second order take whose errors stay below a fraction of the displacements.

    A midpoint step lets the phase of a motion of frequency w lag by ``(w dt)^3 / 12``. The motion is taken for that
    which the loads cause at rest, contacts closed.
    """
    w = _frequency(system)
    count = t_end * w * np.sqrt(max(w * t_end, 1.0) / (12.0 * tol))
    return float(1000.0 + _TRIED * count) * (_STEP + _STEP_UNKNOWN * system.size)


def _frequency(system: System) -> float:
    """Return the frequency in rad/s of the motion in the shape that the loads cause at rest, by Rayleigh's quotient."""
    from scipy.sparse import diags
    from scipy.sparse.linalg import splu

    stiffness = system.stiffness
    if system.contacts is not None:
        rows = system.contacts.rows
        stiffness = stiffness + rows.T @ diags(system.contacts.stiffness) @ rows
    total = np.sum([np.abs(load.vector) for load in system.loads], axis=0)
    try:
        shape = splu(stiffness.tocsc()).solve(total)
    except RuntimeError:  # loose
        shape = total
    energy, inertia = float(shape @ (stiffness @ shape)), float(shape @ (system.mass @ shape))
    return float(np.sqrt(energy / inertia)) if 0.0 < energy < np.inf and inertia > 0.0 else 0.0
