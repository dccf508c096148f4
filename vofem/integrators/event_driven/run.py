"""The event-driven method: closed form between contact events, certified search for the next one.

The method is exact up to rounding for systems that are linear between events, with loads of closed form and ideal
switches. It has no step size, and therefore no order, no stability limit and no numerical dissipation. Its cost depends
on the number of events and on the slow motion.
"""

from __future__ import annotations

import numpy as np

from vofem._validate import number, whole
from vofem.arrays import Array
from vofem.errors import EventStormError, MethodError
from vofem.integrators.event_driven.flow import follower_of, modal_state, solution_of
from vofem.integrators.event_driven.pinned import PIN_FRACTION
from vofem.integrators.event_driven.solution import EventSolution
from vofem.integrators.event_driven.truncated import (
    FULL_UNKNOWNS,
    TOLERANCE,
    run_truncated,
    too_many_inputs,
)
from vofem.integrators.methods import EVENT_DRIVEN
from vofem.integrators.observer import Observer, Snapshot, advanced
from vofem.integrators.reduction import loss_in_all_modes
from vofem.integrators.registry import advice
from vofem.integrators.rounding import graded
from vofem.integrators.sampled_loads import loads_by_values
from vofem.system import Counters, State, System

#: Above this many degrees of freedom the dense eigensystems would need gigabytes.
MOST_UNKNOWNS = 6000

#: Up to this many degrees of freedom a run uses all modes after all, if Ritz vectors miss a tolerance that the user
#: did not give.
FULL_AFTER_ALL = 3000

#: Above this many degrees of freedom the loss to rounding in all modes is computed. A note says so if it exceeds this
#: size.
_LOSSY = 300
_WORTH_TELLING = 1e-10

MOST_EVENTS = 1_000_000


def refusal(system: System) -> str | None:
    """Return why this method cannot treat the system and what can, or None."""
    found = obstacle(system)
    return None if found is None else ". ".join(filter(None, found))


def obstacle(system: System) -> tuple[str, str] | None:
    """Return why this method cannot treat the system, with changes that help, and what other methods can; or None."""
    sliders, contacts = system.sliders, system.contacts
    if sliders is not None and contacts is not None and (contacts.moving is not None or np.any(contacts.jump)):
        others = advice(system, steps=True)
        return (
            f"{sliders.labels[0]} acts beside contacts that stand in space or act on the displacement, which "
            f"{EVENT_DRIVEN.name} does not treat together; use acts_on='penetration' and stops that stand on the base",
            others and f"Or choose {others}",
        )
    for group in system.laws:
        reason = group.nonlinearity(EVENT_DRIVEN.name)
        if reason is None and group is not system.contacts and group is not sliders:
            reason = f"{group.labels[0]} is no contact, and {EVENT_DRIVEN.name} takes no other laws"
        if reason is not None:
            way = {"special": True} if group.driven is not None else {"steps": True}
            others = advice(system, **way)
            return reason, others and f"Use {others}"
    for load in system.loads:
        if not load.function.closed_form:
            why = f"{load.name} has no closed form, which {EVENT_DRIVEN.name} needs"
            if known := getattr(load.function, "obstacle", ""):
                return f"{why}: {known}", f"Use {advice(conserves=True)}"
            return (
                f"{why}. Ways out: write it with Sine, Ramp, Pulse, Tabulated and their sums; or approximate it, "
                "vf.Approximated(f, t_end, tolerance)",
                f"Or choose {advice(conserves=True)}",
            )
    if system.size > MOST_UNKNOWNS and too_many_inputs(system) is not None:
        return _too_large(system)
    return None


def _too_large(system: System) -> tuple[str, str]:
    why = too_many_inputs(system)
    more, cure = ("", "leave truncation= out") if why is None else (f", and its {why}", "use fewer contacts")
    return (
        f"the system has {system.size} degrees of freedom, {EVENT_DRIVEN.name} takes at most "
        f"{MOST_UNKNOWNS} with all modes{more}. Use fewer elements, or {cure}",
        f"Or choose {advice(conserves=True)}",
    )


