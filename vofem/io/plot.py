"""Pictures with matplotlib: histories in time, and the side view of a scene."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.bodies.base import Point
from vofem.effects import Contact
from vofem.errors import ArgumentError
from vofem.io.files import replacing, target
from vofem.io.layout import place_of
from vofem.io.units import length, prefixed
from vofem.result import Result
from vofem.scene import Scene
from vofem.statics import Equilibrium

Array = NDArray[np.float64]

_SUFFIXES = (".png", ".pdf", ".svg")
_COLORS = ("#e07b21", "#2f6fae", "#3f8f5b", "#8a5aa8", "#b23a48", "#6b7280")

#: Times at which a run of event_driven, which knows its motion at any time, is drawn.
_DENSE = 4001


def draw_scene(
    outcome: Result | Equilibrium,
    t: float | None,
    path: str | os.PathLike[str],
    *,
    scene: Scene | None = None,
    size: tuple[int, int] = (1600, 700),
    magnification: float | None = None,
) -> Path:
    """Draw the side view of a scene at time t; see `vofem.io.render.render`, which needs a graphics driver.

    Parameters
    ----------
    outcome : Result or Equilibrium
    t : float or None
        In s; None for an equilibrium.
    path : path of a .png, .pdf or .svg
    scene : Scene, optional
        That of an equilibrium.
    size : tuple of int
        Width and height in pixels.
    magnification : float, optional
        Of displacements; chosen where not given.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    from vofem.io.backend_matplotlib import draw
    from vofem.io.sketch import sketch
    from vofem.io.snapshot import snapshot

    goal = target(path, _SUFFIXES)
    drawing = sketch(snapshot(outcome, t, scene), size, magnification)
    with replacing(goal) as temporary:
        draw(drawing, temporary)
    return goal


def time_history(
    result: Result,
    point: Any,
    path: str | os.PathLike[str],
    *,
    contact: Contact | str | Iterable[Contact | str] | None = None,
) -> Path:
    """Draw the displacement of a point over time, and K_eq of contacts under it.

    Times at which a contact is closed are shaded; the displacement at which
    it closes is a dashed line.

    Parameters
    ----------
    result : Result
    point : point
        ``beam.at(x)`` or a Mass.
    path : path of a .png, .pdf or .svg
    contact : contact, name or several of them, optional
        Those to show; where not given, the contacts at the point, and where
        there are none, the nearest of its body, at most six.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    from matplotlib.figure import Figure

    goal = target(path, _SUFFIXES)
    chosen = _contacts(result, point, contact)
    times = _times(result, chosen)
    eta = result.displacement(point, times)
    factor, unit = length(float(np.max(np.abs(eta))))
    figure = Figure(figsize=(10.0, 6.4 if chosen else 4.2), dpi=140, layout="constrained", facecolor="white")
    grid = figure.subplots(
        2 if chosen else 1, 1, sharex=True, squeeze=False, height_ratios=(2.2, 1.0) if chosen else (1.0,)
    )
    upper = grid[0, 0]
    upper.plot(times, eta / factor, color="#16181d", linewidth=1.3)
    upper.set_ylabel(f"displacement [{unit}]")
    upper.set_title(point.describe().replace("$", r"\$"), fontsize=11)
    # Intervals of several contacts lie on each other.
    shade = 0.14 / max(1, len(chosen)) ** 0.7
    for index, item in enumerate(chosen):
        color = _COLORS[index % len(_COLORS)]
        if _at(item, point):
            surface = np.broadcast_to(_surface(result, item, point, times), times.shape)
            upper.plot(times, surface / factor, color=color, linewidth=1.0, linestyle="--", label=f"{item.name} closes")
        for start, end in _closed(result, item):
            for axes in grid[:, 0]:
                axes.axvspan(start, end, color=color, alpha=shade, linewidth=0)
    if chosen:
        _stiffness(result, chosen, times, grid[1, 0])
    for axes in grid[:, 0]:
        _legend(axes)
    for axes in grid[:, 0]:
        axes.grid(color="#e3e5e9", linewidth=0.7)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    grid[-1, 0].set_xlabel("time [s]")
    grid[-1, 0].set_xlim(times[0], times[-1])
    with replacing(goal) as temporary:
        figure.savefig(temporary)
    return goal


def _contacts(result: Result, point: Point, wanted: Any) -> list[Contact]:
    if wanted is not None:
        names = [wanted] if isinstance(wanted, (str, Contact)) else list(wanted)
        held = {result.contacts[name].name for name in names}
        return [contact for contact in result.scene.contacts if contact.name in held]
    if not hasattr(point, "body"):
        raise ArgumentError(f"expected a point, beam.at(x) or a Mass, found {point!r}")
    of_body = [c for c in result.scene.contacts if any(p.body.name == point.body.name for p in c.points())]
    here = [c for c in of_body if _at(c, point)]
    # More than there are colours cannot be told apart.
    nearest = sorted(of_body, key=lambda c: min(abs(place_of(p) - place_of(point)) for p in c.points()))
    return here or [c for c in of_body if c in nearest[: len(_COLORS)]]


def _at(contact: Contact, point: Point) -> bool:
    """Return whether a contact touches its body at a point."""
    return any(
        p.body.name == point.body.name and np.isclose(place_of(p), place_of(point), rtol=1e-9, atol=0.0)
        for p in contact.points()
    )


def _legend(axes: Any) -> None:
    """Add a legend beside the axes, where no curve runs under it, of as many lines as there are colours."""
    handles, names = axes.get_legend_handles_labels()
    if not handles:
        return
    more = len(names) - len(_COLORS)
    if more > 0:
        handles, names = (
            handles[: len(_COLORS)],
            [*names[: len(_COLORS) - 1], f"{names[len(_COLORS) - 1]}, and {more} more"],
        )
    names = [name.replace("$", r"\$") for name in names]
    axes.legend(handles, names, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)


def _times(result: Result, contacts: list[Contact]) -> Array:
    # The last step of a stepping method may reach beyond the end of the run, where nothing is known.
    end = min(float(result.times[-1]), result.solution.t_end)
    if result.method != "event_driven":
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


def _closed(result: Result, contact: Contact) -> list[tuple[float, float]]:
    history = result.contacts[contact.name]
    openings = np.append(history.openings, result.times[-1])
    return [(float(start), float(end)) for start, end in zip(history.closings, openings, strict=False)]


def _stiffness(result: Result, contacts: list[Contact], times: Array, axes: Any) -> None:
    laws = result.model.system.contacts
    assert laws is not None
    samples = result.solution.contacts(times).stiffness
    rows = [laws.names.index(contact.name) for contact in contacts]
    factor, unit = prefixed(float(np.max(laws.stiffness[rows])), "N/m")
    for index, (contact, row) in enumerate(zip(contacts, rows, strict=True)):
        axes.plot(
            times,
            samples[row] / factor,
            drawstyle="steps-post",
            color=_COLORS[index % len(_COLORS)],
            linewidth=1.4,
            label=contact.name,
        )
    axes.set_ylabel(rf"$K_\mathrm{{eq}}$ [{unit}]")
    axes.set_ylim(0.0, 1.1 * float(np.max(laws.stiffness[rows])) / factor)
