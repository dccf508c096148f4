"""What no method that steps in time can treat."""

from __future__ import annotations

from vofem.integrators.damping_matrix import too_full
from vofem.integrators.registry import advice
from vofem.system import System


def refusal(system: System) -> str | None:
    """Return why methods that step in time cannot treat the system and what can, or None."""
    return follows_the_force(system) or too_full(system) or _rigid(system) or _slides(system)


def _slides(system: System) -> str | None:
    """Return why steps cannot treat the sliders; None where they can, and without any."""
    if system.sliders is None:
        return None
    from vofem.integrators.stepping.sliding import refusal as of_sliders

    return of_sliders(system.sliders, system)


def _rigid(system: System) -> str | None:
    """Return why methods that step in time cannot treat rigid stops; None without any."""
    return None if system.contacts is None else system.contacts.rigid_refusal("a method that steps in time")


def follows_the_force(system: System) -> str | None:
    """Return why methods that step in time cannot treat the law that is printed in the paper; None without one."""
    if system.driven is None:
        return None
    others = advice(system, special=True)
    return (
        f"{system.driven.label} with memory='printed' is Eq. 22, which the applied force drives; "
        f"{others and f'{others} follows it, and '}methods that step in time take memory='cyclic'"
    )
