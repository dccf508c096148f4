"""The histories and the contacts of a run as tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.bodies.base import Point, as_point
from vofem.bodies.path import TravellingPoint
from vofem.histories.impacts import window_of
from vofem.histories.table import Table, joined
from vofem.histories.variables import ENERGIES, Tabulated, histories, motion_and_contacts
from vofem.scene import Scene
from vofem.system import CLOSED, OPEN, PINNED

#: Points that are chosen where none are named.
MOST = 6

#: Which variables are columns of data frames and of CSV files, by what they are counted.
_COLUMNS = {
    "point": ("displacement", "velocity"),
    "contact": ("contact_force", "contact_stiffness"),
    "friction": ("friction_force", "friction_slip_speed"),
}

_STATUS = {OPEN: "opens", CLOSED: "closes", PINNED: "is pinned"}


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
    """Return points by name: those that are given, else points of interest of the scene."""
    if points is None:
        points = points_of_interest(scene)[:MOST]
    if isinstance(points, Mapping):
        return {name: as_point(f"{what}: {name}", point) for name, point in points.items()}
    listed = [points] if isinstance(points, Point) else points
    return {found.name: found for found in (as_point(f"{what}: a point", point) for point in listed)}


def history_columns(run: Tabulated, points: dict[str, Any]) -> dict[str, tuple[NDArray, str]]:
    """Return values and units at the times of a run, of `histories`.

    These are the motion of points, force and K_eq of contacts, and force and slip speed of sliders.
    """
    found = motion_and_contacts(run, points)
    columns: dict[str, tuple[NDArray, str]] = {}
    for over, names in _COLUMNS.items():
        values = {name: found[name].at() for name in names if name in found}
        for k, label in enumerate(found[over].at().tolist() if values else ()):
            for name, block in values.items():
                columns[f"{label} {name.removeprefix(f'{over}_').replace('_', ' ')}"] = block[:, k], found[name].unit(k)
    return columns


def dataframe_of(run: Tabulated, points: Any) -> Any:
    """Return histories as a `pandas.DataFrame`; see `vofem.Result.to_dataframe`."""
    import pandas

    columns = history_columns(run, named_points("to_dataframe", run.scene, points))
    for name in ENERGIES:
        columns[f"{name} energy"] = getattr(run.energy, name), "J"
    values = {f"{name} [{unit}]": part for name, (part, unit) in columns.items()}
    frame = pandas.DataFrame(values, index=pandas.Index(run.times, name="t [s]"))
    frame.attrs["notes"] = list(run.solution.notes)
    return frame


def dataset_of(run: Tabulated, points: Any) -> Any:
    """Return histories as an `xarray.Dataset`; see `vofem.Result.to_xarray`."""
    import xarray

    found = histories(run, named_points("to_xarray", run.scene, points))
    variables = {name: (variable.dims, variable.at(), variable.attributes) for name, variable in found.items()}
    return xarray.Dataset(variables, attrs={"notes": "\n".join(run.solution.notes)})


def events_of(run: Tabulated) -> Table:
    """Return all contact events in the order of time; see `vofem.Result.contact_events`."""
    events = run.solution.events
    names = list(run.contacts)
    columns = {
        "time": (events.time, "s"),
        "contact": (np.array([names[k] for k in events.contact], dtype=str), ""),
        "event": (np.array([_STATUS[int(status)] for status in events.status], dtype=str), ""),
    }
    return Table(columns, "Contact events")


def impacts_of(run: Tabulated, window: ArrayLike | None) -> Table:
    """Return the impacts of all contacts in the order of time; see `vofem.Result.impacts`."""
    begin, end = window_of("impacts", window, float(run.solution.t_end))
    table = joined((history.impacts for history in run.contacts.values()), "Impacts")
    if not table.rows:
        return table
    order = np.lexsort((table["contact"], table["closing"]))
    closing = table["closing"][order]
    return table.chosen(order[(closing >= begin) & (closing <= end)])


def statistics_of(run: Tabulated, window: ArrayLike | None) -> Table:
    """Return the statistics of all contacts, one a row; see `vofem.Result.contact_statistics`."""
    begin, end = window_of("contact_statistics", window, float(run.solution.t_end))
    found = (history.statistics((begin, end)) for history in run.contacts.values())
    return joined(found, f"Contacts from {begin:g} to {end:g} s")
