"""Runs a scene: `simulate`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

from numpy.typing import ArrayLike

from vofem._validate import number
from vofem.cards import from_io
from vofem.initial import StateSource
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
    plan = checked_plan(scene, t_end, method, dt, tol, times, probes, options, initial, t_start, compiled)
    every = number("simulate: checkpoint_every", checkpoint_every, minimum=0)
    writer = None if checkpoint is None else from_io("checkpoint")(checkpoint, scene)
    return run_plan(scene, plan, progress, writer, every, None)
