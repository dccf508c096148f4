"""Histories over time: displacements of points, and the stiffness K_eq of contacts below them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from vofem._validate import flag_or_none, listed, wrong
from vofem.arrays import Array
from vofem.bodies.base import Point, as_point
from vofem.bodies.path import TravellingPoint
from vofem.effects import Contact, RigidStop
from vofem.errors import ArgumentError
from vofem.histories.impacts import window_of
from vofem.io.pictures.axes import COLORS, Canvas, Where, figure, ink, legend, plain, stroke, text_size
from vofem.io.pictures.places import all_contacts
from vofem.io.pictures.units import length, prefixed
from vofem.result import Result

#: Times at which a run of event_driven, known at any time, is drawn: as many at least, so many for each
#: contact event, and as many at most unless the run has more.
_DENSE, _EACH, _MOST = 4001, 20, 60_000

#: Crossings of its mean beyond which a motion is drawn as its envelope.
_CROSSINGS = 300

#: Crossings in each part of an envelope, and fewest and most parts of a window.
_CROSSINGS_EACH, _FEWEST, _PARTS = 6, 20, 400


@figure
def time_history(
    result: Result | Mapping[str, Result],
    point: Any,
    path: Where = None,
    *,
    contact: Contact | str | Iterable[Contact | str] | None = None,
    window: tuple[float, float] | None = None,
    envelope: bool | None = None,
    ax: Any = None,
) -> Any:
    """Draw the displacement of points over time, and the stiffness K_eq of contacts below it.

    Times at which a contact is closed are shaded. A dashed line shows the displacement at which it closes, but for
    contacts that travel. A motion with very many oscillations would be a solid block, so its envelope is drawn: the
    least and the largest displacement in each of up to 400 parts of the window. Below it is then the share of each part
    in which contacts are closed.

    Parameters
    ----------
    result : Result, or mapping of titles to Results
        The runs. Several are drawn side by side with the same scales. K_eq has separate scales if stiffnesses differ by
        more than a factor of ten.
    point : point, or several of them
        ``beam.at(x)``, a Mass or its name; found in every result by its body's name.
    contact : contact, name or several of them, optional
        The contacts to show; ``name[node]`` is a contact of a one-sided foundation. The default is the contacts at the
        points. If there are none, it is the nearest contacts of their bodies, at most six.
    envelope : bool, optional
        Whether the envelope is drawn. By default it is drawn if the motion crosses its mean more than 300 times.
    ax : matplotlib axes, optional
        The axes to draw into. For each result give one for displacements, or two, the second for K_eq. All axes for
        displacements come first. By default a new figure is made.

    Raises
    ------
    ArgumentError
        If `point` is not a point, `contact` is not a contact of the run, or the window lies outside the run.
    """
    envelope = flag_or_none("time_history: envelope", envelope, "to draw it where there are very many oscillations")
    runs = result if isinstance(result, Mapping) else {"": result}
    if not runs:
        raise wrong("result", "empty", "a Result, or a mapping of titles to Results")
    points = [as_point("point", point, next(iter(runs.values())).scene.bodies) for point in listed(point)]
    if not points:
        raise wrong("points", "empty", "one or more of beam.at(x), a Mass or its name")
    if not isinstance(result, Mapping) and len(points) == 1:
        runs = {points[0].describe(): result}
    contacts, count = [_contacts(run, points, contact) for run in runs.values()], len(runs)
    # K_eq is drawn below the displacements, unless the user gave no axes for it. Rigid stops have none.
    below = any(isinstance(c, Contact) for own in contacts for c in own) and (
        ax is None or np.size(np.asarray(ax, dtype=object)) > count
    )
    views = [
        _Run(title, run, points, own, window, envelope)
        for (title, run), own in zip(runs.items(), contacts, strict=True)
    ]
    scale = length(max(float(np.max(np.abs(view.motion))) for view in views))
    size = (10.0 if count == 1 else 2.0 + 4.4 * count, 6.4 if below else 4.2)
    heights = (2.2, 1.0) if below else (1.0,)
    canvas = Canvas("time_history", path, ax, size, len(heights), count, sharex="col", height_ratios=heights)
    grid = canvas.grid
    if ax is None:
        _share(grid[0])
    stiffest = [max(view.stiffness, default=0.0) for view in views]
    # Beside a stop more than ten times as stiff another one would be a line along the axis.
    alike = max(stiffest) <= 10.0 * min(filter(None, stiffest), default=0.0)
    if below and alike:
        if ax is None:
            _share(grid[1])
        stiffest = [max(stiffest)] * count
    for view, column, most in zip(views, grid.T, stiffest, strict=True):
        view.draw_motion(column, scale[0])
        if below:
            (view.draw_shares if view.parts else view.draw_stiffness)(column[1], most)
            if not alike or column[1] is grid[1, 0]:
                label = "closed share [-]" if view.parts else rf"$K_\mathrm{{eq}}$ [{view.unit(most)}]"
                column[1].set_ylabel(label)
        column[0].set_title(plain(view.title), fontsize=text_size(11))
        column[-1].set_xlabel("time [s]")
        column[-1].set_xlim(*view.window)
    grid[0, 0].set_ylabel(f"displacement [{scale[1]}]")
    for row in grid:
        legend(row[-1], row)
    return canvas


class _Run:
    """The part of a run that is drawn: times (n_times,), motion (n_points, n_times), and parts of its envelope or 0."""

    def __init__(
        self,
        title: str,
        run: Result,
        points: list[Point],
        contacts: list[Contact | RigidStop],
        window: Any,
        envelope: bool | None,
    ) -> None:
        self.title, self._run, self._points, self.contacts = title, run, points, contacts
        self.window = window_of("time_history", window, end_of(run))
        self.times = _times(run, contacts, *self.window)
        self.motion = np.array([run.displacement(point, self.times) for point in points])
        crossings = int(np.count_nonzero(np.diff(self.motion[0] > self.motion[0].mean())))
        enveloped = crossings > _CROSSINGS if envelope is None else envelope
        # Each part holds a few periods: in shorter ones the envelope would go up and down with the motion.
        self.parts = int(np.clip(crossings // _CROSSINGS_EACH, _FEWEST, _PARTS)) if enveloped else 0
        laws = run.model.system.contacts
        self._laws = [] if laws is None else [laws.names.index(contact.name) for contact in contacts]
        self.stiffness = [] if laws is None else laws.stiffness[self._laws].tolist()

    def unit(self, most: float) -> str:
        """Return the unit of K_eq with its prefix; both where some contacts act on rotations."""
        units = dict.fromkeys(contact.units.stiffness for contact in self.contacts) or {"N/m": None}
        return ", ".join(prefixed(most, unit)[1] for unit in units)

    def _closed(self, contact: Contact | RigidStop) -> Array:
        """Return the times in s between which a contact is closed, shape (k, 2)."""
        return np.array(closed_intervals(self._run, contact.name)).reshape(-1, 2)

    def draw_motion(self, column: Array, factor: float) -> None:
        """Draw displacements over `factor` into the first axes, and shade all of them where a contact is closed."""
        upper = column[0]
        for k, point in enumerate(self._points):
            label = {} if len(self._points) == 1 else {"label": point.describe()}
            color = ink() if k == 0 else COLORS[k % len(COLORS)]
            if self.parts:
                middle, low, high = envelope_of(self.times, self.motion[k] / factor, self.window, self.parts)
                upper.fill_between(middle, low, high, color=color, alpha=0.4, linewidth=stroke(0.8), **label)
            else:
                upper.plot(self.times, self.motion[k] / factor, color=color, linewidth=stroke(1.3), **label)
        # Intervals of several contacts lie on each other.
        shade = 0.14 / max(1, len(self.contacts)) ** 0.7
        for index, contact in enumerate(self.contacts):
            color = self._color(index)
            surface = _surface(self._run, contact, self._points, self.times, bool(self.parts))
            if surface is not None:
                name, line = f"{contact.name} closes", {"linewidth": stroke(1.0), "linestyle": "--"}
                upper.plot(self.times, surface / factor, color=color, label=name, **line)
            for start, end in () if self.parts else self._closed(contact).tolist():
                if end >= self.window[0] and start <= self.window[1]:
                    for axes in column:
                        axes.axvspan(start, end, color=color, alpha=shade, linewidth=0)

    def draw_shares(self, axes: Any, most: float) -> None:
        """Draw the share of time in which contacts are closed, part by part of the window."""
        edges = np.linspace(*self.window, self.parts + 1)
        for index, contact in enumerate(self.contacts):
            start, end = self._closed(contact).T
            # Closed time before each edge: whole intervals, and what has passed of the present one.
            total = np.array([np.sum(np.clip(np.minimum(end, edge) - start, 0.0, None)) for edge in edges])
            share = np.diff(total) / np.diff(edges)
            axes.stairs(share, edges, color=self._color(index), linewidth=stroke(1.2), label=contact.name)
        axes.set_ylim(0.0, 1.05)

    def draw_stiffness(self, axes: Any, most: float) -> None:
        """Draw K_eq of contacts, in the unit of the stiffest."""
        if not self.contacts:
            return
        factor, _ = prefixed(most, "N/m")
        stiffness = self._run.solution.contacts(self.times).stiffness[self._laws]
        for index, (contact, values) in enumerate(zip(self.contacts, stiffness, strict=True)):
            if isinstance(contact, RigidStop):
                continue
            line = {"drawstyle": "steps-post", "linewidth": stroke(1.4)}
            axes.plot(self.times, values / factor, color=self._color(index), label=contact.name, **line)
        axes.set_ylim(0.0, 1.1 * most / factor)

    def _color(self, index: int) -> str:
        """Return the colour of a contact: it differs from the colours of points."""
        return COLORS[0] if index == 0 else COLORS[(index + len(self._points) - 1) % len(COLORS)]


def _share(row: Array) -> None:
    """Give all axes of a row the same scale, labelled at the first one."""
    for axes in row[1:]:
        axes.sharey(row[0])
        axes.tick_params(labelleft=False)


def _contacts(result: Result, points: list[Point], wanted: Any) -> list[Contact | RigidStop]:
    if wanted is not None:
        held = {result.contacts[name].name for name in listed(wanted)}
        return [contact for contact in all_contacts(result.scene) if contact.name in held]
    bodies = {point.body.name for point in points}
    of_bodies = [c for c in result.scene.contacts if any(p.body.name in bodies for p in c.points())]
    here = [c for c in all_contacts(result.scene) if any(_at(c, point) for point in points)]
    # If there are more than there are colours, they cannot be distinguished.
    nearest = sorted(of_bodies, key=lambda c: min(_distance(p, q) for p in c.points() for q in points))
    return here or [c for c in of_bodies if c in nearest[: len(COLORS)]]


def _distance(one: Point, other: Point) -> float:
    return abs(one.x - other.x) if one.body.name == other.body.name else np.inf


def _at(contact: Contact | RigidStop, point: Point) -> bool:
    """Return whether a contact touches its body at a point."""
    return any(
        p.body.name == point.body.name and np.isclose(p.x, point.x, rtol=1e-9, atol=0.0)
        for p in contact.points()
        if not isinstance(p, TravellingPoint)
    )


def end_of(result: Result) -> float:
    """Return the last time of a run at which there are results, s; its last step may reach beyond."""
    return min(float(result.times[-1]), result.solution.t_end)


def times_of(result: Result, begin: float, end: float, count: int) -> Array:
    """Return times within a window in s: as many as wanted, or of a stepping method those that it has stored."""
    if result.solution.continuous:
        return np.linspace(begin, end, count)
    return result.times[(result.times >= begin) & (result.times <= end)]


def _times(result: Result, contacts: list[Contact | RigidStop], begin: float, end: float) -> Array:
    many = min(_EACH * result.counters.events, _MOST)
    stored = times_of(result, begin, end, max(_DENSE, result.times.size, many))
    if not result.solution.continuous:
        if stored.size < 2:
            raise ArgumentError(
                f"time_history: the run stored {stored.size} times between {begin:g} and {end:g} s, expected two or "
                "more; choose a longer window, or name more times in times= when simulating"
            )
        return stored
    events = [np.concatenate([result.contacts[c.name].closings, result.contacts[c.name].openings]) for c in contacts]
    times = np.unique(np.concatenate([stored, *events]))
    return times[(times >= begin) & (times <= end)]


def _surface(
    result: Result, contact: Contact | RigidStop, points: list[Point], times: Array, enveloped: bool
) -> Array | None:
    """Return the displacement of the point, where it lies on the contact, at which the contact closes."""
    point = next((point for point in points if _at(contact, point)), None)
    if point is None or contact.of != "displacement" or (contact.b is not None and enveloped):
        return None
    if any(isinstance(p, TravellingPoint) for p in contact.points()):
        return None
    laws = result.model.system.contacts
    assert laws is not None
    gap = laws.gaps(laws.names.index(contact.name), times)
    if contact.b is None:
        return -gap if contact.side == "below" else gap
    if contact.a.body.name == point.body.name:
        return result.displacement(contact.b, times) + gap
    return result.displacement(contact.a, times) - gap


def envelope_of(times: Array, values: Array, window: tuple[float, float], parts: int) -> tuple[Array, Array, Array]:
    """Return least and largest values in equal parts of a window of time in s.

    `times`, `values` (shape (n,)): in the order of time.
    Returns `middle, low, high` (shape (k,)): of the parts that hold values.
    """
    edges = np.linspace(*window, parts + 1)
    part = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, parts - 1)
    held, first = np.unique(part, return_index=True)
    low, high = np.minimum.reduceat(values, first), np.maximum.reduceat(values, first)
    return 0.5 * (edges[held] + edges[held + 1]), low, high


def closed_intervals(result: Result, contact: str) -> list[tuple[float, float]]:
    """Return the times in s between which a contact is closed."""
    history = result.contacts[contact]
    openings = np.append(history.openings, result.times[-1])
    return [(float(start), float(end)) for start, end in zip(history.closings, openings, strict=False)]
