"""A periodic orbit, with the same attributes for all methods that find orbits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from vofem._validate import whole
from vofem.arrays import Array, Complex
from vofem.blas import one_thread
from vofem.cards import Shown
from vofem.initial import StoredState
from vofem.kernels.choice import by_need
from vofem.lookup import rows_over
from vofem.result import Result
from vofem.scene import Scene
from vofem.system import State
from vofem.time_functions.parts import frequency_words

#: Number of equal times, both ends included, of an orbit's result.
TIMES = 1001

#: Distance from the unit circle below which stability is not decided: rounding of multipliers that are simple.
DECIDED = 1e-9

#: Distance beyond which no rounding matters.
_NEAR = 1e-2

#: Nodes of the quadrature that gives harmonics, and panels in a period between corners of the motion.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_PANELS = 64


class OrbitMotion(Protocol):
    """The motion along an orbit as its method knows it, without a run."""

    def range_of(self, row: Array) -> tuple[float, float]:
        """Return the least and the largest value of a row over the free degrees of freedom, shape (n,)."""

    @property
    def grazes(self) -> str:
        """Name of a contact whose force jumps and that is grazed within rounding; empty without one."""


@dataclass(frozen=True)
class OrbitTruncation:
    """What was left out of an orbit's unknowns or multipliers.

    Attributes
    ----------
    modes : int
        Number of modes (or harmonics) left out.
    largest : float
        Bound on the modulus of the multipliers of the modes left out. For harmonics it is the estimated error of
        displacements relative to the largest one.
    what : str
        One sentence about what was left out.
    error : float
        Estimated error of displacements relative to the largest one; NaN if it is not known.
    """

    modes: int
    largest: float
    what: str
    error: float = float("nan")


@dataclass(frozen=True)
class OrbitSource:
    """How a method gives what is computed only when an orbit is asked for it."""

    scene: Callable[[], Scene]
    motion: Callable[[], OrbitMotion]
    result: Callable[[], Result]  #: The result over the whole orbit at `TIMES` equal times.
    multipliers: Callable[[], Complex | None]  #: In any order; None if they are not known.
    #: The distance of the largest multiplier from the unit circle below which stability is not decided. It is asked for
    #: only if a multiplier is near the circle.
    uncertainty: Callable[[], float] = lambda: DECIDED
    stable: Callable[[], bool | None] | None = None  #: Whether the orbit is stable, if this is known already.
    truncation: Callable[[], OrbitTruncation | None] = lambda: None


@dataclass(eq=False, repr=False)
class PeriodicOrbit(Shown):
    """A periodic orbit of a scene.

    A run can start from it: ``vofem.simulate(scene, t_end, initial=orbit)`` takes its state at t = 0 of the loads.

    Attributes
    ----------
    source : OrbitSource
        How its motion and its multipliers are found.
    method : str
        "shooting" or "harmonic_balance".
    omega : float
        Angular frequency of the loads in rad/s; for a free oscillation its own angular frequency.
    periods : int
        Number of periods of the loads after which the orbit repeats.
    residual : float
        The error with which the orbit closes: the largest difference between the states at its two ends, divided by the
        size of the motion. Displacements and velocities are compared separately.
    remarks : list of str
        Sentences about the orbit besides that about its truncation.
    unknowns : ndarray or None
        The unknowns of the method, from which other problems can start.
    autonomous : bool
        True if no load determines the period. In that case one multiplier is always 1.
    start : State or None
        State over the free degrees of freedom at t = 0 of the loads.
    """

    source: OrbitSource
    method: str
    omega: float
    periods: int
    residual: float
    remarks: list[str] = field(default_factory=list)
    unknowns: Array | None = None
    autonomous: bool = False
    start: State | None = None
    _measured: tuple[Any, tuple[float, float]] | None = field(default=None, init=False)

    def __repr__(self) -> str:
        times = f" over {self.periods} periods of the loads" if self.periods > 1 else ""
        return f"PeriodicOrbit({self.method}, {self.frequency_words(9)}{times}, {self.stability})"

    def frequency_words(self, digits: int = 6) -> str:
        """Return the frequency as a text, in the unit in which those of the loads were given."""
        loads = (getattr(effect, name, None) for effect in self.scene.effects for name in ("f", "acceleration"))
        return frequency_words(self.omega, loads, digits)

    @cached_property
    def truncation(self) -> OrbitTruncation | None:
        """What was left out of the unknowns, or None; by harmonic balance it is computed when first asked."""
        with one_thread:
            return self.source.truncation()

    @cached_property
    def notes(self) -> list[str]:
        """Sentences about the orbit that a user should read."""
        left_out = self.truncation
        return list(dict.fromkeys([*([] if left_out is None else [left_out.what]), *self.remarks]))

    @cached_property
    def multipliers(self) -> Complex | None:
        """Floquet multipliers by decreasing modulus; None if they are not known. Some are computed when first asked."""
        with one_thread:
            found = self.source.multipliers()
        return None if found is None else by_modulus(found)

    @property
    def stability(self) -> str:
        """A sentence about the stability."""
        if self.grazes:
            return f"at a grazing of contact {self.grazes!r}, stability undecided"
        if self.multipliers is None and not any("stability" in note for note in self.notes):
            return "stability not decided: no exact orbit lies within the error of the harmonics, as beside a fold"
        return {True: "stable", False: "unstable", None: "stability not decided"}[self.stable]

    @cached_property
    def grazes(self) -> str:
        """Name of a contact with ``acts_on="displacement"`` that the orbit grazes within rounding; empty without one.

        The force jumps there, so the multipliers are those of orbits on one side of the grazing, or large without
        bound.
        """
        laws = self.scene.model.system.contacts
        if laws is None or not laws.jumps.any():
            return ""
        return self.source.motion().grazes

    @property
    def scene(self) -> Scene:
        """The scene. For an orbit from a file it is read when it is first needed."""
        return self.source.scene()

    @property
    def period(self) -> float:
        """Duration of the whole orbit in s: `periods` times ``2 pi/omega``."""
        return 2.0 * np.pi * self.periods / self.omega

    @property
    def stable(self) -> bool | None:
        """Whether small perturbations die out.

        None if this is not decided. This is so if multipliers are not known, as by harmonic balance where no exact
        orbit is near, or if the orbit `grazes` a contact, or if the largest multiplier lies on the unit circle within
        its error. This error is rounding, and for laws that shooting does not take that of the harmonics left out.
        """
        if self.source.stable is not None:
            return self.source.stable()
        if self.grazes or self.multipliers is None:
            return None
        size = np.abs(self.multipliers)
        if self.autonomous and size.size:
            size = np.delete(size, int(np.argmin(np.abs(self.multipliers - 1.0))))
        most = float(np.max(size, initial=0.0))
        if abs(most - 1.0) > _NEAR and self.method == "shooting":
            return most < 1.0
        with one_thread:
            margin = self.source.uncertainty()
        return None if abs(most - 1.0) <= margin else most < 1.0

    @cached_property
    def result(self) -> Result:
        """The `Result` over the whole orbit: 1001 equal times, both ends included, from t = 0 of the loads on."""
        with one_thread:
            return self.source.result()

    # -- as the start of a run ------------------------------------------------------------------------

    def state_of(self, body_name: str) -> tuple[Any, Any]:
        """Return a body's degrees of freedom and rates at t = 0 of the loads, each (size,)."""
        return self.as_start().state_of(body_name)

    def as_start(self) -> StoredState:
        """Return the state at t = 0 of the loads, with which a run can start, without the orbit."""
        if self.start is None:
            (q, v), known = self.result.solution.sample(np.zeros(1)).last(), self.result.as_start()
        else:
            q, v, known = self.start.q, self.start.v, StoredState({}, {})
        of = self.scene.model.of_body
        states = {body.name: (of(body, q), of(body, v)) for body in self.scene.bodies}
        return replace(known, states=states, source="PeriodicOrbit")

    def start_of(self, point: Any) -> float:
        """Return the displacement of a point at t = 0 of the loads, m."""
        if self.start is None:
            return float(self.result.displacement(point, [0.0])[0])
        bodies, model = self.scene.bodies, self.scene.model
        return float((rows_over(model, bodies, [point]) @ self.start.q)[0])

    # -- what is measured of it -----------------------------------------------------------------------

    @one_thread
    @by_need("steady states")
    def extremes(self, point: Any) -> tuple[float, float]:
        """Return the least and the largest displacement of a point in m, found between samples.

        Parameters
        ----------
        point : point of a body, or the name of a mass

        Returns
        -------
        least, largest : float
        """
        # Tables and pictures of a branch ask for one point again and again.
        if self._measured is None or self._measured[0] is not point:
            row = rows_over(self.scene.model, self.scene.bodies, [point]).toarray()[0]
            self._measured = point, self.source.motion().range_of(row)
        return self._measured[1]

    def amplitude(self, point: Any) -> float:
        """Return half the difference between the largest and the least displacement of a point, m."""
        least, largest = self.extremes(point)
        return 0.5 * (largest - least)

    @one_thread
    def harmonics(self, point: Any, count: int) -> Complex:
        """Return the Fourier coefficients of a point's displacement.

        Parameters
        ----------
        point : point of a body, or the name of a mass
        count : int
            Number of harmonics beyond the mean, at most 1000.

        Returns
        -------
        ndarray of complex, shape (count + 1,)
            ``c`` in m with ``u(t) = Re sum_k c[k] exp(2 pi i k t/period)``: ``c[0]`` is the mean and ``abs(c[k])`` the
            amplitude of harmonic k of the whole orbit. If the orbit takes n periods of the loads, harmonic n has the
            frequency of the loads, and the harmonics below it are subharmonics.

        Raises
        ------
        ArgumentError
            If count is not a whole number from 0 to 1000.
        """
        count = whole("harmonics: count", count, least=0, most=1000)
        panels = _PANELS + 2 * count
        events = np.asarray(self.result.solution.events.time, dtype=float)
        edges = np.linspace(0.0, self.period, panels + 1)
        edges = np.unique(np.concatenate([edges, events[(events > 0.0) & (events < self.period)]]))
        width = np.diff(edges)
        times = (edges[:-1, None] + 0.5 * width[:, None] * (1.0 + _NODES)).ravel()
        weights = (0.5 * width[:, None] * _WEIGHTS).ravel() / self.period
        u = self.result.displacement(point, times)
        angle = -2j * np.pi * times / self.period
        coefficients = np.array([2.0 * (np.exp(k * angle) @ (weights * u)) for k in range(count + 1)])
        coefficients[0] *= 0.5
        return coefficients


def by_modulus(multipliers: Complex) -> Complex:
    """Return multipliers by decreasing modulus, those of positive imaginary part first in a pair."""
    values = np.asarray(multipliers, dtype=complex)
    order = sorted(
        range(values.size), key=lambda k: (-round(float(abs(values[k])), 12), -values[k].imag, -values[k].real)
    )
    return values[order]
