"""Derivatives of an outcome by parameters, with the access of the outcome and the parameter as last axis."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import Named, array, listed
from vofem.arrays import Array
from vofem.blas import one_thread
from vofem.errors import ArgumentError, MethodError
from vofem.integrators.registry import advice
from vofem.lookup import rows_over
from vofem.result import Result
from vofem.scene import Scene
from vofem.sensitivities.contacts import ContactSensitivities
from vofem.sensitivities.energy import dissipated
from vofem.sensitivities.forward import Forward, Work
from vofem.sensitivities.modal import ModalChange, check_modal_damping, modal_change, modal_system
from vofem.sensitivities.notes import notes_of
from vofem.sensitivities.of_statics import OfParameters
from vofem.sensitivities.parameter import Parameter, parameters_of
from vofem.sensitivities.system_change import SystemChange, system_changes
from vofem.system import refuse_travelling


@dataclass(frozen=True)
class EnergySensitivities:
    """Derivatives of energies at the times of a run.

    Attributes
    ----------
    dissipated : ndarray, shape (n_times, p)
        Of the energy dissipated since t = 0, J over the unit of the parameter.
    """

    dissipated: Array


class MotionSensitivities(OfParameters):
    """Derivatives of the motion of a run, or of a run that is an orbit; the last axis is the parameter.

    Attributes
    ----------
    parameters : tuple of Parameter
    work : Work
    """

    def __init__(
        self, scene: Scene, run: Result, parameters: tuple[Parameter, ...], changes: list[SystemChange]
    ) -> None:
        super().__init__(scene, parameters)
        self._run, self._changes, self._modal = run, changes, modal_system(run.solution)
        self.work = Work(assemblies=sum(change.assemblies for change in changes))
        self._forward = Forward(run.solution, self._modal, self._columns(), self.work)

    def _columns(self) -> list[ModalChange]:
        """Return what the motion is differentiated by."""
        full = self._run.model.system
        return [modal_change(self._modal, full, change) for change in self._changes]

    def _total(self, found: Array) -> Array:
        """Return derivatives by the parameters from those by all columns, which are the last axis."""
        return found

    def displacement(self, point: Any, t: ArrayLike | None = None) -> Array:
        """Return the derivatives of the displacement of a point, shape (n_times, p) or (len(t), p).

        With a parameter "length" the point moves along with its beam.
        """
        return self._along(point, t, 0)

    def velocity(self, point: Any, t: ArrayLike | None = None) -> Array:
        """Return the derivatives of the velocity of a point, shape (n_times, p) or (len(t), p)."""
        return self._along(point, t, 1)

    def acceleration(self, point: Any, t: ArrayLike | None = None) -> Array:
        """Return the derivatives of the acceleration of a point, shape (n_times, p) or (len(t), p)."""
        return self._along(point, t, 2)

    @one_thread
    def _along(self, point: Any, t: ArrayLike | None, kind: int) -> Array:
        times = self._times(t)
        scene, model, modal = self._run.scene, self._run.model, self._modal
        row = np.asarray(rows_over(model, scene.bodies, [point]) @ modal.shapes)
        blank = np.zeros_like(row)
        if kind == 2:
            out = self._total(np.einsum("n,ntp->tp", row[0], self._forward.accelerations(times)))
        else:
            rows = np.hstack([row, blank] if kind == 0 else [blank, row])
            out = self._total(self._forward.sample(rows, times)[0])
        moved = [change.points([point]) for change in self._changes]
        if any(one is not None for one in moved):
            motion = self._forward.motion(times)[kind]
            for k, one in enumerate(moved):
                if one is not None:
                    out[:, k] += (np.asarray(one @ modal.shapes) @ motion)[0]
        return np.asarray(out)

    def _times(self, t: ArrayLike | None) -> Array:
        if t is None:
            return np.asarray(self._run.times)
        times = np.atleast_1d(array("t", t))
        end = self._run.solution.t_end
        if np.any(times < 0.0) or np.any(times > end * (1.0 + 1e-12)):
            raise ArgumentError(f"t holds times outside of the run, expected 0 to {end:g} s")
        return np.minimum(times, end)

    def to_dataframe(self, points: Any = None) -> Any:
        """Return the derivatives of the displacements of points as a `pandas.DataFrame`, one row a time.

        Parameters
        ----------
        points : point or list of points, optional
            The default is the points of the contacts.
        """
        import pandas as pd

        chosen = [c.a for c in self._run.scene.contacts] if points is None else listed(points)
        columns: dict[str, Array] = {"time (s)": self._times(None)}
        for point in chosen:
            values = self.displacement(point)
            for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
                columns[f"d displacement {point.describe()} / d {name} (m/({unit or '1'}))"] = values[:, k]
        return pd.DataFrame(columns)


class RunSensitivities(MotionSensitivities):
    """Derivatives of a run of ``event_driven`` by parameters.

    The access is that of `Result`; the last axis is the parameter. Everything is exact to rounding, and computed when
    it is first read.

    Attributes
    ----------
    result : Result
    parameters : tuple of Parameter
    times : ndarray, shape (n_times,)
        Times in s at which the run is stored.
    """

    def __init__(self, result: Result, parameters: tuple[Parameter, ...]) -> None:
        super().__init__(result.scene, result, parameters, _changes(result, parameters))
        self.result, self.times = result, result.times

    def __repr__(self) -> str:
        count = len(self.notes)
        notes = f", {count} note{'s' * (count > 1)}: see .notes" if count else ""
        return f"RunSensitivities({', '.join(self.names)}{notes})"

    @cached_property
    def notes(self) -> list[str]:
        """What a user should know about the derivatives."""
        return notes_of(self.result, self._forward, self.times, self.horizon)

    @cached_property
    def horizon(self) -> float:
        """Time in s until which rounding stays below a thousandth in the run, and in its derivatives."""
        return self.result.sensitivity.horizon()

    # -- contacts, energies -----------------------------------------------------------------------

    @cached_property
    def contacts(self) -> Named[ContactSensitivities]:
        """Derivatives of what the contacts do, by name."""
        found = {
            name: ContactSensitivities(self._forward, history, j, self.times)
            for j, (name, history) in enumerate(self.result.contacts.items())
        }
        return Named(found)

    @cached_property
    @one_thread
    def energy(self) -> EnergySensitivities:
        """Derivatives of energies at `times`."""
        return EnergySensitivities(dissipated(self._forward, self.times))


def without_state(changes: list[SystemChange], parameters: tuple[Parameter, ...], why: str) -> list[SystemChange]:
    """Return changes for a motion whose start depends on no parameter; `why` is the error for a start as parameter."""
    for parameter in parameters:
        if parameter.field.startswith("initial."):
            raise ArgumentError(f"Parameter {parameter.name}: {why}")
    return [replace(one, displacement=0.0 * one.displacement, velocity=0.0 * one.velocity) for one in changes]


def bare_run(what: str, result: Any, parameters: Any) -> Forward:
    """Return a run and the derivatives of its equations of motion, without those of the motion."""
    _check(what, result)
    chosen = parameters_of(what, parameters, result.scene)
    full, modal = result.model.system, modal_system(result.solution)
    changes = _changes(result, chosen)
    work = Work(assemblies=sum(change.assemblies for change in changes))
    return Forward(result.solution, modal, [modal_change(modal, full, change) for change in changes], work, bare=True)


def _changes(result: Result, parameters: tuple[Parameter, ...]) -> list[SystemChange]:
    """Return the derivatives of the system of a run."""
    found = system_changes(result.scene, parameters)
    if result.start is not None:
        found = without_state(found, parameters, "the run began in the state that initial= of simulate gave")
    check_modal_damping(result.model.system, [parameter.name for parameter in parameters], found)
    return found


def _check(what: str, result: Any) -> None:
    """Raise where a run has no exact derivatives."""
    if not isinstance(result, Result):
        raise ArgumentError(f"{what}: {result!r} is no Result of vofem.simulate")
    if result.method != "event_driven":
        raise MethodError(
            f"{what}: the run used {result.method}, whose steps have no exact derivatives; simulate with "
            f"{advice(exact=True)}"
        )
    refuse_travelling(what, result.model.system)
    contacts = result.model.system.contacts
    if contacts is not None and contacts.moving is not None:
        raise MethodError(f"{what}: {contacts.moving_refusal('an exact derivative')}")
    sliders = result.model.system.sliders
    if sliders is not None:
        raise MethodError(sliders.refusal(what))
    if result.interrupted:
        raise ArgumentError(f"{what}: the run was interrupted; run it to its end")


def run_sensitivities(result: Result, parameters: Any) -> RunSensitivities:
    """Return the derivatives of a run; see `sensitivities`."""
    _check("sensitivities", result)
    return RunSensitivities(result, parameters_of("sensitivities", parameters, result.scene))
