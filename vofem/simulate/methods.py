"""Which method "auto" takes, why, and what it costs; and the options that methods take.

Costs were measured with beams of 1 to 1000 elements; a figure that is wrong by a factor of two costs somebody some
seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vofem._validate import nearest
from vofem.errors import MethodError
from vofem.integrators.methods import ENERGY_CONSERVING, GENERALIZED_ALPHA
from vofem.integrators.registry import method_named, method_names, methods, ranked
from vofem.system import System


def hint(method: object, names: tuple[str, ...]) -> str:
    """Return a suggestion for a misspelt name of a method, for a message, or an empty string."""
    if str(method).lower().startswith(("newmark", "hht", "hilber", "trapezoidal")):
        return f"; Newmark's method, the trapezoidal rule and HHT are settings of {GENERALIZED_ALPHA.name!r}"
    return nearest(method, names)


def option_names(method: str = "auto") -> tuple[str, ...]:
    """Return the names of the options of a method; for "auto" those of all methods."""
    if method in method_names():
        return tuple(method_named(method).options)
    return tuple(sorted({name for known in methods() for name in known.options}))


@dataclass(frozen=True)
class Choice:
    """A method and why it was chosen."""

    method: str
    why: str


#: Seconds below which an exact run is taken in any case: another method would save too little.
_SOON = 0.5


def choose(system: System, t_end: float | None = None, tol: float | None = None) -> Choice:
    """Return the method that ``method="auto"`` takes: the first in rank that does not refuse the system.

    With a tolerance, steps that follow it are preferred to the exact method if the loads have so many breakpoints that
    the exact method would take longer.

    Raises `MethodError` if all of them refuse it.
    """
    refused: list[tuple[str, str]] = []
    for method in ranked():
        reason = method.refusal(system)
        if reason is None:
            if method.exact and t_end is not None and tol is not None:
                why = _steps_are_faster(system, t_end, tol)
                if why:
                    return Choice(ENERGY_CONSERVING.name, why)
            if method.reason is not None:
                return Choice(method.name, method.reason(system))
            why = f"{refused[0][0]} does not apply: {refused[0][1].split('. ')[0]}" if refused else "it applies"
            return Choice(method.name, why)
        refused.append((method.name, reason))
    raise MethodError(f"no method can treat this scene: {'; '.join(f'{name}: {why}' for name, why in refused)}")


def _steps_are_faster(system: System, t_end: float, tol: float) -> str:
    """Return why steps under a tolerance are to be preferred to an exact run, or an empty string."""
    if ENERGY_CONSERVING.refusal(system) is not None:
        return ""
    exact = seconds_between_breakpoints(system, t_end)
    if exact <= _SOON:
        return ""
    steps = seconds_under_tolerance(system, t_end, tol)
    if steps >= exact:
        return ""
    return (
        f"steps that follow tol = {tol:g} take some {steps:.1g} s, where the exact method would take some "
        f"{exact:.1g} s for the breakpoints of the loads"
    )


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


#: Relative error for which a note compares an exact run, that nobody gave a tolerance for, with steps.
_ROUGH = 1e-3


def cheaper(system: System, t_end: float) -> list[str]:
    """Return a note if an exact run takes much longer than steps of an ordinary accuracy would."""
    why = _steps_are_faster(system, t_end, _ROUGH)
    if not why:
        return []
    return [f"cost: with tol={_ROUGH:g}, method='auto' would take {ENERGY_CONSERVING.name}: {why}"]


#: So many steps, times the degrees of freedom, take a noticeable time, and a long one.
_MUCH, _VERY_MUCH = 10_000, 50_000


def exact_instead(system: System, t_end: float, tol: float) -> str:
    """Return the method without steps that ``method="auto"`` takes in place of steps under a tolerance, or ""."""
    better = choose(system, t_end, tol).method
    return better if method_named(better).exact else ""


def note_cost(system: System, t_end: float, tol: float, steps: int) -> list[str]:
    """Return a note if a run took many steps under a tolerance, with the method that takes none where there is one."""
    work = steps * system.size
    better = exact_instead(system, t_end, tol) if work >= _MUCH else ""
    if better:
        return [
            f"cost: tol = {tol:g} took {steps} steps, and stiff stops or quick modes ask for more of them; {better} "
            "takes no steps and meets any tolerance for this scene, and method='auto' chooses it"
        ]
    if work < _VERY_MUCH:
        return []
    return [
        f"cost: tol = {tol:g} took {steps} steps, of {t_end / steps:.2g} s on the average. Vibration on stiff springs "
        "and stops asks for such steps in each of its periods as long as it lasts; damping that ends it, or a larger "
        "tol, takes fewer"
    ]
