"""Derivatives of static equilibria and of natural frequencies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vofem._validate import Named
from vofem.arrays import Array
from vofem.errors import ArgumentError
from vofem.lookup import rows_over
from vofem.scene import Scene
from vofem.sensitivities.forcing import derivative_waves
from vofem.sensitivities.parameter import Parameter, names_of, parameters_of
from vofem.sensitivities.system_change import SystemChange, system_changes
from vofem.statics import Equilibrium
from vofem.vibration import Modes, contact_indices

#: Relative distance of squared frequencies that count as one.
_SAME = 1e-8


class OfParameters:
    """Names and units of parameters."""

    def __init__(self, scene: Scene, parameters: tuple[Parameter, ...]) -> None:
        self._scene = scene
        self.parameters = parameters

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self.names)})"

    @property
    def names(self) -> list[str]:
        """Names of the parameters, numbered where several have one."""
        return names_of(self.parameters)

    @property
    def units(self) -> list[str]:
        """Units of the parameters."""
        return [parameter.unit(self._scene) for parameter in self.parameters]


@dataclass(frozen=True)
class StaticContactSensitivities:
    """Derivatives of a contact in equilibrium, each of shape (p,).

    Attributes
    ----------
    force : ndarray
        Of the contact force, N.
    gap_function : ndarray
        Of the gap function, m.
    """

    force: Array
    gap_function: Array


class EquilibriumSensitivities(OfParameters):
    """Derivatives of a static equilibrium; the access is that of `Equilibrium`.

    Attributes
    ----------
    parameters : tuple of Parameter
    contacts : dict of str to StaticContactSensitivities
    """

    def __init__(self, outcome: Equilibrium, parameters: Any, like: EquilibriumSensitivities | None = None) -> None:
        """Compute the derivatives; `like` are those of another equilibrium of the same scene by the same parameters."""
        from scipy.sparse import bmat, csc_matrix
        from scipy.sparse.linalg import splu

        if like is None:
            scene = Scene(tuple(outcome.model.offsets), outcome.effects).compiled_as(outcome.model)
        else:
            scene = like._scene
        q, t = outcome.free_displacement, outcome.t
        super().__init__(scene, parameters_of("sensitivities", parameters, scene))
        system = scene.model.system
        others = [group for group in system.laws if group.static and group is not system.contacts]
        if others:
            raise ArgumentError(
                f"sensitivities: {others[0].labels[0]} is not linear; of equilibria only those with contacts and "
                "linear springs have derivatives"
            )
        self._q = q
        self._changes: list[SystemChange] = system_changes(scene, self.parameters) if like is None else like._changes
        laws = system.contacts
        names = () if laws is None else laws.names
        closed = [j for j, name in enumerate(names) if outcome.contacts[name].closed]
        pinned = [j for j, name in enumerate(names) if outcome.contacts[name].pinned]
        matrix = system.stiffness
        right = np.zeros((system.size + len(pinned), len(self.parameters)))
        if laws is not None:
            from scipy.sparse import diags

            rows = laws.rows
            matrix = matrix + rows[closed].T @ diags(laws.stiffness[closed]) @ rows[closed]
        free = right[: system.size]
        for k, change in enumerate(self._changes):
            for load, vector in zip(system.loads, change.vectors, strict=True):
                free[:, k] += vector * float(load.function(t))
            for number, path in change.functions.items():
                load = system.loads[number]
                free[:, k] += load.vector * float(derivative_waves(load.function, path, t).level.real.sum())
            if change.stiffness is not None:
                free[:, k] -= change.stiffness @ q
            if laws is None:
                continue
            u = rows @ q
            moved = csc_matrix(rows.shape) if change.rows is None else change.rows
            force = np.array([outcome.contacts[name].force for name in names])
            u_p = moved @ q
            fixed = change.contact_stiffness * (u - laws.offset) + laws.stiffness * (
                u_p - np.where(laws.jump, 0.0, change.gap)
            )
            fixed = np.where(np.isin(np.arange(len(laws)), closed), fixed, 0.0)
            free[:, k] -= rows.T @ fixed + moved.T @ force
            right[system.size :, k] = (change.gap - u_p)[pinned]
        if pinned:
            held = rows[pinned]
            matrix = bmat([[matrix, held.T], [held, None]])
        found = splu(csc_matrix(matrix)).solve(right)
        self._derivatives = found[: system.size]
        contacts = {}
        for j, name in enumerate(names):
            u_p = np.asarray(rows[[j]] @ self._derivatives)[0]
            force = np.zeros(len(self.parameters))
            gap = u_p.copy()
            for k, change in enumerate(self._changes):
                if change.rows is not None:
                    gap[k] += float((change.rows[[j]] @ q)[0])
                gap[k] -= change.gap[j]
                if j in closed and laws is not None:
                    fixed_k = change.contact_stiffness[j] * (float((rows[[j]] @ q)[0]) - laws.offset[j])
                    force[k] = fixed_k + laws.stiffness[j] * (gap[k] + (change.gap[j] if laws.jump[j] else 0.0))
            if j in pinned:
                force = found[system.size + pinned.index(j)]
            contacts[name] = StaticContactSensitivities(force, gap)
        self.contacts = Named(contacts)

    def displacement(self, point: Any) -> Array:
        """Return the derivatives of the displacement of a point, m over the unit of the parameter, shape (p,)."""
        row = rows_over(self._scene.model, self._scene.bodies, [point])
        found = np.asarray(row @ self._derivatives)[0]
        for k, change in enumerate(self._changes):
            moved = change.points([point])
            if moved is not None:
                found[k] += float((moved @ self._q)[0])
        return np.asarray(found)


class ModesSensitivities(OfParameters):
    """Derivatives of natural frequencies.

    Where several modes have one frequency, the derivatives are those of the frequencies into which it splits, in
    ascending order. Frequencies of rigid motions have none, because they are roots: NaN where a parameter gives them a
    stiffness, else 0.

    Attributes
    ----------
    parameters : tuple of Parameter
    omega : ndarray, shape (count, p)
        Of the angular frequencies in rad/s.
    """

    def __init__(self, outcome: Modes, parameters: Any) -> None:
        scene = outcome.scene
        super().__init__(scene, parameters_of("sensitivities", parameters, scene))
        system = scene.model.system
        closed = contact_indices("sensitivities", system, outcome.closed)
        squares, shapes = outcome.omega**2, outcome.free_shapes
        self.omega = np.zeros((squares.size, len(self.parameters)))
        edges = np.flatnonzero(np.diff(squares) > _SAME * squares[1:]) + 1
        for k, change in enumerate(system_changes(scene, self.parameters)):
            for group in np.split(np.arange(squares.size), edges):
                basis, square = shapes[:, group], float(squares[group[0]])
                small = np.zeros((group.size, group.size))
                if change.stiffness is not None:
                    small += basis.T @ (change.stiffness @ basis)
                if change.mass is not None:
                    small -= square * (basis.T @ (change.mass @ basis))
                if closed:
                    laws = system.contacts
                    assert laws is not None
                    u = np.asarray(laws.rows[closed] @ basis)
                    small += u.T @ (change.contact_stiffness[closed, None] * u)
                    if change.rows is not None:
                        moved = np.asarray(change.rows[closed] @ basis)
                        both = u.T @ (laws.stiffness[closed, None] * moved)
                        small += both + both.T
                values = np.linalg.eigvalsh(0.5 * (small + small.T))
                if square > 0.0:
                    self.omega[group, k] = values / (2.0 * np.sqrt(square))
                elif change.stiffness is not None:
                    scale = float(np.max(np.abs(change.stiffness.data)) * np.max(np.abs(basis)) ** 2)
                    self.omega[group, k] = np.where(np.abs(values) <= 1e-9 * scale, 0.0, np.nan)

    @property
    def frequencies(self) -> Array:
        """Of the frequencies in Hz, shape (count, p)."""
        return self.omega / (2.0 * np.pi)
