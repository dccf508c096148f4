"""Curves over logarithmic axes: what benchmarks and pages of numbers show."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from numpy.typing import ArrayLike

from vofem.io.pictures.axes import COLORS, INK, goal_of, panels, plain, save


@dataclass(frozen=True)
class Curve:
    """A named curve.

    Attributes
    ----------
    name : str
        For the legend; curves of one name share colour and entry.
    x, y : array_like, shape (k,)
        Positive.
    dashed : bool
    strong : bool
        Whether it is drawn in ink, as what the figure is about.
    """

    name: str
    x: ArrayLike
    y: ArrayLike
    dashed: bool = False
    strong: bool = False


@dataclass(frozen=True)
class Panel:
    """One pair of axes: curves, and what is written at it."""

    curves: Sequence[Curve]
    xlabel: str
    ylabel: str
    title: str = ""


_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")


def log_curves(pictures: Sequence[Panel], path: str | os.PathLike[str]) -> Path:
    """Draw panels side by side, each with its own legend below, all axes logarithmic.

    Parameters
    ----------
    pictures : sequence of Panel
    path : path of a .png, .pdf or .svg

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    goal = goal_of(path)
    figure, grid = panels((5.6 * len(pictures), 6.0), 1, len(pictures))
    names = list(dict.fromkeys(c.name for panel in pictures for c in panel.curves if not c.strong))
    for panel, axes in zip(pictures, grid[0], strict=True):
        shown: set[str] = set()
        for curve in panel.curves:
            index = names.index(curve.name) if curve.name in names else 0
            color = INK if curve.strong else COLORS[index % len(COLORS)]
            axes.loglog(
                curve.x, curve.y, "--" if curve.dashed else "-", marker=None if curve.dashed else _mark(curve, index),
                color=color, linewidth=1.3, markersize=5, label=None if curve.name in shown else plain(curve.name),
            )  # fmt: skip
            shown.add(curve.name)
        axes.set(xlabel=panel.xlabel, ylabel=panel.ylabel)
        axes.set_title(plain(panel.title), fontsize=11)
        axes.legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=1 if len(shown) < 5 else 2, frameon=False, fontsize=8
        )
    return save(figure, goal)


def _mark(curve: Curve, index: int) -> str:
    return "*" if curve.strong else _MARKERS[index % len(_MARKERS)]
