"""Side views of a scene at one time."""

from __future__ import annotations

import os
from pathlib import Path

from vofem.files.whole import writer
from vofem.result import Result
from vofem.scene import Scene
from vofem.statics import Equilibrium

__all__ = ["render"]


@writer(".png", ".pdf", ".svg")
def render(
    result: Result | Equilibrium,
    t: float | None,
    path: str | os.PathLike[str],
    *,
    scene: Scene | None = None,
    size: tuple[int, int] = (1600, 700),
    magnification: float | None = None,
) -> None:
    """Draw the side view of a scene at time t.

    Beams are coloured by their bending moment, which is also drawn above them on the side in tension; closed contacts
    carry their force. Colours and magnification are those of the whole run, so that pictures of one run at several
    times can be compared.

    Parameters
    ----------
    result : Result or Equilibrium
    t : float or None
        Time, s; None for an equilibrium.
    scene : Scene, optional
        The scene of an equilibrium.
    size : tuple of int
        Width and height in pixels.
    magnification : float, optional
        Factor by which displacements are enlarged. The default is the largest 1, 2 or 5 times a power of ten at which
        the motion fits into the picture. In a scene without beams the picture is taken to be 1 m wide.

    Raises
    ------
    ArgumentError
        If the time lies outside the run, or the size or the suffix is not possible.
    """
    from vofem.io.pictures.axes import write_figure
    from vofem.io.pictures.drawing import DPI
    from vofem.io.pictures.sketch import sketch
    from vofem.io.pictures.snapshot import snapshot

    # Of a vector format this is the resolution of the strips of moments.
    path = Path(path)
    dpi = DPI if path.suffix.lower() == ".png" else 3.0 * DPI
    figure = sketch(snapshot(result, t, scene), size, magnification).figure()
    write_figure(figure, path, dpi=dpi, facecolor="white")
