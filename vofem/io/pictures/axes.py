"""What all pictures with axes share: colours, panels, legends and saving."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from vofem.files.whole import replacing, target

INK = "#16181d"
COLORS = ("#e07b21", "#2f6fae", "#3f8f5b", "#8a5aa8", "#b23a48", "#6b7280")

_SUFFIXES = (".png", ".pdf", ".svg")


def goal_of(path: str | os.PathLike[str]) -> Path:
    """Return where a picture is to be written; raise `OutputError` where it cannot be."""
    return target(path, _SUFFIXES)


def panels(size: tuple[float, float], rows: int = 1, columns: int = 1, **options: Any) -> tuple[Any, Any]:
    """Return a figure, size in inches, and its axes, shape (rows, columns)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=140, layout="constrained", facecolor="white")
    grid = figure.subplots(rows, columns, squeeze=False, **options)
    for axes in grid.flat:
        axes.grid(color="#e3e5e9", linewidth=0.7)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    return figure, grid


def plain(text: str) -> str:
    """Return a name as matplotlib shows it unchanged."""
    return text.replace("$", r"\$")


def legend(axes: Any, sources: Iterable[Any] | None = None, most: int = len(COLORS)) -> None:
    """Add a legend beside the axes, where no curve runs under it, of at most so many lines.

    Lines of several axes, `sources`, are named once.
    """
    named: dict[str, Any] = {}
    for source in (axes,) if sources is None else sources:
        for handle, name in zip(*source.get_legend_handles_labels(), strict=True):
            named.setdefault(name, handle)
    if not named:
        return
    handles, names = list(named.values()), list(named)
    more = len(names) - most
    if more > 0:
        handles, names = handles[:most], [*names[: most - 1], f"{names[most - 1]}, and {more} more"]
    axes.legend(handles, map(plain, names), loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)


def save(figure: Any, goal: Path) -> Path:
    """Write a figure to its place, whole or not at all."""
    with replacing(goal) as temporary:
        figure.savefig(temporary)
    return goal
