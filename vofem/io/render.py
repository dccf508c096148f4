"""Pictures with VTK, off-screen; with matplotlib where VTK does not work."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from vofem.files.whole import replacing, target
from vofem.io.probe import Probe, cure, prepare_environment, probe, remembered, try_out
from vofem.result import Result
from vofem.scene import Scene
from vofem.statics import Equilibrium

if TYPE_CHECKING:
    from vofem.io.pictures.drawing import Drawing
    from vofem.io.pictures.history_figure import RunView
    from vofem.io.pictures.studio import Studio

__all__ = ["Probe", "RenderOutcome", "probe", "render"]


@dataclass(frozen=True)
class RenderOutcome:
    """What was drawn.

    Attributes
    ----------
    path : Path
    backend : str
        "vtk" or "matplotlib".
    message : str
        Why matplotlib was used and how to get VTK; empty where VTK drew.
    """

    path: Path
    backend: str
    message: str


def render(
    result: Result | Equilibrium,
    t: float | None,
    path: str | os.PathLike[str],
    *,
    scene: Scene | None = None,
    size: tuple[int, int] = (1600, 700),
    magnification: float | None = None,
) -> RenderOutcome:
    """Draw the side view of a scene at time t.

    Beams are coloured by their bending moment, which is also drawn above
    them on the side in tension; closed contacts carry their force. Colours and
    magnification are those of the whole run, so that pictures of one run at
    several times can be compared.

    Parameters
    ----------
    result : Result or Equilibrium
    t : float or None
        Time, s; None for an equilibrium.
    path : path of a .png
    scene : Scene, optional
        The scene of an equilibrium.
    size : tuple of int
        Width and height in pixels.
    magnification : float, optional
        Factor by which displacements are enlarged. The default is the largest 1, 2 or 5 times a power of ten at which
        the motion fits into the picture. In a scene without beams the picture is taken to be 1 m wide.

    Returns
    -------
    RenderOutcome

    Raises
    ------
    ArgumentError
        If the time lies outside the run, or the size or the suffix is not possible.
    OutputError
        If the file cannot be written.
    """
    goal, drawing = sketched(result, t, path, scene=scene, size=size, magnification=magnification)
    found = remembered()
    with replacing(goal) as temporary:
        if found is None:
            found = try_out(drawing, temporary)
        elif found.works:
            prepare_environment()
            from vofem.io.pictures import backend_vtk

            temporary.write_bytes(backend_vtk.draw(drawing))
        if not found.works:
            from vofem.io.pictures import backend_matplotlib

            backend_matplotlib.draw(drawing, temporary)
    return _outcome(goal, found)


def _outcome(goal: Path, found: Probe) -> RenderOutcome:
    if found.works:
        return RenderOutcome(goal, "vtk", "")
    message = f"drawn with matplotlib, because VTK does not work here: {found.detail}. To get VTK, {cure()}"
    return RenderOutcome(goal, "matplotlib", message)


def sketched(
    result: Result | Equilibrium,
    t: float | None,
    path: str | os.PathLike[str],
    *,
    scene: Scene | None = None,
    size: tuple[int, int] = (1600, 700),
    magnification: float | None = None,
) -> tuple[Path, Drawing]:
    """Return where a picture goes and what is on it; parameters are those of `render`."""
    from vofem.io.pictures.sketch import sketch
    from vofem.io.pictures.snapshot import snapshot

    return target(path, (".png",)), sketch(snapshot(result, t, scene), size, magnification)


def collect(studio: Studio, picture: Path | None, drawing: Drawing, goal: Path) -> RenderOutcome:
    """Wait for a side view that a studio was asked for, and put it in its place; draw it here where it failed."""
    drawn = studio.wait()
    with replacing(goal) as temporary:
        if drawn and picture is not None:
            temporary.write_bytes(picture.read_bytes())
        else:
            from vofem.io.pictures import backend_matplotlib

            backend_matplotlib.draw(drawing, temporary)
    assert studio.found is not None
    return _outcome(goal, studio.found)


def collect_history(studio: Studio, picture: Path, views: Sequence[RunView], goal: Path) -> Path:
    """Wait for histories that a studio was asked for, and put them in their place; draw them here where it failed."""
    from vofem.io.pictures import history_figure

    if not studio.wait_for_history():
        history_figure.draw(views, goal)
        return goal
    with replacing(goal) as temporary:
        temporary.write_bytes(picture.read_bytes())
    return goal
