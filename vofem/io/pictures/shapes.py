"""Springs, supports and ground as shapes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vofem.io.pictures.drawing import BLOCK, GROUND, Drawing, Patch, circle

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


def element(
    drawing: Drawing, start: ArrayLike, end: ArrayLike, half: float, color: str, width: float, kind: str = "spring"
) -> None:
    """Add a spring, a zigzag of half width `half`, or a dashpot, a piston in a cup, from start to end in pixels."""
    first = np.asarray(start, dtype=float)
    way = np.asarray(end, dtype=float) - first
    normal = half * np.array([-way[1], way[0]]) / max(float(np.hypot(*way)), 1e-9)
    for stroke in _STROKES[kind]:
        points = first + np.array(stroke) @ np.stack([way, normal])
        drawing.line(points[:, 0], points[:, 1], color, width, behind=True)


def clamp(drawing: Drawing, x: float, y: float, half: float, unit: float, facing: int) -> None:
    """Add a clamped support: a block left of x (facing 1), right of it (-1), or on both faces of the beam (0)."""
    if facing:
        outer = x - facing * 38.0 * unit
        height = half + 52.0 * unit
        drawing.rectangle((x, outer), (y - height, y + height), BLOCK)
        return
    for side in (-1.0, 1.0):
        face = y + side * half
        drawing.rectangle((x - 20.0 * unit, x + 20.0 * unit), (face, face + side * 30.0 * unit), BLOCK)


def pin(drawing: Drawing, x: float, y: float, half: float, unit: float) -> None:
    """Add a pinned support: a triangle under the beam on a piece of ground."""
    tip, foot = y - half, y - half - 32.0 * unit
    corners = [[x, tip], [x - 22.0 * unit, foot], [x + 22.0 * unit, foot]]
    drawing.patches.append(Patch(np.array(corners), BLOCK))
    drawing.rectangle((x - 34.0 * unit, x + 34.0 * unit), (foot - 7.0 * unit, foot), GROUND)


def guide(drawing: Drawing, x: float, y: float, half: float, span: tuple[float, float], unit: float, side: int) -> None:
    """Add a guided support: rollers between the beam, at height y, and a wall over the range of its motion.

    `span`: lowest and highest height of the axis.
    `side`: -1: the wall is left of x; 1: right; 0: on both sides of an inner node.
    """
    radius = 8.0 * unit
    for direction in (side,) if side else (-1, 1):
        near = x + direction * 2.0 * radius
        more = half + 14.0 * unit
        drawing.rectangle((near, near + direction * 16.0 * unit), (span[0] - more, span[1] + more), BLOCK)
        for level in (-0.55, 0.55):
            disc(drawing, x + direction * radius, y + level * half, radius, GROUND)


def disc(drawing: Drawing, x: float, y: float, radius: float, color: str) -> None:
    """Add a filled circle."""
    drawing.patches.append(Patch(circle(x, y, radius), color))


def spiral(drawing: Drawing, x: float, y: float, radius: float, color: str, width: float) -> None:
    """Add a spring in rotation: a spiral of two turns and a half."""
    turn = np.linspace(0.0, 5.0 * np.pi, 121)
    away = radius * turn / turn[-1]
    drawing.line(x + away * np.cos(turn), y + away * np.sin(turn), color, width)


def arrow(drawing: Drawing, start: ArrayLike, end: ArrayLike, unit: float, color: str) -> None:
    """Add an arrow from start to end, whose head is at most as long as the arrow."""
    first, last = np.array(start, dtype=float), np.array(end, dtype=float)
    size = float(np.hypot(*(last - first)))
    if size <= 0.0:
        return
    along = (last - first) / size
    head = min(17.0 * unit, max(size, 8.0 * unit))
    back, aside = last - head * along, 0.45 * head * np.array([-along[1], along[0]])
    if size > head:
        drawing.line([first[0], back[0]], [first[1], back[1]], color, 4.2 * unit)
    drawing.patches.append(Patch(np.array([last, back + aside, back - aside]), color))
