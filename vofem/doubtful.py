"""What a scene may hold and its user hardly means: notes, no errors."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from vofem.system import System
from vofem.time_functions import Sine, Tabulated
from vofem.time_functions.parts import parts_of


def doubtful(system: System, t_end: float) -> list[str]:
    """Return notes on loads and damping that are allowed and rarely meant.

    `t_end`: time of the loads at which the run ends, s.
    """
    notes = [note for load in system.loads for note in _of_load(load.name, load.function, t_end)]
    ratio = 0.0 if system.modal_damping is None else float(np.max(system.modal_damping))
    if ratio > 1.0:
        notes.append(
            f"scene: ModalDamping of {ratio:g} is {ratio:g} times the critical one, and no mode with it oscillates; "
            f"{ratio:g} percent of critical damping is ModalDamping({ratio / 100.0:g})"
        )
    return notes


def undamped(system: System) -> list[str]:
    """Return a note where nothing in a scene takes energy from a steady state."""
    contacts = system.contacts
    lossy = contacts is not None and np.any((contacts.damping > 0.0) | (contacts.restitution < 1.0))
    if system.damped or system.recorded or system.sliders is not None or lossy:
        return []
    return [
        "scene: nothing damps the motion, so no orbit attracts its neighbours, and resonances are not bounded; add "
        "RayleighDamping, ModalDamping or a Dashpot if the structure has losses"
    ]


def _of_load(name: str, function: Any, t_end: float) -> Iterator[str]:
    for part in parts_of(function):
        if isinstance(part, Sine) and part.omega == 0.0 and part.amplitude != 0.0:
            value = float(part(0.0))
            yield (
                f"scene: a Sine of {name} has the frequency 0 and is the constant {value:g}; give omega= in rad/s or "
                "frequency= in Hz, or write Constant"
            )
        if isinstance(part, Tabulated) and part.values.size > 1 and part.t[-1] < t_end * (1.0 - 1e-9):
            # Two equal values at the end say that the load is to stay.
            last = float(part.values[-1])
            if last not in (0.0, float(part.values[-2])):
                yield (
                    f"scene: the table of {name} ends at {part.t[-1]:g} s with the value {last:g}, which the load "
                    f"keeps until the run ends at {t_end:g} s; add a time with the value 0 to end it, or with the "
                    f"value {last:g} to keep it"
                )
