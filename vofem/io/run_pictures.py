"""Which points and times of a run to show, where a scene file does not say."""

from __future__ import annotations

from typing import Any

import numpy as np

from vofem.histories.tables import MOST, points_of_interest
from vofem.io.scenes.settings import OutputSettings
from vofem.result import Result
from vofem.scene import Scene


def history_points(scene: Scene, output: OutputSettings) -> tuple[Any, ...]:
    """Return the points that the settings name, or some telling ones."""
    return output.history or points_of_interest(scene)[:MOST]


def picture_times(result: Result, output: OutputSettings) -> tuple[float, ...]:
    """Return the times that the settings name, or the middle of the first contact, or when most is displaced.

    Of the times named those are left out that a shorter run does not reach.
    """
    named = tuple(t for t in output.pictures if t <= result.times[-1])
    if named or output.pictures:
        return named
    intervals = [
        (float(history.closings[0]), float(history.openings[0]) if history.openings.size else float(result.times[-1]))
        for history in result.contacts.values()
        if history.closings.size
    ]
    if intervals:
        middle = 0.5 * sum(min(intervals))
        # A stepping method may have stored few times; event_driven knows them all.
        nearest = float(result.times[int(np.argmin(np.abs(result.times - middle)))])
        return (middle if result.solution.continuous else nearest,)
    motion = np.max(np.abs([result.displacement(point) for point in history_points(result.scene, output)]), axis=0)
    return (float(result.times[int(np.argmax(motion))]),)
