"""Which method "auto" takes and why, and the options that methods take."""

from __future__ import annotations

from dataclasses import dataclass

from vofem._validate import nearest
from vofem.errors import MethodError
from vofem.integrators.method import Method
from vofem.integrators.methods import GENERALIZED_ALPHA
from vofem.integrators.registry import method_named, method_names, methods, ranked
from vofem.system import System


def hint(method: object, names: tuple[str, ...]) -> str:
    """Return what a name that is no method may stand for, for a message, or an empty string."""
    if str(method).lower().startswith(("newmark", "hht", "hilber", "trapezoidal")):
        return f"; Newmark's method, the trapezoidal rule and HHT are settings of {GENERALIZED_ALPHA.name!r}"
    return nearest(method, names)


def option_names(method: str = "auto") -> tuple[str, ...]:
    """Return the names of the options that a method takes, or some method for "auto"."""
    if method in method_names():
        return tuple(method_named(method).options)
    return tuple(sorted({name for known in methods() for name in known.options}))


@dataclass(frozen=True)
class Choice:
    """A method and why it was chosen."""

    method: str
    why: str

    @property
    def description(self) -> Method:
        """What the method is."""
        return method_named(self.method)


def choose(system: System) -> Choice:
    """Return the method that ``method="auto"`` takes: the first in rank that does not refuse the system.

    Raises
    ------
    MethodError
        If all of them refuse it.
    """
    refused: list[tuple[str, str]] = []
    for method in ranked():
        reason = method.refusal(system)
        if reason is None:
            if method.reason is not None:
                return Choice(method.name, method.reason(system))
            why = f"{refused[0][0]} does not apply: {refused[0][1].split('. ')[0]}" if refused else "it applies"
            return Choice(method.name, why)
        refused.append((method.name, reason))
    raise MethodError(f"no method can treat this scene: {'; '.join(f'{name}: {why}' for name, why in refused)}")
