"""Derivatives of outcomes by parameters."""

from __future__ import annotations

from typing import Any

from vofem.errors import ArgumentError
from vofem.result import Result
from vofem.sensitivities.of_runs import RunSensitivities, run_sensitivities
from vofem.sensitivities.of_statics import EquilibriumSensitivities, ModesSensitivities
from vofem.statics import Equilibrium
from vofem.vibration import Modes


def sensitivities(outcome: Any, parameters: Any) -> RunSensitivities | EquilibriumSensitivities | ModesSensitivities:
    """Return the exact derivatives of an outcome by parameters of its scene.

    Between contact events a run is known in closed form, and so are its derivatives; at an event they jump, because the
    changed run meets the contact at another time. No step size and no tolerance is involved: derivatives are exact to
    rounding, as the run is.

    Parameters
    ----------
    outcome : Result, Equilibrium or Modes
        What `vofem.simulate` with ``method="event_driven"``, `vofem.equilibrium` or `vofem.modes` returned.
    parameters : list of Parameter
        By what to differentiate.

    Returns
    -------
    RunSensitivities, EquilibriumSensitivities or ModesSensitivities
        The access is that of the outcome. The last axis is the parameter.

    Raises
    ------
    ArgumentError
        If the scene does not have a parameter, or its field is a Python function.
    MethodError
        If the run used a stepping method.

    Notes
    -----
    The state of an earlier outcome that a scene starts from (``initial=outcome``) counts as fixed numbers.
    Runs in Ritz vectors are differentiated in these vectors, which is as good as the run only if the vectors suit the
    changed scene too; ``truncation=0`` keeps all modes.

    References
    ----------
    R. I. Leine, H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, Springer 2004,
    doi:10.1007/978-3-540-44398-8 (saltation matrices).
    """
    if isinstance(outcome, Result):
        return run_sensitivities(outcome, parameters)
    if isinstance(outcome, Equilibrium):
        return EquilibriumSensitivities(outcome, parameters)
    if isinstance(outcome, Modes):
        return ModesSensitivities(outcome, parameters)
    raise ArgumentError(
        f"sensitivities: {outcome!r} is no outcome with derivatives; expected a Result, an Equilibrium or Modes"
    )
