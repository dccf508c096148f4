"""Histories over time: displacements of points, and the stiffness K_eq of contacts below them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.bodies.base import Point
from vofem.effects import Contact
from vofem.errors import ArgumentError
from vofem.histories.impacts import window_of
from vofem.io.pictures.axes import COLORS, Where, goal_of
from vofem.io.pictures.history_figure import ContactView, RunView, draw, stiffness_below
from vofem.io.pictures.layout import place_of
from vofem.io.pictures.places import all_contacts
from vofem.result import Result

Array = NDArray[np.float64]

#: Times at which a run of event_driven, known at any time, is drawn: as many at least, so many for each
#: contact event, and as many at most unless the run has more.
_DENSE, _EACH, _MOST = 4001, 20, 60_000

#: Crossings of its mean beyond which a motion is drawn as its envelope.
_CROSSINGS = 300

#: Crossings in each part of an envelope, and fewest and most parts of a window.
_CROSSINGS_EACH, _FEWEST, _PARTS = 6, 20, 400


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

    Times at which a contact is closed are shaded. A dashed line shows the displacement at which it closes. A motion
    with very many oscillations would be a solid block, so its envelope is drawn: the least and the largest displacement
    in each of up to 400 parts of the window. Below it is then the share of each part in which contacts are closed.

    Parameters
    ----------
    result : Result, or mapping of titles to Results
        The runs. Several are drawn side by side with the same scales. K_eq has separate scales if stiffnesses differ by
        more than a factor of ten.
    point : point, or several of them
        ``beam.at(x)`` or a Mass; found in every result by its body's name.
    path : path of a .png, .pdf or .svg, optional
        The file to write.
    contact : contact, name or several of them, optional
        The contacts to show; ``name[node]`` is a contact of a one-sided foundation. The default is the contacts at the
        points. If there are none, it is the nearest contacts of their bodies, at most six.
    window : (float, float), optional
        Begin and end of the time that is drawn, in s. The default is the whole run.
    envelope : bool, optional
        Whether the envelope is drawn. By default it is drawn if the motion crosses its mean more than 300 times.
    ax : matplotlib axes, optional
        The axes to draw into. For each result give one for displacements, or two, the second for K_eq. All axes for
        displacements come first. By default a new figure is made.

    Returns
    -------
    Path or matplotlib axes
        `path` where one is given, else the axes.

    Raises
    ------
    ArgumentError
        If `point` is not a point, `contact` is not a contact of the run, or the window lies outside the run.
    OutputError
        If the file cannot be written.
    """
    return draw(
        history_views(result, point, contact=contact, window=window, envelope=envelope, ax=ax), goal_of(path), ax
    )


def history_views(
    result: Result | Mapping[str, Result],
    point: Any,
    *,
    contact: Contact | str | Iterable[Contact | str] | None = None,
    window: tuple[float, float] | None = None,
    envelope: bool | None = None,
    ax: Any = None,
) -> list[RunView]:
    """Return what `time_history` draws of these runs; parameters and errors are those of `time_history`."""
    points = _points(point)
    runs = result if isinstance(result, Mapping) else {points[0].describe() if len(points) == 1 else "": result}
    contacts = [_contacts(run, points, contact) for run in runs.values()]
    below = stiffness_below(any(contacts), len(runs), ax)
    return [
        _view(title, run, points, own, window, envelope, below)
        for (title, run), own in zip(runs.items(), contacts, strict=True)
    ]


def _view(
    title: str,
    run: Result,
    points: list[Point],
    contacts: list[Contact],
    window: Any,
    envelope: bool | None,
    below: bool,
) -> RunView:
    begin, end = window_of("time_history", window, _end(run))
    times = _times(run, contacts, begin, end)
    motion = np.array([run.displacement(point, times) for point in points])
    crossings = int(np.count_nonzero(np.diff(motion[0] > motion[0].mean())))
    enveloped = crossings > _CROSSINGS if envelope is None else bool(envelope)
    # Each part holds a few periods: in shorter ones the envelope would go up and down with the motion.
    parts = int(np.clip(crossings // _CROSSINGS_EACH, _FEWEST, _PARTS)) if enveloped else 0
    laws = run.model.system.contacts
    samples = run.solution.contacts(times).stiffness if laws is not None and below and not enveloped else None
    shown = []
    for item in contacts:
        assert laws is not None
        law = laws.names.index(item.name)
        shown.append(
            ContactView(
                name=item.name,
                stiffness=float(laws.stiffness[law]),
                unit=item.units.stiffness,
                closed=np.array(closed_intervals(run, item.name)).reshape(-1, 2),
                surface=_surface(run, item, points, times, enveloped),
                k_eq=None if samples is None else samples[law],
            )
        )
    labels = tuple(point.describe() for point in points)
    return RunView(title, labels, tuple(shown), (begin, end), times, motion, parts)


def _contacts(result: Result, points: list[Point], wanted: Any) -> list[Contact]:
    if wanted is not None:
        names = [wanted] if isinstance(wanted, (str, Contact)) else list(wanted)
        held = {result.contacts[name].name for name in names}
        return [contact for contact in all_contacts(result.scene) if contact.name in held]
    bodies = {point.body.name for point in points}
    of_bodies = [c for c in result.scene.contacts if any(p.body.name in bodies for p in c.points())]
    here = [c for c in all_contacts(result.scene) if any(_at(c, point) for point in points)]
    # If there are more than there are colours, they cannot be distinguished.
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
    # The last step of a stepping method may reach beyond the end of the run, where there are no results.
    return min(float(result.times[-1]), result.solution.t_end)


def _times(result: Result, contacts: list[Contact], begin: float, end: float) -> Array:
    if not result.solution.continuous:
        stored = result.times[(result.times >= begin) & (result.times <= end)]
        if stored.size < 2:
            raise ArgumentError(
                f"time_history: the run stored {stored.size} times between {begin:g} and {end:g} s, expected two or "
                "more; choose a longer window, or name more times in times= when simulating"
            )
        return stored
    many = min(_EACH * result.counters.events, _MOST)
    dense = np.linspace(begin, end, max(_DENSE, result.times.size, many))
    events = [np.concatenate([result.contacts[c.name].closings, result.contacts[c.name].openings]) for c in contacts]
    times = np.unique(np.concatenate([dense, *events]))
    return times[(times >= begin) & (times <= end)]


def _surface(result: Result, contact: Contact, points: list[Point], times: Array, enveloped: bool) -> Array | None:
    """Return the displacement of the point, where it lies on the contact, at which the contact closes."""
    point = next((point for point in points if _at(contact, point)), None)
    if point is None or contact.of != "displacement" or (contact.b is not None and enveloped):
        return None
    if contact.b is None:
        return np.full(times.shape, -contact.gap if contact.side == "below" else contact.gap)
    if contact.a.body.name == point.body.name:
        return result.displacement(contact.b, times) + contact.gap
    return result.displacement(contact.a, times) - contact.gap


def closed_intervals(result: Result, contact: str) -> list[tuple[float, float]]:
    """Return the times in s between which a contact is closed."""
    history = result.contacts[contact]
    openings = np.append(history.openings, result.times[-1])
    return [(float(start), float(end)) for start, end in zip(history.closings, openings, strict=False)]
