"""Records of a stepping run for its own checks: states at some steps, and findings on contacts from every step.

Neither depends on the times at which results are wanted.
"""

from __future__ import annotations

import numpy as np

from vofem.arrays import Array
from vofem.system import ContactLaws

#: Largest number of steps whose whole states are checked.
_MOST_STATES = 1000

#: In longer runs one step in so many is checked, on the average: a check costs about as much as a step.
_STRIDE = 64

#: Number of states, and of entries of states, that are checked however few the steps are.
_FEWEST_STATES = 16
_ENTRIES = 20_000

#: One of so many checked steps is checked at its middle too.
_MIDDLES = 4

_GOLDEN = 0.6180339887498949


def check_times(t_end: float, dt: float | None, size: int) -> Array:
    """Return the times whose states are checked, increasing, within [0, t_end].

    `t_end`, `dt`: end of the run and size of a step, s; dt is None where steps follow a tolerance.
    `size`: degrees of freedom.
    """
    most = max(_FEWEST_STATES, _ENTRIES // max(size, 1))
    if dt is None:
        count = min(most, _MOST_STATES)
        return np.append(t_end * _irregular(count), t_end)
    steps = int(np.floor(t_end / dt + 1e-9))
    count = min(steps, _MOST_STATES, max(most, steps // _STRIDE))
    # Irregular times, so that a periodic motion is not always checked in the same phase.
    chosen = np.arange(steps + 1) if count == steps else np.floor(steps * _irregular(count)).astype(np.int64)
    chosen = np.unique(np.append(chosen, steps))
    middles = chosen[chosen < steps][::_MIDDLES] + 0.5
    return np.unique(np.minimum(np.concatenate([chosen * dt, middles * dt, [t_end]]), t_end))


def _irregular(count: int) -> Array:
    """Return numbers in [0, 1), 0 first, one in every interval of a length of 1/count."""
    k = np.arange(count)
    return (k + np.modf(k * _GOLDEN)[0]) / max(count, 1)


#: Columns of the record of a contact: its data, the last step, and the findings.
_GAP, _STIFFNESS, _OFFSET, _S, _RATE, _BEFORE, MISSED, PEAK, LOWEST, POWER, DRIFT = range(11)


def contact_checks(laws: ContactLaws | None) -> Array:
    """Return the record that a run keeps of every contact from step to step, shape (n_contacts, 11).

    Five columns hold findings. MISSED counts the closings between two steps
    at which the contact was open. PEAK and LOWEST are the largest and the least
    value of ``b.q - gap`` at a step, m. POWER is the largest power that a contact
    spring with an ideal switch absorbed or released, W. DRIFT is the sum of the
    errors of all steps in ``b.q``, m: within a step the velocity is taken as
    linear in time, which leaves out ``dt^3/12`` times its second derivative.
    """
    if laws is None:
        return np.empty((0, 11))
    table = np.zeros((len(laws), 11))
    table[:, _GAP], table[:, _OFFSET] = laws.gap, laws.offset
    table[:, _STIFFNESS] = np.where(np.isinf(laws.resolution), laws.stiffness, 0.0)
    # No step before the first one: comparisons with NaN are false.
    table[:, _S:MISSED], table[:, PEAK], table[:, LOWEST] = np.nan, -np.inf, np.inf
    return table


def check_contacts(table: Array, u: Array, rates: Array, dt: Array, first: int, last: int) -> None:
    """Update the record of all contacts by rows `first` to `last` of their coordinates and rates, (n_rows, n_laws).

    `dt`, shape (n_rows,), holds the sizes of the steps that end there, s.
    """
    m, count = table.shape[0], last + 1 - first
    if not m or not count:
        return
    u, rate = u[first : last + 1, :m], rates[first : last + 1, :m]
    s, h = u - table[:, _GAP], dt[first : last + 1, None]
    gaps = np.concatenate([table[None, :, _S], s])
    rates = np.concatenate([table[None, :, _BEFORE], table[None, :, _RATE], rate])
    with np.errstate(invalid="ignore", over="ignore"):
        away, towards, closed = rates[1:-1] > 0.0, rate < 0.0, s > 0.0
        step, contact = np.nonzero(away & towards & ~closed)
        if step.size:
            s0, r0, r1 = gaps[step, contact], rates[step + 1, contact], rate[step, contact]
            # The error of the step may be a tenth of the rise of the gap function within the step.
            missed = (s0 <= 0.0) & (s0 + 0.55 * h[step, 0] * r0 * (r0 / (r0 - r1)) > 0.0)
            np.add.at(table[:, MISSED], contact[missed], 1.0)
        change = np.diff(rates, axis=0)
        bend = np.abs(np.diff(change, axis=0), out=change[1:])
        # There is no rate before the first one.
        bend[:2][np.isnan(bend[:2])] = 0.0
        table[:, DRIFT] += h[:, 0] @ bend / 12.0
        table[:, PEAK] = np.fmax(table[:, PEAK], np.max(s, axis=0))
        table[:, LOWEST] = np.fmin(table[:, LOWEST], np.min(s, axis=0))
        step, contact = np.nonzero(closed)
        if step.size:
            power = table[contact, _STIFFNESS] * (u[step, contact] - table[contact, _OFFSET]) * rate[step, contact]
            np.fmax.at(table[:, POWER], contact, np.abs(power))
    table[:, _S], table[:, _RATE], table[:, _BEFORE] = s[-1], rate[-1], rates[-2]
