"""What a stepping run tells of itself at its end: energy, steps that are too large, contacts missed, rounding."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.base import Energies, Samples
from vofem.integrators.rounding import static_loss
from vofem.system import ContactLaws, System

Array = NDArray[np.float64]

#: What is missing from the balance of energy, over the largest energy, that is worth telling.
_ENERGY = 0.01

#: ``omega dt`` of the motion that carries the energy beyond which steps do not resolve it.
_COARSE = 0.5

#: Loss of static responses to rounding that is worth telling.
_ROUNDING = 1e-6

#: Times at most that are looked at.
_MOST_TIMES = 5000


def tell(
    system: System, method: str, times: Array, samples: Samples, parts: Energies, first: float, dt: float | None
) -> list[str]:
    """Return notes on a run from its stored times.

    Parameters
    ----------
    system : System
    method : str
    times : ndarray, shape (n_times,)
    samples : Samples
    parts : Energies
        In the method's own form, `first` at t = 0.
    dt : float, optional
        In s; None where steps follow a tolerance.
    """
    notes: list[str] = []
    laws = system.contacts
    total = parts.kinetic + parts.strain + parts.contact
    scale = max(float(np.max(np.abs(part), initial=0.0)) for part in (total, parts.work, parts.dissipated))
    if not 0.0 < scale < np.inf:
        return notes
    # Between steps the motion is interpolated, which says nothing of the method's own balance.
    on = np.abs(times / dt - np.round(times / dt)) < 1e-6 if dt is not None else times >= 0.0
    if method != "energy_conserving" and np.any(on):
        missing = (total - first + parts.dissipated - parts.work)[on] / scale
        notes += _energy(times[on], missing)
    if dt is not None:
        notes += _coarse(system, samples, scale, dt)
        if laws is not None:
            notes += _missed(laws, samples, times, dt)
    loss = static_loss(system)
    if loss > _ROUNDING:
        notes.append(
            f"rounding: static responses are off by {loss:.1e} in {method} on this mesh of {system.size} unknowns, "
            "slow motion by up to as much; use fewer elements or a mesh less graded, or choose method='event_driven', "
            "which loses less"
        )
    return notes


def _energy(times: Array, missing: Array) -> list[str]:
    """Return a note where the balance of energy does not hold."""
    worst = int(np.argmax(np.abs(missing)))
    if abs(missing[worst]) <= _ENERGY:
        return []
    how = "lost by the steps" if missing[worst] < 0.0 else "made out of nothing"
    return [
        f"energy: by t = {times[worst]:.4g} s {abs(missing[worst]):.2g} of the largest energy was {how}; reduce dt, or "
        "choose method='energy_conserving', which keeps it at any step"
    ]


def _coarse(system: System, samples: Samples, scale: float, dt: float) -> list[str]:
    """Return a note where steps are too large: ``dt |v'(K q + b R)|`` over the energy is omega dt of its motion."""
    stride = -(-samples.q.shape[1] // _MOST_TIMES)
    q, v = samples.q[:, ::stride], samples.v[:, ::stride]
    power = np.sum(v * (system.stiffness @ q), axis=0)
    if system.contacts is not None:
        laws = system.contacts
        u, rate = laws.rows @ q, laws.rows @ v
        closed = (u > laws.gap[:, None]) & np.isinf(laws.resolution)[:, None]
        power += np.sum(np.where(closed, laws.elastic(u) * rate, 0.0), axis=0)
    share = dt * float(np.max(np.abs(power), initial=0.0)) / scale
    if not share > _COARSE:
        return []
    return [
        f"step: steps of {dt:.4g} s do not resolve the motion, in which energy changes its form up to {share:.2g} "
        "times over within one; positions and contact forces are not accurate then. Reduce dt, or choose "
        "method='event_driven' where it applies"
    ]


def _missed(laws: ContactLaws, samples: Samples, times: Array, dt: float) -> list[str]:
    """Return a note where a contact closed and opened, or came near it, between two steps that are both stored."""
    width = np.diff(times)
    if not width.size or float(np.max(width)) > 1.000001 * dt:
        return []
    missed, where = 0, ""
    for j in range(len(laws)):
        row = laws.rows[[j]]
        s, rate = (row @ samples.q)[0] - laws.gap[j], (row @ samples.v)[0]
        turn = (s[:-1] <= 0.0) & (s[1:] <= 0.0) & (rate[:-1] > 0.0) & (rate[1:] < 0.0)
        r0, r1 = rate[:-1][turn], rate[1:][turn]
        part = r0 / (r0 - r1)
        height = 0.5 * width[turn] * r0 * part
        # A tenth of what the gap function rises within the step is left to the step's own error.
        count = int(np.sum(s[:-1][turn] + 1.1 * height > 0.0))
        if count and not missed:
            where = laws.names[j]
        missed += count
    if not missed:
        return []
    return [
        f"contacts: {missed} closings shorter than a step, the first of contact {where!r}, were or may have been "
        "passed over; reduce dt, or choose method='event_driven', which misses none"
    ]
