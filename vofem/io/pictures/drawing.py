"""A picture as plain shapes in pixels: `layout` arranges them, `sketch` composes them, and a backend draws them.

The origin is the lower left corner, y points up. Shapes are drawn in the order
of their kinds: lines behind, patches, strips, lines, dots, labels.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

#: Colour map of the bending moment by its name in matplotlib: blue where negative, red where positive.
COLORMAP = "RdBu_r"

#: Its colours, evenly spaced, between which it is linear: RdBu of ColorBrewer (https://colorbrewer2.org), reversed.
_COLORS = (
    (5, 48, 97), (33, 102, 172), (67, 147, 195), (146, 197, 222), (209, 229, 240), (247, 247, 247), (253, 219, 199),
    (244, 165, 130), (214, 96, 77), (178, 24, 43), (103, 0, 31),
)  # fmt: skip

INK = "#16181d"
PAPER = "#ffffff"
BLOCK = "#3b4150"
GROUND = "#c4c7cd"
OUTLINE = "#a0a3b1"
SPRING = "#5b6270"
OPEN = "#9aa0aa"
OPEN_TEXT = "#6b7280"
CLOSED = "#e07b21"
CLOSED_TEXT = "#8f4306"
MASS = "#8f9bb0"

#: All colours except that of the paper.
PALETTE = (INK, BLOCK, GROUND, OUTLINE, SPRING, OPEN, OPEN_TEXT, CLOSED, CLOSED_TEXT, MASS)


def moment_colors(count: int) -> Array:
    """Return `count` evenly spaced colours of `COLORMAP`, shape (count, 3), from 0 to 1, without matplotlib."""
    stops, wanted = np.linspace(0.0, 1.0, len(_COLORS)), np.linspace(0.0, 1.0, count)
    return np.stack([np.interp(wanted, stops, channel) for channel in np.array(_COLORS).T / 255.0], axis=1)


@dataclass(frozen=True)
class Strip:
    """The area between two curves over a common x, coloured by values: a ribbon or a diagram.

    Attributes
    ----------
    x, low, high : ndarray, shape (k,)
        Coordinates in pixels.
    values : ndarray, shape (k,)
        Values in the unit of `Drawing.limit`.
    """

    x: Array
    low: Array
    high: Array
    values: Array


@dataclass(frozen=True)
class Patch:
    """A filled convex polygon, points of shape (k, 2)."""

    points: Array
    color: str


@dataclass(frozen=True)
class Line:
    """A polyline, points of shape (k, 2), width in pixels; `behind` puts it below all else."""

    points: Array
    color: str
    width: float
    behind: bool = False


@dataclass(frozen=True)
class Dots:
    """Round dots, points of shape (k, 2), diameter in pixels."""

    points: Array
    color: str
    diameter: float


@dataclass(frozen=True)
class Label:
    """A line of text. `align` is "left", "center" or "right" of x; y is the middle of the line."""

    x: float
    y: float
    text: str
    color: str
    size: float
    align: str = "left"
    bold: bool = False

    @property
    def box(self) -> Box:
        """Left, bottom, right and top, estimated from the number of characters."""
        width = 0.58 * self.size * len(self.text)
        left = self.x - {"left": 0.0, "center": 0.5, "right": 1.0}[self.align] * width
        return left, self.y - 0.6 * self.size, left + width, self.y + 0.6 * self.size


@dataclass
class Drawing:
    """Shapes of a picture.

    Attributes
    ----------
    size : tuple of int
        Width and height in pixels.
    limit : float
        Strips are coloured from -limit to limit.
    taken : list of tuple
        Left, bottom, right and top of areas other than labels that `place` keeps free of labels.
    """

    size: tuple[int, int]
    limit: float = 1.0
    strips: list[Strip] = field(default_factory=list)
    patches: list[Patch] = field(default_factory=list)
    lines: list[Line] = field(default_factory=list)
    dots: list[Dots] = field(default_factory=list)
    labels: list[Label] = field(default_factory=list)
    taken: list[Box] = field(default_factory=list)

    def line(self, x: object, y: object, color: str, width: float, behind: bool = False) -> None:
        """Add a polyline."""
        points = np.stack(np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float)), axis=1)
        self.lines.append(Line(points, color, width, behind))

    def dot(self, x: Array, y: Array, color: str, diameter: float) -> None:
        """Add dots."""
        self.dots.append(Dots(np.stack([x, y], axis=1), color, diameter))

    def rectangle(self, across: tuple[float, float], upward: tuple[float, float], color: str) -> None:
        """Add a filled rectangle, between two x and two y in any order."""
        (left, right), (bottom, top) = sorted(across), sorted(upward)
        corners = [[left, bottom], [right, bottom], [right, top], [left, top]]
        self.patches.append(Patch(np.array(corners, dtype=float), color))

    def place(self, label: Label, others: list[Label]) -> bool:
        """Add the first of `label` and `others` that lies inside and covers nothing; return whether there is one."""
        for candidate in (label, *others):
            left, bottom, right, top = candidate.box
            inside = left >= 0.0 and bottom >= 0.0 and right <= self.size[0] and top <= self.size[1]
            boxes = [*self.taken, *(placed.box for placed in self.labels)]
            if inside and not any(_overlap(candidate.box, box) for box in boxes):
                self.labels.append(candidate)
                return True
        return False


def _overlap(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
