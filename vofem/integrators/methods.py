"""The methods of this package. Their modules are imported when a method runs, or is asked what it refuses."""

from __future__ import annotations

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


EVENT_DRIVEN = Method(
    "event_driven",
    deferred(_EVENTS, "run"),
    deferred(_EVENTS, "refusal"),
    {"max_events": 1_000_000, "pin_fraction": 1e-7, "truncation": None},
    steps=False,
    exact=True,
    rank=30,
    reason=_is_exact,
)

#: Option: whether second runs look for chaos and for errors of steps; see `stepping.nearby`.
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
)

GENERALIZED_ALPHA = Method(
    "generalized_alpha",
    deferred(_STEPPING, "generalized_alpha"),
    _REFUSED_BY_STEPS,
    {"rho_infinity": 0.8, "alpha_m": None, "alpha_f": None, "gamma": None, "newmark_beta": None} | _NEARBY,
    adaptive=True,
    records=True,
)

CENTRAL_DIFFERENCE = Method(
    "central_difference",
    deferred(_STEPPING, "central_difference"),
    _REFUSED_BY_STEPS,
    _NEARBY,
    records=True,
    conditional=True,
)

FORCE_DRIVEN = Method(
    "force_driven",
    deferred(_FORCE, "run"),
    deferred(_FORCE, "refusal"),
    special=True,
    rank=20,
    reason=_follows_the_force,
)

BUILT_IN = (EVENT_DRIVEN, ENERGY_CONSERVING, GENERALIZED_ALPHA, CENTRAL_DIFFERENCE, FORCE_DRIVEN)
