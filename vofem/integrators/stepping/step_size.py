"""The choice of step sizes under a tolerance: the error of a step decides on the size of the next one.

The largest size is halved some times: a step has one of 41 sizes. A matrix that
a method has factored for a size can therefore be used again. All times are whole
multiples of the smallest size, so no rounding accumulates. This module knows
errors only; the method takes the steps and estimates their errors (`tolerance`).
"""

from __future__ import annotations

import numpy as np

#: Halvings of the largest step.
HALVINGS = 40

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


class StepSizeControl:
    """The time that a run has reached, the size of its next step, and the decision on a step by its error.

    `largest`, `tick`: largest and smallest size of a step, s.
    `ticks`, `last_tick`: time reached, and the end of the run, in units of `tick`.
    `level`: the next step has the size ``largest / 2**level``.
    `size_of_motion`: displacement that errors are related to, m.
    `forced`: steps that were accepted at the smallest size with an error beyond their share.
    `period`: of the fastest load, s. Steps that are large against it grow when all steps of a period allow it, and do
    not follow its phase: the errors of large steps would all be made at the same phase, and add up.
    `last_hard`: time, in units of `tick`, at which a step was last refused or had an error near its share.
    """

    #: Attributes that change during a run; the others follow from its arguments.
    place: tuple[str, ...] = ("ticks", "level", "forced", "size_of_motion", "last_hard")

    def set_range(self, t_end: float, tolerance: float) -> None:
        """Set the end in s and the tolerance."""
        self.t_end, self.tolerance = t_end, tolerance
        self.largest = t_end / _FEWEST
        self.tick = self.largest / 2**HALVINGS
        self.ticks, self.last_tick = 0, _FEWEST * 2**HALVINGS
        self.level, self.forced, self.size_of_motion = _FIRST, 0, 0.0
        self.period, self.last_hard = 0.0, 0

    @property
    def time(self) -> float:
        """Time at which the next step begins, s."""
        return self.ticks * self.tick

    @property
    def whole(self) -> float:
        """Error of displacements that all steps together may make, m."""
        return self.tolerance * self.size_of_motion + _TINY

    @property
    def at_smallest(self) -> bool:
        """Whether no smaller step can be taken."""
        return self.level + 1 >= HALVINGS

    def length(self, level: int) -> float:
        """Return the size in s of a step."""
        return self.largest / 2**level

    def ratio(self, rough: float, smooth: float) -> float:
        """Return the error of a step in m over its share of the tolerance.

        Errors of motion that the step resolves well point the same way in
        every step: their sum is held. Those of faster motion come and go, and
        halving the step would not lessen them for long: their root mean square is held.
        """
        share = self.length(self.level) / self.t_end
        return max(smooth / (share * self.whole), rough / (np.sqrt(share) * self.whole))

    def accepts(self, ratio: float) -> bool:
        """Decide on a step by its error over its share; where it is refused the next one is half as long."""
        if not ratio <= 1.0 and not self.at_smallest:
            self.level += 1
            self.last_hard = self.ticks
            return False
        self.forced += not ratio <= 1.0
        return True

    def step_on(self, ratio: float) -> None:
        """Go on by the step that was accepted, and choose the size of the next one."""
        length = self.length(self.level)
        self.ticks += 2 ** (HALVINGS - self.level)
        if not ratio < _EASY:
            self.last_hard = self.ticks
        patience = self.period / self.tick if self.period < _MANY * length else 0.0
        # The error over the step's length grows fourfold with a doubled step, and times stay multiples of steps.
        aligned = self.level > 0 and self.ticks % 2 ** (HALVINGS - self.level + 1) == 0
        if ratio < _EASY and aligned and self.ticks - self.last_hard >= patience:
            self.level -= 1
