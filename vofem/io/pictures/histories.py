"""Histories in time: displacements of points, and K_eq of contacts under them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.bodies.base import Point
from vofem.effects import Contact
from vofem.errors import ArgumentError
from vofem.io.pictures.axes import COLORS, INK, goal_of, legend, panels, plain, save
from vofem.io.pictures.layout import place_of
from vofem.io.pictures.places import all_contacts
from vofem.io.pictures.units import length, prefixed
from vofem.result import Result

Array = NDArray[np.float64]

#: Times at which a run of event_driven, which knows its motion at any time, is drawn.
_DENSE = 4001


def time_history(
    result: Result | Mapping[str, Result],
    point: Any,
    path: str | os.PathLike[str],
    *,
    contact: Contact | str | Iterable[Contact | str] | None = None,
) -> Path:
    """Draw the displacement of points over time, and K_eq of contacts under it.

    Times at which a contact is closed are shaded; the displacement at which
    it closes is a dashed line.

    Parameters
    ----------
    result : Result, or mapping of titles to Results
        Several are drawn side by side, with the same axes; K_eq has its own
        where stiffnesses differ by more than ten times.
    point : point, or several of them
        ``beam.at(x)`` or a Mass; found in every result by its body's name.
    path : path of a .png, .pdf or .svg
    contact : contact, name or several of them, optional
        Those to show, ``name[node]`` of a one-sided foundation among them; where
        not given, the contacts at the points, and where there are none, the
        nearest of their bodies, at most six.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    ArgumentError
        For what is not a point, or no contact of the run.
    OutputError
        If the file cannot be written.
    """
    goal = goal_of(path)
    points = _points(point)
    runs = result if isinstance(result, Mapping) else {points[0].describe() if len(points) == 1 else "": result}
    shown = {title: _contacts(run, points, contact) for title, run in runs.items()}
    below = any(shown.values())
    peaks = [np.max(np.abs(run.displacement(p, _times(run, shown[t])))) for t, run in runs.items() for p in points]
    scale = length(float(max(peaks)))
    size = (10.0 if len(runs) == 1 else 2.0 + 4.4 * len(runs), 6.4 if below else 4.2)
    heights = (2.2, 1.0) if below else (1.0,)
    figure, grid = panels(size, len(heights), len(runs), sharex="col", height_ratios=heights)
    _share(grid[0])
    stiffest = [_stiffest(run, shown[title]) for title, run in runs.items()]
    # Beside a stop more than ten times as stiff another one would be a line along the axis.
    alike = max(stiffest) <= 10.0 * min(filter(None, stiffest), default=0.0)
    if below and alike:
        _share(grid[1])
        stiffest = [max(stiffest)] * len(runs)
    for (title, run), column, most in zip(runs.items(), grid.T, stiffest, strict=True):
        _draw_motion(run, points, shown[title], scale, column)
        if below:
            _draw_stiffness(run, shown[title], len(points), most, column[1])
            if not alike or column[1].get_subplotspec().is_first_col():
                column[1].set_ylabel(rf"$K_\mathrm{{eq}}$ [{_unit(run, shown[title], most)}]")
        column[0].set_title(plain(title), fontsize=11)
        column[-1].set_xlabel("time [s]")
        column[-1].set_xlim(0.0, _end(run))
    grid[0, 0].set_ylabel(f"displacement [{scale[1]}]")
    for row in grid:
        legend(row[-1], row)
    return save(figure, goal)


def _unit(run: Result, contacts: list[Contact], most: float) -> str:
    """Return the unit of K_eq with its prefix; both where some contacts act on rotations."""
    units = dict.fromkeys(contact.units.stiffness for contact in contacts) or {"N/m": None}
    return ", ".join(prefixed(most, unit)[1] for unit in units)


def _draw_motion(
    run: Result, points: list[Point], contacts: list[Contact], scale: tuple[float, str], column: Array
) -> None:
    """Draw displacements into the first axes, and shade all of them where a contact is closed."""
    upper, factor, times = column[0], scale[0], _times(run, contacts)
    for k, point in enumerate(points):
        label = {} if len(points) == 1 else {"label": point.describe()}
        eta = run.displacement(point, times) / factor
        upper.plot(times, eta, color=INK if k == 0 else COLORS[k % len(COLORS)], linewidth=1.3, **label)
    # Intervals of several contacts lie on each other.
    shade = 0.14 / max(1, len(contacts)) ** 0.7
    for index, item in enumerate(contacts):
        color = _color(index, len(points))
        touched = next((point for point in points if _at(item, point)), None)
        if touched is not None and item.of == "displacement":
            surface = np.broadcast_to(_surface(run, item, touched, times), times.shape)
            upper.plot(times, surface / factor, color=color, linewidth=1.0, linestyle="--", label=f"{item.name} closes")
        for start, end in closed_intervals(run, item.name):
            for axes in column:
                axes.axvspan(start, end, color=color, alpha=shade, linewidth=0)


def _share(row: Array) -> None:
    """Give the axes of a row one scale, told by the first."""
    for axes in row[1:]:
        axes.sharey(row[0])
        axes.tick_params(labelleft=False)


def _stiffest(run: Result, contacts: list[Contact]) -> float:
    laws = run.model.system.contacts
    if laws is None or not contacts:
        return 0.0
    return float(np.max(laws.stiffness[[laws.names.index(contact.name) for contact in contacts]]))


def _draw_stiffness(run: Result, contacts: list[Contact], points: int, most: float, axes: Any) -> None:
    """Draw K_eq of contacts, in the unit of the stiffest."""
    laws = run.model.system.contacts
    if laws is None or not contacts:
        return
    times = _times(run, contacts)
    samples = run.solution.contacts(times).stiffness
    rows = [laws.names.index(contact.name) for contact in contacts]
    factor, _ = prefixed(most, "N/m")
    for index, (contact, row) in enumerate(zip(contacts, rows, strict=True)):
        color = _color(index, points)
        axes.plot(times, samples[row] / factor, drawstyle="steps-post", color=color, linewidth=1.4, label=contact.name)
    axes.set_ylim(0.0, 1.1 * most / factor)


def _color(index: int, points: int) -> str:
    """Return the colour of a contact: none that a point has."""
    return COLORS[0] if index == 0 else COLORS[(index + points - 1) % len(COLORS)]


def _contacts(result: Result, points: list[Point], wanted: Any) -> list[Contact]:
    if wanted is not None:
        names = [wanted] if isinstance(wanted, (str, Contact)) else list(wanted)
        held = {result.contacts[name].name for name in names}
        return [contact for contact in all_contacts(result.scene) if contact.name in held]
    bodies = {point.body.name for point in points}
    of_bodies = [c for c in result.scene.contacts if any(p.body.name in bodies for p in c.points())]
    here = [c for c in all_contacts(result.scene) if any(_at(c, point) for point in points)]
    # More than there are colours cannot be told apart.
    nearest = sorted(of_bodies, key=lambda c: min(_distance(p, q) for p in c.points() for q in points))
    return here or [c for c in of_bodies if c in nearest[: len(COLORS)]]


def _points(wanted: Any) -> list[Point]:
    several = isinstance(wanted, Iterable) and not isinstance(wanted, str)
    points = list(wanted) if several else [wanted]
    for point in points:
        if not (hasattr(point, "row") and hasattr(point, "body")):
            raise ArgumentError(f"expected a point, beam.at(x) or a Mass, found {point!r}")
    if not points:
        raise ArgumentError("expected a point, beam.at(x) or a Mass, found none")
    return points


def _distance(one: Point, other: Point) -> float:
    return abs(place_of(one) - place_of(other)) if one.body.name == other.body.name else np.inf


def _at(contact: Contact, point: Point) -> bool:
    """Return whether a contact touches its body at a point."""
    return any(
        p.body.name == point.body.name and np.isclose(place_of(p), place_of(point), rtol=1e-9, atol=0.0)
        for p in contact.points()
    )


def _end(result: Result) -> float:
    # The last step of a stepping method may reach beyond the end of the run, where nothing is known.
    return min(float(result.times[-1]), result.solution.t_end)


def _times(result: Result, contacts: list[Contact]) -> Array:
    end = _end(result)
    if not result.solution.continuous:
        return result.times[result.times <= end]
    dense = np.linspace(0.0, end, max(_DENSE, result.times.size))
    events = [np.concatenate([result.contacts[c.name].closings, result.contacts[c.name].openings]) for c in contacts]
    times = np.unique(np.concatenate([dense, *events]))
    return times[times <= end]


def _surface(result: Result, contact: Contact, point: Point, times: Array) -> float | Array:
    """Return the displacement of the point, where it lies on the contact, at which the contact closes."""
    if contact.b is None:
        return -contact.gap if contact.side == "below" else contact.gap
    if contact.a.body.name == point.body.name:
        return result.displacement(contact.b, times) + contact.gap
    return result.displacement(contact.a, times) - contact.gap


def closed_intervals(result: Result, contact: str) -> list[tuple[float, float]]:
    """Return the times in s between which a contact is closed."""
    history = result.contacts[contact]
    openings = np.append(history.openings, result.times[-1])
    return [(float(start), float(end)) for start, end in zip(history.closings, openings, strict=False)]
