"""A side view in pixels: `layout` arranges it, `sketch` composes it, and matplotlib draws it.

The origin is the lower left corner, y points up. Shapes are gathered first. matplotlib then gets one collection of each
kind, which it draws faster than an artist for each shape. Shapes are drawn in the order of their kinds: lines behind,
patches, strips, lines, dots, labels.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.arrays import Array

Box = tuple[float, float, float, float]

#: Colour map of the bending moment by its name in matplotlib: blue where negative, red where positive.
COLORMAP = "RdBu_r"

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

#: Pixels per inch.
DPI = 100.0


_COILS = 5
_ZIGZAG = (np.arange(2 * _COILS) + 0.5) / (2 * _COILS)

#: Strokes of a spring and of a dashpot, shape (k, 2): shares of the way from start to end, and of half the width.
_STROKES = {
    "spring": [
        [(0.0, 0.0), (0.12, 0.0), *zip(0.12 + 0.76 * _ZIGZAG, (-1.0) ** np.arange(2 * _COILS), strict=True),
         (0.88, 0.0), (1.0, 0.0)],
    ],
    "damper": [
        [(0.0, 0.0), (0.48, 0.0)],
        [(0.48, -0.7), (0.48, 0.7)],
        [(0.3, -1.0), (0.68, -1.0), (0.68, 1.0), (0.3, 1.0)],
        [(0.68, 0.0), (1.0, 0.0)],
    ],
}  # fmt: skip


@dataclass(frozen=True)
class Strip:
    """The area between two curves over a common x, coloured by values: a ribbon or a diagram."""

    #: `x`, `low`, `high`: coordinates in pixels, shape (k,).
    x: Array
    low: Array
    high: Array
    values: Array  #: Values in the unit of `Drawing.limit`, shape (k,).


@dataclass(frozen=True)
class Patch:
    """A filled polygon, points of shape (k, 2)."""

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
    """Shapes of a picture."""

    size: tuple[int, int]  #: Width and height in pixels.
    limit: float = 1.0  #: Strips are coloured from -limit to limit.
    strips: list[Strip] = field(default_factory=list)
    patches: list[Patch] = field(default_factory=list)
    lines: list[Line] = field(default_factory=list)
    dots: list[Patch] = field(default_factory=list)
    labels: list[Label] = field(default_factory=list)
    #: Left, bottom, right and top of areas other than labels that `place` keeps free of labels.
    taken: list[Box] = field(default_factory=list)

    def line(self, x: object, y: object, color: str, width: float, behind: bool = False) -> None:
        """Add a polyline."""
        points = np.stack(np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float)), axis=1)
        self.lines.append(Line(points, color, width, behind))

    def dot(self, x: float, y: float, color: str, diameter: float) -> None:
        """Add a dot above all lines."""
        self.dots.append(Patch(circle(x, y, 0.5 * diameter), color))

    def rectangle(self, across: tuple[float, float], upward: tuple[float, float], color: str) -> None:
        """Add a filled rectangle, between two x and two y in any order."""
        (left, right), (bottom, top) = sorted(across), sorted(upward)
        corners = [[left, bottom], [right, bottom], [right, top], [left, top]]
        self.patches.append(Patch(np.array(corners, dtype=float), color))

    def element(
        self, start: ArrayLike, end: ArrayLike, half: float, color: str, width: float, kind: str = "spring"
    ) -> None:
        """Add a spring, a zigzag of half width `half`, or a dashpot, a piston in a cup, from start to end in pixels."""
        first = np.asarray(start, dtype=float)
        way = np.asarray(end, dtype=float) - first
        normal = half * np.array([-way[1], way[0]]) / max(float(np.hypot(*way)), 1e-9)
        for stroke in _STROKES[kind]:
            points = first + np.array(stroke) @ np.stack([way, normal])
            self.line(points[:, 0], points[:, 1], color, width, behind=True)

    def clamp(self, x: float, y: float, half: float, unit: float, facing: int) -> None:
        """Add a clamped support: a block left of x (facing 1), right of it (-1), or on both faces of the beam (0)."""
        if facing:
            outer = x - facing * 38.0 * unit
            height = half + 52.0 * unit
            self.rectangle((x, outer), (y - height, y + height), BLOCK)
            return
        for side in (-1.0, 1.0):
            face = y + side * half
            self.rectangle((x - 20.0 * unit, x + 20.0 * unit), (face, face + side * 30.0 * unit), BLOCK)

    def pin(self, x: float, y: float, half: float, unit: float) -> None:
        """Add a pinned support: a triangle under the beam on a piece of ground."""
        tip, foot = y - half, y - half - 32.0 * unit
        corners = [[x, tip], [x - 22.0 * unit, foot], [x + 22.0 * unit, foot]]
        self.patches.append(Patch(np.array(corners), BLOCK))
        self.rectangle((x - 34.0 * unit, x + 34.0 * unit), (foot - 7.0 * unit, foot), GROUND)

    def guide(self, x: float, y: float, half: float, span: tuple[float, float], unit: float, side: int) -> None:
        """Add a guided support: rollers between the beam, at height y, and a wall over the range of its motion.

        `span`: lowest and highest height of the axis.
        `side`: -1: the wall is left of x; 1: right; 0: on both sides of an inner node.
        """
        radius = 8.0 * unit
        for direction in (side,) if side else (-1, 1):
            near = x + direction * 2.0 * radius
            more = half + 14.0 * unit
            self.rectangle((near, near + direction * 16.0 * unit), (span[0] - more, span[1] + more), BLOCK)
            for level in (-0.55, 0.55):
                self.disc(x + direction * radius, y + level * half, radius, GROUND)

    def disc(self, x: float, y: float, radius: float, color: str) -> None:
        """Add a filled circle."""
        self.patches.append(Patch(circle(x, y, radius), color))

    def spiral(self, x: float, y: float, radius: float, color: str, width: float) -> None:
        """Add a spring in rotation: a spiral of two turns and a half."""
        turn = np.linspace(0.0, 5.0 * np.pi, 121)
        away = radius * turn / turn[-1]
        self.line(x + away * np.cos(turn), y + away * np.sin(turn), color, width)

    def arrow(self, start: ArrayLike, end: ArrayLike, unit: float, color: str) -> None:
        """Add an arrow from start to end, whose head is at most as long as the arrow."""
        first, last = np.array(start, dtype=float), np.array(end, dtype=float)
        size = float(np.hypot(*(last - first)))
        if size <= 0.0:
            return
        along = (last - first) / size
        head = min(17.0 * unit, max(size, 8.0 * unit))
        back, aside = last - head * along, 0.45 * head * np.array([-along[1], along[0]])
        if size > head:
            self.line([first[0], back[0]], [first[1], back[1]], color, 4.2 * unit)
        self.patches.append(Patch(np.array([last, back + aside, back - aside]), color))

    def place(self, *labels: Label) -> bool:
        """Add the first of some labels that lies inside and covers nothing; return whether there is one."""
        for candidate in labels:
            left, bottom, right, top = candidate.box
            inside = left >= 0.0 and bottom >= 0.0 and right <= self.size[0] and top <= self.size[1]
            boxes = [*self.taken, *(placed.box for placed in self.labels)]
            if inside and not any(left < b[2] and b[0] < right and bottom < b[3] and b[1] < top for b in boxes):
                self.labels.append(candidate)
                return True
        return False

    def figure(self) -> Any:
        """Return the picture as a figure of matplotlib."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.collections import LineCollection, PolyCollection, QuadMesh
        from matplotlib.figure import Figure
        from matplotlib.transforms import Affine2D

        # Figure is used and not pyplot, because it shares no state with other code and opens no window.
        figure = Figure(figsize=(self.size[0] / DPI, self.size[1] / DPI), dpi=DPI, facecolor="white")
        FigureCanvasAgg(figure)
        point, pixels = 72.0 / DPI, Affine2D().scale(1.0 / DPI) + figure.dpi_scale_trans

        def add(collection: Any, zorder: int) -> None:
            collection.set(transform=pixels, zorder=zorder)
            figure.add_artist(collection, clip=False)

        for zorder, patches in ((2, self.patches), (5, self.dots)):
            colors = [patch.color for patch in patches]
            add(PolyCollection([patch.points for patch in patches], facecolors=colors, edgecolors="none"), zorder)
        for zorder, lines in ((1, [k for k in self.lines if k.behind]), (4, [k for k in self.lines if not k.behind])):
            widths, colors = [point * line.width for line in lines], [line.color for line in lines]
            collection = LineCollection([line.points for line in lines], linewidths=widths, colors=colors)
            collection.set(capstyle="projecting", joinstyle="round")
            add(collection, zorder)
        for strip in self.strips:
            corners = np.stack([np.stack([strip.x, y], axis=1) for y in (strip.low, strip.high)])
            values = np.stack([strip.values, strip.values])
            # As an image in vector formats: triangles of colour show seams in some viewers.
            mesh = QuadMesh(corners, shading="gouraud", cmap=COLORMAP, array=values, rasterized=True)
            mesh.set_clim(-self.limit, self.limit)
            add(mesh, 3)
        for label in self.labels:
            weight = "bold" if label.bold else "normal"
            # A name is text, not mathematics.
            figure.text(
                label.x, label.y, label.text, transform=pixels, parse_math=False, color=label.color, weight=weight,
                fontsize=label.size * point, ha=label.align, va="center", zorder=6,
            )  # fmt: skip
        return figure

    def pixels(self) -> NDArray[np.uint8]:
        """Return the picture as colours of pixels, shape (height, width, 3)."""
        canvas = self.figure().canvas
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def circle(x: float, y: float, radius: float) -> Array:
    """Return the corners of a polygon that looks like a circle, shape (32, 2)."""
    angle = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
    return np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=1)
