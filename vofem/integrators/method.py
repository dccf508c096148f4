"""What a method is: its name, its options, what it refuses, what it can do, and the function that runs it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vofem.integrators.base import Solution
    from vofem.system import System


def deferred(module: str, name: str) -> Callable[..., Any]:
    """Return a function that imports a module when it is called, and calls a function of that name in it."""

    def call(*arguments: Any, **named: Any) -> Any:
        return getattr(import_module(module), name)(*arguments, **named)

    return call


def treats_all(system: System) -> str | None:
    """Refuse no system."""
    return None


@dataclass(frozen=True, eq=False)
class Method:
    """A method that `vofem.simulate` can use.

    Parameters
    ----------
    name : str
        The name that a user gives as ``method=``.
    run : callable
        ``run(system, start, t_end, times, *, observer, resume, **arguments)``, which returns a `Solution`; see
        `vofem.integrators.base`. The arguments are the options of the method and, as the flags below say,
        ``dt``, ``tol`` and ``probes``, each of which may be None. See the notes.
    refusal : callable
        Takes a `System`; returns why the method cannot treat it and which method can, or None.
    options : dict
        Names of the options that the method takes beside those of `simulate`, with their defaults.
    steps : bool
        Whether the method has a step size ``dt``.
    adaptive : bool
        Whether it takes ``tol`` and chooses its steps by it.
    records : bool
        Whether it records ``probes`` at every step.
    exact : bool
        Whether it has no error of time steps, and knows the motion at any time.
    conserves : bool
        Whether it keeps the balance of energy at any step size.
    conditional : bool
        Whether it is stable below a critical step only.
    special : bool
        Whether it is made for one law, and refuses scenes without it.
    rank : int, optional
        ``method="auto"`` takes the method of the highest rank that does not refuse the scene; never one without.
    reason : callable, optional
        Takes a `System` that the method does not refuse; returns why "auto" takes it. Without it the reason is what
        the method of the highest rank refuses.

    Notes
    -----
    The arguments of `run` are the same for all methods:

    system : System
    start : State
        The state at t = 0.
    t_end : float
        End of the run, s.
    times : ndarray or None
        Where results are stored, in s. None stores every step; with `tol`, 1001 uniform times.
    dt : float or None
        Step size in s. None takes a thousandth of `t_end` where neither `dt` nor `tol` is given.
    tol : float or None
        Chooses the steps: the estimated errors of all steps together stay below this fraction of the largest
        displacement, which a rough run of a thousand steps finds beforehand. Impacts are resolved. Velocities and
        contact forces are not bounded by it.
    observer : Observer or None
        Called with the time reached.
    resume : dict or None
        A snapshot of the same run, from which the run goes on.
    probes : ProbeRows or None
        Points that are recorded at every step.
    """

    name: str
    run: Callable[..., Solution]
    refusal: Callable[[System], str | None] = treats_all
    options: Mapping[str, Any] = field(default_factory=dict)
    steps: bool = True
    adaptive: bool = False
    records: bool = False
    exact: bool = False
    conserves: bool = False
    conditional: bool = False
    special: bool = False
    rank: int | None = None
    reason: Callable[[System], str] | None = None
