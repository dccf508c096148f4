"""The outcome of a study of accuracy and time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vofem._validate import number
from vofem.integrators.registry import method_named
from vofem.studies.accuracy.quantities import Errors


@dataclass(frozen=True)
class Setting:
    """A way to run a scene: method, mesh and step.

    Attributes
    ----------
    method : str
    elements : int
        Number of elements of all beams together; 0 for a scene without beams.
    dt : float, optional
        Step size in s.
    tol : float, optional
    """

    method: str
    elements: int
    dt: float | None = None
    tol: float | None = None

    def __str__(self) -> str:
        """Return method and what steers it, without the mesh."""
        steered = f", dt = {self.dt:.4g} s" if self.dt is not None else ""
        return self.method + steered + (f", tol = {self.tol:.3g}" if self.tol is not None else "")


@dataclass(frozen=True)
class Run:
    """One run: its time, its work and its errors.

    Attributes
    ----------
    setting : Setting
    unknowns : int
    seconds : float
        Shortest wall time in s of the run and of the point's history, without assembly.
    assembly : float
        Wall time of assembling the scene, s.
    counters : dict
        Counted work by name, as in `vofem.system.Counters`.
    total : Errors
        Errors against the reference.
    time : Errors
        Errors against the run on the same mesh that is exact in time.
    space : float
        Error of the mesh alone in m, which is the error of the run that is exact in time, against the reference.
    rounding : float
        Largest difference in m to a run of the same equations with other rounding errors; NaN if not measured.
    order : float
        Observed order in dt, from this run and the one with the next larger step; NaN for the first.
    """

    setting: Setting
    unknowns: int
    seconds: float
    assembly: float
    counters: dict[str, int]
    total: Errors
    time: Errors
    space: float
    rounding: float
    order: float = float("nan")

    @property
    def steps(self) -> int:
        """Time steps, or segments between events."""
        return self.counters["steps"]

    @property
    def work(self) -> int:
        """Number of all counted operations except events."""
        return sum(value for name, value in self.counters.items() if name != "events")

    @property
    def judged(self) -> float:
        """The error in m by which the run is judged: the larger of the total error and that of the steps.

        Errors of steps and mesh may cancel at one step size, for one load. The total error is then small by chance.
        """
        return self.total.largest if np.isnan(self.time.largest) else max(self.total.largest, self.time.largest)


@dataclass(frozen=True)
class LeftOut:
    """A way to run the scene that was left out, and why."""

    setting: Setting
    why: str


@dataclass(frozen=True)
class Reference:
    """The reference with which all runs are compared.

    Attributes
    ----------
    how : str
        Method and mesh.
    elements : int
    floor : float
        Estimated error of the reference in m. Errors of runs that are smaller have no meaning.
    scale : float
        Largest displacement of the reference in m.
    horizon : float
        Time in s until which pointwise values are meaningful. Pointwise errors are taken up to it.
    """

    how: str
    elements: int
    floor: float
    scale: float
    horizon: float


@dataclass(frozen=True, repr=False)
class Study:
    """Error against time, steps and work, of many runs of one scene.

    Attributes
    ----------
    point : str
        Description of the point whose displacement is compared.
    t_end : float
        Duration of the runs in s.
    reference : Reference
    runs : tuple of Run
    left_out : tuple of LeftOut
    machine : str
        The machine on which times were measured.
    """

    point: str
    t_end: float
    reference: Reference
    runs: tuple[Run, ...]
    left_out: tuple[LeftOut, ...]
    machine: str

    def __repr__(self) -> str:
        return f"Study({self.point} over {self.t_end:g} s, {len(self.runs)} runs, {len(self.left_out)} left out)"

    def relative(self, run: Run) -> float:
        """Return the largest displacement error of the point, relative to the largest displacement of the reference."""
        return self._over_scale(run.total.largest)

    def _over_scale(self, error: float) -> float:
        return error / self.reference.scale if self.reference.scale > 0.0 else error

    @property
    def floor(self) -> float:
        """The error of the reference, relative to its largest displacement."""
        return self._over_scale(self.reference.floor)

    def meeting(self, tolerance: float) -> tuple[Run, ...]:
        """Return the runs whose relative error is at most the tolerance, fastest first.

        The error of the steps alone must also meet the tolerance, because it may cancel with the error of the mesh.
        """
        tolerance = number("meeting: tolerance", tolerance, positive=True)
        good = [run for run in self.runs if self._over_scale(run.judged) <= tolerance]
        return tuple(sorted(good, key=lambda run: run.seconds))

    def frontier(self) -> tuple[Run, ...]:
        """Return the runs that no other run beats in both time and error, fastest first."""
        best, kept = np.inf, []
        for run in sorted(self.runs, key=lambda run: (run.seconds, run.total.largest)):
            if run.total.largest < best:
                best = run.total.largest
                kept.append(run)
        return tuple(kept)

    def advice(self, tolerance: float = 1e-6) -> str:
        """Return a sentence of advice for a relative tolerance: the fastest way, its gain and its errors."""
        good = self.meeting(tolerance)
        if not good:
            return self._none_meets(tolerance)
        first = good[0]
        text = (
            f"For an error of {tolerance:g} of the largest displacement at {self.point}, use {_spelt(first)}: "
            f"{_said(first)}"
        )
        other = next((run for run in good if run.setting.method != first.setting.method), None)
        if other is not None:
            text += f", {other.seconds / first.seconds:.3g} times faster than {_spelt(other)}"
        return f"{text}; {self._where(first)}{self._limits(tolerance)}."

    def _none_meets(self, tolerance: float) -> str:
        run = min(self.runs, key=lambda run: run.judged, default=None)
        if run is None:
            return "No run was possible; see what was left out."
        return (
            f"No run comes within {tolerance:g} of the largest displacement at {self.point}; the nearest is "
            f"{_spelt(run)} with {self._over_scale(run.judged):.1e} in {_said(run)}; "
            f"{self._where(run)}{self._limits(tolerance)}."
        )

    def _where(self, run: Run) -> str:
        """Say which part of the error is the largest."""
        # Without steps, what differs from a run exact in time is what Ritz vectors leave out of a large system.
        steps = "Ritz vectors" if not method_named(run.setting.method).steps else "steps in time"
        parts = {steps: run.time.largest, "the mesh": run.space}
        if np.isfinite(run.rounding):
            parts["rounding"] = run.rounding
        if max(run.total.largest, *parts.values()) <= self.reference.floor:
            return "its error is not above that of the reference"
        largest = max(parts, key=lambda name: parts[name])
        return f"most of its error of {run.total.largest:.1e} m comes from {largest}"

    def _limits(self, tolerance: float) -> str:
        text = ""
        if self.floor > tolerance:
            text = f"; the reference itself is known to {self.floor:.1e} only"
        if self.reference.horizon < self.t_end:
            text += (
                f"; the scene is chaotic, and beyond t = {self.reference.horizon:.4g} s pointwise values mean nothing"
            )
        return text


def _spelt(run: Run) -> str:
    mesh = f" on {run.setting.elements} elements" if run.setting.elements else ""
    return f"{run.setting}{mesh}"


def _said(run: Run) -> str:
    return f"{run.seconds * 1e3:.3g} ms" if run.seconds < 1.0 else f"{run.seconds:.3g} s"
