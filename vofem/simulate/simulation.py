"""Runs a scene: `simulate`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

from numpy.typing import ArrayLike

from vofem._validate import number
from vofem.initial import StateSource
from vofem.persistence import store
from vofem.progress import Progress
from vofem.result import Result
from vofem.scene import Scene
from vofem.simulate.arguments import checked_plan
from vofem.simulate.plan import run_plan


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

    What does not depend on the start or on time, such as matrices, vibration
    modes and factorisations, is computed in the first run of a scene and kept
    with it: runs of the same scene that follow begin at once.

    Parameters
    ----------
    scene : Scene
    t_end : float
        Duration in s, positive.
    initial : dict, Equilibrium or Result, optional
        What the run begins with instead of the scene's own ``initial``: a dict
        as in `Scene`, the outcome of `vofem.equilibrium`, or an earlier run,
        whose state at its last time is taken, not its time. Bodies and springs
        are matched by name, so that the outcome may be that of another scene.
    t_start : float
        Time of the loads at which the run begins, s: a load is
        ``function(t_start + t)``, and so is an order of a springpot that varies.
        Times of the run and of its result count from 0 all the same.
    method : {"auto", "event_driven", "energy_conserving", "generalized_alpha", "central_difference", "force_driven"}
        "auto" takes event_driven, which is exact up to rounding, where it
        applies, and else energy_conserving, which is stable at any step;
        force_driven is for ``HystereticSpring(memory="printed")`` alone;
        `vofem.explain` says what it chooses and why.
    dt : float, optional
        Step size in s of a stepping method; chosen where not given.
    tol : float, optional
        Of energy_conserving and generalized_alpha: chooses the steps. The errors of displacements
        that all steps make together, estimated, stay below this fraction of
        the largest displacement; impacts may magnify what was made before
        them. Steps resolve every impact, however stiff the stop, but
        velocities, accelerations and contact forces are not bounded. "auto"
        accepts it with event_driven too, which has no error of steps.
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
    compiled : bool, optional
        Whether the numerical kernels run as machine code (True) or as plain
        Python (False). Results agree to rounding. Without it plain Python is
        taken while the work is small, and machine code where it is there
        already or pays for being compiled, which takes up to a minute once on
        a machine; `Result.compiled` tells what was taken. Give it where two
        processes shall return the same bits.
    **options
        Of event_driven: ``max_events`` (a million); ``pin_fraction``, the
        fraction of the gap below which chatter counts as rest (1e-7); and
        ``truncation``, the relative error of displacements for which few Ritz
        vectors may stand for a large system (1e-6 above 1000 degrees of
        freedom; 0 keeps all modes, which small systems do anyway). Of
        generalized_alpha: ``rho_infinity`` in [0, 1] (0.8), or ``alpha_m``,
        ``alpha_f``, ``gamma``, ``newmark_beta`` in place of what it implies.
        Of all three methods with a step size ``dt``: ``nearby``, whether a
        second run from a start nearby looks for chaos, which takes as long as
        the run (None: where that is less than a second).

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
    plan = checked_plan(scene, t_end, method, dt, tol, times, probes, options, initial, t_start, compiled)
    every = number("simulate: checkpoint_every", checkpoint_every, minimum=0)
    writer = None if checkpoint is None else store().snapshots(checkpoint, scene)
    return run_plan(scene, plan, progress, writer, every, None)
