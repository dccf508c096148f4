"""The histories and the contacts of a run as tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from numpy.typing import NDArray

from vofem._validate import listed
from vofem.bodies.base import Point, as_point
from vofem.bodies.path import TravellingPoint
from vofem.histories.run import Run
from vofem.histories.variables import motion_and_contacts
from vofem.parameters.kinds import checked_name
from vofem.scene import Scene

#: Points that are chosen where none are named.
MOST = 6

#: Which variables are columns of data frames and of CSV files, by what they are counted.
_COLUMNS = {
    "point": ("displacement", "velocity"),
    "contact": ("contact_force", "contact_stiffness"),
    "friction": ("friction_force", "friction_slip_speed"),
}


def points_of_interest(scene: Scene) -> tuple[Any, ...]:
    """Return the points of the contacts and, where there are none, of the other effects.

    A body without such a point is represented by itself if it is a mass, and by its right end if it is a line.
    """
    points: dict[tuple[str, float], Any] = {}
    contacts = scene.contacts
    for effect in (*contacts, *(() if contacts else scene.effects)):
        for point in effect.points():
            if isinstance(point, TravellingPoint):
                continue
            points.setdefault((point.body.name, point.x), point)
    touched = {name for name, _ in points}
    for body in scene.bodies:
        if body.name not in touched:
            points[body.name, 0.0] = body if isinstance(body, Point) else body.at("right")
    return tuple(points.values())


def named_points(what: str, scene: Scene, points: Mapping[str, Any] | Iterable[Any] | None) -> dict[str, Any]:
    """Return points by name: those that are given, else points of interest of the scene.

    A point that has the name of another one, as a mass ``b@1.0`` beside a beam ``b``, is called by its description.
    """
    if points is None:
        points = points_of_interest(scene)[:MOST]
    if isinstance(points, Mapping):
        return {
            checked_name(f"{what}: a name", name): as_point(f"{what}: {name}", point, scene.bodies)
            for name, point in points.items()
        }
    found: dict[str, Any] = {}
    for point in (as_point(f"{what}: a point", point, scene.bodies) for point in listed(points)):
        other = found.get(point.name, point)
        same = other.body is point.body and other.x == point.x
        found[point.name if same else point.describe()] = point
    return found


def history_columns(run: Run, points: dict[str, Any]) -> dict[str, tuple[NDArray, str]]:
    """Return values and units at the times of a run, of `histories`.

    These are the motion of points, force and K_eq of contacts, and force and slip speed of sliders. A slider that has
    the name of a contact is called ``friction`` and its name.
    """
    found = motion_and_contacts(run, points)
    columns: dict[str, tuple[NDArray, str]] = {}
    for over, names in _COLUMNS.items():
        values = {name: found[name].at() for name in names if name in found}
        words = {name: name.removeprefix(f"{over}_").replace("_", " ") for name in values}
        for k, label in enumerate(found[over].at().tolist() if values else ()):
            while any(f"{label} {word}" in columns for word in words.values()):
                label = f"{over} {label}"
            for name, block in values.items():
                columns[f"{label} {words[name]}"] = block[:, k], found[name].unit(k)
    return columns
