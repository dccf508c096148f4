"""What a stepping run looks at to judge itself: states at steps of its own choice, and its contacts at every step.

Neither depends on the times at which results are wanted.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.system import ContactLaws

Array = NDArray[np.float64]

#: Steps at most whose whole states are looked at.
_MOST_STATES = 5000

#: Of longer runs every so many steps are looked at, on the average: a look costs about a third of a step.
_STRIDE = 16

#: States, and entries of states, that are looked at however few the steps are.
_FEWEST_STATES = 16
_ENTRIES = 100_000

#: Every so many of the steps that are looked at, their middles are looked at too.
_MIDDLES = 4

_GOLDEN = 0.6180339887498949


def check_times(t_end: float, dt: float | None, size: int) -> Array:
    """Return the times whose states are looked at, increasing, within [0, t_end].

    Parameters
    ----------
    t_end, dt : float
        In s; dt is None where steps follow a tolerance.
    size : int
        Degrees of freedom.
    """
    most = max(_FEWEST_STATES, _ENTRIES // max(size, 1))
    if dt is None:
        count = min(most, _MOST_STATES // 5)
        return np.append(t_end * _irregular(count), t_end)
    steps = int(np.floor(t_end / dt + 1e-9))
    count = min(steps, _MOST_STATES, max(most, steps // _STRIDE))
    # Irregular, so that no motion is always met in the same phase.
    chosen = np.arange(steps + 1) if count == steps else np.floor(steps * _irregular(count)).astype(np.int64)
    chosen = np.unique(np.append(chosen, steps))
    middles = chosen[chosen < steps][::_MIDDLES] + 0.5
    return np.unique(np.minimum(np.concatenate([chosen * dt, middles * dt, [t_end]]), t_end))


def _irregular(count: int) -> Array:
    """Return numbers in [0, 1), 0 first, one in every interval of a length of 1/count."""
    k = np.arange(count)
    return (k + np.modf(k * _GOLDEN)[0]) / max(count, 1)


class ContactWatch:
    """Looks at the coordinates of all contacts at every step.

    Parameters
    ----------
    laws : ContactLaws
    t_end : float
        In s; later steps do not count.

    Attributes
    ----------
    missed : ndarray of int, shape (n_contacts,)
        Closings between two steps that both found the contact open.
    reach : ndarray, shape (n_contacts,)
        Largest value of ``b.q`` at a step, m.
    power : float
        Largest power that contact springs with an ideal switch took or gave, W.
    """

    def __init__(self, laws: ContactLaws, t_end: float) -> None:
        self.laws, self._until = laws, t_end * (1.0 + 1e-9)
        self.missed = np.zeros(len(laws), dtype=np.int64)
        self.reach = np.full(len(laws), -np.inf)
        self.power = 0.0
        self._last = np.empty((0, 2 * len(laws) + 1))
        self._ideal = np.isinf(laws.resolution)

    def take(self, times: Array, u: Array, rate: Array) -> None:
        """Look at the next steps: coordinates and their rates, each of shape (n_contacts, n_times)."""
        k = int(np.searchsorted(times, self._until, side="right"))
        if not k:
            return
        times, u, rate = times[:k], u[:, :k], rate[:, :k]
        n = self.missed.size
        if self._last.size:
            before = self._last[0]
            self._turns(
                np.array([before[0], times[0]]),
                np.stack([before[1 : n + 1], u[:, 0]], axis=1),
                np.stack([before[n + 1 :], rate[:, 0]], axis=1),
            )
        self._turns(times, u, rate)
        self._last = np.concatenate([times[-1:], u[:, -1], rate[:, -1]])[None, :]
        self.reach = np.maximum(self.reach, np.max(u, axis=1))
        which, when = np.nonzero((u > self.laws.gap[:, None]) & self._ideal[:, None])
        if which.size:
            elastic = self.laws.stiffness[which] * (u[which, when] - self.laws.offset[which])
            power = np.bincount(when, elastic * rate[which, when])
            self.power = max(self.power, float(np.max(np.abs(power))))

    def _turns(self, times: Array, u: Array, rate: Array) -> None:
        """Count where a contact closed and opened, or came near it, between two steps."""
        j, k = np.nonzero((rate[:, :-1] > 0.0) & (rate[:, 1:] < 0.0))
        s0, s1 = u[j, k] - self.laws.gap[j], u[j, k + 1] - self.laws.gap[j]
        r0, r1 = rate[j, k], rate[j, k + 1]
        height = 0.5 * (times[k + 1] - times[k]) * r0 * (r0 / (r0 - r1))
        # A tenth of what the gap function rises within the step is left to the step's own error.
        passed = (s0 <= 0.0) & (s1 <= 0.0) & (s0 + 1.1 * height > 0.0)
        self.missed += np.bincount(j[passed], minlength=self.missed.size)

    def snapshot(self) -> dict[str, Any]:
        """Return what has been seen, as plain data."""
        return {"missed": self.missed, "reach": self.reach, "power": self.power, "last": self._last}

    def go_on(self, saved: dict[str, Any]) -> None:
        """Take over a snapshot of the same run."""
        self.missed, self.reach, self.power, self._last = (
            saved[name] for name in ("missed", "reach", "power", "last")
        )  # fmt: skip
