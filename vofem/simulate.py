"""Chooses the method, checks the arguments, runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import array, nearest, number, one_of
from vofem.bodies.base import as_point
from vofem.errors import ArgumentError
from vofem.integrators.base import ProbeRows, ProbeSamples, Solution
from vofem.lookup import rows_over
from vofem.progress import Progress, Watcher
from vofem.result import Result
from vofem.scene import Scene, as_scene
from vofem.system import System

Array = NDArray[np.float64]

METHODS = ("event_driven", "energy_conserving", "generalized_alpha", "central_difference", "force_driven")

#: Options that a method takes beside those of `simulate`.
_OPTIONS: dict[str, tuple[str, ...]] = {
    "event_driven": ("max_events", "pin_fraction", "truncation"),
    "energy_conserving": (),
    "generalized_alpha": ("rho_infinity", "alpha_m", "alpha_f", "gamma", "newmark_beta"),
    "central_difference": (),
    "force_driven": (),
}


#: Methods that take steps, and record points at each of them.
_STEPPING = ("energy_conserving", "generalized_alpha", "central_difference")


def option_names(method: str = "auto") -> tuple[str, ...]:
    """Return the names of the options that a method takes, or some method for "auto"."""
    return _OPTIONS[method] if method in _OPTIONS else tuple(sorted({n for names in _OPTIONS.values() for n in names}))


def simulate(
    scene: Scene,
    t_end: float,
    *,
    method: str = "auto",
    dt: float | None = None,
    tol: float | None = None,
    times: ArrayLike | None = None,
    progress: Progress = None,
    probes: Mapping[str, Any] | Iterable[Any] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    checkpoint_every: float = 60.0,
    **options: Any,
) -> Result:
    """Simulate a scene from t = 0 to t_end.

    Parameters
    ----------
    scene : Scene
    t_end : float
        In s, positive.
    method : {"auto", "event_driven", "energy_conserving", "generalized_alpha", "central_difference", "force_driven"}
        "auto" takes event_driven, which is exact up to rounding, where it
        applies, and else energy_conserving, which is stable at any step;
        force_driven is for ``HystereticSpring(memory="printed")`` alone;
        `vofem.explain` says what it chooses and why.
    dt : float, optional
        Step size in s of a stepping method; chosen where not given.
    tol : float, optional
        Of energy_conserving: chooses the steps. The errors of all steps
        together, estimated, stay below this fraction of the largest
        displacement.
    times : array_like, shape (n_times,), optional
        Where results are wanted, increasing, within [0, t_end]. Without it:
        1001 uniform times for event_driven and with `tol`, else every step.
    progress : bool or callable, optional
        A bar on the standard error stream: True always, False never, None
        (the default) where that is a terminal and the run takes longer than a
        second. A function is called with the time reached and t_end, in s.
    probes : points, or dict of str to point, optional
        Their motion is recorded at every step, however few `times` there are:
        `Result.probes`. Methods without steps record it at `times`.
    checkpoint : path, optional
        File, ending in .checkpoint, to which the run is saved at intervals;
        `vofem.resume` goes on from it. Runs in Ritz vectors, which take
        seconds, save none.
    checkpoint_every : float
        Seconds of wall time between two checkpoints.
    **options
        Of event_driven: ``max_events`` (a million); ``pin_fraction``, the
        fraction of the gap below which chatter counts as rest (1e-7); and
        ``truncation``, the relative error of displacements for which few Ritz
        vectors may stand for a large system (1e-6 above 1000 degrees of
        freedom; 0 keeps all modes, which small systems do anyway). Of
        generalized_alpha: ``rho_infinity`` in [0, 1] (0.8), or ``alpha_m``,
        ``alpha_f``, ``gamma``, ``newmark_beta`` in place of what it implies.

    Returns
    -------
    Result

    Raises
    ------
    ArgumentError
        For arguments out of range or options that the method does not know.
    MethodError
        If the method cannot treat the scene; the message names one that can.
    StepSizeError
        If dt is beyond the critical step.
    InstabilityError, EventStormError
        If the run goes wrong.
    OutputError
        If the checkpoint exists already or cannot be written.

    Notes
    -----
    Ctrl-C ends a run between two steps: what was computed until then is
    returned, and a note says so. A second Ctrl-C interrupts at once.
    """
    t_end = number("simulate: t_end", t_end, positive=True)
    wanted = None if times is None else _times(times, t_end)
    system = as_scene("simulate", scene).model.system
    chosen = choose(system).method if method == "auto" else method
    if chosen not in METHODS:
        names = ("auto", *METHODS)
        raise ArgumentError(f"simulate: method is {method!r}, expected {one_of(names)}{nearest(method, names)}")
    unknown = sorted(set(options) - set(_OPTIONS[chosen]))
    if unknown:
        raise ArgumentError(
            f"simulate: method {chosen!r} does not know the option {unknown[0]!r}"
            f"{nearest(unknown[0], (*_OPTIONS[chosen], 'dt', 'times', 'method'))}; it takes {list(_OPTIONS[chosen])}"
        )
    if chosen == "event_driven":
        if dt is not None:
            raise ArgumentError("simulate: dt was given, but event_driven has no step; leave it out")
        if tol is not None:
            number("simulate: tol", tol, positive=True)
            tol = None
        wanted = np.linspace(0.0, t_end, 1001) if wanted is None else wanted
    elif tol is not None:
        if chosen != "energy_conserving":
            raise ArgumentError(
                f"simulate: tol was given, but {chosen} has no steps that follow a tolerance; "
                "choose method='energy_conserving', or leave it out"
            )
        options["tol"] = number("simulate: tol", tol, positive=True)
    step = None if dt is None else number("simulate: dt", dt, positive=True)
    plan = Plan(chosen, t_end, wanted, step, options, None if probes is None else _probe_rows(scene, probes))
    every = number("simulate: checkpoint_every", checkpoint_every, minimum=0)
    save = None
    if checkpoint is not None:
        from vofem.io.storage.checkpoint import checkpoint_writer

        save = checkpoint_writer(checkpoint, scene, plan)
    return run_plan(scene, plan, progress, save, every, None)


@dataclass(frozen=True)
class Plan:
    """What is to be run, arguments checked.

    Attributes
    ----------
    method : str
    t_end : float
        In s.
    times : ndarray, optional
    dt : float, optional
        In s.
    options : dict
    probes : ProbeRows, optional
    """

    method: str
    t_end: float
    times: Array | None
    dt: float | None
    options: dict[str, Any]
    probes: ProbeRows | None


def run_plan(
    scene: Scene,
    plan: Plan,
    progress: Progress,
    save: Callable[[dict[str, Any]], None] | None,
    every: float,
    snapshot: dict[str, Any] | None,
) -> Result:
    """Run a plan from the start or from a snapshot, watched as asked for."""
    from vofem.integrators.coarse import unresolved_contacts

    integrator = import_module(f"vofem.integrators.{plan.method}")
    arguments = plan.options if plan.method == "event_driven" else {"dt": plan.dt, **plan.options}
    if plan.method in _STEPPING:
        arguments = {**arguments, "probes": plan.probes}
    with Watcher(plan.t_end, progress, save, every) as watcher:
        solution = integrator.run(
            scene.model.system, scene.initial_state(), plan.t_end, plan.times,
            watch=None if watcher.idle else watcher, resume=snapshot, **arguments,
        )  # fmt: skip
    solution.notes.extend(unresolved_contacts(scene.model.system))
    forgotten = scene.forgotten()
    if forgotten and snapshot is None:
        solution.notes.append(
            f"springpots: Springpot {forgotten[0]!r} begins without the past that it has in the earlier run, at rest "
            "in its place; vofem.resume carries it on"
        )
    return Result(scene, plan.method, solution, _recorded(plan.probes, solution))


def _recorded(probes: ProbeRows | None, solution: Solution) -> ProbeSamples | None:
    """Return what a run has recorded at points; without steps, their motion at its times."""
    if probes is None:
        return None
    record: ProbeSamples | None = getattr(solution, "probes", None)
    if record is None:
        samples = solution.sample(solution.times)
        motion = (np.asarray(samples.along(probes.rows, kind)) for kind in "qva")
        record = ProbeSamples(probes.names, solution.times, *motion)
    return record


def _probe_rows(scene: Scene, probes: Mapping[str, Any] | Iterable[Any]) -> ProbeRows | None:
    """Return names and rows of points to be recorded, or None where there are none."""
    if not isinstance(probes, Mapping):
        if not hasattr(probes, "row") and not isinstance(probes, Iterable):
            raise ArgumentError(f"simulate: probes is {probes!r}, expected points, or a dict of names and points")
        points = [probes] if hasattr(probes, "row") else list(probes)
        named = {as_point("simulate: a point of probes", point).name: point for point in points}
    else:
        named = {name: as_point(f"simulate: probes[{name!r}]", point) for name, point in probes.items()}
    return ProbeRows(tuple(named), rows_over(scene.model, scene.bodies, named.values())) if named else None


def _times(times: ArrayLike, t_end: float) -> Array:
    wanted = np.atleast_1d(array("simulate: times", times))
    if wanted.ndim != 1 or not wanted.size:
        raise ArgumentError(f"simulate: times has shape {wanted.shape}, expected a list of one or more times")
    if np.any(np.diff(wanted) < 0):
        k = int(np.argmax(np.diff(wanted) < 0))
        raise ArgumentError(
            f"simulate: times must be a list of times that does not decrease, found {wanted[k]:g} s "
            f"followed by {wanted[k + 1]:g} s"
        )
    slack = 1e-12 * t_end
    if wanted[0] < 0.0 or wanted[-1] > t_end + slack:
        raise ArgumentError(
            f"simulate: times reaches from {wanted[0]:g} to {wanted[-1]:g} s, expected within 0 to t_end = {t_end:g} s"
            f"; uniform times are np.linspace(0, {t_end:g}, count)"
        )
    return np.minimum(wanted, t_end)


@dataclass(frozen=True)
class Choice:
    """A method and why it was chosen."""

    method: str
    why: str


def choose(system: System) -> Choice:
    """Return the method that ``method="auto"`` takes: the most accurate one that applies."""
    if system.printed is not None:
        return Choice("force_driven", f"{system.printed.label} follows Eq. 22, which the applied force drives")
    from vofem.integrators import event_driven

    reason = event_driven.refusal(system)
    if reason is None:
        return Choice(
            "event_driven",
            "the scene is linear between contact events and its loads have closed forms: exact up to rounding",
        )
    return Choice("energy_conserving", f"event_driven does not apply: {reason.split('. ')[0]}")


@dataclass(frozen=True)
class Explanation:
    """What will be simulated, by which method and why, and what will not; print it.

    Attributes
    ----------
    bodies, effects : tuple of str
        One line each.
    unknowns : int
        Free degrees of freedom.
    method, why : str
        What ``method="auto"`` takes, and the reason.
    absent : tuple of str
        Kinds of effects that the scene does not call for: nothing is built or evaluated for them.
    """

    bodies: tuple[str, ...]
    effects: tuple[str, ...]
    unknowns: int
    method: str
    why: str
    absent: tuple[str, ...]

    def __str__(self) -> str:
        lines = ["Bodies", *(f"  {line}" for line in self.bodies)]
        lines += ["Effects", *(f"  {line}" for line in self.effects or ("none",))]
        lines += [f"Unknowns: {self.unknowns}", f"Method: {self.method}, because {self.why}"]
        lines.append(f"Not simulated: {', '.join(self.absent) or 'nothing is left out'}")
        return "\n".join(lines)


_KINDS: tuple[tuple[str, Callable[[System], bool]], ...] = (
    ("contacts", lambda system: system.contacts is not None),
    (
        "contact dampers",
        lambda system: system.contacts is not None and bool(np.any(system.contacts.damping > 0)),
    ),
    ("damping", lambda system: system.damped),
    ("nonlinear springs", lambda system: system.nonlinear is not None),
    ("springs with memory", lambda system: bool(system.path_dependent)),
    ("springpots", lambda system: system.springpots is not None),
    ("loads", lambda system: bool(system.loads)),
)


def explain(scene: Scene) -> Explanation:
    """Return what will be simulated, by which method and why, and what will not.

    Parameters
    ----------
    scene : Scene
    """
    system = as_scene("explain", scene).model.system
    choice = choose(system)
    return Explanation(
        bodies=tuple(body.describe() for body in scene.bodies),
        effects=tuple(effect.describe() for effect in scene.effects),
        unknowns=system.size,
        method=choice.method,
        why=choice.why,
        absent=tuple(kind for kind, present in _KINDS if not present(system)),
    )
