"""Derivatives of outcomes by parameters."""

from __future__ import annotations

from typing import Any

from vofem.blas import one_thread
from vofem.errors import ArgumentError
from vofem.result import Result
from vofem.sensitivities.adjoint import Backward
from vofem.sensitivities.objectives import Objective
from vofem.sensitivities.of_orbits import OrbitSensitivities, SpecialSensitivities
from vofem.sensitivities.of_runs import bare_run, run_sensitivities
from vofem.sensitivities.of_statics import EquilibriumSensitivities, ModesSensitivities
from vofem.sensitivities.parameter import Parameter
from vofem.statics import Equilibrium
from vofem.studies.steady import PeriodicOrbit, SpecialPoint
from vofem.vibration import Modes


@one_thread
def sensitivities(outcome: Any, parameters: Any, *, along: Parameter | None = None) -> Any:
    """Return the exact derivatives of an outcome by parameters of its scene.

    Between contact events a run is known in closed form, and so are its derivatives; at an event they jump, because the
    changed run meets the contact at another time. No step size and no tolerance is involved: derivatives are exact to
    rounding, as the run is.

    Parameters
    ----------
    outcome : Result, PeriodicOrbit, SpecialPoint, Equilibrium or Modes
        What `vofem.simulate` with ``method="event_driven"``, `vofem.periodic` by shooting, `vofem.equilibrium` or
        `vofem.modes` returned; or a special point of a branch.
    parameters : list of Parameter
        By what to differentiate.
    along : Parameter, optional
        For a special point: the parameter of the branch. It is needed only if this is not the frequency of the loads.

    Returns
    -------
    RunSensitivities, OrbitSensitivities, SpecialSensitivities, EquilibriumSensitivities or ModesSensitivities
        The access is that of the outcome. The last axis is the parameter.

    Raises
    ------
    ArgumentError
        If the scene does not have a parameter, or its field is a Python function.
    MethodError
        If the run used a stepping method, or the orbit was found by harmonic balance or in a few vectors.

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
    if isinstance(outcome, PeriodicOrbit):
        return OrbitSensitivities(outcome, parameters)
    if isinstance(outcome, SpecialPoint):
        return SpecialSensitivities(outcome, parameters, along)
    raise ArgumentError(
        f"sensitivities: {outcome!r} is no outcome with derivatives; expected a Result, a PeriodicOrbit, "
        "a SpecialPoint, an Equilibrium or Modes"
    )


@one_thread
def gradient(result: Result, objective: Objective, parameters: Any) -> Any:
    """Return the gradient of one number of a run by any number of parameters.

    One pass backward through the run gives the derivatives by all parameters (the adjoint method). For few parameters
    and many numbers `sensitivities` is better.

    Parameters
    ----------
    result : Result
        A run of ``event_driven``.
    objective : Objective
        One of `vofem.objectives`: ``peak_force(contact, impact)``, ``impulse(contact, impact)``, ``dissipated()``,
        ``sum_of_squares(point, times, data)``, or a function of one's own, ``of_motion(points, times, function)``.
    parameters : list of Parameter

    Returns
    -------
    ndarray, shape (p,)
        In the unit of the objective over that of the parameter.

    Raises
    ------
    ArgumentError
        If the scene does not have a parameter, or the objective asks for an impact or a time that is not there.
    MethodError
        If the run used a stepping method.
    """
    if not isinstance(objective, Objective):
        raise ArgumentError(f"gradient: objective is {objective!r}, expected one of vofem.objectives")
    forward = bare_run("gradient", result, parameters)
    return Backward(forward, objective.linear(result, forward)).gradient()