def run(
    system: System,
    start: State,
    t_end: float,
    times: Array,
    max_events: int = MOST_EVENTS,
    pin_fraction: float = PIN_FRACTION,
    truncation: float | None = None,
    observer: Observer | None = None,
    resume: Snapshot | None = None,
) -> EventSolution:
    """Simulate from the start state at t = 0 to t_end.

    `t_end`: duration of the run in s.
    `times`: times in s at which results will be computed. The run itself does not depend on them.
    `max_events`: largest number of contact events. A run with more of them raises an error.
    `pin_fraction`: fraction of the gap below which the chatter of a contact that acts on the displacement counts as
    rest at the gap; see `pinned`.
    `truncation`: relative error of displacements up to which Ritz vectors may replace the modes of the system, see
    `truncated`; 0 keeps all modes. The default is `TOLERANCE` above `FULL_UNKNOWNS` degrees of freedom, and 0 below.
    `observer`: a function that is called with the time reached, only in a run in all modes.
    `resume`: a snapshot of the same run, from which it is continued.
    Raises `MethodError` if a load has no closed form, a switch is not ideal, or the system is too large.
    Raises `EventStormError` if events follow each other without end.
    """
    max_events = whole("simulate: max_events", max_events)
    pin_fraction = number("simulate: pin_fraction", pin_fraction, positive=True)
    if truncation is not None:
        truncation = number("simulate: truncation", truncation, minimum=0)
    reason = refusal(system)
    if reason is not None:
        raise MethodError(reason)
    asked = truncation is not None
    rigid = system.contacts is not None and bool(system.contacts.rigid.any())
    if rigid and truncation:
        raise MethodError(
            "simulate: truncation: a rigid stop needs all modes, whose inertia an impact meets; leave it out"
        )
    if rigid:
        truncation = 0.0
    if truncation is None:
        truncation = TOLERANCE if system.size > FULL_UNKNOWNS and too_many_inputs(system) is None else 0.0
    if truncation > 0.0 and resume is None:

        def follow(reduced: System, begin: State) -> EventSolution:
            return _follow(reduced, begin, t_end, times, max_events, pin_fraction)

        truncated = run_truncated(system, start, t_end, truncation, follow)
        kept = None if truncated is None else truncated.truncation
        if (
            truncated is not None
            and kept is not None
            and (asked or kept.error <= truncation or system.size > FULL_AFTER_ALL)
        ):
            truncated.notes += loads_by_values(system, t_end)
            return truncated
    if system.size > MOST_UNKNOWNS:
        raise MethodError(". ".join(_too_large(system)))
    solution = _follow(system, start, t_end, times, max_events, pin_fraction, observer, resume)
    solution.notes += loads_by_values(system, t_end)
    if system.size > _LOSSY or graded(system):
        space = solution.space
        loss = system.cache.get(
            "loss in all modes", None, lambda: loss_in_all_modes(system, space.stiffness, space.shapes)
        )
        if loss is not None and loss > _WORTH_TELLING:
            solution.notes.insert(
                0,
                f"rounding: in all {system.size} modes static responses are off by {loss:.1e}, and motion against "
                "stiff contacts by more; truncation=1e-8, say, loses less",
            )
    return solution


def _follow(
    system: System, start: State, t_end: float, times: Array, max_events: int, pin_fraction: float,
    observer: Observer | None = None, resume: Snapshot | None = None,
) -> EventSolution:  # fmt: skip
    """Follow all modes of a system from event to event."""
    counters = Counters()
    solution = solution_of(system, t_end, times, counters)
    space = solution.space
    if resume is None:
        displacement, velocity = modal_state(system, space, start)
        t, status = 0.0, solution.begin(start, displacement, velocity, pin_fraction)
    else:
        t, status, displacement, velocity = solution.go_on(resume)
    follower = follower_of(solution, t, status, displacement, velocity, pin_fraction, max_events)

    def snapshot() -> Snapshot:
        return solution.snapshot(follower.time, follower.status, follower.displacement, follower.velocity)

    def advance() -> None:
        follower.advance()
        if solution.counters.events > max_events:
            raise EventStormError(_storm(system, solution, follower.time, max_events))

    if not advanced(advance, lambda: follower.time >= t_end, lambda: follower.time, snapshot, observer):
        solution.cut(follower.time)
    solution.conclude()
    return solution


def _storm(system: System, solution: EventSolution, t: float, limit: int) -> str:
    if system.contacts is None or not solution.events.time.size:
        return f"more than {limit} events of sliders by t = {t:.6g} s. Raise max_events or end the run earlier"
    laws = system.contacts
    busy = int(np.bincount(solution.events.contact).argmax())
    cure = ""
    if laws.rigid[busy]:
        cure = (
            f"; the nearer restitution, here {laws.restitution[busy]:g}, is to 1, the more often a body that is "
            "pressed on its stop bounces before it rests"
        )
    elif laws.jump[busy]:
        cure = "; where the contact chatters, raise pin_fraction, below which chatter counts as rest at the gap"
    return (
        f"more than {limit} contact events by t = {t:.6g} s, most of them of {laws.labels[busy]}. Raise max_events or "
        f"end the run earlier{cure}"
    )
