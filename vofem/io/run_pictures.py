"""Which points and times of a run to show, where a scene file does not say."""

from __future__ import annotations

from typing import Any

import numpy as np

from vofem.bodies import Beam
from vofem.io.scene_file import SceneFile
from vofem.result import Result

#: Points that are chosen.
_MOST = 6


def history_points(file: SceneFile) -> tuple[Any, ...]:
    """Return the points that the file names, or those of its contacts and, where there are none, of its loads.

    A body that none of them touches gives its own: a mass itself, a beam its right end.
    """
    if file.output.history:
        return file.output.history
    points: dict[tuple[str, float], Any] = {}
    contacts = file.scene.contacts
    for effect in (*contacts, *(() if contacts else file.scene.effects)):
        for point in effect.points():
            points.setdefault((point.body.name, getattr(point, "x", 0.0)), point)
    touched = {name for name, _ in points}
    for body in file.scene.bodies:
        if body.name not in touched:
            points[body.name, 0.0] = body.at("right") if isinstance(body, Beam) else body
    return tuple(points.values())[:_MOST]


def picture_times(file: SceneFile, result: Result) -> tuple[float, ...]:
    """Return the times that the file names, or the middle of the first contact, or when most is displaced.

    Of the file's times those are left out that a shorter run does not reach.
    """
    named = tuple(t for t in file.output.pictures if t <= result.times[-1])
    if named or file.output.pictures:
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
        return (middle if result.method == "event_driven" else nearest,)
    motion = np.max(np.abs([result.displacement(point) for point in history_points(file)]), axis=0)
    return (float(result.times[int(np.argmax(motion))]),)
