"""The common parts of pictures with axes: the axes, colours, legends and saving.

A figure of vofem has its own style unless the user has chosen one. If a style sheet of matplotlib is in use, or
``rcParams`` of axes, grids, lines, fonts or legends differ from the defaults of matplotlib, the figure follows these.
"""

from __future__ import annotations

import functools
import inspect
import os
import re
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from vofem._validate import wrong
from vofem.errors import ArgumentError
from vofem.files.whole import documented, replacing, target

#: The file to which a picture is written, or None.
Where = str | os.PathLike[str] | None

INK = "#16181d"
_COLORS = ("#e07b21", "#2f6fae", "#3f8f5b", "#8a5aa8", "#b23a48", "#6b7280")

_SUFFIXES = (".png", ".pdf", ".svg")

#: First parts of the names of the parameters with which users choose a style.
_LOOKS = ("axes.", "grid.", "lines.", "font.", "legend.", "xtick.", "ytick.")

#: Figures that were made here, whose legends have room beside the axes.
_OWN: weakref.WeakSet[Any] = weakref.WeakSet()


def goal_of(path: Where) -> Path | None:
    """Return the file to which a picture is written, or None. Raise `OutputError` if it cannot be written."""
    return None if path is None else target(path, _SUFFIXES)


#: Parameters that several pictures have.
_SHARED = {
    "contact": "Contact or str, optional\n    The contact. It must be given if the scene has several.",
    "window": (
        "(float, float), optional\n    Begin and end of the time that is drawn, in s. The default is the whole run."
    ),
    "path": "path of a .png, .pdf or .svg, optional\n    The file to write.",
    "ax": "matplotlib axes, optional\n    The axes to draw into. By default a new figure is made.",
}

F = TypeVar("F", bound=Callable[..., Any])


def figure(draw: F) -> F:
    """Make a function of the user of one that draws on a `Canvas` and returns it.

    The function has parameters `path` and `ax`, and its first one is what is drawn. If this is nothing of its type, or
    the file cannot be written, that is told before the work begins. What is drawn is written to `path`, which is
    returned, or else the axes are. The docstring gets what all of them share.
    """
    names = list(inspect.signature(draw).parameters)
    subject, place = names[0], names.index("path")
    hint = get_type_hints(draw)[subject]
    expected = re.search(rf"^ *{subject} : (.*)$", draw.__doc__ or "", re.MULTILINE)
    assert expected is not None

    @functools.wraps(draw)
    def drawn(*given: Any, **named: Any) -> Any:
        goal_of(named.get("path", given[place] if len(given) > place else None))
        thing = given[0] if given else named.get(subject)
        if not _fits(thing, hint):
            raise wrong(f"{draw.__name__}: {subject}", repr(thing), expected[1])
        return draw(*given, **named).done()

    drawn.__doc__ = documented(draw, _SHARED, "Path or matplotlib axes\n    `path` where one is given, else the axes.")
    return drawn  # type: ignore[return-value]


def _fits(thing: Any, hint: Any) -> bool:
    """Return whether a thing is of a type, or a mapping or sequence of such things that is not empty."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin is UnionType:
        return any(_fits(thing, part) for part in parts)
    if origin is None:
        return isinstance(thing, hint)
    within = thing.values() if isinstance(thing, Mapping) else thing
    return isinstance(thing, origin) and bool(within) and all(_fits(one, parts[-1]) for one in within)


# -- the look -----------------------------------------------------------------------------------------


def restyled() -> bool:
    """Return whether the user has chosen a style of matplotlib, such as a style sheet."""
    from matplotlib import rcParams, rcParamsDefault

    return any(rcParams[key] != value for key, value in rcParamsDefault.items() if key.startswith(_LOOKS))


def _cycle() -> list[str]:
    """Return the colours of lines. The first one is for the main quantity of a picture."""
    if not restyled():
        return [INK, *_COLORS]
    from matplotlib import rcParams

    return list(rcParams["axes.prop_cycle"].by_key().get("color", [INK]))


def ink() -> str:
    """Return the colour of the main quantity of a picture."""
    return _cycle()[0]


def color_of(k: int) -> str:
    """Return the colour of the k-th of several lines, counted from 0."""
    return ink() if k == 0 else str(COLORS[(k - 1) % len(COLORS)])


class _Colors(Sequence[str]):
    """The other colours, taken from the user's style if there is one. They are looked up when they are needed."""

    def __len__(self) -> int:
        return len(_COLORS)

    def __getitem__(self, index: Any) -> Any:
        cycle = _cycle()
        return [cycle[(k + 1) % len(cycle)] for k in range(len(_COLORS))][index]


COLORS = _Colors()


def stroke(width: float) -> float:
    """Return the width of a line in points, which follows that of the user's style."""
    from matplotlib import rcParams, rcParamsDefault

    return float(width * rcParams["lines.linewidth"] / rcParamsDefault["lines.linewidth"])


def text_size(points: float) -> float:
    """Return the size of a text, which follows that of the user's style."""
    from matplotlib import rcParams, rcParamsDefault

    return float(points * rcParams["font.size"] / rcParamsDefault["font.size"])


