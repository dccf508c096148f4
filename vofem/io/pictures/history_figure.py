"""Histories as a figure of matplotlib, from plain data, so that another process can draw them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.io.pictures.axes import COLORS, Canvas, ink, legend, plain, stroke, text_size
from vofem.io.pictures.envelope import envelope_of
from vofem.io.pictures.units import length, prefixed

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ContactView:
    """A contact in the part of a run that is drawn.

    Attributes
    ----------
    name : str
    stiffness : float
        The stiffness K0 of its law, N/m or N m/rad.
    unit : str
        The unit of this stiffness.
    closed : ndarray, shape (k, 2)
        Times in s between which it is closed, of the whole run.
    surface : ndarray, shape (n_times,), or None
        The displacement in m at which it closes; None where this is not drawn.
    k_eq : ndarray, shape (n_times,), or None
        Its stiffness over time; None where this is not drawn.
    """

    name: str
    stiffness: float
    unit: str
    closed: Array
    surface: Array | None
    k_eq: Array | None


@dataclass(frozen=True)
class RunView:
    """The part of a run that is drawn.

    Attributes
    ----------
    title : str
    labels : tuple of str
        Names of the points.
    contacts : tuple of ContactView
    window : (float, float)
        Begin and end in s.
    times : ndarray, shape (n_times,)
        Times in s.
    motion : ndarray, shape (n_points, n_times)
        Displacements in m.
    parts : int
        Number of parts of the envelope that is drawn instead of the motion; 0 where the motion is drawn.
    """

    title: str
    labels: tuple[str, ...]
    contacts: tuple[ContactView, ...]
    window: tuple[float, float]
    times: Array
    motion: Array
    parts: int

    @property
    def enveloped(self) -> bool:
        """Whether the envelope is drawn."""
        return self.parts > 0


def prepare() -> None:
    """Import what `draw` needs from matplotlib, and let it build its parser of formulas and find its font.

    Only for processes that do nothing but draw, because it leaves out docstrings of matplotlib.
    """
    import matplotlib.artist

    # Writing the lists of properties into the docstrings of all artists takes a third of the time of the import.
    matplotlib.artist.kwdoc = lambda artist: ""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.font_manager import FontProperties, findfont
    from matplotlib.mathtext import MathTextParser

    FigureCanvasAgg(Figure())
    findfont(FontProperties())
    MathTextParser("agg").parse("$K$")


def draw(views: Sequence[RunView], goal: Path | None = None, ax: Any = None) -> Any:
    """Draw histories of runs side by side; return the path of the file that was written, or the axes.

    Parameters
    ----------
    views : sequence of RunView
    goal : Path, optional
        The file to write.
    ax : matplotlib axes, optional
        The axes to draw into; see `vofem.io.pictures.histories.time_history`.

    Raises
    ------
    ArgumentError
        If `ax` does not have the required number of axes.
    OutputError
        If the file cannot be written.
    """
    count = len(views)
    below = stiffness_below(any(view.contacts for view in views), count, ax)
    scale = length(max(float(np.max(np.abs(view.motion))) for view in views))
    size = (10.0 if count == 1 else 2.0 + 4.4 * count, 6.4 if below else 4.2)
    heights = (2.2, 1.0) if below else (1.0,)
    canvas = Canvas("time_history", goal, ax, size, len(heights), count, sharex="col", height_ratios=heights)
    grid = canvas.grid
    if ax is None:
        _share(grid[0])
    stiffest = [max((contact.stiffness for contact in view.contacts), default=0.0) for view in views]
    # Beside a stop more than ten times as stiff another one would be a line along the axis.
    alike = max(stiffest) <= 10.0 * min(filter(None, stiffest), default=0.0)
    if below and alike:
        if ax is None:
            _share(grid[1])
        stiffest = [max(stiffest)] * count
    for view, column, most in zip(views, grid.T, stiffest, strict=True):
        _draw_motion(view, scale, column)
        if below:
            (_draw_shares if view.enveloped else _draw_stiffness)(view, most, column[1])
            if not alike or column[1] is grid[1, 0]:
                label = "closed share [-]" if view.enveloped else rf"$K_\mathrm{{eq}}$ [{_unit(view, most)}]"
                column[1].set_ylabel(label)
        column[0].set_title(plain(view.title), fontsize=text_size(11))
        column[-1].set_xlabel("time [s]")
        column[-1].set_xlim(*view.window)
    grid[0, 0].set_ylabel(f"displacement [{scale[1]}]")
    for row in grid:
        legend(row[-1], row)
    return canvas.done()


def stiffness_below(contacts: bool, count: int, ax: Any) -> bool:
    """Return whether K_eq is drawn below the displacements of so many runs: not if the user gave no axes for it."""
    return contacts and (ax is None or np.size(np.asarray(ax, dtype=object)) > count)


def _unit(view: RunView, most: float) -> str:
    """Return the unit of K_eq with its prefix; both where some contacts act on rotations."""
    units = dict.fromkeys(contact.unit for contact in view.contacts) or {"N/m": None}
    return ", ".join(prefixed(most, unit)[1] for unit in units)


def _draw_motion(view: RunView, scale: tuple[float, str], column: Array) -> None:
    """Draw displacements into the first axes, and shade all of them where a contact is closed."""
    upper, factor = column[0], scale[0]
    for k, name in enumerate(view.labels):
        label = {} if len(view.labels) == 1 else {"label": name}
        color = ink() if k == 0 else COLORS[k % len(COLORS)]
        if view.enveloped:
            middle, low, high = envelope_of(view.times, view.motion[k] / factor, view.window, view.parts)
            upper.fill_between(middle, low, high, color=color, alpha=0.4, linewidth=stroke(0.8), **label)
        else:
            upper.plot(view.times, view.motion[k] / factor, color=color, linewidth=stroke(1.3), **label)
    # Intervals of several contacts lie on each other.
    shade = 0.14 / max(1, len(view.contacts)) ** 0.7
    for index, item in enumerate(view.contacts):
        color = _color(index, view)
        if item.surface is not None:
            name, line = f"{item.name} closes", {"linewidth": stroke(1.0), "linestyle": "--"}
            upper.plot(view.times, item.surface / factor, color=color, label=name, **line)
        if not view.enveloped:
            for start, end in item.closed.tolist():
                if end >= view.window[0] and start <= view.window[1]:
                    for axes in column:
                        axes.axvspan(start, end, color=color, alpha=shade, linewidth=0)


def _draw_shares(view: RunView, most: float, axes: Any) -> None:
    """Draw the share of time in which contacts are closed, part by part of the window."""
    edges = np.linspace(*view.window, view.parts + 1)
    for index, contact in enumerate(view.contacts):
        start, end = contact.closed.T
        # Closed time before each edge: whole intervals, and what has passed of the present one.
        total = np.array([np.sum(np.clip(np.minimum(end, edge) - start, 0.0, None)) for edge in edges])
        share = np.diff(total) / np.diff(edges)
        axes.stairs(share, edges, color=_color(index, view), linewidth=stroke(1.2), label=contact.name)
    axes.set_ylim(0.0, 1.05)


def _share(row: Array) -> None:
    """Give all axes of a row the same scale, labelled at the first one."""
    for axes in row[1:]:
        axes.sharey(row[0])
        axes.tick_params(labelleft=False)


def _draw_stiffness(view: RunView, most: float, axes: Any) -> None:
    """Draw K_eq of contacts, in the unit of the stiffest."""
    factor, _ = prefixed(most, "N/m")
    for index, contact in enumerate(view.contacts):
        if contact.k_eq is not None:
            line = {"drawstyle": "steps-post", "linewidth": stroke(1.4)}
            axes.plot(view.times, contact.k_eq / factor, color=_color(index, view), label=contact.name, **line)
    if view.contacts:
        axes.set_ylim(0.0, 1.1 * most / factor)


def _color(index: int, view: RunView) -> str:
    """Return the colour of a contact: it differs from the colours of points."""
    return COLORS[0] if index == 0 else COLORS[(index + len(view.labels) - 1) % len(COLORS)]
