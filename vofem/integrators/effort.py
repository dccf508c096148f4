"""What runs cost in plain Python, so that code is compiled where it pays, and which runs need the same kernels.

Measured with beams of 1 to 1000 elements; a figure that is wrong by a factor of
two costs somebody some seconds.
"""

from __future__ import annotations

import numpy as np

from vofem.integrators.method import Method
from vofem.kernels.mode import kernels
from vofem.laws.kinds import FEWEST_IN_BAND
from vofem.laws.table import build_laws
from vofem.system import System

#: Seconds that a step takes: for itself, for a degree of freedom, for a law.
_STEP, _UNKNOWN, _LAW = 1.5e-4, 1.6e-5, 6e-5

#: Seconds that an evaluation of all event functions takes for a mode, and a modal space for the square of their number.
_MODE, _SQUARE = 1.5e-5, 4e-6

#: Steps of a run under a tolerance, with those of the rough run before it, at least.
_UNDER_TOLERANCE = 4000.0

#: Evaluations of a run between events, at least.
_FEWEST = 20.0


#: Seconds of compiled code: a segment between events or breakpoints, more for a mode, and a step, more for an unknown.
_SEGMENT, _SEGMENT_MODE, _STEP_COMPILED, _UNKNOWN_COMPILED = 3e-6, 2e-7, 4e-6, 2e-7

#: Seconds of a segment in plain Python, more for a mode.
_SEGMENT_PLAIN, _MODE_PLAIN = 4e-4, 2e-5

#: Steps that one under a tolerance costs: it is taken whole and in halves, and smoothed.
_TRIED = 5.0


def seconds_between_breakpoints(system: System, t_end: float) -> float:
    """Return the seconds that event_driven takes for the breakpoints of the loads, such as those of a record."""
    return _breakpoints(system, t_end) * (_SEGMENT + _SEGMENT_MODE * system.size)


def _breakpoints(system: System, t_end: float) -> int:
    """Return how many times there are at which the loads change their closed form."""
    found = [load.function.breakpoints(t_end) for load in system.loads if load.function.closed_form]
    return int(np.unique(np.concatenate(found)).size) if found else 0


def seconds_under_tolerance(system: System, t_end: float, tol: float) -> float:
    """Return the seconds that steps of second order take whose errors stay below a fraction of the displacements.

    A midpoint step lets the phase of a motion of frequency w lag by ``(w dt)^3 / 12``. The motion is taken for that
    which the loads cause at rest, contacts closed.
    """
    w = _frequency(system)
    count = t_end * w * np.sqrt(max(w * t_end, 1.0) / (12.0 * tol))
    return float(1000.0 + _TRIED * count) * (_STEP_COMPILED + _UNKNOWN_COMPILED * system.size)


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
    return float(np.sqrt(energy / inertia)) if 0.0 < energy < np.inf and inertia > 0.0 else 1.0


def seconds_of_steps(system: System, steps: int, compiled: bool) -> float:
    """Return the seconds that some steps take."""
    return steps * (_STEP_COMPILED + _UNKNOWN_COMPILED * system.size if compiled else _step(system))


def kind_of_run(method: Method, system: System, tol: float | None, probes: bool = False) -> str:
    """Return what kernels a run needs, as a name that is the same for all runs that need the same ones.

    Kernels of methods that step in time are compiled for the kinds of laws that a system holds, see `laws.table.Kinds`,
    and for one, several or many laws.

    Parameters
    ----------
    method : Method
    system : System
    tol : float or None
    probes : bool
        Whether points are recorded at every step.
    """
    if method.exact:
        return f"{method.name}, damped" if system.damped else method.name
    if not method.steps or method.special:
        return method.name
    with kernels(compiled=False):  # no law is called
        laws = build_laws(system.laws)
    count = laws.table.size
    parts = [method.name] if tol is None else [method.name, "tol"]
    if count:
        parts.append("one law" if count == 1 else "several laws" if count < FEWEST_IN_BAND else "many laws")
    parts += [name for name, present in laws.kinds._asdict().items() if present]
    return ", ".join([*parts, "probes"] if probes else parts)


def _step(system: System) -> float:
    """Return the seconds that a step takes."""
    return _STEP + _UNKNOWN * system.size + _LAW * sum(len(group) for group in system.laws)


def by_steps(system: System, t_end: float, dt: float | None, tol: float | None) -> float:
    """Return the seconds of a run in time steps, of which there are a thousand where no size is given."""
    if tol is not None:
        return _UNDER_TOLERANCE * _step(system)
    return _step(system) * (1000.0 if dt is None else t_end / dt)


def by_critical_steps(system: System, t_end: float, dt: float | None, tol: float | None) -> float:
    """Return the seconds of a run in steps that are small enough for stability where no size is given."""
    if dt is None:
        fastest = float(np.max(system.stiffness.diagonal() / system.mass.diagonal(), initial=0.0))
        # The largest frequency is at least that of a degree of freedom with all others held.
        dt = min(2.0 / np.sqrt(fastest) if fastest > 0.0 else t_end, t_end / 1000.0)
    return by_steps(system, t_end, dt, tol)


def by_events(system: System, t_end: float, dt: float | None, tol: float | None) -> float:
    """Return the seconds of a run between breakpoints with the fewest events; how many there are nobody knows."""
    between = _breakpoints(system, t_end) * (_SEGMENT_PLAIN + _MODE_PLAIN * system.size)
    contacts = _SQUARE * system.size**2 if system.contacts is not None else 0.0
    return _FEWEST * _MODE * system.size + contacts + between


def nothing(system: System, t_end: float, dt: float | None, tol: float | None) -> float:
    """Return the seconds of a run without kernels."""
    return 0.0
