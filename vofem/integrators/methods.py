"""The methods of this package. Their modules are imported when a method runs, or is asked what it refuses."""

from __future__ import annotations

from vofem.integrators.effort import by_critical_steps, by_events, by_steps, nothing
from vofem.integrators.method import Method, deferred
from vofem.system import System

_EVENTS = "vofem.integrators.event_driven"
_FORCE = "vofem.integrators.force_driven"
_STEPPING = "vofem.integrators.stepping.methods"
_REFUSED_BY_STEPS = deferred("vofem.integrators.stepping.refusal", "refusal")


def _is_exact(system: System) -> str:
    return "the scene is linear between contact events and its loads have closed forms: exact up to rounding"


def _follows_the_force(system: System) -> str:
    return f"{system.driven.label} follows Eq. 22, which the applied force drives"


#: Seconds of processor time that compiling takes: of cold less those of warm processes in
#: `python benchmarks/start_up.py first`, which has one contact, with half as much again for methods that step in time,
#: because several laws take twice and all laws three times as long. More digits are not needed: a run in plain Python
#: starts again after so many seconds. With exact figures this takes at most twice the time of the better choice, and
#: with figures that are wrong by a factor f at most 1 + f times. The speed of the machine is therefore not measured.
_BY_EVENTS, _IMPLICIT, _EXPLICIT = 6.0, 4.0, 2.5

EVENT_DRIVEN = Method(
    "event_driven",
    deferred(_EVENTS, "run"),
    deferred(_EVENTS, "refusal"),
    {"max_events": 1_000_000, "pin_fraction": 1e-7, "truncation": None},
    steps=False,
    exact=True,
    rank=30,
    effort=by_events,
    compiling=_BY_EVENTS,
    reason=_is_exact,
)

#: Option: whether a second run from a start nearby shows how quickly errors grow; see `stepping.nearby`.
_NEARBY: dict[str, object] = {"nearby": None}

ENERGY_CONSERVING = Method(
    "energy_conserving",
    deferred(_STEPPING, "energy_conserving"),
    _REFUSED_BY_STEPS,
    _NEARBY,
    adaptive=True,
    records=True,
    conserves=True,
    rank=10,
    effort=by_steps,
    compiling=_IMPLICIT,
)

GENERALIZED_ALPHA = Method(
    "generalized_alpha",
    deferred(_STEPPING, "generalized_alpha"),
    _REFUSED_BY_STEPS,
    {"rho_infinity": 0.8, "alpha_m": None, "alpha_f": None, "gamma": None, "newmark_beta": None} | _NEARBY,
    adaptive=True,
    records=True,
    effort=by_steps,
    compiling=_IMPLICIT,
)

CENTRAL_DIFFERENCE = Method(
    "central_difference",
    deferred(_STEPPING, "central_difference"),
    _REFUSED_BY_STEPS,
    _NEARBY,
    records=True,
    conditional=True,
    effort=by_critical_steps,
    compiling=_EXPLICIT,
)

FORCE_DRIVEN = Method(
    "force_driven",
    deferred(_FORCE, "run"),
    deferred(_FORCE, "refusal"),
    special=True,
    rank=20,
    effort=nothing,
    reason=_follows_the_force,
)

BUILT_IN = (EVENT_DRIVEN, ENERGY_CONSERVING, GENERALIZED_ALPHA, CENTRAL_DIFFERENCE, FORCE_DRIVEN)
