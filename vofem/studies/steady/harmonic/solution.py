"""A periodic motion given by its harmonics, as the solution of a run over one period."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from vofem.arrays import Array, Complex
from vofem.integrators.base import ContactSamples, Energies, SpringSamples, status_at
from vofem.integrators.event_driven.modal_samples import ModalSamples
from vofem.laws import LawGroup, LawSet
from vofem.result import Result
from vofem.scene import Scene
from vofem.studies.steady.harmonic.law_path import LawPaths
from vofem.studies.steady.harmonic.linear_rest import LinearRest
from vofem.studies.steady.harmonic.trigonometric import (
    basis,
    crossings,
    rate,
    roots,
    stretches,
    to_real,
    turning_points,
)
from vofem.studies.steady.orbit import TIMES
from vofem.system import CLOSED, OPEN, Counters, Events, System

if TYPE_CHECKING:
    from vofem.integrators.slider_history import SliderSamples

#: Gauss's rule between two times, for work and dissipation.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)

#: Number of panels in a period of the highest harmonic for these integrals.
_PARTS = 2


@dataclass(frozen=True)
class HarmonicMotion:
    """A periodic motion in modes, by harmonics."""

    system: System
    rest: LinearRest
    laws: LawPaths
    coefficients: Complex  #: Modal displacements are ``Re sum_k c_k exp(i k omega t)``, shape (m, K + 1).
    omega: float  #: Angular frequency of the first harmonic, rad/s.

    @property
    def period(self) -> float:
        """Duration of the period in s."""
        return 2.0 * np.pi / self.omega

    @cached_property
    def series(self) -> tuple[Array, Array, Array]:
        """Series of modal displacements, velocities and accelerations, each (2K + 1, m)."""
        turn = 1j * self.omega * np.arange(self.coefficients.shape[1])
        return tuple(to_real((self.coefficients * turn**order).T) for order in range(3))  # type: ignore[return-value]

    def modal(self, times: Array, order: int = 0) -> Array:
        """Return modal displacements, or derivatives of an order up to 2, shape (m, n_times)."""
        functions = basis(self.omega * times, self.coefficients.shape[1] - 1)
        return np.asarray((functions @ self.series[order]).T)

    def along(self, rows: Any) -> Array:
        """Return the series of coordinates, shape (n_rows, 2K + 1)."""
        return np.asarray(to_real(((rows @ self.rest.vectors) @ self.coefficients).T).T)

    def range_of(self, row: Array) -> tuple[float, float]:
        """Return the least and the largest value of a row over the free degrees of freedom, shape (n,)."""
        series = self.along(row[None])[0]
        values = basis(np.append(0.0, turning_points(series)), series.size // 2) @ series
        return float(values.min()), float(values.max())

    @property
    def grazes(self) -> str:
        """Nothing: no number of harmonics shows that a motion just grazes a contact."""
        return ""


@dataclass
class HarmonicSolution:
    """A periodic motion as the outcome of a run over one period; a `Solution`."""

    motion: HarmonicMotion
    times: Array
    notes: list[str]

    continuous: ClassVar[bool] = True
    probes: ClassVar[None] = None
    modes: ClassVar[None] = None
    sensitivity: ClassVar[None] = None
    truncation: ClassVar[None] = None

    def __post_init__(self) -> None:
        self.t_end = self.motion.period
        self.counters = Counters()

    def sample(self, times: Array) -> ModalSamples:
        """Return the motion at any times."""
        modal = self.motion.modal
        return ModalSamples(self.motion.rest.vectors, modal(times), modal(times, 1), lambda: modal(times, 2))

    # -- contacts -------------------------------------------------------------------------------------

    @cached_property
    def events(self) -> Events:
        """Closings and openings within the period."""
        laws = self.motion.system.contacts
        if laws is None:
            return Events()
        found: list[tuple[float, int, int]] = []
        initial = np.full(len(laws), OPEN, dtype=np.int64)
        for j, series in enumerate(self.motion.along(laws.rows)):
            angles = np.mod(crossings(series, float(laws.gap[j])), 2.0 * np.pi)
            angles = angles[angles > 0.0]
            closes = basis(angles, series.size // 2) @ rate(series) > 0.0
            for time, status in zip(angles / self.motion.omega, np.where(closes, CLOSED, OPEN), strict=True):
                found.append((float(time), j, int(status)))
            initial[j] = CLOSED if basis(np.zeros(1), series.size // 2)[0] @ series > laws.gap[j] else OPEN
        found.sort()
        time, contact, status = (np.array([event[k] for event in found]) for k in range(3))
        return Events(time.astype(float), contact.astype(np.int64), status.astype(np.int64), initial)

    def contacts(self, times: Array) -> ContactSamples:
        """Return status, K_eq and force, from the gap functions there."""
        laws = self.motion.system.contacts
        assert laws is not None
        samples = self.sample(times)
        u, speed = samples.along(laws.rows, "q"), samples.along(laws.rows, "v")
        status = status_at(self.events, times)
        share = np.where(status == CLOSED, 1.0, 0.0)
        resolved = np.isfinite(laws.resolution)
        if np.any(resolved):
            share = np.where(resolved[:, None], laws.shares(u - laws.gap[:, None]), share)
        force = share * (laws.elastic(u) + laws.damping[:, None] * speed)
        return ContactSamples(status, share * laws.stiffness[:, None], force)

    # -- laws whose forces and energies are recorded ----------------------------------------------------

    @cached_property
    def springs(self) -> SpringSamples | None:
        """Springs with internal variables and springpots at `times`; None where there are none."""
        recorded = [group for group in self.motion.system.recorded if not group.slides]
        if not recorded:
            return None
        parts, past = self._along_path(recorded, self.times)
        force, kept, gone = np.concatenate(parts, axis=1)
        return SpringSamples(force, kept, gone, past)

    # -- sliders --------------------------------------------------------------------------------------

    @property
    def _sliders(self) -> LawGroup:
        return next(group for group in self.motion.system.laws if group.slides)

    def friction(self, times: Array) -> SliderSamples:
        """Return the sliders at some times; they slide where their force has its limit."""
        from vofem.integrators.slider_history import SliderSamples

        group = self._sliders
        force, stored, dissipated = self._along_path([group], times)[0][0]
        limits = group.limits()[:, None]
        slip = np.where(np.abs(force) >= limits, self.sample(times).along(group.rows, "v"), 0.0)
        return SliderSamples(force, slip, np.sign(slip).astype(np.int64), dissipated, limits + 0.0 * force, stored)

    def transitions(self, slider: int) -> tuple[Array, Array]:
        """Return the times within the period at which a slider's sliding ends, and at which its sticking ends, s."""
        motion, group = self.motion, self._sliders
        series, j = motion.along(group.rows)[slider], motion.laws.first_of(group) + slider
        turns, ends = stretches(series)
        places = (basis(ends, series.size // 2) @ series).tolist()
        records = motion.laws.laws.fresh()
        for place in motion.laws.passes * places:
            records.commit(j, place)
        stops, breaks = [], []
        for begin, end, before, place in zip(turns, ends, places[-1:] + places, places, strict=False):
            low, high = records.kinks(j)
            level = high if place > before else low
            if not low < place < high:
                breaks.append(roots(series, np.array([begin]), np.array([end]), level)[0])
                stops.append(end)
            records.commit(j, place)
        found = (np.sort(np.mod(angles, 2.0 * np.pi)) / motion.omega for angles in (stops, breaks))
        return tuple(found)  # type: ignore[return-value]

    def _along_path(self, groups: Sequence[LawGroup], times: Array) -> tuple[list[Array], Array]:
        """Return force, stored energy and loss of the laws of each group, and all internal variables at the end."""
        records = self.motion.laws.laws.fresh()
        parts = [self._linear(g, times) if g.linear else self._followed(g, records, times) for g in groups]
        return parts, records.state

    def _followed(self, group: LawGroup, records: LawSet, times: Array) -> Array:
        """Return force, stored energy and loss of laws with internal variables, (3, n_laws, n_times); update these."""
        motion = self.motion
        first = motion.laws.first_of(group)
        out = np.zeros((3, len(group), times.size))
        for i, series in enumerate(motion.along(group.rows)):
            j = first + i
            turns = turning_points(series)
            at_turns, at_times = (
                (basis(angles, series.size // 2) @ series).tolist() for angles in (turns, motion.omega * times)
            )
            for value in motion.laws.passes * at_turns:
                records.commit(j, value)
            begin = records.dissipated(j, at_times[0])
            ahead = list(zip((turns / motion.omega).tolist(), at_turns, strict=True))
            for k, (time, value) in enumerate(zip(times.tolist(), at_times, strict=True)):
                while ahead and ahead[0][0] <= time:
                    records.commit(j, ahead.pop(0)[1])
                force, lost = records.force(j, np.array([value]))[0], records.dissipated(j, value) - begin
                out[:, i, k] = force, records.stored(j, value), lost
            records.commit(j, at_times[-1])
        return out

    def _linear(self, group: LawGroup, times: Array) -> Array:
        """Return force, stored energy and loss of laws that are linear in harmonic motions, (3, n_laws, n_times)."""
        motion = self.motion
        count = motion.coefficients.shape[1]
        p = 1j * motion.omega * np.arange(-(count - 1), count)
        waves = np.exp(np.outer(p, times))
        edges = np.concatenate([[0.0], times])
        out = np.zeros((3, len(group), times.size))
        coordinates = (group.rows @ motion.rest.vectors) @ motion.coefficients
        stiffness = np.array([group.harmonic_stiffness(w) for w in (motion.omega * np.arange(count)).tolist()]).T
        energy = group.stored_by_pairs(p)
        for i in range(len(group)):
            both = np.concatenate([0.5 * coordinates[i, :0:-1].conj(), coordinates[i, :1], 0.5 * coordinates[i, 1:]])
            impedance = np.concatenate([stiffness[i, :0:-1].conj(), stiffness[i]])
            out[0, i] = ((impedance * both) @ waves).real
            pairs = np.outer(both, both) * energy[i]
            out[1, i] = 0.5 * np.einsum("kt,kl,lt->t", waves, pairs, waves).real
            work = self._integral(edges, lambda t, a=both, z=impedance: _power(p, a, z, t))[1:]
            out[2, i] = work - out[1, i] + out[1, i, 0] if times.size else work
        return out

    # -- energies -------------------------------------------------------------------------------------

    def _integral(self, times: Array, power: Any) -> Array:
        """Return the integral of a power from the first time to each, split at contact events."""
        motion = self.motion
        step = motion.period / (_PARTS * motion.coefficients.shape[1])
        inner = np.arange(0.0, float(times.max(initial=0.0)), step)
        edges = np.unique(np.concatenate([times, inner[inner > times.min(initial=0.0)], self.events.time]))
        edges = edges[(edges >= times.min(initial=0.0)) & (edges <= times.max(initial=0.0))]
        half = 0.5 * np.diff(edges)[:, None]
        nodes = edges[:-1, None] + half * (1.0 + _NODES)
        values = np.asarray(power(nodes.ravel())).reshape(nodes.shape)
        total = np.concatenate([[0.0], np.cumsum(np.sum(half * _WEIGHTS * values, axis=1))])
        return np.asarray(total[np.searchsorted(edges, times)])

    def energies(self, times: Array) -> Energies:
        """Return the energies at some times; dissipation and work from t = 0 on."""
        motion, system = self.motion, self.motion.system
        z, v = motion.modal(times), motion.modal(times, 1)
        kinetic = 0.5 * np.sum(v * v, axis=0)
        strain = 0.5 * (motion.rest.squares @ (z * z))
        contact = np.zeros(times.size)
        for group in system.laws:
            if group is system.contacts:
                contact = group.potential(np.asarray((group.rows @ motion.rest.vectors) @ z))
            elif not (group.recorded or group.linear):
                strain = strain + group.potential(np.asarray((group.rows @ motion.rest.vectors) @ z))
        begun = np.concatenate([[0.0], times])
        dissipated = self._integral(begun, self._losses)[1:]
        work = self._integral(begun, self._loads)[1:]
        for found in self._along_path([g for g in system.laws if g.recorded or g.linear], begun)[0]:
            strain = strain + found[1][:, 1:].sum(axis=0)
            dissipated = dissipated + found[2][:, 1:].sum(axis=0)
        return Energies(kinetic, strain, contact, dissipated, work)

    def _losses(self, times: Array) -> Array:
        """Return the power that dashpots, material damping and dampers of contacts dissipate, W."""
        power = self.motion.rest.dissipation(self.motion.modal(times, 1))
        laws = self.motion.system.contacts
        if laws is not None and np.any(laws.damping > 0.0):
            speed = self.sample(times).along(laws.rows, "v")
            samples = self.contacts(times)
            power = power + np.sum(
                laws.damping[:, None] * samples.stiffness / laws.stiffness[:, None] * speed**2, axis=0
            )
        return np.asarray(power)

    def _loads(self, times: Array) -> Array:
        """Return the power of all loads, W."""
        rates = self.motion.modal(times, 1)
        power = np.zeros(times.size)
        for load in self.motion.system.loads:
            power += np.asarray(load.function(times)) * ((load.vector @ self.motion.rest.vectors) @ rates)
        return power

    @cached_property
    def start_energy(self) -> float:
        """Kinetic, strain and contact energy at t = 0, J."""
        parts = self.energies(np.zeros(1))
        return float(parts.kinetic[0] + parts.strain[0] + parts.contact[0])


def _power(p: Complex, coefficients: Complex, impedance: Complex, times: Array) -> Array:
    waves = np.exp(np.outer(p, times))
    return np.asarray(((impedance * coefficients) @ waves).real * ((p * coefficients) @ waves).real)


def harmonic_result(scene: Scene, motion: HarmonicMotion, notes: tuple[str, ...]) -> Result:
    """Return the run over one period of a motion, at `TIMES` equal times."""
    times = np.linspace(0.0, motion.period, TIMES)
    return Result(scene, "harmonic_balance", HarmonicSolution(motion, times, list(notes)))
