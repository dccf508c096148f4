"""The linear response to harmonic loads over frequency: `frequency_response`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import array, choice
from vofem.arrays import Array, Complex
from vofem.blas import one_thread
from vofem.errors import ArgumentError, MethodError, SingularSystemError
from vofem.lookup import rows_over
from vofem.scene import Scene, as_scene
from vofem.studies.steady.harmonic.linear_rest import Attached, LinearRest, linear_laws
from vofem.system import Counters, System, refuse_travelling
from vofem.time_functions import Constant, Scaled, Sine, Sum, as_time_function
from vofem.vibration import contact_indices


class FrequencyResponse:
    """The linear response of a scene to its harmonic loads, as they are or per unit of the first one.

    Attributes
    ----------
    scene : Scene
    frequencies : ndarray, shape (n_frequencies,)
        Frequencies in Hz.
    counters : Counters
    notes : list of str
    """

    def __init__(self, scene: Scene, frequencies: Array, rest: LinearRest, forces: Array, counters: Counters) -> None:
        self.scene, self.frequencies, self.counters = scene, frequencies, counters
        self._rest, self._forces = rest, forces
        self.notes: list[str] = []
        if rest.error > 0.0:
            self.notes.append(
                f"the structure is expressed in {rest.squares.size} Ritz vectors; half as many change displacements by "
                f"{rest.error:.1e} of themselves"
            )

    def __repr__(self) -> str:
        low, high = self.frequencies.min(), self.frequencies.max()
        return f"FrequencyResponse({self.frequencies.size} frequencies, {low:.6g} to {high:.6g} Hz)"

    @property
    def omega(self) -> Array:
        """Angular frequencies in rad/s, shape (n_frequencies,)."""
        return 2.0 * np.pi * self.frequencies

    @cached_property
    def _modal(self) -> Complex:
        try:
            return self._rest.response(self.omega, self._forces)[:, :, 0].T
        except SingularSystemError as error:
            raise SingularSystemError(f"frequency_response: {error}") from None

    @one_thread
    def displacement(self, point: Any) -> Complex:
        """Return the complex displacement of a point, shape (n_frequencies,).

        With ``loads="unit"``, under the load ``F sin(omega t + phase)``, the displacement is
        ``F Im(H exp(i (omega t + phase)))`` where H is the value that is returned. The modulus of H is the amplitude
        per unit of the load, and its angle is the phase by which the displacement leads the load. With
        ``loads="scene"`` the displacement is ``Im(H exp(i omega t))``, and the modulus of H is the amplitude in m.

        Parameters
        ----------
        point : point of a body

        Returns
        -------
        ndarray of complex
            The response H: in m/N for forces, m/(N/m) for line loads and so on with ``loads="unit"``, and in m with
            ``loads="scene"``.
        """
        rows = rows_over(self.scene.model, self.scene.bodies, [point])
        return np.asarray((rows @ self._rest.vectors) @ self._modal)[0]


@one_thread
def frequency_response(
    scene: Scene, frequencies: ArrayLike, closed: Sequence[Any] = (), *, loads: str = "unit"
) -> FrequencyResponse:
    """Return the linear response to the scene's harmonic loads; all contacts are open except the named ones.

    Loads that are `Sine` act at each of the given frequencies, and their own frequency is ignored. Constant loads are
    left out. Several harmonic loads act together: the ratios of their amplitudes and the differences of their phases
    are kept. A contact that is held closed acts by its stiffness and its damper.

    Parameters
    ----------
    scene : Scene
    frequencies : array_like, shape (n_frequencies,)
        Frequencies in Hz, not negative.
    closed : sequence of str or Contact
        Contacts that are held closed; all others are open.
    loads : {"unit", "scene"}
        "unit": the response per unit of the first load, in m/N for a force, whatever its amplitude and phase.
        "scene": the response in m to the loads as the scene has them.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    ArgumentError
        If a frequency is negative or not a number, a closed contact is unknown or rigid, or a load is not harmonic.
    MethodError
        If the scene has laws other than contacts that are not linear, or a closed contact sees the displacement of a
        base.
    SingularSystemError
        When displacements are asked for at a natural frequency without damping.
    """
    what = "frequency_response"
    system = as_scene(what, scene).model.system
    values = np.atleast_1d(array(f"{what}: frequencies", frequencies))
    if values.ndim != 1 or not values.size or np.any(values < 0.0):
        raise ArgumentError(
            f"{what}: frequencies is {frequencies!r}, expected one or more numbers in Hz, not negative, in one row"
        )
    refuse_travelling(what, system)
    for group in system.laws:
        if not group.linear and group is not system.contacts:
            raise MethodError(
                f"{what}: {group.labels[0]} is not linear; put a Spring of its tangent there, or follow the response "
                "with vofem.periodic and vofem.continuation"
            )
    force, unit = _force(what, system)
    if choice(f"{what}: loads", loads, ("unit", "scene")) == "unit":
        force = force / unit
    chosen = contact_indices(what, system, closed)
    attached = linear_laws(what, system)
    if chosen:
        laws = system.contacts
        assert laws is not None
        reason = laws.moving_refusal(what, chosen)
        if reason is not None:
            raise MethodError(reason)
        stiffness, damping = laws.stiffness[chosen], laws.damping[chosen]
        attached.append(Attached(laws.rows[chosen], lambda omega: stiffness + 1j * omega * damping))
    counters = Counters()
    inputs = np.stack([force.real, force.imag])
    rest = LinearRest(system, attached, inputs, 2.0 * np.pi * values, counters)
    modal = (inputs @ rest.vectors).T @ np.array([[1.0], [1.0j]])
    return FrequencyResponse(scene, values, rest, modal, counters)


def _force(what: str, system: System) -> tuple[Complex, complex]:
    """Return the harmonic load vector, shape (n,), and the amplitude ``a exp(i phase)`` of the first harmonic load."""
    total, unit = np.zeros(system.size, dtype=complex), 0.0j
    for load in system.loads:
        amplitude = _amplitude(what, load.name, as_time_function(load.function))
        if amplitude == 0.0:
            continue
        unit = unit or amplitude
        total += load.vector * amplitude
    if unit == 0.0:
        raise ArgumentError(
            f"{what}: the scene has no harmonic load, so nothing excites it; add one such as PointLoad(point, "
            "Sine(1.0, omega=1.0)), whose own frequency does not matter"
        )
    return total, unit


def _amplitude(what: str, name: str, function: Any) -> complex:
    """Return ``a exp(i phase)`` of a load, 0 for a constant one."""
    if isinstance(function, Sine):
        amplitude = complex(function.amplitude * np.exp(1j * function.phase))
        # sin(-omega t + phase) = -sin(omega t - phase)
        return -amplitude.conjugate() if function.omega < 0.0 else amplitude
    if isinstance(function, Scaled):
        return function.factor * _amplitude(what, name, function.function)
    if isinstance(function, Sum):
        parts = [_amplitude(what, name, term) for term in function.terms]
        if sum(part != 0.0 for part in parts) > 1:
            raise ArgumentError(
                f"{what}: {name} is a sum of several harmonics, which would all act at one frequency; give one Sine"
            )
        return sum(parts, 0.0j)
    if not isinstance(function, Constant):
        raise ArgumentError(
            f"{what}: {name} is neither harmonic nor constant, so it has no response at one frequency; write it with "
            "Sine, or leave it out"
        )
    return 0.0j
