"""Pictures of contacts: histograms of forces and of impacts, and when contacts are closed."""

from __future__ import annotations

from typing import Any

import numpy as np

from vofem._validate import whole
from vofem.errors import ArgumentError
from vofem.histories import ContactHistory
from vofem.histories.impacts import window_of
from vofem.histories.touches import spans_of
from vofem.io.pictures.axes import COLORS, Canvas, Where, figure, ink, plain, single, text_size
from vofem.io.pictures.units import prefixed
from vofem.result import Result

#: Number of times at which the force is evaluated in a run that is known at any time.
_SAMPLES = 40_000

#: Most bins of a histogram.
_MOST_BINS = 100_000

#: What is drawn of impacts: field, label, and name of the unit among those of the contact.
_QUANTITIES = (
    ("peak_force", "peak force", "force"),
    ("impulse", "impulse", "impulse"),
    ("duration", "duration", None),
    ("approach_speed", "approach speed", "coordinate"),
)


@figure
def force_histogram(
    result: Result,
    contact: Any = None,
    path: Where = None,
    *,
    window: tuple[float, float] | None = None,
    bins: int = 40,
    ax: Any = None,
) -> Any:
    """Draw how the force of a contact is distributed over the time in which it is closed.

    Parameters
    ----------
    result : Result
    bins : int
        Number of bins of the histogram.

    Raises
    ------
    ArgumentError
        If the contact is unknown, or does not close in the window.
    """
    history, path = _one(result, contact, path, "force_histogram")
    bins = whole("force_histogram: bins", bins, most=_MOST_BINS)
    begin, end = window_of("force_histogram", window, float(result.solution.t_end))
    times = result.times[(result.times >= begin) & (result.times <= end)]
    if result.solution.continuous:
        edges = np.linspace(begin, end, _SAMPLES + 1)
        times = 0.5 * (edges[1:] + edges[:-1])
    samples = result.solution.contacts(times)
    row = list(result.contacts).index(history.name)
    force = samples.force[row][samples.status[row] != 0]
    if not force.size:
        raise ArgumentError(
            f"force_histogram: contact {history.name!r} is not closed at any of the {times.size} times that were "
            f"looked at between {begin:g} and {end:g} s; choose a longer window, or name more times= when simulating"
        )
    factor, unit = prefixed(float(np.max(np.abs(force))), history.units.force)
    canvas, axes = single("force_histogram", path, ax, (7.2, 4.4))
    axes.hist(force / factor, bins=bins, weights=np.full(force.size, 1.0 / force.size), color=COLORS[0])
    axes.set(xlabel=f"force [{unit}]", ylabel="share of the time in touch [-]")
    share = 100.0 * force.size / times.size
    title = f"{history.name}: in touch for {share:.3g} % of {begin:g} to {end:g} s"
    axes.set_title(plain(title), fontsize=text_size(11))
    return canvas


@figure
def impact_statistics(
    result: Result,
    contact: Any = None,
    path: Where = None,
    *,
    window: tuple[float, float] | None = None,
    bins: int = 20,
    ax: Any = None,
) -> Any:
    """Draw histograms of peak force, impulse, duration and approach speed of the impacts of a contact.

    Parameters
    ----------
    result : Result
    window : (float, float), optional
        Impacts that begin between these times in s; all of them where not given.
    bins : int
        Number of bins of each histogram.
    ax : four matplotlib axes, optional
        The axes to draw into. By default a new figure is made.

    Raises
    ------
    ArgumentError
        If the contact is unknown, has no impacts in the window, or has forces that cannot be computed from the run.
    """
    from matplotlib.ticker import MaxNLocator

    history, path = _one(result, contact, path, "impact_statistics")
    bins = whole("impact_statistics: bins", bins, most=_MOST_BINS)
    begin, end = window_of("impact_statistics", window, float(result.solution.t_end))
    impacts = history.impacts
    within = (impacts.closing >= begin) & (impacts.closing <= end)
    if not np.any(within):
        raise ArgumentError(f"impact_statistics: contact {history.name!r} does not close from {begin:g} to {end:g} s")
    if impacts.why:
        raise ArgumentError(f"impact_statistics: forces of contact {history.name!r} are not known: {impacts.why}")
    canvas = Canvas("impact_statistics", path, ax, (9.6, 6.4), 2, 2)
    for axes, (field, label, kind) in zip(canvas.grid.flat, _QUANTITIES, strict=True):
        values = getattr(impacts, field)[within]
        known = np.isfinite(values)
        if not known.all():
            # As the peak force of an impact at a rigid stop, which has no bound.
            label = f"{label} of {known.sum()} of {known.size} impacts"
        values = values[known]
        unit = "s" if kind is None else getattr(history.units, kind)
        unit = f"{unit}/s" if kind == "coordinate" else unit
        factor, unit = prefixed(float(np.max(np.abs(values), initial=0.0)), unit)
        axes.hist(values / factor, bins=bins, color=COLORS[0])
        if values.size:
            axes.axvline(values.mean() / factor, color=ink(), linestyle="--", linewidth=1.0)
        axes.set(xlabel=f"{label} [{unit}]", ylabel="impacts [-]")
        if axes.get_yscale() == "linear":
            axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    rate = int(np.sum(within)) / (end - begin)
    title = f"{history.name}: {int(np.sum(within))} impacts from {begin:g} to {end:g} s, {rate:.3g} a second"
    canvas.grid[0, 0].set_title(plain(title), fontsize=text_size(11), loc="left")
    return canvas


@figure
def event_raster(
    result: Result, path: Where = None, *, window: tuple[float, float] | None = None, ax: Any = None
) -> Any:
    """Draw when the contacts of a run are closed: a row for each contact, a bar for each impact.

    Parameters
    ----------
    result : Result

    Raises
    ------
    ArgumentError
        If the run has no contacts.
    """
    names = list(result.contacts)
    if not names:
        raise ArgumentError("event_raster: the scene has no contacts")
    begin, end = window_of("event_raster", window, float(result.solution.t_end))
    canvas, axes = single("event_raster", path, ax, (10.0, float(np.clip(1.4 + 0.34 * len(names), 2.4, 12.0))))
    for row in range(len(names)):
        span = spans_of(result, row)
        within = (span.end >= begin) & (span.begin <= end)
        bars = np.stack([span.begin, span.end - span.begin], axis=1)[within]
        # The edge makes impacts visible that are shorter than a pixel.
        axes.broken_barh(bars.tolist(), (row - 0.35, 0.7), color=COLORS[0], linewidth=0.8)
    few = len(names) <= 30
    shown = range(len(names)) if few else range(0, len(names), -(-len(names) // 30))
    axes.set_yticks(list(shown), [plain(names[k]) for k in shown])
    axes.set(xlabel="time [s]", ylabel="contact [-]", xlim=(begin, end), ylim=(len(names) - 0.4, -0.6))
    return canvas


def _one(result: Result, contact: Any, path: Where, what: str) -> tuple[ContactHistory, Where]:
    """Return the given contact, or the only one, and the path, which may stand in the place of the contact."""
    names = list(result.contacts)
    if path is None and contact not in names and str(contact).lower().endswith((".png", ".pdf", ".svg")):
        contact, path = None, contact
    if contact is None and len(names) != 1:
        listed = ", ".join(map(repr, names)) or "none"
        raise ArgumentError(f"{what}: contact is not given, and the scene has {listed}; say which one with contact=")
    return result.contacts[names[0] if contact is None else contact], path
