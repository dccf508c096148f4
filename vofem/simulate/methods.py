"""The methods, the options that they take, and which of them "auto" takes."""

from __future__ import annotations

from dataclasses import dataclass

from vofem._validate import nearest
from vofem.laws import PrintedLaws
from vofem.system import System

METHODS = ("event_driven", "energy_conserving", "generalized_alpha", "central_difference", "force_driven")

#: Options that a method takes beside those of `simulate`.
_OPTIONS: dict[str, tuple[str, ...]] = {
    "event_driven": ("max_events", "pin_fraction", "truncation"),
    "energy_conserving": (),
    "generalized_alpha": ("rho_infinity", "alpha_m", "alpha_f", "gamma", "newmark_beta"),
    "central_difference": (),
    "force_driven": (),
}


def hint(method: object, names: tuple[str, ...]) -> str:
    """Return what a name that is no method may stand for, for a message, or an empty string."""
    if str(method).lower().startswith(("newmark", "hht", "hilber", "trapezoidal")):
        return "; Newmark's method, the trapezoidal rule and HHT are settings of 'generalized_alpha'"
    return nearest(method, names)


def option_names(method: str = "auto") -> tuple[str, ...]:
    """Return the names of the options that a method takes, or some method for "auto"."""
    return _OPTIONS[method] if method in _OPTIONS else tuple(sorted({n for names in _OPTIONS.values() for n in names}))


@dataclass(frozen=True)
class Choice:
    """A method and why it was chosen."""

    method: str
    why: str


def choose(system: System) -> Choice:
    """Return the method that ``method="auto"`` takes: the most accurate one that applies."""
    printed = system.group(PrintedLaws)
    if printed is not None:
        return Choice("force_driven", f"{printed.law.label} follows Eq. 22, which the applied force drives")
    from vofem.integrators import event_driven

    reason = event_driven.refusal(system)
    if reason is None:
        return Choice(
            "event_driven",
            "the scene is linear between contact events and its loads have closed forms: exact up to rounding",
        )
    return Choice("energy_conserving", f"event_driven does not apply: {reason.split('. ')[0]}")