# -- where it is drawn --------------------------------------------------------------------------------


class Canvas:
    """The axes of a picture: those that the user has given, or those of a new figure.

    Without a file and without axes the figure is one of ``matplotlib.pyplot``, so that notebooks and
    ``pyplot.show()`` show it.

    `what`: the function that draws, for messages.
    `path`: the file.
    `ax`: the axes of the user, in the order of rows.
    `size`: width and height of a new figure in inches.
    `options`: further options of ``Figure.subplots``.
    `grid` has shape (rows, columns).
    Raises `ArgumentError` if `ax` does not have the required number of axes.
    """

    def __init__(
        self, what: str, path: Where, ax: Any, size: tuple[float, float], rows: int = 1, columns: int = 1,
        **options: Any,
    ) -> None:  # fmt: skip
        self._goal = goal_of(path)
        if ax is not None:
            self.grid = _given(what, ax, rows * columns).reshape(rows, columns)
            self.figure = self.grid[0, 0].figure
            return
        own_look = restyled()
        look: dict[str, Any] = {} if own_look else {"dpi": 140, "facecolor": "white"}
        if self._goal is None:
            from matplotlib.pyplot import figure as new_figure
        else:
            from matplotlib.figure import Figure as new_figure  # noqa: N813
        self.figure = new_figure(figsize=size, layout="constrained", **look)
        _OWN.add(self.figure)
        self.grid = self.figure.subplots(rows, columns, squeeze=False, **options)
        if own_look:
            return
        for axes in self.grid.flat:
            axes.grid(color="#e3e5e9", linewidth=0.7)
            axes.set_axisbelow(True)
            axes.spines[["top", "right"]].set_visible(False)

    def done(self) -> Any:
        """Write the file; return its path, or without one the axes: one, or an array of them."""
        if self._goal is None:
            return self.grid[0, 0] if self.grid.size == 1 else np.squeeze(self.grid)
        return save(self.figure, self._goal)


def single(what: str, path: Where, ax: Any, size: tuple[float, float]) -> tuple[Canvas, Any]:
    """Return a canvas of one picture, and its axes."""
    canvas = Canvas(what, path, ax, size)
    return canvas, canvas.grid[0, 0]


def _given(what: str, ax: Any, count: int) -> Any:
    """Return the axes that a user has given as an array."""
    listed = np.ravel(np.asarray(ax, dtype=object))
    if listed.size != count or not all(hasattr(one, "plot") and hasattr(one, "figure") for one in listed):
        expected = "matplotlib axes" if count == 1 else f"{count} matplotlib axes in a sequence"
        raise ArgumentError(f"{what}: ax is {ax!r}, expected {expected}; leave it out for a figure of its own")
    return listed


def panels(size: tuple[float, float], rows: int = 1, columns: int = 1, **options: Any) -> tuple[Any, Any]:
    """Return a new figure for a file, with its size in inches, and its axes, shape (rows, columns)."""
    canvas = Canvas("panels", "panels.png", None, size, rows, columns, **options)
    return canvas.figure, canvas.grid


def save(figure: Any, goal: Path) -> Path:
    """Write a figure to its file, completely or not at all."""
    with replacing(goal) as temporary:
        write_figure(figure, temporary)
    return goal


def write_figure(figure: Any, path: Path, **options: Any) -> None:
    """Write a figure to a file of the format that the suffix names; options are those of matplotlib."""
    # In memory first: where a disk is full, a PDF would end with an AttributeError of matplotlib.
    content = BytesIO()
    figure.savefig(content, format=path.suffix[1:].lower(), **options)
    path.write_bytes(content.getvalue())


def plain(text: str) -> str:
    """Return a name as matplotlib shows it unchanged; raise `ArgumentError` if a label is no text."""
    if not isinstance(text, str):
        raise wrong("a label of a picture", repr(text), "a text, such as 'gap [mm]'")
    return text.replace("$", r"\$")


def legend(axes: Any, sources: Iterable[Any] | None = None, most: int = len(COLORS), last: Sequence[str] = ()) -> None:
    """Add a legend with at most `most` lines, beside the axes if there is room for it.

    Lines of several axes, `sources`, are named once; names in `last` come last.
    """
    named: dict[str, Any] = {}
    for source in (axes,) if sources is None else sources:
        for handle, name in zip(*source.get_legend_handles_labels(), strict=True):
            named.setdefault(name, handle)
    if not named:
        return
    for name in last:
        if name in named:
            named[name] = named.pop(name)
    handles, names = list(named.values()), list(named)
    more = len(names) - most
    if more > 0:
        handles, names = handles[:most], [*names[: most - 1], f"{names[most - 1]}, and {more} more"]
    beside(axes, handles, [plain(name) for name in names])


def beside(axes: Any, handles: list[Any], names: list[str]) -> None:
    """Add a legend of these entries: beside the axes in a figure of vofem, within them in one of the user."""
    place: dict[str, Any] = {}
    if axes.figure in _OWN:
        place = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
    look = {} if restyled() else {"frameon": False}
    axes.legend(handles, names, **place, **look, fontsize=text_size(9))
