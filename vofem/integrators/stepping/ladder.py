"""Step sizes that follow a tolerance: from the error of a step to the next size, for any method that steps in time.

Sizes are halves of halves of the largest one, and times whole multiples of the
smallest: what a method factors for a size serves whenever that size comes
again, and no time is accumulated. What a step is and how its error is
estimated is the method's business.
"""

from __future__ import annotations

import numpy as np

#: Halvings of the largest step.
RUNGS = 40

#: Steps in a run at the largest step size.
_FEWEST = 32

#: Keeps errors of a scene without motion from being divided by zero.
_TINY = 1e-300

#: Halvings of the largest step with which a run begins.
_FIRST = 6

#: Error over its share below which a step may be doubled.
_EASY = 0.2

#: Steps in a period of a load above which their size may follow its phase.
_MANY = 32


class Ladder:
    """Where a run stands, the size of its next step, and what a step's error does to it.

    Attributes
    ----------
    largest, tick : float
        Largest and smallest size of a step, s.
    now, end : int
        Time reached, and the end of the run, in ticks.
    rung : int
        The next step has the size ``largest / 2**rung``.
    size : float
        Displacement that errors are related to, m.
    forced : int
        Steps that were accepted at the smallest size with an error beyond their share.
    period : float
        Of the fastest load, s. Steps that are large against it grow when all steps of a period allow it, and do not
        follow its phase: the errors of large steps would all be made at the same phase, and add up.
    uneasy : int
        Time in ticks at which a step was refused or near its share for the last time.
    """

    #: What says where a run stands; the rest follows from the plan.
    place: tuple[str, ...] = ("now", "rung", "forced", "size", "uneasy")

    def climb(self, t_end: float, tolerance: float) -> None:
        """Set the end in s and the tolerance."""
        self.t_end, self.tolerance = t_end, tolerance
        self.largest = t_end / _FEWEST
        self.tick = self.largest / 2**RUNGS
        self.now, self.end = 0, _FEWEST * 2**RUNGS
        self.rung, self.forced, self.size = _FIRST, 0, 0.0
        self.period, self.uneasy = 0.0, 0

    @property
    def time(self) -> float:
        """Time at which the next step begins, s."""
        return self.now * self.tick

    @property
    def whole(self) -> float:
        """Error of displacements that all steps together may make, m."""
        return self.tolerance * self.size + _TINY

    @property
    def at_the_bottom(self) -> bool:
        """Whether no smaller step can be taken."""
        return self.rung + 1 >= RUNGS

    def length(self, rung: int) -> float:
        """Return the size in s of a step."""
        return self.largest / 2**rung

    def ratio(self, rough: float, smooth: float) -> float:
        """Return the error of a step in m over its share of the tolerance.

        Errors of motion that the step resolves well point the same way in
        every step: their sum is held. Those of faster motion come and go, and
        halving the step would not lessen them for long: their root mean square is held.
        """
        share = self.length(self.rung) / self.t_end
        return max(smooth / (share * self.whole), rough / (np.sqrt(share) * self.whole))

    def accepts(self, ratio: float) -> bool:
        """Decide on a step by its error over its share; where it is refused the next one is half as long."""
        if not ratio <= 1.0 and not self.at_the_bottom:
            self.rung += 1
            self.uneasy = self.now
            return False
        self.forced += not ratio <= 1.0
        return True

    def step_on(self, ratio: float) -> None:
        """Go on by the step that was accepted, and choose the size of the next one."""
        length = self.length(self.rung)
        self.now += 2 ** (RUNGS - self.rung)
        if not ratio < _EASY:
            self.uneasy = self.now
        patience = self.period / self.tick if self.period < _MANY * length else 0.0
        # The error over the step's length grows fourfold with a doubled step, and times stay multiples of steps.
        aligned = self.rung > 0 and self.now % 2 ** (RUNGS - self.rung + 1) == 0
        if ratio < _EASY and aligned and self.now - self.uneasy >= patience:
            self.rung -= 1
