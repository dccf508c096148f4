"""The notes of a stepping run on its own quality: energy, steps that are too large, missed closings, rounding.

The notes do not depend on the times at which results are wanted. They use
states at steps that the run chooses itself, and every contact at every step
(`checks`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.base import Energies, Samples
from vofem.integrators.method import Method
from vofem.integrators.registry import advice
from vofem.integrators.rounding import static_loss
from vofem.integrators.stepped import step_count
from vofem.integrators.stepping.checks import DRIFT, LOWEST, MISSED, PEAK, POWER
from vofem.integrators.stepping.energies import kinetic_energy
from vofem.integrators.unclosed import never_closed
from vofem.system import ContactLaws, Events, System

#: Error of the balance of energy at a step, over the largest energy, above which there is a note.
_ENERGY = 0.01

#: The same between two steps, where states are interpolated.
_BETWEEN = 0.1

#: Largest energy, over the largest kinetic energy, that is rounding.
_NO_ENERGY = 1e-12

#: ``omega dt`` of the motion that carries the energy beyond which steps do not resolve it.
_COARSE = 0.5

#: Largest energy of a contact, relative to that of the run, above which a note reports rebounds with a wrong velocity:
#: velocities are as its square root.
_REBOUND = 4e-4

#: Errors of steps, over the motion of a contact, above which there is a note.
_DRIFT = 0.03

#: Motion of a contact, over its largest distance from the gap, that may be rounding.
_AT_REST = 1e-9

#: Relative loss of static responses to rounding above which there is a note.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Checked:
    """What a run has recorded for its checks."""

    #: In s; those of `checks.check_times` up to the end of the run, or to its interruption. Shape (n_times,).
    times: Array
    samples: Samples  #: States at `times`.
    parts: Energies  #: Energies at `times`, in the form that the method balances.
    contacts: Array  #: Findings on every contact, of `checks.contact_checks`, shape (n_contacts, 11).
    #: Largest error in J of the balance of energy between chunks of steps, and its time in s; for methods that conserve
    #: energy at their steps.
    missing: tuple[float, float]


def quality_notes(
    system: System, method: Method, checked: Checked, events: Events, first: float, dt: float | None, t_end: float
) -> list[str]:
    """Return notes on a run.

    `first`: energy at t = 0 in the method's own form, J.
    `dt`: size of a step, s; None where steps follow a tolerance.
    `t_end`: end of the run, s.
    """
    notes: list[str] = []
    if dt is not None and step_count(t_end, dt) == 1:
        notes.append(
            f"step: the whole run of {t_end:.4g} s is one step of {dt:.4g} s, which resolves no motion within it; "
            f"choose dt well below {t_end:.4g} s, or leave it out"
        )
    laws = system.contacts
    if laws is not None:
        notes += never_closed(laws, events, laws.gap + checked.contacts[:, PEAK])
    parts, times = checked.parts, checked.times
    # Between steps states are interpolated, so their energy is not the one that the method balances.
    on = np.abs(times / dt - np.round(times / dt)) < 1e-6 if dt is not None else np.ones(times.size, dtype=bool)
    total = parts.kinetic + parts.strain + parts.contact
    scale = max(float(np.max(np.abs(part[on]), initial=0.0)) for part in (total, parts.work, parts.dissipated))
    # A method's own form of energy may differ from the usual one, and be zero but for rounding in the first step.
    if not _NO_ENERGY * float(np.max(kinetic_energy(system, checked.samples.v), initial=0.0)) < scale < np.inf:
        return notes
    missing = (total - first + parts.dissipated - parts.work) / scale
    if dt is None:
        on = times <= 0.0
    at_steps = _worst(times[on], missing[on])
    if abs(checked.missing[0]) > abs(at_steps[0]) * scale:
        at_steps = checked.missing[0] / scale, checked.missing[1]
    notes += _energy(method, *at_steps, dt)
    coarse = _coarse(system, checked, on, scale, dt) if dt is not None else []
    notes += coarse
    if not coarse and abs(at_steps[0]) <= _ENERGY:
        notes += _interpolated(*_worst(times[~on], missing[~on]), dt)
    if laws is not None:
        if dt is not None and not coarse and not method.conserves:
            notes += _rebounds(laws, checked.contacts, scale, dt)
        if dt is not None and not coarse:
            notes += _drift(laws, checked, float(np.max(np.abs(total))), dt)
        notes += _missed(laws, checked.contacts[:, MISSED], dt)
    loss = static_loss(system)
    if loss > _ROUNDING:
        notes.append(
            f"rounding: static responses are off by {loss:.1e} in {method.name} on this mesh of {system.size} "
            f"unknowns, slow motion by up to as much; use fewer elements or a mesh less graded, or choose "
            f"{advice(exact=True)}, which loses less"
        )
    return notes


def _worst(times: Array, missing: Array) -> tuple[float, float]:
    """Return the entry of largest magnitude and its time, zeros where there is none."""
    if not missing.size:
        return 0.0, 0.0
    worst = int(np.argmax(np.abs(missing)))
    return float(missing[worst]), float(times[worst])


def _smaller(dt: float | None) -> str:
    return "reduce tol" if dt is None else "reduce dt"


def _energy(method: Method, missing: float, t: float, dt: float | None) -> list[str]:
    """Return a note where the balance of energy does not hold at steps."""
    if abs(missing) <= _ENERGY:
        return []
    how = "lost by the steps" if missing < 0.0 else "made out of nothing"
    cure = f"{_smaller(dt)}, or choose {advice(exact=True)} where it applies"
    if not method.conserves:
        cure = f"{_smaller(dt)}, or choose {advice(conserves=True)}, which keeps it at any step"
    return [f"energy: by t = {t:.4g} s {abs(missing):.2g} of the largest energy was {how}; {cure}"]


def _interpolated(missing: float, t: float, dt: float | None) -> list[str]:
    """Return a note where states between steps do not have the energy of those at steps."""
    if abs(missing) <= _BETWEEN:
        return []
    return [
        f"interpolation: between steps states are interpolated, and near t = {t:.4g} s these are off by "
        f"{abs(missing):.2g} of the largest energy; {_smaller(dt)}"
        + ("" if dt is None else ", or name times on steps in times=")
    ]


def _coarse(system: System, checked: Checked, on: NDArray[np.bool_], scale: float, dt: float) -> list[str]:
    """Return a note where steps are too large: ``dt |v'(K q + b R)|`` over the energy is omega dt of its motion."""
    q, v = checked.samples.q[:, on], checked.samples.v[:, on]
    power = np.sum(v * (system.stiffness @ q), axis=0)
    largest = 0.0
    if system.contacts is not None:
        laws = system.contacts
        u, rate = laws.coordinates(q, checked.times[on]), laws.rates(q, v, checked.times[on])
        closed = (u > laws.gap[:, None]) & np.isinf(laws.resolution)[:, None]
        power += np.sum(np.where(closed, laws.elastic(u) * rate, 0.0), axis=0)
        largest = float(np.max(checked.contacts[:, POWER]))
    share = dt * max(float(np.max(np.abs(power), initial=0.0)), largest) / scale
    if not share > _COARSE:
        return []
    return [
        f"step: steps of {dt:.4g} s do not resolve the motion, in which energy changes its form up to {share:.2g} "
        "times over within one; positions and contact forces are not accurate then. Reduce dt, or choose "
        f"{advice(exact=True)} where it applies"
    ]


