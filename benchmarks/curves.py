"""Curves over logarithmic axes, as benchmarks and the pages of figures show them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from vofem.io.pictures.axes import COLORS, Canvas, Where, ink, plain, stroke, text_size


@dataclass(frozen=True)
class Curve:
    """A named curve.

    Attributes
    ----------
    name : str
        Name in the legend. Curves of one name share a colour and an entry.
    x, y : array_like, shape (k,)
        Positive.
    dashed : bool
    strong : bool
        Whether the curve is the main one of the figure, drawn in the main colour.
    """

    name: str
    x: ArrayLike
    y: ArrayLike
    dashed: bool = False
    strong: bool = False


@dataclass(frozen=True)
class Panel:
    """One pair of axes: its curves, and its title and labels."""

    curves: Sequence[Curve]
    xlabel: str
    ylabel: str
    title: str = ""


_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")


def log_curves(pictures: Sequence[Panel], path: Where = None, *, ax: Any = None) -> Any:
    """Draw panels side by side, each with its own legend below, all axes logarithmic.

    Parameters
    ----------
    pictures : sequence of Panel
    path : path of a .png, .pdf or .svg, optional
        The file to write.
    ax : sequence of matplotlib axes, optional
        The axes to draw into, one for each panel. By default a new figure is made.

    Returns
    -------
    Path or matplotlib axes
        `path` where one is given, else the axes.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    canvas = Canvas("log_curves", path, ax, (5.6 * len(pictures), 6.0), 1, len(pictures))
    names = list(dict.fromkeys(c.name for panel in pictures for c in panel.curves if not c.strong))
    for panel, axes in zip(pictures, canvas.grid[0], strict=True):
        shown: set[str] = set()
        for curve in panel.curves:
            index = names.index(curve.name) if curve.name in names else 0
            color = ink() if curve.strong else COLORS[index % len(COLORS)]
            axes.loglog(
                curve.x, curve.y, "--" if curve.dashed else "-", marker=None if curve.dashed else _mark(curve, index),
                color=color, linewidth=stroke(1.3), markersize=5,
                label=None if curve.name in shown else plain(curve.name),
            )  # fmt: skip
            shown.add(curve.name)
        axes.set(xlabel=panel.xlabel, ylabel=panel.ylabel)
        axes.set_title(plain(panel.title), fontsize=text_size(11))
        axes.legend(
            loc="upper center",
            bbox_to_anchor=(0.5, -0.13),
            ncols=1 if len(shown) < 5 else 2,
            frameon=False,
            fontsize=text_size(8),
        )
    return canvas.done()


def _mark(curve: Curve, index: int) -> str:
    return "*" if curve.strong else _MARKERS[index % len(_MARKERS)]
