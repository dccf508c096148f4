"""Runs a scene: `simulate`."""

from __future__ import annotations

import inspect
import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import flag_or_none, nearest, number, one_of, series
from vofem.arrays import Array
from vofem.bodies.base import Point
from vofem.cards import from_io
from vofem.errors import ArgumentError
from vofem.histories.tables import named_points
from vofem.initial import Initial, StateSource
from vofem.integrators.base import ProbeRows
from vofem.integrators.registry import advice, method_named, method_names
from vofem.lookup import rows_over
from vofem.progress import Progress
from vofem.result import Result
from vofem.scene import Scene, as_scene
from vofem.simulate.methods import choose, hint, option_names
from vofem.simulate.plan import Plan, run_plan


def simulate(
    scene: Scene,
    t_end: float,
    *,
    initial: Mapping[Any, Any] | StateSource | None = None,
    t_start: float = 0.0,
    method: str = "auto",
    dt: float | None = None,
    tol: float | None = None,
    times: ArrayLike | None = None,
    progress: Progress = None,
    probes: Mapping[str, Any] | Iterable[Any] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    checkpoint_every: float = 60.0,
    compiled: bool | None = None,
    **options: Any,
) -> Result:
    """Simulate a scene from t = 0 to t_end.

    Matrices, vibration modes and factorisations do not depend on the initial state or on time. They are computed in the
    first run of a scene and kept with the scene, so that later runs of the same scene start faster.

    Parameters
    ----------
    scene : Scene
        The scene that is simulated.
    t_end : float
        Duration of the run in s, positive.
    initial : dict, Equilibrium or Result, optional
        Initial state that is used instead of the scene's own ``initial``: a dict as in `Scene`, the outcome of
        `vofem.equilibrium`, or an earlier run. Of an earlier run the state at its last time is taken, but not the time.
        Bodies and springs are matched by name, so the outcome may belong to another scene.
    t_start : float
        Time in s at which the loads begin: a load is ``function(t_start + t)``. The same holds for varying orders of
        springpots. Times of the run and of its result still count from 0.
    method : {"auto", "event_driven", "energy_conserving", "generalized_alpha", "central_difference", "force_driven"}
        "auto" takes event_driven where it applies, because it is exact up to rounding, and otherwise energy_conserving,
        which is stable at any step. force_driven is for ``HystereticSpring(memory="printed")`` only. `vofem.explain`
        says which method is chosen and why.
    dt : float, optional
        Step size in s of a stepping method. Without it a step is chosen.
    tol : float, optional
        Tolerance of energy_conserving and generalized_alpha, from which the steps are chosen. The estimated error of
        displacements that all steps make together stays below this fraction of the largest displacement. Impacts may
        magnify errors that were made before them; a note appears if a run with four times the tolerance differs by more
        than five of it. Steps resolve every impact, however stiff the stop is. The errors of velocities, accelerations
        and contact forces are not bounded. "auto" also accepts a tolerance when it takes event_driven, which has no
        error of steps.
    times : array_like, shape (n_times,), optional
        Times in s at which results are stored, increasing, within [0, t_end]. Without it there are 1001 uniform times
        for event_driven and with `tol`; other runs store every step.
    progress : bool or callable, optional
        Whether a progress bar is shown on the standard error stream. None, the default, shows it if that is a terminal
        and the run takes longer than a second. Beside steps under a tolerance it names a method that needs none. A
        function is called with the time reached and t_end, in s.
    probes : points, or dict of str to point, optional
        Points whose motion is recorded at every step, however few `times` there
        are; see `Result.probes`. Methods without steps record it at `times`.
    checkpoint : path, optional
        A file whose name ends in .checkpoint, to which the run is saved at intervals. `vofem.resume` continues from it.
        Runs in Ritz vectors take seconds and write no checkpoints.
    checkpoint_every : float
        Seconds of wall time between two checkpoints.
    compiled : bool, optional
        Whether the numerical kernels run as machine code (True) or as plain Python (False). Results agree to rounding.
        Without it, a run begins in plain Python. If it lasts for some seconds, it begins anew with machine code, which
        takes up to a minute to compile once on a machine. `Result.compiled` says what was taken. Give it if two
        processes must return the same bits, and the same number of BLAS threads above 400 unknowns.
    **options
        Options of the method. For event_driven: ``max_events`` (default 1e6), the largest number of events;
        ``pin_fraction`` (1e-7), the fraction of the gap below which chatter counts as rest; ``truncation`` (1e-6 above
        1000 degrees of freedom, otherwise 0), the relative error of displacements up to which a few Ritz vectors
        replace all modes. For generalized_alpha: ``rho_infinity`` in [0, 1] (0.8), the damping of the highest
        frequencies, or the parameters ``alpha_m``, ``alpha_f``, ``gamma`` and ``newmark_beta`` that follow from it. For
        the three methods with a step size ``dt``: ``nearby``, whether a second run from a start nearby looks for chaos,
        and one with larger steps for errors, which take as long as the run and half of it (None: where that is less
        than one or two seconds).

    Returns
    -------
    Result
        Histories, contacts, energies and notes of the run.

    Raises
    ------
    ArgumentError
        For arguments out of range or options that the method does not know.
    MethodError
        If the method cannot treat the scene; the message names one that can.
    StepSizeError
        If dt is larger than the critical step.
    InstabilityError
        If the motion or the energy grows without a physical cause.
    EventStormError
        If there are more than ``max_events`` contact events.
    OutputError
        If the checkpoint exists already or cannot be written.

    Notes
    -----
    Ctrl-C ends a run between two steps. The part of the run that was computed is
    returned, and a note says so. Ctrl-C waits for kernels that are being compiled.
    A second Ctrl-C raises KeyboardInterrupt at once, and nothing is returned.
    """
    t_end = number("simulate: t_end", t_end, positive=True)
    compiled = flag_or_none("simulate: compiled", compiled, "to let vofem decide")
    wanted = None if times is None else _output_times(times, t_end)
    system = as_scene("simulate", scene).model.system
    t_start = number("simulate: t_start", t_start, minimum=0)
    other = None if initial is None else Initial("simulate: initial", scene.bodies, initial, by_name=True)
    if tol is not None:
        tol = number("simulate: tol", tol, positive=True)
    names = ("auto", *method_names())
    if not isinstance(method, str) or method not in names:
        raise ArgumentError(f"simulate: method is {method!r}, expected {one_of(names)}{hint(method, names)}")
    # Steps of one size were asked for by name only, so dt is answered below.
    chosen = choose(system, t_end, tol if dt is None else None).method if method == "auto" else method
    taken = option_names(chosen)
    if unknown := sorted(set(options) - set(taken)):
        own = list(inspect.signature(simulate).parameters)[2:-1]
        raise ArgumentError(
            f"simulate: method {chosen!r} does not know the option {unknown[0]!r}"
            f"{nearest(unknown[0], (*taken, *own))}; it takes {', '.join(taken) or 'none of its own'}"
        )
    description = method_named(chosen)
    if not description.steps:
        if dt is not None:
            if method != "auto":
                raise ArgumentError(f"simulate: dt was given, but {chosen} has no step; leave it out")
            others = advice(system, steps=True)
            cure = f"leave dt out, or use {others}" if others else "leave dt out: no method with steps treats the scene"
            raise ArgumentError(
                f"simulate: dt was given, but method='auto' takes {chosen} for this scene, which has no step; {cure}"
            )
        wanted = np.linspace(0.0, t_end, 1001) if wanted is None else wanted
    if tol is not None:
        if description.adaptive:
            options = {**options, "tol": tol}
        elif not (description.exact and method == "auto"):
            # Where "auto" takes a method without errors of steps, any tolerance is met.
            has = "no step" if not description.steps else "no steps that follow a tolerance"
            raise ArgumentError(
                f"simulate: tol was given, but {chosen} has {has}; choose {advice(adaptive=True)}, or leave it out"
            )
    step = None if dt is None else number("simulate: dt", dt, positive=True)
    rows = None if probes is None else _probe_rows(scene, probes)
    start, forgotten = None if other is None else scene.initial_state(other), scene.forgotten(other)
    plan = Plan(chosen, t_end, wanted, step, options, rows, start, t_start, forgotten, compiled)
    every = number("simulate: checkpoint_every", checkpoint_every, minimum=0)
    writer = None if checkpoint is None else from_io("checkpoint")(checkpoint, scene)
    return run_plan(scene, plan, progress, writer, every, None)


def _probe_rows(scene: Scene, probes: Mapping[str, Any] | Iterable[Any]) -> ProbeRows | None:
    """Return names and rows of points to be recorded, or None where there are none."""
    if not isinstance(probes, (Point, Iterable)):
        raise ArgumentError(
            f"simulate: probes is {probes!r}, expected points such as beam.at(x), or a dict of names and points"
        )
    named = named_points("simulate: probes", scene, probes)
    return ProbeRows(tuple(named), rows_over(scene.model, scene.bodies, named.values())) if named else None


def _output_times(times: ArrayLike, t_end: float) -> Array:
    """Return where results are wanted, within [0, t_end], checked."""
    wanted = series("simulate: times", times)
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
