"""The solution of a run in Ritz vectors, given in degrees of freedom."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from vofem.arrays import Array
from vofem.integrators.base import ContactSamples, Energies, Sensitivity, Truncation
from vofem.integrators.event_driven.modal_samples import ModalSamples
from vofem.integrators.event_driven.segment import Segments
from vofem.integrators.event_driven.solution import EventSolution
from vofem.system import Counters, Events


class TruncatedSolution:
    """The solution of a run in Ritz vectors, given in degrees of freedom.

    `reduced`: the run in Ritz vectors.
    `vectors` (shape (n, count)): M-orthonormal.
    `tolerance`: relative error of displacements that the user accepts.
    `beams`: whether there are slopes among the degrees of freedom.
    """

    continuous = True
    springs = None
    probes = None

    def __init__(
        self,
        reduced: EventSolution,
        vectors: Array,
        times: Array,
        truncation: Truncation,
        tolerance: float,
        beams: bool,
    ) -> None:
        self.reduced = reduced
        self.vectors = vectors
        self.truncation = truncation
        self.tolerance = tolerance
        self.beams = beams
        self.t_end = reduced.t_end
        self.times = times
        self.counters: Counters = reduced.counters
        self.notes: list[str] = [*_notes(truncation, tolerance, reduced.t_end, beams), *reduced.notes]

    @property
    def modes(self) -> tuple[Array, Array]:
        """Squared frequencies (count,) and shapes (n, count) of the Ritz vectors without contacts."""
        return self.reduced.space.stiffness, self._shapes

    @cached_property
    def _shapes(self) -> Array:
        return self.vectors @ self.reduced.space.shapes

    @property
    def segments(self) -> Segments:
        """Begin, duration, contact status and state, in Ritz vectors, of every segment."""
        return self.reduced.segments

    @property
    def events(self) -> Events:
        """The contact events in order of time."""
        return self.reduced.events

    @property
    def start_energy(self) -> float:
        """Kinetic, strain and contact energy at t = 0."""
        return self.reduced.start_energy

    @property
    def sensitivity(self) -> Sensitivity:
        """Growth of a perturbation along the run, in closed form."""
        return self.reduced.sensitivity

    def sample(self, times: Array) -> ModalSamples:
        """Return the motion at any times."""
        return self.reduced.sample(times).lifted(self.modes[1])

    def contacts(self, times: Array) -> ContactSamples:
        """Return status, K_eq and force of the contacts at any times."""
        return self.reduced.contacts(times)

    def energies(self, times: Array) -> Energies:
        """Return energies, dissipation and work at any times, in closed form."""
        return self.reduced.energies(times)


def _notes(kept: Truncation, tolerance: float, t_end: float, beams: bool) -> list[str]:
    beyond = "" if kept.until >= t_end else f"; it stays within {tolerance:g} until t = {kept.until:.4g} s"
    fine = 4.0 * np.finfo(float).eps * kept.unknowns**2
    differences = ""
    if beams:
        differences = (
            "; bending moments and shear forces, second and third differences of them, lose up to about "
            f"{fine:.0e} and {fine * kept.unknowns:.0e} (support reactions do not)"
        )
    return [
        f"truncation: {kept.vectors} Ritz vectors, static responses to contacts and loads among them, stand for "
        f"{kept.unknowns} degrees of freedom; by comparison with half as many, displacements at contacts and loads "
        f"are off by about {kept.error:.1e} of their largest value{beyond}; accelerations are off by more, most of all "
        "at a start, at kinks and steps of loads, and in the first moments after impacts",
        f"rounding: two orders of elimination differ by {kept.rounding:.1e} of the displacements{differences}",
    ]