def _rebounds(laws: ContactLaws, contacts: Array, scale: float, dt: float) -> list[str]:
    """Return a note where impacts are too short for a method that does not conserve energy at them.

    A contact whose energy is a small part of the whole may decide the motion of the body that it stops.
    """
    energy = laws.closed_energies(np.maximum(contacts[:, PEAK], 0.0))
    share = np.where(energy > 0.0, dt * contacts[:, POWER] / np.where(energy > 0.0, energy, 1.0), 0.0)
    share[energy < _REBOUND * scale] = 0.0
    worst = int(np.argmax(share))
    if not share[worst] > _COARSE:
        return []
    return [
        f"step: impacts on contact {laws.names[worst]!r} are not resolved by steps of {dt:.4g} s: within one its "
        f"energy changes {share[worst]:.2g} times over, and what rebounds has a wrong velocity. Choose a dt of "
        f"{0.2 * dt / share[worst]:.2g} s or less, or {advice(conserves=True)}, which loses no energy in an impact"
    ]


def _drift(laws: ContactLaws, checked: Checked, energy: float, dt: float) -> list[str]:
    """Return a note where the errors of all steps together move a contact by a noticeable part of its motion.

    Dampers end the effect of an error after the time in which they take twice the energy that there is.
    """
    lost = max(float(np.max(np.abs(checked.parts.dissipated))), 2.0 * energy)
    peak, drift = checked.contacts[:, PEAK], checked.contacts[:, DRIFT]
    low = checked.contacts[:, LOWEST]
    moves = (peak > 0.0) & (peak - low > _AT_REST * np.maximum(peak, -low))
    moved = np.where(moves, 2.0 * energy / lost * drift / np.where(moves, peak - low, 1.0), 0.0)
    worst = int(np.argmax(moved))
    if not moved[worst] > _DRIFT:
        return []
    return [
        f"step: the errors of steps of {dt:.4g} s add up to {moved[worst]:.2g} of the motion of contact "
        f"{laws.names[worst]!r} by the end of the run, so its later closings may be wrong or missing; reduce dt, or "
        f"choose {advice(exact=True)} where it applies"
    ]


def _missed(laws: ContactLaws, counts: Array, dt: float | None) -> list[str]:
    """Return a note where a contact closed and opened, or came near it, between two steps."""
    missed = int(np.sum(counts))
    if not missed:
        return []
    where = laws.names[int(np.argmax(counts > 0))]
    return [
        f"contacts: {missed} closings shorter than a step, the first of contact {where!r}, were or may have been "
        f"passed over; {_smaller(dt)}, or choose {advice(exact=True)}, which misses none"
    ]
